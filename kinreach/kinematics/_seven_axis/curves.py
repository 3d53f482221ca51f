"""The self-motion curves of a pose within the joint limits, and what is best on them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kinreach._checks import MAX_ANGLE, Floats
from kinreach.errors import InputError
from kinreach.kinematics._angles import TURN, wrapped
from kinreach.kinematics._seven_axis.tracing import LONGEST, SelfMotionTracer
from kinreach.kinematics._solutions import SLACK, Accept, IKResult, Status, nearest_windings

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
        q: Postures along the curve [rad], shape (m, 7), at most 0.15 rad apart, without jumps.
        tangent: Unit tangents there, shape (m, 7): the tip does not move along them.
        length: Arc length from the first posture [rad], shape (m,): the parameter of the curve.
        closed: Whether the last posture leads back to the first. If not, the curve ends at joint limits, or where it
            crosses another, or almost, at a singular posture.
        total: Length of the whole curve [rad], with the way back to the first posture if it is closed.
    """

    q: Floats
    tangent: Floats
    length: Floats
    closed: bool
    total: float
    _tracer: SelfMotionTracer
    _T: Floats

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
        start = self.q[before] + (s - self.length[before]) * self.tangent[before]
        return self._tracer.corrected(start[None], self._T, self.tangent[before][None])[0][0]


@dataclass(frozen=True, eq=False)
class SelfMotions:
    """Every posture of a pose, as curves; an iterable and a sequence of `SelfMotion`.

    Attributes:
        curves: The curves, the longest first.
        status: `OK` if there is at least one.
        reason: Why there is none, else empty.
    """

    curves: Sequence[SelfMotion]
    status: Status
    reason: str
    _kinematics: SevenAxisKinematics
    _T: Floats

    def __len__(self) -> int:
        return len(self.curves)

    def __getitem__(self, index: int) -> SelfMotion:
        return self.curves[index]

    @property
    def success(self) -> bool:
        """Whether there is a posture."""
        return self.status is Status.OK

    def nearest(self, seed: Floats, *, accept: Accept | None = None) -> IKResult:
        """Return the posture nearest to a seed (7,) that is accepted; `branch` is the index of its curve."""
        kin = self._kinematics
        least: list[tuple[float, int, Floats, Floats]] = []
        rest: list[tuple[float, int, Floats]] = []
        for index, curve in enumerate(self.curves):
            q = nearest_windings(curve.q.T, seed[:, None], kin.lower, kin.upper)[0].T
            apart = np.linalg.norm(q - seed, axis=1)
            rest += [(float(d), index, posture) for d, posture in zip(apart, q, strict=True)]
            least += [(float(apart[i]), index, q[i], curve.tangent[i]) for i in _least(apart, closed=curve.closed)]
        worth = min((each[0] for each in least), default=0.0) + 2.0 * LONGEST if accept is None else np.inf
        found = []
        for apart, index, q, t in least:
            if apart <= worth:
                best = self._walked(q, t, seed)
                found.append((float(np.linalg.norm(best - seed)), index, best))
        found.sort(key=lambda each: each[0])
        rest.sort(key=lambda each: each[0])
        for _, index, q in [*found, *rest] if accept is not None else found[:1]:
            if accept is None or accept(q.copy()):
                return self._result(q, index)
        if found:
            return self._result(found[0][2], found[0][1], Status.REJECTED, "accept refused every posture on the curves")
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
        if not tops:
            return self._none(np.array(kin.arm.home))
        best = sorted(tops, key=lambda each: -each[0])[:CLIMBS]
        climbed = [(*self._uphill(measure, value, q, t, max(step, LONGEST)), i) for value, i, q, t in best]
        most = max(value for value, _, _ in climbed)
        equal = [(q, index) for value, q, index in climbed if value >= most - EQUAL * abs(most)]
        middle, reach = 0.5 * (kin.lower + kin.upper), kin.upper - kin.lower
        q, index = min(equal, key=lambda each: float(np.linalg.norm((each[0] - middle) / reach)))
        if accept is not None and not accept(q):
            return self._result(q, index, Status.REJECTED, reason)
        return self._result(q, index)

    def _uphill(
        self, measure: Callable[[Floats], float], value: float, q: Floats, t: Floats, size: float
    ) -> tuple[float, Floats]:
        """The largest measure along a curve from a posture, and where it is."""
        while size > 1e-4:
            moves = [(measure(other), other) for other in (self._moved(q, t, size), self._moved(q, t, -size))]
            best, other = max(moves, key=lambda move: move[0])
            if best > value:
                value, q = best, other
                t = self._kinematics._tracer.corrected(q[None], self._T, t[None], steps=1)[1][0]
            else:
                size *= 0.5
        return value, q

    def _walked(self, q: Floats, t: Floats, seed: Floats) -> Floats:
        """Go along a curve towards a seed, as far as the limits allow."""
        share = 1.0
        for _ in range(STEPS):
            step = share * float(np.clip((seed - q) @ t, -LONGEST, LONGEST))
            if abs(step) < ARRIVED:
                break
            trial, tangent, off = self._kinematics._tracer.corrected((q + step * t)[None], self._T, t[None])
            nearer = np.linalg.norm(seed - trial[0]) < np.linalg.norm(seed - q)
            if nearer and off[0] < 1e-10 and self._kinematics.within_limits(trial[0]):
                q, t = trial[0], tangent[0]
            else:
                share *= 0.5
        return q

    def _moved(self, q: Floats, t: Floats, step: float) -> Floats:
        """A posture farther along the curve, or the same where that is not on it or outside of the limits."""
        trial, _, off = self._kinematics._tracer.corrected((q + step * t)[None], self._T, t[None])
        return trial[0] if off[0] < 1e-10 and self._kinematics.within_limits(trial[0]) else q

    def _result(self, q: Floats, index: int, status: Status = Status.OK, reason: str = "") -> IKResult:
        return IKResult(q, status, *self._kinematics._error_of(self._T, q), reason, branch=index)

    def _none(self, seed: Floats) -> IKResult:
        return IKResult(seed.copy(), self.status, *self._kinematics._error_of(self._T, seed), self.reason)


