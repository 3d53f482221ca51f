"""Native batches of environments, and the random starts that they draw ahead."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike

from kinreach.checks import MOST_THREADS, Floats, check_count
from kinreach.envs.options import check_seed
from kinreach.errors import InputError

#: Rows drawn at a time. Part of what a seed means: changing it may change the goals that follow from a seed.
AHEAD = 256
#: Environments for which they are drawn before they are put in place: as many as stay in the cache. An array of that
#: size has a use when it is freed, too: from then on glibc keeps the memory that every step takes and gives back.
TOGETHER = 256
#: More environments in one batch are refused before memory is asked for.
MOST_ENVIRONMENTS = 2**17


def first_row(info: Mapping[str, Any]) -> dict[str, Any]:
    """The `info` of a single environment from that of a batch of one."""
    return {
        name: first_row(value)
        if isinstance(value, Mapping)
        else value[0].copy()
        if value.ndim > 1
        else value.tolist()[0]
        for name, value in info.items()
    }


class Sampler(Protocol):
    """What rows of numbers are drawn from; a `GoalRegion` is one, with rows of three."""

    def sample(self, rng: np.random.Generator, count: int) -> Floats:
        """Draw `count` rows, shape (count, size)."""
        ...


class RowStreams:
    """An endless sequence of rows for each of a number of environments: goals, or whatever an episode starts with.

    A sequence depends on its own generator alone, not on how many environments there are.

    Args:
        sampler: Draws the rows.
        count: Number of environments.
        size: Numbers in a row.
    """

    def __init__(self, sampler: Sampler, count: int, *, size: int = 3) -> None:
        self._sampler = sampler
        self._rngs = [np.random.default_rng() for _ in range(count)]
        self._ahead = np.empty((AHEAD, count, size))  # environments in step read what lies side by side
        self._next = np.full(count, AHEAD)

    def seed(self, index: int, rng: np.random.Generator) -> None:
        """Start an environment's sequence afresh with a generator that it then owns."""
        self._rngs[index] = rng
        self._next[index] = AHEAD

    def draw(self, ids: np.ndarray) -> Floats:
        """The next row of each of the given environments, shape (len(ids), size)."""
        return self._taken(ids).copy()

    def _taken(self, ids: np.ndarray) -> Floats:
        """As `draw`; holds until the next call."""
        turns = self._next[ids]
        empty = ids[turns == AHEAD]
        for start in range(0, len(empty), TOGETHER):
            some = empty[start : start + TOGETHER]
            run = some[-1] - some[0] == len(some) - 1
            self._ahead[:, slice(some[0], some[-1] + 1) if run else some] = self._drawn(some).swapaxes(0, 1)
        turns[turns == AHEAD] = 0
        self._next[ids] = turns + 1
        in_step = len(ids) == len(self._next) and (turns == turns[0]).all()
        rows: Floats = self._ahead[turns[0]] if in_step else self._ahead[turns, ids]
        return rows

    def _drawn(self, ids: np.ndarray) -> Floats:
        """The next AHEAD rows of some environments, shape (len(ids), AHEAD, size)."""
        return np.array([self._sampler.sample(self._rngs[index], AHEAD) for index in ids])


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
