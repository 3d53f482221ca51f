"""Lifting: an object is lifted where it is held, and nowhere else; batches, options, ends and bad input."""

from dataclasses import replace
from functools import partial
from itertools import product
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest

import kinreach  # noqa: F401
from kinreach._registration import LIFT
from kinreach.baselines.expert import tool_down_postures
from kinreach.compare import get_task
from kinreach.errors import InputError, UnknownNameError
from kinreach.kinematics import CollisionChecker
from kinreach.kinematics.inside import MARGIN
from kinreach.robots import Workcell, get_arm

RANGE = {
    "shapes": ("ball", "cube", "cylinder"),
    "sizes": (0.015, 0.035),
    "masses": (0.02, 0.3),
    "frictions": (0.3, 1.5),
}
FORMS = {"single": {}, "multi": {"steps": "multi", "max_episode_steps": 12}, "kinematic": {"backend": "kinematic"}}


def make(**options):
    return gym.make(LIFT, disable_env_checker=True, **options)


def scripted(env):
    return get_task("lift").methods["closed-form"].make(env)


def lowest_point(env):
    """Height of the object's lowest point above the table, from all of its corners, or from a fine sampling."""
    model, data = env.unwrapped.scene.model, env.unwrapped.scene.data
    import mujoco

    mujoco.mj_kinematics(model, data)
    geom = model.geom("object")
    size, place, R = geom.size, data.geom("object").xpos, data.geom("object").xmat.reshape(3, 3)
    table = env.unwrapped.arm.workcell.goals.z[0]
    if geom.type == mujoco.mjtGeom.mjGEOM_SPHERE:
        return place[2] - size[0] - table
    if geom.type == mujoco.mjtGeom.mjGEOM_BOX:
        points = np.array(np.meshgrid(*3 * [[-1, 1]])).reshape(3, -1) * size[:, None]
    else:
        angle = np.linspace(0, 2 * np.pi, 400)
        ring = np.stack([size[0] * np.cos(angle), size[0] * np.sin(angle), 0 * angle])
        half = np.array([[0], [0], [size[1]]])
        points = np.hstack([ring + half, ring - half])
    return (place[:, None] + R @ points)[2].min() - table


@pytest.mark.parametrize("options", [{}, RANGE, RANGE | {"arm": "ur5e"}], ids=["default", "range", "ur5e"])
def test_a_scripted_grasp_lifts(options):
    env, lifted, shapes = make(**options), 0, set()
    policy = scripted(env)
    for seed in range(12):
        observation, info = env.reset(seed=seed)
        policy.reset(observation, info)
        assert lowest_point(env) == pytest.approx(0.0, abs=1e-9)
        shapes.add(info["shape"])
        _, reward, terminated, truncated, info = env.step(policy.act(observation))
        assert (terminated, truncated) == (True, False)
        assert info["clearance"] == pytest.approx(lowest_point(env), abs=1e-4)
        assert info["is_success"] == (info["cause"] == "")
        if info["is_success"]:
            assert info["held"]
            assert info["clearance"] > 0.1
            assert reward > 21.9
            assert 2.5 < info["move_s"] < 6.0
        lifted += info["is_success"]
    assert lifted == 12
    assert len(shapes) == len(options.get("shapes", ["ball"]))


def test_cubes_are_grasped_along_their_faces():
    env = make(shapes=("cube",), sizes=(0.03,))
    policy = scripted(env)
    for seed in range(8):
        observation, info = env.reset(seed=seed, options={"yaw": 0.7 * seed})
        outwards = np.arctan2(info["goal"][1], info["goal"][0])
        assert abs(observation[3]) <= np.pi / 4
        assert np.exp(4j * observation[3]) == pytest.approx(np.exp(4j * (0.7 * seed - outwards)))
        info = env.step(policy.act(observation))[4]
        assert info["is_success"]
        assert info["posture_error"] < 0.01


