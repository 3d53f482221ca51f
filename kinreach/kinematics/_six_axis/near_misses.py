"""Postures of a pose on curves of postures that almost reach it.

Where a joint is almost free, an arm misses the pose by very little along a whole curve, and reaches it at some places
only. Newton's method from a posture nearby often does not come to these: along the curve the Jacobian is singular, or
almost. So the error is split. Along one twist u, the direction in which the tip hardly moves, it is left as an unknown
size; the five other parts vanish:

    error(q) = size * u,  v . (q - start) = way

v is the direction of joint space that hardly moves the tip. These equations are regular and have one posture for each
way. The pose is reached where the size changes its sign or touches 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.kinematics._general_6r import CONVERGED, EXACT, Chain, first_of_each

#: Ways along a curve, either way of its start [rad]; and how many sizes are compared within an interval of ways.
WAYS, INSIDE = np.linspace(-0.3, 0.3, 13), np.linspace(0.0, 1.0, 9)
#: Steps of Newton's method to a curve, and the longest of a joint [rad]; how often curves go on, and an interval
#: is divided.
STEPS, MAX_JOINT_STEP, ROUNDS = 6, 0.3, 6
#: Curves start this far apart [rad]; index of the start among the ways.
NEAR, MIDDLE = 0.2, len(WAYS) // 2
#: Largest size of what a curve misses [m, rad].
MAX_SIZE = 0.03
#: Intervals that are divided further, at most: those with the smallest sizes.
MAX_INTERVALS = 200
#: A size without a change of its sign has to fall by this factor within an interval to touch 0.
FALLS = 0.5


def reached_beside(chain: Chain, T: Floats, starts: Floats) -> Floats:
    """Follow curves through postures (m, 6) that almost reach a pose; return where the curves reach it (k, 6).

    They are starts of Newton's method.
    """
    curves = []
    for _ in range(ROUNDS):
        if not len(starts):
            break
        J = chain.step(starts, T[None])[1]
        U, _, V = np.linalg.svd(J)
        u, v, (curve, way) = U[:, :, 5], V[:, 5], np.indices((len(starts), len(WAYS)))
        q, size = _on_curves(chain, T, starts[curve] + WAYS[way][..., None] * v[curve], u[curve], v[curve])
        curves.append((q, size, u, v))
        ends, known = q[:, (0, -1)][np.isfinite(size[:, (0, -1)])], np.vstack([each[0][:, MIDDLE] for each in curves])
        starts = ends[first_of_each(np.vstack([known, ends]), NEAR)[len(known) :]]
    if not curves:
        return starts
    q, size, u, v = (np.concatenate(each) for each in zip(*curves, strict=True))
    with np.errstate(invalid="ignore"):
        for _ in range(ROUNDS):
            row, first, last = _intervals(size)
            if not len(row):
                return q[:0, 0]
            least = np.argsort(np.minimum(np.abs(size[row, first]), np.abs(size[row, last])))[:MAX_INTERVALS]
            row, first, last = row[least], first[least], last[least]
            u, v = u[row], v[row]
            begin, end = q[row, first, None], q[row, last, None]
            around = np.broadcast_to(u[:, None], (len(row), len(INSIDE), 6))
            along = np.broadcast_to(v[:, None], around.shape)
            q, size = _on_curves(chain, T, begin + INSIDE[:, None] * (end - begin), around, along)
    best = np.nan_to_num(np.abs(size), nan=np.inf).argmin(axis=1)
    return q[np.arange(len(q)), best]


def _on_curves(chain: Chain, T: Floats, q: Floats, u: Floats, v: Floats) -> tuple[Floats, Floats]:
    """Postures of curves near postures (m, n, 6), and by how much they miss the pose along u (m, n); NaN without."""
    shape = q.shape[:2]
    q, u, v = q.reshape(-1, 6).copy(), u.reshape(-1, 6), v.reshape(-1, 6)
    size, off, rows = np.zeros(len(q)), np.full(len(q), np.inf), np.arange(len(q))
    for left in range(STEPS, -1, -1):
        error, J, _ = chain.step(q[rows], T[None])
        rest = error - size[rows, None] * u[rows]
        off[rows] = np.abs(rest).max(axis=1)
        going = off[rows] > CONVERGED
        rows = rows[going]
        if not (left and len(rows)):
            break
        A = np.zeros((len(rows), 7, 7))
        A[:, :6, :6], A[:, :6, 6], A[:, 6, :6] = J[going], u[rows], v[rows]
        side = np.concatenate([rest[going], np.zeros((len(rows), 1))], axis=1)[..., None]
        step = np.linalg.solve(A + 1e-14 * np.eye(7), side)[..., 0]
        step *= np.minimum(1.0, MAX_JOINT_STEP / np.maximum(np.abs(step).max(axis=1), MAX_JOINT_STEP))[:, None]
        q[rows] += step[:, :6]
        size[rows] += step[:, 6]
    size[(off > EXACT) | (np.abs(size) > MAX_SIZE)] = np.nan
    return q.reshape(*shape, 6), size.reshape(shape)


def _intervals(size: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Where sizes (m, n) change their sign or may touch 0: row, and first and last column of the interval."""
    changes = size[:, 1:] * size[:, :-1] <= 0.0
    changes &= np.maximum(np.abs(size[:, 1:]), np.abs(size[:, :-1])) > EXACT  # or all of the curve reaches
    row, first = np.nonzero(changes)
    height = np.abs(size)
    lowest = (height[:, 1:-1] <= height[:, :-2]) & (height[:, 1:-1] <= height[:, 2:])
    lowest &= height[:, 1:-1] < FALLS * np.maximum(height[:, :-2], height[:, 2:])
    lowest &= ~(changes[:, 1:] | changes[:, :-1])
    touching, middle = np.nonzero(lowest)
    return np.append(row, touching), np.append(first, middle), np.append(first + 1, middle + 2)
