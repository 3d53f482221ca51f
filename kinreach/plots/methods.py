"""Success and errors against tolerance; the reward around a posture and what exploring there pays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import is_color_like
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter, PercentFormatter
from numpy.typing import ArrayLike

from kinreach.checks import Floats, check_number, shown
from kinreach.errors import InputError
from kinreach.plots.checks import MOST_DRAWN, as_drawn, check_label, check_mapping
from kinreach.plots.style import FAINT, INK, colours_of, key, label_ends, name_label, new_figure, plain
from kinreach.thesis.reward import IMPOSSIBLE_REWARD, REACHED_POSTURE_ERROR


class Success(NamedTuple):
    """Share of goals within each tolerance, of one method.

    Attributes:
        share: 0 to 1, shape (k,).
        interval: Bounds of its confidence interval, shape (k, 2); None if there is none.
    """

    share: ArrayLike
    interval: ArrayLike | None = None


def draw_success(
    tolerances: ArrayLike,
    methods: Mapping[str, Success],
    *,
    title: str = "Share of goals reached within a tolerance",
    xlabel: str = "tolerance [mm]",
    colours: Mapping[str, str] | None = None,
    note: str = "",
) -> Figure:
    """Share of goals against tolerance on a log axis, a line per method with its confidence intervals.

    Args:
        tolerances: Positive, shape (k,), in any order.
        methods: By name.
        title: Of the figure.
        xlabel: What the tolerance is of, with its unit.
        colours: Of the methods; by default those of `colours_of`.
        note: Small print.

    Raises:
        InputError: No method, shapes that do not fit, a tolerance that is not positive, or a method without a colour.
    """
    check_label("xlabel", xlabel)
    check_mapping("methods", methods)
    x = as_drawn("tolerances", tolerances)
    if not methods or x.ndim != 1 or not x.size or not (x > 0).all():
        raise InputError("success against tolerance needs a method and positive tolerances")
    order = np.argsort(x)
    x = x[order]
    colours = colours_of(methods) if colours is None else colours
    check_mapping("colours", colours)
    figure, (ax,) = new_figure(title, size=(7.6, 4.6), note=note, grid="y")
    ends = {}
    for rank, (name, success) in enumerate(methods.items()):
        if not isinstance(success, Success):
            raise InputError(f"the method {name!r} must be a Success, got {shown(success)}")
        if not is_color_like(colours.get(name)):
            raise InputError(f"colours must have one for {name!r}, got {shown(colours.get(name))}")
        share = 100 * as_drawn(f"share of {name}", success.share)
        if share.shape != x.shape:
            raise InputError(f"the share of {name!r} must have shape {x.shape}, got {share.shape}")
        share = share[order]
        # Side by side, so that equal methods do not hide each other.
        at = x * 1.035 ** (rank - (len(methods) - 1) / 2)
        error = None
        if success.interval is not None:
            bounds = 100 * as_drawn(f"interval of {name}", success.interval)
            if bounds.shape != (*x.shape, 2):
                raise InputError(f"the interval of {name!r} must have shape {(*x.shape, 2)}, got {bounds.shape}")
            low, high = bounds[order].T
            if not ((low <= share + 1e-9) & (share <= high + 1e-9)).all():
                raise InputError(f"the interval of {name!r} must be around its share")
            low, high = np.minimum(low, share), np.maximum(high, share)
            error = [share - low, high - share]
        ax.errorbar(at, share, error, color=colours[name], lw=1.6, elinewidth=1, marker="o", ms=4)
        ends[name] = (at[0], share[0])
    ax.set(xscale="log", xlim=(x[0] / 1.09, x[-1] * 1.16), ylim=(-3, 103), xlabel=xlabel)
    ax.set_xticks(x, [plain(tick) for tick in x])
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.tick_params(which="minor", length=0)
    ax.yaxis.tick_right()
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0f} %"))
    label_ends(ax, ends, colours, side="left")
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
    """Errors of many goals against what they depend on, both on log axes: median, and the middle 90 %.

    Args:
        tolerances: Positive, shape (k,), in any order.
        errors: By the method's name, positive, shape (k, n): those of n goals at each tolerance.
        title: Of the figure.
        xlabel: What the tolerance is of, with its unit.
        ylabel: What the error is, with its unit.
        limit: Error that is allowed; dashed.
        note: Small print.

    Raises:
        InputError: No method, shapes that do not fit, or a tolerance, an error or a limit that is not positive.
    """
    check_label("xlabel", xlabel)
    check_label("ylabel", ylabel)
    check_mapping("errors", errors)
    x = as_drawn("tolerances", tolerances)
    if not errors or x.ndim != 1 or not x.size or not (x > 0).all():
        raise InputError("errors against tolerance need a method and positive tolerances")
    if limit is not None:
        limit = check_number("limit", limit, above=0.0, most=MOST_DRAWN)
    order = np.argsort(x)
    x = x[order]
    figure, (ax,) = new_figure(title, size=(7.6, 4.6), note=note)
    colours, ends = colours_of(errors), {}
    for name, values in errors.items():
        sample = as_drawn(f"errors of {name}", values)
        if sample.ndim != 2 or len(sample) != len(x) or not sample.size or not (sample > 0).all():
            raise InputError(f"the errors of {name!r} must be positive, of shape ({len(x)}, n), got {sample.shape}")
        low, middle, high = np.percentile(sample[order], (5, 50, 95), axis=1)
        ax.fill_between(x, low, high, color=colours[name], alpha=0.2, lw=0)
        ax.plot(x, middle, color=colours[name], lw=1.8, marker="o", ms=4)
        ends[name] = (x[0], middle[0])
    ax.set(xscale="log", yscale="log", xlim=(x[0] / 1.09, x[-1] * 1.09), xlabel=xlabel, ylabel=ylabel)
    ax.set_xticks(x, [plain(tick) for tick in x])
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.tick_params(which="minor", length=0)
    ax.yaxis.tick_right()
    ax.yaxis.set_label_position("right")
    ax.yaxis.set_major_formatter(FuncFormatter(plain))
    said = "line: median · band: 90 % of the goals"
    if limit is not None:
        ax.axhline(limit, color=INK, lw=1.2, ls="--", zorder=1)
        said += f" · dashed: {limit:g}, which is allowed"
    key(ax, said)
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
    colours = colours_of(samples)
    for name, sample in samples.items():
        if sample.ndim != 1:
            raise InputError(f"the posture errors of {name!r} must have shape (n,), got {sample.shape}")
        ax.hist(
            sample, list(edges), weights=np.full(sample.shape, 1 / sample.size), color=colours[name], alpha=0.55,
            label=name_label(name), histtype="stepfilled",
        )  # fmt: skip
    ax.axvline(REACHED_POSTURE_ERROR, color=INK, lw=1.2, ls="--")
    ax.set(xlim=(0, widest), xlabel="posture error $r_e$ [rad]", ylabel="share of the steps")
    ax.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    ax.legend(frameon=False, fontsize=9, labelcolor=INK)
    key(ax, f"dashed: {REACHED_POSTURE_ERROR:g} rad, below which the goal counts as reached")
    return figure
