"""The closed form for every arm of the family, whatever its lengths."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace
from itertools import product
from pathlib import Path

import gymnasium as gym
import numpy as np
import pinocchio as pin
import pytest

import kinreach  # noqa: F401  registers the environments
from benchmarks.speed.poses import CASES
from benchmarks.speed.suites.ik_edge_cases import judge
from benchmarks.studies import ur_family
from kinreach.errors import InputError, UnknownNameError
from kinreach.kinematics import ArmKinematics, CollisionChecker, UR5Kinematics, URKinematics
from kinreach.kinematics.inside import link_frame
from kinreach.robots import PUBLISHED_CALIBRATIONS, ArmDescription, arm_names, get_arm
from kinreach.robots.inside import FLIP, UR_LENGTHS, link_shapes, origin_of
from kinreach.sim import ArmSimulation
from kinreach.sim.inside import MoveStatus
from tests.cases import slow

WITH_MESHES = ("ur3", "ur5", "ur10")
FEW = ("ur3e", "ur5", "ur16e")  # `make test` solves poses of these
MORE = [name for name in UR_LENGTHS if name not in FEW]
UR_FILES = Path(str(get_arm("ur5").package_root())) / "example-robot-data/robots/ur_description/urdf"


def of(name):
    if name.endswith(".urdf"):
        return URKinematics(ArmDescription.from_urdf(UR_FILES / name, tip="tool0"))
    return URKinematics(name, tip="tcp", base="world")


@pytest.mark.parametrize("name", [*FEW, "ur10_robot.urdf", *slow("ur3_robot.urdf", *MORE)])
def test_every_posture_is_found_again(name):
    kin = of(name)
    rng = np.random.default_rng(0)
    q = rng.uniform(np.maximum(kin.lower, -np.pi), np.minimum(kin.upper, np.pi), (200, 6))
    T = kin.fk(q)
    batch = kin.batch(T)
    for posture, pose, row, valid in zip(q, T, batch.q, batch.valid, strict=True):
        solutions = kin.all_solutions(pose)
        assert np.abs(solutions.q - posture).max(axis=1).min() < 1e-8
        assert solutions.residual.max() < 1e-8
        np.testing.assert_allclose(row[valid], solutions.q, atol=1e-8)
    nearest = kin.nearest_batch(T, q)
    assert nearest.success.all()
    np.testing.assert_allclose(nearest.q, q, atol=1e-8)


def test_every_model_of_the_oracle_is_known():
    theirs = {name for name in dir(pytest.importorskip("ur_analytic_ik")) if name.startswith("ur")}
    assert theirs <= set(UR_LENGTHS)
    assert len(theirs) >= 14


@pytest.mark.parametrize("name", UR_LENGTHS)
def test_forward_kinematics_is_the_oracles(name):
    oracle = getattr(pytest.importorskip("ur_analytic_ik"), name, None)
    if oracle is None:
        pytest.skip(f"ur_analytic_ik has no {name}")
    kin, rng = URKinematics(name), np.random.default_rng(1)
    q = rng.uniform(kin.lower, kin.upper, (200, 6))
    expected = np.array([FLIP @ oracle.forward_kinematics(*posture) for posture in q])
    np.testing.assert_allclose(kin.fk(q), expected, atol=1e-10)
    np.testing.assert_allclose([kin.fk(posture) for posture in q], expected, atol=1e-10)
    assert tuple(vars(kin.geometry)[each] for each in ("d1", "a2", "a3", "d4", "d5", "d6")) == UR_LENGTHS[name]


@pytest.mark.parametrize("name", WITH_MESHES)
def test_forward_kinematics_is_that_of_the_urdfs(name):
    model = pin.buildModelFromUrdf(str(UR_FILES / f"{name}_robot.urdf"))
    data, frame = model.createData(), model.getFrameId("tool0")
    kin = URKinematics(name)
    q = np.random.default_rng(2).uniform(-6, 6, (100, 6))
    for posture, T in zip(q, kin.fk(q), strict=True):
        pin.framesForwardKinematics(model, data, posture)
        np.testing.assert_allclose(T, data.oMf[frame].homogeneous, atol=1e-10)


@pytest.mark.parametrize("name", [*FEW, *slow(*MORE)])
def test_no_singular_pose_comes_back_empty_or_wrong(name):
    kin = URKinematics(name)
    assert len(CASES) == 9
    for case, make in CASES.items():
        poses = make(np.random.default_rng(4), 50, kin)
        tally = judge(lambda T: kin.all_solutions(T).q, poses, kin)
        assert (len(poses), tally.empty, tally.spurious) == (50, 0, 0), case
        batch = kin.batch(poses)
        assert batch.valid.any(axis=1).all(), case


def test_no_model_loses_a_pose_as_the_docs_say(capsys):
    """Nine cases of every model; the page has 1000 poses in each, of 14 models."""
    assert ur_family.main(["--poses", "5"]) == 0
    rows = [line.strip("| ").split(" | ") for line in capsys.readouterr().out.splitlines() if line.startswith("| `")]
    assert len(rows) == len(UR_LENGTHS) >= 14
    assert {tuple(row[1:10]) for row in rows} == {("0 / 0",) * 9}
    text = (Path(__file__).parents[2] / "docs/reference/accuracy.md").read_text(encoding="utf-8")
    assert "Of 1000 poses in each of nine cases, for all 14 models, each had a valid solution" in text


@pytest.mark.parametrize("name", ["ur3e", "ur20", "ur5"])
def test_the_nearest_of_all_windings(name):
    """Against all of them: every branch with every joint a turn further up and down, within ±2 pi."""
    kin = URKinematics(get_arm(name).with_limits(2 * np.pi))
    np.testing.assert_allclose((kin.lower, kin.upper), [[-2 * np.pi] * 6, [2 * np.pi] * 6])
    turns = 2 * np.pi * np.array(list(product((-1, 0, 1), repeat=6)))
    rng, beyond = np.random.default_rng(3), 0
    poses = kin.fk(rng.uniform(kin.lower, kin.upper, (40, 6)))
    seeds = rng.uniform(kin.lower, kin.upper, (40, 6))
    many = kin.nearest_batch(poses, seeds)
    for T, seed, in_batch in zip(poses, seeds, many.q, strict=True):
        every = (kin.all_solutions(T).q[:, None] + turns).reshape(-1, 6)
        every = every[(np.abs(every) <= kin.upper + 1e-9).all(axis=1)]
        best = every[np.linalg.norm(every - seed, axis=1).argmin()]
        np.testing.assert_allclose(kin.nearest(T, seed).q, best, atol=1e-9)
        np.testing.assert_allclose(in_batch, best, atol=1e-9)
        beyond += (np.abs(best) > np.pi).any()
    assert beyond > 30


@pytest.mark.parametrize("name", UR_LENGTHS)
def test_the_elbow_ends_where_the_arm_hits_itself(name):
    """As in the maker's ROS description; so no posture is listed that the elbow cannot get to."""
    checker = CollisionChecker(name, obstacles=())
    kin, q = ArmKinematics.of(name), np.random.default_rng(5).uniform(-np.pi, np.pi, (40, 6))
    for q[:, 2] in (kin.lower[2], kin.upper[2]):
        assert checker.impossible(q - 1e-9 * np.sign(q)).all()
    assert (kin.lower[2], kin.upper[2]) == pytest.approx((-np.pi, np.pi))
    seed, ends = np.array(kin.arm.home), 0
    for T in kin.fk(q - 1.9 * np.eye(6)[2]):
        elbows = kin.all_solutions(T, seed=seed).q[:, 2]
        assert np.abs(elbows).max(initial=0.0) < np.pi + 1e-8
        ends += (elbows < seed[2] - np.pi).any()
    assert ends >= 8


