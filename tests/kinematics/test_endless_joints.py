"""Joints that turn without end: no limits, each posture once, and the turns that are nearest to a seed."""

import re

import numpy as np
import pytest
from example_robot_data.robots_loader import getModelPath

from benchmarks.ik_arms.arms import urdf
from benchmarks.ik_arms.random_arms import CLASSES, OTHERS, Judge, some_arm
from kinreach.cli import main
from kinreach.kinematics import (
    ArmKinematics,
    AxisGoal,
    CollisionChecker,
    MotionLimits,
    PoseGoal,
    PositionGoal,
    joint_line,
    plan_path,
    pose_vector,
    time_waypoints,
)
from kinreach.kinematics._seven_axis.kinematics import SevenAxisKinematics
from kinreach.kinematics._six_axis.kinematics import SixAxisKinematics
from kinreach.kinematics._solvers import new_solver
from kinreach.kinematics._ur.kinematics import CalibratedURKinematics, URKinematics
from kinreach.robots import ArmDescription, get_arm
from tests.cases import slow
from tests.robots.peoples_files import LIMIT, arm, shape

TURN = 2 * np.pi
#: Steps along a curve in the joint that moves most, and the largest jump that an answer may make [rad].
STEP, JUMP = np.deg2rad((1.0, 2.0))
#: A continuous answer exists along a curve where the arm is regular: smallest singular value of its Jacobian.
REGULAR = 0.02
FREE = {i: {"kind": "continuous", "inside": ""} for i in range(1, 7)}


def endless(text, *names):
    """A URDF in which these joints, or all revolute ones, turn without end."""

    def without(found):
        name, inside = found.groups()
        if names and name not in names:
            return found[0]
        plain = re.sub(r' (?:lower|upper)="[^"]*"', "", inside)
        return f'<joint name="{name}" type="continuous">{plain}</joint>'

    return re.sub(r'<joint name="([^"]*)" type="revolute">(.*?)</joint>', without, text, flags=re.DOTALL)


def written(folder, text, **options):
    file = folder / "endless.urdf"
    file.write_text(text)
    return ArmKinematics.from_urdf(file, **options)


def closed_curve(rng, kin, turns):
    """Postures whose poses are a closed curve on which joints turn so often, in steps of 1 degree, none singular."""
    for _ in range(500):
        start, phase = rng.uniform(-np.pi, np.pi, (2, kin.n))
        size = rng.uniform(0.1, 0.5, kin.n)

        def at(s, start=start, phase=phase, size=size):
            s = s[:, None]
            return start + TURN * s * turns + size * (np.sin(TURN * s + phase) - np.sin(phase))

        if np.linalg.svd(kin.jacobian(at(np.linspace(0, 1, 100))), compute_uv=False)[:, -1].min() > REGULAR:
            return at(np.linspace(0, 1, 1 + int(np.ceil(TURN * (np.abs(turns) + size).max() / STEP))))
    raise AssertionError("no regular curve")


def tracked(kin, curve, q, nearest=None):
    """The answers along a curve, each from the one before, the first from a posture; no joint jumps."""
    answers = []
    for T in kin.fk(curve):
        result = (nearest or kin.nearest)(T, q)
        assert result.success, result
        assert np.abs(result.q - q).max() < JUMP
        q = result.q
        answers.append(q)
    return np.array(answers)


def test_a_joint_without_end_has_no_limits(tmp_path):
    kin = written(tmp_path, arm(joints={1: FREE[1], 6: FREE[6]}))
    assert kin.lower.tolist() == [-np.inf, -3.1, -3.1, -3.1, -3.1, -np.inf]
    np.testing.assert_array_equal(kin.upper, -kin.lower)
    assert kin.sampling_limits[1].tolist() == [np.pi, 3.1, 3.1, 3.1, 3.1, np.pi]
    assert kin.arm.home == (0.0,) * 6
    assert kin.within_limits([1e5, 0, 0, 0, 0, -1e5])
    assert kin.joints_outside_limits([1e5, 4, 0, 0, 0, -1e5]) == ("j2",)
    near, far = np.array([0.5, 0.3, 0.8, -0.4, 0.9, 0.2]), np.array([0.5 + 40 * TURN, 0.3, 0.8, -0.4, 0.9, 0.2 - TURN])
    np.testing.assert_allclose(kin.fk(far), kin.fk(near), atol=1e-12)
    np.testing.assert_allclose(kin.jacobian(far), kin.jacobian(near), atol=1e-12)


