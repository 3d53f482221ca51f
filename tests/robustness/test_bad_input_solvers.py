"""Goals and numeric solvers under fuzz: placo, Pinocchio and daqp are given nothing that they abort on."""

import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from kinreach.errors import InputError
from kinreach.kinematics import (
    Arm3Kinematics,
    AxisGoal,
    ClosedFormSolver,
    LevenbergMarquardtSolver,
    PlacoSolver,
    PoseGoal,
    PositionGoal,
    QPSolver,
    Tolerance,
    UR5Kinematics,
)
from tests.robustness.fuzzing import NUMBERS, bad_arrays, things

UR5, ARM3 = UR5Kinematics(tip="tcp", base="world"), Arm3Kinematics()
NUMERIC = {"lm": LevenbergMarquardtSolver, "qp": QPSolver, "placo": PlacoSolver}
SOLVERS = {
    f"{name}-{kin.arm.name}": solver(kin, max_restarts=1, max_iterations=15)
    for name, solver in NUMERIC.items()
    for kin in (UR5, ARM3)
} | {"closed-form-ur5": ClosedFormSolver(UR5), "closed-form-arm3": ClosedFormSolver(ARM3)}


def angles(n, most):
    return arrays(np.float64, n, elements=st.floats(-most, most))


@st.composite
def goals(draw, kin):
    """Goals that can be made, near, far and at the bounds; or what is none."""
    point = arrays(np.float64, 3, elements=st.floats(-0.8, 0.8) | st.floats(-1e6, 1e6) | st.sampled_from([1e6, -1e6]))
    kind = draw(st.sampled_from(["pose", "axis", "point", "made", "thing", "type"]))
    if kind == "pose":
        T = kin.fk(draw(angles(kin.n, 3.0)))
        return PoseGoal(T + draw(st.sampled_from([0.0, 1e-7, 3e-6])) * np.eye(4, k=1) * [1, 1, 1, 0])
    if kind == "axis":
        return AxisGoal(draw(point), draw(arrays(np.float64, 3, elements=st.floats(-1, 1)).filter(np.any)))
    if kind == "point":
        return PositionGoal(draw(point))
    if kind == "made":
        made = draw(st.sampled_from([PoseGoal, AxisGoal, PositionGoal]))
        return made(draw(bad_arrays((4, 4) if made is PoseGoal else (3,))))
    return draw(things()) if kind == "thing" else PoseGoal


@pytest.mark.parametrize("made", [PoseGoal, AxisGoal, PositionGoal])
def test_goals(made, fuzzed):
    def run(case):
        goal = made(*case[:2]) if made is AxisGoal else made(case[0])
        assert goal.position.shape == (3,)
        assert np.abs(goal.position).max() <= 1e6
        if made is AxisGoal:
            assert np.linalg.norm(goal.axis) == pytest.approx(1.0)
        if made is PoseGoal:
            assert np.abs(goal.T[:3, :3].T @ goal.T[:3, :3] - np.eye(3)).max() <= 1e-5

    shape = (4, 4) if made is PoseGoal else (3,)
    good = angles(6, 3.0).map(UR5.fk) if made is PoseGoal else angles(3, 1.0)
    fuzzed(st.tuples(bad_arrays(shape) | good, bad_arrays((3,)) | angles(3, 1.0)), run)


@pytest.mark.parametrize("solver", SOLVERS.values(), ids=SOLVERS)
def test_solvers(solver, fuzzed):
    kin = solver.kin

    def run(case):
        make, seed, accept = case
        result = solver.solve(make(), seed, accept=accept)
        position, orientation = make().error(kin.fk(result.q))
        assert result.q.shape == (kin.n,)
        assert (result.position_error, result.orientation_error) == pytest.approx((position, orientation))
        assert not result.success or (position <= 1e-4 and orientation <= 1e-3 and kin.within_limits(result.q))
        assert result.success or result.reason

    seeds = angles(kin.n, 3.0) | angles(kin.n, 1e6) | bad_arrays((kin.n,))
    accepts = st.sampled_from([None, None, None, lambda q: True, lambda q: False, lambda q: bool(q[0] > 0), 5, "free"])
    fuzzed(st.tuples(goals_or_errors(kin), seeds, accepts), run, share=0.6)


def goals_or_errors(kin):
    """Goals as functions: drawing one that cannot be made must not end the test."""

    @st.composite
    def made(draw):
        try:
            goal = draw(goals(kin))
        except InputError as error:
            reason = str(error)

            def refuse():
                raise InputError(reason)

            return refuse
        return lambda: goal

    return made()


@pytest.mark.parametrize("solver", NUMERIC.values(), ids=NUMERIC)
def test_what_solvers_are_made_of(solver, fuzzed):
    def run(case):
        made = solver(**{"kin": ARM3, **case})
        result = made.solve(PositionGoal([0.3, 0.2, 0.4]), np.zeros(3))
        assert result.q.shape == (3,)

    value = NUMBERS | things() | st.integers(-2, 3)
    options = st.sampled_from(["kin", "tolerance", "max_iterations", "max_restarts", "rng_seed", "dt", "position"])

    @st.composite
    def cases(draw):
        name = draw(options)
        if name == "position":
            return {"tolerance": Tolerance(draw(value), draw(value))}
        if name == "dt" and solver is LevenbergMarquardtSolver:
            name = "rng_seed"
        return {name: draw(value)}

    fuzzed(cases(), run, share=0.6)
