"""Kinematics of arms with seven joints, or with six on a slide: every posture of a pose, as curves."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import MAX_ANGLE, Floats, as_pose
from kinreach._rotations import pose_error
from kinreach.errors import InputError
from kinreach.kinematics._arm import ArmKinematics
from kinreach.kinematics._chain import TURNS, poses_about, turns_and_own
from kinreach.kinematics._collision import CollisionChecker
from kinreach.kinematics._goals import AxisGoal, Goal, SolvesGoals, check_goal, nearest_rotations
from kinreach.kinematics._seven_axis.curves import SelfMotions, surfaces_within_limits, within_limits
from kinreach.kinematics._seven_axis.starts import JOINTS
from kinreach.kinematics._seven_axis.tracing import SelfMotionTracer
from kinreach.kinematics._six_axis.methods import WAYS
from kinreach.kinematics._solutions import Accept, IKResult, Status, check_accept, nearest_windings

UNREACHED = "no posture reaches the goal"


class SevenAxisKinematics(SolvesGoals, ArmKinematics):
    """Kinematics of an arm with any seven revolute joints, by its data sheet or calibrated; or with six and a slide.

    A pose has a family of postures, the self-motion. `self_motions` computes all of it as curves in joint space;
    `nearest`, `clearest` and `manipulable` choose from them. Threads may share an instance.

    The slide is the first joint, such as a rail or a column under the arm, or the last. It has metres in `q`. Where
    distances between postures, lengths of curves and manipulability need them in radians, `length` metres are one.

    Args:
        arm: Name of a registered arm, or a description.
        tip: Short name of the tip frame; default is the arm's own tool centre point.
        base: `"base_link"`, `"world"`, or a frame of your own (4, 4).
        tool: As in `ArmKinematics`.

    Attributes:
        length: Sum of the distances from each joint to the next, and to the tip, without the slide's own way [m].
        unit: What counts as 1 rad of each joint [rad, m], shape (7,): of the slide `length`.

    Raises:
        UnknownNameError: The arm, the tip or the base does not exist.
        InputError: The arm does not have seven joints, or one of another kind, or no six of them can be solved with the
            first or the last held, or with the slide held.
    """

    joints: ClassVar[int] = JOINTS
    _closed_forms: ClassVar = {}
    knows_all_postures = True
    unsolved = "a seven-joint arm is asked for a pose or a direction, not for a bare position"

    def _prepare(self) -> None:
        if self.n != JOINTS:
            raise InputError(f"arm {self.arm.name!r} has {self.n} joints; seven are needed")
        sliding = np.flatnonzero(self.slides).tolist()
        if len(self.moves) != JOINTS or sliding not in ([], [0], [JOINTS - 1]):
            does = f"slides ({', '.join(self.arm.joints[i] for i in sliding)})" if sliding else "follows another"
            raise InputError(
                f"arm {self.arm.name!r} has a joint that {does}; {type(self).__name__} takes joints that turn, and one "
                "slide, the first or the last"
            )
        self._tracer = SelfMotionTracer(self.chain)
        if not self._tracer.sound:
            held = self.arm.joints[sliding[0]] if sliding else "its first or last joint"
            raise InputError(f"arm {self.arm.name!r}: with {held} held, the other six cannot be solved")
        self.length = self._tracer.reach
        self.unit: Floats = self._tracer.unit

    @property
    def solved(self) -> str:
        """How postures are found with a joint held, in closed form, by Newton's method from one, or by elimination."""
        return WAYS[self._tracer.rank]

    def self_motions(self, T: ArrayLike, *, limits: bool = True, seed: ArrayLike | None = None) -> SelfMotions:
        """Compute every posture that brings the tip to a pose, as closed and open curves.

        Args:
            T: Pose of the tip in the base frame, shape (4, 4).
            limits: Cut the curves at the joint limits.
            seed: Posture [rad, m], shape (7,). The curve to which Newton's method leads from it is looked for, too.

        Returns:
            The curves, or the reason why there is none. Where every posture is singular, because the elbow of an arm
            such as an iiwa is stretched to less than 1e-5 rad, each curve is there twice, once for either side of the
            elbow, 3e-5 rad apart, or up to 3e-3 where it is folded. Its postures miss the pose by up to 1e-10 m and
            rad. Where two pairs of axes coincide, or almost, the postures are a surface: it is among `surfaces`, by
            postures all over it.

        Raises:
            InputError: `T` is not a finite rigid motion, or the seed is malformed.
        """
        T = as_pose("T", T).copy()
        T[:3, :3] = nearest_rotations(T[:3, :3])
        far = np.full(self.n, MAX_ANGLE)
        lower, upper = (np.maximum(self.lower, -far), np.minimum(self.upper, far)) if limits else (-far, far)
        places = self._tracer.placed(T, lower, upper)
        start = None if seed is None else places.of(self.as_posture("seed", seed))
        curves, wide = self._tracer.curves(places.moved, start)
        found = within_limits(self._tracer, places, curves)
        surfaces = surfaces_within_limits(wide, places)
        status, reason = Status.OK, ""
        if not (found or surfaces):
            status, reason = Status.OUT_OF_REACH, UNREACHED
            if curves or wide:
                status, reason = Status.OUT_OF_LIMITS, "every posture is outside the joint limits"
                reason += self._slide_needed(places.postures(np.vstack([*(each.q for each in curves), *wide])))
        return SelfMotions(found, surfaces, status, reason, self, places)

    def _slide_needed(self, q: Floats) -> str:
        """Where the slide is in postures (m, 7) of a pose, if its limits allow none of them."""
        for joint in np.flatnonzero(self.slides):
            if self.past_limits(q)[:, joint].all():
                low, high = q[:, joint].min(), q[:, joint].max()
                limits = f"{self.lower[joint]:g} to {self.upper[joint]:g} m"
                return f": {self.arm.joints[joint]} would be at {low:.3f} to {high:.3f} m, its limits are {limits}"
        return ""

    def nearest(self, T: ArrayLike, seed: ArrayLike, *, accept: Accept | None = None) -> IKResult:
        """Compute the posture for a pose that is nearest to a seed, over all self-motions.

        Distances are in rad, of a slide in `length` metres. A seed within the limits that reaches the pose is returned
        itself.

        Args:
            T: Pose of the tip in the base frame, shape (4, 4).
            seed: Posture [rad, m], shape (7,).
            accept: Called with candidates until it returns True: the nearest of each curve, then the others by their
                distance.

        Returns:
            The posture; `branch` is the index of its curve in `self_motions(T, seed=seed)`.

        Raises:
            InputError: As `self_motions`.
        """
        check_accept(accept)
        start = self.as_posture("seed", seed)
        return self.self_motions(T, seed=start).nearest(start, accept=accept)

    def clearest(self, T: ArrayLike, checker: CollisionChecker) -> IKResult:
        """Compute the posture for a pose whose shapes are farthest from each other and from the obstacles.

        Raises:
            InputError: As `self_motions`, or a checker of another arm or without pairs of shapes.
        """
        return self.self_motions(T).clearest(checker)

    def manipulable(self, T: ArrayLike) -> IKResult:
        """Compute the posture for a pose with the largest manipulability, sqrt(det(J J^T)) (Yoshikawa 1985).

        Of postures with the same, as on either side of a Panda's shoulder, it is the one nearest to the middle of the
        joint limits. The same holds for `clearest`. The Jacobian's column of a slide is that of `length` metres.

        Raises:
            InputError: As `self_motions`.
        """
        return self.self_motions(T).manipulable()

    def solve(self, goal: Goal, seed: ArrayLike, *, accept: Accept | None = None) -> IKResult:
        """Compute a posture near a seed for a `PoseGoal` or an `AxisGoal`.

        For a direction the joint that is held, a slide if there is one, keeps the seed's value, and the tip is turned
        about the direction in steps of 3 degrees, and as it is turned in the seed.

        Raises:
            InputError: A `PositionGoal`, or an object of another kind.
        """
        return check_goal(goal).solved_by(self, seed, accept)

    def _solve_axis(self, goal: AxisGoal, seed: ArrayLike, accept: Accept | None) -> IKResult:
        check_accept(accept)
        start = self.as_posture("seed", seed)
        turns = turns_and_own(TURNS, goal.axis, self.fk(start))
        q = self._tracer.with_held(poses_about(goal.position, goal.axis, turns), start / self.unit) * self.unit
        wound, within = nearest_windings(q.T, start[:, None], self.lower, self.upper, turns=~self.slides)
        found = wound.T[within]
        for posture in found[np.argsort(np.linalg.norm(found - start, axis=1))]:
            if accept is None or accept(posture.copy()):
                return IKResult(posture, Status.OK, *goal.error(self.fk(posture)))
        status, reason = Status.OUT_OF_REACH, UNREACHED
        if len(q):
            status, reason = Status.OUT_OF_LIMITS, "every posture found is outside the joint limits"
        if len(found):
            status, reason = Status.REJECTED, f"accept refused all {len(found)} postures"
        return IKResult(start.copy(), status, *goal.error(self.fk(start)), reason)

    def _error_of(self, T: Floats, q: Floats) -> tuple[float, float]:
        return pose_error(T, self.fk(q))
