"""What is drawn: directions all around, numbers from one end of their range to the other, both signs."""

import math

import gymnasium as gym
import numpy as np
import pytest

import kinreach  # noqa: F401 (registers the environments)
from kinreach.envs import _obstacles as obstacles
from kinreach.envs import moving, real_arm
from kinreach.envs._lift.lift_task import APART, SHAPES, LiftOptions, LiftTask
from kinreach.envs._reach.space import SpaceOptions, SpaceTask

COUNT = 1500
LOW, HIGH = np.array([0.3, -0.3]), np.array([0.65, 0.3])


def all_around(angles):
    """Whether no direction, and no line, is drawn more often than others."""
    return all(
        abs(np.exp(1j * turns * np.asarray(angles)).mean()) < 4.5 / math.sqrt(len(angles)) for turns in (1, 2, 3)
    )


def even(values, low, high):
    """Whether numbers are spread evenly from one end to the other."""
    shares = (np.asarray(values) - low) / (high - low)
    ends = 8.0 / len(shares)
    return -1e-9 <= shares.min() < ends and 1 - ends < shares.max() <= 1 + 1e-9 and abs(shares.mean() - 0.5) < 0.04


def test_a_draw_that_is_not_even_is_found():
    rng = np.random.default_rng(0)
    assert all_around(rng.uniform(0.0, math.tau, COUNT))
    for low, high in ((0.0, 3.0 * math.pi), (0.0, math.pi), (-1.0, 1.0)):
        assert not all_around(rng.uniform(low, high, COUNT))
    assert even(rng.uniform(2.0, 3.0, COUNT), 2.0, 3.0)
    for low, high in ((2.0, 3.1), (1.9, 3.0), (2.1, 3.0), (2.0, 2.9)):
        assert not even(rng.uniform(low, high, COUNT), 2.0, 3.0)


def test_balls_enter_at_the_border_and_roll_through_the_middle():
    rng, headings, through = np.random.default_rng(1), [], []
    middle, size = (LOW + HIGH) / 2, HIGH - LOW
    for _ in range(600):
        start, heading = moving.entering(rng, LOW, HIGH)
        assert min(np.abs(start - LOW).min(), np.abs(start - HIGH).min()) < 1e-9
        assert (start > LOW - 1e-9).all()
        assert (start < HIGH + 1e-9).all()
        along = start + np.linspace(0.0, 1.0, 400)[:, None] * [math.cos(heading), math.sin(heading)]
        through.append((np.abs(along - middle) < size / 4 + 0.003).all(axis=1).any())
        headings.append(heading)
    assert all(through)
    assert all_around(headings)


def test_circles_are_anywhere_and_in_both_directions():
    rng, first, signs, centres = np.random.default_rng(2), [], [], []
    times = np.linspace(0.0, math.tau * moving.RADIUS / 0.3, 33)  # once around
    for _ in range(600):
        places = moving.circle(rng, 0.3, times, LOW, HIGH)
        centre = places[:-1].mean(axis=0)
        away = places - centre
        assert np.abs(np.linalg.norm(away, axis=1) - moving.RADIUS).max() < 1e-9
        np.testing.assert_allclose(places[-1], places[0], atol=1e-9)
        first.append(math.atan2(away[0, 1], away[0, 0]))
        signs.append(np.sign(away[0, 0] * away[1, 1] - away[0, 1] * away[1, 0]))
        centres.append(centre)
    assert all_around(first)
    assert abs(np.mean(signs)) < 0.15
    for axis in (0, 1):
        assert even(np.array(centres)[:, axis], LOW[axis] + moving.RADIUS, HIGH[axis] - moving.RADIUS)


def test_accelerations_of_a_random_walk_are_even_and_kept():
    """And outside of the middle half they lead towards the middle."""
    rng, drawn, outside = np.random.default_rng(3), [], 0
    middle, size, speed, dt = (LOW + HIGH) / 2, HIGH - LOW, 0.4, 1 / 120
    times = np.arange(121) * dt
    for _ in range(120):
        places = moving.random_walk(rng, speed, times, LOW, HIGH)
        steps = np.diff(places, axis=0)
        np.testing.assert_allclose(np.linalg.norm(steps, axis=1), speed * dt, atol=1e-12)
        headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
        sideways = speed * np.diff(headings) / dt
        for hold in range(4):
            inside = slice(30 * hold + 1, 30 * hold + 28)
            assert np.ptp(np.abs(sideways[inside])) < 1e-6
            drawn.append(abs(sideways[30 * hold + 10]))
        for place, heading, turn in zip(places[1:-1], headings[:-1], sideways, strict=True):
            if (np.abs(place - middle) > size / 4).any():
                inwards = math.atan2(*(middle - place)[::-1])
                outside += 1
                assert turn * math.sin(inwards - heading) >= -1e-9
    assert even(drawn, 0.0, moving.SIDEWAYS)
    assert outside > 1000


