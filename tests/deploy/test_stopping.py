"""What interrupts a program stops the robot: signals at any moment, a lost connection, and what a robot reports."""

import re
import signal
import sys
import threading
from itertools import product

import numpy as np
import pytest

from kinreach.deploy import Move, Program, SimulatedUR
from kinreach.deploy._connection import LostError
from kinreach.deploy._controller import BRAKING, FINISHED, REGISTER
from kinreach.deploy._server import _RtdeClient, _ScriptClient
from kinreach.deploy._signals import SIGNALS, Interruption
from kinreach.errors import RobotError
from kinreach.kinematics import ArmKinematics
from kinreach.robots import get_arm
from tests.cases import slow

ARM = get_arm("ur5e")
KIN = ArmKinematics.of(ARM, base="base")
HOME = np.array(ARM.home)
#: To and fro for more than a minute: however late a busy machine is, it is not at its end when it is stopped.
AWAY = tuple(np.add(HOME, [1.2, 0, 0, 0, 0, 0]))
LONG = Program.of(KIN, HOME, [Move("movej", place, 1.0, 2.0) for place in 20 * [AWAY, tuple(HOME)]])


class Robot(SimulatedUR):
    """A simulated UR that can be deaf to the first programs that would stop it."""

    deaf = 0

    def run_script(self, text):
        if text.startswith("def kinreach_stop") and self.deaf > 0:
            self.deaf -= 1
        else:
            super().run_script(text)

    def in_its_thread(self, request):
        """Do something that only the robot's thread may do, and wait until it is done."""
        done = threading.Event()
        self._requests.put(lambda: (request(), done.set()))
        assert done.wait(30.0)

    def cut(self, kind):
        """Break the connections of one kind, as a switch that is unplugged."""
        self.in_its_thread(lambda: [self.drop(each) for each in list(self._clients) if isinstance(each, kind)])


@pytest.fixture
def robot():
    log = []
    with Robot(ARM, rtde_port=0, script_port=0, speed=8.0, log=log.append) as served:
        served.log = log
        yield served


@pytest.fixture(autouse=True)
def no_signal_is_ignored():
    """As in a terminal: under `nohup` SIGHUP is ignored, and stays so."""
    before = {number: signal.signal(number, signal.SIG_DFL) for number in SIGNALS if _is_ignored(number)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def _is_ignored(number):
    return signal.getsignal(number) is signal.SIG_IGN


def fast(state):
    """Whether the arm is at full speed."""
    return np.abs(state.target_qd).max() > 0.9


def stands(robot):
    """Whether the robot stands, by itself, and did not come to the end of its program."""
    ur, seen = robot.controller, []
    robot.in_its_thread(
        lambda: seen.append((ur.runtime_state == 1, not ur.target_qd.any(), ur.registers.get(REGISTER)))
    )
    at_rest, still, progress = seen[0]
    return at_rest and still and progress != FINISHED


def stops(robot):
    return robot.log.count("program kinreach_stop is running")


def away(state):
    return np.abs(state.actual_q - HOME).max() > 2e-4


def back(robot, client):
    """Let the next case begin at home."""
    if away(client.read()):  # from home to home it would end before a busy machine has seen it begin
        client.send(f"movej({HOME.tolist()}, a=20, v=3)\n")
        while away(state := client.read()) or state.runtime_state != 1:
            pass
    robot.log.clear()


def at_once(*numbers):
    """Let signals arrive at the same moment."""
    signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    for number in numbers:
        signal.raise_signal(number)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, numbers)


def test_ctrl_c_stops_within_a_cycle_of_the_arrival(robot, client):
    far = Program.of(KIN, HOME, [Move("movej", tuple(np.add(HOME, [6.0, 0, 0, 0, 0, 0])), 1.0, 2.0)])

    def interrupt(state):
        if fast(state):
            raise KeyboardInterrupt

    states, stop = [], client._stop

    def recorded(gathered, sent):
        doubt = stop(gathered, sent)
        states.extend(gathered)
        return doubt

    client._stop = recorded
    with pytest.raises(KeyboardInterrupt, match="stopped; the robot stands"):
        client.run(far, watch=interrupt)
    speeds = np.array([state.target_qd[0] for state in states])
    falling = int(np.flatnonzero(np.diff(speeds) < -1e-4)[0])
    # from full speed, in even steps of 4 rad/s^2, to rest: no cycle between; a busy robot brakes while it reads
    steps = np.diff(speeds)[falling : falling + 100] / 0.002
    reading = int(np.argmax(np.isclose(steps, -4.0, atol=0.05)))
    np.testing.assert_allclose(steps[:reading], -BRAKING, atol=0.05)
    np.testing.assert_allclose(steps[reading:], -4.0, atol=0.05)
    assert reading < 10
    assert speeds[-1] == 0.0
    assert stands(robot)
    assert [line for line in robot.log if line.startswith("program")][-2:] == [
        "program kinreach_stop is running", "program finished"]  # fmt: skip


