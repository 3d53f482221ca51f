"""The comparison as pictures: how far the tip ends from the goal, how often within a tolerance, how long a solve takes.

Colours are those of Okabe and Ito, which colour-blind readers tell apart; a method keeps its colour whichever
others are beside it, and is always named next to its data.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from kinreach.compare.methods import METHODS
from kinreach.compare.statistics import median, p95
from kinreach.compare.tables import number
from kinreach.compare.trials import Trial
from kinreach.files import replacing

PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8C6D31")
INK, FAINT, GRID = "#222222", "#6b6b6b", "#e4e4e4"

#: Name of the row of what the cameras saw.
CAMERAS = "cameras"

#: Errors below this are rounding noise; the axis ends here [mm].
SMALLEST_ERROR_MM = 1e-13


def write_all(out: Path, trials: Sequence[Trial], results: Mapping[str, Any]) -> None:
    """Write `errors.png`, `success.png` and `times.png` into a directory.

    Raises:
        OutputError: The file system refused.
    """
    for name, draw in (("errors", draw_errors), ("success", draw_success), ("times", draw_times)):
        figure = draw(trials, results)
        with replacing(out / f"{name}.png") as temporary:
            figure.savefig(temporary, dpi=160, facecolor="white")


def draw_errors(trials: Sequence[Trial], results: Mapping[str, Any]) -> Figure:
    """Distance to the goal of every trial: of the posture by itself, and after the arm has moved there.

    Where cameras looked, the first row is how far from the goal they saw it, and its median a line through both.
    """
    figure, (left, right) = _figure(results, "Distance from the tip to the goal", columns=2)
    posture = _by_method(trials, results, _posture_error_mm)
    moved = _by_method(trials, results, lambda t: 1e3 * t.distance)
    colours, source, target = _colours(results), "by forward kinematics", "in the simulation"
    if results["settings"].get("camera") is not None:
        # One method's trials are all the looks there were.
        seen = _by_method(trials, results, lambda t: None if t.seen_error is None else 1e3 * t.seen_error)
        first = {CAMERAS: next(iter(seen.values()))}
        posture, moved, colours = first | posture, first | moved, [FAINT, *colours]
        for axes in (left, right) if first[CAMERAS].size else ():
            axes.axvline(median(first[CAMERAS]), color=FAINT, lw=1, ls="--", zorder=0)
        source, target = "to where the cameras saw the goal", "to where the goal is"
        _key(right, "cameras: from where they saw the goal to where it is")
    _strips(left, posture, colours, f"posture found, {source} [mm]")
    _strips(right, moved, colours, f"after the move, {target} [mm]")
    right.tick_params(labelleft=False)
    _key(left, f"dot: one goal · bar: median · errors below {number(SMALLEST_ERROR_MM)} mm are drawn at it")
    return figure


def _posture_error_mm(trial: Trial) -> float | None:
    return None if trial.q is None or trial.ik_error is None else max(1e3 * trial.ik_error, SMALLEST_ERROR_MM)


def draw_times(trials: Sequence[Trial], results: Mapping[str, Any]) -> Figure:
    """Wall time of every solve, and the median of what is left of it without the acceptance tests."""
    figure, (axes,) = _figure(results, "Time per solve, acceptance tests included")
    whole = _by_method(trials, results, lambda t: t.solve_s)
    tests = _by_method(trials, results, lambda t: t.accept_s)
    _strips(axes, {name: 1e3 * times for name, times in whole.items()}, _colours(results), "wall time, one thread [ms]")
    own = [1e3 * (times - tests[name]) for name, times in whole.items()]
    for row, values in enumerate(own):
        if not values.size:
            continue
        axes.plot(median(values), row + 0.34, marker="D", ms=5, mfc="white", mec=INK, ls="")
    _key(axes, "dot: one goal · bar: median · diamond: median without the acceptance tests")
    return figure


def draw_success(trials: Sequence[Trial], results: Mapping[str, Any]) -> Figure:
    """Share of goals within a tolerance, with 95 % intervals where the table reports it."""
    figure, (axes,) = _figure(results, "Share of goals reached within a tolerance")
    methods = results["methods"]
    colours = _colours(results)
    ends = []
    for rank, method in enumerate(methods):
        tolerances = np.array([float(key) for key in method["success_at_mm"]])
        order = np.argsort(tolerances)
        share = 100 * np.array(list(method["success_at_mm"].values()))[order]
        low, high = 100 * np.array(list(method["success_at_mm_ci"].values()))[order].T
        # Side by side, so that equal methods do not hide each other.
        x = tolerances[order] * 1.035 ** (rank - (len(methods) - 1) / 2)
        axes.errorbar(
            x, share, [share - low, high - share], color=colours[rank], lw=1.6, elinewidth=1, marker="o", ms=4
        )
        ends.append((x[0], share[0]))
    for rank, y in enumerate(_spread([share for _, share in ends], gap=6.5)):
        axes.annotate(
            methods[rank]["name"],
            ends[rank],
            xytext=(0.415, y),
            ha="right",
            va="center",
            color=colours[rank],
            weight="bold",
            annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": colours[rank], "lw": 0.8, "relpos": (1, 0.5), "shrinkB": 0},
        )
    axes.set(xscale="log", xlim=(0.46, 58), ylim=(-3, 103), xlabel="tolerance [mm]", ylabel="")
    ticks = sorted(float(key) for key in methods[0]["success_at_mm"])
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.tick_right()
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0f} %"))
    axes.grid(axis="y", color=GRID, lw=0.8)
    return figure


def _figure(results: Mapping[str, Any], title: str, *, columns: int = 1) -> tuple[Figure, Sequence[Axes]]:
    rows = len(results["methods"])
    height = 4.6 if columns == 1 and "within" in title else 1.7 + 0.75 * rows
    figure = Figure(figsize=(9.0 if columns > 1 else 7.6, height), layout="constrained")
    settings = results["settings"]
    figure.suptitle(title, x=0.01, ha="left", fontsize=13, weight="bold", color=INK)
    origin = f"{settings['goals']} goals, seed {settings['seed']} · {settings['command']}"
    figure.supxlabel(fill(origin, width=round(16 * figure.get_figwidth())), x=0.01, ha="left", fontsize=7, color=FAINT)
    axes = figure.subplots(1, columns, squeeze=False)[0]
    for ax in axes:
        ax.spines[["top", "right", "left"]].set_visible(False)
        ax.spines["bottom"].set_color(FAINT)
        ax.tick_params(colors=INK, length=0, labelsize=9)
        ax.set_axisbelow(True)
    return figure, list(axes)


def _key(axes: Axes, text: str) -> None:
    axes.set_title(text, loc="left", fontsize=8.5, color=FAINT)


def _plain(value: float, _: int) -> str:
    """A label of a log axis: a plain number as long as that is short."""
    return f"{value:g}" if 1e-3 <= value < 1e4 else f"$10^{{{round(np.log10(value))}}}$"


def _strips(axes: Axes, values: Mapping[str, Any], colours: Sequence[str], label: str) -> None:
    """One row of dots per name on a log axis, with the median marked and median and 95th percentile in numbers."""
    jitter = np.random.default_rng(0)
    for row, (colour, sample) in enumerate(zip(colours, values.values(), strict=True)):
        if not sample.size:
            axes.annotate("none", (0.5, row), xycoords=("axes fraction", "data"), ha="center", color=FAINT)
            continue
        y = row + jitter.uniform(-0.2, 0.2, sample.size)
        axes.scatter(sample, y, s=9, color=colour, alpha=0.5, linewidths=0)
        axes.plot([median(sample)] * 2, [row - 0.3, row + 0.3], color=INK, lw=2)
        axes.annotate(
            f"median {number(median(sample))} · p95 {number(p95(sample))}", (median(sample), row - 0.33),
            ha="center", va="bottom", fontsize=8, color=INK,
        )  # fmt: skip
    axes.set(xscale="log", xlabel=label, ylim=(len(values) - 0.45, -0.75))
    low, high = np.log10(axes.get_xlim())
    axes.set_xlim(10.0 ** np.floor(low), 10.0 ** np.ceil(high))
    axes.xaxis.set_major_formatter(FuncFormatter(_plain))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_yticks(range(len(values)), list(values), weight="bold")
    for tick, colour in zip(axes.get_yticklabels(), colours, strict=True):
        tick.set_color(colour)
    axes.grid(axis="x", color=GRID, lw=0.8)


def _by_method(
    trials: Sequence[Trial], results: Mapping[str, Any], value: Callable[[Trial], float | None]
) -> dict[str, Any]:
    found: dict[str, list[float]] = {method["name"]: [] for method in results["methods"]}
    for trial in trials:
        measured = value(trial)
        if measured is not None:
            found[trial.method].append(measured)
    return {name: np.array(values) for name, values in found.items()}


def _colours(results: Mapping[str, Any]) -> list[str]:
    known = list(METHODS[results["settings"]["task"]])
    return [PALETTE[known.index(method["name"]) % len(PALETTE)] for method in results["methods"]]


def _spread(positions: Sequence[float], *, gap: float) -> list[float]:
    """Positions on 0 to 100, moved apart so that neighbours keep their order and a gap."""
    order = np.argsort(-np.array(positions), kind="stable")
    placed = np.array(positions, dtype=float)
    for above, below in pairwise(order):
        placed[below] = min(placed[below], placed[above] - gap)
    return list(placed + max(0.0, -placed.min()))