def within_limits(
    tracer: SelfMotionTracer, T: Floats, curves: Sequence[tuple[Floats, bool]], lower: Floats, upper: Floats
) -> list[SelfMotion]:
    """Cut curves at the joint limits, and wind them into them."""
    found = []
    turns = upper - lower >= 2.0 * MAX_ANGLE  # a joint without limits goes round and round
    for q, closed in curves:
        wound = np.column_stack([_wound(*column) for column in zip(q.T, lower, upper, strict=True)])
        inside = np.atleast_1d(((wound >= lower - SLACK) & (wound <= upper + SLACK)).all(axis=1))
        jumps: Floats = np.diff(wound, axis=0, append=wound[:1] if closed else wound[-1:])
        jumps[-1, turns] = wrapped(jumps[-1, turns])
        whole = np.abs(jumps).max(axis=1) < np.pi
        if closed and not (whole & inside).all():  # begin behind a cut
            first = int(np.argmin(whole & inside)) + 1
            wound, inside, whole = (np.roll(values, -first, axis=0) for values in (wound, inside, whole))
        elif closed:
            found.append(_motion(tracer, T, wound, closed=True))
            continue
        count = len(wound)
        cuts = np.flatnonzero(~(whole & inside & np.roll(inside, -1))) + 1
        for piece in np.split(np.arange(count), cuts[cuts < count]):
            if not inside[piece].all():
                continue
            begin, end = piece[0], piece[-1]
            postures = [*wound[piece]]
            if begin > 0 or closed:
                postures[:0] = _at_limit(tracer, T, wound[begin], wound[begin - 1], lower, upper)
            if end < count - 1 or closed:
                postures += _at_limit(tracer, T, wound[end], wound[(end + 1) % count], lower, upper)
            if len(postures) > 1:
                found.append(_motion(tracer, T, np.array(postures), closed=False))
    return sorted(found, key=lambda motion: -motion.total)


def _wound(angles: Floats, low: float, high: float) -> Floats:
    """Angles of one joint along a curve [rad], wound into its limits: with a jump only where they forbid to go on."""
    if high - low < TURN:
        return low + np.mod(angles - low, TURN)
    shift = -TURN * np.rint((angles[0] - 0.5 * (low + high)) / TURN)
    wound = np.empty_like(angles)
    for index, angle in enumerate(angles):
        if angle + shift > high:
            shift -= TURN
        elif angle + shift < low:
            shift += TURN
        wound[index] = angle + shift
    return wound


def _at_limit(
    tracer: SelfMotionTracer, T: Floats, inside: Floats, outside: Floats, lower: Floats, upper: Floats
) -> list[Floats]:
    """Where a curve leaves the limits between two neighbours: one posture, or none if it is the one inside."""
    ahead = inside + wrapped(outside - inside)
    best: list[Floats] = []
    least = np.inf
    for joint in np.flatnonzero((ahead < lower) | (ahead > upper)):
        limit = lower[joint] if ahead[joint] < lower[joint] else upper[joint]
        share = (limit - inside[joint]) / (ahead[joint] - inside[joint])
        start = inside + share * (ahead - inside)
        start[joint] = limit
        direction = np.zeros((1, len(start)))
        direction[0, joint] = 1.0
        q, _, off = tracer.corrected(start[None], T, direction, steps=8)
        good = off[0] < 1e-10 and ((q[0] >= lower - SLACK) & (q[0] <= upper + SLACK)).all()
        away = float(np.linalg.norm(q[0] - inside))
        if good and 1e-9 < away < min(least, 3.0 * LONGEST):
            best, least = [q[0]], away
    return best


def _motion(tracer: SelfMotionTracer, T: Floats, q: Floats, *, closed: bool) -> SelfMotion:
    steps = np.linalg.norm(np.diff(q, axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    total = float(length[-1]) + (float(np.linalg.norm(wrapped(q[0] - q[-1]))) if closed else 0.0)
    return SelfMotion(q, tracer.tangents(q), length, closed, total, tracer, T)


def _least(values: Floats, *, closed: bool) -> list[int]:
    """Indices of the local minima along a curve."""
    before, after = np.roll(values, 1), np.roll(values, -1)
    if not closed:
        before[0], after[-1] = np.inf, np.inf
    return [int(index) for index in np.flatnonzero((values <= before) & (values < after))]
