"""Maps of errors over the table, as filled cells."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import LogLocator
from numpy.typing import ArrayLike, NDArray

from kinreach.plots._colours import PALETTE
from kinreach.plots._style import FAINT, INK, MAGNITUDE, name_label, new_figure, plain, plain_ticks

#: Bounds of x and y [m].
Area = tuple[tuple[float, float], tuple[float, float]]
Floats = NDArray[np.float64]

#: Cells across the longer side of a map whose positions are not a grid.
_RASTER = 160
#: A goal colours places within this distance [m].
_REACH = 0.15
#: Of cells without a value.
_MISSING = "#d0d0d0"


def draw_error_maps(
    maps: Mapping[str, tuple[ArrayLike, ArrayLike]],
    *,
    title: str,
    label: str = "error [mm]",
    limits: tuple[float, float] | None = None,
    missing: str = "not found",
    area: Area | None = None,
    columns: int = 2,
    note: str = "",
) -> Figure:
    """Draw errors of goals on the table, a panel for each method, camera or pipeline, on one logarithmic scale.

    Positions that form a grid are its cells. Others are dots, and each place has the colour of the nearest of them.

    Args:
        maps: Panel -> positions (x, y) in the world [m], shape (n, 2), and their errors, shape (n,). NaN is drawn as a
            grey cell with a cross.
        title: Of the figure.
        label: Name and unit of the error.
        limits: Ends of the scale; by default the smallest and the largest error. Errors beyond have the colour of the
            end, but count as they are in the numbers above the panel.
        missing: Meaning of a cross.
        area: Rectangle to outline, such as where goals are drawn from.
        columns: Panels beside each other.
        note: Small print.
    """
    panels = {name: (np.asarray(xy), np.asarray(errors)) for name, (xy, errors) in maps.items()}
    measured = np.concatenate([errors for _, errors in panels.values()])
    positive = measured[measured > 0]
    low, high = limits or ((positive.min(), positive.max()) if positive.size else (1.0, 10.0))
    norm = LogNorm(low, high if high > low else 1.01 * low)
    columns = min(columns, len(panels))
    rows = -(-len(panels) // columns)
    spans = np.ptp(np.concatenate([xy for xy, _ in panels.values()]), axis=0)
    width = 4.3 if columns < 3 else 3.4
    height = 0.75 + (width - 0.7) * float(np.clip(spans[0] / max(spans[1], 1e-9), 0.3, 1.2))
    figure, axes = new_figure(
        title, size=(width * columns + 0.8, 0.8 + height * rows), rows=rows, columns=columns, note=note, grid="none"
    )
    drawn: Any = None
    for ax, (name, (xy, errors)) in zip(axes, panels.items(), strict=False):
        drawn = _cells(ax, xy, errors, low, norm)
        gone = ~np.isfinite(errors)
        crosses = float(np.clip(6e3 / len(errors), 6, 30))
        ax.scatter(xy[gone, 1], xy[gone, 0], s=crosses, color=PALETTE[1], marker="x", lw=1.2)
        if area is not None:
            outline(ax, area, colour=INK, halo=True)
        missed = f" · {gone.sum()} {missing} (×)" if gone.any() else ""
        numbers = "none"
        if (~gone).any():
            median, largest = (plain(float(f"{v:.2g}")) for v in (np.median(errors[~gone]), errors[~gone].max()))
            numbers = f"median {median}, max {largest}"
        ax.set_title(name_label(name), loc="left", fontsize=10, weight="bold", color=INK, pad=18)
        ax.annotate(numbers + missed, (0, 1.025), xycoords="axes fraction", fontsize=8.5, color=FAINT)
    for ax in axes[len(panels) :]:
        ax.set_axis_off()
    bar = figure.colorbar(drawn, ax=axes, label=label, shrink=0.8, aspect=30, extend="both" if limits else "neither")
    bar.outline.set_visible(False)
    bar.ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 100 * low else (1.0,)))
    plain_ticks(bar.ax.yaxis)
    bar.ax.tick_params(which="both", labelsize=9)
    return figure


def _cells(axes: Axes, xy: Floats, errors: Floats, low: float, norm: LogNorm) -> Any:
    """Fill the panel with the errors; positions of a grid are its cells."""
    xs, ys = (np.unique(np.round(xy[:, axis], 9)) for axis in (0, 1))
    shown = np.where(np.isfinite(errors), np.maximum(errors, low), np.nan)
    axes.set_facecolor("white")
    if len(xs) * len(ys) == len(xy) and min(len(xs), len(ys)) > 1:
        grid = np.full((len(xs), len(ys)), np.nan)
        grid[np.searchsorted(xs, np.round(xy[:, 0], 9)), np.searchsorted(ys, np.round(xy[:, 1], 9))] = shown
        margin = max(xs[1] - xs[0], ys[1] - ys[0]) / 2
        x, y, filled, inside = xs, ys, grid, np.ones(grid.shape, dtype=np.bool_)
    else:
        from scipy.spatial import cKDTree  # a third of a second to import

        span = np.maximum(np.ptp(xy, axis=0), 1e-3)
        spacing = float(np.sqrt(span.prod() / len(xy)))
        margin = min(0.5 * spacing, 0.05)
        (x, y) = (
            np.linspace(low_ - margin, high_ + margin, max(8, round(_RASTER * side / span.max())))
            for low_, high_, side in zip(xy.min(axis=0), xy.max(axis=0), span, strict=True)
        )
        places = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
        away, nearest = cKDTree(xy).query(places.reshape(-1, 2))
        inside = (away <= min(1.6 * spacing, _REACH)).reshape(len(x), len(y))
        filled = np.where(inside, shown[nearest].reshape(len(x), len(y)), np.nan)
        axes.plot(xy[:, 1], xy[:, 0], ".", ms=2.0, color="black", alpha=0.5, zorder=3)
        margin = 0.0
    view_from_the_robot(axes, x, y, margin=margin)
    grey = np.where(inside & ~np.isfinite(filled), 1.0, np.nan)
    axes.pcolormesh(y, x, grey, cmap=ListedColormap([_MISSING]), shading="nearest", rasterized=True)
    return axes.pcolormesh(y, x, filled, cmap=MAGNITUDE, norm=norm, shading="nearest", rasterized=True)


def outline(axes: Axes, area: Area, *, colour: str, halo: bool = False) -> None:
    """Draw the border of an area, dashed; with a halo it can be seen on any colour."""
    (x0, x1), (y0, y1) = area
    for ec, lw, ls in ((("white", 3.6, "-"),) if halo else ()) + ((colour, 1.2, "--"),):
        axes.add_patch(Rectangle((y0, x0), y1 - y0, x1 - x0, fill=False, ec=ec, lw=lw, ls=ls))


def view_from_the_robot(axes: Axes, x: Floats, y: Floats, *, margin: float = 0.0) -> None:
    """Show world x up and y to the left, as the robot at the lower edge sees the table; equal scales."""
    axes.set(
        xlim=(y.max() + margin, y.min() - margin), ylim=(x.min() - margin, x.max() + margin), aspect="equal",
        xlabel="y [m]", ylabel="x [m]",
    )  # fmt: skip
    axes.spines["bottom"].set_visible(False)
