"""The state of an environment: saved in mid-episode and restored, here or in a copy, everything goes on bit for bit."""

import copy
from typing import NamedTuple

import gymnasium as gym
import mujoco
import numpy as np
import pytest

import kinreach  # noqa: F401 (registers the environments)
from kinreach.envs._state import put_back, saved
from kinreach.errors import InputError

IDS = sorted(name for name in gym.registry if name.startswith("kinreach/"))
#: Trays that are small.
QUICK = {"kinreach/RealArm-v0": {"balls": 2, "budgets": (0, 5), "again": 1}}
#: Ids whose episodes are longer than these tests.
LONG = {
    f"kinreach/{name}-v0"
    for name in ("UR5MultiStep", "UR5MultiStepKinematic", "ButtonPress", "Moving", "Reach", "Push", "PickAndPlace")
}
VARIANTS = [
    *((name, QUICK.get(name, {})) for name in IDS),
    ("kinreach/Lift-v0", {"backend": "kinematic"}),
    ("kinreach/Lift-v0", {"steps": "multi", "shapes": ("ball", "cube", "cylinder"), "masses": (0.02, 0.2)}),
    ("kinreach/UR5MultiStep-v0", {"backend": "kinematic"}),
    ("kinreach/UR5MultiStep-v0", {"goal_env": True, "reward": "sparse"}),
    ("kinreach/Lift-v0", {"goal_env": True}),
    ("kinreach/UR5MultiStep-v0", {"imperfections": {"payload": 0.5}}),
]


def made(name, options):
    return gym.make(name, disable_env_checker=True, **options).unwrapped


def drawn(env, count):
    env.action_space.seed(4)
    return [env.action_space.sample() for _ in range(count)]


def goes_on(env, actions):
    """What steps and resets return, episode after episode."""
    found = []
    for action in actions:
        found.append(env.step(action))
        if found[-1][2] or found[-1][3]:
            found.append(env.reset())
    return found


def assert_same(one, other):
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for name in one:
            assert_same(one[name], other[name])
    elif isinstance(one, tuple | list):
        assert len(one) == len(other)
        for each in zip(one, other, strict=True):
            assert_same(*each)
    else:
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(("name", "options"), VARIANTS)
@pytest.mark.slow
def test_it_goes_on_bit_for_bit(name, options):
    check(name, options)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["kinreach/UR5MultiStep-v0", "kinreach/Lift-v0"])
@pytest.mark.parametrize("kind", ["camera", "pixels"])
def test_what_cameras_see_goes_on_bit_for_bit(name, kind, needs_gl):
    check(name, {"observation": kind})


def check(name, options):
    """Again and again, after other episodes, in a new environment, in a copy, and in a copy of a copy."""
    env = made(name, options)
    env.reset(seed=3)
    actions = drawn(env, 4)
    goes_on(env, actions[:2])
    state = env.save_state()
    expected = goes_on(env, actions)
    cases = 0
    for _ in range(2):
        env.restore_state(state)
        assert_same(goes_on(env, actions), expected)
        cases += 1
    env.reset(seed=9)
    goes_on(env, actions[:3])
    env.restore_state(state)
    twin = copy.deepcopy(env)
    another = made(name, options)
    another.restore_state(state)
    late = made(name, options)
    late.reset(seed=1)
    goes_on(late, actions[:1])
    late.restore_state(state)
    for each in (env, twin, another, late, copy.deepcopy(copy.deepcopy(_with(env, state)))):
        assert_same(goes_on(each, actions), expected)
        cases += 1
    assert cases == 7
    ended = sum(len(step) == 2 for step in expected)
    assert ended or name in LONG or options.get("steps") == "multi"


@pytest.mark.parametrize("name", IDS)
def test_a_scene_that_was_asked_for_is_no_other_state(name):
    """It is copied, and a state with it is restored where there is none, or another one."""
    env = made(name, QUICK.get(name, {}))
    env.reset(seed=3)
    actions, cases = drawn(env, 2), 0
    plain = env.save_state()
    _ = env.scene
    state = env.save_state()
    expected = goes_on(env, actions)
    env.reset(seed=5)
    for each in (_with(env, state), copy.deepcopy(_with(env, state))):
        assert_same(goes_on(each, actions), expected)
        cases += 1
    for one in (plain, state):
        assert_same(goes_on(_with(made(name, QUICK.get(name, {})), one), actions), expected)
        cases += 1
    assert cases == 4


def _with(env, state):
    env.restore_state(state)
    return env


@pytest.mark.parametrize("name", ["kinreach/UR5MultiStep-v0", "kinreach/ButtonPress-v0", "kinreach/Obstacles-v0"])
def test_what_was_randomised_in_the_model_comes_back(name):
    env = made(name, {})
    env.reset(seed=0)
    env.model.opt.gravity[2], env.model.opt.timestep = -3.0, 0.001
    env.model.dof_damping[:] *= 1.5
    damping = env.model.dof_damping.copy()
    state = env.save_state()
    env.model.opt.gravity[2], env.model.opt.timestep, env.model.dof_damping[:] = -9.81, 0.002, 0.0
    for each in (env, copy.deepcopy(_with(env, state)), _with(made(name, {}), state)):
        each.restore_state(state)
        assert each.model.opt.gravity[2] == -3.0
        assert each.model.opt.timestep == 0.001
        np.testing.assert_array_equal(each.model.dof_damping, damping)


