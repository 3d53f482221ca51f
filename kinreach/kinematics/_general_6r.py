"""All postures of any arm with six revolute joints, and what its equations need: poses, Jacobians, Newton's method.

The postures are found by elimination and an eigenvalue problem, in the compiled core: `_core/elimination.c` has the
method and its sources. `General6R` prepares it for an arm, and tells which arms' equations are singular.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach._rotations import joints_apart, turns_about_z, wrapped
from kinreach.kinematics._core import Struct, doubles, ffi, ints, lib, longs

#: A posture is a solution if its error is less [m, rad].
EXACT = 1e-10
#: Newton's method stops at an error below this [m, rad].
CONVERGED = 1e-13
#: Imaginary part up to which an eigenvalue is a starting point: two postures merge there, or have just vanished.
MAX_CANDIDATE = 3e-2
#: The same for the starting points of an arm with one more joint, which may reach what this one misses by far.
MAX_REDUNDANT_CANDIDATE = 0.2
#: Eigenvalues whose angles differ by more are distinct [rad].
DISTINCT_ANGLE = 1e-4
#: Postures closer than this in every joint are the same [rad].
SAME = 1e-6
#: Starting points closer than this are the same, where Newton's method converges slowly [rad].
SAME_START = 1e-3
#: Steps of Newton's method from an eigenvalue, and near a singularity.
STEPS, MAX_STEPS = 6, 40
#: An eigenvalue that occurs for this share of random poses is spurious.
SPURIOUS_SHARE = 0.9
#: Largest number of postures of a six-joint arm for a pose.
MAX_POSTURES = 16
_JOINTS = 6
#: Three angles at which functions that are linear in cosine and sine are sampled [rad].
SAMPLES = 2 * np.pi / 3 * np.arange(3)
#: Coefficients of 1, cos and sin of a function that is linear in them, from its values at `SAMPLES`.
COEFFICIENTS = np.array([np.full(3, 1 / 3), 2 / 3 * np.cos(SAMPLES), 2 / 3 * np.sin(SAMPLES)])
#: Places at which functions that are linear in a slide are sampled, and coefficients of 1, the slide and nothing.
SLIDE_SAMPLES = np.array([0.0, 1.0, -1.0])
SLIDE_COEFFICIENTS = np.array([[1.0, 0.0, 0.0], [0.0, 0.5, -0.5], [0.0, 0.0, 0.0]])
#: Twist and trace of a small motion (4, 4), from its entries, shape (16, 7).
_TWIST = np.zeros((16, 7))
_TWIST[(3, 7, 11), (0, 1, 2)] = _TWIST[::5, 6][:3] = 1.0
_TWIST[(9, 2, 4), (3, 4, 5)], _TWIST[(6, 8, 1), (3, 4, 5)] = 0.5, -0.5


class Chain:
    """Joints that each turn about their frame's z axis, or slide along it, `T = A0 Rz(q1) A1 Rz(q2) ... Rz(qn) An`.

    `SerialChain` has the same poses and Jacobians. Newton's method asks for those of few postures at a time: of up to
    32 this class takes less than an eighth of its time, of 4000 twice as long.

    Args:
        placements: A0 to An, shape (n + 1, 4, 4); n is 6 or 7.
        pitches: By how much each joint slides in a step of 1 [m], shape (n,), 0 for one that turns; by default all do.

    Attributes:
        placements, pitches: The same.
        slides: Which joints slide, shape (n,).
        rows: Upper rows of the placements, shape (n + 1, 3, 4).
        core: Those and the pitches, as the core has them.
    """

    def __init__(self, placements: Floats, pitches: Floats | None = None) -> None:
        self.placements = placements
        self.rows: Floats = np.ascontiguousarray(placements[:, :3])
        self._joints = len(placements) - 1
        self.pitches: Floats = np.zeros(self._joints) if pitches is None else pitches
        self.core: Floats = np.append(self.rows, self.pitches)
        self.slides: NDArray[np.bool_] = self.pitches != 0.0
        # largest distance of the tip from the origin of the frame before joint 4
        self._reach = float(np.linalg.norm(placements[4:, :3, 3], axis=1).sum() + np.pi * self.pitches[3:].sum())

    @cached_property
    def _halves(self) -> list[Floats]:
        """Coefficients of `_half` for joints 1 to 3, shape (27, 34), and for the others, (27, 34) or (81, 40)."""
        return [
            self._half(self.placements[:4], self.pitches[:3], after=False),
            self._half(self.placements[4:], self.pitches[3:], after=True),
        ]

    def fk(self, q: Floats) -> Floats:
        """Upper rows of the tip's poses, shape (m, 3, 4), for postures (m, n)."""
        frame, turns = self._start(q)
        for joint in range(self._joints):
            frame = self._turned(frame, turns, joint)
        return frame

    def jacobian(self, q: Floats) -> tuple[Floats, Floats]:
        """As `fk`, and the geometric Jacobian along the base's axes, shape (m, 6, n)."""
        frame, turns = self._start(q)
        axes = np.empty((self._joints, len(q), 3, 2))
        for joint in range(self._joints):
            axes[joint] = frame[:, :, 2:]
            frame = self._turned(frame, turns, joint)
        z, arm = axes[..., 0], frame[:, :, 3] - axes[..., 1]
        J = np.empty((len(q), 6, self._joints))
        for row, (a, b) in enumerate(((1, 2), (2, 0), (0, 1))):
            J[:, row] = (z[..., a] * arm[..., b] - z[..., b] * arm[..., a]).T
        J[:, 3:] = z.transpose(1, 2, 0)
        for joint in np.flatnonzero(self.slides):
            J[:, :3, joint], J[:, 3:, joint] = self.pitches[joint] * z[joint], 0.0
        return frame, J

    def step(self, q: Floats, T: Floats) -> tuple[Floats, Floats, Floats]:
        """Compute errors and Jacobians of postures (m, n) for poses (m, 4, 4) or (1, 4, 4).

        Returns:
            Twists to the poses (m, 6) and Jacobians (m, 6, n), both in the frame before joint 4; and upper bounds of
            the tip's error [m, rad], shape (m,).
        """
        count = len(q)
        first, last = self._products(q)
        before, after = first @ self._halves[0], last @ self._halves[1]
        reached = before[:, :16].reshape(count, 4, 4) @ T @ after[:, :16].reshape(count, 4, 4)
        entries = reached.reshape(count, 16) @ _TWIST
        J = np.concatenate([before[:, 16:], after[:, 16:]], axis=1).reshape(count, self._joints, 6).transpose(0, 2, 1)
        error = entries[:, :6]
        if (entries[:, 6] < 1.0).any():  # by more than a right angle
            error[:, 3:] += np.where(entries[:, 6:] < 1.0, np.copysign(1.0, error[:, 3:]), 0.0)
        square = error * error
        turned = np.sqrt(square[:, 3:].sum(axis=1))
        return error, J, np.maximum(np.sqrt(square[:, :3].sum(axis=1)) + self._reach * turned, turned)

    def _products(self, q: Floats) -> tuple[Floats, Floats]:
        """Products of 1, cosine and sine of the angles (m, n) of joints 1 to 3 (m, 27), and of the others.

        Of a slide they are 1, the slide and 0.
        """
        count = len(q)
        angles = np.empty((3, self._joints, count))
        angles[0] = 1.0
        np.cos(q.T, out=angles[1])
        np.sin(q.T, out=angles[2])
        if self.slides.any():
            angles[1, self.slides], angles[2, self.slides] = q.T[self.slides], 0.0
        products = (angles[:, None, None, 0:6:3] * angles[:, None, 1:6:3]) * angles[:, 2:6:3]
        first, last = products.reshape(27, 2, count).transpose(1, 2, 0)
        if self._joints == 7:
            last = (products[..., 1, None, :] * angles[:, 6]).reshape(81, count).T
        return first, last

    @staticmethod
    def _half(placements: Floats, pitches: Floats, *, after: bool) -> Floats:
        """Some joints' inverse motion (16 numbers) and their axes (6 each) in the frame before joint 4.

        They are linear in 1, cosine and sine of each of k angles, or in 1 and a slide; these are the coefficients of
        the products, shape (3^k, 16 + 6 k).
        """
        joints = len(placements) - (not after)
        samples = [np.asarray(SLIDE_SAMPLES if pitch else SAMPLES, dtype=np.float64) for pitch in pitches]
        values = np.empty((*[3] * joints, 16 + 6 * joints))
        for index in np.ndindex(values.shape[:-1]):
            frame = np.eye(4) if after else placements[0]
            axes = []
            for joint, placement in enumerate(placements[0 if after else 1 :]):
                axes.append(frame)
                moved = moves_along_z(samples[joint][index[joint], None], pitches[joint])[0]
                frame = frame @ moved @ placement
            back = np.linalg.inv(frame)
            axes = axes if after else [back @ axis for axis in axes]
            lines = [
                (*pitch * axis[:3, 2], 0.0, 0.0, 0.0) if pitch else (*np.cross(axis[:3, 3], axis[:3, 2]), *axis[:3, 2])
                for axis, pitch in zip(axes, pitches, strict=True)
            ]
            values[index] = np.concatenate([back.ravel(), *lines])
        return _coefficients(values, [SLIDE_COEFFICIENTS if pitch else COEFFICIENTS for pitch in pitches])

    def _start(self, q: Floats) -> tuple[Floats, NDArray[Any]]:
        """The first frames (m, 3, 4), and exp(-i q); of a joint that slides, by how much it does [m]."""
        frame = np.empty((len(q), 3, 4))
        frame[:] = self.placements[0, :3]
        turns = np.exp(-1j * q)
        if self.slides.any():
            turns[:, self.slides] = (q * self.pitches)[:, self.slides]
        return frame, turns

    def _turned(self, frame: Floats, turns: NDArray[Any], joint: int) -> Floats:
        """The next joint's frames: x + i y of a frame turns by exp(-i q)."""
        if self.slides[joint]:
            frame[:, :, 3] += turns[:, joint, None].real * frame[:, :, 2]
        else:
            plane = frame.view(np.complex128)[:, :, 0]
            np.multiply(plane, turns[:, joint, None], out=plane)
        return (frame.reshape(-1, 4) @ self.placements[joint + 1]).reshape(-1, 3, 4)


