"""The self-motion of a seven-axis arm: all postures of a pose, as curves in joint space.

`Starts` finds postures on every curve, and the compiled core follows the curves through them (`_core/tracing.c`). A
slide is in steps of the arm's length, from where it is nearest to the pose (`Places`): it is within [-1, 1], so that
what is said of angles in [-pi, pi] holds for it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach._rotations import joints_apart, wrapped
from kinreach.kinematics._chain import SerialChain
from kinreach.kinematics._core import doubles, flags, ints, lib
from kinreach.kinematics._general_6r import Chain, first_of_each
from kinreach.kinematics._seven_axis.starts import JOINTS, Starts
from kinreach.kinematics._seven_axis.surfaces import FREE, moved_onto, on_cover, surfaces_through

#: Longest step along a curve, and shortest step of `along` [rad].
LONGEST, SHORTEST = 0.1, 1e-6
#: Room for samples of all curves of a pose.
SAMPLES = 1 << 16
#: Steps of Newton's method to get back to a curve; and a posture is on one if it misses the pose by less [m, rad].
NEWTON, ON_CURVE = 4, 1e-10
#: A posture that misses the pose by more is not returned [m, rad].
MISSED = 1e-9
#: By how much a pose is moved where all of a curve is singular [m, rad].
INWARDS = 1e-10
#: A pose is on the boundary if at least this share of its postures are singular, and on no surface.
BOUNDARY = 0.25
#: Two postures nearer than this are one [rad].
SAME = 1e-5
#: A posture from which no curve can be followed is part of one that comes nearer than this [rad].
BESIDE = 1e-4
#: How far a curve is beside its tangent at most, in shares of a step.
ASIDE = 0.15
#: Limit of a slide in steps where it has none or is farther from the pose.
BEYOND = 3.0
#: Rounding of a slide's place [m].
AT_LIMIT = 1e-11


class Curve(NamedTuple):
    """Postures along a curve [rad], shape (m, 7), whether it is closed, and its unit tangents there, shape (m, 7).

    A curve that is smaller than `BESIDE` may be a single posture.
    """

    q: Floats
    closed: bool
    tangents: Floats


class Places(NamedTuple):
    """What the joints of an arm are for the tracer: angles as they are, and a slide in steps from its place for a pose.

    There it is nearest to what it brings to the pose.

    Attributes:
        T: The pose of the tip, shape (4, 4).
        moved: The pose that the tracer is asked for, moved back along the slide.
        lower, upper: Limits of the arm's joints [rad, m], shape (7,).
        slides: Which joints slide, shape (7,).
        unit: A step of the tracer's [rad, m], shape (7,).
        origin: Where the joints are when the tracer's are at 0, shape (7,).
    """

    T: Floats
    moved: Floats
    lower: Floats
    upper: Floats
    slides: NDArray[np.bool_]
    unit: Floats
    origin: Floats

    @property
    def limits(self) -> tuple[Floats, Floats]:
        """Limits of the tracer's joints, shape (7,) each."""
        if not self.slides.any():
            return self.lower, self.upper
        wide = np.where(self.slides, BEYOND, np.inf)  # such that a turn more is beyond them, too
        lower, upper = np.clip([self.of(self.lower), self.of(self.upper)], -wide, wide)
        return lower, upper

    def of(self, q: Floats) -> Floats:
        """The tracer's joints for postures (..., 7) [rad, m]."""
        return (q - self.origin) / self.unit if self.slides.any() else q

    def postures(self, q: Floats) -> Floats:
        """Postures [rad, m] of the tracer's (..., 7); a slide that is at a limit but for rounding is there exactly."""
        if not self.slides.any():
            return q
        q = q * self.unit + self.origin
        for limit in (self.lower, self.upper):
            q = np.where(self.slides & (np.abs(q - limit) < AT_LIMIT), limit, q)
        return q


