"""What `randomise` draws at every reset: within its ranges, in `info`, in the dynamics, also in native batches."""

import copy
from dataclasses import replace

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import kinreach  # noqa: F401 (registers the environments)
from kinreach.envs import TabletopTask, register_tabletop
from kinreach.envs.inside import ObstaclesEnv
from kinreach.envs.real_arm import MEDIAN_LENGTH
from kinreach.errors import InputError, UnknownNameError
from kinreach.robots import get_arm
from kinreach.sim.inside import OF_JOINTS
from tests.cases import slow

ARM = {"payload": (0.1, 0.5), "friction": (0.0, 0.05), "damping": (0.0, 0.02), "gears": (0.7, 1.3)}
SERVOS = {**ARM, "encoder_noise": (0.0, 1e-3)}
ALL = {**SERVOS, "camera": (-0.005, 0.005)}
SIGHTS = {"noise": (1e-4, 1e-3), "delay": (0.02, 0.1), "strength": (0.6, 1.0)}
LOOKS = {"noise": (1e-4, 1e-3), "payload": (0.5, 5.0)}
TRAY = {"errors": ("nongeometric",), "balls": 2, "budgets": (0, 5), "again": 1}


class Push(TabletopTask):
    fingers = False

    def sample(self, rng, count, region):
        return np.array([0.47, 0.0]) + rng.uniform(-0.02, 0.02, (count, 2)), np.zeros(count), np.zeros((count, 3))

    def achieved(self, state):
        return state.position

    def success(self, achieved, goals):
        return np.zeros(len(achieved), dtype=np.bool_)


register_tabletop("tests/DrawnPush-v0", Push, max_episode_steps=4)
CASES = {
    "multi": ("kinreach/UR5MultiStep-v0", ALL, {}),
    "reach": ("kinreach/Reach-v0", ALL, {"steps": "multi"}),
    "panda": ("kinreach/Reach-v0", ALL, {"steps": "multi", "arm": "panda"}),
    "lift": ("kinreach/Lift-v0", ALL, {"steps": "multi", "masses": (0.05, 0.2)}),
    "button": ("kinreach/ButtonPress-v0", ARM, {}),
    "report": ("kinreach/ButtonPress-v0", ARM, {"actuation": "report"}),
    "push": ("tests/DrawnPush-v0", SERVOS, {}),
    "moving": ("kinreach/Moving-v0", SIGHTS, {}),
    "obstacles": ("kinreach/Obstacles-v0", {**ALL, "obstacles": (-0.02, 0.02)}, {"boxes": True, "clutter": (1, 3)}),
    "real": ("kinreach/RealArm-v0", LOOKS, TRAY),
    "random": ("kinreach/RandomArm-v0", {"noise": (1e-4, 1e-3)}, {}),
    "kinematic": ("kinreach/UR5MultiStepKinematic-v0", {"camera": (-0.005, 0.005)}, {}),
}
QUICK = ("multi", "lift", "button", "moving", "obstacles", "real", "random", "kinematic")
EVERY = [*QUICK, *slow(*(name for name in CASES if name not in QUICK))]


def single(case, **changed):
    name, ranges, options = CASES[case]
    return gym.make(name, **{"randomise": ranges, **options, **changed})


def native(case, count, **changed):
    name, ranges, options = CASES[case]
    more = {"randomise": ranges, "vectorization_mode": "vector_entry_point", **options, **changed}
    return gym.make_vec(name, count, **more)


def drawn(info):
    return {name: np.asarray(value) for name, value in info.items() if name.startswith("drawn_")}


def action_of(env, seed=0):
    env.action_space.seed(seed)
    action = env.action_space.sample()
    if isinstance(env.unwrapped, ObstaclesEnv):  # a posture near the first
        return (env.unwrapped.home + 0.2 * action) / np.pi
    return action if isinstance(env.action_space, gym.spaces.Discrete) else 0.2 * action


@pytest.mark.parametrize("case", EVERY)
def test_every_range_is_met_and_every_seed_draws_the_same(case):
    env, seen = single(case), []
    ranges = CASES[case][1]
    shapes = None
    for seed in range(40):
        found = drawn(env.reset(seed=seed)[1])
        assert set(found) == {f"drawn_{name}" for name in ranges}
        shapes = shapes or {name: value.shape for name, value in found.items()}
        stepped = drawn(env.step(action_of(env))[4]) if seed < 3 else found
        for name, value in found.items():
            assert value.shape == shapes[name]
            np.testing.assert_array_equal(stepped[name], value)
        seen.append(found)
    joints = (env.unwrapped.believed if case == "real" else env.unwrapped.arm).joints
    numbers = {name: shapes[f"drawn_{name}"] for name in ranges if name not in ("camera", "obstacles")}
    assert numbers == {name: (len(joints),) if name in OF_JOINTS else () for name in numbers}
    for name, (low, high) in ranges.items():
        values = np.array([found[f"drawn_{name}"] for found in seen])
        assert low <= values.min() < low + 0.15 * (high - low)
        assert high - 0.15 * (high - low) < values.max() <= high
        assert len(np.unique(values)) == values.size
    again = drawn(env.reset(seed=7)[1])
    np.testing.assert_equal(again, seen[7])
    assert not np.array_equal(
        drawn(env.reset()[1])[f"drawn_{next(iter(ranges))}"], again[f"drawn_{next(iter(ranges))}"]
    )


