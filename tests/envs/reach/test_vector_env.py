"""Native batches are as many single environments."""

import copy

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import kinreach
from kinreach.errors import InputError
from kinreach.kinematics import URKinematics

SINGLE, MULTI = "kinreach/UR5SingleStep-v0", "kinreach/UR5MultiStep-v0"
#: One arm takes the URDF's angles as they are written, many take right angles where almost right ones are written.
ROUNDED = 1e-10
ARRAYS = ("goal", "distance", "posture_error", "reached", "is_success", "impossible")


def make_vec(name, count, **options):
    assert kinreach.__version__
    return gym.make_vec(name, num_envs=count, vectorization_mode="vector_entry_point", **options)


def actions_for(name, count, steps):
    """Random actions, and some near a posture that reaches."""
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (steps, count, 6))
    if name == SINGLE:
        natural = np.array([-1.8, -1.0, 1.9, -2.47, -np.pi / 2, 0.0]) / np.pi
        actions[:, ::2] = natural + rng.normal(0, 0.02, (steps, len(range(0, count, 2)), 6))
    return np.clip(actions, -1, 1)


@pytest.mark.parametrize(
    ("name", "backend", "count", "steps", "tolerance"),
    [
        (SINGLE, "kinematic", 16, 10, ROUNDED),
        (MULTI, "kinematic", 4, 105, ROUNDED),
        (SINGLE, "mujoco", 6, 4, 0.0),
        (MULTI, "mujoco", 3, 8, 0.0),
    ],
)
@pytest.mark.slow
def test_a_batch_equals_single_environments(name, backend, count, steps, tolerance):
    batch = make_vec(name, count, backend=backend)
    singles = [gym.make(name, backend=backend) for _ in range(count)]
    observations, info = batch.reset(seed=21)
    for i, env in enumerate(singles):
        observation, single_info = env.reset(seed=21 + i)
        np.testing.assert_allclose(observations[i], observation, rtol=0, atol=tolerance)
        np.testing.assert_array_equal(info["goal"][i], single_info["goal"])
    ended = impossible = 0
    for actions in actions_for(name, count, steps):
        observations, rewards, terminated, truncated, info = batch.step(actions)
        for i, env in enumerate(singles):
            observation, reward, over, cut, single_info = env.step(actions[i])
            last = info["final_info"] if over or cut else info
            assert (terminated[i], truncated[i]) == (over, cut)
            np.testing.assert_allclose(rewards[i], reward, rtol=0, atol=tolerance)
            for key in ARRAYS:
                np.testing.assert_allclose(last[key][i], single_info[key], rtol=0, atol=tolerance)
            for key, term in single_info["reward_terms"].items():
                np.testing.assert_allclose(last["reward_terms"][key][i], term, rtol=0, atol=tolerance)
            if over or cut:
                assert info["_final_obs"][i]
                np.testing.assert_allclose(info["final_obs"][i], observation, rtol=0, atol=tolerance)
                observation, single_info = env.reset()
                np.testing.assert_array_equal(info["goal"][i], single_info["goal"])
                ended += 1
            np.testing.assert_allclose(observations[i], observation, rtol=0, atol=tolerance)
            impossible += single_info.get("impossible", False)
    assert ended == count * steps if name == SINGLE else True
    assert name == SINGLE or backend == "mujoco" or ended >= count
    batch.close()


@pytest.mark.parametrize("name", [SINGLE, MULTI])
def test_joints_end_anywhere_within_the_tolerance(name):
    """The thesis's 0.01 rad (6.3); a batch is as many single environments with this too."""
    count, steps, tolerance = 8, 30, 0.01
    batch = make_vec(name, count, backend="kinematic", tolerance=tolerance)
    singles = [gym.make(name, backend="kinematic", tolerance=tolerance) for _ in range(count)]
    batch.reset(seed=5)
    for i, env in enumerate(singles):
        env.reset(seed=5 + i)
    errors = []
    for actions in actions_for(name, count, steps):
        *_, info = batch.step(actions)
        for i, env in enumerate(singles):
            _, _, over, cut, found = env.step(actions[i])
            last = info["final_info"] if over or cut else info
            np.testing.assert_allclose(last["q"][i], found["q"], rtol=0, atol=1e-12)
            errors += [] if found["impossible"] else [found["q"] - found["target"]]
            if over or cut:
                env.reset()
    off = np.array(errors)
    assert len(off) > 100
    assert 0.95 * tolerance < np.abs(off).max() <= tolerance * (1 + 1e-9)
    assert (np.abs(off.mean(axis=0)) < 4 * tolerance / np.sqrt(3 * len(off))).all()
    assert len(np.unique(off)) > 0.99 * off.size
    batch.close()


