"""Free objects: they are what MuJoCo would compile, holding one is no collision, and pushing one is said."""

import mujoco
import numpy as np
import pytest

from kinreach.errors import InputError
from kinreach.sim import ArmSimulation, BatchSimulation
from kinreach.sim.inside import SHAPES, Grasping, MoveStatus, Objects

ONE = np.zeros(1, dtype=np.intp)
KINDS = [("ball", 0.015, 0.02, 0.3), ("cube", 0.03, 0.3, 1.5), ("cylinder", 0.02, 0.1, 1.0)]


def kinds(*rows):
    shape, size, mass, friction = zip(*rows, strict=True)
    return Objects(np.array([SHAPES.index(name) for name in shape]), *map(np.array, (size, mass, friction)))


def compiled(shape, size, mass, friction):
    sizes = {"ball": f"{size}", "cube": f"{size} {size} {size}", "cylinder": f"{size} {size}"}[shape]
    kind = {"ball": "sphere", "cube": "box"}.get(shape, shape)
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><body name="object"><freejoint/><geom name="object" type="{kind}" size="{sizes}" '
        f'mass="{mass}" friction="{friction} 0.005 0.0001"/></body></worldbody></mujoco>'
    )


@pytest.mark.parametrize("kind", KINDS)
def test_an_object_is_what_mujoco_compiles(kind):
    """In the model of one simulation and in that of a batch, with all constants that follow."""
    single, batch = ArmSimulation("ur5-thesis", objects=1), BatchSimulation("ur5-thesis", 3, objects=1)
    place, wanted = np.array([[0.5, 0.1, -0.2]]), compiled(*kind)
    Grasping(single).put(ONE, 0, kinds(kind), place, np.zeros(1))
    Grasping(batch).put(ONE + 1, 0, kinds(kind), place, np.zeros(1))
    for model in (single.model, batch._plant.model_of(1)):
        geom, body = model.geom("object"), model.body("object")
        ours, theirs = geom.id, wanted.geom("object").id
        for name in ("geom_type", "geom_size", "geom_friction", "geom_rbound", "geom_aabb"):
            np.testing.assert_allclose(
                getattr(model, name)[ours], getattr(wanted, name)[theirs], rtol=1e-12, err_msg=name
            )
        for name in ("body_mass", "body_inertia"):
            np.testing.assert_allclose(
                getattr(model, name)[body.id], getattr(wanted, name)[1], rtol=1e-12, err_msg=name
            )
    for name in ("body_invweight0", "body_subtreemass"):
        np.testing.assert_allclose(
            getattr(single.model, name)[body.id], getattr(wanted, name)[1], rtol=1e-9, err_msg=name
        )
        np.testing.assert_allclose(
            batch.batch.expanded(name)[1, body.id], getattr(wanted, name)[1], rtol=1e-9, err_msg=name
        )
    assert batch._plant.model_of(0).geom("object").size[0] == 0.025


@pytest.mark.parametrize("kind", KINDS)
def test_the_lowest_point_of_an_object(kind):
    rng, checked = np.random.default_rng(0), 0
    shape, size = kind[:2]
    for _ in range(50):
        quaternion, R = rng.normal(size=4), np.empty(9)
        mujoco.mju_quat2Mat(R, quaternion / np.linalg.norm(quaternion))
        points = rng.normal(size=(3, 20_000))
        if shape == "ball":
            points *= size / np.linalg.norm(points, axis=0)
        elif shape == "cube":
            points = size * np.sign(points)
        else:
            points[:2] *= size / np.linalg.norm(points[:2], axis=0)
            points[2] = size * np.sign(points[2])
        lowest = -(R.reshape(3, 3) @ points)[2].min()
        assert kinds(kind).lowest(R.reshape(1, 3, 3))[0] == pytest.approx(lowest, abs=1e-3 * size)
        checked += 1
    assert checked == 50


def grasped(tool_down, *, height=0.0):
    """A simulation in which a ball is held at a point above the table, and the posture there."""
    simulation = ArmSimulation("ur5-thesis", objects=1)
    world, place = Grasping(simulation), np.array([0.5, 0.1, -0.2])
    world.reset(ONE, simulation.q[None])
    world.put(ONE, 0, kinds(("ball", 0.025, 0.05, 1.0)), place[None], np.zeros(1))
    low, high = (tool_down(np.add(place, (0, 0, z))) for z in (0.025 + height, 0.175))
    results = [world.move(ONE, target[None])[0] for target in (high, low)]
    return simulation, world, high, results


def test_what_is_held_is_no_collision(tool_down):
    _, world, high, results = grasped(tool_down)
    assert [result.reached for result in results] == [True, True]
    assert not world.grasp(ONE).gripped[0]
    world.drive(ONE, np.array([0.036]), 0.5)
    grip = world.grasp(ONE)
    assert grip.gripped[0]
    assert not grip.held[0]  # it still lies on the table
    lifted = world.move(ONE, high[None])[0]
    assert lifted.reached
    assert {touch.other for touch in lifted.touches} == {"object"}
    assert {touch.link for touch in lifted.touches} == {"finger_left", "finger_right"}
    grip = world.grasp(ONE)
    assert grip.held[0]
    assert grip.clearance[0] == pytest.approx(0.15, abs=2e-3)
    assert not grip.collides[0]


def test_what_an_object_blocks_is_said(tool_down):
    """The palm comes down on a large cube."""
    simulation = ArmSimulation("ur5-thesis", objects=1)
    world, place = Grasping(simulation), np.array([0.5, 0.1, -0.2])
    world.reset(ONE, simulation.q[None])
    turned = np.zeros(1)
    world.put(ONE, 0, kinds(("cube", 0.045, 1.0, 1.0)), place[None], turned)
    beside = np.add(place, (0.0, 0.045, 0.03))  # a finger stands on the cube
    results = [world.move(ONE, tool_down(np.add(beside, (0, 0, z)))[None])[0] for z in (0.15, 0.0)]
    assert results[0].reached
    assert results[1].status is MoveStatus.BLOCKED
    assert "touches object" in results[1].reason


def test_a_table_is_still_in_the_way(tool_down):
    *_, results = grasped(tool_down, height=-0.03)
    assert results[1].status is MoveStatus.BLOCKED
    assert "table" in results[1].reason


@pytest.mark.parametrize(("depth", "collides"), [(-1e-3, False), (0.5e-3, False), (2e-3, True)])
def test_a_slight_touch_is_not_a_collision(tool_down, depth, collides):
    simulation = ArmSimulation("ur5-thesis", objects=1)
    world = Grasping(simulation)
    world.reset(ONE, tool_down((0.45, 0.0, -0.19 - depth))[None])  # fingers end 1 cm below the tip
    world.put(ONE, 0, kinds(("ball", 0.025, 0.05, 1.0)), np.array([[0.6, 0.2, -0.2]]), np.zeros(1))
    assert world.grasp(ONE).collides.tolist() == [collides]


def test_arms_without_a_gripper_cannot_grasp():
    with pytest.raises(InputError, match="has no gripper"):
        Grasping(ArmSimulation("ur5e", objects=1))
    with pytest.raises(InputError, match="objects must be at most 2"):
        ArmSimulation("ur5-thesis", objects=3)