@pytest.mark.parametrize(
    ("wrong", "cause"),
    [
        ("beside", "reached"),
        ("open", "closed"),
        ("slippery", "slipped"),
        ("impossible", "reached"),
        ("unsolved", "reached"),
    ],
)
def test_a_grasp_that_fails_says_at_which_stage(wrong, cause):
    env, seen = make(), 0
    for seed in range(4):
        options = {"friction": 0.0} if wrong == "slippery" else {}
        observation, info = env.reset(seed=seed, options=options)
        action = scripted(env).act(observation)
        if wrong == "beside":
            action[0] += 0.06
        elif wrong == "open":
            action[6] = 0.0  # 8 cm around a ball of 5
        elif wrong == "impossible":
            action[1] += 0.12  # into the table
        elif wrong == "unsolved":
            action[:6] = [0, -0.5, 0, -0.5, 0, 0]  # stretched upwards: nothing above it
        _, reward, terminated, _, info = env.step(action)
        assert terminated
        assert not info["is_success"]
        assert (info["cause"], info["impossible"]) == (cause, wrong in ("impossible", "unsolved"))
        assert info["impossible"] == bool(info["impossible_reason"])
        assert reward < 3.0
        seen += 1
    assert seen == 4


def test_after_a_miss_the_arm_looks_again():
    env, lifted = make(attempts=2), 0
    for seed in range(6):
        observation, info = env.reset(seed=seed)
        policy = scripted(env)
        action = policy.act(observation)
        aside = np.linalg.norm(info["goal"][:2]) * 0.1
        action[0] += 0.1 / np.pi
        observation, _, terminated, truncated, info = env.step(action)
        assert (terminated, truncated, info["is_success"]) == (False, False, False)
        assert np.abs(observation[8:14] - env.unwrapped.home).max() < 0.01
        assert observation[14] == pytest.approx(0.10, abs=1e-3)
        assert aside > 0.03
        _, _, terminated, _, info = env.step(policy.act(observation))
        assert terminated
        assert info["attempts"] == 2
        lifted += info["is_success"]
    assert lifted == 6


def test_going_home_leaves_the_object_where_it_is():
    """The fingers open and rise before the arm turns away."""
    env = make(attempts=2)
    observation, info = env.reset(seed=0)
    before, action = info["goal"], scripted(env).act(observation)
    action[6] = 0.0  # 8 cm around a ball of 5
    observation, _, terminated, _, info = env.step(action)
    assert (terminated, info["cause"], info["attempts"]) == (False, "closed", 1)
    assert np.linalg.norm(observation[:3] - before) < 2e-3
    assert np.linalg.norm(env.unwrapped.scene.T_world_frame("object")[:3, 3] - observation[:3]) < 1e-6
    np.testing.assert_allclose(observation[8:14], env.unwrapped.home, atol=1e-3)


def test_clutter_is_seen_and_left_alone():
    env = make(clutter=True)
    policy, lifted = scripted(env), 0
    for seed in range(8):
        observation, _ = env.reset(seed=seed)
        other = observation[18:21]
        assert np.linalg.norm(other - observation[:3]) >= 0.13
        turned = env.unwrapped.scene.data.joint("other").qpos[3:]
        np.testing.assert_allclose(turned, [1.0, 0.0, 0.0, 0.0], atol=1e-6)  # only the object lies in any direction
        observation, _, _, _, info = env.step(policy.act(observation))
        lifted += info["is_success"]
        body = env.unwrapped.scene.data.body("other").xpos
        assert np.linalg.norm(body - other) < 0.005
    assert lifted == 8


@pytest.mark.parametrize("shift", [(0.0, 0.0, 0.05), (0.04, -0.05, -0.03)])
def test_the_table_can_stand_elsewhere(shift):
    env, usual, lifted = make(table=shift), make(), 0
    policy = scripted(env)
    for seed in range(6):
        observation, info = env.reset(seed=seed)
        np.testing.assert_allclose(info["goal"], usual.reset(seed=seed)[1]["goal"] + shift, atol=1e-12)
        lifted += env.step(policy.act(observation))[4]["is_success"]
    assert lifted == 6


