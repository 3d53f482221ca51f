"""Small steps of arms with grippers, 25 times a second: actions change joints or the tip, and fingers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from kinreach._checks import Floats
from kinreach.envs._batch import Ids
from kinreach.envs._reach.reach_task import held_in_limits, joint_limits
from kinreach.envs._tip_control import JOINTS, SMALL_STEP, TipControl, shortened
from kinreach.robots import ArmDescription

#: Period [s]; largest change of a joint [rad] and of the opening [m] in one of them.
STEP_S, STEP_ANGLE, STEP_OPENING = 0.04, math.radians(5.0), 0.008


def tip_of(arm: ArmDescription, control: str) -> TipControl | None:
    """Return what turns actions into postures where they change the tip; None where they change joints.

    Raises:
        InputError: They change the tip, and the arm has not six joints with a closed form.
    """
    return None if control == JOINTS else TipControl(arm, control, joint_limits(arm), SMALL_STEP, alone=True)


class SmallSteps:
    """Where the actions of a number of arms send them.

    Args:
        arm: Theirs.
        tip: Of `tip_of`.
        count: Number of arms.
    """

    def __init__(self, arm: ArmDescription, tip: TipControl | None, count: int) -> None:
        self._arm, self._tip = arm, tip
        self._held, self._share = np.zeros((count, 3, 3)), np.zeros(count)  # the tips' rotations, and how far they came

    def begin(self, ids: Ids, q: Floats) -> None:
        """Start episodes in postures [rad], shape (k, n)."""
        self._share[ids] = 0.0
        if self._tip is not None:
            self._held[ids] = self._tip.directions(q)

    def targets(self, ids: Ids, q: Floats, changes: Floats) -> Floats:
        """Return the postures [rad] to which changes in [-1, 1] lead from postures `q` [rad], shape (k, n)."""
        if self._tip is None:
            return held_in_limits(self._arm, q + STEP_ANGLE * changes)
        found, self._share[ids] = self._tip.targets(q, changes, self._held[ids])
        return found

    def action_for(self, q: Floats, target: Floats) -> Floats:
        """Return the changes in [-1, 1] from postures straight towards others [rad], both of shape (k, n)."""
        return shortened((target - q) / STEP_ANGLE) if self._tip is None else self._tip.action_for(q, target)

    def info(self, rows: Any) -> dict[str, Floats]:
        """Return the parts of the ways that tips were sent, from 0 to 1; nothing where actions change joints."""
        return {} if self._tip is None else {"tip_share": np.array(self._share[rows])}
