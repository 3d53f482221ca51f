"""The state of the simulated robot as its ports 30001 to 30003 send it.

Layouts are those of Universal Robots' client interfaces, for software 3.15 (CB3) and 5.12. Currents, voltages,
temperatures, forces and inputs are 0.
"""

from __future__ import annotations

import struct
from itertools import chain
from typing import TYPE_CHECKING

from kinreach._rotations import quick_pose_vector
from kinreach.deploy._primary import STATE_PARTS, state_package
from kinreach.deploy._rtde import JOINT_MODES, RobotMode, RuntimeState, SafetyMode

if TYPE_CHECKING:
    from kinreach.deploy._controller import Controller

#: Time between two states on ports 30001 and 30002 [s].
STATE_PERIOD = 0.1
_NONE6 = (0.0,) * 6
#: Numbers that a CB3 and an e-Series controller send on port 30003, by their control cycles per second.
_REAL_TIME = {125: 139, 500: 152}


def state(ur: Controller) -> bytes:
    """Return the state of the robot, in the package of the primary and secondary interface."""
    q, tcp = ur.actual_q.tolist(), quick_pose_vector(ur.tcp)
    is_on = ur.robot_mode is not RobotMode.POWER_OFF
    mode = (
        round(1e6 * ur.time), True, is_on, is_on,
        ur.safety_mode is SafetyMode.ROBOT_EMERGENCY_STOP, ur.safety_mode is SafetyMode.PROTECTIVE_STOP,
        ur.runtime_state in (RuntimeState.PLAYING, RuntimeState.RESUMING),
        ur.runtime_state in (RuntimeState.PAUSING, RuntimeState.PAUSED),
        ur.robot_mode, 0, ur.speed_slider, ur.speed_scaling, 1.0, 0,
    )  # fmt: skip
    joints = zip(q, ur.target_q.tolist(), ur.actual_qd.tolist(), strict=True)
    joint_mode = JOINT_MODES[ur.robot_mode]
    analog = ur.io.analog
    parts = {
        "mode": mode,
        "joints": tuple(chain.from_iterable((*joint, 0.0, 0.0, 0.0, 0.0, joint_mode) for joint in joints)),
        "tool": (0, 0, 0.0, 0.0, 0.0, ur.io.tool_voltage, 0.0, 0.0, joint_mode),
        "masterboard": (
            0, ur.io.digital, 0, 0, 0.0, 0.0, 0, 0, *analog, 0.0, 0.0, 0.0, 0.0, ur.safety_mode, 0, 0, 0,
        ),
        "cartesian": (*ur.tcp_pose(ur.actual_q).tolist(), *tcp),
        "force": (0.0,) * 7,
        "additional": (0, False, False, 0),
    }  # fmt: skip
    packed = {name: STATE_PARTS[name].pack(*values) for name, values in parts.items()}
    if ur.rate == 500:  # operational mode, enabling device and a byte that is not documented
        packed["masterboard"] += bytes(3)
    return state_package(packed.items())


def real_time_state(ur: Controller) -> bytes:
    """Return the state of the robot, in the package of the real-time interface."""
    q, qd, target, speed = ur.actual_q, ur.actual_qd, ur.target_q, ur.target_qd
    form = struct.Struct(f">i{_REAL_TIME[ur.rate]}d")
    numbers = [
        ur.time, *target.tolist(), *speed.tolist(), *ur.target_qdd.tolist(), *_NONE6, *_NONE6,
        *q.tolist(), *qd.tolist(), *_NONE6, *_NONE6,
        *ur.tcp_pose(q).tolist(), *ur.tcp_speed(q, qd).tolist(), *_NONE6,
        *ur.tcp_pose(target).tolist(), *ur.tcp_speed(target, speed).tolist(),
        0.0, *_NONE6, 0.0, 0.0, ur.robot_mode, *(JOINT_MODES[ur.robot_mode],) * 6, ur.safety_mode,
        *_NONE6, 0.0, 0.0, 0.0, *_NONE6, ur.speed_scaling, *_NONE6, *_NONE6,
        ur.io.digital, ur.runtime_state, *_NONE6, ur.safety_mode,
        0.0, 0.0, 0.0, ur.payload, *ur.centre_of_mass, *ur.inertia,
    ]  # fmt: skip
    return form.pack(form.size, *numbers[: _REAL_TIME[ur.rate]])
