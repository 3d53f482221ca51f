"""The shapes of an arm's links, and their places in a posture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach._engines import load
from kinreach._rotations import rotation_to
from kinreach.kinematics import ArmKinematics
from kinreach.kinematics.inside import link_frame
from kinreach.robots import ArmDescription
from kinreach.robots.inside import LinkShape, link_shapes

pin: Any = load("pinocchio")

#: Radii of tubes and joints of an arm without shapes, relative to its size.
TUBE, JOINT = 0.035, 0.055
#: How far inside the surface of the links a ghost is [m]: where it is in the place of a solid one, only that one shows.
INSET = 0.002
#: Exponent for colours of files, which are darker than the arms.
GAMMA = 0.75
_TUBE_COLOUR, _JOINT_COLOUR = (0.78, 0.80, 0.83, 1.0), (0.30, 0.44, 0.54, 1.0)


@dataclass(frozen=True, eq=False)
class Piece:
    """Triangles of one colour on one link: vertices (v, 3) in its frame [m], faces (f, 3), colour 0 to 255."""

    link: int
    vertices: Floats
    faces: NDArray[np.int64]
    colour: tuple[int, int, int]


class Figure:
    """The drawn links of an arm; `simple` draws the collision shapes, which have a tenth of the triangles.

    Attributes:
        links: Names of the links, in the order of `poses`.
        fine: Visual shapes, one piece for each link and colour.
        coarse: Collision shapes, `INSET` thinner, one piece for each link that can move, for ghosts.
    """

    def __init__(self, kinematics: ArmKinematics, *, simple: bool = False) -> None:
        self._kinematics = kinematics
        coarse = _shapes(kinematics.arm, "collision")
        fine = coarse if simple else _shapes(kinematics.arm, "visual")
        if not fine:
            fine = coarse = _skeleton(kinematics)
        self.links = tuple(dict.fromkeys(shape.link for shape in (*coarse, *fine)))
        self._frames = [link_frame(kinematics.model, link) for link in self.links]
        self.fine = _merged(fine, self.links, by_colour=True)
        moved = [kinematics.model.frames[frame].parentJoint > 0 for frame in self._frames]
        ghosts = _merged(coarse, self.links, by_colour=False, inset=INSET)
        self.coarse = [piece for piece in ghosts if moved[piece.link]]

    def poses(self, q: Floats) -> Floats:
        """Return positions [m] and quaternions w x y z of the links in the world in a posture (n,), shape (k, 7)."""
        model, data = self._kinematics.model, self._kinematics.data
        pin.forwardKinematics(model, data, q)
        poses = [pin.SE3ToXYZQUAT(pin.updateFramePlacement(model, data, frame)) for frame in self._frames]
        return np.array(poses).reshape(-1, 7)[:, [0, 1, 2, 6, 3, 4, 5]]


@lru_cache(maxsize=8)
def _shapes(arm: ArmDescription, kind: str) -> list[LinkShape]:
    return link_shapes(arm, kind)


def _merged(shapes: list[LinkShape], links: tuple[str, ...], *, by_colour: bool, inset: float = 0.0) -> list[Piece]:
    groups: dict[tuple[int, tuple[float, ...]], list[LinkShape]] = {}
    for shape in shapes:
        groups.setdefault((links.index(shape.link), shape.rgba if by_colour else ()), []).append(shape)
    pieces = []
    for (link, rgba), parts in groups.items():
        offsets = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
        faces = np.concatenate([part.faces + offset for part, offset in zip(parts, offsets, strict=True)])
        vertices = np.concatenate([part.vertices - inset * part.normals for part in parts])
        pieces.append(Piece(link, vertices, faces, shade(rgba or parts[0].rgba)))
    return pieces


def shade(rgba: Sequence[float]) -> tuple[int, int, int]:
    """Turn a colour of a file, 0 to 1, into the drawn one, 0 to 255."""
    red, green, blue = (round(255 * float(value) ** GAMMA) for value in rgba[:3])
    return red, green, blue


def _skeleton(kinematics: ArmKinematics) -> list[LinkShape]:
    """Tubes from joint to joint, for an arm without shapes."""
    import trimesh

    model, data = kinematics.model, kinematics.model.createData()
    pin.forwardKinematics(model, data, np.zeros(model.nq))
    pin.updateFramePlacements(model, data)
    base = data.oMf[link_frame(model, kinematics.arm.base)]
    stations = [base, *(data.oMi[joint] for joint in range(1, model.njoints)), data.oMf[kinematics.tip_frame]]
    names = [kinematics.arm.base, *(_carried(model, joint) for joint in range(1, model.njoints))]
    size = float(np.linalg.norm([b.translation - a.translation for a, b in pairwise(stations)]))
    shapes = []
    for name, here, there in zip(names, stations[:-1], stations[1:], strict=True):
        along = here.actInv(there.translation)
        length = float(np.linalg.norm(along))
        parts = [(trimesh.creation.icosphere(2, JOINT * size), _JOINT_COLOUR)]
        if length > 1e-6:
            tube = trimesh.creation.cylinder(TUBE * size, length, sections=20)
            turned = np.eye(4)
            turned[:3, :3], turned[:3, 3] = rotation_to(along / length), along / 2
            tube.apply_transform(turned)
            parts.append((tube, _TUBE_COLOUR))
        shapes += [
            LinkShape(name, np.array(part.vertices), np.array(part.vertex_normals), np.array(part.faces), rgba)
            for part, rgba in parts
        ]
    return shapes


def _carried(model: Any, joint: int) -> str:
    frames = (frame for frame in model.frames if frame.type == pin.BODY and frame.parentJoint == joint)
    return str(min(frames, key=lambda frame: float(np.linalg.norm(frame.placement.translation))).name)
