"""Many reach environments in step: numpy for the kinematic backend, `mujoco.batch.Batch` or Warp for the dynamics."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from kinreach._checks import check_count
from kinreach._registration import MAX_EPISODE_STEPS, MULTI
from kinreach.envs._batch import BatchPicture, NativeVectorEnv, check_batch
from kinreach.envs._options import options_from
from kinreach.envs._reach.episodes import ReachEpisodes
from kinreach.envs._reach.reach_task import (
    MULTI_STEP,
    SINGLE_STEP,
    ReachOptions,
    ReachTask,
    ReachVariant,
    action_space,
    check_actions,
)
from kinreach.envs._reach.space import SpaceTask
from kinreach.envs._reach.worlds import BatchDynamicWorld, KinematicWorld, ReachWorld
from kinreach.sim import ArmSimulation
from kinreach.sim.inside import as_imperfections

#: Two pictures of three bytes and a depth; what all environments see may take so much [bytes].
_PIXEL_BYTES, MAX_BYTES = 2 * (3 + 4), 2**32


class ReachVectorEnv(NativeVectorEnv):
    """As many independent environments, equal to as many single ones with the seeds `seed`, `seed + 1`, ...

    Episodes start anew as `NativeVectorEnv` describes: where one ended in a step, read its outcome from
    `info["final_info"]`, because `info["goal"]` is already the next one's. What would take long is left out of
    `info` with `backend="kinematic"`: `target_tip`, and in `impossible_reason` the names of what collides.

    Args:
        num_envs: Number of environments.
        variant: Which of the thesis's tasks; None for reaching in space, whose variant is an option.
        threads: Threads that step the dynamics (`backend="mujoco"`).
        autoreset_mode: `AutoresetMode.SAME_STEP`, `NEXT_STEP` or `DISABLED`.
        max_episode_steps: Steps after which episodes are truncated.
        device: Of torch, for tensors instead of arrays. With `backend="warp"` it is Warp's device too, and rewards are
            computed on it; else they are computed in numpy and handed over.
        **options: As in the single environments (`ReachOptions`, `SpaceOptions`). `render_mode` is None or
            `"rgb_array"`, for up to 64 environments. With `observation="pixels"` one scene is drawn for all of them.

    Attributes:
        task: What is to be done.

    Raises:
        InputError: Invalid options.
    """

    registered_limit = MAX_EPISODE_STEPS[MULTI]

    def __init__(
        self,
        num_envs: int = 1,
        *,
        variant: ReachVariant | None = None,
        threads: int = 1,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        device: str | None = None,
        **options: Any,
    ) -> None:
        self.task = task = (
            SpaceTask.of(options) if variant is None else ReachTask(options_from(ReachOptions, options), variant)
        )
        given = task.options
        num_envs = check_batch(num_envs, threads, given.render_mode)
        if given.observation == "pixels":
            check_count("bytes of all pictures", num_envs * given.width * given.height * _PIXEL_BYTES, most=MAX_BYTES)
        arm = task.arm
        world: ReachWorld = (
            KinematicWorld(task, num_envs)
            if given.backend == "kinematic"
            else BatchDynamicWorld(
                arm,
                num_envs,
                threads=threads,
                imperfections=as_imperfections(given.imperfections),
                backend=given.backend,
                device=device if given.backend == "warp" else None,
            )
        )
        episodes = ReachEpisodes(task, world)
        super().__init__(
            episodes,
            num_envs,
            action_space=action_space(arm),
            observation_space=episodes.observation_space,
            check_actions=partial(check_actions, count=num_envs, joints=len(arm.joints)),
            check_start=partial(task.reset_options, count=num_envs),
            autoreset_mode=autoreset_mode,
            picture=None if given.render_mode is None else _picture(episodes),
            device=device,
            numbers_only=given.info == "numbers",
            max_episode_steps=max_episode_steps,
        )


def _picture(episodes: ReachEpisodes) -> BatchPicture:
    scene = ArmSimulation(episodes.task.arm, visual=True)
    limits = scene.controller

    def show(index: int) -> None:
        scene.reset(np.clip(episodes.world.q[index], limits.lower, limits.upper))
        scene.place_ball(episodes.goals[index])

    return BatchPicture(scene, show)


#: Entry points of the native batches.
single_step = partial(ReachVectorEnv, variant=SINGLE_STEP)
multi_step = partial(ReachVectorEnv, variant=MULTI_STEP)
in_space = partial(ReachVectorEnv, variant=None)
