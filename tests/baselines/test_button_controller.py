"""The controller that presses the button by a model: on both actuations, alone and for many at once."""

import gymnasium as gym
import mujoco
import numpy as np
import pytest

import kinreach
from benchmarks.studies.button_actuation import analytic
from kinreach.baselines import AnalyticButtonPolicy
from kinreach.baselines._button_controller import ButtonController
from kinreach.envs.inside import ACTUATIONS, torque_model
from kinreach.errors import InputError, UnknownNameError
from kinreach.kinematics import Arm3Kinematics
from kinreach.robots import get_arm
from tests.cases import slow

NAME = "kinreach/ButtonPress-v0"
KIN = Arm3Kinematics(base="world")
HELD_OUT = 1_000_000  # seed
#: Steps within which the button has to be pressed: a quarter more than the worst of 1000 targets took.
LONGEST = {"tuned": 72, "report": 730}


def make(**options):
    assert kinreach.__version__
    return gym.make(NAME, **options)


@pytest.mark.parametrize(
    ("actuation", "count", "median"),
    [
        ("tuned", 100, 25),
        ("report", 40, 184.5),
        *slow(("tuned", 1000, 25), ("report", 1000, 184.5)),
    ],
)
def test_held_out_targets_are_pressed(actuation, count, median):
    result = analytic(ACTUATIONS[actuation], count, HELD_OUT)
    assert result["pressed"] >= 0.99
    assert np.median(result["steps"]) == pytest.approx(median, rel=0.15)
    assert result["wrong"] <= 0.01 * count


@pytest.mark.parametrize("actuation", list(ACTUATIONS))
def test_one_at_a_time_it_does_what_it_does_for_many(actuation):
    count = 4
    env = make(actuation=actuation, max_episode_steps=LONGEST[actuation])
    policy = AnalyticButtonPolicy(actuation)
    together = analytic(ACTUATIONS[actuation], count, 5)
    assert together["pressed"] == 1
    for index in range(count):
        observation, info = env.reset(seed=5 + index)
        policy.reset(observation, info)
        taken = 0
        over = False
        while not over:
            action = policy.act(observation)
            assert isinstance(action, int)
            observation, _, over, truncated, _ = env.step(action)
            taken += 1
            assert not truncated
        assert taken == together["steps"][index]


def test_it_reads_the_controls_where_they_are_observed():
    """Where somebody else acted before, it knows what the arm's controls are; alone it does the same as ever."""
    plain, observing = ButtonController(count=1), ButtonController(count=1)
    env, seen_env = make(), make(controls=True)
    seen, more = env.reset(seed=4)[0], seen_env.reset(seed=4)[0]
    for _ in range(20):
        action = plain.actions(seen[None])
        assert observing.actions(more[None]) == action
        seen, more = env.step(int(action[0]))[0], seen_env.step(int(action[0]))[0]
    more = seen_env.step(0)[0]  # an action of another's: all controls down by one
    observing.actions(more[None])
    assert np.abs(observing._control[0] - more[19:]).max() <= 1.0
    assert np.abs(more[19:] - plain._control[0]).max() > 0.0


def test_episodes_after_the_first_start_with_a_clean_slate():
    env = make()
    policy = AnalyticButtonPolicy()
    pressed = 0
    for episode in range(12):
        observation, info = env.reset(seed=3 if episode == 0 else None)
        policy.reset(observation, info)
        for _ in range(LONGEST["tuned"]):
            observation, _, over, _, _ = env.step(policy.act(observation))
            if over:
                pressed += 1
                break
    assert pressed == 12


def test_it_starts_from_any_posture():
    """Also with the first joint near the end of its range, where the observed angle jumps."""
    rng = np.random.default_rng(8)
    env = make(max_episode_steps=150)
    policy = AnalyticButtonPolicy()
    pressed = 0
    for episode in range(40):
        q = [np.pi - 0.02 if episode % 2 else 0.02 - np.pi, *rng.uniform(-0.8, 0.8, 2)]
        observation, info = env.reset(seed=episode, options={"q": q})
        policy.reset(observation, info)
        over = truncated = False
        while not (over or truncated):
            observation, _, over, truncated, _ = env.step(policy.act(observation))
        pressed += over
    assert pressed >= 38


def test_malformed_input_is_refused():
    for actuation in ("magic", ["tuned"], None):
        with pytest.raises(UnknownNameError, match="report, tuned"):
            ButtonController(actuation)
    with pytest.raises(InputError, match="needs 2 observations, got 3"):
        ButtonController(count=2).actions(np.zeros((3, 19)))


@pytest.mark.parametrize("actuation", ACTUATIONS)
def test_where_the_tip_is_a_step_later(actuation):
    """As MuJoCo has it: the controller presses where the tip will be."""
    controller, model = ButtonController(actuation), torque_model(get_arm("arm3"), ACTUATIONS[actuation], visual=False)
    data, rng, moved = mujoco.MjData(model), np.random.default_rng(0), 0.0
    for _ in range(50):
        data.qpos[:], data.qvel[:], data.ctrl[:] = rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3)
        q = data.qpos.copy()
        expected = controller._next_tip(q, data.qvel.copy(), ACTUATIONS[actuation].gears * data.ctrl)
        mujoco.mj_step(model, data, ACTUATIONS[actuation].frame_skip)
        np.testing.assert_allclose(expected, KIN.fk(data.qpos)[:3, 3], atol=1e-3)
        moved = max(moved, np.linalg.norm(expected - KIN.fk(q)[:3, 3]))
    assert moved > 4e-3
