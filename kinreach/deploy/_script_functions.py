"""The functions of URScript: their parameters with the defaults of Universal Robots' manual, and those that compute."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from kinreach._checks import shown
from kinreach._rotations import PoseLine, quick_pose_vector, rotation, rpy, turns, vectors_of
from kinreach.deploy._script_tree import Constant, Expression, Place, ScriptError, is_number
from kinreach.kinematics import pose

#: Longest text, and most numbers in a list with the lists in it.
MAX_TEXT, MAX_ENTRIES = 10_000, 10_000


class Required:
    """Stands for the default of a parameter that must be given."""


Default = float | bool | str | None | type[Required]
R = Required


class ValueProblem(Exception):
    """An argument cannot be used; the message says why."""


class Pose(tuple[float, ...]):
    """A value `p[...]`."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Function:
    """A function of the controller.

    Attributes:
        parameters: With their defaults; None is left out.
        returns: Whether it has a value.
        is_moving: Whether it moves the arm.
    """

    parameters: Mapping[str, Default]
    returns: bool = False
    is_moving: bool = False


def _values(**functions: Mapping[str, Default]) -> dict[str, Function]:
    return {name: Function(parameters, returns=True) for name, parameters in functions.items()}


def _orders(**functions: Mapping[str, Default]) -> dict[str, Function]:
    return {name: Function(parameters) for name, parameters in functions.items()}


def _motions(**functions: Mapping[str, Default]) -> dict[str, Function]:
    return {name: Function(parameters, is_moving=True) for name, parameters in functions.items()}


_TURN: Mapping[str, Default] = {"f": R}
#: Settings that are taken and change nothing here.
SETTINGS: Mapping[str, Function] = _orders(
    force_mode_set_damping={"damping": R},
    force_mode_set_gain_scaling={"scaling": R},
    set_analog_inputrange={"port": R, "range": R},
    set_analog_outputdomain={"port": R, "domain": R},
    set_configurable_digital_input_action={"n": R, "action": R},
    set_euromap_input_action={"n": R, "action": R},
    set_gp_boolean_input_action={"n": R, "action": R},
    set_input_actions_to_default={},
    set_runstate_configurable_digital_output_to_value={"outputId": R, "state": R},
    set_runstate_gp_boolean_output_to_value={"outputId": R, "state": R},
    set_runstate_standard_analog_output_to_value={"outputId": R, "state": R},
    set_runstate_standard_digital_output_to_value={"outputId": R, "state": R},
    set_runstate_tool_digital_output_to_value={"outputId": R, "state": R},
    set_safety_mode_transition_hardness={"type": R},
    set_standard_analog_input_domain={"port": R, "domain": R},
    set_standard_digital_input_action={"n": R, "action": R},
    set_tool_analog_input_domain={"port": R, "domain": R},
    set_tool_communication={
        "enabled": R, "baud_rate": R, "parity": R, "stop_bits": R, "rx_idle_chars": R, "tx_idle_chars": R,
    },
    set_tool_digital_input_action={"n": R, "action": R},
    set_tool_digital_output_mode={"n": R, "mode": R},
    set_tool_output_mode={"mode": R},
    set_joint_friction_compensation={"enable": R},
    rtde_set_watchdog={"variable_name": R, "min_frequency": R, "action": "pause"},
)  # fmt: skip

