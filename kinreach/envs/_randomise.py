"""What `randomise` draws anew at every reset: properties of the arm, where its cameras seem to be, and others."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from kinreach._checks import Floats
from kinreach.envs._options import about
from kinreach.errors import InputError
from kinreach.sim.inside import BOUNDS, OF_JOINTS, DrawnArms, check_ranges, draw

Ranges = Mapping[str, Sequence[float]]
Bounds = Mapping[str, tuple[float, float]]
#: How far a camera can be off its place, along each of its axes [m].
CAMERA_BOUNDS = {"camera": (-0.1, 0.1)}
#: Prefix of the entries of `info`.
DRAWN = "drawn_"
#: What is drawn of an arm with cameras, and of one under torque, which has no servos.
WITH_CAMERAS: Bounds = {**BOUNDS, **CAMERA_BOUNDS}
TORQUE: Bounds = {name: ends for name, ends in BOUNDS.items() if name != "encoder_noise"}


def about_randomise(names: Iterable[str], example: str = '"payload": (0, 0.5)') -> dict[str, str | None]:
    """Metadata of the option."""
    listed = ", ".join(f"`{name}`" for name in names)
    text = f"ranges, drawn at every reset, of {listed}, such as `{{{example}}}`; `info` has `drawn_NAME`"
    return about(text, flag=None)


def check_randomise(given: Ranges | None, *, backend: str = "mujoco", bounds: Bounds = WITH_CAMERAS) -> None:
    """Check the option of an environment in which what has `bounds` can be drawn."""
    if isinstance(given, Mapping) and not {*OF_JOINTS} & {*bounds}:
        for name in given:
            if name in BOUNDS and name not in bounds:
                raise InputError(
                    f"randomise[{name!r}] is of the dynamics, and this environment, whose arm goes where it is told, "
                    f"has no masses or torques; available: {', '.join(sorted(bounds))}"
                )
    check_ranges(given, bounds)
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
        arms: Writes what is drawn of them; None where nothing is, or the environment writes what is `of_arms`.
        sizes: Numbers of each property that `arms` has not, by name; draws follow their order.
    """

    def __init__(
        self,
        given: Ranges | None,
        count: int,
        arms: DrawnArms | None,
        *,
        sizes: Mapping[str, int] | None = None,
    ) -> None:
        ranges, every = given or {}, {**({} if arms is None else arms.sizes), **(sizes or {})}
        self._sizes = {name: size for name, size in every.items() if name in ranges}
        self._ranges = {name: ranges[name] for name in self._sizes}
        self._arms = arms
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
        for name, values in zip(self._sizes, parts, strict=True):
            self._values[name][ids] = values
        if self._arms is not None:
            self._arms.write(ids, self.of_arms(ids))

    def of_arms(self, ids: Any) -> dict[str, Floats]:
        """Return what was drawn of the arms themselves, by name, each of shape (k, size)."""
        return {name: values[ids] for name, values in self._values.items() if name in BOUNDS}

    def values(self, name: str, ids: Any, default: float | None = None) -> Floats:
        """Return what was drawn of a property, shape (k, size), or of one environment (size,).

        A property that is not drawn has its default in all of `ids`, shape (k, 1).
        """
        if default is not None and name not in self._values:
            return np.full((len(ids), 1), default)
        return self._values[name][ids]

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
