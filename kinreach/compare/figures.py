"""The comparison as pictures: how far from the goal the tip ends and why, success within a tolerance, time to decide.

A method keeps its colour whichever others are beside it, and is always named next to its data.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from kinreach import plots
from kinreach.compare.budget_figure import draw_budget
from kinreach.compare.tables import number
from kinreach.compare.trials import Trial
from kinreach.files import replacing
from kinreach.plots import Success
from kinreach.plots.style import FAINT, INK, key, new_figure, plain
from kinreach.statistics import median, p95

#: One hue per family of methods, one lightness per member: solvers blue, plain PPO orange, ranked PPO green.
COLOURS: Mapping[str, str] = {
    "closed-form": "#003F66",
    "placo": "#0072B2",
    "lm": "#56B4E9",
    "qp": "#8CCBEB",
    "ppo-single": "#D55E00",
    "ppo-multi": "#F2A35E",
    "ranked-single": "#00674C",
    "ranked-multi": "#2FBF94",
    "thesis-ppo-single": "#000000",
    "hybrid": "#CC79A7",
}
#: Of methods that come from files.
_OTHERS = ("#8C6D31", "#6A3D9A", "#B8A100")

#: Name of the row of what the cameras saw.
CAMERAS = "cameras"

#: Errors below this are rounding noise; the axis ends here [mm].
SMALLEST_ERROR_MM = 1e-13


def write_all(out: Path, trials: Sequence[Trial], results: Mapping[str, Any]) -> None:
    """Write `errors.png`, `success.png`, `times.png` and `budget.png` into a directory.

    Raises:
        OutputError: The file system refused.
    """
    drawn = {
        "errors": draw_errors(trials, results),
        "success": draw_success(results),
        "times": draw_times(trials, results),
        "budget": draw_budget(results, note=_origin(results)),
    }
    for name, figure in drawn.items():
        with replacing(out / f"{name}.png") as temporary:
            figure.savefig(temporary, dpi=160, facecolor="white")


def draw_errors(trials: Sequence[Trial], results: Mapping[str, Any]) -> Figure:
    """Distance to the goal of every trial: of the posture by itself, and after the arm has moved there.

    Where cameras looked, the first row is how far from the goal they saw it, and its median a line through both.
    """
    figure, (left, right) = _figure(results, "Distance from the tip to the goal", columns=2)
    posture = _by_method(trials, results, _posture_error_mm)
    moved = _by_method(trials, results, lambda t: 1e3 * t.distance)
    drawn = f"dot: one goal · bar: median · errors below {number(SMALLEST_ERROR_MM)} mm are drawn at it"
    colours, source, target = _colours(results), "by forward kinematics", "in the simulation"
    if results["settings"].get("camera") is not None:
        # One method's trials are all the looks there were.
        seen = _by_method(trials, results, lambda t: None if t.seen_error is None else 1e3 * t.seen_error)
        first = {CAMERAS: next(iter(seen.values()))}
        posture, moved, colours = first | posture, first | moved, [FAINT, *colours]
        for axes in (left, right) if first[CAMERAS].size else ():
            axes.axvline(median(first[CAMERAS]), color=FAINT, lw=1, ls="--", zorder=0)
        source, target = "to where the cameras saw the goal", "to where the goal is"
        drawn += "\ncameras: from where they saw the goal to where it is, its median dashed"
    _strips(left, posture, colours, f"posture found, {source} [mm]")
    _strips(right, moved, colours, f"after the move, {target} [mm]")
    right.tick_params(labelleft=False)
    key(left, drawn)
    return figure


def _posture_error_mm(trial: Trial) -> float | None:
    return None if trial.q is None or trial.ik_error is None else max(1e3 * trial.ik_error, SMALLEST_ERROR_MM)


def draw_times(trials: Sequence[Trial], results: Mapping[str, Any]) -> Figure:
    """Wall time that the decisions on every goal took, and the median of what is left without the acceptance tests."""
    figure, (axes,) = _figure(results, "Time to decide per goal, acceptance tests included")
    whole = _by_method(trials, results, lambda t: t.solve_s)
    tests = _by_method(trials, results, lambda t: t.accept_s)
    _strips(axes, {name: 1e3 * times for name, times in whole.items()}, _colours(results), "wall time, one thread [ms]")
    own = [1e3 * (times - tests[name]) for name, times in whole.items()]
    for row, values in enumerate(own):
        if not values.size:
            continue
        axes.plot(median(values), row + 0.34, marker="D", ms=5, mfc="white", mec=INK, ls="")
    key(axes, "dot: one goal · bar: median · diamond: median without the acceptance tests")
    return figure


def draw_success(results: Mapping[str, Any]) -> Figure:
    """Share of goals within a tolerance, with 95 % intervals where the table reports it."""
    methods = {method["name"]: method for method in results["methods"]}
    tolerances = list(next(iter(methods.values()))["success_at_mm"])
    shares = {
        name: Success(
            [method["success_at_mm"][mm] for mm in tolerances],
            [method["success_at_mm_ci"][mm] for mm in tolerances],
        )
        for name, method in methods.items()
    }
    colours = dict(zip(methods, _colours(results), strict=True))
    return plots.draw_success([float(mm) for mm in tolerances], shares, colours=colours, note=_origin(results))


def _figure(results: Mapping[str, Any], title: str, *, columns: int = 1) -> tuple[Figure, list[Axes]]:
    size = (9.0 if columns > 1 else 7.6, 1.7 + 0.6 * len(results["methods"]))
    return new_figure(title, size=size, columns=columns, note=_origin(results), grid="x")


def _origin(results: Mapping[str, Any]) -> str:
    settings = results["settings"]
    return f"{settings['goals']} goals, seed {settings['seed']} · {settings['command']}"


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
    axes.xaxis.set_major_formatter(FuncFormatter(plain))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_yticks(range(len(values)), list(values), weight="bold")
    for tick, colour in zip(axes.get_yticklabels(), colours, strict=True):
        tick.set_color(colour)


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
    others = cycle(_OTHERS)
    return [COLOURS[method["name"]] if method["name"] in COLOURS else next(others) for method in results["methods"]]
