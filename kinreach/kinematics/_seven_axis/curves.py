"""The self-motion curves of a pose within the joint limits, and what is best on them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from kinreach._checks import MAX_ANGLE, Floats, check_known, check_number
from kinreach._rotations import wrapped
from kinreach.errors import InputError
from kinreach.kinematics._seven_axis.limits import at_value, cut
from kinreach.kinematics._seven_axis.tracing import LONGEST, MISSED, ON_CURVE, Curve, Places, SelfMotionTracer
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
        q: Postures along the curve [rad, m], shape (m, 7), at most 0.15 rad apart, without jumps. A curve that is
            shorter than 1e-4 rad may be one posture.
        tangent: By how much the joints move there along 1 rad of the curve [rad, m], shape (m, 7); unit vectors where
            no joint slides. The tip does not move along them.
        length: Arc length from the first posture [rad], shape (m,): the parameter of the curve. A slide's way is in
            `SevenAxisKinematics.length` metres.
        closed: Whether the last posture leads back to the first. If not, the curve ends at joint limits, or where it
            crosses another, or almost, at a singular posture.
        total: Length of the whole curve [rad], with the way back to the first posture if it is closed.
    """

    q: Floats
    length: Floats
    closed: bool
    total: float
    _tracer: SelfMotionTracer
    _places: Places

    @cached_property
    def tangent(self) -> Floats:
        return self._curve.tangents * self._places.unit

    @cached_property
    def _curve(self) -> Curve:
        """As the tracer has it."""
        q = self._places.of(self.q)
        return Curve(q, self.closed, self._tracer.tangents(q))

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
        q, tangent = self._curve.q[before], self._curve.tangents[before]
        return self._places.postures(self._tracer.along(q, tangent, s - self.length[before], self._places.moved))


