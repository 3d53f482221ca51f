"""What the reward looks like around a posture: local optima, and the border that a learner keeps to."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter
from numpy.typing import ArrayLike

from kinreach.errors import InputError
from kinreach.inputs import check_number
from kinreach.kinematics.goals import Floats
from kinreach.kinematics.reward_geometry import IMPOSSIBLE_REWARD, REACHED_POSTURE_ERROR
from kinreach.plots.checks import as_drawn, check_mapping
from kinreach.plots.style import FAINT, INK, PALETTE, colours_of, key, label_ends, name_label, new_figure


def draw_local_optimum(
    offsets: ArrayLike,
    joints: Mapping[str, ArrayLike],
    heights: ArrayLike,
    explored: Mapping[str, ArrayLike],
    *,
    title: str,
    note: str = "",
) -> Figure:
    """Why a learner stays where it is though a better posture is near (thesis, figure 6.1).

    Left the reward if one joint turns. Right the mean reward of a learner that tries something else every time, at
    several heights above the goal: the more it explores, the higher is the place that pays best.

    Args:
        offsets: Of the joint [rad], increasing, shape (n,).
        joints: Rewards by the joint's name, each of shape (n,); impossible ones are left out, and their border marked.
        heights: Above the goal [m], increasing, shape (m,).
        explored: Mean rewards by how far the learner explores, each of shape (m,).
        title: Of the figure.
        note: Small print.

    Raises:
        InputError: No joint, no exploration, shapes that do not fit, places that do not increase, or a number that is
            not finite.
    """
    check_mapping("joints", joints)
    check_mapping("explored", explored)
    x, lines = _lines("an offset", offsets, joints)
    height, means = _lines("a height", heights, explored)
    figure, (left, right) = new_figure(title, size=(9.0, 3.9), columns=2, note=note)
    _draw_joints(left, np.degrees(x), lines)
    _draw_explored(right, 1e3 * height, means)
    return figure


def _lines(what: str, at: ArrayLike, values: Mapping[str, ArrayLike]) -> tuple[Floats, dict[str, Floats]]:
    x = as_drawn("places", at)
    lines = {name: as_drawn(f"reward of {name}", line) for name, line in values.items()}
    if not lines or x.ndim != 1 or len(x) < 2 or any(line.shape != x.shape for line in lines.values()):
        raise InputError(f"a local optimum needs lines with a reward for {what} each, and two or more of them")
    if not all(np.isfinite(line).all() for line in (x, *lines.values())) or (np.diff(x) <= 0).any():
        raise InputError("a local optimum needs finite rewards at increasing places")
    return x, lines


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
        ax.annotate(
            name_label(name), (millimetres[best], line[best]), xytext=(4, 6), textcoords="offset points", fontsize=9,
            weight="bold", color=colours[name],
        )  # fmt: skip
    top = max(float(line.max()) for line in means.values())
    span = abs(top) or 1.0
    ax.set(xlim=(millimetres[0], millimetres[-1]), ylim=(top - 1.3 * span, top + 0.12 * span))
    ax.set(xlabel="height above the goal [mm]", ylabel="mean reward")
    key(ax, "colour: exploration in every joint, σ · dot: the best height")


def draw_posture_errors(errors: Mapping[str, ArrayLike], *, title: str, widest: float = 0.4, note: str = "") -> Figure:
    """How large the posture error is, as shares of steps, with the limit below which a goal counts as reached.

    Args:
        errors: r_e [rad] of steps by the policy's name, each of shape (n,).
        title: Of the figure.
        widest: End of the axis [rad]; what is larger is counted but not drawn.
        note: Small print.

    Raises:
        InputError: No policy, one without a step, or an end of the axis that is no angle.
    """
    check_mapping("errors", errors)
    widest = check_number("widest", widest, least=1e-6, most=100.0)
    samples = {name: as_drawn(name, values) for name, values in errors.items()}
    if not samples or not all(sample.size for sample in samples.values()):
        raise InputError("a figure of posture errors needs policies, and of each at least one step")
    figure, (ax,) = new_figure(title, size=(9.0, 3.8), note=note)
    edges = np.linspace(0, widest, 81)
    for colour, (name, sample) in zip(PALETTE, samples.items(), strict=False):
        if sample.ndim != 1:
            raise InputError(f"the posture errors of {name!r} must have shape (n,), got {sample.shape}")
        ax.hist(
            sample, list(edges), weights=np.full(sample.shape, 1 / sample.size), color=colour, alpha=0.55,
            label=name_label(name), histtype="stepfilled",
        )  # fmt: skip
    ax.axvline(REACHED_POSTURE_ERROR, color=INK, lw=1.2, ls="--")
    ax.set(xlim=(0, widest), xlabel="posture error $r_e$ [rad]", ylabel="share of the steps")
    ax.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    ax.legend(frameon=False, fontsize=9, labelcolor=INK)
    key(ax, f"dashed: {REACHED_POSTURE_ERROR:g} rad, below which the goal counts as reached")
    return figure
