"""How the postures of a six-axis arm are found, one class a way; all give the same."""

from __future__ import annotations

from functools import cached_property
from math import sqrt
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.kinematics._angles import wrapped
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
from kinreach.kinematics._near_closed_form import FAR, NearClosedForm
from kinreach.kinematics._six_axis.batch import solve_poses
from kinreach.kinematics._six_axis.closed_form import AMISS, DecoupledArm, Doubt, decouples
from kinreach.kinematics._six_axis.dh import DenavitHartenberg
from kinreach.kinematics._six_axis.near_misses import reached_beside
from kinreach.kinematics._solutions import ANGLES, BRANCH, FLAGS, Row
from kinreach.kinematics._ur.geometry import BRANCHES
from kinreach.robots._identification import moved_frames

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
#: By how much less postures in batches of a trial have to miss their poses for no other batch to be tested.
MARGIN = 100.0
#: Joints (0 is the first) that move the wrist.
POSITIONING = {0, 1, 2}
#: By how much starts of Newton's method may miss a pose [m, rad].
NEAR_MISS = 0.03
#: Random postures by which a method is judged, and the share that elimination has to find again.
TRIALS, MIN_SHARE = 100, 0.98
#: Samples of a family of postures are tested against so many others, and are apart by less than this [rad].
NEIGHBOURS, NEIGHBOURING = 4, 0.6
#: Starts of Newton's method near a singular pose, at most; and closer ones start one curve [rad].
MAX_STARTS, NEAR_START = 160, 0.1
#: Poses of an arm that are off by less make curves that almost reach [m, rad].
SLIGHT = 1e-5
#: A random posture is found again if each joint is within this of it [rad].
AGAIN = 1e-5
_JOINTS = 6


#: What the ranks of methods are called.
WAYS = ("by elimination", "by Newton's method from a closed form", "in closed form")


