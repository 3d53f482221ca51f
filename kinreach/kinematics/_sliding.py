"""Kinematics of SCARAs and gantries, whose joints turn or slide, in closed form."""

from __future__ import annotations

import numpy as np

from kinreach._checks import Floats
from kinreach._rotations import turns_about_z, wrapped
from kinreach.errors import InputError
from kinreach.kinematics._by_geometry import NOWHERE, SINGULAR, ByGeometry, Found, elbow_bend, how_far

#: How far axes may be from parallel, by the sine of their angle, and slides from a plane, by their volume.
PARALLEL, FLAT = 1e-6, 1e-3


class SlidingKinematics(ByGeometry):
    """Kinematics of a SCARA, or of a gantry with a wrist. Threads may share an instance.

    A SCARA has three joints that turn about parallel axes, and one that slides along them, in any order. Its postures
    are two, by the side of its elbow. A gantry has three joints that slide, and on them up to three that turn. Its
    postures are two with three joints that turn, by the side of its wrist, else one. With fewer, and for a SCARA, a
    pose has postures only if its orientation is one that the arm can have.

    Postures miss their pose by less than 1e-9 m and rad. Where a pose is singular, a joint that is free keeps the
    seed's value, or is at 0. For a `PositionGoal` a SCARA's last joint that turns keeps the seed's value, of a gantry
    every joint that turns. For an `AxisGoal` a gantry with three of them tries turns about the direction in steps of
    3 degrees.

    Args:
        arm: Name of a registered arm, or a description.
        tip: Short name of the tip frame; default is the arm's own tool centre point.
        base: As in `ArmKinematics`.

    Raises:
        UnknownNameError: The arm, the tip or the base does not exist.
        InputError: The arm is neither.
    """

    unsolved = (
        "a gantry with fewer than three joints that turn has a closed form for poses and positions; give a PoseGoal, "
        "or use a numeric solver"
    )

    def _prepare(self) -> None:
        slides, self._still = self.slides, self.chain.fk(np.zeros((1, self.n)))[0]
        J = self.chain.jacobian(np.zeros((1, self.n)))[0]
        self._ways = J[:3]
        if len(self.moves) == self.n == 4 and slides.sum() == 1 and self._is_scara(J):
            self.branches, self._find = 2, self._scara_postures
        elif len(self.moves) == self.n <= 6 and slides[:3].all() and slides.sum() == 3:
            if abs(np.linalg.det(J[:3, :3])) < FLAT:
                raise InputError(f"arm {self.arm.name!r}: the three slides move it in a plane, or nearly")
            self._turns = self._wrist()
            self.branches, self._find = 1 + (self.n == 6), self._gantry_postures
        else:
            raise InputError(
                f"arm {self.arm.name!r}: of arms with slides, SCARAs have a closed form (three parallel axes "
                f"and a slide along them), and three slides with a wrist; with {self._sliding_names} held, others may"
            )

    @property
    def _sliding_names(self) -> str:
        return ", ".join(name for name, slides in zip(self.arm.joints, self.slides, strict=True) if slides)

    def _is_scara(self, J: Floats) -> bool:
        axes = np.where(self.slides, J[:3], J[3:]).T
        first = axes[0]
        if np.linalg.norm(np.cross(axes, first), axis=1).max() > PARALLEL:
            return False
        self._axis, self._sign = first, np.where(axes @ first > 0.0, 1.0, -1.0)
        across = np.linalg.svd(first[None])[2][1:]
        across = across if np.linalg.det(np.vstack([across, first])) > 0.0 else across[::-1]
        self._plane = across[0] + 1j * across[1]  # of a point, as a complex number
        turning = np.flatnonzero(~self.slides)
        # a joint moves the tip by axis x (tip - its own axis)
        radii = [self._sign[i] * 1j * -(self._plane @ self._ways[:, i]) for i in turning]
        tip = complex(self._plane @ self._still[:3, 3])
        shoulder, elbow, wrist = (tip - radius for radius in radii)
        self._last_turning = int(turning[2])
        self._shoulder, self._links = shoulder, (elbow - shoulder, wrist - elbow, tip - wrist)
        if min(map(abs, self._links[:2])) < NOWHERE:
            raise InputError(f"arm {self.arm.name!r}: two of its three axes are one")
        return True

    def _wrist(self) -> Floats:
        """Rotations B0 to Bm of the tip, R = B0 Rz(q4) B1 Rz(q5) ... Bm, shape (m + 1, 3, 3)."""
        A, found = self.chain.placements[:, :3, :3], [np.eye(3)]
        for joint, rotation in enumerate(A):
            found[-1] = found[-1] @ rotation
            if 3 <= joint < self.n:
                found.append(np.eye(3))
        return np.array(found)

    def _scara_postures(self, T: Floats, near: Floats, *, hold: bool = False) -> Found:
        """Postures of a pose; with `hold` of its point, and the last joint that turns keeps its value."""
        heading = self._heading(T)
        target = complex(self._plane @ T[:3, 3])
        turning = np.flatnonzero(~self.slides)
        upper, fore, hand = self._links
        held = float(self._sign[self._last_turning] * near[self._last_turning])
        if hold:
            fore, hand = fore + np.exp(1j * held) * hand, 0j
            if abs(fore) < NOWHERE:
                return Found([], [], [], f"with {self.arm.joints[self._last_turning]} there the tip is on another axis")
        way = target - self._shoulder - np.exp(1j * heading) * hand
        bend, *misses = elbow_bend(upper, fore, way)
        what, straight = how_far(*misses), bend in (0.0, np.pi)
        reason = f"the goal is {what} the axis of {self.arm.joints[turning[0]]}" if what else ""
        slide = int(np.flatnonzero(self.slides)[0])
        found = Found([], [], [], reason)
        for branch, angle in enumerate((bend,) if straight else (bend, -bend)):
            second = angle + float(np.angle(upper) - np.angle(fore))
            arm = upper + np.exp(1j * second) * fore
            free = abs(way) < NOWHERE
            first = self._sign[turning[0]] * near[turning[0]] if free else np.angle(way / arm)
            q = np.zeros(self.n)
            third = held if hold else heading - first - second
            q[turning] = self._sign[turning] * wrapped(np.array([first, second, third]))
            q[slide] = self._sign[slide] * (self._axis @ (T[:3, 3] - self._still[:3, 3]))
            found.branch.append(branch)
            found.flags.append(SINGULAR if free or straight else 0)
            found.q.append(q)
        return found

    def _gantry_postures(self, T: Floats, near: Floats) -> Found:
        B = self._turns
        G = B[0].T @ T[:3, :3] @ B[-1].T
        found = Found([], [], [])
        for branch, (angles, free) in enumerate(_wrist_angles(G, B[1:-1], near[3:])):
            q = np.concatenate([np.zeros(3), angles])
            beside = T[:3, 3] - self.chain.fk(q[None])[0, :3, 3]
            q[:3] = np.linalg.solve(self._ways[:, :3], beside)
            found.branch.append(branch)
            found.flags.append(SINGULAR if free else 0)
            found.q.append(q)
        return found


