"""What single environments have beyond Gymnasium's: copies in the middle of an episode, films of their motion."""

from __future__ import annotations

from copy import deepcopy
from typing import Any, Self

import gymnasium as gym
from gymnasium.utils import EzPickle
from gymnasium.wrappers import RecordVideo

from kinreach.envs.batch import first_row, numbers_of
from kinreach.errors import InputError


class CopyableEnv(gym.Env[Any, Any], EzPickle):
    """An environment that `copy.deepcopy` copies with its whole state, generators included: both go on alike.

    Nothing that draws is copied, it is made anew with the first frame. Pickling, as Gymnasium has it, keeps the options
    only: what comes back is to be reset.
    """

    options: Any
    _episodes: Any
    _started: bool

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        twin = type(self)(**self._ezpickle_kwargs)
        memo[id(self)] = twin
        twin._np_random, twin._np_random_seed = deepcopy((self._np_random, self._np_random_seed))
        twin.action_space, twin.observation_space = deepcopy((self.action_space, self.observation_space))
        twin.spec = self.spec
        twin._started = self._started
        twin._episodes.copy_from(self._episodes)
        return twin

    def _told(self, info: dict[str, Any]) -> dict[str, Any]:
        """The `info` of the one environment, as far as it is asked for."""
        told = first_row(info)
        return numbers_of(told) if self.options.info == "numbers" else told


class RecordMotion(RecordVideo):
    """Gymnasium's `RecordVideo`, with all frames of the motion of each step instead of the last one.

    A step of the single-step task is a whole motion, of which `RecordVideo` would keep two pictures.

    Args:
        env: Made with `render_mode="rgb_array_list"`.
        *args: As those of `RecordVideo`.
        **kwargs: As those of `RecordVideo`.

    Raises:
        InputError: The environment has another render mode.
    """

    def __init__(self, env: Any, *args: Any, **kwargs: Any) -> None:
        if env.render_mode != "rgb_array_list":
            raise InputError(f'RecordMotion needs render_mode="rgb_array_list", got {env.render_mode!r}')
        super().__init__(env, *args, **kwargs)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step, and keep the frames of the motion."""
        known = len(self.render_history)
        result = super().step(action)
        if self.recording:
            self.recorded_frames[-1:-1] = self.render_history[known:-1]
        return result
