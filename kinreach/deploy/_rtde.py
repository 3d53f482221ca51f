"""The RTDE protocol, version 2: packages and the types of the variables, for server and client.

A package is a big-endian header, its size as `uint16` and its kind as `uint8`, and a payload. Names and types are those
of Universal Robots' RTDE guide.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from enum import IntEnum

from kinreach.errors import InputError

#: Ports of a UR controller.
RTDE_PORT, SCRIPT_PORT, REAL_TIME_PORT = 30004, 30002, 30003
PROTOCOL = 2
#: Versions of a CB3 and an e-Series controller, by their control cycles per second.
VERSIONS = {125: (3, 15, 8, 0), 500: (5, 12, 0, 0)}
#: Largest list of variables that a controller takes [bytes].
MAX_NAMES = 2048
HEADER = struct.Struct(">HB")
NOT_FOUND, IN_USE = "NOT_FOUND", "IN_USE"
#: Level of a text message that reports an error; 0 is an exception, 2 a warning, 3 information.
ERROR = 1


class Kind(IntEnum):
    TEXT_MESSAGE = ord("M")
    DATA = ord("U")
    PROTOCOL_VERSION = ord("V")
    CONTROLLER_VERSION = ord("v")
    SETUP_OUTPUTS = ord("O")
    SETUP_INPUTS = ord("I")
    START = ord("S")
    PAUSE = ord("P")


class RobotMode(IntEnum):
    """Values of `robot_mode`; the simulated controller reports three, POWER_OFF, IDLE and RUNNING."""

    NO_CONTROLLER = -1
    DISCONNECTED = 0
    CONFIRM_SAFETY = 1
    BOOTING = 2
    POWER_OFF = 3
    POWER_ON = 4
    IDLE = 5
    BACKDRIVE = 6
    RUNNING = 7
    UPDATING_FIRMWARE = 8


#: `joint_mode` in the modes of a robot.
JOINT_MODES = {RobotMode.POWER_OFF: 239, RobotMode.IDLE: 255, RobotMode.RUNNING: 253}


class SafetyMode(IntEnum):
    """Values of `safety_mode`; a script may be sent in the first two. The simulated controller reports 1, 3 and 7."""

    NORMAL = 1
    REDUCED = 2
    PROTECTIVE_STOP = 3
    RECOVERY = 4
    SAFEGUARD_STOP = 5
    SYSTEM_EMERGENCY_STOP = 6
    ROBOT_EMERGENCY_STOP = 7
    VIOLATION = 8
    FAULT = 9
    VALIDATE_JOINT_ID = 10
    UNDEFINED_SAFETY_MODE = 11


class RuntimeState(IntEnum):
    """Values of `runtime_state`; a program that is there and not STOPPED goes on, or can."""

    STOPPING = 0
    STOPPED = 1
    PLAYING = 2
    PAUSING = 3
    PAUSED = 4
    RESUMING = 5


#: RTDE's types and those of `struct`.
FORMATS: Mapping[str, str] = {
    "BOOL": "?", "UINT8": "B", "UINT32": "I", "UINT64": "Q", "INT32": "i", "DOUBLE": "d", "VECTOR3D": "3d",
    "VECTOR6D": "6d", "VECTOR6INT32": "6i", "VECTOR6UINT32": "6I",
}  # fmt: skip

_OUTPUTS = {
    "DOUBLE": "timestamp actual_execution_time target_execution_time speed_scaling target_speed_fraction "
    "actual_momentum actual_main_voltage actual_robot_voltage actual_robot_current standard_analog_input0 "
    "standard_analog_input1 standard_analog_output0 standard_analog_output1 io_current tool_analog_input0 "
    "tool_analog_input1 tool_output_current tool_temperature tcp_force_scalar payload collision_detection_ratio "
    "joint_position_deviation_ratio actual_robot_energy_consumed actual_robot_braking_energy_dissipated "
    "euromap67_24V_voltage euromap67_24V_current",
    "VECTOR6D": "target_q target_qd target_qdd target_current target_moment actual_q actual_qd actual_current "
    "actual_current_window actual_current_as_torque joint_control_output actual_TCP_pose actual_TCP_speed "
    "actual_TCP_force target_TCP_pose target_TCP_speed tcp_offset joint_temperatures actual_joint_voltage "
    "ft_raw_wrench payload_inertia actual_TCP_acceleration target_TCP_acceleration wrench_calc_from_currents "
    "target_base_acceleration target_base_wrench",
    "VECTOR3D": "actual_tool_accelerometer elbow_position elbow_velocity payload_cog target_gravity",
    "INT32": "robot_mode safety_mode safety_status tool_output_voltage encoder0_raw encoder1_raw time_scale_source",
    "UINT32": "runtime_state robot_status_bits safety_status_bits analog_io_types tool_analog_input_types tool_mode "
    "euromap67_input_bits euromap67_output_bits script_control_line "
    "output_bit_registers0_to_31 output_bit_registers32_to_63 input_bit_registers0_to_31 input_bit_registers32_to_63",
    "UINT64": "actual_digital_input_bits actual_digital_output_bits actual_configurable_digital_input_bits "
    "actual_configurable_digital_output_bits control_step",
    "UINT8": "tool_output_mode tool_digital_output0_mode tool_digital_output1_mode",
    "VECTOR6INT32": "joint_mode",
}
_INPUTS = {
    "UINT32": "speed_slider_mask input_bit_registers0_to_31 input_bit_registers32_to_63",
    "DOUBLE": "speed_slider_fraction standard_analog_output_0 standard_analog_output_1",
    "UINT8": "standard_digital_output_mask standard_digital_output configurable_digital_output_mask "
    "configurable_digital_output tool_digital_output_mask tool_digital_output standard_analog_output_mask "
    "standard_analog_output_type",
    "VECTOR6D": "external_force_torque",
}
_OUTPUT_TYPES, _INPUT_TYPES = (
    {name: kind for kind, names in table.items() for name in names.split()} for table in (_OUTPUTS, _INPUTS)
)
#: General purpose registers: direction, type, and number of the register.
_REGISTER = re.compile(r"(input|output)_(?:(bit)_register_(6[4-9]|[7-9]\d|1[01]\d|12[0-7])|"
                       r"(int|double)_register_(\d|[1-3]\d|4[0-7]))")  # fmt: skip
_REGISTER_TYPES = {"bit": "BOOL", "int": "INT32", "double": "DOUBLE"}


def type_of(name: str, *, inputs: bool = False) -> str:
    """Return the type of a variable, a key of `FORMATS`, or `NOT_FOUND`."""
    if register := _REGISTER.fullmatch(name):
        forbidden = register[1] == "output" and inputs  # a controller shows its clients' inputs, too
        return NOT_FOUND if forbidden else _REGISTER_TYPES[register[2] or register[4]]
    return (_INPUT_TYPES if inputs else _OUTPUT_TYPES).get(name, NOT_FOUND)


class RtdeRecipe:
    """Variables in the order of a data package.

    Args:
        names: Of the variables.
        types: Their types, keys of `FORMATS`.
    """

    def __init__(self, names: Sequence[str], types: Sequence[str]) -> None:
        self.names = tuple(names)
        formats = [FORMATS[kind] for kind in types]
        self._format = struct.Struct(">" + "".join(formats))
        self._counts = [int(text[:-1] or 1) for text in formats]
        #: Default values.
        self.zeros: dict[str, tuple[float, ...]] = {
            name: (0,) * count for name, count in zip(names, self._counts, strict=True)
        }

    @property
    def size(self) -> int:
        """Bytes of the values."""
        return self._format.size

    def pack(self, values: Mapping[str, Sequence[float]]) -> bytes:
        """Return the values of all variables as bytes; missing ones are 0."""
        numbers: list[float] = []
        for name in self.names:
            numbers += values.get(name) or self.zeros[name]
        return self._format.pack(*numbers)

    def unpack(self, payload: bytes) -> dict[str, tuple[float, ...]]:
        """Return the values in a payload.

        Raises:
            InputError: It is not as long as the recipe.
        """
        if len(payload) != self.size:
            raise InputError(f"an RTDE data package has {len(payload)} bytes, its recipe {self.size}")
        numbers, place, values = self._format.unpack(payload), 0, {}
        for name, count in zip(self.names, self._counts, strict=True):
            values[name] = numbers[place : place + count]
            place += count
        return values


def names_in(payload: bytes) -> list[str]:
    """Return the names of variables in a payload; empty ones are left out, ur_rtde's lists end with a comma."""
    if len(payload) > MAX_NAMES:
        raise InputError(f"a list of variables may have {MAX_NAMES} bytes, got {len(payload)}")
    try:
        return [name for name in payload.decode("ascii").split(",") if name]
    except UnicodeDecodeError:
        raise InputError("a list of variables must be ASCII") from None


