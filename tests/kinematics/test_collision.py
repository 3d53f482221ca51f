"""Collision verdicts on postures whose answer is known, and their agreement with one another."""

from __future__ import annotations

import pickle

import mujoco
import numpy as np
import pytest

from kinreach.errors import InputError, UnknownNameError
from kinreach.kinematics import ArmKinematics, AxisGoal, CollisionChecker, LevenbergMarquardtSolver
from kinreach.robots import ArmDescription, Box, get_arm
from kinreach.sim.inside import build_scene

arms = pytest.mark.parametrize("name", ["ur5-thesis", "arm3"])
FOLDED = (0.0, -np.pi / 2, 3.0, -np.pi / 2, -np.pi / 2, 0.0)


def random_postures(name, count, seed=0):
    kin = ArmKinematics(name)
    return np.random.default_rng(seed).uniform(kin.lower, kin.upper, (count, kin.n))


@pytest.fixture(scope="module")
def ur5():
    return CollisionChecker("ur5-thesis")


@pytest.mark.parametrize("name", ["arm3", "ur10-thesis", "ur3-thesis", "ur5-thesis"])
def test_home_is_free(name):
    checker, home = CollisionChecker(name), get_arm(name).home
    assert not checker.in_collision(home)
    assert checker.free(home)
    assert checker.contacts(home) == ()
    assert checker.distance(home).distance > 0.01


def test_a_folded_arm_touches_itself(ur5):
    contacts = ur5.contacts(FOLDED)
    assert ("forearm_link", "shoulder_link") in contacts
    assert ("upper_arm_link", "wrist_1_link") in contacts
    assert ur5.in_collision(FOLDED)
    assert not ur5.free(FOLDED)
    assert ur5.distance(FOLDED).distance < -0.01
    assert ur5.distance(FOLDED).pair in contacts


@pytest.mark.parametrize(("height", "touches"), [(0.05, False), (0.01, False), (-0.03, True), (-0.10, True)])
def test_fingers_below_the_table_top_touch_the_table(ur5, height, touches):
    kin = ArmKinematics("ur5-thesis", base="world")
    table = next(box for box in kin.arm.workcell.obstacles if box.name == "table")
    top = table.position[2] + table.size[2] / 2
    below = 0.210 - 0.200  # the fingers end 1 cm beyond the tool centre point
    goal = AxisGoal((0.45, 0.0, top + below + height))
    q = LevenbergMarquardtSolver(kin).solve(goal, kin.arm.home)
    assert q.success
    contacts = ur5.contacts(q.q)
    assert (("finger_left", "table") in contacts) is touches
    assert ur5.in_collision(q.q) is touches


def test_obstacles_can_be_others():
    alone = CollisionChecker("ur5-thesis", obstacles=())
    assert not any("table" in pair or "floor" in pair for pair in alone.pairs)
    tcp = ArmKinematics("ur5-thesis", base="world").fk(get_arm("ur5-thesis").home)[:3, 3]
    crate = Box("crate", (0.1, 0.3, 0.1), tuple(tcp))
    walled = CollisionChecker(get_arm("ur5-thesis"), obstacles=[crate])
    assert alone.free(get_arm("ur5-thesis").home)
    assert walled.contacts(get_arm("ur5-thesis").home) == (("crate", "finger_left"), ("crate", "finger_right"))


def test_an_obstacle_around_the_base_is_reported():
    block = Box("block", (0.4, 0.4, 0.1), (0.0, 0.0, 0.0))
    assert ("base_link", "block") in CollisionChecker("ur5-thesis", obstacles=[block]).contacts(
        get_arm("ur5-thesis").home
    )


