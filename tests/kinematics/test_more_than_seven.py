"""Arms with more joints than a pose needs: the nearest, clearest and most manipulable posture by numeric solvers."""

import numpy as np
import pytest

from kinreach._rotations import small_motion
from kinreach.cli import main
from kinreach.errors import InputError
from kinreach.kinematics import CollisionChecker, RedundantKinematics, Status, pose_vector
from kinreach.robots import Box
from tests.kinematics.test_coupled_and_sliding import chain, written


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
    for joints, slides in ((8, 0), (9, 0), (7, 2), (8, 2)):
        text = random_arm(rng, joints, slides)
        yield written(folder, text, joints=[f"q{i}" for i in range(joints)])


@pytest.mark.slow
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


def around(kin, q, by):
    """Postures of the same pose, a step of so many scaled radians from one, either way along each free direction.

    Joints at a limit stay there.
    """
    held = np.eye(kin.n)[np.minimum(q - kin.lower, kin.upper - q) < 1e-9]
    still = np.vstack([kin.jacobian(q) / kin._scale, held])
    null = np.linalg.svd(still)[2][len(still) :]
    for way in np.vstack([null, -null]):
        other, T = q + by * way / kin._scale, kin.fk(q)
        for _ in range(5):  # back to the pose
            J = np.vstack([kin.jacobian(other), held])
            other = other + np.linalg.pinv(J) @ np.append(small_motion(T, kin.fk(other)), 0.0 * held @ q)
        assert np.abs(kin.fk(other) - T).max() < 1e-12
        yield other


@pytest.mark.parametrize("slides", [0, 2])
def test_no_posture_beside_the_nearest_is_nearer_and_none_beside_the_most_manipulable_more_so(slides, tmp_path):
    rng, count = np.random.default_rng(5), 0
    kin = written(tmp_path, random_arm(rng, 8, slides), joints=[f"q{i}" for i in range(8)])
    q = rng.uniform(0.5 * kin.lower, 0.5 * kin.upper)
    T, seed = kin.fk(q), q + rng.uniform(-0.3, 0.3, kin.n)
    for found, measure in (
        (kin.nearest(T, seed), lambda q: -np.linalg.norm(kin._scale * (q - seed))),
        (kin.manipulable(T), lambda q: np.prod(np.linalg.svd(kin.jacobian(q) / kin._scale)[1])),
    ):
        assert found.success
        assert np.abs(kin.fk(found.q) - T).max() < 1e-8
        for other in around(kin, found.q, 0.02):
            if kin.within_limits(other):
                assert measure(other) < measure(found.q)
                count += 1
    assert count >= 4


@pytest.mark.parametrize("slides", [0, 2])
def test_joints_at_limits_are_held_where_the_nearest_posture_would_pass_them(slides, tmp_path):
    rng, count, at_limits = np.random.default_rng(6), 0, 0
    kin = written(tmp_path, random_arm(rng, 9, slides), joints=[f"q{i}" for i in range(9)])
    for _ in range(3):
        q = rng.uniform(0.6 * kin.lower, 0.6 * kin.upper)
        q[-2:] = 0.9 * kin.upper[-2:]
        T, seed = kin.fk(q), q + rng.uniform(-0.1, 0.1, kin.n)
        seed[-2:] += 0.5
        found = kin.nearest(T, seed)
        assert found.success
        at_limits += (np.minimum(found.q - kin.lower, kin.upper - found.q) < 1e-9).sum()
        for other in around(kin, found.q, 0.02):
            if kin.within_limits(other):
                assert np.linalg.norm(kin._scale * (other - seed)) > np.linalg.norm(kin._scale * (found.q - seed))
                count += 1
    assert at_limits >= 2
    assert count >= 4


def test_the_most_manipulable_is_more_so_than_what_it_started_from(tmp_path):
    rng, better, count = np.random.default_rng(1), 0, 0
    for kin in arms(rng, tmp_path):
        for q in rng.uniform(0.6 * kin.lower, 0.6 * kin.upper, (1, kin.n)):
            found = kin.manipulable(kin.fk(q))
            assert found.success
            assert np.abs(kin.fk(found.q) - kin.fk(q)).max() < 1e-8
            much = [float(np.sqrt(np.linalg.det(J @ J.T))) for J in kin.jacobian(np.array([found.q, q])) / kin._scale]
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
    T = kin.fk(kin.arm.home)
    around = kin.T_world_base[:3, :3] @ T[:3, 3] + kin.T_world_base[:3, 3]
    found = kin.clearest(T, CollisionChecker(kin, obstacles=[Box("around", (0.05, 0.05, 0.05), tuple(around))]))
    assert (found.status, found.reason) == (Status.REJECTED, "the posture found collides")
    with pytest.raises(InputError, match=r"arm 'ur5e' has 6 joints, no more than a pose needs"):
        RedundantKinematics("ur5e")


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


@pytest.mark.slow
def test_it_is_named_as_numeric(tmp_path, capsys):
    names = [f"q{i}" for i in range(8)]
    kin = written(tmp_path, random_arm(np.random.default_rng(4), 8, 2), joints=names)
    joints = ["--joints", ",".join(names)]
    assert main(["check", str(tmp_path / "arm.urdf"), *joints, "--poses", "1"]) == 0
    assert "numeric: nearest, clearest and manipulable" in capsys.readouterr().out
    pose = ",".join(map(str, pose_vector(kin.fk(kin.arm.home)).tolist()))
    assert main(["ik", "--arm", str(tmp_path / "arm.urdf"), *joints, f"--pose={pose}"]) == 0
    assert "* numeric: no other next to it is nearer to the seed" in capsys.readouterr().out
