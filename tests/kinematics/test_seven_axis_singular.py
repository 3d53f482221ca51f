"""Seven axes next to singular postures: the curve of the posture behind a pose is there, `nearest` returns it."""

from dataclasses import replace

import numpy as np
import pytest
from example_robot_data.robots_loader import getModelPath

from benchmarks.ik_arms.random_arms import RIGHT, kinematics, motion
from kinreach._rotations import wrapped
from kinreach.kinematics import ArmKinematics, AxisGoal
from tests.cases import slow

PANDA = "panda_description/urdf/panda.urdf"
#: Lengths along and angles between the axes of an arm with a spherical shoulder, a spherical wrist and no offsets.
LENGTHS, TILTS = (0.34, 0, 0.4, 0, 0.4, 0, 0.126), (-RIGHT, RIGHT, RIGHT, -RIGHT, -RIGHT, RIGHT, 0)
LIKE_AN_IIWA = np.array([np.eye(4), *(motion(0, d, 0, tilt) for d, tilt in zip(LENGTHS, TILTS, strict=True))])


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


def test_a_direction_is_reached_by_the_postures_that_are_returned(tmp_path, monkeypatch):
    """Next to what the arm reaches with a joint held, postures that miss the goal by less than 1e-7 are none."""
    monkeypatch.setattr("kinreach.kinematics._seven_axis.kinematics.TURNS", np.arange(-4, 4) * RIGHT / 2)
    kin, rng, reached, tried = kinematics(tmp_path, LIKE_AN_IIWA), np.random.default_rng(3), 0, 0
    for index in range(10):
        q = np.round(rng.uniform(-np.pi, np.pi, 7) / RIGHT) * RIGHT if index % 2 else rng.uniform(-np.pi, np.pi, 7)
        q[3 if index % 4 < 2 else 5] = 0.0
        T = kin.fk(q)
        for beyond in (0.0, 1e-9, 1e-8, 5e-8):
            result = kin.solve(AxisGoal(T[:3, 3] * (1.0 + beyond), T[:3, 2]), q)
            tried += 1
            if result.success:
                reached += 1
                assert max(result.position_error, result.orientation_error) < 1e-9
    assert tried == 40
    assert reached >= 20


def test_nearest_passes_over_a_posture_that_misses_the_pose(panda):
    """`accept` does not see it."""
    q = np.array([0.3, -0.5, 0.2, -2.0, 0.4, 1.8, 0.6])
    motions = panda.self_motions(panda.fk(q))
    amiss = motions[0].q[:1] + 1e-6
    curve = replace(motions[0], q=amiss, length=np.zeros(1), total=0.0)
    motions = replace(motions, curves=[curve, *motions])
    seen = []
    for accept in (None, lambda posture: seen.append(posture) is None):
        result = motions.nearest(amiss[0], accept=accept)
        assert result.success
        assert max(result.position_error, result.orientation_error) < 1e-9
    assert len(seen) == 1
    assert np.abs(seen[0] - amiss[0]).max() > 1e-8
