"""What other people's code needs of every registered id: one kind of `info`, vectors, one limit of steps."""

import gc
import sys
import types
from itertools import product

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import TimeAwareObservation

import kinreach  # noqa: F401 (registers the environments)
from kinreach.errors import InputError, UnknownOptionError
from tests.cases import slow

IDS = sorted(name for name in gym.registry if name.startswith("kinreach/"))
NATIVE = [name for name in IDS if gym.spec(name).vector_entry_point is not None]
#: Episodes that end soon, so that some begin in a few steps; trays that are small.
QUICK = {
    "kinreach/RealArm-v0": {"balls": 2, "budgets": (0, 5), "again": 1},
    "kinreach/Lift-v0": {"backend": "kinematic"},
}
#: In the contract of every environment.
CONTRACT = {"goal", "distance", "reached", "is_success", "impossible", "reward_terms"}
#: Of these only a success, or a collision, ends an episode.
ENDLESS = {
    f"kinreach/{name}-v0" for name in ("UR5MultiStep", "UR5MultiStepKinematic", "ButtonPress", "Push", "PickAndPlace")
}
MODES = ["sync", "async", "vector_entry_point"]


def options(name):
    return QUICK.get(name, {})


def kinds(info, within=""):
    """Type, shape and dtype of every entry, those of dictionaries too, without what Gymnasium adds."""
    found = {}
    for name, value in info.items():
        if name.startswith("_") or name in ("final_obs", "final_info"):
            continue
        if isinstance(value, dict):
            found |= kinds(value, f"{within}{name}.")
        else:
            found[f"{within}{name}"] = type(value), getattr(value, "shape", None), getattr(value, "dtype", None)
    return found


def test_there_are_ids():
    assert len(IDS) >= 11
    assert NATIVE == IDS


@pytest.mark.parametrize("name", IDS)
def test_observations_and_infos_are_of_one_kind_from_reset_to_reset(name):
    """Of types that Gymnasium's vectors and Minari stack, and with the entries of the contract."""
    env = gym.make(name, disable_env_checker=True, max_episode_steps=3, **options(name))
    env.action_space.seed(0)
    known = None
    resets = steps = 0
    for seed in range(8):
        observation, info = env.reset(seed=seed)
        over = False
        resets += 1
        while True:
            assert env.observation_space.contains(observation)
            found = kinds(info)
            known = known or found
            assert found == known
            if over:
                break
            observation, _, terminated, truncated, info = env.step(env.action_space.sample())
            over = terminated or truncated
            steps += 1
    entries = {entry.partition(".")[0] for entry in known}
    assert entries >= CONTRACT - ({"reward_terms"} if "Kinematic" in name else set())  # those have numbers only
    assert {kind for kind, _, _ in known.values()} <= {bool, int, float, str, np.ndarray}
    assert {dtype.kind for _, _, dtype in known.values() if dtype is not None} <= set("biuf")
    assert resets == 8
    assert steps >= 8


@pytest.mark.parametrize("name", IDS)
def test_numbers_alone_are_the_same_numbers(name):
    """With `info="numbers"`, single environments and batches; nothing but texts and dictionaries is missing."""
    numbers, all_of_it = (
        gym.make(name, disable_env_checker=True, **{**options(name), "info": kind}) for kind in ("numbers", "all")
    )
    batch = gym.make_vec(name, 2, "vector_entry_point", **{**options(name), "info": "numbers"})
    few, info, told = numbers.reset(seed=1)[1], all_of_it.reset(seed=1)[1], batch.reset(seed=1)[1]
    assert set(few) == {entry for entry, value in info.items() if not isinstance(value, str | dict)}
    assert {entry for entry in told if entry[0] != "_"} | {"target_tip"} == set(few) | {"target_tip"}
    for entry, value in few.items():
        np.testing.assert_array_equal(value, info[entry])
    assert len(few) >= len(CONTRACT) - 1


@pytest.mark.parametrize("name", IDS)
def test_rewards_and_verdicts_of_a_reset_are_nothing(name):
    _, info = gym.make(name, disable_env_checker=True, **options(name)).reset(seed=3)
    assert (info["reached"], info["is_success"], info["impossible"]) == (False, False, False)
    assert set(info.get("reward_terms", {}).values()) <= {0.0}
    assert {value for entry, value in info.items() if entry.startswith("reward_") and entry != "reward_terms"} <= {0.0}
    assert info.get("status", "") == info.get("impossible_reason", "") == ""


