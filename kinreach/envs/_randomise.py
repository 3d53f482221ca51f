"""What `randomise` draws anew at every reset: properties of the arm, and where its cameras seem to be."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from kinreach._checks import Floats
from kinreach.envs._options import about
from kinreach.errors import InputError
from kinreach.sim.inside import BOUNDS, DrawnArms, check_ranges, draw

Ranges = Mapping[str, Sequence[float]]
#: How far a camera can be off its place, along each of its axes [m].
CAMERA_BOUNDS = {"camera": (-0.1, 0.1)}
#: Prefix of the entries of `info`.
DRAWN = "drawn_"


def _about(names: Iterable[str]) -> dict[str, str | None]:
    listed = ", ".join(f"`{name}`" for name in names)
    text = f'ranges, drawn at every reset, of {listed}, such as `{{"payload": (0, 0.5)}}`; `info` has `drawn_NAME`'
    return about(text, flag=None)


#: Metadata of the option: of environments with cameras, without, and under torque.
RANDOMISE, RANDOMISE_ARM = _about((*BOUNDS, *CAMERA_BOUNDS)), _about(BOUNDS)
#: What is drawn of an arm under torque, which has no servos.
TORQUE = tuple(name for name in BOUNDS if name != "encoder_noise")
RANDOMISE_TORQUE = _about(TORQUE)


def check_randomise(
    given: Ranges | None, *, backend: str = "mujoco", names: Iterable[str] = (*BOUNDS, *CAMERA_BOUNDS)
) -> None:
    """Check the option of an environment."""
    bounds = {**BOUNDS, **CAMERA_BOUNDS}
    check_ranges(given, {name: bounds[name] for name in names})
    dynamic = drawn_of(given)
    if dynamic and backend != "mujoco":
        raise InputError(f'randomise[{dynamic[0]!r}] is of the dynamics: use backend="mujoco", got {backend!r}')


def drawn_of(given: Ranges | None) -> list[str]:
    """Return the names of what is drawn of the arm itself."""
    return [name for name in BOUNDS if name in (given or ())]


class Randomisation:
    """Draws for a number of environments, each from its own generator.

    Args:
        given: The option, as `check_randomise` checked it.
        count: Number of environments.
        arms: Writes what is drawn of them; None where nothing is.
        coordinates: Numbers of a camera's displacement.
    """

    def __init__(
        self,
        given: Ranges | None,
        count: int,
        arms: DrawnArms | None,
        *,
        coordinates: int = 0,
    ) -> None:
        ranges = given or {}
        self._ranges = {name: ranges[name] for name in (*BOUNDS, *CAMERA_BOUNDS) if name in ranges}
        self._arms = arms
        sizes = {"camera": coordinates} if arms is None else {**arms.sizes, "camera": coordinates}
        self._sizes = {name: sizes[name] for name in self._ranges}
        self._rngs = [np.random.default_rng() for _ in range(count)]
        self._values = {name: np.zeros((count, size)) for name, size in self._sizes.items()}

    def seed(self, index: int, rng: np.random.Generator) -> None:
        """Give an environment its own generator."""
        self._rngs[index] = rng

    def begin(self, ids: Any) -> None:
        """Draw for new episodes."""
        if not self._ranges:
            return
        rows = np.stack([draw(self._ranges, self._sizes, self._rngs[index]) for index in ids])
        parts = np.split(rows, np.cumsum(list(self._sizes.values()))[:-1], axis=1)
        drawn = dict(zip(self._sizes, parts, strict=True))
        for name, values in drawn.items():
            self._values[name][ids] = values
        if self._arms is not None:
            self._arms.write(ids, {name: values for name, values in drawn.items() if name in BOUNDS})

    def displaced(self, ids: Any, views: Floats) -> Floats:
        """Return what displaced cameras see [m], shape (k, coordinates); three zeros stay what they mean."""
        if "camera" not in self._ranges:
            return views
        seen = np.repeat(np.any(views.reshape(len(views), -1, 3), axis=2), 3, axis=1)
        return np.where(seen, views - self._values["camera"][ids], views)

    def info(self, rows: Any) -> dict[str, Any]:
        """Return what was drawn, by its name in `info`: a number, or one for each joint or coordinate."""
        found = {f"{DRAWN}{name}": np.array(values[rows]) for name, values in self._values.items()}
        return {name: values[:, 0] if values.shape[1] == 1 else values for name, values in found.items()}
