"""The self-motion of a seven-axis arm: all postures of a pose, as curves in joint space.

`Starts` finds postures on every curve. From some of them the curves are followed all at once, by a tangent and Newton's
method (Burdick, On the inverse kinematics of redundant manipulators: characterization of the self-motion manifolds,
ICRA 1989), each up to the next such posture. What is then on no curve starts one more, until nothing is left.

A curve has a direction: that of the tangent t with det [J; t] > 0. So from every posture there is one way to go, and
if two arrive at the same posture, one has left its curve; it is followed again by shorter steps. Two curves that almost
meet have opposite directions there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.kinematics._angles import TURN, wrapped
from kinreach.kinematics._chain import SerialChain
from kinreach.kinematics._general_6r import Chain, first_of_each
from kinreach.kinematics._seven_axis.starts import GOLDEN, JOINTS, NUDGE, REACHED, Starts, limited, solved
from kinreach.kinematics._seven_axis.surfaces import FREE, moved_onto, on_cover, surfaces_through

#: Postures from which curves are followed at once.
SEEDS = 64
#: Longest and shortest step along a curve [rad], and most steps.
LONGEST, SHORTEST, MAX_STEPS = 0.1, 1e-6, 4000
#: By how much shorter the steps are where a curve was left, and how often.
SHORTER, TRIES = 4.0, 3
#: Steps of Newton's method to get back to a curve; and a posture is on one if it misses the pose by less [m, rad].
NEWTON, ON_CURVE = 4, 1e-10
#: A posture that misses the pose by more is not returned [m, rad].
MISSED = 1e-9
#: By how much a pose is moved where all of a curve is singular [m, rad].
INWARDS = 1e-10
#: Smallest singular value up to which a curve may end at a posture: it crosses another there, or almost.
END = 1e-4
#: Two postures nearer than this are one [rad].
SAME = 1e-5
#: A posture from which no curve can be followed is part of one that comes nearer than this [rad].
BESIDE = 1e-4
#: Cosine between the tangents at both ends of a step; and how far a curve that bends by that is beside its tangent, in
#: shares of the step, and a little more.
STRAIGHT, ASIDE = 0.97, 0.15

#: Postures along a curve [rad], shape (m, 7), without jumps, and whether it is closed. A curve that is smaller than
#: `BESIDE` may be a single posture.
Curve = tuple[Floats, bool]


class SelfMotionTracer:
    """All self-motion curves of a seven-axis arm."""

    def __init__(self, chain: SerialChain) -> None:
        A = chain.placements
        self._loop = Chain(A)
        self._starts = Starts(self._loop)
        self._reach = float(np.linalg.norm(A[1:, :3, 3], axis=1).sum())

    @property
    def sound(self) -> bool:
        """Whether a six-axis arm that is left, when the first or the last joint is held, can be solved."""
        return bool(self._starts.ends)

    @property
    def rank(self) -> int:
        """Of the better method of the two ends, as in `Method`."""
        return self._starts.ends[0].method.rank

    def curves(self, T: Floats, seed: Floats | None = None) -> tuple[list[Curve], list[Floats]]:
        """Compute all curves of a pose of the tip, shape (4, 4), and postures (k, 7) all over each of its surfaces.

        Args:
            T: The pose.
            seed: A posture (7,); the curve or surface that is found from it is among them.
        """
        seeds = np.empty((0, JOINTS)) if seed is None else self.reached(seed, T)
        if np.linalg.norm(T[:3, 3] - self._loop.placements[0][:3, 3]) > self._reach and not len(seeds):
            return [], []
        q = np.vstack([seeds, self._starts.of(T)])
        if not len(q):
            return [], []
        singular, surface, twists = self._starts.singular(q, T)
        surfaces, points = surfaces_through(self._loop, q[surface], T)
        if surfaces:
            away = self.off_surfaces(q, surfaces)
            q, singular, surface, twists = q[away], singular[away], surface[away], twists[away]
        along = singular & ~surface
        if along.any() and np.count_nonzero(along) >= 0.25 * len(q):
            T, q = self._beside_boundary(T, q, twists[np.argmax(along)], seeds)
        else:
            q = q[~surface]
        q = q[self.off_surfaces(q, surfaces)]
        first = np.arange(len(q)) < len(seeds)
        q = q[np.argsort(np.where(first, -1.0, np.arange(len(q)) * GOLDEN % 1.0), kind="stable")]
        curves: list[Curve] = []
        while len(q):
            found, alone = self._followed(q[:SEEDS], T, curves)
            curves += found
            points = np.vstack([points, alone])
            q = self.beside(curves, q[SEEDS:], T)
        points = points[self.off_surfaces(points, surfaces)]
        return curves + [(point[None], True) for point in _apart(points, curves)], surfaces

    def reached(self, seed: Floats, T: Floats) -> Floats:
        """The posture of a pose to which the shortest steps lead from a seed (7,), shape (1, 7); (0, 7) without one."""
        q = self._starts.reached(wrapped(seed)[None], T)
        return q[np.argsort(np.linalg.norm(wrapped(q - seed), axis=1))[:1]]

    def _beside_boundary(self, T: Floats, q: Floats, twist: Floats, seeds: Floats) -> tuple[Floats, Floats]:
        """Where whole curves are singular, the pose `INWARDS` of one, and its postures; else the same (m, 7).

        With the elbow stretched axes 3 and 5 of many arms coincide. The tip is on the boundary of what it reaches, and
        a curve has no tangent of its own, as the elbow also bends without moving the tip. Two curves meet there, one
        for each side of the elbow.

        Args:
            T: The pose.
            q: Its postures.
            twist: The tip cannot move along it.
            seeds: Starts from which postures of the other pose are found, too.
        """
        v, w = np.split(twist, 2)
        found = []
        for sign in (1.0, -1.0):
            moved = T.copy()
            moved[:3, 3] += sign * INWARDS * v
            moved[:3, :3] += sign * INWARDS * np.cross(w, T[:3, :3], axisb=0, axisc=0)
            found.append((moved, np.vstack([self._starts.reached(seeds, moved), self._starts.of(moved)])))
        moved, near = max(found, key=lambda each: len(each[1]))
        return (moved, near) if len(near) else (T, q)

    def off_surfaces(self, q: Floats, surfaces: list[Floats]) -> NDArray[np.bool_]:
        """Which of postures (m, 7) are on none of some surfaces."""
        away = np.ones(len(q), dtype=np.bool_)
        if surfaces and len(q):
            free = np.linalg.svd(self._loop.jacobian(q)[1])[1][:, 5] < FREE
            for cover in surfaces:
                away &= ~(free & on_cover(cover, q))
        return away

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
        row, piece = np.nonzero(JOINTS - _close(q, begin + 0.5 * away) <= 0.2 * length[:, 0] ** 2 + SAME**2)
        along = (away / np.maximum(length, SHORTEST))[piece]
        length = length[piece]
        here = wrapped(q[row] - begin[piece])
        u = np.clip((here * along).sum(axis=1)[:, None] / np.maximum(length, SHORTEST), 0.0, 1.0)
        way = u * u * (3.0 - 2.0 * u) * length * along  # a cubic between the two samples
        way += length * u * (1.0 - u) * ((1.0 - u) * out[piece] - u * into[piece])
        across = np.where(length > 0.0, along, out[piece])
        way += ((here - way) * across).sum(axis=1)[:, None] * across
        there, _, _ = self.corrected(begin[piece] + way, T, across)
        same = np.abs(wrapped(there - q[row])).max(axis=1) < SAME
        return np.delete(q, row[same], axis=0)

    def along(self, q: Floats, tangent: Floats, length: float, T: Floats) -> Floats:
        """The posture (7,) of a pose's curve at a distance [rad] from another; less far if it cannot be followed."""
        gone, step = 0.0, length
        while abs(step) > SHORTEST * min(abs(length), 1.0):
            start = q + step * tangent
            there, ahead, off = self.corrected(start[None], T, tangent[None])
            if off[0] < ON_CURVE and np.linalg.norm(there[0] - start) < ASIDE * abs(step):
                q, tangent, gone = there[0], ahead[0], gone + step
                step = length - gone
            else:
                step *= 0.5
        return q

    def on_surface(self, q: Floats, T: Floats) -> bool:
        """Whether postures around one (7,) of a pose's form a surface."""
        return bool(self._starts.singular(q[None], T)[1][0])

    def onto_surface(self, q: Floats, T: Floats) -> tuple[Floats, Floats, float]:
        """The posture of a surface of a pose next to one (7,), its plane (k, 7), and by how much it misses the pose."""
        there, off, s, V = moved_onto(self._loop, q[None], T)
        return there[0], V[0, np.append(s[0] >= FREE, False).sum() :], float(off[0])

    def missed(self, q: Floats, T: Floats) -> Floats:
        """How far postures (m, 7) miss a pose [m, rad], shape (m,)."""
        return self._loop.step(q, T[None])[2]

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
            going = (off[rows] >= REACHED) | (left == steps)
            rows, count = rows[going], np.count_nonzero(going)
            if not (left and count):
                break
            A, sides = np.empty((count, JOINTS, JOINTS)), np.zeros((count, JOINTS, 2))
            A[:, :6], A[:, 6] = J[going], direction[rows]
            sides[:, :6, 0], sides[:, 6, 1] = error[going], 1.0
            found = solved(A + NUDGE * np.eye(JOINTS), sides)
            q[rows] += limited(found[..., 0])
            tangent[rows] = found[..., 1] / np.linalg.norm(found[..., 1], axis=1)[:, None]
        return q, tangent, off

    def with_held(self, T: Floats, seed: Floats) -> Floats:
        """Compute every posture (k, 7) for poses (m, 4, 4) in which a joint at an end keeps a seed's value (7,)."""
        end = self._starts.ends[0]
        others = np.tile(np.delete(seed, end.held), (len(T), 1))
        q, valid = end.method.many(end.poses(np.full(len(T), seed[end.held]), T), others, MISSED)
        branch, row = np.nonzero(valid)
        found = np.insert(q[:, branch, row].T, end.held, seed[end.held], axis=1)
        return found[self._loop.step(found, T[row])[2] < MISSED]

    def tangents(self, q: Floats) -> Floats:
        """Compute unit tangents of a curve at its postures (m, 7), in their order: J t = 0, to rounding."""
        steps = wrapped(np.diff(q, axis=0))
        if not steps.any():
            return np.linalg.svd(self._loop.step(q, np.eye(4)[None])[1])[2][:, 6]
        ahead = np.vstack([steps[:1], steps[1:] + steps[:-1], steps[-1:]])
        A = np.concatenate([self._loop.step(q, np.eye(4)[None])[1], ahead[:, None]], axis=1)
        side = np.zeros((len(q), JOINTS, 1))
        side[:, 6] = 1.0
        t = solved(A + NUDGE * np.eye(JOINTS), side)[..., 0]
        return t / np.linalg.norm(t, axis=1)[:, None]

    def _singular(self, q: Floats) -> NDArray[np.bool_]:
        """Whether curves may end at postures (m, 7)."""
        return np.linalg.svd(self._loop.jacobian(q)[1])[1][:, 5] < END

    def _tangent(self, q: Floats, T: Floats) -> Floats:
        """Unit tangents of curves at postures (m, 7), in the direction that all curves have."""
        t = np.linalg.svd(self._loop.step(q, T[None])[1])[2][:, 6]
        return self._sense(q, t, T)[:, None] * t

    def _sense(self, q: Floats, tangent: Floats, T: Floats) -> Floats:
        """1 where tangents at postures (m, 7) have the direction that all curves have, else -1."""
        J = self._loop.step(q, T[None])[1]
        return np.sign(np.linalg.det(np.concatenate([J, tangent[:, None]], axis=1)))

    def _followed(self, q: Floats, T: Floats, known: list[Curve]) -> tuple[list[Curve], Floats]:
        """The curves of postures (m, 7) that are none of the known ones, and postures whose curve cannot be followed.

        A curve is followed up to the next of the postures or of the samples of a known one.
        """
        tangent = self._tangent(q, T)
        once = _each_once(q, tangent)
        q, tangent = q[once], tangent[once]
        count = len(q)
        if known:
            samples = wrapped(np.vstack([curve for curve, _ in known]))
            q, tangent = np.vstack([q, samples]), np.vstack([tangent, self._tangent(samples, T)])
        todo, longest = np.arange(count), LONGEST
        after = np.full(len(q), -1)
        pieces: list[Floats] = [q[:0]] * count
        arrivals = np.zeros(len(q), dtype=np.int64)
        for _ in range(TRIES):
            after[todo], found = self._pieces(q, todo, tangent, T, longest)
            for row, piece in zip(todo, found, strict=True):
                pieces[row] = piece
            arrivals = np.bincount(after[after >= 0], minlength=len(q))
            lost = np.flatnonzero(after[:count] < 0)
            lost = lost[~self._singular(np.array([pieces[row][-1] for row in lost]).reshape(-1, JOINTS))]
            todo = np.union1d(lost, np.flatnonzero((after[:count] >= 0) & (arrivals[after[:count]] > 1)))
            if not len(todo):
                break
            longest /= SHORTER
        first = np.flatnonzero(arrivals[:count] == 0)  # behind these a curve ends, or known ones are met
        before, behind = self._pieces(q, first, -tangent, T, longest)
        seen = np.zeros(count, dtype=np.bool_)
        curves, alone = [], [q[:0]]
        for row, back, begin in zip(first.tolist(), behind, before.tolist(), strict=True):
            walked, end = _walked(pieces, after, row, seen)
            curve = _joined([back[::-1], *walked])
            if begin >= count and end >= count:  # part of a known curve
                continue
            if _length(curve) < BESIDE:
                alone.append(curve[:1])
            else:
                curves.append((curve, False))
        curves += [(_joined(_walked(pieces, after, row, seen)[0])[:-1], True) for row in range(count) if not seen[row]]
        return curves, np.vstack(alone)

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
            good = (off < ON_CURVE) & beside & ((ahead * way[going]).sum(axis=1) > STRAIGHT)
            good[good] = self._sense(there[good], ahead[good], T) == sense[going[good]]
            moved = going[good]
            own = which[moved]
            next_one[moved], end = self._passed(q[moved], way[moved], step[moved], there[good], own, seeds, tangent, T)
            q[moved], way[moved] = end, ahead[good]
            for row, posture in zip(moved, end, strict=True):
                pieces[row].append(posture)
            step[going[~good]] *= 0.5
            step[moved] = np.minimum(longest, 1.3 * step[moved])
            going = going[(step[going] > SHORTEST) & (next_one[going] < 0)]
        return next_one, [np.array(piece) for piece in pieces]

    def _passed(
        self,
        q: Floats,
        way: Floats,
        step: Floats,
        there: Floats,
        own: NDArray[np.int64],
        seeds: Floats,
        tangent: Floats,
        T: Floats,
    ) -> tuple[NDArray[np.int64], Floats]:
        """Which seed comes first on the way from postures (m, 7) to others, -1 without one; and it, or the others.

        Those of the curves' `own` seeds that are just left are none.
        """
        row, seed = np.nonzero(JOINTS - _close(0.5 * (q + there), seeds) < 0.2 * step[:, None] ** 2)
        away = wrapped(seeds[seed] - q[row])
        along = (away * way[row]).sum(axis=1)
        on_way = (along > np.where(seed == own[row], 0.5 * SAME, 0.0)) & (along < step[row] + 0.1 * SAME)
        on_way &= (tangent[seed] * way[row]).sum(axis=1) > 0.0
        row, seed, away, along = row[on_way], seed[on_way], away[on_way], along[on_way]
        first, end = np.full(len(q), -1), there.copy()
        if len(row):
            passed, _, _ = self.corrected(q[row] + along[:, None] * way[row], T, way[row])
            same = np.abs(wrapped(passed - seeds[seed])).max(axis=1) < SAME
            order = np.argsort(-along[same])
            row, seed, away = row[same][order], seed[same][order], away[same][order]
            first[row], end[row] = seed, q[row] + away
        return first, end


