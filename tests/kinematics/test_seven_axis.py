"""Seven-axis arms: the postures of a pose as curves, against ssik's samples and by Pinocchio."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from example_robot_data.robots_loader import getModelPath

from benchmarks.ik_arms.random_arms import RIGHT, apart, kinematics, motion, random_motion
from benchmarks.ik_arms.self_motions import ARMS, checked, faultless
from kinreach.errors import InputError
from kinreach.kinematics import (
    ArmKinematics,
    AxisGoal,
    ClosedFormSolver,
    CollisionChecker,
    PositionGoal,
    SevenAxisKinematics,
    Status,
)
from kinreach.robots import ArmDescription
from tests.cases import slow
from tests.kinematics.test_six_axis_closed_form import of_ssik

FILE = "panda_description/urdf/panda.urdf"


@pytest.fixture(scope="module")
def panda():
    kin = ArmKinematics.from_urdf(f"{getModelPath(FILE)}/{FILE}")
    assert type(kin) is SevenAxisKinematics
    return kin


def wrapped(q):
    return (q + np.pi) % (2 * np.pi) - np.pi


def on_a_curve(kin, T, curves, q):
    """Whether a posture is one of a curve's, between two samples too."""
    for curve in curves:
        apart = wrapped(curve.q - q)
        nearest = int(np.linalg.norm(apart, axis=1).argmin())
        start = curve.q[nearest] - (apart[nearest] @ curve.tangent[nearest]) * curve.tangent[nearest]
        there, _, _ = kin._tracer.corrected(start[None], T, curve.tangent[nearest][None])
        if np.abs(wrapped(there[0] - q)).max() < 5e-3:
            return True
    return False


def exact(kin, T, motions):
    """Every sample reaches the pose, the tip stands still along the tangents, and there are no gaps."""
    for curve in motions:
        assert np.abs(kin.fk(curve.q) - T).max() < 1e-9
        assert np.abs(np.einsum("mij,mj->mi", kin.jacobian(curve.q), curve.tangent)).max() < 1e-9
        assert np.linalg.norm(np.diff(curve.q, axis=0), axis=1).max() < 0.16
        ahead = np.einsum("mi,mi->m", np.diff(curve.q, axis=0), curve.tangent[:-1])
        assert (ahead > 0).all()


def test_the_posture_that_made_the_pose_is_on_a_closed_curve(panda):
    count = 0
    for q in np.random.default_rng(0).uniform(-np.pi, np.pi, (5, 7)):
        T = panda.fk(q)
        motions = panda.self_motions(T, limits=False)
        exact(panda, T, motions)
        assert all(curve.closed for curve in motions)
        assert on_a_curve(panda, T, motions, q)
        count += len(motions)
    assert count >= 20


def test_a_short_curve_is_found(panda):
    """With the elbow almost straight neither the first joint nor the last moves by as much as what they are held at."""
    for q in ([-1.71, -2.36, -2.93, 0.02, -2.37, -2.03, 2.26], [-0.36, -1.89, 1.33, 0.02, 2.32, 2.49, -1.15]):
        T = panda.fk(np.array(q))
        motions = panda.self_motions(T, limits=False)
        exact(panda, T, motions)
        assert on_a_curve(panda, T, motions, np.array(q))
        assert all(curve.closed for curve in motions)


def test_an_arm_that_is_off_its_data_sheet_has_its_curves(panda, tmp_path):
    """Each joint by a millimetre and a milliradian, as a calibration has it: no closed form is left."""
    rng = np.random.default_rng(1)
    chain = np.array(panda.chain.placements)
    kin = kinematics(tmp_path, np.array([step @ random_motion(rng, 1e-3, 1e-3) for step in chain]))
    assert type(kin) is SevenAxisKinematics
    for q in rng.uniform(-3, 3, (2, 7)):
        T = kin.fk(q)
        motions = kin.self_motions(T)
        exact(kin, T, motions)
        assert on_a_curve(kin, T, motions, q)


