"""`Push-v0` with a strip of the table that no camera sees: contact, and a view of a part only.

The cube begins beside the strip and is to be pushed into it or across. As long as its middle is in the strip,
observations have its pose as it was last seen. The expert that is imitated sees it all the time, as in Chen et al.
2019, "Learning by cheating" (arXiv:1912.12294).
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from gymnasium import register

from kinreach._checks import Floats, check_number
from kinreach.baselines import get_recipe, register_algorithm, register_recipe
from kinreach.baselines._algorithms import ALGORITHMS, answered
from kinreach.baselines._imitation import AnsweredVecEnv
from kinreach.envs._batch import Ids
from kinreach.envs._tabletop import TabletopEnv, TabletopEpisodes, TabletopOptions, TabletopState, TabletopVectorEnv
from kinreach.envs._tabletop_tasks import Push
from kinreach.robots import BoxRegion

ID, LIMIT = "benchmarks/HiddenPush-v0", 200
#: Its id where nothing has imported this module.
WORLD = f"{__name__}:{ID}"
#: Width of the strip along y = 0 [m].
STRIP = 0.12
#: Numbers of an observation: the object's place, and its rotation.
OBJECT = slice(10, 19)


class HiddenPush(Push):
    """Push an object into the strip that no camera sees, or across.

    Args:
        strip: Its width [m]; 0 hides nothing.
        options: Of `Push`.
    """

    def __init__(self, *, strip: float = STRIP, **options: Any) -> None:
        super().__init__(**options)
        self.strip = check_number("strip [m]", strip, least=0.0, most=0.2)

    def sample(self, rng: np.random.Generator, count: int, region: BoxRegion) -> tuple[Floats, Floats, Floats]:
        """Draw places beside the strip, and goals in it or on its other side, 6 to 20 cm away."""
        places, yaws, goals = (np.empty((count, *shape)) for shape in ((2,), (), (3,)))
        missing = np.arange(count)
        while len(missing):
            drawn = super().sample(rng, len(missing), region)
            for mine, new in zip((places, yaws, goals), drawn, strict=True):
                mine[missing] = new
            y, end = places[missing, 1], goals[missing, 1]
            good = (np.abs(y) >= STRIP / 2.0) & (np.sign(y) * end < STRIP / 2.0)
            missing = missing[~good]
        return places, yaws, goals


class HiddenEpisodes(TabletopEpisodes):
    """Episodes whose observations have the object as it was last seen."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self._seen = np.zeros((self.count, OBJECT.stop - OBJECT.start))

    def _read(self, ids: Ids) -> None:
        super()._read(ids)
        state: TabletopState = self._state
        visible = ids[np.abs(state.position[ids, 1]) >= self.setup.task.strip / 2.0]
        self._seen[visible] = self.whole()[visible, OBJECT]

    def whole(self) -> Floats:
        """Return observations with the object as it is, shape (count, 22)."""
        return np.asarray(super().observe())

    def observe(self) -> Floats:
        """Return observations with the object as it was last seen, shape (count, 22)."""
        rows = self.whole()
        rows[:, OBJECT] = self._seen
        return rows


class HiddenPushEnv(TabletopEnv):
    """One environment."""

    def _new_episodes(self, options: TabletopOptions) -> HiddenEpisodes:
        made = super()._new_episodes(options)
        return HiddenEpisodes(options, made.setup, made.world)


class HiddenPushVectorEnv(TabletopVectorEnv):
    """A batch."""

    def _new_episodes(self, options: TabletopOptions, threads: int, device: str | None) -> HiddenEpisodes:
        made = super()._new_episodes(options, threads, device)
        return HiddenEpisodes(options, made.setup, made.world)


register(
    ID,
    entry_point=f"{__name__}:HiddenPushEnv",
    vector_entry_point=f"{__name__}:HiddenPushVectorEnv",
    max_episode_steps=LIMIT,
    kwargs={"task": f"{__name__}:HiddenPush", "limit": LIMIT},
)


class _Shown(AnsweredVecEnv):
    """A batch whose expert sees the object all the time."""

    def _shown(self) -> Any:
        batch: Any = self._env.unwrapped
        return batch.episodes.whole().astype(self._now.dtype)


register_algorithm(replace(ALGORITHMS["Imitation"], name="ShownImitation", vec_env=partial(answered, make=_Shown)))
imitated_hidden_push = register_recipe(
    replace(
        get_recipe("imitated-push"),
        name="imitated-hidden-push",
        summary="As imitated-push, where a strip of the table is not seen; the script sees it.",
        environment=WORLD,
        algorithm="ShownImitation",
    )
)