@pytest.mark.parametrize("name", ["ur3e", "ur16e", *slow(*(name for name in MORE if name not in WITH_MESHES))])
def test_arms_without_meshes_have_shapes(name):
    """They collide, are simulated, and reach every goal on their table with the tool down."""
    kin = URKinematics(name, base="world")
    checker, arm, rng, down = CollisionChecker(kin), kin.arm, np.random.default_rng(0), np.diag([1.0, -1.0, -1.0, 1.0])
    assert checker.free(np.array(arm.home))
    assert 0.3 < checker.impossible(rng.uniform(-np.pi, np.pi, (500, 6))).mean() < 0.7
    for T, goal in ((down.copy(), goal) for goal in arm.workcell.draw_goals(rng, 50)):
        T[:3, 3] = goal
        assert kin.nearest(T, np.array(arm.home), accept=checker.free).success
    simulation = ArmSimulation(arm)
    simulation.reset()
    assert simulation.move(np.array(arm.home) + 0.2).status is MoveStatus.REACHED
    _, info = gym.make("kinreach/UR5SingleStep-v0", arm=name).reset(seed=0)
    assert info["distance"] > 0.05


@pytest.mark.parametrize(("name", "largest"), [("ur3", 0.012), ("ur5", 0.016), ("ur10", 0.018)])
def test_shapes_are_those_of_the_meshes(name, largest):
    """Few points of the meshes are out of the cylinders, and not far; other models have theirs by the same rule."""
    drawn = ArmKinematics(get_arm(f"{name}-thesis"), tip="tool0")
    ruled = ArmKinematics(name, tip="tool0")
    q, counted = np.zeros(6), 0
    for link in ("shoulder_link", "upper_arm_link", "forearm_link", "wrist_1_link", "wrist_2_link", "wrist_3_link"):
        frames = []
        for kin in (drawn, ruled):
            pin.framesForwardKinematics(kin.model, kin.data, q)
            frames.append(kin.T_base_world @ kin.data.oMf[link_frame(kin.model, link)].homogeneous)
        T = np.linalg.inv(frames[1]) @ frames[0]
        points = np.vstack([s.vertices for s in link_shapes(drawn.arm, "collision") if s.link == link])
        points = points @ T[:3, :3].T + T[:3, 3]
        element = next(e for e in ET.fromstring(ruled.arm.urdf).iter("link") if e.get("name") == link)
        out = np.min(
            [outside(points, origin_of(c), c.find("geometry/cylinder")) for c in element.iter("collision")], axis=0
        )
        assert out.max() < largest, link
        assert np.percentile(out, 90) < 0.012
        counted += len(points)
    assert counted > 1000


