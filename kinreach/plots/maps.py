"""Errors, rewards and ways over the table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from matplotlib.ticker import FuncFormatter, NullFormatter
from numpy.typing import ArrayLike

from kinreach.checks import Floats, as_vector, check_count, check_number, shown
from kinreach.errors import InputError
from kinreach.plots.checks import MOST_DRAWN, as_drawn, as_limits, as_point, check_label, check_mapping
from kinreach.plots.pictures import MOST_RATIO
from kinreach.plots.style import (
    FAINT,
    INK,
    MAGNITUDE,
    MOST_COLUMNS,
    PALETTE,
    colours_of,
    key,
    name_label,
    new_figure,
    plain,
)
from kinreach.thesis.reward import IMPOSSIBLE_REWARD, NEAR_REWARD, REACHED_REWARD

#: Bounds of x and y [m].
Area = tuple[tuple[float, float], tuple[float, float]]

_IMPOSSIBLE, _NEAR, _REACHED = "#bdbdbd", PALETTE[4], PALETTE[1]
#: Steps of the reward that are told apart where the tip is not at the goal.
_FAR = np.linspace(0.0, 4.0, 17)


class RewardMap(NamedTuple):
    """Rewards of tip positions on a grid.

    Attributes:
        x, y: Of the grid [m], shapes (m,) and (n,).
        reward: Shape (m, n); not a number where nothing is to be drawn.
    """

    x: ArrayLike
    y: ArrayLike
    reward: ArrayLike


def draw_error_maps(
    maps: Mapping[str, tuple[ArrayLike, ArrayLike]],
    *,
    title: str,
    label: str = "error [mm]",
    limits: tuple[float, float] | None = None,
    missing: str = "not found",
    area: Area | None = None,
    columns: int = 2,
    note: str = "",
) -> Figure:
    """Errors of goals on the table, a panel for each method, camera or pipeline, on one logarithmic scale.

    Args:
        maps: By the panel's name: positions (x, y) in the world [m], shape (n, 2), and their errors, shape (n,); an
            error that is not a number is drawn as a cross.
        title: Of the figure.
        label: What is measured, with its unit.
        limits: Ends of the scale, to compare figures; by default the smallest and the largest error. What is beyond
            has the colour of the end, but is itself in what a panel says of its errors.
        missing: What a cross means.
        area: To be outlined, such as where goals are drawn from.
        columns: Panels beside each other.
        note: Small print.

    Raises:
        InputError: No panel, shapes that do not fit, no positive error at all, or limits or an area that do not
            increase.
    """
    check_mapping("maps", maps)
    check_label("label", label)
    check_label("missing", missing)
    columns, area = check_count("columns", columns, most=MOST_COLUMNS), _as_area(area)
    panels = {name: _error_map(name, *_parts(name, data, 2)) for name, data in maps.items()}
    measured = np.concatenate([np.empty(0), *(errors for _, errors in panels.values())])
    finite = measured[np.isfinite(measured) & (measured > 0)]
    if not finite.size:
        raise InputError("an error map needs at least one positive error")
    if limits is None:
        low, high = float(finite.min()), float(finite.max())
    else:
        low, high = as_limits("limits", limits, positive=True)
    norm = LogNorm(low, high if high > low else 1.01 * low)
    rows = -(-len(panels) // columns)
    figure, axes = new_figure(
        title, size=(4.5 * columns, 0.7 + 2.8 * rows), rows=rows, columns=columns, note=note, grid="none"
    )
    drawn: Any = None
    for ax, (name, (xy, errors)) in zip(axes, panels.items(), strict=False):
        seen = np.isfinite(errors)
        size = float(np.clip(9e3 / len(errors), 6, 60))
        crosses = float(np.clip(6e3 / len(errors), 3, 30))
        drawn = ax.scatter(
            xy[seen, 1],
            xy[seen, 0],
            s=size,
            c=np.clip(errors[seen], low, None),
            cmap=MAGNITUDE,
            norm=norm,
            marker="s",
            linewidths=0,
        )
        ax.scatter(xy[~seen, 1], xy[~seen, 0], s=crosses, color=PALETTE[1], marker="x")
        if area is not None:
            _outline(ax, area, colour=INK, halo=True)
        _seen_by_the_robot(ax, xy[:, 0], xy[:, 1], margin=0.02)
        some = errors[seen]
        missed = f" · {(~seen).sum()} {missing} (×)" if (~seen).any() else ""
        said = [plain(float(f"{value:.2g}")) for value in (np.median(some), some.max())] if some.size else []
        numbers = "median {}, max {}".format(*said) if said else "none"
        ax.set_title(name_label(name), loc="left", fontsize=10, weight="bold", color=INK, pad=18)
        ax.annotate(numbers + missed, (0, 1.025), xycoords="axes fraction", fontsize=8.5, color=FAINT)
    for ax in axes[len(panels) :]:
        ax.set_axis_off()
    bar = figure.colorbar(drawn, ax=axes, label=label, shrink=0.8, aspect=30)
    bar.outline.set_visible(False)
    bar.ax.yaxis.set_major_formatter(FuncFormatter(plain))
    bar.ax.yaxis.set_minor_formatter(FuncFormatter(plain) if high / low < 20 else NullFormatter())
    bar.ax.tick_params(which="both", labelsize=9)
    return figure


def draw_reward_maps(
    maps: Mapping[str, RewardMap], *, goal: tuple[float, float], area: Area | None = None, title: str, note: str = ""
) -> Figure:
    """The thesis's reward of tip positions over the table, for a goal that stays where it is.

    Args:
        maps: By the panel's name.
        goal: Where the ball lies, (x, y) in the world [m].
        area: Where goals are drawn from; outlined in panels that hold all of it.
        title: Of the figure.
        note: Small print.

    Raises:
        InputError: No panel, shapes that do not fit, a goal that is no point, or an area that does not increase.
    """
    check_mapping("maps", maps)
    check_label("note", note)
    goal, area = as_point("goal", goal), _as_area(area)
    if not maps:
        raise InputError("a figure of reward maps needs at least one panel")
    panels = {name: _reward_map(name, *_parts(name, grid, 3)) for name, grid in maps.items()}
    widths = [(y[-1] - y[0]) / (x[-1] - x[0]) for x, y, _ in panels.values()]
    height = 3.2
    text = "seen from above, the robot below · grey: impossible, −100 · " + (note or "+: the ball")
    figure, axes = new_figure(
        title, size=(0.8 + (height - 1.2) * sum(widths) + 0.75 * len(maps), height), columns=len(maps), widths=widths,
        note=text, grid="none",
    )  # fmt: skip
    cmap = ListedColormap([*colormaps[MAGNITUDE](np.linspace(0, 1, len(_FAR) - 1)), _NEAR, _REACHED])
    norm = BoundaryNorm([*_FAR, NEAR_REWARD + 0.5, REACHED_REWARD + 0.5], cmap.N)
    drawn: Any = None
    for ax, (name, (x, y, r)) in zip(axes, panels.items(), strict=True):
        ax.pcolormesh(y, x, np.where(r == IMPOSSIBLE_REWARD, 0.0, np.nan), cmap=ListedColormap([_IMPOSSIBLE]))
        possible = np.where(r == IMPOSSIBLE_REWARD, np.nan, np.maximum(r, 0.0))
        drawn = ax.pcolormesh(y, x, possible, cmap=cmap, norm=norm)
        _seen_by_the_robot(ax, x, y)
        ax.locator_params(nbins=5)
        if area is not None and x[0] <= area[0][0] and area[0][1] <= x[-1]:
            _outline(ax, area, colour="white")
        ax.plot(goal[1], goal[0], marker="+", ms=9, mew=1.4, color=INK)
        ax.set_title(name_label(name), loc="left", fontsize=9.5, weight="bold", color=INK)
    bar = figure.colorbar(drawn, ax=axes, label="reward r", aspect=18)
    bar.outline.set_visible(False)
    middles = (norm.boundaries[-3:-1] + norm.boundaries[-2:]) / 2
    bar.set_ticks([0, 1, 2, 3, *middles], labels=["≤ 0", "1", "2", "3", "$10 - r_e$", f"{REACHED_REWARD:g}: reached"])
    bar.ax.tick_params(length=0, labelsize=8.5)
    bar.ax.minorticks_off()
    return figure


def _outline(axes: Axes, area: Area, *, colour: str, halo: bool = False) -> None:
    (x0, x1), (y0, y1) = area
    for ec, lw, ls in ((("white", 3.6, "-"),) if halo else ()) + ((colour, 1.2, "--"),):
        axes.add_patch(Rectangle((y0, x0), y1 - y0, x1 - x0, fill=False, ec=ec, lw=lw, ls=ls))


def _seen_by_the_robot(axes: Axes, x: Floats, y: Floats, *, margin: float = 0.0) -> None:
    """World x up and y to the left, as the robot at the lower edge sees the table; equal scales."""
    axes.set(
        xlim=(y.max() + margin, y.min() - margin), ylim=(x.min() - margin, x.max() + margin), aspect="equal",
        xlabel="y [m]", ylabel="x [m]",
    )  # fmt: skip
    axes.spines["bottom"].set_visible(False)


def _as_area(area: Area | None) -> Area | None:
    if area is None:
        return None
    x, y = _parts("area", area, 2)
    return as_limits("x of the area", x), as_limits("y of the area", y)


def _parts(name: str, value: object, count: int) -> Sequence[ArrayLike]:
    if not isinstance(value, Sequence) or len(value) != count:
        raise InputError(f"{name!r} must have {count} parts, got {shown(value)}")
    return value


def _error_map(name: str, positions: ArrayLike, errors: ArrayLike) -> tuple[Floats, Floats]:
    xy, values = as_drawn("positions", positions), as_drawn("errors", errors)
    if xy.ndim != 2 or xy.shape[1] != 2 or values.shape != xy.shape[:1] or not values.size:
        raise InputError(f"map {name!r} needs positions (n, 2) and errors (n,), got {xy.shape} and {values.shape}")
    return xy, values


def _reward_map(name: str, x: ArrayLike, y: ArrayLike, reward: ArrayLike) -> tuple[Floats, Floats, Floats]:
    x, y, r = as_drawn("x", x), as_drawn("y", y), as_drawn("reward", reward)
    if min(x.size, y.size) < 2 or r.shape != (*x.shape, *y.shape):
        raise InputError(f"the reward of {name!r} must have shape {(*x.shape, *y.shape)} on a grid, got {r.shape}")
    if x.ndim != 1 or y.ndim != 1 or not (np.diff(x) > 0).all() or not (np.diff(y) > 0).all():
        raise InputError(f"x and y of the grid of {name!r} must increase")
    if not 1 / MOST_RATIO <= (y[-1] - y[0]) / (x[-1] - x[0]) <= MOST_RATIO:
        raise InputError(f"a side of the grid of {name!r} must be at most {MOST_RATIO} times as long as the other")
    return x, y, r


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
