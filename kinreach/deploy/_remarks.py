"""Remarks for people on answers: why a pose has no posture, and what collision checks leave out."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from kinreach._checks import Floats
from kinreach.kinematics import ArmKinematics, CalibratedURKinematics, CollisionChecker, Trajectory, URKinematics
from kinreach.robots.inside import TOOL, TOOL_BODY, ur_model

#: A position farther away than this many lengths of the arm is not in metres.
WRONG_UNIT = 10
#: A pose nearer to the reach than this is at its border [m].
AT_BORDER = 1e-6


def tool_note(checker: CollisionChecker) -> str:
    """Return a note if the tool has no shape for a checker; empty if it has one, or there is no tool."""
    if checker.kinematics.tip != TOOL or TOOL_BODY in {shape.name for shape in checker.shapes}:
        return ""
    return "the tool has no shape, so it cannot collide; --tool-radius or --tool-mesh gives it one"


def arm_and_tip(kinematics: ArmKinematics) -> str:
    """Return whose answers they are: the arm, of a UR whether that of its data sheet, and the tip in its base."""
    arm = kinematics.arm
    real = isinstance(kinematics, CalibratedURKinematics) or ur_model(arm.name) is None
    return f"{arm.title}{'' if real else ', by its data sheet'}: tip {kinematics.tip} in {kinematics.base}"


def fastest(kinematics: ArmKinematics, motion: Trajectory) -> str:
    """Return how long a motion takes, and the largest speeds of a joint, by its limit, and of the tool."""
    speeds = np.abs(motion.qd).max(axis=0)
    shares = speeds / kinematics.velocity_limit
    joint = int(shares.argmax())
    ways = np.linalg.norm(np.diff(kinematics.positions(motion.q), axis=0), axis=1)
    tool = float(np.max(ways / np.diff(motion.t), initial=0.0))
    return (
        f"{motion.duration:.2f} s; {kinematics.arm.joints[joint].removesuffix('_joint')} at most {speeds[joint]:.2f} "
        f"rad/s, {100 * shares[joint]:.0f} % of its limit; tool at most {tool:.2f} m/s"
    )


def untouched(names: Iterable[str]) -> str:
    """Return that a motion touched nothing, of what is around by these names."""
    around = ", ".join(names)
    return f"no collision with itself{f', {around}' if around else '; nothing around it is known'}"


def why_none(kinematics: ArmKinematics, T: Floats, reason: str) -> str:
    """Add to the reason why a pose has no posture how far it is from the reach, or that positions are in metres."""
    if not reason:
        return reason
    first, *links = kinematics.chain.placements[:, :3, 3]
    away, length = np.linalg.norm(T[:3, 3] - first), np.linalg.norm(links, axis=1).sum()
    if away >= WRONG_UNIT * length:
        return f"{reason}: {away:.0f} m from the first joint, of an arm of {length:.1f} m; positions are in metres"
    if isinstance(kinematics, URKinematics):
        lack = float(np.linalg.norm(kinematics.nearest_in_reach(T)[:3, 3] - T[:3, 3]))
        if lack > AT_BORDER:
            far = f"{1000 * lack:.3g} mm" if lack < 0.9995 else f"{lack:.3g} m"
            return f"{reason}; the nearest pose in reach with this orientation is {far} away"
    return reason