@pytest.mark.parametrize(("rise", "lifts"), [(0.15, True), (0.08, False)])
def test_small_steps_lift_what_is_held_high_for_half_a_second(rise, lifts):
    """A script of small steps: above, down, close, up, and still."""
    env = make(steps="multi", max_episode_steps=140, dtype="float64")
    kinematics = env.unwrapped.kinematics
    observation, info = env.reset(seed=0)
    place, over, count, up = info["goal"], False, 0, 0
    task = env.unwrapped._task
    low = scripted(env).act(observation)[:6] * np.pi
    high = task.above(low[None])[0]
    T = kinematics.fk(low)
    T[2, 3] += rise
    end = kinematics.nearest(T, low).q
    while not over:
        closed = count > 75
        target = high if count < 40 else end if count > 95 else low
        action = np.append(np.clip((target - observation[8:14]) / np.radians(5.0), -1, 1), -1.0 if closed else 0.0)
        observation, reward, terminated, truncated, info = env.step(action)
        assert reward == sum(info["reward_terms"].values())
        assert np.linalg.norm(kinematics.positions(observation[8:14][None])[0] - info["tip"]) < 1e-9
        np.testing.assert_allclose(observation[15:18], info["goal"] - info["tip"], atol=1e-12)
        over, count = terminated or truncated, count + 1
        up = up + 1 if info["held"] and info["clearance"] >= 0.10 else 0
    assert (info["is_success"], terminated, truncated) == (lifts, lifts, not lifts), (info["status"], count)
    assert info["cause"] == ("" if lifts else "slipped")
    assert up == (13 if lifts else 0)  # of 0.04 s
    assert info["goal"][2] - place[2] == pytest.approx(rise, abs=0.02)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(
    "options",
    [pytest.param({}, id="default"), pytest.param(RANGE | {"clutter": True}, id="range", marks=pytest.mark.slow)],
)
def test_a_batch_is_as_many_single_ones(form, options):
    """Bit for bit, with whatever objects, over the ends of episodes."""
    options = FORMS[form] | options | ({"attempts": 2} if form == "single" else {})
    batch = gym.make_vec(
        LIFT, num_envs=3, vectorization_mode="vector_entry_point", autoreset_mode="NextStep", **options
    )
    singles = [make(**options) for _ in range(3)]
    policies = [scripted(env) for env in singles]
    seen, told = batch.reset(seed=5)
    rows = [env.reset(seed=5 + i) for i, env in enumerate(singles)]
    same = np.testing.assert_array_equal if form != "kinematic" else partial(np.testing.assert_allclose, atol=1e-9)
    same(seen, [row[0] for row in rows])
    rng, over, compared, ends = np.random.default_rng(0), np.zeros(3, dtype=bool), 0, 0
    for step in range(4 if form != "multi" else 15):
        actions = rng.uniform(-1, 1, (3, 7)) * 0.3
        if form != "multi":
            for i, policy in enumerate(policies):
                action = None if (step + i) % 3 == 0 else policy.act(seen[i])
                actions[i] = actions[i] if action is None else action
        seen, rewards, ended, cut, told = batch.step(actions)
        for i, env in enumerate(singles):
            if over[i]:
                observation, info = env.reset()
                over[i] = False
            else:
                observation, reward, terminated, truncated, info = env.step(actions[i])
                same(reward, rewards[i])
                assert (terminated, truncated) == (ended[i], cut[i])
                assert sum(info["reward_terms"].values()) == pytest.approx(reward, abs=1e-12)
                over[i] = terminated or truncated
                ends += over[i]
                for name in ("cause", "status", "impossible_reason"):
                    assert info[name] == told[name][i]
                for name in ("clearance", "distance", "move_s", "opening"):
                    same(info[name], told[name][i])
            same(observation, seen[i])
            same(info["goal"], told["goal"][i])
            compared += 1
    assert compared == 3 * (step + 1)
    assert ends >= 3


