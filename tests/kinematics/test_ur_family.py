"""The closed form for every arm of the family, whatever its lengths."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from kinreach.errors import InputError, UnknownNameError
from kinreach.kinematics import UR5Kinematics, URKinematics
from kinreach.robots import ArmDescription, get_arm

#: |a2| and |a3| of the data sheets [m].
LENGTHS = {"ur3": (0.24365, 0.21325), "ur5": (0.425, 0.39225), "ur10": (0.612, 0.5723)}
UR_FILES = Path(str(get_arm("ur5").package_root())) / "example-robot-data/robots/ur_description/urdf"


def of(name, tmp_path):
    if name.endswith(".urdf"):
        return URKinematics(ArmDescription.from_urdf(UR_FILES / name, tip="tool0"))
    return URKinematics(name, tip="tcp", base="world")


@pytest.mark.parametrize("name", [*LENGTHS, "ur10_robot.urdf", "ur3_robot.urdf"])
def test_every_posture_is_found_again(name, tmp_path):
    kin = of(name, tmp_path)
    rng = np.random.default_rng(0)
    q = rng.uniform(np.maximum(kin.lower, -np.pi), np.minimum(kin.upper, np.pi), (200, 6))
    T = kin.fk(q)
    batch = kin.batch(T)
    for posture, pose, row, valid in zip(q, T, batch.q, batch.valid, strict=True):
        solutions = kin.all_solutions(pose)
        assert np.abs(solutions.q - posture).max(axis=1).min() < 1e-8
        assert solutions.residual.max() < 1e-8
        np.testing.assert_allclose(row[valid], solutions.q, atol=1e-8)
    nearest = kin.nearest_batch(T, q)
    assert nearest.success.all()
    np.testing.assert_allclose(nearest.q, q, atol=1e-8)


@pytest.mark.parametrize("name", LENGTHS)
def test_lengths_are_the_data_sheets(name):
    geometry = URKinematics(name).geometry
    np.testing.assert_allclose((-geometry.a2, -geometry.a3), LENGTHS[name], atol=1e-9)


def test_the_ur5_by_its_old_name():
    old, new = UR5Kinematics(tip="tcp", base="world"), URKinematics("ur5", tip="tcp", base="world")
    assert isinstance(old, URKinematics)
    q = np.random.default_rng(0).uniform(-3, 3, (50, 6))
    np.testing.assert_array_equal(old.fk(q), new.fk(q))
    np.testing.assert_array_equal(old.batch(old.fk(q)).q, new.batch(new.fk(q)).q)
    assert URKinematics().tip == UR5Kinematics().tip == "tool0"


def test_arms_of_another_kind():
    with pytest.raises(UnknownNameError, match="tool0"):
        URKinematics("arm3", tip="end_effector")
    with pytest.raises(UnknownNameError, match="ur10, ur3, ur5"):
        URKinematics("ur16")
    panda = UR_FILES.parents[1] / "panda_description/urdf/panda.urdf"
    arm = ArmDescription.from_urdf(panda, joints=[f"panda_joint{i}" for i in range(1, 7)], tip="panda_link6")
    with pytest.raises(InputError, match="tool0"):
        URKinematics(arm)
