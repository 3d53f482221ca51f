"""The stronger rival on moving balls: its forecast follows turns, and it touches what the package's misses."""

import math

import numpy as np
import pytest

pytest.importorskip("torch")
from benchmarks.studies.interceptor import METHODS, TurnRateFit, main
from kinreach.compare._methods.interception import KalmanFilter


def forecast_error(method, rate, noise, *, sights=12, ahead=0.4):
    """How far off the forecast is of a ball at 0.6 m/s that turns so fast [rad/s], in the mean of 20 [m]."""
    errors = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        heading = rng.uniform(0.0, 2.0 * math.pi)

        def place(t, heading=heading):
            s = np.linspace(0.0, t, 400)
            step = 0.6 * np.column_stack([np.cos(heading + rate * s), np.sin(heading + rate * s), 0.0 * s])
            return np.trapezoid(step, s, axis=0)

        found = method(noise)
        times = np.arange(sights) / 30.0
        for t in times:
            found.see(float(t), place(t) + rng.normal(0.0, noise, 3))
        errors.append(np.linalg.norm((found.forecast(np.array([ahead]))[0] - place(times[-1] + ahead))[:2]))
    return float(np.mean(errors))


@pytest.mark.parametrize("rate", [0.0, 1.0, -5.0])
def test_the_fit_follows_constant_turns(rate):
    noisy = forecast_error(TurnRateFit, rate, 9e-5)
    assert noisy < 6e-3
    if rate == -5.0:
        assert forecast_error(KalmanFilter, rate, 9e-5) > 3 * noisy


def test_a_single_sight_stays_where_it_is():
    fit = TurnRateFit(1e-4)
    fit.see(0.0, np.array([0.4, 0.1, 0.0]))
    np.testing.assert_allclose(fit.forecast(np.array([0.0, 1.0])), [[0.4, 0.1, 0.0]] * 2)


def test_the_table(capsys):
    assert main(["--speeds", "0.6", "--balls", "9", "--seed", "3"]) == 0
    rows = [line.strip("| ").split(" | ") for line in capsys.readouterr().out.splitlines()[2:]]
    assert [row[0] for row in rows] == list(METHODS)
    touched, free = (
        {name: float(row[column].split()[0]) for name, row in zip(METHODS, rows, strict=True)} for column in (1, 2)
    )
    assert all(free[name] <= touched[name] for name in METHODS)
    assert touched["interceptor"] >= 75.0
    assert touched["interceptor"] >= touched["interception, forecast by turn rate"] >= touched["interception"]
