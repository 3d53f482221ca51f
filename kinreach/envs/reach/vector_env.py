"""Many reach environments in step: numpy for the kinematic backend, `mujoco.batch.Batch` for the dynamics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kinreach.checks import Floats
from kinreach.envs.batch import NativeVectorEnv
from kinreach.envs.reach.episodes import Outcome, ReachEpisodes
from kinreach.envs.reach.options import ReachOptions
from kinreach.envs.reach.task import (
    MULTI_STEP,
    SINGLE_STEP,
    ReachVariant,
    action_space,
    check_actions,
    observation_space,
    reset_options,
)
from kinreach.envs.reach.worlds import BatchDynamicWorld, KinematicWorld, ReachWorld


class UR5ReachVectorEnv(NativeVectorEnv):
    """As many independent environments, equal to as many single ones with the seeds `seed`, `seed + 1`, ...

    An episode that ends starts anew in the same step (`AutoresetMode.SAME_STEP`): the observation returned is the first
    of the new episode, `info["final_obs"]`, shape (num_envs, 13), is the last of the old one where
    `info["_final_obs"]` is True, and `info["final_info"]` holds what the single environment's `info` would, as arrays.
    The other entries of `info` are those of the step that was just made, whether or not an episode ended with it;
    only `goal` and `ball_found` are already the new episode's.

    Args:
        num_envs: Number of environments.
        variant: Which task.
        threads: Threads that step the dynamics (`backend="mujoco"`).
        observation: `"geometric"` or `"camera"`; images of many environments are what Gymnasium's own vectorisation
            of the single environment is for.
        backend, pipeline, width, height, rgb_noise, depth_noise, end_on_reached: As in the single environments.

    Raises:
        InputError: Options that cannot be.
    """

    def __init__(
        self,
        num_envs: int = 1,
        *,
        variant: ReachVariant,
        threads: int = 1,
        observation: str = "geometric",
        backend: str = "mujoco",
        render_mode: str | None = None,
        pipeline: str = "hybrid",
        width: int = 640,
        height: int = 360,
        rgb_noise: float = 0.0,
        depth_noise: float = 0.0,
        end_on_reached: bool = True,
    ) -> None:
        options = ReachOptions(observation, backend, pipeline, width, height, rgb_noise, depth_noise, end_on_reached)
        super().__init__(
            num_envs,
            threads=threads,
            draws=(observation == "pixels") or render_mode is not None,
            action_space=action_space(),
            observation_space=observation_space(),
        )
        world: ReachWorld = (
            BatchDynamicWorld(num_envs, threads=threads) if backend == "mujoco" else KinematicWorld(num_envs)
        )
        self._episodes = ReachEpisodes(options.arm, variant, world, options.observer(), end_on_reached=end_on_reached)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Start all episodes.

        Args:
            seed: Of the first environment (the others count up), or one for each.
            options: `"goal"`, shape (num_envs, 3), puts the balls there, in the world frame [m]; `"q"`, shape
                (num_envs, 6), starts the arms in these postures [rad].

        Raises:
            InputError: Unknown options, or as many seeds, goals or postures as there are not environments.
        """
        goals, q = reset_options(options, self.num_envs)
        self._seed(seed, self._episodes.seed)
        self._episodes.begin(self._everyone, goals, q)
        return self._episodes.observe(), {
            "goal": self._episodes.goals.copy(),
            "ball_found": self._episodes.found.copy(),
        }

    def step(self, actions: ArrayLike) -> tuple[Floats, Floats, Any, Any, dict[str, Any]]:
        """Act in all environments.

        Args:
            actions: Shape (num_envs, 6), in [-1, 1]; what is outside is clipped.

        Raises:
            InputError: Wrong shape, or a value that is not finite.
        """
        outcome = self._episodes.step(check_actions(actions, self.num_envs))
        info = self._info(outcome)
        over = outcome.terminated | outcome.truncated
        observation = self._episodes.observe()
        if over.any():
            final_info = info | {"goal": self._episodes.goals, "ball_found": self._episodes.found}
            info |= {"final_obs": observation, "_final_obs": over, "final_info": final_info, "_final_info": over}
            self._episodes.begin(np.flatnonzero(over))
            observation = self._episodes.observe()
        info |= {"goal": self._episodes.goals.copy(), "ball_found": self._episodes.found.copy()}
        return observation, outcome.scored.reward, outcome.terminated, outcome.truncated, info

    def close_extras(self, **kwargs: Any) -> None:
        """Free the renderers."""
        self._episodes.close()

    def _info(self, outcome: Outcome) -> dict[str, Any]:
        scored = outcome.scored
        info: dict[str, Any] = {
            "distance": outcome.distance,
            "posture_error": scored.posture_error,
            "reached": scored.reached,
            "is_success": scored.reached,
            "impossible": outcome.executed.impossible,
            "reward_terms": scored.terms._asdict(),
        }
        if outcome.executed.reasons is not None:
            info["impossible_reason"] = np.array(outcome.executed.reasons, dtype=object)
        return info


def single_step(num_envs: int = 1, **options: Any) -> UR5ReachVectorEnv:
    """A batch of `kinreach/UR5SingleStep-v0`."""
    return UR5ReachVectorEnv(num_envs, variant=SINGLE_STEP, **options)


def multi_step(num_envs: int = 1, **options: Any) -> UR5ReachVectorEnv:
    """A batch of `kinreach/UR5MultiStep-v0`."""
    return UR5ReachVectorEnv(num_envs, variant=MULTI_STEP, **options)