def moves_along_z(values: Floats, pitch: float) -> Floats:
    """Motions (m, 4, 4) of a joint for values (m,): along z by the pitch in a step of 1 [m], about it if that is 0."""
    if not pitch:
        return turns_about_z(values)
    moves = np.tile(np.eye(4), (len(values), 1, 1))
    moves[:, 2, 3] = pitch * values
    return moves


def miss(reached: Floats, T: Floats) -> Floats:
    """Errors (m, 6) of poses: position [m], and sine of the angle times its axis [rad].

    For angles over pi/2 the second part is longer than 1.
    """
    E = T[:, :3, :3] @ reached[:, :, :3].transpose(0, 2, 1)
    flat = E.reshape(-1, 9)
    error = np.empty((len(E), 6))
    np.subtract(T[:, :3, 3], reached[:, :, 3], out=error[:, :3])
    np.subtract(flat[:, (7, 2, 3)], flat[:, (5, 6, 1)], out=error[:, 3:])
    error[:, 3:] *= 0.5
    turned = flat[:, ::4].sum(axis=1) < 1.0
    if turned.any():
        error[turned, 3:] += np.copysign(1.0, error[turned, 3:])
    return error


def missed_by(error: Floats) -> Floats:
    """The larger of position [m] and orientation [rad] error, shape (m,)."""
    return np.sqrt(np.maximum((error[:, :3] ** 2).sum(axis=1), (error[:, 3:] ** 2).sum(axis=1)))