@pytest.mark.parametrize("name", ["iiwa14_ik", *slow("j2s7s300_ik", "rizon4_ik")])
def test_every_sample_of_ssik_is_on_a_curve(name, tmp_path):
    (arm, kin), compared = of_ssik(tmp_path, name), 0
    for q in np.random.default_rng(2).uniform(-np.pi, np.pi, (2, 7)):
        T = arm.fk(q)
        motions = kin.self_motions(T, limits=False)
        exact(kin, T, motions)
        samples = [one.q for one in arm.solve(T, respect_limits=False, enumerate_windings=False)]
        assert all(on_a_curve(kin, T, motions, one) for one in [q, *samples[::4]])
        compared += len(samples[::4])
    assert compared >= 20


def test_no_curve_is_lost_where_two_almost_meet(tmp_path):
    """With the elbow almost folded all curves come near singular postures, and four pairs near each other."""
    (arm, kin), q = (
        of_ssik(tmp_path, "iiwa7_ik"),
        np.array([-0.994, 0.2744, -1.9082, 3.1173, -1.6134, -1.5276, -2.6817]),
    )
    T = arm.fk(q)
    motions = kin.self_motions(T, limits=False)
    exact(kin, T, motions)
    assert [curve.closed for curve in motions] == [True] * 8
    samples = [one.q for one in arm.solve(T, respect_limits=False, enumerate_windings=False)]
    assert len(samples) >= 100
    assert all(on_a_curve(kin, T, motions, one) for one in [q, *samples[::10]])


@pytest.mark.slow
@pytest.mark.parametrize("errors", [False, True])
@pytest.mark.parametrize("name", ARMS)
def test_a_grid_twice_as_fine_finds_no_further_curve(name, errors):
    """Nor does ssik find a posture beside the curves."""
    pytest.importorskip("ssik")
    rows = [checked(name, errors, posture, full=True) for posture in range(5000, 5002)]
    assert all(map(faultless, rows)), rows
    assert sum(row["curves"] for row in rows) >= 4
    assert errors or sum(row["samples"] for row in rows) >= 30


@pytest.mark.slow
def test_the_curves_of_a_folded_elbow_are_found(tmp_path):
    """The wrist is as near to the shoulder as it comes, 0.02 m, and moves away slowly: the curves are on a boundary."""
    lengths, tilts = (0.36, 0, 0.42, 0, 0.4, 0, 0.126), (-RIGHT, RIGHT, RIGHT, -RIGHT, -RIGHT, RIGHT, 0)
    links = (motion(0, length, 0, tilt) for length, tilt in zip(lengths, tilts, strict=True))
    kin, rng = kinematics(tmp_path, np.array([np.eye(4), *links])), np.random.default_rng(1)
    for _ in range(2):
        q = rng.uniform(-2.8, 2.8, 7)
        q[3] = np.pi
        q[[1, 5]] = np.copysign(np.maximum(np.abs(q[[1, 5]]), 0.05), q[[1, 5]])  # and nothing else is singular
        T = kin.fk(q)
        motions = kin.self_motions(T, limits=False)
        exact(kin, T, motions)
        assert len(motions) == 8  # two of the shoulder, two of the wrist, and both sides of the elbow
        assert all(curve.closed for curve in motions)
        assert min(apart(q, curve.q) for curve in motions) < 0.1
        assert np.abs(np.sin(kin.nearest(T, q).q - q)).max() < 1e-6


