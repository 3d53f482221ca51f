"""How the postures of a six-axis arm are found, one class a way; all give the same."""

from __future__ import annotations

from functools import cached_property
from math import sqrt
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach._rotations import joints_apart, wrapped
from kinreach.kinematics._core import Struct, doubles, flags, ints, lib, longs
from kinreach.kinematics._general_6r import (
    EXACT,
    MAX_POSTURES,
    SAME,
    SAME_START,
    Chain,
    General6R,
    first_of_each,
    miss,
    missed_by,
    nearest_by_newton,
)
from kinreach.kinematics._six_axis.dh import ROWS, DecoupledArm, DenavitHartenberg, decouples
from kinreach.kinematics._six_axis.near_misses import reached_beside
from kinreach.kinematics._solutions import ANGLES, BRANCH, Row
from kinreach.kinematics._ur.geometry import BRANCHES
from kinreach.robots.inside import moved_frames

#: Lengths [m] and angles [rad] below which an arm of the closed form has zeros: exactly, and nearly.
EXACTLY, NEARLY = (1e-9, 1e-9), (3e-3, 5e-3)
#: How far an arm of the closed form may be off its parameters [m, rad]; one that is nearly of it; and one of which the
#: closed form is used only if elimination is singular.
EXACT_FIT, CLOSE_FIT, NEAR_FIT = 1e-10, 1e-3, 0.03
#: Smallest singular value of the Jacobian of an arm that is singular in every posture, and of one that is nearly.
ALWAYS_SINGULAR, NEARLY_SINGULAR = 1e-9, 1e-3
#: What `method_of` returns for it.
SINGULAR = -1.0
#: By how many times that a pose may be missed by the closed form and yet be reached.
CAUTION = 3.0
#: By how much a posture may miss its pose and be counted as exact [m, rad].
MISSED = 1e-9
#: Newton's method moves a joint less than this on the way to the posture of the same branch [rad].
FAR = 0.1
#: Random postures by which a method is judged, and the share that elimination has to find again.
TRIALS, MIN_SHARE = 100, 0.98
#: Starts of Newton's method near a singular pose, at most; and closer ones start one curve [rad].
MAX_STARTS, NEAR_START = 160, 0.1
#: Poses of an arm that are off by less make curves that almost reach [m, rad].
SLIGHT = 1e-5
#: A random posture is found again if each joint is within this of it [rad].
AGAIN = 1e-5
_JOINTS = 6


#: What the ranks of methods are called.
WAYS = ("by elimination", "by Newton's method from a closed form", "in closed form")


class IKMethod(Protocol):
    """Finds every posture of poses.

    Attributes:
        branches: Most postures of a pose.
        rank: 2 in closed form, 1 nearly so, 0 by elimination.
        off: How far poses are from those of an arm of the closed form, at most [m, rad].
        special_axes: Axes that give the closed form, counted from 1 at the base, and what they do, with a place for an
            adverb; none without one.
        starts_all: Whether `starts` are near all postures; not if the arm's elimination is singular.
        compiled: How the core finds all of a pose alone, and what it needs for that; None if it does not.
    """

    branches: int
    rank: int
    off: float
    special_axes: tuple[tuple[int, ...], str]
    starts_all: bool

    @property
    def compiled(self) -> tuple[int, Struct] | None: ...

    def many(self, T: Floats, seeds: Floats, tol: float) -> tuple[Floats, NDArray[np.bool_]]:
        """Compute postures (6, branches, m) for poses (m, 4, 4), NaN where there is none, and which there are.

        Joints that are free keep the values of the pose's seed (m, 6), as far as they can.
        """

    def starts(self, T: Floats) -> tuple[Floats, NDArray[np.int64]]:
        """Compute starts of Newton's method for poses (m, 4, 4), faster than `many`; some may be missing.

        Returns:
            Postures (k, 6) [rad] near those of a pose, and near some that only just do not exist; and which pose (k,).
        """


