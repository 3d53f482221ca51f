"""ur-analytic-ik: the textbook closed form in C++."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.speed.peers.base import IKPeer
from kinreach.checks import Floats

FLIP = np.diag([-1.0, -1.0, 1.0, 1.0])  # base_link -> the DH base frame that it uses


def make() -> IKPeer:
    """Its UR5."""
    from ur_analytic_ik import ur5

    def postures(solutions: Any) -> Floats:
        return np.array(solutions, dtype=np.float64).reshape(-1, 6)

    return IKPeer(
        "ur5.inverse_kinematics(T)", lambda T: np.ascontiguousarray(FLIP @ T), ur5.inverse_kinematics, postures
    )
