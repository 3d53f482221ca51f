"""Where rounding, limits and singularities meet: what is promised there, held against forward kinematics."""

from __future__ import annotations

import sys
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kinreach.errors import InputError
from kinreach.kinematics import (
    ArmKinematics,
    Cause,
    CollisionChecker,
    LevenbergMarquardtSolver,
    PoseGoal,
    QPSolver,
    Status,
    URKinematics,
)
from kinreach.robots import get_arm

FLANGE = URKinematics("ur5-thesis")
TCP = URKinematics("ur5-thesis", tip="tcp", base="world")
DOWN = (0.0, 0.0, -1.0)
PLACE = (0.45, 0.1, -0.175)


def narrow(name="narrow", **limits):
    """The UR5 with other limits of some joints."""
    return replace(
        get_arm("ur5-thesis").with_limits({f"{joint}_joint": ends for joint, ends in limits.items()}), name=name
    )


# tool directions: wrist_3 is free, so limits and windings never cost a turn of it


def test_a_seed_a_hair_past_the_limit_of_wrist_3_costs_a_hair():
    seed = TCP.axis_goal(PLACE, DOWN, TCP.arm.home).q
    for past in (np.pi + 1e-3, -np.pi - 1e-3, np.pi + 3.0):
        seed[5] = past
        result = TCP.axis_goal(PLACE, DOWN, seed)
        assert result.success
        assert TCP.within_limits(result.q)
        assert np.abs(result.q - seed).max() == pytest.approx(abs(past) - np.pi, abs=1e-12)


@pytest.mark.parametrize("wrist_3", [1.5, -3.0, 0.4])
def test_a_narrow_wrist_3_refuses_no_tool_direction(wrist_3):
    kin = URKinematics(narrow(wrist_3=(-1.0, 1.0)), tip="tcp", base="world")
    seed = np.array([*kin.arm.home[:5], wrist_3])
    result = kin.axis_goal(PLACE, DOWN, seed)
    assert result.success
    assert result.q[5] == np.clip(wrist_3, -1.0, 1.0)
    assert len(kin.axis_solutions(PLACE, DOWN)) == 8
    away = URKinematics(narrow(wrist_3=(0.5, 1.0)), tip="tcp", base="world")
    assert (away.axis_solutions(PLACE, DOWN).q[:, 5] == 0.5).all()


# sin q5 = 0


@pytest.mark.parametrize(
    "limits",
    [
        {"wrist_3": (-1.0, 1.0)},
        {"wrist_3": (0.5, 1.5)},
        {"wrist_1": (-1.0, 1.0), "wrist_3": (-1.0, 1.0)},
        {"shoulder_lift": (-2.0, -0.5), "elbow": (0.2, 2.0), "wrist_1": (-1.5, 0.5)},
        {"wrist_1": (0.2, 1.2), "wrist_3": (-6.0, 6.0)},
    ],
)
def test_a_posture_within_narrow_limits_is_found_at_a_free_wrist(limits):
    kin = URKinematics(narrow(**limits))
    rng, covered = np.random.default_rng(0), 0
    for _ in range(25):
        q = rng.uniform(kin.lower, kin.upper)
        q[4] = 0.0 if rng.random() < 0.5 else np.pi * rng.choice([-1.0, 1.0])
        T = kin.fk(q)
        solutions = kin.all_solutions(T)
        assert solutions.status is Status.OK
        assert solutions.residual.max() < 1e-7
        assert all(kin.within_limits(each) for each in solutions.q)
        np.testing.assert_allclose(kin.nearest(T, q).q[:4], q[:4], atol=1e-6)
        batch = kin.batch(T[None])
        np.testing.assert_array_equal(np.flatnonzero(batch.valid[0]), solutions.branch)
        np.testing.assert_allclose(batch.q[0, solutions.branch], solutions.q, rtol=0, atol=1e-9)
        assert kin.nearest_batch(T[None], q).success.all()
        covered += 1
    assert covered == 25


