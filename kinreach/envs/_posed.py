"""Environments that simulate no bodies, drawn by a scene that follows them."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

from kinreach.envs._batch import Outcome
from kinreach.envs._single import ONLY, SingleEnv
from kinreach.robots import ArmDescription
from kinreach.sim.inside import PosedScene


class PosedEnv(SingleEnv):
    """An environment that simulates no bodies: a scene follows its `arm` and the ball of its `info` where it is drawn.

    Its episodes have the postures `q`.
    """

    _posed: PosedScene | None = None

    @property
    @abstractmethod
    def arm(self) -> ArmDescription:
        """The arm, in its work cell."""

    @property
    def scene(self) -> PosedScene:
        """What `render` draws; once it was asked for, it follows the episodes."""
        if self._posed is None:
            self._posed = PosedScene(self.arm)
            if self._started:
                self._follow()
        return self._posed

    def _follow(self) -> None:
        scene = self._posed
        if scene is None:
            return
        told = self.episodes.goal_info(ONLY)
        time = float(told["time"][0]) if "time" in told else scene.data.time + 1.0 / self.episodes.fps
        scene.put(self.episodes.q[0], ball=told["goal"][0], time=time)
        if scene.watch is not None:
            scene.watch()

    def _answer(self, outcome: Outcome) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self._follow()
        return super()._answer(outcome)
