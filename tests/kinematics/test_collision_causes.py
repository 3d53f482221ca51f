"""Why postures are impossible: one verdict for one posture and for many, for solvers, environments and MuJoCo."""

from __future__ import annotations

import pickle
from dataclasses import replace
from itertools import combinations, pairwise

import coal
import gymnasium as gym
import numpy as np
import pinocchio as pin
import pytest

import kinreach  # noqa: F401 (registers the environments)
from benchmarks.studies.collision_agreement import edges, near_solutions
from kinreach._registration import MULTI, SINGLE
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, Cause, CollisionChecker, URKinematics
from kinreach.robots import ArmDescription, Box, Workcell, get_arm

ARMS = ("ur3-thesis", "ur5-thesis", "ur10-thesis", "panda", "arm3")
FOLDED = np.array([0.0, -np.pi / 2, 3.0, -np.pi / 2, -np.pi / 2, 0.0])
HOME = np.array(get_arm("ur5-thesis").home)


@pytest.fixture(scope="module", params=ARMS)
def checker(request):
    return CollisionChecker(request.param)


@pytest.fixture(scope="module")
def ur5():
    return CollisionChecker("ur5-thesis")


@pytest.fixture(scope="module")
def kin():
    return URKinematics("ur5-thesis", tip="tcp", base="world")


def random_postures(kin, count, *, beyond=1.0, seed=10):
    return np.random.default_rng(seed).uniform(beyond * kin.lower, beyond * kin.upper, (count, kin.n))


def test_the_verdict_on_one_and_on_many_is_the_same(checker):
    kin = checker.kinematics
    near = np.concatenate(edges(checker, np.random.default_rng(11), 40))
    q = np.concatenate([random_postures(kin, 200, beyond=1.05), random_postures(kin, 200), near])
    together = checker.causes(q)
    alone = [
        Cause.LIMITS if kin.joints_outside_limits(row) else bool(checker.contacts(row)) and Cause.SELF for row in q
    ]
    assert len(near) == 80
    assert set(together) == set(Cause)
    np.testing.assert_array_equal(np.minimum(together, Cause.SELF), alone)
    np.testing.assert_array_equal([checker.causes(row[None])[0] for row in q], together)
    np.testing.assert_array_equal(np.concatenate([checker.causes(part) for part in np.array_split(q, 37)]), together)
    order = np.random.default_rng(0).permutation(len(q))
    np.testing.assert_array_equal(checker.causes(q[order]), together[order])
    np.testing.assert_array_equal(checker.causes(np.asfortranarray(q)), together)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(checker)).causes(q), together)


@pytest.mark.parametrize("arm", ["ur5-thesis", "panda"])
def test_environments_of_any_size_and_solvers_say_what_the_checker_says(arm):
    checker, kin = CollisionChecker(arm), ArmKinematics.of(arm)
    free, hit = edges(checker, np.random.default_rng(11), 15)
    q = np.concatenate([free, hit, random_postures(kin, 90)])
    single = gym.make(SINGLE, arm=arm, backend="kinematic").unwrapped
    actions = np.array([single.action_for(row) for row in q])
    assert np.abs(actions).max() <= 1.0
    truth = np.array([checker.in_collision(row) for row in single._task.targets(q, actions)])
    assert 16 < truth.sum() < 104
    for size in (5, 120):
        batch = gym.make_vec(
            SINGLE, num_envs=size, vectorization_mode="vector_entry_point", arm=arm, backend="kinematic"
        )
        batch.reset(seed=0)
        said = [batch.step(part)[4]["impossible"] for part in actions.reshape(-1, size, kin.n)]
        np.testing.assert_array_equal(np.concatenate(said), truth)
    for action, collides in zip(actions, truth, strict=True):
        single.reset(seed=0)
        info = single.step(action)[4]
        assert info["impossible"] == bool(info["impossible_reason"]) == collides
        assert not (collides and single.accept(single.posture_for(action)))


def test_natural_postures_at_the_goals_are_free(ur5):
    q = near_solutions(np.random.default_rng(3), 1000)
    assert (q[:, 0] < 0).any()
    assert (q[:, 0] > 0).any()
    assert not ur5.causes(q).any()


def lowered(kin, q, heights):
    """The posture with its tip at other heights [m], reached without changing the branch."""
    T = kin.fk(q)
    postures = []
    for height in heights:
        T[2, 3] = height
        postures.append(kin.nearest(T, q).q)
    return np.array(postures)


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_finger_tips_meet_the_table_exactly(ur5, kin, tilt):
    table = next(box for box in get_arm("ur5-thesis").workcell.obstacles if box.name == "table")
    top = table.position[2] + table.size[2] / 2
    rng = np.random.default_rng(4)
    checked = 0
    for q in near_solutions(rng, 8):
        tilted = q.copy()
        tilted[3] += rng.uniform(-tilt, tilt)
        heights = np.arange(top + 0.0301, top - 0.02, -1e-4)
        causes = ur5.causes(lowered(kin, tilted, heights))
        assert causes[0] == Cause.NONE
        assert causes[-1] == Cause.OBSTACLE
        assert (np.diff(causes.astype(int)) >= 0).all()
        if tilt == 0.0:
            assert heights[causes.argmax()] == pytest.approx(top + 0.01 + ur5.margin, abs=1.1e-4)
        checked += 1
    assert checked == 8


