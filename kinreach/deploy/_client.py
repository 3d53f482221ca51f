"""A client of a UR that reads its state by RTDE, sends programs, waits for their end, and stops them."""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable, Sequence
from contextlib import suppress
from secrets import randbelow
from time import monotonic, sleep
from typing import Self

import numpy as np

from kinreach._checks import Floats, check_count, printable, shown
from kinreach._rotations import pose_error
from kinreach.deploy._connection import TIMEOUT, LostError
from kinreach.deploy._controller import FINISHED, NOT_AT_START, OTHER_ARM, Recording
from kinreach.deploy._model import DhFigures, apart
from kinreach.deploy._primary import PRIMARY_PORT
from kinreach.deploy._program import Program, name_of_run, stop_script
from kinreach.deploy._rtde import RTDE_PORT, RuntimeState
from kinreach.deploy._script_port import ScriptPort
from kinreach.deploy._signals import Interruption
from kinreach.deploy._states import REST, RobotState, StateReader
from kinreach.errors import InputError, RobotError
from kinreach.kinematics import Trajectory, pose
from kinreach.robots.inside import JOINTS

#: Longest time for the start of a program, in addition for each of its characters, and for the arm to stop [s].
START_TIMEOUT, READING_TIME, STOP_TIMEOUT = 3.0, 1e-5, 10.0
#: So long a stop has to take effect before it is sent again, over a new connection [s].
STOP_AGAIN = 0.25
#: So long after a stop a program that was sent before may still begin, and after another one's end the next [s].
LATE = 0.5
#: Longest time between two programs of which the second one ends the first [s].
GAP = 0.2
#: So long an arm that its safety system has halted must be at rest, if it has not ended the stopping program [s].
HALTED = 0.1
#: How far from where its program ends the arm may be: a joint [rad]; the tool of a straight line [m, degrees].
AT_END, TOOL_AT_END = 0.01, (2e-3, 0.5)


