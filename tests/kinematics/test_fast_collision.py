"""The fast verdict on postures: agreement with the meshes, exactness at the table, independence of the batch."""

from __future__ import annotations

import pickle
from dataclasses import replace
from itertools import combinations, pairwise

import coal
import numpy as np
import pinocchio as pin
import pytest

from benchmarks.studies.collision_agreement import classes, exact, near_solutions
from kinreach.errors import InputError, UnknownNameError
from kinreach.kinematics import ArmKinematics, UR5Kinematics
from kinreach.kinematics.blocked_arcs import Arcs, BlockedArcs, rows_of
from kinreach.kinematics.collision import CollisionChecker
from kinreach.kinematics.fast_collision import Cause, FastCollision
from kinreach.robots import ArmDescription, Box, Workcell, get_arm

COUNT = 1500
FOLDED = np.array([0.0, -np.pi / 2, 3.0, -np.pi / 2, -np.pi / 2, 0.0])
HOME = np.array(get_arm("ur5").home)


@pytest.fixture(scope="module")
def fast():
    return FastCollision("ur5")


@pytest.fixture(scope="module")
def checker():
    return CollisionChecker("ur5")


@pytest.fixture(scope="module")
def kin():
    return UR5Kinematics(tip="tcp", base="world")


@pytest.fixture(scope="module")
def groups():
    return classes(np.random.default_rng(10), COUNT)


@pytest.mark.parametrize(
    ("name", "agreement", "impossible"),
    [
        ("near, noise 0.02 rad", 0.999, (0.05, 0.2)),
        ("near, noise 0.05 rad", 0.999, (0.2, 0.5)),
        ("near, noise 0.1 rad", 0.998, (0.3, 0.6)),
        ("near, noise 0.2 rad", 0.996, (0.3, 0.6)),
        ("random", 0.985, (0.55, 0.7)),
    ],
)
def test_agreement_with_the_meshes(fast, checker, kin, groups, name, agreement, impossible):
    q = groups[name]
    truth, verdict = exact(checker, kin, q), fast.impossible(q)
    assert len(q) == COUNT
    assert impossible[0] < truth.mean() < impossible[1]
    assert (truth == verdict).mean() >= agreement
    assert (truth & ~verdict).mean() <= 0.006
    assert (verdict & ~truth).mean() <= 0.011


def test_solutions_are_free(fast):
    q = near_solutions(np.random.default_rng(3), 1000)
    assert len(q) == 1000
    assert (q[:, 0] < 0).any()
    assert (q[:, 0] > 0).any()
    assert not fast.impossible(q).any()


def lowered(kin, q, heights):
    """The posture with its tip at other heights [m], reached without changing the branch."""
    T = kin.fk(q)
    postures = []
    for height in heights:
        T[2, 3] = height
        postures.append(kin.nearest(T, q).q)
    return np.array(postures)


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_finger_tips_meet_the_table_exactly(fast, checker, kin, tilt):
    table = next(box for box in get_arm("ur5").workcell.obstacles if box.name == "table")
    top = table.position[2] + table.size[2] / 2
    rng = np.random.default_rng(4)
    checked = 0
    for q in near_solutions(rng, 40):
        tilted = q.copy()
        tilted[3] += rng.uniform(-tilt, tilt)
        heights = np.arange(top + 0.0301, top - 0.02, -1e-4)
        postures = lowered(kin, tilted, heights)
        verdict = fast.impossible(postures)
        truth = np.array([checker.in_collision(row) for row in postures])
        assert not verdict[0]
        assert verdict[-1]
        assert (np.diff(verdict.astype(int)) >= 0).all()
        assert abs(verdict.argmax() - truth.argmax()) <= 1
        if tilt == 0.0:
            assert heights[verdict.argmax()] == pytest.approx(top + 0.01, abs=1.1e-4)
        checked += 1
    assert checked == 40


