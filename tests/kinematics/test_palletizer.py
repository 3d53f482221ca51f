"""Palletizers in closed form: every posture, against many starts of a numeric solver."""

import numpy as np
import pytest

from kinreach.cli import main
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


@pytest.mark.slow
def test_points_and_directions(tmp_path):
    """The last joint keeps the seed's value, or what the direction leaves free does."""
    rng, solved = np.random.default_rng(1), 0
    for kin in palletizers(rng, tmp_path):
        for q in rng.uniform(kin.lower, kin.upper, (2, kin.n)):
            T, seed = kin.fk(q), q + 0.05 * (kin.arm.home - q)
            seed[3] = q[3]
            found = kin.solve(PositionGoal(T[:3, 3]), seed)
            assert found.success, found.reason
            assert found.position_error < 1e-9
            assert abs(found.q[3] - q[3]) < 1e-6
            assert np.linalg.norm(found.q - seed) <= np.linalg.norm(q - seed) + 1e-6
            found = kin.solve(AxisGoal(T[:3, 3], T[:3, 2]), seed)
            assert found.success, found.reason
            assert max(found.position_error, found.orientation_error) < 1e-9
            solved += 1
    assert solved == 18


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
