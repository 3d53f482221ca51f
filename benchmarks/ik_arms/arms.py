"""The arms that ssik ships and eight calibrated URs: URDFs, classes by the geometry of their axes, poses."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.ik_arms.child import forked
from benchmarks.studies.calibrated_arms import ORACLE, ROBOTS, arm_of
from kinreach._checks import Floats
from kinreach._engines import load_extra
from kinreach._rotations import rpy
from kinreach.kinematics import ArmKinematics
from kinreach.kinematics._chain import about_z
from kinreach.kinematics._six_axis.dh import DenavitHartenberg
from kinreach.robots import ArmDescription

WRIST, PARALLEL, NONE = "spherical wrist", "three parallel axes", "six axes, no closed form"
CALIBRATED, SEVEN = "calibrated UR", "seven axes"
CLASSES = (WRIST, PARALLEL, NONE, CALIBRATED, SEVEN)
#: Singular cases: joint whose angle makes det J vanish (0 is the first), and how far beside that [rad].
CASES = {
    "wrist": ((4,), 0.0),
    "elbow": ((2,), 0.0),
    "both": ((4, 2), 0.0),
    "right angles": ((), 0.0),
    "beside by 1e-9": ((4,), 1e-9),
    "beside by 1e-5": ((2,), 1e-5),
}
_EXACT = 1e-9


def arm_names() -> list[str]:
    """Names of all arms: ssik's with six and seven axes, then the calibrated URs."""
    return [*forked(lambda: [entry.name for entry in ssik().list_arms()]), *ROBOTS]


def ssik() -> Any:
    """Import ssik, or say which extra brings it."""
    return load_extra("ssik", "bench")


def arm(name: str) -> ArmKinematics:
    """Pinocchio's kinematics of an arm, which judges; without a closed form."""
    if name in ROBOTS:
        kin = arm_of(name)
        return ArmKinematics(kin.arm, tip=kin.tip)
    placements = forked(lambda: placements_of(ssik().Manipulator.from_prebuilt(name)))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{name}.urdf"
        file.write_text(urdf(placements), encoding="utf-8")
        return ArmKinematics(ArmDescription.from_urdf(file, name=name))


def placements_of(manipulator: Any) -> Floats:
    """A0 to An of `T = A0 Rz(q1) A1 ... Rz(qn) An` of an arm of ssik, shape (n + 1, 4, 4)."""
    before, axes, carry = [], [], np.eye(4)
    for joint in manipulator.kinbody.joints:
        before.append(carry @ joint.T_left)
        axes.append(np.asarray(joint.axis) / np.linalg.norm(joint.axis))
        carry = joint.T_right
    return about_z(before, axes, carry)


def urdf(placements: Floats, limits: Floats | None = None) -> str:
    """A URDF of an arm, as `placements_of` returns it, with limits (2, n) [rad]; half a circle either way without."""
    text, bounds = '<link name="l0"/>', np.full((2, len(placements)), ((-3.1416,), (3.1416,)))
    if limits is not None:
        bounds[:, :-1] = limits
    for index, T in enumerate(placements, start=1):
        kind, axis = ("fixed", "") if index == len(placements) else ("revolute", '<axis xyz="0 0 1"/>')
        origin = f'<origin xyz="{" ".join(map(str, T[:3, 3]))}" rpy="{" ".join(map(str, rpy(T[:3, :3])))}"/>'
        text += (
            f'<link name="l{index}"/><joint name="j{index}" type="{kind}"><parent link="l{index - 1}"/>'
            f'<child link="l{index}"/>{origin}{axis}'
            f'<limit lower="{bounds[0, index - 1]}" upper="{bounds[1, index - 1]}" effort="9" velocity="3"/></joint>'
        )
    return f'<robot name="arm">{text}</robot>'


def parameters(kin: ArmKinematics) -> DenavitHartenberg:
    """Denavit-Hartenberg parameters of an arm with six joints."""
    placements, axes = kin._joint_frames()
    placements[0] = kin.T_base_world @ placements[0]
    tip = kin.model.frames[kin.tip_frame].placement.homogeneous
    return DenavitHartenberg.of(about_z(placements, axes, tip), length=_EXACT, angle=_EXACT)


def class_of(kin: ArmKinematics) -> str:
    """Return the name of an arm's class, one of `CLASSES`."""
    if kin.n == 7:
        return SEVEN
    if kin.arm.name.endswith("_calibrated"):
        return CALIBRATED
    dh = parameters(kin)
    for a, d, alpha in ((dh.a, dh.d, dh.alpha), (dh.a[::-1], dh.d[::-1], dh.alpha[::-1])):
        if not (a[3] or a[4] or d[4]):
            return WRIST
        if not (alpha[1] or alpha[2]):
            return PARALLEL
    return NONE


def postures(name: str, kin: ArmKinematics, count: int) -> Floats:
    """Random postures (count, n); of a calibrated UR those of which ssik's answers are stored, at most 40."""
    if name in ROBOTS:
        with np.load(ORACLE) as stored:
            return np.asarray(stored[f"{name} random postures"][:count], dtype=np.float64)
    return np.random.default_rng(0).uniform(-np.pi, np.pi, (count, kin.n))


def singular_poses(kin: ArmKinematics, count: int) -> dict[str, Floats]:
    """Poses (m, 4, 4) of each case; m is less than `count` where no angle of the joint makes the arm singular."""
    rng, found = np.random.default_rng(1), {}
    for case, (joints, beside) in CASES.items():
        q: Floats = rng.uniform(-np.pi, np.pi, (4 * count, 6))
        if not joints:
            q = rng.integers(-2, 3, q.shape) * (np.pi / 2)
        roots = [_singular(kin, q, joint) for joint in joints]
        for joint, angle in zip(joints, roots, strict=True):
            q[:, joint] = angle + beside
        found[case] = kin.fk(q[np.isfinite(q).all(axis=1)][:count])
    return found


def _singular(kin: ArmKinematics, q: Floats, joint: int) -> Floats:
    """Angles (m,) of a joint at which the arm is singular and its other joints are those of `q`, NaN without one."""

    def determinant(angle: Floats) -> Floats:
        moved = q.copy()
        moved[:, joint] = angle
        return np.asarray(np.linalg.det(kin.chain.jacobian(moved)))

    grid = np.linspace(-np.pi, np.pi, 25) + 0.1
    values = np.array([determinant(np.full(len(q), angle)) for angle in grid])
    changes = values[1:] * values[:-1] < 0
    first = changes.argmax(axis=0)
    low, high = grid[first], grid[first + 1]
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = determinant(low) * determinant(middle) <= 0
        low, high = np.where(below, low, middle), np.where(below, middle, high)
    return np.where(changes.any(axis=0), low, np.nan)