def test_a_verdict_does_not_depend_on_the_batch(fast, groups):
    q = np.concatenate(list(groups.values()))[-4500:]  # more than one block
    together = fast.causes(q)
    assert len(q) == 4500
    assert set(together) == set(Cause)
    np.testing.assert_array_equal(np.concatenate([fast.causes(row[None]) for row in q[:700]]), together[:700])
    np.testing.assert_array_equal(np.concatenate([fast.causes(part) for part in np.array_split(q, 37)]), together)
    order = np.random.default_rng(0).permutation(len(q))
    np.testing.assert_array_equal(fast.causes(q[order]), together[order])
    np.testing.assert_array_equal(fast.causes(np.asfortranarray(q)), together)
    np.testing.assert_array_equal(FastCollision(get_arm("ur5")).causes(q), together)


def test_the_postures_are_left_as_they_are(fast, groups):
    q = groups["random"].copy()
    fast.impossible(q)
    np.testing.assert_array_equal(q, groups["random"])


def test_home_is_free(fast):
    assert not fast.impossible(HOME[None])[0]
    assert fast.reason(HOME) == ""
    assert fast.impossible(np.empty((0, 6))).shape == (0,)


@pytest.mark.parametrize("joint", range(6))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_limits(fast, kin, joint, sign):
    q = np.tile(HOME, (3, 1))
    q[:, joint] = sign * (kin.upper[joint] + np.array([-1e-6, 1e-6, 100.0]))
    causes = fast.causes(q)
    assert causes[0] != Cause.LIMITS
    assert (causes[1:] == Cause.LIMITS).all()
    assert fast.reason(q[1]) == f"out of limits: {kin.arm.joints[joint]}"


def test_reasons_are_named(fast, checker, kin):
    assert fast.reason(FOLDED) in {
        " - ".join(pair) for one, two in checker.contacts(FOLDED) for pair in ((one, two), (two, one))
    }
    assert fast.causes(FOLDED[None])[0] == Cause.SELF
    (pressed,) = lowered(kin, near_solutions(np.random.default_rng(0), 1)[0], [-0.195])
    assert fast.reason(pressed) in ("finger_left - table", "finger_right - table")
    assert fast.causes(pressed[None])[0] == Cause.OBSTACLE


def test_the_kind_of_collision_is_that_of_the_deepest_pair_in_most_postures(fast, checker, groups):
    q = groups["random"][fast.causes(groups["random"]) >= Cause.SELF]
    causes = fast.causes(q)
    obstacles = {box.name for box in get_arm("ur5").workcell.obstacles}
    kinds = [{bool(obstacles & set(pair)) for pair in checker.contacts(row)} for row in q]
    fits = [(cause == Cause.OBSTACLE) in kind for cause, kind in zip(causes, kinds, strict=True)]
    assert len(fits) > 600
    assert np.mean(fits) > 0.97


@pytest.mark.parametrize("q", [HOME, np.zeros((3, 5)), np.full((2, 6), np.nan), "home", None, [[np.inf] * 6], 1.0])
def test_malformed_postures(fast, q):
    for judge in (fast.impossible, fast.causes):
        with pytest.raises(InputError, match="q must"):
            judge(q)


@pytest.mark.parametrize("name", ["ur3", "ur5", "ur10"])
def test_no_collision_deeper_than_5_mm_is_missed(name):
    fast, checker, kin = FastCollision(name), CollisionChecker(name), ArmKinematics(name)
    q = np.random.default_rng(42).uniform(kin.lower, kin.upper, (5000, 6))
    truth, verdict = exact(checker, kin, q), fast.impossible(q)
    assert truth.mean() > 0.5
    assert (truth == verdict).mean() >= 0.985
    missed = q[truth & ~verdict]
    assert len(missed) <= 2
    assert all(checker.distance(row).distance > -0.005 for row in missed)


