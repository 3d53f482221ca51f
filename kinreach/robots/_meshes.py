"""Mesh files, read and checked before an engine uses them.

Engines open no mesh themselves: a vertex that is not finite, or a hull without thickness, crashes them.
"""

from __future__ import annotations

import io
import json
from collections import Counter, defaultdict
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, NamedTuple, NoReturn
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats, shown
from kinreach._files import read_bytes
from kinreach.errors import InputError
from kinreach.robots._urdf import MESHES, PACKAGE

#: What collision checks use of a mesh.
MESHES_AS = (HULLS, TRIANGLES) = ("hulls", "triangles")
#: Largest file [bytes], largest coordinate after scaling [m], and most triangles of a file.
MAX_BYTES, MAX_COORDINATE, MAX_FACES = 2**26, 100.0, 2_000_000
#: Most shapes that the scene of a COLLADA file or a GLB places.
MAX_PLACED = 10_000
#: Meshes that are kept in memory.
MAX_KEPT = 64
#: Least thickness of a collision mesh, such as a plate without any [m].
MIN_THICKNESS = 1e-4
#: A mesh whose points are this near to one line has no surface [m].
LINE = 1e-6


#: From a GLB, which has y upwards, to a link, which has z: as in RViz since 2025, Drake and Blender.
UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
_GLB, _JSON = b"glTF\x02\x00\x00\x00", b"JSON"


class Mesh(NamedTuple):
    """Triangles of a collision shape.

    Attributes:
        vertices: In the file's unit, shape (v, 3).
        faces: Indices of vertices, shape (f, 3).
    """

    vertices: Floats
    faces: NDArray[np.int64]


def collision_mesh(address: str, package_root: str | None, scale: Floats) -> Mesh:
    """Read the mesh of a collision shape, with a hull that has a volume; its arrays are read-only.

    A mesh is read again only if its file has changed. `scale` is in metres per unit of the file along each axis, (3,).
    """
    try:
        status = _inside(address, package_root).stat()
    except OSError:  # reading reports it; a file that has come since is read, and not kept without its status
        return _collision_mesh.__wrapped__(address, package_root, tuple(scale), ())
    return _collision_mesh(address, package_root, tuple(scale), (status.st_ino, status.st_size, status.st_mtime_ns))


def mesh_in_metres(path: str, scale: float) -> Mesh:
    """Read the mesh of an obstacle as `collision_mesh` does, in metres; `scale` is in metres per unit of the file."""
    file = Path(path).resolve()
    vertices, faces = collision_mesh(file.name, str(file.parent), np.full(3, scale))
    return Mesh(vertices * scale, faces)


@lru_cache(maxsize=MAX_KEPT)
def _collision_mesh(
    address: str, package_root: str | None, scale: tuple[float, float, float], status: tuple[int, ...]
) -> Mesh:
    soup = [
        (part.vertices @ T[:3, :3].T + T[:3, 3])[part.faces].reshape(-1, 3)
        for part, T in placed_parts(address, package_root, np.array(scale))
    ]
    corners = np.concatenate(soup)
    _, first, number = np.unique(corners, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)  # as they come in the file
    mesh = Mesh(corners[first[order]], np.argsort(order)[number].reshape(-1, 3))
    mesh = _with_thickness(address, mesh, np.array(scale))
    for array in mesh:
        array.flags.writeable = False
    return mesh


def placed_parts(address: str, package_root: str | None, scale: Floats) -> list[tuple[Any, Floats]]:
    """Read the parts of a mesh file as trimesh's meshes, in the file's unit, each with its pose in the file (4, 4)."""
    path = _inside(address, package_root)
    name = shown(address)
    try:
        scene = _read(path)
    except InputError as error:
        raise InputError(f"the mesh {name} {error}") from None
    parts = [(scene.geometry[part], np.asarray(T)) for T, part in map(scene.graph.get, scene.graph.nodes_geometry)]
    parts = [(part, T) for part, T in parts if len(getattr(part, "faces", ()))]
    parts = [(part, UP @ T) for part, T in parts] if path.suffix.lower() == ".glb" else parts
    if not parts:
        raise InputError(f"the mesh {name} has no triangles")
    if (count := sum(len(part.faces) for part, _ in parts)) > MAX_FACES:
        raise InputError(f"the mesh {name} has {count} triangles, more than {MAX_FACES}")
    for part, T in parts:
        _check_part(name, part, T, scale)
    return parts


def _check_part(name: str, part: Any, T: Floats, scale: Floats) -> None:
    """Refuse vertices that are not finite or far away, and triangles of vertices that do not exist."""
    if part.faces.min() < 0 or part.faces.max() >= len(part.vertices):
        raise InputError(f"the mesh {name} has a triangle of a vertex that it does not have")
    with np.errstate(over="ignore", invalid="ignore"):
        placed = (part.vertices @ T[:3, :3].T + T[:3, 3]) * scale
        largest = float(np.abs(placed).max())
    if not np.isfinite(largest):
        raise InputError(f"the mesh {name} has a vertex that is not finite")
    if largest > MAX_COORDINATE:
        raise InputError(
            f"the mesh {name} has a vertex at {largest:g} m, farther than {MAX_COORDINATE:g} m; a mesh in millimetres "
            'needs scale="0.001 0.001 0.001"'
        )


