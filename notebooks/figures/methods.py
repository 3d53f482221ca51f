"""Success and errors against tolerance; the reward around a posture; posture errors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, NullFormatter, PercentFormatter
from numpy.typing import ArrayLike, NDArray

from kinreach.plots import FAINT, INK, colours_of, key, label_ends, new_figure
from kinreach.thesis import REACHED_POSTURE_ERROR

from .maps import IMPOSSIBLE_REWARD

Floats = NDArray[np.float64]


class Success(NamedTuple):
    """Share of goals within each tolerance, of one method.

    Attributes:
        share: 0 to 1, shape (k,).
        interval: Confidence interval of the share, shape (k, 2), or None.
    """

    share: ArrayLike
    interval: ArrayLike | None = None


def draw_success(
    tolerances: ArrayLike,
    methods: Mapping[str, Success],
    *,
    title: str = "Share of goals reached within a tolerance",
    xlabel: str = "tolerance [mm]",
    note: str = "",
) -> Figure:
    """Draw the share of goals against tolerance on a log axis, a line with confidence intervals for each method.

    Args:
        tolerances: Positive, shape (k,), in any order.
        methods: By name.
        title: Of the figure.
        xlabel: Name and unit of the tolerance.
        note: Small print.
    """
    x = np.asarray(tolerances)
    order = np.argsort(x)
    x = x[order]
    colours = colours_of(methods)
    figure, (ax,) = new_figure(title, size=(7.6, 4.6), note=note, grid="y")
    shares = np.array([np.asarray(success.share)[order] for success in methods.values()])
    side, at_end = ("right", -1) if np.ptp(shares[:, -1]) > np.ptp(shares[:, 0]) else ("left", 0)  # where lines part
    ends = {}
    for rank, (name, success) in enumerate(methods.items()):
        share = 100 * np.asarray(success.share)[order]
        # Side by side, so that equal methods do not hide each other.
        at = x * 1.035 ** (rank - (len(methods) - 1) / 2)
        error = None
        if success.interval is not None:
            low, high = 100 * np.asarray(success.interval)[order].T
            error = np.maximum([share - low, high - share], 0.0)  # an interval may miss its end by a rounding error
        ax.errorbar(at, share, error, color=colours[name], lw=1.6, elinewidth=1, marker="o", ms=4)
        ends[name] = (at[at_end], share[at_end])
    ax.set(xscale="log", xlim=(x[0] / 1.16, x[-1] * 1.16), ylim=(-3, 103), xlabel=xlabel)
    ax.set_xticks(x, [f"{tick:g}" for tick in x])
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.tick_params(which="minor", length=0)
    if side == "left":
        ax.yaxis.tick_right()
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0f} %"))
    label_ends(ax, ends, colours, side=side)
    return figure


def draw_error_bands(
    tolerances: ArrayLike,
    errors: Mapping[str, ArrayLike],
    *,
    title: str,
    xlabel: str,
    ylabel: str = "distance to the goal [mm]",
    limit: float | None = None,
    note: str = "",
) -> Figure:
    """Draw errors of many goals against a tolerance, both on log axes: median, and the middle 90 %.

    Args:
        tolerances: Positive, shape (k,), in any order.
        errors: Method -> positive errors of n goals at each tolerance, shape (k, n).
        title: Of the figure.
        xlabel: Name and unit of the tolerance.
        ylabel: Name and unit of the error.
        limit: Allowed error; dashed.
        note: Small print.
    """
    x = np.asarray(tolerances)
    order = np.argsort(x)
    x = x[order]
    figure, (ax,) = new_figure(title, size=(7.6, 4.6), note=note)
    colours, ends = colours_of(errors), {}
    for name, values in errors.items():
        low, middle, high = np.percentile(np.asarray(values)[order], (5, 50, 95), axis=1)
        ax.fill_between(x, low, high, color=colours[name], alpha=0.2, lw=0)
        ax.plot(x, middle, color=colours[name], lw=1.8, marker="o", ms=4)
        ends[name] = (x[0], middle[0])
    ax.set(xscale="log", yscale="log", xlim=(x[0] / 1.09, x[-1] * 1.09), xlabel=xlabel, ylabel=ylabel)
    ax.set_xticks(x, [f"{tick:g}" for tick in x])
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.tick_params(which="minor", length=0)
    ax.yaxis.tick_right()
    ax.yaxis.set_label_position("right")
    ax.yaxis.set_major_formatter("{x:g}")
    legend = "line: median · band: 90 % of the goals"
    if limit is not None:
        ax.axhline(limit, color=INK, lw=1.2, ls="--", zorder=1)
        legend += f" · dashed: {limit:g}, which is allowed"
    key(ax, legend)
    label_ends(ax, ends, colours, side="left")
    return figure


def draw_local_optimum(
    offsets: ArrayLike,
    joints: Mapping[str, ArrayLike],
    heights: ArrayLike,
    explored: Mapping[str, ArrayLike],
    *,
    title: str,
    note: str = "",
) -> Figure:
    """Draw why a learner stays where it is although a better posture is near (thesis, figure 6.1).

    Left: the reward when one joint turns. Right: the mean reward of a learner that explores, at several heights above
    the goal. The more it explores, the higher is the best height.

    Args:
        offsets: Of the joint [rad], increasing, shape (n,).
        joints: Joint -> rewards, shape (n,); impossible ones are left out, and their border marked.
        heights: Above the goal [m], increasing, shape (m,).
        explored: Standard deviation of the exploration -> mean rewards, shape (m,).
        title: Of the figure.
        note: Small print.
    """
    figure, (left, right) = new_figure(title, size=(9.0, 3.9), columns=2, note=note)
    _draw_joints(left, np.degrees(offsets), {name: np.asarray(line) for name, line in joints.items()})
    _draw_explored(right, 1e3 * np.asarray(heights), {name: np.asarray(line) for name, line in explored.items()})
    return figure


def _draw_joints(ax: Axes, degrees: Floats, lines: Mapping[str, Floats]) -> None:
    colours, ends = colours_of(lines), {}
    for name, line in lines.items():
        possible = np.where(line == IMPOSSIBLE_REWARD, np.nan, line)
        ax.plot(degrees, possible, color=colours[name], lw=1.6)
        known = ~np.isnan(possible)
        borders = known & ~(np.append(known[1:], True) & np.append(True, known[:-1]))
        ax.plot(degrees[borders], possible[borders], "x", color=colours[name], ms=7, mew=2)
        if known.any():
            last = np.flatnonzero(known)[-1]
            ends[name] = (degrees[last], possible[last])
    ax.axvline(0, color=FAINT, lw=1, ls="--", zorder=0)
    ax.set(xlim=(degrees[0], degrees[-1]), xlabel="change of one joint [°]", ylabel="reward r")
    label_ends(ax, ends, colours)
    key(ax, "×: beyond it the posture is impossible, −100")


def _draw_explored(ax: Axes, millimetres: Floats, means: Mapping[str, Floats]) -> None:
    colours = colours_of(means)
    for name, line in means.items():
        best = int(line.argmax())
        ax.plot(millimetres, line, color=colours[name], lw=1.6)
        ax.plot(millimetres[best], line[best], "o", color=colours[name], ms=6, clip_on=False, zorder=4)
        words = ax.annotate(
            name, (millimetres[best], line[best]), xytext=(4, 6), textcoords="offset points", fontsize=9,
            weight="bold", color=colours[name],
        )  # fmt: skip
        words.set_path_effects([withStroke(linewidth=2.5, foreground="white")])
    top = max(float(line.max()) for line in means.values())
    span = abs(top) or 1.0
    ax.set(xlim=(millimetres[0], millimetres[-1]), ylim=(top - 1.3 * span, top + 0.12 * span))
    ax.set(xlabel="height above the goal [mm]", ylabel="mean reward")
    key(ax, "colour: exploration in every joint, σ · dot: the best height")


def draw_posture_errors(errors: Mapping[str, ArrayLike], *, title: str, widest: float = 0.4, note: str = "") -> Figure:
    """Draw histograms of the posture error, with the limit below which a goal counts as reached.

    Args:
        errors: Policy -> r_e [rad] of its steps, shape (n,).
        title: Of the figure.
        widest: End of the axis [rad]; larger errors are counted but not drawn.
        note: Small print.
    """
    figure, (ax,) = new_figure(title, size=(9.0, 3.8), note=note)
    edges = np.linspace(0, widest, 81)
    colours = colours_of(errors)
    for name, sample in errors.items():
        ax.hist(
            sample, list(edges), weights=np.full(np.shape(sample), 1 / np.size(sample)), histtype="stepfilled",
            color=colours[name], alpha=0.55, label=name,
        )  # fmt: skip
    ax.axvline(REACHED_POSTURE_ERROR, color=INK, lw=1.2, ls="--")
    ax.set(xlim=(0, widest), xlabel="posture error $r_e$ [rad]", ylabel="share of the steps")
    ax.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    ax.legend(frameon=False, fontsize=9, labelcolor=INK)
    key(ax, f"dashed: {REACHED_POSTURE_ERROR:g} rad, below which the goal counts as reached")
    return figure
