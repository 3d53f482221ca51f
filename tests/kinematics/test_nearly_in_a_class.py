"""Six axes that nearly have a closed form, as files with rounded digits do: no posture is lost, none is wrong."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from benchmarks.ik_arms import arms
from benchmarks.ik_arms.arms import _singular, singular_poses
from benchmarks.ik_arms.random_arms import (
    CLASSES,
    OTHERS,
    Judge,
    apart,
    kinematics,
    motion,
    random_motion,
    some_arm,
    some_figures,
)
from kinreach._rotations import pose_error
from kinreach.cli import main
from kinreach.kinematics import ArmKinematics, AxisGoal
from kinreach.kinematics._general_6r import Chain, miss, missed_by
from kinreach.kinematics._six_axis import methods
from kinreach.robots._ur import nominal_robot


def placements_of(rng, name):
    """Placements of a random arm of a class, with one Denavit-Hartenberg figure off by 1e-12 to 1e-2."""
    a, d, alpha, turn = some_figures(rng, name)
    values, joint = (a, d, alpha)[rng.integers(3)], rng.integers(5)
    values[joint] += rng.choice([-1, 1]) * 10.0 ** rng.uniform(-12, -2)
    links = [motion(turn[i], d[i], a[i], alpha[i]) for i in range(5)]
    chain = [random_motion(rng, 0.3, np.pi), *links, random_motion(rng, 0.2, np.pi)]
    return np.array(list(np.linalg.inv(chain[::-1])) if rng.random() < 0.5 else chain)


def of_one(method, T):
    """All postures of one pose."""
    q, valid = method.many(T[None], np.zeros((1, 6)), 1e-7)
    return q[:, valid[:, 0], 0].T


@pytest.mark.slow
@pytest.mark.parametrize("perturbed", [1, 2])
@pytest.mark.parametrize("name", [*CLASSES, *OTHERS])
def test_every_figure_off_by_every_power_of_ten(name, perturbed):
    """Each Denavit-Hartenberg value, alone or with another one, by 1e-12 to 1e-2, of arms of 0.1, 1 and 10 m."""
    rng, poses = np.random.default_rng([len(name), perturbed, 1]), 0
    sweep = [
        (values, joint, power) for power in range(-12, -1, 2 * perturbed) for values in range(3) for joint in range(5)
    ]
    for index, (values, joint, power) in enumerate(sweep):
        figures = a, d, alpha, turn = some_figures(rng, name)
        figures[values][joint] += rng.choice([-1, 1]) * 10.0**power
        if perturbed == 2:
            figures[rng.integers(3)][rng.integers(5)] += rng.choice([-1, 1]) * 10.0 ** rng.integers(-12, -1)
        size = 10.0 ** (index % 3 - 1)
        links = [motion(turn[i], size * d[i], size * a[i], alpha[i]) for i in range(5)]
        chain = [random_motion(rng, 0.3 * size, np.pi), *links, random_motion(rng, 0.2 * size, np.pi)]
        placements = np.array(list(np.linalg.inv(chain[::-1])) if index % 2 else chain)
        method, judge = methods.method_of(placements), Judge(placements)
        assert not isinstance(method, float), (values, joint, power)
        q = rng.uniform(-np.pi, np.pi, (2, 6))
        T = np.array([judge.fk(posture) for posture in q])
        found, valid = method.many(T, np.zeros_like(q), 1e-7)
        alone = of_one(method, T[0])
        for posture, pose, postures in (
            (q[0], T[0], alone),
            *((q[pose], T[pose], found[:, valid[:, pose], pose].T) for pose in range(2)),
        ):
            assert apart(posture, postures) < 1e-5, (values, joint, power, index)
            assert max(max(pose_error(pose, judge.fk(one))) for one in postures) < 1e-9, (values, joint, power, index)
            poses += 1
    assert poses == 3 * len(sweep) == (270 if perturbed == 1 else 135)


@pytest.mark.parametrize("name", [*CLASSES, *OTHERS])
def test_no_posture_of_an_arm_near_a_class_is_lost_or_wrong(name):
    rng, poses = np.random.default_rng([len(name), 1]), 0
    for _ in range(12):
        placements = placements_of(rng, name)
        method, chain = methods.method_of(placements), Chain(placements)
        assert not isinstance(method, float)
        q = rng.uniform(-np.pi, np.pi, (6, 6))
        T = np.tile(np.eye(4), (len(q), 1, 1))
        T[:, :3] = chain.fk(q)
        found, valid = method.many(T, np.zeros_like(q), 1e-7)
        for pose, posture in enumerate(q):
            for postures in (
                found[:, valid[:, pose], pose].T,
                of_one(method, T[pose]),
            ):
                assert apart(posture, postures) < 1e-5
                off = missed_by(miss(chain.fk(postures), np.broadcast_to(T[pose], (len(postures), 4, 4))))
                assert off.max() < 1e-9
                poses += 1
    assert poses == 144


@pytest.mark.parametrize("name", CLASSES)
@pytest.mark.slow
def test_a_tip_beside_the_last_axis_meets_every_direction(name, tmp_path):
    """By up to 1e-5 m and rad, as a file with 1.5708 leaves it: the other joints make up for it, or other turns do."""
    rng, goals, few = np.random.default_rng(len(name)), 0, 0
    for tilt in (0.0, 1e-9, 3e-6):
        placements = some_arm(rng, name, off=tilt if rng.random() < 0.5 else 0.0)
        placements[6] = motion(0.0, 0.1, tilt, 0.0) @ motion(0.0, 0.0, 0.0, rng.choice([0.0, np.pi]) + tilt)
        kin = kinematics(tmp_path, placements)
        for poses in singular_poses(kin, 1).values():
            for T in poses:
                seed = rng.uniform(-3.0, 3.0, 6)
                found = kin.axis_solutions(T[:3, 3], T[:3, 2], seed=seed, limits=False)
                assert found.success
                assert found.residual.max() < 1e-7
                result = kin.solve(AxisGoal(T[:3, 3], T[:3, 2]), seed)
                assert not result.success or max(result.position_error, result.orientation_error) < 1e-7
                goals, few = goals + 1, few + (len(found) <= 16)
    assert goals >= 10
    assert few > 0.6 * goals


@pytest.mark.parametrize("name", CLASSES)
def test_no_posture_misses_where_others_reach(name):
    """Arms with one figure so small that dividing by it is inexact: what leaves the house was tried on the arm."""
    rng, poses = np.random.default_rng(len(name)), 0
    for _ in range(8):
        a, d, alpha, turn = some_figures(rng, name)
        (a, d, alpha)[rng.integers(3)][rng.integers(3)] = 10.0 ** rng.uniform(-9, -6)
        links = [motion(turn[i], d[i], a[i], alpha[i]) for i in range(5)]
        placements = np.array([random_motion(rng, 0.3, np.pi), *links, random_motion(rng, 0.2, np.pi)])
        method, chain = methods.method_of(placements), Chain(placements)
        if isinstance(method, float):
            continue
        q = rng.uniform(-np.pi, np.pi, (6, 6))
        T = np.tile(np.eye(4), (len(q), 1, 1))
        T[:, :3] = chain.fk(q)
        found, valid = method.many(T, np.zeros_like(q), 1e-7)
        smallest = np.linalg.svd(chain.jacobian(q)[1])[1][:, -1]
        for pose, (posture, least) in enumerate(zip(q, smallest, strict=True)):
            for postures in (
                found[:, valid[:, pose], pose].T,
                of_one(method, T[pose]),
            ):
                assert apart(posture, postures) < max(1e-5, 1e-12 / least)  # all postures may be nearly singular
                off = missed_by(miss(chain.fk(postures), np.broadcast_to(T[pose], (len(postures), 4, 4))))
                assert off.max() < 1e-9
                poses += 1
    assert poses >= 48


@pytest.mark.parametrize("off", [0.0, 1e-4])
@pytest.mark.parametrize("name", ["right angles", "three parallel axes, 5 and 6 meet", "no class"])
def test_what_is_just_out_of_reach_is_missed_by_no_more_than_the_tolerance(name, off, tmp_path):
    """A stretched arm whose goal is 0.03 mm farther the way in which its tip cannot go."""
    rng, goals = np.random.default_rng(len(name)), 0
    kin = kinematics(tmp_path, some_arm(rng, name, off=off))
    q = rng.uniform(-np.pi, np.pi, (4, 6))
    q[:, 2] = _singular(kin, q, 2)
    for posture in q[np.isfinite(q).all(axis=1)]:
        way = np.linalg.svd(kin.jacobian(posture))[0][:3, -1]
        for sign in (-1.0, 1.0):
            T = kin.fk(posture)
            T[:3, 3] += sign * 3e-5 * way / np.linalg.norm(way)
            if not kin.all_solutions(T, limits=False):  # it may be reached by other postures
                for limits in (False, True):
                    found = kin.all_solutions(T, seed=posture, limits=limits, tol=1e-3)
                    assert len(found)
                    off_by = np.array([pose_error(T, kin.fk(one)) for one in found.q])
                    np.testing.assert_allclose(found.residual, off_by, rtol=1e-2, atol=1e-9)
                    assert 1e-7 < off_by.max() <= 1e-3
                    assert np.abs(found.q[0] - posture).max() < 0.1
                goals += 1
    assert goals >= 1


def test_the_tolerance_holds_in_a_batch_for_a_posture_next_to_a_limit(tmp_path):
    """As above, with a limit of the first joint that the posture is past by 1e-8."""
    rng = np.random.default_rng(12)
    placements = some_arm(rng, "right angles", off=1e-4)
    kin = kinematics(tmp_path, placements)
    q = rng.uniform(-1.0, 1.0, (9, 6))
    q[0, 2] = _singular(kin, q[:1], 2)[0]
    T = kin.fk(q)
    way = np.linalg.svd(kin.jacobian(q[0]))[0][:3, -1]
    for sign in (-1.0, 1.0):
        T[0, :3, 3] = kin.fk(q[0])[:3, 3] + sign * 3e-5 * way / np.linalg.norm(way)
        if not kin.all_solutions(T[0], limits=False):
            break
    first = kin.all_solutions(T[0], seed=q[0], limits=False, tol=1e-3).q[0, 0]
    limits = np.tile([[-3.0], [3.0]], 6)
    limits[:, 0] = first - 1.0, first - 1e-8
    limited = kinematics(tmp_path, placements, limits)
    for tol, reached in ((1e-3, True), (1e-7, False)):
        alone, every = limited.all_solutions(T[0], tol=tol), limited.batch(T, tol=tol)
        assert alone.success == reached
        assert np.flatnonzero(every.valid[0]).tolist() == sorted(alone.branch)
        np.testing.assert_allclose(every.q[0][alone.branch], alone.q, rtol=0, atol=1e-9)


@pytest.mark.parametrize("digits", [3, 4, 5, 6])
def test_a_file_with_rounded_right_angles_is_solved_as_it_is(tmp_path, digits):
    """A UR whose URDF says 1.571 or 1.5708 for a right angle is no UR, by the digits that are missing."""
    file = tmp_path / "rounded.urdf"
    text = re.sub(r"1\.57079632\d*", f"{np.pi / 2:.{digits}f}", ET.tostring(nominal_robot("ur5e"), encoding="unicode"))
    file.write_text(text)
    kin = ArmKinematics.from_urdf(file, tip="tool0")
    q = np.random.default_rng(digits).uniform(-2.5, 2.5, (40, 6))
    for posture, T in zip(q, kin.fk(q), strict=True):
        found = kin.all_solutions(T)
        assert np.abs(found.q - posture).max(axis=1).min() < 1e-6
        for solution in found.q:
            assert np.abs(kin.fk(solution) - T).max() < 1e-9
        result = kin.nearest(T, posture)
        assert result.success
        assert np.abs(result.q - posture).max() < 1e-6


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("name", ["right angles", "three parallel axes"])
@pytest.mark.slow
def test_check_says_which_class_an_arm_is_nearly_in(name, backwards, tmp_path, capsys):
    """Exactly, nearly with how far poses differ, and with two axes on one line."""
    rng = np.random.default_rng(18)
    axes = {("right angles", False): "4, 5 and 6", ("right angles", True): "1, 2 and 3"}.get((name, backwards))
    axes, what = (axes, "meet in a point") if axes else ("3, 4 and 5" if backwards else "2, 3 and 4", "parallel")
    for off in (0.0, 1e-4):
        kin = kinematics(tmp_path, some_arm(rng, name, backwards=backwards, off=off))
        assert re.fullmatch(rf"axes {axes} (are )?(nearly )?{what}.*", kin.special_axes)
        assert ("nearly" in kin.special_axes) == bool(off)
        if off:
            assert off / 10 < float(re.search(r"up to (\S+) m", kin.special_axes)[1]) < 100 * off
        if name == "right angles" and backwards == bool(off):
            assert main(["check", str(tmp_path / "arm.urdf"), "--poses", "1"]) == 0
            assert kin.special_axes in capsys.readouterr().out
    placements = some_arm(rng, "no class")
    placements[3] = motion(0.3, 0.2, 0.0, 0.0)
    kin = kinematics(tmp_path, placements)
    assert kin.no_closed_form.startswith("arm 'arm' is singular in every posture: axes 3 and 4 (j3, j4) coincide;")
    placements[3] = motion(0.3, 0.2, 1e-6, 1e-6)
    assert "axes 3 and 4 (j3, j4) nearly coincide" in kinematics(tmp_path, placements).no_closed_form
    placements[2:6] = [motion(0.3, 0.1, a, 1e-7) for a in (0.2, 0.3, 0.25, 0.15)]  # five axes almost parallel
    assert "'arm': its axes make the elimination singular; of random" in kinematics(tmp_path, placements).no_closed_form


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("name", ["right angles", "three parallel axes"])
def test_the_axes_of_a_class_are_named_with_how_nearly(name, backwards, tmp_path):
    rng = np.random.default_rng(18)
    axes = {("right angles", False): "4, 5 and 6", ("right angles", True): "1, 2 and 3"}.get((name, backwards))
    axes, what = (axes, "meet in a point") if axes else ("3, 4 and 5" if backwards else "2, 3 and 4", "parallel")
    kin = kinematics(tmp_path, some_arm(rng, name, backwards=backwards))
    assert re.fullmatch(rf"axes {axes} (are )?{what}", kin.special_axes)
    assert kin.has_named_branches
    kin = kinematics(tmp_path, some_arm(rng, name, backwards=backwards, off=1e-4))
    assert re.fullmatch(rf"axes {axes} (are )?nearly {what}: poses differ by up to \S+ m or rad", kin.special_axes)
    assert 1e-5 < float(re.search(r"up to (\S+) m", kin.special_axes)[1]) < 1e-2


def test_an_arm_of_no_class_has_no_special_axes(tmp_path):
    kin = kinematics(tmp_path, some_arm(np.random.default_rng(8), "no class"))
    assert kin.special_axes == ""
    assert not kin.has_named_branches


def test_with_the_tip_almost_on_the_last_axis_a_stretched_elbow_leaves_that_joint_free(tmp_path, monkeypatch):
    """The other joints then cannot make up for it, but the pose turned by as much has the posture."""
    monkeypatch.setattr(arms, "CASES", {"elbow": arms.CASES["elbow"]})
    goals, kept = 0, 0
    for name in list(CLASSES)[:2]:
        rng = np.random.default_rng(len(name))
        placements = some_arm(rng, name)
        placements[6] = motion(0.0, 0.1, 1e-9, 0.0) @ motion(0.0, 0.0, 0.0, 1e-9)
        kin = kinematics(tmp_path, placements)
        for T in singular_poses(kin, 1)["elbow"]:
            seed = rng.uniform(-3.0, 3.0, 6)
            found = kin.axis_solutions(T[:3, 3], T[:3, 2], seed=seed, limits=False)
            assert found.success
            for q in found.q:
                tip = kin.fk(q)
                assert np.linalg.norm(tip[:3, 3] - T[:3, 3]) < 1e-7
                assert np.linalg.norm(tip[:3, 2] - T[:3, 2]) < 1e-7
                kept += abs(q[-1] - seed[-1]) < 1e-3
                goals += 1
    assert kept == goals >= 4
