"""Inverse kinematics of calibrated UR arms: every posture, exactly.

A calibrated arm has no closed form: its axes are tilted by milliradians, so no two of them intersect or are parallel.

1. An arm with a closed form is fitted to it: lengths, zero angles, base and flange. Over all postures the two differ by
   a few tenths of a millimetre and a few milliradians. These bounds are kept.
2. Every posture of the calibrated arm is a posture of the fitted arm for a pose within the bounds. If no pose within
   the bounds is singular, each branch of the closed form has exactly one posture: the correction is a contraction, as
   its steps shrink by the ratio of the bounds to the distance from the singularity. Newton's method finds the posture
   from the closed form's.
3. If a pose within the bounds is singular (wrist centre near the shoulder's cylinder, sin q5 near 0, elbow nearly
   stretched or folded), branches may merge or vanish, and near sin q5 = 0 there may be more than eight postures. Two
   postures of a stretched elbow are all if both are found. In the other cases, and if Newton's method left its branch,
   `General6R` finds all postures without branches. Where it finds singular ones, or an odd number, Newton's method also
   starts from all postures of the fitted arm that are near (`NearlyDecoupled.near_singular`).

The branch index is that of the fitted arm's closed form at the same posture. It is continuous as long as no singularity
is crossed. Two postures near a singularity may have the same index: the one farther from the singularity keeps it, and
the others get indices from 8 on, in no particular order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.errors import InputError
from kinreach.kinematics._angles import wrapped
from kinreach.kinematics._general_6r import (
    EXACT,
    MAX_POSTURES,
    Chain,
    General6R,
    miss,
    nearest_by_newton,
)
from kinreach.kinematics._near_closed_form import NearClosedForm
from kinreach.kinematics._six_axis.closed_form import ZERO, DecoupledArm
from kinreach.kinematics._six_axis.dh import DenavitHartenberg
from kinreach.kinematics._six_axis.methods import CAUTION, NearlyDecoupled
from kinreach.kinematics._six_axis.near_misses import reached_beside
from kinreach.kinematics._solutions import ANGLES, BRANCH, FLAGS
from kinreach.kinematics._ur.batch import flange_entries, solve_poses
from kinreach.kinematics._ur.closed_form import solve_pose
from kinreach.kinematics._ur.geometry import BRANCHES, Miss, Rows, URGeometry
from kinreach.kinematics._ur.reach import Shortfall, shortfalls, way_into_reach
from kinreach.kinematics._ur.refine import Refinement
from kinreach.robots._identification import moved_frames
from kinreach.robots._rotations import turns_about_z

#: Random postures at which the fitted arm is compared with the real one, and Gauss-Newton steps of the fit.
SAMPLES, FIT_STEPS = 400, 5
#: The bounds are the largest differences of the samples times this, for maxima between samples and second order.
SAFETY_FACTOR = 1.5
#: Branches are distinct if sin q5 is larger than this multiple of the difference's derivative by the free angle.
WRIST_MARGIN = 3.0
#: An arm that differs more from the fitted one is not a UR [m, rad].
MAX_MISFIT = 0.1
#: Elimination may miss postures where one has a smaller singular value of its Jacobian and is near two singularities by
#: this (sines, and the wrist centre's distance from axis 1 in arm's lengths); or a singular value as good as 0.
HARD, TWICE, EXACTLY_SINGULAR = 1e-3, 0.05, 1e-6
#: Largest correction of q4 and q6 for a pose out of reach that is valid to first order [rad].
MAX_CORRECTION = 0.3


@dataclass(frozen=True)
class Fit:
    """The arm with a closed form that is closest to a calibrated one: `T = before ur_fk(q + zeros) after`.

    Attributes:
        geometry: Its lengths [m].
        zeros: Offsets of the joint angles [rad], shape (6,).
        before: Base of the fitted arm in that of the chain (4, 4).
        after: Tip of the chain in the flange of the fitted arm (4, 4).
        chain: The fitted arm, for `q + zeros`.
        position: Bound of the distance between the two arms' tips at the same posture [m].
        orientation: Bound of the angle [rad].
    """

    geometry: URGeometry
    zeros: Floats
    before: Floats
    after: Floats
    chain: Chain
    position: float
    orientation: float


def fit(chain: Chain, start: URGeometry) -> Fit:
    """Fit lengths, zeros, base and flange of an arm with a closed form to a chain, by least squares.

    Raises:
        InputError: The arm differs from every UR by more than `MAX_MISFIT`.
    """
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (SAMPLES, 6))
    T = _poses(chain.fk(q))
    x = np.array([start.d1, start.a2, start.a3, start.d4, start.d5, start.d6])
    zeros: Floats = np.zeros(6)
    before, after = np.eye(4), np.eye(4)
    for _ in range(FIT_STEPS):
        error = miss(_chain(x, before, after).fk(q + zeros), T).ravel()
        columns = []
        for index in range(24):
            nudge = np.zeros(24)
            nudge[index] = 1e-6
            trial = _chain(x + nudge[:6], *_moved(before, after, nudge[12:]))
            moved = miss(trial.fk(q + zeros + nudge[6:12]), T)
            columns.append((error - moved.ravel()) / 1e-6)
        step = np.asarray(np.linalg.lstsq(np.column_stack(columns), error, rcond=1e-9)[0], dtype=np.float64)
        x, zeros = x + step[:6], zeros + step[6:12]
        before, after = _moved(before, after, step[12:])
    error = miss(_chain(x, before, after).fk(q + zeros), T)
    position = SAFETY_FACTOR * float(np.linalg.norm(error[:, :3], axis=1).max())
    orientation = SAFETY_FACTOR * float(np.linalg.norm(error[:, 3:], axis=1).max())
    if not max(position, orientation) < MAX_MISFIT:
        raise InputError("the arm is not a UR, not even one out of adjustment")
    return Fit(URGeometry(*x.tolist()), zeros, before, after, _chain(x, before, after), position, orientation)


class CalibratedSolver(NearClosedForm):
    """Every posture of a calibrated UR, of its flange in the chain's base."""

    def __init__(self, placements: Floats, start: URGeometry) -> None:
        super().__init__(placements)
        self.fit = fit(self.chain, start)
        self._refinement = Refinement(placements)
        self._left: Floats = np.asarray(np.linalg.inv(self.fit.before), dtype=np.float64)
        self._right: Floats = np.asarray(np.linalg.inv(self.fit.after), dtype=np.float64)
        self._centre, self._radius = self._centres()
        self._wrist, self._elbow = self._changes()

    @cached_property
    def general(self) -> General6R:
        """The solver that needs no branches."""
        return General6R(self.chain)

    def _start(self, T: Floats, seed: Floats) -> tuple[list[int], Floats, bool]:
        rows = self._fitted_rows(T)
        found, _ = solve_pose(rows, self.fit.geometry, tol=EXACT)
        branches = [row[BRANCH] for row in found]
        doubtful = any(row[FLAGS] for row in found) or self._one_near_singular(rows, T, branches)
        return branches, np.array([row[ANGLES] for row in found]).reshape(-1, 6) - self.fit.zeros, doubtful

    def _starts(self, T: Floats) -> tuple[Floats, NDArray[np.bool_], NDArray[np.bool_]]:
        q, valid, doubtful, _ = solve_poses(T, self._left, self._right, self.fit.geometry, tol=EXACT)
        q -= self.fit.zeros[:, None, None]
        return q, valid, doubtful | self._near_singular(T, valid)

    def _refined(self, q: Floats, row: NDArray[np.int64], T: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        return self._refinement.near(q, row, self._refinement.wanted(T))

    def _stays(self, found: Floats, start: Floats, branch: Sequence[int] | NDArray[np.int64]) -> NDArray[np.bool_]:
        return self._index(found)[0] == branch

    def _every(self, T: Floats, seeds: Floats, tol: float) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64]]:
        lists = self.general.solve(T)
        for which, found in enumerate(lists):
            if self._is_hard(found):
                more = self._hard(T[which], seeds[which], found, tol)
                lists[which] = more if len(more) else self.general.solve(T[which, None], tol=tol)[0]
        postures, pose = np.vstack(lists), np.repeat(np.arange(len(T)), [len(found) for found in lists])
        index = self._index(postures.T)[0]
        counts = np.bincount(MAX_POSTURES * pose + index, minlength=MAX_POSTURES * len(T))
        for which in np.flatnonzero(counts.reshape(-1, MAX_POSTURES).max(axis=1) > 1):
            index[pose == which] = self.branches_of(lists[which])
        return postures, pose, index

    def _is_hard(self, found: Floats) -> bool:
        """Whether a pose with these postures (k, 6) may have more.

        They come and go in pairs, and elimination is ill-conditioned near two singularities at once.
        """
        if len(found) % 2 or not len(found):
            return True
        least = np.linalg.svd(self.chain.jacobian(found)[1], compute_uv=False)[:, -1]
        margins = np.sort(np.abs(self._sides(found.T)) / ((self.fit.geometry.stretched,), (1.0,), (1.0,)), axis=0)
        return bool(((least < HARD) & (margins[1] < TWICE)).any() or least.min() < EXACTLY_SINGULAR)

    def _hard(self, T: Floats, seed: Floats, found: Floats, tol: float) -> Floats:
        """All postures (k, 6) of a pose of which elimination has found some; arguments are those of `one`."""
        every, _ = self._nearly.near_singular(T, seed, tol, found)
        starts = reached_beside(self.chain, T, every)
        more, off = nearest_by_newton(self.chain, starts, np.broadcast_to(T, (len(starts), 4, 4)))
        every = self.general.distinct(np.vstack([found, every, wrapped(more[off < EXACT])]), T)
        return every[:MAX_POSTURES]

    @cached_property
    def _nearly(self) -> NearlyDecoupled:
        """The arm as one that almost decouples."""
        fitted = self.fit.chain.placements.copy()
        fitted[:-1] = fitted[:-1] @ turns_about_z(self.fit.zeros)
        dh = DenavitHartenberg.of(fitted, length=0.0, angle=ZERO)
        off = max(self.fit.position, self.fit.orientation)
        return NearlyDecoupled(DecoupledArm(dh), self.chain.placements, off / CAUTION)

    def _one_near_singular(self, rows: Rows, T: Floats, branches: Sequence[int]) -> bool:
        """As `_near_singular`, for one pose and the branches that it has."""
        g, turned, centre = self.fit.geometry, self.fit.orientation, self._centre
        (nx, ox, ax, px), (ny, oy, ay, py), (_, _, az, pz) = rows
        x, y, z = px - g.d6 * ax, py - g.d6 * ay, pz - g.d6 * az - g.d1
        r2 = x * x + y * y
        r = sqrt(r2)
        if r <= g.d4:
            return r >= g.d4 - self._radius
        side = sqrt(r2 - g.d4 * g.d4)
        pan = centre / side
        for first, m in ((0, side / r2), (4, -side / r2)):
            s1, c1 = x * g.d4 / r2 + y * m, x * m - y * g.d4 / r2
            s5 = hypot(nx * s1 - ny * c1, oy * c1 - ox * s1)
            if s5 <= 2.0 * turned + WRIST_MARGIN * (self._wrist[0] + self._wrist[1] / side):
                return True
            reach = centre * (1.0 + r / side) + 2.0 * g.d5 * (turned + pan) / s5
            u, k = -x * c1 - y * s1, g.d5 / s5
            for branch, flip in ((first, k), (first + 2, -k)):
                if branch not in branches or branch + 1 not in branches:
                    rho = hypot(u - flip * az, flip * (ax * c1 + ay * s1) - z)
                    if g.folded - reach < rho < g.stretched + reach and (
                        turned + pan > MAX_CORRECTION * s5 or self._may_be_reached(T[None], branch)[0]
                    ):
                        return True
        return False

    def why_empty(self, T: Floats) -> int:
        """`Miss` flags of the fitted arm for a pose (4, 4) that the calibrated one does not reach."""
        found, flags = solve_pose(self._fitted_rows(T), self.fit.geometry)
        return int(Miss.CALIBRATION) if found else flags

    def shortfalls(self, T: Floats) -> dict[int, Shortfall]:
        """`kinreach.kinematics._ur.reach.shortfalls` of the fitted arm for a pose (4, 4)."""
        return shortfalls(self._fitted_rows(T), self.fit.geometry)

    def way_into_reach(self, T: Floats) -> Floats:
        """`kinreach.kinematics._ur.reach.way_into_reach` of the fitted arm for a pose (4, 4), in its frame."""
        return self._left[:3, :3].T @ way_into_reach(self._fitted_rows(T), self.fit.geometry)

    def _fitted_rows(self, T: Floats) -> Rows:
        """A pose in the DH base of the fitted arm, and of its flange."""
        return (self._left @ T @ self._right)[:3].tolist()

    def branches_of(self, q: Floats) -> list[int]:
        """Return the index of each posture (k, 6) of one pose, all different."""
        index, margin = self._index(q.T)
        taken: dict[int, int] = {}
        for which in np.argsort(-margin):
            taken.setdefault(int(index[which]), int(which))
        mine = {which: branch for branch, which in taken.items()}
        spare = iter([*range(BRANCHES, MAX_POSTURES), *(set(range(BRANCHES)) - set(taken))])
        return [mine[which] if which in mine else next(spare) for which in range(len(q))]

    def _index(self, q: Floats) -> tuple[NDArray[np.int64], Floats]:
        """Branch of postures (6, m) of the fitted arm, and how far each is from the nearest singularity."""
        shoulder, wrist, elbow = self._sides(q)
        index = 4 * (shoulder < 0.0) + 2 * (wrist < 0.0) + (elbow < 0.0)
        return index, np.minimum(np.abs(shoulder), np.minimum(np.abs(wrist), np.abs(elbow)))

    def _sides(self, q: Floats) -> tuple[Floats, Floats, Floats]:
        """Distance of the wrist centre from axis 1, in the arm's plane [m], and sines of q5 and q3, of postures (6, m).

        They are 0 where the fitted arm is singular.
        """
        g = self.fit.geometry
        _, q2, q3, q4, q5, _ = (wrapped(q) + self.fit.zeros[:, None]).astype(np.float32)
        return g.a2 * np.cos(q2) + g.a3 * np.cos(q2 + q3) + g.d5 * np.sin(q2 + q3 + q4), np.sin(q5), np.sin(q3)

    def _near_singular(self, T: Floats, valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Whether a pose within the fit's bounds is singular, except where both postures of the elbow are found.

        `valid` has the branches that the fitted arm has for the poses, shape (8, count).
        """
        g, turned = self.fit.geometry, self.fit.orientation
        near = np.zeros(len(T), dtype=np.bool_)
        entries = self._entries(T)
        with np.errstate(invalid="ignore", divide="ignore"):
            for branch in range(0, BRANCHES, 2):
                elbow = _ElbowCircle(entries, branch, g)
                pan = self._centre / elbow.side  # largest error of q1 [rad]
                near |= elbow.s5 <= 2.0 * turned + WRIST_MARGIN * (self._wrist[0] + self._wrist[1] / elbow.side)
                reach = self._centre * (1.0 + elbow.r / elbow.side) + 2.0 * g.d5 * (turned + pan) / elbow.s5
                border = (elbow.rho < g.stretched + reach) & (elbow.rho > g.folded - reach)
                missing = border & ~valid[branch : branch + 2].all(axis=0)
                near |= missing & (turned + pan > MAX_CORRECTION * elbow.s5)
                rows = np.flatnonzero(missing & ~near)
                if len(rows):
                    near[rows] = self._may_be_reached(T[rows], branch)
        return (near | (elbow.r <= g.d4)) & (elbow.r >= g.d4 - self._radius)

    def _may_be_reached(self, T: Floats, branch: int) -> NDArray[np.bool_]:
        """Whether one shoulder and wrist may reach poses (count, 4, 4) that are out of the fitted arm's reach.

        The poses are corrected by the difference of the two arms with the elbow stretched or folded. The remaining
        difference grows in proportion to the elbow's angle, and the reach shrinks with its square.
        """
        g, wanted = self.fit.geometry, T
        elbow = _ElbowCircle(self._entries(T), branch, g)
        for _ in range(2):
            q = elbow.clamped(g)
            T = _poses(self.fit.chain.fk(q)) @ np.linalg.inv(_poses(self.chain.fk(q - self.fit.zeros))) @ wanted
            elbow = _ElbowCircle(self._entries(T), branch, g)
        reached = np.zeros(len(T), dtype=np.bool_)
        with np.errstate(divide="ignore"):  # inside the shoulder's cylinder the bound is infinite
            for gap, (position, orientation, bend) in zip(
                (elbow.rho - g.stretched, g.folded - elbow.rho), self._elbow, strict=True
            ):
                slope = (position + g.d6 * orientation) * (1.0 + elbow.r / elbow.side + g.d5 / (elbow.side * elbow.s5))
                slope += g.d5 * orientation / elbow.s5
                reached |= gap > slope * slope * bend
        return ~reached

    def _entries(self, T: Floats) -> Floats:
        """Entries of the flange's poses in the DH base of the fitted arm, shape (12, count)."""
        return flange_entries(np.ascontiguousarray(T[:, :3].reshape(-1, 12).T), self._left, self._right)

    def _centres(self) -> tuple[float, float]:
        """Bounds of the distance between the arms' wrist centres, and between their distances from axis 1 [m]."""
        q = np.random.default_rng(2).uniform(-np.pi, np.pi, (10 * SAMPLES, 6))
        arms = (self.fit.chain.fk(q), self.chain.fk(q - self.fit.zeros))
        entries = np.array([self._entries(_poses(rows)).reshape(3, 4, -1) for rows in arms])
        centres = entries[:, :, 3] - self.fit.geometry.d6 * entries[:, :, 2]
        apart = np.linalg.norm(centres[1] - centres[0], axis=0).max()
        radii = np.hypot(centres[:, 0], centres[:, 1])
        return SAFETY_FACTOR * float(apart), SAFETY_FACTOR * float(np.abs(radii[1] - radii[0]).max())

    def _changes(self) -> tuple[tuple[float, float], list[tuple[float, float, float]]]:
        """Derivatives of the two arms' difference where the wrist, or the elbow, is singular.

        Returns:
            Of orientation [rad/rad] and wrist centre [m/rad] by the angle by which q4 and q6 turn against each other
            with sin q5 = 0; and for the stretched and the folded elbow of position and orientation by the elbow's
            angle, with the inverse of the reach's second derivative by it [1/m].
        """
        g = self.fit.geometry
        q = np.random.default_rng(1).uniform(-np.pi, np.pi, (SAMPLES, 6))

        def change(joint: int, angle: float, along: Sequence[float]) -> Floats:
            q[:, joint] = angle
            twist = (self.chain.jacobian(q - self.fit.zeros)[1] - self.fit.chain.jacobian(q)[1]) @ along
            return np.array([np.linalg.norm(twist[:, :3], axis=1).max(), np.linalg.norm(twist[:, 3:], axis=1).max()])

        wrist = np.maximum(change(4, 0.0, (0, 0, 0, 1, 0, -1)), change(4, np.pi, (0, 0, 0, 1, 0, 1)))
        past = []
        for angle, length in ((0.0, g.a2 + g.a3), (np.pi, g.a2 - g.a3)):
            lift = -np.cos(angle) * g.a3 / length  # keeps wrist_1 in its place, to first order
            position, orientation = SAFETY_FACTOR * change(2, angle, (0, lift, 1, -1 - lift, 0, 0))
            past.append((float(position), float(orientation), abs(length / (g.a2 * g.a3))))
        return (SAFETY_FACTOR * float(wrist[1]), SAFETY_FACTOR * float(wrist[0] + g.d6 * wrist[1])), past


class _ElbowCircle:
    """The elbow's triangle for one shoulder and one wrist of the fitted arm, for many poses.

    Attributes:
        r: Distance of the wrist centre from the first axis [m].
        side: Its component perpendicular to d4, 0 inside the cylinder of that radius [m].
        s5: Absolute sine of q5.
        rho: Distance between shoulder and wrist_1 [m].
    """

    def __init__(self, entries: Floats, branch: int, g: URGeometry) -> None:
        nx, ox, ax, px, ny, oy, ay, py, _, _, az, pz = entries
        x, y, z = px - g.d6 * ax, py - g.d6 * ay, pz - g.d6 * az - g.d1
        r2 = x * x + y * y
        self.r = np.sqrt(r2)
        self.side = np.sqrt(np.maximum(r2 - g.d4 * g.d4, 0.0))
        m, d = (self.side if branch < 4 else -self.side) / r2, g.d4 / r2
        self._flip = -1.0 if branch & 2 else 1.0
        self._s1, self._c1 = s1, c1 = x * d + y * m, x * m - y * d
        self._c6, self._s6, self._c5 = nx * s1 - ny * c1, oy * c1 - ox * s1, ax * s1 - ay * c1
        self.s5 = np.sqrt(self._c6 * self._c6 + self._s6 * self._s6)
        k = self._flip * g.d5 / self.s5
        self._s, self._c = k * az, k * (ax * c1 + ay * s1)
        self._u, self._v = -x * c1 - y * s1 - self._s, self._c - z
        self.rho = np.sqrt(self._u * self._u + self._v * self._v)

    def clamped(self, g: URGeometry) -> Floats:
        """Return the posture with the elbow stretched or folded, whichever is nearer [rad], shape (count, 6)."""
        folded = self.rho < 0.5 * (g.stretched + g.folded)
        q3 = np.where(folded, np.pi, 0.0)
        q2 = np.arctan2(self._v, self._u) - np.where(folded & (g.a2 > g.a3), np.pi, 0.0)
        q4 = np.arctan2(-self._s, -self._c) - q2 - q3
        q5 = self._flip * np.arctan2(self.s5, self._c5)
        q6 = np.arctan2(self._flip * self._s6, self._flip * self._c6)
        return np.column_stack([np.arctan2(self._s1, self._c1), q2, q3, q4, q5, q6])


def _chain(lengths: Floats, before: Floats, after: Floats) -> Chain:
    """The arm with a closed form, `before ur_fk(q) after` with `kinreach.kinematics._ur.geometry.ur_fk`."""
    d1, a2, a3, d4, d5, d6 = lengths.tolist()
    right = np.pi / 2
    steps = ((right, 0.0, d1), (0.0, a2, 0.0), (0.0, a3, 0.0), (right, 0.0, d4), (-right, 0.0, d5), (0.0, 0.0, d6))
    placements = [before]
    for alpha, a, d in steps:
        c, s = np.cos(alpha), np.sin(alpha)
        placements.append(np.array([[1, 0, 0, a], [0, c, -s, 0], [0, s, c, d], [0, 0, 0, 1]]))
    placements[-1] = placements[-1] @ after
    return Chain(np.array(placements))


def _moved(before: Floats, after: Floats, twists: Floats) -> tuple[Floats, Floats]:
    """Base and flange moved by small twists, in the chain's base and in the tip [m, rad], shape (12,)."""
    outside, flange = moved_frames(np.array([np.eye(4), after]), twists.reshape(2, 6))
    return outside @ before, flange


def _poses(rows: Floats) -> Floats:
    """Homogeneous transforms (m, 4, 4) from their upper rows (m, 3, 4)."""
    T = np.zeros((len(rows), 4, 4))
    T[:, :3], T[:, 3, 3] = rows, 1.0
    return T
