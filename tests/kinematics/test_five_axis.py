"""Arms of four and five axes: the point exactly, the orientation or the direction as near as it goes."""

import math
import pickle

import numpy as np
import pytest
from scipy.optimize import minimize

from kinreach._rotations import wrapped
from kinreach.errors import InputError
from kinreach.kinematics import (
    ArmKinematics,
    AxisGoal,
    ClosedFormSolver,
    CollisionChecker,
    FiveAxisKinematics,
    IKResult,
    LevenbergMarquardtSolver,
    NearestOrientationGoal,
    PlacoSolver,
    PoseGoal,
    PositionGoal,
    QPSolver,
    SixAxisKinematics,
    Status,
)
from tests.kinematics.five_axis_arms import (
    FIGURES,
    kinematics_of,
    orientations,
    owned,
    random_joints,
    random_pitched_joints,
)
from tests.kinematics.stationary_oracle import Oracle


@pytest.fixture(scope="module", params=sorted(FIGURES))
def kin(request, tmp_path_factory):
    return owned(tmp_path_factory.mktemp("arm"), request.param)


def poses_of(kin, rng, count):
    """Poses with points that the arm reaches within its limits, of any orientation."""
    T = kin.fk(rng.uniform(np.maximum(kin.lower, -np.pi), np.minimum(kin.upper, np.pi), (count, kin.n)))
    for pose in T:
        pose[:3, :3] = orientations(rng)
    return T


def stationary(kin, T, *, axis_only):
    """All stationary postures without limits, of a pose or of its point and z axis."""
    return kin.axis_solutions(T[:3, 3], T[:3, 2], limits=False) if axis_only else kin.all_solutions(T, limits=False)


def apart(q, others, free=None):
    """The largest difference of a joint from each of other postures, but for one that is free."""
    off = np.abs(wrapped(others - q)).reshape(-1, len(q))
    if free is not None:
        off[:, free] = 0.0
    return off.max(axis=1)


def test_the_class_is_chosen_by_the_number_of_joints(kin):
    assert isinstance(kin, FiveAxisKinematics)
    assert kin.knows_all_postures
    assert kin.solved == "by a search over one angle"
    assert kin.n in (4, 5)


def test_every_posture_meets_the_point_and_is_stationary(kin):
    rng, seen = np.random.default_rng(0), {}
    for T in poses_of(kin, rng, 6):
        for axis_only in (False, True):
            goal = AxisGoal(T[:3, 3], T[:3, 2]) if axis_only else NearestOrientationGoal(T)
            found, oracle = stationary(kin, T, axis_only=axis_only), Oracle(kin, T, axis_only=axis_only)
            assert len(found)
            for solution, kind, left in zip(found, found.kind, found.left, strict=True):
                errors = goal.error(kin.fk(solution.q))
                assert errors[0] < 1e-9
                assert (solution.position_error, solution.orientation_error) == pytest.approx(errors, abs=1e-12)
                assert left == solution.orientation_error
                trace, gradient, J, *_ = oracle.derivatives(solution.q[None])
                along = np.linalg.svd(J[0].T)[2][3:]  # motions that leave the tip at its point
                assert np.abs(along @ gradient[0]).max() < 1e-7
                # beside it the trace grows or falls as the kind says
                ways = np.vstack([along, -along, along.sum(axis=0)])
                grows = oracle.derivatives(_at_the_point(oracle, solution.q + 1e-4 * ways, 3))[0] - trace[0]
                if max(np.abs(grows)) > 1e-10:
                    expected = {"minimum": max(grows) < 1e-12, "maximum": min(grows) > -1e-12, "saddle": True}
                    assert expected[kind]
                    seen[kind] = seen.get(kind, 0) + 1
            assert list(found.left) == pytest.approx(sorted(found.left), abs=1e-7)
    assert seen["minimum"] > 20
    assert seen["maximum"] > 5


def _at_the_point(oracle, q, steps):
    """Postures near by that have the tip at its point again."""
    for _ in range(steps):
        _, _, J, away, *_ = oracle.derivatives(q)
        q = q + np.einsum("mir,mr->mi", np.linalg.pinv(J.swapaxes(1, 2)), away)
    return q