@pytest.mark.parametrize(("name", "backend"), [(SINGLE, "kinematic"), (MULTI, "kinematic"), (SINGLE, "mujoco")])
def test_what_a_step_returned_is_not_touched_by_later_ones(name, backend):
    batch = make_vec(name, 4, backend=backend)
    q = np.tile([-1.8, -1.0, 1.9, -2.47, -np.pi / 2, 0.0], (4, 1))
    goals = URKinematics("ur5-thesis", tip="tcp", base="world").positions(q) + np.arange(4)[:, None] * [0.0, 0.02, 0.0]
    returned = [batch.reset(seed=1, options={"q": q, "goal": goals})]
    scale = 1.0 if name == SINGLE else 0.0
    returned += [batch.step(scale * actions) for actions in actions_for(name, 4, 4)]
    ended = returned[1][4]["_final_info"]
    assert ended.all() if name == SINGLE else ended.tolist() == [True, False, False, False]
    kept = copy.deepcopy(returned)
    for actions in actions_for(name, 4, 102 if name == MULTI else 3):
        batch.step(actions)
    compared = 0
    for old, new in zip(flat(kept), flat(returned), strict=True):
        np.testing.assert_array_equal(old, new)
        compared += 1
    assert compared > 50


def flat(value):
    """The arrays in nested lists, tuples and dicts."""
    if isinstance(value, np.ndarray):
        yield value
    for part in value.values() if isinstance(value, dict) else value if isinstance(value, list | tuple) else ():
        yield from flat(part)


@pytest.mark.parametrize("threads", [1, 2])
def test_threads_change_nothing(threads):
    results = []
    for used in (1, threads):
        batch = make_vec(SINGLE, 8, backend="mujoco", threads=used)
        batch.reset(seed=3)
        results.append([batch.step(actions)[:2] for actions in actions_for(SINGLE, 8, 2)])
    for one, other in zip(*results, strict=True):
        np.testing.assert_array_equal(one[0], other[0])
        np.testing.assert_array_equal(one[1], other[1])


def test_the_vector_interface():
    batch = make_vec(MULTI, 5, backend="kinematic")
    assert batch.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    observations, _ = batch.reset(seed=[4, 5, 6, 7, 8])
    assert batch.observation_space.contains(observations)
    assert batch.action_space.shape == (5, 6)
    np.testing.assert_array_equal(observations, batch.reset(seed=4)[0])
    goals = np.tile([0.4, 0.0, -0.175], (5, 1))
    np.testing.assert_array_equal(batch.reset(options={"goal": goals})[1]["goal"], goals)
    for _ in range(2):
        batch.close()


def test_thousands_stay_in_step_with_one():
    """The result of an environment does not depend on how many there are."""
    small, large = make_vec(SINGLE, 1, backend="kinematic"), make_vec(SINGLE, 2000, backend="kinematic")
    actions = actions_for(SINGLE, 2000, 6)
    np.testing.assert_array_equal(small.reset(seed=9)[0][0], large.reset(seed=9)[0][0])
    for action in actions:
        one, many = small.step(action[:1]), large.step(action)
        for a, b in zip(one[:2], many[:2], strict=True):
            np.testing.assert_allclose(a[0], b[0], rtol=0, atol=ROUNDED)


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_gymnasiums_own_vectorisation_works(mode):
    env = gym.make_vec(
        SINGLE,
        num_envs=2,
        vectorization_mode=mode,
        backend="kinematic",
        vector_kwargs={"autoreset_mode": AutoresetMode.SAME_STEP},
    )
    env.reset(seed=0)
    for _ in range(3):
        _, rewards, terminated, _, _ = env.step(env.action_space.sample())
        assert terminated.all()
        assert np.isfinite(rewards).all()
    env.close()


