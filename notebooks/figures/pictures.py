"""Camera pictures beside each other, and the steps of the search for the ball."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import ArrayLike, NDArray

from kinreach.plots import INK, PALETTE, new_figure

#: In colours, uint8 (height, width, 3), or with one number for each pixel, (height, width).
Picture = NDArray[Any]


def draw_pictures(
    pictures: Mapping[str, Picture],
    *,
    title: str = "",
    columns: int = 2,
    width: float = 9.0,
    units: Mapping[str, str] | None = None,
    note: str = "",
) -> Figure:
    """Draw pictures of one size under their names, row by row.

    Args:
        pictures: Name -> picture. One with a number for each pixel is grey, from the smallest to the largest number;
            with a unit it has a colour bar.
        title: Of the figure.
        columns: Pictures beside each other.
        width: Of the figure [inches].
        units: Name -> unit of the picture's numbers, such as `"depth [m]"`.
        note: Small print.
    """
    units = units or {}
    height, across = next(iter(pictures.values())).shape[:2]
    rows = -(-len(pictures) // columns)
    each = width / columns - (0.75 / columns if units else 0.1)  # a colour bar takes its room from the whole column
    size = (width, (0.45 if title else 0.1) + rows * (0.3 + each * height / across))
    figure, axes = new_figure(title, size=size, rows=rows, columns=columns, note=note, bare=True)
    for ax, (name, picture) in zip(axes, pictures.items(), strict=False):
        unit = units.get(name)
        drawn = ax.imshow(picture, cmap="cividis" if unit else "gray", interpolation="antialiased")
        ax.set_title(name, loc="left", fontsize=9.5, weight="bold", color=INK)
        if unit:
            bar = figure.colorbar(drawn, ax=ax, label=unit, shrink=0.8, aspect=25, pad=0.01)
            bar.outline.set_visible(False)
            bar.ax.tick_params(labelsize=8)
    return figure


def draw_camera_steps(
    pictures: Mapping[str, Picture],
    circle: ArrayLike,
    *,
    marked: Collection[str] = (),
    title: str,
    units: Mapping[str, str] | None = None,
    zoom: float = 3.0,
    note: str = "",
) -> Figure:
    """Draw the steps from a camera's picture to the ball, each with the ball enlarged (thesis 2.2, figure 3.1).

    Args:
        pictures: Step -> picture, as for `draw_pictures`.
        circle: The circle that was found, centre (u, v) and radius [pixels], shape (3,); or one for each picture,
            shape (n, 3).
        marked: Pictures into which the circle is drawn.
        title: Of the figure.
        units: As for `draw_pictures`.
        zoom: Radii to either side of the circle's centre that are enlarged.
        note: Small print.
    """
    circles = np.broadcast_to(circle, (len(pictures), 3))
    figure = draw_pictures(pictures, title=title, units=units, note=note)
    for ax, (name, picture), (u, v, r) in zip(figure.axes, pictures.items(), circles, strict=False):
        height, width = picture.shape[:2]
        side = 0.5  # of the picture's height, in the corner that is farther from the ball
        left = 0.015 if u > width / 2 else 0.985 - side * height / width
        inset = ax.inset_axes((left, 0.03, side * height / width, side))
        inset.imshow(picture, cmap=ax.images[0].cmap, vmin=picture.min(), vmax=picture.max(), interpolation="nearest")
        inset.set(xlim=(u - zoom * r, u + zoom * r), ylim=(v + zoom * r, v - zoom * r), xticks=[], yticks=[])
        for line in ax.indicate_inset_zoom(inset, edgecolor=PALETTE[4], alpha=1.0).connectors or ():
            line.set_visible(False)
        inset.spines[:].set_color(PALETTE[4])
        if name in marked:
            _mark_circle(ax, (u, v, r), width=1.2)
            _mark_circle(inset, (u, v, r), width=2.0)
    return figure


def _mark_circle(axes: Axes, circle: tuple[float, float, float], *, width: float) -> None:
    """Draw a circle (u, v, r) and its centre, visible on any background."""
    u, v, r = circle
    axes.add_patch(Circle((u, v), r, fill=False, color="white", lw=2.2 * width))
    axes.add_patch(Circle((u, v), r, fill=False, color=PALETTE[0], lw=width))
    axes.plot(u, v, "+", color="white", ms=5 * width, mew=width)
