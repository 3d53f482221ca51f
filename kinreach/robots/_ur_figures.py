"""How the models of Universal Robots without a mesh are drawn: housings of joints, tapered tubes and caps.

A figure is made from the cylinders of a link (`kinreach.robots._ur.link_solids`), each a profile that turns about its
axis, and stays within them. It is drawn and nothing else: collision checks and simulations keep the cylinders.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach._rotations import placement
from kinreach.robots._ur import UR_LENGTHS, link_solids, shape_of
from kinreach.robots._urdf import Solid, numbers

Colour = tuple[float, float, float, float]
#: A corner of a profile: height along the axis, radius, and how round it is [m].
Corner = tuple[float, float, float]

_HOUSING: Colour = (0.52, 0.53, 0.55, 1.0)
_TUBE: Colour = (0.74, 0.75, 0.76, 1.0)
_CAP: Colour = (0.34, 0.52, 0.66, 1.0)
_DARK: Colour = (0.06, 0.06, 0.07, 1.0)
#: Corners around an axis, and of a round edge.
_AROUND, _ROUND = 48, 6
#: An edge is sharp if its sides differ by more [rad].
_SHARP = 0.5
#: Of the radius of a housing: height of the cap, of the groove below it and of the ring where the next link begins;
#: how round the cap and the housing are.
_CAP_HEIGHT, _GROOVE, _RING, _CAP_ROUND, _HOUSING_ROUND = 0.45, 0.05, 0.10, 0.28, 0.10
#: Depth of a groove or ring, of the radius.
_DEPTH = 0.03
#: Length of a cone between two radii, by their difference; of its radius, how thick a tube is at its end, and a collar,
#: which would come out of the flat end of a housing.
_CONE, _TAPER, _COLLAR = 1.5, 0.92, 0.97


class Part(NamedTuple):
    """Triangles of one colour: corners (v, 3) in the link's frame [m], their normals (v, 3), and faces (f, 3)."""

    vertices: Floats
    normals: Floats
    faces: NDArray[np.int64]
    rgba: Colour


class _Cylinder(NamedTuple):
    """Centres of both ends, the one of larger coordinates last, and the radius [m]."""

    start: Floats
    end: Floats
    radius: float


def figure_of(link: ET.Element) -> Sequence[Part] | None:
    """Return how a link is drawn whose visual shapes are the cylinders of a UR; None of any other link."""
    name = link.get("name", "")
    solids = _solids().get((name, *(_as_written(visual) for visual in link.iterfind("visual"))))
    return None if solids is None else tuple(_LINKS[name](*map(_cylinder, solids)))


def _as_written(visual: ET.Element) -> tuple[str, ...]:
    origin, cylinder = visual.find("origin"), visual.find("geometry/cylinder")
    if origin is None or cylinder is None:
        return ()
    return (*(origin.get(key, "") for key in ("xyz", "rpy")), *(cylinder.get(key, "") for key in ("radius", "length")))


@lru_cache(maxsize=1)
def _solids() -> Mapping[tuple[str | tuple[str, ...], ...], tuple[Solid, ...]]:
    """Cylinders of the links of all models, by the link's name and how a URDF writes them."""
    return {
        (link, *((numbers(each.xyz), numbers(each.rpy), *map(repr, each.size)) for each in solids)): solids
        for model, lengths in UR_LENGTHS.items()
        for link, solids in link_solids(shape_of(model), lengths).items()
    }


def _cylinder(solid: Solid) -> _Cylinder:
    radius, length = solid.size
    T = placement(solid.xyz, solid.rpy)
    start, end = sorted((T[:3, 3] + half * T[:3, 2] for half in (-length / 2, length / 2)), key=np.sum)
    return _Cylinder(start, end, radius)


def _base(foot: _Cylinder, body: _Cylinder) -> Iterator[Part]:
    height, top = foot.end[2], body.end[2]
    plate, edge = 0.3 * height, 0.04 * foot.radius
    profile = [(0, 0, 0), (0, foot.radius, edge), (plate, foot.radius, edge), (plate, body.radius, 0.3 * plate)]
    yield _turned([*profile, (top, body.radius, 0), (top, 0, 0)], foot.start, body.end, _HOUSING)


