"""Iterative solvers inside: attempts, a goal's error with its Jacobian, and postures folded into the limits."""

from __future__ import annotations

import numpy as np
import pytest

from kinreach.kinematics import (
    ArmKinematics,
    AxisGoal,
    PoseGoal,
    PositionGoal,
    Status,
    Tolerance,
)
from kinreach.kinematics._solvers.iterative import Descent, GoalTask, IterativeSolver, JointSpace
from tests.kinematics.test_solvers_contract import goal_kinds, make_goal


@pytest.fixture(scope="module")
def kin():
    return ArmKinematics("ur5-thesis")


@pytest.fixture(scope="module")
def poses(kin):
    return kin.fk(np.random.default_rng(0).uniform(kin.lower, kin.upper, (30, 6)))


class Scripted(IterativeSolver):
    """Descents that end where a script says, whatever their start."""

    name = "scripted"

    def _descender(self, goal):
        self.starts, ends = [], iter(self.script)

        def descend(q):
            self.starts.append(q)
            return Descent(*next(ends))

        return descend


def test_attempts_are_counted_and_the_best_one_is_returned():
    kin = ArmKinematics("arm3")
    solver, seed = Scripted(kin, max_restarts=2, rng_seed=3), [0.1, 0.2, 0.3 + 2 * np.pi]
    goal, there = PositionGoal(kin.fk([0.4, 0.5, 0.6])[:3, 3]), np.array([0.4, 0.5, 0.6])
    solver.script = [(there + 0.2, 3), (there + 0.1, 4), (there + 2 * np.pi * np.eye(3)[0], 5)]
    found = solver.solve(goal, seed)
    assert (found.status, found.iterations, found.restarts, found.reason) == (Status.OK, 12, 2, "")
    np.testing.assert_allclose(found.q, there, atol=1e-12)
    rng = np.random.default_rng(3)
    np.testing.assert_allclose(solver.starts[0], [0.1, 0.2, 2.0])
    np.testing.assert_array_equal(solver.starts[1:], rng.uniform(kin.lower, kin.upper, (2, 3)))
    refused = solver.solve(goal, seed, accept=lambda q: False)
    assert (refused.status, refused.iterations, refused.restarts) == (Status.REJECTED, 12, 2)
    assert refused.reason.startswith("1 of 3 attempts (12 steps) converged, and accept refused")
    np.testing.assert_allclose(refused.q, there, atol=1e-12)
    solver.script[2] = (there - 0.15, 5)
    missed = solver.solve(goal, seed)
    assert (missed.status, missed.iterations, missed.restarts) == (Status.NOT_CONVERGED, 12, 2)
    np.testing.assert_allclose(missed.q, there + 0.1)
    assert (
        f"came within 0.0001 m and 0.001 rad; the nearest is {missed.position_error:.3g} m and 0 rad" in missed.reason
    )
    solver.script = [(there, 7)]
    assert solver.solve(goal, seed).iterations == 7


@pytest.mark.parametrize("arm", ["ur5-thesis", "arm3"])
@goal_kinds
def test_jacobian_is_the_gradient_of_the_error(arm, kind):
    # For any goal, the derivative of |e|^2 / 2 along dq is -e . J dq.
    kin = ArmKinematics(arm, base="world")
    rng = np.random.default_rng(6)
    step, checked = 1e-6, 0
    for _ in range(50):
        q, goal_q, dq = rng.uniform(-1.5, 1.5, (3, kin.n))
        task = GoalTask(kin, make_goal(kind, kin.fk(goal_q)), Tolerance())
        e, J = task.linearise(q)
        assert J.shape == (len(e), kin.n) == ({PoseGoal: 6, AxisGoal: 5, PositionGoal: 3}[kind], kin.n)
        ahead, _ = task.linearise(q + step * dq)
        behind, _ = task.linearise(q - step * dq)
        numeric = (ahead @ ahead - behind @ behind) / (4 * step)
        assert numeric == pytest.approx(-e @ J @ dq, abs=1e-6)
        checked += 1
    assert checked == 50


@goal_kinds
def test_task_error_is_the_goal_error(kind, kin, poses):
    home = np.array(kin.arm.home)
    for T in poses:
        goal = make_goal(kind, T)
        e, _ = GoalTask(kin, goal, Tolerance()).linearise(home)
        position, orientation = goal.error(kin.fk(home))
        assert np.linalg.norm(e[:3]) == pytest.approx(position, abs=1e-12)
        assert np.linalg.norm(e[3:]) == pytest.approx(orientation, abs=1e-9)


def test_fold_keeps_the_posture_and_the_limits(kin):
    space = JointSpace(kin)
    q = np.random.default_rng(7).uniform(-15, 15, (500, 6))
    folded = np.array([space.fold(row) for row in q])
    assert ((folded >= kin.lower) & (folded <= kin.upper)).all()
    np.testing.assert_allclose(kin.fk(folded), kin.fk(q), atol=1e-9)
    inside = np.random.default_rng(8).uniform(kin.lower, kin.upper)
    np.testing.assert_array_equal(space.fold(inside), inside)


def test_fold_clamps_joints_that_do_not_turn_full_circle():
    kin = ArmKinematics("arm3")
    folded = JointSpace(kin).fold(np.array([4.0, 2.5, -9.0]))
    np.testing.assert_allclose(folded, [4.0 - 2 * np.pi, 2.0, -2.0])