FUNCTIONS: Mapping[str, Function] = {
    **_motions(
        movec={"pose_via": R, "pose_to": R, "a": 1.2, "v": 0.25, "r": 0.0, "mode": 0.0},
        movej={"q": R, "a": 1.4, "v": 1.05, "t": 0.0, "r": 0.0},
        movel={"pose": R, "a": 1.2, "v": 0.25, "t": 0.0, "r": 0.0},
        movep={"pose": R, "a": 1.2, "v": 0.25, "r": 0.0},
        servoj={"q": R, "a": 0.0, "v": 0.0, "t": 0.002, "lookahead_time": 0.1, "gain": 300.0},
        protective_stop={},
        speedj={"qd": R, "a": 40.0, "t": None},
        speedl={"xd": R, "a": 1.2, "t": None, "aRot": None},
        stopj={"a": R},
        stopl={"a": R, "aRot": None},
    ),
    **_orders(
        popup={"s": R, "title": "Popup", "warning": False, "error": False, "blocking": False},
        powerdown={},
        set_analog_out={"n": R, "f": R},
        set_configurable_digital_out={"n": R, "b": R},
        set_digital_out={"n": R, "b": R},
        set_flag={"n": R, "b": R},
        set_gravity={"d": R},
        set_payload={"m": R, "cog": None},
        set_payload_cog={"CoG": R, "transition_time": 0.0},
        set_payload_mass={"m": R, "transition_time": 0.0},
        set_standard_analog_out={"n": R, "f": R},
        set_standard_digital_out={"n": R, "b": R},
        set_target_payload={"m": R, "cog": None, "inertia": None, "transition_time": 0.0},
        set_tcp={"pose": R, "tcp_name": ""},
        set_tool_digital_out={"n": R, "b": R},
        set_tool_voltage={"voltage": R},
        sleep={"t": R},
        sync={},
        textmsg={"s1": R, "s2": ""},
        write_output_boolean_register={"output_id": R, "value": R},
        write_output_float_register={"output_id": R, "value": R},
        write_output_integer_register={"output_id": R, "value": R},
    ),
    **SETTINGS,
    **_values(
        get_actual_joint_positions={},
        get_actual_joint_positions_history={"steps": 0.0},
        get_actual_joint_speeds={},
        get_actual_tcp_pose={},
        get_actual_tcp_speed={},
        get_actual_tool_flange_pose={},
        get_analog_in={"n": R},
        get_analog_out={"n": R},
        get_configurable_digital_in={"n": R},
        get_configurable_digital_out={"n": R},
        get_controller_temp={},
        get_digital_in={"n": R},
        get_digital_out={"n": R},
        get_flag={"n": R},
        get_forward_kin={"q": None, "tcp": None},
        get_inverse_kin={"x": R, "qnear": None, "maxPositionError": 1e-10, "maxOrientationError": 1e-10, "tcp": None},
        get_inverse_kin_has_solution={
            "pose": R, "qnear": None, "maxPositionError": 1e-10, "maxOrientationError": 1e-10, "tcp": None,
        },
        get_standard_analog_in={"n": R},
        get_standard_analog_out={"n": R},
        get_standard_digital_in={"n": R},
        get_standard_digital_out={"n": R},
        get_steptime={},
        get_target_joint_positions={},
        get_target_joint_speeds={},
        get_target_payload={},
        get_target_payload_cog={},
        get_target_payload_inertia={},
        get_target_tcp_pose={},
        get_target_tcp_speed={},
        get_target_waypoint={},
        get_tcp_offset={},
        get_tool_digital_in={"n": R},
        get_tool_digital_out={"n": R},
        is_steady={},
        is_within_safety_limits={"pose": R, "qnear": None},
        read_input_boolean_register={"address": R},
        read_input_float_register={"address": R},
        read_input_integer_register={"address": R},
        read_output_boolean_register={"address": R},
        read_output_float_register={"address": R},
        read_output_integer_register={"address": R},
        random={},
    ),
    # those that compute, see `COMPUTED`
    **_values(
        acos=_TURN, asin=_TURN, atan=_TURN, ceil=_TURN, cos=_TURN, floor=_TURN, sin=_TURN, sqrt=_TURN, tan=_TURN,
        atan2={"x": R, "y": R},
        binary_list_to_integer={"l": R},
        d2r={"d": R},
        integer_to_binary_list={"x": R},
        interpolate_pose={"p_from": R, "p_to": R, "alpha": R},
        length={"v": R},
        log={"b": R, "f": R},
        norm={"a": R},
        point_dist={"p_from": R, "p_to": R},
        pose_add={"p_1": R, "p_2": R},
        pose_dist={"p_from": R, "p_to": R},
        pose_inv={"p_from": R},
        pose_sub={"p_to": R, "p_from": R},
        pose_trans={"p_from": R, "p_from_to": R},
        pow={"base": R, "exponent": R},
        r2d={"r": R},
        rotvec2rpy={"rotation_vector": R},
        rpy2rotvec={"rpy_vector": R},
        str_at={"src": R, "index": R},
        str_cat={"op1": R, "op2": R},
        str_empty={"str": R},
        str_find={"src": R, "target": R, "start_from": 0.0},
        str_len={"str": R},
        str_sub={"src": R, "index": R, "len": None},
        to_num={"str": R},
        to_str={"val": R},
    ),
}  # fmt: skip

