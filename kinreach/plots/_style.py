"""The style of the figures: empty axes, tick labels, names beside their data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from textwrap import fill
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import XAxis, YAxis
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.patheffects import AbstractPathEffect, withStroke
from matplotlib.ticker import FuncFormatter, NullFormatter
from numpy.typing import ArrayLike

#: Colour of texts and of lines that explain.
INK = "#222222"
#: Colour of remarks and of lines in the background.
FAINT = "#6b6b6b"
GRID = "#e4e4e4"
#: Colour map of magnitudes: uniform in lightness, and the same for colour-blind readers.
MAGNITUDE = "cividis"
GridLines = Literal["x", "y", "both", "none"]
#: A line that ends nearer to the border of the axes is named beside them, as a share of their width.
BORDER = 0.15
#: Of names beside their data [points], and the colour of strokes that lead to them.
FONT_SIZE, LEADER = 9.0, "#9a9a9a"
#: Around words, so that lines may pass behind them.
HALO: list[AbstractPathEffect] = [withStroke(linewidth=2.5, foreground="white")]
#: Default resolution [dots per inch].
DPI = 100
#: Longest name that a figure has room for [characters].
MAX_NAME_LENGTH = 40


def new_figure(
    title: str,
    *,
    size: tuple[float, float],
    rows: int = 1,
    columns: int = 1,
    widths: Sequence[float] | None = None,
    note: str = "",
    grid: GridLines = "both",
    bare: bool = False,
) -> tuple[Figure, list[Axes]]:
    """Make a figure with empty axes in the common style.

    Args:
        title: At the top left; none if empty. Dollar signs enclose formulas: pass names through `name_label`.
        size: Width and height [inches].
        rows: Of axes, which are returned row by row.
        columns: Of axes.
        widths: Of the columns, relative to each other; equal by default.
        note: Small print at the bottom, as it is, such as the source of the data.
        grid: `"x"`, `"y"`, `"both"` or `"none"`.
        bare: Hide axes and ticks, as for pictures.
    """
    figure = Figure(figsize=size, dpi=DPI, layout="constrained")
    if title:
        figure.suptitle(title, x=0.01, ha="left", fontsize=13, weight="bold", color=INK)
    if note:
        text = fill(verbatim(note), width=round(16 * size[0]), break_on_hyphens=False)
        figure.supxlabel(text, x=0.01, ha="left", fontsize=7, color=FAINT)
    axes = list(figure.subplots(rows, columns, squeeze=False, width_ratios=widths).ravel())
    for ax in axes:
        if bare:
            ax.set_axis_off()
            continue
        style_axes(ax, grid=grid)
    return figure, axes


def style_axes(axes: Axes, *, grid: GridLines = "both") -> None:
    """Give empty axes the common style, with a grid as in `new_figure`."""
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.spines["bottom"].set_color(FAINT)
    axes.tick_params(colors=INK, length=0, labelsize=9)
    axes.set_axisbelow(True)
    if grid != "none":
        axes.grid(axis=grid, color=GRID, lw=0.8)


def key(axes: Axes, text: str) -> None:
    """Write above the axes, at the left, what the marks mean."""
    axes.set_title(text, loc="left", fontsize=8.5, color=FAINT)


def plain(value: float, _: int | None = None) -> str:
    """Format a tick of a log axis: a plain number if that is short, else a power of ten."""
    power = f"$10^{{{round(np.log10(value))}}}$" if value > 0 else ""
    return power if power and not 1e-3 <= value < 1e4 and np.isclose(np.log10(value) % 1, 0) else f"{value:g}"


def plain_ticks(axis: XAxis | YAxis) -> None:
    """Label the major ticks of a log axis by `plain`, and no minor ones."""
    axis.set_major_formatter(FuncFormatter(plain))
    axis.set_minor_formatter(NullFormatter())


def verbatim(text: str) -> str:
    """Escape dollar signs, so that matplotlib reads no formula in the text."""
    return text.replace("$", r"\$")


def name_label(name: str) -> str:
    """Escape a name that is written beside its data, and shorten it to `MAX_NAME_LENGTH`."""
    return verbatim(name if len(name) <= MAX_NAME_LENGTH else f"{name[: MAX_NAME_LENGTH - 1]}…")


def text_colour(colour: str) -> str:
    """Darken a colour until it can be read on white: contrast of at least 4.5 (WCAG 2)."""
    r, g, b = to_rgb(colour)
    while 1.05 / (_luminance((r, g, b)) + 0.05) < 4.5:
        r, g, b = 0.95 * r, 0.95 * g, 0.95 * b
    return to_hex((r, g, b))


def _luminance(rgb: ArrayLike) -> float:
    c = np.asarray(rgb)
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def label_ends(axes: Axes, ends: Mapping[str, ArrayLike], colours: Mapping[str, str], *, side: str = "right") -> None:
    """Write names at the ends of lines, moved apart where they would overlap.

    A line that ends inside the axes is named there. The other names form a column beside the axes; a thin grey stroke
    beside the axes leads to a name that was moved by more than half its height. Set the limits of the axes first.

    Args:
        axes: The axes with the lines.
        ends: Name -> end of its line, (x, y) in data coordinates.
        colours: Of the names.
        side: Side of the ends, `"right"` or `"left"`.
    """
    to_axes = axes.transData + axes.transAxes.inverted()
    places = {name: to_axes.transform(np.asarray(end, dtype=float)) for name, end in ends.items()}
    edge, beside, align = (1.0, 1.0, "left") if side == "right" else (0.0, -1.0, "right")
    column = {name: place for name, place in places.items() if abs(place[0] - edge) <= BORDER}
    figure: Any = axes.figure
    gap = 1.35 * FONT_SIZE / 72 / (figure.get_size_inches()[1] * axes.get_position().height)
    for at_border, group in ((True, column), (False, {n: place for n, place in places.items() if n not in column})):
        heights = spread([float(y) for _, y in group.values()], gap=gap)
        moved = any(abs(h - float(y)) > 0.6 * gap for (_, y), h in zip(group.values(), heights, strict=True))
        for (name, (x, y)), height in zip(group.items(), heights, strict=True):
            start = min(max(float(y), 0.0), 1.0)
            if at_border and abs(height - start) > 0.6 * gap:
                axes.plot(
                    [edge + 0.008 * beside, edge + 0.026 * beside], [start, height], transform=axes.transAxes,
                    color=LEADER, lw=0.7, clip_on=False, zorder=1, solid_capstyle="round",
                )  # fmt: skip
            text = axes.annotate(
                name_label(name),
                (
                    (edge if at_border else float(x))
                    + (0.03 if at_border and moved else 0.012 if at_border else 0.02) * beside,
                    height,
                ),
                xycoords="axes fraction",
                ha=align,
                va="center",
                fontsize=FONT_SIZE,
                color=text_colour(colours[name]),
                weight="bold",
                annotation_clip=False,
            )
            if not at_border:  # other lines may pass behind it
                text.set_path_effects(HALO)


def spread(positions: Sequence[float], *, gap: float) -> list[float]:
    """Move positions apart, so that neighbours keep their order and a gap; none is below 0."""
    order = np.argsort(-np.array(positions), kind="stable")
    placed = np.array(positions, dtype=float)
    for above, below in pairwise(order):
        placed[below] = min(placed[below], placed[above] - gap)
    placed = np.maximum(placed, 0.0)
    for below, above in pairwise(order[::-1]):
        placed[above] = max(placed[above], placed[below] + gap)
    return list(placed)
