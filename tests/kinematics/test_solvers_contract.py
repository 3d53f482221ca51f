"""What the solver protocol promises beyond reaching a goal."""

from __future__ import annotations

import numpy as np
import pytest

from kinreach.errors import InputError
from kinreach.kinematics import (
    Arm3Kinematics,
    ArmKinematics,
    AxisGoal,
    CollisionChecker,
    LevenbergMarquardtSolver,
    PlacoSolver,
    PoseGoal,
    PositionGoal,
    QPSolver,
    Status,
    Tolerance,
)

SOLVERS = (PlacoSolver, LevenbergMarquardtSolver, QPSolver)
GOALS = (PoseGoal, AxisGoal, PositionGoal)

solvers = pytest.mark.parametrize("solver_class", SOLVERS, ids=lambda solver: solver.name)
goal_kinds = pytest.mark.parametrize("kind", GOALS, ids=lambda kind: kind.__name__)


def make_goal(kind, T):
    if kind is PoseGoal:
        return PoseGoal(T)
    return AxisGoal(T[:3, 3], T[:3, 2]) if kind is AxisGoal else PositionGoal(T[:3, 3])


@pytest.fixture(scope="module")
def kin():
    return ArmKinematics("ur5-thesis")


@pytest.fixture(scope="module")
def poses(kin):
    return kin.fk(np.random.default_rng(0).uniform(kin.lower, kin.upper, (30, 6)))


def test_names(kin):
    assert [solver.name for solver in SOLVERS] == ["placo", "lm", "qp"]
    assert [repr(solver(kin)) for solver in SOLVERS] == [f"{solver.__name__}({kin!r})" for solver in SOLVERS]
    far = ArmKinematics.of(kin.arm).all_solutions(np.eye(4) + 9.0 * np.eye(4, k=3))
    assert repr(far) == f"IKSolutions(0 postures, status={far.status}, reason={far.reason!r})"


@solvers
@goal_kinds
def test_at_the_goal_nothing_is_left_to_do(solver_class, kind, kin):
    home = np.array(kin.arm.home)
    result = solver_class(kin).solve(make_goal(kind, kin.fk(home)), home)
    assert result.success
    assert result.iterations <= 1
    assert result.restarts == 0
    np.testing.assert_allclose(result.q, home, atol=1e-9)


@solvers
@goal_kinds
def test_the_error_falls_with_every_step(solver_class, kind, kin):
    rng = np.random.default_rng(5)
    falls = 0
    for _ in range(10):
        goal_q = rng.uniform(-1.5, 1.5, 6)
        goal = make_goal(kind, kin.fk(goal_q))
        seed = goal_q + rng.uniform(-0.3, 0.3, 6)
        previous = max(goal.error(kin.fk(seed)))
        for steps in range(1, 10):
            result = solver_class(kin, max_iterations=steps, max_restarts=0).solve(goal, seed)
            error = np.hypot(result.position_error, result.orientation_error)
            if steps > 1:
                assert error < previous
                falls += 1
            previous = error
            if result.success:
                break
        assert result.success
    assert falls >= 5


@solvers
@goal_kinds
def test_out_of_reach_is_a_status(solver_class, kind, kin):
    T = np.eye(4)
    T[:3, 3] = (2.0, 0.0, 0.3)
    solver = solver_class(kin, max_restarts=3)
    result = solver.solve(make_goal(kind, T), kin.arm.home)
    assert result.status is Status.NOT_CONVERGED
    assert not result.success
    assert result.restarts == 3
    assert "4 attempts" in result.reason
    assert f"{result.iterations} steps" in result.reason
    assert kin.within_limits(result.q)
    errors = make_goal(kind, T).error(kin.fk(result.q))
    assert (result.position_error, result.orientation_error) == errors
    assert 0.5 < result.position_error < 2.0


