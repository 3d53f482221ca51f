"""MuJoCo's model belongs to its environment: what is written to it acts there, and nowhere else."""

import copy
import pickle

import gymnasium as gym
import mujoco
import numpy as np
import pytest

import kinreach  # noqa: F401 (registers the environments)
from kinreach.envs.inside import ACTUATIONS, torque_model
from kinreach.errors import KinreachError
from kinreach.robots import get_arm
from kinreach.sim import ArmSimulation, BatchSimulation

IDS = sorted(name for name in gym.registry if name.startswith("kinreach/"))
#: Ids whose arms are simulated -> options of an episode of a few actions.
DYNAMIC = {
    "kinreach/UR5SingleStep-v0": {},
    "kinreach/UR5MultiStep-v0": {},
    "kinreach/Reach-v0": {},
    "kinreach/ButtonPress-v0": {},
    "kinreach/Lift-v0": {"steps": "multi"},
    "kinreach/Push-v0": {},
    "kinreach/PickAndPlace-v0": {},
    "kinreach/Obstacles-v0": {"clutter": (4,)},
}


def heavier(model):
    model.body_mass[:] *= 3.0
    model.body_inertia[:] *= 3.0


def rougher(model):
    model.dof_frictionloss[:] = 3.0


def weightless(model):
    """Gravity, where nothing compensates it."""
    model.body_gravcomp[:] = 0.0
    model.opt.gravity[:] = (0.0, 0.0, -30.0)


def damped(model):
    model.dof_damping[:] += 40.0


CHANGES = [heavier, rougher, weightless, damped]


def made(name, **more):
    return gym.make(name, disable_env_checker=True, **DYNAMIC[name], **more)


def played(env):
    """Observations, rewards and numbers of `info` of an episode of always the same actions, one after the other."""
    rng, numbers = np.random.default_rng(5), []
    env.reset(seed=7)
    for _ in range(4):
        space = env.action_space
        action = rng.integers(27) if space.shape == () else (rng.uniform(-0.3, 0.3, space.shape)).astype(np.float32)
        if "SingleStep" in env.spec.id or env.spec.id in ("kinreach/Reach-v0", "kinreach/Obstacles-v0"):
            action = (np.array([-1.5, -1.6, 1.4, -1.5, -1.5, 0.2]) / np.pi + 0.05 * action).astype(np.float32)
        observation, reward, terminated, truncated, info = env.step(action)
        numbers += [*observation, reward, *info["q"], info.get("move_s", 0.0), *env.unwrapped.data.qvel]
        if terminated or truncated:
            break
    return np.array(numbers)


@pytest.mark.parametrize("name", DYNAMIC)
def test_the_textures_of_a_model_are_small(name):
    """A thousand environments have a thousand models: all their textures are half a gigabyte."""
    assert 0 < made(name).unwrapped.model.ntexdata < 500_000


def test_these_are_all_ids_with_dynamics():
    assert {name for name in IDS if hasattr(gym.make(name).unwrapped, "model")} == set(DYNAMIC)
    assert {name for name in IDS if hasattr(gym.make(name).unwrapped, "data")} == set(DYNAMIC)


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("name", DYNAMIC)
def test_what_is_written_to_a_model_acts_there_and_nowhere_else(name, change):
    changed, beside = made(name), made(name)
    before, same = played(changed), played(beside)
    np.testing.assert_array_equal(before, same)
    change(changed.unwrapped.model)
    after = played(changed)
    assert after.shape != before.shape or (after != before).any()
    np.testing.assert_array_equal(played(changed), after)  # a reset keeps it
    np.testing.assert_array_equal(played(beside), before)
    np.testing.assert_array_equal(played(made(name)), before)  # a later one
    assert len(before) > 20