@dataclass(frozen=True, eq=False)
class SelfMotions:
    """Every posture of a pose, as curves; an iterable and a sequence of `SelfMotion`.

    Attributes:
        curves: The curves, the longest first.
        surfaces: Families of postures of two parameters, or three: postures all over each [rad, m], shape (m, 7), at
            most 0.4 rad apart in every joint, or twice or four times that if there are many. A pose has some only where
            pairs of axes coincide, as where the shoulder and the wrist of an iiwa are straight.
        status: `OK` if there is at least one curve or surface.
        reason: Why there is none, else empty.
    """

    curves: Sequence[SelfMotion]
    surfaces: Sequence[Floats]
    status: Status
    reason: str
    _kinematics: SevenAxisKinematics
    _places: Places

    def __len__(self) -> int:
        return len(self.curves)

    def __getitem__(self, index: int) -> SelfMotion:
        return self.curves[index]

    @property
    def success(self) -> bool:
        """Whether there is a posture."""
        return self.status is Status.OK

    @property
    def _tracer(self) -> SelfMotionTracer:
        return self._kinematics._tracer

    @property
    def _T(self) -> Floats:
        """The pose that the tracer was asked for."""
        return self._places.moved

    @cached_property
    def _lines(self) -> list[Curve]:
        """The curves as the tracer has them."""
        return [curve._curve for curve in self.curves]

    @cached_property
    def _covers(self) -> list[Floats]:
        """Postures all over the surfaces as the tracer has them."""
        return [self._places.of(q) for q in self.surfaces]

    def with_joint(self, joint: str, value: float) -> list[IKResult]:
        """Return the postures on the curves with a joint at a value, such as a rail at a place.

        Args:
            joint: Its name.
            value: Where it is [rad, m]. An angle's whole turns are not looked at.

        Returns:
            Postures in the order of the curves; `branch` is the index of each one's curve. Those on surfaces are not
            among them.

        Raises:
            UnknownNameError: The arm has no joint of that name.
            InputError: The value is not finite, or larger than 1e6.
        """
        check_known("joint", joint, self._kinematics.arm.joints)
        index = self._kinematics.arm.joints.index(joint)
        place = self._places.of(np.full(self._kinematics.n, check_number("value", value, most=MAX_ANGLE)))[index]
        if self._places.slides[index] and abs(place) > 1.0:
            return []
        return [
            self._result(q, curve)
            for curve, line in enumerate(self._lines)
            for q in at_value(self._tracer, self._T, line, index, place)
        ]

    def nearest(self, seed: Floats, *, accept: Accept | None = None) -> IKResult:
        """Return the posture nearest to a seed (7,) that is accepted; `branch` is the index of its curve.

        Indices of surfaces follow those of the curves. Newton's method from the seed itself finds a posture, too. If
        that is on none of them, its index is -1.
        """
        start = self._places.of(seed)
        least: list[tuple[float, int, Floats, Floats]] = []
        rest: list[tuple[float, int, Floats]] = []
        for index, curve in enumerate(self._lines):
            q = self._nearest_windings(curve.q, start)
            apart = np.linalg.norm(q - start, axis=1)
            rest += [(float(d), index, posture) for d, posture in zip(apart, q, strict=True)]
            least += [(float(apart[i]), index, q[i], curve.tangents[i]) for i in _least(apart, closed=curve.closed)]
        for index, cover in enumerate(self._covers, start=len(self.curves)):
            q = self._nearest_windings(cover, start)
            apart = np.linalg.norm(q - start, axis=1)
            rest += [(float(d), index, posture) for d, posture in zip(apart, q, strict=True)]
            least += [(float(apart[i]), index, q[i], np.zeros(7)) for i in np.argsort(apart)[:CLIMBS]]
        least += self._beside(start)
        worth = min((each[0] for each in least), default=0.0) + 2.0 * LONGEST if accept is None else np.inf
        found = []
        for apart, index, q, t in least:
            if apart <= worth:
                best = self._walked(q, t, start)
                found.append((float(np.linalg.norm(best - start)), index, best))
        found.sort(key=lambda each: each[0])
        rest.sort(key=lambda each: each[0])
        refused: IKResult | None = None
        for _, index, q in [*found, *rest]:
            result = self._result(q, index)
            if result.success and (accept is None or accept(result.q.copy())):
                return result
            if result.success:
                reason = "accept refused every posture on the curves"
                refused = refused or replace(result, status=Status.REJECTED, reason=reason)
        if refused is not None:
            return refused
        return self._none(seed)

    def _nearest_windings(self, q: Floats, seed: Floats) -> Floats:
        """Postures (m, 7) in the turns nearest to a seed (7,)."""
        wound: Floats = nearest_windings(q.T, seed[:, None], *self._places.limits)[0].T
        return wound

    def clearest(self, checker: CollisionChecker) -> IKResult:
        """Return the posture with the largest distance between any two shapes that could collide."""
        postures = self._places.postures
        return self._best(
            lambda q: checker.distance(postures(q)).distance,
            CLEARANCE_STEP,
            lambda q: checker.free(postures(q)),
            "every posture collides",
        )

    def manipulable(self) -> IKResult:
        """Return the posture with the largest manipulability, sqrt(det(J J^T)) (Yoshikawa 1985)."""
        kin, places = self._kinematics, self._places

        def measure(q: Floats) -> float:
            J = kin.jacobian(places.postures(q)) * places.unit
            return float(np.sqrt(max(np.linalg.det(J @ J.T), 0.0)))

        return self._best(measure, 0.0, None, "")

    def _best(self, measure: Callable[[Floats], float], step: float, accept: Accept | None, reason: str) -> IKResult:
        """The posture with the largest measure; of equal ones the nearest to the middle of the joint limits."""
        kin = self._kinematics
        tops: list[tuple[float, int, Floats, Floats]] = []
        for index, (curve, line) in enumerate(zip(self.curves, self._lines, strict=True)):
            spaced = [0]
            for i in range(1, len(curve.length)):
                if curve.length[i] - curve.length[spaced[-1]] >= step:
                    spaced.append(i)
            values = np.array([measure(line.q[i]) for i in spaced])
            padded = np.pad(values, 1, constant_values=-np.inf)
            highest = np.flatnonzero((values >= padded[:-2]) & (values > padded[2:]))
            tops += [(float(values[k]), index, line.q[spaced[k]], line.tangents[spaced[k]]) for k in highest]
        for index, cover in enumerate(self._covers, start=len(self.curves)):
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
        postures = self._places.postures
        q, index = min(equal, key=lambda each: float(np.linalg.norm((postures(each[0]) - middle) / reach)))
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
                    t = self._tracer.corrected(q[None], self._T, t[None], steps=1)[1][0]
            else:
                size *= 0.5
        return value, q

    def _beside(self, seed: Floats) -> list[tuple[float, int, Floats, Floats]]:
        """The posture to which the shortest steps lead from a seed: distance, index of its curve, itself and a tangent.

        None if they lead to none, or outside the limits.
        """
        tracer = self._tracer
        q = tracer.reached(seed, self._T)
        wound, within = nearest_windings(q.T, seed[:, None], *self._places.limits)
        if not within.any():
            return []
        index = next((i for i, curve in enumerate(self._lines) if not len(tracer.beside([curve], q, self._T))), -1)
        if index < 0:  # where whole curves are singular they are a little beside
            away = [float(np.linalg.norm(wrapped(curve.q - q), axis=1).min()) for curve in self._lines]
            index = int(np.argmin(away)) if away and min(away) < 2.0 * LONGEST else -1
        on = [not tracer.off_surfaces(q, [cover])[0] for cover in self._covers]
        if any(on):
            index = len(self.curves) + on.index(True)
        posture = wound[:, 0]
        return [(float(np.linalg.norm(posture - seed)), index, posture, tracer.tangents(q)[0])]

    def _walked(self, q: Floats, t: Floats, seed: Floats) -> Floats:
        """Go along a curve towards a seed, as far as the limits allow; on a surface straight to it."""
        tracer, share = self._tracer, 1.0
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
        tracer, longest = self._tracer, 2.0 * LONGEST
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
        tracer = self._tracer
        plane = step * tracer.onto_surface(q, self._T)[1]
        trials = [tracer.onto_surface(q + way, self._T) for way in np.vstack([plane, -plane])]
        return [trial for trial, _, off in trials if off < MISSED and self._within(trial)]

    def _moved(self, q: Floats, t: Floats, step: float) -> Floats:
        """A posture farther along the curve, or the same where that is not on it or outside of the limits."""
        trial, _, off = self._tracer.corrected((q + step * t)[None], self._T, t[None])
        return trial[0] if off[0] < ON_CURVE and self._within(trial[0]) else q

    def _within(self, q: Floats) -> bool:
        return not past_limits(q, *self._places.limits, 0.0).any()

    def _result(self, q: Floats, index: int, status: Status = Status.OK, reason: str = "") -> IKResult:
        """The result for a posture of the tracer's."""
        q = self._places.postures(q)
        position, orientation = self._kinematics._error_of(self._places.T, q)
        if max(position, orientation) > MISSED:
            status, reason = Status.NOT_CONVERGED, f"{position:.3g} m and {orientation:.3g} rad from the goal"
        return IKResult(q, status, position, orientation, reason, branch=index)

    def _none(self, seed: Floats) -> IKResult:
        return IKResult(seed.copy(), self.status, *self._kinematics._error_of(self._places.T, seed), self.reason)


