"""Seven axes: nothing that reaches a pose is beside its curves, near every singularity and for every arm of ssik.

Postures come from the pose's making and from Newton's method out of random ones, and curves are compared with cubics
between their samples: nothing here is what the curves are made by.
"""

import numpy as np
import pytest

from benchmarks.ik_arms.self_motions import ARMS, arm_of
from kinreach.kinematics import ArmKinematics

#: Poses near each of a Panda's singularities, in parts that each take less than 90 s.
POSES, PARTS = 1000, 4
#: Angles of a Panda's joints (0 is the first) at its singularities and where its links are in line, and how far beside
#: [rad]. Within the limits the elbow is bent by 0.07 and more.
SINGULAR = {
    "elbow stretched": ({3: 0.0}, 0.01, 0.07),
    "elbow within its limits": ({3: -0.0698}, 0.0, 0.05),
    "shoulder straight": ({1: 0.0}, 1e-6, 0.07),
    "wrist straight": ({5: 0.0}, 1e-6, 0.07),
    "shoulder straight and elbow stretched": ({1: 0.0, 3: 0.0}, 1e-3, 0.07),
}
#: Poses of each arm, and random starts of Newton's method at each.
ORACLE_POSES, STARTS, STEPS = 100, 300, 25
#: A cubic between two samples is nearer than this to the curve [rad].
CUBIC = 2e-3


def wrapped(q):
    return (q + np.pi) % (2.0 * np.pi) - np.pi


def beside(motions, q):
    """Which of postures (m, 7) are on no curve: distance from the cubics between its samples [rad]."""
    nearest = np.full(len(q), np.inf)
    for curve in motions:
        ends = np.arange(len(curve.q) - (not curve.closed)) if len(curve.q) > 1 else np.empty(0, dtype=int)
        samples = np.linalg.norm(wrapped(q[:, None] - curve.q), axis=2)
        nearest = np.minimum(nearest, samples.min(axis=1))
        begin, end = curve.q[ends], curve.q[(ends + 1) % len(curve.q)]
        out, into = curve.tangent[ends], curve.tangent[(ends + 1) % len(curve.q)]
        away = wrapped(end - begin)
        length = np.linalg.norm(away, axis=1, keepdims=True)
        row, piece = np.nonzero(samples[:, ends] < length[:, 0] + CUBIC)
        u = np.linspace(0.0, 1.0, 81)[:, None, None]
        cubics = u**2 * (3.0 - 2.0 * u) * away + length * u * (1.0 - u) * ((1.0 - u) * out - u * into)
        apart = np.linalg.norm(wrapped(q[row] - begin[piece]) - cubics[:, piece], axis=2).min(axis=0, initial=np.inf)
        np.minimum.at(nearest, row, apart)
    return nearest > CUBIC


def made_near(kin, angles, least, most, rng):
    """A posture with some joints so far beside angles, within the limits if these are."""
    q = rng.uniform(kin.lower, kin.upper)
    for joint, angle in angles.items():
        beside_it = rng.choice([-1.0, 1.0]) * rng.uniform(least, most)
        q[joint] = angle - abs(beside_it) if least == 0.0 else angle + beside_it
    return q


def reached_from_anywhere(kin, T, rng):
    """Postures that reach a pose, by damped Newton steps from random ones."""
    q = rng.uniform(-np.pi, np.pi, (STARTS, 7))
    for _ in range(STEPS):
        reached = kin.fk(q)
        turn = T[:3, :3] @ reached[:, :3, :3].transpose(0, 2, 1)
        axis = 0.5 * np.stack([turn[:, i, j] - turn[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1)
        error = np.concatenate([T[:3, 3] - reached[:, :3, 3], axis], axis=1)
        J = kin.jacobian(q)
        damped = J @ J.transpose(0, 2, 1) + 1e-3 * np.linalg.norm(error, axis=1)[:, None, None] ** 2 * np.eye(6)
        step = (J.transpose(0, 2, 1) @ np.linalg.solve(damped + 1e-15 * np.eye(6), error[..., None]))[..., 0]
        q += step * np.minimum(1.0, 0.5 / np.maximum(np.abs(step).max(axis=1), 0.5))[:, None]
    return q[np.abs(kin.fk(q) - T).max(axis=(1, 2)) < 1e-11]


@pytest.mark.slow
@pytest.mark.parametrize("part", range(PARTS))
@pytest.mark.parametrize("where", SINGULAR)
def test_next_to_its_singularities_a_panda_loses_no_posture(where, part):
    """The posture behind the pose is on a curve, exact, and `nearest` returns nothing farther."""
    kin, tried, within = ArmKinematics.of("panda"), 0, 0
    for index in range(part, POSES, PARTS):
        rng = np.random.default_rng([index, *where.encode()])
        q = made_near(kin, *SINGULAR[where], rng)
        T = kin.fk(q)
        motions = kin.self_motions(T, limits=False)
        assert not beside(motions, q[None]).any(), index
        assert max(np.abs(kin.fk(curve.q) - T).max() for curve in motions) < 1e-9, index
        tried += 1
        if kin.within_limits(q):
            within += 1
            found = kin.nearest(T, q)
            assert found.success, index
            assert np.linalg.norm(found.q - q) < 1e-6, index
            assert max(found.position_error, found.orientation_error) < 1e-9, index
    assert tried == POSES // PARTS
    assert within >= tried // 3 or where in ("elbow stretched", "shoulder straight and elbow stretched")


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_what_newtons_method_reaches_from_anywhere_is_on_the_curves(name):
    pytest.importorskip("ssik")
    kin, compared = arm_of(name, False), 0
    for index in range(ORACLE_POSES):
        rng = np.random.default_rng([index, 11])
        q = rng.uniform(-np.pi, np.pi, 7)
        T = kin.fk(q)
        motions = kin.self_motions(T, limits=False)
        postures = np.vstack([q, reached_from_anywhere(kin, T, rng)])
        assert not beside(motions, postures).any(), index
        compared += len(postures)
    assert compared >= 50 * ORACLE_POSES


def test_an_xarm7_has_eight_curves_at_a_folded_elbow():
    """Two of them, through this posture, were lost."""
    pytest.importorskip("ssik")
    kin = arm_of("xArm7", False)
    q = np.array([0.94275769, -1.36096347, -1.59056325, -3.13653089, 2.21175882, -1.36126508, 1.97164097])
    T = kin.fk(q)
    motions = kin.self_motions(T, limits=False)
    assert len(motions) == 8
    assert all(curve.closed for curve in motions)
    assert [beside([curve], q[None]).item() for curve in motions].count(False) == 1
    found = kin.nearest(T, q)
    assert found.success
    assert np.abs(found.q - q).max() < 1e-6
