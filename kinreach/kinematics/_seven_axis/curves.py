"""The self-motion curves of a pose within the joint limits, and what is best on them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from kinreach._checks import Floats
from kinreach._rotations import wrapped
from kinreach.errors import InputError
from kinreach.kinematics._seven_axis.limits import cut
from kinreach.kinematics._seven_axis.tracing import LONGEST, MISSED, ON_CURVE, Curve, SelfMotionTracer
from kinreach.kinematics._solutions import SLACK, Accept, IKResult, Status, nearest_windings, past_limits

if TYPE_CHECKING:
    from kinreach.kinematics._collision import CollisionChecker
    from kinreach.kinematics._seven_axis.kinematics import SevenAxisKinematics

#: Steps with which the best posture on a curve is found between two samples.
STEPS = 30
#: A step along the curve that is shorter ends that [rad].
ARRIVED = 1e-10
#: Samples of a curve, at most this far apart, whose clearance is computed [rad].
CLEARANCE_STEP = 0.15
#: Measures that differ by a smaller share are equal: an arm that reaches over its shoulder has the same manipulability.
EQUAL = 1e-6
#: The best samples on the curves from which the best posture is found.
CLIMBS = 6


@dataclass(frozen=True, eq=False)
class SelfMotion:
    """One curve of postures that all reach the same pose.

    Attributes:
        q: Postures along the curve [rad], shape (m, 7), at most 0.15 rad apart, without jumps. A curve that is shorter
            than 1e-4 rad may be one posture.
        tangent: Unit tangents there, shape (m, 7): the tip does not move along them.
        length: Arc length from the first posture [rad], shape (m,): the parameter of the curve.
        closed: Whether the last posture leads back to the first. If not, the curve ends at joint limits, or where it
            crosses another, or almost, at a singular posture.
        total: Length of the whole curve [rad], with the way back to the first posture if it is closed.
    """

    q: Floats
    length: Floats
    closed: bool
    total: float
    _tracer: SelfMotionTracer
    _T: Floats

    @cached_property
    def tangent(self) -> Floats:
        return self._tracer.tangents(self.q)

    def at(self, length: float) -> Floats:
        """Return the posture at an arc length [rad] from the first, shape (7,); exact, not interpolated.

        On a closed curve every length is taken modulo the whole one.

        Raises:
            InputError: The length is not finite, or beyond the end of an open curve.
        """
        if not np.isfinite(length) or not (self.closed or -SLACK <= length <= self.total + SLACK):
            raise InputError(f"length must be between 0 and {self.total:.6g} rad on this curve, got {length!r}")
        s = length % self.total if self.closed and self.total else min(max(length, 0.0), self.total)
        before = int(np.searchsorted(self.length, s, side="right")) - 1
        if s == self.length[before]:
            return self.q[before].copy()
        return self._tracer.along(self.q[before], self.tangent[before], s - self.length[before], self._T)


@dataclass(frozen=True, eq=False)
class SelfMotions:
    """Every posture of a pose, as curves; an iterable and a sequence of `SelfMotion`.

    Attributes:
        curves: The curves, the longest first.
        surfaces: Families of postures of two parameters, or three: postures all over each [rad], shape (m, 7), at most
            0.4 rad apart in every joint, or twice or four times that if there are many. A pose has some only where
            pairs of axes coincide, as where the shoulder and the wrist of an iiwa are straight.
        status: `OK` if there is at least one curve or surface.
        reason: Why there is none, else empty.
    """

    curves: Sequence[SelfMotion]
    surfaces: Sequence[Floats]
    status: Status
    reason: str
    _kinematics: SevenAxisKinematics
    _T: Floats
    _lower: Floats
    _upper: Floats

    def __len__(self) -> int:
        return len(self.curves)

    def __getitem__(self, index: int) -> SelfMotion:
        return self.curves[index]

    @property
    def success(self) -> bool:
        """Whether there is a posture."""
        return self.status is Status.OK

    def nearest(self, seed: Floats, *, accept: Accept | None = None) -> IKResult:
        """Return the posture nearest to a seed (7,) that is accepted; `branch` is the index of its curve.

        Indices of surfaces follow those of the curves. Newton's method from the seed itself finds a posture, too. If
        that is on none of them, its index is -1.
        """
        least: list[tuple[float, int, Floats, Floats]] = []
        rest: list[tuple[float, int, Floats]] = []
        for index, curve in enumerate(self.curves):
            q = nearest_windings(curve.q.T, seed[:, None], self._lower, self._upper)[0].T
            apart = np.linalg.norm(q - seed, axis=1)
            rest += [(float(d), index, posture) for d, posture in zip(apart, q, strict=True)]
            least += [(float(apart[i]), index, q[i], curve.tangent[i]) for i in _least(apart, closed=curve.closed)]
        for index, cover in enumerate(self.surfaces, start=len(self.curves)):
            q = nearest_windings(cover.T, seed[:, None], self._lower, self._upper)[0].T
            apart = np.linalg.norm(q - seed, axis=1)
            rest += [(float(d), index, posture) for d, posture in zip(apart, q, strict=True)]
            least += [(float(apart[i]), index, q[i], np.zeros(7)) for i in np.argsort(apart)[:CLIMBS]]
        least += self._beside(seed)
        worth = min((each[0] for each in least), default=0.0) + 2.0 * LONGEST if accept is None else np.inf
        found = []
        for apart, index, q, t in least:
            if apart <= worth:
                best = self._walked(q, t, seed)
                found.append((float(np.linalg.norm(best - seed)), index, best))
        found.sort(key=lambda each: each[0])
        rest.sort(key=lambda each: each[0])
        refused: IKResult | None = None
        for _, index, q in [*found, *rest]:
            result = self._result(q, index)
            if result.success and (accept is None or accept(q.copy())):
                return result
            if result.success:
                reason = "accept refused every posture on the curves"
                refused = refused or replace(result, status=Status.REJECTED, reason=reason)
        if refused is not None:
            return refused
        return self._none(seed)

    def clearest(self, checker: CollisionChecker) -> IKResult:
        """Return the posture with the largest distance between any two shapes that could collide."""
        return self._best(
            lambda q: checker.distance(q).distance, CLEARANCE_STEP, checker.free, "every posture collides"
        )

    def manipulable(self) -> IKResult:
        """Return the posture with the largest manipulability, sqrt(det(J J^T)) (Yoshikawa 1985)."""
        kin = self._kinematics

        def measure(q: Floats) -> float:
            J = kin.jacobian(q)
            return float(np.sqrt(max(np.linalg.det(J @ J.T), 0.0)))

        return self._best(measure, 0.0, None, "")

    def _best(self, measure: Callable[[Floats], float], step: float, accept: Accept | None, reason: str) -> IKResult:
        """The posture with the largest measure; of equal ones the nearest to the middle of the joint limits."""
        kin = self._kinematics
        tops: list[tuple[float, int, Floats, Floats]] = []
        for index, curve in enumerate(self.curves):
            spaced = [0]
            for i in range(1, len(curve.length)):
                if curve.length[i] - curve.length[spaced[-1]] >= step:
                    spaced.append(i)
            values = np.array([measure(curve.q[i]) for i in spaced])
            padded = np.pad(values, 1, constant_values=-np.inf)
            highest = np.flatnonzero((values >= padded[:-2]) & (values > padded[2:]))
            tops += [(float(values[k]), index, curve.q[spaced[k]], curve.tangent[spaced[k]]) for k in highest]
        for index, cover in enumerate(self.surfaces, start=len(self.curves)):
            values = np.array([measure(q) for q in cover])
            tops += [(float(values[k]), index, cover[k], np.zeros(7)) for k in np.argsort(-values)[:CLIMBS]]
        if not tops:
            return self._none(np.array(kin.arm.home))
        best = sorted(tops, key=lambda each: -each[0])[:CLIMBS]
        climbed = [(*self._uphill(measure, value, q, t, max(step, LONGEST)), i) for value, i, q, t in best]
        most = max(value for value, _, _ in climbed)
        equal = [(q, index) for value, q, index in climbed if value >= most - EQUAL * abs(most)]
        lower, upper = kin.sampling_limits
        middle, reach = 0.5 * (lower + upper), upper - lower
        q, index = min(equal, key=lambda each: float(np.linalg.norm((each[0] - middle) / reach)))
        if accept is not None and not accept(q):
            return self._result(q, index, Status.REJECTED, reason)
        return self._result(q, index)

    def _uphill(
        self, measure: Callable[[Floats], float], value: float, q: Floats, t: Floats, size: float
    ) -> tuple[float, Floats]:
        """The largest measure along a curve or over a surface from a posture, and where it is."""
        while size > 1e-4:
            moves = [(measure(other), other) for other in self._moves(q, t, size)]
            best, other = max(moves, key=lambda move: move[0], default=(value, q))
            if best > value:
                value, q = best, other
                if t.any():
                    t = self._kinematics._tracer.corrected(q[None], self._T, t[None], steps=1)[1][0]
            else:
                size *= 0.5
        return value, q

    def _beside(self, seed: Floats) -> list[tuple[float, int, Floats, Floats]]:
        """The posture to which the shortest steps lead from a seed: distance, index of its curve, itself and a tangent.

        None if they lead to none, or outside the limits.
        """
        tracer = self._kinematics._tracer
        q = tracer.reached(seed, self._T)
        wound, within = nearest_windings(q.T, seed[:, None], self._lower, self._upper)
        if not within.any():
            return []
        known = [Curve(curve.q, curve.closed, curve.tangent) for curve in self.curves]
        index = next((i for i, curve in enumerate(known) if not len(tracer.beside([curve], q, self._T))), -1)
        if index < 0:  # where whole curves are singular they are a little beside
            away = [float(np.linalg.norm(wrapped(curve.q - q), axis=1).min()) for curve in known]
            index = int(np.argmin(away)) if away and min(away) < 2.0 * LONGEST else -1
        on = [not tracer.off_surfaces(q, [cover])[0] for cover in self.surfaces]
        if any(on):
            index = len(self.curves) + on.index(True)
        posture = wound[:, 0]
        return [(float(np.linalg.norm(posture - seed)), index, posture, tracer.tangents(q)[0])]

    def _walked(self, q: Floats, t: Floats, seed: Floats) -> Floats:
        """Go along a curve towards a seed, as far as the limits allow; on a surface straight to it."""
        tracer, share = self._kinematics._tracer, 1.0
        if tracer.on_surface(q, self._T):
            return self._walked_on_surface(q, seed)
        for _ in range(STEPS):
            step = share * float(np.clip((seed - q) @ t, -LONGEST, LONGEST))
            if abs(step) < ARRIVED:
                break
            trial, tangent, off = tracer.corrected((q + step * t)[None], self._T, t[None])
            nearer = np.linalg.norm(seed - trial[0]) < np.linalg.norm(seed - q)
            if nearer and off[0] < ON_CURVE and self._within(trial[0]):
                q, t = trial[0], tangent[0]
            else:
                share *= 0.5
        return q

    def _walked_on_surface(self, q: Floats, seed: Floats) -> Floats:
        tracer, longest = self._kinematics._tracer, 2.0 * LONGEST
        for _ in range(STEPS):
            plane = tracer.onto_surface(q, self._T)[1]
            way = (seed - q) @ plane.T @ plane
            way *= min(1.0, longest / max(float(np.linalg.norm(way)), ARRIVED))
            if np.linalg.norm(way) < ARRIVED:
                break
            trial, _, off = tracer.onto_surface(q + way, self._T)
            if np.linalg.norm(seed - trial) < np.linalg.norm(seed - q) and off < MISSED and self._within(trial):
                q = trial
            else:
                longest = 0.5 * min(longest, float(np.linalg.norm(way)))
        return q

    def _moves(self, q: Floats, t: Floats, step: float) -> list[Floats]:
        """Postures a step away, along the curve both ways, or on a surface if the tangent is 0."""
        if t.any():
            return [self._moved(q, t, step), self._moved(q, t, -step)]
        tracer = self._kinematics._tracer
        plane = step * tracer.onto_surface(q, self._T)[1]
        trials = [tracer.onto_surface(q + way, self._T) for way in np.vstack([plane, -plane])]
        return [trial for trial, _, off in trials if off < MISSED and self._within(trial)]

    def _moved(self, q: Floats, t: Floats, step: float) -> Floats:
        """A posture farther along the curve, or the same where that is not on it or outside of the limits."""
        trial, _, off = self._kinematics._tracer.corrected((q + step * t)[None], self._T, t[None])
        return trial[0] if off[0] < ON_CURVE and self._within(trial[0]) else q

    def _within(self, q: Floats) -> bool:
        return not past_limits(q, self._lower, self._upper).any()

    def _result(self, q: Floats, index: int, status: Status = Status.OK, reason: str = "") -> IKResult:
        position, orientation = self._kinematics._error_of(self._T, q)
        if max(position, orientation) > MISSED:
            status, reason = Status.NOT_CONVERGED, f"{position:.3g} m and {orientation:.3g} rad from the goal"
        return IKResult(q, status, position, orientation, reason, branch=index)

    def _none(self, seed: Floats) -> IKResult:
        return IKResult(seed.copy(), self.status, *self._kinematics._error_of(self._T, seed), self.reason)


def within_limits(
    tracer: SelfMotionTracer, T: Floats, curves: Sequence[Curve], lower: Floats, upper: Floats
) -> list[SelfMotion]:
    """The parts of curves within the joint limits, the longest first."""
    parts = cut(tracer, T, curves, lower, upper)
    return sorted((_motion(tracer, T, *part) for part in parts), key=lambda motion: -motion.total)


def surfaces_within_limits(surfaces: Sequence[Floats], lower: Floats, upper: Floats) -> list[Floats]:
    """The postures of surfaces that can be wound into the joint limits, the most first."""
    found = []
    for q in surfaces:
        seed = np.clip(q, lower, upper)
        wound, within = nearest_windings(q.T, seed.T, lower, upper)
        found.append(wound.T[within])
    return sorted((q for q in found if len(q)), key=len, reverse=True)


def _motion(tracer: SelfMotionTracer, T: Floats, q: Floats, closed: bool) -> SelfMotion:
    steps = np.linalg.norm(np.diff(q, axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    total = float(length[-1]) + (float(np.linalg.norm(wrapped(q[0] - q[-1]))) if closed else 0.0)
    return SelfMotion(q, length, closed, total, tracer, T)


def _least(values: Floats, *, closed: bool) -> list[int]:
    """Indices of the local minima along a curve."""
    before, after = np.roll(values, 1), np.roll(values, -1)
    if not closed:
        before[0], after[-1] = np.inf, np.inf
    least = (values <= before) & (values < after)
    least[np.argmin(values)] = True
    return [int(index) for index in np.flatnonzero(least)]
