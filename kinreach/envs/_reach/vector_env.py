"""Many reach environments in step: numpy for the kinematic backend, `mujoco.batch.Batch` or Warp for the dynamics."""

from __future__ import annotations

from functools import partial
from typing import Any, ClassVar

import numpy as np

from kinreach._checks import check_count
from kinreach._registration import MAX_EPISODE_STEPS, MULTI
from kinreach.envs._batch import BatchPicture, NativeVectorEnv
from kinreach.envs._goals import GoalMethods
from kinreach.envs._randomise import drawn_of
from kinreach.envs._reach.episodes import ReachEpisodes
from kinreach.envs._reach.reach_task import MULTI_STEP, SINGLE_STEP, ReachOptions, ReachTask
from kinreach.envs._reach.space import SpaceOptions, SpaceTask
from kinreach.envs._reach.worlds import BatchDynamicWorld, KinematicWorld, ReachWorld
from kinreach.sim import ArmSimulation
from kinreach.sim.inside import as_imperfections

#: Two pictures of three bytes and a depth; what all environments see may take so much [bytes].
_PIXEL_BYTES, MAX_BYTES = 2 * (3 + 4), 2**32


class ReachVectorEnv(GoalMethods, NativeVectorEnv):
    """As many independent environments, equal to as many single ones with the seeds `seed`, `seed + 1`, ...

    Arguments, and how episodes start anew, are as of `NativeVectorEnv`. What would take long is left out of `info` with
    `backend="kinematic"`: `target_tip`, and in `impossible_reason` the names of what collides.

    With `backend="warp"` the `device` is Warp's device too, and rewards are computed on it; else they are computed in
    numpy and handed over. With `observation="pixels"` one scene is drawn for all environments.
    """

    registered_limit = MAX_EPISODE_STEPS[MULTI]
    drawn = True
    Options: ClassVar[type[ReachOptions]] = ReachOptions
    #: The task with the options.
    new_task: ClassVar[Any]

    def _new_episodes(self, options: ReachOptions, threads: int, device: str | None) -> ReachEpisodes:
        if options.observation == "pixels":
            size = self.num_envs * options.width * options.height * _PIXEL_BYTES
            check_count("bytes of all pictures", size, most=MAX_BYTES)
        self.task = task = self.new_task(options)
        world: ReachWorld = (
            KinematicWorld(task, self.num_envs)
            if options.backend == "kinematic"
            else BatchDynamicWorld(
                task.arm,
                self.num_envs,
                threads=threads,
                imperfections=as_imperfections(options.imperfections),
                backend=options.backend,
                device=device if options.backend == "warp" else None,
                drawn=drawn_of(options.randomise),
            )
        )
        return ReachEpisodes(task, world)

    def _new_picture(self) -> BatchPicture:
        episodes, scene = self.episodes, ArmSimulation(self.task.arm, visual=True)
        limits = scene.controller

        def show(index: int) -> None:
            scene.reset(np.clip(episodes.q[index], limits.lower, limits.upper))
            scene.place_ball(episodes.goals[index])

        return BatchPicture(scene, show, self.options)


class SingleStepVectorEnv(ReachVectorEnv):
    """A batch of `kinreach/UR5SingleStep-v0`."""

    new_task = staticmethod(partial(ReachTask, variant=SINGLE_STEP))


class MultiStepVectorEnv(ReachVectorEnv):
    """A batch of `kinreach/UR5MultiStep-v0`."""

    new_task = staticmethod(partial(ReachTask, variant=MULTI_STEP))


class SpaceReachVectorEnv(ReachVectorEnv):
    """A batch of `kinreach/Reach-v0`."""

    Options = SpaceOptions
    new_task = SpaceTask