class URClient:
    """A connection to a UR, real or simulated. Use it in `with`, by one thread of one process.

    Threads of its own read what the robot sends, so that its state is never old, however long nobody asks for it.

    Args:
        address: Host name or IP address.
        rtde_port: Port of RTDE.
        script_port: Port for programs and messages.

    Raises:
        RobotError: There is no answer, or not one of a UR.
    """

    def __init__(self, address: str, *, rtde_port: int = RTDE_PORT, script_port: int = PRIMARY_PORT) -> None:
        given: object = address
        if not isinstance(given, str) or not given.isprintable() or not 0 < len(given) < 254:
            raise InputError(f"the address of a robot must be a host name or an IP address, got {shown(address)}")
        self.address = address
        ports = [check_count(name, port, most=65535) for name, port in (("rtde_port", rtde_port),
                                                                        ("script_port", script_port))]  # fmt: skip
        self._rtde_port = ports[0]
        self._states = StateReader(address, ports[0])
        try:
            self._script = ScriptPort(address, ports[1])
        except BaseException:
            self._states.close()
            raise
        # also if nobody closes it; the threads know these two, and not the client
        self._open: list[StateReader | ScriptPort] = [self._states, self._script]
        self._close = weakref.finalize(self, _close_all, self._open)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection; a program that runs goes on."""
        self._close()

    def read(self) -> RobotState:
        """Return the robot's newest state, which comes after this call.

        Raises:
            RobotError: The connection broke, or no state comes; it is a `ConnectionError`, too.
        """
        return self._states.read()

    def next_state(self) -> RobotState:
        """Return the state after the one that was returned last; there is one for each control cycle.

        Who has not asked for a second gets the newest one.

        Raises:
            RobotError: As `read`.
        """
        return self._states.next()

    def wait_for_figures(self, seconds: float) -> DhFigures | None:
        """Return the Denavit-Hartenberg figures of the robot's own kinematics, or None if it does not say them in time.

        A controller says them on the ports 30001 and 30002 when a client connects.
        """
        return self._script.wait_for_figures(seconds)

    def send(self, script: str) -> None:
        """Send a program; the running one ends.

        Raises:
            RobotError: The connection is lost; it is a `ConnectionError`, too.
        """
        self._script.send(script, patience=TIMEOUT + READING_TIME * len(script))

    def stop(self) -> None:
        """Stop the robot by `stopj`, within a control cycle, and return when it stands.

        The stop is sent again over new connections until the robot has taken it.

        Raises:
            RobotError: It is not known that the robot stands; the message says what is known.
        """
        self._script.check_usable()
        with Interruption():
            if doubt := self._stop([]):
                raise RobotError(f"the robot at {self.address}: {doubt}")

    def check_ready(self, program: Program) -> None:
        """Check that the robot can run a program now, by its newest state.

        Raises:
            RobotError: It is not running, is stopped, runs another program, stands elsewhere, or has another cycle than
                the program's trajectory.
        """
        self._check_ready(program, self.read())

    def run(
        self,
        program: Program,
        *,
        check: Callable[[RobotState], object] | None = None,
        watch: Callable[[RobotState], object] | None = None,
    ) -> Recording:
        """Send a program and wait for its end.

        The robot is judged by a new state right before the program is sent, and by every one until it ends. It must run
        this program, under its own number, to its end, and stand where the last move ends.

        Whatever ends this early stops the robot, unless another client's program has taken it over. So do Ctrl-C,
        SIGTERM and SIGHUP, which are raised as KeyboardInterrupt when the robot stands; further ones change nothing.

        Args:
            program: Try it in simulation before.
            check: Called with the state by which the robot is judged; nothing is sent if it raises.
            watch: Called with each state.

        Returns:
            `commanded` and `measured`, each a `Trajectory` with a sample for each control cycle.

        Raises:
            RobotError: The robot does not begin or finish the program, reports a stop, a pause, another mode or NaN, or
                was taken over. The message has the robot's reason, if any; `recording` is what was recorded until then.
                If the connection broke it is a `ConnectionError`, too.
        """
        with Interruption() as interruption:
            self._states.keep_all(whether=True)
            try:
                run = _ProgramRun(program, self.read())
                self._check_ready(program, run.states[0])
                if check is not None:
                    check(run.states[0])
                interruption.check()
                self._script.forget()
                self._send_and_follow(run, watch, interruption)
                return self._recording(run.states)
            finally:
                self._states.keep_all(whether=False)

    def _send_and_follow(
        self, run: _ProgramRun, watch: Callable[[RobotState], object] | None, interruption: Interruption
    ) -> None:
        try:
            self.send(run.text)
            self._follow(run, watch, interruption)
            self._check_end(run)
        except _TakenOverError as error:  # the robot moves for somebody else
            raise self._with_recording(error, run) from None
        except BaseException as error:
            if not run.is_over and (doubt := self._stop(run.states, None if run.began else run)):
                what = "interrupted" if isinstance(error, KeyboardInterrupt) else str(error)
                raise self._with_recording(RobotError(f"{what}; {doubt}"), run) from error
            if isinstance(error, KeyboardInterrupt):
                raise KeyboardInterrupt("stopped; the robot stands") from None
            if isinstance(error, LostError):
                raise self._with_recording(LostError(f"{error}; it was stopped and stands"), run) from None
            if isinstance(error, RobotError):
                self._with_recording(error, run)
            raise

    def _follow(
        self, run: _ProgramRun, watch: Callable[[RobotState], object] | None, interruption: Interruption
    ) -> None:
        """Collect states until the program has ended; a robot may be silent while it reads a long one."""
        reading = READING_TIME * len(run.text)
        deadline = monotonic() + START_TIMEOUT + reading
        self._states.patience = TIMEOUT + reading
        try:
            while not run.ended:
                state = self._states.next(interruption.check)
                run.add(state, self._script.started)
                interruption.check()
                if run.began:
                    self._states.patience = TIMEOUT
                for each in (state, *self._states.ahead()):
                    self._judge(run, each)
                if watch is not None:
                    with interruption.armed():
                        watch(state)
                if not run.played and monotonic() > deadline:
                    raise self._not_begun(run, state)
        finally:
            self._states.patience = TIMEOUT

    def _not_begun(self, run: _ProgramRun, state: RobotState) -> RobotError:
        if other := run.only_other(self._script.started):
            return self._taken_over(other, state)
        if state.run != run.states[0].run or state.runtime_state != RuntimeState.STOPPED:
            return self._taken_over("ran another program in place of this one", state)
        return self._error(f"did not begin{self._script.reason(': ')}; is it in remote control?")

    def _taken_over(self, what: str, state: RobotState) -> _TakenOverError:
        return _TakenOverError(f"the robot at {self.address} {what}; {_whereabouts(state)}")

    def _judge(self, run: _ProgramRun, state: RobotState) -> None:
        """Raise if a state says that the program does not go on as it should."""
        if other := run.other_program(state, self._script.started):
            raise self._taken_over(other, state)
        if state.trouble:
            word, reason = state.trouble.partition(" (")[0], self._script.reason()
            reason = reason.removeprefix(f"{word}: ")
            raise self._error(f"stopped: {state.trouble}{f': {reason}' if reason else ''}")
        if state.is_paused:
            raise self._error("paused the program; it is not resumed: plan again from where it stands")

    def _stop(self, states: list[RobotState], sent: _ProgramRun | None = None) -> str:
        """Stop the robot and wait until it stands; return what is not known about that, or nothing.

        It stands when it says that it took the stop, that no program runs, and that its joints are at rest. Until it
        has taken the stop it gets it again, each time over a new connection.

        Args:
            states: Where the states until then are added.
            sent: A program that was sent and has not begun; if it begins after all, the robot is stopped again.
        """
        number, taken, anew, problem = _number(), False, False, ""
        begun = monotonic()
        deadline, again, quiet = begun + STOP_TIMEOUT, begun, begun + (LATE if sent is not None else 0.0)
        state: RobotState | None = None
        rest = math.inf  # the robot's time since when it is at rest
        while (now := monotonic()) < deadline and self._close.alive:
            if now >= again and not taken:
                try:
                    self._script.send(stop_script(number), anew=anew)
                    problem = ""
                except RobotError as error:
                    problem = str(error)
                anew, again = True, monotonic() + STOP_AGAIN
            news = self._states_within(STOP_AGAIN)
            states += news
            state = news[-1] if news else None
            if state is None:
                continue
            if taken and state.run not in (None, number):
                if sent is None or state.run != sent.number:
                    return f"it was stopped, and another program began since: {_whereabouts(state)}"
                taken, again, quiet = False, 0.0, monotonic() + LATE
            # an old controller has no register that says what it took
            taken = taken or state.run == number or (state.run is None and not problem and now > begun + STOP_AGAIN)
            for each in news:
                rest = min(rest, each.time) if each.stands else math.inf
            stopped = taken and state.runtime_state == RuntimeState.STOPPED
            if state.time >= rest + (0.0 if stopped else HALTED) and (stopped or state.is_halted) and now >= quiet:
                return ""
        what = "its state is not known" if state is None else _motion(state, taken=taken)
        because = f" ({problem})" if problem else ""
        return f"it is not confirmed that the robot stands: {what}{because}; use its emergency stop"

    def _states_within(self, seconds: float) -> list[RobotState]:
        """Return the states since the last one; if there are none the connection is a new one, if possible."""
        until = monotonic() + seconds
        self._states.patience = seconds
        try:
            return self._states.read_all()
        except RobotError:
            self._states.close()
            with suppress(RobotError):
                self._states = StateReader(self.address, self._rtde_port)
                self._open[0] = self._states
                return []
        finally:
            self._states.patience = TIMEOUT
        sleep(max(0.0, until - monotonic()))
        return []

    def _check_ready(self, program: Program, state: RobotState) -> None:
        if state.trouble:
            raise self._error(f"is not ready: {state.trouble}; power it on, release brakes and stops")
        if state.runtime_state != RuntimeState.STOPPED:
            raise self._error("runs a program already; end that one first")
        off = np.abs(state.actual_q - program.start)
        if not off.max() <= program.tolerance:
            joint = int(off.argmax())
            way = f"{JOINTS[joint]} is {off[joint]:.4f} rad off, {program.tolerance:g} at most"
            raise self._error(f"does not stand where the program begins: {way}; plan again")
        if program.trajectory is not None:
            period, cycle = float(program.trajectory.t[1]), self._states.cycle
            if abs(period / cycle - max(1, round(period / cycle))) > 1e-6:
                raise self._error(
                    f"has control cycles of {1000 * cycle:g} ms, and the trajectory a posture every {1000 * period:g} "
                    f"ms; make the program for this robot's model, or of `trajectory.resampled({round(1 / cycle)})`"
                )

    def _check_end(self, run: _ProgramRun) -> None:
        """Check that the program came to its end, and the arm to where that is."""
        end = run.states[-1]
        if end.register == NOT_AT_START:
            raise self._error("did not move: it does not stand where the program begins")
        if end.register == OTHER_ARM:
            raise self._error(
                "did not move: its own kinematics is not that of the arm that the program is for; it is another model, "
                "or has another calibration"
            )
        miss = _miss(run.program, end)
        if end.register not in (None, FINISHED):
            wrong = f"ended the program before its last move{self._script.reason(': ')}"
        elif miss:
            wrong = f"does not stand where the program ends: {miss}"
        else:
            return
        self._look_for_another(run)
        raise self._error(f"{wrong}; {_whereabouts(run.states[-1])}")

    def _look_for_another(self, run: _ProgramRun) -> None:
        """Raise if another program came in place of one that did not end as it should; it may begin a little later."""
        until = monotonic() + LATE
        while monotonic() < until:
            state = run.states[-1]
            if other := run.other_program(state, self._script.started) or run.only_other(self._script.started):
                raise self._taken_over(other, state)
            if run.is_over and state.runtime_state == RuntimeState.PLAYING:
                raise self._taken_over("began another program", state)
            run.states.append(self._states.next())

    def _recording(self, states: Sequence[RobotState], reason: str = "") -> Recording:
        """Make the recording of a motion from its states, each time once."""
        t = np.array([state.time for state in states])
        kept = np.flatnonzero(np.diff(t, prepend=-np.inf) > 0)
        rows = [states[index] for index in kept]

        def column(name: str) -> Floats:
            return np.array([getattr(state, name) for state in rows])

        t = t[kept] - t[kept[0]]
        return Recording(
            Trajectory(JOINTS, t, column("target_q"), column("target_qd")),
            Trajectory(JOINTS, t, column("actual_q"), column("actual_qd")),
            rows[-1].register or 0,
            reason,
            missing=max(0, round(float(t[-1]) / self._states.cycle) + 1 - len(t)),
        )

    def _with_recording(self, error: RobotError, run: _ProgramRun) -> RobotError:
        states = [state for state in run.states if "NaN" not in state.trouble]
        error.recording = self._recording(states, str(error)) if states else None
        return error

    def _error(self, what: str) -> RobotError:
        return RobotError(f"the robot at {self.address} {what}")


class _TakenOverError(RobotError):
    """Another client's program runs."""


