"""A world without an arm: a point on a line that has to come near a goal, registered as anybody would from outside."""

import gymnasium as gym
import numpy as np
import pytest

from kinreach.compare import Method, Task, common_columns

TOY = "tests/Toy-v0"


class ToyEnv(gym.Env):
    """One action moves the point; it is reached within 10 mm, and an action beyond ±1 m is impossible."""

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012 (declared by Gymnasium)
    action_space = gym.spaces.Box(-2.0, 2.0, (1,), np.float64)
    observation_space = gym.spaces.Box(-2.0, 2.0, (1,), np.float64)

    def __init__(self, render_mode=None, offset=0.0):
        self.render_mode, self.offset = render_mode, offset

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        goal = self.np_random.uniform(-1, 1) if options is None else options["goal"][0]
        self.goal = np.array([goal, 0.0, 0.0])
        return self.goal[:1].copy(), {"goal": self.goal.copy(), "is_success": False}

    def step(self, action):
        x = float(action[0]) + self.offset
        distance = abs(x - self.goal[0])
        impossible = abs(x) > 1
        reached = distance < 0.01 and not impossible
        info = {
            "goal": self.goal.copy(), "q": np.array([x]), "distance": distance, "reached": reached,
            "is_success": reached, "impossible": impossible, "status": "beyond" if impossible else "completed",
            "impossible_reason": "beyond ±1 m" if impossible else "", "move_s": abs(x),
        }  # fmt: skip
        return self.goal[:1].copy(), -distance, True, False, info

    def render(self):
        return np.zeros((9, 16, 3), dtype=np.uint8)


if TOY not in gym.registry:
    gym.register(TOY, entry_point=ToyEnv)


@pytest.fixture
def without_pictures(monkeypatch):
    """A comparison without figures and renderings, which take seconds."""
    monkeypatch.setattr("kinreach.compare._figures.write_figures", lambda *arguments: {})
    monkeypatch.setattr("kinreach.compare._report.render_trials", lambda *arguments: [])


def resets(count, seed, env):
    return [{"seed": int(np.random.default_rng([seed % 2**32, index]).integers(2**31))} for index in range(count)]


def toy_task():
    """A task with a method that is right, one that is 5 mm off, and one that asks for the impossible."""
    return Task(
        name="toy",
        title="A point on a line",
        environment=TOY,
        resets=resets,
        methods={
            "right": Method(lambda env: lambda observation: observation),
            "near": Method(lambda env: lambda observation: observation + 0.005),
            "wild": Method(lambda env: lambda observation: np.array([1.5])),
        },
        columns=common_columns(lambda trial: not trial["impossible"]),
        reached="d < 10 mm",
    )


@pytest.fixture
def toy():
    return toy_task()