@pytest.mark.parametrize("wanted", [1.5, -1.5, 0.3])
def test_a_free_wrist_3_stops_at_its_limit_on_the_seeds_side(wanted):
    kin = URKinematics(narrow(wrist_3=(-1.0, 1.0)))
    seed = np.array([0.3, -1.0, 1.2, 0.4, 0.0, wanted])
    T = kin.fk(np.array([*seed[:5], 0.2]))
    for q in (kin.nearest(T, seed).q, kin.nearest_batch(T[None], seed).q[0]):
        assert q[5] == pytest.approx(np.clip(wanted, -1.0, 1.0), abs=1e-6)
        np.testing.assert_allclose(kin.fk(q), T, atol=1e-9)


@pytest.mark.parametrize(
    ("tol", "nearest_s5", "digits"), [(1e-7, -6.95, 13), (1e-9, -8.95, None), (1e-7, -4.5, 13), (1e-9, -3.0, None)]
)
def test_no_residual_beyond_the_tolerance_near_a_free_wrist(tol, nearest_s5, digits):
    rng, covered = np.random.default_rng(0), 0
    poses = []
    for _ in range(600):
        q = rng.uniform(-np.pi, np.pi, 6)
        q[4] = rng.choice([0.0, np.pi]) + rng.choice([-1.0, 1.0]) * 10 ** rng.uniform(nearest_s5, nearest_s5 + 1.0)
        T = FLANGE.fk(q)
        poses.append(T if digits is None else np.round(T, digits))
        solutions = FLANGE.all_solutions(poses[-1], tol=tol)
        assert len(solutions) >= 1
        assert solutions.residual.max() <= tol
        covered += len(solutions)
    assert covered > 1600
    batch = FLANGE.batch(np.array(poses), tol=tol)
    i, branch = np.nonzero(batch.valid)
    assert np.abs(FLANGE.fk(batch.q[i, branch]) - np.array(poses)[i]).max() <= 2 * tol


# batch and single


@pytest.mark.parametrize("joint", ["elbow folded", "elbow stretched", "wrist", "shoulder", "anywhere"])
def test_a_batch_gives_what_single_poses_give(joint):
    rng = np.random.default_rng(1)
    q = rng.uniform(-3.1, 3.1, (250, 6))
    away = rng.choice([-1.0, 1.0], 250) * 10 ** rng.uniform(-9, -1, 250)
    if joint == "elbow folded":
        q[:, 2] = np.pi - np.abs(away)
    elif joint == "elbow stretched":
        q[:, 2] = away
    elif joint == "wrist":
        q[:, 4] = away
    T = FLANGE.fk(q)
    if joint == "shoulder":
        g = FLANGE.geometry
        p5 = T[:, :3, 3] - g.d6 * T[:, :3, 2]
        T[:, :2, 3] += p5[:, :2] * (g.d4 * (1 + np.abs(away)) / np.linalg.norm(p5[:, :2], axis=1) - 1)[:, None]
    batch = FLANGE.batch(T)
    seeds = rng.uniform(-3.1, 3.1, (250, 6))
    nearest = FLANGE.nearest_batch(T, seeds)
    compared = 0
    for i, pose in enumerate(T):
        solutions = FLANGE.all_solutions(pose)
        np.testing.assert_array_equal(np.flatnonzero(batch.valid[i]), solutions.branch)
        np.testing.assert_allclose(batch.q[i, solutions.branch], solutions.q, rtol=0, atol=1e-9)
        alone = FLANGE.nearest(pose, seeds[i])
        assert alone.success == nearest.success[i]
        if alone.success:
            np.testing.assert_allclose(nearest.q[i], alone.q, rtol=0, atol=1e-9)
        compared += len(solutions)
    assert compared > 375


# limits and windings


