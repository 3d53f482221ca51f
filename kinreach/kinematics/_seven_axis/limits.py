"""The parts of self-motion curves that are within joint limits.

Between two samples a curve is a cubic, to about 1e-5 rad. Where one of its joints comes to a limit, a sample is added
with that joint exactly there. So every way between two neighbours is within the limits as a whole, or it is not.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import MAX_ANGLE, Floats
from kinreach._rotations import TURN, wrapped
from kinreach.kinematics._core import doubles, flags, ints, lib
from kinreach.kinematics._general_6r import first_of_each
from kinreach.kinematics._seven_axis.starts import JOINTS
from kinreach.kinematics._seven_axis.tracing import MISSED, ON_CURVE, SAME, Curve, SelfMotionTracer
from kinreach.kinematics._solutions import SLACK, nearest_windings, past_limits

#: Part of a curve within limits: postures [rad], shape (m, 7), without jumps, and whether it is all of a closed one.
Part = tuple[Floats, bool]
#: Steps of Newton's method to a limit.
NEWTON = 8
#: The same to any value, next to which a joint may turn back, and by how much the posture misses the pose [m, rad].
MANY, EXACT = 40, 1e-12


def cut(tracer: SelfMotionTracer, T: Floats, curves: Sequence[Curve], lower: Floats, upper: Floats) -> list[Part]:
    """Cut curves of a pose (4, 4) at joint limits (7,), and wind their parts into them.

    They are also cut where a joint that may turn by more than a whole turn comes to a limit, and goes on a turn back. A
    joint that has no limits goes round and round.
    """
    if not curves:
        return []
    q, owner, whole = _with_crossings(tracer, T, curves, lower, upper)
    inside = _inside(q, lower, upper) & (tracer.missed(q, T) < MISSED)
    found: list[Part] = []
    for index, curve in enumerate(curves):
        begin, end = np.searchsorted(owner, (index, index + 1))
        here, within = q[begin:end], inside[begin:end]
        ways = whole[begin:end] & within & np.roll(within, -1)
        if not curve.closed:
            ways[-1] = False
        for run in _runs(ways, within, closed=curve.closed):
            if len(run) > 1 or (len(run) and len(here) == 1):
                unrolled = here[run[0]] + np.vstack(
                    [np.zeros(7), np.cumsum(wrapped(np.diff(here[run], axis=0)), axis=0)]
                )
                found += _wound(unrolled, lower, upper, full=bool(ways.all()))
    return found


def _runs(ways: NDArray[np.bool_], inside: NDArray[np.bool_], *, closed: bool) -> list[NDArray[np.int64]]:
    """The samples of each part of a curve whose samples (m,) and ways to the next ones (m,) are inside."""
    count = len(ways)
    if ways.all():
        return [np.arange(count + 1) % count]
    last = np.flatnonzero(~ways)
    begins = np.roll(last, 1) + 1
    begins[0] -= 0 if closed else count
    runs = [np.arange(a if a <= b else a - count, b + 1) for a, b in zip(begins, last, strict=True)]
    return [run[inside[run]] for run in runs]


def _with_crossings(
    tracer: SelfMotionTracer, T: Floats, curves: Sequence[Curve], lower: Floats, upper: Floats
) -> tuple[Floats, NDArray[np.int64], NDArray[np.bool_]]:
    """The samples of all curves, and one wherever a joint is at a limit.

    Returns:
        Postures (m, 7); the curve of each; and whether the way from each to the next may be inside.
    """
    q, tangent = np.vstack([curve.q for curve in curves]), np.vstack([curve.tangents for curve in curves])
    owner = np.repeat(np.arange(len(curves)), [len(curve.q) for curve in curves])
    free = upper - lower >= 2.0 * MAX_ANGLE
    after = _following(owner)
    here, closed = np.arange(len(q)), np.array([curve.closed for curve in curves])[owner]
    (steps,) = np.nonzero((after > here) | (closed & (after < here)))
    if free.all() or not len(steps):
        return q, owner, np.ones(len(q), dtype=np.bool_)
    begin, out, into = q[steps], tangent[steps], tangent[after[steps]]
    away = wrapped(q[after[steps]] - begin)
    length = np.linalg.norm(away, axis=1)[:, None]
    piece, joint, limit, share = _crossings(begin, away, length * out, length * into, lower, upper, ~free)
    if not len(piece):
        return q, owner, np.ones(len(q), dtype=np.bool_)
    start = begin[piece] + _cubic(away[piece], (length * out)[piece], (length * into)[piece], share[:, None])
    there, off = _exactly_at(tracer, T, start, joint, limit)
    slip = np.linalg.norm(there - start, axis=1) > 0.3 * length[piece, 0]
    failed = slip | (off >= ON_CURVE)  # the curve only touches the limit
    if failed.any():
        there[failed], _, off[failed] = tracer.corrected(start[failed], T, out[piece[failed]])
    gone = wrapped(there - begin[piece])
    good = off < ON_CURVE
    order = np.lexsort(((gone * away[piece]).sum(axis=1)[good], piece[good]))
    piece, gone = steps[piece[good][order]], gone[good][order]
    places = piece + 1
    wide, owner = np.insert(q, places, q[piece] + gone, axis=0), np.insert(owner, places, owner[piece])
    # middles of the ways that begin or end at an added sample
    added = places + np.arange(len(places))
    near = np.union1d(added, added - 1)
    whole = np.ones(len(wide), dtype=np.bool_)
    step = wrapped(wide[_following(owner)[near]] - wide[near])
    direction = step / np.maximum(np.linalg.norm(step, axis=1), SAME)[:, None]
    middle, _, off = tracer.corrected(wide[near] + 0.5 * step, T, direction)
    whole[near] = (off < ON_CURVE) & _inside(middle, lower, upper)
    return wide, owner, whole


def _exactly_at(
    tracer: SelfMotionTracer,
    T: Floats,
    start: Floats,
    joint: NDArray[np.int64],
    value: Floats,
    *,
    steps: int = NEWTON,
) -> tuple[Floats, Floats]:
    """Postures of a pose near some (m, 7) with a joint (m,) of each at a value (m,), and how far they miss it (m,).

    The joints of the given ones are put there.
    """
    row = np.arange(len(start))
    start[row, joint] += wrapped(value - start[row, joint])
    across = np.zeros(start.shape)
    across[row, joint] = 1.0
    there, _, off = tracer.corrected(start, T, across, steps=steps)
    return there, off


def _with_turning_points(tracer: SelfMotionTracer, T: Floats, curve: Curve, joint: int) -> Curve:
    """A curve with samples where a joint goes no farther: between two others it may come to a value there."""
    after = np.roll(np.arange(len(curve.q)), -1)
    away, out, into = wrapped(curve.q[after] - curve.q), curve.tangents, curve.tangents[after]
    (piece,) = np.nonzero(out[:, joint] * into[:, joint] < 0.0)
    piece = piece[: None if curve.closed else -1] if len(piece) and piece[-1] == len(curve.q) - 1 else piece
    length = np.linalg.norm(away[piece], axis=1)
    a, b, c = away[piece, joint], length * out[piece, joint], length * into[piece, joint]
    # the cubic's derivative is b + (6 a - 4 b - 2 c) u + 3 (b + c - 2 a) u^2, with one zero between
    half, square = 3.0 * a - 2.0 * b - c, 3.0 * (b + c - 2.0 * a)
    u = (b / (-half + np.copysign(np.sqrt(half * half - square * b), b)))[:, None]
    ways = away[piece], length[:, None] * out[piece], length[:, None] * into[piece]
    there, tangents, off = tracer.corrected(curve.q[piece] + _cubic(*ways, u), T, away[piece])
    good = off < ON_CURVE
    places = piece[good] + 1
    q, ahead = (
        np.insert(rows, places, new[good], axis=0) for rows, new in ((curve.q, there), (curve.tangents, tangents))
    )
    return Curve(q, curve.closed, ahead)


def at_value(tracer: SelfMotionTracer, T: Floats, curve: Curve, joint: int, value: float) -> Floats:
    """The postures (k, 7) on a curve of a pose (4, 4) with a joint at a value, turns aside, in their order."""
    curve = _with_turning_points(tracer, T, curve, joint)
    after = np.roll(np.arange(len(curve.q)), -1)[: None if curve.closed else -1]
    begin, tangents = curve.q[: len(after)], curve.tangents[: len(after)]
    away = wrapped(curve.q[after] - begin)
    length = np.linalg.norm(away, axis=1)[:, None]
    out, into = length * tangents, length * curve.tangents[after]
    this, never = np.arange(JOINTS) == joint, np.full(JOINTS, np.nan)
    piece, _, _, share = _crossings(begin, away, out, into, np.full(JOINTS, value), never, this)
    order = np.lexsort((share, piece))
    piece, share = piece[order], share[order][:, None]
    start = begin[piece] + _cubic(away[piece], out[piece], into[piece], share)
    joints, values = np.full(len(piece), joint), np.full(len(piece), value)
    there, off = _exactly_at(tracer, T, start, joints, values, steps=MANY)
    there = there[(off < EXACT) & (np.linalg.norm(there - start, axis=1) <= 0.3 * length[piece, 0] + SAME)]
    ends = curve.q[:0] if curve.closed else curve.q[[0, -1]]
    first, last = (end[np.abs(wrapped(end[:, joint] - value)) < EXACT] for end in (ends[:1], ends[-1:]))
    found = np.vstack([first, there, last])
    return found[first_of_each(found, SAME)]


def _following(owner: NDArray[np.int64]) -> NDArray[np.int64]:
    """The row after each of curves' samples, the first one after the last."""
    after = np.arange(1, len(owner) + 1)
    (ends,) = np.nonzero(np.append(owner[1:] != owner[:-1], True))
    after[ends] = np.append(0, ends[:-1] + 1)
    return after