def _with_thickness(name: str, mesh: Mesh, scale: Floats) -> Mesh:
    """Return the mesh; if it is thinner than `MIN_THICKNESS`, its hull, made that thick."""
    points = mesh.vertices[np.unique(mesh.faces)] * scale
    centre = points.mean(axis=0)
    axes = np.linalg.eigh(np.cov(points.T, ddof=0))[1][:, ::-1]  # the direction in which the mesh is thinnest is last
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])  # right-handed, so that triangles keep facing outwards
    along = (points - centre) @ axes
    extent = np.ptp(along, axis=0)
    if extent[1] < LINE:
        raise InputError(f"the mesh {shown(name)} has no surface: its points are on one line")
    if extent[2] >= MIN_THICKNESS:
        return mesh
    import trimesh

    half = 0.5 * np.where(extent < MIN_THICKNESS, MIN_THICKNESS, 0.0)
    sides = [along + half * sign for sign in ((0, 1, 1), (0, 1, -1), (0, -1, 1), (0, -1, -1))]
    hull = trimesh.convex.convex_hull(np.concatenate(sides))
    return Mesh((np.array(hull.vertices) @ axes.T + centre) / scale, np.array(hull.faces))


def _inside(address: str, package_root: str | None) -> Path:
    """Return the file of an address, links followed; refuse one outside the package."""
    root = Path(package_root or "").resolve()
    try:
        path = (root / address.removeprefix(PACKAGE)).resolve()
    except (OSError, ValueError, RuntimeError) as error:
        raise InputError(f"the mesh {shown(address)} cannot be read: {error}") from None
    if not path.is_relative_to(root):
        raise InputError(
            f"the mesh {shown(address)} is a link to {shown(str(path))}, outside of its package; copy the file, or "
            "name the folder that it is in with package_dirs="
        )
    return path


def _read(path: Path) -> Any:
    """Read the scene in a file; errors continue "the mesh ..."."""
    import trimesh  # half a second, which an arm without meshes saves

    kind = path.suffix.lower()
    if kind not in MESHES:
        raise InputError(f"is not one of {', '.join(MESHES)}")
    try:
        content = read_bytes(path, "the file", most=MAX_BYTES)
    except InputError as error:
        raise InputError(f"cannot be used: {error}") from None
    try:
        if kind == ".dae":
            _check_collada(content)
        elif kind == ".glb":
            _check_glb(content)
        # An empty resolver: what the mesh names, such as materials and textures, is not opened.
        return trimesh.load_scene(io.BytesIO(content), file_type=kind[1:], resolver={}, process=False)
    except MemoryError:
        raise InputError("cannot be read: there is not enough memory") from None
    except InputError:
        raise
    except Exception as error:  # whatever a parser raises at what is not a mesh
        raise InputError(f"cannot be read: {type(error).__name__}: {shown(str(error))}") from None


def _check_glb(content: bytes) -> None:
    """Refuse what is no GLB of glTF 2, and one that places very many parts or has more numbers than bytes."""
    size = int.from_bytes(content[12:16], "little")
    if not content.startswith(_GLB) or content[16:20] != _JSON or size > len(content) - 20:
        raise InputError("is no GLB of glTF 2")
    head = json.loads(content[20 : 20 + size])
    if any("uri" in part for kind in ("buffers", "images") for part in head.get(kind, ())):
        raise InputError("names other files; save it with all that it has in one")
    if len(head.get("nodes", ())) > MAX_PLACED:
        raise InputError(f"places more than {MAX_PLACED} parts")
    if sum(int(part["count"]) for part in head.get("accessors", ())) > len(content):
        raise InputError("has more numbers than bytes")


def _check_collada(content: bytes) -> None:
    """Refuse what is not XML, a document type, and a scene that places very many parts."""
    inside: list[str] = []  # open nodes
    placed: Counter[str] = Counter()
    used: defaultdict[str, list[str]] = defaultdict(list)

    def start(tag: str, attributes: dict[str, str]) -> None:
        tag = tag.rpartition(":")[2]
        if tag in ("node", "visual_scene"):
            inside.append(attributes.get("id", "") if tag == "node" else "")
        elif tag == "instance_node":
            for node in {*inside}:
                used[node].append(attributes.get("url", "").removeprefix("#"))
        elif tag in ("instance_geometry", "instance_controller"):
            placed.update({*inside})

    def end(tag: str) -> None:
        if tag.rpartition(":")[2] in ("node", "visual_scene"):
            inside.pop()

    def refuse(*declared: object) -> NoReturn:
        raise InputError("must not have a document type")

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise InputError(f"is not XML: {error}") from None

    @cache
    def count(node: str) -> int:
        return min(placed[node] + sum(map(count, used[node])), MAX_PLACED + 1)

    try:
        total = max(map(count, {"", *placed, *used}))
    except RecursionError:
        raise InputError("places parts within parts without end") from None
    if total > MAX_PLACED:
        raise InputError(f"places more than {MAX_PLACED} parts")