@pytest.mark.parametrize(
    ("name", "count", "hulls", "blocked", "missed"),
    [
        ("ur5", 2000, 0.3465, 0.026, 0.031),
        pytest.param("ur3", 2000, 0.2295, 0.012, 0.008, marks=pytest.mark.slow),
        pytest.param("ur10", 2000, 0.2875, 0.0125, 0.0005, marks=pytest.mark.slow),
    ],
)
def test_the_verdict_of_cylinders_is_that_of_the_meshes(name, count, hulls, blocked, missed):
    """docs/reference/accuracy.md: hulls of the bent links block far more."""
    meshes = get_arm(f"{name}-thesis").with_tool(np.eye(4))
    meshes = replace(meshes, disabled_collisions=None, default_tip="tool0")
    arms = (get_arm(name), replace(meshes, meshes="triangles"), meshes)
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (count, 6))
    cylinders, triangles, convex = (CollisionChecker(arm, obstacles=()).impossible(q) for arm in arms)
    shares = [(convex & ~triangles).mean(), (cylinders & ~triangles).mean(), (triangles & ~cylinders).mean()]
    assert shares == pytest.approx([hulls, blocked, missed], abs=0.004)
    assert not (triangles & ~convex).any()


def outside(points, T, cylinder):
    """Distance of points from a cylinder; negative inside."""
    local = (points - T[:3, 3]) @ T[:3, :3]
    across = np.hypot(local[:, 0], local[:, 1]) - float(cylinder.get("radius"))
    along = np.abs(local[:, 2]) - float(cylinder.get("length")) / 2
    inside = np.maximum(across, along)
    return np.where(inside < 0, inside, np.hypot(np.maximum(across, 0), np.maximum(along, 0)))


def test_the_ur5_by_its_old_name():
    old, new = UR5Kinematics(tip="tcp", base="world"), URKinematics("ur5", tip="tcp", base="world")
    assert isinstance(old, URKinematics)
    q = np.random.default_rng(0).uniform(-3, 3, (50, 6))
    np.testing.assert_array_equal(old.fk(q), new.fk(q))
    np.testing.assert_array_equal(old.batch(old.fk(q)).q, new.batch(new.fk(q)).q)
    assert URKinematics().tip == UR5Kinematics().tip == "tool0"


