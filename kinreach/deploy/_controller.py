"""A simulated UR controller, without sockets: it runs programs on an arm in MuJoCo and stops as a UR does."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kinreach._checks import Floats, printable
from kinreach._rotations import quick_pose_vector
from kinreach.deploy._commands import Commands
from kinreach.deploy._interpreter import Machine
from kinreach.deploy._motion import BlendedMotion, JointSpeed, LineError, Servo, ToolSpeed
from kinreach.deploy._rtde import RobotMode, RuntimeState, SafetyMode
from kinreach.deploy._script_tree import ScriptError
from kinreach.deploy._urscript import grammar, parsing
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, ClosedFormKinematics, Trajectory
from kinreach.robots import ArmDescription
from kinreach.robots.inside import FLANGE, JOINTS, TOOL_BODY, origin_of, ur_model
from kinreach.sim import ArmSimulation
from kinreach.sim.inside import mujoco, servo_response, touches

#: Models whose controller is a CB3; the others have an e-Series controller or a later one.
CB3 = ("ur3", "ur5", "ur10")
#: Step of the simulation [s].
TIMESTEP = 0.002
#: Deceleration of joints that no program moves [rad/s^2].
BRAKING = 10.0
#: Largest rate at which the speed of program time follows the speed slider [1/s].
SLIDER_RATE = 4.0
#: How far a joint may be from its target before the controller stops [rad].
MAX_DEVIATION = 0.1
#: Control cycles that `get_actual_joint_positions_history` remembers.
REMEMBERED = 500
#: Register for the progress of a program of kinreach, and its values; register for the number of its run.
REGISTER, BEGUN, FINISHED, NOT_AT_START, OTHER_ARM = 24, 1, 2, 3, 4
RUN_REGISTER = 25
#: Words for the stops, and what follows a change of the runtime state.
_STOPS = {SafetyMode.PROTECTIVE_STOP: "protective stop", SafetyMode.ROBOT_EMERGENCY_STOP: "emergency stop"}
_AFTER = {RuntimeState.PAUSING: RuntimeState.PAUSED, RuntimeState.RESUMING: RuntimeState.PLAYING}


def rate_of(arm: ArmDescription) -> int:
    """Return the control cycles of a UR's controller per second."""
    return 125 if ur_model(arm.name) in CB3 else 500


def outlasting(longest: float) -> str:
    """Return the reason of a run that ends after its time [s], while the program goes on."""
    return f"the program takes longer than {longest:g} s"


def check_is_ur(arm: ArmDescription) -> None:
    """Refuse an arm that has no UR controller."""
    if arm.joints != JOINTS or FLANGE not in arm.tips:
        raise InputError(
            f"arm {arm.name!r} is not a UR: only URs run URScript, ur3 to ur30; for others plan_path and time_path "
            "plan in Python"
        )


def tcp_of(arm: ArmDescription) -> Floats:
    """Return the pose of a UR's default tip on its flange (4, 4)."""
    flange, tip = (ArmKinematics(arm, tip=name) for name in (FLANGE, arm.default_tip))
    return np.linalg.inv(flange.fk(arm.home)) @ tip.fk(arm.home)


def payload_of(arm: ArmDescription) -> tuple[float, tuple[float, ...]] | None:
    """Return mass [kg] and centre of mass on the flange [m] of an arm's tool; None if it has none."""
    inertial = arm.robot.find(f"./link[@name='{TOOL_BODY}']/inertial")
    if inertial is None:
        return None
    mass = float(inertial.find("mass").get("value", "0"))  # type: ignore[union-attr]
    return mass, tuple(origin_of(inertial)[:3, 3].round(6).tolist())


@dataclass(frozen=True, eq=False)
class Recording:
    """A recorded motion, with a sample for each control cycle.

    Attributes:
        status: Register of the program: `BEGUN`, `FINISHED`, `NOT_AT_START` or `OTHER_ARM`; 0 if it wrote none.
        reason: Why the program did not finish; empty if it did.
        missing: Control cycles between the first sample and the last one that were not received.
    """

    commanded: Trajectory
    measured: Trajectory
    status: int
    reason: str
    missing: int = 0