def test_it_has_those_that_it_is_given(tmp_path):
    kin = written(tmp_path, arm(joints=FREE))
    some = ArmKinematics.of(kin.arm.with_limits({"j1": (-1.0, 2.0)}))
    assert (some.lower[0], some.upper[0], some.upper[1]) == (-1.0, 2.0, np.inf)
    every = ArmKinematics.of(kin.arm.with_limits(3.0))
    assert every.upper.tolist() == [3.0] * 6
    q = np.array([0.5, 0.3, 0.8, -0.4, 0.9, 0.2])
    np.testing.assert_array_equal(every.fk(q), kin.fk(q))


@pytest.mark.parametrize("name", [*CLASSES, *OTHERS])
def test_six_axes_follow_a_closed_curve(name, tmp_path):
    rng, count = np.random.default_rng(len(name)), 0
    for backwards, off in ((False, 0.0), (True, 1e-4)):
        chain = some_arm(rng, name, backwards=backwards, off=off)
        kin = written(tmp_path, endless(urdf(chain)))
        assert type(kin) is SixAxisKinematics
        assert not np.isfinite(kin.upper).any()
        curve = closed_curve(rng, kin, rng.choice([-1, 1], 6) * [1, 0, 0, 0, 0, 1])
        answers = tracked(kin, curve, curve[0])
        np.testing.assert_allclose(answers, curve, atol=1e-6)
        alike = kin.nearest_batch(kin.fk(curve), curve)
        assert alike.success.all()
        np.testing.assert_allclose(alike.q, curve, atol=1e-6)
        count += len(curve)
    assert count > 400


def test_urs_follow_a_closed_curve(tmp_path):
    """Whose wrist 3 alone has no end, as in the maker's description of a UR3e, or all joints; calibrated, too."""
    rng, count = np.random.default_rng(3), 0
    for text, kind in ((get_arm("ur3e").urdf, URKinematics), (get_arm("ur5e").calibrated("ur5e_a").urdf, None)):
        for joints in (("wrist_3_joint",), ()):
            kin = written(tmp_path, endless(text, *joints), tip="tool0")
            assert type(kin) is (kind or CalibratedURKinematics)
            curve = closed_curve(rng, kin, np.array([0 if joints else 1, 0, 0, 0, 0, -3]))
            curve -= np.where(np.isfinite(kin.upper), TURN * np.rint(curve.mean(axis=0) / TURN), 0.0)
            if joints:
                curve = curve[kin.past_limits(curve).any(axis=1).cumsum() == 0]
            assert len(curve) > 50
            np.testing.assert_allclose(tracked(kin, curve, curve[0]), curve, atol=1e-6)
            count += len(curve)
    assert count > 1000


#: Joints without end of arms that makers sell; others have any.
ENDLESS = {"Jaco": ("j1", "j4", "j5", "j6"), "RealMan": ("j6",)}