#: What the simulated robot lacks, as the beginning of the names of functions, and what a refusal says.
LACKING: Mapping[str, str] = {
    **dict.fromkeys(("socket_",), "has no sockets"),
    **dict.fromkeys(("rpc_", "modbus_", "read_port_", "write_port_", "get_euromap_", "set_euromap_", "profinet_"),
                    "has no field bus and no remote calls"),
    **dict.fromkeys(
        ("force", "end_force_mode", "zero_ftsensor", "get_tcp_force", "get_actual_joint_torques", "get_joint_torques",
         "get_target_joint_moments", "tool_contact", "ft_rtde_input_enable", "enable_external_ft_sensor",
         "torque_command", "direct_torque",
         "get_actual_tool_wrench", "get_actual_tcp_wrench"),
        "has no force control and measures no forces"),
    **dict.fromkeys(("freedrive_mode", "end_freedrive_mode", "freedrive", "teach_mode", "end_teach_mode",
                     "get_freedrive_status"), "cannot be moved by hand"),
    **dict.fromkeys(("conveyor_", "track_conveyor", "stop_conveyor", "encoder_", "get_conveyor"), "has no conveyor"),
    **dict.fromkeys(("path_offset_", "screw_driving", "end_screw_driving", "servoc", "movec_", "mc_", "optimovej",
                     "optimovel", "get_jacobian", "get_mass_matrix", "get_coriolis_and_centrifugal_torques",
                     "jog", "start_jog"), "does not have this function"),
}  # fmt: skip


def bound(
    name: str,
    parameters: Mapping[str, Any],
    positional: Sequence[Expression],
    keywords: Mapping[str, Expression],
    place: Place,
) -> dict[str, Expression]:
    """Return the value of each parameter of a function, in their order."""
    if len(positional) > len(parameters):
        raise ScriptError(place, f"compile error: {name} has {len(parameters)} arguments, got {len(positional)}")
    given = dict(zip(parameters, positional, strict=False))
    for keyword, value in keywords.items():
        if keyword in given or keyword not in parameters:
            known = ", ".join(parameters) or "none"
            raise ScriptError(place, f"compile error: {name} has no free argument {shown(keyword)}; it has: {known}")
        given[keyword] = value
    for parameter, default in parameters.items():
        if parameter not in given:
            if default is Required:
                raise ScriptError(place, f"compile error: {name} needs the argument {parameter}")
            given[parameter] = default if isinstance(default, Expression) else Constant(default)
    return {parameter: given[parameter] for parameter in parameters}


def lack_of(name: str) -> str:
    """Return why the simulated robot has not got a function of URScript; empty for names that are not known."""
    return next((reason for start, reason in LACKING.items() if name.startswith(start)), "")


def text_of(value: object) -> str:
    """Write a value as the controller's `to_str` and `textmsg` do."""
    if isinstance(value, bool) or not isinstance(value, tuple | float | int):
        return str(value)
    if isinstance(value, tuple):
        return f"{'p' if isinstance(value, Pose) else ''}[{', '.join(map(text_of, value))}]"
    return f"{value:.0f}" if float(value).is_integer() and abs(value) < 1e15 else f"{value:.10g}"


def number(value: object, what: str = "a number is needed") -> float:
    if not is_number(value):
        raise ValueProblem(f"{what}, got {shown(value)}")
    return float(value)  # type: ignore[arg-type]


def whole(value: object) -> int:
    if not number(value).is_integer():
        raise ValueProblem(f"a whole number is needed, got {shown(value)}")
    return int(value)  # type: ignore[call-overload]


def numbers(value: object) -> tuple[float, ...]:
    if not isinstance(value, tuple):
        raise ValueProblem(f"a list is needed, got {shown(value)}")
    return tuple(number(entry) for entry in value)


def some_numbers(value: object, count: int) -> tuple[float, ...]:
    """Return so many numbers; a client that writes (x,y,z) sends them as a list."""
    found = numbers(value)
    if len(found) != count:
        listed = list(value) if isinstance(value, tuple) else value
        raise ValueProblem(f"a list of {count} numbers is needed, got {shown(listed)}")
    return found


def a_pose(value: object) -> Pose:
    if not isinstance(value, Pose):
        raise ValueProblem(f"a pose p[...] is needed, got {shown(value)}")
    return value


def a_text(value: object) -> str:
    if not isinstance(value, str):
        raise ValueProblem(f"a text is needed, got {shown(value)}")
    return value


def a_truth(value: object) -> bool:
    if not isinstance(value, bool):
        raise ValueProblem(f"{shown(value)} is neither true nor false")
    return value


