"""Mesh files that a URDF names, found beside it and in the folders of its packages.

A mesh, links followed, must lie within its package or the URDF's, in a folder that the caller or ROS's environment
names, beside the URDF or in the folder above it.
"""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from functools import cache, cached_property
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from kinreach._checks import check_path, shown
from kinreach._files import read_bytes
from kinreach.errors import InputError
from kinreach.robots._urdf import MESHES, PACKAGE

#: Folders above a URDF in which packages are looked for.
LEVELS_UP = 4
FILE = "file://"
#: Addresses of a file in a package: of ROS, of Gazebo, and of xacro and ROS's launch files.
_IN_PACKAGE = re.compile(
    r"(?:package|model)://(?P<path>.*)|(?:file://)?\$\(find(?:-pkg-share)? (?P<name>[^)]+)\)/*(?P<rest>.*)", re.DOTALL
)
#: The file that names a package, its largest size [bytes], and the name in it.
MANIFEST, MAX_MANIFEST = "package.xml", 2**20
_NAME = re.compile(rb"<name>([^<]*)</name>")


def find_meshes(
    robot: ET.Element, file: Path, package_dirs: Sequence[str | Path]
) -> tuple[str | None, str, Mapping[ET.Element, Path]]:
    """Rewrite the addresses of all meshes as `package://` within one folder, and leave out those that are not found.

    A link whose visual meshes are all missing is drawn by its collision shapes.

    Returns:
        The folder that `package://` stands for, None without meshes; why collision shapes are missing, or ""; and the
        file of each mesh.
    """
    folders = _Folders(file, [check_path("package_dirs", folder).resolve() for folder in package_dirs])
    for material in robot.iter("material"):
        for texture in material.findall("texture"):  # a picture of the surface, which no engine here draws
            material.remove(texture)
    parents = {child: parent for parent in robot.iter() for child in parent}
    places: dict[ET.Element, Path] = {}
    lost: dict[ET.Element, str] = {}  # shapes, or meshes that belong to no shape
    for mesh in robot.iter("mesh"):
        address = mesh.get("filename", "")
        if (place := folders.mesh(address)) is not None:
            places[mesh] = place
        else:
            shape = parents.get(parents[mesh], mesh)
            lost[shape if shape.tag in ("visual", "collision") else mesh] = address
    missing = [(address, parents[shape].get("name", "")) for shape, address in lost.items() if shape.tag == "collision"]
    for link in {parents[shape]: None for shape in lost}:
        drawn = any(shape.tag == "visual" for shape in link)
        link[:] = [shape for shape in link if shape not in lost]
        if drawn and link.find("visual") is None:
            for shape in link.findall("collision"):
                link.append(visual := deepcopy(shape))
                visual.tag = "visual"
                places |= {
                    copy: places[mesh] for mesh, copy in zip(shape.iter("mesh"), visual.iter("mesh"), strict=True)
                }
    root = Path(os.path.commonpath([place.parent for place in places.values()])) if places else None
    for mesh, place in places.items():
        mesh.set("filename", PACKAGE + place.relative_to(root or "").as_posix())
    return None if root is None else str(root), _reason(missing), places


def _reason(missing: Sequence[tuple[str, str]]) -> str:
    if not missing:
        return ""
    address, link = missing[0]
    more = f" (and {len(missing) - 1} more)" if len(missing) > 1 else ""
    return (
        f"the collision mesh {shown(address)} of link {shown(link)}{more} is not found; meshes are {', '.join(MESHES)} "
        "files beside the URDF, in the folder above it, or in a package, which is looked for with package_dirs=, "
        "around the URDF, and in ROS_PACKAGE_PATH and AMENT_PREFIX_PATH"
    )


