"""Newton's method from near starts for arms that are almost URs, on arrays of angles.

The loop is closed in the frame before the turn of joint 5, with its origin where axes 5 and 6 are nearest: there the
columns of joints 4 and 5 are constant, and what is left are four equations. Almost: the first joint alone moves that
origin along axis 4, joint 6 alone turns about the normal of axes 4 and 5, and joints 2 and 3 do the rest. In this order
nothing has to be sorted, and no pivot is small unless the arm is near a singularity: the shoulder's, the wrist's, the
elbow's.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.kinematics._general_6r import EXACT

JOINTS = 6
#: Postures at once: their numbers stay in the cache.
ROWS = 2048
#: Within this of a start that almost reaches, a posture is turned by less than pi against it [rad].
FAR = 0.5
#: Steps with a matrix of their own, and with the last one.
NEWTON, CHORD = 2, 2


class Refinement:
    """Newton's method from near starts."""

    def __init__(self, placements: Floats) -> None:
        A = placements.copy()
        z, p = A[5][:3, 2], A[5][:3, 3]
        self._slide(A, 5, float(p[2] - (p[:2] @ z[:2]) / (z[:2] @ z[:2]) * z[2]))  # axis 5, to where axis 6 is nearest
        z, p = A[5][:3, 2], A[5][:3, 3]
        self._slide(A, 6, float(-(p @ z)))  # and axis 6
        back = np.linalg.inv(A)
        self._first, self._last = back[0], back[6]
        self._turns, self._shifts = back[1:5, :3, :3].copy(), back[1:5, :3, 3:].copy()
        x, y, z, self._near = A[5][:3].T
        self._wrist = np.column_stack([x, y, z, self._near, np.cross(self._near, z)])
        self._rows = self._equations(np.hstack([np.cross(back[4][:3, 3], back[4][:3, 2]), back[4][:3, 2]]))

    @staticmethod
    def _slide(A: Floats, joint: int, height: float) -> None:
        """Move the frame of a joint along its axis [m]."""
        A[joint - 1, :3, 3] += height * A[joint - 1, :3, 2]
        A[joint, 2, 3] -= height

    @staticmethod
    def _equations(fourth: Floats) -> Floats:
        """Rows that make the columns of joints 4 and 5 unit vectors, from the column of joint 4, shape (6, 6)."""
        y = fourth[3:] * (1.0, 1.0, 0.0) / np.hypot(*fourth[3:5])
        x, z = (y[1], -y[0], 0.0), (0.0, 0.0, 1.0)
        rows = np.zeros((JOINTS, 6))
        rows[0, :3], rows[1, 3:], rows[2, :3], rows[3, :3], rows[4, 3:], rows[5, 3:] = y, x, x, z, y, z
        fourth = rows @ fourth
        rows[4] /= fourth[4]
        rows[[0, 1, 2, 3, 5]] -= np.outer(fourth[[0, 1, 2, 3, 5]], rows[4])
        return rows

    def wanted(self, T: Floats) -> Floats:
        """Poses (count, 4, 4) as `refined` reads them, shape (3, 4, count)."""
        return np.ascontiguousarray((self._first @ T @ self._last)[:, :3].transpose(1, 2, 0))

    def near(self, q: Floats, row: NDArray[np.int64], wanted: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Postures near starts (6, m) for poses by their row (m,) in `wanted`, and which have arrived (m,).

        Where Newton's method has not arrived, the posture is the start.
        """
        found, off = np.empty_like(q), np.full(q.shape[1], np.inf)
        with np.errstate(all="ignore"):  # what goes astray has not arrived
            for start in range(0, len(row), ROWS):
                part = slice(start, start + ROWS)
                found[:, part], off[part] = self.refined(q[:, part], wanted[:, :, row[part]])
            late = np.flatnonzero(~(off < EXACT))
            found[:, late], off[late] = self.refined(found[:, late], wanted[:, :, row[late]])
            arrived = (off < EXACT) & (np.abs(found - q).max(axis=0) < FAR)
        return np.where(arrived, found, q), arrived

    def refined(self, q: Floats, wanted: Floats) -> tuple[Floats, Floats]:
        """Compute postures near starts (6, m) [rad], for columns of `wanted`, shape (3, 4, m).

        Returns:
            Postures (6, m), and a bound of how far they miss their poses at the wrist [m, rad], shape (m,).
        """
        for _ in range(NEWTON):
            c, s = _cosine_sine(q)
            lines, reached = self._lines(c, s, wanted), self._end(c, s)
            error = self._error(lines[:, 3:7], reached)
            factors = self._factors(lines, reached)
            step = _solved(factors, self._rows @ error)
            q = q + step
        for _ in range(CHORD):
            c, s = _turned_on(c, s, step)
            error = self._error(self._across(c, s, wanted), self._end(c, s))
            step = _solved(factors, self._rows @ error)
            q += step
        return q, np.abs(error).sum(axis=0)

    def _across(self, c: Floats, s: Floats, wanted: Floats) -> Floats:
        """What joints 5 and 6 have to do: the wanted pose in the frame of joint 5, shape (3, 4, m)."""
        frame = wanted.copy()
        for joint in range(4):
            _turn_back(frame, c[joint], s[joint])
            frame = (self._turns[joint] @ frame.reshape(3, -1)).reshape(frame.shape)
            frame[:, 3] += self._shifts[joint]
        return frame

    def _lines(self, c: Floats, s: Floats, wanted: Floats) -> Floats:
        """In the frame of joint 5: directions of axes 3, 2, 1, the wanted pose, points of axes 1, 2, 3 (3, 10, m)."""
        count = wanted.shape[2]
        lines, other = np.empty((2, 3, 10, count))
        lines[:, 3:7] = wanted
        for joint in range(4):
            low, high = 3 - joint, 7 + joint
            part = lines[:, low:high]
            _turn_back(part, c[joint], s[joint])
            np.matmul(self._turns[joint], part.reshape(3, -1), out=other[:, low:high].reshape(3, -1))
            other[:, 6:high] += self._shifts[joint][:, None]
            if joint < 3:
                other[:, low - 1], other[:, high] = self._turns[joint][:, 2:], self._shifts[joint]
            lines, other = other, lines
        return lines

    def _end(self, c: Floats, s: Floats) -> Floats:
        """What joints 5 and 6 do: axes and origin of the last frame, and moment of axis 6, shape (3, 5, m)."""
        x, y = self._wrist[:, 0, None], self._wrist[:, 1, None]
        end = np.empty((3, 5, c.shape[1]))
        end[:, 0], end[:, 1] = c[5] * x + s[5] * y, c[5] * y - s[5] * x
        end[:, 2:] = self._wrist[:, 2:, None]
        _turn_back(end, c[4], -s[4])
        return end

    def _error(self, wanted: Floats, reached: Floats) -> Floats:
        """Twist from what is reached to what is wanted, velocity at the frame's origin first, shape (6, m)."""
        error = np.empty((6, wanted.shape[2]))
        for row, (a, b) in enumerate(((1, 2), (2, 0), (0, 1))):
            error[3 + row] = 0.5 * (reached[a, :3] * wanted[b, :3] - reached[b, :3] * wanted[a, :3]).sum(axis=0)
        np.subtract(wanted[:, 3], reached[:, 3], out=error[:3])
        return error

    def _factors(self, lines: Floats, reached: Floats) -> tuple[Floats, ...]:
        """The equations' matrix, columns of joints 1, 2, 3 and 6, and what eliminates joints 1 and 6."""
        count = lines.shape[2]
        columns = np.empty((6, 4, count))
        z, p = lines[:, 2::-1], lines[:, 7:]
        for row, (a, b) in enumerate(((1, 2), (2, 0), (0, 1))):
            np.multiply(p[a], z[b], out=columns[row, :3])
            columns[row, :3] -= p[b] * z[a]
        columns[3:, :3] = z
        columns[:3, 3], columns[3:, 3] = reached[:, 4], reached[:, 2]
        K = (self._rows @ columns.reshape(6, -1)).reshape(6, 4, count)
        first = K[1:4, 0] / K[0, 0]
        K[1:4, 1:] -= first[:, None] * K[0, 1:]
        last = K[2:4, 3] / K[1, 3]
        K[2:4, 1:3] -= last[:, None] * K[1, 1:3]
        return K, first, last, 1.0 / (K[2, 1] * K[3, 2] - K[2, 2] * K[3, 1])


def _solved(factors: tuple[Floats, ...], b: Floats) -> Floats:
    """Steps of the joints (6, m) for right sides (6, m), which are changed."""
    K, first, last, inverse = factors
    b[1:4] -= first * b[0]
    b[2:4] -= last * b[1]
    x = np.empty_like(b)
    x[1] = (K[3, 2] * b[2] - K[2, 2] * b[3]) * inverse
    x[2] = (K[2, 1] * b[3] - K[3, 1] * b[2]) * inverse
    x[5] = (b[1] - (K[1, 1:3] * x[1:3]).sum(axis=0)) / K[1, 3]
    x[0] = (b[0] - (K[0, 1:3] * x[1:3]).sum(axis=0) - K[0, 3] * x[5]) / K[0, 0]
    x[3:5] = b[4:] - (K[4:, :3] * x[:3]).sum(axis=1) - K[4:, 3] * x[5]
    return x


def _turn_back(columns: Floats, c: Floats, s: Floats) -> None:
    """Turn vectors (3, k, m) about z by the angles whose cosines and sines (m,) are given, backwards."""
    crossed = columns[:2] * s
    columns[:2] *= c
    columns[0] += crossed[1]
    columns[1] -= crossed[0]


def _cosine_sine(q: Floats) -> tuple[Floats, Floats]:
    """Cosines and sines of angles, by way of the half angle's tangent."""
    t = np.tan(0.5 * q)
    c = t * t
    c += 1.0
    np.divide(2.0, c, out=c)
    t *= c
    c -= 1.0
    return c, t


def _turned_on(c: Floats, s: Floats, step: Floats) -> tuple[Floats, Floats]:
    """Cosines and sines of angles that small steps have changed."""
    square = step * step
    cosine, sine = 1.0 + square * (square * (1 / 24) - 0.5), step * (1.0 + square * (square * (1 / 120) - 1 / 6))
    return c * cosine - s * sine, s * cosine + c * sine
