"""Obstacles on the table: what is free, what collides, and who says so."""

import copy
from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest

import kinreach  # noqa: F401  (registers the environments)
from kinreach.envs import _obstacles
from kinreach.errors import InputError, PathError
from kinreach.kinematics import CollisionChecker, URKinematics, plan_path
from kinreach.vision import RGBDCamera

NAME = "kinreach/Obstacles-v0"
FIRST, SECOND = np.eye(6)[:2]


@pytest.fixture(scope="module")
def env():
    return gym.make(NAME, disable_env_checker=True)


def begun(env, seed, clutter=8):
    _, info = env.reset(seed=seed, options={"clutter": clutter})
    return env.unwrapped, info


def test_a_scene_is_as_described(env):
    obstacles = 0
    for seed in range(6):
        world, info = begun(env, seed, clutter=2 * seed)
        exact = CollisionChecker("ur5-thesis", obstacles=world.arm.workcell.obstacles)
        assert exact.distance(world.home).distance >= world.options.margin
        assert info["clutter"] == len(world.obstacles) == 2 * seed
        boxes = np.array([(*b.position, *b.size) for b in world.obstacles]).reshape(-1, 6)
        assert info["obstacles"].shape == (20, 6)
        np.testing.assert_array_equal(info["obstacles"][: 2 * seed], boxes)
        assert (info["obstacles"][2 * seed :, 2] <= -20.0).all()  # out of the way
        assert (info["obstacles"][:, 3:] > 0.0).all()
        for box in world.obstacles:
            assert box.position[2] - box.size[2] / 2 == pytest.approx(-0.2)
            assert 0.1 <= box.size[2] <= 0.4
            obstacles += 1
        goals = world.goal_postures()
        assert len(goals) >= 1
        kin = URKinematics("ur5-thesis", tip="tcp", base="world")
        for q in goals:
            T = kin.fk(q)
            np.testing.assert_allclose(T[:3, 3], info["goal"], atol=1e-7)
            np.testing.assert_allclose(T[:3, 2], (0, 0, -1), atol=1e-7)
            assert exact.distance(q).distance >= world.options.margin - 1e-6
    assert obstacles == 30


def test_obstacles_are_anywhere_on_the_table_but_at_the_ball():
    env = gym.make(NAME, disable_env_checker=True, clutter=(20,), heights=(0.2, 0.21)).unwrapped
    env.reset(seed=0, options={"clutter": 0})
    drawn = [env.episodes.scene(env.np_random, 20) for _ in range(60)]
    boxes = np.array([(*box.position[:2], *box.size[:2]) for scene, _ in drawn for box in scene])
    low, high = [0.2, -0.45, 0.04, 0.04], [0.75, 0.45, 0.1, 0.1]
    assert (boxes >= low).all()
    assert (boxes <= high).all()
    np.testing.assert_allclose(boxes.min(axis=0), low, atol=5e-3)
    np.testing.assert_allclose(boxes.max(axis=0), high, atol=5e-3)
    gaps = [
        np.linalg.norm((np.abs(goal[:2] - box.position[:2]) - np.array(box.size[:2]) / 2).clip(0.0))
        for scene, goal in drawn
        for box in scene
    ]
    assert 0.04 <= min(gaps) < 0.045
    assert len(boxes) == len({box.name for scene, _ in drawn[:1] for box in scene}) * 60 == 1200


def test_goal_postures_turn_the_gripper_by_an_eighth_of_half_a_turn(env):
    world, _ = begun(env, 0, clutter=0)
    turned = (world.goal_postures()[:, 5] - world.home[5]) / (np.pi / 8)
    np.testing.assert_allclose(turned, np.round(turned), atol=1e-9)
    assert np.unique(np.round(turned)).tolist() == list(range(8))


def test_a_move_is_straight_and_drawn_as_it_goes(env):
    world, info = begun(env, 0, clutter=0)
    assert world.waypoints_to(world.home, world.home + 1.0)[0][0] == world.home[0] + 1.0
    shown = []
    scene = world.scene
    scene.watch = mine = lambda: shown.append(scene.q)
    way = 0.3 * np.array([1.0, -1.0, 0.5, 0.0, 0.2, 0.4])
    env.step(world.action_for(world.home + way))
    along = (shown - world.home) @ way / (way @ way)
    assert np.abs(shown - (world.home + along[:, None] * way)).max() < 0.01
    assert along[-1] == pytest.approx(1.0, abs=1e-3)
    np.testing.assert_array_equal(scene.ball_position, info["goal"])
    assert scene.watch is mine


def test_a_seed_is_a_scene(env):
    first, again = begun(env, 3)[1], begun(env, 3)[1]
    other = begun(env, 4)[1]
    np.testing.assert_array_equal(first["obstacles"], again["obstacles"])
    np.testing.assert_array_equal(first["goal"], again["goal"])
    assert (first["goal"] != other["goal"]).any()