@solvers
def test_a_pose_that_three_joints_cannot_take_does_not_converge(solver_class):
    kin = ArmKinematics("arm3")
    T = kin.fk([0.3, 0.6, 0.5])
    T[:3, :3] = T[:3, :3] @ np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    result = solver_class(kin, max_restarts=3).solve(PoseGoal(T), kin.arm.home)
    assert result.status is Status.NOT_CONVERGED
    assert kin.within_limits(result.q)


@solvers
def test_a_refused_posture_leads_to_another(solver_class, kin):
    goal = AxisGoal(kin.fk(kin.arm.home)[:3, 3] + (0.05, -0.05, -0.1))
    first = solver_class(kin).solve(goal, kin.arm.home)
    asked = []

    def elsewhere(q):
        asked.append(q.copy())
        q[:] = np.nan  # the posture that is returned is not the callback's to change
        return np.abs(asked[-1] - first.q)[:5].max() > 0.1

    result = solver_class(kin).solve(goal, kin.arm.home, accept=elsewhere)
    assert result.success
    assert result.restarts >= 1
    assert len(asked) >= 2
    np.testing.assert_array_equal(asked[0], first.q)
    np.testing.assert_array_equal(asked[-1], result.q)
    assert np.abs(result.q - first.q)[:5].max() > 0.1


@solvers
def test_rejected_when_every_posture_is_refused(solver_class, kin):
    goal = AxisGoal(kin.fk(kin.arm.home)[:3, 3] + (0.05, -0.05, -0.1))
    asked = []
    result = solver_class(kin, max_restarts=4).solve(goal, kin.arm.home, accept=lambda q: bool(asked.append(q)))
    assert result.status is Status.REJECTED
    assert len(asked) >= 1
    assert f"{len(asked)} of 5 attempts" in result.reason
    np.testing.assert_array_equal(result.q, asked[0])
    assert result.position_error <= Tolerance().position
    assert result.restarts == 4


@solvers
@pytest.mark.slow
def test_collision_free_postures_on_request(solver_class, kin, poses):
    checker = CollisionChecker(kin)
    solver = solver_class(kin)
    avoided = found = 0
    for T in poses:
        plain = solver.solve(PoseGoal(T), kin.arm.home)
        free = solver.solve(PoseGoal(T), kin.arm.home, accept=checker.free)
        assert plain.success
        if free.success:
            assert not checker.in_collision(free.q)
            found += 1
            avoided += checker.in_collision(plain.q)
        else:
            assert free.status is Status.REJECTED
    assert found >= 10
    assert avoided >= 1


@solvers
def test_equal_questions_get_equal_answers_in_any_order(solver_class, kin, poses):
    goals = [make_goal(kind, T) for T in poses[:10] for kind in GOALS]
    solver = solver_class(kin)
    forward = [solver.solve(goal, kin.arm.home) for goal in goals]
    backward = [solver.solve(goal, kin.arm.home) for goal in reversed(goals)][::-1]
    fresh = [solver_class(kin).solve(goal, kin.arm.home) for goal in goals]
    assert any(result.restarts for result in forward)
    for one, other, another in zip(forward, backward, fresh, strict=True):
        np.testing.assert_array_equal(one.q, other.q)
        np.testing.assert_array_equal(one.q, another.q)
        assert (one.iterations, one.restarts) == (other.iterations, other.restarts)


@solvers
def test_rng_seed_changes_the_restarts(solver_class, kin, poses):
    results = [[solver_class(kin, rng_seed=seed).solve(PoseGoal(T), kin.arm.home) for T in poses] for seed in (0, 1)]
    restarted = [(a, b) for a, b in zip(*results, strict=True) if a.restarts]
    assert restarted
    assert any(not np.array_equal(a.q, b.q) for a, b in restarted)


@solvers
@pytest.mark.parametrize("seed", [np.zeros(5), np.full(6, np.nan), [0, 0, 0, 0, 0, np.inf], np.zeros((1, 6)), "home"])
def test_malformed_seeds(solver_class, seed, kin):
    with pytest.raises(InputError, match="seed"):
        solver_class(kin).solve(PositionGoal((0.3, -0.4, 0.2)), seed)