#: Each signal first and second, and one twice.
SOME = [(SIGNALS[0], SIGNALS[0]), *zip(SIGNALS, SIGNALS[1:] + SIGNALS[:1], strict=True)]


@pytest.mark.parametrize(
    ("first", "second"), [*SOME, *slow(*(pair for pair in product(SIGNALS, SIGNALS) if pair not in SOME))]
)
def test_two_signals_stop_the_robot_however_near_they_are(robot, client, first, second):
    """At once, and the second one in every step of stopping; before the program began, and at full speed."""
    handlers = [signal.getsignal(number) for number in SIGNALS]
    cases, during = 0, []
    within = client._states_within

    def interrupted(seconds):
        during.append(signal.raise_signal(second))
        return within(seconds)

    for when, meanwhile in ((lambda state: True, False), (fast, True)):
        client._states_within = interrupted if meanwhile else within
        with pytest.raises(KeyboardInterrupt, match="stopped; the robot stands"):
            client.run(LONG, watch=lambda state, when=when: at_once(first, second) if when(state) else None)
        assert stands(robot)
        cases += 1
        back(robot, client)
    assert cases == 2
    assert during  # a busy machine sees few steps of it
    assert [signal.getsignal(number) for number in SIGNALS] == handlers


@pytest.fixture
def sigterm_elsewhere():
    """Where the run's own handlers are not there yet, SIGTERM ends the process; here it does nothing."""

    def nothing(*_):
        pass

    before = signal.signal(signal.SIGTERM, nothing)
    yield nothing
    signal.signal(signal.SIGTERM, before)


@pytest.mark.slow
def test_a_signal_anywhere_stops_the_robot(robot, client, sigterm_elsewhere):
    """After any line of Python that a program's run executes, of this package and of its locks."""
    rng, cases, places = np.random.default_rng(2), 0, set()
    for _ in range(8):
        after, left = int(rng.choice([0, 1, 2, 60])), int(rng.integers(0, 80))
        seen = [0]

        def line(frame, event, argument, left=[left], after=after, seen=seen):  # noqa: B006 (a counter)
            if event == "line" and seen[0] >= after:
                left[0] -= 1
                if left[0] == 0:
                    places.add((frame.f_code.co_name, frame.f_lineno))
                    at_once(signal.SIGINT, signal.SIGTERM)
            return line

        def call(frame, event, argument, line=line):
            inside = "kinreach/deploy" in frame.f_code.co_filename or frame.f_code.co_filename == threading.__file__
            return line if inside else None

        def watch(state, seen=seen):
            seen[0] += 1

        before = sys.gettrace()
        sys.settrace(call)
        try:
            with pytest.raises(KeyboardInterrupt):
                client.run(LONG, watch=watch)
        finally:
            sys.settrace(before)
        assert signal.getsignal(signal.SIGTERM) is sigterm_elsewhere
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        assert stands(robot)
        cases += 1
        back(robot, client)
    assert cases == 8
    assert len(places) > 4


def test_a_signal_before_the_program_is_sent_sends_nothing(robot, client):
    with pytest.raises(KeyboardInterrupt):
        client.run(LONG, check=lambda state: at_once(signal.SIGINT, signal.SIGHUP))
    with pytest.raises(KeyboardInterrupt):
        client.run(LONG, check=lambda state: at_once(signal.SIGTERM))
    assert robot.log == []


def test_signals_that_a_process_ignores_stay_ignored():
    """As `nohup` has it; and in other threads than the main one signals are not touched."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with Interruption() as interruption, interruption.armed():
            signal.raise_signal(signal.SIGHUP)
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
    seen = []

    def elsewhere():
        with Interruption():
            seen.extend(signal.getsignal(number) for number in SIGNALS)

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert seen == [signal.getsignal(number) for number in SIGNALS]
    with pytest.raises(KeyboardInterrupt), Interruption():
        signal.raise_signal(signal.SIGTERM)  # not armed: it is raised at the end


@pytest.mark.parametrize("kinds", [[_ScriptClient], [_RtdeClient], [_ScriptClient, _RtdeClient]])
def test_connections_that_break_in_mid_program_are_opened_again_to_stop(robot, client, kinds):
    """The script port's alone is seen when it is needed; without its state the robot is stopped at once."""
    moving = []

    def watch(state):
        if fast(state) and not moving:
            moving.append(state)
            for kind in kinds:
                robot.cut(kind)
        elif moving and len(kinds) == 1 and kinds[0] is _ScriptClient:
            raise KeyboardInterrupt

    with pytest.raises((LostError, KeyboardInterrupt)) as stopped:
        client.run(LONG, watch=watch)
    assert stands(robot)
    assert stops(robot) == 1
    if _RtdeClient in kinds:
        assert str(stopped.value).endswith("the connection was closed; it was stopped and stands")
        assert stopped.value.recording.reason == str(stopped.value)
        assert np.abs(stopped.value.recording.commanded.qd).max() > 0.9
    assert client.read().runtime_state == 1  # it is of use again


