"""Many button environments in step, on `mujoco.batch.Batch`."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from kinreach._registration import BUTTON, MAX_EPISODE_STEPS
from kinreach.envs._batch import BatchPicture, NativeVectorEnv, check_batch
from kinreach.envs._button.button_task import action_space, check_actions
from kinreach.envs._button.episodes import ButtonEpisodes, ButtonOptions
from kinreach.envs._button.world import BatchTorqueWorld, SingleTorqueWorld
from kinreach.envs._options import options_from


class ButtonPressVectorEnv(NativeVectorEnv):
    """A batch of `kinreach/ButtonPress-v0`, equal to as many single ones with the seeds `seed`, `seed + 1`, ...

    Episodes start anew as `NativeVectorEnv` describes: where one ended in a step, read its outcome from
    `info["final_info"]`, because `info["goal"]` is already the next one's.

    Args:
        num_envs: Number of environments.
        threads: Threads that step the dynamics.
        autoreset_mode: `AutoresetMode.SAME_STEP`, `NEXT_STEP` or `DISABLED`.
        max_episode_steps: Steps after which episodes are truncated.
        device: Of torch, for tensors instead of arrays.
        **options: As in the single environment (`ButtonOptions`). `render_mode` is None or `"rgb_array"`, for up to 64
            environments.

    Raises:
        InputError: Invalid options.
    """

    registered_limit = MAX_EPISODE_STEPS[BUTTON]

    def __init__(
        self,
        num_envs: int = 1,
        *,
        threads: int = 1,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        device: str | None = None,
        **options: Any,
    ) -> None:
        given = options_from(ButtonOptions, options)
        num_envs = check_batch(num_envs, threads, given.render_mode)
        episodes = ButtonEpisodes(given, BatchTorqueWorld(given.arm, given.motors, num_envs, threads=threads))
        super().__init__(
            episodes,
            num_envs,
            action_space=action_space(),
            observation_space=given.observation_space,
            check_actions=partial(check_actions, count=num_envs),
            check_start=partial(episodes.check_start, count=num_envs),
            autoreset_mode=autoreset_mode,
            picture=None if given.render_mode is None else _picture(given, episodes),
            device=device,
            numbers_only=given.info == "numbers",
            max_episode_steps=max_episode_steps,
        )
        self.metadata = {**self.metadata, "render_fps": round(1 / given.motors.period)}


def _picture(options: ButtonOptions, episodes: ButtonEpisodes) -> BatchPicture:
    scene = SingleTorqueWorld(options.arm, options.motors, visual=True)

    def show(index: int) -> None:
        q = episodes.world.q[[index]]
        scene.reset(np.zeros(1, dtype=np.intp), episodes.goals[[index]], q, np.zeros_like(q))

    return BatchPicture(scene, show)