def test_without_refining_the_verdict_is_that_of_the_tables(groups):
    q = groups["random"]
    tables, refined = FastCollision("ur5", refine=False), FastCollision("ur5")
    changed = tables.causes(q) != refined.causes(q)
    assert 0 < changed.sum() < 20
    assert not tables.impossible(q[changed]).any()
    for each in (tables, refined):
        again = pickle.loads(pickle.dumps(each))
        assert again.refine == each.refine
        np.testing.assert_array_equal(again.causes(q), each.causes(q))


@pytest.mark.parametrize("arm", ["arm3", replace(get_arm("ur5"), workcell=Workcell())])
def test_any_other_arm_is_judged_by_the_exact_checker(arm):
    fast, checker, kin = FastCollision(arm), CollisionChecker(arm), ArmKinematics(arm)
    q = np.random.default_rng(1).uniform(1.1 * kin.lower, 1.1 * kin.upper, (400, kin.n))
    truth, causes = exact(checker, kin, q), fast.causes(q)
    np.testing.assert_array_equal(causes != Cause.NONE, truth)
    assert {Cause.NONE, Cause.LIMITS} < set(causes)
    for row, cause in zip(q, causes, strict=True):
        assert fast.reason(row).startswith("out of limits") == (cause == Cause.LIMITS)
        assert bool(fast.reason(row)) == (cause != Cause.NONE)
        if cause >= Cause.SELF:
            assert (cause == Cause.OBSTACLE) == any(box.name in fast.reason(row) for box in fast.arm.workcell.obstacles)
    with pytest.raises(InputError, match="q must be finite"):
        fast.causes(np.full((1, kin.n), np.nan))


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


@pytest.mark.parametrize("refine", [True, False])
@pytest.mark.parametrize("geometry", ['box size="0.1 0.1 {:g}"', 'cylinder radius="0.05" length="{:g}"'])
def test_an_arm_that_is_no_ur_is_judged_as_by_pinocchio(tmp_path, geometry, refine):
    arm = wrist_arm(tmp_path, geometry)
    q = np.random.default_rng(7).uniform(-3.0, 3.0, (1000, 6))
    distance, verdict = least_distances(arm, q), FastCollision(arm, refine=refine).impossible(q)
    free, touching = distance > 1e-4, distance < -1e-4
    assert (free | touching).sum() >= 990
    assert min(free.sum(), touching.sum()) > 200
    assert not verdict[free].any()
    assert verdict[touching].all()


def test_unknown_arms():
    with pytest.raises(UnknownNameError, match="ur5"):
        FastCollision("ur6")


@pytest.mark.parametrize("grid", [(64,), (48, 40)])
def test_blocked_arcs_of_a_known_shape(grid):
    joints = 1 + len(grid)
    asked = []

    def boundary(q):
        return 2.5 * np.sin(q[1]), 0.8 + 0.5 * np.cos(q[-1])

    def collides(q):
        asked.append(None)
        middle, half = boundary(q)
        return abs((q[0] - middle + np.pi) % (2 * np.pi) - np.pi) < half

    table = BlockedArcs(Arcs(0, tuple(range(1, joints)), grid), collides, joints)
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (joints, 4000))
    single = q.astype(np.float32)
    rows = rows_of(single, table.arcs.over)
    verdict = table.blocked(single, rows)
    middle, half = boundary(q)
    margin = half - np.abs((q[0] - middle + np.pi) % (2 * np.pi) - np.pi)
    clear = np.abs(margin) > 0.08  # the grid's step times the slope of 2.5, and its curvature
    assert clear.mean() > 0.9
    np.testing.assert_array_equal(verdict[clear], margin[clear] > 0)
    assert table.doubtful(single, rows)[margin > 0].all()
    assert len(asked) < 41 * np.prod(grid)


@pytest.mark.parametrize("answer", [True, False])
def test_arcs_that_are_all_or_nothing(answer):
    table = BlockedArcs(Arcs(1, (0,), (16,)), lambda q: answer, 2)
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (2, 500)).astype(np.float32)
    assert (table.blocked(q, rows_of(q, (0,))) == answer).all()
    assert (table.doubtful(q, rows_of(q, (0,))) == answer).all()