def test_the_posture_of_a_pose_is_found_with_nothing_left(kin):
    rng, found = np.random.default_rng(1), 0
    for q in rng.uniform(np.maximum(kin.lower, -np.pi), np.minimum(kin.upper, np.pi), (60, kin.n)):
        T = kin.fk(q)
        solutions = kin.all_solutions(T)
        exact = solutions.left < 1e-7
        assert apart(q, solutions.q[exact]).min() < 1e-5
        assert all(kind == "minimum" for kind in np.array(solutions.kind)[exact])
        result = kin.nearest(T, q)
        assert result.success
        np.testing.assert_allclose(result.q, q, atol=1e-5)
        found += 1
    assert found == 60


@pytest.mark.parametrize("axis_only", [False, True])
def test_none_is_missed_of_those_from_many_starts(kin, axis_only):
    rng, tried = np.random.default_rng(2), 0
    for T in poses_of(kin, rng, 2):
        found = stationary(kin, T, axis_only=axis_only)
        free = kin.n - 1 if axis_only and kin._five.pointer.last_turns_tip else None
        for q in Oracle(kin, T, axis_only=axis_only).stationary(rng, 80)[0]:
            assert apart(q, found.q, free).min() < 1e-4
            tried += 1
    assert tried >= (4 if axis_only else 8)


def found_by_many_starts(kin, T, rng, starts):
    """How many stationary postures of a pose Newton's method finds; the kinematics have each, exactly at its point."""
    found = kin.all_solutions(T, limits=False)
    assert found.residual[:, 0].max() < 1e-9
    every = Oracle(kin, T).stationary(rng, starts)[0]
    for q in every:
        assert apart(q, found.q).min() < 1e-4
    return len(every)


@pytest.mark.parametrize("n", [4, 5])
def test_none_is_missed_of_arms_of_random_geometry(n, tmp_path):
    rng, tried = np.random.default_rng(n), 0
    for _ in range(4):
        kin = kinematics_of(tmp_path, *random_joints(n, rng))
        assert kin.solved == "by a search over two angles"
        for T in poses_of(kin, rng, 1):
            tried += found_by_many_starts(kin, T, rng, 120)
    assert tried > 13


def test_none_is_missed_of_arms_with_three_parallel_axes(tmp_path):
    """Of any size; and next to half a turn on a Koch, where the error's slope changes sign three times in 9 degrees;
    and with the elbow straight, where two postures are about to merge."""
    arms = [random_pitched_joints(4 + seed % 2, np.random.default_rng([seed, 19])) for seed in range(8)]
    tried = 0
    merging = random_pitched_joints(5, np.random.default_rng([147, 18]))
    for seed, figures in [*enumerate(arms), (865, FIGURES["koch"]), (1391, merging)]:
        rng = np.random.default_rng([seed, 17])
        kin = kinematics_of(tmp_path, *figures)
        assert kin.solved == "by a search over one angle"
        T = kin.fk(rng.uniform(-np.pi, np.pi, kin.n))
        T[:3, :3] = orientations(rng)
        tried += found_by_many_starts(kin, T, rng, 60)
    assert tried > 50


#: Seed of an arm with three parallel axes, number of a pose, and a posture [rad] hard to see between samples.
HIDDEN = [
    (7, 32, (-2.75, -0.559, 1.892, -2.53, 1.499)),  # elbow straight, beside two postures at half a turn
    (33, 79, (-1.544, -0.549, 1.474, 2.867, 2.777)),
    (59, 30, (-0.376, 1.645, -2.145, 1.478, -1.554)),
    (9, 86, (-1.184, 2.419, 0.425, 3.042, 0.978)),  # a pair that is about to merge, each with two elbows
    (9, 86, (-1.145, -2.977, -1.634, -2.106, 1.0)),
    (66, 41, (0.516, -1.495, -2.154, 2.177, 0.398)),  # next to where joint 1 turns back
    (199, 88, (1.131, -2.668, 1.927, 1.711, 0.467)),
    (145, 90, (-1.989, 0.115, 1.091, -0.578, 1.693)),  # on a small loop, with two links of nearly one length
    (189, 8, (0.956, 0.454, 2.779, -2.345, -0.875)),
    (189, 57, (-0.37, -2.232, 2.779, 2.727, -0.402)),
]


