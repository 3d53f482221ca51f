"""UR-type arms as the core has them; `_core/ur.c` is their closed form."""

from __future__ import annotations

import numpy as np

from kinreach._checks import Floats
from kinreach.kinematics._core import Struct
from kinreach.kinematics._ur.geometry import URGeometry

#: Below this sin q5 rounding in the pose, 1e-13 say, is magnified to more than the smallest tolerance.
NEAR_WRIST = 1e-3
_SAME = np.eye(4)


def core_arm(g: URGeometry, *, base: Floats = _SAME, flange: Floats = _SAME) -> Struct:
    """Return the arm as the core has it, with the transforms (4, 4) from a pose's base and to its flange."""
    return Struct(
        "kr_ur", d1=g.d1, upper=-g.a2, fore=-g.a3, d4=g.d4, d5=g.d5, d6=g.d6, stretched=g.stretched, folded=g.folded,
        base=base[:3].ravel().tolist(), flange=flange[:3].ravel().tolist(),
    )  # fmt: skip
