"""Many reach environments in step: numpy for the kinematic backend, `mujoco.batch.Batch` for the dynamics."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kinreach.checks import Floats
from kinreach.envs.batch import NativeVectorEnv
from kinreach.envs.options import options_from
from kinreach.envs.reach.episodes import ReachEpisodes
from kinreach.envs.reach.task import (
    MULTI_STEP,
    SINGLE_STEP,
    ReachOptions,
    ReachTask,
    ReachVariant,
    action_space,
    check_actions,
    observation_space,
    reset_options,
)
from kinreach.envs.reach.worlds import BatchDynamicWorld, KinematicWorld, ReachWorld


class ReachVectorEnv(NativeVectorEnv):
    """As many independent environments, equal to as many single ones with the seeds `seed`, `seed + 1`, ...

    An episode that ends starts anew in the same step (`AutoresetMode.SAME_STEP`): the observation returned is the first
    of the new episode, `info["final_obs"]`, shape (num_envs, size), is the last of the old one where
    `info["_final_obs"]` is True, and `info["final_info"]` holds what the single environment's `info` would, as arrays.
    The other entries of `info` are those of the step that was just made, whether or not an episode ended with it;
    only `goal`, `seen` and `ball_found` are already the new episode's. What would take long is left out with
    `backend="kinematic"`: `target_tip`, and in `impossible_reason` the names of what collides.

    Args:
        num_envs: Number of environments.
        variant: Which task.
        threads: Threads that step the dynamics (`backend="mujoco"`).
        **options: As in the single environments (`ReachOptions`), but `observation="pixels"` and `render_mode`: images
            of many environments are what Gymnasium's own vectorisation of the single environment is for.

    Raises:
        InputError: Options that cannot be.
    """

    def __init__(self, num_envs: int = 1, *, variant: ReachVariant, threads: int = 1, **options: Any) -> None:
        given = options_from(ReachOptions, options)
        task = ReachTask(given, variant)
        super().__init__(
            num_envs,
            threads=threads,
            draws=given.observation == "pixels" or given.render_mode is not None,
            action_space=action_space(task.arm),
            observation_space=observation_space(task.arm),
        )
        world: ReachWorld = (
            BatchDynamicWorld(task.arm, num_envs, threads=threads)
            if given.backend == "mujoco"
            else KinematicWorld(task, num_envs)
        )
        self._task = task
        self._episodes = ReachEpisodes(task, world)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Start all episodes.

        Args:
            seed: Of the first environment (the others count up), or one for each.
            options: As those of the single environment, `"goal"`, `"q"` and `"view"`, one row for each environment.

        Raises:
            InputError: Unknown options, or as many seeds, goals or postures as there are not environments.
        """
        start = reset_options(options, self.num_envs, self._task.arm)
        self._seed(seed, self._episodes.seed)
        self._episodes.begin(self._everyone, start)
        return self._episodes.observe(), self._episodes.start_info()

    def step(self, actions: ArrayLike) -> tuple[Floats, Floats, Any, Any, dict[str, Any]]:
        """Act in all environments.

        Args:
            actions: Shape (num_envs, n), in [-1, 1]; what is outside is clipped.

        Raises:
            InputError: Wrong shape, or a value that is not finite.
        """
        outcome = self._episodes.step(check_actions(actions, self.num_envs, len(self._task.arm.joints)))
        info = outcome.info
        over = outcome.terminated | outcome.truncated
        observation = self._episodes.observe()
        if over.any():
            episodes = self._episodes
            final_info = {**info, "goal": episodes.goals, "seen": episodes.seen, "ball_found": episodes.found}
            info |= {"final_obs": observation, "_final_obs": over, "final_info": final_info, "_final_info": over}
            self._episodes.begin(np.flatnonzero(over))
            observation = self._episodes.observe()
        info |= self._episodes.goal_info()
        return observation, outcome.reward, outcome.terminated, outcome.truncated, info

    def close_extras(self, **kwargs: Any) -> None:
        """Free the renderers."""
        self._episodes.close()


#: Entry points of the native batches.
single_step = partial(ReachVectorEnv, variant=SINGLE_STEP)
multi_step = partial(ReachVectorEnv, variant=MULTI_STEP)