@pytest.mark.parametrize("case", EVERY)
def test_a_native_batch_draws_for_every_world_what_single_ones_draw(case):
    """And its dynamics are theirs, bit for bit, over resets in the same step."""
    batch = native(case, 3, max_episode_steps=3)
    singles = [single(case, max_episode_steps=3) for _ in range(3)]
    observations, info = batch.reset(seed=5)
    for row, env in enumerate(singles):
        alone, told = env.reset(seed=5 + row)
        np.testing.assert_allclose(observations[row], alone, atol=1e-12)
        np.testing.assert_equal({name: value[row] for name, value in drawn(info).items()}, drawn(told))
    redrawn = 0
    for number in range(7):
        action = action_of(singles[0], number)
        observations, _, terminated, truncated, info = batch.step(np.stack([action] * 3))
        for row, env in enumerate(singles):
            alone, _, *ends, told = env.step(action)
            if any(ends):
                alone, told = env.reset()
                redrawn += 1
            assert (terminated | truncated)[row] == any(ends)
            np.testing.assert_allclose(observations[row], alone, atol=1e-9 if case == "kinematic" else 0)
            np.testing.assert_equal({name: value[row] for name, value in drawn(info).items()}, drawn(told))
    assert redrawn >= 6


@pytest.mark.filterwarnings("ignore:.*A Box observation space .*infinity")
@pytest.mark.parametrize("case", EVERY)
def test_gymnasium_checks_it(case):
    check_env(single(case).unwrapped, skip_render_check=True)


@pytest.mark.parametrize("case", ["multi", "lift", "button"])
def test_what_is_drawn_is_in_the_model_and_changes_the_dynamics(case):
    """One at a time; goals and starts of a seed stay as they are."""
    ranges = CASES[case][1]
    plain = single(case, randomise=None)
    start = plain.reset(seed=3)[1]
    action = action_of(plain)
    ends = [plain.step(action)[4]["q"] for _ in range(3)][-1]
    nominal, changed = plain.unwrapped.model, 0
    servos = [nominal.actuator(name).id for name in plain.unwrapped.arm.joints]
    dofs = [nominal.joint(name).dofadr[0] for name in plain.unwrapped.arm.joints]
    for name in (name for name in ranges if name != "camera"):
        env = single(case, randomise={name: ranges[name]})
        info = env.reset(seed=3)[1]
        np.testing.assert_array_equal(info["goal"], start["goal"])
        np.testing.assert_array_equal(info["q"], start["q"])
        value, model = info[f"drawn_{name}"], env.unwrapped.model
        efforts = np.array([model.jnt_actfrcrange[model.joint(joint).id, 1] for joint in env.unwrapped.arm.joints])
        if name == "payload":
            assert model.body("payload").mass[0] == value
            assert model.body_subtreemass[0] == pytest.approx(nominal.body_subtreemass[0] + value)
        elif name == "friction":
            np.testing.assert_allclose(model.dof_frictionloss[dofs], value * efforts)
        elif name == "damping":
            np.testing.assert_allclose(model.dof_damping[dofs], nominal.dof_damping[dofs] + value * efforts)
        elif name == "gears":
            gains = nominal.actuator_gainprm[servos, 0]
            np.testing.assert_allclose(model.actuator_gainprm[servos, 0], value * gains)
        q = [env.step(action)[4]["q"] for _ in range(3)][-1]
        assert 1e-9 < np.abs(q - ends).max() < 0.5, name
        changed += 1
    assert changed == len(ranges) - ("camera" in ranges)


@pytest.mark.parametrize(("name", "value"), [("friction", 0.02), ("damping", 0.01), ("encoder_noise", 1e-3)])
def test_a_range_of_one_value_is_that_imperfection(name, value):
    drawn_env = single("multi", randomise={name: (value, value)})
    given = single("multi", randomise=None, imperfections={name: value})
    for env in (drawn_env, given):
        env.reset(seed=1)
    for number in range(3):
        action = action_of(given, number)
        np.testing.assert_array_equal(drawn_env.step(action)[4]["q"], given.step(action)[4]["q"])