def test_options_of_a_reset_are_those_of_each_environment():
    batch = gym.make_vec(LIFT, num_envs=3, vectorization_mode="vector_entry_point", **RANGE)
    places = np.array([[0.4, 0.1], [0.5, -0.1], [0.45, 0.0]])
    views = np.array([[0.4, 0.1, -0.17], [0.0, 0.0, 0.0], [0.45, 0.0, -0.17]])
    options = {"place": places, "yaw": [0.1, 0.2, 0.3], "shape": ["cube", "ball", "cylinder"], "view": views,
               "size": [0.02, 0.025, 0.03], "mass": [0.1, 0.2, 0.3], "friction": [0.4, 0.5, 0.6]}  # fmt: skip
    observations, told = batch.reset(seed=0, options=options)
    for row in range(3):
        observation, info = make(**RANGE).reset(options={name: values[row] for name, values in options.items()})
        np.testing.assert_array_equal(observation, observations[row])
        for name in ("yaw", "shape", "size", "mass", "friction"):
            assert info[name] == options[name][row] == told[name][row]
        np.testing.assert_array_equal(info["goal"], [*places[row], -0.2 + options["size"][row]])
        np.testing.assert_array_equal(info["seen"], views[row] if views[row].any() else 3 * [np.nan])
    assert not observations[1, :3].any()
    assert not observations[1, 15:18].any()
    info = batch.step(np.zeros((3, 7)))[4]["final_info"]
    assert (info["cause"] == "seen").tolist() == [False, True, False]
    same = batch.reset(options={"shape": "ball", "size": None})[1]["shape"]
    assert same.tolist() == 3 * ["ball"]
    with pytest.raises(InputError, match="a name for each of 3 environments, got 2"):
        batch.reset(options={"shape": ["ball", "cube"]})


def test_what_is_drawn_is_in_its_range_and_reaches_both_ends():
    task = make(clutter=True, **RANGE).unwrapped._task
    rows = task.sample(np.random.default_rng(0), 4000)
    region = task.region
    low = [region.x[0], region.y[0], -np.pi, 0, 0.015, 0.02, 0.3, region.x[0], region.y[0]]
    high = [region.x[1], region.y[1], np.pi, 2, 0.035, 0.3, 1.5, region.x[1], region.y[1]]
    assert (rows >= low).all()
    assert (rows <= high).all()
    np.testing.assert_allclose(rows.min(axis=0), low, atol=5e-3)
    np.testing.assert_allclose(rows.max(axis=0), high, atol=5e-3)
    assert np.linalg.norm(rows[:, :2] - rows[:, 7:], axis=1).min() >= 0.13
    starts = task.training_starts(np.random.default_rng(0), 4000, beyond=0.02)
    assert region.x[0] - 0.02 <= starts["place"][:, 0].min() < region.x[0] - 0.015
    assert set(starts["shape"]) == set(RANGE["shapes"])
    np.testing.assert_array_equal(np.sort(starts["size"]), np.sort(rows[:, 4]))
    assert {"place", "yaw", "shape", "size"} == set(starts)


@pytest.mark.parametrize("form", ["single", "multi"])
def test_a_simulation_that_diverges_ends_the_episode(form):
    env = make(attempts=3, **FORMS[form])
    observation, _ = env.reset(seed=0)
    action = scripted(env).act(observation)
    env.unwrapped.scene.data.qvel[:] = 1e7
    observation, _, terminated, truncated, info = env.step(action if form == "single" else 0.0 * action)
    assert terminated or truncated
    assert info["status"] == "diverged"
    assert info["impossible_reason"].startswith("diverged")
    assert not info["is_success"]
    assert np.isfinite(observation).all()
    env.reset(seed=1)
    assert env.step(np.zeros(7))[4]["status"] != "diverged"


