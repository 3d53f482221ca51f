"""Seven axes where two pairs of axes coincide, or almost: the postures of a pose are a surface, and none is lost."""

import numpy as np
import pytest

from benchmarks.ik_arms.random_arms import RIGHT, kinematics, motion
from tests.cases import slow

#: Lengths along and angles between the axes of an arm with a spherical shoulder, a spherical wrist and no offsets.
LENGTHS, TILTS = (0.34, 0, 0.4, 0, 0.4, 0, 0.126), (-RIGHT, RIGHT, RIGHT, -RIGHT, -RIGHT, RIGHT, 0)
CHAIN = np.array([np.eye(4), *(motion(0, d, 0, tilt) for d, tilt in zip(LENGTHS, TILTS, strict=True))])
#: Joints (0 is the first) that are straight, and two ways in which the arm then moves without its tip.
SURFACES = {
    "shoulder and wrist straight": ((1, 5), (1, 0, -1, 0, 0, 0, 0), (0, 0, 0, 0, 1, 0, -1)),
    "shoulder straight, elbow stretched": ((1, 3), (1, 0, -1, 0, 0, 0, 0), (0, 0, 1, 0, -1, 0, 0)),
    "elbow stretched, wrist straight": ((3, 5), (0, 0, 1, 0, -1, 0, 0), (0, 0, 0, 0, 1, 0, -1)),
}
#: Farthest from a posture of a surface to one that is listed, in the joint that differs most [rad].
NEXT = 0.4


@pytest.fixture(scope="module")
def kin(tmp_path_factory):
    return kinematics(tmp_path_factory.mktemp("arm"), CHAIN)


def farthest_joint(q, others):
    return np.abs((others - q + np.pi) % (2 * np.pi) - np.pi).max(axis=-1).min(initial=np.inf)


def posture_at(rng, joints, off=0.0):
    """A random posture with some joints straight, or almost, and no other."""
    q = rng.uniform(-2.8, 2.8, 7)
    q[[1, 3, 5]] = np.copysign(np.maximum(np.abs(q[[1, 3, 5]]), 0.1), q[[1, 3, 5]])
    q[list(joints)] = rng.uniform(-off, off, len(joints))
    return q


def exact(kin, T, motions):
    for postures in [*(curve.q for curve in motions), *motions.surfaces]:
        assert np.abs(kin.fk(postures) - T).max() < 1e-9


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.slow
def test_a_surface_is_one_family_and_its_postures_are_all_over_it(kin, name):
    joints, *ways = SURFACES[name]
    rng, tried = np.random.default_rng(1), 0
    for _ in range(2):
        q = posture_at(rng, joints)
        T = kin.fk(q)
        motions = kin.self_motions(T, limits=False)
        assert motions.success
        assert len(motions.surfaces) == 2  # the elbow on either side, or the wrist turned over
        assert all(len(curve.q) > 1 for curve in motions)
        exact(kin, T, motions)
        on_it = q + rng.uniform(-np.pi, np.pi, (100, 2)) @ ways
        assert np.abs(kin.fk(on_it) - T).max() < 1e-12
        (own,) = (cover for cover in motions.surfaces if farthest_joint(q, cover) < NEXT)
        assert max(farthest_joint(one, own) for one in on_it) < NEXT
        tried += len(on_it)
    assert tried == 200


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.slow
def test_the_nearest_posture_of_a_surface_is_nearer_than_any_sample(kin, name):
    joints, *ways = SURFACES[name]
    rng = np.random.default_rng(2)
    q, seed = posture_at(rng, joints), rng.uniform(-2.8, 2.8, 7)
    T = kin.fk(q)
    on_it = q + rng.uniform(-np.pi, np.pi, (4000, 2)) @ ways
    on_it = on_it[(on_it >= kin.lower).all(axis=1) & (on_it <= kin.upper).all(axis=1)]
    assert len(on_it) > 100
    found = kin.nearest(T, seed)
    assert found.success
    assert kin.within_limits(found.q)
    assert max(found.position_error, found.orientation_error) < 1e-9
    assert np.linalg.norm(found.q - seed) <= np.linalg.norm(on_it - seed, axis=1).min() + 1e-6
    itself = kin.nearest(T, q)
    assert np.linalg.norm(itself.q - q) < 1e-6
    motions = kin.self_motions(T, seed=q)
    assert farthest_joint(q, motions.surfaces[itself.branch - len(motions)]) < NEXT
    assert kin.manipulable(T).success


def test_postures_of_a_surface_are_wound_into_the_limits(tmp_path):
    kin = kinematics(tmp_path, CHAIN, np.array([[-1.5, 1.5]] * 7).T)
    q = np.array([0.4, 0.0, -0.3, 0.9, 0.5, 0.0, 0.2])
    motions = kin.self_motions(kin.fk(q))
    assert len(motions.surfaces) == 1
    assert all(map(kin.within_limits, motions.surfaces[0]))
    assert farthest_joint(q, motions.surfaces[0]) < NEXT
    exact(kin, kin.fk(q), motions)


#: Of all cases those that `make test` tries.
FEW = (("shoulder straight, elbow stretched", 1e-5), ("shoulder and wrist straight", 1e-6))
ALMOST = [(name, off) for name in SURFACES for off in (1e-9, 1e-8, 1e-7, 1e-6, 1e-5)]


@pytest.mark.parametrize(("name", "off"), [*FEW, *slow(*(case for case in ALMOST if case not in FEW))])
def test_no_posture_is_lost_where_two_pairs_of_axes_almost_coincide(kin, name, off):
    rng, tried = np.random.default_rng(3), 0
    for _ in range(3):
        q = posture_at(rng, SURFACES[name][0], off)
        T = kin.fk(q)
        motions = kin.self_motions(T, limits=False)
        exact(kin, T, motions)
        on_curve = min((farthest_joint(q, curve.q) for curve in motions), default=np.inf) < 0.15
        assert on_curve or min(farthest_joint(q, cover) for cover in motions.surfaces) < NEXT
        found = motions.nearest(q)
        assert found.success
        assert np.linalg.norm(found.q - q) < 1e-6
        tried += 1
    assert tried == 3