@pytest.mark.parametrize("joint", range(6))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_limits(ur5, kin, joint, sign):
    q = np.tile(HOME, (3, 1))
    q[:, joint] = sign * (kin.upper[joint] + np.array([-1e-6, 1e-6, 100.0]))
    causes = ur5.causes(q)
    assert causes[0] != Cause.LIMITS
    assert (causes[1:] == Cause.LIMITS).all()
    assert ur5.reason(q[1]) == f"out of limits: {kin.arm.joints[joint]}"


def test_reasons_name_the_deepest_pair_of_the_cause(checker):
    q = random_postures(checker.kinematics, 300, beyond=1.02)
    obstacles = {shape.name for shape in checker.shapes if shape.obstacle}
    found = []
    for row, cause in zip(q, checker.causes(q), strict=True):
        reason = checker.reason(row)
        assert reason.startswith("out of limits: ") == (cause == Cause.LIMITS)
        assert bool(reason) == (cause != Cause.NONE)
        if cause >= Cause.SELF:
            pair, contacts = reason.split(" - "), checker.contacts(row)
            assert tuple(sorted(pair)) in contacts
            assert (pair[0] in obstacles, pair[1] in obstacles) == (False, cause == Cause.OBSTACLE)
            assert (cause == Cause.SELF) == any(not obstacles & set(names) for names in contacts)
            kinds = {bool(obstacles & set(names)) for names in contacts}
            if len(kinds) == 1:
                assert tuple(sorted(pair)) == checker.distance(row).pair
        found.append(cause)
    assert set(found) == set(Cause)


def test_reasons_of_known_postures(ur5, kin):
    assert ur5.reason(HOME) == ""
    assert ur5.causes(FOLDED[None]) == [Cause.SELF]
    (pressed,) = lowered(kin, near_solutions(np.random.default_rng(0), 1)[0], [-0.195])
    assert ur5.reason(pressed) in ("finger_left - table", "finger_right - table")
    assert ur5.causes(pressed[None]) == [Cause.OBSTACLE]


def test_no_postures_and_postures_that_are_kept(ur5):
    assert ur5.causes(np.empty((0, 6))).shape == (0,)
    q = random_postures(ur5.kinematics, 50)
    before = q.copy()
    ur5.causes(q)
    np.testing.assert_array_equal(q, before)


@pytest.mark.parametrize("q", [HOME, np.zeros((3, 5)), np.full((2, 6), np.nan), "home", None, [[np.inf] * 6], 1.0])
def test_malformed_postures(ur5, q):
    with pytest.raises(InputError, match="q must"):
        ur5.causes(q)


def test_the_margin_of_environments_is_the_checkers():
    margin, moved = 0.02, 0
    wide = CollisionChecker("ur5-thesis", margin=margin)
    envs = [gym.make(SINGLE, backend="kinematic", margin=each).unwrapped for each in (0.0, margin)]
    batch = gym.make_vec(MULTI, num_envs=4, vectorization_mode="vector_entry_point", backend="kinematic", margin=margin)
    for q in edges(wide, np.random.default_rng(11), 40)[1]:
        said = []
        for env in envs:
            env.reset(seed=0)
            said.append(env.step(env.action_for(q))[4]["impossible"])
            assert not (said[-1] and env.accept(q))
        assert said[1] == wide.in_collision(envs[1].posture_for(envs[1].action_for(q)))
        batch.reset(seed=0, options={"q": np.tile(q, (4, 1))})
        np.testing.assert_array_equal(batch.step(np.zeros((4, 6)))[4]["impossible"], wide.in_collision(q))
        moved += said == [False, True]
    assert moved >= 10


@pytest.mark.parametrize("margin", [-0.01, np.nan, "wide"])
def test_a_margin_that_cannot_be(margin):
    with pytest.raises(InputError, match="margin"):
        gym.make(SINGLE, backend="kinematic", margin=margin)


def test_without_obstacles_nothing_collides_with_one(ur5):
    q = random_postures(ur5.kinematics, 200)
    assert Cause.OBSTACLE in ur5.causes(q)
    assert Cause.OBSTACLE not in CollisionChecker(replace(get_arm("ur5-thesis"), workcell=Workcell())).causes(q)


