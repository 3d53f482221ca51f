"""Kinematics of the UR family: closed-form inverse for poses and tool directions, one or many."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import (
    Floats,
    as_pose,
    check_tolerance,
)
from kinreach._engines import load
from kinreach._rotations import joints_apart
from kinreach._tensors import like, on_host
from kinreach.errors import InputError
from kinreach.kinematics._arm import link_frame
from kinreach.kinematics._chain import about_z, poses_about, turns_and_own
from kinreach.kinematics._closed_form import TOLERANCE, TURNS_ABOUT, ClosedFormKinematics
from kinreach.kinematics._compiled import CompiledKinematics
from kinreach.kinematics._core import NULL, ROW, doubles, ffi, lib
from kinreach.kinematics._general_6r import MAX_POSTURES
from kinreach.kinematics._goals import (
    AxisGoal,
    rigid_pose,
    rigid_poses,
)
from kinreach.kinematics._solutions import (
    Accept,
    IKBatch,
    IKResult,
    IKSolutions,
    Status,
    nearest_windings,
)
from kinreach.kinematics._ur.batch import SHOULDER_LIFT, WRIST_1, WRIST_3, solve_poses
from kinreach.kinematics._ur.geometry import BRANCHES, Rows, URGeometry, core_arm, miss_text
from kinreach.kinematics._ur.reach import Shortfall, shortfalls, way_into_reach
from kinreach.robots import ArmDescription, Tool, get_arm
from kinreach.robots.inside import FLANGE, FLIP

pin: Any = load("pinocchio")

#: Random postures that a closed form is tried on; how far the poses of its arm may be off [m, rad]; and how far the
#: posture that it finds again [rad].
TRIALS, FIT_TOLERANCE, AGAIN = 64, 1e-8, 1e-5
#: Turns about the tool that are tried if all postures with the seed's wrist_3 are refused [rad].
TURNS = np.radians([45, -45, 90, -90, 135, -135, 180])
#: How far the flange may be from the last joint's axis for wrist_3 to turn about it [m, and sine of an angle].
AXIS_TOLERANCE = 1e-10
#: How far the tip may be from the flange's z axis [m], and its z axis from that one's direction [sine].
ALIGNED = 1e-10


class NotOfThisKind(InputError):
    """The arm does not have the geometry of a closed form."""


class URKinematics(CompiledKinematics):
    r"""Kinematics of a UR-type arm. Threads may share an instance.

    .. math::

        T_{\text{base}}^{\text{flange}}(q) = \prod_{i=1}^{6}
        R_z(q_i) \, D_z(d_i) \, D_x(a_i) \, R_x(\alpha_i), \qquad
        \alpha = (\tfrac{\pi}{2}, 0, 0, \tfrac{\pi}{2}, -\tfrac{\pi}{2}, 0)

    with rotations R and translations D, and the lengths d1, d4, d5, d6 and a2, a3 of the URDF, all others 0 (Hawkins,
    Analytic inverse kinematics for the UR-5/UR-10, 2013).

    Args:
        arm: Name of a UR, "ur3" to "ur30" or "ur5-thesis", or the description of a UR-type arm.
        tip: `"tool0"`, the flange, or another tip of the arm; None for the arm's own.
        base: `"base_link"`, `"base"` (the controller's), `"world"`, or a frame of your own (`ArmKinematics`).
        tool: A tool on the flange; its centre point is the tip. `[x, y, z, rx, ry, rz]` as on the pendant (metres,
            rotation vector in radians), a 4x4 transform, or a `kinreach.robots.Tool` with mass and shapes.

    Attributes:
        geometry: Denavit-Hartenberg lengths [m].

    Raises:
        UnknownNameError: Unknown arm, tip or base.
        InputError: The arm's geometry is not that of a UR.

    Note:
        The tip is the flange unless another one is named, as for the controller of a UR without a tool; that of
        `ArmKinematics.of` is the arm's own, `"tcp"` of `ur5-thesis`.

    Examples:
        >>> from kinreach.kinematics import URKinematics, pose
        >>> kin = URKinematics("ur5e", base="base")
        >>> T = pose([-0.4, 0.1, 0.3, 3.14, 0, 0])
        >>> solutions = kin.all_solutions(T)
        >>> len(solutions), bool(solutions.residual.max() < 1e-12)
        (8, True)
        >>> kin.nearest(T, [0, -1.5, 2, -2, -1.5, 0]).q.round(2).tolist()
        [-0.57, -1.7, 2.19, -2.06, -1.57, 1.0]
    """

    branches = BRANCHES
    unsolved = "a six-joint arm has no closed form for a bare position; give an AxisGoal or a PoseGoal"

    def __init__(
        self,
        arm: str | ArmDescription = "ur5",
        *,
        tip: str | None = FLANGE,
        base: str | ArrayLike = "base_link",
        tool: Tool | str | ArrayLike | None = None,
    ) -> None:
        super().__init__(arm, tip=tip, base=base, tool=tool)
        self.geometry, self._flange = self._lengths()
        T_flange_tip = self._flange.inverse() * self.model.frames[self.tip_frame].placement
        self._T_dh_base: Floats = FLIP @ np.linalg.inv(self.T_world_arm) @ self.T_world_base
        self._T_tip_flange: Floats = T_flange_tip.inverse().homogeneous
        self._reach = _reach_along_tool(T_flange_tip.homogeneous)
        self._check_fit()

    def _lengths(self) -> tuple[URGeometry, Any]:
        """Lengths by the joints' axes, and the flange in the last joint's frame (a pin.SE3).

        An arm without a tip `tool0` has its flange where the tip's perpendicular meets the last axis.
        """
        origins, directions, frame = [], [], np.linalg.inv(self.T_world_arm)
        for placement, axis in zip(*self._joint_frames(), strict=True):
            frame = frame @ placement
            origins.append(frame[:3, 3])
            directions.append(frame[:3, :3] @ axis)
        named = FLANGE in self.arm.tips
        link = link_frame(self.model, self.arm.tips[FLANGE]) if named else self.tip_frame
        flange = self.model.frames[link].placement
        end = frame[:3, :3] @ flange.translation + frame[:3, 3]
        geometry = URGeometry.from_axes(np.array(origins), np.array(directions), end)
        if not named:
            (T_dh_flange,) = geometry.chain.fk(np.zeros((1, self.n)))
            flange = pin.SE3(np.linalg.inv(FLIP @ frame) @ T_dh_flange)
        return geometry, flange

    @classmethod
    def from_calibration(
        cls,
        file: str | Path,
        *,
        model: str | ArmDescription = "ur5",
        tip: str | None = FLANGE,
        base: str | ArrayLike = "base_link",
        tool: Tool | str | ArrayLike | None = None,
        repair: bool = False,
    ) -> URKinematics:
        """Return the kinematics of a real arm with its factory calibration.

        Args:
            file: The ROS driver's `kinematics.yaml`, the controller's `calibration.conf`, or a calibrated URDF.
            model: Which UR it is, "ur3" to "ur30", or a description of one.
            tip: As for `URKinematics`.
            base: As for `URKinematics`.
            tool: As for `URKinematics`.
            repair: Correct what an old exporter folded (`kinreach.robots.read_calibration`).

        Returns:
            A `CalibratedURKinematics`; a `URKinematics` if the file has the figures of the data sheet.

        Raises:
            UnknownNameError: Unknown model, tip or base.
            InputError: The file is not a calibration of this model.
        """
        arm = get_arm(model).calibrated(file, repair=repair)
        try:
            return URKinematics(arm, tip=tip, base=base, tool=tool)
        except NotOfThisKind:
            return CalibratedURKinematics(arm, tip=tip, base=base, tool=tool)

    def branch_words(self, branch: int) -> tuple[str, ...]:
        """Return words for a branch by its index: shoulder, elbow and wrist; none for one from 8 on.

        The shoulder is the side of the first axis on which the upper arm passes, seen along the arm. The elbow is
        above or below the line from shoulder to wrist, while the arm does not reach over itself. A flipped wrist has a
        positive wrist_2.
        """
        if not 0 <= branch < BRANCHES:
            return ()
        right, straight, second = branch >> 2 & 1, branch >> 1 & 1, branch & 1
        elbow, wrist = "up" if right != second else "down", "straight" if straight else "flipped"
        return "right" if right else "left", elbow, wrist

    def all_solutions(
        self, T: ArrayLike, *, seed: ArrayLike | None = None, limits: bool = True, tol: float = TOLERANCE
    ) -> IKSolutions:
        """Compute every posture that brings the tip to a pose, singular cases included.

        Args:
            T: Pose of the tip in the base frame, shape (4, 4).
            seed: Posture [rad], shape (6,). With it, each solution is given in the winding nearest to it, they are
                sorted by distance from it, and wrist_3 keeps its value where it is free. Without it,
                they are in the order of the branch index, and a free wrist_3 stays near 0.
            limits: Leave out what the joint limits forbid.
            tol: Largest error of a solution in which something was clamped [m, rad], 1e-9 to 1.

        Returns:
            Up to eight solutions, or the reason why there is none.

        Raises:
            InputError: `T` is not a finite rigid motion, or the seed is malformed.
        """
        return self._every(T, seed, limits=limits, tol=tol)

    def _miss_text(self, T: Floats, miss: int) -> str:
        return miss_text(miss)

    def axis_solutions(
        self,
        position: ArrayLike,
        axis: ArrayLike,
        *,
        seed: ArrayLike | None = None,
        limits: bool = True,
        tol: float = TOLERANCE,
    ) -> IKSolutions:
        """Compute every posture with the tip at a point and its z axis along a direction; rotation about it is free.

        Args:
            position: In the base frame [m], shape (3,).
            axis: Direction of the tip's z axis in the base frame, shape (3,); need not be normalised.
            seed: As in `all_solutions`; wrist_3 takes its value (0 without a seed), or the limit nearest to that.
            limits: As in `all_solutions`.
            tol: As in `all_solutions`.

        Returns:
            Every posture, if wrist_3 turns the tip about its z axis. If not, as with a tool that is turned or beside
            that axis, those at 36 turns about the direction, 10 degrees apart, and with a seed at its own.

        Raises:
            InputError: Malformed input.
        """
        start = self._posture_or_none(seed)
        goal = AxisGoal(position, axis)  # type: ignore[arg-type]
        tol = check_tolerance(tol)
        if not self._wrist_3_turns_tip:
            return self._at_turns(goal, start, limits=limits, tol=tol)
        q6 = 0.0 if start is None else float(start[WRIST_3])
        if limits:  # wrist_3 is free, so what the limits ask of it costs no solution
            q6 = min(max(q6, self._low[WRIST_3]), self._high[WRIST_3])
        found, miss = self._axis_postures(goal, start, q6, tol)
        return self._solutions(found, miss_text(miss), goal, start, limits, tol)

    def _axis_postures(self, goal: AxisGoal, start: Floats | None, q6: float, tol: float) -> tuple[Floats, int]:
        """Rows of postures where wrist_3 turns the tip, and the parts that missed."""
        T = np.zeros((3, 4))
        T[:, 2] = self._T_dh_base[:3, :3] @ goal.axis
        T[:, 3] = self._T_dh_base[:3, :3] @ goal.position + self._T_dh_base[:3, 3]
        pitch = 0.0 if start is None else float(start[SHOULDER_LIFT : WRIST_1 + 1].sum())
        rows, miss = np.empty((BRANCHES, BRANCHES)), ffi.new("int *")
        count = lib.kr_ur_axis_postures(
            self._prepared.pointer, doubles(T), self._reach, pitch, q6, tol, doubles(rows), miss
        )  # fmt: skip
        return rows[:count], miss[0]

    @property
    def _wrist_3_turns_tip(self) -> bool:
        """Whether wrist_3 turns the tip about its own z axis."""
        return self._reach is not None

    def _at_turns(self, goal: AxisGoal, start: Floats | None, *, limits: bool, tol: float) -> IKSolutions:
        turns = TURNS_ABOUT if start is None else turns_and_own(TURNS_ABOUT, goal.axis, self.fk(start))
        turned = poses_about(goal.position, goal.axis, turns)
        found = np.concatenate([self.all_solutions(T, limits=False, tol=tol).rows for T in turned])
        unreached = "" if len(found) else "no posture reaches the point with any of 36 turns about the direction"
        return self._solutions(found, unreached, goal, start, limits, tol)

    def axis_goal(
        self, position: ArrayLike, axis: ArrayLike, seed: ArrayLike, *, accept: Accept | None = None
    ) -> IKResult:
        """Compute the posture nearest to a seed among `axis_solutions`.

        Args:
            position: In the base frame [m], shape (3,).
            axis: Direction of the tip's z axis in the base frame, shape (3,).
            seed: Posture [rad], shape (6,).
            accept: Called with candidates in the order of their distance until it returns True. If it refuses them all
                they are turned about the tip's z axis, if wrist_3 does that alone: by 45 degrees, and so on.

        Raises:
            InputError: As `axis_solutions`.
        """
        start = self.as_posture("seed", seed)
        result = self._choose(self.axis_solutions(position, axis, seed=start), start, accept)
        if result.status is not Status.REJECTED or not self._wrist_3_turns_tip:
            return result
        for turn in TURNS:
            wrist_3 = start[WRIST_3:]
            last, within = nearest_windings(wrist_3 + turn, wrist_3, self.lower[WRIST_3:], self.upper[WRIST_3:])
            if not within:
                continue
            turned = np.concatenate([start[:WRIST_3], last])
            other = self._choose(self.axis_solutions(position, axis, seed=turned), start, accept)
            if other.success:
                return other
        return result

    def shortfalls(self, T: ArrayLike) -> dict[int, Shortfall]:
        """Explain which part of the arm keeps each branch from a pose, and by how much.

        Args:
            T: Pose of the tip in the base frame, shape (4, 4).

        Returns:
            By branch index, for those that are out of reach.

        Raises:
            InputError: `T` is not a finite rigid motion.
        """
        return shortfalls(self._flange_rows(T), self.geometry)

    def nearest_in_reach(self, T: ArrayLike) -> Floats:
        """Compute the nearest pose with the same orientation that the arm reaches, whatever the joint limits.

        Args:
            T: Pose of the tip in the base frame, shape (4, 4).

        Returns:
            Shape (4, 4); `T` itself, within 1e-9 m, where it is in reach.

        Raises:
            InputError: `T` is not a finite rigid motion.
        """
        nearest = as_pose("T", T).copy()
        nearest[:3, 3] += self._T_dh_base[:3, :3].T @ way_into_reach(self._flange_rows(T), self.geometry)
        return nearest

    def _solve_axis(self, goal: AxisGoal, seed: ArrayLike, accept: Accept | None) -> IKResult:
        return self.axis_goal(goal.position, goal.axis, seed, accept=accept)

    def _tensor_batch(self, T: Any, tol: float, *, limits: bool) -> IKBatch:
        """`batch` for a tensor, on its device; poses near a singularity are solved by the core."""
        poses = T.detach().double()
        if poses.ndim != 3 or poses.shape[1:] != (4, 4):
            raise InputError(f"T must have shape (count, 4, 4), got {tuple(poses.shape)}")
        left, right, g = self._T_dh_base, self._T_tip_flange, self.geometry
        q, valid, singular, skewed = solve_poses(poses, left, right, g, tol=tol)
        if skewed.any() or (poses[:, 3] != like(poses, (0.0, 0.0, 0.0, 1.0))).any():
            poses = like(poses, rigid_poses(on_host(poses)))
            q, valid, singular, _ = solve_poses(poses, left, right, g, tol=tol)
        if len(rows := np.flatnonzero(on_host(singular))):
            exact = self.batch(on_host(poses[rows]), limits=limits, tol=tol)
            q[:, :, rows], valid[:, rows] = like(q, exact.q.swapaxes(0, 2)), like(valid, exact.valid.T)
        found = self._batch_within(poses, q, valid, tol, limits=limits)
        return IKBatch(like(T, found.q), found.valid)

    def _flange_rows(self, T: ArrayLike) -> Rows:
        """Pose of the flange in the DH base frame, from a checked pose of the tip in the base frame."""
        rigid = rigid_pose(T)
        rows: Rows = (self._T_dh_base @ rigid @ self._T_tip_flange)[:3].tolist()
        return rows

    def _check_fit(self) -> None:
        """The closed form describes this arm: poses of random postures agree, and it finds the postures again."""
        q = np.random.default_rng(0).uniform(-np.pi, np.pi, (TRIALS, self.n))
        T, flange = self.fk(q), self.geometry.chain.fk(q)
        apart = T - np.linalg.inv(self._T_dh_base) @ flange @ np.linalg.inv(self._T_tip_flange)
        angles = np.linalg.norm(apart[:, :3, :3], axis=(1, 2)) / np.sqrt(2.0)
        off = float(np.maximum(np.linalg.norm(apart[:, :3, 3], axis=1), angles).max())
        if off <= FIT_TOLERANCE:
            self._way = lib.KR_UR
            self._prepared = core_arm(self.geometry, base=self._T_dh_base, flange=self._T_tip_flange)
            found = self.batch(T, limits=False, tol=FIT_TOLERANCE)
            if (joints_apart(found.q, q[:, None]) < AGAIN).any(axis=1).all():
                return
        raise NotOfThisKind(
            f"arm {self.arm.name!r} does not have the geometry of a UR-type arm: its poses are up to {off:.1e} m or "
            "rad off; CalibratedURKinematics is for those that are a little off"
        )


class UR5Kinematics(URKinematics):
    """`URKinematics` of the UR5. Threads may share an instance.

    The arguments are those of `URKinematics`.
    """


class CalibratedURKinematics(URKinematics):
    """Kinematics of a UR with its factory calibration: every posture, exactly. Threads may share an instance.

    The methods are those of `URKinematics`, and so are the branches, as far as they can be: there may be up to sixteen
    postures, and near a singularity some have an index of 8 or more (`kinreach.kinematics._ur.calibrated`). A free
    wrist_3 is rare here, as tilted axes are never parallel. Postures miss the pose by less than 1e-10 m and rad; only
    where none does that, as for a pose on the border that was rounded, those that miss it by up to `tol` are returned.

    Args:
        arm: Description of the arm, such as `get_arm("ur5").calibrated(FILE)`.
        tip, base, tool: As for `URKinematics`.

    Attributes:
        geometry: Lengths of the nearest arm that has a closed form [m].

    Raises:
        UnknownNameError: Unknown arm, tip or base.
        InputError: The arm is not a UR, not even one out of adjustment.
    """

    branches = MAX_POSTURES

    def _axis_postures(self, goal: AxisGoal, start: Floats | None, q6: float, tol: float) -> tuple[Floats, int]:
        """Only wrist_3 turns about the tool's axis: joints 1 to 5 are those of any pose with this direction."""
        (T,) = poses_about(goal.position, goal.axis, np.zeros(1))
        rows = np.empty((self.branches, ROW))
        count = lib.kr_solutions(*self._arguments, doubles(T), NULL, False, tol, doubles(rows))
        miss = 0 if count else int(rows[0, 1])
        rows[:, -1] = q6
        return rows[:count], miss

    @property
    def _wrist_3_turns_tip(self) -> bool:
        last = self._calibrated.chain.placements[6]
        return self._reach is not None and bool(np.abs(last[:2, 2:]).max() <= AXIS_TOLERANCE)

    @property
    def special_axes(self) -> str:
        """How nearly the arm has the axes of a data sheet."""
        off, turned = 1e3 * self._calibrated.fit.position, 1e3 * self._calibrated.fit.orientation
        return f"axes 2, 3 and 4 are nearly parallel: poses differ by less than {off:.2g} mm and {turned:.2g} mrad"

    def shortfalls(self, T: ArrayLike) -> dict[int, Shortfall]:
        """As `URKinematics.shortfalls`, of the nearest arm that has a closed form: right to about a millimetre."""
        return self._calibrated.shortfalls(np.array([*self._flange_rows(T), (0.0, 0.0, 0.0, 1.0)]))

    def nearest_in_reach(self, T: ArrayLike) -> Floats:
        """As `URKinematics.nearest_in_reach`, of the nearest arm with a closed form: right to about a millimetre."""
        nearest = as_pose("T", T).copy()
        way = self._calibrated.way_into_reach(np.array([*self._flange_rows(T), (0.0, 0.0, 0.0, 1.0)]))
        nearest[:3, 3] += self._T_dh_base[:3, :3].T @ way
        return nearest

    _tensor_batch = ClosedFormKinematics._tensor_batch

    def _check_fit(self) -> None:
        """Fit the nearest arm with a closed form."""
        placements, axes = self._joint_frames()
        placements[0] = np.linalg.inv(self.T_world_arm @ FLIP) @ placements[0]
        from kinreach.kinematics._ur.calibrated import CalibratedChain  # loads the elimination

        self._calibrated = CalibratedChain(about_z(placements, axes, self._flange.homogeneous), self.geometry)
        self.geometry = self._calibrated.fit.geometry
        self._way = lib.KR_CALIBRATED
        self._prepared = self._calibrated.for_core(self._T_dh_base, self._T_tip_flange)


def _reach_along_tool(T_flange_tip: Floats) -> float | None:
    """Distance of the tip along the flange's z axis [m], or None if it is not on it or turned away from it."""
    aligned = T_flange_tip[2, 2] > 0.0 and np.abs(T_flange_tip[:2, 2:]).max() <= ALIGNED
    return float(T_flange_tip[2, 3]) if aligned else None
