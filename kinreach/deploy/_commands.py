"""What the functions of URScript do with the simulated controller: motions, tool, in- and outputs, and the state."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from kinreach._checks import Floats, shown
from kinreach.deploy._motion import Arc, BlendedMotion, JointSpeed, LineError, Segment, Servo, ToolSpeed, segment_to
from kinreach.deploy._script_functions import (
    SETTINGS,
    Pose,
    ValueProblem,
    a_pose,
    a_truth,
    number,
    numbers,
    pose_of,
    some_numbers,
    text_of,
    whole,
)
from kinreach.deploy._script_tree import Place, ScriptError, is_number
from kinreach.kinematics import pose

if TYPE_CHECKING:
    from kinreach.deploy._controller import Controller

#: Ranges of arguments by their names.
RANGES: Mapping[str, tuple[float, float]] = {
    "a": (1e-6, 1e3), "v": (1e-6, 1e3), "t": (0.0, 3600.0), "r": (0.0, 2.0),
    "lookahead_time": (0.03, 0.2), "gain": (100.0, 2000.0), "m": (0.0, 100.0),
}  # fmt: skip
#: Numbers of the digital outputs of each kind, and the bit of RTDE of the first.
DIGITAL: Mapping[str, tuple[int, int]] = {
    "": (18, 0), "standard_": (8, 0), "configurable_": (8, 8), "tool_": (2, 16)
}  # fmt: skip
#: Registers of programs.
INTEGERS, FLOATS, BOOLEANS = 48, 48, 128
#: Speeds below this are rest [rad/s].
REST = 1e-6

Waiting = Generator[None, None, Any]


class Commands:
    """The functions of a robot.

    Args:
        controller: Of the arm that they move.
    """

    def __init__(self, controller: Controller) -> None:
        self._ur = controller
        self._mover: object = None

    def call(self, function: str, values: Mapping[str, Any], place: Place, thread: object) -> Any:
        """Call a function: return its value, or a generator that yields at the end of each control cycle it takes.

        Raises:
            ScriptError: An argument cannot be used.
        """
        _check_ranges(function, values, place)
        if (order := getattr(self, f"_{function}", None)) is not None:
            return order(values)
        if (motion := getattr(self, f"_{function}_motion", None)) is not None:
            return self._alone(motion(values, place), place, thread)
        if function in SETTINGS:
            return None
        for start, act in (("write_output_", self._write), ("read_", self._read), ("set_", self._set),
                           ("get_", self._get)):  # fmt: skip
            if function.startswith(start):
                return act(function.removeprefix(start), values)
        raise ScriptError(place, f"runtime error: {function} is not simulated")

    def _alone(self, motion: Waiting, place: Place, thread: object) -> Waiting:
        """Run a motion if no other thread's is running."""
        if self._mover not in (None, thread):
            raise ScriptError(place, "runtime error: another thread is already controlling the robot")
        self._mover = thread
        try:
            return (yield from motion)
        except GeneratorExit:  # its thread is killed
            self._ur.drop_motion()
            raise
        finally:
            self._mover = None

    def _six(self, function: str, place: Place, value: object, *, is_pose: bool) -> Floats:
        if not isinstance(value, tuple) or len(value) != 6 or isinstance(value, Pose) is not is_pose:
            kind = "a pose p[...]" if is_pose else "a list of six joint angles"
            raise ScriptError(place, f"runtime error: {function} takes {kind}, got {shown(_listed(value))}")
        return np.array(numbers(value))

    # motions

    def _movej_motion(self, values: Mapping[str, Any], place: Place) -> Waiting:
        target = values["q"]
        if isinstance(target, Pose):
            target = tuple(self._solved(pose(target) @ np.linalg.inv(self._ur.tcp), self._ur.motion.end).tolist())
        return self._move("movej", self._six("movej", place, target, is_pose=False), values, place)

    def _movel_motion(self, values: Mapping[str, Any], place: Place, name: str = "movel") -> Waiting:
        target = values["pose"]
        if not isinstance(target, Pose):
            q = self._six(name, place, target, is_pose=False)
            target = pose_of(self._ur.kinematics.fk(q) @ self._ur.tcp)
        return self._move("movel", np.array(target), values, place)

    def _movep_motion(self, values: Mapping[str, Any], place: Place) -> Waiting:
        return self._movel_motion(values, place, "movep")

    def _movec_motion(self, values: Mapping[str, Any], place: Place) -> Waiting:
        ur = self._ur
        via, target = (
            np.array(end) if isinstance(end := values[name], Pose)
            else np.array(pose_of(ur.kinematics.fk(self._six("movec", place, end, is_pose=False)) @ ur.tcp))
            for name in ("pose_via", "pose_to")
        )  # fmt: skip
        is_fixed = whole(values["mode"]) == 1

        def arc() -> Segment:
            return Arc(ur.kinematics, ur.tcp, ur.motion.end, pose(target), values["v"], values["a"],
                       via=via[:3], is_fixed=is_fixed)  # fmt: skip

        yield from self._begin(arc, values["r"], place)

    def _move(self, command: str, target: Floats, values: Mapping[str, Any], place: Place) -> Waiting:
        """Run `movej` or `movel` until the next move may be blended in."""
        ur = self._ur

        def segment() -> Segment:
            return segment_to(
                ur.kinematics, ur.tcp, ur.motion.end, command, target, values["v"], values["a"], values.get("t", 0.0)
            )

        yield from self._begin(segment, values["r"], place)

    def _begin(self, make: Any, radius: float, place: Place) -> Waiting:
        ur = self._ur
        ur.servo = ur.speed = None
        if not ur.motion.segments:
            yield from self._at_rest()
            ur.motion = BlendedMotion(ur.tool_position, ur.target_q)
        segment = make()
        if overlap := ur.motion.overlap(segment, radius):
            ur.say(f"line {place.line}: overlapping blends, the move is skipped: {overlap}")
            return
        ur.motion.add(segment, radius)
        yield
        while not ur.motion.may_go_on():
            yield

    def _at_rest(self) -> Waiting:
        ur = self._ur
        while ur.motion.segments or np.abs(ur.target_qd).max() > REST:
            yield

    def _servoj_motion(self, values: Mapping[str, Any], place: Place) -> Waiting:
        ur, duration = self._ur, values["t"]
        if not is_number(duration) or not ur.cycle - 1e-9 <= duration <= 10.0:
            raise ScriptError(place, f"runtime error: t of servoj must be from {ur.cycle:g} to 10 s, "
                              f"got {shown(duration)}")  # fmt: skip
        target = self._six("servoj", place, values["q"], is_pose=False)
        ur.speed = None
        if ur.servo is None:
            yield from self._at_rest()
            ur.servo_until = ur.program_time
        servo = Servo(ur.target_q, ur.target_qd) if ur.servo is None else ur.servo[0]
        ur.servo = servo, target, values["lookahead_time"], values["gain"]
        ur.servo_until += duration
        while ur.program_time < ur.servo_until - 1e-9:
            yield

    def _speedj_motion(self, values: Mapping[str, Any], place: Place) -> Waiting:
        wanted = self._six("speedj", place, values["qd"], is_pose=False)
        yield from self._keep_speed(JointSpeed(wanted, values["a"]), values["t"], lambda: self._ur.target_qd, wanted)

    def _speedl_motion(self, values: Mapping[str, Any], place: Place) -> Waiting:
        ur, given = self._ur, values["xd"]
        wanted = self._six("speedl", place, given, is_pose=isinstance(given, Pose))
        begin = ur.tcp_speed(ur.target_q, ur.target_qd)
        turning = values["a"] if values["aRot"] is None else number(values["aRot"])
        speed = ToolSpeed(ur.kinematics, ur.tcp, begin, wanted, (values["a"], turning))
        yield from self._keep_speed(speed, values["t"], lambda: ur.tcp_speed(ur.target_q, ur.target_qd), wanted)

    def _keep_speed(self, speed: JointSpeed | ToolSpeed, t: float | None, now: Any, wanted: Floats) -> Waiting:
        """Move with a speed for a time, or until it is reached; the arm keeps it until something else is asked for."""
        ur = self._ur
        ur.motion, ur.servo, ur.speed = BlendedMotion(ur.tool_position, ur.target_q), None, speed
        until = ur.program_time + (0.0 if t is None else t)
        yield
        while ur.program_time < until - 1e-9 or (t is None and np.abs(now() - wanted * ur.speed_scaling).max() > 1e-4):
            yield

    def _stopj_motion(self, values: Mapping[str, Any], place: Place) -> Waiting:
        ur = self._ur
        ur.drop_motion()
        ur.braking = values["a"]
        yield from self._at_rest()
        ur.drop_motion()

    def _stopl_motion(self, values: Mapping[str, Any], place: Place) -> Waiting:
        ur = self._ur
        begin = ur.tcp_speed(ur.target_q, ur.target_qd)
        turning = values["a"] if values["aRot"] is None else number(values["aRot"])
        ur.drop_motion()
        ur.speed = ToolSpeed(ur.kinematics, ur.tcp, begin, np.zeros(6), (values["a"], turning))
        yield from self._at_rest()
        ur.drop_motion()

    def _sleep(self, values: Mapping[str, Any]) -> Waiting:
        until = self._ur.program_time + float(values["t"])
        while self._ur.program_time < until - 1e-9:
            yield

    def _sync(self, values: Mapping[str, Any]) -> Waiting:
        yield

    # the tool, and what is said

    def _set_tcp(self, values: Mapping[str, Any]) -> None:
        if not isinstance(values["pose"], Pose):
            raise ValueProblem(f"set_tcp takes a pose p[...], got {shown(_listed(values['pose']))}")
        self._ur.tcp = pose(values["pose"])

    def _set_payload(self, values: Mapping[str, Any]) -> None:
        self._ur.payload = number(values["m"])
        centre = values["cog"]
        self._ur.centre_of_mass = tuple(self._ur.tcp[:3, 3].tolist()) if centre is None else some_numbers(centre, 3)
        self._ur.inertia = (0.0,) * 6

    def _set_target_payload(self, values: Mapping[str, Any]) -> None:
        self._set_payload({"m": values["m"], "cog": (0.0, 0.0, 0.0) if values["cog"] is None else values["cog"]})
        if values["inertia"] is not None:
            self._ur.inertia = some_numbers(values["inertia"], 6)

    def _set_payload_mass(self, values: Mapping[str, Any]) -> None:
        self._ur.payload = number(values["m"])

    def _set_payload_cog(self, values: Mapping[str, Any]) -> None:
        self._ur.centre_of_mass = some_numbers(values["CoG"], 3)

    def _set_gravity(self, values: Mapping[str, Any]) -> None:
        self._ur.gravity = some_numbers(values["d"], 3)

    def _set_tool_voltage(self, values: Mapping[str, Any]) -> None:
        if whole(values["voltage"]) not in (0, 12, 24):
            raise ValueProblem(f"the tool's voltage is 0, 12 or 24, got {shown(values['voltage'])}")
        self._ur.io.tool_voltage = whole(values["voltage"])

    def _protective_stop_motion(self, values: Mapping[str, Any], place: Place) -> Waiting:
        yield
        raise LineError(f"line {place.line} of the program asked for it")

    def _powerdown(self, values: Mapping[str, Any]) -> Waiting:
        self._ur.power_off()
        yield

    def _popup(self, values: Mapping[str, Any]) -> None:
        self._ur.say(f"popup: {text_of(values['s'])}")

    def _textmsg(self, values: Mapping[str, Any]) -> None:
        self._ur.say(f"textmsg: {text_of(values['s1'])}{text_of(values['s2'])}")

    # the state

    def _get_actual_joint_positions(self, values: Mapping[str, Any]) -> tuple[float, ...]:
        return tuple(self._ur.actual_q.tolist())

    def _get_actual_joint_positions_history(self, values: Mapping[str, Any]) -> tuple[float, ...]:
        history = self._ur.history
        return tuple(history[-1 - _place(values["steps"], len(history), "steps")].tolist())

    def _get_actual_joint_speeds(self, values: Mapping[str, Any]) -> tuple[float, ...]:
        return tuple(self._ur.actual_qd.tolist())

    def _get_target_joint_positions(self, values: Mapping[str, Any]) -> tuple[float, ...]:
        return tuple(self._ur.target_q.tolist())

    def _get_target_joint_speeds(self, values: Mapping[str, Any]) -> tuple[float, ...]:
        return tuple(self._ur.target_qd.tolist())

    def _get_actual_tcp_pose(self, values: Mapping[str, Any]) -> Pose:
        return Pose(self._ur.tcp_pose(self._ur.actual_q).tolist())

    def _get_target_tcp_pose(self, values: Mapping[str, Any]) -> Pose:
        return Pose(self._ur.tcp_pose(self._ur.target_q).tolist())

    def _get_target_waypoint(self, values: Mapping[str, Any]) -> Pose:
        return Pose(self._ur.tcp_pose(self._ur.motion.end).tolist())

    def _get_actual_tool_flange_pose(self, values: Mapping[str, Any]) -> Pose:
        return pose_of(self._ur.kinematics.fk(self._ur.actual_q))

    def _get_actual_tcp_speed(self, values: Mapping[str, Any]) -> tuple[float, ...]:
        return tuple(self._ur.tcp_speed(self._ur.actual_q, self._ur.actual_qd).tolist())

    def _get_target_tcp_speed(self, values: Mapping[str, Any]) -> tuple[float, ...]:
        return tuple(self._ur.tcp_speed(self._ur.target_q, self._ur.target_qd).tolist())

    def _get_tcp_offset(self, values: Mapping[str, Any]) -> Pose:
        return pose_of(self._ur.tcp)

    def _get_target_payload(self, values: Mapping[str, Any]) -> float:
        return self._ur.payload

    def _get_target_payload_cog(self, values: Mapping[str, Any]) -> tuple[float, ...]:
        return self._ur.centre_of_mass

    def _get_target_payload_inertia(self, values: Mapping[str, Any]) -> tuple[float, ...]:
        return self._ur.inertia

    def _get_steptime(self, values: Mapping[str, Any]) -> float:
        return self._ur.cycle

    def _get_controller_temp(self, values: Mapping[str, Any]) -> float:
        return 25.0

    def _is_steady(self, values: Mapping[str, Any]) -> bool:
        return bool(np.abs(self._ur.target_qd).max() <= REST and np.abs(self._ur.actual_qd).max() <= 1e-2)

    def _random(self, values: Mapping[str, Any]) -> float:
        return float(self._ur.rng.random())

    def _get_forward_kin(self, values: Mapping[str, Any]) -> Pose:
        q = values["q"]
        if q is not None and (not isinstance(q, tuple) or len(q) != 6 or isinstance(q, Pose)):
            raise ValueProblem(f"get_forward_kin takes a list of six joint angles, got {shown(_listed(q))}")
        posture = self._ur.actual_q if q is None else np.array(numbers(q))
        return pose_of(self._ur.kinematics.fk(posture) @ self._tcp(values["tcp"]))

    def _get_inverse_kin(self, values: Mapping[str, Any]) -> tuple[float, ...]:
        q = self._solved(*self._goal(values["x"], values))
        return tuple(q.tolist())

    def _get_inverse_kin_has_solution(self, values: Mapping[str, Any]) -> bool:
        T, near = self._goal(values["pose"], values)
        return bool(self._ur.inverse.nearest(T, near).success)

    def _is_within_safety_limits(self, values: Mapping[str, Any]) -> bool:
        if isinstance(values["pose"], Pose):
            return self._get_inverse_kin_has_solution({**values, "tcp": None})
        return not self._ur.kinematics.past_limits(np.array(numbers(values["pose"]))).any()

    def _goal(self, target: object, values: Mapping[str, Any]) -> tuple[Floats, Floats]:
        """Return the pose of the flange that a pose of the tool is, and the posture to be near."""
        near = values["qnear"]
        if near is not None and (not isinstance(near, tuple) or len(near) != 6 or isinstance(near, Pose)):
            raise ValueProblem(f"qnear is a list of six joint angles, got {shown(_listed(near))}")
        T = pose(a_pose(target)) @ np.linalg.inv(self._tcp(values["tcp"]))
        return T, self._ur.actual_q if near is None else np.array(numbers(near))

    def _tcp(self, given: object) -> Floats:
        """Return a tool centre point that an argument gives, or the active one."""
        return self._ur.tcp if given is None or given == "active_tcp" else pose(a_pose(given))

    def _solved(self, T: Floats, near: Floats) -> Floats:
        found = self._ur.inverse.nearest(T, near)
        if not found.success:
            raise ValueProblem(f"no posture within the limits reaches the pose {text_of(pose_of(T))} of the flange")
        return np.asarray(found.q, dtype=np.float64)

    # in- and outputs

    def _set(self, what: str, values: Mapping[str, Any]) -> None:
        io = self._ur.io
        if what == "flag":
            io.flags[_place(values["n"], 33)] = a_truth(values["b"])
        elif what.endswith("digital_out"):
            count, first = DIGITAL[what.removesuffix("digital_out")]
            io.set_digital(first + _place(values["n"], count), is_on=a_truth(values["b"]))
        else:
            share = number(values["f"])
            if not 0.0 <= share <= 1.0:
                raise ValueProblem(f"an analog output is from 0 to 1, got {share:g}")
            io.analog[_place(values["n"], 2)] = share

    def _get(self, what: str, values: Mapping[str, Any]) -> bool | float:
        io = self._ur.io
        if what == "flag":
            return io.flags[_place(values["n"], 33)]
        if what.endswith(("digital_out", "digital_in")):
            kind, _, way = what.rpartition("digital_")
            count, first = DIGITAL[kind]
            place = first + _place(values["n"], count)
            return bool((io.digital if way == "out" else 0) >> place & 1)
        return io.analog[_place(values["n"], 2)] if what.endswith("out") else 0.0 * _place(values["n"], 4)

    def _write(self, what: str, values: Mapping[str, Any]) -> None:
        io, value = self._ur.io, values["value"]
        match what:
            case "integer_register":
                if not -(2**31) <= number(value) < 2**31:
                    raise ValueProblem(f"value of a register must be from -2^31 to 2^31 - 1, got {shown(value)}")
                self._ur.registers[_place(values["output_id"], INTEGERS, "output_id")] = int(value)
            case "float_register":
                io.floats[_place(values["output_id"], FLOATS, "output_id")] = number(value)
            case _:
                io.booleans[_place(values["output_id"], BOOLEANS, "output_id")] = a_truth(value)

    def _read(self, what: str, values: Mapping[str, Any]) -> bool | float:
        way, kind, _ = what.split("_")
        io, address = self._ur.io, values["address"]
        if kind == "integer":
            table: Mapping[int, float] = self._ur.registers if way == "output" else io.given_integers
            return float(table.get(_place(address, INTEGERS), 0))
        if kind == "float":
            return (io.floats if way == "output" else io.given_floats).get(_place(address, FLOATS), 0.0)
        return (io.booleans if way == "output" else io.given_booleans).get(_place(address, BOOLEANS), False)


def _check_ranges(function: str, values: Mapping[str, Any], place: Place) -> None:
    unused: tuple[str, ...] = ("a", "v") if function == "servoj" else ()
    if function in ("movej", "movel") and is_number(values["t"]) and values["t"] > 0.0:
        unused = ("v",)
    for name, value in values.items():
        if name not in RANGES or name in unused or (value is None and name == "t"):
            continue
        low, high = RANGES[name]
        if not (is_number(value) and low <= value <= high):
            raise ScriptError(
                place,
                f"runtime error: {name} of {function} must be a number from {low:g} to {high:g}, got {shown(value)}",
            )


def _place(value: object, count: int, name: str = "its number") -> int:
    if not is_number(value) or not float(value).is_integer() or not 0 <= value < count:  # type: ignore[arg-type,operator]
        raise ValueProblem(f"{name} must be from 0 to {count - 1}, got {shown(value)}")
    return int(value)  # type: ignore[call-overload]


def _listed(value: object) -> object:
    return list(value) if isinstance(value, tuple) else value