def test_paths_are_free_and_reach(env):
    waypoints = 0
    for seed in range(4):
        world, _ = begun(env, seed)
        path = plan_path(world.clearance, world.home, world.goal_postures())
        way = 0.0
        for index, (before, q) in enumerate(pairwise(path)):
            _, reward, terminated, truncated, info = env.step(world.action_for(q))
            way += np.linalg.norm(q - before)
            assert reward == pytest.approx(sum(info["reward_terms"].values()))
            assert terminated == info["reached"] == info["is_success"] == (index == len(path) - 2)
            assert not truncated
            assert not info["impossible"]
            waypoints += 1
        assert info["distance"] < 1e-3
        assert info["length"] == pytest.approx(way, rel=1e-3)
        assert info["move_s"] > 0.5
    assert waypoints >= 6


def test_the_verdict_is_the_checkers(env):
    """Straight moves to random postures: an oracle with samples of its own finds the same lines free."""
    rng, collided, free = np.random.default_rng(0), 0, 0
    for seed in range(16):
        world, _ = begun(env, seed)
        target = world.home + rng.uniform(-1.0, 1.0, 6)
        line = world.home + np.linspace(0, 1, 750)[:, None] * (target - world.home)
        exact = CollisionChecker("ur5-thesis", obstacles=world.arm.workcell.obstacles)
        apart = min(exact.distance(q).distance for q in line[::25])
        _, _, terminated, _, info = env.step(world.action_for(target))
        if exact.impossible(line).any():
            assert info["impossible"], seed
            assert terminated
            assert info["status"] in ("collision", "self-collision")
            assert exact.in_collision(info["q"])
            assert " - " in info["impossible_reason"]
            collided += 1
        elif apart > 0.01:  # nearer, the arm may touch what its line does not
            assert not info["impossible"], (seed, info["impossible_reason"])
            np.testing.assert_allclose(info["q"], target, atol=1e-3)
            free += 1
    assert collided >= 5
    assert free >= 5


def test_each_posture_of_a_move_is_checked_once(env, monkeypatch):
    checked, causes = [], CollisionChecker.causes

    def counted(self, q):
        checked.append(q)
        return causes(self, q)

    monkeypatch.setattr(CollisionChecker, "causes", counted)
    for seed in range(3):
        world, _ = begun(env, seed, clutter=0)
        checked.clear()
        env.step(world.action_for(world.home + 0.4 * FIRST))
        postures = np.concatenate(checked)
        assert len(checked) > 2
        assert len(postures) == len(np.unique(postures, axis=0)) > 100


def test_an_arm_that_is_sent_to_where_it_stands_ends_the_episode(env):
    world, _ = begun(env, 0)
    _, _, terminated, truncated, info = env.step(world.action_for(world.home))
    assert (terminated, truncated, info["reached"], info["impossible"]) == (True, False, False, False)
    assert info["status"] == "missed"
    with pytest.raises(InputError, match="over"):
        env.step(world.action_for(world.home))


def test_episodes_are_truncated():
    env = gym.make(NAME, disable_env_checker=True, max_episode_steps=2, clutter=(0,))
    world, _ = begun(env, 0, clutter=0)
    for count, turn in enumerate((0.1, 0.2)):
        _, _, terminated, truncated, _ = env.step(world.action_for(world.home + turn * FIRST))
        assert (terminated, truncated) == (False, count == 1)


def test_who_finds_no_way_says_why(env):
    world, info = begun(env, 1)
    _, _, terminated, _, info = world.forfeit("too narrow")
    assert terminated
    assert (info["impossible"], info["impossible_reason"], info["status"]) == (True, "too narrow", "forfeited")
    with pytest.raises(PathError, match=r"none of the 1 goal postures is free: .* - table"):
        plan_path(world.clearance, world.home, world.home + 1.3 * SECOND)


@pytest.mark.parametrize(("options", "said"), [
    ({"clutter": (30,)}, "clutter must be at most 20"),
    ({"clutter": ()}, "clutter must be a list of at least one number"),
    ({"heights": (0.4, 0.1)}, "the smaller one first"),
])  # fmt: skip
def test_bad_options(options, said):
    with pytest.raises(InputError, match=said):
        gym.make(NAME, **options)


