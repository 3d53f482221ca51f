"""Native batches as Gymnasium's users have them: when episodes start anew, Gymnasium's wrappers, pictures."""

from itertools import product

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import vector as wrappers

import kinreach  # noqa: F401 (registers the environments)
from kinreach.envs.inside import Outcome
from kinreach.errors import InputError
from tests.cases import slow

SINGLE, MULTI, BUTTON = "kinreach/UR5SingleStep-v0", "kinreach/UR5MultiStep-v0", "kinreach/ButtonPress-v0"
TASKS = {
    "single": (SINGLE, {"backend": "kinematic"}),
    "multi": (MULTI, {"backend": "kinematic"}),
    "single, dynamics": (SINGLE, {}),
    "multi, dynamics": (MULTI, {}),
    "button": (BUTTON, {"max_episode_steps": 7}),
}
OTHERS = {
    "space": ("kinreach/Reach-v0", {"backend": "kinematic", "tilt": 30.0}),
    "moving": ("kinreach/Moving-v0", {}),
    "random arm": ("kinreach/RandomArm-v0", {}),
    "lift": ("kinreach/Lift-v0", {"attempts": 2}),
}
COUNT = 3


def batch(task, count=COUNT, **options):
    name, own = (TASKS | OTHERS)[task]
    return gym.make_vec(name, num_envs=count, vectorization_mode="vector_entry_point", **own, **options)


def singles(task, mode):
    name, own = (TASKS | OTHERS)[task]
    return SyncVectorEnv([lambda: gym.make(name, **own)] * COUNT, autoreset_mode=mode)


def actions(task, env, steps):
    """Random actions; in the multi-step task environment 0 starts at its goal, and reaches it by standing still."""
    env.action_space.seed(0)
    for _ in range(steps):
        drawn = env.action_space.sample()
        yield 0.0 * drawn if task.startswith("multi") else drawn


def near_goals(task):
    """Options of a reset with which the episode of environment 0 of the multi-step task ends with the first step."""
    if not task.startswith("multi"):
        return None
    kinematics = gym.make(MULTI, backend="kinematic").unwrapped.kinematics
    q = np.tile([-1.8, -1.0, 1.9, -2.47, -np.pi / 2, 0.0], (COUNT, 1))
    return {"q": q, "goal": kinematics.positions(q) + np.diag([0.0, 0.1, 0.1])}


@pytest.mark.parametrize("task", TASKS)
def test_next_step_is_what_gymnasium_does_with_single_environments(task):
    native, sync = batch(task, autoreset_mode="NextStep"), singles(task, AutoresetMode.NEXT_STEP)
    assert native.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    options = near_goals(task)
    np.testing.assert_array_equal(native.reset(seed=3)[0], sync.reset(seed=3)[0])
    if options is not None:
        native.reset(options=options)
        for index, env in enumerate(sync.envs):
            env.reset(options={name: rows[index] for name, rows in options.items()})
    restarts = 0
    ended = np.zeros(COUNT, dtype=bool)
    for action in actions(task, native, 20 if task == "button" else 5):
        ours, theirs = native.step(action), sync.step(action)
        for one, other in zip(ours[:4], theirs[:4], strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-10)
        np.testing.assert_array_equal(ours[4]["goal"], theirs[4]["goal"])
        np.testing.assert_allclose(sum(ours[4]["reward_terms"].values()), ours[1], rtol=0, atol=1e-12)
        assert not ours[4]["reached"][ended].any()
        assert (ours[1][ended] == 0.0).all()
        restarts += ended.sum()
        ended = ours[2] | ours[3]
    assert restarts >= 1


def test_who_did_not_act_earns_nothing_and_does_not_end():
    yes, half = np.ones(2, dtype=bool), np.array([True, False])
    outcome = Outcome(np.array([2.0, 3.0]), yes, yes, {}).of(half)
    for flags in (outcome.terminated, outcome.truncated):
        np.testing.assert_array_equal(flags, half)
    np.testing.assert_array_equal(outcome.reward, [2.0, 0.0])


@pytest.mark.parametrize("task", ["single", "multi", "button", "space", "moving", "random arm", "lift"])
@pytest.mark.slow
def test_with_next_step_the_info_of_a_restart_is_that_of_a_reset(task):
    """As in Gymnasium's own batches."""
    native, sync = batch(task, autoreset_mode="NextStep"), singles(task, AutoresetMode.NEXT_STEP)
    native.reset(seed=3)
    sync.reset(seed=3)
    native.action_space.seed(0)
    compared, over = 0, np.zeros(COUNT, dtype=bool)
    for _ in range({"multi": 110, "moving": 110, "lift": 8}.get(task, 20)):
        action = native.action_space.sample()
        begun = over
        _, _, terminated, truncated, told = native.step(action)
        said = sync.step(action)[4]
        over = terminated | truncated
        for name in {name for name in told if not name.startswith("_")} if begun.any() else ():
            if name != "reward_terms":
                one, other = told[name][begun], said[name][begun]
                if one.dtype == object:
                    assert (one == other).all(), name
                else:
                    np.testing.assert_allclose(one, other, rtol=0, atol=1e-9, err_msg=name)
                compared += 1
    assert compared >= 6