@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("name", NATIVE)
@pytest.mark.slow
def test_infos_of_native_batches_are_of_one_kind(name, mode):
    env = gym.make_vec(name, 3, "vector_entry_point", autoreset_mode=mode, max_episode_steps=3, **options(name))
    env.action_space.seed(0)
    _, info = env.reset(seed=0)
    known, ended, restarted = kinds(info), 0, 0
    for _ in range(5):
        _, _, terminated, truncated, info = env.step(env.action_space.sample())
        over = terminated | truncated
        for told in (info, info.get("final_info", info)):
            assert kinds(told) == known
            entries = {entry for entry in told if not entry.startswith("_") and not entry.startswith("final_")}
            assert {f"_{entry}" for entry in entries} <= set(told)
        ended += over.sum()
        if mode is AutoresetMode.DISABLED and over.any():
            _, info = env.reset(options={"reset_mask": over})
            assert kinds(info) == known
            restarted += 1
    assert ended >= 3
    assert restarted >= (mode is AutoresetMode.DISABLED)


@pytest.mark.parametrize("name", NATIVE)
def test_infos_of_a_batch_that_restarted_are_of_the_new_episodes(name):
    """What an episode begins with and keeps, such as a ball's speed, is there that of the reset of a single one."""
    alone = [gym.make(name, disable_env_checker=True, max_episode_steps=2, **options(name)) for _ in range(3)]
    batch = gym.make_vec(name, 3, vectorization_mode="vector_entry_point", max_episode_steps=2, **options(name))
    batch.reset(seed=3)
    batch.action_space.seed(0)
    begun = [env.reset(seed=3 + index)[1] for index, env in enumerate(alone)]
    kept, pairs = dict.fromkeys(set(begun[0]) - {"reward_terms"}, True), []
    for _ in range(6):
        actions = batch.action_space.sample()
        info = batch.step(actions)[-1]
        for index, env in enumerate(alone):
            *_, terminated, truncated, told = env.step(actions[index])
            for key in kept:
                kept[key] &= np.array_equal(told[key], begun[index][key])
            if terminated or truncated:
                begun[index] = env.reset()[1]
                pairs.append((begun[index], {key: info[key][index] for key in kept if key in info}))
    assert len(pairs) >= 6
    found = {key for key, still in kept.items() if still and any(key in new for _, new in pairs)}
    assert "goal" in found or name == "kinreach/Moving-v0"  # there it rolls
    for single, new in pairs:
        for key in found & new.keys():
            np.testing.assert_array_equal(new[key], single[key])


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", IDS)
@pytest.mark.slow
def test_vectors_of_gymnasium(name, mode):
    """Seeded and unseeded resets, and episodes that end on the way."""
    env = gym.make_vec(name, 2, mode, max_episode_steps=2, **options(name))
    try:
        env.action_space.seed(0)
        first, info = env.reset(seed=0)
        ended = 0
        for step in range(5):
            observation, _, terminated, truncated, told = env.step(env.action_space.sample())
            assert observation.shape == first.shape
            assert observation.dtype == first.dtype == env.observation_space.dtype == np.float32
            assert set(info) <= set(told)
            ended += (terminated | truncated).sum()
            if step == 3:
                env.reset()
        np.testing.assert_array_equal(env.reset(seed=0)[0], first)
        assert ended >= 2
    finally:
        env.close()