def test_what_is_between_two_samples_is_found(tmp_path):
    tried = 0
    for seed, number, q in HIDDEN:
        rng = np.random.default_rng([seed, 99])
        kin = kinematics_of(tmp_path, *random_pitched_joints(5, rng))
        for _ in range(number + 1):
            T = kin.fk(rng.uniform(-np.pi, np.pi, kin.n))
            T[:3, :3] = orientations(rng)
        found = kin.all_solutions(T, limits=False)
        assert apart(np.array(q), found.q).min() < 1e-3, (seed, number)
        tried += 1
    assert tried == len(HIDDEN)


#: Number of a pose of `tools.endurance.five_axes`, and a posture [rad] on a small surface, or loop, between points of
#: the grid.
SMALL = [
    (226, (1.257, 1.036, -2.306, 1.356, 0.678)),
    (226, (1.313, 0.896, -2.246, 1.082, 0.783)),
    (1934, (-0.163, 2.731, -1.303, -3.086, -0.284)),
    (8334, (2.528, 2.598, -1.708, 0.163, -0.956)),
    (8334, (2.533, 2.673, -1.753, -0.196, -1.095)),
    (30280, (-0.6135, 2.3667, 0.6299, 1.5999)),
    (30280, (1.1183, -2.273, 1.3551, -1.3508)),
]