class ClosedForm:
    """An arm that decouples, to rounding."""

    branches, rank, starts_all = BRANCHES, 2, True

    def __init__(self, arm: DecoupledArm) -> None:
        self._arm = arm
        self.off, self.special_axes = 0.0, arm.special_axes

    @property
    def compiled(self) -> tuple[int, Struct]:
        return lib.KR_DECOUPLED, self._arm.core

    def many(self, T: Floats, seeds: Floats, tol: float) -> tuple[Floats, NDArray[np.bool_]]:
        q, valid = np.empty((len(T), BRANCHES, _JOINTS)), np.empty((len(T), BRANCHES), dtype=np.bool_)
        poses, starts = np.ascontiguousarray(T), np.ascontiguousarray(seeds)
        lib.kr_decoupled_postures_of_each(
            self._arm.core.pointer, doubles(poses), doubles(starts), len(T), tol, doubles(q), flags(valid)
        )
        return q.T, valid.T

    def starts(self, T: Floats) -> tuple[Floats, NDArray[np.int64]]:
        return _starts(self._arm, T)


class NearlyDecoupled:
    """An arm that almost decouples.

    1. The closed form has the postures of the other arm. It also tells whether a pose may have a different number of
       postures on this arm, because a singular pose is close. If not, each branch has exactly one posture.
    2. Newton's method goes from the closed form's postures to those of this arm. Each has to stay on its branch.
    3. The postures of all other poses are found by elimination, which knows no branches.
    """

    branches, rank, starts_all = MAX_POSTURES, 1, True
    compiled = None

    def __init__(self, arm: DecoupledArm, placements: Floats, off: float) -> None:
        self.chain, self._arm, self._off = Chain(placements), arm, CAUTION * off
        self.off, self.special_axes = off, arm.special_axes

    @cached_property
    def _elimination(self) -> tuple[IKMethod, float]:
        return by_elimination(self.chain.placements)

    def many(self, T: Floats, seeds: Floats, tol: float) -> tuple[Floats, NDArray[np.bool_]]:
        shape = len(T), MAX_POSTURES
        q, valid = np.empty((*shape, _JOINTS)), np.empty(shape, dtype=np.bool_)
        doubtful = np.empty(len(T), dtype=np.bool_)
        poses, starts = np.ascontiguousarray(T), np.ascontiguousarray(seeds)
        lib.kr_nearly_decoupled_of_each(
            self._arm.core.pointer, self._off, doubles(poses), doubles(starts), len(T), doubles(q), flags(valid),
            flags(doubtful),
        )  # fmt: skip
        rows = np.flatnonzero(doubtful)
        if len(rows):
            others, exist = self._elimination[0].many(T[rows], seeds[rows], EXACT)
            for pose, row in enumerate(rows):
                every = self._near_singular(T[row], seeds[row], tol, others[:, exist[:, pose], pose].T)
                for branch, _, *angles in every:
                    q[row, branch], valid[row, branch] = angles, True
        return q.T, valid.T

    def starts(self, T: Floats) -> tuple[Floats, NDArray[np.int64]]:
        return _starts(self._arm, T)

    def _near_singular(self, T: Floats, seed: Floats, tol: float, eliminated: Floats) -> list[Row]:
        """Postures of a pose for which the closed form may have others; those near one of its have its branch index.

        By elimination; and by Newton's method from the closed form's postures for this pose, from the seed, and, where
        elimination may be singular for the arm, from those for other poses about it, too.
        """
        sound, wide = self._elimination[1] >= MIN_SHARE, 10.0 * self._off
        near, _ = self._arm.rows(T, wide, seed)
        # At one singularity an angle moves by the root of what the arm is off; at a second, that counts.
        rows = [self._arm.rows(T, sqrt(wide), seed, samples=True)[0], near]
        if not sound:
            rows += [self._arm.rows(pose, wide, seed)[0] for pose in self._about(T)]
        starts = np.vstack(rows)[:, ANGLES]
        starts = starts[first_of_each(starts, SAME_START)]
        rng = np.random.default_rng(0)
        starts = starts[rng.permutation(len(starts))[:MAX_STARTS]]
        if self._off < SLIGHT:  # elimination is as good as singular where the closed form is
            more = reached_beside(self.chain, T, starts[first_of_each(starts, NEAR_START)])
        else:
            more = starts + rng.normal(size=starts.shape) * sqrt(self._off)
        starts = np.vstack([seed, starts, more])
        q, off = nearest_by_newton(self.chain, starts, np.broadcast_to(T, (len(starts), 4, 4)))
        every = np.vstack([eliminated, wrapped(q[off < EXACT])])
        if not len(every):
            every = wrapped(q[off < tol])
        every = every[first_of_each(every, SAME)]
        if len(every) > MAX_POSTURES:
            every = every[_families(self.chain, every, T)][:MAX_POSTURES]
        exact, _ = self._arm.rows(T, EXACT, seed)
        near_by = sorted(
            (wider, float(joints_apart(one, row[ANGLES])), index, int(row[BRANCH]))
            for wider, rows in enumerate((exact, near))  # a wide tolerance may count other branches
            for row in rows
            for index, one in enumerate(every)
        )
        named: dict[int, int] = {}
        for _, apart, index, branch in near_by:  # each branch is that of the posture nearest to the closed form's
            if apart < FAR and branch not in named and index not in named.values():
                named[branch] = index
        order = np.lexsort(every.T)
        spare = iter([branch for branch in (*range(BRANCHES, MAX_POSTURES), *range(BRANCHES)) if branch not in named])
        known = set(named.values())
        named |= {next(spare): index for index in order.tolist() if index not in known}
        return [(branch, 0, *every[named[branch]].tolist()) for branch in sorted(named)]

    def _about(self, T: Floats) -> list[Floats]:
        """The poses that are off by as much as the two arms along each axis."""
        return list(moved_frames(T[None], self._off * np.concatenate([np.eye(6), -np.eye(6)])))