def package(kind: Kind, payload: bytes = b"") -> bytes:
    return HEADER.pack(HEADER.size + len(payload), kind) + payload


def error_message(text: str) -> bytes:
    message, source = text.encode("ascii", "replace")[:255], b"kinreach"
    return package(Kind.TEXT_MESSAGE, bytes([len(message)]) + message + bytes([len(source)]) + source + bytes([ERROR]))


def packages_in(buffer: bytearray, sizes: Mapping[int, tuple[int, int]] | None = None) -> Iterator[tuple[int, bytes]]:
    """Remove the complete packages from a buffer and yield kind and payload of each.

    Args:
        buffer: Bytes that were received.
        sizes: Kinds that may come, each with the least and the largest size of its package.

    Raises:
        InputError: A header that cannot be one, as soon as it is there.
    """
    while len(buffer) >= HEADER.size:
        size, kind = HEADER.unpack_from(buffer)
        if size < HEADER.size:
            raise InputError(f"an RTDE package has at least {HEADER.size} bytes, this one says {size}")
        if sizes is not None and kind not in sizes:
            raise InputError(f"RTDE has no package of kind {kind}")
        if sizes is not None and not sizes[kind][0] <= size <= sizes[kind][1]:
            raise InputError(f"an RTDE package of kind {chr(kind)} has {size} bytes, too few or too many")
        if len(buffer) < size:
            return
        payload = bytes(buffer[HEADER.size : size])
        del buffer[:size]
        yield kind, payload