class Method(Protocol):
    """Finds every posture of poses.

    Attributes:
        branches: Most postures of a pose.
        rank: 2 in closed form, 1 nearly so, 0 by elimination.
        off: How far poses are from those of an arm of the closed form, at most [m, rad].
        special_axes: Axes that give the closed form, counted from 1 at the base, and what they do, with a place for an
            adverb; none without one.
        starts_all: Whether `starts` are near all postures; not if the arm's elimination is singular.
    """

    branches: int
    rank: int
    off: float
    special_axes: tuple[tuple[int, ...], str]
    starts_all: bool

    def one(self, T: Floats, seed: Floats, tol: float) -> list[Row]:
        """Compute the postures for a pose (4, 4): branch index, flags and angles of each, by branch index.

        Joints that are free keep the seed's value, as far as they can.
        """

    def many(
        self, T: Floats, seeds: Floats, tol: float, free: list[int] | None = None
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Compute postures (6, branches, m) for poses (m, 4, 4), NaN where there is none, and which there are.

        `free` learns the rows of poses with a flag, where joints may be free.
        """

    def starts(self, T: Floats) -> tuple[Floats, NDArray[np.int64]]:
        """Compute starts of Newton's method for poses (m, 4, 4), faster than `many`; some may be missing.

        Returns:
            Postures (k, 6) [rad] near those of a pose, and near some that only just do not exist; and which pose (k,).
        """


class ClosedForm:
    """An arm that decouples, to rounding."""

    branches, rank, starts_all = BRANCHES, 2, True

    def __init__(self, arm: DecoupledArm, placements: Floats) -> None:
        self._arm, self._chain = arm, Chain(placements)
        self.off, self.special_axes = 0.0, arm.special_axes
        self._exact = self._is_exact()

    def one(self, T: Floats, seed: Floats, tol: float) -> list[Row]:
        rows = sorted(self._arm.solve(T, tol=tol, seed=seed.tolist()))
        if not rows or any(row[FLAGS] for row in rows):
            return self._singular(T, seed, tol)
        if self._arm.by_shoulder and self._chain.reaches(np.array([row[ANGLES] for row in rows]), T, MISSED).all():
            return rows
        q, off = self._refined(rows, T, FAR)  # roots that almost merge are inexact
        if off.max() > MISSED or not first_of_each(q, SAME).all() or rows[-1][BRANCH] >= BRANCHES:
            return self._singular(T, seed, tol)
        return [(*row[: ANGLES.start], *angles) for row, angles in zip(rows, q.tolist(), strict=True)]

    def many(
        self, T: Floats, seeds: Floats, tol: float, free: list[int] | None = None
    ) -> tuple[Floats, NDArray[np.bool_]]:
        q, valid, singular = solve_poses(self._arm, T, tol)
        if not self._exact:
            branch, pose = np.nonzero(valid)
            singular[pose[missed_by(miss(self._chain.fk(q[:, branch, pose].T), T[pose])) > MISSED]] = True
        for row in np.flatnonzero(singular):
            q[..., row], valid[:, row] = np.nan, False
            rows = self.one(T[row], seeds[row], tol)
            for branch, _, *angles in rows:
                q[:, branch, row], valid[branch, row] = angles, True
            if free is not None and any(found[FLAGS] for found in rows):
                free.append(int(row))
        return q, valid

    def starts(self, T: Floats) -> tuple[Floats, NDArray[np.int64]]:
        return _starts(self._arm, T)

    def _is_exact(self) -> bool:
        """Whether all postures in batches of random poses, some nearly singular, miss by a small part of `MISSED`.

        If not, each posture of a batch is tested.
        """
        q, beside = _random_postures(), np.logspace(-1, -6, TRIALS)
        bent = q.copy()
        bent[:, 2] = self._arm.dh.sign[2] * (beside - self._arm.fore_angle - self._arm.dh.offset[2])
        q[::2, 4] = (self._arm.dh.sign[4] * (beside - self._arm.dh.offset[4]))[::2]
        q = np.vstack([q, bent])
        T = _poses(self._chain.fk(q))
        found, valid, singular = solve_poses(self._arm, T, EXACT)
        branch, pose = np.nonzero(valid & ~singular)
        off = missed_by(miss(self._chain.fk(found[:, branch, pose].T), T[pose]))
        return bool(off.max(initial=0.0) < MISSED / MARGIN)

    def _singular(self, T: Floats, seed: Floats, tol: float) -> list[Row]:
        """Postures of a pose that may be singular; if none is exact, those that miss it by up to `tol`.

        What is singular by less than the tolerance of the closed form is free, and otherwise it is not: several
        tolerances find the postures of both. Those that miss the pose go there by Newton's method. If the widest
        tolerance has one from which that fails, two singularities are close to each other, and all joints that are
        free take many values.
        """
        given = seed.tolist()
        rows, free = self._arm.near_singular(T, (MISSED, EXACT, tol, AMISS), given)
        q = np.array([row[ANGLES] for row in rows]).reshape(-1, _JOINTS)
        rows = [rows[index] for index in np.flatnonzero(first_of_each(q, SAME))]
        q, off = self._refined(rows, T, FAR)
        free &= POSITIONING | {_JOINTS - 1} if (off > MISSED).any() else POSITIONING
        samples = self._arm.samples(T, AMISS, given, free)
        if samples:
            more, missing = self._refined(samples, T, np.inf)
            rows, q, off = rows + samples, np.vstack([q, more]), np.append(off, missing)
        exact = np.flatnonzero(off <= MISSED)
        exact = exact[first_of_each(q[exact], SAME)]
        if samples:
            exact = exact[_families(self._chain, q[exact], T)]
        named: dict[int, int] = {}
        for index in exact.tolist() or np.flatnonzero(off <= tol).tolist():
            if rows[index][BRANCH] < BRANCHES:  # more roots than there are postures
                named.setdefault(rows[index][BRANCH], index)
        spare = [index for index in exact.tolist() if index not in named.values()]
        unnamed = [branch for branch in range(BRANCHES) if branch not in named]
        named |= dict(zip(unnamed, spare, strict=False))
        return [(branch, rows[named[branch]][FLAGS], *q[named[branch]].tolist()) for branch in sorted(named)]

    def _refined(self, rows: list[Row], T: Floats, far: float) -> tuple[Floats, Floats]:
        """Postures (m, 6) near those of rows, by Newton's method if they miss a pose; and by how much they do (m,).

        A joint that would move by `far` stays where it is [rad].
        """
        q = np.array([row[ANGLES] for row in rows]).reshape(-1, _JOINTS)
        poses = np.broadcast_to(T, (len(q), 4, 4))
        off = missed_by(miss(self._chain.fk(q), poses))
        some = np.flatnonzero(off > MISSED)
        if len(some):
            moved, missing = nearest_by_newton(self._chain, q[some], poses[some])
            nearer = (missing < off[some]) & (np.abs(moved - q[some]).max(axis=1) < far)
            some, moved, missing = some[nearer], moved[nearer], missing[nearer]
            q[some], off[some] = wrapped(moved), missing
        return q, off


class NearlyDecoupled(NearClosedForm):
    """An arm that almost decouples."""

    def __init__(self, arm: DecoupledArm, placements: Floats, off: float) -> None:
        super().__init__(placements)
        self._arm, self._off = arm, CAUTION * off
        self.off, self.special_axes = off, arm.special_axes

    @cached_property
    def _elimination(self) -> tuple[Method, float]:
        return by_elimination(self.chain.placements)

    def _start(self, T: Floats, seed: Floats) -> tuple[list[int], Floats, bool]:
        doubt = Doubt(self._off)
        rows = self._arm.solve(T, tol=EXACT, seed=seed.tolist(), doubt=doubt)
        q = np.array([row[ANGLES] for row in rows]).reshape(-1, _JOINTS)
        doubtful = any(row[FLAGS] or row[BRANCH] >= BRANCHES for row in rows)
        return [row[BRANCH] for row in rows], q, doubt.found or doubtful

    def _starts(self, T: Floats) -> tuple[Floats, NDArray[np.bool_], NDArray[np.bool_]]:
        q, valid, doubtful = solve_poses(self._arm, T, EXACT, off=self._off)
        if not self._arm.by_shoulder:
            for row, pose in enumerate(T):
                branches, found, doubtful[row] = self._start(pose, np.zeros(_JOINTS))
                q[:, branches, row], valid[branches, row] = found.T, True
        return q, valid, doubtful

    def _every(self, T: Floats, seeds: Floats, tol: float) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64]]:
        others, exist = self._elimination[0].many(T, seeds, EXACT)
        found = [
            (*row[ANGLES], pose, row[BRANCH])
            for pose, seed in enumerate(seeds)
            for row in self._near_singular(T[pose], seed, tol, others[:, exist[:, pose], pose].T)
        ]
        postures, indices = np.split(np.array(found).reshape(-1, _JOINTS + 2), [_JOINTS], axis=1)
        pose, branch = indices.T.astype(np.int64)
        return postures, pose, branch

    def starts(self, T: Floats) -> tuple[Floats, NDArray[np.int64]]:
        return _starts(self._arm, T)

    def _near_singular(self, T: Floats, seed: Floats, tol: float, eliminated: Floats) -> list[Row]:
        """Postures of a pose for which the closed form may have others; those near one of its have its branch index.

        By elimination; and by Newton's method from the closed form's postures for this pose, from the seed, and, where
        elimination may be singular for the arm, from those for other poses about it, too.
        """
        sound, wide, given = self._elimination[1] >= MIN_SHARE, 10.0 * self._off, seed.tolist()
        near = self._arm.solve(T, tol=wide, seed=given)
        # At one singularity an angle moves by the root of what the arm is off; at a second, that counts.
        rows, free = self._arm.near_singular(T, (sqrt(wide),), given)
        rows += near + self._arm.samples(T, sqrt(wide), given, free)
        if not sound:
            rows += [row for pose in self._about(T) for row in self._arm.solve(pose, tol=wide, seed=given)]
        starts = np.array([row[ANGLES] for row in rows]).reshape(-1, _JOINTS)
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
        exact = self._arm.solve(T, tol=EXACT, seed=given)
        near_by = sorted(
            (wider, float(np.abs(wrapped(one - row[ANGLES])).max()), index, int(row[BRANCH]))
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

    def one(self, T: Floats, seed: Floats, tol: float) -> list[Row]:
        (found,) = self._general.solve(T[None], tol=tol)
        return [(index, 0, *q) for index, q in enumerate(found.tolist())]

    def many(
        self, T: Floats, seeds: Floats, tol: float, free: list[int] | None = None
    ) -> tuple[Floats, NDArray[np.bool_]]:
        q, counts = self._general.postures(T, tol=tol)
        return np.ascontiguousarray(q.T), np.arange(MAX_POSTURES)[:, None] < counts

    def starts(self, T: Floats) -> tuple[Floats, NDArray[np.int64]]:
        return self._general.starts(T)


class Backwards:
    """The same arm from its tip to its base."""

    def __init__(self, method: Method) -> None:
        self._method, self.branches, self.rank, self.starts_all = (
            method,
            method.branches,
            method.rank,
            method.starts_all,
        )
        axes, what = method.special_axes
        self.off, self.special_axes = method.off, (tuple(_JOINTS + 1 - axis for axis in reversed(axes)), what)

    def one(self, T: Floats, seed: Floats, tol: float) -> list[Row]:
        rows = self._method.one(_inverse(T), -seed[::-1], tol)
        return [(branch, flags, *[-angle for angle in q[::-1]]) for branch, flags, *q in rows]

    def many(
        self, T: Floats, seeds: Floats, tol: float, free: list[int] | None = None
    ) -> tuple[Floats, NDArray[np.bool_]]:
        q, valid = self._method.many(_inverse(T), -seeds[:, ::-1], tol, free)
        return -q[::-1], valid

    def starts(self, T: Floats) -> tuple[Floats, NDArray[np.int64]]:
        q, pose = self._method.starts(_inverse(T))
        return -q[:, ::-1], pose


def method_of(placements: Floats) -> Method | float:
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


def _closed_forms(placements: Floats) -> tuple[dict[bool, list[Method]], dict[bool, list[Method]]]:
    """The closed forms that an arm has, by whether they are well-conditioned; and nearly has, by whether closely."""
    ways = list(enumerate((placements, _inverse(placements[::-1]))))
    closed: dict[bool, list[Method]] = {True: [], False: []}
    near: dict[bool, list[tuple[float, Method]]] = {True: [], False: []}
    for backwards, way in ways:
        dh = DenavitHartenberg.of(way, length=EXACTLY[0], angle=EXACTLY[1])
        if decouples(dh) and _apart(dh, Chain(way)) < EXACT_FIT:
            arm = DecoupledArm(dh)
            sound = arm.length_divisor > NEARLY[0] and arm.sine_divisor > NEARLY[1]
            closed[sound].append(_from_end(ClosedForm(arm, way), backwards=backwards))
        dh = DenavitHartenberg.of(way, length=NEARLY[0], angle=NEARLY[1])
        off = _apart(dh, Chain(way))
        if off < NEAR_FIT and decouples(dh):
            method = _from_end(NearlyDecoupled(DecoupledArm(dh), way, off), backwards=backwards)
            near[off <= CLOSE_FIT].append((off, method))
    return closed, {
        close: [method for _, method in sorted(each, key=lambda fit: fit[0])] for close, each in near.items()
    }


def _finds_again(method: Method, placements: Floats) -> bool:
    """Whether random postures are among those for their poses, and none of these misses its pose."""
    q, chain = _random_postures(), Chain(placements)
    T = _poses(chain.fk(q))
    found, valid = method.many(T, np.zeros_like(q), EXACT)
    branch, pose = np.nonzero(valid)
    postures = found[:, branch, pose].T
    if missed_by(miss(chain.fk(postures), T[pose])).max(initial=0.0) > MISSED:
        return False
    again = np.abs(wrapped(postures - q[pose])).max(axis=1) < AGAIN
    return len(np.unique(pose[again])) == len(q)


def by_elimination(placements: Floats) -> tuple[Method, float]:
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
    away = wrapped(q[:, None] - q)
    distance = np.abs(away).max(axis=2)
    near = np.argsort(distance, axis=1)[:, 1 : 1 + NEIGHBOURS]
    one, other = np.repeat(np.arange(len(q)), near.shape[1]), near.ravel()
    close = distance[one, other] < NEIGHBOURING
    one, other = one[close], other[close]
    step = away[other, one]
    middle = q[one] + 0.5 * step
    found, off = nearest_by_newton(chain, middle, np.broadcast_to(T, (len(middle), 4, 4)))
    moved, apart = (np.abs(each).max(axis=1, initial=0.0) for each in (found - middle, step))
    joined = (off < MISSED) & (moved < 0.2 * apart)
    label = np.arange(len(q))
    for a, b in zip(one[joined].tolist(), other[joined].tolist(), strict=True):
        label[label == max(label[a], label[b])] = min(label[a], label[b])
    return label == np.arange(len(q))


def _inverse(T: Floats) -> Floats:
    return np.asarray(np.linalg.inv(T), dtype=np.float64)


def _from_end(method: Method, *, backwards: int) -> Method:
    return Backwards(method) if backwards else method


def _starts(arm: DecoupledArm, T: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """`Method.starts` of a closed form: its postures; and those of a wide tolerance, where a branch has none."""
    q, valid, singular = solve_poses(arm, T, EXACT)
    branch, pose = np.nonzero(valid)
    asked = [(row, EXACT) for row in np.flatnonzero(singular)]
    asked += [(row, NEAR_MISS) for row in np.flatnonzero(~valid.all(axis=0))]
    found = [(row, each[ANGLES]) for row, tol in asked for each in arm.solve(T[row], tol=tol, seed=[0.0] * _JOINTS)]
    others = np.array([angles for _, angles in found]).reshape(-1, _JOINTS)
    rows = np.array([row for row, _ in found], dtype=np.int64)
    return np.vstack([q[:, branch, pose].T, others]), np.concatenate([pose, rows])


def _apart(dh: DenavitHartenberg, chain: Chain) -> float:
    """How far the poses of two arms are apart at most, over random postures [m, rad]."""
    q = _random_postures()
    return float(np.abs(dh.fk(q)[:, :3] - chain.fk(q)).max())


def _poses(rows: Floats) -> Floats:
    """Homogeneous transforms (m, 4, 4) from their upper rows (m, 3, 4)."""
    T = np.tile(np.eye(4), (len(rows), 1, 1))
    T[:, :3] = rows
    return T


def _random_postures() -> Floats:
    return np.random.default_rng(0).uniform(-np.pi, np.pi, (TRIALS, _JOINTS))
