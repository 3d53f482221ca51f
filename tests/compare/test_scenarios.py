"""Planning for many futures of a rolling ball: draws agree with the sights, and motions with what the arm can do."""

import math
from contextlib import closing

import gymnasium as gym
import numpy as np
import pytest

from kinreach.baselines import load_policy, rollout
from kinreach.compare import get_task
from kinreach.compare._methods.futures import SPEEDS, Futures
from kinreach.compare._methods.interception import Interception
from kinreach.compare._methods.scenarios import Scenarios
from kinreach.compare._methods.turn_rate import TurnRateFit
from kinreach.envs.inside import moving
from kinreach.errors import InputError

LOW, HIGH = np.array([0.3, -0.3]), np.array([0.65, 0.3])
AHEAD = np.array([0.1, 0.2, 0.3])


def seen(kind, seed, frames, speed=0.5):
    """Return the fit after some frames, its draws, and where the ball is at these times."""
    rng = np.random.default_rng(seed)
    times = np.arange(0, 3 * 240 + 1) / 240
    places = moving.PATHS[kind](rng, speed, times, LOW + 0.02, HIGH - 0.02)
    fit = TurnRateFit(None)
    for frame in range(frames + 1):
        taken = max(8 * frame - 12, 0)
        fit.see(frame / 30, places[taken] + rng.normal(0.0, 9e-5, 2), frame / 30 - taken / 240)
    truth = np.array([np.interp(times[taken] + AHEAD, times, axis) for axis in places.T]).T
    return fit, Futures(LOW, HIGH, seed).draw(fit, 60, AHEAD), truth


@pytest.mark.parametrize("kind", moving.PATHS)
@pytest.mark.slow
def test_the_true_future_is_among_the_draws(kind):
    """Half of the draws are as near as the kind allows; a random walk's next acceleration is not known."""
    near = {"straight": 0.01, "circle": 0.02, "random": 0.06}[kind]
    found = []
    for seed in range(12):
        _, drawn, truth = seen(kind, seed, 12)
        away = np.linalg.norm(drawn[:, -1] - truth[-1], axis=1)
        assert away.min() < near
        found.append(np.median(away))
    assert np.median(found) < near
    assert len(found) == 12


def test_more_sights_narrow_the_draws():
    spreads = [
        np.median([np.linalg.norm(seen("straight", seed, frames)[1][:, -1].std(axis=0)) for seed in range(8)])
        for frames in (0, 4, 14)
    ]
    assert spreads[0] > 20 * max(spreads[1:])
    assert max(spreads[1:]) < 0.01


def test_a_ball_that_has_not_moved_may_go_anywhere_in_the_area():
    checked = 0
    for seed in range(12):
        fit, _, _ = seen("straight", seed, 0)
        draws = Futures(LOW, HIGH, seed).draw(fit, 100, np.array([0.01, 0.1]))
        speeds = np.linalg.norm(draws[:, 1] - draws[:, 0], axis=1) / 0.09
        assert (speeds > 0.9 * SPEEDS[0]).all()
        assert (speeds < SPEEDS[1] + 1e-6).all()
        inwards = ((LOW + HIGH) / 2 - draws[:, 0]) * (draws[:, 1] - draws[:, 0])
        assert (inwards.sum(axis=1) > 0).mean() > 0.7
        checked += len(draws)
    assert checked == 1200


@pytest.fixture(scope="module")
def env():
    task = get_task("moving")
    with closing(gym.make(task.environment, **{**task.options, "collisions": False, "delay": 0.2})) as made:
        yield made


