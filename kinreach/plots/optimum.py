"""What the reward looks like around a posture: local optima, and the border that a learner keeps to."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter
from numpy.typing import ArrayLike

from kinreach.errors import InputError
from kinreach.kinematics.goals import Floats, as_floats
from kinreach.kinematics.reward_geometry import IMPOSSIBLE_REWARD, REACHED_POSTURE_ERROR, REACHED_REWARD
from kinreach.plots.style import FAINT, INK, PALETTE, colours_of, key, label_ends, new_figure

_IMPOSSIBLE = "#d9d9d9"


def draw_local_optimum(
    offsets: ArrayLike,
    joints: Mapping[str, ArrayLike],
    way: ArrayLike,
    *,
    title: str,
    note: str = "",
) -> Figure:
    """A posture that small steps do not leave, though a better one exists (thesis, figure 6.1).

    Left the reward if one joint turns, right on the straight way through joint space to a posture that reaches the
    goal.

    Args:
        offsets: Of the joint [rad], increasing, shape (n,).
        joints: Rewards by the joint's name, each of shape (n,); impossible ones are left out, and their border marked.
        way: Rewards at even parts of the way, shape (m,); impossible stretches are grey.
        title: Of the figure.
        note: Small print.

    Raises:
        InputError: No joint, or shapes that do not fit.
    """
    x, along = as_floats("offsets", offsets), as_floats("way", way)
    lines = {name: as_floats(f"reward of {name}", values) for name, values in joints.items()}
    if not lines or x.ndim != 1 or along.ndim != 1 or any(line.shape != x.shape for line in lines.values()):
        raise InputError("a local optimum needs rewards of joints, one for each offset, and of the way")
    figure, (left, right) = new_figure(title, size=(9.0, 3.9), columns=2, note=note)
    colours, ends = colours_of(lines), {}
    degrees = np.degrees(x)
    for name, line in lines.items():
        possible = np.where(line == IMPOSSIBLE_REWARD, np.nan, line)
        left.plot(degrees, possible, color=colours[name], lw=1.6)
        borders = np.flatnonzero(np.diff(np.isnan(possible).astype(int)) == 1)
        left.plot(degrees[borders], possible[borders], "x", color=colours[name], ms=7, mew=2)
        last = np.flatnonzero(~np.isnan(possible))[-1]
        ends[name] = (degrees[last], possible[last])
    left.axvline(0, color=FAINT, lw=1, ls="--", zorder=0)
    left.set(xlim=(degrees[0], degrees[-1]), xlabel="change of one joint [°]", ylabel="reward r")
    label_ends(left, ends, colours)
    key(left, "×: beyond it the posture is impossible")
    _draw_way(right, along)
    return figure


def _draw_way(ax: Axes, along: Floats) -> None:
    at = np.linspace(0, 1, len(along))
    impossible = along == IMPOSSIBLE_REWARD
    ax.plot(at, np.where(impossible, np.nan, along), color=PALETTE[0], lw=1.8)
    ax.set(xlim=(0, 1), ylim=(-1.5, REACHED_REWARD + 1), xlabel="part of the way to the goal")
    ax.fill_between(at, *ax.get_ylim(), where=impossible.tolist(), color=_IMPOSSIBLE, lw=0, zorder=0)
    ax.plot(0, along[0], "o", color=PALETTE[1], ms=7, clip_on=False, zorder=4)
    key(ax, "dot: the posture · grey: impossible, −100")


def draw_posture_errors(errors: Mapping[str, ArrayLike], *, title: str, widest: float = 0.4, note: str = "") -> Figure:
    """How large the posture error is, as shares of steps, with the limit below which a goal counts as reached.

    Args:
        errors: r_e [rad] of steps by the policy's name, each of shape (n,).
        title: Of the figure.
        widest: End of the axis [rad]; what is larger is counted but not drawn.
        note: Small print.

    Raises:
        InputError: No policy, or one without a step.
    """
    if not errors or any(not np.size(values) for values in errors.values()):
        raise InputError("a figure of posture errors needs policies, and of each at least one step")
    figure, (ax,) = new_figure(title, size=(9.0, 3.8), note=note)
    edges = np.linspace(0, widest, 81)
    for colour, (name, values) in zip(PALETTE, errors.items(), strict=False):
        sample = as_floats(name, values)
        ax.hist(
            sample, list(edges), weights=np.full(sample.shape, 1 / sample.size), color=colour, alpha=0.55, label=name,
            histtype="stepfilled",
        )  # fmt: skip
    ax.axvline(REACHED_POSTURE_ERROR, color=INK, lw=1.2, ls="--")
    ax.set(xlim=(0, widest), xlabel="posture error $r_e$ [rad]", ylabel="share of the steps")
    ax.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    ax.legend(frameon=False, fontsize=9, labelcolor=INK)
    key(ax, f"dashed: {REACHED_POSTURE_ERROR:g} rad, below which the goal counts as reached")
    return figure
