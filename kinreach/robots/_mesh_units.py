"""Meshes in millimetres, told by their size beside the arm's.

A URDF has no unit for a mesh but its `scale`, and exporters often write millimetres. No link is ten times as long as
its arm: such a mesh is scaled where that makes it fit, and left out where it does not.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kinreach._checks import Floats, shown
from kinreach._files import open_input, read_bytes
from kinreach.errors import InputError
from kinreach.robots._meshes import MAX_BYTES, placed_parts
from kinreach.robots._urdf import joints_above, numbers, origin_of, way_down
from kinreach.robots._urdf_repair import Notes

#: From so many lengths of the arm on, a mesh is not in metres; up to so many it may be a link's.
FAR, FITS = 10.0, 2.0
#: Arms of other lengths than these are not compared with [m].
SHORTEST, LONGEST = 0.05, 50.0
MILLIMETRE = 1e-3
#: A COLLADA file of more bytes takes long to read; its unit is within the first ones.
SLOW, ASSET = 2**20, 2**12
#: Bytes of an STL file before its triangles, and of each triangle.
_HEAD, _TRIANGLE = 84, 50
_VERTEX = re.compile(rb"^[ \t]*(?:vertex|v)[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)", re.MULTILINE)
_ARRAY = re.compile(rb"<float_array\b([^<>]*)>([^<]*)<")
#: Parts of the names of arrays that are not positions.
_NO_POSITIONS = re.compile(rb"normal|map|tex|colou?r|uv|weight|matri|bind", re.IGNORECASE)
_UNIT = re.compile(rb"""<unit\b[^<>]*\bmeter[ \t]*=[ \t]*["']([^"'<>]*)["']""")


@dataclass(frozen=True, eq=False)
class _Placed:
    """A mesh of a link.

    Attributes:
        length: Its longest side [m], as the URDF scales it.
        unit: Metres per unit of the file, if it is not in metres.
        moved: Whether a joint moves its link.
    """

    link: ET.Element
    shape: ET.Element
    mesh: ET.Element
    address: str
    length: float
    unit: float
    moved: bool

    def fits(self, arm: float) -> bool:
        return self.length * self.unit <= FITS * arm


def arm_length(robot: ET.Element) -> float:
    """Return the longest way from the root to a link, joint by joint [m]."""
    above = joints_above(robot)
    lengths = {joint: float(np.linalg.norm(origin_of(joint)[:3, 3])) for joint in above.values()}
    return max((sum(lengths[joint] for joint in way_down(above, link)) for link in above), default=0.0)


def scale_to_metres(robot: ET.Element, places: Mapping[ET.Element, Path]) -> tuple[list[str], str]:
    """Scale the meshes of a URDF that are in millimetres, and leave out those that cannot be a link's, in place.

    Args:
        robot: The URDF, before joints are held.
        places: The file of each of its meshes.

    Returns:
        Notes, a line each; and why collision shapes are missing, or "".
    """
    arm = arm_length(robot)
    if arm > LONGEST:
        return [f"the arm is {arm:.0f} m long; URDFs are in metres, and its lengths may be millimetres"], ""
    if not places or arm < SHORTEST:
        return [], ""
    every = list(_measured(robot, places, FITS * arm))
    far = [placed for placed in every if placed.length > FAR * arm]
    certain = any(placed.moved and placed.fits(arm) for placed in far)
    every += _measured(robot, places, FITS * arm, slow=True) if certain else []
    notes, missing = Notes(), ""
    for placed in every if certain else far:
        name = placed.link.get("name", "")
        times = f"{placed.length / arm:.0f} times as long as the arm"
        if certain and placed.fits(arm):
            scale = np.array([float(word) for word in placed.mesh.get("scale", "1 1 1").split()])
            placed.mesh.set("scale", numbers((placed.unit * scale).tolist()))
            unit = "millimetres" if placed.unit == MILLIMETRE else f"units of {placed.unit:g} m"
            notes.add(f"meshes in {unit} are scaled to metres", "link", name)
        elif placed.moved and placed.length > FAR * arm:
            placed.link.remove(placed.shape)
            if placed.shape.tag == "collision":
                missing = missing or (
                    f"the collision mesh {shown(placed.address)} of link {shown(name)} is {placed.length:.3g} m long, "
                    f"{times}; scale= of its <mesh> is metres per unit of the file"
                )
            else:
                notes.add(f"a visual mesh {times} is left out", "link", name)
        elif placed.length > FAR * arm:
            notes.add(f"a mesh is {times}; if it is in millimetres, its <mesh> needs scale", "link", name)
    return notes.lines, missing


def _measured(
    robot: ET.Element, places: Mapping[ET.Element, Path], longer: float, *, slow: bool = False
) -> Iterator[_Placed]:
    """Measure the meshes that are longer than this [m], those that are only drawn and `slow` to read for themselves."""
    above = joints_above(robot)
    moved = {link for link in above if any(joint.get("type") != "fixed" for joint in way_down(above, link))}
    lengths: dict[tuple[Path, tuple[float, ...]], tuple[float, float]] = {}
    for link in robot.findall("link"):
        for shape in [child for child in link if child.tag in ("visual", "collision")]:
            for mesh in shape.iter("mesh"):
                path = places.get(mesh)
                if path is None or (shape.tag == "visual" and _is_slow(path)) is not slow:
                    continue
                scale = tuple(float(word) for word in mesh.get("scale", "1 1 1").split())
                if (path, scale) not in lengths:
                    lengths[path, scale] = _length(path, np.abs(scale), longer)
                length, unit = lengths[path, scale]
                if length > longer:
                    yield _Placed(link, shape, mesh, mesh.get("filename", ""), length, unit, link.get("name") in moved)


def _is_slow(path: Path) -> bool:
    """Whether a mesh takes long to measure, and is no COLLADA file that says that it has another unit than metres."""
    try:
        if path.suffix.lower() != ".dae" or path.stat().st_size <= SLOW:
            return False
        with open_input(path, "the mesh", most=path.stat().st_size) as file:
            return _unit_of(file.read(ASSET)) == 1.0
    except (OSError, InputError):
        return False


def _unit_of(content: bytes) -> float:
    """Metres per unit, as a COLLADA file names it; Pinocchio and trimesh leave that alone, and RViz does not."""
    found = _UNIT.search(content)
    try:
        return 1.0 if found is None else float(found[1])
    except ValueError:
        return 1.0


def _length(path: Path, scale: Floats, longer: float) -> tuple[float, float]:
    """Longest side of a mesh [m], 0 where it cannot be measured; and metres per unit if it is not in metres."""
    try:
        content = read_bytes(path, "the mesh", most=MAX_BYTES)
    except InputError:  # who uses it says so
        return 0.0, MILLIMETRE
    if path.suffix.lower() == ".glb":  # which is in metres
        return 0.0, 1.0
    with np.errstate(all="ignore"):
        if path.suffix.lower() == ".dae":
            return _length_of_collada(path, content, scale, longer)
        vertices = _vertices(path, content)
        length = float((np.ptp(vertices, axis=0) * scale).max()) if len(vertices) else 0.0
    return (length if np.isfinite(length) else 0.0), MILLIMETRE


def _vertices(path: Path, content: bytes) -> Floats:
    """Corners of an STL or OBJ file, shape (v, 3)."""
    count = int.from_bytes(content[80:_HEAD], "little")
    if path.suffix.lower() == ".stl" and len(content) == _HEAD + _TRIANGLE * count:
        triangle = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        return np.frombuffer(content, triangle, offset=_HEAD)["corners"].reshape(-1, 3).astype(np.float64)
    try:
        return np.array(_VERTEX.findall(content), dtype=np.float64).reshape(-1, 3)
    except ValueError:
        return np.empty((0, 3))


def _length_of_collada(path: Path, content: bytes, scale: Floats, longer: float) -> tuple[float, float]:
    """As `_length`, for a COLLADA file."""
    unit = _unit_of(content)
    unit = unit if 0.0 < unit < 1.0 else MILLIMETRE
    try:
        arrays = [words.split() for about, words in _ARRAY.findall(content) if not _NO_POSITIONS.search(about)]
        largest = max(
            (float(np.abs(np.array(words, dtype=np.float64)).max(initial=0.0)) for words in arrays), default=0.0
        )
        if not largest * float(scale.max()) > 0.5 * longer:
            return 0.0, unit
        parts = placed_parts(path.name, str(path.parent), scale * MILLIMETRE)
    except (InputError, ValueError):
        return 0.0, unit
    corners = np.concatenate([part.vertices @ T[:3, :3].T + T[:3, 3] for part, T in parts])
    return float((np.ptp(corners, axis=0) * scale).max()), unit