@pytest.mark.parametrize("name", IDS)
@pytest.mark.slow
def test_observations_are_of_single_precision_or_as_asked(name):
    """Rounded, and else the same: in single environments, sync and native batches, and as a learner keeps them."""
    torch, buffers = pytest.importorskip("torch"), pytest.importorskip("stable_baselines3.common.buffers")
    compared = 0
    for mode in ("single", "sync", "vector_entry_point"):
        seen, paid = {}, {}
        for dtype in ("float32", "float64"):
            given = {**options(name), "dtype": dtype}
            env = (
                gym.make(name, disable_env_checker=True, **given)
                if mode == "single"
                else gym.make_vec(name, 2, mode, **given)
            )
            env.action_space.seed(0)
            seen[dtype], paid[dtype] = [env.reset(seed=0)[0]], []
            for _ in range(2):
                observation, reward, over, *_ = env.step(env.action_space.sample())
                seen[dtype].append(observation)
                paid[dtype].append(reward)
                if mode == "single" and over:
                    break
            assert env.observation_space.dtype == dtype
            assert {rows.dtype.name for rows in seen[dtype]} == {dtype}
            assert all(env.observation_space.contains(rows) for rows in seen[dtype])
            if (mode, dtype) == ("single", "float32"):
                kept = buffers.ReplayBuffer(4, env.observation_space, env.action_space)
                kept.add(seen[dtype][0], observation, np.array(env.action_space.sample()), 0.0, False, [{}])
                torch.nn.Linear(observation.shape[-1], 1)(kept.sample(2).observations)  # as CleanRL's DQN and C51
            env.close()
        np.testing.assert_array_equal(paid["float32"], paid["float64"])
        for rounded, whole in zip(seen["float32"], seen["float64"], strict=True):
            np.testing.assert_array_equal(rounded, whole.astype(np.float32))
            compared += 1
    assert compared >= 8
    with pytest.raises(InputError, match="float16"):
        gym.make(name, dtype="float16")


LIMITED = {
    "kinreach/UR5MultiStep-v0": {"backend": "kinematic", "end_on_reached": False},
    "kinreach/ButtonPress-v0": {},
    "kinreach/Reach-v0": {"backend": "kinematic", "steps": "multi", "end_on_reached": False},
    "kinreach/Lift-v0": {"steps": "multi"},
    "kinreach/Obstacles-v0": {"clutter": (0,)},
}


def ends(name, mode, steps, **limit):
    """After how many steps, `steps` at most, the first episode is truncated; None if it is not."""
    given = {**LIMITED[name], **limit}
    if mode == "single":
        env = gym.make(name, disable_env_checker=True, **given)
        still = np.zeros(env.action_space.shape) if env.action_space.shape else 13
    else:
        env = gym.make_vec(name, 2, mode, **given)
        space = env.single_action_space
        still = np.zeros((2, *space.shape)) if space.shape else np.full(2, 13)
    try:
        env.reset(seed=0)
        for step in range(1, steps + 1):
            if name == "kinreach/Obstacles-v0":  # to another posture each time
                still = (0.1 * (step % 2) + np.array([-0.5, -0.5, 0.5, -0.5, -0.5, 0.0])).astype(np.float32)
                still = still if mode == "single" else np.tile(still, (2, 1))
            _, _, terminated, truncated, _ = env.step(still)
            assert not np.any(terminated)
            if np.any(truncated):
                assert np.all(truncated)
                return step
        return None
    finally:
        env.close()


@pytest.mark.parametrize("mode", ["single", "sync", "vector_entry_point", *slow("async")])
@pytest.mark.parametrize("name", LIMITED)
def test_there_is_one_limit_of_steps(name, mode):
    assert ends(name, mode, 5, max_episode_steps=3) == 3


@pytest.mark.parametrize(
    ("name", "limit", "mode"),
    [
        ("kinreach/UR5MultiStep-v0", 300, "single"),
        ("kinreach/UR5MultiStep-v0", 300, "vector_entry_point"),
        *slow(
            ("kinreach/UR5MultiStep-v0", 300, "sync"),
            *product(["kinreach/ButtonPress-v0"], [2000], ["single", "sync", "vector_entry_point"]),
        ),
    ],
)
def test_a_limit_may_be_larger_than_the_registered_one(name, limit, mode):
    registered = gym.spec(name).max_episode_steps
    assert registered < limit
    assert ends(name, mode, limit + 1, max_episode_steps=limit) == limit
    assert ends(name, mode, limit) == registered
    assert ends(name, mode, registered + 1, max_episode_steps=-1) is None


@pytest.mark.parametrize("name", NATIVE)
def test_a_native_batch_knows_its_limit(name):
    made = lambda **limit: gym.make_vec(name, 2, "vector_entry_point", **limit).unwrapped.max_episode_steps  # noqa: E731
    registered = gym.spec(name).max_episode_steps
    assert made() == made(max_episode_steps=None) == registered
    assert made(max_episode_steps=7) == 7
    assert made(max_episode_steps=-1) is None
    for wrong in (0, -2, 1.5, "many"):
        with pytest.raises(InputError, match="max_episode_steps must be"):
            made(max_episode_steps=wrong)


