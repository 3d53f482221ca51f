"""Figures of a comparison.

A method has the same colour in every figure and is named next to its data. A `Draw` is called with all trials and the
contents of `results.json`; functions with parameters return one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kinreach._files import replacing
from kinreach._statistics import Trial, median, number, p95
from kinreach.compare._task import Draw
from kinreach.plots import FAINT, INK, PALETTE, draw_error_maps, key, new_figure
from kinreach.plots.inside import name_label, plain_ticks, text_colour

#: Of the files.
DPI = 160
#: Errors below this are rounding noise; the axis ends here [mm].
SMALLEST_ERROR_MM = 1e-13
#: Name of the row of what the cameras saw.
CAMERAS = "cameras"
#: Parts of a distance below this are drawn at it [mm].
SMALLEST_PART_MM = 1e-4

Measure = Callable[[Trial], float | None]


def write_figures(
    drawings: Mapping[str, Draw], out: Path, trials: Sequence[Trial], results: Mapping[str, Any]
) -> dict[str, Path]:
    """Write figures into a directory, as PNG; return the files by the titles of the figures."""
    written = {}
    for name, draw in drawings.items():
        figure = draw(trials, results)
        path = written[figure.get_suptitle()] = out / f"{name}.png"
        with replacing(path) as temporary:
            figure.savefig(temporary, dpi=DPI, facecolor="white")
    return written


def draw_errors(ik_error_mm: Measure, seen_error_mm: Measure, *, near_mm: float) -> Draw:
    """Draw every trial's distance to the goal [mm]: of the commanded posture, and after the move.

    With cameras, the first row is their error, and its median a line through both panels. A goal within `near_mm`
    counts as reached.
    """

    def draw(trials: Sequence[Trial], results: Mapping[str, Any]) -> Figure:
        figure, (left, right) = _strips_figure(results, "Distance from the tip to the goal", columns=2)
        posture = by_method(trials, results, lambda t: _at_least(ik_error_mm(t), SMALLEST_ERROR_MM))
        moved = by_method(trials, results, lambda t: _at_least(1e3 * t["distance"], SMALLEST_ERROR_MM))
        drawn = f"dot: one goal · bar: median · dotted: {near_mm:g} mm, near enough to reach the goal"
        if any((values == SMALLEST_ERROR_MM).any() for values in posture.values()):
            drawn += f"\nerrors below {number(SMALLEST_ERROR_MM)} mm are drawn at it"
        colours, source, target = colours_in(results), "by forward kinematics", "in the simulation"
        seen = np.concatenate([*by_method(trials, results, seen_error_mm).values()])
        if seen.size:
            goals = len({trial["goal_index"] for trial in trials})
            first = {CAMERAS: seen[:goals]}  # one method's trials are all the looks there were
            posture, moved, colours = first | posture, first | moved, [FAINT, *colours]
            for axes in (left, right):
                axes.axvline(median(first[CAMERAS]), color=FAINT, lw=1, ls="--", zorder=0)
            source, target = "to where the cameras saw the goal", "to where the goal is"
            drawn += "\ncameras: from where they saw the goal to where it is, its median dashed"
        draw_strips(left, posture, colours, f"posture found, {source} [mm]")
        draw_strips(right, moved, colours, f"after the move, {target} [mm]")
        right.axvline(near_mm, color=FAINT, lw=1.2, ls=":", zorder=0)
        limits = [axes.get_xlim() for axes in (left, right)]
        for axes in (left, right):  # the same scale, so that the two can be compared by eye
            axes.set_xlim(min(low for low, _ in limits), max(high for _, high in limits))
        right.tick_params(labelleft=False)
        key(left, drawn)
        return figure

    return draw


def draw_times(trials: Sequence[Trial], results: Mapping[str, Any]) -> Figure:
    """Draw the wall time of the decisions on every goal, and its median without the acceptance tests."""
    figure, (axes,) = _strips_figure(results, "Time to decide per goal, acceptance tests included")
    whole = by_method(trials, results, lambda t: 1e3 * t["solve_s"])
    own = by_method(trials, results, lambda t: 1e3 * (t["solve_s"] - (t.get("accept_s") or 0.0)))
    draw_strips(axes, whole, colours_in(results), "wall time, one thread [ms]")
    for row, values in enumerate(own.values()):
        if values.size:
            axes.plot(median(values), row + 0.34, marker="D", ms=5, mfc="white", mec=INK, ls="")
    key(axes, "dot: one goal · bar: median · diamond: median without the acceptance tests")
    return figure


def draw_budget(parts: Sequence[str], meaning: str) -> Draw:
    """Draw the parts of each method's mean distance on a logarithmic axis, with their intervals.

    Parts are names in `budget_mm` of a method's results, beside `distance`. Negative ones are hollow dots, and those
    below `SMALLEST_PART_MM` are drawn at it.
    """
    marks = dict(zip(parts, (("o", PALETTE[5]), ("s", PALETTE[1]), ("D", PALETTE[2])), strict=True))

    def draw(trials: Sequence[Trial], results: Mapping[str, Any]) -> Figure:
        methods = results["methods"]
        seen = ", goals seen by the cameras" if results["settings"].get("observation") == "camera" else ""
        size = (9.0, 2.1 + 0.46 * len(methods))
        figure, (axes,) = new_figure(f"Where the distance comes from{seen}", size=size, note=origin(results), grid="x")
        for row, method in enumerate(methods):
            _budget_dots(axes, row, method, marks)
        axes.set_yticks(range(len(methods)), [name_label(method["name"]) for method in methods], weight="bold")
        for tick, colour in zip(axes.get_yticklabels(), colours_in(results), strict=True):
            tick.set_color(text_colour(colour))
        axes.set_xscale("log")
        plain_ticks(axes.xaxis)
        axes.set(ylim=(len(methods) - 0.5, -0.6), xlim=(0.7 * SMALLEST_PART_MM, None))
        axes.set_xlabel(f"part of the mean distance [mm]\n{meaning}", fontsize=9)
        for name, (marker, colour) in marks.items():
            axes.plot([], [], ls="", marker=marker, ms=7, color=colour, label=name)
        axes.plot([], [], ls="", marker="|", ms=13, mew=2.2, color=INK, label="distance, their sum")
        axes.plot([], [], ls="", marker="o", ms=7, mfc="white", mec=FAINT, label="hollow: towards the goal")
        axes.legend(
            loc="lower left", bbox_to_anchor=(0, 1.0), ncols=5, frameon=False, fontsize=9, labelcolor=INK,
            borderpad=0.2, handlelength=1.0, columnspacing=1.4,
        )  # fmt: skip
        return figure

    return draw


def _budget_dots(axes: Axes, row: int, method: Mapping[str, Any], marks: Mapping[str, tuple[str, str]]) -> None:
    budget, intervals = method["budget_mm"], method.get("budget_mm_ci", {})
    if not budget["distance"]:
        text = "none" if budget["distance"] is None else "0"
        axes.annotate(text, (SMALLEST_PART_MM, row), va="center", fontsize=8.5, color=FAINT)
        return
    for place, (name, (marker, colour)) in enumerate(marks.items()):
        part, bounds = float(budget[name] or 0.0), intervals.get(name)
        if part == 0.0:  # such as seeing, where the true goal is observed
            continue
        y = row + 0.17 * (place - 1)
        if bounds is not None:
            low, high = sorted(abs(bound) for bound in bounds) if min(bounds) * max(bounds) > 0 else (0.0, abs(part))
            low, high = (max(bound, SMALLEST_PART_MM) for bound in (low, high))
            axes.plot([low, high], [y, y], color=colour, lw=1.2, zorder=2)
        face = colour if part >= 0 else "white"
        axes.plot(max(abs(part), SMALLEST_PART_MM), y, marker=marker, ms=6, mfc=face, mec=colour, mew=1.5, zorder=3)
    axes.plot([budget["distance"]] * 2, [row - 0.34, row + 0.34], color=INK, lw=2.2, zorder=1)
    summands = [float(budget[name] or 0.0) for name in marks]
    text = " ".join(f"{'−' if part < 0 else '+'} {number(abs(part))}" for part in summands).removeprefix("+ ")
    axes.annotate(
        f"{text} = {number(budget['distance'])} mm", (1.02, row), xycoords=("axes fraction", "data"), va="center",
        fontsize=8.5, color=INK, annotation_clip=False,
    )  # fmt: skip


def draw_map(trials: Sequence[Trial], results: Mapping[str, Any]) -> Figure:
    """Draw each method's distances over the places of the goals, with crosses at goals that were not reached."""
    ends = by_method(trials, results, lambda trial: trial["goal_index"])
    maps = {}
    for name in ends:
        own = [trial for trial in trials if trial["method"] == name]
        errors = [1e3 * trial["distance"] if trial["reached"] else np.nan for trial in own]
        maps[name] = (np.array([trial["goal"][:2] for trial in own]), np.array(errors))
    reached = np.concatenate([errors[np.isfinite(errors)] for _, errors in maps.values()])
    limits = None
    if reached.size:
        low, high = np.maximum(np.percentile(reached, (2, 98)), SMALLEST_ERROR_MM)
        limits = (float(low), max(float(high), 2.0 * float(low)))
    note = f"from above, the robot below · dot: a goal, around it its distance · {origin(results)}"
    return draw_error_maps(
        maps, title="Distance by the place of the goal", label="distance of the tip [mm]", missing="not reached",
        columns=4, limits=limits, note=note,
    )  # fmt: skip