@pytest.mark.parametrize("stage", ["drive", "rest"])
def test_a_simulation_that_diverges_in_a_grasp_ends_the_episode(stage, monkeypatch):
    """While the fingers close, or the object is held up; the arm is put back to where that began."""
    env = make(attempts=3)
    observation, _ = env.reset(seed=0)
    world = env.unwrapped._grasping
    act, begun = getattr(world, stage), []

    def unstable(ids, *given):
        begun.append(world.q[0])
        world._plant.qvel[ids] = 1e7
        act(ids, *given)

    monkeypatch.setattr(world, stage, unstable)
    _, _, terminated, _, info = env.step(scripted(env).act(observation))
    assert (terminated, info["status"], info["is_success"]) == (True, "diverged", False)
    assert info["impossible_reason"] == "diverged: the simulation became unstable"
    np.testing.assert_allclose(info["q"], begun[0], atol=1e-9)
    assert len(begun) == 1


@pytest.mark.parametrize(("form", "lost"), [("multi", [1]), ("multi", [0, 2]), ("single", [1])])
def test_of_a_batch_only_those_that_diverge_are_put_back(form, lost):
    """The others go on as if nothing had happened."""
    options = FORMS[form] | {"dtype": "float64", "autoreset_mode": "NextStep"}
    hit, plain = (gym.make_vec(LIFT, 3, "vector_entry_point", **options) for _ in range(2))
    observations, policy = hit.reset(seed=4)[0], scripted(make())
    plain.reset(seed=4)
    actions = np.zeros((3, 7)) if form == "multi" else np.array([policy.act(row) for row in observations])
    world = hit.unwrapped.episodes.world
    before = world.q.copy()
    world._plant.qvel[lost] = 1e7
    (seen, reward, ended, cut, info), (same, paid, over, limit, told) = (each.step(actions) for each in (hit, plain))
    others = np.setdiff1d(np.arange(3), lost)
    np.testing.assert_array_equal(seen[others], same[others])
    np.testing.assert_array_equal(reward[others], paid[others])
    np.testing.assert_array_equal((ended | cut)[others], (over | limit)[others])
    assert (info["status"] == "diverged").nonzero()[0].tolist() == lost
    assert (told["status"] != "diverged").all()
    assert (ended | cut)[lost].all()
    assert np.isfinite(seen).all()
    np.testing.assert_allclose(info["q"][lost], before[lost], atol=1e-9)
    hit.step(actions)  # starts them anew
    assert (hit.step(actions)[4]["status"] != "diverged").all()


@pytest.mark.parametrize("kind", ["dense", "sparse"])
def test_a_collision_ends_an_episode_of_small_steps(kind):
    """With sparse rewards it is no terminal state: fewer steps of -1 would make it pay."""
    env = make(steps="multi", reward=kind)
    env.reset(seed=0)
    terminated = truncated = False
    while not (terminated or truncated):
        _, reward, terminated, truncated, info = env.step([0, 1, 0, 0, 0, 0, 0])  # the upper arm goes down
    assert (terminated, truncated) == (kind == "dense", kind == "sparse")
    assert (info["impossible"], info["status"], info["is_success"]) == (True, "collision", False)
    assert info["reward_terms"].get("impossible", reward) == -1.0
    assert reward == sum(info["reward_terms"].values())