@pytest.mark.parametrize("kind", [URKinematics, UR5Kinematics])
def test_every_class_takes_the_arm_first_and_files(kind):
    assert kind("ur10").arm is kind(arm="ur10").arm is get_arm("ur10")
    assert kind("ur10", tip="tcp").tip == "tcp"
    assert (kind().arm, kind().tip, ArmKinematics.of("ur5").tip) == (get_arm("ur5"), "tool0", "tool0")
    assert ArmKinematics.of("ur5-thesis").tip == "tcp"
    kin = kind.from_urdf(UR_FILES / "ur5_robot.urdf", tip="tool0")
    assert type(kin) is kind
    q = np.random.default_rng(0).uniform(-3.0, 3.0, (20, 6))
    np.testing.assert_allclose(kin.fk(q), ArmKinematics.from_urdf(UR_FILES / "ur5_robot.urdf", tip="tool0").fk(q))


def test_arms_of_another_kind():
    with pytest.raises(InputError, match="a UR-type arm has 6 joints, the model has 3"):
        URKinematics("arm3", tip="end_effector")
    with pytest.raises(UnknownNameError, match=", ".join(sorted(arm_names()))):
        URKinematics("ur16")
    panda = UR_FILES.parents[1] / "panda_description/urdf/panda.urdf"
    arm = ArmDescription.from_urdf(panda, joints=[f"panda_joint{i}" for i in range(1, 7)], tip="panda_link6")
    with pytest.raises(InputError, match="UR-type"):
        URKinematics(arm, tip=None)


def add_joint(robot, name, parent, child, *, xyz=(0, 0, 0), rpy):
    joint = ET.SubElement(robot, "joint", name=name, type="fixed")
    ET.SubElement(joint, "origin", xyz=" ".join(map(repr, xyz)), rpy=" ".join(map(repr, rpy)))
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    return joint


def drivers_urdf(lengths):
    """A UR with the frames of the ROS driver's description: every joint turns about its own z, as in DH."""
    d1, a2, a3, d4, d5, d6 = lengths
    right, robot = np.pi / 2, ET.Element("robot", name="mine")
    steps = (
        ((0, 0, d1), (0, 0, 0)),
        ((0, 0, 0), (right, 0, 0)),
        ((a2, 0, 0), (0, 0, 0)),
        ((a3, 0, d4), (0, 0, 0)),
        ((0, -d5, 0), (right, 0, 0)),
        ((0, d6, 0), (right, np.pi, np.pi)),
    )
    for link in ("base_link", "base_link_inertia", *(f"link_{index}" for index in range(6)), "flange", "tool0"):
        ET.SubElement(robot, "link", name=link)
    add_joint(robot, "inertia", "base_link", "base_link_inertia", rpy=(0, 0, np.pi))
    parent = "base_link_inertia"
    for index, (xyz, rpy) in enumerate(steps):
        joint = add_joint(robot, f"j{index}", parent, f"link_{index}", xyz=xyz, rpy=rpy)
        joint.set("type", "revolute")
        ET.SubElement(joint, "axis", xyz="0 0 1")
        ET.SubElement(joint, "limit", lower="-6", upper="6", effort="1", velocity="3")
        parent = f"link_{index}"
    add_joint(robot, "flange_joint", parent, "flange", rpy=(0, -right, -right))
    add_joint(robot, "tool0_joint", "flange", "tool0", rpy=(right, 0, right))
    return ET.tostring(robot, encoding="unicode")


@pytest.mark.parametrize("name", ["ur3e", "ur5", "ur20"])
def test_the_closed_form_of_a_ur_whatever_its_frames_are(name, tmp_path):
    file = tmp_path / "mine.urdf"
    file.write_text(drivers_urdf(UR_LENGTHS[name]))
    kin, nominal = ArmKinematics.from_urdf(file), URKinematics(name)
    assert type(kin) is URKinematics
    assert kin.geometry == nominal.geometry
    q = np.random.default_rng(6).uniform(-np.pi, np.pi, (200, 6))
    T = nominal.fk(q)
    np.testing.assert_allclose(kin.fk(q), T, atol=1e-10)
    for posture, pose in zip(q, T, strict=True):
        solutions = kin.all_solutions(pose)
        np.testing.assert_allclose(solutions.q, nominal.all_solutions(pose).q, atol=1e-8)
        assert np.abs(solutions.q - posture).max(axis=1).min() < 1e-8


