"""ssik: a prebuilt solver of the UR5 with a C++ back end."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.speed.peers.base import IKPeer
from kinreach.checks import Floats
from kinreach.kinematics.arm import ArmKinematics


def make() -> IKPeer:
    """Its prebuilt UR5."""
    from ssik.prebuilt import ur5_ik

    kin = ArmKinematics("ur5", tip="tool0")
    tool = np.linalg.inv(kin.fk(np.zeros(6))) @ ur5_ik.fk(np.zeros(6))

    def postures(solutions: Any) -> Floats:
        return np.array([solution.q for solution in solutions], dtype=np.float64).reshape(-1, 6)

    def call(T: Floats) -> Any:
        return ur5_ik.solve(T, enumerate_windings=False)

    note = "ur5_ik.solve(T, enumerate_windings=False)"  # one winding per branch, as the others
    return IKPeer(note, lambda T: np.ascontiguousarray(T @ tool), call, postures)
