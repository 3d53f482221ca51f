"""The self-motion of a seven-axis arm: all postures of a pose, as curves in joint space.

The first joint and the last are held, one after the other, at values all around their circles. The six-axis arm that
is left has finitely many postures for each, by closed form or elimination (`method_of`). These, and those that only
just do not exist, lead to the curves by Newton's method with all seven joints: a curve that lies between two of the
values is found, too. From some of these postures the curves are followed all at once, by a tangent and Newton's method
(Burdick, On the inverse kinematics of redundant manipulators: characterization of the self-motion manifolds, ICRA
1989), each up to the next such posture. What is then on no curve starts one more.

A curve has a direction: that of the tangent t with det [J; t] > 0. So from every posture there is one way to go, and
if two arrive at the same posture, one has left its curve; it is followed again by shorter steps.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.kinematics._angles import TURN, wrapped
from kinreach.kinematics._chain import SerialChain
from kinreach.kinematics._general_6r import Chain
from kinreach.kinematics._six_axis.methods import Method, method_of
from kinreach.robots._rotations import turns_about_z

JOINTS = 7
#: Values at which a joint is held, and postures from which curves are followed at once.
VALUES, SEEDS = 48, 64
#: How often that is done at most; all curves of a pose that is not singular are found in one to three rounds.
ROUNDS = 8
#: Longest and shortest step along a curve [rad], and most steps.
LONGEST, SHORTEST, MAX_STEPS = 0.1, 1e-6, 4000
#: By how much shorter the steps are where a curve was left, and how often.
SHORTER, TRIES = 4.0, 3
#: A posture is on a curve if it misses the pose by less [m, rad]; steps of Newton's method to get there.
ON_CURVE, NEWTON = 1e-11, 4
#: Beside a singular posture Newton's method is slow; what misses the pose by less goes on [m, rad].
SLOW = 1e-4
#: Longest step of a joint in Newton's method [rad].
MAX_JOINT_STEP = 0.3
#: Smallest singular value of the Jacobian at a posture whose curve cannot be followed; and by how much a pose is moved
#: where all of a curve is like that [m, rad].
SINGULAR, INWARDS = 3e-6, 1e-10
#: Two postures nearer than this are one [rad].
SAME = 1e-5
#: Cosine between the tangents at both ends of a step; and how far a curve that bends by that is beside its tangent, in
#: shares of the step, and a little more.
STRAIGHT, ASIDE = 0.97, 0.15
#: Multiples of it, modulo 1, are spread evenly.
GOLDEN = 0.6180339887498949
#: What is added to a matrix before it is inverted.
NUDGE = 1e-14

#: Postures along a curve [rad], shape (m, 7), without jumps, and whether it is closed.
Curve = tuple[Floats, bool]


class _Sweep:
    """A joint that is held at values all around its circle, and how the six others are solved."""

    def __init__(self, held: int, placements: Floats, method: Method) -> None:
        self.held, self.method, self._placements = held, method, placements
        self.values: Floats = TURN * (np.arange(VALUES) + 0.382) / VALUES - np.pi

    def starts(self, T: Floats, shift: float) -> Floats:
        """Postures (m, 7) near those of a pose (4, 4) with the held joint at its values, moved by a part of a step."""
        values = self.values + shift * TURN / len(self.values)
        q, value = self.method.starts(self.poses(values, T))
        return np.insert(q, self.held, values[value], axis=1)

    def poses(self, values: Floats, T: Floats) -> Floats:
        """Poses of the six-axis arm for values of the held joint, shape (m, 4, 4)."""
        turns, A = turns_about_z(values), self._placements
        if self.held == 0:
            return np.linalg.inv(A[0] @ turns) @ T
        return T @ np.linalg.inv(turns @ A[JOINTS])


class SelfMotionTracer:
    """All self-motion curves of a seven-axis arm."""

    def __init__(self, chain: SerialChain) -> None:
        A = chain.placements
        self._loop = Chain(A)
        methods = [(JOINTS - 1, method_of(A[:JOINTS])), (0, method_of(A[1:]))]
        ways = [_Sweep(held, A, method) for held, method in methods if not isinstance(method, float)]
        self._reach = float(np.linalg.norm(A[1:, :3, 3], axis=1).sum())
        self._sweeps = sorted(ways, key=lambda sweep: -sweep.method.rank)

    @property
    def sound(self) -> bool:
        """Whether a six-axis arm that is left can be solved."""
        return bool(self._sweeps)

    @property
    def rank(self) -> int:
        """Of the better method of the two ends, as in `Method`."""
        return self._sweeps[0].method.rank

    def curves(self, T: Floats) -> list[Curve]:
        """Compute all curves of a pose of the tip, shape (4, 4)."""
        if np.linalg.norm(T[:3, 3] - self._loop.placements[0][:3, 3]) > self._reach:
            return []
        curves: list[Curve] = []
        q = self._starts(T)
        if len(q):
            T, q = self._beside_boundary(T, q)
        for _ in range(ROUNDS):
            if not len(q):
                break
            spread = np.argsort(np.arange(len(q)) * GOLDEN % 1.0)
            found = self._followed(_each_once(q[spread[:SEEDS]]), T)
            curves += [curve for curve in found if 2 * len(self.beside(curves, curve[0], T)) > len(curve[0])]
            q = self.beside(curves, q[spread[SEEDS:]], T)
        return curves

    def _starts(self, T: Floats) -> Floats:
        """Postures (m, 7) of a pose, on every curve."""
        for shift in (0.0, 0.5):  # with the elbow almost stretched a curve may lie between two values of both joints
            q = self._nearest(np.vstack([sweep.starts(T, shift) for sweep in self._sweeps]), T)
            if len(q):
                break
        return q

    def _beside_boundary(self, T: Floats, q: Floats) -> tuple[Floats, Floats]:
        """A pose and its postures (m, 7); if whole curves are singular, the pose `INWARDS` of it and its postures.

        With the elbow stretched axes 3 and 5 of many arms coincide. The tip is on the boundary of what it reaches, and
        a curve has no tangent of its own, as the elbow also bends without moving the tip. Two curves meet there, one
        for each side of the elbow.
        """
        U, s, _ = np.linalg.svd(self._loop.jacobian(q)[1])
        singular = s[:, 5] < SINGULAR
        if np.count_nonzero(singular) < 0.25 * len(q):
            return T, q
        v, w = np.split(U[np.argmax(singular), :, 5], 2)  # the tip cannot move along this twist
        found = []
        for sign in (1.0, -1.0):
            moved = T.copy()
            moved[:3, 3] += sign * INWARDS * v
            moved[:3, :3] += sign * INWARDS * np.cross(w, T[:3, :3], axisb=0, axisc=0)
            found.append((moved, self._starts(moved)))
        moved, near = max(found, key=lambda each: len(each[1]))
        return (moved, near) if len(near) else (T, q)

    def beside(self, curves: list[Curve], q: Floats, T: Floats) -> Floats:
        """Those of postures (m, 7) of a pose that are on none of some of its curves."""
        if not curves or not len(q):
            return q
        rounds = [np.vstack([curve, curve[: int(closed)]]) for curve, closed in curves]
        tangents = [self.tangents(each) for each in rounds]
        begin, out = (np.vstack([each[:-1] for each in values]) for values in (rounds, tangents))
        end, into = (np.vstack([each[1:] for each in values]) for values in (rounds, tangents))
        away = wrapped(end - begin)
        length = np.linalg.norm(away, axis=1)[:, None]
        row, piece = np.nonzero(JOINTS - _close(q, begin + 0.5 * away) < 0.2 * length[:, 0] ** 2)
        along, length = (away / length)[piece], length[piece]
        here = wrapped(q[row] - begin[piece])
        u = (here * along).sum(axis=1)[:, None] / length
        way = u * u * (3.0 - 2.0 * u) * length * along  # a cubic between the two samples
        way += length * u * (1.0 - u) * ((1.0 - u) * out[piece] - u * into[piece])
        way += ((here - way) * along).sum(axis=1)[:, None] * along
        there, _, _ = self.corrected(begin[piece] + way, T, along)
        same = np.abs(wrapped(there - q[row])).max(axis=1) < SAME
        return np.delete(q, row[same], axis=0)

    def corrected(
        self, q: Floats, T: Floats, direction: Floats, *, steps: int = NEWTON
    ) -> tuple[Floats, Floats, Floats]:
        """Bring postures to a pose by Newton's method, across a direction.

        Args:
            q: Postures near the curve [rad], shape (m, 7).
            T: Pose of the tip, shape (4, 4).
            direction: Along which they do not move, shape (m, 7).
            steps: Steps of Newton's method.

        Returns:
            Postures (m, 7); unit tangents of the curve there, nearest to the direction (m, 7); and how far the postures
            miss the pose [m, rad], shape (m,).
        """
        q, tangent, off = q.copy(), direction.copy(), np.full(len(q), np.inf)
        rows = np.arange(len(q))
        for left in range(steps, -1, -1):
            error, J, off[rows] = self._loop.step(q[rows], T[None])
            going = (off[rows] >= ON_CURVE) | (left == steps)
            rows, count = rows[going], np.count_nonzero(going)
            if not (left and count):
                break
            A, sides = np.empty((count, JOINTS, JOINTS)), np.zeros((count, JOINTS, 2))
            A[:, :6], A[:, 6] = J[going], direction[rows]
            sides[:, :6, 0], sides[:, 6, 1] = error[going], 1.0
            found = np.linalg.solve(A + NUDGE * np.eye(JOINTS), sides)
            q[rows] += _limited(found[..., 0])
            tangent[rows] = found[..., 1] / np.linalg.norm(found[..., 1], axis=1)[:, None]
        return q, tangent, off

    def with_held(self, T: Floats, seed: Floats) -> Floats:
        """Compute every posture (k, 7) for poses (m, 4, 4) in which a joint at an end keeps a seed's value (7,)."""
        sweep = self._sweeps[0]
        others = np.tile(np.delete(seed, sweep.held), (len(T), 1))
        q, valid = sweep.method.many(sweep.poses(np.full(len(T), seed[sweep.held]), T), others, 1e-7)
        branch, row = np.nonzero(valid)
        return np.insert(q[:, branch, row].T, sweep.held, seed[sweep.held], axis=1)

    def tangents(self, q: Floats) -> Floats:
        """Compute unit tangents of a curve at its postures (m, 7), in their order: J t = 0, to rounding."""
        steps = wrapped(np.diff(q, axis=0))
        ahead = np.vstack([steps[:1], steps[1:] + steps[:-1], steps[-1:]])
        A = np.concatenate([self._loop.step(q, np.eye(4)[None])[1], ahead[:, None]], axis=1)
        side = np.zeros((len(q), JOINTS, 1))
        side[:, 6] = 1.0
        t = np.linalg.solve(A + NUDGE * np.eye(JOINTS), side)[..., 0]
        return t / np.linalg.norm(t, axis=1)[:, None]

    def _tangent(self, q: Floats, T: Floats) -> Floats:
        """Unit tangents of curves at postures (m, 7), in the direction that all curves have."""
        t = np.linalg.svd(self._loop.step(q, T[None])[1])[2][:, 6]
        return self._sense(q, t, T)[:, None] * t

    def _sense(self, q: Floats, tangent: Floats, T: Floats) -> Floats:
        """1 where tangents at postures (m, 7) have the direction that all curves have, else -1."""
        J = self._loop.step(q, T[None])[1]
        return np.sign(np.linalg.det(np.concatenate([J, tangent[:, None]], axis=1)))

    def _nearest(self, q: Floats, T: Floats) -> Floats:
        """Bring postures (m, 7) to a pose by the shortest steps; those that arrive."""
        q, going, found = q.copy(), np.arange(len(q)), []
        for step in range(10 * NEWTON):
            error, J, off = self._loop.step(q[going], T[None])
            arrived = off < ON_CURVE
            found.append(going[arrived])
            left = ~arrived & ((step < 3 * NEWTON) | (off < SLOW))
            going, error, J = going[left], error[left], J[left]
            if not len(going):
                break
            turned = J.transpose(0, 2, 1)
            q[going] += _limited((turned @ np.linalg.solve(J @ turned + NUDGE * np.eye(6), error[..., None]))[..., 0])
        return wrapped(q[np.sort(np.concatenate(found))])

    def _followed(self, q: Floats, T: Floats) -> list[Curve]:
        """The curves of postures (m, 7)."""
        tangent, todo, longest = self._tangent(q, T), np.arange(len(q)), LONGEST
        after = np.full(len(q), -1)
        pieces: list[Floats] = [q[:0]] * len(q)
        for _ in range(TRIES):
            after[todo], found = self._pieces(q, todo, tangent, T, longest)
            for row, piece in zip(todo, found, strict=True):
                pieces[row] = piece
            arrivals = np.bincount(after[after >= 0], minlength=len(q))
            todo = np.flatnonzero((after < 0) | (arrivals[after] > 1))
            if not len(todo):
                break
            longest /= SHORTER
        first = np.flatnonzero(arrivals == 0)  # behind these a curve ends: at a posture where several meet
        _, behind = self._pieces(q, first, -tangent, T, longest)
        seen = np.zeros(len(q), dtype=np.bool_)
        curves = [
            (_joined([back[::-1], *_walked(pieces, after, row, seen)]), False)
            for row, back in zip(first.tolist(), behind, strict=True)
        ]
        curves += [(_joined(_walked(pieces, after, row, seen))[:-1], True) for row in range(len(q)) if not seen[row]]
        return [curve for curve in curves if len(curve[0]) > 1]

    def _pieces(
        self, seeds: Floats, which: NDArray[np.int64], tangent: Floats, T: Floats, longest: float
    ) -> tuple[NDArray[np.int64], list[Floats]]:
        """Follow the curves of some seeds (k, 7), each up to the next one.

        Args:
            seeds: Postures, shape (k, 7).
            which: Indices of those to start from, shape (m,).
            tangent: Which way, at each seed, shape (k, 7).
            T: Pose of the tip.
            longest: Step [rad].

        Returns:
            Indices of the next ones (m,), -1 if the curve ends at a singular posture, and postures up to there.
        """
        q, way, step = seeds[which], tangent[which], np.full(len(which), 0.5 * longest)
        sense = self._sense(q, way, T)
        pieces, next_one, going = [[posture] for posture in q.copy()], np.full(len(q), -1), np.arange(len(q))
        for _ in range(MAX_STEPS):
            if not len(going):
                break
            start = q[going] + step[going, None] * way[going]
            there, ahead, off = self.corrected(start, T, way[going])
            beside = np.linalg.norm(there - start, axis=1) < ASIDE * step[going]  # not on another curve
            good = (off < 1e-10) & beside & ((ahead * way[going]).sum(axis=1) > STRAIGHT)
            good[good] = self._sense(there[good], ahead[good], T) == sense[going[good]]
            moved = going[good]
            next_one[moved], end = self._passed(q[moved], way[moved], step[moved], there[good], seeds, T)
            q[moved], way[moved] = end, ahead[good]
            for row, posture in zip(moved, end, strict=True):
                pieces[row].append(posture)
            step[going[~good]] *= 0.5
            step[moved] = np.minimum(longest, 1.3 * step[moved])
            going = going[(step[going] > SHORTEST) & (next_one[going] < 0)]
        return next_one, [np.array(piece) for piece in pieces]

    def _passed(
        self, q: Floats, way: Floats, step: Floats, there: Floats, seeds: Floats, T: Floats
    ) -> tuple[NDArray[np.int64], Floats]:
        """Which seed comes first on the way from postures (m, 7) to others, -1 without one; and it, or the others."""
        row, seed = np.nonzero(JOINTS - _close(0.5 * (q + there), seeds) < 0.2 * step[:, None] ** 2)
        away = wrapped(seeds[seed] - q[row])
        along = (away * way[row]).sum(axis=1)
        on_way = (along > 0.5 * SAME) & (along < step[row] + 0.1 * SAME)
        row, seed, away, along = row[on_way], seed[on_way], away[on_way], along[on_way]
        first, end = np.full(len(q), -1), there.copy()
        if len(row):
            passed, _, _ = self.corrected(q[row] + along[:, None] * way[row], T, way[row])
            same = np.abs(wrapped(passed - seeds[seed])).max(axis=1) < SAME
            order = np.argsort(-along[same])
            row, seed, away = row[same][order], seed[same][order], away[same][order]
            first[row], end[row] = seed, q[row] + away
        return first, end