def _close(q: Floats, others: Floats) -> Floats:
    """How close postures (m, 7) and (k, 7) are on the torus: the sums of the differences' cosines, shape (m, k)."""
    waves, other_waves = (np.hstack([np.cos(each), np.sin(each)]) for each in (q, others))
    return waves @ other_waves.T


def _each_once(q: Floats, tangent: Floats) -> NDArray[np.bool_]:
    """Which of postures (m, 7) are not near an earlier one whose curve has the same direction."""
    same = (np.abs(wrapped(q[:, None] - q)).max(axis=2) < SAME) & (tangent @ tangent.T >= 0.0)
    return ~(np.tri(len(q), k=-1, dtype=np.bool_) & same).any(axis=1)


def _apart(points: Floats, curves: list[Curve]) -> Floats:
    """Those of postures (m, 7) that are not near an earlier one, nor near a curve's sample."""
    points = points[first_of_each(points, BESIDE)]
    samples = np.vstack([points[:0], *(curve for curve, _ in curves)])
    row, other = np.nonzero(JOINTS - _close(points, samples) < JOINTS * BESIDE**2)
    near = np.abs(wrapped(points[row] - samples[other])).max(axis=1) < BESIDE
    return np.delete(points, row[near], axis=0)


def _walked(
    pieces: list[Floats], after: NDArray[np.int64], row: int, seen: NDArray[np.bool_]
) -> tuple[list[Floats], int]:
    """The pieces of a curve from a seed on, until it ends or comes to one that was seen; and the last one's next."""
    found = []
    while 0 <= row < len(seen) and not seen[row]:
        seen[row] = True
        found.append(pieces[row])
        row = int(after[row])
    return found, row


def _joined(pieces: list[Floats]) -> Floats:
    """Pieces of which each ends where the next begins, as one without jumps."""
    whole = pieces[0]
    for piece in pieces[1:]:
        whole = np.vstack([whole, piece[1:] + TURN * np.rint((whole[-1] - piece[0]) / TURN)])
    return whole


def _length(q: Floats) -> float:
    return float(np.linalg.norm(np.diff(q, axis=0), axis=1).sum())
