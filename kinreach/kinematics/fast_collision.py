"""Whether postures are impossible, for thousands at once: joint limits, and collisions as `CollisionChecker` sees them.

For arms of the UR kind with the parallel gripper, three tests, each in the form in which it is cheapest:

*   Joint limits.
*   Links few joints apart, and everything up to wrist_1 against the work cell: tables of blocked arcs (`blocked_arcs`),
    measured on the meshes when the first object is made, which takes some seconds.
*   What is behind wrist_1 against the work cell, the base and the shoulder: geometry (`WristClearance`), exact for the
    gripper.

Where a table is in doubt, near the ends of an arc, the exact checker decides. For any other arm it decides always.
All of it is elementwise: the verdict on a posture depends neither on the others nor on how many there are. How often it
is that of `CollisionChecker` and of MuJoCo: `python -m benchmarks.studies.collision_agreement`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import IntEnum
from functools import lru_cache
from sys import float_info

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach.checks import Floats, as_floats, check_entries
from kinreach.errors import InputError
from kinreach.kinematics.arm import ArmKinematics
from kinreach.kinematics.blocked_arcs import Arcs, BlockedArcs, Flags, Single, collision_test, rows_of
from kinreach.kinematics.bodies import fits
from kinreach.kinematics.chain import blocks
from kinreach.kinematics.closed_form import kinematics_of
from kinreach.kinematics.collision import CollisionChecker, Shape
from kinreach.kinematics.solutions import SLACK as LIMIT_SLACK
from kinreach.kinematics.ur.kinematics import URKinematics
from kinreach.kinematics.wrist_clearance import WristClearance
from kinreach.robots import PARALLEL_GRIPPER, ArmDescription, as_arm

JOINTS = 6
#: An obstacle that is no wider than this from its centre [m] belongs to the arm's foot.
FOOT_WIDTH = 0.25

Codes = NDArray[np.uint8]


class Cause(IntEnum):
    """Why a posture is impossible; the first that is found."""

    NONE = 0
    LIMITS = 1
    SELF = 2
    OBSTACLE = 3


class FastCollision:
    """Judges many postures of one arm. Threads may share an instance.

    With `refine`, postures that the tables call free but are not sure of go to the exact checker. On random postures of
    the UR5 (80 000) the verdict then is the checker's in 99.5 %; one collision was missed, 0.9 mm deep. Without, it
    takes a tenth of the time and is the checker's in 99.3 %, but collisions are missed in 0.3 %, up to 40 mm deep (the
    UR3, whose gripper is large for it: 0.9 %, 50 mm).

    Args:
        arm: Name of a registered arm, or a description.
        refine: Whether the exact checker decides where the tables are in doubt.

    Attributes:
        arm: The description.
        refine: As given.

    Raises:
        UnknownNameError: There is no arm of that name.
        InputError: The arm's collision shapes cannot be read.
        InstallationError: Pinocchio or coal cannot be loaded.
    """

    def __init__(self, arm: str | ArmDescription = "ur5", *, refine: bool = True) -> None:
        self.arm, self.refine = as_arm(arm), refine
        self._model = _model(self.arm)

    def __reduce__(self) -> tuple[Callable[..., FastCollision], tuple[ArmDescription, bool]]:
        return _made, (self.arm, self.refine)  # the tables are quicker made than read

    def impossible(self, q: ArrayLike) -> Flags:
        """Which postures are outside the joint limits or collide.

        Args:
            q: Postures [rad], shape (m, n).

        Returns:
            Shape (m,).

        Raises:
            InputError: Wrong shape or a value that is not finite.
        """
        return self.causes(q) != Cause.NONE

    def causes(self, q: ArrayLike) -> Codes:
        """Why postures are impossible.

        Args:
            q: Postures [rad], shape (m, n).

        Returns:
            Values of `Cause`, shape (m,).

        Raises:
            InputError: Wrong shape or a value that is not finite.
        """
        q = as_floats("q", q)
        if q.ndim != 2 or q.shape[1] != len(self.arm.joints):
            raise InputError(f"q must have shape (m, {len(self.arm.joints)}), got {q.shape}")
        causes = np.empty(len(q), dtype=np.uint8)
        for block in blocks(len(q)):
            causes[block] = self._model.judge(q[block], refine=self.refine)
        return causes

    def reason(self, q: ArrayLike) -> str:
        """What makes one posture impossible, for people; empty if nothing does.

        Joints outside their limits, or the pair that is deepest in one another ("finger_left - table").

        Args:
            q: Posture [rad], shape (n,).

        Raises:
            InputError: Wrong shape or a value that is not finite.
        """
        q = self._model.kinematics.as_posture("q", q)
        cause = self.causes(q[None])[0]
        if cause == Cause.NONE:
            return ""
        if cause == Cause.LIMITS:
            return f"out of limits: {', '.join(self._model.kinematics.joints_outside_limits(q, tolerance=LIMIT_SLACK))}"
        one, other = self._model.deepest_pair(q)
        return f"{one} - {other}"


def _made(arm: ArmDescription, refine: bool) -> FastCollision:
    return FastCollision(arm, refine=refine)


class _Exact:
    """The exact checker, posture by posture: for arms without tables, and where tables are in doubt."""

    def __init__(self, kinematics: ArmKinematics, checker: CollisionChecker) -> None:
        self.kinematics, self._checker = kinematics, checker
        self.lower = kinematics.lower[:, None] - LIMIT_SLACK
        self.upper = kinematics.upper[:, None] + LIMIT_SLACK
        self._obstacles = {box.name for box in kinematics.arm.workcell.obstacles}

    def judge(self, q: Floats, *, refine: bool) -> Codes:
        """Causes for postures (m, n)."""
        check_entries("q", q, float_info.max)
        causes = np.full(len(q), Cause.LIMITS, dtype=np.uint8)
        within = self._within(q.T).all(axis=0)
        causes[within] = self.collisions(q[within])
        return causes

    def _within(self, columns: Floats) -> Flags:
        """Which angles are within the limits, one joint a row, shape (n, m)."""
        within: Flags = (columns >= self.lower) & (columns <= self.upper)
        return within

    def collisions(self, q: Floats) -> Codes:
        """Causes for postures (m, n) within the limits."""
        causes = np.zeros(len(q), dtype=np.uint8)
        for row in np.flatnonzero([self._checker.in_collision(posture) for posture in q]):
            pair = self._checker.distance(q[row]).pair
            causes[row] = Cause.OBSTACLE if self._obstacles & set(pair) else Cause.SELF
        return causes

    def deepest_pair(self, q: Floats) -> tuple[str, str]:
        """The two that are deepest in one another, an obstacle last."""
        one, other = self._checker.distance(q).pair
        return (other, one) if one in self._obstacles else (one, other)


class _Tabled(_Exact):
    """Tables and geometry for an arm of the UR kind within ±pi, the first joint upright, with a gripper and a table."""

    def __init__(self, kinematics: ArmKinematics, checker: CollisionChecker, table: str) -> None:
        super().__init__(kinematics, checker)
        # nearer to the limits single precision does not tell inside from outside
        self._certain = float(min(self.upper.min(), -self.lower.max())) - 1e-6
        foot = _foot(kinematics.arm)
        self._cell, self._links = _tables(checker, table, foot)
        self._over = {table.arcs.over for table in (*self._cell, *self._links)}
        self._wrist = WristClearance(kinematics.chain, checker, table=table, foot=foot)

    def judge(self, q: Floats, *, refine: bool) -> Codes:
        """Causes for postures (m, 6)."""
        with np.errstate(over="ignore"):  # what is too large for single precision is far outside the limits
            single = np.array(q.T, dtype=np.float32, order="C")
        if max(single.max(initial=0.0), -single.min(initial=0.0)) < self._certain:
            return self._collisions(single, q, refine)
        columns = np.ascontiguousarray(q.T)
        within = self._within(columns)
        if within.all():
            return self._collisions(single, q, refine)
        finite = np.isfinite(columns).all(axis=0)
        if not finite.all():
            raise InputError(f"q must be finite, got {q[finite.argmin()]}")
        clipped = np.clip(q, self.lower[:, 0], self.upper[:, 0])
        causes = self._collisions(np.clip(single, -np.float32(np.pi), np.float32(np.pi)), clipped, refine)
        causes[~within.all(axis=0)] = Cause.LIMITS
        return causes

    def _collisions(self, single: Single, q: Floats, refine: bool) -> Codes:
        """Causes for postures within the limits, in single and in double precision."""
        rows_over = {over: rows_of(single, over) for over in self._over}
        on_cell = _any([table.blocked(single, rows_over[table.arcs.over]) for table in self._cell])
        on_link = _any([table.blocked(single, rows_over[table.arcs.over]) for table in self._links])
        causes = _causes(on_cell, on_link)
        rows = np.flatnonzero(causes == Cause.NONE)
        causes[rows] = _causes(*self._wrist.touches(single.take(rows, axis=1)))
        if refine:
            tables = (*self._cell, *self._links)
            in_doubt = _any([table.doubtful(single, rows_over[table.arcs.over]) for table in tables])
            rows = np.flatnonzero(in_doubt & (causes == Cause.NONE))
            causes[rows] = self.collisions(q[rows])
        return causes


def _any(flags: Sequence[Flags]) -> Flags:
    return np.logical_or.reduce(flags)


def _causes(on_cell: Flags, on_arm: Flags) -> Codes:
    """Self-collision where both are so."""
    return np.where(on_arm, np.uint8(Cause.SELF), np.where(on_cell, np.uint8(Cause.OBSTACLE), np.uint8(Cause.NONE)))


@lru_cache(maxsize=4)
def _model(arm: ArmDescription) -> _Exact:
    kinematics = ArmKinematics(arm, base="world")
    checker = CollisionChecker(kinematics)
    table = _table(kinematics, checker)
    return _Exact(kinematics, checker) if table is None else _Tabled(kinematics, checker, table)


def _foot(arm: ArmDescription) -> frozenset[str]:
    """Names of the obstacles under the arm."""
    return frozenset(box.name for box in arm.workcell.obstacles if np.hypot(*box.size[:2]) < 2 * FOOT_WIDTH)


def _table(kinematics: ArmKinematics, checker: CollisionChecker) -> str | None:
    """Name of the highest obstacle beside an arm of the UR kind; None for any other arm, shapes or work cell."""
    arm = kinematics.arm
    largest = max(kinematics.upper.max(), -kinematics.lower.min()) + LIMIT_SLACK
    if kinematics.n != JOINTS or arm.gripper != PARALLEL_GRIPPER or largest > np.pi + 1e-6:
        return None
    (first,) = kinematics.chain.frames([0.0] * JOINTS, [0])
    upright = np.allclose(np.array([*first.z, *first.p[:2]], dtype=np.float64), (0, 0, 1, 0, 0))
    beside = [box for box in arm.workcell.obstacles if box.name not in _foot(arm)]
    if not upright or len(beside) < 2 or not all(map(fits, checker.geometry.geometryObjects)):
        return None
    shaped = {shape.joint for shape in checker.shapes if not shape.obstacle}
    if len(shaped) < 1 + JOINTS or not isinstance(kinematics_of(arm), URKinematics):
        return None
    return max(beside, key=lambda box: box.position[2] + box.size[2] / 2).name


def _tables(
    checker: CollisionChecker, table: str, foot: frozenset[str]
) -> tuple[Sequence[BlockedArcs], Sequence[BlockedArcs]]:
    """Tables of links up to wrist_1 on the work cell, and of two links on each other.

    Where forearm or wrist_1 touch the base they touch the shoulder or what the base stands on, too. The averaged joints
    matter little: wrist_1 is nearly round about its axis, and the gripper rarely decides over the upper arm.
    """

    def measured(arcs: Arcs, choose: Callable[[Shape, Shape], bool]) -> BlockedArcs:
        return BlockedArcs(arcs, collision_test(checker, choose), JOINTS)

    cell = (
        measured(Arcs(1, (0,), (256,)), lambda a, b: a.joint == -1 and b.joint == 1),
        measured(Arcs(2, (0, 1), (24, 24), averaged=3), lambda a, b: a.name == table and b.joint in (2, 3)),
        measured(Arcs(2, (0, 1), (32, 32), averaged=3), lambda a, b: a.name in foot and b.joint in (2, 3)),
        measured(
            Arcs(2, (1,), (128,), averaged=3),
            lambda a, b: a.obstacle and a.name not in (*foot, table) and b.joint in (2, 3),
        ),
    )
    links = (
        measured(Arcs(2, (1,), (128,), averaged=3), lambda a, b: a.joint == 0 and b.joint in (2, 3)),
        measured(Arcs(2, (3, 4), (32, 16), averaged=5), lambda a, b: a.joint == 1 and b.joint >= 3),
        measured(Arcs(4, (3, 5), (48, 48)), lambda a, b: a.joint == 2 and b.joint >= 4),
    )
    return [arcs for arcs in cell if arcs.any], [arcs for arcs in links if arcs.any]
