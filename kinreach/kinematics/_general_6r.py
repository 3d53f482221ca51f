"""All postures of any arm with six revolute joints, by elimination and an eigenvalue problem.

The method is that of Raghavan and Roth (Inverse kinematics of the general 6R manipulator and related linkages, Journal
of Mechanical Design 115, 1993), with the eigenvalues of Manocha and Canny (Efficient inverse kinematics for general 6R
manipulators, IEEE Transactions on Robotics and Automation 10, 1994).

**Equations.** The line of joint 5's axis is computed from both ends of the closed chain, so the angle of joint 5 does
not occur. A line has the direction l and the point p; the fourteen functions p, l, p.p, p.l, p x l and
l (p.p) - 2 p (p.l) are linear in the cosine and sine of every angle. Joints 1 and 6 are eliminated linearly. Six
equations in the sines and cosines of joints 2, 3 and 4 remain. Multiplied by cos(q/2) and sin(q/2) of one of these
joints, they become twelve equations that are linear in twelve products, and their coefficients are linear in the cosine
and sine of another joint. This is a quadratic eigenvalue problem of size 24 in the tangent of half that joint's angle.
Its real eigenvalues include every posture; there are at most sixteen.

**Deflation.** Eight of the 24 eigenvalues are extraneous: i and -i, four times each. If joint 2 is the eigenvalue,
their vectors are the same for all poses: for large e^(iq) of that joint only the part of a line's functions that grows
with it counts, and at most four parts do, one of each vector p, l, p x l and l (p.p) - 2 p (p.l). One orthogonal
projection per arm reduces the problem to size 16.

**Conditioning.** Near the wrist singularity of an arm that is almost a UR, a matrix to invert is almost singular. This
is detected by the size of its inverse, and by eigenvalues that Newton's method has to correct by much. Such a pose is
solved again by the QZ algorithm, which needs no inverse.

With the axis of joint 5 the problem is regular for arms whose axes 2 to 4 are parallel or nearly so. With another axis
it is singular for a UR by its data sheet. It is also singular if the first and the last axis are parallel: the pose is
then tilted by `TILT`, which changes the eigenvalues by about as much (Hochstenbach, Mehl and Plestenjak, Solving
singular generalized eigenvalue problems by a rank-completing perturbation, SIAM Journal on Matrix Analysis and
Applications 40, 2019).

The eigenvalues give starting points for Newton's method on the arm itself. Only postures that reach the pose are
returned.
"""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.kinematics._angles import wrapped
from kinreach.robots._rotations import turns_about_z