def _shoulder(can: _Cylinder, side: _Cylinder) -> Iterator[Part]:
    yield from _joint(can.start, can.end, can.radius)
    yield _plain(side, _HOUSING)


def _upper_arm(
    tube: _Cylinder, shoulder: _Cylinder, elbow: _Cylinder, near: _Cylinder, far: _Cylinder
) -> Iterator[Part]:
    yield from _joint(shoulder.start, shoulder.end, shoulder.radius)
    yield from _joint(elbow.start, elbow.end, elbow.radius)
    yield from _arm(tube, near, far)


def _forearm(tube: _Cylinder, elbow: _Cylinder, wrist: _Cylinder, near: _Cylinder) -> Iterator[Part]:
    yield _plain(elbow, _HOUSING, closed=True)
    yield from _joint(wrist.end, wrist.start, wrist.radius)
    yield from _arm(tube, near)


def _wrist(can: _Cylinder, stub: _Cylinder) -> Iterator[Part]:
    yield from _joint(can.end, can.start, can.radius)
    yield _plain(stub, _HOUSING)


def _flange(body: _Cylinder) -> Iterator[Part]:
    length, r = float(np.linalg.norm(body.end - body.start)), body.radius
    ring, edge, bore, depth = _RING * r, 0.05 * r, 0.5 * r, 0.1 * r
    rim = 0.7 * length
    yield _ring(body.start, body.end, r, 0.0, ring)
    housing = [(ring, 0, 0), (ring, r, edge), (rim, r, edge), (rim, 0, 0)]
    yield _turned(housing, body.start, body.end, _HOUSING)
    profile = [(rim, 0, 0), (rim, 0.9 * r, 0), (length, 0.9 * r, edge), (length, bore, 0)]
    yield _turned([*profile, (length - depth, bore, 0), (length - depth, 0, 0)], body.start, body.end, _TUBE)


def _arm(tube: _Cylinder, near: _Cylinder, far: _Cylinder | None = None) -> Iterator[Part]:
    """A tube that begins in a collar and ends in another one, or becomes thinner."""
    length, r = float(np.linalg.norm(tube.end - tube.start)), tube.radius
    begins = float(np.linalg.norm(near.end - near.start))
    ends = length - (0.0 if far is None else float(np.linalg.norm(far.end - far.start)))
    thin = _TAPER * r
    profile = [(0, 0, 0), (0, r, 0), (begins, r, 0), (ends, thin, 0), (length, thin, 0), (length, 0, 0)]
    yield _collar(tube.start, tube.end, near.radius, r, begins)
    if far is not None:
        yield _collar(tube.end, tube.start, far.radius, thin, length - ends)
    yield _turned(profile, tube.start, tube.end, _TUBE)


def _collar(start: Floats, end: Floats, radius: float, tube: float, length: float) -> Part:
    radius = max(_COLLAR * radius, tube)
    cone = min(_CONE * (radius - tube), 0.6 * length)
    lip = min(0.1 * tube, radius - tube)
    profile = [(0, 0, 0), (0, radius, 0), (length - cone, radius, 0.3 * cone), (length - lip, tube + lip, 0.2 * cone)]
    return _turned([*profile, (length, tube + lip, 0.3 * lip), (length, 0, 0)], start, end, _HOUSING)


def _joint(open_end: Floats, cap: Floats, radius: float) -> Iterator[Part]:
    """The housing of a joint, with a ring where the next link begins, and a cap."""
    length = float(np.linalg.norm(cap - open_end))
    ring, groove, height = _RING * radius, _GROOVE * radius, _CAP_HEIGHT * radius
    top = length - height - groove
    edge = _HOUSING_ROUND * radius
    yield _ring(open_end, cap, radius, 0.0, ring)
    yield _turned([(ring, 0, 0), (ring, radius, 0.3 * edge), (top, radius, edge), (top, 0, 0)], open_end, cap, _HOUSING)
    yield _ring(open_end, cap, radius, top - edge, length - height + edge)
    profile = [(length - height, 0, 0), (length - height, radius, 0.3 * edge), (length, radius, _CAP_ROUND * radius)]
    yield _turned([*profile, (length, 0, 0)], open_end, cap, _CAP)