def masks_of(info):
    """The masks of an `info`, by name, those of `final_info` too."""
    inner = info.get("final_info", {})
    return {**{name: info[name] for name in info if name.startswith("_")},
            **{f"final_info.{name}": inner[name] for name in inner if name.startswith("_")}}  # fmt: skip


@pytest.mark.parametrize(
    ("task", "mode"),
    [
        *product(("single", "multi", "button", "space"), AutoresetMode),
        *product(("single, dynamics", "random arm", "lift"), [AutoresetMode.NEXT_STEP]),
        *slow(
            *product(("multi, dynamics", "moving"), AutoresetMode),
            *product(("single, dynamics", "random arm", "lift"), [AutoresetMode.SAME_STEP, AutoresetMode.DISABLED]),
        ),
    ],
)
def test_masks_say_which_environments_an_entry_is_of_as_gymnasiums_do(task, mode):
    native, sync = batch(task, autoreset_mode=mode), singles(task, mode)
    told = [native.reset(seed=3)[1], sync.reset(seed=3)[1]]
    compared = ends = 0
    over = np.zeros(COUNT, dtype=bool)
    native.action_space.seed(0)
    for step in range(101 if task == "moving" else 9):
        ours, theirs = (masks_of(info) for info in told)
        left_out = {f"{part}_target_tip" for part in ("", "final_info.")}  # kinematic batches have none
        assert set(theirs) - left_out <= set(ours)
        for name, mask in ours.items():
            assert mask.shape == (COUNT,)
            assert mask.dtype == np.bool_
            # Where no environment has it, Gymnasium has no entry; a batch of ours may have one without a True value.
            np.testing.assert_array_equal(mask, theirs.get(name, np.zeros(COUNT, dtype=bool)), err_msg=name)
            compared += 1
        for info in (told[0], told[0].get("final_info", {})):
            entries = {name for name in info if not name.startswith("_")}
            assert entries == {name[1:] for name in info if name.startswith("_")}
        if mode is AutoresetMode.DISABLED and over.any():
            told = [env.reset(seed=20 + step, options={"reset_mask": over})[1] for env in (native, sync)]
            over = np.zeros(COUNT, dtype=bool)
            continue
        action = native.action_space.sample()
        _, _, terminated, truncated, info = native.step(action)
        told = [info, sync.step(action)[4]]
        over = terminated | truncated
        ends += over.sum()
    assert compared >= 12 * 3
    assert ends > 0 or task.startswith("multi")


@pytest.mark.parametrize("device", [None, "cpu"])
def test_masks_on_a_device_are_tensors(device):
    if device is not None:
        torch = pytest.importorskip("torch")
    env = batch("single", device=device)
    told = [env.reset(seed=0)[1], env.step(np.zeros((COUNT, 6)))[4]]
    kind = np.ndarray if device is None else torch.Tensor
    assert all(isinstance(mask, kind) for info in told for mask in masks_of(info).values())
    assert len(masks_of(told[1])) > 40


@pytest.mark.parametrize("task", TASKS)
def test_disabled_restarts_those_that_the_mask_names(task):
    native = batch(task, autoreset_mode=AutoresetMode.DISABLED)
    options = near_goals(task)
    native.reset(seed=3)
    native.reset(options=options)
    for action in actions(task, native, 20):
        observation, _, terminated, truncated, info = native.step(action)
        ended = terminated | truncated
        if ended.any():
            break
    assert ended.any()
    with pytest.raises(InputError, match="have ended"):
        native.step(native.action_space.sample())
    before, goals = observation, info["goal"]
    observation, info = native.reset(options={"reset_mask": ended})
    np.testing.assert_array_equal(observation[~ended], before[~ended])
    np.testing.assert_array_equal(info["goal"][~ended], goals[~ended])
    assert (info["goal"][ended] != goals[ended]).any(axis=1).all()
    native.step(native.action_space.sample())


def test_a_reset_of_some_that_have_ended_leaves_the_others_ended():
    native = batch("single", autoreset_mode=AutoresetMode.DISABLED)
    native.reset(seed=3)
    assert native.step(native.action_space.sample())[2].all()
    native.reset(options={"reset_mask": np.array([True, False, True])})
    with pytest.raises(InputError, match=r"environments \[1\] have ended"):
        native.step(native.action_space.sample())


def test_a_masked_reset_takes_seeds_and_options_of_the_environments_that_it_restarts():
    native = batch("single", autoreset_mode=AutoresetMode.DISABLED)
    expected = batch("single").reset(seed=11)[1]["goal"]
    first = native.reset(seed=3)[1]["goal"]
    mask = np.array([False, True, False])
    goals = native.reset(seed=11, options={"reset_mask": mask})[1]["goal"]
    np.testing.assert_array_equal(goals, np.where(mask[:, None], expected, first))
    asked = np.array([[0.4, y, -0.175] for y in np.linspace(-0.1, 0.1, COUNT)])
    goals = native.reset(options={"reset_mask": mask, "goal": asked})[1]["goal"]
    np.testing.assert_array_equal(goals, np.where(mask[:, None], asked, first))


