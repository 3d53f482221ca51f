"""Every posture of calibrated UR arms: against Pinocchio, against ssik, and in the cases where branches merge."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.ik_arms.random_arms import moves_to
from benchmarks.studies.calibrated_arms import CASES as SINGULAR
from benchmarks.studies.calibrated_arms import SAME, main, recall, singular_postures
from kinreach._rotations import pose_error
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, CalibratedURKinematics, Status, URKinematics
from kinreach.robots import PUBLISHED_CALIBRATIONS, get_arm
from kinreach.robots.inside import FLIP
from tests.cases import slow

DATA = Path(__file__).parents[1] / "data"
#: Branches that ssik's general_6r found; benchmarks/studies/calibrated_arms.py --oracle made it.
ORACLE = np.load(DATA / "calibrated_branches.npz")
ROBOTS = sorted({name.split()[0] for name in ORACLE})
FEW = ("ur10e_a", "ur3_a", "ur5_a")  # of `make test`


def of(robot, **options):
    return URKinematics.from_calibration(PUBLISHED_CALIBRATIONS[robot], model=robot.split("_")[0], **options)


def wrapped(q):
    return (q + np.pi) % (2 * np.pi) - np.pi


def distance(q, others):
    return np.abs(wrapped(others - q)).max(axis=1).min(initial=np.inf)


@pytest.fixture(scope="module", params=[*FEW, *slow(*(robot for robot in ROBOTS if robot not in FEW))])
def robot(request):
    return request.param


@pytest.fixture(scope="module")
def kin(robot):
    return of(robot, tip="tool0")


def test_random_poses_keep_their_posture(kin):
    """All solutions reach to 1e-9 by Pinocchio, none twice, the generating posture among them, batch as alone."""
    q = np.random.default_rng(1).uniform(-np.pi, np.pi, (20, 6))
    T = np.array([kin.fk(posture) for posture in q])
    batch = kin.batch(T)
    assert batch.q.shape == (20, 16, 6)
    count = 0
    for posture, pose, row, valid in zip(q, T, batch.q, batch.valid, strict=True):
        solutions = kin.all_solutions(pose, limits=False)
        assert solutions.residual.max() < 1e-9
        assert distance(posture, solutions.q) < 1e-6
        for i in range(1, len(solutions)):
            assert distance(solutions.q[i], solutions.q[:i]) > 1e-6
        assert len(set(solutions.branch.tolist())) == len(solutions)
        np.testing.assert_array_equal(np.flatnonzero(valid), solutions.branch)
        np.testing.assert_allclose(row[valid], solutions.q, atol=1e-7)
        count += len(solutions)
    assert count > 120


def test_the_branches_that_ssik_finds(robot, kin):
    """ssik's general_6r, after minutes of preparation, on random poses and next to the singularities."""
    found, asked = recall(robot, kin, ORACLE)
    assert asked > 400
    assert found >= 0.999 * asked


@pytest.mark.parametrize("case", SINGULAR)
def test_singular_poses_are_never_empty_and_never_wrong(case):
    poses = 0
    for robot in ("ur5_a", "ur10e_a"):
        kin = of(robot)
        T = SINGULAR[case](kin, np.random.default_rng(7), 2)
        for pose in T:
            solutions = kin.all_solutions(pose, limits=False)
            assert len(solutions) > 0
            assert solutions.residual.max() < (2e-9 if "1e-9" in case else 1e-9)
            poses += 1
    assert poses == 4


def test_the_tables_of_the_documentation(capsys):
    assert main(["--poses", "10", "--singular", "2", "--robots", "ur5_b"]) == 0
    printed = capsys.readouterr().out
    assert "| ur5_b | 100.00 % of" in printed
    assert printed.count("| 0 / 0 |") == len(SINGULAR)