def _ring(start: Floats, end: Floats, radius: float, low: float, high: float) -> Part:
    inner = (1.0 - _DEPTH) * radius
    return _turned([(low, 0, 0), (low, inner, 0), (high, inner, 0), (high, 0, 0)], start, end, _DARK)


def _plain(body: _Cylinder, colour: Colour, *, closed: bool = False) -> Part:
    length, r = float(np.linalg.norm(body.end - body.start)), body.radius
    edge = _CAP_ROUND * r if closed else 0.0
    return _turned([(0, 0, 0), (0, r, edge), (length, r, 0), (length, 0, 0)], body.start, body.end, colour)


def _turned(profile: Sequence[Corner], start: Floats, end: Floats, colour: Colour) -> Part:
    """Turn a profile about the axis from `start` to `end`; heights count from `start`."""
    points = _rounded(profile)
    along = np.diff(points, axis=0)
    outward = np.column_stack([-along[:, 1], along[:, 0]])  # height, radius
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    smooth = (outward[1:] * outward[:-1]).sum(axis=1) > np.cos(_SHARP)
    mean = outward[1:] + outward[:-1]
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)
    first, last = outward.copy(), outward.copy()
    first[1:][smooth], last[:-1][smooth] = mean[smooth], mean[smooth]

    axis = (end - start) / np.linalg.norm(end - start)
    across = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    across /= np.linalg.norm(across)
    angles = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    radial = np.outer(np.cos(angles), across) + np.outer(np.sin(angles), np.cross(axis, across))

    def around(heights_and_radii: Floats) -> Floats:
        return heights_and_radii[:, None, :1] * axis + heights_and_radii[:, None, 1:] * radial

    rows = np.stack([points[:-1], points[1:]], axis=1).reshape(-1, 2)
    vertices = start + around(rows)
    normals = around(np.stack([first, last], axis=1).reshape(-1, 2))
    here = np.arange(_AROUND)
    there = np.roll(here, -1)
    faces = []
    for index, (low, high) in enumerate(pairwise(points)):
        below, above = 2 * index * _AROUND, (2 * index + 1) * _AROUND
        if low[1] > 0:
            faces.append(np.column_stack([below + here, below + there, above + there]))
        if high[1] > 0:
            faces.append(np.column_stack([below + here, above + there, above + here]))
    return Part(vertices.reshape(-1, 3), normals.reshape(-1, 3), np.concatenate(faces), colour)


def _rounded(profile: Sequence[Corner]) -> Floats:
    """Return the points of a profile, shape (n, 2), its corners as arcs."""
    corners = np.array(profile, dtype=float)
    points = [corners[0, :2]]
    for before, (*corner, radius), after in zip(corners[:-2, :2], corners[1:-1], corners[2:, :2], strict=True):
        here = np.array(corner)
        back, ahead = before - here, after - here
        most = 0.5 * min(np.linalg.norm(back), np.linalg.norm(ahead))
        back, ahead = (each / max(float(np.linalg.norm(each)), 1e-12) for each in (back, ahead))
        if radius <= 0.0 or most <= 0.0 or np.linalg.norm(back + ahead) < 1e-6:
            points.append(here)
            continue
        half = 0.5 * np.arccos(np.clip(back @ ahead, -1.0, 1.0))
        reach = min(radius / np.tan(half), most)
        radius = reach * np.tan(half)
        centre = here + (back + ahead) / np.linalg.norm(back + ahead) * radius / np.sin(half)
        spokes = here + reach * back - centre, here + reach * ahead - centre
        turn = np.pi - 2.0 * half
        for share in np.linspace(0.0, 1.0, _ROUND):
            weights = np.sin((1.0 - share) * turn), np.sin(share * turn)
            points.append(centre + (weights[0] * spokes[0] + weights[1] * spokes[1]) / np.sin(turn))
    points.append(corners[-1, :2])
    kept = [points[0], *(b for a, b in pairwise(points) if np.linalg.norm(b - a) > 1e-9)]
    return np.array(kept)


_LINKS: Mapping[str, Callable[..., Iterator[Part]]] = {
    "base_link": _base,
    "shoulder_link": _shoulder,
    "upper_arm_link": _upper_arm,
    "forearm_link": _forearm,
    "wrist_1_link": _wrist,
    "wrist_2_link": _wrist,
    "wrist_3_link": _flange,
}
