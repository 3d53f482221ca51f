"""Arms with more joints than a pose needs: the nearest, clearest and most manipulable posture by numeric solvers."""

import re

import numpy as np
import pytest

from kinreach.cli import main
from kinreach.kinematics import ArmKinematics, CollisionChecker, RedundantKinematics, Status
from tests.kinematics.test_coupled_and_sliding import chain, joint, written
from tests.robots.peoples_files import arm


def random_arm(rng, joints, slides):
    """Joints in random places, the first of which slide."""
    numbers = lambda size: " ".join(map(str, rng.uniform(-size, size, 3)))  # noqa: E731
    kinds = ["prismatic"] * slides + ["revolute"] * (joints - slides)
    places = [{"xyz": numbers(0.3), "rpy": numbers(3.0), "axis": numbers(1.0)} for _ in kinds]
    ends = {"prismatic": (-0.6, 0.6), "revolute": (-2.9, 2.9)}
    return chain(
        *[
            (f"q{i}", kind, {**place, "limits": ends[kind]})
            for i, (kind, place) in enumerate(zip(kinds, places, strict=True))
        ]
    )


def arms(rng, folder):
    """Eight and nine joints, and seven or eight of which some slide."""
    for joints, slides in ((8, 0), (9, 0), (7, 1), (8, 2)):
        text = random_arm(rng, joints, slides)
        yield written(folder, text, joints=[f"q{i}" for i in range(joints)])


def test_nearest_is_exact_and_no_posture_next_to_it_is_nearer(tmp_path):
    rng, nearer, count = np.random.default_rng(0), 0, 0
    for kin in arms(rng, tmp_path):
        assert type(kin) is RedundantKinematics
        assert not kin.knows_all_postures
        for q in rng.uniform(0.7 * kin.lower, 0.7 * kin.upper, (3, kin.n)):
            T, seed = kin.fk(q), q + rng.uniform(-0.15, 0.15, kin.n)
            found = kin.nearest(T, seed)
            assert found.success, found
            assert np.abs(kin.fk(found.q) - T).max() < 1e-8
            assert kin.within_limits(found.q)
            scale = kin._scale
            inside = (found.q > kin.lower + 1e-6) & (found.q < kin.upper - 1e-6)
            if inside.all():
                null = np.linalg.svd(kin.jacobian(found.q) / scale)[2][6:]
                assert np.abs(null @ (scale * (seed - found.q))).max() < 1e-3
            nearer += np.linalg.norm(scale * (found.q - seed)) <= np.linalg.norm(scale * (q - seed)) + 1e-6
            count += 1
    assert (count, nearer) == (12, 12)


def test_the_most_manipulable_is_more_so_than_what_it_started_from(tmp_path):
    rng, better, count = np.random.default_rng(1), 0, 0
    for kin in arms(rng, tmp_path):
        for q in rng.uniform(0.6 * kin.lower, 0.6 * kin.upper, (1, kin.n)):
            found = kin.manipulable(kin.fk(q))
            assert found.success
            assert np.abs(kin.fk(found.q) - kin.fk(q)).max() < 1e-8
            much = [float(np.sqrt(np.linalg.det(J @ J.T))) for J in kin.jacobian(np.array([found.q, q]))]
            better, count = better + (much[0] >= much[1]), count + 1
    assert count == 4
    assert better >= 3


def test_the_clearest_is_clearer_than_what_it_started_from(tmp_path):
    rng, better = np.random.default_rng(2), 0
    kin = written(tmp_path, random_arm(rng, 8, 0))
    checker = CollisionChecker(kin)
    for q in rng.uniform(0.6 * kin.lower, 0.6 * kin.upper, (3, kin.n)):
        found = kin.clearest(kin.fk(q), checker)
        assert found.status in (Status.OK, Status.REJECTED)
        better += checker.distance(found.q).distance >= checker.distance(q).distance - 1e-9
    assert better >= 2


def test_a_pose_out_of_reach_and_what_accept_refuses(tmp_path):
    kin = written(tmp_path, random_arm(np.random.default_rng(3), 8, 0))
    T = kin.fk(kin.arm.home)
    refused = kin.nearest(T, kin.arm.home, accept=lambda q: False)
    assert refused.status is Status.REJECTED
    T[:3, 3] += 50.0
    far = kin.nearest(T, kin.arm.home)
    assert far.status is Status.NOT_CONVERGED
    assert "none of 8 attempts reached the pose" in far.reason
    with pytest.raises(AttributeError, match="has no all_solutions"):
        kin.all_solutions(T)


def test_a_rail_is_named_as_numeric(tmp_path, capsys):
    rail = joint("rail", "prismatic", "floor", axis="1 0 0", limits=(0, 3.0))
    rail = re.sub(r'<link name="rail_link">.*?</link>', "", rail).replace("rail_link", "l0")
    text = arm(more=f'<link name="floor"/>{rail}')
    taken = written(tmp_path, text, joints=["rail", *(f"j{i}" for i in range(1, 7))])
    assert type(taken) is RedundantKinematics
    q = np.array([1.2, 0.1, 0.5, 0.9, -0.4, 0.9, 0.2])
    found = taken.nearest(taken.fk(q), q)
    np.testing.assert_allclose(found.q, q, atol=1e-6)
    file = tmp_path / "arm.urdf"
    assert main(["check", str(file), "--joints", "rail,j1,j2,j3,j4,j5,j6", "--poses", "5"]) == 0
    assert "numeric: nearest, clearest and manipulable" in capsys.readouterr().out
    assert type(ArmKinematics.of(taken.arm)) is RedundantKinematics