@pytest.mark.parametrize("reward", ["dense", "sparse"])
@pytest.mark.parametrize("form", FORMS)
def test_who_finds_no_grasp_ends_the_episode_where_the_arm_stands(form, reward):
    """Impossible, whatever was reached before; paid by the distance that is left."""
    env = make(attempts=2, reward=reward, dtype="float64", **FORMS[form]).unwrapped
    env.reset(seed=0)
    if form == "multi":
        observation, *_, info = env.step([0.4, 0.3, 0.0, 0.0, 0.0, 0.0, -1.0])
    else:
        observation, *_, info = env.step(np.append(env.home / np.pi, 0.0))  # a grasp of nothing
        assert info["attempts"] == 1
    same, paid, terminated, truncated, told = env.forfeit("no way there")
    assert (terminated, truncated) == (True, False)
    assert (told["status"], told["impossible"], told["impossible_reason"]) == ("forfeited", True, "no way there")
    assert (told["is_success"], told["reached"], told["cause"]) == (False, False, "reached")
    np.testing.assert_array_equal(same, observation)
    np.testing.assert_array_equal(told["q"], observation[8:14])
    assert told["distance"] == info["distance"]
    if form == "multi":
        assert told["distance"] == pytest.approx(np.linalg.norm(env.kinematics.positions(told["q"]) - told["goal"]))
    if reward == "sparse":
        assert (paid, told["reward_terms"]) == (-1.0, {"sparse": -1.0})
    else:
        expected = {
            "distance": -told["distance"] * (0.04 if form == "multi" else 1.0),
            "closed": 0.0,
            "height": 0.0,
            "lifted": 0.0,
        }
        assert told["reward_terms"] == pytest.approx(expected | {"impossible": -1.0}, abs=1e-6)
        assert paid == pytest.approx(expected["distance"] - 1.0, abs=1e-6)
    with pytest.raises(InputError, match="over"):
        env.step(np.zeros(7))
    assert env.reset(seed=1)[1]["impossible_reason"] == ""


@pytest.mark.slow
def test_geometry_predicts_what_the_dynamics_do():
    """The kinematic backend's verdict on grasps that are a little off, beside that of MuJoCo."""
    options = {**RANGE, "backend": "mujoco"}
    count = 120
    dynamic = gym.make_vec(LIFT, num_envs=count, vectorization_mode="vector_entry_point", **options)
    judged = gym.make_vec(LIFT, count, vectorization_mode="vector_entry_point", **options | {"backend": "kinematic"})
    observations, _ = dynamic.reset(seed=0)
    np.testing.assert_array_equal(judged.reset(seed=0)[0], observations)
    policy, rng = scripted(make(**RANGE)), np.random.default_rng(1)
    actions = np.array([policy.act(row) for row in observations])
    actions[:, :6] += rng.normal(0.0, 0.006, (count, 6)) * (np.arange(count) % 3)[:, None]
    lifted, predicted = (env.step(actions)[4]["final_info"]["is_success"] for env in (dynamic, judged))
    assert 0.4 < predicted.mean() < 0.95
    assert (lifted & predicted).sum() / predicted.sum() >= 0.97  # what geometry promises, the dynamics keep
    assert lifted.sum() >= predicted.sum()


@pytest.mark.parametrize(
    ("options", "error", "said"),
    [
        (
            {"sizes": (0.09,)},
            InputError,
            "from 0.01 to 0.045 m, got 0.09: it is 0.18 m wide, and the fingers come open",
        ),
        ({"sizes": ()}, InputError, "sizes must be a list of at least one"),
        ({"masses": (0.0,)}, InputError, "mass .* at least 0.001 and at most 1, got 0"),
        ({"frictions": (-0.1,)}, InputError, "friction must be finite and at least 0 and at most 3, got -0.1"),
        ({"shapes": ("cone",)}, UnknownNameError, "cone"),
        ({"steps": "two"}, UnknownNameError, "two"),
        ({"clutter": 1}, InputError, "clutter"),
        ({"arm": "panda"}, InputError, "arm 'panda'"),
        ({"arm": "arm3"}, InputError, "flange 'tool0' for one, as a UR has; arm 'arm3' has none"),
        (
            {"arm": replace(get_arm("ur5e"), workcell=Workcell())},
            InputError,
            "objects lie on a table, in a BoxRegion; the work cell of arm 'ur5e' lacks them",
        ),
        ({"observation": "camera", "shapes": ("cube",)}, InputError, "one ball, of one size, .* got shapes .*cube"),
        ({"observation": "camera", "sizes": (0.02, 0.03)}, InputError, "got sizes .*0.03"),
        ({"observation": "pixels", "clutter": True}, InputError, "got clutter=True; .* takes all"),
        ({"observation": "pixels", "arm": "ur5e"}, InputError, "got arm 'ur5e', which has no goal cameras"),
        ({"backend": "kinematic", "steps": "multi"}, InputError, "kinematic"),
    ],
)
def test_bad_options(options, error, said):
    with pytest.raises(error, match=said):
        make(**options)


