"""Rolling balls: who looks ahead touches them, and who looks down touches nothing else."""

import math
from collections import Counter
from contextlib import closing

import gymnasium as gym
import numpy as np
import pytest

from kinreach.baselines import rollout
from kinreach.cli import EXIT_ERROR, main
from kinreach.compare import compare, get_task
from kinreach.compare._methods.interception import Interception
from kinreach.compare._methods.turn_rate import TurnRateFit
from kinreach.envs.moving import moved, travel_times
from kinreach.envs.real_arm import MEDIAN_LENGTH

METHODS = ["interception", "last-sight", "first-sight", "gradient-moving"]


@pytest.fixture(scope="module", params=[True, False])
def results(request):
    options = {"speeds": (0.05, 0.6), "collisions": request.param}
    entries = compare("moving", METHODS, goals=12, options=options)["methods"]
    return request.param, {entry["name"]: entry for entry in entries}


@pytest.mark.slow
def test_who_touches(results):
    collisions, found = results
    for speed in ("0.05", "0.6"):
        assert found["interception"]["touched"][speed] >= 0.8
        assert found["first-sight"]["touched"][speed] < 0.5
    assert found["last-sight"]["touched"]["0.6"] < 0.5
    assert found["last-sight"]["touched"]["0.05"] >= 0.9 - 0.9 * collisions
    assert found["gradient-moving"]["touched"]["0.05"] >= 0.9 - 0.9 * collisions
    assert found["interception"]["touched"]["0.2"] is None
    assert found["interception"]["impossible"] <= 0.2 * collisions
    assert (found["first-sight"]["impossible"] > 0.3) == collisions


@pytest.mark.parametrize("strength", [1.0, 0.9, 0.7])
def test_the_share_of_its_limits_that_the_arm_keeps_is_found(strength):
    """From the second frame on, whatever the methods were told."""
    task, found = get_task("moving"), []
    with closing(gym.make(task.environment, **{**task.options, "strength": strength, "collisions": False})) as env:
        method = task.methods["interception"].make(env)
        for seed in range(5):
            observation, info = env.reset(seed=seed)
            method.reset(observation, info)
            for _ in range(4):
                observation, *_ = env.step(method.act(observation))
            found.append(method._limits["speed"] / env.unwrapped.speed_limit)
    np.testing.assert_allclose(found, strength, rtol=0.0, atol=1e-9)
    assert len(found) == 5


@pytest.mark.parametrize("believed", [None, 9e-5])
def test_the_noise_is_found_unless_one_is_believed(believed):
    task, found = get_task("moving"), []
    with closing(gym.make(task.environment, **{**task.options, "noise": 0.01, "collisions": False})) as env:
        method = Interception(env, noise=believed)
        for seed in range(3):
            observation, info = env.reset(seed=seed, options={"speed": 0.1})
            method.reset(observation, info)
            for _ in range(20):
                method.act(observation)
                observation, *_ = env.step(env.unwrapped.home / math.pi)
            found.append(method._fit._noise)
    if believed is None:
        assert all(0.5 < one * MEDIAN_LENGTH / 0.01 < 2.0 for one in found)
    else:
        assert found == 3 * [believed]


def test_it_checks_no_collisions_where_they_do_not_count(monkeypatch):
    task = get_task("moving")
    with closing(gym.make(task.environment, **{**task.options, "collisions": False})) as env:
        method = task.methods["interception"].make(env)
        monkeypatch.setattr(method, "_checker", None)
        observation, info = env.reset(seed=0, options={"speed": 0.8, "path": "circle"})
        method.reset(observation, info)
        over = False
        while not over:
            observation, _, over, _, info = env.step(method.act(observation))
    assert info["is_success"]


def test_it_keeps_a_way_out_if_sights_are_noisy():
    """Of 60 such balls it collided with 21 before, and touched 37."""
    options, ends = {"noise": 0.01, "speeds": (0.4,)}, Counter()
    task = get_task("moving").with_options(options)
    with closing(gym.make(task.environment, **task.options | options)) as env:
        for trial in rollout(env, task.methods["interception"].make(env), task.resets(12, 2, env)):
            ends[trial["reached"], trial["impossible"]] += 1
    assert ends.total() == 12
    assert not ends[False, True]
    assert ends[True, False] >= 10


