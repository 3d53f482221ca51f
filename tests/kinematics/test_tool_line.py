"""Straight lines of the tool: straight, in one branch, and stopped with the reason and the place."""

from itertools import pairwise

import numpy as np
import pytest

from kinreach.errors import InputError, PathError
from kinreach.kinematics import ArmKinematics, CollisionChecker, URKinematics, joint_line, pose, tool_line
from kinreach.robots import PUBLISHED_CALIBRATIONS, Box, get_arm


@pytest.fixture(scope="module")
def kin():
    return URKinematics("ur5e", base="world")


def shifted(T, *way):
    moved = T.copy()
    moved[:3, 3] += way
    return moved


def random_lines(kin, seed, count):
    """Starts and poses near them."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        start = rng.uniform(-2.5, 2.5, 6)
        T = kin.fk(start)
        turned = T @ pose([0.0, 0.0, 0.0, *rng.uniform(-0.4, 0.4, 3)])
        yield start, np.array([shifted(turned, *rng.uniform(-0.15, 0.15, 3)) for _ in range(2)])


def test_the_tip_is_on_the_lines(kin):
    done = 0
    for start, poses in random_lines(kin, 0, 30):
        try:
            path = tool_line(kin, start, poses)
        except PathError:
            continue
        done += 1
        assert (path[0] == start).all()
        np.testing.assert_allclose(kin.fk(path[-1]), poses[-1], atol=1e-6)
        assert np.abs(np.diff(path, axis=0)).max() <= 0.1
        middles = (path[:-1] + path[1:]) / 2
        tips = kin.fk(np.vstack([path, middles]))[:, :3, 3]
        ends = [kin.fk(start)[:3, 3], *poses[:, :3, 3]]
        off = []
        for tip in tips:
            gaps = []
            for a, b in pairwise(ends):
                part = np.clip((tip - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
                gaps.append(np.linalg.norm(tip - a - part * (b - a)))
            off.append(min(gaps))
        assert max(off[: len(path)]) < 1e-6
        assert max(off) < 2e-4
    assert done > 12


@pytest.mark.slow
def test_what_stops_a_line_is_said_with_its_place(kin):
    reasons = {"reach": 0, "singularity": 0, "limits": 0}
    through = 0
    for start, poses in random_lines(kin, 1, 30):
        far = shifted(poses[0], *(4.0 * (poses[0] - kin.fk(start))[:3, 3]))
        error = stopped(kin, start, far)
        if error is None:
            continue
        reasons[next(key for key in reasons if key in str(error))] += 1
        assert error.index == 0
        assert 0.0 <= error.fraction <= 1.0
        for branch, other in zip(error.branches, error.starts, strict=True):
            through += 1
            assert str(branch) in str(error)
            path = tool_line(kin, other, far)
            np.testing.assert_allclose(kin.fk(path[0]), kin.fk(start), atol=1e-6)
    assert reasons["reach"] > 4
    assert reasons["singularity"] > 0
    assert through > 0


def stopped(kin, start, poses):
    try:
        tool_line(kin, start, poses)
    except PathError as error:
        return error
    return None


def test_a_wrist_that_would_pass_its_singularity_stops_there(kin):
    """Along a motion of wrist_2 alone through 0 the other joints need not move, but the branch is another one."""
    start = np.array([0.0, -1.2, 1.5, -0.3, 0.3, 0.0])
    end = start * [1.0, 1.0, 1.0, 1.0, -1.0, 1.0]
    with pytest.raises(PathError, match="a singularity, past which it would be in another branch") as caught:
        tool_line(kin, start, kin.fk(end))
    assert 0.45 < caught.value.fraction <= 0.5
    assert 0.0 <= caught.value.q[4] < 0.04
    half = start * [1.0, 1.0, 1.0, 1.0, 0.1, 1.0]
    np.testing.assert_allclose(tool_line(kin, start, kin.fk(half))[-1], half, atol=1e-6)


def branch_of(kin, q):
    solutions = kin.all_solutions(kin.fk(q), seed=q, limits=False)
    return solutions.branch[0] if np.abs(solutions.q[0] - q).max() < 1e-4 else None


#: Joints whose zero is a singularity of a UR's wrist and elbow.
WRIST_2, ELBOW = 4, 2


@pytest.mark.parametrize("model", ["ur3e", "ur5e", "ur10e", "ur20", "calibrated"])
@pytest.mark.slow
def test_lines_through_exact_singularities_keep_their_branch_or_stop(model):
    arm = get_arm("ur5e").calibrated(PUBLISHED_CALIBRATIONS["ur5e_a"]) if model == "calibrated" else get_arm(model)
    kin = ArmKinematics.of(arm, tip="tool0")
    rng, stopped_there, through = np.random.default_rng(7), 0, 0
    for case in range(8 if model == "calibrated" else 15):
        middle = rng.uniform(-2.0, 2.0, 6)
        middle[WRIST_2 if case % 3 else ELBOW] = 0.0
        way = np.array([*rng.uniform(-0.1, 0.1, 3), *rng.uniform(-0.3, 0.3, 3)])
        here, there = (kin.fk(middle) @ pose(part) for part in (-way, way))
        for start in kin.all_solutions(here, seed=middle, limits=False).q[:2]:
            before = branch_of(kin, start)
            if before is None:
                continue
            try:
                path = tool_line(kin, start, there)
            except PathError as error:
                stopped_there += "singularity" in str(error)
                continue
            through += 1
            assert branch_of(kin, path[-1]) == before
            np.testing.assert_allclose(kin.fk(path[-1]), there, atol=1e-6)
    assert stopped_there > (3 if model == "calibrated" else 6)
    assert through >= (1 if model == "calibrated" else 2)


def test_limits_and_collisions_stop_it_and_other_branches_are_named():
    arm = get_arm("ur5e")
    kin = URKinematics(arm, base="world")
    start = kin.all_solutions(shifted(pose([0.0, 0.0, 0.0, np.pi, 0.0, 0.0]), 0.45, 0.3, 0.25), seed=arm.home).q[0]
    across = shifted(kin.fk(start), 0.0, -0.6, 0.0)
    assert len(tool_line(kin, start, across)) > 100
    wall = Box("wall", (0.02, 0.02, 0.3), (0.45, 0.0, 0.15))
    checker = CollisionChecker(kin, obstacles=[wall], margin=0.005)
    with pytest.raises(PathError, match=r"line 0 stops after 0\.2\d+ m of 0\.600 m, .*: collision: .*wall") as caught:
        tool_line(kin, start, across, checker=checker)
    assert checker.in_collision(caught.value.q)
    free = tool_line(kin, start, shifted(kin.fk(start), 0.0, -0.1, 0.0), checker=checker)
    assert (joint_line(checker, free) == free).all()
    tight = kin.arm.with_limits({"shoulder_pan_joint": (start[0] - 0.4, start[0] + 3.5)})
    limited = URKinematics(tight, base="world")
    with pytest.raises(PathError, match="out of limits: shoulder_pan_joint"):
        tool_line(limited, start, across)


def test_where_there_is_no_way_to_go_the_posture_is_still_looked_at(kin):
    start = np.array(kin.arm.home)
    path = tool_line(kin, start, np.tile(kin.fk(start), (3, 1, 1)))
    np.testing.assert_allclose(path, np.tile(start, (len(path), 1)), atol=1e-9)
    past = start.copy()
    past[5] = kin.upper[5] + 0.1
    with pytest.raises(PathError, match="out of limits: wrist_3_joint"):
        tool_line(kin, past, kin.fk(past))
    wall = Box("wall", (0.1, 0.1, 0.1), tuple(kin.fk(start)[:3, 3]))
    with pytest.raises(PathError, match=r"line 0 stops after 0\.000 m of 0\.000 m, .*: collision: .*wall"):
        tool_line(kin, start, kin.fk(start), checker=CollisionChecker(kin, obstacles=[wall], margin=0.005))


def test_six_numbers_and_calibrated_arms():
    file = next(file for name, file in PUBLISHED_CALIBRATIONS.items() if name.startswith("ur5e"))
    kin = URKinematics.from_calibration(file, model="ur5e")
    start = np.array(kin.arm.home)
    numbers = np.array([[0.4, 0.1, 0.3, np.pi, 0.0, 0.0], [0.4, 0.1, 0.2, np.pi, 0.0, 0.0]])
    first = kin.nearest(pose(numbers[0]), start).q
    path = tool_line(kin, first, numbers)
    np.testing.assert_allclose(kin.fk(path[-1]), pose(numbers[1]), atol=1e-6)


def test_input_is_checked(kin):
    home = np.array(kin.arm.home)
    with pytest.raises(InputError, match="need an arm with six axes and a closed form"):
        tool_line(ArmKinematics.of("panda"), get_arm("panda").home, np.eye(4))
    with pytest.raises(InputError, match=r"poses must have shape \(k, 4, 4\)"):
        tool_line(kin, home, np.zeros((0, 4, 4)))
    with pytest.raises(InputError, match="last row 0 0 0 1"):
        tool_line(kin, home, 2.0 * np.eye(4))
    with pytest.raises(InputError, match="margin of at least"):
        tool_line(kin, home, kin.fk(home), checker=CollisionChecker(kin))
    with pytest.raises(InputError, match="step must be"):
        tool_line(kin, home, kin.fk(home), step=0.0)
