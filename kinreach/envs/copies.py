"""Copies of environments in the middle of an episode."""

from __future__ import annotations

from copy import deepcopy
from typing import Any, Self

import gymnasium as gym
from gymnasium.utils import EzPickle


class CopyableEnv(gym.Env[Any, Any], EzPickle):
    """An environment that `copy.deepcopy` copies with its whole state, generators included: both go on alike.

    Nothing that draws is copied, it is made anew with the first frame. Pickling, as Gymnasium has it, keeps the options
    only: what comes back is to be reset.
    """

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