@pytest.mark.slow
def test_the_curves_of_an_elbow_that_is_stretched_or_almost_so_are_found(tmp_path):
    """Only joints 3 and 5 move along them: they lie between two values of the first joint and of the last.

    Every posture on them is singular if the elbow is exactly stretched; each curve is there for both sides of it.
    """
    lengths, tilts = (0.34, 0, 0.4, 0, 0.4, 0, 0.126), (-RIGHT, RIGHT, RIGHT, -RIGHT, -RIGHT, RIGHT, 0)
    links = (motion(0, length, 0, tilt) for length, tilt in zip(lengths, tilts, strict=True))
    kin, rng, found = kinematics(tmp_path, np.array([np.eye(4), *links])), np.random.default_rng(0), 0
    for bent in (1e-2, 1e-3, 1e-5, 1e-6, 1e-8, 0.0):
        q = rng.uniform(-2.8, 2.8, 7)
        q[3] = bent * rng.choice([-1, 1])
        q[[1, 5]] = np.copysign(np.maximum(np.abs(q[[1, 5]]), 0.05), q[[1, 5]])  # and nothing else is singular
        T = kin.fk(q)
        motions = kin.self_motions(T, limits=False)
        exact(kin, T, motions)
        assert all(curve.closed for curve in motions)
        assert apart(q, kin.nearest(T, q).q[None]) < 5e-5
        for curve in motions:
            assert np.abs(kin.fk(curve.at(0.7 * curve.total)) - T).max() < 1e-9
        found += len(motions)
    assert found == 8 * 6


def test_limits_cut_the_curves_where_a_joint_is_at_its_limit(panda):
    ends = kept = 0
    for q in np.random.default_rng(3).uniform(panda.lower, panda.upper, (4, 7)):
        T = panda.fk(q)
        motions, whole = panda.self_motions(T), panda.self_motions(T, limits=False)
        exact(panda, T, motions)
        assert on_a_curve(panda, T, motions, q)
        assert list(motions) == sorted(motions, key=lambda curve: -curve.total)
        for curve in motions:
            assert all(map(panda.within_limits, curve.q))
            for end in () if curve.closed else (curve.q[0], curve.q[-1]):
                assert np.abs(np.concatenate([end - panda.lower, end - panda.upper])).min() < 1e-8
                ends += 1
        for curve in whole:
            posture = panda.lower + np.mod(curve.q[::25] - panda.lower, 2 * np.pi)
            for one in posture[(posture < panda.upper - 0.1).all(axis=1) & (posture > panda.lower + 0.1).all(axis=1)]:
                assert on_a_curve(panda, T, motions, one)
                kept += 1
    assert ends >= 12
    assert kept >= 10


def test_a_curve_gives_the_posture_at_every_length(panda):
    T = panda.fk(np.array([0.3, -0.5, 0.2, -2.0, 0.4, 1.8, 0.6]))
    curve = panda.self_motions(T, limits=False)[0]
    assert curve.closed
    rng, tried = np.random.default_rng(4), 0
    for length in rng.uniform(0, curve.total, 30):
        q = curve.at(length)
        np.testing.assert_allclose(panda.fk(q), T, atol=1e-9)
        assert np.linalg.norm(wrapped(curve.q - q), axis=1).min() < 0.11
        np.testing.assert_allclose(curve.at(length + curve.total), q, atol=1e-6)
        tried += 1
    assert tried == 30
    with pytest.raises(InputError, match="length must be between 0 and"):
        panda.self_motions(T)[0].at(99.0)


def test_the_nearest_posture_is_nearer_than_any_sample(panda):
    rng, moved = np.random.default_rng(5), 0
    for q in rng.uniform(panda.lower, panda.upper, (2, 7)):
        T, seed = panda.fk(q), rng.uniform(panda.lower, panda.upper)
        np.testing.assert_allclose(panda.nearest(T, q).q, q, atol=1e-6)
        found = panda.nearest(T, seed)
        motions = panda.self_motions(T)
        assert found.success
        assert panda.within_limits(found.q)
        assert max(found.position_error, found.orientation_error) < 1e-9
        best = min(np.linalg.norm(curve.q - seed, axis=1).min() for curve in motions)
        assert np.linalg.norm(found.q - seed) <= best
        other = panda.nearest(T, seed, accept=lambda posture, known=found.q: np.linalg.norm(posture - known) > 1.0)
        assert np.linalg.norm(other.q - found.q) > 1.0
        moved += other.success
        refused = panda.nearest(T, seed, accept=lambda _: False)
        assert (refused.status, refused.reason) == (Status.REJECTED, "accept refused every posture on the curves")
    assert moved == 2


