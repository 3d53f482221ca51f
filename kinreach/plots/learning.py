"""How training went: curves over seeds, every episode's reward, one episode's distance, discounted rewards."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator
from numpy.typing import ArrayLike

from kinreach.checks import check_count, check_number
from kinreach.errors import InputError
from kinreach.plots.checks import MOST_DRAWN, as_drawn, as_limits, as_point, check_label, check_mapping, check_names
from kinreach.plots.series import Run, moving_mean, seed_band
from kinreach.plots.style import FAINT, INK, PALETTE, colours_of, key, label_ends, new_figure, plain
from kinreach.thesis.reward import REACHED_DISTANCE

#: Most lines that mark an update.
MOST_UPDATES = 10_000


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
    """Median over seeds of what training logged, with a band from the lowest to the highest seed.

    Args:
        panels: By what is on the vertical axis, unit included; in each the runs of all seeds of every recipe by the
            recipe's name. A recipe keeps its colour in all panels.
        title: Of the figure.
        xlabel: What x counts, such as `"environment steps"`.
        log: Panels with a logarithmic vertical axis.
        limits: Of a panel's vertical axis.
        marks: In a panel, points (x, y) by what to write beside them: what others have reported.
        note: Small print.

    Raises:
        InputError: No panel, runs that `seed_band` refuses, limits that do not increase, or a mark that is no point.
    """
    check_label("xlabel", xlabel)
    check_mapping("panels", panels)
    for ylabel, runs_of in panels.items():
        check_label("a panel", ylabel)
        check_mapping(f"panel {ylabel!r}", runs_of)
    check_names("log", log)
    limits, marks = {} if limits is None else limits, {} if marks is None else marks
    check_mapping("limits", limits)
    check_mapping("marks", marks)
    if not panels:
        raise InputError("a figure of learning curves needs at least one panel")
    figure, axes = new_figure(title, size=(9.0, 1.0 + 2.7 * len(panels)), rows=len(panels), note=note)
    colours = colours_of(dict.fromkeys(name for recipes in panels.values() for name in recipes))
    bands = {ylabel: {name: seed_band(runs) for name, runs in recipes.items()} for ylabel, recipes in panels.items()}
    everywhere = np.concatenate([band.x for recipes in bands.values() for band in recipes.values()] or [np.zeros(1)])
    for ax, (ylabel, recipes) in zip(axes, bands.items(), strict=True):
        ends = {}
        for name, band in recipes.items():
            ax.fill_between(band.x, band.low, band.high, color=colours[name], alpha=0.2, lw=0)
            ax.plot(band.x, band.median, color=colours[name], lw=1.8)
            ends[name] = (band.x[-1], band.median[-1])
        ax.set(ylabel=ylabel, xlim=_hull(everywhere))
        if ylabel in log:
            _log_axis(ax)
        if ylabel in limits:
            ax.set_ylim(as_limits(f"limits of {ylabel!r}", limits[ylabel], positive=ylabel in log))
        noted = marks.get(ylabel, {})
        check_mapping(f"marks of {ylabel!r}", noted)
        for text, place in noted.items():
            check_label("a mark", text)
            point = as_point(f"mark {text!r}", place)
            ax.plot(*point, marker="D", ms=6, mfc="white", mec=INK, mew=1.4, ls="", clip_on=False, zorder=4)
            ax.annotate(text, point, xytext=(8, 5), textcoords="offset points", fontsize=8.5, color=INK)
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
    xlabel: str = "episode",
    note: str = "",
) -> Figure:
    """Rewards of single episodes, and their moving mean (thesis, figures 5.1 and 5.3).

    Args:
        rewards: Of successive episodes, shape (n,).
        title: Of the figure.
        at: Which episodes these are, increasing, shape (n,); 1 to n by default.
        window: Of the mean, counted in `rewards`.
        xlabel: What `at` counts.
        note: Small print.

    Raises:
        InputError: Not one-dimensional, shapes that do not fit, or a window below 1.
    """
    check_label("xlabel", xlabel)
    smooth = moving_mean(rewards, window)
    episodes = as_drawn("at", np.arange(1, len(smooth) + 1) if at is None else at)
    if episodes.shape != smooth.shape:
        raise InputError(f"rewards and their places must have the same length, got {smooth.shape} and {episodes.shape}")
    figure, (ax,) = new_figure(title, size=(9.0, 3.8), note=note)
    size = float(np.clip(3e4 / max(len(smooth), 1), 0.3, 8.0))
    ax.scatter(episodes, np.asarray(rewards), s=size, color=PALETTE[0], alpha=0.35, linewidths=0, rasterized=True)
    ax.plot(episodes[window - 1 :], smooth[window - 1 :], color=PALETTE[1], lw=1.8)
    ax.set(xlabel=xlabel, ylabel="reward of the episode", xlim=(0, max(episodes.max(initial=1), 1)))
    _thousands(ax)
    every = 1 if at is None or len(episodes) < 2 else round(float(np.diff(episodes).mean()))
    dots = "one episode" if every == 1 else f"one episode in {every}"
    key(ax, f"dot: {dots} · line: mean of the last {every * window}")
    return figure


def draw_distances(
    episodes: Mapping[str, ArrayLike],
    *,
    title: str,
    near: float = REACHED_DISTANCE,
    xlabel: str = "step of the episode",
    note: str = "",
) -> Figure:
    """Distance from the tip to the goal along episodes, on a log axis (thesis, figure 5.5).

    Args:
        episodes: Distance [m] before the first and after every step by the episode's name, each of shape (n,).
        title: Of the figure.
        near: Distance at which a goal counts as reached [m].
        xlabel: What is counted.
        note: Small print.

    Raises:
        InputError: No episode, or a distance that is not positive.
    """
    check_label("xlabel", xlabel)
    check_mapping("episodes", episodes)
    near = check_number("near", near, above=0.0, most=MOST_DRAWN)
    if not episodes:
        raise InputError("a figure of distances needs at least one episode")
    figure, (ax,) = new_figure(title, size=(9.0, 3.8), note=note)
    colours = colours_of(episodes)
    ends = {}
    for name, distances in episodes.items():
        mm = 1e3 * as_drawn(f"distances of {name!r}", distances)
        if mm.ndim != 1 or not mm.size or not (mm > 0).all():
            raise InputError(f"the distances of {name!r} must be positive numbers in a row")
        ax.plot(mm, color=colours[name], lw=1.8, marker="o", ms=2.5)
        ends[name] = (len(mm) - 1, mm[-1])
    ax.set(xlabel=xlabel, ylabel="distance to the goal [mm]", xlim=_hull(np.array([0, *(x for x, _ in ends.values())])))
    _log_axis(ax)
    limit = 1e3 * near
    if ax.get_ylim()[0] < limit:
        ax.axhline(limit, color=INK, lw=1.2, ls="--", zorder=1)
        key(ax, f"dashed: {limit:g} mm, near enough to reach the goal")
    label_ends(ax, ends, colours)
    return figure


def draw_discounted_rewards(
    steps: ArrayLike, returns: ArrayLike, *, gamma: float, n_steps: int, title: str, note: str = ""
) -> Figure:
    """Discounted sum of what follows a step, with the updates of the policy marked (thesis, figure 5.6).

    Args:
        steps: Of training, equally far apart, shape (n,).
        returns: `discounted_returns` of these steps, shape (n,).
        gamma: Discount factor, for the label.
        n_steps: Steps between two updates.
        title: Of the figure.
        note: Small print.

    Raises:
        InputError: Shapes that do not fit, or fewer than two steps.
    """
    x, y = as_drawn("steps", steps), as_drawn("returns", returns)
    if x.ndim != 1 or len(x) < 2 or x.shape != y.shape:
        raise InputError(f"steps and returns must be as long as each other, got {x.shape} and {y.shape}")
    if not (np.diff(x) > 0).all():
        raise InputError("steps must increase")
    gamma, n_steps = check_number("gamma", gamma, least=0.0, most=1.0), check_count("n_steps", n_steps, most=2**62)
    if x[-1] / n_steps > MOST_UPDATES:
        raise InputError(f"there is no room for more than {MOST_UPDATES} updates, got one every {n_steps} steps")
    every = (x[-1] - x[0]) / (len(x) - 1)
    window = min(len(x), max(1, round(n_steps / every)))
    smooth = moving_mean(y, window)
    figure, (ax,) = new_figure(title, size=(9.0, 3.8), note=note, grid="y")
    for update in np.arange(n_steps, x[-1] + 1, n_steps):
        ax.axvline(update, color=FAINT, lw=0.6, alpha=0.5, zorder=0)
    ax.plot(x, y, color=PALETTE[0], lw=0.4, alpha=0.6, rasterized=True)
    ax.plot(x[window - 1 :], smooth[window - 1 :], color=PALETTE[1], lw=1.8)
    ax.set(xlabel="environment steps", ylabel=f"discounted reward, $\\gamma$ = {gamma:g}", xlim=(0, x[-1]))
    _thousands(ax)
    key(ax, f"thin: of {every:.0f} steps one · thick: mean of the last {n_steps} · grey: update of the policy")
    return figure


def _hull(x: ArrayLike) -> tuple[float, float]:
    """Limits without margins, so that names can stand right behind the ends of lines."""
    x = np.asarray(x, dtype=float)
    low, high = float(x.min()), float(x.max())
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def _log_axis(axes: Axes) -> None:
    """A logarithmic vertical axis with plain numbers, and enough of them where it spans less than two decades."""
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    axes.yaxis.set_major_formatter(FuncFormatter(plain))
    axes.yaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0) if high < 100 * low else ()))
    axes.yaxis.set_minor_formatter(FuncFormatter(plain))
    axes.tick_params(axis="y", which="minor", length=0, labelsize=9, labelcolor=INK)


def _thousands(axes: Axes) -> None:
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: _count(value)))
    axes.tick_params(axis="x", colors=INK)


def _count(value: float) -> str:
    for unit, letter in ((1e6, "M"), (1e3, "k")):
        if abs(value) >= unit:
            return f"{value / unit:g}{letter}"
    return f"{value:g}"
