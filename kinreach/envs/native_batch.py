"""What every native batch of environments is to Gymnasium."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike

from kinreach.envs.resets import check_seed
from kinreach.errors import InputError
from kinreach.inputs import MOST_THREADS, check_count
from kinreach.kinematics.goals import Floats

#: More environments in one batch are refused before memory is asked for.
MOST_ENVIRONMENTS = 2**17


class NativeVectorEnv(VectorEnv[Floats, ArrayLike, Floats]):
    """Spaces and seeds of a batch whose episodes start anew in the step in which they end.

    Args:
        num_envs: Number of environments.
        threads: Threads that step the dynamics.
        draws: Whether images were asked for, which a batch does not make.
        action_space, observation_space: Of one environment.

    Raises:
        InputError: No environments, no threads, or images.
    """

    metadata = {  # noqa: RUF012 (declared by Gymnasium)
        "render_modes": [],
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(
        self,
        num_envs: int,
        *,
        threads: int,
        draws: bool,
        action_space: spaces.Space[Any],
        observation_space: spaces.Space[Any],
    ) -> None:
        num_envs = check_count("num_envs", num_envs, most=MOST_ENVIRONMENTS)
        check_count("threads", threads, most=MOST_THREADS)
        if draws:
            raise InputError('a native batch draws no images; use vectorization_mode="sync" or "async" for them')
        self.num_envs = num_envs
        self.render_mode = None
        self.single_action_space = action_space
        self.single_observation_space = observation_space
        self.action_space = batch_space(action_space, num_envs)
        self.observation_space = batch_space(observation_space, num_envs)
        self._everyone = np.arange(num_envs)
        self._seeded = False

    def _seed(
        self, seed: int | Sequence[int | None] | None, give: Callable[[int, np.random.Generator], object]
    ) -> None:
        """Give each environment the generator of its seed; without seeds only if they have none yet.

        Args:
            seed: Of the first environment (the others count up), one for each, or None.
            give: Called with the index of an environment and its generator.

        Raises:
            InputError: A seed that is none, or as many seeds as there are not environments.
        """
        if seed is None:
            seeds: list[int | None] = [None] * self.num_envs
        elif isinstance(seed, Sequence | np.ndarray) and not isinstance(seed, str | bytes):
            seeds = [check_seed(value) for value in seed]
        else:
            first = check_count("seed", seed, least=0)
            seeds = list(range(first, first + self.num_envs))
        if len(seeds) != self.num_envs:
            raise InputError(f"there are {self.num_envs} environments and {len(seeds)} seeds")
        for index, value in enumerate(seeds):
            if value is not None or not self._seeded:
                give(index, seeding.np_random(value)[0])
        self._seeded = True