def _wrist_angles(G: Floats, B: Floats, near: Floats) -> list[tuple[Floats, bool]]:
    """Angles with which Rz(a) B[0] Rz(b) B[1] Rz(c) is a rotation, or as near as it gets, and whether one is free.

    Args:
        G: The rotation, shape (3, 3).
        B: Between the joints, shape (joints - 1, 3, 3).
        near: Values of joints that are free, shape (joints,).
    """
    if not len(near):
        return [(np.empty(0), False)]
    if len(near) == 1:
        return [(np.array([_about_z(G)]), False)]
    if len(near) == 2:
        middle, others = B[0], [(np.empty(0), np.eye(3))]
    else:
        u, v = B[0][2], B[1][:, 2]  # G's last entry is u Rz(b) v
        along, across = u[0] * v[0] + u[1] * v[1], u[1] * v[0] - u[0] * v[1]
        size = np.hypot(along, across)
        if size < NOWHERE:
            bends = [float(near[1])]
        else:
            bend = np.arccos(np.clip((G[2, 2] - u[2] * v[2]) / size, -1.0, 1.0))
            bends = [float(np.arctan2(across, along) + side) for side in ((bend, -bend) if bend % np.pi else (bend,))]
        middle = B[1]
        others = [(np.array([b]), B[0] @ _rz(b)) for b in bends]
    found = []
    for known, before in others:
        M = before @ middle  # what the first joint turns, whose z axis is to be G's
        free = min(np.hypot(*M[:2, 2]), np.hypot(*G[:2, 2])) < NOWHERE
        a = float(near[0]) if free else float(np.arctan2(G[1, 2], G[0, 2]) - np.arctan2(M[1, 2], M[0, 2]))
        c = _about_z((_rz(a) @ M).T @ G)
        found.append((wrapped(np.concatenate([[a], known, [c]])), free))
    return found


def _rz(angle: float) -> Floats:
    return turns_about_z(np.array([angle]))[0, :3, :3]


def _about_z(R: Floats) -> float:
    """The turn about z that is nearest to a rotation [rad]."""
    return float(np.arctan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1]))