def test_going_along_ends_beside_the_ball_and_as_fast_as_it():
    """Within the arm's limits, on a line across the area."""
    task = get_task("moving")
    with closing(gym.make(task.environment, **task.options)) as env:
        env.reset(seed=0)
        world, method = env.unwrapped, Interception(env)
        method.reset(None, {"q": world.home})
        xy = np.array([0.45, -0.1]) + np.arange(1, 61)[:, None] / 30.0 * np.array([0.05, 0.2])
        way = method._along(world.home, np.zeros(6), xy)
        tip = method._kinematics.fk(way)[:, :3, 3]
        frames = np.arange(len(way)) / 8.0 + 1.0 / 8.0 - 1.0  # the first place is a frame ahead
        balls = np.array([np.interp(frames, np.arange(60), axis) for axis in xy.T]).T
        acceleration = np.diff(way, 2, axis=0) * (30.0 * 8.0) ** 2
    away = np.linalg.norm(tip[:, :2] - balls, axis=1)
    assert away[0] > 0.03
    assert away[-6 * 8 :].max() < 1e-3
    joined = len(way) - 6 * 8
    assert 3 * 8 <= joined <= 30 * 8
    assert np.abs(acceleration[: joined - 2]).max() <= world.acceleration_limit
    np.testing.assert_allclose(
        np.diff(tip[joined - 9 : joined + 8, :2], axis=0).mean(axis=0) * 240.0, [0.05, 0.2], atol=0.03
    )


def forecast_error(rate, noise, *, sights=12, ahead=0.4, known=True):
    """How far off the forecast is of a ball at 0.6 m/s that turns so fast [rad/s], in the mean of 20 [m]."""
    errors = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        heading = rng.uniform(0.0, 2.0 * math.pi)

        def place(t, heading=heading):
            s = np.linspace(0.0, t, 400)
            step = 0.6 * np.column_stack([np.cos(heading + rate * s), np.sin(heading + rate * s)])
            return np.trapezoid(step, s, axis=0)

        found = TurnRateFit(noise if known else None)
        times = np.arange(sights) / 30.0
        for t in times:
            found.see(float(t), place(t) + rng.normal(0.0, noise, 2))
            if not known:
                found.forecast(np.array([ahead]))
        errors.append(np.linalg.norm(found.forecast(np.array([ahead]))[0] - place(times[-1] + ahead)))
    return float(np.mean(errors))


@pytest.mark.parametrize("rate", [0.0, 1.0, -5.0])
def test_the_fit_follows_constant_turns(rate):
    assert forecast_error(rate, 0.0) < 1e-3
    assert forecast_error(rate, 9e-5) < 6e-3


@pytest.mark.parametrize(("rate", "straight"), [(0.0, 20), (-5.0, 0)])
def test_a_ball_rolls_straight_on_unless_its_sights_are_of_a_turn(rate, straight):
    """With some 3 mm of noise, from 20 sights; a few straight balls look like turning ones."""
    found = []
    for seed in range(20):
        rng, fit = np.random.default_rng(seed), TurnRateFit(2e-3)
        for t in np.arange(20) / 30.0:
            heading = rate * t
            place = (
                0.4 * t * np.array([np.sinc(heading / math.pi), math.sin(heading / 2) * np.sinc(heading / math.tau)])
            )
            fit.see(float(t), place + rng.normal(0.0, 2e-3, 2))
        found.append(fit._fit()[2])
    assert abs(sum(one == 0.0 for one in found) - straight) <= 3
    np.testing.assert_allclose(np.median(found), rate, atol=0.3)