@pytest.mark.parametrize("robot", ["ur5_a", *slow("ur3e_a")])
@pytest.mark.parametrize("case", ["elbow", "wrist", "shoulder"])
def test_the_arms_own_singularities(robot, case):
    """Two postures are one there; it is found, nothing is empty and nothing wrong, also when the pose is rounded."""
    kin = of(robot)
    q = singular_postures(kin, case, np.random.default_rng(3), 3)
    assert len(q) == 3
    for rounded in (False, True):
        T = np.array([kin.fk(posture) for posture in q])
        if rounded:
            T = T.astype(np.float32).astype(np.float64)
        batch = kin.batch(T, limits=False, tol=5e-7 if rounded else 1e-7)
        assert batch.valid.any(axis=1).all()
        for posture, pose, row, valid in zip(q, T, batch.q, batch.valid, strict=True):
            assert max(max(pose_error(pose, kin.fk(found))) for found in row[valid]) < (5e-7 if rounded else 1e-9)
            if not rounded:
                assert distance(posture, row[valid]) < SAME


def some_calibration(rng, model, folder):
    """Kinematics of a UR with random deviations from its data sheet: 0.1 or 0.3 mm, 0.3 to 2 mrad."""
    scale = rng.choice([0.3, 1.0])
    sizes = {"theta": 2e-3, "a": 3e-4, "d": 3e-4, "alpha": 1e-3}
    rows = [
        f"delta_{name} = [{', '.join(map(repr, (scale * size * rng.normal(size=6)).tolist()))}]"
        for name, size in sizes.items()
    ]
    file = folder / "calibration.conf"
    file.write_text("\n".join(["[mounting]", "[calibration]", *rows, ""]))
    return URKinematics.from_calibration(file, model=model)


E_SERIES = ("ur3e", "ur5e", "ur7e", "ur10e", "ur12e", "ur16e")
#: How many poses of each model.
HARD = {"wrist and shoulder": 14, "wrist": 2, "elbow": 2, "shoulder": 2, "zero": 2}


@pytest.mark.parametrize(("model", "arms"), [("ur10e", 1), *slow(*((model, 3) for model in E_SERIES))])
def test_the_posture_of_a_singular_pose_is_found(model, arms, tmp_path):
    """Or one that the arm can move to while its tip stays; alone as in a batch, with the posture as a seed too."""
    rng, joined, poses = np.random.default_rng(len(model)), 0, 0
    for _ in range(arms):
        kin = some_calibration(rng, model, tmp_path)
        chain = kin._calibrated.chain
        for case, count in HARD.items():
            if case == "zero":
                q = rng.integers(-2, 3, (count, 6)) * (np.pi / 2)
            else:
                q = singular_postures(kin, case, rng, count)
            T = np.tile(np.eye(4), (len(q), 1, 1))
            T[:, :3] = chain.fk(q)
            batch = kin.batch(kin.fk(q), limits=False)
            for posture, pose, given, row, valid in zip(q, T, kin.fk(q), batch.q, batch.valid, strict=True):
                found = kin.all_solutions(given, limits=False)
                assert found.residual.max() < 1e-9
                assert found.branch.tolist() == np.flatnonzero(valid).tolist()
                near = distance(posture, found.q) < SAME
                assert near or moves_to(chain, posture, found.q, pose), (case, posture.tolist())
                assert max(distance(one, found.q) for one in row[valid]) < SAME
                seeded = kin.all_solutions(given, seed=posture, limits=False)
                assert seeded.success
                joined, poses = joined + (not near), poses + 1
    assert poses == 22 * arms
    assert joined <= 2 * arms


@pytest.mark.parametrize("robot", ["ur5_c", "ur3e_a"])
def test_branches_are_all_there_are(robot):
    """Near the wrist's singularity, where more than eight may appear, as many as the method without branches finds."""
    kin, rng = of(robot), np.random.default_rng(6)
    q = rng.uniform(-np.pi, np.pi, (150, 6))
    q[:, 4] = rng.choice((0.0, np.pi), 150) + rng.uniform(-0.06, 0.06, 150)
    T = kin.fk(q)
    counts = [len(found) for found in kin._calibrated.general.solve(FLIP @ T)]
    assert max(counts) > 8
    assert counts == kin.batch(T, limits=False).valid.sum(axis=1).tolist()