@pytest.mark.parametrize("name", DYNAMIC)
def test_models_and_states_are_where_gymnasium_has_them(name):
    one, other = made(name), made(name)
    for env in (one, other):
        assert isinstance(env.unwrapped.model, mujoco.MjModel)
        assert isinstance(env.unwrapped.data, mujoco.MjData)
        assert env.get_wrapper_attr("model") is env.unwrapped.model
    first = one.unwrapped.model, one.unwrapped.data
    one.reset(seed=0)
    one.step(one.action_space.sample())
    one.reset()
    assert (one.unwrapped.model, one.unwrapped.data) == first
    assert first[0] is not other.unwrapped.model
    one.reset(seed=0)
    assert one.unwrapped.data.time == 0.0
    assert one.unwrapped.scene.model is one.unwrapped.model


@pytest.mark.parametrize("name", DYNAMIC)
def test_copies_have_a_model_of_their_own(name):
    env = made(name).unwrapped
    for twin in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
        assert twin.model is not env.model
        twin.model.opt.gravity[:] = 0.0
        assert env.model.opt.gravity[2] == pytest.approx(-9.81)


@pytest.mark.parametrize("name", [name for name in IDS if name not in DYNAMIC])
def test_without_dynamics_there_is_no_model(name):
    env = gym.make(name).unwrapped
    for attribute in ("model", "data"):
        with pytest.raises(AttributeError, match=f"no `{attribute}` of MuJoCo without dynamics") as refused:
            getattr(env, attribute)
        assert isinstance(refused.value, KinreachError)
    assert ('backend="mujoco" has dynamics' in str(refused.value)) == ("Kinematic" in name)
    assert not env.has_wrapper_attr("model")


@pytest.mark.parametrize("name", ["kinreach/UR5MultiStep-v0", "kinreach/ButtonPress-v0", "kinreach/Lift-v0"])
def test_native_batches_are_not_touched_by_single_environments(name):
    options = DYNAMIC[name]

    def steps(env):
        rng = np.random.default_rng(3)
        env.reset(seed=4)
        shape = env.single_action_space.shape
        actions = rng.integers(0, 27, (3, 2)) if shape == () else rng.uniform(-0.3, 0.3, (3, 2, *shape))
        return np.array([env.step(action)[0] for action in actions])

    before = steps(gym.make_vec(name, 2, "vector_entry_point", **options))
    one, kept = made(name), gym.make_vec(name, 2, "vector_entry_point", **options)
    weightless(one.unwrapped.model)
    heavier(one.unwrapped.model)
    for env in (kept, gym.make_vec(name, 2, "vector_entry_point", **options)):
        np.testing.assert_array_equal(steps(env), before)


def test_nobody_gets_the_scene_that_is_kept():
    arm = get_arm("arm3")
    for new in (
        lambda: ArmSimulation(arm, visual=False).model,
        lambda: torque_model(arm, ACTUATIONS["tuned"], visual=False),
        lambda: ArmSimulation(arm).model,
        lambda: BatchSimulation(arm, 2).model,
    ):
        first = new()
        first.opt.gravity[:] = 0.0
        first.body_mass[:] = 5.0
        assert new() is not first
        assert new().opt.gravity[2] == pytest.approx(-9.81)
        assert (new().body_mass != 5.0).any()


@pytest.mark.parametrize("name", DYNAMIC)
def test_only_what_is_drawn_has_looks(name):
    """More shapes, without contacts and masses, that the physics does not know of."""
    plain, drawn = (made(name, render_mode=mode).unwrapped for mode in (None, "rgb_array"))
    for env in (plain, drawn):
        env.reset(seed=0)
    models = [plain.model, drawn.scene.model]
    solid = [((model.geom_contype != 0) | (model.geom_conaffinity != 0)).sum() for model in models]
    looks = [model.ngeom - count for model, count in zip(models, solid, strict=True)]
    assert solid[0] == solid[1] > 5
    assert looks[1] > looks[0] + 4
    np.testing.assert_allclose(models[0].body_mass.sum(), models[1].body_mass.sum(), rtol=1e-12)