class Elimination:
    """Postures of an arm without a closed form, by elimination."""

    branches, rank = MAX_POSTURES, 0

    def __init__(self, general: General6R) -> None:
        self._general = general
        self.off, self.starts_all = np.inf, not general.singular
        self.special_axes: tuple[tuple[int, ...], str] = ((), "")

    @property
    def compiled(self) -> tuple[int, Struct]:
        return lib.KR_ELIMINATION, self._general.arm

    def many(self, T: Floats, seeds: Floats, tol: float) -> tuple[Floats, NDArray[np.bool_]]:
        q, counts = self._general.postures(T, tol=tol)
        return np.ascontiguousarray(q.T), np.arange(MAX_POSTURES)[:, None] < counts

    def starts(self, T: Floats) -> tuple[Floats, NDArray[np.int64]]:
        return self._general.starts(T)


class Backwards:
    """The same arm from its tip to its base."""

    def __init__(self, method: IKMethod) -> None:
        self._method, self.branches, self.rank, self.starts_all = (
            method,
            method.branches,
            method.rank,
            method.starts_all,
        )
        axes, what = method.special_axes
        self.off, self.special_axes = method.off, (tuple(_JOINTS + 1 - axis for axis in reversed(axes)), what)

    @property
    def compiled(self) -> tuple[int, Struct] | None:
        way = self._method.compiled
        return way and (way[0] + lib.KR_BACKWARDS, way[1])

    def many(self, T: Floats, seeds: Floats, tol: float) -> tuple[Floats, NDArray[np.bool_]]:
        q, valid = self._method.many(_inverse(T), -seeds[:, ::-1], tol)
        return -q[::-1], valid

    def starts(self, T: Floats) -> tuple[Floats, NDArray[np.int64]]:
        q, pose = self._method.starts(_inverse(T))
        return -q[:, ::-1], pose


def method_of(placements: Floats) -> IKMethod | float:
    """Choose how an arm is solved: in closed form, nearly so, or by elimination, from its base or from its tip.

    Returns:
        The method; or, if there is none, the share of random postures that elimination finds again, `SINGULAR`
        if every posture is singular.
    """
    _, J = Chain(placements).jacobian(_random_postures())
    least = np.linalg.svd(J)[1][:, -1].max()
    if least < ALWAYS_SINGULAR:
        return SINGULAR
    closed, near = _closed_forms(placements)
    for method in (*closed[True], *near[True], *closed[False]):
        if _finds_again(method, placements):
            return method
    method, share = by_elimination(placements)
    if share >= MIN_SHARE:
        return method
    if near[False]:
        return near[False][0]
    # where that is the equations' fault, not the arm's, eigenvalues of several joints have all postures together
    return method if least > NEARLY_SINGULAR and _finds_again(method, placements) else share