@pytest.mark.parametrize("name", [*CLASSES, *OTHERS])
def test_arms_of_which_some_joints_end_follow_a_closed_curve(name, tmp_path):
    """Where it is within the limits of the others, from any turns of those without end; the last joint turns once."""
    rng, count = np.random.default_rng(len(name)), 0
    some = [*(f"j{i}" for i in 1 + rng.permutation(5)[: rng.integers(1, 5)]), "j6"]
    for free in (*ENDLESS.values(), some):
        low, high = rng.uniform([-3.1, 1.5], [-1.5, 3.1])
        chain = some_arm(rng, name)
        kin = written(tmp_path, endless(urdf(chain, np.tile([[low], [high]], (1, 6))), *free))
        ends = np.isfinite(kin.upper)
        assert ends.sum() == 6 - len(free)
        curve = closed_curve(rng, kin, np.array([0, 0, 0, 0, 0, rng.choice([-1, 1])]))
        middle = 0.5 * (curve[:, ends].min(axis=0) + curve[:, ends].max(axis=0))
        shift = TURN * rng.integers(-2, 3, 6)
        names = np.array(kin.arm.joints)[ends]
        limits = {joint: (at + low, at + high) for joint, at in zip(names, middle, strict=True)}
        around = ArmKinematics.of(kin.arm.with_limits(limits))
        assert not around.past_limits(curve).any()
        start = np.where(ends, curve, curve + shift)
        np.testing.assert_allclose(tracked(around, curve, start[0]), start, atol=1e-6)
        count += len(curve)
    assert count > 1200


@pytest.mark.parametrize("seed", [0, *slow(1, 2, 3)])
def test_seven_axes_follow_a_closed_curve(seed, tmp_path):
    file = "panda_description/urdf/panda.urdf"
    with open(f"{getModelPath(file)}/{file}") as opened:
        text = endless(re.sub(r"<(visual|collision)>.*?</\1>", "", opened.read(), flags=re.DOTALL))
    kin, rng = written(tmp_path, text), np.random.default_rng(seed)
    assert type(kin) is SevenAxisKinematics
    assert not np.isfinite(kin.upper).any()
    curve = closed_curve(rng, kin, np.array([1, 0, 0, 0, 0, 0, 1]))
    part = curve if seed else curve[:20]
    shift = TURN * rng.integers(-3, 4, 7)
    tracked(kin, part, part[0] + shift)
    motions = kin.self_motions(kin.fk(curve[0]), seed=curve[0])
    assert all(motion.closed for motion in motions)  # no limit cuts them
    assert len(motions) >= 1


@pytest.mark.parametrize("name", ["lm", "qp", "placo"])
def test_solvers_follow_a_closed_curve(name, tmp_path, request):
    if name == "placo":
        request.getfixturevalue("needs_placo")
    rng, count = np.random.default_rng(1), 0
    for group in list(CLASSES)[::3]:
        kin = written(tmp_path, endless(urdf(some_arm(rng, group))))
        curve, solver = closed_curve(rng, kin, np.array([1, 0, 0, 0, 0, 1])), new_solver(name, kin)
        shift = TURN * rng.integers(-20, 20, 6)
        answers = tracked(kin, curve[:100], curve[0] + shift, lambda T, q, solve=solver.solve: solve(PoseGoal(T), q))
        assert np.abs(answers - shift - curve[:100]).max() < JUMP
        count += len(answers)
    assert count == 300


def test_every_posture_once(tmp_path):
    """Without a seed within a turn; with one in the turns nearest to it, whatever the other joints' limits."""
    rng, count = np.random.default_rng(0), 0
    for number, name in enumerate([*CLASSES, *OTHERS]):
        chain = some_arm(rng, name)
        for joints in ((), (("j1", "j4"), ("j2", "j6"))[number % 2]):
            kin, judge = written(tmp_path, endless(urdf(chain), *joints)), Judge(chain)
            free = np.isinf(kin.upper)
            assert free.sum() == (len(joints) or 6)
            q, seed = rng.uniform(-np.pi, np.pi, 6), np.where(free, rng.uniform(-50, 50, 6), 0.0)
            T = judge.fk(q)
            found, near = kin.all_solutions(T), kin.all_solutions(T, seed=seed)
            assert sorted(found.branch) == sorted(near.branch)
            assert np.abs(found.q).max() <= np.pi + 1e-9
            assert (np.abs(near.q - seed) <= np.pi + 1e-9)[:, free].all()
            for one in near.q:
                assert np.abs(judge.fk(one) - T).max() < 1e-8
            others = np.abs((found.q[:, None] - found.q + np.pi) % TURN - np.pi).max(axis=2)
            assert (others + np.eye(len(found)) > 1e-9).all()
            alike = kin.batch(T[None]).q[0][found.branch]
            np.testing.assert_array_equal(alike, found.q)
            count += len(found)
    assert count > 70


