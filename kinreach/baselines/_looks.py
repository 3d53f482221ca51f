"""Pictures of goals for a training, rendered in advance, and the environments that show them."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs

from kinreach._checks import Floats
from kinreach.baselines._ranked_ppo import TriesVecEnv
from kinreach.envs.inside import PixelObserver, reach_task


class Looks:
    """Pictures of balls by both cameras, with the arm in its start pose; noise before `take`.

    Attributes:
        pictures: Of each look and camera, uint8, shape (count, cameras, height, width, 3).
        names: Of the pictures, as observations have them, in the order of the cameras.
    """

    def __init__(self, task: reach_task.ReachTask, count: int) -> None:
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


class LooksVecEnv(TriesVecEnv):
    """Groups of tries from pictures: an observation is the number of a look at a group's goal.

    Looks are taken when the environments are seeded.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any], *, looks: Looks, **kwargs: Any) -> None:
        super().__init__(env, **kwargs)
        self.looks = looks
        self.observation_space = spaces.Box(0.0, float(len(looks.pictures) - 1), (1,))
        self._goals = np.zeros((len(looks.pictures), 3))

    def seen(self, observations: NDArray[Any]) -> Any:
        return self.looks.seen(observations[:, 0].astype(int))

    def reset(self) -> VecEnvObs:
        if self._seeds[0] is not None:
            rng = np.random.default_rng([self._seeds[0], 1])
            self._goals = np.array(self._draw(rng, len(self._goals))["goal"])
            self.looks.take(self._goals, rng)
        return super().reset()

    def _begin(self) -> NDArray[Any]:
        groups = self._rng.integers(len(self._goals), size=self.num_envs // self._tries)
        numbers = np.repeat(groups, self._tries)
        self._env.reset(options={"goal": self._goals[numbers]})
        return numbers[:, None].astype(np.float32)
