"""A training's learning curves, as the thesis draws its own (figures 5.1 to 5.4)."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import ArrayLike

from kinreach._checks import Floats, as_floats, check_known
from kinreach._registration import MULTI, SINGLE
from kinreach.errors import InputError
from kinreach.plots._colours import PALETTE
from kinreach.plots._style import FAINT, HALO, INK, key, new_figure, verbatim
from kinreach.thesis.inside import IMPOSSIBLE_REWARD

#: Panels, from top to bottom.
PANELS = ("reward", "reached", "distance")
#: Columns of a learning curve that are drawn.
COLUMNS = ("steps", "episodes", "reward", "return", "reached", "distance", "impossible")
#: Episodes, or steps, that the thesis counts goals in, most bars of a panel, episodes of a point of a line, and actions
#: of a multi-step episode.
PER, MAX_BARS, SMOOTH, ACTIONS = 1000, 150, 30, 100
#: Of single-step in the thesis: its rewards are above 0 from here on, and close to 2 or higher (5.1).
SINGLE_MARKS = {"thesis: above 0": (20_000, 0.0), "thesis: about 2": (50_000, 2.0)}
#: What the thesis compares the reward of a multi-step episode with (5.2), and the steps in which it reaches most (5.4).
MULTI_REWARD, MULTI_MOST = 126.79, (30_000, 40_000)
#: Longest training in which these steps can be seen.
MAX_MARKED = 1_000_000
#: Lowest reward that is drawn of single-step if all seeds end above it: below are postures of the first episodes.
LOWEST = -6.0


class _Training(NamedTuple):
    """A seed, in bins of whole rows of its log; each of shape (n,), NaN where the log has no number.

    `start` and `end` are episodes or steps so far.
    """

    start: Floats
    end: Floats
    reward: Floats
    ended: Floats
    reached: Floats
    distance: Floats
    impossible: Floats


def draw_training(
    curves: Mapping[str, Mapping[str, ArrayLike]],
    *,
    environment: str = "",
    panels: Collection[str] = ("reward", "reached"),
    title: str = "",
    note: str = "",
) -> Figure:
    """Draw learning curves as the thesis does: rewards (figures 5.1 and 5.3), and goals reached (5.2 and 5.4).

    The horizontal axis counts episodes where each step is one, else steps. Bars are goals per 1000 of them, as the
    thesis counts. Each is a whole number of the log's rows, about 1000 wide. They are of the seed with the median of
    all goals. Twice the thesis's 150 000 or more have at most 150 bars, with the share of episodes that reached the
    goal. Rewards and distances are means over as many, and over at least 30 episodes.

    Args:
        curves: Name of a seed -> its learning curve: the columns that `kinreach.baselines.read_curve` returns.
        environment: Id of the environment. For the thesis's two tasks, rewards leave out what is impossible (-100 a
            step), and the thesis's own numbers are marked.
        panels: Of `"reward"`, `"reached"` and `"distance"`, that at the end of an episode [m].
        title: Of the figure.
        note: Small print.

    Raises:
        InputError: No curve, one without rows, or one that lacks a column.
        UnknownNameError: No such panel.
    """
    for panel in panels:
        check_known("panel", panel, PANELS)
    if not curves or not panels:
        raise InputError(f"draw_training needs a curve and a panel, got {len(curves)} and {len(panels)}")
    logs = {name: _columns(name, log) for name, log in curves.items()}
    single = all(np.array_equal(log["steps"], log["episodes"]) for log in logs.values())
    bars = {name: _binned(log, environment, single) for name, log in logs.items()}
    points = {name: _binned(log, environment, single, least=SMOOTH) for name, log in logs.items()}
    shown = [panel for panel in PANELS if panel in panels]
    figure, axes = new_figure(title, size=(9.0, 0.9 + 2.9 * len(shown)), rows=len(shown), note=note)
    marked = environment in (SINGLE, MULTI) and single == (environment == SINGLE)
    last = max(float(seed.end[-1]) for seed in bars.values())
    unit = "episodes" if single else "steps"
    for ax, panel in zip(axes, shown, strict=True):
        ax.set_xlim(0.0, last)
        ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: _count(value)))
        if panel == "reached":
            _bars(ax, bars, unit)
            if marked and not single and MULTI_MOST[1] <= last <= MAX_MARKED:
                ax.axvspan(*MULTI_MOST, color=PALETTE[4], alpha=0.25, lw=0, zorder=0)
                ax.annotate("most of the\nthesis's goals", (MULTI_MOST[1], 0.93), xycoords=("data", "axes fraction"),
                            xytext=(5, 0), textcoords="offset points", fontsize=8.5, color=INK, va="top")  # fmt: skip
            continue
        _lines(ax, points, panel)
        if panel == "distance":
            ax.set_ylabel("last distance [m]")
            ax.set_ylim(bottom=0.0)
        elif not marked:
            ax.set_ylabel("return of an episode")
        else:
            ax.set_ylabel("reward if possible" if single else f"reward of {ACTIONS} possible actions")
            _marks(ax, single, last)
    axes[-1].set_xlabel(unit[:-1] if single else "environment steps")
    return figure


def _columns(name: str, log: Mapping[str, ArrayLike]) -> dict[str, Floats]:
    """Check the columns of a curve, each of shape (n,)."""
    missing = [column for column in COLUMNS if column not in log]
    if missing:
        raise InputError(f"the curve {name!r} has no column {missing[0]!r}; it has: {', '.join(log) or 'none'}")
    found = {column: as_floats(f"{column} of the curve {name!r}", log[column]) for column in COLUMNS}
    steps = found["steps"]
    if not steps.size:
        raise InputError(f"the curve {name!r} has no row yet: the training was too short to be drawn")
    if steps.ndim != 1 or not np.all(np.diff(steps, prepend=0.0) > 0):
        raise InputError(f"steps of the curve {name!r} must be positive and increase")
    for column, values in found.items():
        if values.shape != steps.shape:
            raise InputError(f"{column} of the curve {name!r} must have shape {steps.shape}, got {values.shape}")
    return found


def _binned(log: Mapping[str, Floats], environment: str, single: bool, *, least: int = 0) -> _Training:
    """Sum rows of a log up to bins of about `PER`, and of at least so many episodes in the mean."""
    end, episodes = log["steps"], log["episodes"]
    steps, ended = np.diff(end, prepend=0.0), np.diff(episodes, prepend=0.0)
    row = float(np.median(steps))
    if np.count_nonzero(ended) > 1:  # arms side by side end their episodes together, some rows apart
        row *= round(float(np.median(np.diff(np.flatnonzero(ended)))))
    width = row * max(1, round(max(PER, end[-1] / MAX_BARS) / row))
    width *= max(1, round(least / max(1.0, episodes[-1] * width / end[-1])))
    group = np.floor((end - steps / 2) / width)
    first = np.flatnonzero(np.diff(group, prepend=-1.0))

    def mean(values: Floats, weights: Floats) -> Floats:
        weights = np.where(np.isnan(values), 0.0, weights)
        total = np.add.reduceat(weights, first)
        sums = np.add.reduceat(np.nan_to_num(values) * weights, first)
        return np.divide(sums, total, out=np.full(len(first), np.nan), where=total > 0)

    impossible = mean(log["impossible"], steps)
    reward = mean(log["return"], ended)
    if environment in (SINGLE, MULTI):
        share = np.nan_to_num(impossible)
        paid = mean(log["reward"], steps) - IMPOSSIBLE_REWARD * share
        reward = (1.0 if single else ACTIONS) * np.divide(
            paid, 1.0 - share, out=np.full(len(first), np.nan), where=share < 1
        )
    reached = log["reached"] * ended
    goals = np.add.reduceat(np.nan_to_num(reached), first)
    last = np.append(first[1:], len(end)) - 1
    return _Training(
        start=np.append(0.0, end[last[:-1]]),
        end=end[last],
        reward=reward,
        ended=np.add.reduceat(ended, first),
        reached=goals if np.isfinite(reached).any() else np.full(len(first), np.nan),
        distance=mean(log["distance"], ended),
        impossible=impossible,
    )


def _lines(axes: Axes, seeds: Mapping[str, _Training], column: str) -> None:
    """Draw each seed, and their median where there are more."""
    lines = [(seed.end, getattr(seed, column)) for seed in seeds.values()]
    for x, y in lines:
        axes.plot(x, y, color=PALETTE[0], lw=0.8 if len(lines) > 1 else 1.8, alpha=0.45 if len(lines) > 1 else 1.0)
    if len(lines) > 1:
        at = min((x for x, _ in lines), key=len)
        values = [np.interp(at, x[np.isfinite(y)], y[np.isfinite(y)]) for x, y in lines if np.isfinite(y).any()]
        if values:
            axes.plot(at, np.median(values, axis=0), color=PALETTE[1], lw=2.0)
    shares = [float(np.nanmean(seed.impossible[-len(seed.end) // 10 :])) for seed in seeds.values()
              if np.isfinite(seed.impossible[-len(seed.end) // 10 :]).any()]  # fmt: skip
    parts = ["line: one seed" if len(lines) == 1 else f"thin: each of {len(lines)} seeds · thick: their median"]
    if column == "reward" and max(shares, default=0.0) > 0:
        low, high = (f"{100 * bound:.1f}" for bound in (min(shares), max(shares)))
        parts.append(f"of the last tenth {low if low == high else f'{low} to {high}'} % were impossible")
    key(axes, " · ".join(parts))


def _marks(axes: Axes, single: bool, last: float) -> None:
    """Mark what the thesis says of its rewards, on an axis where it can be read."""
    low, high = axes.get_ylim()
    if not single:
        axes.set_ylim(min(0.0, max(low, -ACTIONS)), max(high, 1.12 * MULTI_REWARD))
        axes.axhline(MULTI_REWARD, color=INK, lw=1.2, ls="--", zorder=1)
        axes.annotate(f"thesis: {MULTI_REWARD}, discounted", (0.0, MULTI_REWARD), xytext=(6, 4), weight="bold",
                      textcoords="offset points", fontsize=8.5, color=INK, path_effects=HALO)  # fmt: skip
        return
    shown = {text: (x, y) for text, (x, y) in SINGLE_MARKS.items() if x <= last}
    drawn = [np.asarray(line.get_ydata(), dtype=float) for line in axes.lines]
    ends = np.concatenate([y[np.isfinite(y)][-1:] for y in drawn])
    lowest = max(low, LOWEST) if np.all(ends > LOWEST) else low
    axes.set_ylim(min([lowest, *(y - 0.5 for _, y in shown.values())]), max(high, 4.0))
    left, right = axes.get_xlim()
    for text, (x, y) in shown.items():
        place, align = ((9, -12), "left") if x < left + (right - left) / 6 else ((-9, 5), "right")
        axes.plot(x, y, marker="D", ms=7, mfc="white", mec=INK, mew=1.6, ls="", clip_on=False, zorder=5)
        axes.annotate(text, (x, y), xytext=place, textcoords="offset points", fontsize=8.5, ha=align,
                      color=INK, weight="bold", path_effects=HALO, zorder=5)  # fmt: skip


def _bars(axes: Axes, seeds: Mapping[str, _Training], unit: str) -> None:
    """Draw the goals of the seed with the median of all goals, and name how many the others reached."""
    known = {name: seed for name, seed in seeds.items() if np.isfinite(seed.reached).all()}
    totals = {name: round(float(seed.reached.sum())) for name, seed in known.items()}
    ordered = sorted(totals, key=totals.__getitem__)
    shown = known[ordered[(len(ordered) - 1) // 2]] if ordered else next(iter(seeds.values()))
    widths = shown.end - shown.start
    counted = widths[0] < 2 * PER
    # by the width of a whole bar: the last one, which may be narrower, is no rate of its own
    heights = shown.reached * PER / widths[0] if counted else 100.0 * shown.reached / np.maximum(shown.ended, 1.0)
    axes.set_ylabel(f"goals reached\nper {PER} {unit}" if counted else "episodes that\nreached the goal [%]")
    width = f" · a bar is {_grouped(widths[0])} {unit}" if counted and round(widths[0]) != PER else ""
    axes.yaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1, steps=[1, 2, 5, 10]))
    if ordered:
        axes.bar(shown.start, heights, widths, align="edge", color=PALETTE[0], lw=0)
        axes.set_ylim(0.0, max(4.0, 1.08 * heights.max()))
    if not any(totals.values()):
        longest = max(float(seed.end[-1]) for seed in seeds.values())
        over = f"{_seeds(len(seeds))} in {_grouped(longest)} {unit}{' each' if len(seeds) > 1 else ''}"
        text = f"no goal reached by {over}" if ordered else "this environment does not say what is reached"
        axes.set_ylim(0.0, 4.0)
        axes.annotate(text, (0.62, 0.5), xycoords="axes fraction", ha="center", fontsize=10, color=FAINT)
    elif len(ordered) == 1:
        key(axes, f"{_grouped(totals[ordered[0]])} goals in all{width}")
    else:
        name = ordered[(len(ordered) - 1) // 2]
        others: Sequence[str] = [_grouped(totals[each]) for each in ordered]
        key(axes, f"bars: {verbatim(name)}, the median of {', '.join(others)} goals{width}")


def _seeds(count: int) -> str:
    return "one seed" if count == 1 else f"{count} seeds"


def _grouped(value: float) -> str:
    """Write a whole number with thin spaces, 4 digits without."""
    return f"{value:,.0f}".replace(",", "\N{NARROW NO-BREAK SPACE}") if value >= 10_000 else f"{value:.0f}"


def _count(value: float) -> str:
    """Write a tick of an axis that counts: 20k, 1.5M."""
    for size, letter in ((1e6, "M"), (1e3, "k")):
        if abs(value) >= size:
            return f"{value / size:g}{letter}"
    return f"{value:g}"
