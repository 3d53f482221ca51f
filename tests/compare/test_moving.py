"""Rolling balls: who looks ahead touches them."""

import numpy as np
import pytest

from kinreach.compare import compare
from kinreach.compare._cli import main
from kinreach.compare._methods.interception import KalmanFilter
from kinreach.envs._moving import moved, travel_times
from kinreach.errors import InputError

METHODS = ["interception", "last-sight", "first-sight", "policy"]


@pytest.fixture(scope="module")
def results():
    options = {"speeds": (0.05, 0.2)}
    return {entry["name"]: entry for entry in compare("moving", METHODS, goals=12, options=options)["methods"]}


def test_who_touches(results):
    assert results["interception"]["touched"]["0.2"] >= 0.9
    assert results["last-sight"]["touched"]["0.05"] == 1.0
    assert results["last-sight"]["touched"]["0.2"] < 0.5
    assert results["first-sight"]["touched"]["0.2"] < 0.5
    assert results["policy"]["touched"]["0.05"] >= 0.9
    assert results["policy"]["touched"]["0.2"] >= 0.75
    assert results["interception"]["touched"]["0.6"] is None
    assert results["interception"]["straight"]["0.2"] >= 0.75


def test_the_filter_finds_what_moves_as_it_thinks():
    """Constant acceleration, exact sights: the forecast is exact; with noise as good as it can be."""
    times = np.arange(30) / 30
    motion = np.array([[0.3, 0.1, 0.0], [0.2, -0.1, 0.0], [0.5, 0.4, 0.0]])

    def place(t):
        return motion[0] + motion[1] * t + motion[2] * t**2 / 2

    exact, rng = KalmanFilter(0.0), np.random.default_rng(0)
    noisy = [KalmanFilter(1e-4) for _ in range(20)]
    for t in times:
        exact.see(t, place(t))
        for one in noisy:
            one.see(t, place(t) + rng.normal(0, 1e-4, 3))
    np.testing.assert_allclose(exact.forecast(np.array([0.2]))[0], place(times[-1] + 0.2), atol=1e-4)
    true = [place(times[-1]), place(times[-1] + 0.1)]
    errors = [np.linalg.norm(one.forecast(np.array([0.0, 0.1])) - true) for one in noisy]
    assert np.median(errors) < 2e-3


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
    arguments = ["--task", "moving", "--goals", "3", "--speeds", "0.1", "--methods", "first-sight,last-sight"]
    assert main([*arguments, "--out", str(tmp_path)], prog="compare") == 0
    assert "rolling ball" in capsys.readouterr().out
    assert (tmp_path / "speeds.png").stat().st_size > 10_000


@pytest.mark.parametrize(("arguments", "said"), [
    (["--speeds", "5"], "the arm's tip is no faster"),
    (["--speeds", "fast"], "--speeds must be numbers with commas between them, such as 0.05,0.1, got 'fast'"),
])  # fmt: skip
def test_bad_input(arguments, said, tmp_path):
    with pytest.raises(InputError, match=said):
        main(["--task", "moving", *arguments, "--out", str(tmp_path)], prog="compare")
