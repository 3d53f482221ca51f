"""Postures at joint limits, and 1e-8 rad beyond, are found again, within the limits: every closed form."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from kinreach.kinematics import (
    ArmKinematics,
    ClosedFormKinematics,
    CollisionChecker,
    LevenbergMarquardtSolver,
    PoseGoal,
    Tolerance,
)
from kinreach.kinematics.inside import SLACK
from kinreach.robots import ArmDescription, arm_names, get_arm
from kinreach.sim import ArmSimulation
from tests.cases import slow

ROBOTS = Path(str(get_arm("ur5").package_root())) / "example-robot-data/robots"
FILES = (
    *(f"ur_description/urdf/ur{size}_{kind}.urdf" for size in (3, 5) for kind in ("gripper", "robot")),
    "ur_description/urdf/ur10_robot.urdf",
    *(f"ur_description/urdf/ur{size}_joint_limited_robot.urdf" for size in (3, 5, 10)),
    "kinova_description/robots/kinova.urdf",
    "bravo7_description/urdf/bravo7_no_ee.urdf",
)
CALIBRATION = Path(__file__).parents[1] / "data/calibrations/controller_calibration_ur5e.conf"
CASES = 15
MORE = sorted({*arm_names(), *FILES} - {"arm3", "panda", "so101", "ur5", "ur16e", *FILES[::4]})


@cache
def kinematics(name: str) -> ArmKinematics:
    if name.endswith(".urdf"):
        return ArmKinematics.of(ArmDescription.from_urdf(ROBOTS / name))
    if name == "calibrated":
        return ArmKinematics.of(get_arm("ur5e").calibrated(CALIBRATION))
    return ArmKinematics.of(name)


def at_limits(kin, beyond, count=CASES):
    """Postures with some joints at a limit or so far beyond it, if they have one, the others anywhere."""
    rng, ends = np.random.default_rng(0), np.isfinite(kin.upper)
    q = rng.uniform(*kin.sampling_limits, (count, kin.n))
    there, above = rng.random(q.shape) < 0.4, rng.random(q.shape) < 0.5
    there &= ends
    there[~there.any(axis=1), ends.argmax()] = True
    return np.where(there, np.where(above, kin.upper + beyond, kin.lower - beyond), q)


def goals(kin, q):
    return kin.fk(q) if kin.n == 6 else kin.fk(q)[:, :3, 3]


@pytest.mark.parametrize("beyond", [0.0, 1e-8])
@pytest.mark.parametrize("name", ["arm3", "ur5", "ur16e", "calibrated", *FILES[::4], *slow(*MORE)])
def test_a_posture_at_its_limits_is_found_again(name, beyond):
    kin = kinematics(name)
    assert isinstance(kin, ClosedFormKinematics)
    postures = at_limits(kin, beyond)
    targets = goals(kin, postures)
    nearest = kin.nearest_batch(targets, postures)
    every = kin.batch(targets)
    regular = 0
    assert nearest.success.all()
    for q, T, quick, branches, valid in zip(postures, targets, nearest.q, every.q, every.valid, strict=True):
        result = kin.nearest(T, q)
        found = kin.all_solutions(T, seed=q)
        assert result.success
        np.testing.assert_array_equal(result.q, found.q[0])
        for posture in (result.q, quick, *found.q, *branches[valid]):
            assert kin.within_limits(posture), kin.joints_outside_limits(posture)
            error = kin.fk(posture) - kin.fk(q)
            assert np.abs(error[:3, 3] if kin.n < 6 else error).max() < 1.5e-7
        # next to a singular posture an error of 1e-8 in the pose is 1e-4 in the joints
        np.testing.assert_allclose(result.q, q, atol=1e-3)
        np.testing.assert_allclose(quick, q, atol=1e-3)
        if np.linalg.svd(kin.jacobian(q)[: kin.n], compute_uv=False)[-1] < 1e-3:
            continue  # a free joint is somewhere else without a seed
        regular += 1
        turns = (branches[valid] - q + np.pi) % (2 * np.pi) - np.pi
        assert np.abs(turns).max(axis=1).min() < 1e-3
    assert (beyond > SLACK) == (not kin.within_limits(postures[0]))


@pytest.mark.parametrize("name", ["panda", "ur5", FILES[0]])
def test_solvers_stay_within_the_limits(name):
    kin = ArmKinematics(kinematics(name).arm)
    solver = LevenbergMarquardtSolver(kin, tolerance=Tolerance(1e-6, 1e-6))
    for q in at_limits(kin, 1e-8, 10):
        result = solver.solve(PoseGoal(kin.fk(q)), np.clip(q, kin.lower, kin.upper))
        assert result.success
        assert kin.within_limits(result.q, tolerance=0.0)


def test_what_is_found_at_a_limit_is_taken_by_checks_and_simulation():
    kin = kinematics(FILES[1])
    checker, simulation = CollisionChecker(kin), ArmSimulation(kin.arm)
    taken = 0
    for q in at_limits(kin, 1e-8):
        found = kin.nearest(kin.fk(q), q).q
        taken += checker.in_collision(found) in (True, False)
        assert not simulation.controller.outside_limits(found).any()
    assert taken == CASES
