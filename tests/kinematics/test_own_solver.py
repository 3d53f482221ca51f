"""A solver of one's own, and solvers when a package of another one is missing."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from kinreach.errors import InputError
from kinreach.kinematics import (
    ArmKinematics,
    ClosedFormSolver,
    CollisionChecker,
    IKResult,
    LevenbergMarquardtSolver,
    PoseGoal,
    PositionGoal,
    Status,
    URKinematics,
    _solvers,
)
from kinreach.kinematics.inside import SOLVERS, new_solver
from tests.cases import slow

HIDDEN = """
import sys
sys.modules[{hidden!r}] = None
import numpy as np
from kinreach.errors import InstallationError
from kinreach.kinematics import PoseGoal, UR5Kinematics
from kinreach.kinematics._solvers import ClosedFormSolver, LevenbergMarquardtSolver, PlacoSolver, QPSolver
kin = UR5Kinematics()
goal, home = PoseGoal(kin.fk([0.3, -1.2, 1.1, -0.7, 0.9, 0.2])), kin.arm.home
for solver in {working}:
    assert solver(kin).solve(goal, home).success, solver
try:
    {broken}(kin)
except InstallationError as error:
    print(error)
"""


@pytest.mark.parametrize(("hidden", "broken"), [("placo", "PlacoSolver"), *slow(("qpsolvers", "QPSolver"))])
def test_a_missing_package_takes_its_own_solver_only(run_python, hidden, broken):
    working = {"ClosedFormSolver", "LevenbergMarquardtSolver", "PlacoSolver", "QPSolver"} - {broken}
    done = run_python("-c", HIDDEN.format(hidden=hidden, working="(" + ", ".join(working) + ")", broken=broken))
    assert done.returncode == 0, done.stderr
    assert hidden in done.stdout


class LeastSquares:
    name = "scipy"

    def __init__(self, kin):
        self.kin = kin

    def solve(self, goal, seed, *, accept=None):
        def error(q):
            T = self.kin.fk(q)
            return np.concatenate([T[:3, 3] - goal.T[:3, 3], 0.3 * (T[:3, :3] - goal.T[:3, :3]).ravel()])

        found = least_squares(error, seed, bounds=(self.kin.lower, self.kin.upper))
        return IKResult.of(self.kin, goal, found.x, accept=accept, iterations=found.nfev)


def test_a_solver_of_ten_lines():
    kin = ArmKinematics("ur5-thesis")
    solver, home, rng = LeastSquares(kin), np.array(kin.arm.home), np.random.default_rng(0)
    results = [solver.solve(PoseGoal(kin.fk(home + rng.uniform(-0.5, 0.5, 6))), home) for _ in range(20)]
    assert sum(result.success for result in results) >= 18
    assert all(result.position_error < 1e-4 for result in results if result.success)
    assert all(result.iterations > 1 for result in results)


@pytest.mark.usefixtures("needs_placo")
def test_solvers_by_their_names():
    kin, plain = URKinematics("ur5-thesis"), ArmKinematics("ur5-thesis")
    for name in SOLVERS:
        assert new_solver(name, kin).name == name
        if name != "closed-form":
            assert new_solver(name, plain).kin is plain
    with pytest.raises(InputError, match="the arm 'ur5-thesis' has no closed form; its solvers are placo, lm and qp"):
        new_solver("closed-form", plain)
    with pytest.raises(InputError, match="unknown solver 'ik'; available: closed-form, lm, placo, qp"):
        new_solver("ik", kin)
    for what in (plain, "ur5-thesis", None):
        with pytest.raises(InputError, match="has no closed form; the solvers placo, lm and qp take any arm"):
            ClosedFormSolver(what)
        if what is not plain:
            with pytest.raises(InputError, match="kin must be the kinematics of an arm"):
                LevenbergMarquardtSolver(what)
    assert not hasattr(_solvers, "NoSolver")


def test_results_are_judged_anew():
    kin = URKinematics("ur5-thesis")
    home = np.array(kin.arm.home)
    goal = PoseGoal(kin.fk(home))
    far = IKResult.of(kin, goal, home + 0.1)
    assert (far.status, far.success) == (Status.NOT_CONVERGED, False)
    assert "from the goal" in far.reason
    assert IKResult.of(kin, goal, home + 0.1, reason="gave up").reason == "gave up"
    spun = IKResult.of(kin, goal, [*home[:5], home[5] + 0.1])  # the right place, the wrong way round
    assert (spun.status, spun.position_error < 1e-9) == (Status.NOT_CONVERGED, True)
    turned = IKResult.of(kin, goal, [*home[:5], home[5] + 2 * np.pi])
    assert turned.status is Status.OUT_OF_LIMITS
    assert "wrist_3_joint" in turned.reason
    refused = IKResult.of(kin, goal, home, accept=lambda q: False)
    assert refused.status is Status.REJECTED
    good = IKResult.of(kin, goal, home, accept=CollisionChecker(kin).free, iterations=3)
    assert (good.success, good.iterations, good.reason, good.position_error) == (True, 3, "", 0.0)
    assert IKResult.of(kin, PositionGoal(goal.position), home).orientation_error == 0.0
    with pytest.raises(InputError, match="q must"):
        IKResult.of(kin, goal, [0.0])
