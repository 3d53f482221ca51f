"""Pictures beside each other, and what the search for the ball makes of one."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import ArrayLike, NDArray

from kinreach.checks import as_array, as_floats, as_vector, check_count, check_number, shown
from kinreach.errors import InputError
from kinreach.plots.checks import MOST_DRAWN, as_drawn, as_limits, check_label, check_mapping, check_names
from kinreach.plots.style import INK, MAGNITUDE, MOST_COLUMNS, PALETTE, new_figure

#: Picture with colours, uint8 (height, width, 3), or one number per pixel, (height, width).
Picture = NDArray[Any]
#: Farther away than any picture's edge [pixels].
MOST_PIXELS = 1e6
#: Of height and width, for a figure that is to be looked at.
MOST_RATIO = 20
#: What a picture shows of a plane: left, right, bottom and top [m].
Extent = tuple[float, float, float, float]


def check_picture(name: str, picture: Picture) -> None:
    """Refuse what cannot be drawn as a picture.

    Raises:
        InputError: Another shape or type, no pixel, or no pixel that is a number.
    """
    array = as_array(name, picture)
    colours = array.ndim == 3 and array.shape[2] == 3 and array.dtype == np.uint8
    wide = array.dtype.kind == "f" and array.dtype.itemsize > 8  # matplotlib takes doubles at most
    if array is not picture or not array.size or not (colours or (array.ndim == 2 and not wide)):
        raise InputError(
            f"{name} must be uint8 of shape (height, width, 3) or numbers of up to 8 bytes of shape (height, width), "
            f"got {array.dtype} {array.shape}"
        )
    if not colours and np.isnan(as_drawn(name, array)).all():
        raise InputError(f"{name} must have a pixel that is a number")


def as_placed(name: str, value: object) -> tuple[Picture, Extent]:
    """A picture and what it shows of a plane.

    Raises:
        InputError: They are none.
    """
    if not isinstance(value, Sequence) or len(value) != 2:
        raise InputError(f"{name} must be pixels and what they show, got {shown(value)}")
    pixels, shows = value
    check_picture(name, pixels)
    left, right, bottom, top = as_vector(f"what {name} shows", shows, 4, most=MOST_DRAWN).tolist()
    return pixels, (*as_limits("left and right", (left, right)), *as_limits("bottom and top", (bottom, top)))


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
        InputError: No picture, one of another shape or type, or a width without room for the columns.
    """
    check_label("title", title)
    check_mapping("pictures", pictures)
    units = {} if units is None else units
    check_mapping("units", units)
    if not pictures:
        raise InputError("expected pictures of shape (height, width) or (height, width, 3)")
    for name, picture in pictures.items():
        check_label("a picture's name", name)
        check_label("a picture's unit", units.get(name, ""))
        check_picture(f"picture {name!r}", picture)
    columns = check_count("columns", columns, most=MOST_COLUMNS)
    width = check_number("width", width, least=float(columns), most=100.0)
    height, across = next(iter(pictures.values())).shape[:2]
    if height > MOST_RATIO * across:
        raise InputError(f"pictures must be at most {MOST_RATIO} times as high as wide, got {height} x {across} pixels")
    rows = -(-len(pictures) // columns)
    each = width / columns - (0.75 / columns if units else 0.1)  # a scale takes its room from the whole column
    size = (width, (0.45 if title else 0.1) + rows * (0.3 + each * height / across))
    figure, axes = new_figure(title, size=size, rows=rows, columns=columns, note=note, bare=True)
    for ax, (name, picture) in zip(axes, pictures.items(), strict=False):
        unit = units.get(name)
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
        InputError: What `draw_pictures` refuses, a circle that is not three finite numbers and of a size, or a zoom
            that is not positive.
    """
    check_mapping("pictures", pictures)
    check_names("marked", marked)
    zoom = check_number("zoom", zoom, least=1e-3, most=1e3)
    found = as_floats("circle", circle)
    if found.shape not in ((3,), (len(pictures), 3)) or not (np.abs(found) < MOST_PIXELS).all():
        raise InputError(f"circle must have shape (3,) or ({len(pictures)}, 3) and be finite, got {shown(circle)}")
    if (found[..., 2] < 1e-3).any():
        raise InputError(f"the radius of a circle must be positive, got {found[..., 2].min():g}")
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
