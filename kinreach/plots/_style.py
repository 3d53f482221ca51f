"""The style of the figures: palette, a colour for each method, empty axes, tick labels, names beside their data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import cycle, pairwise
from textwrap import fill
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.typing import ArrayLike

PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8C6D31")
#: Method or recipe -> its colour in every figure. Two names of one method have the same colour.
METHOD_COLOURS = {
    **dict.fromkeys(("closed-form", "closed form", "analytic"), "#003F66"),
    "placo": "#0072B2",
    "lm": "#56B4E9",
    "qp": "#8CCBEB",
    "hybrid": "#CC79A7",
    "random": "#7A7A7A",
    **dict.fromkeys(("ppo-single", "ppo", "button"), "#D55E00"),
    "ppo-multi": "#F2A35E",
    "ppo-multi-ending": "#6A3D9A",
    **dict.fromkeys(("single", "ranked-single", "space-single", "panda-single"), "#00674C"),
    **dict.fromkeys(("multi", "ranked-multi"), "#2FBF94"),
    **dict.fromkeys(("thesis-single", "thesis-ppo-single", "thesis-multi"), "#000000"),
    **dict.fromkeys(("sb3-single", "sb3-multi", "sb3-multi-long"), "#E69F00"),
    **dict.fromkeys(("sac-single", "sac-multi"), "#0072B2"),
    **dict.fromkeys(("td3-single", "td3-multi"), "#CC79A7"),
    **dict.fromkeys(("ddpg-single", "ddpg-multi"), "#009E73"),
    **dict.fromkeys(("button-dqn", "button-dqn-report-actuation"), "#009E73"),
    **dict.fromkeys(("button-report", "button-report-actuation"), "#0072B2"),
    "button-report-both": "#CC79A7",
    "button-report-controls": "#E69F00",
    "button-report-frames": "#56B4E9",
    "button-guided-controls": "#000000",
}
INK = "#222222"
FAINT = "#6b6b6b"
GRID = "#e4e4e4"
#: Colour map of magnitudes: uniform in lightness, and the same for colour-blind readers.
MAGNITUDE = "cividis"
Grid = Literal["x", "y", "both", "none"]
#: A line that ends nearer to the border of the axes is named beside them, as a share of their width.
BORDER = 0.15
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
    grid: Grid = "both",
    bare: bool = False,
) -> tuple[Figure, list[Axes]]:
    """Make a figure with empty axes in the common style.

    Args:
        title: At the top left; none if empty. Dollar signs enclose formulas: pass names through `name_label`.
        size: Width and height [inches].
        rows: Of axes, which are returned row by row.
        columns: Of axes.
        widths: Of the columns, relative to each other; equal by default.
        note: Small print at the bottom, such as the source of the data; dollar signs as in `title`.
        grid: `"x"`, `"y"`, `"both"` or `"none"`.
        bare: Hide axes and ticks, as for pictures.
    """
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


def verbatim(text: str) -> str:
    """Escape dollar signs, so that matplotlib reads no formula in the text."""
    return text.replace("$", r"\$")


def name_label(name: str) -> str:
    """Escape a name that is written beside its data, and shorten it to `MAX_NAME_LENGTH`."""
    return verbatim(name if len(name) <= MAX_NAME_LENGTH else f"{name[: MAX_NAME_LENGTH - 1]}…")


def colours_of(names: Iterable[str]) -> dict[str, str]:
    """Choose a colour for each name: a method's own, and for other names the unused ones of the palette, in its order.

    The part of a name after a comma, such as the seed, is ignored.
    """
    found = {name: METHOD_COLOURS.get(name.partition(",")[0], "") for name in names}
    others = cycle([colour for colour in PALETTE if colour not in found.values()] or PALETTE)
    return {name: colour or next(others) for name, colour in found.items()}


def label_ends(axes: Axes, ends: Mapping[str, ArrayLike], colours: Mapping[str, str], *, side: str = "right") -> None:
    """Write names at the ends of lines, moved apart where they would overlap.

    A line that ends inside the axes is named there. The other names form a column beside the axes. A stroke leads to a
    name that was moved; it starts at the border of the axes, so that it cannot be taken for data. Set the limits of the
    axes first.

    Args:
        axes: The axes with the lines.
        ends: Name -> end of its line, (x, y) in data coordinates.
        colours: Of the names.
        side: Side of the ends, `"right"` or `"left"`.
    """
    to_axes = axes.transData + axes.transAxes.inverted()
    places = {name: to_axes.transform(np.asarray(end, dtype=float)) for name, end in ends.items()}
    edge, beside, align = (1.0, 1.03, "left") if side == "right" else (0.0, -0.03, "right")
    column = {name: place for name, place in places.items() if abs(place[0] - edge) <= BORDER}
    for at_border, group in ((True, column), (False, {n: place for n, place in places.items() if n not in column})):
        heights = spread([float(y) for _, y in group.values()], gap=0.062)
        for (name, (x, y)), height in zip(group.items(), heights, strict=True):
            moved = at_border and abs(height - y) > 0.01
            text = axes.annotate(
                name_label(name),
                (edge, min(max(float(y), 0.0), 1.0)),
                xycoords="axes fraction",
                xytext=(beside if at_border else float(x) + beside - edge, height),
                textcoords="axes fraction",
                ha=align,
                va="center",
                fontsize=9,
                color=colours[name],
                weight="bold",
                annotation_clip=False,
                arrowprops={
                    "arrowstyle": "-", "color": colours[name], "lw": 0.8, "relpos": (float(side == "left"), 0.5),
                    "shrinkA": 0, "shrinkB": 2,
                } if moved else None,
            )  # fmt: skip
            if not at_border:  # other lines may pass behind it
                text.set_path_effects([withStroke(linewidth=2.5, foreground="white")])


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
