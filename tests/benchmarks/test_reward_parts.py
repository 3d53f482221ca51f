"""Parts of the thesis's reward left out: all of them together are the thesis's own."""

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from benchmarks.studies import reward_parts
from benchmarks.studies.reward_parts import PARTS
from kinreach.baselines._rewards import FLOOR, training_reward
from kinreach.thesis import distance_reward, reach_reward
from kinreach.thesis._posture import posture_errors

CASES = 4000


@pytest.fixture
def steps():
    """Steps of every kind: beside goals, reaching them, impossible, unnatural."""
    rng = np.random.default_rng(0)
    q = rng.uniform(-np.pi, np.pi, (CASES, 6))
    half = CASES // 2
    q[:half, 0], q[:half, 2] = -np.abs(q[:half, 0]), np.abs(q[:half, 2])
    q[:half, 4] = -np.pi / 2 + rng.normal(0, 0.05, half)
    q[:half, 3] = -(q[:half, 1] + q[:half, 2] + np.pi / 2) + rng.normal(0, 0.05, half)
    return {"q": q, "distance": 10 ** rng.uniform(-3, 0.6, CASES), "impossible": rng.random(CASES) < 0.1}


def test_the_whole_reward_is_the_thesis_s(steps):
    found = reach_reward(steps["distance"], steps["q"], impossible=steps["impossible"])
    np.testing.assert_allclose(PARTS["all"](np.zeros(CASES), steps), found.reward, atol=1e-12)
    kinds = [found.reached.sum(), steps["impossible"].sum(), (found.reward > 9).sum(), (found.reward < -24).sum()]
    assert min(kinds) > 100


def test_what_is_left_out_costs_nothing(steps):
    natural, angle = posture_errors(steps["q"])
    away = (steps["distance"] >= 0.01) & ~steps["impossible"]
    own = distance_reward(steps["distance"][away])
    left = {"distance": 0 * natural, "natural arm": natural, "gripper angle": angle, "all": natural + angle}
    assert away.sum() > 2000
    for name, cost in left.items():
        paid = PARTS[name](np.zeros(CASES), steps)
        np.testing.assert_allclose(paid[away], own - cost[away], atol=1e-12)
        assert (paid[steps["impossible"]] == -100).all()
    beside = (steps["distance"] < 0.01) & ~steps["impossible"]
    assert beside.sum() > 500
    assert (PARTS["distance"](np.zeros(CASES), steps)[beside] == 20).all()


@pytest.mark.parametrize("name", ["distance", "natural_arm", "gripper_angle", "everything"])
def test_recipes_find_them_by_name(name, steps):
    plain, floored = (
        training_reward(f"{reward_parts.__name__}:{name}{ending}")(np.zeros(CASES), steps)
        for ending in ("", "_floored")
    )
    np.testing.assert_array_equal(floored, np.maximum(plain, FLOOR))
