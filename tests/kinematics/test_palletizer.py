"""Palletizers in closed form: every posture, against many starts of a numeric solver."""

from itertools import islice

import numpy as np
import pytest

from kinreach.cli import main
from kinreach.errors import InputError
from kinreach.kinematics import (
    ArmKinematics,
    AxisGoal,
    LevenbergMarquardtSolver,
    PalletizerKinematics,
    PoseGoal,
    PositionGoal,
    Status,
    Tolerance,
    pose_vector,
)
from tests.kinematics.test_coupled_and_sliding import COUPLED_WRIST, PALLETIZER, RIGHT, chain, follows, written
from tests.kinematics.test_scara_and_gantry import apart, numbers

#: The joints between the first and the last. Those with an m turn back what the joint of the same number turns: at
#: once, or behind the forearm, in either order.
RODS = (("2", "2m", "3", "3m"), ("2", "3", "3m", "2m"), ("2", "3", "2m", "3m"))


def random_palletizer(rng, rods, *, right=RIGHT):
    """Axes either way, rods with offsets, an arm that stands anywhere, and a tool beside the last axis."""
    offset, signs, joints = rng.uniform(-0.3, 0.3), {}, []
    for index, name in enumerate(("1", *rods, "4")):
        sign = int(rng.choice([-1, 1]))
        options = {"xyz": numbers(rng.uniform(-0.3, 0.3, 3)), "axis": f"0 0 {sign}"}
        options["rpy"] = (numbers(rng.uniform(-3, 3, 3)), f"-{right} 0 0", *["0 0 0"] * 3, f"{right} 0 0")[index]
        if name.endswith("m"):
            turned = offset if name == "2m" else -offset
            options["mimic"] = follows(f"j{name[0]}", -sign * signs[name[0]], sign * turned)
            options["limits"] = (-4.0, 4.0)
        if rods == RODS[2] and name == "3m":  # one pin for both rods: there is no third link
            options["xyz"] = f"0 0 {rng.uniform(-0.1, 0.1)}"
        signs[name] = sign
        joints.append((f"j{name}", "revolute", options))
    tool = {"xyz": numbers(rng.uniform(-0.1, 0.1, 3)), "rpy": numbers(rng.uniform(-1, 1, 3))}
    return chain(*joints, ("tool", "fixed", tool))


def palletizers(rng, folder, **options):
    for rods in RODS * 3:
        kin = written(folder, random_palletizer(rng, rods, **options), tip="tool_link")
        assert type(kin) is PalletizerKinematics, kin.no_closed_form
        yield kin


@pytest.mark.parametrize("right", [RIGHT, "1.5708"])
@pytest.mark.slow
def test_every_posture(right, tmp_path):
    """Drawn postures are found again, and what a numeric solver finds from many starts is among those found."""
    rng, poses, postures, searched = np.random.default_rng(0), 0, 0, 0
    for kin in palletizers(rng, tmp_path, right=right):
        solver = LevenbergMarquardtSolver(kin, tolerance=Tolerance(1e-9, 1e-9), max_restarts=0)
        for index, q in enumerate(rng.uniform(kin.lower, kin.upper, (12, kin.n))):
            T = kin.fk(q)
            found = kin.all_solutions(T)
            assert apart(kin, q, found.q) < 1e-4
            assert found.residual.max() < 1e-9
            assert all(kin.within_limits(each) for each in found.q)
            assert len({*found.branch.tolist()}) == len(found) <= kin.branches
            poses, postures = poses + 1, postures + len(found)
            for start in rng.uniform(kin.lower, kin.upper, (8, kin.n)) if index < 2 else ():
                other = solver.solve(PoseGoal(T), start)
                if other.success:
                    assert apart(kin, other.q, found.q) < 1e-3
                    searched += 1
    assert poses == 108
    assert postures > 216
    assert searched > 40


def solved_near(kin, q):
    """Solve for the point of a posture from a seed beside it: the pose, the seed and the result, which is checked."""
    T, seed = kin.fk(q), q + 0.05 * (kin.arm.home - q)
    seed[3] = q[3]
    found = kin.solve(PositionGoal(T[:3, 3]), seed)
    assert found.success, found.reason
    assert found.position_error < 1e-9
    assert abs(found.q[3] - q[3]) < 1e-6
    assert np.linalg.norm(found.q - seed) <= np.linalg.norm(q - seed) + 1e-6
    return T, seed, found