@pytest.mark.parametrize("joint", range(6))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_of_two_ends_of_a_turn_the_seeds_is_taken(joint, sign):
    q = np.array([0.4, -1.1, 0.9, 0.3, 1.2, -0.5])
    q[joint] = sign * np.pi
    T = FLANGE.fk(q)
    seed = q + 0.01 * np.arange(-3, 3)
    seed[joint] = sign * (np.pi - 0.01)
    for found in (FLANGE.nearest(T, seed).q, FLANGE.nearest_batch(T[None], seed).q[0]):
        assert found[joint] == pytest.approx(q[joint], abs=1e-7)
        if joint != 4:  # there wrist_3 is free and keeps the seed's value
            np.testing.assert_allclose(found, q, atol=1e-7)


@pytest.mark.parametrize("joint", range(6))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_millionth_of_a_radian_outside_is_outside(joint, sign):
    kin, checker = ArmKinematics("ur5-thesis"), CollisionChecker("ur5-thesis")
    q = np.tile(kin.arm.home, (6, 1))
    q[:, joint] = sign * (kin.upper[joint] + np.array([-1e-6, 5e-10, 2e-9, 1e-8, 1e-7, 9e-7]))
    outside = [False, False, True, True, True, True]
    assert (checker.causes(q) == Cause.LIMITS).tolist() == outside
    assert [not kin.within_limits(row) for row in q] == outside
    assert [kin.arm.joints[joint] in kin.joints_outside_limits(row) for row in q] == outside


# threads


@pytest.mark.parametrize("make", [lambda kin: kin, LevenbergMarquardtSolver, QPSolver])
def test_threads_may_share_kinematics(make):

    before = sys.getswitchinterval()
    kin = URKinematics("ur5-thesis", tip="tcp", base="world")
    solver = make(kin)
    q = np.random.default_rng(0).uniform(-3, 3, (100, 6))
    home = np.array(kin.arm.home)

    def answers(posture):
        T = kin.fk(posture)
        found = solver.solve(PoseGoal(T), home)
        return [T, kin.jacobian(posture), found.q, np.array([found.position_error])]

    expected = [answers(posture) for posture in q]
    wrong = []

    def work(start):
        for i in range(start, 100, 8):
            wrong.extend(not np.array_equal(a, b) for a, b in zip(answers(q[i]), expected[i], strict=True))

    sys.setswitchinterval(1e-6)
    try:
        for _ in range(2):
            threads = [threading.Thread(target=work, args=(k,)) for k in range(8)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
    finally:
        sys.setswitchinterval(before)
    assert len(wrong) == 2 * 100 * 4
    assert not any(wrong)


@pytest.mark.parametrize("arm", ["ur5e", "calibrated"])
def test_threads_change_no_bit(arm):
    file = Path(__file__).parents[1] / "data/calibrations/controller_calibration_ur5e.conf"
    kin = URKinematics(arm) if arm == "ur5e" else URKinematics.from_calibration(file, model="ur5e")
    rng, compared = np.random.default_rng(4), 0
    T = kin.fk(rng.uniform(-3, 3, (997, 6)))
    T[::5] = kin.fk(rng.uniform(-3, 3, (200, 6)) * (1, 1, 0, 1, 1, 1))
    T[::7, :3, :3] += 1e-9  # not quite rotations
    seeds = rng.uniform(-6, 6, (997, 6))
    one, nearest = kin.batch(T), kin.nearest_batch(T, seeds)
    for threads in (2, 3, 16, 1000):
        many, near = kin.batch(T, threads=threads), kin.nearest_batch(T, seeds, threads=threads)
        for a, b in ((one.q, many.q), (one.valid, many.valid), (nearest.q, near.q), (nearest.branch, near.branch)):
            np.testing.assert_array_equal(a, b)
            compared += 1
    assert compared == 16
    alone = [kin.all_solutions(pose) for pose in T[:100]]
    for k, found in enumerate(alone):
        np.testing.assert_array_equal(found.q, one.q[k, found.branch])
    for threads in (0, 1.5, 10**6):
        with pytest.raises(InputError, match="threads"):
            kin.batch(T, threads=threads)