def test_the_best_postures_are_better_than_every_sample(panda):
    checker = CollisionChecker(panda, meshes="hulls")
    q = np.array([0.3, -0.5, 0.2, -2.0, 0.4, 1.8, 0.6])
    T = panda.fk(q)
    motions = panda.self_motions(T)

    def measure(posture):
        J = panda.jacobian(posture)
        return np.sqrt(np.linalg.det(J @ J.T))

    dexterous, clear = panda.manipulable(T), panda.clearest(T, checker)
    for found in (dexterous, clear):
        assert found.success
        np.testing.assert_allclose(panda.fk(found.q), T, atol=1e-9)
    samples = np.vstack([curve.q for curve in motions])
    assert measure(dexterous.q) >= max(map(measure, samples))
    assert checker.distance(clear.q).distance >= max(checker.distance(one).distance for one in samples[::10])
    assert checker.free(clear.q)


def test_of_equally_good_postures_the_nearest_to_the_middle_of_the_limits_is_returned(panda):
    """A Panda reaches a pose from either side of its shoulder, with the same manipulability."""

    def off_middle(posture):
        return np.linalg.norm((posture - 0.5 * (panda.lower + panda.upper)) / (panda.upper - panda.lower))

    rng, mirrored = np.random.default_rng(5), 0
    for q in rng.uniform(panda.lower, panda.upper, (10, 7)):
        found = panda.manipulable(panda.fk(q)).q
        over = found.copy()
        over[[0, 2]] -= np.pi * np.sign(over[[0, 2]])
        over[1] *= -1.0
        np.testing.assert_allclose(panda.fk(over), panda.fk(found), atol=1e-9)
        if panda.within_limits(over):
            mirrored += 1
            assert off_middle(found) <= off_middle(over) + 1e-3
    assert mirrored >= 4


def test_goals_and_reasons(panda):
    q = np.array([0.3, -0.5, 0.2, -2.0, 0.4, 1.8, 0.6])
    T, solver = panda.fk(q), ClosedFormSolver(panda)
    down = solver.solve(AxisGoal(T[:3, 3], T[:3, 2]), q)
    assert down.success
    assert max(down.position_error, down.orientation_error) < 1e-8
    assert panda.within_limits(down.q)
    never = solver.solve(AxisGoal(T[:3, 3], T[:3, 2]), q, accept=lambda _: False)
    assert never.status is Status.REJECTED
    with pytest.raises(InputError, match="not for a bare position"):
        solver.solve(PositionGoal(T[:3, 3]), q)
    T[:3, 3] += 3.0
    for lost in (panda.self_motions(T), panda.nearest(T, q), solver.solve(AxisGoal(T[:3, 3], T[:3, 2]), q)):
        assert (lost.status, lost.reason) == (Status.OUT_OF_REACH, "no posture reaches the goal")
    assert len(panda.self_motions(T)) == 0
    assert not panda.manipulable(T).success
    with pytest.raises(InputError, match="6 joints; seven are needed"):
        SevenAxisKinematics("ur5")


def test_seven_axes_in_a_plane_are_refused(tmp_path):
    chain = np.tile(np.eye(4), (8, 1, 1))
    chain[:, 0, 3] = 0.2
    kin = kinematics(tmp_path, chain)
    assert type(kin) is ArmKinematics
    with pytest.raises(InputError, match="the other six cannot be solved"):
        SevenAxisKinematics(kin.arm)
    with pytest.raises(InputError, match="has no closed form"):
        ClosedFormSolver(kin)


def test_narrow_limits_leave_no_posture(panda):
    """The reason says so."""
    q = np.array([0.3, -0.5, 0.2, -2.0, 0.4, 1.8, 0.6])
    text = panda.arm.urdf.replace('upper="-0.0698"', 'upper="-3.07"')
    assert text != panda.arm.urdf
    arm: ArmDescription = replace(panda.arm, build_urdf=partial(str, text), home=np.r_[q[:3], -3.071, q[4:]])
    kin = ArmKinematics.of(arm)
    none = kin.self_motions(kin.fk(q))
    assert (none.status, none.reason) == (Status.OUT_OF_LIMITS, "every posture is outside the joint limits")
