"""The charts of a section: a dot for the median of the rounds, a line from the quickest to the slowest round."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from benchmarks.speed.sections import Chart, Section
from kinreach.plots._colours import PALETTE, colours_of, method_colours, own_colour
from kinreach.plots._style import FAINT, INK, key, label_ends, new_figure, plain, text_colour, verbatim

#: Width of a figure, height of a panel without its dots, of a dot, and of a panel with lines [inches].
WIDTH, FRAME, DOT, LINES = 8.0, 1.0, 0.27, 3.4
OURS, PEERS = PALETTE[0], PALETTE[4]
ROUNDS = "dot: median · line: range of the rounds"


def draw(section: Section) -> Figure | None:
    """Draw the charts of a section; None if it has none."""
    if not section.charts:
        return None
    heights = [FRAME + DOT * len(chart.bars) if chart.bars else LINES for chart in section.charts]
    figure, _ = new_figure("", size=(WIDTH, sum(heights)), rows=len(heights))
    for axes, chart in zip(figure.axes, section.charts, strict=True):
        (_dots if chart.bars else _lines)(axes, chart, section.samples)
    return figure


def _dots(axes: Axes, chart: Chart, samples: dict[str, list[float]]) -> None:
    names = list(chart.bars)
    rate = "/s" in chart.x
    methods = all(map(own_colour, names))
    colours = method_colours(names) if methods else {n: PEERS if n in chart.peers else OURS for n in names}
    drawn = [value for value in chart.bars.values() if value > 0]  # nothing has no place on a logarithmic axis
    lowest, highest = (min(drawn), max(drawn)) if drawn else (0.0, 1.0)
    for row, (name, value) in enumerate(chart.bars.items()):
        low, high = _range(value, samples.get(name, []), rate=rate)
        lowest, highest = min(lowest, low or lowest), max(highest, high)
        axes.plot([low, high], [row, row], color=colours[name], lw=2.0, solid_capstyle="butt", alpha=0.55)
        axes.plot(value, row, "o", ms=7, color=colours[name])
        text = f"{value:.3g}" if value < 1000 else f"{float(f'{value:.3g}'):,.0f}".replace(",", " ")
        axes.annotate(
            text, (high, row), xytext=(9, 0), textcoords="offset points", va="center", fontsize=8.5, color=INK
        )
    axes.set_yticks(range(len(names)), [verbatim(name) for name in names])
    for tick, name in zip(axes.get_yticklabels(), names, strict=True):
        tick.set_color(text_colour(colours[name]))
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel(verbatim(chart.x), fontsize=9, color=FAINT)
    if drawn:
        axes.set_xscale("log")
        axes.set_xlim(lowest / 1.6, highest * max(2.0, (highest / lowest) ** 0.12))
        _plain(axes.xaxis)
    else:
        axes.set_xlim(0.0, 1.0)
    who = "" if methods else "blue: kinreach · amber: other packages\n"
    key(axes, verbatim(chart.title) + "\n" + who + (ROUNDS if any(name in samples for name in names) else ""))


def _lines(axes: Axes, chart: Chart, samples: dict[str, list[float]]) -> None:
    colours, ends = colours_of(chart.lines), {}
    for name, points in chart.lines.items():
        x, y = np.array(points).T
        ranges = [_range(value, samples.get(f"{name} {at:.0f}", []), rate=False) for at, value in points]
        axes.vlines(x, *np.array(ranges).T, color=colours[name], lw=1.2, alpha=0.7)
        axes.plot(x, y, color=colours[name], lw=1.8, marker="o", ms=4)
        ends[name] = (x[-1], y[-1])
    axes.set(xscale="log", yscale="log")
    axes.set_xlim(right=axes.get_xlim()[1] / 1.3)
    axes.set_xlabel(verbatim(chart.x), fontsize=9, color=FAINT)
    axes.set_ylabel(verbatim(chart.y), fontsize=9, color=FAINT)
    _plain(axes.xaxis)
    _plain(axes.yaxis)
    key(axes, f"{verbatim(chart.title)}\n{ROUNDS}")
    label_ends(axes, ends, colours)


def _range(value: float, rounds: Sequence[float], *, rate: bool) -> tuple[float, float]:
    """Return the least and the largest of the rounds, in the unit of their median, which is drawn as `value`.

    Args:
        value: In the chart's unit.
        rounds: Seconds of each.
        rate: Whether the unit is a number a second.
    """
    if not rounds or value <= 0:
        return value, value
    low, middle, high = min(rounds), float(np.median(rounds)), max(rounds)
    ends = (middle / high, middle / low) if rate else (low / middle, high / middle)
    low, high = (value * end for end in ends)
    return min(low, value), max(high, value)


def _plain(axis: Any) -> None:
    low, high = axis.get_view_interval()
    if high < 100 * low:  # hardly a power of ten in it
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_tick_params(which="both", length=0)
    axis.set_major_formatter(FuncFormatter(plain))
    axis.set_minor_formatter(NullFormatter())