def test_arms_among_obstacles_are_as_drawn():
    """The move that a plain one makes ends elsewhere, one property at a time; scenes stay as they are."""
    ranges, changed = CASES["obstacles"][1], 0
    for name in (None, *SERVOS):
        env = single("obstacles", randomise=name and {name: ranges[name]}, clutter=(2,))
        info = env.reset(seed=3)[1]
        q = env.step((info["q"] + 0.2) / np.pi)[4]["q"]
        if name is None:
            start, end = info, q
            continue
        np.testing.assert_array_equal(info["obstacles"], start["obstacles"])
        np.testing.assert_array_equal(info["goal"], start["goal"])
        assert 1e-9 < np.abs(q - end).max() < 0.5, name
        if name == "payload":
            assert env.unwrapped.model.body("payload").mass[0] == info["drawn_payload"]
        changed += 1
    assert changed == 5


def test_obstacles_are_observed_beside_their_places():
    env, off = single("obstacles", dtype="float64", clutter=(0, 3, 20)), []
    for seed in range(8):
        observation, info = env.reset(seed=seed)
        boxes, count = observation[13:].reshape(20, 7), info["clutter"]
        np.testing.assert_allclose(boxes[:count, 1:4] - info["drawn_obstacles"][:count], info["obstacles"][:count, :3])
        np.testing.assert_array_equal(boxes[:count, 4:], info["obstacles"][:count, 3:])
        assert not boxes[count:].any()
        off += [*np.abs(boxes[:count, 1:4] - info["obstacles"][:count, :3]).max(axis=1)]
    assert len(off) >= 40
    assert 0.0 < min(off) < 0.02


def test_sights_of_a_ball_are_as_drawn():
    """As an environment with these options has them, to the bit; and the arm keeps its share of its limits."""
    env, steps = single("moving", dtype="float64", sights=3), 0
    for seed in range(4):
        observation, info = env.reset(seed=seed)
        options = {name: float(info[f"drawn_{name}"]) for name in SIGHTS}
        same = single("moving", randomise=None, dtype="float64", sights=3, **options)
        np.testing.assert_array_equal(same.reset(seed=seed)[0], observation)
        for number in range(12):
            action = action_of(env, number)
            observation, *_, info = env.step(action)
            np.testing.assert_array_equal(same.step(action)[0], observation)
            steps += 1
        assert abs(observation[3] - info["drawn_delay"]) <= 0.5 / 240 + 1e-9
    assert steps == 48


@pytest.mark.parametrize("case", ["multi", "lift", "kinematic", "obstacles"])
def test_cameras_off_their_places_see_goals_elsewhere(case):
    env, off = single(case, dtype="float64"), []
    plain = single(case, randomise=None, dtype="float64")
    for seed in range(10):
        observation, info = env.reset(seed=seed)
        ideal, _ = plain.reset(seed=seed)
        size = 3 if case == "lift" else 6
        np.testing.assert_allclose(observation[:size] + info["drawn_camera"], ideal[:size], atol=1e-9)
        if case != "obstacles":
            np.testing.assert_array_equal(info["view"], observation[:size])
        off.append(np.linalg.norm(info["seen"] - info["goal"]))
    assert min(off) > 5e-4
    assert max(off) < 0.01


def test_a_real_arm_bends_under_the_payload_that_was_drawn_and_is_seen_with_the_noise():
    """One that is heavier bends more, in the same workplace; noise alone changes sights, and not the arm."""
    q, bent, spread = np.tile(get_arm("ur5-thesis").home, (50, 1)), [], []
    for seed in range(8):
        env = single("real", budgets=(50,), balls=200, dtype="float64")
        observation, info = env.reset(seed=seed)
        place = env.unwrapped.episodes.place(0)
        assert place.payload == info["drawn_payload"]
        off = np.linalg.norm(place.tips(q[:1]) - replace(place, payload=0.0).tips(q[:1]))
        bent.append((info["drawn_payload"], off))
        noise = [*(env.unwrapped.look(q) - place.tips(q)), *(observation[:, :3] - env.unwrapped.episodes.balls[0])]
        spread.append(np.std(noise) / info["drawn_noise"] * MEDIAN_LENGTH)
        assert env.unwrapped.noise == pytest.approx(info["drawn_noise"] / MEDIAN_LENGTH)
    masses, offs = np.array(sorted(bent)).T
    assert (np.diff(offs) > 0.0).all()
    assert masses[-1] > 2 * masses[0]
    np.testing.assert_allclose(spread, 1.0, atol=0.15)