def pose_of(T: np.ndarray) -> Pose:
    return Pose(quick_pose_vector(T))


def _norm(a: object) -> float:
    return float(np.linalg.norm(numbers(a) if isinstance(a, tuple) else [number(a)]))


def _turn_of(six: Pose) -> np.ndarray:
    return pose([0.0, 0.0, 0.0, *six[3:]])[:3, :3]


def _added(one: object, other: object) -> Pose:
    """Add the positions and put the rotations one after the other: the manual's `pose_add`."""
    first, second = a_pose(one), a_pose(other)
    T = np.eye(4)
    T[:3, :3] = _turn_of(first) @ _turn_of(second)
    T[:3, 3] = np.add(first[:3], second[:3])
    return pose_of(T)


def _subtracted(to: object, start: object) -> Pose:
    last, first = a_pose(to), a_pose(start)
    T = np.eye(4)
    T[:3, :3] = _turn_of(last) @ _turn_of(first).T
    T[:3, 3] = np.subtract(last[:3], first[:3])
    return pose_of(T)


def _interpolated(one: object, other: object, alpha: object) -> Pose:
    return pose_of(PoseLine(pose(a_pose(one)), pose(a_pose(other))).at(number(alpha)))


def _binary(value: object) -> tuple[bool, ...]:
    bits = whole(value)
    return tuple(bool(bits >> place & 1) for place in range(32))


def _integer(bits: object) -> float:
    if not isinstance(bits, tuple) or len(bits) > 32:
        raise ValueProblem(f"a list of at most 32 truth values is needed, got {shown(bits)}")
    return float(sum(a_truth(bit) << place for place, bit in enumerate(bits)))


def _cut(text: object, index: object, count: object) -> str:
    begin = whole(index)
    if not 0 <= begin <= len(a_text(text)):
        raise ValueProblem(f"the text has no sign {begin}")
    return a_text(text)[begin : None if count is None or whole(count) < 0 else begin + whole(count)]


def _to_num(text: object) -> float:
    try:
        return float(a_text(text))
    except ValueError:
        raise ValueProblem(f"{shown(text)} is not a number") from None


def _roll_pitch_yaw(vector: object) -> tuple[float, ...]:
    return rpy(turns(np.array(some_numbers(vector, 3))))


def _rotation_vector(angles: object) -> tuple[float, ...]:
    return tuple(vectors_of(rotation(some_numbers(angles, 3))).tolist())


def _length(value: object) -> float:
    if not isinstance(value, str | tuple):
        raise ValueProblem(f"a list or a text is needed, got {shown(value)}")
    return float(len(value))


def _of_number(function: Callable[..., float]) -> Callable[..., float]:
    return lambda *values: float(function(*map(number, values)))


#: Functions that compute a value from their arguments alone, which come in the order of the parameters.
COMPUTED: Mapping[str, Callable[..., Any]] = {
    **{name: _of_number(getattr(math, name))
       for name in ("acos", "asin", "atan", "ceil", "cos", "floor", "sin", "sqrt", "tan", "atan2", "pow")},
    "binary_list_to_integer": _integer,
    "d2r": _of_number(math.radians),
    "integer_to_binary_list": _binary,
    "interpolate_pose": _interpolated,
    "length": _length,
    "log": _of_number(lambda base, value: math.log(value) / math.log(base)),
    "norm": _norm,
    "point_dist": lambda one, other: math.dist(a_pose(one)[:3], a_pose(other)[:3]),
    "pose_add": _added,
    "pose_dist": lambda one, other: float(np.linalg.norm(_subtracted(other, one))),
    "pose_inv": lambda six: pose_of(np.linalg.inv(pose(a_pose(six)))),
    "pose_sub": _subtracted,
    "pose_trans": lambda one, other: pose_of(pose(a_pose(one)) @ pose(a_pose(other))),
    "r2d": _of_number(math.degrees),
    "rotvec2rpy": _roll_pitch_yaw,
    "rpy2rotvec": _rotation_vector,
    "str_at": lambda text, index: _cut(text, index, 1.0),
    "str_cat": lambda one, other: text_of(one) + text_of(other),
    "str_empty": lambda text: not a_text(text),
    "str_find": lambda text, wanted, start: float(a_text(text).find(a_text(wanted), whole(start))),
    "str_len": lambda text: float(len(a_text(text))),
    "str_sub": _cut,
    "to_num": _to_num,
    "to_str": text_of,
}  # fmt: skip