def _crossings(
    begin: Floats, away: Floats, out: Floats, into: Floats, lower: Floats, upper: Floats, limited: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats, Floats]:
    """Where cubics (m, 7) from a posture by a way, with derivatives at both ends, come to a limit of a joint.

    Returns:
        Which cubic and joint, each (k,); the limit [rad] and the parameter in [0, 1], each (k,).
    """
    begin, away, out, into = map(np.ascontiguousarray, (begin, away, out, into))
    which, limits, shares = np.empty(6 * begin.size, np.int32), np.empty(6 * begin.size), np.empty(6 * begin.size)
    count = lib.kr_crossings(
        *begin.shape, doubles(begin), doubles(away), doubles(out), doubles(into), doubles(lower), doubles(upper),
        flags(limited), ints(which), doubles(limits), doubles(shares),
    )  # fmt: skip
    piece, joint = np.divmod(which[:count].astype(np.int64), begin.shape[1])
    return piece, joint, limits[:count], shares[:count]


def _cubic(away: Floats, out: Floats, into: Floats, u: Floats) -> Floats:
    """The way on a cubic to a parameter in [0, 1], from the whole way and the derivatives at both ends."""
    return u * u * (3.0 - 2.0 * u) * away + u * (1.0 - u) * ((1.0 - u) * out - u * into)