def test_a_random_arm_is_seen_with_the_noise_that_was_drawn():
    batch, ratios = native("random", 200, dtype="float64"), []
    for seed in range(2):
        seen, info = batch.reset(seed=1000 * seed)
        off = np.linalg.norm(seen[:, :3] - info["goal"], axis=1)
        ratios.append(np.median(off / info["drawn_noise"]))
        low = info["drawn_noise"] < 4e-4
        assert np.median(off[low]) < 0.6 * np.median(off[~low])
    np.testing.assert_allclose(ratios, 1.0, atol=0.15)


@pytest.mark.parametrize("case", ["multi", "button", "moving", "obstacles", "real"])
def test_a_state_has_what_was_drawn(case):
    one, other = single(case), single(case)
    one.reset(seed=1)
    other.reset(seed=2)
    one.step(action_of(one))
    state = one.unwrapped.save_state()
    other.unwrapped.restore_state(state)
    copied = copy.deepcopy(one)
    for number in range(1, 4):
        action = action_of(one, number)
        steps = [env.step(action) for env in (one, other, copied)]
        for step in steps[1:]:
            np.testing.assert_array_equal(step[0], steps[0][0])
            np.testing.assert_equal(drawn(step[4]), drawn(steps[0][4]))
    resets = [env.reset() for env in (one.unwrapped, other.unwrapped, copied.unwrapped)]
    for observation, info in resets[1:]:
        np.testing.assert_array_equal(observation, resets[0][0])
        np.testing.assert_equal(drawn(info), drawn(resets[0][1]))


@pytest.mark.parametrize(
    ("case", "options", "error", "words"),
    [
        ("multi", {"randomise": {"mass": (0, 1)}}, UnknownNameError, "available: camera, damping, enc"),
        ("button", {"randomise": {"camera": (0, 0.01)}}, UnknownNameError, "damping, friction, gears, payload$"),
        ("push", {"randomise": {"camera": (0, 0.01)}}, UnknownNameError, "available: damping, encoder_noise, friction"),
        ("multi", {"randomise": (0, 1)}, InputError, "must be a mapping of payload"),
        ("multi", {"randomise": {"payload": 0.5}}, InputError, r"randomise\['payload'\], its least and largest value,"),
        ("multi", {"randomise": {"payload": (0.5, 0.1)}}, InputError, "least value first"),
        ("multi", {"randomise": {"friction": (0.0, 2.0)}}, InputError, r"randomise\['friction'\] .*2"),
        ("lift", {"randomise": {"gears": (0.0, 1.0)}}, InputError, r"randomise\['gears'\] .*0.1"),
        ("multi", {"randomise": {"payload": (0, float("nan"))}}, InputError, "payload"),
        ("multi", {"randomise": {"payload": (0, 1)}, "backend": "kinematic"}, InputError, 'use backend="mujoco"'),
        ("lift", {"randomise": {"gears": (1, 1)}, "backend": "kinematic"}, InputError, "of the dynamics"),
        ("multi", {"randomise": {"camera": (0, 0.01)}, "observation": "pixels"}, InputError, "pixels"),
        ("moving", {"randomise": {"payload": (0, 1)}}, InputError, "no masses or torques; available: delay, noise, st"),
        ("random", {"randomise": {"gears": (1, 1)}}, InputError, "has no masses or torques; available: noise$"),
        ("real", {"randomise": {"friction": (0, 1)}}, InputError, "no masses or torques; available: noise, payload$"),
        ("real", {"randomise": {"payload": (0, 9)}}, InputError, r"randomise\['payload'\] .*at most 5, got 9"),
        ("multi", {"randomise": {"camera": (0, 0.11)}}, InputError, r"randomise\['camera'\] .*at most 0\.1, got 0\.11"),
        ("multi", {"randomise": {"camera": (-0.11, 0)}}, InputError, r"camera'\] .*at least -0\.1 and .*, got -0\.11"),
        ("real", {"randomise": {"delay": (0, 1)}}, UnknownNameError, "available: noise, payload$"),
        ("moving", {"randomise": {"strength": (0.0, 1)}}, InputError, r"randomise\['strength'\] .*0.1"),
        ("obstacles", {"boxes": False}, InputError, "use boxes=True"),
    ],
)  # fmt: skip
def test_what_cannot_be_drawn_is_refused(case, options, error, words):
    with pytest.raises(error, match=words):
        single(case, **options)
    with pytest.raises(error, match=words):
        native(case, 2, **options)


def test_warp_has_one_model_for_all():
    with pytest.raises(InputError, match="use backend=\"mujoco\", got 'warp'"):
        native("multi", 2, backend="warp")


def test_the_model_of_an_environment_without_it_has_no_payload():
    model = single("multi", randomise=None).unwrapped.model
    assert "payload" not in [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, i) for i in range(model.nbody)]