def test_errors_of_a_real_arm_are_in_any_direction():
    rng = np.random.default_rng(4)
    ways = np.array([real_arm._direction(rng) for _ in range(COUNT)])
    np.testing.assert_allclose(np.linalg.norm(ways, axis=1), 1.0, atol=1e-12)
    assert np.abs(ways.mean(axis=0)).max() < 0.07
    np.testing.assert_allclose(ways.T @ ways / COUNT, np.eye(3) / 3, atol=0.04)
    phases = [real_arm.workplace(real_arm.ENCODERS, "", rng).phases for _ in range(200)]
    assert all_around(np.concatenate(phases))
    turns = np.array([real_arm.workplace(real_arm.BASE, "", rng).base for _ in range(200)])
    assert set(np.abs(turns)) == {real_arm.BASE_TURN}
    assert abs(np.sign(turns).mean()) < 0.3
    tools = np.array([real_arm.workplace(real_arm.TOOL, "", rng).tool for _ in range(200)])
    np.testing.assert_allclose(np.linalg.norm(tools, axis=1), real_arm.TOOL_OFF, atol=1e-12)


def test_objects_to_lift_are_of_all_kinds_and_turned_all_around():
    given = {"sizes": (0.015, 0.035), "masses": (0.02, 0.3), "frictions": (1.5, 0.3)}
    task = LiftTask(LiftOptions(shapes=("ball", "cube"), clutter=True, **given))
    rows = task.sample(np.random.default_rng(5), COUNT)
    assert all_around(rows[:, 2])
    assert np.abs(rows[:, 2]).max() <= math.pi
    assert set(rows[:, 3]) == {SHAPES.index("ball"), SHAPES.index("cube")}
    assert abs((rows[:, 3] == SHAPES.index("cube")).mean() - 0.5) < 0.06
    for column, ends in enumerate(given.values(), start=4):
        assert even(rows[:, column], min(ends), max(ends))
    apart = np.linalg.norm(rows[:, 7:] - rows[:, :2], axis=1)
    assert apart.min() >= APART
    assert apart.min() < 1.2 * APART


def test_obstacles_are_of_all_sizes_all_over_the_table():
    episodes, rng = gym.make("kinreach/Obstacles-v0", heights=(0.1, 0.4)).unwrapped.episodes, np.random.default_rng(6)
    boxes, gaps = [], []
    for _ in range(80):
        scene, goal = episodes.scene(rng, 16)
        for box in scene:
            boxes.append([*box.size, *box.position])
            beside = np.abs(goal[:2] - box.position[:2]) - np.array(box.size[:2]) / 2
            gaps.append(np.linalg.norm(beside.clip(0.0)))
    wide, deep, height, x, y, z = np.array(boxes).T
    assert even(wide, *obstacles.EDGE)
    assert even(deep, *obstacles.EDGE)
    assert even(height, 0.1, 0.4)
    assert np.ptp(z - height / 2) < 1e-9  # they stand on the table
    for values, (low, high) in ((x, obstacles.X), (y, obstacles.Y)):
        assert low <= values.min() < low + 0.01
        assert high - 0.01 < values.max() <= high
    assert obstacles.FROM_BALL <= min(gaps) < obstacles.FROM_BALL + 0.01


@pytest.mark.parametrize("tilt", [0.0, 30.0, 90.0])
def test_directions_of_the_tool_are_even_on_the_cap_around_straight_down(tilt):
    aims = SpaceTask(SpaceOptions(tilt=tilt, goal_height=0.3))._aims(np.random.default_rng(7), COUNT, 0.0)
    x, y, z = aims[:, 3:].T
    np.testing.assert_allclose(x * x + y * y + z * z, 1.0, atol=1e-12)
    if not tilt:
        assert (z == -1.0).all()
        return
    assert all_around(np.arctan2(y, x))
    assert even(-z, math.cos(math.radians(tilt)), 1.0)
