"""Pictures of goals for a training, rendered in advance."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.envs.inside import PixelObserver, ReachTask


class Looks:
    """Pictures of balls by both cameras, with the arm in its start pose; noise before `take`.

    Attributes:
        pictures: Of each look and camera, uint8, shape (count, cameras, height, width, 3).
        names: Of the pictures, as observations have them, in the order of the cameras.
    """

    def __init__(self, task: ReachTask, count: int) -> None:
        self._task = task
        self.names = sorted(f"{camera.name}_rgb" for camera in task.arm.goal_cameras)
        shape = (count, len(self.names), task.options.height, task.options.width, 3)
        self.pictures: NDArray[np.uint8] = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)

    def take(self, goals: Floats, rng: np.random.Generator) -> None:
        """Take new looks at balls in the world [m], shape (count, 3); `rng` is of the sensors' noise."""
        observer = PixelObserver(self._task.arm, self._task.options)
        try:
            seen = observer.measure(np.tile(self._task.home, (len(goals), 1)), goals, [rng] * len(goals))
        finally:
            observer.close()
        for camera, name in enumerate(self.names):
            self.pictures[:, camera] = seen[name]

    def seen(self, numbers: NDArray[Any]) -> dict[str, NDArray[np.uint8]]:
        """Looks by their numbers, shape (k,), as environments with `observation="pixels"` give them."""
        return {name: self.pictures[numbers, camera] for camera, name in enumerate(self.names)}