def test_a_batch_that_is_not_drawn_says_so_at_once():
    with pytest.raises(InputError, match=r"is not drawn, got render_mode='rgb_array'; gym.make draws one"):
        gym.make_vec("kinreach/Lift-v0", 2**17, "vector_entry_point", render_mode="rgb_array")


@pytest.mark.parametrize("name", IDS)
def test_time_can_be_observed(name):
    env = gym.make(name, disable_env_checker=True, **options(name))
    assert env.spec.max_episode_steps == gym.spec(name).max_episode_steps >= 1
    env = TimeAwareObservation(env, flatten=False)
    times = [env.reset(seed=0)[0]["time"][0]]
    observation, *_ = env.step(env.action_space.sample())
    assert env.observation_space.contains(observation)
    assert [*times, observation["time"][0]] == [0, 1]
    assert env.max_timesteps == env.spec.max_episode_steps


@pytest.mark.parametrize("name", IDS)
def test_episodes_that_end_by_themselves_are_not_truncated(name):
    """The registered limit is above what their task takes."""
    most = {"kinreach/RealArm-v0": {"again": 20, "budgets": (0, 5, 10, 20, 50, 100), "balls": 1},
            "kinreach/Lift-v0": {"backend": "kinematic", "attempts": 10}}.get(name, {})  # fmt: skip
    env = gym.make(name, disable_env_checker=True, **most)
    env.action_space.seed(0)
    env.reset(seed=0)
    for _ in range(gym.spec(name).max_episode_steps - 1):
        _, _, terminated, truncated, _ = env.step(env.action_space.sample())
        assert not truncated
        if terminated:
            break
    assert terminated or name in ENDLESS


@pytest.mark.parametrize("name", ["kinreach/ButtonPress-v0", "kinreach/Lift-v0", "kinreach/Obstacles-v0"])
def test_who_asks_for_the_former_option_is_told_the_present_one(name):
    with pytest.raises(UnknownOptionError, match=r"'max_steps'.*Gymnasium's, max_episode_steps="):
        gym.make(name, max_steps=10)


@pytest.mark.filterwarnings("ignore:Implicitly cleaning up")  # Minari's folders
@pytest.mark.parametrize("name", IDS)
def test_minari_collects_infos(name, tmp_path, monkeypatch):
    """By its own wrapper; of jax it needs one function, which torch has as well."""
    torch, minari = pytest.importorskip("torch"), pytest.importorskip("minari")
    pytest.importorskip("h5py")
    tree = types.ModuleType("jax.tree_util")
    tree.tree_map = torch.utils._pytree.tree_map
    jax = types.ModuleType("jax")
    jax.tree_util = tree
    monkeypatch.setitem(sys.modules, "jax", jax)
    monkeypatch.setitem(sys.modules, "jax.tree_util", tree)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    env = minari.DataCollector(
        gym.make(name, disable_env_checker=True, max_episode_steps=2, **options(name)),
        record_infos=True,
        data_format="hdf5",
    )
    env.action_space.seed(0)
    told = []
    for seed in range(2):
        told.append([env.reset(seed=seed)[1]])
        over = False
        while not over:
            _, _, terminated, truncated, info = env.step(env.action_space.sample())
            told[-1].append(info)
            over = terminated or truncated
    about = {"algorithm_name": "random", "description": "a test", "author": "me", "author_email": "none"}
    dataset = env.create_dataset("kinreach/infos-v0", eval_env=name, code_permalink="none", **about)
    compared = 0
    for episode, infos in zip(dataset.iterate_episodes(), told, strict=True):
        assert set(episode.infos) == set(infos[0])
        for entry, kept in episode.infos.items():
            if not isinstance(kept, dict):
                assert len(kept) == len(infos)
                for one, other in zip(kept, infos, strict=True):
                    value = one.decode() if isinstance(one, bytes) else one
                    np.testing.assert_array_equal(value, other[entry])
                    compared += 1
    env.close()
    del env, dataset
    gc.collect()
    assert compared >= 10
