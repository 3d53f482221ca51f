"""The common style of the figures: palette, empty axes, labels of ticks, names beside their data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from textwrap import fill
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from kinreach.plots.checks import check_label

PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8C6D31")
INK, FAINT, GRID = "#222222", "#6b6b6b", "#e4e4e4"
#: Colour map of magnitudes: even in lightness, and the same to colour-blind readers.
MAGNITUDE = "cividis"
Grid = Literal["x", "y", "both", "none"]
#: Dots per inch where nothing else is asked for, as in notebooks.
DPI = 100
#: Panels beside each other that a figure has room for.
MOST_COLUMNS = 32
#: Characters of a name that a figure has room for.
LONGEST_NAME = 40


def new_figure(
    title: str,
    *,
    size: tuple[float, float],
    rows: int = 1,
    columns: int = 1,
    widths: Sequence[float] | None = None,
    note: str = "",
    grid: Grid = "both",
    bare: bool = False,
) -> tuple[Figure, list[Axes]]:
    """A figure with empty axes in the common style.

    Args:
        title: At the top left; none if empty.
        size: Width and height [inches].
        rows: Of axes; they come back row by row.
        columns: Of axes.
        widths: Of the columns, in proportion to each other; equal by default.
        note: Small print at the bottom: where the data comes from.
        grid: `"x"`, `"y"`, `"both"` or `"none"`.
        bare: Hide axes and ticks: for pictures.

    Raises:
        InputError: A title or a note that is no text, or in which a formula is wrong.
    """
    check_label("title", title)
    check_label("note", note)
    figure = Figure(figsize=size, dpi=DPI, layout="constrained")
    if title:
        figure.suptitle(title, x=0.01, ha="left", fontsize=13, weight="bold", color=INK)
    if note:
        text = fill(note, width=round(16 * size[0]))
        figure.supxlabel(text, x=0.01, ha="left", fontsize=7, color=FAINT)
    axes = list(figure.subplots(rows, columns, squeeze=False, width_ratios=widths).ravel())
    for ax in axes:
        if bare:
            ax.set_axis_off()
            continue
        style_axes(ax, grid=grid)
    return figure, axes


def style_axes(axes: Axes, *, grid: Grid = "both") -> None:
    """Bring empty axes into the common style.

    Args:
        axes: The axes.
        grid: As of `new_figure`.
    """
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.spines["bottom"].set_color(FAINT)
    axes.tick_params(colors=INK, length=0, labelsize=9)
    axes.set_axisbelow(True)
    if grid != "none":
        axes.grid(axis=grid, color=GRID, lw=0.8)


def key(axes: Axes, text: str) -> None:
    """Say above the axes, at the left, what is drawn."""
    axes.set_title(text, loc="left", fontsize=8.5, color=FAINT)


def plain(value: float, _: int | None = None) -> str:
    """A label of a log axis: a plain number as long as that is short, else a power of ten."""
    power = f"$10^{{{round(np.log10(value))}}}$" if value > 0 else ""
    return power if power and not 1e-3 <= value < 1e4 and np.isclose(np.log10(value) % 1, 0) else f"{value:g}"


def verbatim(text: str) -> str:
    """Text to be drawn as it stands: its dollar signs begin no formula."""
    return text.replace("$", r"\$")


def name_label(name: str) -> str:
    """A name beside its data: as it stands, but no longer than there is room for."""
    return verbatim(name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 1]}…")


def colours_of(names: Iterable[str]) -> dict[str, str]:
    """A colour for each name, in the order of the palette."""
    return {name: PALETTE[index % len(PALETTE)] for index, name in enumerate(names)}


def label_ends(axes: Axes, ends: Mapping[str, ArrayLike], colours: Mapping[str, str], *, side: str = "right") -> None:
    """Write names beside the ends of lines, moved apart where they would overlap.

    The limits of the axes must be set.

    Args:
        axes: Where the lines are.
        ends: Where each line ends, (x, y) in data coordinates.
        colours: Of the names.
        side: `"right"` or `"left"`: which ends these are.
    """
    to_axes = axes.transData + axes.transAxes.inverted()
    heights = [float(to_axes.transform(np.asarray(end, dtype=float))[1]) for end in ends.values()]
    x, align = (1.03, "left") if side == "right" else (-0.03, "right")
    for (name, end), height in zip(ends.items(), spread(heights, gap=0.062), strict=True):
        axes.annotate(
            name_label(name),
            tuple(np.asarray(end, dtype=float)),
            xytext=(x, height),
            textcoords="axes fraction",
            ha=align,
            va="center",
            fontsize=9,
            color=colours[name],
            weight="bold",
            annotation_clip=False,
            arrowprops={
                "arrowstyle": "-", "color": colours[name], "lw": 0.8, "relpos": (float(side == "left"), 0.5),
                "shrinkA": 0, "shrinkB": 0,
            },
        )  # fmt: skip


def spread(positions: Sequence[float], *, gap: float) -> list[float]:
    """Positions from 0 up, moved apart so that neighbours keep their order and a gap."""
    order = np.argsort(-np.array(positions), kind="stable")
    placed = np.array(positions, dtype=float)
    for above, below in pairwise(order):
        placed[below] = min(placed[below], placed[above] - gap)
    placed = np.maximum(placed, 0.0)
    for below, above in pairwise(order[::-1]):
        placed[above] = max(placed[above], placed[below] + gap)
    return list(placed)