@pytest.mark.slow
def test_points_and_directions(tmp_path):
    """The last joint keeps the seed's value, or what the direction leaves free does."""
    rng, solved = np.random.default_rng(1), 0
    for kin in palletizers(rng, tmp_path):
        for q in rng.uniform(kin.lower, kin.upper, (2, kin.n)):
            T, seed, _ = solved_near(kin, q)
            found = kin.solve(AxisGoal(T[:3, 3], T[:3, 2]), seed)
            assert found.success, found.reason
            assert max(found.position_error, found.orientation_error) < 1e-9
            solved += 1
    assert solved == 18


@pytest.mark.parametrize("right", [RIGHT, "1.5708"])
def test_drawn_postures_of_three_palletizers_are_found_again(right, tmp_path):
    """Each kind of rods once, also with the elbow almost or just straight."""
    rng, checked = np.random.default_rng(6), 0
    for kin in islice(palletizers(rng, tmp_path, right=right), 3):
        straight = straight_elbow(kin)
        for bend in (None, None, 1e-3, 0.0):
            q = rng.uniform(kin.lower, kin.upper)
            if bend is not None:
                q[1:3] = kin._to_joints @ (-0.4 + np.array([0.0, straight + bend]))
            T = kin.fk(q)
            found = kin.all_solutions(T, limits=False)
            assert found.success, found.reason
            assert apart(kin, q, found.q) < 1e-4
            assert found.residual.max() < 1e-9
            assert len({*found.branch.tolist()}) == len(found) <= kin.branches
            checked += 1
    assert checked == 12


def straight_elbow(kin):
    """The turn of the second link with respect to the first where both point along one line [rad]."""
    upper, fore = kin._links
    return np.angle(upper) - np.angle(fore)


def test_points_and_directions_of_three_palletizers(tmp_path):
    """The last joint keeps the seed's value for a point; what is refused or outside the limits says so."""
    rng, solved = np.random.default_rng(7), 0
    for kin in islice(palletizers(rng, tmp_path), 3):
        q = rng.uniform(kin.lower, kin.upper)
        T, seed, found = solved_near(kin, q)
        seen = []
        refused = kin.solve(PositionGoal(T[:3, 3]), seed, accept=lambda posture, seen=seen: seen.append(posture))
        assert refused.status is Status.REJECTED
        assert refused.reason == f"accept refused all {len(seen)} postures"
        assert refused.position_error < 1e-9
        np.testing.assert_allclose(refused.q, found.q, atol=1e-9)
        np.testing.assert_allclose(seen[0], found.q, atol=1e-9)
        other = seed + 0.7 * np.eye(4)[3]
        found = kin.solve(AxisGoal(T[:3, 3], T[:3, 2]), other)
        assert found.success, found.reason
        np.testing.assert_allclose(kin.fk(found.q)[:3, 2:], T[:3, 2:], atol=1e-9)
        solved += 1
    assert solved == 3


def test_a_point_outside_the_limits_says_so(tmp_path):
    """A point that only postures beyond joint 1's limits reach, and one that none does."""
    narrow = [(name, kind, dict(options)) for name, kind, options in PALLETIZER]
    narrow[0][2]["limits"] = (-0.5, 0.5)
    kin = written(tmp_path, chain(*narrow))
    q = np.array([1.0, 0.2, 0.5, 0.2])
    T = kin.fk(q)
    found = kin.solve(PositionGoal(T[:3, 3]), np.zeros(4))
    assert found.status is Status.OUT_OF_LIMITS
    assert "outside the joint limits (j1" in found.reason
    np.testing.assert_array_equal(found.q, np.zeros(4))
    assert found.position_error == pytest.approx(np.linalg.norm(T[:3, 3] - kin.fk(np.zeros(4))[:3, 3]), abs=1e-12)
    far = kin.solve(PositionGoal(3.0 * T[:3, 3]), np.zeros(4))
    assert far.status is Status.OUT_OF_REACH
    assert "m too far from the axis of j2" in far.reason
    upright = kin.solve(AxisGoal(3.0 * T[:3, 3], T[:3, 2]), np.zeros(4))
    assert upright.status is Status.OUT_OF_REACH
    assert upright.reason == far.reason
    assert upright.orientation_error == pytest.approx(0.0, abs=1e-7)


