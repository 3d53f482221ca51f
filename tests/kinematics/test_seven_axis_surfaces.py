"""Seven axes where two pairs of axes coincide, or almost: the postures of a pose are a surface, and none is lost."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.ik_arms.random_arms import RIGHT, kinematics, motion
from kinreach.kinematics import Status
from kinreach.kinematics._seven_axis.starts import NEAR, NOT_BETTER, REACHED, STEPS
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


@pytest.mark.parametrize("name", ["shoulder and wrist straight", *slow(*list(SURFACES)[1:])])
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


@pytest.mark.parametrize("name", SURFACES)
def test_polishing_brings_postures_nearer_where_newtons_method_is_slow(kin, name):
    rng, starts, tried, arrived = np.random.default_rng(3), kin._tracer._starts, 0, 0
    for off in np.repeat((1e-7, 1e-6), 6):
        q = posture_at(rng, SURFACES[name][0], off)
        T = kin.fk(q)
        near, before = starts._newton(q + rng.uniform(-1e-3, 1e-3, (20, 7)), T, STEPS)
        going = (before >= REACHED) & (before < NEAR)
        polished, after = starts._polished(near[going], T)
        assert (after <= before[going] + 1e-14).all()
        assert np.abs(kin.fk(polished) - T).max(initial=0.0) < NOT_BETTER
        tried, arrived = tried + going.sum(), arrived + (after < 0.1 * before[going]).sum()
    assert tried > 60
    assert arrived > 0.5 * tried


#: Of the arm with its shoulder and its wrist straight: the ways in which it moves without its tip.
WAYS = np.array(SURFACES["shoulder and wrist straight"][1:], dtype=float)


class Nearness:
    """Stands in for a collision checker: the clearest posture is the one nearest to a wanted one."""

    def __init__(self, wanted, *, free=True):
        self.wanted, self.is_free = wanted, free

    def distance(self, q):
        return SimpleNamespace(distance=2.0 - np.linalg.norm(q - self.wanted))

    def free(self, q):
        return self.is_free


def test_the_best_posture_of_a_surface_is_found_between_its_samples(kin):
    """Beside a surface, the posture nearest to a point is where the point is projected to."""
    rng = np.random.default_rng(4)
    q = posture_at(rng, (1, 5))
    motions = kin.self_motions(kin.fk(q), limits=False)
    motions = replace(motions, curves=[])
    beside = rng.normal(size=7)
    beside -= beside @ np.linalg.pinv(WAYS) @ WAYS
    beside *= 0.05 / np.linalg.norm(beside)
    nearest = q + rng.uniform(-1.0, 1.0, 2) @ WAYS
    found = motions.clearest(Nearness(nearest + beside))
    assert found.success
    assert np.abs(found.q - nearest).max() < 1e-3
    assert min(np.linalg.norm(cover - nearest, axis=1).min() for cover in motions.surfaces) > 0.01
    assert farthest_joint(q, motions.surfaces[found.branch]) < NEXT
    refused = motions.clearest(Nearness(nearest + beside, free=False))
    assert (refused.status, refused.reason) == (Status.REJECTED, "every posture collides")
    assert refused.branch == found.branch
    np.testing.assert_allclose(refused.q, found.q, atol=1e-12)


def test_a_way_over_a_surface_ends_at_the_limits(tmp_path):
    """The nearest posture within them is worked out by hand: each of the two ways moves two joints of its own."""
    kin = kinematics(tmp_path, CHAIN, np.array([[-1.5, 1.5]] * 7).T)
    rng, at_limit, inside = np.random.default_rng(0), 0, 0
    q = np.array([0.4, 0.0, -0.3, 0.9, 0.5, 0.0, 0.2])
    motions = kin.self_motions(kin.fk(q))
    (cover,) = motions.surfaces
    for _ in range(8):
        seed = q + rng.uniform(-2.5, 2.5, 2) @ WAYS + rng.uniform(-0.2, 0.2, 7)
        wanted = (seed - q) @ WAYS.T / 2.0
        shares = [
            np.clip(share, max(-1.5 - q[ahead], q[back] - 1.5), min(1.5 - q[ahead], q[back] + 1.5))
            for share, ahead, back in zip(wanted, (0, 4), (2, 6), strict=True)
        ]
        best = np.linalg.norm(q + shares @ WAYS - seed)
        found = motions.nearest(seed)
        assert found.success
        assert kin.within_limits(found.q)
        apart = np.linalg.norm(found.q - seed)
        assert apart >= best - 1e-9
        if np.allclose(shares, wanted):
            assert apart == pytest.approx(best, abs=1e-6)
            inside += 1
        else:  # straight on until a joint is at its limit
            assert np.abs(found.q).max() == pytest.approx(1.5, abs=1e-5)
            assert apart < np.linalg.norm(cover - seed, axis=1).min() - 0.05
            at_limit += 1
    assert (at_limit, inside) == (5, 3)


def test_with_the_elbow_stretched_curves_are_followed_a_little_within_reach(kin, monkeypatch):
    """Joints 3 and 5 then turn about one axis: each curve has a length of 2 pi sqrt(2), and the elbow hardly bends."""
    monkeypatch.setattr("kinreach.kinematics._seven_axis.starts.RANDOM", 8)  # no posture reaches farther out
    rng, checked = np.random.default_rng(1), 0
    q = posture_at(rng, (3,))
    T, turns = kin.fk(q), np.linspace(-3.0, 3.0, 20)[:, None] * [0, 0, 1, 0, -1, 0, 0]
    motions = kin.self_motions(T, seed=q, limits=False)
    exact(kin, T, motions)
    assert not motions.surfaces
    assert len(motions) == 8
    for curve in motions:
        assert curve.closed
        assert curve.total == pytest.approx(2.0 * np.pi * np.sqrt(2.0), abs=1e-3)
        assert 1e-6 < np.abs(curve.q[:, 3]).max() < 1e-4
        assert 1e-11 < np.abs(kin.fk(curve.q)[:, :3, 3] - T[:3, 3]).max() < 2e-10
    for shoulder, wrist in ((False, False), (True, False), (False, True), (True, True)):  # turned over
        family = q.copy()
        if shoulder:
            family[[0, 2]] += np.pi
            family[1] *= -1.0
        if wrist:
            family[[4, 6]] += np.pi
            family[5] *= -1.0
        assert np.abs(kin.fk(family + turns) - T).max() < 1e-12
        for one in family + turns:
            assert sorted(farthest_joint(one, curve.q) for curve in motions)[1] < 0.06  # the elbow to either side
            checked += 1
    assert checked == 80


def test_curves_that_cross_where_the_shoulder_is_straight_are_all_found(kin):
    """Joints 1 and 3 turn about one axis there: the elbow may go around with these alone, or with all joints."""
    rng, checked = np.random.default_rng(2), 0
    q = posture_at(rng, (1,))
    T = kin.fk(q)
    motions = kin.self_motions(T, limits=False)
    exact(kin, T, motions)
    assert not motions.surfaces
    around = q + np.linspace(-np.pi, np.pi, 40)[:, None] * [1, 0, -1, 0, 0, 0, 0]
    assert np.abs(kin.fk(around) - T).max() < 1e-12
    for one in around:
        assert min(farthest_joint(one, curve.q) for curve in motions) < 0.12
        checked += 1
    for curve in motions:
        assert np.linalg.norm(np.diff(curve.q, axis=0), axis=1).max(initial=0.0) < 0.16
        assert not curve.closed  # it ends where it meets others
        assert np.abs(curve.q[[0, -1], 1]).max() < 1e-5
    half = [curve for curve in motions if curve.total == pytest.approx(np.pi * np.sqrt(2.0), abs=1e-3)]
    assert (len(motions), len(half), checked) == (16, 8, 40)
