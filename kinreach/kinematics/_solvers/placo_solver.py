"""placo's task-space quadratic program, iterated to convergence under joint and speed limits."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from functools import partial
from typing import Any, ClassVar

import numpy as np

from kinreach._checks import Floats
from kinreach._engines import load
from kinreach.kinematics._arm import ArmKinematics
from kinreach.kinematics._goals import AxisGoal, Goal, PoseGoal, PositionGoal, check_goal
from kinreach.kinematics._solvers.base import Tolerance
from kinreach.kinematics._solvers.iterative import (
    STALLED,
    Descend,
    Descent,
    SteppingSolver,
)
from kinreach.robots.inside import followers, skeleton

pin: Any = load("pinocchio")

#: Limit [rad] for joints that turn full circle: no search reaches it.
NO_LIMIT = 100.0


class PlacoSolver(SteppingSolver):
    """placo (github.com/Rhoban/placo) with restarts.

    Its settings gave the best results: speed limits, which keep each step where the linearisation holds, and steps up
    to convergence. Joints that turn full circle have no position limit on the way (see `JointSpace`). placo's objects
    are made once per kind of goal and thread; a call only moves their targets. Threads may share an instance.

    The arguments are those of `SteppingSolver`.

    Raises:
        InputError: A count, a tolerance or `dt` cannot be used.
        InstallationError: placo cannot be loaded.
    """

    name: ClassVar[str] = "placo"

    def _prepare(self) -> None:
        ends = dict(zip(self.kin.arm.joints, self.joint_space.search_upper, strict=True))
        follows = followers(self.kin.arm)
        free = [name for name in ends if np.isinf(ends[name])]
        free += [name for name, how in follows.items() if how.joint in free]
        self._work = _WorkSpace(self.kin, self.tolerance, self.dt, free)

    def __reduce__(self) -> tuple[Any, ...]:
        options = {
            name: getattr(self, name) for name in ("tolerance", "dt", "max_iterations", "max_restarts", "rng_seed")
        }
        return partial(PlacoSolver, **options), (self.kin,)  # placo's own objects cannot be pickled

    def _descender(self, goal: Goal) -> Descend:
        work = self._work
        robot, configuration, entries = work.robot, work.configuration.copy(), work.entries
        places, factors = work.followers
        problem = next((problem for kind, problem in work.problems.items() if isinstance(goal, kind)), None)
        if problem is None:
            return self._descender_by_steps(check_goal(goal))
        problem.aim(self.kin.T_world_base @ goal.frame())

        def descend(q: Floats) -> Descent:
            configuration[entries] = q
            configuration[places] = factors @ q
            robot.state.q = configuration
            robot.update_kinematics()
            steps, stalled = 0, False
            while steps < self.max_iterations and not stalled and not problem.reached():
                try:
                    stalled = np.abs(problem.solver.solve(True)).max() < STALLED
                except RuntimeError:  # rarely, placo finds NaN in what its program gives
                    break
                robot.update_kinematics()
                steps += 1
            return Descent(robot.state.q[entries], steps)

        return descend

    def _descender_by_steps(self, goal: Goal) -> Descend:
        """A goal that placo has no task for: each step aims at the pose nearest to the tip that meets it, linearised.

        The tip is held in what the goal leaves free, but for its orientation where the goal asks nothing of it.
        """
        work, kin = self._work, self.kin
        robot, configuration, entries = work.robot, work.configuration.copy(), work.entries
        places, factors = work.followers
        T_base_world = np.linalg.inv(kin.T_world_base)

        def descend(q: Floats) -> Descent:
            configuration[entries] = q
            configuration[places] = factors @ q
            robot.state.q = configuration
            for steps in range(self.max_iterations):
                robot.update_kinematics()
                tip = pin.SE3(T_base_world @ robot.get_T_world_frame(work.tip))
                position, orientation = goal.error(tip.homogeneous)
                if position <= self.tolerance.position and orientation <= self.tolerance.orientation:
                    return Descent(robot.state.q[entries], steps)
                e, L = goal.way(tip)
                L = np.eye(len(e), 6) if L is None else L
                nearest = tip * pin.exp6(np.linalg.lstsq(L, e, rcond=None)[0])
                problem = work.problems[PoseGoal if L[:, 3:].any() else PositionGoal]
                problem.aim(kin.T_world_base @ nearest.homogeneous)
                try:
                    stalled = np.abs(problem.solver.solve(True)).max() < STALLED
                except RuntimeError:  # rarely, placo finds NaN in what its program gives
                    return Descent(robot.state.q[entries], steps)
                if stalled:
                    return Descent(robot.state.q[entries], steps + 1)
            return Descent(robot.state.q[entries], self.max_iterations)

        return descend


def placo_robot(kin: ArmKinematics) -> tuple[Any, str]:
    """Return placo's robot for an arm, with the joints that are held in their places, and the frame of its tip."""
    placo: Any = load("placo")  # here, and not above: without placo the other solvers still work
    urdf, tip = skeleton(kin.arm.robot, kin.arm.tips[kin.tip])
    robot = placo.RobotWrapper("", int(placo.Flags.ignore_collisions), urdf)
    for name, position in kin.arm.locked_joints.items():
        robot.set_joint(name, position)
    return robot, tip