def test_bad_input():
    env = make()
    with pytest.raises(InputError, match="reset"):
        env.unwrapped.step(np.zeros(7))
    for options, said in (
        ({"size": 0.1}, "size"),
        ({"mass": 0.0}, "mass"),
        ({"friction": -1.0}, "friction"),
        ({"place": (0, 0, 0)}, "place must have shape"),
        ({"place": (5, 0)}, "place must be on the table, x from 0.18 to 0.88 m and y from -0.6 to 0.6 m, got 5, 0"),
        ({"ball": 1}, "unknown reset options"),
        ({"shape": "cone"}, "cone"),
        ({"shape": 3}, "shape must be a name"),
    ):
        with pytest.raises((InputError, UnknownNameError), match=said):
            env.reset(options=options)
    env.reset(seed=0)
    for action in (np.zeros(6), np.full(7, np.nan)):
        with pytest.raises(InputError, match="action"):
            env.unwrapped.step(action)


def test_the_scene_follows_grasps_that_are_only_judged():
    env = make(backend="kinematic", shapes=("cube",), sizes=(0.02,))
    observation, info = env.reset(seed=3)
    assert lowest_point(env) == pytest.approx(0.0, abs=1e-9)
    env.step(scripted(env).act(observation))
    scene = env.unwrapped.scene
    np.testing.assert_allclose(scene.T_world_frame("object")[:3, 3], info["goal"], atol=1e-12)
    assert np.linalg.norm(scene.tip_position - info["goal"]) < 1e-6


def test_a_ur_gets_the_gripper():
    arm = get_arm("ur5e").with_gripper()
    assert (arm.gripper, arm.default_tip) == (get_arm("ur5-thesis").gripper, "tcp")
    with pytest.raises(InputError, match="has a gripper already"):
        arm.with_gripper()


def test_a_gripper_needs_a_flange():
    arm = replace(get_arm("ur5e"), tips={"wrist": "wrist_3_link"}, default_tip="wrist")
    with pytest.raises(InputError, match=r"unknown tip .* that can carry a gripper 'tool0'; available: wrist"):
        arm.with_gripper()


def test_cameras_find_the_ball(needs_gl):
    env = make(observation="camera")
    policy, lifted = scripted(env), 0
    for seed in range(3):
        observation, info = env.reset(seed=seed)
        assert 0.0 < np.linalg.norm(observation[:3] - info["goal"]) < 0.005
        lifted += env.step(policy.act(observation))[4]["is_success"]
    assert lifted == 3


@pytest.mark.slow
def test_pictures_show_the_ball(needs_gl):
    env = make(observation="pixels", width=128, height=72)
    batch = gym.make_vec(LIFT, 2, vectorization_mode="vector_entry_point", observation="pixels", width=128, height=72)
    both, _ = batch.reset(seed=0)
    for seed in range(2):
        observation, _ = env.reset(seed=seed)
        assert env.observation_space.contains(observation)
        for name, part in observation.items():
            np.testing.assert_array_equal(part, both[name][seed])
        red = observation["front_rgb"][..., 0].astype(int) - observation["front_rgb"][..., 1]
        assert (red > 80).sum() > 8
        assert observation["gripper"] == pytest.approx([0.1])


@pytest.mark.slow
def test_in_small_steps_cameras_look_once_and_pictures_show_the_fingers(needs_gl):
    camera = make(observation="camera", steps="multi", dtype="float64")
    env = make(observation="pixels", steps="multi", width=128, height=72, dtype="float64")
    first, _ = camera.reset(seed=0)
    shown, _ = env.reset(seed=0)
    for _ in range(12):
        action = [0.5, 0, 0, 0, 0, 0, -1]
        observation, info = camera.step(action)[::4]
        pictures = env.step(action)[0]
        np.testing.assert_array_equal(observation[:3], first[:3])
        np.testing.assert_allclose(observation[15:18], first[:3] - info["tip"], atol=1e-12)
    assert observation[14] == pictures["gripper"][0] < 0.05
    scene = env.unwrapped.episodes._pixels._simulation
    fingers = [scene.T_world_frame(name)[:3, 3] for name in ("finger_left", "finger_right")]
    assert np.linalg.norm(fingers[0] - fingers[1]) < 0.08
    assert (shown["wrist_rgb"] != pictures["wrist_rgb"]).any()


