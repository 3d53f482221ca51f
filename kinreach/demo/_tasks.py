"""Environments of the demo, by the names of its command line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from kinreach._registration import BUTTON, LIFT, MOVING, MULTI, OBSTACLES, REAL_ARM, SINGLE, SPACE
from kinreach.demo._film import FILM_FPS
from kinreach.demo._players import playable


@dataclass(frozen=True)
class DemoTask:
    """An environment that can be watched.

    Attributes:
        policy, steps, printed: Defaults of the command line.
        fps: Frames per second of a film, in the time of the simulation.
        done: Text for success in a film.
    """

    name: str
    policy: str = "closed-form"
    steps: int = 20
    printed: str = "reward"
    fps: int = FILM_FPS
    done: str = "reached"

    @property
    def settings(self) -> Mapping[str, Any]:
        """Defaults of the options of its environment; the button's are those of the course report."""
        return {} if self.name == BUTTON else playable(self.name).options


TASKS: Mapping[str, DemoTask] = {
    "single": DemoTask(SINGLE),
    "multi": DemoTask(MULTI),
    "space": DemoTask(SPACE),
    "real-arm": DemoTask(REAL_ARM, policy="identified", steps=6),
    "moving": DemoTask(MOVING, policy="interception", steps=200, fps=30),
    "obstacles": DemoTask(OBSTACLES, policy="path"),
    "lift": DemoTask(LIFT, steps=5, done="lifted"),
    # By default this is the test that the course report describes.
    "button": DemoTask(BUTTON, policy="random", steps=10_000, printed="action,observation"),
}