class _ProgramRun:
    """A program on its way to its end, as the robot's states tell it.

    Attributes:
        number: Of this run; the robot shows it while this program runs, and until another one begins.
        states: Since before it was sent.
        began: Whether the robot has shown the number.
        played: Whether it was seen running.
        is_over: Whether the robot has said that it was this program that ran, and that it runs no longer.
    """

    def __init__(self, program: Program, state: RobotState) -> None:
        self.program, self.states = program, [state]
        self.began = self.played = self.is_over = False
        self._rest = math.inf  # the robot's time since when no program runs
        self.number = _number(other_than=state.run)
        self.text = program.text_of_run(self.number)

    def add(self, state: RobotState, started: Sequence[str]) -> None:
        """Add a state, and look whether the program has begun; `started` are the names that the robot has announced."""
        self.states.append(state)
        plays = state.runtime_state != RuntimeState.STOPPED
        if state.run is not None:
            self.began = self.began or state.run == self.number
        else:  # an old controller, which has no such register
            self.began = name_of_run(self.number) in started or (not started and (self.began or plays))
        self.played = self.began and (self.played or plays)
        self._rest = math.inf if plays else min(self._rest, state.time)
        self.is_over = self.ended and state.run == self.number and not state.trouble

    @property
    def ended(self) -> bool:
        """Whether the program has begun and runs no longer."""
        state = self.states[-1]
        if state.run is None:  # this may be the gap between another one's program and this one
            return self.played and state.time >= self._rest + GAP
        over = self.played or state.register in (FINISHED, NOT_AT_START, OTHER_ARM)
        return self.began and over and state.runtime_state == RuntimeState.STOPPED

    def only_other(self, started: Sequence[str]) -> str:
        """Which other program the robot announced in place of this one, if it announced that one only."""
        if started and name_of_run(self.number) not in started:
            return f"ran another program, {printable(started[-1]) or 'a single line'}, in place of this one"
        return ""

    def other_program(self, now: RobotState, started: Sequence[str]) -> str:
        """Which other program the robot began after this one; empty if it runs this one, or has not begun it yet."""
        own = name_of_run(self.number)
        if own in started and started[-1] != own:
            return f"began another program, {printable(started[-1]) or 'a single line'}, which ended this one"
        if self.began and now.run not in (None, self.number):
            return "began another client's program, which ended this one"
        return ""


