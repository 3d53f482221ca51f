"""Training: curves over seeds, the reward of every episode, the distance during one episode, discounted rewards."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, LogLocator
from numpy.typing import ArrayLike, NDArray

from kinreach.plots import FAINT, INK, PALETTE, colours_of, key, label_ends, new_figure
from kinreach.thesis import REACHED_DISTANCE

#: One seed: increasing positions on the horizontal axis, and the values there.
Run = tuple[ArrayLike, ArrayLike]
Floats = NDArray[np.float64]


class Band(NamedTuple):
    """Median and range over seeds, each of shape (n,)."""

    x: Floats
    median: Floats
    low: Floats
    high: Floats


def seed_band(runs: Sequence[Run]) -> Band:
    """Median, minimum and maximum over seeds, at those x of the first seed that all seeds have reached.

    The other seeds are interpolated linearly. NaN is left out.
    """
    curves = [(x[~np.isnan(y)], y[~np.isnan(y)]) for x, y in (np.array(run, dtype=float) for run in runs)]
    first = curves[0][0]
    at = first[(first >= max(x[0] for x, _ in curves)) & (first <= min(x[-1] for x, _ in curves))]
    values = np.array([np.interp(at, x, y) for x, y in curves])
    return Band(at, np.median(values, axis=0), values.min(axis=0), values.max(axis=0))


def moving_mean(values: ArrayLike, window: int) -> Floats:
    """Mean of each value and up to `window - 1` before it, shape (n,)."""
    sums = np.cumsum(np.concatenate([[0.0], np.asarray(values)]))
    ends = np.arange(1, len(sums))
    starts = np.maximum(ends - window, 0)
    return (sums[ends] - sums[starts]) / (ends - starts)


def draw_learning_curves(
    panels: Mapping[str, Mapping[str, Sequence[Run]]],
    *,
    title: str,
    xlabel: str,
    log: Collection[str] = (),
    limits: Mapping[str, tuple[float, float]] | None = None,
    marks: Mapping[str, Mapping[str, tuple[float, float]]] | None = None,
    note: str = "",
) -> Figure:
    """Draw the median over seeds, with a band from the lowest to the highest seed.

    Args:
        panels: Label of the vertical axis -> recipe -> the runs of all its seeds. A recipe has the same colour in all
            panels.
        title: Of the figure.
        xlabel: What x counts, such as `"environment steps"`.
        log: Panels with a logarithmic vertical axis.
        limits: Of a panel's vertical axis.
        marks: Panel -> text -> point (x, y): results that others have reported.
        note: Small print.
    """
    figure, axes = new_figure(title, size=(9.0, 1.0 + 2.7 * len(panels)), rows=len(panels), note=note)
    colours = colours_of(name for recipes in panels.values() for name in recipes)
    bands = {ylabel: {name: seed_band(runs) for name, runs in recipes.items()} for ylabel, recipes in panels.items()}
    everywhere = np.concatenate([band.x for recipes in bands.values() for band in recipes.values()])
    for ax, (ylabel, recipes) in zip(axes, bands.items(), strict=True):
        ends = {}
        for name, band in recipes.items():
            ax.fill_between(band.x, band.low, band.high, color=colours[name], alpha=0.2, lw=0)
            ax.plot(band.x, band.median, color=colours[name], lw=1.8)
            ends[name] = (band.x[-1], band.median[-1])
        ax.set(ylabel=ylabel, xlim=_hull(everywhere))
        if ylabel in log:
            _log_axis(ax)
        if limits and ylabel in limits:
            ax.set_ylim(limits[ylabel])
        _mark(ax, (marks or {}).get(ylabel, {}))
        _thousands(ax)
        label_ends(ax, {name: (x, np.clip(y, *ax.get_ylim())) for name, (x, y) in ends.items()}, colours)
    seeds = {len(runs) for recipes in panels.values() for runs in recipes.values()}
    if seeds == {1}:
        key(axes[0], "one seed")
    else:
        key(
            axes[0], f"line: median of {'/'.join(map(str, sorted(seeds)))} seeds · band: from the lowest to the highest"
        )
    axes[-1].set_xlabel(xlabel)
    return figure


def draw_episode_rewards(
    rewards: ArrayLike,
    *,
    title: str,
    at: ArrayLike | None = None,
    window: int = 1000,
    marks: Mapping[str, tuple[float, float]] | None = None,
    band: tuple[float, float] = (-6.0, 4.0),
    impossible: float = -100.0,
    xlabel: str = "episode",
    note: str = "",
) -> Figure:
    """Draw rewards of single episodes: those around their band enlarged, and below it all (thesis, figure 5.1).

    The line is the moving mean of the episodes that were possible.

    Args:
        rewards: Of successive episodes, shape (n,).
        title: Of the figure.
        at: Numbers of these episodes, increasing, shape (n,); 1 to n by default.
        window: Of the mean, in `rewards`.
        marks: Text -> point (x, y): results that others have reported.
        band: Limits of the enlarged axis.
        impossible: Reward of an episode whose posture was impossible; the mean leaves it out.
        xlabel: What `at` counts.
        note: Small print.
    """
    values = np.asarray(rewards, dtype=float)
    episodes = np.asarray(np.arange(1, len(values) + 1) if at is None else at)
    possible = values > impossible
    smooth = moving_mean(values[possible], window)
    figure, (near, whole) = new_figure(title, size=(9.0, 6.6), rows=2, note=note)
    size = float(np.clip(3e4 / len(values), 0.3, 8.0))
    for ax in (near, whole):
        ax.scatter(episodes, values, s=size, color=PALETTE[0], alpha=0.35, linewidths=0, rasterized=True)
        ax.plot(episodes[possible][window - 1 :], smooth[window - 1 :], color=PALETTE[1], lw=1.8)
        ax.set(ylabel="reward of the episode", xlim=(0, episodes.max()))
        _thousands(ax)
    near.set_ylim(band)
    _mark(near, marks or {})
    whole.set_xlabel(xlabel)
    every = 1 if at is None else round(float(np.diff(episodes).mean()))
    dots = "one episode" if every == 1 else f"one episode in {every}"
    key(near, f"dot: {dots} · line: mean of the last {every * window} that were possible")
    share = f"{100 * (1 - possible.mean()):.1f} % were impossible, which pays −{-impossible:g}"
    key(whole, f"dots: all of them, {share} · line: as above")
    return figure


def draw_distances(
    episodes: Mapping[str, ArrayLike],
    *,
    title: str,
    near: float = REACHED_DISTANCE,
    marks: Mapping[str, tuple[float, float]] | None = None,
    log: bool = True,
    xlabel: str = "step of the episode",
    note: str = "",
) -> Figure:
    """Draw the distance from the tip to the goal during episodes (thesis, figure 5.5).

    Args:
        episodes: Name -> distance [m] before the first and after every step, shape (n,).
        title: Of the figure.
        near: Distance at which a goal counts as reached [m].
        marks: Text -> step and distance [m]: results that others have reported.
        log: Logarithmic vertical axis; a linear one begins at 0.
        xlabel: What is counted.
        note: Small print.
    """
    figure, (ax,) = new_figure(title, size=(9.0, 3.8), note=note)
    colours = colours_of(episodes)
    ends = {}
    for name, distances in episodes.items():
        mm = 1e3 * np.asarray(distances)
        ax.plot(mm, color=colours[name], lw=1.8, marker="o", ms=2.5)
        ends[name] = (len(mm) - 1, mm[-1])
    ax.set(xlabel=xlabel, ylabel="distance to the goal [mm]", xlim=_hull([0, *(x for x, _ in ends.values())]))
    if log:
        _log_axis(ax)
    else:
        ax.set_ylim(bottom=0.0)
    _mark(ax, {text: (step, 1e3 * d) for text, (step, d) in (marks or {}).items()})
    limit = 1e3 * near
    if ax.get_ylim()[0] < limit:
        ax.axhline(limit, color=INK, lw=1.2, ls="--", zorder=1)
        key(ax, f"dashed: {limit:g} mm, near enough to reach the goal")
    label_ends(ax, ends, colours)
    return figure


def draw_discounted_rewards(
    steps: ArrayLike, returns: ArrayLike, *, gamma: float, n_steps: int, title: str, note: str = ""
) -> Figure:
    """Draw the discounted return of each step, with the updates of the policy marked (thesis, figure 5.6).

    The steps are the medians between two updates. The axis ends where whiskers of a box plot do, 1.5 interquartile
    ranges beyond the middle half: an impossible action makes the steps before it worth hundreds less.

    Args:
        steps: Of training, equally far apart, shape (n,).
        returns: `discounted_returns` of these steps, shape (n,).
        gamma: Discount factor, for the label.
        n_steps: Steps between two updates.
        title: Of the figure.
        note: Small print.
    """
    x, y = np.asarray(steps, dtype=float), np.asarray(returns, dtype=float)
    every = (x[-1] - x[0]) / (len(x) - 1)
    rollout = ((x - 1) // n_steps).astype(int)
    medians = np.array([np.median(y[rollout == k]) for k in range(rollout[-1] + 1)])
    quarter, three = np.percentile(y, (25.0, 75.0))
    low, high = quarter - 1.5 * (three - quarter), three + 1.5 * (three - quarter)
    figure, (ax,) = new_figure(title, size=(9.0, 4.4), note=note, grid="y")
    for update in np.arange(n_steps, x[-1] + 1, n_steps):
        ax.axvline(update, color=FAINT, lw=0.6, alpha=0.5, zorder=0)
    ax.scatter(x, y, s=3.0, color=PALETTE[0], alpha=0.3, linewidths=0, rasterized=True)
    edges = np.append(n_steps * np.arange(len(medians)), x[-1])
    ax.stairs(medians, edges, color=PALETTE[1], lw=2.4, baseline=None, zorder=3)
    ax.set(xlabel="environment steps", ylabel=f"discounted reward, $\\gamma$ = {gamma:g}", xlim=(0, x[-1]))
    ax.set_ylim(max(low, y.min()), min(high, y.max()) + 1e-9)
    _thousands(ax)
    parts = f"dot: one step of {every:.0f} · line: median between two updates · grey: update of the policy"
    below = 100 * float((y < ax.get_ylim()[0]).mean())
    if below:
        parts += f"\n{below:.1f} % are below the axis, down to {y.min():.0f}: an impossible action follows"
    key(ax, parts.replace("-", "−"))
    return figure


def _mark(axes: Axes, points: Mapping[str, tuple[float, float]]) -> None:
    """Draw results that others have reported: diamonds, with words at their left, or right where the border is near."""
    left, right = axes.get_xlim()
    for text, (x, y) in points.items():
        beside = 1 if x < left + (right - left) / 6 else -1
        axes.plot(x, y, marker="D", ms=7, mfc="white", mec=INK, mew=1.6, ls="", clip_on=False, zorder=5)
        words = axes.annotate(text, (x, y), xytext=(9, -12) if beside > 0 else (-9, 5), textcoords="offset points",
                              ha="left" if beside > 0 else "right", fontsize=8.5, color=INK, weight="bold",
                              zorder=5)  # fmt: skip
        words.set_path_effects([withStroke(linewidth=2.5, foreground="white")])


def _hull(x: ArrayLike) -> tuple[float, float]:
    """Limits without margins, so that names can stand right behind the ends of lines."""
    return float(np.min(x)), float(np.max(x))


def _log_axis(axes: Axes) -> None:
    """Make the vertical axis logarithmic with plain numbers, and label 2 and 5 where it spans less than two decades."""
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0) if high < 100 * low else ()))
    axes.yaxis.set_minor_formatter("{x:g}")
    axes.tick_params(axis="y", which="minor", length=0, labelsize=9, labelcolor=INK)


def _thousands(axes: Axes) -> None:
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: _count(value)))
    axes.tick_params(axis="x", colors=INK)


def _count(value: float) -> str:
    for unit, letter in ((1e6, "M"), (1e3, "k")):
        if abs(value) >= unit:
            return f"{value / unit:g}{letter}"
    return f"{value:g}"