def test_the_way_through_half_a_turn_is_short(tmp_path):
    """From 179 to 181 degrees a path has 2 degrees, and takes no longer than from 0 to 2."""
    solids = {i: shape('<cylinder radius="0.02" length="0.05"/>', "collision") for i in range(7)}
    kin = written(tmp_path, arm(joints={1: FREE[1], 6: FREE[6]}, links=solids))
    checker = CollisionChecker(kin, margin=0.005)
    start, end = np.deg2rad([[179, 30, 40, 50, 60, 179], [181, 30, 40, 50, 60, 181]])
    limits = MotionLimits.of(kin, acceleration=2.0, jerk=20.0)
    for turns in (0.0, 3 * TURN):
        shift = turns * np.array([1, 0, 0, 0, 0, -1])
        path = plan_path(checker, start + shift, kin.all_solutions(kin.fk(end), seed=None))
        assert path.shape == (2, 6)
        np.testing.assert_allclose(path[-1], end + shift, atol=1e-6)
        assert joint_line(checker, path).shape == (2, 6)
        assert checker.free(path[-1])
        assert not checker.impossible(path).any()
        duration = time_waypoints(path, limits).duration
        assert duration == pytest.approx(time_waypoints(path - start - shift, limits).duration, abs=1e-6)


def test_points_and_directions_keep_turns(tmp_path):
    kin = written(tmp_path, arm(joints=FREE))
    q = np.array([3.1, 0.3, 0.8, -0.4, 0.9, 0.2])
    T, turns = kin.fk(q), TURN * np.array([2, -1, 0, 3, 0, -4])
    for goal in (AxisGoal(T[:3, 3], T[:3, 2]), PositionGoal(T[:3, 3])):
        for name in ("lm", "qp"):
            found = new_solver(name, kin).solve(goal, q + turns + 0.01)
            assert found.success
            assert np.abs(found.q - q - turns).max() < 0.1
    found = kin.axis_solutions(T[:3, 3], T[:3, 2], seed=q + turns)
    np.testing.assert_allclose(found.q[0], q + turns, atol=1e-6)


def test_the_command_line_keeps_turns(tmp_path, capsys):
    file = tmp_path / "free.urdf"
    file.write_text(arm(joints={1: FREE[1], 6: FREE[6]}))
    kin = ArmKinematics.from_urdf(file)
    q = np.deg2rad([399, 30, 40, 50, 60, -700])
    T = kin.fk(q)
    pose = ",".join(f"{value:.12f}" for value in pose_vector(T))
    command = ["ik", "--arm", str(file), f"--pose={pose}"]
    assert main([*command, "--seed", "400,30,40,50,60,-700", "--degrees"]) == 0
    out, err = capsys.readouterr()
    best = next(line for line in out.splitlines() if line.startswith("*"))
    np.testing.assert_allclose([float(word) for word in best.split()[2:8]], np.rad2deg(q), atol=2e-3)
    assert not err
    assert main([*command, "--seed", "400,0.5,0.7,0.9,1,-12"]) == 0
    assert "63.7 turns; for degrees add --degrees" in capsys.readouterr().err
    assert main([*command, "--seed", "0,400,40,50,60,0", "--degrees"]) != 0
    assert "within ±360 degrees, got 400" in capsys.readouterr().err
    assert main(["check", str(file)]) == 0
    out = capsys.readouterr().out
    assert len(re.findall(r"j[16] +turns without end", out)) == 2
    assert "inf" not in out
    assert "nan" not in out


def test_limits_so_wide_that_they_are_none(tmp_path):
    wide = LIMIT.replace("-3.1", "-1e16").replace("3.1", "1e16")
    file = tmp_path / "wide.urdf"
    file.write_text(arm(joints={1: {"inside": wide}}))
    described = ArmDescription.from_urdf(file)
    assert ArmKinematics(described).upper[0] == np.inf