def test_slack_is_of_what_joints_can_reach(env):
    """Beyond the ends of the slack no joint comes in that time; up to them it does."""
    planner, rng = Scenarios(env), np.random.default_rng(0)
    planner.reset(*env.reset(seed=0))
    q, v = rng.uniform(-1.0, 1.0, (5, 6)), rng.uniform(-3.0, 3.0, (5, 6))
    for frames in (1, 5, 20):
        ends = []
        for far in (-100.0, 100.0):
            end, speed = q, v
            for _ in range(8 * frames):
                end, speed = moving.moved(end, speed, np.full(6, far), 1 / 240, speed=math.pi, acceleration=10.0)
            ends.append(end)
        goals = (ends[0] + ends[1]) / 2
        slack = planner._slack(q, v, goals[:, None], np.array([frames / 30]))[:, :, 0]
        half = (ends[1] - ends[0]).min(axis=1) / 2
        np.testing.assert_allclose(np.diag(slack), half, atol=0.03)


@pytest.mark.parametrize("planned_by", [Interception, Scenarios])
def test_a_policy_acts_first_then_the_planner_that_has_seen_all(env, planned_by):
    policy = load_policy("gradient-moving-clear")
    hybrid, planner = planned_by(env, first=policy, frames=6), Interception(env)
    observation, info = env.reset(seed=3, options={"speed": 0.3, "path": "circle"})
    hybrid.reset(observation, info)
    planner.reset(observation, info)
    for frame in range(9):
        action, planned = hybrid.act(observation), planner.act(observation)
        same = np.allclose(action, policy.act(observation), rtol=0.0, atol=1e-12)
        assert same == (frame < 6)
        if frame >= 6:
            assert hybrid._fit.seen == planner._fit.seen == frame + 1
            np.testing.assert_allclose(hybrid._fit.forecast(AHEAD), planner._fit.forecast(AHEAD))
        planner._sent[-1] = hybrid._sent[-1]
        assert planned.shape == (6,)
        observation, *_ = env.step(action)


def test_who_cannot_wait_goes_on_where_that_is_free_and_stops_else(monkeypatch):
    """Where no posture is above the ball."""
    monkeypatch.setattr(Interception, "_above", lambda self, xy: np.full(6, np.nan))
    rng, free = np.random.default_rng(4), 0
    with closing(gym.make("kinreach/Moving-v0")) as env:
        planner = Interception(env)
        planner.reset(*env.reset(seed=0))
        for q, v in zip(
            env.unwrapped.home + rng.uniform(-0.4, 0.4, (40, 6)), rng.uniform(-3.0, 3.0, (40, 6)), strict=True
        ):
            planner._target = target = q + v
            stop = q + v * np.abs(v) / 20.0
            free += (goes := planner._is_free(q, v, target))
            planner._wait(q, v, np.zeros(2))
            np.testing.assert_allclose(planner._target, target if goes else stop)
    assert 5 < free < 35


def test_a_slow_planner_follows_its_way_between_decisions():
    """Each joint is where the way has it five frames after the decision, on which it goes on without another one."""
    task, off = get_task("moving"), []
    with closing(gym.make(task.environment, **{**task.options, "collisions": False})) as env:
        for seed in range(3, 9):
            planner = Interception(env, every=6)
            observation, info = env.reset(seed=seed, options={"speed": 0.3})
            planner.reset(observation, info)
            way = None
            for frame in range(12):
                target = planner.act(observation)
                if frame % 6 == 0:
                    way = planner._followed
                observation, *_ = env.step(target)
            if way is not None and len(way) >= 6 * moving.PARTS:
                off.append(np.abs(observation[moving.ANGLES] - way[6 * moving.PARTS - 1]).max())
        with pytest.raises(InputError, match="every must be at least 1"):
            Interception(env, every=0)
    assert len(off) > 3
    assert max(off) < 0.05


@pytest.mark.slow
def test_with_late_sights_it_touches_no_fewer():
    task, options = get_task("moving"), {"collisions": False, "delay": 0.2, "speeds": (0.8,)}
    touched = {}
    with closing(gym.make(task.environment, **{**task.options, **options})) as env:
        for name in ("interception", "scenarios"):
            trials = list(rollout(env, task.methods[name].make(env), task.resets(9, 3, env)))
            touched[name] = sum(trial["reached"] for trial in trials)
    assert touched["scenarios"] >= touched["interception"] >= 2
