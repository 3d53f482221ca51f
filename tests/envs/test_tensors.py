"""Batches that speak torch: the numbers are those of the same batch in numpy, whoever computed them."""

import sys

import gymnasium as gym
import numpy as np
import pytest

from kinreach._checks import is_tensor
from kinreach._tensors import on_device, on_host
from kinreach.envs._reach.episodes import ReachEpisodes
from kinreach.envs._reach.reach_task import MULTI_STEP, SINGLE_STEP, ReachOptions, ReachTask
from kinreach.envs._reach.rewards import DirectedReward, DistanceReward, ThesisReward
from kinreach.envs._reach.worlds import BatchDynamicWorld
from kinreach.envs.inside import SpaceTask
from kinreach.errors import InputError, InstallationError
from kinreach.thesis import pentagon_angles, reach_reward

torch = pytest.importorskip("torch")

DEVICES = ["cpu", pytest.param("cuda", marks=pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU"))]
TASKS = {
    "single": ("kinreach/UR5SingleStep-v0", {"backend": "kinematic"}),
    "multi": ("kinreach/UR5MultiStep-v0", {"backend": "kinematic", "info": "numbers"}),
    "dynamics": ("kinreach/UR5SingleStep-v0", {}),
    "space": ("kinreach/Reach-v0", {"backend": "kinematic", "tilt": 30.0, "start_spread": 0.3}),
    "button": ("kinreach/ButtonPress-v0", {"max_episode_steps": 7}),
    "lift": ("kinreach/Lift-v0", {"backend": "kinematic"}),
    "real arm": ("kinreach/RealArm-v0", {"balls": 2, "budgets": (0,), "again": 0}),
    "obstacles": ("kinreach/Obstacles-v0", {"clutter": (0,), "max_episode_steps": 1}),
}
COUNT = 5


def batch(task, **options):
    name, own = TASKS[task]
    return gym.make_vec(name, num_envs=COUNT, vectorization_mode="vector_entry_point", **own, **options)


def same(given, wanted):
    """How many tensors there are, each with the numbers of the array in its place."""
    if isinstance(wanted, dict):
        assert set(given) == set(wanted)
        return sum(same(given[name], wanted[name]) for name in wanted)
    if isinstance(wanted, tuple):
        return sum(same(one, other) for one, other in zip(given, wanted, strict=True))
    text = wanted.dtype == object
    assert isinstance(given, np.ndarray if text else torch.Tensor)
    np.testing.assert_array_equal(given if text else given.cpu().numpy(), wanted)
    return not text


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("mode", ["SameStep", "NextStep"])
@pytest.mark.parametrize("task", TASKS)
@pytest.mark.slow
def test_tensors_are_the_arrays(task, mode, device):
    ours, theirs = batch(task, autoreset_mode=mode, device=device), batch(task, autoreset_mode=mode)
    compared, ends = same(ours.reset(seed=4), theirs.reset(seed=4)), 0
    ours.action_space.seed(1)
    for _ in range(9 if task == "button" else 3):
        action = ours.action_space.sample()
        given = ours.step(torch.tensor(action, device=device))
        compared += same(given, theirs.step(action))
        ends += int((given[2] | given[3]).sum())
    assert {value.device.type for value in given[:4]} == {device}
    assert compared >= 4 * 10
    assert ends >= (0 if task == "multi" else COUNT)


def test_on_the_processor_memory_is_shared():
    values = np.arange(6.0).reshape(2, 3)
    given = on_device({"values": values, "text": np.array(["a"], dtype=object)}, torch.device("cpu"))
    values[1, 2] = 7.0
    assert given["values"][1, 2] == 7.0
    assert given["text"].tolist() == ["a"]


def steps(count):
    """Distances, postures and truth values, special cases among them."""
    rng = np.random.default_rng(0)
    distance = np.where(rng.random(count) < 0.3, rng.uniform(0.0, 0.012, count), rng.uniform(0.0, 3.0, count))
    q = rng.uniform(-np.pi, np.pi, (count, 6))
    natural = rng.random(count) < 0.4
    q[natural] = [-1.5, -1.0, 1.6, -2.17, -np.pi / 2, 0.0]
    q[:, [0, 2]] *= rng.random((count, 2)) > 0.05  # straight arms, and those that point ahead
    return distance, q, rng.random(count) < 0.1


@pytest.mark.parametrize("device", DEVICES)
def test_rewards_are_those_of_numpy(device):
    arrays = steps(4000)
    tensors = [torch.tensor(array, device=device) for array in arrays]
    angle = np.random.default_rng(1).uniform(0.0, 0.3, 4000)
    worth = []
    for scorer, more in ((ThesisReward(), ()), (DistanceReward(0.01), ()), (DirectedReward(0.01), (angle,))):
        ours = scorer.score(*tensors, *(torch.tensor(each, device=device) for each in more))
        theirs = scorer.score(*arrays, *more)
        for name, term in {"reward": theirs.reward, "posture": theirs.posture_error, **theirs.terms}.items():
            mine = {"reward": ours.reward, "posture": ours.posture_error, **ours.terms}[name]
            assert (mine.dtype, mine.device.type) == (torch.float64, device)
            np.testing.assert_allclose(mine.cpu().numpy(), term, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(ours.reached.cpu().numpy(), theirs.reached)
        worth.append(int(theirs.reached.sum()))
    assert min(worth) >= 100


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("name", ["single", "multi"])
@pytest.mark.parametrize("reward", [None, lambda distance, q, impossible: (-distance, {"distance": -distance})])
def test_episodes_compute_with_what_their_world_gives(name, reward, device):
    variant = {"single": SINGLE_STEP, "multi": MULTI_STEP}[name]
    task = ReachTask(ReachOptions(reward=reward), variant)
    acting, everyone = np.array([True, True, False, True]), np.arange(4)
    actions = np.random.default_rng(2).uniform(-0.4, 0.4, (4, 6))
    found = []
    for where in (None, device):
        episodes = ReachEpisodes(task, BatchDynamicWorld(task.arm, 4, device=where))
        for index in everyone:
            episodes.seed(index, np.random.default_rng(index))
        episodes.begin(everyone)
        start, outcome = episodes.start_info(everyone), episodes.step(actions, acting)
        assert isinstance(start["distance"], np.ndarray if where is None else torch.Tensor)
        ended = (outcome.terminated, outcome.truncated)
        assert all(isinstance(flags, np.ndarray) for flags in ended)
        numbers = [start["distance"], start["posture_error"], outcome.reward, outcome.info["tip"], *ended]
        found.append([np.array(on_host(values), dtype=float) for values in numbers])
    for theirs, ours in zip(*found, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9)
    assert found[0][2][2] == 0.0
    assert np.unique(found[0][2]).size >= 3


def test_angles_of_tools_and_pentagons_are_those_of_numpy():
    _, q, _ = steps(1000)
    tensor, down = torch.tensor(q), np.tile([0.0, 0.6, -0.8], (1000, 1))
    for mine, theirs in zip(pentagon_angles(tensor), pentagon_angles(q), strict=True):
        np.testing.assert_allclose(mine.numpy(), theirs, rtol=0, atol=1e-12)
    task = SpaceTask.of({"backend": "kinematic"})
    theirs = task.posture_error(q, down)
    np.testing.assert_allclose(task.posture_error(tensor, torch.tensor(down)).numpy(), theirs, rtol=0, atol=1e-12)


def test_a_tensor_among_arrays_makes_tensors():
    distance, q, impossible = steps(50)
    wanted = reach_reward(distance, q, impossible=impossible).reward
    for given in ((torch.tensor(distance), q), (distance, torch.tensor(q))):
        found = reach_reward(*given, impossible=impossible).reward
        np.testing.assert_allclose(found.numpy(), wanted, rtol=0, atol=1e-12)
    assert reach_reward(0.005, torch.tensor(q[0], dtype=torch.float32)).reward.dtype == torch.float32
    with pytest.raises(InputError, match="leading shapes do not fit"):
        reach_reward(torch.zeros(3), torch.zeros(2, 6))
    with pytest.raises(InputError, match=r"d must be a tensor of floating-point numbers, got torch\.int64"):
        reach_reward(torch.zeros(3, dtype=torch.int64), torch.zeros(3, 6))


def test_what_cannot_be(monkeypatch):
    for device in ("nonsense", "meta", 7) + (() if torch.cuda.is_available() else ("cuda",)):
        with pytest.raises(InputError, match=rf"torch has no device '?{device}'? here: \w+"):
            batch("single", device=device)
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(InstallationError, match=r"pip install 'kinreach\[train\]'"):
        batch("single", device="cpu")


@pytest.mark.parametrize("count", [1, 64])
@pytest.mark.parametrize("task", ["single", "space"])
def test_a_step_asks_seldom_whether_it_has_tensors(task, count):
    """At its boundaries: formulas get the library that they compute with."""
    name, options = TASKS[task]
    env = gym.make(name, **options) if count == 1 else gym.make_vec(name, count, "vector_entry_point", **options)
    env = env.unwrapped
    asked = []

    def profile(frame, event, _):
        if event == "call" and frame.f_code is is_tensor.__code__:
            asked.append(frame.f_back.f_code.co_qualname)

    env.reset(seed=0)
    action = np.zeros(env.action_space.shape)
    env.step(action)
    sys.setprofile(profile)
    try:
        env.step(action)
    finally:
        sys.setprofile(None)
    assert 1 <= len(asked) <= 16, asked
