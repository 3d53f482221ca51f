"""Comparisons of postures as pictures: how far from the goal the tip ends, success, time to decide."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kinreach import plots
from kinreach.compare.strips import by_method, colours_in, draw_strips, origin
from kinreach.compare.tables import number
from kinreach.compare.trials import ReachTrial
from kinreach.plots import Success
from kinreach.plots.style import FAINT, INK, key, new_figure
from kinreach.statistics import median

#: Name of the row of what the cameras saw.
CAMERAS = "cameras"

#: Errors below this are rounding noise; the axis ends here [mm].
SMALLEST_ERROR_MM = 1e-13


def draw_errors(trials: Sequence[ReachTrial], results: Mapping[str, Any]) -> Figure:
    """Distance to the goal of every trial: of the posture by itself, and after the arm has moved there.

    Where cameras looked, the first row is how far from the goal they saw it, and its median a line through both.
    """
    figure, (left, right) = _figure(results, "Distance from the tip to the goal", columns=2)
    posture = by_method(trials, results, _posture_error_mm)
    moved = by_method(trials, results, lambda t: 1e3 * t.distance)
    drawn = f"dot: one goal · bar: median · errors below {number(SMALLEST_ERROR_MM)} mm are drawn at it"
    colours, source, target = colours_in(results), "by forward kinematics", "in the simulation"
    if results["settings"].get("camera") is not None:
        # One method's trials are all the looks there were.
        seen = by_method(trials, results, lambda t: None if t.seen_error is None else 1e3 * t.seen_error)
        first = {CAMERAS: next(iter(seen.values()))}
        posture, moved, colours = first | posture, first | moved, [FAINT, *colours]
        for axes in (left, right) if first[CAMERAS].size else ():
            axes.axvline(median(first[CAMERAS]), color=FAINT, lw=1, ls="--", zorder=0)
        source, target = "to where the cameras saw the goal", "to where the goal is"
        drawn += "\ncameras: from where they saw the goal to where it is, its median dashed"
    draw_strips(left, posture, colours, f"posture found, {source} [mm]")
    draw_strips(right, moved, colours, f"after the move, {target} [mm]")
    right.tick_params(labelleft=False)
    key(left, drawn)
    return figure


def _posture_error_mm(trial: ReachTrial) -> float | None:
    return None if trial.q is None or trial.ik_error is None else max(1e3 * trial.ik_error, SMALLEST_ERROR_MM)


def draw_times(trials: Sequence[ReachTrial], results: Mapping[str, Any]) -> Figure:
    """Wall time that the decisions on every goal took, and the median of what is left without the acceptance tests."""
    figure, (axes,) = _figure(results, "Time to decide per goal, acceptance tests included")
    whole = by_method(trials, results, lambda t: t.solve_s)
    tests = by_method(trials, results, lambda t: t.accept_s)
    draw_strips(
        axes, {name: 1e3 * times for name, times in whole.items()}, colours_in(results), "wall time, one thread [ms]"
    )
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
    colours = dict(zip(methods, colours_in(results), strict=True))
    return plots.draw_success([float(mm) for mm in tolerances], shares, colours=colours, note=origin(results))


def _figure(results: Mapping[str, Any], title: str, *, columns: int = 1) -> tuple[Figure, list[Axes]]:
    size = (9.0 if columns > 1 else 7.6, 1.7 + 0.6 * len(results["methods"]))
    return new_figure(title, size=size, columns=columns, note=origin(results), grid="x")
