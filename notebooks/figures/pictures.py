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
from kinreach.robots import CameraMount
from kinreach.vision import Intrinsics

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


def places_in_picture(mount: CameraMount, points: ArrayLike, *, width: int, height: int) -> NDArray[np.float64]:
    """Project points of the world [m], shape (n, 3), into the picture of a camera that stands still; return (u, v)."""
    forward = np.subtract(mount.target, mount.position)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, mount.up)
    right /= np.linalg.norm(right)
    axes = np.array([right, np.cross(forward, right), forward])  # x right, y down, z forward
    seen = np.subtract(points, mount.position) @ axes.T
    return Intrinsics.from_fovy(mount.fovy, width, height).project(seen)


def draw_named_places(
    picture: Picture, places: Mapping[str, ArrayLike], *, title: str, offset: float = 0.16, note: str = ""
) -> Figure:
    """Draw a picture with named dots, names in two columns beside them (thesis, figure 2.2).

    Args:
        picture: In colours.
        places: Name -> (u, v) [pixels].
        title: Of the figure.
        offset: From the outermost dot to the names, as a share of the width.
        note: Small print.
    """
    height, width = picture.shape[:2]
    figure, (ax,) = new_figure(title, size=(7.2, 0.5 + 7.2 * height / width), note=note, bare=True)
    ax.imshow(picture, interpolation="antialiased")
    at = {name: np.asarray(place, dtype=float) for name, place in places.items()}
    middle = float(np.mean([u for u, _ in at.values()]))
    gap = 0.085 * height
    for side in (-1.0, 1.0):
        column = {name: place for name, place in at.items() if (place[0] >= middle) == (side > 0)}
        edge = max((side * place[0] for place in column.values()), default=0.0) + offset * width
        ordered = sorted(column, key=lambda name: (round(column[name][1] / gap), side * column[name][0]))
        heights: list[float] = []
        for name in ordered:
            heights.append(max(column[name][1], heights[-1] + gap) if heights else column[name][1])
        up = np.mean([y - column[name][1] for name, y in zip(ordered, heights, strict=True)] or [0.0])
        for name, y in zip(ordered, np.array(heights) - up, strict=True):
            u, v = column[name]
            ax.annotate(
                name, (u, v), (side * edge, y), ha="left" if side > 0 else "right", va="center", fontsize=10.5,
                color=INK, weight="bold", arrowprops={"arrowstyle": "-", "color": INK, "lw": 1.2},
                bbox={"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.85},
            )  # fmt: skip
            ax.plot(u, v, "o", ms=6, mfc="white", mec=INK, mew=1.6)
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
