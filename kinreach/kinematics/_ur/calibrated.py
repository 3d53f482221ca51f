"""Calibrated UR arms: the arm with a closed form that is closest to one, and bounds of their difference.

The compiled core finds the postures (`_core/calibrated.c`), by Newton's method from those of the fitted arm where no
singular pose is close, and by elimination elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kinreach._checks import Floats
from kinreach.errors import InputError
from kinreach.kinematics._core import Struct
from kinreach.kinematics._general_6r import Chain, General6R, miss
from kinreach.kinematics._ur.geometry import Rows, URGeometry, core_arm, ur_placements
from kinreach.kinematics._ur.reach import Shortfall, shortfalls, way_into_reach
from kinreach.robots.inside import moved_frames

#: Random postures at which the fitted arm is compared with the real one, and Gauss-Newton steps of the fit.
SAMPLES, FIT_STEPS = 400, 5
#: The bounds are the largest differences of the samples times this, for maxima between samples and second order.
SAFETY_FACTOR = 1.5
#: An arm that differs more from the fitted one is not a UR [m, rad].
MAX_MISFIT = 0.1


@dataclass(frozen=True)
class Fit:
    """The arm with a closed form that is closest to a calibrated one: `T = before T_ur(q + zeros) after`.

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


class CalibratedChain:
    """A calibrated UR as a chain from its base to its flange, with the closed form that is fitted to it."""

    def __init__(self, placements: Floats, start: URGeometry) -> None:
        self.chain = Chain(placements)
        self.fit = fit(self.chain, start)
        self._left: Floats = np.asarray(np.linalg.inv(self.fit.before), dtype=np.float64)
        self._right: Floats = np.asarray(np.linalg.inv(self.fit.after), dtype=np.float64)

    @cached_property
    def general(self) -> General6R:
        """The solver that needs no branches."""
        return General6R(self.chain)

    def for_core(self, base: Floats, flange: Floats) -> Struct:
        """Return what the core needs, with the transforms (4, 4) from a pose's base and to its flange."""
        fitted = core_arm(self.fit.geometry, base=self._left, flange=self._right)
        centre, radius = self._centres()
        return Struct(
            "kr_calibrated", base=base[:3].ravel().tolist(), flange=flange[:3].ravel().tolist(),
            fitted=fitted.pointer[0], zeros=self.fit.zeros.tolist(), turned=self.fit.orientation, centre=centre,
            radius=radius, wrist=self._wrist(), elimination=self.general.arm.pointer[0],
        )  # fmt: skip

    def shortfalls(self, T: Floats) -> dict[int, Shortfall]:
        """`kinreach.kinematics._ur.reach.shortfalls` of the fitted arm for a pose (4, 4)."""
        return shortfalls(self._fitted_rows(T), self.fit.geometry)

    def way_into_reach(self, T: Floats) -> Floats:
        """`kinreach.kinematics._ur.reach.way_into_reach` of the fitted arm for a pose (4, 4), in its frame."""
        return self._left[:3, :3].T @ way_into_reach(self._fitted_rows(T), self.fit.geometry)

    def _fitted_rows(self, T: Floats) -> Rows:
        """A pose in the DH base of the fitted arm, and of its flange."""
        return (self._left @ T @ self._right)[:3].tolist()

    def _entries(self, T: Floats) -> Floats:
        """Entries of the flange's poses in the DH base of the fitted arm, shape (12, count)."""
        return np.ascontiguousarray((self._left @ T @ self._right)[:, :3].reshape(-1, 12).T)

    def _centres(self) -> tuple[float, float]:
        """Bounds of the distance between the arms' wrist centres, and between their distances from axis 1 [m]."""
        q = np.random.default_rng(2).uniform(-np.pi, np.pi, (10 * SAMPLES, 6))
        arms = (self.fit.chain.fk(q), self.chain.fk(q - self.fit.zeros))
        entries = np.array([self._entries(_poses(rows)).reshape(3, 4, -1) for rows in arms])
        centres = entries[:, :, 3] - self.fit.geometry.d6 * entries[:, :, 2]
        apart = np.linalg.norm(centres[1] - centres[0], axis=0).max()
        radii = np.hypot(centres[:, 0], centres[:, 1])
        return SAFETY_FACTOR * float(apart), SAFETY_FACTOR * float(np.abs(radii[1] - radii[0]).max())

    def _wrist(self) -> list[float]:
        """How the two arms' difference changes where the wrist is singular.

        Returns:
            Derivatives of orientation [rad/rad] and wrist centre [m/rad] by the angle by which q4 and q6 turn against
            each other with sin q5 = 0.
        """
        q = np.random.default_rng(1).uniform(-np.pi, np.pi, (SAMPLES, 6))

        def change(angle: float, along: Sequence[float]) -> Floats:
            q[:, 4] = angle
            twist = (self.chain.jacobian(q - self.fit.zeros)[1] - self.fit.chain.jacobian(q)[1]) @ along
            return np.array([np.linalg.norm(twist[:, :3], axis=1).max(), np.linalg.norm(twist[:, 3:], axis=1).max()])

        position, turn = SAFETY_FACTOR * np.maximum(change(0.0, (0, 0, 0, 1, 0, -1)), change(np.pi, (0, 0, 0, 1, 0, 1)))
        return [float(turn), float(position + self.fit.geometry.d6 * turn)]


def _chain(lengths: Floats, before: Floats, after: Floats) -> Chain:
    """The arm with a closed form and these lengths on a base, with its tip in the flange."""
    placements = ur_placements(lengths.tolist())
    placements[0], placements[-1] = before, placements[-1] @ after
    return Chain(placements)


def _moved(before: Floats, after: Floats, twists: Floats) -> tuple[Floats, Floats]:
    """Base and flange moved by small twists, in the chain's base and in the tip [m, rad], shape (12,)."""
    outside, flange = moved_frames(np.array([np.eye(4), after]), twists.reshape(2, 6))
    return outside @ before, flange


def _poses(rows: Floats) -> Floats:
    """Homogeneous transforms (m, 4, 4) from their upper rows (m, 3, 4)."""
    T = np.zeros((len(rows), 4, 4))
    T[:, :3], T[:, 3, 3] = rows, 1.0
    return T