@pytest.mark.parametrize("mask", [np.zeros(COUNT, dtype=bool), np.ones(2, dtype=bool), "all", [0.5, 0, 1]])
def test_masks_that_mean_nothing_are_refused(mask):
    native = batch("single")
    native.reset(seed=0)
    with pytest.raises(InputError, match="reset_mask"):
        native.reset(options={"reset_mask": mask})


def test_a_mode_that_there_is_not_is_refused():
    with pytest.raises(InputError, match="autoreset_mode must be one of NextStep, SameStep, Disabled, got 'never'"):
        batch("single", autoreset_mode="never")


@pytest.mark.parametrize("task", TASKS)
def test_a_step_before_the_first_reset_is_refused(task):
    native = batch(task)
    with pytest.raises(InputError, match="reset the environment"):
        native.step(native.action_space.sample())
    with pytest.raises(InputError, match="reset all environments"):
        native.reset(options={"reset_mask": np.ones(COUNT, dtype=bool)})
    name, own = TASKS[task]
    single = gym.make(name, **own).unwrapped
    with pytest.raises(InputError, match="reset the environment"):
        single.step(single.action_space.sample())


@pytest.mark.parametrize("task", TASKS)
def test_a_refused_reset_changes_nothing(task):
    name, own = TASKS[task]
    goals = []
    for refused in (False, True):
        env, native = gym.make(name, **own).unwrapped, batch(task)
        for one in (env, native):
            one.reset(seed=0)
            if refused:
                with pytest.raises(InputError):
                    one.reset(seed=1, options={"gaol": [0.4, 0, -0.175]})
        goals.append(np.vstack([env.reset()[1]["goal"], native.reset()[1]["goal"]]))
    np.testing.assert_array_equal(*goals)


@pytest.mark.parametrize("task", ["single", "multi", "button"])
def test_gymnasiums_vector_wrappers(task):
    native = wrappers.NormalizeObservation(batch(task, autoreset_mode=AutoresetMode.NEXT_STEP))
    native = wrappers.FlattenObservation(native)
    native = wrappers.RecordEpisodeStatistics(native)
    native.reset(seed=0)
    lengths = []
    for _ in range(210 if task == "multi" else 20):
        observation, *_, info = native.step(native.action_space.sample())
        assert np.isfinite(observation).all()
        if "episode" in info:
            lengths += info["episode"]["l"][info["_episode"]].tolist()
    assert len(lengths) >= COUNT
    assert set(lengths) <= {"single": {1}, "multi": {100}, "button": {7}}[task]
    native.close()


@pytest.mark.filterwarnings("ignore:.*autoreset mode is same-step")
@pytest.mark.parametrize(
    ("task", "mode"),
    [
        ("single", AutoresetMode.SAME_STEP),
        ("multi, dynamics", AutoresetMode.SAME_STEP),
        ("button", AutoresetMode.NEXT_STEP),
    ],
)
@pytest.mark.slow
def test_batches_can_be_filmed(task, mode, tmp_path, films, needs_gl):
    native = wrappers.RecordVideo(
        batch(task, render_mode="rgb_array", autoreset_mode=mode), str(tmp_path / "films"), video_length=3
    )
    native.reset(seed=0)
    for _ in range(4):
        native.step(native.action_space.sample())
    native.close()
    frames = films[0]
    assert len(frames) >= (1 if (task, mode) == ("single", AutoresetMode.SAME_STEP) else 2)  # without the last of each
    height, width = 360, 640
    assert {frame.shape[0] * frame.shape[1] for frame in frames} == {COUNT * height * width}
    parts = [frame.reshape(-1, height, width, 3) for frame in frames if frame.shape[1] == width]
    assert all((a[0] != a[1]).any() for a in parts)  # each environment has its own ball


@pytest.mark.slow
def test_pictures_of_a_batch_are_those_of_single_environments(needs_gl):
    native = batch("single", render_mode="rgb_array")
    native.reset(seed=4)
    frames = native.render()
    assert len(frames) == COUNT
    for index, frame in enumerate(frames):
        env = gym.make(SINGLE, backend="kinematic", render_mode="rgb_array")
        env.reset(seed=4 + index)
        np.testing.assert_array_equal(env.render(), frame)
        env.close()
    native.close()
    native.close()
    assert batch("single").render() is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"render_mode": "human"}, "render_mode of a native batch"),
        ({"render_mode": "rgb_array", "count": 65}, "draws at most 64 environments, got 65"),
    ],
)
def test_pictures_that_a_batch_does_not_make(options, message):
    with pytest.raises(InputError, match=message):
        batch("single", **options)
    assert batch("single", count=64, render_mode="rgb_array").render_mode == "rgb_array"
