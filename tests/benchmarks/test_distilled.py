"""A planner that answers rows of observations, for a network to imitate."""

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
from benchmarks.learners.distilled import ScenariosExpert, _Planner
from kinreach.envs import moving
from tests.baselines.test_steering import after_a_frame

OPTIONS = {"sights": 20, "delay": 0.2, "collisions": False, "speeds": (1.2,)}
LIMITS = {"speed": np.pi, "acceleration": 10.0}


@pytest.mark.slow
def test_its_answers_move_the_arm_as_a_planner_of_each_environment_does():
    """Also after an environment has begun anew, and where somebody else moved the arm."""
    single = gym.make("kinreach/Moving-v0", **OPTIONS)
    batch = gym.make_vec("kinreach/Moving-v0", num_envs=3, vectorization_mode="vector_entry_point", **OPTIONS)
    assert (single.unwrapped.speed_limit, single.unwrapped.acceleration_limit) == tuple(LIMITS.values())
    expert, planners = ScenariosExpert(single), [_Planner(single) for _ in range(3)]
    rng, compared, begun = np.random.default_rng(0), 0, 0
    seen, _ = batch.reset(seed=1)
    for frame in range(30):
        answers = expert.act(seen)
        q, v = seen[:, moving.ANGLES].astype(float), seen[:, moving.RATES].astype(float)
        down, up = moving.motion_range(q, v, **LIMITS)
        assert ((np.pi * answers >= down - 1e-9) & (np.pi * answers <= up + 1e-9)).all()
        for planner, row, answer in zip(planners, seen, answers, strict=True):
            if not row[moving.RATES.stop :].any():
                planner.reset(row, {"q": row[moving.ANGLES]})
                begun += 1
            own = planner.act(row.astype(float))
            (far, fast), (its, speed) = (
                after_a_frame(row[moving.ANGLES], row[moving.RATES], np.pi * action, LIMITS) for action in (own, answer)
            )
            np.testing.assert_allclose(its, far, atol=3e-3)
            np.testing.assert_allclose(speed, fast, atol=0.2)
            compared += 1
        seen, *_ = batch.step(answers if frame % 3 else rng.uniform(-1.0, 1.0, answers.shape))
    assert compared == 90
    assert begun > 3
    single.close()
    batch.close()