class SelfMotionTracer:
    """All self-motion curves of a seven-axis arm.

    Attributes:
        reach: Sum of the distances from each joint to the next, and to the tip [m].
        unit: What counts as 1 rad [rad, m], shape (7,): of a slide the reach.
    """

    def __init__(self, chain: SerialChain) -> None:
        A, slides = chain.placements, chain.slides
        self.reach = float(np.linalg.norm(A[1:, :3, 3], axis=1).sum())
        self.unit: Floats = np.where(slides, self.reach, 1.0)
        self._loop = Chain(A, np.where(slides, self.reach, 0.0))
        self._starts = Starts(self._loop)

    def placed(self, T: Floats, lower: Floats, upper: Floats) -> Places:
        """What the joints are for a pose (4, 4) of the tip, within limits (7,) [rad, m]."""
        slides, A = self._loop.slides, self._loop.placements
        T, moved, origin = T.copy(), T.copy(), np.zeros(JOINTS)
        for joint in np.flatnonzero(slides):  # the first or the last
            end = A[0] if joint == 0 else T @ np.linalg.inv(A[JOINTS])
            between = (T if joint == 0 else end)[:3, 3] - A[0, :3, 3]
            origin[joint] = end[:3, 2] @ between
            moved[:3, 3] -= origin[joint] * end[:3, 2]
        return Places(T, moved, lower, upper, slides, self.unit, origin)

    @property
    def _A(self) -> Any:
        return doubles(self._loop.core)

    @property
    def sound(self) -> bool:
        """Whether a six-axis arm that is left, when the first or the last joint is held, can be solved."""
        return bool(self._starts.ends)

    @property
    def rank(self) -> int:
        """Of the better method of the two ends, as in `IKMethod`."""
        return self._starts.ends[0].method.rank

    def curves(self, T: Floats, seed: Floats | None = None) -> tuple[list[Curve], list[Floats]]:
        """Compute all curves of a pose of the tip, shape (4, 4), and postures (k, 7) all over each of its surfaces.

        Args:
            T: The pose.
            seed: A posture (7,); the curve or surface that is found from it is among them.
        """
        seeds = np.empty((0, JOINTS)) if seed is None else self.reached(seed, T)
        if np.linalg.norm(T[:3, 3] - self._loop.placements[0][:3, 3]) > self.reach and not len(seeds):
            return [], []
        q = np.vstack([seeds, self._starts.of(T)])
        if not len(q):
            return [], []
        singular, surface, twists = self._starts.singular(q, T)
        surfaces, points = surfaces_through(self._loop, q[surface], T)
        if surfaces:
            away = self.off_surfaces(q, surfaces)
            q, singular, surface, twists = q[away], singular[away], surface[away], twists[away]
        elif np.count_nonzero(singular) >= BOUNDARY * len(q):
            # what looks like a surface is on a boundary that the elbow leaves slowly
            surface, points = np.zeros_like(surface), points[:0]
        along = singular & ~surface
        if along.any() and np.count_nonzero(along) >= BOUNDARY * len(q):
            T, q = self._beside_boundary(T, q, twists[np.argmax(along)], seeds)
        else:
            q = q[~surface]
        q = q[self.off_surfaces(q, surfaces)]
        curves: list[Curve] = []
        if len(q):
            curves, alone = self._followed(q, T)
            points = np.vstack([points, alone])
        points = points[self.off_surfaces(points, surfaces)]
        return curves + [self.point(q) for q in _apart(points, curves)], surfaces

    def reached(self, seed: Floats, T: Floats) -> Floats:
        """The posture of a pose to which the shortest steps lead from a seed (7,), shape (1, 7); (0, 7) without one."""
        seed = np.where(self._loop.slides, np.clip(seed, -1.0, 1.0), seed)
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
        if not len(near):
            return T, q
        return moved, np.vstack([near, self._starts.across(near, moved)])

    def off_surfaces(self, q: Floats, surfaces: list[Floats]) -> NDArray[np.bool_]:
        """Which of postures (m, 7) are on none of some surfaces."""
        away = np.ones(len(q), dtype=np.bool_)
        if surfaces and len(q):
            free = self._starts.least_singular_values(q) < FREE
            for cover in surfaces:
                away &= ~(free & on_cover(cover, q))
        return away

    def beside(self, curves: list[Curve], q: Floats, T: Floats) -> Floats:
        """Those of postures (m, 7) of a pose that are on none of some of its curves."""
        q, on = np.ascontiguousarray(q), np.zeros(len(q), dtype=np.bool_)
        for curve in curves:
            here = np.empty(len(q), dtype=np.bool_)
            lib.kr_on_curve(
                self._A, doubles(T), doubles(curve.q), doubles(curve.tangents), len(curve.q), curve.closed, doubles(q),
                len(q), flags(here),
            )  # fmt: skip
            on |= here
        return q[~on]

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
        q, off = np.ascontiguousarray(q), np.empty(len(q))
        lib.kr_missed_by_each(self._A, doubles(T), len(q), doubles(q), doubles(off))
        return off

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
        q, tangent, off = np.array(q, order="C"), np.array(direction, order="C"), np.empty(len(q))
        lib.kr_across_each(self._A, doubles(T), steps, len(q), doubles(q), doubles(tangent), doubles(off))
        return q, tangent, off

    def with_held(self, T: Floats, seed: Floats) -> Floats:
        """Compute every posture (k, 7) for poses (m, 4, 4) in which a joint at an end keeps a seed's value (7,).

        A slide is as many steps as it is from 0, for the poses themselves.
        """
        end = self._starts.ends[0]
        others = np.tile(np.delete(seed, end.held), (len(T), 1))
        q, valid = end.method.many(end.poses(np.full(len(T), seed[end.held]), T), others, MISSED)
        branch, row = np.nonzero(valid)
        found = np.insert(q[:, branch, row].T, end.held, seed[end.held], axis=1)
        return found[self._loop.step(found, T[row])[2] < MISSED]

    def tangents(self, q: Floats) -> Floats:
        """Compute unit tangents of a curve at its postures (m, 7), in their order: J t = 0, to rounding."""
        steps = wrapped(np.diff(q, axis=0))
        ahead = np.zeros((1, JOINTS)) if len(q) == 1 else np.vstack([steps[:1], steps[1:] + steps[:-1], steps[-1:]])
        q, tangents = np.ascontiguousarray(q), np.empty((len(q), JOINTS))
        lib.kr_tangents(self._A, len(q), doubles(q), doubles(ahead), doubles(tangents))
        return tangents

    def point(self, q: Floats) -> Curve:
        """A posture (7,) as a curve of its own."""
        return Curve(q[None], True, self.tangents(q[None]))

    def _followed(self, q: Floats, T: Floats) -> tuple[list[Curve], Floats]:
        """The curves of postures (m, 7), and postures whose curve cannot be followed."""
        q = np.ascontiguousarray(q[np.argsort(q[:, 0])])
        count = len(q)
        samples, tangents = np.empty((2, SAMPLES, JOINTS))
        (ends, closed), marks = np.empty((2, 2 * count), np.int32), np.empty(4 * count, np.int32)
        found = lib.kr_self_motion(
            self._A, doubles(T), doubles(q), count, SAMPLES, doubles(samples), doubles(tangents), ints(ends),
            ints(closed), ints(marks),
        )  # fmt: skip
        curves, alone = [], [q[:0]]
        for begin, end, back in zip([0, *ends[: found - 1]], ends[:found], closed[:found].tolist(), strict=False):
            if back < 0:
                continue
            if not back and _length(samples[begin:end]) < BESIDE:
                alone.append(wrapped(samples[begin : begin + 1]))
            else:
                curves.append(Curve(samples[begin:end].copy(), bool(back), tangents[begin:end].copy()))
        return curves, np.vstack(alone)


def _apart(points: Floats, curves: list[Curve]) -> Floats:
    """Those of postures (m, 7) that are not near an earlier one, nor near a curve's sample."""
    points = points[first_of_each(points, BESIDE)]
    samples = np.vstack([points[:0], *(curve.q for curve in curves)])
    near = [joints_apart(point, samples).min(initial=np.inf) < BESIDE for point in points]
    return points[~np.array(near, dtype=np.bool_)]


def _length(q: Floats) -> float:
    return float(np.linalg.norm(np.diff(q, axis=0), axis=1).sum())
