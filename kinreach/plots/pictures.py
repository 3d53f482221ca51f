"""Pictures beside each other, and what the search for the ball makes of one."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import ArrayLike, NDArray

from kinreach.errors import InputError
from kinreach.kinematics.goals import as_floats
from kinreach.plots.style import INK, MAGNITUDE, PALETTE, new_figure

#: Picture with colours, uint8 (height, width, 3), or one number per pixel, (height, width).
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
    """Pictures of one size under their names, row by row.

    Args:
        pictures: By name; those with one number per pixel are grey, from the smallest to the largest number, or with
            a unit in the colours of a scale beside them.
        title: Of the figure.
        columns: Pictures beside each other.
        width: Of the figure [inches].
        units: What the numbers of a picture are, by its name, such as `"depth [m]"`.
        note: Small print.

    Raises:
        InputError: No picture, or one that has neither two nor three dimensions.
    """
    if not pictures or any(np.ndim(picture) not in (2, 3) for picture in pictures.values()):
        raise InputError("expected pictures of shape (height, width) or (height, width, 3)")
    height, across = next(iter(pictures.values())).shape[:2]
    rows = -(-len(pictures) // columns)
    each = width / columns - (0.75 / columns if units else 0.1)  # a scale takes its room from the whole column
    size = (width, (0.45 if title else 0.1) + rows * (0.3 + each * height / across))
    figure, axes = new_figure(title, size=size, rows=rows, columns=columns, note=note, bare=True)
    for ax, (name, picture) in zip(axes, pictures.items(), strict=False):
        unit = (units or {}).get(name)
        drawn = ax.imshow(picture, cmap=MAGNITUDE if unit else "gray", interpolation="antialiased")
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
    """The steps from a camera's picture to the ball, each with the ball enlarged in a corner (thesis 2.2, figure 3.1).

    Args:
        pictures: Of each step by its name, as for `draw_pictures`, all of one size.
        circle: That was found, centre (u, v) and radius [pixels], shape (3,); or one for each picture, shape (n, 3).
        marked: Names of the pictures into which the circle is drawn.
        title: Of the figure.
        units: As for `draw_pictures`.
        zoom: Radii to either side of the circle's centre that are shown enlarged.
        note: Small print.

    Raises:
        InputError: What `draw_pictures` refuses, or a circle that is not three finite numbers.
    """
    found = as_floats("circle", circle)
    if found.shape not in ((3,), (len(pictures), 3)) or not np.isfinite(found).all():
        raise InputError(f"circle must have shape (3,) or ({len(pictures)}, 3) and be finite, got {found}")
    circles = np.broadcast_to(found, (len(pictures), 3))
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
    """Draw a circle (u, v, r) and its centre, to be seen on any ground."""
    u, v, r = circle
    axes.add_patch(Circle((u, v), r, fill=False, color="white", lw=2.2 * width))
    axes.add_patch(Circle((u, v), r, fill=False, color=PALETTE[0], lw=width))
    axes.plot(u, v, "+", color="white", ms=5 * width, mew=width)
