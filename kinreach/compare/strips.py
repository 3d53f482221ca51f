"""What the figures of all comparisons share: a row of dots per method, colours, and where the numbers are from.

A method keeps its colour whichever others are beside it, and is always named next to its data.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import cycle
from typing import Any, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, NullFormatter

from kinreach.compare.tables import number
from kinreach.compare.trials import Trial
from kinreach.plots.style import FAINT, INK, name_label, plain, verbatim
from kinreach.statistics import median, p95

T = TypeVar("T", bound=Trial)

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
    "analytic": "#003F66",
    "ppo": "#D55E00",
    "random": "#7A7A7A",
}
#: Of methods that come from files.
_OTHERS = ("#8C6D31", "#6A3D9A", "#B8A100")


def draw_strips(
    axes: Axes, values: Mapping[str, Any], colours: Sequence[str], label: str, *, counts: bool = False
) -> None:
    """One row of dots per name on a log axis, with the median marked and median and 95th percentile in numbers.

    Args:
        axes: Empty.
        values: Of each row, shape (n,); positive unless they are counts.
        colours: Of the rows.
        label: Of the axis, with its unit.
        counts: Whether values are counts, which may be zero: then the axis is linear up to 1.
    """
    jitter = np.random.default_rng(0)
    for row, (colour, sample) in enumerate(zip(colours, values.values(), strict=True)):
        if not sample.size:
            axes.annotate("none", (0.5, row), xycoords=("axes fraction", "data"), ha="center", color=FAINT)
            continue
        y = row + jitter.uniform(-0.2, 0.2, sample.size)
        axes.scatter(sample, y, s=9, color=colour, alpha=0.5, linewidths=0)
        axes.plot([median(sample)] * 2, [row - 0.3, row + 0.3], color=INK, lw=2)
        said = [f"{value:.3g}" if counts else number(value) for value in (median(sample), p95(sample))]
        axes.annotate(
            f"median {said[0]} · p95 {said[1]}", (median(sample), row - 0.33),
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
    axes.xaxis.set_major_formatter(FuncFormatter(plain))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_yticks(range(len(values)), [name_label(name) for name in values], weight="bold")
    for tick, colour in zip(axes.get_yticklabels(), colours, strict=True):
        tick.set_color(colour)


def by_method(trials: Sequence[T], results: Mapping[str, Any], value: Callable[[T], float | None]) -> dict[str, Any]:
    """A value of each trial that has one, in an array for each method, in the order of the results."""
    found: dict[str, list[float]] = {method["name"]: [] for method in results["methods"]}
    for trial in trials:
        measured = value(trial)
        if measured is not None:
            found[trial.method].append(measured)
    return {name: np.array(values) for name, values in found.items()}


def colours_in(results: Mapping[str, Any]) -> list[str]:
    """A colour for each method."""
    others = cycle(_OTHERS)
    return [COLOURS[method["name"]] if method["name"] in COLOURS else next(others) for method in results["methods"]]


def origin(results: Mapping[str, Any]) -> str:
    """Small print: where the numbers are from."""
    settings = results["settings"]
    return f"{settings['goals']} goals, seed {settings['seed']} · {verbatim(settings['command'])}"