def draw_strip_grid(
    title: str, strips: Mapping[str, tuple[Measure, bool]], *, marks: Mapping[str, float], legend: str
) -> Draw:
    """Draw a row of dots per method for each of several values, two side by side.

    Args:
        title: Of the figure.
        strips: Label of each axis -> the value of a trial, and whether it is a count.
        marks: Label of an axis -> where a dashed line is drawn.
        legend: What is drawn.
    """

    def draw(trials: Sequence[Trial], results: Mapping[str, Any]) -> Figure:
        rows = (len(strips) + 1) // 2
        size = (9.6, 1.0 * rows + 0.6 * rows * len(results["methods"]))
        figure, axes = new_figure(title, size=size, rows=rows, columns=2, note=origin(results), grid="x")
        for place, (panel, (label, (value, counts))) in enumerate(zip(axes, strips.items(), strict=False)):
            draw_strips(panel, by_method(trials, results, value), colours_in(results), label, counts=counts)
            if label in marks:
                panel.axvline(marks[label], color=FAINT, lw=1, ls="--", zorder=0)
            if place % 2:
                panel.tick_params(labelleft=False)
        key(axes[0], legend)
        return figure

    return draw


def draw_strips(
    axes: Axes, values: Mapping[str, Any], colours: Sequence[str], label: str, *, counts: bool = False
) -> None:
    """Draw a row of dots per name on a log axis, with median and 95th percentile in numbers.

    The values of a row have shape (n,), and are positive. Counts may be zero: their axis is linear up to 1.
    """
    jitter = np.random.default_rng(0)
    for row, (colour, sample) in enumerate(zip(colours, values.values(), strict=True)):
        if not sample.size:
            axes.annotate("none", (0.5, row), xycoords=("axes fraction", "data"), ha="center", color=FAINT)
            continue
        y = row + jitter.uniform(-0.2, 0.2, sample.size)
        axes.scatter(sample, y, s=9, color=colour, alpha=0.5, linewidths=0)
        axes.plot([median(sample)] * 2, [row - 0.3, row + 0.3], color=INK, lw=2)
        numbers = [number(value, 3 if counts else None) for value in (median(sample), p95(sample))]
        axes.annotate(
            f"median {numbers[0]} · p95 {numbers[1]}", (median(sample), row - 0.33),
            ha="center", va="bottom", fontsize=8, color=INK,
        )  # fmt: skip
    axes.set(xlabel=label, ylim=(len(values) - 0.45, -0.75))
    if counts:
        most = max(float(sample.max(initial=1.0)) for sample in values.values())
        axes.set_xscale("symlog", linthresh=1.0)
        axes.set_xlim(-0.3, 10.0 ** np.ceil(np.log10(most)))
    else:
        axes.set_xscale("log")
        low, high = np.log10(axes.get_xlim())
        axes.set_xlim(10.0 ** np.floor(low), 10.0 ** np.ceil(high))
    plain_ticks(axes.xaxis)
    # above the dots, where a report's first screen has it, and below
    axes.xaxis.set_label_position("top")
    axes.tick_params(axis="x", which="both", labeltop=True)
    axes.set_yticks(range(len(values)), [name_label(name) for name in values], weight="bold")
    for tick, colour in zip(axes.get_yticklabels(), colours, strict=True):
        tick.set_color(text_colour(colour))


def by_method(trials: Sequence[Trial], results: Mapping[str, Any], value: Measure) -> dict[str, Any]:
    """Return the values of the trials that have one, an array a method, in the order of the results."""
    found: dict[str, list[float]] = {method["name"]: [] for method in results["methods"]}
    for trial in trials:
        measured = value(trial)
        if measured is not None:
            found[trial["method"]].append(measured)
    return {name: np.array(values, dtype=np.float64) for name, values in found.items()}


def colours_in(results: Mapping[str, Any]) -> list[str]:
    return [method["colour"] for method in results["methods"]]


def origin(results: Mapping[str, Any]) -> str:
    """Return where the numbers are from, for the small print."""
    settings = results["settings"]
    return f"{settings['goals']} goals, seed {settings['seed']} · {settings['command']}"


def _at_least(value: float | None, least: float) -> float | None:
    return None if value is None else max(value, least)


def _strips_figure(results: Mapping[str, Any], title: str, *, columns: int = 1) -> tuple[Figure, list[Axes]]:
    size = (9.0 if columns > 1 else 7.6, 1.7 + 0.6 * len(results["methods"]))
    return new_figure(title, size=size, columns=columns, note=origin(results), grid="x")