@pytest.mark.parametrize("noise", [9e-5, 2e-3])
def test_a_fit_that_finds_the_noise_is_nearly_as_good_as_one_that_knows_it(noise):
    known, found = (forecast_error(-5.0, noise, sights=12, ahead=0.3, known=known) for known in (True, False))
    assert found < 1.5 * known


def test_the_noise_is_found_and_rather_too_large():
    """Of a ball that rolls straight on; never less than the cameras' own."""
    for seed, noise in enumerate((0.0, 2e-3, 6.5e-3)):
        rng, fit = np.random.default_rng(seed), TurnRateFit(None)
        for frame in range(40):
            fit.see(frame / 30.0, np.array([0.02 * frame, 0.1]) + rng.normal(0.0, noise, 2))
            fit.forecast(np.array([0.1]))
        assert max(0.9 * noise, 1e-4) <= fit._noise < max(1.8 * noise, 1.1e-4)


def test_a_single_sight_stays_where_it_is():
    fit = TurnRateFit(1e-4)
    fit.see(0.0, np.array([0.4, 0.1, 0.0]))
    assert not fit.moving
    np.testing.assert_allclose(fit.forecast(np.array([0.0, 1.0])), [[0.4, 0.1]] * 2)


def test_travel_times_are_those_of_the_arm():
    """As the environment moves joints, at a thousandth of a second: no earlier, and hardly later."""
    rng, checked = np.random.default_rng(1), 0
    for _ in range(30):
        q, v, target = rng.uniform(-1, 1, 6), rng.uniform(-3, 3, 6), rng.uniform(-1.5, 1.5, 6)
        said = travel_times(q, v, target[None], speed=3.0, acceleration=10.0)[0]
        there, now, dt = np.full(6, np.nan), 0.0, 1e-3
        while np.isnan(there).any() and now < 5.0:
            q, v = moved(q, v, target, dt, speed=3.0, acceleration=10.0)
            now += dt
            there = np.where(np.isnan(there) & (np.abs(q - target) < 1e-4) & (np.abs(v) < 0.05), now, there)
        np.testing.assert_allclose(there, said, atol=0.03)
        checked += 6
    assert checked == 180


def test_on_disk(tmp_path, capsys):
    arguments = ["--task", "moving", "--goals", "3", "--speeds", "0.1,0.3", "--methods", "first-sight,last-sight"]
    assert main(["compare", *arguments, "--out", str(tmp_path)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "rolling ball" in said
    assert "No goal is left for balls at 0.3 m/s: give at least 6." in said
    files = said.split(f"In {tmp_path}: ")[1].split(" No picture")[0].split(", ")
    assert sorted(files) == sorted(path.name for path in tmp_path.iterdir())
    assert (tmp_path / "speeds.png").stat().st_size > 10_000


@pytest.mark.parametrize(("arguments", "said"), [
    (["--speeds", "5"], "the arm's tip is no faster"),
    (["--speeds", "fast"], "--speeds must be numbers with commas between them, such as 0.05,0.1, got 'fast'"),
])  # fmt: skip
def test_bad_input(arguments, said, tmp_path, capsys):
    assert main(["compare", "--task", "moving", *arguments, "--out", str(tmp_path)]) == EXIT_ERROR
    assert said in capsys.readouterr().err


def test_the_fit_is_what_it_was_on_a_path_that_turns_left_and_right():
    rng, fit, place, heading = np.random.default_rng(0), TurnRateFit(9e-5), np.array([0.4, 0.1]), 0.3
    found = []
    for frame in range(60):
        heading += 0.1 * math.sin(0.2 * frame)
        place = place + 0.02 * np.array([math.cos(heading), math.sin(heading)])
        fit.see(frame / 30.0, place + rng.normal(0.0, 9e-5, 2))
        if frame % 12 == 11:
            found.append(fit.forecast(np.array([0.2]))[0] - place)
    kept = (
        (0.0121245, 0.1179133),
        (0.1044415, 0.0567576),
        (0.0933483, 0.0742443),
        (0.0231086, 0.1175416),
        (0.1185695, 0.0123383),
    )
    np.testing.assert_allclose(found, kept, atol=1e-6)
