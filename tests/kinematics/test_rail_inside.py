"""Curves of an arm on a rail, in their parts."""

import re

import numpy as np
import pytest

from kinreach.cli import main
from kinreach.deploy._check_cli import _class_of, _joints
from kinreach.errors import InputError, UnknownNameError
from kinreach.kinematics import (
    ArmKinematics,
    AxisGoal,
    PoseGoal,
    Status,
    pose_vector,
)
from kinreach.robots import ArmDescription
from tests.kinematics.test_rail import SIX, on_slide, written
from tests.robots.peoples_files import arm, joint


def test_from_the_shell_and_where_there_is_none(tmp_path, capsys):
    kin = written(tmp_path, on_slide(arm(), (1, 0, 0), limits=(0.0, 3.0)), joints=["rail", *SIX])
    q = np.array([1.2, 0.1, 0.5, 0.9, -0.4, 0.9, 0.2])
    command = [str(tmp_path / "slide.urdf"), "--joints", "rail,j1,j2,j3,j4,j5,j6"]
    assert _class_of(kin).startswith("six joints and the slide rail: every posture of a pose as curves, in closed form")
    assert re.search(r"rail +\+0\.000 to +\+3\.000 m, +1\.00 m/s, starts at \+1\.500 m", next(_joints(kin)))
    goal = ",".join(f"{value:.12f}" for value in pose_vector(kin.fk(q)))
    seed = ",".join(map(str, q))
    assert main(["ik", "--arm", *command, f"--pose={goal}", f"--seed={seed}"]) == 0
    out = capsys.readouterr().out
    row = next(line for line in out.splitlines() if line.startswith("*"))
    np.testing.assert_allclose([float(word) for word in row.split()[2:9]], q, atol=1e-5)
    assert "angles in rad, rail in m" in out
    assert "* nearest to the seed 1.200" in out
    far = kin.fk(q)
    far[0, 3] += 5.0
    none = kin.self_motions(far)
    assert none.status is Status.OUT_OF_LIMITS
    assert re.fullmatch(r".*limits: rail would be at [4-7]\.\d+ to [5-9]\.\d+ m, its limits are 0 to 3 m", none.reason)
    assert none.with_joint("rail", 6.0) == []
    assert kin.nearest(far, q).reason == none.reason
    far[2, 3] += 50.0
    assert kin.nearest(far, q).status is Status.OUT_OF_REACH
    held = kin.solve(AxisGoal(kin.fk(q)[:3, 3], kin.fk(q)[:3, 2]), q)
    assert held.success
    assert held.q[0] == q[0]
    assert kin.solve(PoseGoal(kin.fk(q)), q + 0.1).success
    motions = kin.self_motions(kin.fk(q))
    assert min(np.abs(each.q - q).max() for each in motions.with_joint("j3", q[3])) < 1e-8
    with pytest.raises(UnknownNameError, match=r"unknown joint 'track'; available: .* rail"):
        motions.with_joint("track", 0.0)
    with pytest.raises(InputError, match="value must be"):
        motions.with_joint("rail", np.nan)


def test_the_class_of_a_chain_of_few_or_many_joints_is_said(tmp_path):
    said = {}
    for count in (1, 2, 8, 9):
        text = "".join(f'<link name="l{i}"/>' for i in range(count + 1))
        for i in range(count):
            axis = f'<axis xyz="{"0 0 1" if i % 2 else "0 1 0"}"/>'
            text += joint(f"j{i}", f"l{i}", f"l{i + 1}", origin='<origin xyz="0 0.05 0.2"/>', axis=axis)
        file = tmp_path / "chain.urdf"
        file.write_text(f'<robot name="chain">{text}</robot>')
        said[count] = _class_of(ArmKinematics.of(ArmDescription.from_urdf(file)))
    none = (
        "no closed form (not the geometry of an arm that kinreach has one for): placo, lm and qp, one posture at a time"
    )
    assert said[1] == said[2] == none
    for count in (8, 9):
        assert said[count].startswith(f"{count - 6} joints more than a pose needs; numeric: nearest, clearest and")
    assert _class_of(ArmKinematics("ur5e")) == none  # as long as nobody asks for a closed form
    family = (
        "more than a pose needs, so that each pose has a family of postures): placo, lm and qp, one posture at a time"
    )
    assert _class_of(ArmKinematics("panda")) == f"no closed form (1 joint {family}"