@pytest.mark.parametrize(
    "options",
    [
        {"observation": "pixels", "width": 16384, "height": 16384},
        {"render_mode": "human"},
        {"threads": 0},
        {"backend": "bullet"},
        {"end_on_reached": 1.0},
    ],
)
def test_options_that_cannot_be_are_refused(options):
    with pytest.raises(InputError):
        make_vec(SINGLE, 2, **options)


def test_malformed_input_is_refused():
    batch = make_vec(SINGLE, 3, backend="kinematic")
    batch.reset(seed=0)
    for actions in (np.zeros((2, 6)), np.full((3, 6), np.nan), np.zeros(6)):
        with pytest.raises(InputError):
            batch.step(actions)
    with pytest.raises(InputError, match="2 seeds"):
        batch.reset(seed=[1, 2])
    for goals in (np.zeros(3), "there"):
        with pytest.raises(InputError):
            batch.reset(options={"goal": goals})


@pytest.mark.slow
def test_after_a_partial_restart_each_camera_has_its_own_noise(needs_gl):
    """Only environments 0 and 2 end; what they see then is what they would see alone."""
    options = {"backend": "kinematic", "observation": "camera", "depth_noise": 0.003, "width": 160, "height": 90}
    q = np.tile([-1.8, -1.0, 1.9, -2.47, -np.pi / 2, 0.0], (3, 1))
    goals = URKinematics("ur5-thesis", tip="tcp", base="world").positions(q) + np.diag([0.0, 0.1, 0.0])
    batch = make_vec(MULTI, 3, **options)
    batch.reset(seed=7)
    batch.reset(options={"q": q, "goal": goals})
    observations, _, terminated, _, _ = batch.step(np.zeros((3, 6)))
    assert terminated.tolist() == [True, False, True]
    batch.close()
    for index in (0, 2):
        single = gym.make(MULTI, **options)
        single.reset(seed=7 + index)
        single.reset(options={"q": q[index], "goal": goals[index]})
        assert single.step(np.zeros(6))[2]
        np.testing.assert_array_equal(single.reset()[0], observations[index])
        single.close()


@pytest.mark.slow
def test_what_starts_anew_leaves_the_others_pictures_as_they_are(needs_gl):
    """The noise of an environment's pictures is its own, whatever the others do."""
    options = {"backend": "kinematic", "observation": "pixels", "width": 32, "height": 18, "rgb_noise": 20.0}
    batch, single = make_vec(MULTI, 2, autoreset_mode="Disabled", **options), gym.make(MULTI, **options)
    batch.reset(seed=0)
    single.reset(seed=1)
    action = np.full(6, 0.1)
    for mask in ([True, False], [True, True]):
        alone = single.step(action)[0]
        seen, *_ = batch.step(np.tile(action, (2, 1)))
        np.testing.assert_array_equal(seen["front_rgb"][1], alone["front_rgb"])
        seen["front_rgb"][:] = 0  # it is the caller's
        again, _ = batch.reset(options={"reset_mask": np.array(mask)})
        if mask[1]:
            alone, _ = single.reset()
        np.testing.assert_array_equal(again["front_rgb"][1], alone["front_rgb"])
    batch.close()
    single.close()


@pytest.mark.parametrize("exposure", [1.0, 4.0])
@pytest.mark.slow
def test_pictures_are_those_of_single_environments(exposure, needs_gl):
    options = {"backend": "kinematic", "observation": "pixels", "width": 48, "height": 32, "exposure": exposure}
    batch, singles = make_vec(SINGLE, 3, **options), [gym.make(SINGLE, **options) for _ in range(3)]
    seen, _ = batch.reset(seed=5)
    assert batch.observation_space.contains(seen)
    actions = np.random.default_rng(0).uniform(-0.5, 0.5, (3, 6)).astype(np.float32)
    alone = [env.reset(seed=5 + index)[0] for index, env in enumerate(singles)]
    *_, info = batch.step(actions)
    after = [env.step(action)[0] for env, action in zip(singles, actions, strict=True)]
    compared = 0
    for stack, rows in ((seen, alone), (info["final_obs"], after)):
        for name, values in stack.items():
            for index in range(3):
                np.testing.assert_array_equal(values[index], rows[index][name])
                compared += 1
    assert compared == 2 * 6 * 3
    batch.close()
    for env in singles:
        env.close()
