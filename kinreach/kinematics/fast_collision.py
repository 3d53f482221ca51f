"""Whether postures are impossible, for thousands at once: joint limits, and collisions as `CollisionChecker` sees them.

Three kinds of test, each in the form in which it is cheapest:

*   Links few joints apart, and everything up to wrist_1 against the work cell: tables of blocked arcs, measured on the
    meshes when the first object is made, which takes 2 s.
*   What is behind wrist_1 against the work cell, the base and the shoulder: geometry, exact for the gripper.
*   Joint limits.

All of it is elementwise: the verdict on a posture depends neither on the others nor on how many there are. How often it
is that of `CollisionChecker` and of MuJoCo: `python -m benchmarks.studies.collision_agreement`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import IntEnum
from functools import lru_cache
from threading import Lock
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach.checks import Floats, as_floats
from kinreach.errors import InputError
from kinreach.kinematics.arm import ArmKinematics
from kinreach.kinematics.blocked_arcs import Arcs, BlockedArcs
from kinreach.kinematics.cell_shapes import CellShapes, Part
from kinreach.kinematics.chain import blocks
from kinreach.kinematics.collision import CollisionChecker
from kinreach.kinematics.straight_line import Entry, Program, any_of
from kinreach.kinematics.wrist_clearance import WristClearance
from kinreach.robots import ArmDescription, as_arm

#: How far outside a joint limit a joint may be, for rounding [rad]; as in `ArmKinematics.within_limits`.
LIMIT_SLACK = 1e-9
JOINTS = 6
#: An obstacle that is no wider than this from its centre [m] belongs to the arm's foot.
FOOT_WIDTH = 0.25

Codes = NDArray[np.uint8]


_EXPLAINING = Lock()


class Cause(IntEnum):
    """Why a posture is impossible; the first that is found."""

    NONE = 0
    LIMITS = 1
    SELF = 2
    OBSTACLE = 3


class FastCollision:
    """Judges postures of a six-joint arm of the UR kind. Threads may share an instance.

    Args:
        arm: Name of a registered arm, or a description.

    Attributes:
        arm: The description.

    Raises:
        InputError: The arm is not of that kind, or its work cell has no table.
        UnknownNameError: There is no arm of that name.
        InstallationError: Pinocchio or coal cannot be loaded.
    """

    def __init__(self, arm: str | ArmDescription = "ur5") -> None:
        self.arm = as_arm(arm)
        self._model = _model(self.arm)

    def __reduce__(self) -> tuple[type[FastCollision], tuple[ArmDescription]]:
        return FastCollision, (self.arm,)  # the tables are quicker made than read

    def impossible(self, q: ArrayLike) -> NDArray[np.bool_]:
        """Which postures are outside the joint limits or collide.

        Args:
            q: Postures [rad], shape (n, 6).

        Returns:
            Shape (n,).

        Raises:
            InputError: Wrong shape or a value that is not finite.
        """
        return self.causes(q) != Cause.NONE

    def causes(self, q: ArrayLike) -> Codes:
        """Why postures are impossible.

        Args:
            q: Postures [rad], shape (n, 6).

        Returns:
            Values of `Cause`, shape (n,).

        Raises:
            InputError: Wrong shape or a value that is not finite.
        """
        q = as_floats("q", q)
        if q.ndim != 2 or q.shape[1] != JOINTS:
            raise InputError(f"q must have shape (n, {JOINTS}), got {q.shape}")
        causes = np.empty(len(q), dtype=np.uint8)
        for block in blocks(len(q)):
            causes[block] = self._judged(q[block])
        return causes

    def reason(self, q: ArrayLike) -> str:
        """What makes one posture impossible, for people; empty if nothing does.

        Joints outside their limits, or the pair that is deepest in one another ("finger_left - table").

        Args:
            q: Posture [rad], shape (6,).

        Raises:
            InputError: Wrong shape or a value that is not finite.
        """
        kinematics = self._model.kinematics
        q = kinematics.as_posture("q", q)
        cause = self.causes(q[None])[0]
        if cause == Cause.NONE:
            return ""
        if cause == Cause.LIMITS:
            return f"out of limits: {', '.join(kinematics.joints_outside_limits(q, tolerance=LIMIT_SLACK))}"
        with _EXPLAINING:  # instances of the same arm share the checker
            one, other = self._model.checker.distance(q).pair
        if one in (box.name for box in self.arm.workcell.obstacles):
            one, other = other, one
        return f"{one} - {other}"

    def _judged(self, q: Floats) -> Codes:
        """Causes for one block of postures, shape (m, 6)."""
        model = self._model
        with np.errstate(over="ignore"):  # what is too large for single precision is far outside the limits
            single = np.array(q.T, dtype=np.float32, order="C")
        if max(single.max(initial=0.0), -single.min(initial=0.0)) < model.certain:
            return self._collisions(single)
        columns = np.ascontiguousarray(q.T)
        within = (columns >= model.lower) & (columns <= model.upper)
        if within.all():
            return self._collisions(single)
        finite = np.isfinite(columns).all(axis=0)
        if not finite.all():
            raise InputError(f"q must be finite, got {q[finite.argmin()]}")
        causes = self._collisions(np.clip(single, -np.float32(np.pi), np.float32(np.pi)))
        causes[~within.all(axis=0)] = Cause.LIMITS
        return causes

    def _collisions(self, q: NDArray[np.float32]) -> Codes:
        """Causes for postures within the limits."""
        causes = _causes(*self._model.arcs(q))
        rows = np.flatnonzero(causes == Cause.NONE)
        causes[rows] = _causes(*self._model.wrist.touches(q.take(rows, axis=1)))
        return causes


def _causes(on_cell: NDArray[np.bool_], on_arm: NDArray[np.bool_]) -> Codes:
    """Self-collision where both are so."""
    return np.where(on_arm, np.uint8(Cause.SELF), on_cell * np.uint8(Cause.OBSTACLE))


class _Model(NamedTuple):
    """What the verdicts on one arm are made of."""

    kinematics: ArmKinematics
    checker: CollisionChecker
    lower: Floats
    upper: Floats
    certain: float
    arcs: Program
    wrist: WristClearance


@lru_cache(maxsize=4)
def _model(arm: ArmDescription) -> _Model:
    kinematics = ArmKinematics(arm, base="world")
    checker = CollisionChecker(kinematics)
    lower, upper = kinematics.lower[:, None] - LIMIT_SLACK, kinematics.upper[:, None] + LIMIT_SLACK
    first = kinematics.chain.frames([0.0] * kinematics.n)[0]
    upright = np.allclose(np.array([*first.z, *first.p[:2]], dtype=np.float64), (0, 0, 1, 0, 0))
    if kinematics.n != JOINTS or not upright or arm.gripper is None or max(upper.max(), -lower.min()) > np.pi + 1e-6:
        raise InputError(
            f"arm {arm.name!r} cannot be judged fast: it needs six joints within ±pi, the first about the world's "
            "z axis, and a gripper; use CollisionChecker"
        )
    obstacles = arm.workcell.obstacles
    foot = frozenset(box.name for box in obstacles if np.hypot(*box.size[:2]) < 2 * FOOT_WIDTH)
    beside = [box for box in obstacles if box.name not in foot]
    if len(beside) < 2:
        raise InputError(f"the work cell of {arm.name!r} needs a table and a floor, it has {[b.name for b in beside]}")
    table = max(beside, key=lambda box: box.position[2] + box.size[2] / 2).name
    shapes = CellShapes(checker, frozenset(box.name for box in obstacles))
    wrist = WristClearance(
        kinematics.chain,
        shapes.bodies(lambda part: part.joint >= 4),
        table=shapes.bodies(lambda part: part.name == table)[0],
        ground=shapes.bodies(lambda part: part.obstacle and part.name not in foot and part.name != table),
        foot=shapes.bodies(lambda part: part.name in foot),
        base=shapes.bodies(lambda part: part.joint == -1 and not part.obstacle),
        shoulder=shapes.bodies(lambda part: part.joint == 0),
    )
    certain = float(min(upper.min(), -lower.max())) - 1e-6  # nearer to the limits single precision does not do
    return _Model(kinematics, checker, lower, upper, certain, _arcs(shapes, table, foot), wrist)


def _arcs(shapes: CellShapes, table: str, foot: frozenset[str]) -> Program:
    """Whether links up to wrist_1 touch the work cell, and whether two links touch each other.

    Where forearm or wrist_1 touch the base they touch the shoulder or what the base stands on, too. The averaged joints
    matter little: wrist_1 is nearly round about its axis, and the gripper rarely decides over the upper arm.
    """

    def table_of(arcs: Arcs, choose: Callable[[Part, Part], bool]) -> BlockedArcs:
        return BlockedArcs(arcs, shapes.test(choose), JOINTS)

    cell = (
        table_of(Arcs(1, (0,), (256,)), lambda a, b: a.joint == -1 and b.joint == 1),
        table_of(Arcs(2, (0, 1), (24, 24), averaged=3), lambda a, b: a.name == table and b.joint in (2, 3)),
        table_of(Arcs(2, (0, 1), (32, 32), averaged=3), lambda a, b: a.name in foot and b.joint in (2, 3)),
    )
    links = (
        table_of(Arcs(2, (1,), (128,), averaged=3), lambda a, b: a.joint == 0 and b.joint in (2, 3)),
        table_of(Arcs(2, (3, 4), (32, 16), averaged=5), lambda a, b: a.joint == 1 and b.joint >= 3),
        table_of(Arcs(4, (3, 5), (48, 48)), lambda a, b: a.joint == 2 and b.joint >= 4),
    )

    def formula(q: Sequence[Entry]) -> list[Entry]:
        return [any_of([blocked.blocked(q) for blocked in group]) for group in (cell, links)]

    return Program(formula, JOINTS)