def test_an_arm_with_the_axes_of_a_ur_and_no_offset_is_not_taken_for_one(tmp_path):
    """With d4 = 0 the wrist may stand on the axis of the base, where the closed form divides by its distance."""
    d1, a2, a3, _, d5, d6 = UR_LENGTHS["ur5"]
    file = tmp_path / "mine.urdf"
    file.write_text(drivers_urdf((d1, a2, a3, 0.0, d5, d6)))
    with pytest.raises(InputError, match="not the lengths of a UR-type arm"):
        URKinematics(ArmDescription.from_urdf(file))
    kin, rng, found = ArmKinematics.from_urdf(file), np.random.default_rng(7), 0
    assert not isinstance(kin, URKinematics)
    for q in rng.uniform(-3.0, 3.0, (100, 6)):
        solutions = kin.all_solutions(kin.fk(q))
        found += np.abs(solutions.q - q).max(axis=1).min() < 1e-7
    assert found == 100


def out_of_reach(kinematics, count, rng):
    """Poses that no posture reaches: too far, too near, and all around."""
    while count:
        T = kinematics.fk(rng.uniform(-3, 3, 6))
        T[:3, 3] = kinematics.fk(rng.uniform(-3, 3, 6))[:3, 3] * rng.uniform(0.05, 2.0)
        if not len(kinematics.all_solutions(T, limits=False).branch):
            count -= 1
            yield T


@pytest.mark.parametrize("name", ["ur5", "ur10e"])
def test_nothing_in_reach_is_nearer_than_the_nearest(name):
    """By the closed form, in a ball around the pose that ends just before it."""
    kinematics = URKinematics(name, tip="tcp" if name == "ur5" else "tool0", base="world")
    rng, tried = np.random.default_rng(5), 0
    for T in out_of_reach(kinematics, 40, rng):
        nearest = kinematics.nearest_in_reach(T)
        np.testing.assert_array_equal(nearest[:3, :3], T[:3, :3])
        assert len(kinematics.all_solutions(nearest, limits=False).branch)
        way = nearest[:3, 3] - T[:3, 3]
        radius = (1 - 1e-4) * np.linalg.norm(way) - 1e-6  # the closed form itself takes what is 1e-7 m outside
        around = rng.normal(size=(400, 3))
        around[:200] = 10 * way + rng.uniform(0, 5, (200, 1)) * np.linalg.norm(way) * around[:200]  # about the way
        around *= radius / np.linalg.norm(around, axis=1, keepdims=True)
        around[300:] *= rng.uniform(0, 1, (100, 1)) ** (1 / 3)
        others = np.tile(T, (400, 1, 1))
        others[:, :3, 3] += around
        assert not kinematics.batch(others, limits=False).valid.any()
        tried += len(others)
    assert tried == 16_000
    T = kinematics.fk(rng.uniform(-3, 3, 6))
    np.testing.assert_allclose(kinematics.nearest_in_reach(T), T, atol=2e-9)
    with pytest.raises(InputError):
        kinematics.nearest_in_reach(2 * T)


def test_the_nearest_of_a_calibrated_arm_is_right_to_a_few_millimetres():
    real = URKinematics.from_calibration(PUBLISHED_CALIBRATIONS["ur5_a"], tip="tcp", base="world")
    rng, near = np.random.default_rng(6), 0
    for T in out_of_reach(real, 15, rng):
        nearest = real.nearest_in_reach(T)
        way = nearest[:3, 3] - T[:3, 3]
        places, length = np.tile(T, (2, 1, 1)), np.linalg.norm(way)
        places[:, :3, 3] += np.outer([1 + 0.004 / length, max(0.0, 1 - 0.004 / length)], way)
        inside, outside = (len(real.all_solutions(place, limits=False).branch) > 0 for place in places)
        near += inside and not outside
    assert near == 15


def test_the_floor_is_within_reach_of_the_largest():
    checker = CollisionChecker("ur10")
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (3000, 6))
    assert sum("floor" in pair for row in q for pair in checker.contacts(row)) >= 5
