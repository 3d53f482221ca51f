"""How `interception` goes along with a ball whose sights are noisy, and what it does when no way out is left."""

from itertools import pairwise
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest

from kinreach.compare import get_task
from kinreach.envs.inside import moving as ball

#: Parts of a frame, and the time of one [s].
PARTS, PART = ball.PARTS, 1.0 / (ball.FRAMES * ball.PARTS)


@pytest.fixture(scope="module")
def env():
    task = get_task("moving")
    with gym.make(task.environment, **{**task.options, "noise": 0.01}) as env:
        yield env


@pytest.fixture
def planner(env):
    """In its first frame."""
    planner = get_task("moving").methods["interception"].make(env)
    observation, info = env.reset(seed=0, options={"speed": 0.1})
    planner.reset(observation, info)
    planner.start = np.array(info["q"]), np.zeros(6)
    return planner


def line(planner, frames, speed):
    """Where a ball is after each frame that rolls through the middle of the area [m], shape (frames, 2)."""
    middle = (planner._low + planner._high) / 2.0
    return middle + (np.arange(1, frames + 1) - frames / 2.0)[:, None] / ball.FRAMES * speed * np.array([0.6, 0.8])


@pytest.mark.parametrize("speed", [0.05, 0.1, 0.2])
def test_a_way_along_ends_above_the_ball_for_some_frames_within_the_limits(planner, speed):
    q, v = planner.start
    xy = line(planner, 40, speed)
    way = planner._along(q, v, xy)
    frames = len(way) // PARTS
    assert len(way) == frames * PARTS
    followed = 0
    for frame in range(frames, 0, -1):
        tip = planner._kinematics.fk(way[frame * PARTS - 1])
        if np.linalg.norm(tip[:2, 3] - xy[frame - 1]) > 1e-6:
            break
        assert tip[2, 3] == pytest.approx(planner._aim, abs=1e-6)
        np.testing.assert_allclose(tip[:3, 2], [0.0, 0.0, -1.0], atol=1e-6)
        followed += 1
    assert followed == 7  # when it arrives, and six frames more
    assert 10 < frames < 39
    rates = np.diff(np.vstack([q, way]), axis=0) / PART
    assert np.abs(rates).max() <= planner._known["speed"] + 1e-6
    gains = np.diff(np.vstack([v, rates]), axis=0) / PART
    assert np.abs(gains).max() <= 0.94 * planner._known["acceleration"]


def test_there_is_no_way_along_a_ball_that_leaves_soon_or_with_collisions_all_over(planner, monkeypatch):
    q, v = planner.start
    xy = line(planner, 40, 0.1)
    assert planner._along(q, v, xy) is not None
    assert [planner._along(q, v, xy[:frames]) for frames in (1, 4, 8)] == [None] * 3
    asked = []
    monkeypatch.setattr(planner, "_collides", lambda way: asked.append(way) or np.ones(len(way), dtype=bool))
    assert planner._along(q, v, xy) is None
    assert len(asked) > 1
    assert all(len(one) < len(other) for one, other in pairwise(asked))


def test_with_noisy_sights_the_arm_is_on_the_way_along_a_frame_later(planner, monkeypatch):
    """Its joints pass where they shall be a tenth of a second later: places and speeds count alike."""
    q, v = planner.start
    xy = line(planner, 80, 0.1)
    planner._fit = SimpleNamespace(moving=True, noise=0.01, forecast=lambda ages: xy[: len(ages)])
    way = planner._along(q, v, xy[:60])
    planner._choose(q, v, 0.02, np.zeros(3))
    for _ in range(PARTS):
        q, v = ball.moved(q, v, planner._target, PART, **planner._limits)
    speed = (way[PARTS] - way[PARTS - 2]) / (2.0 * PART)
    np.testing.assert_allclose(q + 0.1 * v, way[PARTS - 1] + 0.1 * speed, atol=1e-3)
    assert np.abs(v).max() > 0.05
    assert planner._meeting is None
    assert planner._followed is None


def test_without_a_way_out_the_last_one_is_taken(planner, monkeypatch):
    q, v = planner.start
    target, escape = q + 0.1, q - 0.2
    for free, expected in ((lambda *_: False, escape), (lambda q, v, to, *_: to is target, target)):
        planner._target, planner._escape = target, escape
        monkeypatch.setattr(planner, "_is_free", free)
        planner._keep_a_way_out(q, v)
        np.testing.assert_array_equal(planner._target, expected)
        np.testing.assert_array_equal(planner._escape, escape)


@pytest.mark.parametrize("path", ["circle", "straight"])
def test_a_fast_ball_that_leaves_has_no_second_try_and_one_that_comes_back_has(path):
    """Seen late: what comes back is met without a collision."""
    task = get_task("moving")
    options = {**task.options, "delay": 0.2, "speeds": (0.8,), "paths": (path,)}
    with gym.make(task.environment, **options) as env:
        planner = task.methods["interception"].make(env)
        touched, fast = 0, []
        for seed in range(6):
            (observation, info), over = env.reset(seed=seed), False
            planner.reset(observation, info)
            while not over:
                observation, _, terminated, truncated, info = env.step(planner.act(observation))
                over = terminated or truncated
                if planner._fit.moving:
                    fast.append(planner._fast)
            touched += info["reached"]
    assert len(fast) > 30
    if path == "circle":
        assert np.mean(fast) < 0.1
        assert touched >= 5
    else:
        assert np.mean(fast) > 0.9
