"""Where a rolling ball will be, by the turn rate that fits its sights, and the way along it."""

import math
from contextlib import closing

import gymnasium as gym
import numpy as np
import pytest

from kinreach.compare import get_task
from kinreach.compare._methods.interception import Interception
from kinreach.compare._methods.turn_rate import TurnRateFit
from kinreach.envs.real_arm import MEDIAN_LENGTH


@pytest.mark.parametrize("believed", [None, 9e-5])
@pytest.mark.slow
def test_the_noise_is_found_unless_one_is_believed(believed):
    task, found = get_task("moving"), []
    with closing(gym.make(task.environment, **{**task.options, "noise": 0.01, "collisions": False})) as env:
        method = Interception(env, noise=believed)
        for seed in range(2):
            observation, info = env.reset(seed=seed, options={"speed": 0.1})
            method.reset(observation, info)
            for _ in range(20):
                method.act(observation)
                observation, *_ = env.step(env.unwrapped.home / math.pi)
            found.append(method._fit._noise)
    if believed is None:
        assert all(0.5 < one * MEDIAN_LENGTH / 0.01 < 2.0 for one in found)
    else:
        assert found == 2 * [believed]


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
        found.append(fit.local()[2])
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


@pytest.mark.parametrize("share", [0.5, 1.0, 1.5])
def test_a_delay_that_is_not_the_believed_one_is_found(share):
    """By a ball that rests until the first sight is observed, and then rolls straight on."""
    fit = TurnRateFit(9e-5)
    for t in np.arange(10) / 30.0:
        fit.see(float(t), np.array([0.4 + 0.5 * max(t - 0.1 * share, 0.0), 0.1]), 0.1)
    assert fit.age == pytest.approx(0.1 * share, abs=0.006)
    ahead = fit.forecast(np.array([0.1 * share + 0.2]))[0]
    np.testing.assert_allclose(ahead, [0.4 + 0.5 * (9 / 30 + 0.2), 0.1], atol=2e-3)


@pytest.mark.parametrize("after", [0, 5])
def test_a_sight_that_is_reported_again_has_only_become_older(after):
    """As for a ball that is hidden, at once or later."""
    rng = np.random.default_rng(4)
    places = np.array([0.4, 0.1]) + np.outer(np.arange(20) / 30.0, [0.3, 0.2]) + rng.normal(0.0, 1e-4, (20, 2))
    kept, repeated = TurnRateFit(1e-4), TurnRateFit(1e-4)
    for frame in range(20):
        hidden = after < frame < after + 6
        if not hidden:
            kept.see(frame / 30.0, places[frame], 0.0 if frame == 0 else 0.02)
        shown = after if hidden else frame
        repeated.see(frame / 30.0, places[shown], (frame - shown) / 30.0 + (0.0 if shown == 0 else 0.02))
        assert repeated.age == pytest.approx((frame - shown) / 30.0 + (0.0 if shown == 0 else 0.02))
        assert repeated.seen == kept.seen
    np.testing.assert_array_equal(repeated.forecast(np.array([0.1, 0.3])), kept.forecast(np.array([0.1, 0.3])))


def test_a_single_sight_stays_where_it_is():
    fit = TurnRateFit(1e-4)
    fit.see(0.0, np.array([0.4, 0.1, 0.0]))
    assert not fit.moving
    np.testing.assert_allclose(fit.forecast(np.array([0.0, 1.0])), [[0.4, 0.1]] * 2)


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


@pytest.mark.parametrize(("noise", "used"), [(None, 1e-4), (0.0, 1e-6), (9e-7, 1e-6), (2e-6, 2e-6), (9e-5, 9e-5)])
def test_the_noise_that_is_used_has_a_least_one(noise, used):
    assert TurnRateFit(noise).noise == used


def test_sights_of_two_times_have_a_speed():
    """A thousandth of a second lies between them, or more."""
    for second, moves in ((0.0, False), (1e-3, False), (1.1e-3, True)):
        fit = TurnRateFit(1e-4)
        fit.see(0.0, np.array([0.4, 0.1]))
        fit.see(second, np.array([0.5, 0.1]))
        assert fit.moving == moves
        assert (fit.seen, fit.last_time, fit.age) == (2, second, 0.0)


@pytest.mark.parametrize(("window", "used"), [(1, 3), (2, 3), (3, 3), (4, 4), (9, 9), (12, 12), (40, 12)])
def test_how_well_an_acceleration_is_known(window, used):
    """The variance of a parabola's second derivative that is fitted to n places, equally far apart in time."""
    fit, dt, n = TurnRateFit(2e-3), 1 / 30, used
    for frame in range(12):
        fit.see(frame * dt, np.array([0.02 * frame, 0.1]))
    variance = 720 * 2e-3**2 / (dt**4 * n * (n**2 - 1) * (n**2 - 4))
    assert fit.acceleration_error(window) == pytest.approx(math.sqrt(variance), rel=1e-6)