#: Row of the pose (m,), eigenvalue (m,), its twelve products (m, 12), and the largest entry of each pose's matrix.
_Eigen = tuple[NDArray[np.int64], NDArray[Any], NDArray[Any], Floats]
#: A posture is a solution if its error is less [m, rad].
EXACT = 1e-10
#: Newton's method stops at an error below this [m, rad].
CONVERGED = 1e-13
#: Rotation of a pose whose last axis is closer to the first one's direction than this [rad].
TILT = 1e-5
#: Imaginary part up to which an eigenvalue is real.
MAX_REAL = 1e-11
#: Imaginary part from which an eigenvalue is complex.
MIN_COMPLEX = 1e-4
#: Imaginary part up to which an eigenvalue is a starting point: two postures merge there, or have just vanished.
MAX_CANDIDATE = 3e-2
#: The same for the starting points of an arm with one more joint, which may reach what this one misses by far.
MAX_REDUNDANT_CANDIDATE = 0.2
#: Largest correction of a well-conditioned eigenvalue by Newton's method [rad].
MAX_CORRECTION = 1e-4
#: A matrix with a larger entry is ill-conditioned.
MAX_ENTRY = 1e5
#: Added to a matrix before its inversion, so that a singular one has a large inverse.
REGULARISATION = 1e-14
_REGULAR = REGULARISATION * np.eye(6)
#: Eigenvalues whose angles differ by more are distinct [rad].
DISTINCT_ANGLE = 1e-4
#: Eigenvalues whose angles differ by less may be equal [rad].
CLUSTER_WIDTH = 0.05
#: Postures closer than this in every joint are the same [rad].
SAME = 1e-6
#: Postures closer than this in every joint are the same if the posture between them reaches the pose too [rad].
SAME_IF_CONNECTED = 2e-2
#: Newton's method has diverged if the error is larger after `2 * STEPS` steps [m, rad].
DIVERGED = 1e-3
#: Singular values below this are 0.
MIN_SINGULAR_VALUE = 1e-12
#: Starting points closer than this are the same, where Newton's method converges slowly [rad].
SAME_START = 1e-3
#: Steps of Newton's method from an eigenvalue, and near a singularity.
STEPS, MAX_STEPS = 6, 40
#: Longest step of a joint [rad].
MAX_JOINT_STEP = 0.3
#: An eigenvalue that occurs for this share of random poses is spurious.
SPURIOUS_SHARE = 0.9
#: Largest number of postures of a six-joint arm for a pose.
MAX_POSTURES = 16
#: Poses solved together.
BLOCK_SIZE = 512
#: Random starting points around solutions that may merge.
RESTARTS = 256
#: Smallest singular value of the Jacobian at a solution that may have others near it.
MERGING = 1e-3
#: Multiplicity of the extraneous eigenvalues i and -i, and the signs by which they multiply their vectors' coordinates.
EXTRANEOUS = 4
SIGNS = np.repeat([1.0, -1.0], EXTRANEOUS)
#: Three angles at which functions that are linear in cosine and sine are sampled [rad].
SAMPLES = 2 * np.pi / 3 * np.arange(3)
#: Coefficients of 1, cos and sin of a function that is linear in them, from its values at `SAMPLES`.
COEFFICIENTS = np.array([np.full(3, 1 / 3), 2 / 3 * np.cos(SAMPLES), 2 / 3 * np.sin(SAMPLES)])
#: Twist and trace of a small motion (4, 4), from its entries, shape (16, 7).
_TWIST = np.zeros((16, 7))
_TWIST[(3, 7, 11), (0, 1, 2)] = _TWIST[::5, 6][:3] = 1.0
_TWIST[(9, 2, 4), (3, 4, 5)], _TWIST[(6, 8, 1), (3, 4, 5)] = 0.5, -0.5
_IDENTITY = np.eye(4).ravel()
#: (cos q/2, sin q/2) times (1, cos q, sin q) in (cos 3q/2, sin 3q/2, cos q/2, sin q/2).
_HALF = np.array([
    [[0, 0, 1, 0], [0.5, 0, 0.5, 0], [0, 0.5, 0, 0.5]],
    [[0, 0, 0, 1], [0, 0.5, 0, -0.5], [-0.5, 0, 0.5, 0]],
])  # fmt: skip


class Chain:
    """Joints that each turn about their frame's z axis, `T = A0 Rz(q1) A1 Rz(q2) ... Rz(qn) An`.

    Args:
        placements: A0 to An, shape (n + 1, 4, 4); n is 6 or 7.
    """

    def __init__(self, placements: Floats) -> None:
        self.placements = placements
        self._joints = len(placements) - 1
        # largest distance of the tip from the origin of the frame before joint 4
        self._reach = float(np.linalg.norm(placements[4:, :3, 3], axis=1).sum())

    @cached_property
    def _halves(self) -> list[Floats]:
        """Coefficients of `_half` for joints 1 to 3, shape (27, 34), and for the others, (27, 34) or (81, 40)."""
        return [self._half(self.placements[:4], after=False), self._half(self.placements[4:], after=True)]

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

    def reaches(self, q: Floats, T: Floats, off: float) -> NDArray[np.bool_]:
        """Which postures (m, n) miss poses (m, 4, 4) or (1, 4, 4) by less than `off` [m, rad] for certain.

        Entries of a transform are compared: for a few postures that is faster than `fk` and `miss`.
        """
        first, last = self._products(q)
        before, after = (half[:, :16] for half in self._halves)
        reached = (first @ before).reshape(-1, 4, 4) @ T @ (last @ after).reshape(-1, 4, 4)
        difference = np.abs(reached.reshape(-1, 16) - _IDENTITY).max(axis=1)
        return np.asarray(difference < off / (2.0 + 2.0 * self._reach))

    def _products(self, q: Floats) -> tuple[Floats, Floats]:
        """Products of 1, cosine and sine of the angles (m, n) of joints 1 to 3 (m, 27), and of the others."""
        count = len(q)
        angles = np.empty((3, self._joints, count))
        angles[0] = 1.0
        np.cos(q.T, out=angles[1])
        np.sin(q.T, out=angles[2])
        products = (angles[:, None, None, 0:6:3] * angles[:, None, 1:6:3]) * angles[:, 2:6:3]
        first, last = products.reshape(27, 2, count).transpose(1, 2, 0)
        if self._joints == 7:
            last = (products[..., 1, None, :] * angles[:, 6]).reshape(81, count).T
        return first, last

    @staticmethod
    def _half(placements: Floats, *, after: bool) -> Floats:
        """Some joints' inverse motion (16 numbers) and their axes (6 each) in the frame before joint 4.

        They are linear in 1, cosine and sine of each of k angles; these are the coefficients of the products, shape
        (3^k, 16 + 6 k).
        """
        joints = len(placements) - (not after)
        values = np.empty((*[3] * joints, 16 + 6 * joints))
        for index in np.ndindex(values.shape[:-1]):
            frame = np.eye(4) if after else placements[0]
            axes = []
            for angle, placement in zip(SAMPLES[list(index)], placements[0 if after else 1 :], strict=True):
                axes.append(frame)
                frame = frame @ turns_about_z(angle[None])[0] @ placement
            back = np.linalg.inv(frame)
            axes = axes if after else [back @ axis for axis in axes]
            lines = [(*np.cross(axis[:3, 3], axis[:3, 2]), *axis[:3, 2]) for axis in axes]
            values[index] = np.concatenate([back.ravel(), *lines])
        return _coefficients(values)

    def _start(self, q: Floats) -> tuple[Floats, NDArray[Any]]:
        """The first frames (m, 3, 4), and exp(-i q)."""
        frame = np.empty((len(q), 3, 4))
        frame[:] = self.placements[0, :3]
        return frame, np.exp(-1j * q)

    def _turned(self, frame: Floats, turns: NDArray[Any], joint: int) -> Floats:
        """The next joint's frames: x + i y of a frame turns by exp(-i q)."""
        plane = frame.view(np.complex128)[:, :, 0]
        np.multiply(plane, turns[:, joint, None], out=plane)
        return (frame.reshape(-1, 4) @ self.placements[joint + 1]).reshape(-1, 3, 4)


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