def test_bad_calls(env, monkeypatch):
    batch = gym.make_vec(NAME, 3, vectorization_mode="vector_entry_point")
    for clutter in ([1, 2], [1, 2, 3, 4]):
        with pytest.raises(InputError, match=rf"clutter must have a value for each of 3 .*, got {len(clutter)}"):
            batch.reset(options={"clutter": clutter})
    monkeypatch.setattr(_obstacles, "MAX_DRAWS", 0)
    with pytest.raises(InputError, match="none of 0 scenes with 4 obstacles has a free goal; choose fewer"):
        batch.reset(options={"clutter": 4})
    batch.close()
    monkeypatch.undo()
    with pytest.raises(InputError, match="reset the environment"):
        gym.make(NAME).unwrapped.step(np.zeros(6))
    with pytest.raises(InputError, match="clutter"):
        env.reset(options={"clutter": -1})
    env.reset(seed=0)
    with pytest.raises(InputError, match="shape"):
        env.step(np.zeros(5))


def test_depths_are_those_of_the_scene(needs_gl):
    """No farther than rays to the boxes, and as far where nothing else is before them; in a batch and a copy too."""
    env = gym.make(NAME, depth=True, clutter=(16,), dtype="float64")
    batch = gym.make_vec(NAME, 3, "vector_entry_point", depth=True, clutter=(16,), dtype="float64")
    world, together, hit, met = env.unwrapped, batch.reset(seed=0)[0], 0, 0
    camera = RGBDCamera(gym.make(NAME).unwrapped.scene, "overview", width=64, height=48)
    k, T = camera.intrinsics, camera.T_world_camera
    u, v = np.meshgrid(np.arange(64), np.arange(48))
    rays = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones((48, 64))], axis=2) @ T[:3, :3].T
    for seed in range(3):
        seen, _ = env.reset(seed=seed)
        depth = seen["overview_depth"]
        assert env.observation_space.contains(seen)
        assert (depth.dtype, depth.shape, seen["observation"].shape) == (np.float32, (48, 64, 1), (13,))
        for name, part in seen.items():
            np.testing.assert_array_equal(together[name][seed], part)
        boxes = np.full((48, 64), np.inf)
        for box in world.obstacles:
            ends = (np.array(box.position) + np.array([[-0.5], [0.5]]) * box.size)[:, None, None] - T[:3, 3]
            near, far = np.sort(ends / rays, axis=0)
            enters = near.max(axis=2)
            boxes = np.where(enters < far.min(axis=2), np.minimum(boxes, enters), boxes)
        on_box = np.isfinite(boxes)
        away = depth[:, :, 0][on_box] - boxes[on_box]
        hit, met = hit + len(away), met + (np.abs(away) < 2e-3).sum()
        assert (away < 2e-3).mean() > 0.98  # but at edges
    assert hit > 500
    assert met > 0.7 * hit
    twin, action = copy.deepcopy(world), world.action_for(world.home + 0.1 * FIRST)
    moved = env.step(action)[0]["overview_depth"]
    np.testing.assert_array_equal(twin.step(action)[0]["overview_depth"], moved)
    assert 10 < (np.abs(moved - depth) > 0.005).sum() < 1000
    for each in (env, batch, twin, camera):
        each.close()
    with pytest.raises(InputError, match="depth must be true or false, got 2"):
        gym.make(NAME, depth=2)


def test_obstacles_can_be_observed():
    """In a row each, as `info` has them, and zeros for the spare ones; else nothing changes."""
    given = {"clutter": (0, 3, 20), "boxes": True, "dtype": "float64"}
    env, plain = (
        gym.make(NAME, **given),
        gym.make(NAME, **{**given, "boxes": False}),
    )
    batch = gym.make_vec(NAME, 4, "vector_entry_point", **given)
    together, counts = batch.reset(seed=0)[0], set()
    for seed in range(4):
        observation, info = env.reset(seed=seed)
        boxes, count = observation[13:].reshape(20, 7), info["clutter"]
        np.testing.assert_array_equal(observation[:13], plain.reset(seed=seed)[0])
        np.testing.assert_array_equal(observation, together[seed])
        np.testing.assert_array_equal(boxes[:, 0], np.arange(20) < count)
        np.testing.assert_array_equal(boxes[:count, 1:], info["obstacles"][:count])
        assert not boxes[count:].any()
        assert env.observation_space.contains(observation)
        counts.add(count)
    assert len(counts) >= 2
    assert env.observation_space.shape == (153,)
    with pytest.raises(InputError, match="boxes must be true or false, got 'yes'"):
        gym.make(NAME, boxes="yes")


def test_the_exact_verdict_is_that_of_the_arm_among_the_obstacles(env):
    """Without the margin, which planners keep beside it; compared with a checker of the arm as it is described."""
    world, _ = begun(env, 3, clutter=6)
    exact = CollisionChecker(world.arm, margin=0.0)
    q = world.home + np.random.default_rng(3).uniform(-1.0, 1.0, (150, 6))
    found = [world.checker.free(posture) for posture in q]
    assert found == [exact.free(posture) for posture in q]
    kept = [world.clearance.free(posture) for posture in q]
    assert all(one >= other for one, other in zip(found, kept, strict=True))
    assert 0 < sum(kept) < sum(found) < 150
