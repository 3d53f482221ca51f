"""How a trial ended, to be drawn: the arm in its posture, and the ball."""

from __future__ import annotations

from typing import Any

import numpy as np

from kinreach.compare.tables import number
from kinreach.compare.trials import ReachTrial
from kinreach.robots import ArmDescription
from kinreach.sim.simulation import ArmSimulation


class ReachStage:
    """Shows trials of one arm.

    The arm is shown in the posture that was commanded last, which is where it came to rest if the move was completed;
    where none was found or it is outside the limits, at the start.

    Args:
        arm: Whose trials.

    Attributes:
        model, data: MuJoCo's.
    """

    def __init__(self, arm: ArmDescription) -> None:
        self._simulation = ArmSimulation(arm, visual=True)
        self.model: Any = self._simulation.model
        self.data: Any = self._simulation.data

    def show(self, trial: ReachTrial) -> list[str]:
        """Put arm and ball where the trial had them, and say what there is to see."""
        q = None if trial.q is None else np.array(trial.q)
        outside = q is not None and bool(self._simulation.controller.outside_limits(q).any())
        self._simulation.reset(None if outside else q)
        self._simulation.place_ball((trial.x, trial.y, trial.z))
        error = [] if trial.posture_error is None else [f"posture error {number(trial.posture_error)} rad"]
        if not trial.impossible:
            return [*error, "the arm where it came to rest"]
        place = "at the start" if q is None or outside else "in the posture that was commanded last"
        return [*error, f"{trial.status}: {trial.reason}" if trial.reason else trial.status, f"the arm {place}"]