def _solved(A: Floats, b: Floats) -> Floats:
    """Solutions of A x = b, shape (m, n, k); those of least squares if one A is singular."""
    try:
        return np.asarray(np.linalg.solve(A, b), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.linalg.pinv(A) @ b


def newton(chain: Chain, q: Floats, T: Floats, *, steps: int = STEPS) -> tuple[Floats, Floats]:
    """Run Newton's method from postures (m, 6) to poses (m, 4, 4); return postures and their errors (m,)."""
    results, off, rows = q.copy(), np.empty(len(q)), np.arange(len(q))
    for left in range(steps, -1, -1):
        error, J, missing = chain.step(q, T)
        results[rows], off[rows] = q, missing
        going = np.flatnonzero(missing >= CONVERGED)
        if not (left and len(going)):
            break
        if len(going) < len(rows):
            q, T, rows, J, error = q[going], T[going], rows[going], J[going], error[going]
        step = _solved(J + _REGULAR, error[:, :, None])[:, :, 0]
        longest = np.abs(step).max(axis=1)
        if longest.max() > MAX_JOINT_STEP:
            step *= np.minimum(1.0, MAX_JOINT_STEP / np.maximum(longest, MAX_JOINT_STEP))[:, None]
        q = q + step
    return results, off


def nearest_by_newton(chain: Chain, q: Floats, T: Floats) -> tuple[Floats, Floats]:
    """Run Newton's method with singular values, for bad starts and singular arms; return each run's best posture."""
    best, best_off, rows = q.copy(), np.full(len(q), np.inf), np.arange(len(q))
    for step in range(MAX_STEPS):
        error, J, off = chain.step(q, T)
        better = off < best_off[rows]
        best[rows[better]], best_off[rows[better]] = q[better], off[better]
        going = np.flatnonzero((off >= CONVERGED) & (best_off[rows] < (np.inf if step < 2 * STEPS else DIVERGED)))
        if not len(going):
            break
        q, T, rows, error = q[going], T[going], rows[going], error[going]
        U, s, V = np.linalg.svd(J[going])
        inverse = np.divide(1.0, s, out=np.zeros_like(s), where=s > MIN_SINGULAR_VALUE)
        way = (((error[:, None] @ U)[:, 0] * inverse)[:, None] @ V)[:, 0]
        q = q + way * np.minimum(1.0, MAX_JOINT_STEP / np.maximum(np.abs(way).max(axis=1), MAX_JOINT_STEP))[:, None]
    return best, best_off


class General6R:
    """Every posture of a six-joint arm for a pose."""

    #: Angles that are pi before the one with an infinite eigenvalue [rad]; arbitrary.
    PHASES = (0.7123, 2.0451)
    #: Which of joints 2, 3, 4 (0, 1, 2) is the eigenvalue, and which multiplies the equations.
    CHOICES = ((0, 1), (1, 0), (2, 1))

    def __init__(self, chain: Chain) -> None:
        self.chain = chain
        A = chain.placements
        turns = turns_about_z(SAMPLES)
        self._size = float(np.abs(A[1:, :3, 3]).max())
        # axis 5 in the frame before joint 2, through joints 2, 3 and 4
        near = turns[:, None, None] @ A[2] @ turns[:, None] @ A[3] @ turns @ A[4]
        values = self._functions(near[..., :3, 2], near[..., :3, 3])
        self._near = _coefficients(values).T.copy()
        # and through joints 1 and 6: (A0 R1 A1)^-1 T A6^-1 R6^-1 A5^-1
        self._left = np.linalg.inv(A[0] @ turns @ A[1])
        self._right = np.linalg.inv(A[5] @ turns @ A[6])[:, :, 2:]
        self._bases = [self._deflation(*self.CHOICES[0]), *[(np.eye(24), np.empty((24, 0)))] * 2]
        self._spurious: Floats = np.empty(0)
        self._both = np.kron(COEFFICIENTS, COEFFICIENTS)

    def solve(self, T: Floats, *, tol: float = EXACT) -> list[Floats]:
        """Compute all postures for each of many poses (count, 4, 4): shape (k, 6), angles in [-pi, pi].

        If no posture reaches a pose exactly, those with an error of at most `tol` [m, rad] are returned.
        """
        found: list[Floats] = []
        for start in range(0, len(T), BLOCK_SIZE):
            found += self._solve_some(T[start : start + BLOCK_SIZE], tol)
        return found

    def tried(self, q: Floats) -> float:
        """Solve for the poses of postures (m, 6), and record the spurious eigenvalues of this arm.

        If two axes can become parallel for any angles of the others, the same eigenvalues occur for every pose and lead
        to no posture. `solve` ignores them unless Newton's method converges from them.

        Returns:
            Share of the postures that are found again; 1, unless the arm's elimination is singular.
        """
        T = np.tile(np.eye(4), (len(q), 1, 1))
        T[:, :3] = self.chain.fk(q)
        try:
            pose, start, *_ = self._candidates(self._regular(T), *self.CHOICES[0], self.PHASES[0])
        except np.linalg.LinAlgError:
            return 0.0
        found, off = newton(self.chain, start, T[pose])
        diverged = np.flatnonzero(off >= EXACT)
        angles = start[diverged, 1]
        same = np.abs(wrapped(angles[:, None] - angles)) < DISTINCT_ANGLE
        recurring = np.array([len(np.unique(pose[diverged[row]])) for row in same]) > SPURIOUS_SHARE * len(q)
        self._spurious = angles[recurring][first_of_each(angles[recurring, None], DISTINCT_ANGLE)]
        back = (off < EXACT) & (np.abs(wrapped(found - q[pose])).max(axis=1) < SAME)
        return len(np.unique(pose[back])) / len(q)

    @property
    def spurious(self) -> int:
        """Number of eigenvalues that lead to no posture of any pose; known after `tried`."""
        return len(self._spurious)

    def starts(self, T: Floats) -> tuple[Floats, NDArray[np.int64]]:
        """Compute starts of Newton's method (k, 6) for poses (m, 4, 4) from all eigenvalues, and the pose of each."""
        regular = self._regular(T)
        pose, q, *_ = self._candidates(regular, *self.CHOICES[0], self.PHASES[0], most=MAX_REDUNDANT_CANDIDATE)
        return q, pose

    def _solve_some(self, T: Floats, tol: float) -> list[Floats]:
        regular = self._regular(T)
        pose, start, imaginary, largest = self._candidates(regular, *self.CHOICES[0], self.PHASES[0])
        likely = imaginary < MIN_COMPLEX
        q, off = start.copy(), np.full(len(start), np.inf)
        q[likely], off[likely] = newton(self.chain, start[likely], T[pose[likely]])
        spurious = (np.abs(wrapped(start[:, 1, None] - self._spurious)) < DISTINCT_ANGLE).any(axis=1) & (off >= EXACT)
        rest = ~spurious
        pose, start, imaginary, q, off = pose[rest], start[rest], imaginary[rest], wrapped(q[rest]), off[rest]
        moved, real = np.abs(wrapped(q[:, 1] - start[:, 1])), imaginary <= MAX_REAL
        clear = _clear(pose, len(T), wrapped(start[:, 1]), moved, imaginary, off < EXACT) & (largest < MAX_ENTRY)
        found = []
        for row, (begin, end) in enumerate(pairwise(np.searchsorted(pose, np.arange(len(T) + 1)).tolist())):
            part = slice(begin, end)
            if clear[row]:
                found.append(q[part][real[part]])
                continue
            if len(T) > 1:  # rounding differs between one and many; what it changes here must be the same for both
                found += self._solve_some(T[row : row + 1], tol)
                continue
            angles, complexity = start[part, 1], imaginary[part]
            kept, others = q[part][off[part] < EXACT], start[part][complexity >= MIN_COMPLEX]
            if largest[row] >= MAX_ENTRY or (moved[part][real[part]] > MAX_CORRECTION).any():
                _, again, complexity, _ = self._candidates(
                    regular[row, None], *self.CHOICES[0], self.PHASES[0], stable=True
                )
                angles, others = again[:, 1], np.vstack([others, again])
            more, miss_by = newton(self.chain, others, T[row, None].repeat(len(others), axis=0), steps=2 * STEPS)
            kept = np.vstack([kept, wrapped(more[miss_by < EXACT])])
            kept = self.distinct(kept, T[row])
            if not len(kept) or _in_doubt(len(kept), angles, complexity):
                kept = self._solve_near_singular(T[row], kept, tol)
            found.append(kept)
        return found

    def _solve_near_singular(self, T: Floats, known: Floats, tol: float) -> Floats:
        """All postures of one pose near a singularity: all choices of eigenvalue, and random restarts."""
        regular = self._regular(T[None])
        starts = [self._candidates(regular, *choice, phase)[1] for choice in self.CHOICES for phase in self.PHASES]
        seeds = np.vstack(starts)
        poses = np.broadcast_to(T, (len(seeds), 4, 4))
        q, off = newton(self.chain, seeds, poses, steps=2 * STEPS)
        late = np.flatnonzero(off >= EXACT)  # slow convergence, to double or nearly double postures
        late = late[first_of_each(seeds[late], SAME_START)]
        q[late], off[late] = nearest_by_newton(self.chain, seeds[late], poses[late])
        found = self.distinct(np.vstack([known, wrapped(q[off < EXACT])]), T)
        merging = found[np.linalg.svd(self.chain.jacobian(found)[1])[1][:, -1] < MERGING] if len(found) else found
        if len(merging):  # solutions that merge are close to each other
            rng = np.random.default_rng(0)
            away = rng.normal(size=(RESTARTS, 6)) * 10.0 ** rng.uniform(-4.0, -1.5, (RESTARTS, 1))
            around = merging[rng.integers(len(merging), size=RESTARTS)] + away
            q, off = newton(self.chain, around, np.broadcast_to(T, (RESTARTS, 4, 4)), steps=MAX_STEPS)
            found = self.distinct(np.vstack([found, wrapped(q[off < EXACT])]), T)[:MAX_POSTURES]
        elif not len(found) and (off <= tol).any():
            order = np.argsort(off)
            nearest = wrapped(q[order][off[order] <= tol])
            found = nearest[first_of_each(nearest, SAME_IF_CONNECTED)]
        return found

    def distinct(self, q: Floats, T: Floats) -> Floats:
        """Distinct postures of (m, 6): two are the same if they are close, or if the one between them reaches too."""
        q = q[first_of_each(q, SAME)]
        if len(q) < 2:
            return q
        away = wrapped(q[:, None] - q)
        near = (np.abs(away).max(axis=2) < SAME_IF_CONNECTED) & np.tri(len(q), k=-1, dtype=np.bool_)
        if not near.any():
            return q
        later, earlier = np.nonzero(near)
        middle = q[later] - 0.5 * away[later, earlier]
        tested = np.vstack([q, middle])
        off = missed_by(miss(self.chain.fk(tested), np.broadcast_to(T, (len(tested), 4, 4))))
        ends = np.maximum(off[later], off[earlier])
        return np.delete(q, later[off[len(q) :] < 4.0 * ends + 1e-13], axis=0)

    def _regular(self, T: Floats) -> Floats:
        """The poses, tilted where the last axis is parallel to the first."""
        A = self.chain.placements
        first = A[0][:3, 2]
        last = T[:, :3, :3] @ np.linalg.inv(A[6])[:3, 2]
        parallel = np.abs(np.cross(first, last)).max(axis=1) < TILT
        if not parallel.any():
            return T
        T = T.copy()
        c, s = np.cos(TILT), np.sin(TILT)
        across = A[0][:3, :3] @ ((1, 0, 0), (0, c, -s), (0, s, c)) @ A[0][:3, :3].T
        T[parallel, :3, :3] = across @ T[parallel, :3, :3]
        return T

    def _functions(self, direction: Floats, point: Floats) -> Floats:
        """The fourteen functions of lines (..., 3), shape (..., 14)."""
        p = point / self._size
        pp, pl = (p * p).sum(axis=-1, keepdims=True), (p * direction).sum(axis=-1, keepdims=True)
        return np.concatenate([p, direction, pp, pl, np.cross(p, direction), direction * pp - 2.0 * p * pl], axis=-1)

    def _candidates(
        self, T: Floats, unknown: int, factor: int, phase: float, *, stable: bool = False, most: float = MAX_CANDIDATE
    ) -> tuple[NDArray[np.int64], Floats, Floats, Floats]:
        """Compute starting points for Newton's method.

        Args:
            T: Poses, shape (count, 4, 4).
            unknown: Which joint is the eigenvalue.
            factor: Which joint multiplies the equations.
            phase: The eigenvalue is infinite at this angle plus pi [rad].
            stable: Use the QZ algorithm, which needs no inverse and takes twenty times as long.
            most: Imaginary part up to which an eigenvalue is a starting point.

        Returns:
            Rows of the poses, in order, (m,); for each a posture (m, 6) and its eigenvalue's imaginary part (m,); and
            the largest entry of each pose's matrix (count,), 0 with `stable`.
        """
        far = self._far(T)
        base, triangle = np.linalg.qr(far[:, :, 1:], mode="complete")
        B, C, S = np.moveaxis(self._problem(far, base, unknown, factor), 1, 0)
        c, s = np.cos(phase), np.sin(phase)
        C, S = c * C + s * S, c * S - s * C
        find = _by_qz if stable else self._by_inverse
        pose, value, products, largest = find(B, C, S, unknown, most)
        products = products.reshape(-1, 4, 3)
        # products are an outer product; the largest entries are the most accurate
        row = np.abs(products).sum(axis=2).argmax(axis=1)
        column = np.abs(products).sum(axis=1).argmax(axis=1)
        every = np.arange(len(pose))
        halves, whole = products[every, :, column], products[every, row]
        large = halves[every, 2 + np.abs(halves[:, 2:]).argmax(axis=1)]
        halves, whole = _scaled(halves, large), _scaled(whole, whole[:, 0])
        q = np.zeros((len(pose), 6))
        q[:, 1 + unknown] = phase + 2.0 * np.arctan(value.real)
        q[:, 1 + factor] = 2.0 * np.arctan2(halves[:, 3], halves[:, 2])
        q[:, 1 + 3 - unknown - factor] = np.arctan2(whole[:, 2], whole[:, 1])
        self._close(q, T[pose], far[pose], base[pose], triangle[pose])
        return pose, q, np.abs(value.imag) / (1.0 + np.abs(value) ** 2), largest

    def _by_inverse(self, B: Floats, C: Floats, S: Floats, unknown: int, most: float) -> _Eigen:
        """Eigenvalues x of (B - C) x^2 + 2 S x + B + C that may be real, by the companion matrix."""
        rest, known = self._bases[unknown]
        regular = B - C + REGULARISATION * np.eye(12)
        image = -_solved(regular, np.concatenate([B + C, 2.0 * S], axis=2) @ rest)
        values, vectors = np.linalg.eig(rest[:12].T @ rest[12:] + rest[12:].T @ image)
        pose, which = _nearly_real(values, most)
        value, vector = values[pose, which], vectors[pose, :, which]
        mixed = ((known[:12].T @ rest[12:] + known[12:].T @ image)[pose] @ vector[:, :, None])[:, :, 0]
        turned = np.roll(mixed, EXTRANEOUS, axis=1) * SIGNS[: known.shape[1]]
        mixed = (value[:, None] * mixed + turned) / (value[:, None] ** 2 + 1.0)
        return pose, value, vector @ rest[:12].T + mixed @ known[:12].T, np.abs(image).max(axis=(1, 2))

    def _deflation(self, unknown: int, factor: int) -> tuple[Floats, Floats]:
        """Orthonormal bases (24, 16) and (24, 8): the companion matrix maps the second to itself, by i and by -i."""
        third = 3 - unknown - factor
        ordered = self._near.reshape(14, 3, 3, 3).transpose(0, 1 + unknown, 1 + third, 1 + factor)
        growing = ordered[:, 1] + 1j * ordered[:, 2]
        products = (growing @ _HALF.transpose(1, 0, 2).reshape(3, 8)).reshape(14, 3, 2, 4)
        kernel = np.linalg.svd(products.transpose(2, 0, 3, 1).reshape(28, 12))[2][-EXTRANEOUS:].conj().T
        known = np.block([[kernel.real, kernel.imag], [-kernel.imag, kernel.real]])
        return np.linalg.qr(known, mode="complete")[0][:, 2 * EXTRANEOUS :], known

    def _far(self, T: Floats) -> Floats:
        """The functions of axis 5 through joints 1 and 6, a column for each of their nine products (count, 14, 9)."""
        lines = np.einsum("aij,nbjk->nabik", self._left, T[:, None] @ self._right)[..., :3, :]
        values = self._functions(lines[..., 0], lines[..., 1]).reshape(-1, 9, 14)
        return (self._both @ values).transpose(0, 2, 1)

    def _problem(self, far: Floats, base: Floats, unknown: int, factor: int) -> Floats:
        """Coefficients of 1, cosine and sine of the unknown joint, shape (count, 3, 12, 12)."""
        free = base[:, :, 8:].transpose(0, 2, 1)  # (count, 6, 14)
        equations = free @ self._near
        equations[:, :, 0] -= (free @ far[:, :, :1])[:, :, 0]
        third = 3 - unknown - factor
        ordered = equations.reshape(-1, 6, 3, 3, 3).transpose(0, 2 + unknown, 1, 2 + third, 2 + factor)
        products = ordered @ _HALF.transpose(1, 0, 2).reshape(3, 8)  # (count, unknown, equation, third, half x product)
        count = len(far)
        return products.reshape(count, 3, 6, 3, 2, 4).transpose(0, 1, 4, 2, 5, 3).reshape(count, 3, 12, 12)

    def _close(self, q: Floats, T: Floats, far: Floats, base: Floats, triangle: Floats) -> None:
        """Fill in joints 1 and 6 of postures (m, 6), by the equations that eliminate them, then joint 5."""
        A, count = self.chain.placements, len(q)
        angles = np.ones((count, 3, 3))
        angles[:, :, 1], angles[:, :, 2] = np.cos(q[:, 1:4]), np.sin(q[:, 1:4])
        products = np.einsum("ma,mb,mc->mabc", angles[:, 0], angles[:, 1], angles[:, 2]).reshape(count, 27)
        right = (products @ self._near.T)[:, :, None] - far[:, :, :1]
        found = _solved(triangle[:, :8], base[:, :, :8].transpose(0, 2, 1) @ right)[:, :, 0]
        q[:, 0], q[:, 5] = np.arctan2(found[:, 5], found[:, 2]), np.arctan2(found[:, 1], found[:, 0])
        frame = np.broadcast_to(A[0], (count, 4, 4))
        for joint in range(4):
            frame = frame @ turns_about_z(q[:, joint]) @ A[joint + 1]
        after = A[5] @ turns_about_z(q[:, 5]) @ A[6]
        turn = frame[:, :3, :3].transpose(0, 2, 1) @ T[:, :3, :3] @ after[:, :3, :3].transpose(0, 2, 1)
        q[:, 4] = np.arctan2(turn[:, 1, 0] - turn[:, 0, 1], turn[:, 0, 0] + turn[:, 1, 1])


def _by_qz(B: Floats, C: Floats, S: Floats, _: int, most: float) -> _Eigen:
    """As `General6R._by_inverse`, by the QZ algorithm, for each pose alone."""
    from scipy.linalg import eig  # rarely needed, and slow to import

    count = len(B)
    values, vectors = np.empty((count, 24), np.complex128), np.empty((count, 12, 24), np.complex128)
    left, right = np.zeros((24, 24)), np.eye(24)
    left[:12, 12:] = np.eye(12)
    for row in range(count):
        left[12:] = -np.hstack([B[row] + C[row], 2.0 * S[row]])
        right[12:, 12:] = B[row] - C[row]
        values[row], pair = eig(left, right)
        vectors[row] = pair[:12]
    pose, which = _nearly_real(values, most)
    return pose, values[pose, which], vectors[pose, :, which], np.zeros(count)


def _nearly_real(values: NDArray[Any], most: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns of the eigenvalues (count, k) up to an imaginary part, one of each conjugate pair."""
    with np.errstate(invalid="ignore"):  # some may be infinite
        near = (np.abs(values.imag) < most * (1.0 + np.abs(values) ** 2)) & (values.imag >= 0.0)
    pose, which = np.nonzero(near)
    return pose, which


def _scaled(rows: NDArray[Any], by: NDArray[Any]) -> Floats:
    """Real parts of rows (m, k) over numbers (m,), except those that are 0."""
    return (rows / np.where(by == 0.0, 1.0, by)[:, None]).real


def _in_doubt(found: int, angles: Floats, imaginary: Floats) -> bool:
    """Whether the number of postures may differ from the number that was found.

    Postures appear and vanish in pairs, and each has a real eigenvalue. One of k equal eigenvalues is accurate to the
    k-th root of the rounding error only: it may belong to a posture although it is not real, if it is nearly real or
    in a cluster.
    """
    if found % 2 or found != np.count_nonzero(imaginary <= MAX_REAL):
        return True
    maybe = imaginary > MAX_REAL
    if not maybe.any():
        return False
    together = np.abs(wrapped(angles[maybe, None] - angles)) < CLUSTER_WIDTH
    return bool((imaginary[maybe] < MIN_COMPLEX).any() or (np.count_nonzero(together, axis=1) > 2).any())


def _clear(
    pose: NDArray[np.int64], count: int, angles: Floats, moved: Floats, imaginary: Floats, good: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Which poses are solved: every real eigenvalue is distinct and leads to a posture, and no other may.

    A stricter `_in_doubt` for many poses at once.

    Args:
        pose: Row of the pose of each eigenvalue, in order, shape (m,).
        count: Number of poses.
        angles: Of the eigenvalues [rad], in [-pi, pi].
        moved: Their correction by Newton's method, absolute [rad].
        imaginary: Their imaginary parts.
        good: Which led to a posture.
    """
    order = np.lexsort((angles, pose))
    ends = np.searchsorted(pose, np.arange(count + 1))
    filled = np.flatnonzero(np.diff(ends))
    first, last = ends[filled], ends[filled + 1] - 1
    ahead = np.diff(angles[order], append=0.0)  # to the next one's
    ahead[last] = angles[order][first] + 2 * np.pi - angles[order][last]
    behind = np.roll(ahead, 1)
    behind[first] = ahead[last]
    gap = np.empty(len(pose))
    gap[order] = np.minimum(ahead, behind)
    real = imaginary <= MAX_REAL
    fine = np.where(
        real,
        good & (gap > DISTINCT_ANGLE) & (moved < np.minimum(MAX_CORRECTION, 0.25 * gap)),
        (imaginary >= MIN_COMPLEX) & (gap > CLUSTER_WIDTH),
    )
    number = np.bincount(pose, weights=real, minlength=count)
    return (np.bincount(pose, weights=~fine, minlength=count) == 0) & (number % 2 == 0) & (number > 0)


def _coefficients(values: Floats) -> Floats:
    """Coefficients of products of 1, cosine and sine of k angles (3^k, m), from values (3, ..., 3, m) at `SAMPLES`."""
    for joint in range(values.ndim - 1):
        values = np.moveaxis(np.tensordot(COEFFICIENTS, values, (1, joint)), 0, joint)
    return np.ascontiguousarray(values).reshape(-1, values.shape[-1])


def first_of_each(q: Floats, distance: float) -> NDArray[np.bool_]:
    """Which of the postures (m, n) are not near an earlier one."""
    weights = np.sqrt(np.arange(2.0, 2.0 + 2 * q.shape[1]))
    sums = np.hstack([np.cos(q), np.sin(q)]) @ weights  # those of near postures are near
    near = np.abs(sums[:, None] - sums) <= distance * weights.sum() + 1e-12
    later, earlier = np.nonzero(near & np.tri(len(q), k=-1, dtype=np.bool_))
    first = np.ones(len(q), dtype=np.bool_)
    first[later[np.abs(wrapped(q[later] - q[earlier])).max(axis=1, initial=0.0) < distance]] = False
    return first
