"""Actions that change the tip, in place of joints; the arm's closed form turns them into postures."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach._rotations import turns, vectors_of
from kinreach.envs._options import about
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics
from kinreach.kinematics.inside import determinant_sign
from kinreach.robots import ArmDescription

Flags = NDArray[np.bool_]

#: What actions change: joints, the tip's place, or its place and its direction.
JOINTS, POSITION, POSE = CONTROLS = ("joints", "position", "pose")
#: Numbers of the action, but for fingers.
SIZES = {POSITION: 3, POSE: 6}
#: Changes by an action of 1, of the place [m] and of the direction [rad]: where an action is a whole move, and where it
#: is a step of 0.04 s.
MOVE, SMALL_STEP = (0.05, math.radians(5.0)), (0.02, math.radians(2.0))
#: No joint turns further by one action [rad].
MAX_TURN = 0.5
#: How often the way is halved where its end is not for the arm.
HALVINGS = 6
#: Poses that are solved one after the other, whatever else is in the batch.
ALONE = 8


def shortened(changes: Floats) -> Floats:
    """Return changes, shape (..., n), shortened along the way until all are in [-1, 1]."""
    return np.asarray(changes / np.maximum(1.0, np.abs(changes).max(axis=-1, keepdims=True)))


def about_control(step: float, turn: float) -> dict[str, str | None]:
    """Metadata of the option, with the changes by an action of 1 [m], [rad]."""
    return about(
        f'what actions of several steps change: `"joints"`, the `"position"` of the tip (3 numbers, parts of '
        f"{100 * step:g} cm along the world's axes; its direction is held), or its "
        f'`"pose"` (3 more: a rotation vector in parts of {math.degrees(turn):g} degrees)',
        flag=None,
    )


class TipControl:
    """From changes of the tip to postures, in the branch in which the arm is.

    The tip goes straight from where it is. Where a posture at the end would be out of reach, outside the joint limits,
    past a singularity (the sign of the Jacobian's determinant would change), or more than `MAX_TURN` away in a joint,
    it goes as far as 6 halvings of the way find one: to within a 64th. With none of them the arm stays.

    Args:
        arm: With six joints and a closed form.
        control: `"position"` or `"pose"`.
        limits: Of the joints, lower and upper [rad], shape (n,) each.
        parts: Changes by an action of 1, of place [m] and direction [rad].
        alone: Solve each pose by itself, so that the last bits do not depend on how many there are.
    """

    def __init__(
        self,
        arm: ArmDescription,
        control: str,
        limits: tuple[Floats, Floats],
        parts: tuple[float, float],
        *,
        alone: bool,
    ) -> None:
        self.kinematics: Any = ArmKinematics.of(arm, base="world")
        if not (hasattr(self.kinematics, "nearest_batch") and self.kinematics.n == SIZES[POSE]):
            raise InputError(
                f'control="{control}" needs an arm of six joints with a closed form, such as a UR; arm {arm.name!r} '
                f'is another: use control="{JOINTS}"'
            )
        self.size, self._turns = SIZES[control], control == POSE
        self._limits, self._alone = limits, alone
        self._step, self._turn = parts

    def directions(self, q: Floats) -> Floats:
        """Return the rotations of the tips to the world, shape (k, 3, 3), of postures [rad], shape (k, n)."""
        R: Floats = self._poses(q)[:, :3, :3]
        return R

    def targets(self, q: Floats, actions: Floats, held: Floats) -> tuple[Floats, Floats]:
        """Return the postures that actions ask for.

        Args:
            q: Present postures [rad], shape (k, n).
            actions: In [-1, 1], shape (k, size).
            held: Rotations of the tips to the world that are held where actions do not turn them, shape (k, 3, 3).

        Returns:
            Postures [rad], shape (k, n), and the parts of the ways that lead there, from 0 to 1, shape (k,).
        """
        start, side = self._poses(q), self._side(q)
        found, share, left = q.copy(), np.zeros(len(q)), np.arange(len(q))
        for halving in range(HALVINGS + 1):
            part = share[left] + 0.5**halving
            postures = self._followed(self._on_way(start, actions, held, left, part), q[left], side[left])
            there = np.isfinite(postures[:, 0])
            found[left[there]], share[left[there]] = postures[there], part[there]
            left = left[share[left] < 1.0]
            if not len(left):
                break
        return found, share

    def action_for(self, q: Floats, target: Floats) -> Floats:
        """Return the actions from postures straight towards the tips' poses in others [rad], both of shape (k, n)."""
        now, then = self._poses(q), self._poses(target)
        change = (then[:, :3, 3] - now[:, :3, 3]) / self._step
        if self._turns:
            change = np.hstack([change, vectors_of(then[:, :3, :3] @ now[:, :3, :3].swapaxes(1, 2)) / self._turn])
        return shortened(change)

    def _on_way(self, start: Floats, actions: Floats, held: Floats, rows: Any, part: Floats) -> Floats:
        """Return poses at parts of the ways of some arms, shape (m, 4, 4)."""
        T = start[rows]
        change = part[:, None] * actions[rows]
        T[:, :3, 3] += self._step * change[:, :3]
        if self._turns:
            T[:, :3, :3] = turns(self._turn * change[:, 3:]) @ T[:, :3, :3]
        else:
            T[:, :3, :3] = held[rows]
        return T

    def _followed(self, T: Floats, q: Floats, side: Floats) -> Floats:
        """Return the postures at poses to which arms go on from postures `q`, (m, n); NaN where there is none."""
        nearest = np.concatenate([self.kinematics.nearest_batch(T[some], q[some]).q for some in self._parts(len(T))])
        good = self._goes_on(nearest, q, side)
        for row in np.flatnonzero(~good & np.isfinite(nearest[:, 0])):  # perhaps another one is of the arm's branch
            others = self.kinematics.all_solutions(T[row], seed=q[row]).q
            fit = self._goes_on(others, q[row], side[row])
            if fit.any():
                good[row], nearest[row] = True, others[fit.argmax()]
        return np.where(good[:, None], nearest, np.nan)

    def _poses(self, q: Floats) -> Floats:
        """Return poses of the tips in the world, shape (m, 4, 4)."""
        return self._each(q, self.kinematics.fk, self.kinematics.chain.fk)

    def _each(self, q: Floats, one: Callable[[Floats], Floats], many: Callable[[Floats], Floats]) -> Floats:
        """Return what a function says of postures: of one after the other if these are few, which takes less then."""
        return np.array([one(row) for row in q]) if self._alone or 0 < len(q) <= ALONE else many(q)

    def _parts(self, count: int) -> Iterator[slice]:
        size = ALONE if self._alone else count
        return (slice(first, first + size) for first in range(0, count, size))

    def _goes_on(self, postures: Floats, q: Floats, side: Any) -> Flags:
        """Return which postures (m, n) are near `q`, within the limits, and on the same side of singularities."""
        lower, upper = self._limits
        with np.errstate(invalid="ignore"):
            near = (np.abs(postures - q) <= MAX_TURN) & (postures >= lower) & (postures <= upper)
        good: Flags = np.all(near, axis=1)
        if good.any():
            good[good] = self._side(postures[good]) * np.broadcast_to(side, good.shape)[good] >= 0.0
        return good

    def _side(self, q: Floats) -> Floats:
        """Return the signs of the Jacobians' determinants, shape (m,); 0 where the arm is singular."""
        return determinant_sign(self._each(q, self.kinematics.jacobian, self.kinematics.chain.jacobian))
