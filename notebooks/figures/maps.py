"""Rewards and paths over the table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from numpy.typing import ArrayLike, NDArray

from kinreach.plots import INK, PALETTE, colours_of, key, new_figure

Floats = NDArray[np.float64]

#: The thesis's rewards of a posture that is impossible, near the goal, and at it.
#: Bounds of x and y [m].
Area = tuple[tuple[float, float], tuple[float, float]]
IMPOSSIBLE_REWARD, NEAR_REWARD, REACHED_REWARD = -100.0, 10.0, 20.0
_IMPOSSIBLE, _NEAR, _REACHED = "#bdbdbd", PALETTE[4], PALETTE[1]
#: Colour steps of the reward where the tip is not at the goal.
_FAR = np.linspace(0.0, 4.0, 17)


class RewardMap(NamedTuple):
    """Rewards of tip positions on a grid.

    Attributes:
        x, y: Of the grid [m], increasing, shapes (m,) and (n,).
        reward: Shape (m, n); NaN where nothing is drawn.
    """

    x: ArrayLike
    y: ArrayLike
    reward: ArrayLike


def draw_reward_maps(
    maps: Mapping[str, RewardMap], *, goal: tuple[float, float], area: Area | None = None, title: str, note: str = ""
) -> Figure:
    """Draw the thesis's reward of tip positions over the table, for one goal.

    Args:
        maps: By the panel's name.
        goal: Position of the ball, (x, y) in the world [m].
        area: Where goals are drawn from; outlined in panels that contain it.
        title: Of the figure.
        note: Small print.
    """
    panels = {name: tuple(map(np.asarray, grid)) for name, grid in maps.items()}
    widths = [(y[-1] - y[0]) / (x[-1] - x[0]) for x, y, _ in panels.values()]
    height = 3.2
    text = "seen from above, the robot below · grey: impossible, −100 · " + (note or "+: the ball")
    figure, axes = new_figure(
        title, size=(0.8 + (height - 1.2) * sum(widths) + 0.75 * len(maps), height), columns=len(maps), widths=widths,
        note=text, grid="none",
    )  # fmt: skip
    cmap = ListedColormap([*colormaps["cividis"](np.linspace(0, 1, len(_FAR) - 1)), _NEAR, _REACHED])
    norm = BoundaryNorm([*_FAR, NEAR_REWARD + 0.5, REACHED_REWARD + 0.5], cmap.N)
    drawn: Any = None
    for ax, (name, (x, y, r)) in zip(axes, panels.items(), strict=True):
        ax.pcolormesh(y, x, np.where(r == IMPOSSIBLE_REWARD, 0.0, np.nan), cmap=ListedColormap([_IMPOSSIBLE]))
        possible = np.where(r == IMPOSSIBLE_REWARD, np.nan, np.maximum(r, 0.0))
        drawn = ax.pcolormesh(y, x, possible, cmap=cmap, norm=norm)
        ax.set(xlim=(y[-1], y[0]), ylim=(x[0], x[-1]), aspect="equal", xlabel="y [m]", ylabel="x [m]")
        ax.spines["bottom"].set_visible(False)
        ax.locator_params(nbins=5)
        if area is not None and x[0] <= area[0][0] and area[0][1] <= x[-1]:
            (x0, x1), (y0, y1) = area
            ax.add_patch(Rectangle((y0, x0), y1 - y0, x1 - x0, fill=False, ec="white", lw=1.2, ls="--"))
        ax.plot(goal[1], goal[0], marker="+", ms=9, mew=1.4, color=INK)
        ax.set_title(name, loc="left", fontsize=9.5, weight="bold", color=INK)
    bar = figure.colorbar(drawn, ax=axes, label="reward r", aspect=18)
    bar.outline.set_visible(False)
    middles = (norm.boundaries[-3:-1] + norm.boundaries[-2:]) / 2
    bar.set_ticks([0, 1, 2, 3, *middles], labels=["≤ 0", "1", "2", "3", "$10 - r_e$", f"{REACHED_REWARD:g}: reached"])
    bar.ax.tick_params(length=0, labelsize=8.5)
    bar.ax.minorticks_off()
    return figure


def draw_paths(
    paths: Mapping[str, ArrayLike], target: ArrayLike, *, radius: float, title: str, note: str = ""
) -> Figure:
    """Draw the paths of an end effector in episodes with the same target.

    Left: from above. Right: the height against the distance from the base's axis, in which the turn of the base does
    not show.

    Args:
        paths: Episode -> positions in the world [m], shape (n, 3).
        target: In the world [m], shape (3,).
        radius: Distance at which the target counts as reached [m].
        title: Of the figure.
        note: Small print.
    """
    figure, axes = new_figure(title, size=(9.0, 4.6), columns=2, note=note)
    colours = colours_of(paths)
    labels = (("x [m]", "y [m]"), ("distance from the base's axis [m]", "z [m]"))
    for ax, view, (xlabel, ylabel) in zip(axes, (_from_above, _from_the_side), labels, strict=True):
        for name, path in paths.items():
            line = view(np.asarray(path))
            ax.plot(*line.T, color=colours[name], lw=1.5, marker="o", ms=2.0, label=name)
            ax.plot(*line[-1], color=colours[name], marker="s", ms=6)
        ax.add_patch(Circle(tuple(view(np.asarray(target))), radius, fill=False, ec=INK, lw=1.4, zorder=3))
        ax.set(xlabel=xlabel, ylabel=ylabel)
        ax.set_aspect("equal", adjustable="datalim")
    key(axes[0], f"circle: within {1e3 * radius:g} mm of the target · square: the last step")
    axes[1].legend(frameon=False, fontsize=9)
    return figure


def _from_above(positions: Floats) -> Floats:
    return positions[..., :2]


def _from_the_side(positions: Floats) -> Floats:
    """Distance from the z axis and height, shape (..., 2)."""
    return np.stack([np.hypot(positions[..., 0], positions[..., 1]), positions[..., 2]], axis=-1)