def _limited(steps: NDArray[Any]) -> Floats:
    """Steps (m, 7), none of a joint longer than `MAX_JOINT_STEP`."""
    longest = np.maximum(np.abs(steps).max(axis=1), MAX_JOINT_STEP)
    return steps * (MAX_JOINT_STEP / longest)[:, None]


def _close(q: Floats, others: Floats) -> Floats:
    """How close postures (m, 7) and (k, 7) are on the torus: the sums of the differences' cosines, shape (m, k)."""
    waves, other_waves = (np.hstack([np.cos(each), np.sin(each)]) for each in (q, others))
    return waves @ other_waves.T


def _each_once(q: Floats) -> Floats:
    """Postures (m, 7) without repetition."""
    away = np.abs(wrapped(q[:, None] - q)).max(axis=2)
    return q[~(np.tri(len(q), k=-1, dtype=np.bool_) & (away < SAME)).any(axis=1)]


def _walked(pieces: list[Floats], after: NDArray[np.int64], row: int, seen: NDArray[np.bool_]) -> list[Floats]:
    """The pieces of a curve from a seed on, until it ends or comes to one that was seen."""
    found = []
    while row >= 0 and not seen[row]:
        seen[row] = True
        found.append(pieces[row])
        row = int(after[row])
    return found


def _joined(pieces: list[Floats]) -> Floats:
    """Pieces of which each ends where the next begins, as one without jumps."""
    whole = pieces[0]
    for piece in pieces[1:]:
        whole = np.vstack([whole, piece[1:] + TURN * np.rint((whole[-1] - piece[0]) / TURN)])
    return whole
