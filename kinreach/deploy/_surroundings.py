"""What stands around an arm, by flags of the command line: a table, boxes and meshes."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np

from kinreach._flags import numbers_of, pose_numbers_of
from kinreach.errors import InputError, NoShapesError
from kinreach.kinematics import ArmKinematics, CollisionChecker, pose, pose_vector
from kinreach.robots import ArmDescription, Box, Obstacle, Workcell

#: Edges of the table of `--table` [m].
TABLE_SIZE = (6.0, 6.0, 1.0)


def add_surroundings(parser: argparse.ArgumentParser, frame: str) -> None:
    """Add `--table` and `--box`."""
    parser.add_argument(
        "--table",
        metavar="Z",
        help="a table all around the arm, with its top at this height above the arm's base [m]: 0 or negative",
    )
    parser.add_argument(
        "--box",
        action="append",
        default=[],
        metavar="X,Y,Z,SX,SY,SZ",
        help=f"an obstacle: centre and full edge lengths of a box in {frame} [m]; may be repeated",
    )


def add_meshes(parser: argparse.ArgumentParser, frame: str) -> None:
    """Add `--mesh` and `--mesh-scale`."""
    parser.add_argument(
        "--mesh",
        action="append",
        default=[],
        metavar="FILE[@X,Y,Z,RX,RY,RZ]",
        help=f"an obstacle: the triangles of an STL, OBJ, DAE or GLB, and the pose of its origin in {frame}; may be "
        "repeated",
    )
    parser.add_argument(
        "--mesh-scale",
        type=float,
        default=1.0,
        metavar="S",
        help="metres per unit of these files; 0.001 for millimetres (%(default)s)",
    )


def meshes_of(kinematics: ArmKinematics, meshes: Sequence[str], scale: float) -> list[Obstacle]:
    """Return the meshes of `--mesh`, each placed in the frame of the kinematics, named by its file.

    Raises:
        InputError: A pose or a scale that cannot be used.
    """
    placed: list[Obstacle] = []
    taken = {box.name for box in kinematics.arm.workcell.obstacles}
    for text in meshes:
        file, placed_at, numbers = text.rpartition("@")
        T = pose(pose_numbers_of("--mesh", numbers, strict=True)) if placed_at else np.eye(4)
        file = file if placed_at else text
        plain = Path(file).name
        names = (plain if number == 1 else f"{plain} {number}" for number in count(1))
        name = next(name for name in names if name not in taken)
        taken.add(name)
        placed.append(Obstacle(name, file, pose_vector(kinematics.T_world_base @ T), scale))
    return placed


def surrounded(kinematics: ArmKinematics, table: str | None, boxes: Sequence[str], *, cell: bool) -> ArmDescription:
    """Return an arm with what `add_surroundings` puts around it, boxes in the frame of its kinematics.

    Its own work cell is kept only with `cell`, and not beside a table.
    """
    arm = kinematics.arm
    around = arm.workcell if cell else Workcell()
    if table is not None:
        around = _table(kinematics, numbers_of("--table", table, 1)[0])
    placed = [_box(kinematics, text, number) for number, text in enumerate(boxes, start=1)]
    return replace(arm, workcell=replace(around, obstacles=(*around.obstacles, *placed)))


def _table(kinematics: ArmKinematics, height: float) -> Workcell:
    """A table that parts that are fixed to the arm's base may touch."""
    if not height <= 0.0:
        raise InputError(
            f"--table must be 0 or negative, got {height:g}: metres from the arm's base down to the table's top; "
            "--box is an obstacle anywhere"
        )
    x, y, z = kinematics.T_world_arm[:3, 3].tolist()
    table = Box("table", TABLE_SIZE, (x, y, z + height - TABLE_SIZE[2] / 2))
    standing: tuple[tuple[str, str], ...] = ()
    with suppress(NoShapesError):
        shapes = CollisionChecker(kinematics, obstacles=()).shapes
        standing = tuple((table.name, shape.name) for shape in shapes if shape.joint < 0)
    return Workcell((table,), standing)


def _box(kinematics: ArmKinematics, text: str, number: int) -> Box:
    numbers = np.array(numbers_of("--box", text, 6))
    T = kinematics.T_world_base
    edges = np.abs(T[:3, :3])
    if np.abs(edges - edges.round()).max() > 1e-6:
        raise InputError(
            "--box needs a frame with its axes along those of the world; in Python Obstacle(name, size, pose) takes "
            "any pose"
        )
    size, centre = edges.round() @ numbers[3:], T[:3, :3] @ numbers[:3] + T[:3, 3]
    return Box(f"box {number}", tuple(size.tolist()), tuple(centre.tolist()))