def test_with_the_tool_straight_down():
    """The first axis and the last are parallel, exactly: the elimination would be singular."""
    kin = of("ur5e_a")
    rng = np.random.default_rng(4)
    down = np.diag([1.0, -1.0, -1.0, 1.0])
    T = np.tile(down, (60, 1, 1))
    T[:, :3, 3] = rng.uniform((-0.7, -0.7, 0.0), (0.7, 0.7, 0.4), (60, 3))
    postures = kin._calibrated.general.solve(FLIP @ T)
    batch = kin.batch(T, limits=False)
    reached = [len(found) for found in postures]
    assert reached == batch.valid.sum(axis=1).tolist()
    assert sum(reached) > 250


def test_branches_are_those_of_the_data_sheet():
    """Along a path without singularity a posture keeps its index, and it is the nominal arm's there."""
    kin, nominal = of("ur5_a"), URKinematics("ur5")
    start, end = np.array([0.3, -1.9, 1.4, -1.0, 1.2, 0.2]), np.array([1.3, -1.2, 0.6, -0.4, 0.7, -0.9])
    seen = set()
    for part in np.linspace(0.0, 1.0, 25):
        q = start + part * (end - start)
        seen.add(kin.nearest(kin.fk(q), q).branch)
        seen.add(nominal.nearest(nominal.fk(q), q).branch)
    assert len(seen) == 1


def test_goals_seeds_limits_and_reasons():
    kin = of("ur5_b", tip="tcp", base="world")
    assert isinstance(kin, CalibratedURKinematics)
    q = np.array([-1.6, -1.5, 1.6, -1.7, -1.5, 0.3])
    result = kin.nearest(kin.fk(q), q)
    assert result.success
    np.testing.assert_allclose(result.q, q, atol=1e-8)
    T = kin.fk(q)
    down = kin.axis_goal(T[:3, 3], T[:3, 2], q)
    np.testing.assert_allclose(down.q, q, atol=1e-8)
    every = kin.axis_solutions(T[:3, 3], T[:3, 2], seed=q, limits=False)
    assert len(every) >= 4
    assert (np.abs(every.q[:, 5] - q[5]) < 1e-12).all()
    assert every.residual.max() < 1e-9
    beyond = kin.axis_solutions(T[:3, 3], T[:3, 2], seed=[*q[:5], q[5] + 7.0])
    assert len(beyond) >= 1
    np.testing.assert_allclose(beyond.q[:, 5], kin.upper[5], atol=1e-12)
    nearest = kin.nearest_batch(np.array([T, T]), np.array([q, q + 0.1]))
    np.testing.assert_allclose(nearest.q, [q, q], atol=1e-8)
    assert kin.nearest(T, q, accept=lambda _: False).status is Status.REJECTED
    far = np.eye(4)
    far[0, 3] = 2.0
    assert kin.all_solutions(far).status is Status.OUT_OF_REACH
    assert "too far away" in kin.all_solutions(far).reason
    assert not kin.batch(far[None]).valid.any()
    with pytest.raises(InputError, match="rotation"):
        kin.batch(np.diag([2.0, 1.0, 1.0, 1.0])[None])


def test_a_calibrated_arm_is_recognised_by_its_joints():
    arm = get_arm("ur5").calibrated(PUBLISHED_CALIBRATIONS["ur5_c"])
    assert isinstance(ArmKinematics.of(arm), CalibratedURKinematics)
    with pytest.raises(InputError, match="CalibratedURKinematics"):
        URKinematics(arm)
    with pytest.raises(InputError, match="not a UR"):
        CalibratedURKinematics(skewed(arm))


def skewed(arm):
    """The arm with its elbow turned by 0.7 rad about another axis."""
    robot = ET.fromstring(arm.urdf)
    robot.find("joint[@name='elbow_joint']/origin").attrib.update(xyz="0 0 0.425", rpy="0.7 0 0")
    return replace(arm, build_urdf=lambda: ET.tostring(robot, encoding="unicode"))


def test_a_file_of_the_data_sheet_is_the_closed_form(tmp_path):
    file = tmp_path / "nominal.urdf"
    file.write_text(get_arm("ur5e").urdf)
    kin = URKinematics.from_calibration(file, model="ur5e")
    assert not isinstance(kin, CalibratedURKinematics)
