"""Many button environments in step, on `mujoco.batch.Batch`."""

from __future__ import annotations

import numpy as np

from kinreach._registration import BUTTON, MAX_EPISODE_STEPS
from kinreach.envs._batch import BatchPicture, NativeVectorEnv
from kinreach.envs._button.episodes import ButtonEpisodes, ButtonOptions
from kinreach.envs._button.world import BatchTorqueWorld, SingleTorqueWorld


class ButtonPressVectorEnv(NativeVectorEnv):
    """A batch of `kinreach/ButtonPress-v0`, equal to as many single ones with the seeds `seed`, `seed + 1`, ...

    Arguments, and how episodes start anew, are as of `NativeVectorEnv`.
    """

    registered_limit = MAX_EPISODE_STEPS[BUTTON]
    Options = ButtonOptions
    drawn = True

    def _new_episodes(self, options: ButtonOptions, threads: int, device: str | None) -> ButtonEpisodes:
        return ButtonEpisodes(options, BatchTorqueWorld(options.arm, options.motors, self.num_envs, threads=threads))

    def _new_picture(self) -> BatchPicture:
        episodes, scene = self.episodes, SingleTorqueWorld(self.options.arm, self.options.motors, visual=True)

        def show(index: int) -> None:
            q = episodes.world.q[[index]]
            scene.reset(np.zeros(1, dtype=np.intp), episodes.goals[[index]], q, np.zeros_like(q))

        return BatchPicture(scene, show)