def newton(chain: Chain, q: Floats, T: Floats, *, steps: int = STEPS) -> tuple[Floats, Floats]:
    """Run Newton's method from postures (m, 6) to poses (m, 4, 4) or (4, 4); return postures and their errors (m,)."""
    return _by_newton(chain, q, T, steps, damped=False)


def nearest_by_newton(chain: Chain, q: Floats, T: Floats) -> tuple[Floats, Floats]:
    """Run damped Newton's method, for bad starts and singular arms; return each run's best posture."""
    return _by_newton(chain, q, T, MAX_STEPS, damped=True)


def _by_newton(chain: Chain, q: Floats, T: Floats, steps: int, *, damped: bool) -> tuple[Floats, Floats]:
    found, off, T = np.array(q, order="C"), np.empty(len(q)), _contiguous(np.broadcast_to(T, (len(q), 4, 4)))
    lib.kr_newton_of_each(doubles(chain.rows), doubles(T), len(q), steps, damped, doubles(found), doubles(off))
    return found, off


class General6R:
    """Every posture of a six-joint arm for a pose.

    Attributes:
        arm: What the core has prepared.
    """

    def __init__(self, chain: Chain) -> None:
        self.chain = chain
        self.arm = Struct("kr_elimination")
        lib.kr_elimination_prepare(doubles(chain.rows), self.arm.pointer)

    def solve(self, T: Floats, *, tol: float = EXACT) -> list[Floats]:
        """Compute all postures for each of many poses (count, 4, 4): shape (k, 6), angles in [-pi, pi].

        If no posture reaches a pose exactly, those with an error of at most `tol` [m, rad] are returned.
        """
        q, counts = self.postures(T, tol=tol)
        return [found[:count] for found, count in zip(q, counts.tolist(), strict=True)]

    def postures(self, T: Floats, *, tol: float = EXACT) -> tuple[Floats, NDArray[np.int32]]:
        """As `solve`: postures (count, 16, 6), NaN where there is none, and how many each pose has (count,)."""
        q, counts, T = np.full((len(T), MAX_POSTURES, _JOINTS), np.nan), np.empty(len(T), np.int32), _contiguous(T)
        lib.kr_elimination_postures(self.arm.pointer, doubles(T), len(T), tol, doubles(q), ints(counts), ffi.NULL)
        return q, counts

    def tried(self, q: Floats) -> float:
        """Solve for the poses of postures (m, 6), and record the spurious eigenvalues of this arm.

        If two axes can become parallel for any angles of the others, the same eigenvalues occur for every pose and lead
        to no posture. `solve` ignores them unless Newton's method converges from them. If some of the postures are not
        found from the eigenvalues, `solve` also takes those of other joints for every pose.

        Returns:
            Share of the postures that are found from the eigenvalues; 1, unless the arm's elimination is singular.
        """
        T = np.tile(np.eye(4), (len(q), 1, 1))
        T[:, :3] = self.chain.fk(q)
        start, pose = self._starts(T, MAX_CANDIDATE)
        found, off = newton(self.chain, start, T[pose])
        diverged = np.flatnonzero(~(off < EXACT))
        angles = start[diverged, 1]
        same = np.abs(wrapped(angles[:, None] - angles)) < DISTINCT_ANGLE
        recurring = np.array([len(np.unique(pose[diverged[row]])) for row in same]) > SPURIOUS_SHARE * len(q)
        spurious = angles[recurring][first_of_each(angles[recurring, None], DISTINCT_ANGLE)]
        back = (off < EXACT) & (joints_apart(found, q[pose]) < SAME)
        share = len(np.unique(pose[back])) / len(q)
        arm = self.arm.pointer
        arm.spurious_count, arm.singular = len(spurious), share < 1.0
        arm.spurious[0 : len(spurious)] = spurious.tolist()
        return share

    @property
    def spurious(self) -> int:
        """Number of eigenvalues that lead to no posture of any pose; known after `tried`."""
        return int(self.arm.pointer.spurious_count)

    @property
    def singular(self) -> bool:
        """Whether eigenvalues of one joint lead to a part of the postures only; known after `tried`."""
        return bool(self.arm.pointer.singular)

    def starts(self, T: Floats) -> tuple[Floats, NDArray[np.int64]]:
        """Compute starts of Newton's method (k, 6) for poses (m, 4, 4) from all eigenvalues, and the pose of each."""
        return self._starts(T, MAX_REDUNDANT_CANDIDATE)

    def _starts(self, T: Floats, most: float) -> tuple[Floats, NDArray[np.int64]]:
        """As `starts`, from eigenvalues with imaginary parts less than `most`."""
        room, T = MAX_POSTURES * len(T), _contiguous(T)
        q, imaginary, pose = np.empty((room, _JOINTS)), np.empty(room), np.empty(room, dtype=np.int64)
        count = lib.kr_elimination_starts(
            self.arm.pointer, doubles(T), len(T), most, doubles(q), doubles(imaginary),
            longs(pose),
        )  # fmt: skip
        return q[:count], pose[:count]


