"""Arms, their ghosts and their surroundings in the scene of the page."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import Floats
from kinreach.kinematics import pose
from kinreach.robots import ArmDescription, Box, Obstacle
from kinreach.robots.inside import mesh_in_metres
from kinreach.view._figure import Figure, Piece

Colour = tuple[int, int, int]

RED: Colour = (214, 30, 30)
#: Of postures that are refused.
PALE_RED: Colour = (235, 150, 150)
AMBER: Colour = (240, 160, 30)
BLUE: Colour = (40, 110, 200)
VIOLET: Colour = (130, 70, 190)
#: One colour for each posture, also for colour-blind readers (Okabe and Ito, 2008).
BRANCH_COLOURS: tuple[Colour, ...] = (
    (0, 114, 178), (86, 180, 233), (0, 158, 115), (150, 200, 80), (204, 121, 167), (120, 94, 240), (170, 120, 60),
    (90, 90, 90),
)  # fmt: skip
_BOX_COLOURS: dict[str, Colour] = {"table": (199, 181, 153)}
_METAL: Colour = (122, 126, 133)
#: Links nearer than this are drawn once, because surfaces in one place flicker [m, 1 - cos of half the angle].
SAME_PLACE = 1e-6
#: A place where nothing is drawn [m].
FAR = 1e6
#: How far the camera is moved, by its distance: to the side and away, and on an upright screen down and away.
ASIDE, AWAY, UNDER, AWAY_UPRIGHT = 0.14, 0.15, 0.25, 0.8
#: Lines of the grid, of its cells and of its sections.
GRID, DARK_GRID = ((222, 226, 230), (196, 202, 208)), ((46, 48, 52), (66, 69, 74))
_LEG = 0.05  # edge of a table leg [m]


def box_colour(name: str) -> Colour:
    return _BOX_COLOURS.get(name, _METAL)


def instance_colours(colours: ArrayLike) -> Floats:
    """Convert colours, 0 to 255, for batched meshes: viser decodes no sRGB there."""
    return (np.asarray(colours) / 255.0) ** 2.2


def overview(client: Any, arm: ArmDescription) -> None:
    """Look at an arm from its overview camera, if it has one.

    The view leaves room for the panel: at the side, or below on an upright screen.
    """
    mount = next((mount for mount in arm.cameras if mount.name == "overview"), None)
    if mount is None:
        return
    position, target = np.array(mount.position), np.array(mount.target)
    forward = target - position
    right = np.cross(forward, (0.0, 0.0, 1.0))
    upright = client.camera.image_height > client.camera.image_width
    moved = UNDER * np.cross(forward, right) / np.linalg.norm(right) if upright else ASIDE * right
    client.camera.position = position + moved - (AWAY_UPRIGHT if upright else AWAY) * forward
    client.camera.look_at = target + moved
    client.camera.fov = np.radians(mount.fovy)


class Shapes(Protocol):
    """Shapes of a `SolidScene`.

    Attributes:
        fine: Their pieces in colour.
        coarse: The same in fewer triangles.
    """

    links: tuple[str, ...]
    fine: list[Piece]
    coarse: list[Piece]


class Branch:
    """A node of the scene that is shown or hidden with everything below it."""

    _root: Any

    @property
    def visible(self) -> bool:
        return bool(self._root.visible)

    @visible.setter
    def visible(self, visible: bool) -> None:
        if visible != self._root.visible:
            self._root.visible = visible


class SolidScene(Branch):
    """Links that are placed together."""

    def __init__(
        self, scene: Any, root: str, shapes: Shapes, *, colour: Colour | None = None, opacity: float | None = None
    ) -> None:
        self._names = shapes.links
        self._root = scene.add_frame(root, show_axes=False)
        self._links = [scene.add_frame(f"{root}/{link}", show_axes=False) for link in shapes.links]
        self._pieces = []
        for index, piece in enumerate(shapes.fine if colour is None else shapes.coarse):
            own = colour or piece.colour
            name = f"{root}/{shapes.links[piece.link]}/{index}"
            mesh = scene.add_mesh_simple(
                name, piece.vertices, piece.faces, color=own, opacity=opacity, side="double", flat_shading=False
            )
            self._pieces.append((piece.link, own, mesh))
        self._red: frozenset[str] = frozenset()

    def place(self, poses: Floats, *, red: Collection[str] = ()) -> None:
        """Place the links at poses (k, 7), position [m] and quaternion w x y z; those named in `red` turn red."""
        for node, place in zip(self._links, poses, strict=True):
            node.position, node.wxyz = place[:3], place[3:]
        wanted = frozenset(red)
        if wanted != self._red:
            for link, own, mesh in self._pieces:
                mesh.color = RED if self._names[link] in wanted else own
            self._red = wanted

    def remove(self) -> None:
        self._root.remove()


class SolidArm(SolidScene):
    """One arm as one solid, moved by its joint angles."""

    def __init__(
        self, scene: Any, root: str, figure: Figure, *, colour: Colour | None = None, opacity: float | None = None
    ) -> None:
        super().__init__(scene, root, figure, colour=colour, opacity=opacity)
        self._figure = figure

    def take(self, q: Floats, *, red: Collection[str] = ()) -> None:
        """Move to a posture (n,) [rad], and draw the links named in `red` red."""
        self.place(self._figure.poses(q), red=red)


@dataclass(frozen=True)
class Ghost:
    """A transparent posture (n,) [rad]: its colour, its red links, and its opacity, 0 to 1."""

    q: Floats
    colour: Colour
    red: Collection[str] = ()
    opacity: float = 0.3


class Ghosts(Branch):
    """Many transparent arms at once."""

    def __init__(self, scene: Any, root: str, figure: Figure, *, most: int) -> None:
        self._figure, self._most = figure, most
        self._root = scene.add_frame(root, show_axes=False)
        self._pieces = [
            scene.add_batched_meshes_simple(
                f"{root}/{index}",
                piece.vertices,
                piece.faces,
                batched_wxyzs=np.tile((1.0, 0.0, 0.0, 0.0), (most, 1)),
                batched_positions=np.zeros((most, 3)),
                batched_scales=np.zeros(most),
                batched_colors=np.zeros((most, 3)),
                batched_opacities=np.zeros(most),
                lod="off",
                cast_shadow=False,
                receive_shadow=False,
            )
            for index, piece in enumerate(figure.coarse)
        ]
        self._looks: list[tuple[Colour, frozenset[str], float]] = []

    def take(self, ghosts: Sequence[Ghost], *, beside: Floats | None) -> None:
        """Draw these ghosts only. Links in one place are drawn once, those of the posture `beside` before others."""
        ghosts = ghosts[: self._most]
        poses = np.zeros((self._most, len(self._figure.links), 7))
        poses[:, :, 3] = 1.0
        scales = np.zeros((self._most, len(self._figure.links)))
        drawn = [self._figure.poses(beside) if beside is not None else np.full(poses.shape[1:], FAR)]
        for row, ghost in sorted(enumerate(ghosts), key=lambda pair: -pair[1].opacity):
            poses[row] = self._figure.poses(ghost.q)
            others = np.array(drawn)
            apart = np.abs(poses[row, :, :3] - others[..., :3]).max(axis=2)
            turned = 1.0 - np.abs((poses[row, :, 3:] * others[..., 3:]).sum(axis=2))
            scales[row] = ((apart > SAME_PLACE) | (turned > SAME_PLACE)).all(axis=0)
            drawn.append(poses[row])
        looks = [(ghost.colour, frozenset(ghost.red), ghost.opacity) for ghost in ghosts]
        for piece, node in zip(self._figure.coarse, self._pieces, strict=True):
            node.batched_positions = poses[:, piece.link, :3]
            node.batched_wxyzs = poses[:, piece.link, 3:]
            node.batched_scales = scales[:, piece.link]
            if looks != self._looks:
                link = self._figure.links[piece.link]
                shades, opacities = np.zeros((self._most, 3)), np.zeros(self._most)
                for row, (colour, red, opacity) in enumerate(looks):
                    shades[row], opacities[row] = RED if link in red else colour, opacity
                node.batched_colors, node.batched_opacities = instance_colours(shades), opacities
        self._looks = looks


class FloorGrid:
    """The floor of a work cell."""

    def __init__(self, scene: Any, boxes: Sequence[Box]) -> None:
        floor = min((box.position[2] + box.size[2] / 2 for box in boxes if box.name == "floor"), default=0.0)
        self._grid = scene.add_grid("/grid", 6.0, 6.0, position=(0.0, 0.0, floor), cell_size=0.25, section_size=1.0)

    def colour(self, *, dark: bool) -> None:
        self._grid.cell_color, self._grid.section_color = DARK_GRID if dark else GRID


class Surroundings(Branch):
    """The boxes of a work cell, and meshes beside it."""

    def __init__(
        self, scene: Any, boxes: Sequence[Box], *, meshes: Sequence[Obstacle] = (), root: str = "/world"
    ) -> None:
        self._boxes: dict[str, list[tuple[Colour, Any]]] = {}
        self._red: frozenset[str] = frozenset()
        self._root = scene.add_frame(root, show_axes=False)
        for box in boxes:
            if box.name == "floor":
                continue
            colour = box_colour(box.name)
            node = scene.add_box(f"{root}/{box.name}", color=colour, dimensions=box.size, position=box.position)
            self._boxes[box.name] = [(colour, node)]
            x, y, z = np.array(box.size) / 2
            for index, (sx, sy) in enumerate([(-1, -1), (-1, 1), (1, -1), (1, 1)] if box.legs > 0 else []):
                leg = scene.add_box(
                    f"{root}/{box.name}/leg_{index}",
                    color=_METAL,
                    dimensions=(_LEG, _LEG, box.legs),
                    position=(sx * (x - _LEG), sy * (y - _LEG), -z - box.legs / 2),
                )
                self._boxes[box.name].append((_METAL, leg))
        for each in meshes:
            vertices, faces = mesh_in_metres(str(each.shape), each.scale)
            T = pose(each.pose)
            placed = vertices @ T[:3, :3].T + T[:3, 3]
            scene.add_mesh_simple(f"{root}/{each.name}", placed, faces, color=_METAL, side="double", flat_shading=True)

    def remove(self) -> None:
        self._root.remove()

    def mark(self, red: Collection[str]) -> None:
        """Draw only the boxes of these names red."""
        wanted = frozenset(red)
        for name in wanted ^ self._red:
            for colour, node in self._boxes.get(name, ()):
                node.color = RED if name in wanted else colour
        self._red = wanted