def placo_program(kin: ArmKinematics, robot: Any) -> Any:
    """Return a solver of placo for that robot, which moves neither its base nor the joints that are held.

    Joints that follow others do, in its steps.
    """
    placo: Any = load("placo")
    solver = placo.KinematicsSolver(robot)
    solver.mask_fbase(True)
    for name in kin.arm.locked_joints:
        solver.mask_dof(name)
    if follows := followers(kin.arm):
        gears = solver.add_gear_task()
        gears.configure("followers", "hard", 1.0)
        for name, how in follows.items():
            gears.add_gear(name, how.joint, how.factor)
    return solver


def place_robot(kin: ArmKinematics, robot: Any, q: Floats) -> None:
    """Put that robot into a posture [rad, m], shape (n,), with the joints that follow others."""
    for name, place in zip(kin.arm.joints, q, strict=True):
        robot.set_joint(name, place)
    for name, how in followers(kin.arm).items():  # their offsets are in their places: see `skeleton`
        robot.set_joint(name, how.factor * q[kin.arm.joints.index(how.joint)])
    robot.update_kinematics()


class _WorkSpace(threading.local):
    """placo's objects for one arm, those of one thread."""

    def __init__(self, kin: ArmKinematics, tolerance: Tolerance, dt: float, free: Sequence[str]) -> None:
        self.robot, self.tip = placo_robot(kin)
        # Base, then all joints of the URDF. A copy, because state.q is a view of memory that placo replaces.
        self.configuration: Floats = self.robot.state.q.copy()
        self.entries = [self.robot.get_joint_offset(name) for name in kin.arm.joints]
        follows = followers(kin.arm)
        factors = np.zeros((len(follows), kin.n))
        for row, how in enumerate(follows.values()):
            factors[row, kin.arm.joints.index(how.joint)] = how.factor
        #: Where the joints that follow others are in it, and by how much they follow each joint of `q`, (m, n).
        self.followers = [self.robot.get_joint_offset(name) for name in follows], factors
        for name in free:
            self.robot.set_joint_limits(name, -NO_LIMIT, NO_LIMIT)
        self.problems: dict[type[Goal], _Problem] = {}
        for kind in (PoseGoal, AxisGoal, PositionGoal):
            solver = placo_program(kin, self.robot)
            solver.enable_joint_limits(True)
            solver.enable_velocity_limits(True)
            solver.dt = dt
            self.problems[kind] = _Problem(kind, solver, self.tip, tolerance)


class _Problem:
    """placo's solver with the tasks of one kind of goal, all of weight 1."""

    def __init__(self, kind: type[Goal], solver: Any, frame: str, tolerance: Tolerance) -> None:
        self.solver = solver
        self._kind = kind
        self._position = solver.add_position_task(frame, np.zeros(3))
        self._position.configure("position", "soft", 1.0)
        self._bounds = [(self._position, tolerance.position)]
        if kind is PositionGoal:
            return
        z = np.array([0.0, 0.0, 1.0])
        if kind is PoseGoal:
            self._orientation = solver.add_orientation_task(frame, np.eye(3))
        else:
            self._orientation = solver.add_axisalign_task(frame, z, z)
        self._orientation.configure("orientation", "soft", 1.0)
        self._bounds.append((self._orientation, tolerance.orientation))

    def aim(self, T_world_goal: Floats) -> None:
        self._position.target_world = T_world_goal[:3, 3]
        if self._kind is PoseGoal:
            self._orientation.R_world_frame = T_world_goal[:3, :3]
        elif self._kind is AxisGoal:
            self._orientation.targetAxis_world = T_world_goal[:3, 2]

    def reached(self) -> bool:
        """Return whether the robot, its kinematics updated, is within the tolerance."""
        for task, bound in self._bounds:
            task.update()  # otherwise the error is that of the last call of solve
            if task.error_norm() > bound:
                return False
        return True