def test_surfaces_between_points_of_the_grid_are_found(tmp_path):
    tried = 0
    for number, q in SMALL:
        rng = np.random.default_rng([number, 17])
        kin = kinematics_of(tmp_path, *random_joints(len(q), np.random.default_rng([number // 2 % 200, 18])))
        T = kin.fk(rng.uniform(-np.pi, np.pi, kin.n))
        T[:3, :3] = orientations(rng)
        assert apart(np.array(q), kin.all_solutions(T, limits=False).q).min() < 1e-3, number
        tried += 1
    assert tried == len(SMALL)


def test_next_to_where_joint_1_turns_back_rounding_loses_none(tmp_path):
    """There the multipliers are large, and the last steps of Newton's method are rounding."""
    rng = np.random.default_rng([4067, 17])  # a pose of `tools.endurance.five_axes`
    kin = kinematics_of(tmp_path, *random_pitched_joints(4, np.random.default_rng([16, 18])))
    T = kin.fk(rng.uniform(-np.pi, np.pi, kin.n))
    T[:3, :3] = orientations(rng)
    found = kin.all_solutions(T, limits=False)
    first = np.unique(found.q[:, 0].round(6))
    assert len(found) == 8
    assert len(first) == 2
    assert np.ptp(first) < 2e-4
    assert all(np.isclose(found.q[:, 0], each, atol=1e-6).sum() == 4 for each in first)
    assert found.residual[:, 0].max() < 1e-9
    assert apart(np.array((1.912953, 2.410629, -0.253409, -0.664491)), found.q).min() < 1e-4


def test_minima_at_limits_are_those_of_what_the_limits_allow(kin):
    """Small motions within the limits, after which the tip is at its point again, never leave less."""
    rng, tried, at_limits = np.random.default_rng(3), 0, 0
    for T in poses_of(kin, rng, 8):
        found, oracle = kin.all_solutions(T), Oracle(kin, T)
        assert not any(kin.joints_outside_limits(q) for q in found.q)
        for q, kind in zip(found.q, found.kind, strict=True):
            at_limit = np.minimum(np.abs(q - kin.lower), np.abs(q - kin.upper)) < 1e-9
            assert kind != "minimum at a limit" or at_limit.any()
            if not kind.startswith("minimum"):
                continue
            at_limits += at_limit.any()
            best, _, J, *_ = oracle.derivatives(q[None])
            along = np.linalg.svd(J[0].T)[2][3:]
            beside = _at_the_point(oracle, q + 1e-3 * rng.normal(size=(20, len(along))) @ along, 4)
            traces, _, _, away, *_ = oracle.derivatives(beside)
            there = ~kin.past_limits(beside).any(axis=1) & (np.linalg.norm(away, axis=1) < 1e-11)
            assert (traces[there] < best[0] + 1e-10).all()
            tried += np.count_nonzero(there)
    assert tried > 100
    assert at_limits > 3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["so101", "koch"])
def test_within_limits_no_optimiser_finds_less(name, tmp_path):
    kin, rng, runs = owned(tmp_path, name), np.random.default_rng(3), 0
    for T in poses_of(kin, rng, 3):
        minima = kin.all_solutions(T).minima
        for q, trace in zip(*Oracle(kin, T).least_within_limits(rng, 5), strict=True):
            assert minima.left[0] <= math.acos(max(-1.0, min(1.0, (trace - 1) / 2))) + 1e-6
            assert apart(q, minima.q).min() < 2e-2
            runs += 1
    assert runs >= 5


def test_exact_directions_are_those_of_the_arm_with_a_sixth_joint_about_the_tips_axis(tmp_path):
    """Every posture with the tip's z axis along a direction, by another way: elimination on six axes."""
    rng, tried = np.random.default_rng(4), 0
    for number in range(8):
        joints, tip = FIGURES["so101"] if number < 2 else random_joints(5, rng)
        joints = [(place, axis, -np.pi, np.pi) for place, axis, *_ in joints]
        five = kinematics_of(tmp_path, joints, tip, "five")
        six = kinematics_of(tmp_path, [*joints, (tip, "0 0 1", -np.pi, np.pi)], (0,) * 6, "six")
        assert isinstance(six, SixAxisKinematics)
        for q in rng.uniform(-np.pi, np.pi, (3, 6)):
            T = six.fk(q)
            expected = six.all_solutions(T).q[:, :5]
            found = five.axis_solutions(T[:3, 3], T[:3, 2])
            exact = found.q[found.left < 1e-7]
            assert len(exact) == len(expected)
            assert all(apart(each, exact).min() < 1e-5 for each in expected)
            tried += len(expected)
    assert tried > 60


def test_a_pose_that_has_to_be_met_exactly_is_refused_with_what_is_left(kin):
    rng, refused = np.random.default_rng(5), 0
    for T in poses_of(kin, rng, 10):
        result = kin.solve(NearestOrientationGoal(T), kin.arm.home)
        assert result.success
        assert IKResult.of(kin, NearestOrientationGoal(T), result.q).success
        exact = ClosedFormSolver(kin).solve(PoseGoal(T), kin.arm.home)
        assert exact.orientation_error == pytest.approx(result.orientation_error, abs=1e-7)
        if exact.orientation_error > 1e-3:
            assert exact.status is Status.OUT_OF_REACH
            assert f"{kin.n} joints leave {exact.orientation_error:.3g} rad" in exact.reason
            assert not IKResult.of(kin, PoseGoal(T), exact.q).success
            refused += 1
        point = kin.solve(PositionGoal(T[:3, 3]), kin.arm.home)
        assert point.success
        assert point.orientation_error == 0.0
        assert point.position_error < 1e-9
        same = kin.nearest(T[:3, 3], kin.arm.home)
        np.testing.assert_array_equal(point.q, same.q)
    assert refused > 5


def test_others_say_that_they_do_not_solve_it(kin):
    goal = NearestOrientationGoal(poses_of(kin, np.random.default_rng(13), 1)[0])
    for solver in (LevenbergMarquardtSolver, QPSolver, PlacoSolver):
        with pytest.raises(InputError, match="solved by the kinematics of an arm with four or five joints"):
            solver(kin).solve(goal, kin.arm.home)
    with pytest.raises(InputError, match="goal must be a PoseGoal, an AxisGoal or a PositionGoal, got"):
        kin.solve("home", kin.arm.home)
    six = ArmKinematics.of("ur5e")
    with pytest.raises(InputError, match="solved by the kinematics of an arm with four or five joints"):
        six.solve(NearestOrientationGoal(six.fk(six.arm.home)), six.arm.home)
    found = kin.all_solutions(goal.T)
    assert found.singularity.tolist() == [0] * len(found) != []
    assert repr(found) == f"NearestSolutions({len(found)} postures, status={found.status})"


def test_refused_postures_lead_to_the_next_and_nearest_is_near(kin):
    rng = np.random.default_rng(6)
    several = 0
    for T in poses_of(kin, rng, 10):
        minima = kin.all_solutions(T, seed=kin.arm.home).minima
        refused = []

        def accept(q, refused=refused):
            refused.append(q)
            return len(refused) == 2

        result = kin.nearest(T, kin.arm.home, accept=accept)
        if len(minima) > 1:
            np.testing.assert_array_equal(result.q, minima.q[1])
            several += 1
        assert kin.nearest(T, kin.arm.home, accept=lambda q: False).status is Status.REJECTED
        np.testing.assert_array_equal(kin.nearest(T, kin.arm.home).q, minima.q[0])
        for q in minima.q:  # with a margin the posture stays where it is
            np.testing.assert_allclose(kin.nearest(T, q, margin=math.inf).q, q, atol=1e-9)
    assert several > 3
    with pytest.raises(InputError, match="margin"):
        kin.nearest(T, kin.arm.home, margin=-1.0)


@pytest.mark.parametrize("margin", [0.2, 0.5, 0.9])
def test_within_a_margin_of_the_least_the_nearest_posture_is_taken(kin, margin):
    rng, others, farther = np.random.default_rng(12), 0, 0
    for T in poses_of(kin, rng, 30):
        seed = rng.uniform(*kin.sampling_limits)
        minima = kin.all_solutions(T, seed=seed).minima
        if not len(minima):
            continue
        allowed = minima.q[minima.left <= minima.left.min() + margin]
        away = np.linalg.norm(allowed - seed, axis=1)
        found = kin.nearest(T, seed, margin=margin)
        np.testing.assert_array_equal(found.q, allowed[away.argmin()])
        others += found.orientation_error > minima.left.min() + 1e-6
        farther += np.linalg.norm(minima.q - seed, axis=1).min() < away.min()
    assert others >= 2
    assert farther >= 1


def test_a_path_is_followed_without_jumps(kin):
    """The tip goes around a circle in steps of 2 degrees while its wanted orientation stays."""
    rng, steps = np.random.default_rng(7), 0
    for _ in range(3):
        q = (0.55 * kin.lower + 0.45 * kin.upper) / max(1.0, np.abs(kin.upper).max() / np.pi) + rng.uniform(
            -0.1, 0.1, kin.n
        )
        T = kin.fk(q)
        centre, radius = T[:3, 3] - [0.02, 0.0, 0.0], 0.02
        for angle in np.radians(np.arange(0.0, 361.0, 2.0)):
            T[:3, 3] = centre + radius * np.array([math.cos(angle), math.sin(angle), 0.0])
            result = kin.nearest(T, q, margin=math.inf)
            assert result.success
            assert np.abs(result.q - q).max() < 0.15
            q = result.q
            steps += 1
    assert steps > 500


def test_batches_give_what_single_poses_give(kin):
    T = poses_of(kin, np.random.default_rng(8), 12)
    T[3, :3, 3] = 5.0
    found, nearest = kin.batch(T), kin.nearest_batch(T, kin.arm.home)
    for row, pose in enumerate(T):
        one = kin.all_solutions(pose)
        assert found.valid[row].sum() == len(one)
        np.testing.assert_array_equal(found.q[row, : len(one)], one.q)
        each = kin.nearest(pose, kin.arm.home)
        assert nearest.success[row] == each.success == (row != 3)
        if each.success:
            np.testing.assert_array_equal(nearest.q[row], each.q)
    assert np.isnan(nearest.q[3]).all()
    points = np.delete(T, 3, axis=0)[:, :3, 3]
    for row, point in enumerate(points):  # with the orientation of the seed
        np.testing.assert_array_equal(
            kin.nearest_batch(points, kin.arm.home).q[row], kin.nearest(point, kin.arm.home).q
        )


def test_windings_are_those_nearest_to_the_seed(tmp_path):
    kin, rng = owned(tmp_path, "xarm5"), np.random.default_rng(9)
    turned = 0
    for T in poses_of(kin, rng, 10):
        seed = np.array([5.0, 0.0, -1.0, 0.5, -5.0])
        for q in kin.all_solutions(T, seed=seed).q:
            assert kin.within_limits(q)
            for joint in (0, 4):
                others = [a for a in q[joint] + 2 * np.pi * np.arange(-3, 4) if abs(a) <= 2 * np.pi]
                assert q[joint] == pytest.approx(min(others, key=lambda a, j=joint: abs(a - seed[j])))
                turned += abs(q[joint]) > np.pi
    assert turned > 20


def test_why_there_is_none(kin):
    far = np.eye(4)
    far[:3, 3] = 3.0, 0.0, 0.3
    found = kin.all_solutions(far)
    assert found.status is Status.OUT_OF_REACH
    assert "the tip does not come to this point, " in found.reason
    assert kin.nearest(far, kin.arm.home).status is Status.OUT_OF_REACH
    assert kin.solve(AxisGoal(far[:3, 3], [0, 0, -1]), kin.arm.home).status is Status.OUT_OF_REACH
    outside, rng = 0, np.random.default_rng(10)
    for q in rng.uniform(-np.pi, np.pi, (300, kin.n)):
        found = kin.all_solutions(kin.fk(q))
        if not found.success:
            assert found.status is Status.OUT_OF_LIMITS
            assert "are outside the joint limits (j" in found.reason
            assert kin.all_solutions(kin.fk(q), limits=False).success
            outside += 1
    assert outside >= 3
    for wrong in (np.eye(3), np.full((4, 4), np.nan), [1.0, 2.0]):
        with pytest.raises(InputError, match="T"):
            kin.all_solutions(wrong)
    with pytest.raises(InputError, match="seed"):
        kin.all_solutions(far, seed=[0.0] * 7)


def test_the_edge_of_reach_is_reached(kin):
    """The tip as far from joint 2 as the joints after it bring it: there postures of both elbows merge."""
    reached, rng = 0, np.random.default_rng(11)

    def near(bend, q):
        kin.fk(np.concatenate([q[:2], bend, q[4:]]))
        return -np.linalg.norm(kin.data.oMf[kin.tip_frame].translation - kin.data.oMi[2].translation)

    for q in rng.uniform(-np.pi, np.pi, (8, kin.n)):
        starts = [minimize(near, rng.uniform(-np.pi, np.pi, 2), args=(q,), tol=1e-14) for _ in range(4)]
        q[2:4] = min(starts, key=lambda found: found.fun).x
        found = kin.all_solutions(kin.fk(q), limits=False)
        reached += found.success and found.residual[:, 0].max() < 1e-7 and found.left[0] < 1e-3
        off = np.linalg.norm(kin.fk(found.q)[:, :3, 3] - kin.fk(q)[:3, 3], axis=1)
        np.testing.assert_allclose(found.residual[:, 0], off, rtol=0, atol=1e-12)
    assert reached == 8


def test_it_can_be_pickled_and_postures_too(kin):
    T = poses_of(kin, np.random.default_rng(12), 1)[0]
    again, found = pickle.loads(pickle.dumps(kin)), kin.all_solutions(T)
    np.testing.assert_array_equal(again.all_solutions(T).q, found.q)
    copy = pickle.loads(pickle.dumps(found))
    assert copy.kind == found.kind
    np.testing.assert_array_equal(copy.left, found.left)
    assert len(copy.minima) == len(found.minima)


def test_arms_of_other_kinds_are_refused(tmp_path):
    for n in (3, 6):
        joints, tip = random_joints(n, np.random.default_rng(0))
        arm = kinematics_of(tmp_path, joints, tip).arm
        with pytest.raises(InputError, match=rf"has {n} joints; four or five are needed"):
            FiveAxisKinematics(arm)
    parallel = [((0.1, 0, 0, 0, 0, 0), "0 0 1", -3, 3)] * 5
    plain = kinematics_of(tmp_path, parallel, (0.1, 0, 0, 0, 0, 0))
    assert type(plain) is ArmKinematics
    assert "singular in every posture" in plain.no_closed_form


@pytest.mark.parametrize("name", ["so101", "wx250", "xarm5"])
def test_a_roll_that_is_free_stays_at_the_seed(name, tmp_path):
    """Straight down, joint 1 makes up for what an offset tip is moved by joint 5, whatever its angle."""
    kin, rng, tried = owned(tmp_path, name), np.random.default_rng(14), 0
    for _ in range(40):
        r, turn = rng.uniform(0.1, 0.25), rng.uniform(-1, 1)
        seed = np.array(kin.arm.home)
        seed[-1] = rng.uniform(max(-1.5, kin.lower[-1]), min(1.5, kin.upper[-1]))
        point = [r * math.cos(turn), r * math.sin(turn), 0.05]
        found = kin.axis_solutions(point, [0, 0, -1], seed=seed, limits=False)
        if len(found) and found.left[0] < 1e-6:
            exact = found.q[found.left < 1e-6]
            assert np.abs(wrapped(exact[:, -1] - seed[-1])).min() < 0.02
            assert found.residual[0].max() < 1e-9
            tried += 1
    assert tried > 10


@pytest.mark.parametrize("name", ["wx250", "vx300", "xarm5"])
def test_a_roll_is_free_in_files_with_few_digits(name, tmp_path):
    """With 1.5708 for a right angle the tip is 4e-6 rad off the last axis, which decides about no roll."""
    joints, tip = FIGURES[name]
    few = [((*place[:3], *np.round(place[3:], 4)), *rest) for place, *rest in joints], (*tip[:3], *np.round(tip[3:], 4))
    exact, rounded = owned(tmp_path, name), kinematics_of(tmp_path, *few, name=f"{name}_rounded")
    rng, tried = np.random.default_rng(15), 0
    for q in rng.uniform(exact.lower, exact.upper, (30, exact.n)):
        axis, seed, point = rng.normal(size=3), rng.uniform(exact.lower, exact.upper), rounded.fk(q)[:3, 3]
        ours, theirs = (kin.axis_solutions(point, axis, seed=seed, limits=False) for kin in (rounded, exact))
        assert len(ours) > 0
        np.testing.assert_array_equal(ours.q[:, -1], seed[-1])
        assert ours.residual[:, 0].max() < 1e-9
        if len(ours) == len(theirs):
            np.testing.assert_allclose(ours.left, theirs.left, atol=1e-3)
            tried += 1
    assert tried >= 25


@pytest.mark.parametrize("name", ["so101", "koch"])
def test_a_direction_that_is_met_with_a_joint_at_its_limit_is_found(name, tmp_path):
    """The same posture without the limit is past it by rounding; it must not take the place of this one."""
    kin, rng, tried = owned(tmp_path, name), np.random.default_rng(7), 0
    for number in range(600):
        q = rng.uniform(kin.lower, kin.upper)
        joint = number % 4 + 1 if number % 2 else 3
        q[joint] = (kin.lower, kin.upper)[rng.integers(2)][joint]
        T = kin.fk(q)
        found = kin.axis_solutions(T[:3, 3], T[:3, 2])
        assert found.left[0] < 1e-6, q
        tried += 1
    assert tried == 600


def test_where_the_seeds_orientation_is_refused_a_point_is_met_with_another():
    """Low over the table the jaws cannot be ahead, as at home."""
    kin, seed = ArmKinematics.of("so101", base="world"), ArmKinematics.of("so101").arm.home
    checker, turned = CollisionChecker(kin), 0
    for point in kin.arm.workcell.goals.sample(np.random.default_rng(0), 60):
        found = kin.solve(PositionGoal(point), seed, accept=checker.free)
        assert found.success, found.reason
        assert found.position_error < 1e-9
        assert checker.free(found.q)
        turned += not kin.nearest(point, seed, accept=checker.free).success
    assert turned > 10
    assert kin.solve(PositionGoal(point), seed, accept=lambda q: False).status is Status.REJECTED


def test_the_so101_is_an_arm_by_name():
    kin = ArmKinematics.of("so101")
    assert isinstance(kin, FiveAxisKinematics)
    assert kin.arm.joints == ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
    checker = CollisionChecker(kin)
    assert checker.free(kin.arm.home)
    down = kin.axis_solutions([0.25, 0.1, 0.05], [0, 0, -1], seed=kin.arm.home)
    assert down.left[0] < 1e-9
    # arm stretched out forward, jaws ahead: 0.39 m in front of the base, 0.23 m above the table
    np.testing.assert_allclose(kin.fk(kin.arm.home)[:3, 3], [0.3914, 0.0, 0.2265], atol=1e-4)
