"""Obstacles of every shape and pose: verdicts against distances computed by hand."""

import numpy as np
import pytest
import trimesh

from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, CollisionChecker, pose
from kinreach.robots import Box, Obstacle, Tool, get_arm

#: A ball on the flange: the only part of the arm that the obstacles of these tests can touch.
RADIUS = 0.03
ARM = get_arm("ur5e").with_tool(Tool([0.0, 0.0, 0.5, 0.0, 0.0, 0.0], shapes=[((RADIUS,), (0.0, 0.0, 0.5))]))


def outside(point, size, T):
    """Distance of a point from a box, cylinder or ball [m], negative inside, from its definition."""
    x = (np.linalg.inv(T) @ np.append(point, 1.0))[:3]
    if len(size) == 1:
        return np.linalg.norm(x) - size[0]
    if len(size) == 2:
        deep = np.array([np.hypot(x[0], x[1]) - size[0], abs(x[2]) - size[1] / 2])
    else:
        deep = np.abs(x) - size / 2
    return np.linalg.norm(deep.clip(0.0)) + min(deep.max(), 0.0)


@pytest.mark.slow
def test_solids_at_any_pose_touch_where_geometry_says():
    rng = np.random.default_rng(0)
    kin = ArmKinematics(ARM, base="world")
    seen = {True: 0, False: 0}
    for _ in range(150):
        q = rng.uniform(-3, 3, 6)
        centre = kin.fk(q)[:3, 3]
        size = rng.uniform(0.02, 0.2, rng.integers(1, 4))
        around = np.concatenate([centre + rng.uniform(-0.15, 0.15, 3), rng.uniform(-1.5, 1.5, 3)])
        gap = outside(centre, size, pose(around)) - RADIUS
        if abs(gap) < 1e-5:
            continue
        contacts = CollisionChecker(kin, obstacles=[Obstacle("it", size, around)]).contacts(q)
        assert (("it", "tool_body") in contacts) == (gap < 0.0)
        seen[gap < 0.0] += 1
    assert min(seen.values()) > 20


@pytest.mark.parametrize("scale", [1.0, 0.001])
def test_a_mesh_is_taken_as_its_triangles(tmp_path, scale):
    """Within a ring, whose hull is full, the ball touches nothing."""
    ring = trimesh.creation.annulus(0.1 / scale, 0.14 / scale, 0.06 / scale)
    file = tmp_path / "ring.stl"
    ring.export(file)
    kin = ArmKinematics(ARM, base="world")
    q = np.array(ARM.home)
    centre = kin.fk(q)[:3, 3]
    for offset, touches in ((0.0, False), (0.06, False), (0.08, True), (0.165, True), (0.18, False)):
        at = (centre[0] + offset, *centre[1:], 0.0, 0.0, 0.0)
        checker = CollisionChecker(kin, obstacles=[Obstacle("ring", file, at, scale=scale)])
        assert (("ring", "tool_body") in checker.contacts(q)) == touches, offset


def test_a_box_is_the_same_either_way():
    rng = np.random.default_rng(1)
    postures = rng.uniform(-3, 3, (200, 6))
    box = Box("it", (0.3, 0.4, 0.5), (0.4, 0.2, 0.3))
    same = Obstacle("it", box.size, (*box.position, 0.0, 0.0, 0.0))
    verdicts = [CollisionChecker("ur5e", obstacles=[each]).causes(postures) for each in (box, same)]
    assert (verdicts[0] == verdicts[1]).all()
    assert len(np.unique(verdicts[0])) == 3


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"name": ""}, "name of an obstacle must be text"),
        ({"pose": (0.0,) * 3}, r"pose of the obstacle 'it' must have shape \(6,\)"),
        ({"pose": (np.nan,) * 6}, "pose of the obstacle 'it' must be finite"),
        ({"shape": ()}, "size of the obstacle 'it' must be one to three numbers"),
        ({"shape": (0.1, -0.2)}, "size of the obstacle 'it' must be finite and above 0"),
        ({"shape": 3.0}, "size of the obstacle 'it' must be one to three numbers"),
        ({"scale": 0.0}, "scale of the obstacle 'it' must be finite and above 0"),
    ],
)
def test_what_is_no_obstacle_is_refused(wrong, said):
    with pytest.raises(InputError, match=said):
        Obstacle(**({"name": "it", "shape": (0.1,)} | wrong))


def test_lists_of_obstacles_are_checked(tmp_path):
    ball = Obstacle("ball", (0.1,))
    with pytest.raises(InputError, match="two obstacles are named 'ball'"):
        CollisionChecker("ur5e", obstacles=[ball, Box("ball", (1.0, 1.0, 1.0), (0.0, 0.0, 3.0))])
    with pytest.raises(InputError, match="must be a list of Box and Obstacle"):
        CollisionChecker("ur5e", obstacles=["ball"])
    (tmp_path / "not.stl").write_bytes(b"not a mesh")
    with pytest.raises(InputError, match=r"mesh 'not\.stl'"):
        CollisionChecker("ur5e", obstacles=[Obstacle("it", tmp_path / "not.stl")])