@arms
def test_pairs_are_ordered_and_leave_out_what_touches_by_construction(name):
    checker, arm = CollisionChecker(name), get_arm(name)
    assert len(checker.pairs) == len(set(checker.pairs))
    assert all(a < b for a, b in checker.pairs)
    assert list(checker.pairs) == sorted(checker.pairs)
    excused = {tuple(sorted(pair)) for pair in (*arm.disabled_collisions, *arm.workcell.touching)}
    assert not excused & set(checker.pairs)
    seen = {pair for q in random_postures(name, 300) for pair in checker.contacts(q)}
    assert seen
    assert seen <= set(checker.pairs)


@arms
def test_all_three_answers_agree(name):
    checker = CollisionChecker(name)
    verdicts = []
    for q in random_postures(name, 400):
        verdict, contacts, nearest = checker.in_collision(q), checker.contacts(q), checker.distance(q)
        assert verdict == bool(contacts) == (nearest.distance <= checker.margin)
        if contacts:
            assert nearest.pair in contacts
        verdicts.append(verdict)
    assert 33 < sum(verdicts) < 367


def test_a_graze_that_loose_tolerances_miss(ur5):
    q = random_postures("ur5-thesis", 3605)[3604]
    assert ur5.distance(q).pair == ("forearm_link", "gripper_palm")
    assert -0.002 < ur5.distance(q).distance < -0.001
    assert ur5.in_collision(q)


@pytest.mark.parametrize("name", ["arm3", "panda", "ur10-thesis", "ur3-thesis", "ur5-thesis"])
def test_mujoco_finds_the_same_contacts(name):
    arm = get_arm(name)
    checker = CollisionChecker(arm, margin=0.0)
    model = build_scene(arm, visual=False).compile()
    data = mujoco.MjData(model)
    held = model.key("home").qpos[len(arm.home) :]
    colliding = 0
    for q in random_postures(name, 300, seed=2):
        data.qpos[:] = [*q, *held]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        geoms = [(contact.geom1, contact.geom2) for contact in data.contact[: data.ncon]]
        pairs = {tuple(sorted(model.body(model.geom_bodyid[geom]).name for geom in pair)) for pair in geoms}
        assert checker.contacts(q) == tuple(sorted(pairs))
        assert checker.in_collision(q) == bool(pairs)
        colliding += bool(pairs)
    assert 15 < colliding < 285


@arms
@pytest.mark.parametrize("margin", [0.01, 0.05])
def test_margin_counts_what_is_nearer(name, margin):
    plain, wide = CollisionChecker(name), CollisionChecker(name, margin=margin)
    near = 0
    for q in random_postures(name, 500, seed=1):
        distance = plain.distance(q).distance
        assert wide.distance(q).distance == distance
        assert wide.in_collision(q) == bool(wide.contacts(q)) == (distance <= margin)
        near += 0 < distance <= margin
    assert near >= 2


def test_the_gripper_is_as_wide_as_the_description_says(ur5):
    # At home a thin wall beside one finger is touched only if the finger is held at half the opening.
    arm = get_arm("ur5-thesis")
    kin = ArmKinematics(arm, base="world")
    T = kin.fk(arm.home)
    thickness = 0.012
    for offset, touched in ((arm.gripper.opening / 2 + thickness / 2, True), (arm.gripper.opening / 4, False)):
        point = T[:3, 3] + offset * T[:3, 1]
        probe = Box("probe", (0.004, 0.004, 0.004), tuple(point))
        contacts = CollisionChecker(arm, obstacles=[probe]).contacts(arm.home)
        assert contacts == ((("finger_left", "probe"),) if touched else ())


def test_an_arm_with_one_shape_collides_with_nothing(tmp_path):
    file = tmp_path / "arm.urdf"
    file.write_text(
        '<robot name="arm"><link name="base"/><link name="tip"><collision><geometry><box size="0.1 0.1 0.3"/>'
        '</geometry></collision></link><joint name="turn" type="revolute"><parent link="base"/><child link="tip"/>'
        '<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>'
    )
    checker = CollisionChecker(ArmDescription.from_urdf(file))
    assert checker.pairs == checker.contacts([0.5]) == ()
    assert checker.free([0.5])
    with pytest.raises(InputError, match="no two shapes"):
        checker.distance([0.5])


