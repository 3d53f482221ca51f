"""Figures of shares and errors against a tolerance, steps, speeds or looks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, LogLocator

from kinreach._statistics import Trial, bootstrap_intervals, median, number, wilson_interval
from kinreach.compare._figures import Measure, by_method, colours_in, origin
from kinreach.compare._task import Draw, of_reached
from kinreach.plots import key, label_ends, new_figure
from kinreach.plots.inside import name_label, plain_ticks, text_colour


def draw_success(trials: Sequence[Trial], results: Mapping[str, Any]) -> Figure:
    """Draw the share of goals within any tolerance, with 95 % intervals at those of the table.

    Methods without a goal within the axes are named above.
    """
    figure, (axes,) = new_figure(
        "Share of goals reached within a tolerance", size=(8.2, 4.9), note=origin(results), grid="both"
    )
    methods = results["methods"]
    near = by_method(trials, results, lambda t: None if t["impossible"] else max(1e3 * t["distance"], 1e-6))
    tolerances = np.array([float(mm) for mm in methods[0]["success_at_mm"]])
    low = min([tolerances.min(), *(np.percentile(found, 2) for found in near.values() if found.size)])
    low, high = 10 ** np.floor(np.log10(low)), 1.3 * tolerances.max()
    middles, never = {}, []
    for method, colour in zip(methods, colours_in(results), strict=True):
        found = np.sort(near[method["name"]])
        if not (found <= high).any():
            never.append(name_label(method["name"]))
            continue
        middles[method["name"]] = float(np.median(found))
        shares = 100 * np.arange(1, found.size + 1) / method["goals"]
        axes.step([found[0], *found, high], [0.0, *shares, shares[-1]], where="post", color=colour, lw=1.6)
        at = 100 * np.array([*method["success_at_mm"].values()])
        bounds = 100 * np.array([*method["success_at_mm_ci"].values()])
        error = np.maximum([at - bounds[:, 0], bounds[:, 1] - at], 0.0)
        axes.errorbar(tolerances, at, error, color=colour, ls="", marker="o", ms=3.5, elinewidth=1, zorder=3)
    for rank, name in enumerate(sorted(middles, key=middles.__getitem__)):  # from top left to bottom right
        found, count = np.sort(near[name]), next(m["goals"] for m in methods if m["name"] == name)
        wanted = 94 - 88 * (rank + 0.5) / len(middles)
        index = min(int(np.ceil(wanted / 100 * count)), int((found <= high).sum())) - 1
        colour = next(m["colour"] for m in methods if m["name"] == name)
        axes.annotate(
            name_label(name), (found[max(index, 0)], 100 * (index + 1) / count), xytext=(5, 0),
            textcoords="offset points", color=text_colour(colour), weight="bold", fontsize=8.5, va="center",
            path_effects=[withStroke(linewidth=3, foreground="white")], zorder=4,
        )  # fmt: skip
    axes.set(xscale="log", xlim=(low, high), ylim=(-3, 103), xlabel="tolerance [mm]")
    plain_ticks(axes.xaxis)
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0f} %"))
    rest = f"\nno goal within {high:.0f} mm: {', '.join(never)}" if never else ""
    key(axes, f"line: all goals, sorted by distance · dot: reported, with its 95 % interval{rest}")
    return figure


def draw_pressed(trials: Sequence[Trial], results: Mapping[str, Any]) -> Figure:
    """Draw the share of goals reached so far against the steps of the episode, with its interval at the end.

    Methods that reach none are named above.
    """
    figure, (axes,) = new_figure("Share of goals pressed so far", size=(7.6, 4.4), note=origin(results), grid="both")
    most = max(trial["steps"] for trial in trials)
    reached = by_method(trials, results, of_reached("steps"))
    colours = dict(zip(reached, colours_in(results), strict=True))
    ends = {}
    never = [name_label(method["name"]) for method in results["methods"] if not reached[method["name"]].size]
    for rank, method in enumerate(results["methods"]):
        name = method["name"]
        steps = np.sort(reached[name])
        if not steps.size:
            continue
        shares = 100 * np.arange(len(steps) + 1) / method["goals"]
        axes.step([0, *steps, most], [*shares, shares[-1]], where="post", color=colours[name], lw=1.8)
        end = 100 * method["reached"]
        low, high = 100 * np.array(method["reached_ci"])
        at = most * (1 + 0.012 * (1 + rank))  # side by side, so that equal methods do not hide each other
        axes.errorbar(at, end, [[end - low], [high - end]], color=colours[name], marker="o", ms=4, elinewidth=1.4)
        ends[name] = (at, end)
    axes.set(xlim=(0, most * (1.02 + 0.012 * len(ends))), ylim=(-3, 103), xlabel="steps of the episode")
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0f} %"))
    label_ends(axes, ends, colours)
    rest = f"\nnone of {results['settings']['goals']} goals: {', '.join(never)}" if never else ""
    key(axes, f"dot: at the end of the episodes, with its 95 % interval{rest}")
    return figure


def draw_shares(entry: str, *, title: str, label: str, of: str) -> Draw:
    """Draw the share of goals reached against an entry of the trials, with Wilson's 95 % interval."""

    def draw(trials: Sequence[Trial], results: Mapping[str, Any]) -> Figure:
        figure, (axes,) = new_figure(title, size=(7.6, 4.4), note=origin(results), grid="both")
        names = [method["name"] for method in results["methods"]]
        colours = dict(zip(names, colours_in(results), strict=True))
        values = sorted({trial[entry] for trial in trials})
        ends = {}
        for rank, name in enumerate(names):
            rates = []
            for value in values:
                own = [trial["reached"] for trial in trials if trial["method"] == name and trial[entry] == value]
                rates.append((np.mean(own), *wilson_interval(sum(own), len(own))))
            rate, low, high = 100 * np.array(rates).T
            # side by side, so that equal methods do not hide each other
            at = np.array(values) + 0.007 * max(values) * rank
            axes.errorbar(
                at, rate, np.maximum([rate - low, high - rate], 0.0), color=colours[name], marker="o", ms=4, lw=1.6,
                elinewidth=1,
            )  # fmt: skip
            ends[name] = (at[-1], rate[-1])
        axes.set(xlim=(min(0.0, -0.03 * max(values)), max(*values, 1e-9) * 1.1), ylim=(-3, 103), xlabel=label)
        if all(isinstance(value, int) for value in values):
            axes.set_xticks(values)
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0f} %"))
        label_ends(axes, ends, colours)
        key(axes, f"share of {of}, with 95 % intervals")
        return figure

    return draw


