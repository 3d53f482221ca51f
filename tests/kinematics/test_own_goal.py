"""A goal of a kind that kinreach does not have: a class, and no edit of the package."""

import numpy as np
import pytest

from kinreach.errors import InputError
from kinreach.kinematics import (
    ArmKinematics,
    ClosedFormSolver,
    Goal,
    IKResult,
    LevenbergMarquardtSolver,
    PlacoSolver,
    PoseGoal,
    QPSolver,
    URKinematics,
)

SOLVERS = (LevenbergMarquardtSolver, QPSolver, PlacoSolver)


class OnLine(Goal):
    """The tip is somewhere on a line through a point, along a direction, and its z axis is across the line."""

    lengths = 3

    def __init__(self, point, direction):
        self.point, self.direction = np.array(point), np.array(direction) / np.linalg.norm(direction)
        self.across = np.eye(3) - np.outer(self.direction, self.direction)

    def error(self, T):
        return np.linalg.norm(self.across @ (self.point - T[:3, 3])), abs(np.arcsin(self.direction @ T[:3, 2]))

    def way(self, tip):
        R, z = tip.rotation, tip.rotation[:, 2]
        e = np.append(self.across @ (self.point - tip.translation), -self.direction @ z)
        turned = np.cross(R.T @ self.direction, [0.0, 0.0, 1.0])  # w moves z by w x z
        return e, np.vstack([np.hstack([self.across @ R, np.zeros((3, 3))]), np.append(np.zeros(3), -turned)])


@pytest.mark.parametrize("base", ["base_link", "world", "base"])
@pytest.mark.parametrize("solver", SOLVERS)
def test_a_goal_of_ones_own_is_solved(solver, base):
    kin, rng, off = URKinematics("ur5e", base=base), np.random.default_rng(0), []
    search = solver(kin)
    for _ in range(40):
        T = kin.fk(rng.uniform(-2.0, 2.0, 6))
        goal = OnLine(T[:3, 3], T[:3, 0])  # the x axis is across the z axis
        assert max(goal.error(T)) < 1e-12
        found = search.solve(goal, kin.arm.home)
        assert found.success, found.reason
        assert (found.position_error, found.orientation_error) == pytest.approx(goal.error(kin.fk(found.q)), abs=1e-12)
        assert IKResult.of(kin, goal, found.q).success
        off.append(np.abs(kin.fk(found.q)[:3, 3] - T[:3, 3]).max())
    assert sum(np.array(off) > 0.01) > 20  # elsewhere on the line, as is free


def test_its_derivative_is_that_of_its_error():
    """By central differences, at random poses, for goals of kinreach, too."""
    kin, rng, tried = ArmKinematics("ur5e"), np.random.default_rng(1), 0
    from kinreach.kinematics._solvers.iterative import DEFAULT_TOLERANCE, GoalTask

    for _ in range(30):
        q, T = rng.uniform(-2.0, 2.0, 6), kin.fk(rng.uniform(-2.0, 2.0, 6))
        task = GoalTask(kin, OnLine(T[:3, 3], T[:3, 0]), DEFAULT_TOLERANCE)
        _, J = task.linearise(q)
        for joint in range(6):
            step = 1e-6 * np.eye(6)[joint]
            ahead, behind = (task.linearise(q + s)[0].copy() for s in (step, -step))
            np.testing.assert_allclose((behind - ahead) / 2e-6, J[:, joint], atol=1e-8)
            tried += 1
    assert tried == 180


class AtHeight(Goal):
    """The tip is at a height; nothing is asked of its orientation."""

    lengths = 1

    def __init__(self, z):
        self.z = z

    def error(self, T):
        return abs(self.z - T[2, 3]), 0.0

    def way(self, tip):
        return np.array([self.z - tip.translation[2]]), np.append(tip.rotation[2], np.zeros(3))[None]


@pytest.mark.parametrize("arm", ["arm3", "panda", "ur5-thesis"])
@pytest.mark.parametrize("solver", SOLVERS)
def test_arms_of_any_number_of_joints_meet_it(solver, arm):
    kin, rng = ArmKinematics.of(arm, base="world"), np.random.default_rng(2)
    for q in rng.uniform(kin.lower, kin.upper, (10, kin.n)):
        goal = AtHeight(kin.fk(q)[2, 3])
        found = solver(kin).solve(goal, kin.arm.home)
        assert found.success, found.reason
        assert abs(kin.fk(found.q)[2, 3] - goal.z) < 1e-4
        assert len(kin.joints_outside_limits(found.q)) == 0


def test_solvers_that_know_some_kinds_only_say_so():
    kin = URKinematics("ur5e")
    goal = OnLine([0.4, 0.1, 0.3], [1.0, 0.0, 0.0])
    with pytest.raises(InputError, match=r"OnLine names no pose that meets it; the numeric solvers need none"):
        goal.frame()
    with pytest.raises(InputError, match=r"closed forms do not know the goal .*numeric solvers solve any"):
        ClosedFormSolver(kin).solve(goal, kin.arm.home)


@pytest.mark.parametrize("solver", SOLVERS)
def test_what_is_no_goal_is_refused(solver):
    kin = URKinematics("ur5e")
    for wrong in (None, np.eye(4), "home"):
        with pytest.raises(InputError, match="goal must be a PoseGoal, an AxisGoal or a PositionGoal"):
            solver(kin).solve(wrong, kin.arm.home)
    assert solver(kin).solve(PoseGoal(kin.fk(kin.arm.home)), kin.arm.home).iterations == 0
