"""The environments under fuzz: observations stay in their space, rewards are numbers, and bad input is refused."""

import warnings
from dataclasses import fields

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import kinreach  # noqa: F401 (registers the environments)
from tests.robustness.fuzzing import NUMBERS, bad_arrays, things

REACH, BUTTON = ("kinreach/UR5SingleStep-v0", "kinreach/UR5MultiStep-v0"), "kinreach/ButtonPress-v0"
#: Id, options, joints, environments of a batch or None.
CASES = {
    f"{name.split('/')[1]}-{options.get('backend', '')}-{count}": (name, options, 3 if name == BUTTON else 6, count)
    for name, options in [*((name, {"backend": "kinematic"}) for name in REACH), (REACH[1], {}), (BUTTON, {})]
    for count in (None, 3)
}
SLOW = (REACH[1], {})


def made(name, options, count):
    if count is None:
        return gym.make(name, **options).unwrapped
    return gym.make_vec(name, num_envs=count, vectorization_mode="vector_entry_point", **options).unwrapped


@pytest.mark.parametrize(("name", "options", "n", "count"), CASES.values(), ids=CASES)
def test_reset_and_step(name, options, n, count, fuzzed):
    env = made(name, options, count)
    env.reset(seed=0)
    rows = () if count is None else (count,)

    def run(case):
        seed, reset_options, action = case
        refused = None
        try:
            observation, info = env.reset(seed=seed, options=reset_options)
            assert env.observation_space.contains(observation)
            assert np.isfinite(info["goal"]).all()
        except ValueError as error:  # still to be tried: an action after a reset that was refused
            refused = error
        observation, reward, terminated, truncated, info = env.step(action)
        assert env.observation_space.contains(observation)
        assert np.shape(reward) == np.shape(terminated) == np.shape(truncated) == rows
        assert np.isfinite(reward).all()
        total = sum(info["reward_terms"].values())
        np.testing.assert_allclose(total, reward, rtol=1e-12, atol=1e-12)
        if refused:
            raise refused

    near = [arrays(np.float64, (*rows, size), elements=st.floats(-0.5, 0.5)) for size in (3, n)]
    goal = near[0] | bad_arrays((*rows, 3)) | arrays(np.float64, (*rows, 3), elements=st.floats(-1e7, 1e7))
    start = near[1] | bad_arrays((*rows, n))
    optional = {"goal": goal, "q": start}
    if name != BUTTON:
        optional["view"] = arrays(np.float64, (*rows, 6), elements=st.floats(-3, 3)) | bad_arrays((*rows, 6))
    if count is not None:
        optional["reset_mask"] = arrays(np.bool_, rows) | bad_arrays(rows) | things()
    asked = st.fixed_dictionaries({}, optional=optional) | things()
    seeds = st.none() | st.integers(0, 2**32) | st.integers(-5, 2**70) | things() | NUMBERS
    seeds = st.none() | st.none() | seeds | st.lists(st.none() | st.integers(-1, 99), max_size=4)
    if name == BUTTON:
        actions = st.integers(0, 53) if count is None else st.lists(st.integers(0, 53), min_size=count, max_size=count)
        actions = actions | actions | st.integers(-3, 60) | bad_arrays(rows) | bad_arrays((3,))
    else:
        good = arrays(np.float32, (*rows, n), elements=st.floats(-1, 1, width=32))
        actions = (
            good | good | bad_arrays((*rows, n)) | arrays(np.float64, (*rows, n), elements=st.floats(-1e308, 1e308))
        )
    slow = (name, options) == SLOW
    fuzzed(st.tuples(seeds, st.none() | asked, actions), run, share=0.3 if slow else 1.0)
    env.close()


@pytest.mark.parametrize("name", [REACH[0], BUTTON])
def test_what_environments_are_made_of(name, fuzzed):
    kind = type(gym.make(name).unwrapped).Options
    own = [entry.name for entry in fields(kind) if entry.name != "render_mode"]  # which Gymnasium looks at first
    values = NUMBERS | things() | st.integers(-3, 60) | st.booleans() | st.tuples(*[st.floats(-0.6, 0.6)] * 3)
    named = ["kinematic", "geometric", "tuned", "report", "thesis", "mujoco", "ur5", "arm3", "NextStep", "Disabled"]
    words = st.sampled_from(named)

    def run(case):
        option, value, count = case
        options = {"backend": "kinematic"} if name != BUTTON else {}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # Gymnasium's, of render modes
            env = made(name, {**options, option: value}, count)
        observation, _ = env.reset(seed=0)
        assert env.observation_space.contains(observation)
        env.close()

    batches = st.none() | st.integers(1, 3)
    fuzzed(st.tuples(st.sampled_from([*own, "autoreset_mode", "nothing"]), values | words, batches), run, share=0.6)


@pytest.mark.parametrize("name", [*REACH, BUTTON])
def test_sizes_of_batches(name, fuzzed):
    options = {} if name == BUTTON else {"backend": "kinematic"}

    def run(case):
        count, threads = case
        env = gym.make_vec(name, num_envs=count, vectorization_mode="vector_entry_point", threads=threads, **options)
        assert env.reset(seed=0)[0].shape[0] == count
        env.close()

    number = st.integers(1, 9)
    wild = number | things() | NUMBERS | st.sampled_from([0, -1, 2**17 + 1, 10**9, 10**12, 2**63, 10**400])
    fuzzed(st.tuples(wild, number) | st.tuples(number, wild), run, share=0.4)
