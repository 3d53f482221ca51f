"""How an episode ended, to be drawn: the arm, the target, and the button below it."""

from __future__ import annotations

from typing import Any

import numpy as np

from kinreach.compare.tasks import ButtonTask
from kinreach.compare.trials import EpisodeTrial
from kinreach.envs.button.world import ButtonState, SingleTorqueWorld


class ButtonStage:
    """Shows the ends of episodes.

    Args:
        task: Whose episodes.

    Attributes:
        model, data: MuJoCo's.
    """

    def __init__(self, task: ButtonTask) -> None:
        self._world = SingleTorqueWorld(task.arm, task.episode.options.actuation, visual=True)
        self.model: Any = self._world.model
        self.data: Any = self._world.data

    def show(self, trial: EpisodeTrial) -> list[str]:
        """Put the arm and the button where the episode left them, and say what there is to see."""
        target, q = np.array([[trial.x, trial.y, trial.z]]), np.array([trial.q])
        self._world.reset(np.zeros(1, dtype=np.intp), target, q, np.zeros_like(q))
        self._world.show(ButtonState.PRESSED if trial.reached else ButtonState.IDLE)
        return [f"{trial.status} after {trial.steps} steps", f"wrong presses: {trial.wrong_presses}"]