def _close_all(connections: Sequence[StateReader | ScriptPort]) -> None:
    for connection in connections:
        connection.close()


def _number(other_than: int | None = None) -> int:
    """Return a number for a run, which no other client has but by a chance of 1 in 2e9."""
    while (number := randbelow(2**31 - 1) + 1) == other_than:
        pass
    return number


def _miss(program: Program, state: RobotState) -> str:
    """How far the arm is from where a program ends; empty if it is there."""
    last = program.moves[-1] if program.moves else None
    if last is not None and last.command == "movel":
        far, turned = pose_error(pose(last.target), pose(state.tcp_pose))
        degrees = float(np.degrees(turned))
        return f"its tool is {1000 * far:.1f} mm and {degrees:.2f}° off" if apart(TOOL_AT_END, far, degrees) else ""
    end = last.target if last is not None else program.trajectory.q[-1]  # type: ignore[union-attr]
    off = np.abs(state.actual_q - end)
    joint = int(off.argmax())
    return "" if off.max() <= AT_END else f"{JOINTS[joint]} is {off[joint]:.3f} rad off"


def _whereabouts(state: RobotState) -> str:
    degrees = np.degrees(state.actual_q).round(1) + 0.0  # no -0.0
    return f"the arm is at {', '.join(f'{angle:.1f}' for angle in degrees)} degrees"


def _motion(state: RobotState, *, taken: bool) -> str:
    if state.trouble and not state.is_halted:
        return state.trouble
    speed = float(np.abs(state.actual_qd).max())
    if speed <= REST:
        return "a program still runs" if taken else "it does not take the stop"
    return f"a joint moves at {speed:.2f} rad/s"