def test_a_goal_next_to_the_first_axis_is_too_close_for_a_hand_beside_it(tmp_path):
    """The last axis passes the first one 50 mm beside it: a tip 20 mm from the first axis is 30 mm too close."""
    beside = [(name, kind, dict(options)) for name, kind, options in PALLETIZER]
    beside[5][2]["xyz"] = "0.06 0 0.05"
    kin = written(tmp_path, chain(*beside))
    reached = kin.fk([0.3, 0.2, 0.5, 0.2])
    assert apart(kin, np.array([0.3, 0.2, 0.5, 0.2]), kin.all_solutions(reached).q) < 1e-9
    for way in ([0.02, 0.0], [0.0, -0.02], [-0.012, 0.016]):
        T = reached.copy()
        T[:2, 3] = way
        found = kin.all_solutions(T)
        assert (len(found), found.status) == (0, Status.OUT_OF_REACH)
        assert found.reason == "the goal is 0.03 m too close to the axis of j1"


@pytest.mark.parametrize(
    ("number", "changed", "said"),
    [
        (1, {"rpy": "-1.5 0 0"}, "axes 2 to those of the rods are parallel, and across the first"),
        (3, {"rpy": "0.05 0 0"}, "axes 2 to those of the rods are parallel, and across the first"),
        (4, {"mimic": follows("j3", -0.9)}, "its rods keep the last axis parallel to the first"),
        (5, {"rpy": "1.5 0 0"}, "the last axis is parallel to the first"),
        (4, {"xyz": "0 0 0"}, "it has two links, with multipliers of -1 or 1"),
    ],
)
def test_an_arm_that_is_almost_a_palletizer_has_no_closed_form(number, changed, said, tmp_path):
    other = [(name, kind, dict(options)) for name, kind, options in PALLETIZER]
    other[number][2].update(changed)
    kin = written(tmp_path, chain(*other))
    assert type(kin) is ArmKinematics
    assert kin.no_closed_form.endswith(said)


def test_singular_poses(tmp_path):
    kin = written(tmp_path, chain(*PALLETIZER))
    stretched = kin.fk([0.3, 0.4, 0.4, 0.2])
    assert kin.all_solutions(stretched).residual.max() < 1e-9
    over = np.array([0.4, 1.1, np.arccos(-(0.06 + 0.135 * np.cos(1.1)) / 0.147), 0.1])  # with the tip on the first axis
    assert np.hypot(*kin.fk(over)[:2, 3]) < 1e-12
    found = kin.nearest(kin.fk(over), [0.9, *over[1:]])
    assert found.q[0] == pytest.approx(0.9, abs=1e-9)
    assert max(found.position_error, found.orientation_error) < 1e-9


def test_why_there_is_none(tmp_path):
    kin = written(tmp_path, chain(*PALLETIZER))
    T = kin.fk([0.3, 0.2, 0.5, 0.2])
    tilted, far = T.copy(), T.copy()
    tilted[:3, :3] = T[:3, :3] @ np.array([[1, 0, 0], [0, np.cos(0.1), -np.sin(0.1)], [0, np.sin(0.1), np.cos(0.1)]])
    far[:3, 3] *= 3.0
    for pose, said in (
        (tilted, "its joints cannot turn the tip to this orientation"),
        (far, "m too far from the axis of j2"),
    ):
        found = kin.nearest(pose, kin.arm.home)
        assert found.status is Status.OUT_OF_REACH
        assert said in found.reason
    coupled = written(tmp_path, chain(*COUPLED_WRIST))
    assert type(coupled) is ArmKinematics
    assert "joints follow others, palletizers of four axes have a closed form: first and last" in coupled.no_closed_form
    alone = written(tmp_path, chain(*[joint for joint in PALLETIZER if "mimic" not in joint[2]]))
    with pytest.raises(InputError, match="first and last joint turn alone, and rods keep what is between them upright"):
        PalletizerKinematics(alone.arm)
    half = [(name, kind, dict(options)) for name, kind, options in PALLETIZER]
    half[2][2]["mimic"] = follows("j2", -0.5)
    assert "its rods keep the last axis parallel to the first" in written(tmp_path, chain(*half)).no_closed_form


def test_a_palletizer_is_solved_on_the_command_line(tmp_path, capsys):
    file = tmp_path / "arm.urdf"
    file.write_text(chain(*PALLETIZER))
    pose = pose_vector(written(tmp_path, chain(*PALLETIZER)).fk([0.3, 0.2, 0.5, 0.2]))
    assert main(["ik", "--arm", str(file), f"--pose={','.join(f'{value:.12f}' for value in pose)}"]) == 0
    rows = [line.strip("* ").split() for line in capsys.readouterr().out.splitlines() if line.endswith((" no", " yes"))]
    assert ["0.30000", "0.20000", "0.50000", "0.20000"] in [row[1:5] for row in rows]
