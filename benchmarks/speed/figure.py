"""All charts of a benchmark in one figure: bars at the left, lines at the right."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from benchmarks.speed.sections import Chart, Section
from kinreach.plots import DPI, FAINT, INK, PALETTE, colours_of, key, plain, style_axes, verbatim

#: Width of the columns of panels with bars and with lines [inches].
WIDTHS = (8.5, 5.5)
#: Height of a panel without its bars, of a bar, and of a panel with lines [inches].
FRAME, BAR, LINES = 0.75, 0.2, 2.6
OURS, PEERS = PALETTE[0], PALETTE[4]


def draw(sections: Sequence[Section]) -> Figure | None:
    """Draw the charts of all sections; None if there are none."""
    charts = [chart for section in sections for chart in section.charts]
    both = zip(([c for c in charts if c.bars], [c for c in charts if c.lines]), WIDTHS, strict=True)
    columns = {width: column for column, width in both if column}
    if not columns:
        return None
    heights = [[_height(chart) for chart in column] for column in columns.values()]
    figure = Figure(figsize=(sum(columns), max(map(sum, heights))), dpi=DPI, layout="constrained")
    parts = figure.subfigures(1, len(columns), squeeze=False, width_ratios=list(columns))[0]
    for part, column, ratios in zip(parts, columns.values(), heights, strict=True):
        panels = part.subplots(len(column), 1, squeeze=False, height_ratios=ratios)[:, 0]
        for panel, chart in zip(panels, column, strict=True):
            style_axes(panel, grid="x" if chart.bars else "both")
            key(panel, verbatim(chart.title))
            (_bars if chart.bars else _lines)(panel, chart)
    return figure


def _height(chart: Chart) -> float:
    return FRAME + BAR * len(chart.bars) if chart.bars else LINES


def _bars(axes: Axes, chart: Chart) -> None:
    names, values = list(chart.bars), list(chart.bars.values())
    places = range(len(names))
    colours = [PEERS if name in chart.peers else OURS for name in names]
    axes.barh(places, values, height=0.7, color=colours)
    axes.set_yticks(list(places), [verbatim(name) for name in names])
    axes.invert_yaxis()
    drawn = [value for value in values if value > 0]  # nothing has no place on a logarithmic axis
    if drawn:
        axes.set_xscale("log")
        lowest, highest = min(drawn), max(drawn)
        # room for a bar of the smallest, and for the number behind the largest
        axes.set_xlim(lowest / 3, highest * max(3.0, (highest / lowest) ** 0.25))
    else:
        axes.set_xlim(0.0, 1.0)
    for place, value in zip(places, values, strict=True):
        axes.annotate(
            f" {value:.3g}" if value < 1000 else f" {float(f'{value:.3g}'):,.0f}".replace(",", " "),
            (max(value, axes.get_xlim()[0]), place), va="center", fontsize=7.5, color=INK,
        )  # fmt: skip
    axes.set_xlabel(verbatim(chart.x), fontsize=8.5, color=FAINT)
    if drawn:
        _plain(axes.xaxis)


def _lines(axes: Axes, chart: Chart) -> None:
    colours = colours_of(chart.lines)
    for name, points in chart.lines.items():
        axes.plot(*zip(*points, strict=True), color=colours[name], lw=1.8, marker="o", ms=3.5, label=verbatim(name))
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(verbatim(chart.x), fontsize=8.5, color=FAINT)
    axes.set_ylabel(verbatim(chart.y), fontsize=8.5, color=FAINT)
    axes.legend(frameon=False, fontsize=8)
    _plain(axes.xaxis)
    _plain(axes.yaxis)


def _plain(axis: Any) -> None:
    low, high = axis.get_view_interval()
    if high < 30 * low:  # hardly a power of ten in it
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_tick_params(which="both", length=0)
    axis.set_major_formatter(FuncFormatter(plain))
    axis.set_minor_formatter(NullFormatter())
