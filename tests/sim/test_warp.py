"""MuJoCo Warp on its CPU device: the moves, verdicts and observations of MuJoCo itself, to single precision."""

import sys

import gymnasium as gym
import numpy as np
import pytest

from kinreach.baselines.inside import PickAndPlaceScript
from kinreach.cli import main
from kinreach.compare import get_task
from kinreach.errors import InputError, InstallationError, UnknownNameError
from kinreach.kinematics import URKinematics
from kinreach.sim import BatchSimulation
from tests.machine import compile_kernels_quickly

COUNT = 12
#: The first run compiles Warp's kernels, some 50 s of processor time; they are kept in Warp's cache.
pytestmark = pytest.mark.slow
compile_kernels_quickly()


@pytest.fixture(scope="module")
def targets():
    """Postures at goals, and every other one some 15 degrees off: something is in the way of some of these."""
    kinematics, arm = URKinematics("ur5-thesis", tip="tcp", base="world"), BatchSimulation("ur5-thesis", 1).arm
    rng, home = np.random.default_rng(1), np.array(arm.home)
    found = np.array([kinematics.axis_goal(goal, (0, 0, -1), home).q for goal in arm.workcell.goals.sample(rng, COUNT)])
    found[1::2] += rng.normal(0.0, 0.25, (COUNT // 2, 6))
    return np.clip(found, kinematics.lower, kinematics.upper)


@pytest.fixture(scope="module")
def moved(targets):
    """What became of the moves, by backend."""
    everyone = np.arange(COUNT)
    return {
        backend: BatchSimulation("ur5-thesis", COUNT, backend=backend, device=device).move(everyone, targets)
        for backend, device in (("mujoco", None), ("warp", "cpu"))
    }


def test_verdicts_are_the_same(moved):
    said = {backend: [(move.status, move.reason) for move in moves] for backend, moves in moved.items()}
    assert said["warp"] == said["mujoco"]
    assert 2 <= sum(move.reached for move in moved["warp"]) <= COUNT - 2


def test_free_moves_end_in_the_same_place(moved):
    pairs = [(ours, theirs) for ours, theirs in zip(*moved.values(), strict=True) if ours.reached]
    assert len(pairs) >= COUNT // 2
    assert max(np.abs(ours.q - theirs.q).max() for ours, theirs in pairs) <= 1e-6
    for ours, theirs in pairs:
        assert theirs.duration == pytest.approx(ours.duration, abs=1e-9)


def test_the_others_stand_still_and_repeats_are_the_same(targets):
    ends = []
    for _ in range(2):
        batch = BatchSimulation("ur5-thesis", 3, backend="warp", device="cpu")
        batch.place_ball([2], [0.4, 0.1, -0.1])
        before = batch.q
        (move,) = batch.move([1], targets[:1])
        assert move.reached
        np.testing.assert_array_equal(batch.q[[0, 2]], before[[0, 2]])
        np.testing.assert_array_equal(batch.ball_positions[2], [0.4, 0.1, -0.1])
        ends.append(move.q)
    np.testing.assert_array_equal(*ends)


def test_environments_observe_and_reward_the_same():
    found = {}
    for backend in ("mujoco", "warp"):
        envs = gym.make_vec(
            "kinreach/UR5SingleStep-v0", num_envs=4, vectorization_mode="vector_entry_point", backend=backend
        )
        envs.reset(seed=3)
        actions = np.random.default_rng(5).uniform(-0.4, 0.4, (4, 6))
        _, reward, terminated, truncated, info = envs.step(actions)
        found[backend] = reward, terminated, truncated, info["impossible"], info["final_obs"]
        envs.close()
    for ours, theirs in zip(*found.values(), strict=True):
        np.testing.assert_allclose(np.array(theirs, dtype=float), np.array(ours, dtype=float), atol=1e-4)


def test_rewards_are_computed_on_the_device():
    torch = pytest.importorskip("torch")
    given = {}
    for device in (None, "cpu"):
        envs = gym.make_vec(
            "kinreach/UR5SingleStep-v0",
            num_envs=4,
            vectorization_mode="vector_entry_point",
            backend="warp",
            device=device,
        )
        envs.reset(seed=3)
        actions = np.random.default_rng(5).uniform(-0.4, 0.4, (4, 6))
        given[device] = envs.step(actions if device is None else torch.tensor(actions))
        envs.close()
    for ours, theirs in zip(given["cpu"][:4], given[None][:4], strict=True):
        assert isinstance(ours, torch.Tensor)
        assert ours.device.type == "cpu"
        np.testing.assert_allclose(ours.numpy(), theirs, rtol=0, atol=1e-9)
    for name in ("tip", "distance", "posture_error", "reward_distance", "final_obs"):
        np.testing.assert_allclose(given["cpu"][4][name].numpy(), given[None][4][name], rtol=0, atol=1e-9)


def test_what_cannot_be(monkeypatch, capsys):
    with pytest.raises(InputError, match=r"no device 'cuda:7' here: .*available: .*cpu"):
        BatchSimulation("ur5-thesis", 2, backend="warp", device="cuda:7")
    with pytest.raises(InputError, match="is of native batches"):
        gym.make("kinreach/UR5SingleStep-v0", backend="warp")
    with pytest.raises(UnknownNameError, match="unknown backend 'brax'"):
        BatchSimulation("ur5-thesis", 2, backend="brax")
    monkeypatch.setitem(sys.modules, "mujoco_warp", None)
    with pytest.raises(InstallationError, match=r"pip install 'kinreach\[warp\]'"):
        BatchSimulation("ur5-thesis", 2, backend="warp")
    assert main(["evaluate", "ranked-single", "--backend", "warp", "--goals", "2"]) == 2
    assert capsys.readouterr().err.strip().endswith("pip install 'kinreach[warp]'")


def test_a_script_picks_and_places_in_the_same_steps():
    found, script = {}, PickAndPlaceScript(gym.make("kinreach/PickAndPlace-v0"))
    for backend in ("mujoco", "warp"):
        envs = gym.make_vec("kinreach/PickAndPlace-v0", 2, vectorization_mode="vector_entry_point", backend=backend)
        rows, told, ended = envs.reset(seed=0)[0], [], np.zeros(2, dtype=bool)
        while not ended.all():
            rows, _, terminated, truncated, info = envs.step(script.act(rows))
            last = info.get("final_info", info)
            told.append((last["q"], last["gripped"], terminated & ~ended))
            ended |= terminated | truncated
        envs.close()
        found[backend] = [np.array(each) for each in zip(*told, strict=True)]
    (ours, held, successes), (theirs, *others) = found["mujoco"], found["warp"]
    assert successes.sum() == 2
    for mine, other in zip((held, successes), others, strict=True):
        np.testing.assert_array_equal(mine, other)
    before = ~np.maximum.accumulate(held, axis=0)
    assert 40 < before.sum() < before.size - 4
    assert np.abs(ours - theirs)[before].max() <= 1e-5
    assert np.abs(ours - theirs)[: int(successes[:, 0].argmax())].max() <= 1e-3


def test_cubes_of_their_own_size_mass_and_friction_are_lifted():
    options = {"shapes": ["cube"], "sizes": (0.015, 0.035), "masses": (0.02, 0.3), "frictions": (0.3, 1.5)}
    grasp = get_task("lift").methods["closed-form"].make(gym.make("kinreach/Lift-v0", **options))
    found = {}
    for backend in ("mujoco", "warp"):
        envs = gym.make_vec(
            "kinreach/Lift-v0", 3, vectorization_mode="vector_entry_point", backend=backend, clutter=True, **options
        )
        rows, _ = envs.reset(seed=0)
        found[backend] = info = envs.step(np.array([grasp.act(row) for row in rows]))[4]["final_info"]
        assert info["is_success"].all()
        envs.close()
    for name, tolerance in (("q", 1e-5), ("position", 1e-4), ("opening", 1e-5), ("move_s", 1e-9)):
        np.testing.assert_allclose(found["warp"][name], found["mujoco"][name], rtol=0, atol=tolerance, err_msg=name)