@pytest.mark.slow
def test_the_object_is_drawn(needs_gl):
    env = make(render_mode="rgb_array", shapes=("cube",), sizes=(0.035,))
    env.reset(seed=0)
    red = env.render()[..., 0].astype(int) - env.render()[..., 1]
    assert (red > 80).sum() > 40


def test_the_margin_counts_what_is_nearer_as_a_collision():
    """For solvers and for the geometric verdict, single and in a batch."""
    margin, moved = 0.02, 0
    envs = [make(backend="kinematic", margin=each).unwrapped for each in (MARGIN, margin)]
    batch = gym.make_vec(LIFT, 2, "vector_entry_point", backend="kinematic", margin=margin)
    exact = CollisionChecker("ur5-thesis")
    for seed, height in product(range(4), (0.0, 0.02, 0.04)):
        place = [*envs[0].reset(seed=seed)[1]["goal"][:2], -0.175 + height]
        q = tool_down_postures(envs[0]._task.kinematics, np.array([place]))[0]
        action = envs[0].grasp_action(q, 0.0)
        batch.reset(seed=0)
        nearest = exact.distance(q).distance
        expected = [nearest <= MARGIN, nearest <= margin]
        found = []
        for env in envs:
            env.reset(seed=seed)
            found.append(env.step(action)[4]["impossible"])
            assert env.accept(q) != found[-1]
        assert found == expected
        assert (batch.step(np.array([action, action]))[4]["impossible"] == expected[1]).all()
        moved += found == [False, True]
    assert moved >= 4


def test_a_grasp_is_a_posture_and_an_opening():
    task = make().unwrapped._task
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 7))
    actions[:3, -1] = -1.0, 0.0, 1.0
    postures, openings = task.grasps(actions)
    np.testing.assert_allclose(postures, np.pi * actions[:, :-1], atol=1e-12)
    np.testing.assert_allclose(openings, 0.08 * (1.0 + actions[:, -1]), atol=1e-12)
    np.testing.assert_allclose(openings[:3], [0.0, 0.08, 0.16], atol=1e-12)
    narrow = get_arm("ur5e").with_limits({"elbow_joint": (-1.0, 2.5), "wrist_1_joint": (-3.0, 0.5)})
    narrow = make(arm=narrow).unwrapped._task
    np.testing.assert_allclose(narrow.grasps(actions)[0][:, 2], 0.75 + 1.75 * actions[:, 2], atol=1e-12)
    for one in (task, narrow):
        for action, q, opening in zip(actions, *one.grasps(actions), strict=True):
            np.testing.assert_allclose(one.action_for(q, opening), action, atol=1e-12)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            {"observation": "pixels", "randomise": {"camera": (0.0, 0.01)}},
            "displaces what cameras measure; observation=",
        ),
        (
            {
                "arm": replace(
                    get_arm("panda"),
                    tips={"tool0": "panda_link8"},
                    default_tip="tool0",
                    workcell=get_arm("ur5-thesis").workcell,
                )
            },
            "closed form, such as a UR; arm 'panda.*' has none",
        ),
    ],
)
def test_options_that_do_not_go_together_are_refused(options, said):
    with pytest.raises(InputError, match=said):
        make(**options)


def test_without_cameras_nothing_was_measured():
    env = make()
    env.reset(seed=0)
    assert env.unwrapped.measurement is None
    env.unwrapped.episodes._camera = SimpleNamespace(last="a measurement")
    assert env.unwrapped.measurement == "a measurement"