@solvers
@pytest.mark.parametrize("goal", [np.eye(4), (0.3, 0.1, 0.2), None, "home"])
def test_what_is_no_goal(solver_class, goal, kin):
    with pytest.raises(InputError, match="goal must be a PoseGoal, an AxisGoal or a PositionGoal"):
        solver_class(kin).solve(goal, kin.arm.home)


@solvers
def test_malformed_goals(solver_class, kin):
    solver = solver_class(kin)
    skewed = np.diag([1.0, 1.0, 2.0, 1.0])
    with pytest.raises(InputError, match="rotation"):
        solver.solve(PoseGoal(skewed), kin.arm.home)
    with pytest.raises(InputError, match="finite"):
        solver.solve(AxisGoal((0.3, np.nan, 0.2)), kin.arm.home)
    with pytest.raises(InputError, match="shape"):
        solver.solve(PositionGoal((0.3, 0.2)), kin.arm.home)


@solvers
@pytest.mark.parametrize(
    "options",
    [
        {"max_iterations": 0},
        {"max_restarts": -1},
        {"tolerance": Tolerance(position=0.0)},
        {"tolerance": Tolerance(orientation=float("nan"))},
    ],
)
def test_options_that_cannot_be_used(solver_class, options, kin):
    with pytest.raises(InputError):
        solver_class(kin, **options)


@pytest.mark.parametrize("solver_class", [PlacoSolver, QPSolver], ids=lambda solver: solver.name)
@pytest.mark.parametrize("dt", [0.0, -0.1, float("nan"), float("inf")])
def test_durations_that_cannot_be_used(solver_class, dt, kin):
    with pytest.raises(InputError, match="dt"):
        solver_class(kin, dt=dt)


@pytest.mark.parametrize("solver_class", [PlacoSolver, QPSolver], ids=lambda solver: solver.name)
def test_a_step_keeps_the_speed_limits(solver_class, kin, poses):
    dt, steps = 0.1, 3
    solver = solver_class(kin, dt=dt, max_iterations=steps, max_restarts=0)
    home = np.array(kin.arm.home)
    moves = np.array([np.abs(solver.solve(PoseGoal(T), home).q - home) for T in poses])
    moves = np.minimum(moves, 2 * np.pi - moves)
    assert (moves <= steps * dt * kin.velocity_limit + 1e-6).all()
    assert moves.max() > 0.9 * steps * dt * kin.velocity_limit.min()


@pytest.mark.parametrize("solver_class", [LevenbergMarquardtSolver, QPSolver])
def test_two_tolerances_beyond_the_reach_is_out_of_reach(solver_class):
    kin = ArmKinematics("arm3")
    g = Arm3Kinematics().geometry
    rng, refused = np.random.default_rng(4), 0
    for _ in range(5):
        q = np.array([rng.uniform(-1, 1), rng.uniform(-1, 1), np.arctan2(*g.upper) - np.arctan2(*g.fore)])
        tip = kin.fk(q)[:3, 3]
        out = tip - kin.T_base_world[:3] @ [*kin.data.oMi[2].translation, 1.0]
        beyond = PositionGoal(tip + 2e-4 * out / np.linalg.norm(out))
        result = solver_class(kin, max_restarts=0).solve(beyond, q)  # from behind it would reach
        assert result.status is Status.NOT_CONVERGED
        refused += result.position_error < 3e-4
    assert refused >= 3


def test_tolerance_is_kept(kin, poses):
    tight = Tolerance(position=1e-9, orientation=1e-9)
    results = [LevenbergMarquardtSolver(kin, tolerance=tight).solve(PoseGoal(T), kin.arm.home) for T in poses]
    assert len(results) == 30
    assert all(r.success and r.position_error <= 1e-9 and r.orientation_error <= 1e-9 for r in results)