@pytest.mark.parametrize("deaf", [1, 4])
@pytest.mark.slow
def test_a_stop_that_is_not_taken_is_sent_again(robot, client, deaf):
    def interrupt(state):
        if fast(state):
            raise KeyboardInterrupt

    robot.deaf = deaf
    with pytest.raises(KeyboardInterrupt):
        client.run(LONG, watch=interrupt)
    assert robot.deaf == 0
    assert stops(robot) == 1
    assert stands(robot)
    back(robot, client)
    client.send(LONG.text)
    while not fast(client.read()):
        pass
    robot.deaf = deaf
    client.stop()
    assert robot.deaf == 0
    assert stands(robot)


def refused_as(client, said, why):
    """A stop is not confirmed, and that is why; a busy machine may have heard nothing in the last moments."""
    for _ in range(20):
        with pytest.raises(RobotError, match=said) as refused:
            client.stop()
        if "its state is not known" not in str(refused.value):
            break
    assert re.search(why, str(refused.value))


def test_what_is_not_known_about_a_stop_is_said(robot, client, monkeypatch):
    monkeypatch.setattr("kinreach.deploy._client.STOP_TIMEOUT", 0.4)
    slow = Program.of(KIN, HOME, [Move("movej", AWAY, 0.05, 2.0)])

    def interrupt(state):
        if np.abs(state.actual_qd).max() > 0.04:
            raise KeyboardInterrupt

    robot.deaf = 1000
    moves = r"a joint moves at 0\.05 rad/s"
    said = rf"it is not confirmed that the robot stands: ({moves}|its state is not known); use its emergency stop"
    with pytest.raises(RobotError, match=f"^interrupted; {said}"):
        client.run(slow, watch=interrupt)
    refused_as(client, f"^the robot at 127.0.0.1: {said}", moves)
    robot.deaf = 0
    client.stop()
    assert client.read().runtime_state == 1
    back(robot, client)
    robot.deaf = 1000  # stands, and does not take it

    def first(state):
        raise KeyboardInterrupt

    with pytest.raises(RobotError, match=r"interrupted; .*(a program still runs|it does not take the stop|rad/s);"):
        client.run(slow, watch=first)
    robot.deaf = 0
    client.stop()
    back(robot, client)

    def gone(state):
        if np.abs(state.actual_qd).max() > 0.04:
            robot.close()

    with pytest.raises(
        RobotError, match=r"is lost.*: its state is not known \(no robot answers at .*\); use its emerg"
    ):
        client.run(slow, watch=gone)


#: What a robot may report in mid-program, and the words for it.
REPORTS = {
    "robot emergency stop (safety mode 7): emergency stop: its button was pressed": lambda ur: ur.emergency_stop(),
    "paused the program": lambda ur: ur.pause(),
    "protective stop (safety mode 3)": lambda ur: ur.report("safety_mode", [3]),
    "safeguard stop (safety mode 5)": lambda ur: ur.report("safety_mode", [5]),
    "an unknown mode (safety mode 77)": lambda ur: ur.report("safety_mode", [77]),
    "idle (robot mode 5)": lambda ur: ur.report("robot_mode", [5]),
    "power off (robot mode 3)": lambda ur: ur.report("robot_mode", [3]),
    **{f"it reports NaN or infinity, {name} {value}": lambda ur, name=name, value=value: ur.report(name, [value] * 6)
       for name, value in (("actual_q", np.nan), ("target_q", np.inf), ("actual_TCP_pose", np.nan))},
    "it reports NaN or infinity, speed_scaling": lambda ur: ur.report("speed_scaling", [np.nan]),
}  # fmt: skip


@pytest.mark.parametrize("word", REPORTS)
def test_what_a_robot_reports_in_mid_program_ends_the_run_with_that_word(robot, client, word):
    reported = []

    def watch(state):
        if fast(state) and not reported:
            reported.append(REPORTS[word](robot))

    with pytest.raises(RobotError) as stopped:
        client.run(LONG, watch=watch)
    assert word.partition(",")[0] in str(stopped.value)
    assert "not confirmed" not in str(stopped.value)
    assert stands(robot)
    assert len(stopped.value.recording.measured.t) > 100
    assert np.isfinite(stopped.value.recording.measured.q).all()
    if "pause" not in word:  # and nothing is sent as long as it is so
        robot.log.clear()
        with pytest.raises(RobotError, match="is not ready: "):
            client.run(LONG)
        assert robot.log == []


def test_a_robot_whose_speed_is_no_number_does_not_stand(robot, client, monkeypatch):
    monkeypatch.setattr("kinreach.deploy._client.STOP_TIMEOUT", 0.4)
    robot.report("actual_qd", [0.0, 0.0, np.nan, 0.0, 0.0, 0.0])
    while np.isfinite(client.read().actual_qd).all():
        pass
    refused_as(client, r"not confirmed that the robot stands: .*; use its", "it reports NaN or infinity")
    assert not client.read().stands