class InputsOutputs:
    """In- and outputs of a controller, and its registers; inputs that nobody writes are off, or 0.

    Attributes:
        digital: Bits of the outputs: 0 to 7 standard, 8 to 15 configurable, 16 and 17 of the tool.
        analog: Both outputs, from 0 to 1.
        tool_voltage: 0, 12 or 24 [V].
        flags: That programs keep for others.
        floats, booleans: Output registers.
        given_integers, given_floats, given_booleans: Input registers, which clients write.
    """

    def __init__(self) -> None:
        self.digital = self.tool_voltage = 0
        self.analog, self.flags = [0.0, 0.0], [False] * 33
        self.floats, self.given_floats = dict[int, float](), dict[int, float]()
        self.booleans, self.given_booleans = dict[int, bool](), dict[int, bool]()
        self.given_integers = dict[int, int]()

    def set_digital(self, bit: int, *, is_on: bool) -> None:
        self.digital = self.digital | 1 << bit if is_on else self.digital & ~(1 << bit)


class Controller:
    """The controller of one UR and its arm in MuJoCo. Time passes only in `tick`.

    The arm's default tip is the tool centre point until a program sets one. `log` gets each line of its log.

    Attributes:
        simulation: The arm in MuJoCo.
        kinematics: Of the flange, in the controller's frame `base`, with the arm's own calibration.
        cycle: Time between two ticks [s].
        tcp: Tool centre point on the flange (4, 4).
        target_q, target_qd, target_qdd: Commands of the joints [rad], [rad/s], [rad/s^2], shape (6,).
        motion, servo, speed: What moves the arm: moves, `servoj`, or `speedj` and its like; the last two may be None.
        braking: Deceleration of joints that nothing moves [rad/s^2].
        payload, centre_of_mass, inertia, gravity: As programs set them [kg], [m] on the flange, [kg m^2], [m/s^2].
        history: Measured postures at the begin of the last cycles.
        stopped_at: Time of the last protective stop [s].
        io: In- and outputs, and registers.
        registers: Integers that programs wrote.
        is_fresh: Whether the program has had no control cycle yet.
        program_time: Time that passed for the program that runs [s].
        robot_mode, runtime_state, safety_mode: As RTDE reports them.
        program_name: Of the program that runs, empty for a single line; None if none does.
        reason: Why the last program was refused or stopped; empty if it was not.

    Raises:
        InputError: Not a UR, or a start posture outside the limits or in collision.
    """

    def __init__(
        self, arm: ArmDescription, *, q: Sequence[float] | None = None, log: Callable[[str], object] | None = None
    ) -> None:
        check_is_ur(arm)
        self.arm, self._log = arm, log
        self.simulation = ArmSimulation(arm, timestep=TIMESTEP)
        self.kinematics = ArmKinematics(arm, tip=FLANGE, base="base")
        self.rate = rate_of(arm)
        self.cycle = 1.0 / self.rate
        start = np.array(arm.home if q is None else q, dtype=np.float64)
        self.tcp: Floats = tcp_of(arm)
        self.payload = 0.0
        self.centre_of_mass: tuple[float, ...] = (0.0, 0.0, 0.0)
        self.gravity: tuple[float, ...] = (0.0, 0.0, 9.82)
        self.inertia: tuple[float, ...] = (0.0,) * 6
        self.history: deque[Floats] = deque(maxlen=REMEMBERED)
        self.stopped_at = -math.inf
        self.io, self.rng = InputsOutputs(), np.random.default_rng(0)
        self._drive = _Drive(self.simulation)
        self.speed_slider = self._scaling = 1.0
        self.registers: dict[int, int] = {}
        self.robot_mode, self.safety_mode = RobotMode.RUNNING, SafetyMode.NORMAL
        self.runtime_state = RuntimeState.STOPPED
        self.reason = ""
        self._has_to_end = self.is_fresh = False
        self._program: Machine | None = None
        self._beside: Machine | None = None
        self._commands = Commands(self)
        self.program_time = self.servo_until = 0.0
        grammar()  # now, and not when the first program comes
        self.program_name: str | None = None
        self._ticks = 0
        self.place(start)
        if touching := self.simulation.contacts():
            raise InputError(f"the start posture is in collision: {touching[0]}")

    def place(self, q: Floats) -> None:
        """Put the arm at rest into a posture [rad], shape (6,), without moving."""
        self.simulation.reset(q)
        self.history.clear()
        self.motion = BlendedMotion(self.tool_position, q)
        self.servo: tuple[Servo, Floats, float, float] | None = None
        self.speed: JointSpeed | ToolSpeed | None = None
        self.braking = BRAKING
        self._began = q
        self.target_q: Floats = q.copy()
        self.target_qd, self.target_qdd = np.zeros(len(q)), np.zeros(len(q))

    @property
    def actual_q(self) -> Floats:
        return self.simulation.q

    @property
    def actual_qd(self) -> Floats:
        return self._drive.speeds

    @property
    def time(self) -> float:
        """Time since the controller was made [s]."""
        return self._ticks * self.cycle

    @property
    def speed_scaling(self) -> float:
        """Speed of program time: it follows the slider, and is 0 in a stop."""
        return self._scaling if self.safety_mode is SafetyMode.NORMAL else 0.0

    def tcp_pose(self, q: Floats) -> Floats:
        """Return the tool centre point in `base`, `[x, y, z, rx, ry, rz]`, shape (6,)."""
        return np.array(quick_pose_vector(self.kinematics.fk(q) @ self.tcp))

    def tcp_speed(self, q: Floats, qd: Floats) -> Floats:
        """Return the speed of the tool centre point in `base` [m/s, rad/s], shape (6,)."""
        flange = self.kinematics.fk(q)
        speed = self.kinematics.jacobian(q) @ qd
        (x, y, z), (a, b, c) = (flange[:3, :3] @ self.tcp[:3, 3]).tolist(), speed[3:].tolist()
        speed[:3] += [b * z - c * y, c * x - a * z, a * y - b * x]
        return speed

    def tool_position(self, q: Floats) -> Floats:
        """Return the position of the tool centre point [m], shape (3,)."""
        return (self.kinematics.fk(q) @ self.tcp)[:3, 3]

    @cached_property
    def inverse(self) -> ClosedFormKinematics:
        """Kinematics that finds the postures of a pose of the flange in `base`."""
        found = ArmKinematics.of(self.arm, tip=FLANGE, base="base")
        if not isinstance(found, ClosedFormKinematics):
            raise InputError(f"arm {self.arm.name!r} has no inverse kinematics of a UR")
        return found

    def say(self, text: str) -> None:
        if self._log is not None:
            self._log(printable(text))

    def start(self, text: str) -> None:
        """Start a program. The running one ends, even if the new one is refused.

        Raises:
            InputError: It is not in the URScript that kinreach runs, or the controller is in a stop.
        """
        for _ in self.starting(text):
            pass

    def starting(self, text: str) -> Generator[None, None, None]:
        """Start a program, and read it in parts, each of which ends in a `yield`: meanwhile time may pass.

        Raises:
            InputError: As `start`.
        """
        self._refuse_in_stop()
        is_beside = text.lstrip().startswith("sec ")
        if not is_beside:
            self._end_program()
            self.reason = ""
        try:
            script = yield from parsing(text)
        except ScriptError as error:
            self.reason = self.reason if is_beside else str(error)
            self.say(f"program refused: {error}")
            raise
        self._refuse_in_stop()
        if script.is_secondary:
            self._beside = Machine(script.code, self._commands)
            self.say(f"secondary program {script.name} is running")
            return
        self._program, self.is_fresh = Machine(script.code, self._commands), True
        self.runtime_state, self.program_name = RuntimeState.PLAYING, f"{script.name}"
        self.say(f"program {script.name or 'of one line'} is running")

    def _refuse_in_stop(self) -> None:
        if self.safety_mode is not SafetyMode.NORMAL:
            raise InputError(f"the program is not run: {_STOPS[self.safety_mode]} ({self.reason})")
        if self.robot_mode is not RobotMode.RUNNING:
            what = "the power of the arm is off" if self.robot_mode is RobotMode.POWER_OFF else "its brakes are closed"
            raise InputError(f"the program is not run: {what}")

    def power_off(self) -> None:
        """Take the arm's power until `release` or `power_on`: the program ends."""
        self.end_program()
        self.robot_mode = RobotMode.POWER_OFF
        self.say("the power of the arm is off")

    def power_on(self) -> None:
        """Give the arm its power; its brakes stay closed."""
        if self.robot_mode is RobotMode.POWER_OFF and self.safety_mode is SafetyMode.NORMAL:
            self.robot_mode = RobotMode.IDLE
            self.say("the power of the arm is on")

    def release_brakes(self) -> None:
        """Open the brakes, with power if it is off."""
        self.power_on()
        if self.robot_mode is RobotMode.IDLE:
            self.robot_mode = RobotMode.RUNNING
            self.say("the brakes are released")

    def end_program(self) -> None:
        """Stop the program that runs, as on the pendant: the arm brakes."""
        if self._program is not None:
            self._has_to_end = True

    def drop_motion(self) -> None:
        """Let nothing move the arm any more: it brakes."""
        self.motion, self.servo, self.speed = BlendedMotion(self.tool_position, self.target_q), None, None
        self.braking = BRAKING

    def release(self) -> None:
        """End a stop; after a protective one the arm is put back to where the stopped program began."""
        if self.safety_mode is SafetyMode.PROTECTIVE_STOP:
            self.place(self._began)
            self.say("protective stop released; the arm is back where the program began")
        elif self.safety_mode is SafetyMode.ROBOT_EMERGENCY_STOP:
            self.say("emergency stop released; the arm is where it stopped")
        self.safety_mode, self.robot_mode = SafetyMode.NORMAL, RobotMode.RUNNING

    def emergency_stop(self) -> None:
        """Press the emergency stop: the program ends, the arm brakes, and its power is off."""
        self._end_program()
        self.safety_mode, self.robot_mode = SafetyMode.ROBOT_EMERGENCY_STOP, RobotMode.POWER_OFF
        self.reason = "its button was pressed"
        self.say(f"emergency stop: {self.reason}")

    def pause(self) -> None:
        """Pause the program that runs: its time slows down to a standstill."""
        if self.runtime_state in (RuntimeState.PLAYING, RuntimeState.RESUMING):
            self.runtime_state = RuntimeState.PAUSING
            self.say("program is paused")

    def resume(self) -> None:
        """Let a paused program go on."""
        if self.runtime_state in (RuntimeState.PAUSING, RuntimeState.PAUSED):
            self.runtime_state = RuntimeState.RESUMING
            self.say("program is resumed")

    def tick(self) -> None:
        self.history.append(self.actual_q)
        self._scale_time()
        if self.safety_mode is SafetyMode.NORMAL and self.runtime_state is not RuntimeState.PAUSED:
            self._advance_program()
        if self.safety_mode is not SafetyMode.PROTECTIVE_STOP:
            self._advance_target()
        self._drive.step(self.target_q, self.target_qd, self.target_qdd, self.cycle)
        self._ticks += 1
        if self.safety_mode is SafetyMode.NORMAL:
            self._supervise()

    def _scale_time(self) -> None:
        """Let the speed of program time follow the speed slider, or a pause."""
        pausing = self.runtime_state in (RuntimeState.PAUSING, RuntimeState.PAUSED)
        wanted, change = 0.0 if pausing else self.speed_slider, SLIDER_RATE * self.cycle
        self._scaling += min(max(wanted - self._scaling, -change), change)
        if self._scaling == wanted and self.runtime_state in _AFTER:
            self.runtime_state = _AFTER[self.runtime_state]

    def run(self, text: str, *, longest: float = 600.0) -> Recording:
        """Run a program as fast as possible, to its end or for at most `longest` simulated seconds, and record it."""
        self.start(text)
        began, rows = self._ticks, [self._row()]
        while self.runtime_state is RuntimeState.PLAYING and (self._ticks - began) * self.cycle < longest:
            self.tick()
            rows.append(self._row())
        if self.runtime_state is RuntimeState.PLAYING:
            self._end_program()
            self.reason = outlasting(longest)
        t = self.cycle * np.arange(len(rows), dtype=np.float64)
        commanded, speeds, measured, measured_speeds = (np.array(column) for column in zip(*rows, strict=True))
        return Recording(
            Trajectory(JOINTS, t, commanded, speeds),
            Trajectory(JOINTS, t, measured, measured_speeds),
            self.registers.get(REGISTER, 0),
            self.reason,
        )

    def _row(self) -> tuple[Floats, ...]:
        return self.target_q, self.target_qd, self.actual_q, self.actual_qd

    def _end_program(self) -> None:
        if self._program is not None:
            self._program.end()
        self.drop_motion()
        self._program, self.program_name, self.runtime_state = None, None, RuntimeState.STOPPED
        self._has_to_end = self.is_fresh = False
        self.program_time = self.servo_until = 0.0
        self._began = self.actual_q

    def _advance_program(self) -> None:
        if self._beside is not None:
            self._run_beside(self._beside)
        if self._program is None:
            return
        self.program_time += self.cycle * self._scaling
        try:
            self.is_fresh = False
            if not self._program.is_done:
                self._program.cycle()
            if self._has_to_end:
                self._end_program()
                self.say("program ended by request")
            elif self._program.has_halted or (self._program.is_done and not self.motion.segments):
                self._end_program()
                self.say("program finished")
        except ScriptError as error:
            self.reason = str(error)
            self._end_program()
            self.say(f"program stopped: {error}")
        except LineError as error:
            self._stop(str(error))

    def _run_beside(self, machine: Machine) -> None:
        """Let a secondary program go on."""
        try:
            machine.cycle()
        except ScriptError as error:
            self.say(f"secondary program stopped: {error}")
            self._beside = None
        if machine.is_done:
            self._beside = None

    def _advance_target(self) -> None:
        dt, before = self.cycle * self._scaling, self.target_qd
        if self.motion.segments:
            try:
                q, qd = self.motion.advance(dt)
            except (LineError, np.linalg.LinAlgError) as error:
                self._stop(str(error))
                return
            self.target_q, self.target_qd = q, self._scaling * qd
        elif self.servo is not None:
            servo, target, lookahead, gain = self.servo
            servo.follow(target, lookahead, gain, dt)
            self.target_q, self.target_qd = servo.q, self._scaling * servo.qd
        elif self.speed is not None:
            try:
                self.target_qd = self.speed.next(self.target_q, before, self.cycle)
            except LineError as error:
                self._stop(str(error))
                return
            self.target_q = self.target_q + dt * self.target_qd
        elif (fastest := float(np.abs(before).max())) > 0.0:
            self.target_qd = before * max(0.0, 1.0 - self.braking * self.cycle / fastest)
            self.target_q = self.target_q + self.cycle * self.target_qd
        self.target_qdd = (self.target_qd - before) / self.cycle

    def _supervise(self) -> None:
        """Stop at a limit of a joint or its speed, on contact, and when the arm does not follow."""
        controller, data = self.simulation.controller, self.simulation.data
        outside = self.kinematics.past_limits(self.target_q)
        fast = np.abs(self.target_qd) > self.kinematics.velocity_limit * 1.001
        if data.ncon and (touching := touches(self.simulation.model, data, controller.obstacles)):
            self._stop(f"collision: {touching[0]}")
        elif outside.any():
            joint = int(outside.argmax())
            self._stop(f"joint limit: {JOINTS[joint]} at {self.target_q[joint]:.3f} rad")
        elif fast.any():
            joint = int(fast.argmax())
            limit = self.kinematics.velocity_limit[joint]
            self._stop(f"joint speed: {JOINTS[joint]} at {abs(self.target_qd[joint]):.2f} rad/s, limit {limit:.2f}")
        elif (off := np.abs(self.target_q - self.actual_q)).max() > MAX_DEVIATION:
            self._stop(f"{JOINTS[int(off.argmax())]} is {off.max():.2f} rad from its target")

    def _stop(self, reason: str) -> None:
        """Stop protectively: the program ends, the arm stays where it is."""
        began = self._began
        self._end_program()
        self._began = began
        self.reason, self.safety_mode, self.stopped_at = reason, SafetyMode.PROTECTIVE_STOP, self.time
        self.target_q, self.target_qd, self.target_qdd = self.actual_q, np.zeros(6), np.zeros(6)
        self.say(f"protective stop: {reason}")


class _Drive:
    """Feeds the servos of a simulation with setpoints that compensate their lag and the arm's inertia."""

    def __init__(self, simulation: ArmSimulation) -> None:
        model, controller = simulation.model, simulation.controller
        self._model, self._data = model, simulation.data
        self._servos = controller.ctrl
        joints = [model.joint(name) for name in simulation.arm.joints]
        self._dof = [int(joint.dofadr[0]) for joint in joints]
        self._stiffness, self._lag = servo_response(model, controller.ctrl)
        self._full, self._product = np.zeros(model.nv), np.empty(model.nv)

    @property
    def speeds(self) -> Floats:
        return self._data.qvel[self._dof].copy()

    def step(self, q: Floats, qd: Floats, qdd: Floats, duration: float) -> None:
        """Simulate for a duration [s] with a posture [rad], speeds [rad/s] and accelerations [rad/s^2] as setpoint."""
        self._full[self._dof] = qdd
        mujoco.mj_mulM(self._model, self._data, self._product, self._full)
        self._data.ctrl[self._servos] = q + self._lag * qd + self._product[self._dof] / self._stiffness
        mujoco.mj_step(self._model, self._data, round(duration / TIMESTEP))