def wrist_arm(tmp_path, geometry):
    """An arm that is no UR: an upright first joint, three axes through one point, a gripper, a table and a floor."""
    lengths, axes = (0.3, 0.1, 0.4, 0.2, 0.2, 0.1, 0.1), ("0 0 1", "0 1 0", "0 1 0", "0 0 1", "0 1 0", "0 0 1")
    links = "".join(
        f'<link name="l{i}"><collision><origin xyz="0 0 {length / 2}"/>'
        f"<geometry><{geometry.format(length - 0.02)}/></geometry></collision></link>"
        for i, length in enumerate(lengths)
    )
    joints = "".join(
        f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/>'
        f'<origin xyz="0 0 {lengths[i]}"/><axis xyz="{axis}"/><limit lower="-3" upper="3" effort="50" velocity="2"/>'
        "</joint>"
        for i, axis in enumerate(axes)
    )
    file = tmp_path / "arm.urdf"
    file.write_text(f'<robot name="arm">{links}{joints}</robot>')
    names = [f"l{i}" for i in range(7)]
    fingers = combinations(("gripper_palm", "finger_left", "finger_right"), 2)
    cell = Workcell(
        obstacles=(Box("table", (0.8, 1.2, 0.04), (0.6, 0, 0.1)), Box("floor", (4, 4, 0.04), (0, 0, -0.05)))
    )
    touching = (*pairwise([*names, "gripper_palm"]), *fingers)
    return ArmDescription.from_urdf(file, gripper_on="l6", workcell=cell, disabled_collisions=touching)


def least_distances(arm, postures):
    """The smallest distance of all pairs [m], shape (m,), with Pinocchio's reader and coal's search alone."""
    full = pin.buildModelFromXML(arm.urdf)
    held = [full.getJointId(name) for name in arm.locked_joints]
    place = pin.neutral(full)
    for joint, opening in zip(held, arm.locked_joints.values(), strict=True):
        place[full.joints[joint].idx_q] = opening
    shapes = pin.buildGeomFromUrdfString(full, arm.urdf, pin.COLLISION)
    model, shapes = pin.buildReducedModel(full, shapes, held, place)
    names = [model.frames[shape.parentFrame].name for shape in shapes.geometryObjects]
    joints = [shape.parentJoint for shape in shapes.geometryObjects]
    for box in arm.workcell.obstacles:
        where = pin.SE3(np.eye(3), np.array(box.position, dtype=float))
        shapes.addGeometryObject(pin.GeometryObject(box.name, 0, 0, where, coal.Box(*map(float, box.size))))
        names.append(box.name)
        joints.append(-1)
    left_out = {frozenset(pair) for pair in arm.disabled_collisions}
    for i, j in combinations(range(len(names)), 2):
        if joints[i] != joints[j] and {names[i], names[j]} not in left_out:
            shapes.addCollisionPair(pin.CollisionPair(i, j))
    data, search = model.createData(), shapes.createData()
    nearest = [
        search.distanceResults[pin.computeDistances(model, data, shapes, search, q)].min_distance for q in postures
    ]
    return np.array(nearest)


@pytest.mark.parametrize("geometry", ['box size="0.1 0.1 {:g}"', 'cylinder radius="0.05" length="{:g}"'])
def test_a_described_arm_is_judged_as_by_pinocchio(tmp_path, geometry):
    arm = wrist_arm(tmp_path, geometry)
    q = np.random.default_rng(7).uniform(-3.0, 3.0, (1000, 6))
    distance, impossible = least_distances(arm, q), CollisionChecker(arm, margin=0.0).causes(q) != Cause.NONE
    free, touching = distance > 1e-6, distance < -1e-6
    assert (free | touching).sum() >= 990
    assert min(free.sum(), touching.sum()) > 200
    assert not impossible[free].any()
    assert impossible[touching].all()


def test_a_posture_at_the_border_has_its_reason():
    """There the verdict of one search for the nearest points may not be that of the next one."""
    wall = Box("wall", (0.5, 0.02, 0.55), (0.45, 0.0, 0.275))
    borders, named, arm = 0, 0, get_arm("ur5e")
    for seed in range(60):
        rng, margin = np.random.default_rng(seed), (0.0, 0.005)[seed % 2]
        checker = CollisionChecker(arm, obstacles=[*arm.workcell.obstacles, wall], margin=margin)
        free = np.array(arm.home) + rng.normal(0.0, 0.5, 6)
        touching = free + rng.normal(0.0, 1.0, 6)
        if not checker.free(free) or checker.free(touching):
            continue
        for _ in range(60):
            middle = (free + touching) / 2.0
            if checker.free(middle):
                free = middle
            else:
                touching = middle
            named += " - " in checker.reason(middle)
        borders += 1
    assert borders >= 10
    assert named >= 15 * borders