@pytest.mark.parametrize("q", [np.zeros(5), np.zeros((2, 6)), np.full(6, np.nan), "home", None])
@pytest.mark.parametrize("method", ["in_collision", "free", "contacts", "distance"])
def test_malformed_postures(ur5, method, q):
    with pytest.raises(InputError, match="q must"):
        getattr(ur5, method)(q)


@pytest.mark.parametrize("margin", [-0.01, float("nan"), float("inf")])
def test_margins_that_cannot_be_used(margin):
    with pytest.raises(InputError, match="margin"):
        CollisionChecker("ur5-thesis", margin=margin)


def test_unknown_arm():
    with pytest.raises(UnknownNameError, match="ur5-thesis"):
        CollisionChecker("ur6")


@pytest.mark.parametrize("name", ["ur10-thesis", "ur3-thesis", "ur5-thesis"])
def test_triangles_collide_only_where_hulls_do(name):
    hulls, triangles = CollisionChecker(name, obstacles=()), CollisionChecker(name, obstacles=(), meshes="triangles")
    q = random_postures(name, 4000, seed=5)
    by_hulls, by_triangles = hulls.impossible(q), triangles.impossible(q)
    assert not (by_triangles & ~by_hulls).any()
    only_hulls = q[by_hulls & ~by_triangles]
    assert 50 < len(only_hulls) < 200
    assert by_triangles.sum() > 800
    assert all(triangles.free(one) and triangles.reason(one) == "" for one in only_hulls)
    assert max(-hulls.distance(one).distance for one in only_hulls) > 0.015


def test_answers_of_triangles_agree():
    checker, wide = (CollisionChecker("ur5-thesis", meshes="triangles", margin=margin) for margin in (0.0, 0.02))
    near = 0
    for q in random_postures("ur5-thesis", 60, seed=6):
        distance, contacts = checker.distance(q).distance, checker.contacts(q)
        assert checker.in_collision(q) == bool(contacts) == (distance <= 0)
        assert wide.in_collision(q) == (distance < 0.02)
        if checker.causes(q[None])[0]:
            assert tuple(sorted(checker.reason(q).split(" - "))) in contacts
        near += 0 < distance < 0.02
    assert near > 1


def test_an_owner_s_arm_is_judged_by_its_triangles(tmp_path):
    hulls = CollisionChecker("ur5-thesis", obstacles=())
    ours, file = hulls.kinematics.arm, tmp_path / "own.urdf"
    file.write_text(ours.urdf.replace("package://", f"{ours.package_root()}/"))
    arm = ArmDescription.from_urdf(
        file,
        held=ours.locked_joints,
        package_dirs=[ours.package_root()],
        disabled_collisions=ours.disabled_collisions,
    )
    assert arm.meshes == "triangles"
    assert arm.with_tool([0.0, 0.0, 0.1, 0.0, 0.0, 0.0]).meshes == "triangles"
    own, copy = CollisionChecker(arm), pickle.loads(pickle.dumps(CollisionChecker(arm, meshes="hulls")))
    q = random_postures("ur5-thesis", 1500, seed=7)
    wanted = CollisionChecker("ur5-thesis", obstacles=(), meshes="triangles").impossible(q)
    np.testing.assert_array_equal(own.impossible(q), wanted)
    np.testing.assert_array_equal(copy.impossible(q), hulls.impossible(q))
    assert (hulls.impossible(q) != wanted).sum() > 20
    with pytest.raises(UnknownNameError, match="hulls"):
        CollisionChecker("ur5-thesis", meshes="boxes")
    assert {get_arm(name).meshes for name in ("ur3-thesis", "ur5-thesis", "ur10-thesis", "panda")} == {"hulls"}
