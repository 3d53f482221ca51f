"""Ways of an end effector through space, from above and from the side."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import ArrayLike

from kinreach.errors import InputError
from kinreach.inputs import check_number
from kinreach.kinematics.goals import as_vector
from kinreach.plots.checks import MOST_DRAWN, as_drawn, check_mapping
from kinreach.plots.style import INK, colours_of, key, name_label, new_figure

Array = np.ndarray[Any, Any]


def draw_paths(
    paths: Mapping[str, ArrayLike], target: ArrayLike, *, radius: float, title: str, note: str = ""
) -> Figure:
    """Where an end effector went in episodes with the same target.

    On the left from above; on the right the distance from the base's axis against the height, so that the turn of the
    base does not show.

    Args:
        paths: Positions in the world [m] by the episode's name, each of shape (n, 3).
        target: In the world [m], shape (3,).
        radius: Within which the target counts as reached [m].
        title: Of the figure.
        note: Small print.

    Raises:
        InputError: No path, positions that are not finite or not of these shapes, or a radius that is not positive.
    """
    check_mapping("paths", paths)
    goal = as_vector("target", target, 3, most=MOST_DRAWN)
    radius = check_number("radius", radius, above=0.0, most=MOST_DRAWN)
    ways = {name: as_drawn(f"path of {name}", path) for name, path in paths.items()}
    if not ways:
        raise InputError("a figure of paths needs at least one path")
    for name, way in ways.items():
        if way.ndim != 2 or way.shape[1:] != (3,) or not len(way) or not np.isfinite(way).all():
            raise InputError(f"the path {name!r} must be of finite numbers and shape (n, 3), got {way.shape}")
    figure, axes = new_figure(title, size=(9.0, 4.6), columns=2, note=note)
    colours = colours_of(ways)
    labels = (("x [m]", "y [m]"), ("distance from the base's axis [m]", "z [m]"))
    for ax, view, (xlabel, ylabel) in zip(axes, (_from_above, _from_the_side), labels, strict=True):
        for name, way in ways.items():
            line = view(way)
            ax.plot(*line.T, color=colours[name], lw=1.5, marker="o", ms=2.0, label=name_label(name))
            ax.plot(*line[-1], color=colours[name], marker="s", ms=6)
        ax.add_patch(Circle(tuple(view(goal)), radius, fill=False, ec=INK, lw=1.4, zorder=3))
        ax.set(xlabel=xlabel, ylabel=ylabel)
        ax.set_aspect("equal", adjustable="datalim")
    key(axes[0], f"circle: within {1e3 * radius:g} mm of the target · square: the last step")
    axes[1].legend(frameon=False, fontsize=9)
    return figure


def _from_above(positions: Array) -> Array:
    return positions[..., :2]


def _from_the_side(positions: Array) -> Array:
    """Distance from the z axis and height, shape (..., 2)."""
    return np.stack([np.hypot(positions[..., 0], positions[..., 1]), positions[..., 2]], axis=-1)