def _contiguous(T: Floats) -> Floats:
    return np.ascontiguousarray(T, dtype=np.float64)


def _coefficients(values: Floats, of_joints: Sequence[Floats]) -> Floats:
    """Coefficients of products of three functions of each of k joints (3^k, m), from sampled values (3, ..., 3, m)."""
    for joint, coefficients in enumerate(of_joints):
        values = np.moveaxis(np.asarray(np.tensordot(coefficients, values, (1, joint))), 0, joint)
    return np.ascontiguousarray(values).reshape(-1, values.shape[-1])


#: Pairs of postures that are compared at once.
MAX_PAIRS = 2**17


def first_of_each(q: Floats, distance: float) -> NDArray[np.bool_]:
    """Which of the postures (m, n) are not near an earlier one."""
    weights = np.sqrt(np.arange(2.0, 2.0 + 2 * q.shape[1]))
    reach, parts = distance * weights.sum() + 1e-12, np.hstack([np.cos(q), np.sin(q)])
    sums, others = parts @ weights, parts @ weights[::-1]  # those of near postures are near
    order = np.argsort(sums, kind="stable")
    sums, others = sums[order], others[order]
    following = np.searchsorted(sums, sums + reach, side="right") - np.arange(1, len(q) + 1)
    first = np.ones(len(q), dtype=np.bool_)
    blocks = np.searchsorted(np.cumsum(following), np.arange(MAX_PAIRS, following.sum(), MAX_PAIRS))
    for rows in np.split(np.arange(len(q)), blocks):
        counts = following[rows]
        begin = np.repeat(rows, counts)
        end = begin + 1 + np.arange(len(begin)) - np.repeat(np.cumsum(counts) - counts, counts)
        kept = np.abs(others[begin] - others[end]) <= reach
        one, other = order[begin[kept]], order[end[kept]]
        near = joints_apart(q[one], q[other]) < distance
        first[np.maximum(one, other)[near]] = False
    return first