def draw_looks(budgets: Sequence[int], error_mm: Callable[[int, int], Measure]) -> Draw:
    """Draw the median error against looks before, with its 95 % interval over robots, directions and balls.

    Left: in the first move to a ball; methods that do not depend on looks are named above. Right: in the second move,
    after the tip was seen beside the ball, where looks before hardly matter. `error_mm` is called with a
    number of looks and one of corrections.
    """

    def draw(trials: Sequence[Trial], results: Mapping[str, Any]) -> Figure:
        figure, panels = new_figure(
            "Everything a little wrong: what looks are worth",
            size=(11.4, 4.8),
            columns=2,
            note=origin(results),
            grid="y",
        )
        measured = [budget for budget in budgets if any(trial.get(f"error_{budget}_0") is not None for trial in trials)]
        colours = dict(zip((method["name"] for method in results["methods"]), colours_in(results), strict=True))
        first, second = (
            {budget: by_method(trials, results, error_mm(budget, again)) for budget in measured} for again in (0, 1)
        )
        _first_move(panels[0], first, colours)
        _second_move(panels[1], second, colours)
        return figure

    return draw


def _first_move(axes: Axes, samples: Mapping[int, Mapping[str, Any]], colours: Mapping[str, str]) -> None:
    """Draw a dot at each number of looks for each method that they change, side by side."""
    unchanged: dict[str, list[str]] = {}
    drawn = {}
    for method in colours:
        found = [
            (place, *_with_interval(sample[method]))
            for place, sample in enumerate(samples.values())
            if sample[method].size
        ]
        if not found:
            continue
        place, middle, low, high = np.array(found).T
        if len(found) > 1 and np.ptp(middle) < 0.01 * middle[0]:
            unchanged.setdefault(number(middle[0]), []).append(name_label(method))
        else:
            drawn[method] = place, middle, low, high
    right = len(samples) - 0.5
    ends = {}
    for beside, (method, (place, middle, low, high)) in zip(_side_by_side(len(drawn)), drawn.items(), strict=True):
        axes.vlines(place + beside, low, high, color=colours[method], lw=1.2)
        axes.plot(place + beside, middle, "o", color=colours[method], ms=5)
        ends[method] = (right, middle[-1])
    axes.set(yscale="log", xlim=(-0.5, right), xlabel="looks before")
    axes.set_xticks(range(len(samples)), [str(budget) for budget in samples])
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    plain_ticks(axes.yaxis)
    flat = "; ".join(f"{', '.join(names)} ({mm} mm)" for mm, names in unchanged.items())
    rest = fill(f"looks change nothing for {flat}", width=64) if flat else ""
    key(axes, f"first move · median distance to the ball [mm]\n{rest}")
    if ends:
        label_ends(axes, ends, colours)


def _side_by_side(count: int) -> Any:
    """Return offsets from a place, shape (count,), that leave room before the next one."""
    return 0.09 * (np.arange(count) - (count - 1) / 2)


def _second_move(axes: Axes, samples: Mapping[int, Mapping[str, Any]], colours: Mapping[str, str]) -> None:
    """Draw a row of two dots for each method: without looks before, and with most of them."""
    few, most = min(samples), max(samples)
    rows = [method for method in colours if samples[most][method].size]
    for row, method in enumerate(rows):
        for budget in dict.fromkeys((few, most)):
            if samples[budget][method].size:
                y = row + (0.16 if budget == most else -0.16) * (few != most)
                middle, low, high = _with_interval(samples[budget][method])
                face = colours[method] if budget == most else "white"
                axes.plot([low, high], [y, y], color=colours[method], lw=1.2)
                axes.plot(middle, y, "o", ms=5, mfc=face, mec=colours[method], mew=1.4)
    axes.set(xscale="log", ylim=(len(rows) - 0.4, -0.6))
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    plain_ticks(axes.xaxis)
    axes.grid(axis="x", color="#e4e4e4", lw=0.8)
    axes.set_yticks(range(len(rows)), [name_label(name) for name in rows], weight="bold")
    for tick, name in zip(axes.get_yticklabels(), rows, strict=True):
        tick.set_color(text_colour(colours[name]))
    axes.set_xlabel("median distance to the ball [mm]")
    key(axes, f"second move, having seen the first\nopen: {few} looks before · filled: {most}")


def _with_interval(sample: Any) -> tuple[float, float, float]:
    """Return the median of a sample with its 95 % interval."""
    return float(median(sample)), *bootstrap_intervals(sample, (median,))[0]