def within_limits(tracer: SelfMotionTracer, places: Places, curves: Sequence[Curve]) -> list[SelfMotion]:
    """The parts of curves within the joint limits, the longest first."""
    parts = cut(tracer, places.moved, curves, *places.limits)
    return sorted((_motion(tracer, places, *part) for part in parts), key=lambda motion: -motion.total)


def surfaces_within_limits(surfaces: Sequence[Floats], places: Places) -> list[Floats]:
    """The postures of surfaces that can be wound into the joint limits [rad, m], the most first."""
    found, (lower, upper) = [], places.limits
    for q in surfaces:
        seed = np.clip(q, lower, upper)
        wound, within = nearest_windings(q.T, seed.T, lower, upper)
        found.append(places.postures(wound.T[within]))
    return sorted((q for q in found if len(q)), key=len, reverse=True)


def _motion(tracer: SelfMotionTracer, places: Places, q: Floats, closed: bool) -> SelfMotion:
    steps = np.linalg.norm(np.diff(q, axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    total = float(length[-1]) + (float(np.linalg.norm(wrapped(q[0] - q[-1]))) if closed else 0.0)
    return SelfMotion(places.postures(q), length, closed, total, tracer, places)


def _least(values: Floats, *, closed: bool) -> list[int]:
    """Indices of the local minima along a curve."""
    before, after = np.roll(values, 1), np.roll(values, -1)
    if not closed:
        before[0], after[-1] = np.inf, np.inf
    least = (values <= before) & (values < after)
    least[np.argmin(values)] = True
    return [int(index) for index in np.flatnonzero(least)]