def _closed_forms(placements: Floats) -> tuple[dict[bool, list[IKMethod]], dict[bool, list[IKMethod]]]:
    """The closed forms that an arm has, by whether they are well-conditioned; and nearly has, by whether closely."""
    ways = list(enumerate((placements, _inverse(placements[::-1]))))
    closed: dict[bool, list[IKMethod]] = {True: [], False: []}
    near: dict[bool, list[tuple[float, IKMethod]]] = {True: [], False: []}
    for backwards, way in ways:
        dh = DenavitHartenberg.of(way, length=EXACTLY[0], angle=EXACTLY[1])
        if decouples(dh) and _apart(dh, Chain(way)) < EXACT_FIT:
            arm = DecoupledArm(dh, way[:, :3])
            closed[arm.sound(*NEARLY)].append(_from_end(ClosedForm(arm), backwards=backwards))
        dh = DenavitHartenberg.of(way, length=NEARLY[0], angle=NEARLY[1])
        off = _apart(dh, Chain(way))
        if off < NEAR_FIT and decouples(dh):
            method = _from_end(NearlyDecoupled(DecoupledArm(dh, way[:, :3]), way, off), backwards=backwards)
            near[off <= CLOSE_FIT].append((off, method))
    return closed, {
        close: [method for _, method in sorted(each, key=lambda fit: fit[0])] for close, each in near.items()
    }


def _finds_again(method: IKMethod, placements: Floats) -> bool:
    """Whether random postures are among those for their poses, and none of these misses its pose."""
    q, chain = _random_postures(), Chain(placements)
    T = _poses(chain.fk(q))
    found, valid = method.many(T, np.zeros_like(q), EXACT)
    branch, pose = np.nonzero(valid)
    postures = found[:, branch, pose].T
    if missed_by(miss(chain.fk(postures), T[pose])).max(initial=0.0) > MISSED:
        return False
    again = joints_apart(postures, q[pose]) < AGAIN
    return len(np.unique(pose[again])) == len(q)


def by_elimination(placements: Floats) -> tuple[IKMethod, float]:
    """Solve an arm by elimination from its base or its tip, and the share of random postures that it finds again."""
    q = _random_postures()
    back = _inverse(placements[::-1])
    ways = (placements, q), (back, -q[:, ::-1])
    methods = [General6R(Chain(way)) for way, _ in ways]
    shares = [general.tried(postures) for general, (_, postures) in zip(methods, ways, strict=True)]
    best = int(np.argmax(shares))
    return _from_end(Elimination(methods[best]), backwards=best), shares[best]


def _families(chain: Chain, q: Floats, T: Floats) -> NDArray[np.bool_]:
    """Which of the postures (m, 6) of a pose (4, 4) are the first of those from which the arm moves to one another."""
    first, postures, pose = np.empty(len(q), dtype=np.int32), np.ascontiguousarray(q), np.ascontiguousarray(T)
    lib.kr_families(doubles(chain.rows), doubles(pose), doubles(postures), len(q), ints(first))
    return first == np.arange(len(q))


def _inverse(T: Floats) -> Floats:
    return np.asarray(np.linalg.inv(T), dtype=np.float64)


def _from_end(method: IKMethod, *, backwards: int) -> IKMethod:
    return Backwards(method) if backwards else method


def _starts(arm: DecoupledArm, T: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """`IKMethod.starts` of a closed form: its postures; and those of a wide tolerance, where a branch has none."""
    room, poses = 2 * ROWS * len(T), np.ascontiguousarray(T)
    q, pose = np.empty((room, _JOINTS)), np.empty(room, dtype=np.int64)
    count = lib.kr_decoupled_starts(arm.core.pointer, doubles(poses), len(T), doubles(q), longs(pose))
    return q[:count], pose[:count]


def _apart(dh: DenavitHartenberg, chain: Chain) -> float:
    """How far the poses of two arms are apart at most, over random postures [m, rad]."""
    q = _random_postures()
    return float(np.abs(Chain(dh.placements).fk(q) - chain.fk(q)).max())


def _poses(rows: Floats) -> Floats:
    """Homogeneous transforms (m, 4, 4) from their upper rows (m, 3, 4)."""
    T = np.tile(np.eye(4), (len(rows), 1, 1))
    T[:, :3] = rows
    return T


def _random_postures() -> Floats:
    return np.random.default_rng(0).uniform(-np.pi, np.pi, (TRIALS, _JOINTS))