def test_a_copy_of_wrapped_environments_keeps_their_steps():
    env = gym.make("kinreach/UR5MultiStepKinematic-v0", max_episode_steps=6)
    env.reset(seed=2)
    actions = drawn(env.unwrapped, 6)
    for action in actions[:4]:
        env.step(action)
    twin = copy.deepcopy(env)
    for one in (env, twin):
        assert not one.step(actions[4])[3]
        assert one.step(actions[5])[3]


def test_what_is_no_state_of_it_is_refused():
    env = made("kinreach/UR5MultiStepKinematic-v0", {})
    with pytest.raises(InputError, match="reset the environment"):
        env.save_state()
    with pytest.raises(InputError, match="state must be what save_state returned, got 3"):
        env.restore_state(3)
    env.reset(seed=0)
    other = made("kinreach/ButtonPress-v0", {})
    other.reset(seed=0)
    with pytest.raises(InputError, match="the state is of an environment with other options: it has a ReachEpisodes"):
        other.restore_state(env.save_state())
    arms = [made("kinreach/UR5SingleStep-v0", {"arm": arm}) for arm in ("arm3", "ur5e")]
    for one in arms:
        one.reset(seed=0)
    with pytest.raises(
        InputError, match="the state is of an environment with other options: its model has other parts"
    ):
        arms[0].restore_state(arms[1].save_state())


class Pair(NamedTuple):
    first: object
    second: object


def test_every_value_comes_back_and_a_state_can_be_put_back_again():
    """Into nothing, into what is alike and into what is not; what is done to it later leaves the state as it was."""

    def values():
        a, rng = np.arange(6.0), np.random.default_rng(4)
        rng.normal(size=3)
        deep = {"rows": [a + 1.0, Pair(np.eye(2), "text")], "none": None, "some": (3, a * 2.0)}
        return [a, a.astype(int).reshape(2, 3), [a, [a + 1.0], 2], {"a": a, "b": 1}, (1, a), Pair(a, [a]), deep, rng]

    def plain(value):
        return str(value.bit_generator.state) if isinstance(value, np.random.Generator) else repr(value)

    def change(value):
        """Write into the first array of it, or draw."""
        if isinstance(value, np.random.Generator):
            value.normal()
        elif isinstance(value, np.ndarray):
            value += 7
        else:
            parts = value.values() if isinstance(value, dict) else value
            change(next(part for part in parts if isinstance(part, np.ndarray | list | dict)))

    others = [None, np.zeros(6), np.zeros((2, 3), dtype=int), [], [1, [2.0]], {"b": [0.0], "z": 1}, (1, 2), Pair(0, 0)]
    compared = 0
    for index in range(8):
        value, same = values()[index], values()[index]
        state = saved(value)
        generator = isinstance(value, np.random.Generator)
        for now in [np.random.default_rng(0)] if generator else others:
            found = put_back(now, state)
            assert type(found) is type(value)
            assert plain(found) == plain(same)
            for changing in (found, value):
                change(changing)
                assert plain(changing) != plain(same)
            assert plain(put_back(np.random.default_rng(0) if generator else None, state)) == plain(same)
            compared += 1
    assert compared == 7 * len(others) + 1
    fixed = np.zeros(6)
    fixed.flags.writeable = False
    restored = put_back(fixed, saved(np.arange(6.0)))  # cannot be in place
    np.testing.assert_array_equal(restored, np.arange(6.0))
    assert not fixed.any()


def test_an_array_that_is_alike_is_written_in_place():
    now, then = np.zeros(4), np.arange(4.0)
    rows, state = [now], saved({"rows": [then], "same": then})
    holder = {"rows": rows, "same": now[:2]}
    assert put_back(holder, state) is holder
    assert holder["rows"] is rows
    assert rows[0] is now
    np.testing.assert_array_equal(now, then)
    np.testing.assert_array_equal(holder["same"], then)  # one of another shape is replaced


def test_data_of_a_model_with_other_joints_is_refused():
    """That of one with as many is put back."""
    text = "<mujoco><worldbody><body>{}<geom size='1'/></body></worldbody></mujoco>"
    one, two = (mujoco.MjModel.from_xml_string(text.format("<joint/>" * count)) for count in (1, 2))
    then = mujoco.MjData(two)
    then.qpos[:] = [0.25, 0.5]
    with pytest.raises(InputError, match="the state is of an environment with other options: its model has other joi"):
        put_back(mujoco.MjData(one), saved(then))
    now = mujoco.MjData(two)
    assert put_back(now, saved(then)) is now
    np.testing.assert_array_equal(now.qpos, [0.25, 0.5])
