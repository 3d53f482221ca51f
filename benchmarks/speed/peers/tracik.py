"""TRAC-IK (Beeson and Ames) by its Python binding pytracik: two solvers in C++ that run side by side."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.speed.peers.base import IKPeer
from kinreach.checks import Floats
from kinreach.kinematics.arm import ArmKinematics
from kinreach.kinematics.solvers import Tolerance

#: Longest that it may search for one pose [s]; its own 5 ms leave some poses unsolved.
TIMEOUT = 0.05


def make(seed: Floats, tolerance: Tolerance) -> IKPeer:
    """Its UR5, by default as fast as it can (`solver_type="Speed"`).

    Args:
        seed: Posture to start from [rad], shape (6,).
        tolerance: How near is reached. It has one bound for each component of the error, metres and radians alike:
            the position's over the root of three.
    """
    from trac_ik import TracIK

    arm = ArmKinematics("ur5", tip="tool0").arm
    epsilon = tolerance.position / 3**0.5
    with tempfile.TemporaryDirectory() as folder:
        urdf = Path(folder) / "arm.urdf"
        urdf.write_text(arm.urdf, encoding="utf-8")
        solver = TracIK(arm.base, arm.tips["tool0"], str(urdf), timeout=TIMEOUT, epsilon=epsilon)

    def call(pose: tuple[Floats, Floats]) -> Any:
        return solver.ik(*pose, seed)

    def postures(found: Any) -> Floats:
        return np.empty((0, 6)) if found is None else np.atleast_2d(found)

    note = f"TracIK(..., timeout={TIMEOUT}, epsilon={epsilon:.3g}).ik(p, R, seed)"
    return IKPeer(note, lambda T: (T[:3, 3].copy(), T[:3, :3].copy()), call, postures)
