"""Many button environments in step, on `mujoco.batch.Batch`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kinreach.checks import Floats
from kinreach.envs.batch import NativeVectorEnv
from kinreach.envs.button.episodes import ButtonEpisodes, ButtonOptions
from kinreach.envs.button.task import action_space, check_actions, observation_space
from kinreach.envs.button.world import BatchTorqueWorld
from kinreach.envs.options import options_from


class ButtonPressVectorEnv(NativeVectorEnv):
    """A batch of `kinreach/ButtonPress-v0`, equal to as many single ones with the seeds `seed`, `seed + 1`, ...

    An episode that ends starts anew in the same step (`AutoresetMode.SAME_STEP`): the observation returned is the first
    of the new episode, `info["final_obs"]`, shape (num_envs, 19), is the last of the old one where
    `info["_final_obs"]` is True, and `info["final_info"]` holds what the single environment's `info` would, as arrays.
    The other entries of `info` are those of the step that was just made, whether or not an episode ended with it;
    only `goal` is already the new episode's.

    Args:
        num_envs: Number of environments.
        threads: Threads that step the dynamics.
        **options: As in the single environment (`ButtonOptions`), but `render_mode`: a batch draws nothing.

    Raises:
        InputError: Options that cannot be.
    """

    def __init__(self, num_envs: int = 1, *, threads: int = 1, **options: Any) -> None:
        given = options_from(ButtonOptions, options)
        super().__init__(
            num_envs,
            threads=threads,
            draws=given.render_mode is not None,
            action_space=action_space(),
            observation_space=observation_space(),
        )
        world = BatchTorqueWorld(given.arm, given.motors, num_envs, threads=threads)
        self._episodes = ButtonEpisodes(given, world)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Start all episodes.

        Args:
            seed: Of the first environment (the others count up), or one for each.
            options: `"goal"`, shape (num_envs, 3), sets the targets, in the world frame [m]; `"q"`, shape
                (num_envs, 3), starts the arms in these postures [rad], at rest.

        Raises:
            InputError: Unknown or malformed options, targets out of reach, or as many seeds as there are not
                environments.
        """
        goals, q = self._episodes.options(options, self.num_envs)
        self._seed(seed, self._episodes.seed)
        self._episodes.begin(self._everyone, goals, q)
        return self._episodes.observe(), self._episodes.start_info()

    def step(self, actions: ArrayLike) -> tuple[Floats, Floats, Any, Any, dict[str, Any]]:
        """Act in all environments.

        Args:
            actions: Integers from 0 to 53, shape (num_envs,).

        Raises:
            InputError: Wrong shape, or no such actions.
        """
        outcome = self._episodes.step(check_actions(actions, self.num_envs))
        info = outcome.info
        over = outcome.terminated | outcome.truncated
        observation = self._episodes.observe()
        if over.any():
            info |= {"final_obs": observation, "_final_obs": over, "final_info": dict(info), "_final_info": over}
            self._episodes.begin(np.flatnonzero(over))
            observation = self._episodes.observe()
            info["goal"] = self._episodes.goals.copy()
        return observation, outcome.reward, outcome.terminated, outcome.truncated, info