class _Folders:
    """Folders in which the meshes of a URDF may be."""

    def __init__(self, file: Path, given: Sequence[Path]) -> None:
        self._file = file
        self._around = [file.parent, *file.parents[1 : LEVELS_UP + 1]]
        self._ros = [Path(entry).resolve() for entry in _entries("ROS_PACKAGE_PATH")]
        self._ros += [Path(entry).resolve() / "share" for entry in _entries("AMENT_PREFIX_PATH")]
        self._given = given
        own = next((folder for folder in self._around if os.path.isfile(folder / MANIFEST)), file.parent)
        self._allowed = (*given, *self._ros, file.parent, file.parent.parent, own)
        self._packages_of = cache(self._search)

    def mesh(self, address: str) -> Path | None:
        """Return the file that an address means, links followed; None if there is none that may be read."""
        if not address.isprintable():
            return None
        for place, package in self._candidates(address):
            mesh = Path(os.path.realpath(place))
            inside = any(mesh.is_relative_to(folder) for folder in (*self._allowed, *package))
            if mesh.suffix.lower() in MESHES and inside and os.path.isfile(mesh):
                return mesh
        return self.mesh(address.replace("\\", "/")) if "\\" in address else None  # written on Windows

    def _candidates(self, address: str) -> Iterator[tuple[Path, tuple[Path, ...]]]:
        """Places that an address may mean, each with the package that it is in."""
        if (found := _IN_PACKAGE.fullmatch(address)) is not None:
            path = found["path"] if found["name"] is None else f"{found['name'].strip()}/{found['rest']}"
            name, *rest = PurePosixPath(path).parts or ("/",)
            if rest and ".." not in (name, *rest) and name != "/":
                for package in self._packages_of(name):
                    yield package.joinpath(*rest), (package,)
        elif address.startswith((FILE, "/")):
            path = unquote(address.removeprefix(FILE)) if address.startswith(FILE) else address
            if path.startswith("/") and path.isprintable():
                yield Path(path), ()
        elif "://" not in address:
            yield self._file.parent / address, ()

    def _search(self, name: str) -> list[Path]:
        """Return the folders of a package: those whose `package.xml` names it, then those that are called so.

        In both, the given ones come first, then those around the file, ROS's, and nested ones.
        """
        places = []
        for folder in (*self._given, *self._around, *self._ros):
            places += [folder / name, *([folder] if folder.name == name else [])]
        called = [place for place in (*places, *self._nested.get(name, [])) if os.path.isdir(place)]
        return [*self._declared.get(name, []), *called]

    @cached_property
    def _declared(self) -> dict[str, list[Path]]:
        """Packages by the name in their `package.xml`, whatever their folders are called."""
        folders = [*self._given, *self._around, *self._ros]
        folders += [child for folder in folders for child in _folders_in(folder)]
        folders += [package for packages in self._nested.values() for package in packages]
        places: dict[str, list[Path]] = {}
        for folder in dict.fromkeys(folders):
            if name := _declared_name(folder / MANIFEST):
                places.setdefault(name, []).append(folder)
        return places

    @cached_property
    def _nested(self) -> dict[str, list[Path]]:
        """Packages by name, in repositories within the given folders and ROS's."""
        places: dict[str, list[Path]] = {}
        for repository in (path for folder in (*self._given, *self._ros) for path in _folders_in(folder)):
            for package in _folders_in(repository):
                places.setdefault(package.name, []).append(package)
        return places


def _declared_name(manifest: Path) -> str:
    """Return the name of the package that a `package.xml` is of; empty if it cannot be read."""
    if not os.path.isfile(manifest):
        return ""
    try:
        content = read_bytes(manifest, MANIFEST, most=MAX_MANIFEST)
    except InputError:
        return ""
    before, *commented = content.split(b"<!--")
    found = _NAME.search(before + b"".join(part.partition(b"-->")[2] for part in commented))
    return "" if found is None else found[1].decode(errors="replace").strip()


def _entries(variable: str) -> list[str]:
    return [entry for entry in os.environ.get(variable, "").split(os.pathsep) if entry]


def _folders_in(folder: Path) -> list[Path]:
    try:
        return sorted(Path(entry) for entry in os.scandir(folder) if entry.is_dir())
    except OSError:
        return []
