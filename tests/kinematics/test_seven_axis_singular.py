"""Seven axes next to singular postures: the curve of the posture behind a pose is there, `nearest` returns it."""

import numpy as np
import pytest
from example_robot_data.robots_loader import getModelPath

from kinreach.kinematics import ArmKinematics
from kinreach.kinematics._angles import wrapped
from tests.cases import slow

PANDA = "panda_description/urdf/panda.urdf"


@pytest.fixture(scope="module")
def panda():
    return ArmKinematics.from_urdf(f"{getModelPath(PANDA)}/{PANDA}")


def distance_from_curves(kin, q, *, limits):
    return min(
        float(np.linalg.norm(wrapped(curve.q - q), axis=1).min())
        for curve in kin.self_motions(kin.fk(q), limits=limits)
    )


@pytest.mark.parametrize("bent", [0.03, *slow(0.3, 0.1, 0.07, 0.01, 0.001)])
def test_no_curve_next_to_a_stretched_elbow_is_lost(panda, bent):
    rng = np.random.default_rng(int(1e4 * bent))
    for _ in range(6):
        q = rng.uniform(-np.pi, np.pi, 7)
        q[3] = bent * rng.choice([-1, 1])
        assert distance_from_curves(panda, q, limits=False) < 0.15


@pytest.mark.parametrize(
    "q",
    [
        [-1.52616, -1.63918, 1.56575, -0.07458, -1.58628, 0.5957, -0.88307],
        [1.86595, 0.97253, -1.48503, -0.07133, 2.64862, 1.3473, -1.2228],
        [2.20166, -1.2023, -2.79062, -0.07568, 0.13902, 2.21535, 1.93483],
    ],
)
def test_a_seed_that_reaches_the_pose_is_returned(panda, q):
    result = panda.nearest(panda.fk(q), q)
    assert result.success
    assert np.abs(result.q - q).max() < 1e-6


def test_nearest_returns_seeds_of_random_postures_next_to_the_elbow(panda):
    rng, tried = np.random.default_rng(5), 0
    while tried < 8:
        q = rng.uniform(panda.lower, panda.upper)
        q[3] = -rng.uniform(0.07, 0.12)
        if not panda.within_limits(q):
            continue
        tried += 1
        result = panda.nearest(panda.fk(q), q)
        assert result.success
        assert np.abs(result.q - q).max() < 1e-6