def _inside(q: Floats, lower: Floats, upper: Floats) -> NDArray[np.bool_]:
    """Which postures (m, 7) can be wound into limits."""
    inside: NDArray[np.bool_] = nearest_windings(q.T, 0.0, lower, upper)[1]
    return inside


def _wound(q: Floats, lower: Floats, upper: Floats, *, full: bool) -> list[Part]:
    """Wind a part of a curve (m, 7) that is within limits but for whole turns; a `full` one ends as it begins."""
    shift = _shifts(q, lower, upper)
    jumps = np.flatnonzero((np.diff(shift, axis=0) != 0.0).any(axis=1))
    if full and len(jumps):  # begin at a cut
        q = np.vstack([q[jumps[0] :], q[1 : jumps[0] + 1] + q[-1] - q[0]])
        shift = _shifts(q, lower, upper)
        jumps = np.flatnonzero((np.diff(shift, axis=0) != 0.0).any(axis=1))
    around = np.abs(q[-1] + shift[-1] - q[0] - shift[0]) > np.pi
    if full and not len(jumps) and not (around & (upper - lower < 2.0 * MAX_ANGLE)).any():
        return [((q + shift)[:-1], True)]
    # the sample at a limit ends one part, and a turn back it begins the next
    ends = zip([-1, *jumps], [*jumps, len(q) - 1], strict=True)
    return [(q[max(begin, 0) : end + 1] + shift[begin + 1], False) for begin, end in ends]


def _shifts(q: Floats, lower: Floats, upper: Floats) -> Floats:
    """Whole turns by which the postures of a part of a curve are wound into the limits, shape (m, 7)."""
    middle = q[len(q) // 2] if len(q) > 2 else q.mean(axis=0)
    narrow = upper - lower < TURN
    turns = -TURN * np.where(narrow, np.floor((middle - lower) / TURN), np.rint((q[0] - 0.5 * (lower + upper)) / TURN))
    shift = np.tile(turns, (len(q), 1))
    whole = ~past_limits(np.array([q.min(axis=0), q.max(axis=0)]) + turns, lower, upper).any(axis=0)
    for joint in np.flatnonzero(~(narrow | whole)):
        along, turned = np.ascontiguousarray(q[:, joint]), np.empty(len(q))
        lib.kr_turns_along(len(q), 1, doubles(along), lower[joint], upper[joint], SLACK, doubles(turned))
        shift[:, joint] = turned
    return shift
