"""A direction and a seed that has it already: the seed itself, whatever turns the tip about it."""

import numpy as np
import pytest

from benchmarks.ik_arms.random_arms import kinematics, some_arm
from kinreach.kinematics import ArmKinematics, AxisGoal, URKinematics
from kinreach.robots import PUBLISHED_CALIBRATIONS
from tests.kinematics.test_rail import ur_on_rail, written
from tests.kinematics.test_scara_and_gantry import random_gantry

BESIDE = [0.03, -0.02, 0.15, 0.4, -0.3, 0.2]


def gantry(folder):
    return written(folder, random_gantry(np.random.default_rng(6), 3), tip="t2_link")


ARMS = {
    "seven axes": lambda folder: ArmKinematics.of("panda"),
    "six axes on a slide": ur_on_rail,
    "a gantry with a hand": gantry,
    "a UR with a tool beside its axis": lambda folder: URKinematics("ur5e", tool=BESIDE),
    "a calibrated UR with that tool": lambda folder: URKinematics.from_calibration(
        PUBLISHED_CALIBRATIONS["ur5e_a"], model="ur5e", tool=BESIDE
    ),
    "six axes of no class": lambda folder: kinematics(folder, some_arm(np.random.default_rng(4), "no class")),
}


@pytest.mark.parametrize("name", ARMS)
def test_a_seed_that_points_there_is_the_answer(tmp_path, name):
    kin, rng, tried = ARMS[name](tmp_path), np.random.default_rng(3), 0
    for q in rng.uniform(*kin.sampling_limits, (6, kin.n)):
        T = kin.fk(q)
        found = kin.solve(AxisGoal(T[:3, 3], T[:3, 2]), q)
        assert found.success, found.reason
        np.testing.assert_allclose(found.q, q, atol=1e-6)
        near = kin.solve(AxisGoal(T[:3, 3] + 1e-5, T[:3, 2]), q)  # and what moves a little answers with a small move
        if near.success:
            assert np.abs(near.q - q).max() < 0.02
            tried += 1
    assert tried >= 5
