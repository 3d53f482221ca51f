"""A simulation that blows up ends the episode as impossible, says so, and leaves nothing of itself behind."""

import os
import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest

import kinreach  # noqa: F401 (registers the environments)
from kinreach.sim import ArmSimulation, BatchSimulation
from kinreach.sim._setpoints import ARRIVED
from kinreach.sim.inside import MoveStatus
from tests.cases import slow

SPEEDS = [np.nan, np.inf, -np.inf, 1e5, 1e8, 1e12]
GOAL = (0.45, 0.05, -0.175)


#: What a fresh process runs: moves that diverge, alone and in native threads, in which it counts them.
DIVERGING = """
import numpy as np
from kinreach.sim._simulation import BatchSimulation
from kinreach.sim._simulation import ArmSimulation
arm, batch = ArmSimulation("ur5-thesis"), BatchSimulation("ur5-thesis", 4, threads=2)
arm._plant.qvel[0], batch._plant.qvel[:] = 1e12, np.nan
moves = [arm.move(arm.arm.home), *batch.move(np.arange(4), np.tile(batch.arm.home, (4, 1)))]
print([move.reason.split(":")[0] for move in moves].count("diverged"))
"""
OWN_LOG = """
import mujoco
settings = mujoco.MjLogConfig.get()
settings.logfile, settings.logto_file = "own.txt", True
settings.set()
"""


def blow_up(plant, row, speed):
    plant.qvel[row] = speed


@pytest.mark.parametrize(("before", "after", "written"), [
    ("", "", []), *slow((OWN_LOG, "", ["own.txt"]), ("import kinreach.sim._engine", OWN_LOG, ["own.txt"])),
])  # fmt: skip
def test_a_move_that_diverges_writes_no_file_but_the_log_that_was_asked_for(before, after, written, tmp_path):
    code = "\n".join([before, after, DIVERGING])
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=600
    )
    assert (done.returncode, done.stdout) == (0, "5\n"), done.stderr
    assert "unstable" in done.stderr  # MuJoCo's warnings are not lost
    assert [path.name for path in tmp_path.iterdir()] == written


@pytest.mark.parametrize("speed", SPEEDS)
@pytest.mark.parametrize("arm", ["ur5-thesis", "arm3"])
def test_a_move_that_diverges_is_impossible_and_puts_the_arm_back(arm, speed):
    simulation, sound = ArmSimulation(arm), ArmSimulation(arm)
    target = np.array(simulation.arm.home) + 0.2
    for each in (simulation, sound):
        each.place_ball(GOAL)
        assert each.move(target).reached
    before, time = simulation.q, simulation.data.time
    blow_up(simulation._plant, 0, speed)
    move = simulation.move(simulation.arm.home)
    assert move.status is MoveStatus.DIVERGED
    assert not move.reached
    assert move.reason.startswith("diverged")
    assert move.duration == 0.0
    np.testing.assert_array_equal(move.q, before)
    np.testing.assert_array_equal(simulation.q, before)
    np.testing.assert_array_equal(simulation.ball_position, GOAL)
    assert simulation.data.time == time
    assert simulation.move(simulation.arm.home).reached  # it can go on


@pytest.mark.parametrize("beyond", [-0.51, -0.49, 0.49, 0.51])
@pytest.mark.parametrize("joint", range(6))
def test_one_joint_far_beyond_its_limit_is_enough(joint, beyond, monkeypatch):
    simulation = ArmSimulation("ur5-thesis")
    controller, before = simulation.controller, simulation.q
    limit = (controller.lower if beyond < 0.0 else controller.upper)[joint]

    def follow(plant, ids, targets, **_):
        plant.qpos[0, controller.qpos][joint] = limit + beyond  # the joints are a slice of the state
        return np.full(len(ids), ARRIVED)

    monkeypatch.setattr(controller, "_follow", follow)
    move = simulation.move(before)
    assert (move.status is MoveStatus.DIVERGED) == (abs(beyond) > 0.5)
    np.testing.assert_array_equal(move.q == before, np.arange(6) != (joint if abs(beyond) < 0.5 else -1))


def test_in_a_batch_the_neighbours_notice_nothing():
    count, lost = 6, [1, 4]
    rng = np.random.default_rng(0)
    batch, untouched = BatchSimulation("ur5-thesis", count), BatchSimulation("ur5-thesis", count)
    everyone = np.arange(count)
    there, targets = np.array(batch.arm.home) + rng.uniform(-0.3, 0.3, (2, count, 6))
    for each in (batch, untouched):
        each.place_ball(everyone, GOAL)
        each.move(everyone, there)
    before = batch.q
    for speed, row in zip((np.nan, 1e9), lost, strict=True):
        blow_up(batch._plant, row, speed)
    moves, expected = batch.move(everyone, targets), untouched.move(everyone, targets)
    assert [move.status is MoveStatus.DIVERGED for move in moves] == [row in lost for row in everyone]
    for row in everyone:
        if row in lost:
            np.testing.assert_array_equal(moves[row].q, before[row])
            continue
        assert (moves[row].status, moves[row].duration) == (expected[row].status, expected[row].duration)
        np.testing.assert_array_equal(moves[row].q, expected[row].q)
    np.testing.assert_array_equal(batch.ball_positions, np.tile(GOAL, (count, 1)))
    for move in batch.move(np.array(lost), targets[lost]):
        assert move.status is not MoveStatus.DIVERGED


@pytest.mark.parametrize("name", ["UR5SingleStep", "UR5MultiStep"])
@pytest.mark.parametrize("speed", SPEEDS)
def test_reaching_ends_as_impossible_with_the_reason(name, speed):
    env = gym.make(f"kinreach/{name}-v0", backend="mujoco").unwrapped
    env.reset(seed=0)
    env.step(np.zeros(6))
    q = env._simulation.q
    blow_up(env._simulation._plant, 0, speed)
    observation, reward, terminated, truncated, info = env.step(np.zeros(6))
    assert (terminated, truncated) == ((True, False) if name == "UR5SingleStep" else (False, True))
    assert info["impossible"]
    assert not info["reached"]
    assert info["impossible_reason"].startswith("diverged")
    assert reward == -100.0
    assert env.observation_space.contains(observation)
    np.testing.assert_array_equal(env._simulation.q, q)
    env.reset(seed=0)
    fresh = gym.make(f"kinreach/{name}-v0", backend="mujoco").unwrapped
    fresh.reset(seed=0)
    np.testing.assert_array_equal(env.step(np.full(6, 0.1))[0], fresh.step(np.full(6, 0.1))[0])


def test_one_diverged_arm_of_a_batch_that_reaches():
    def make():
        env = gym.make_vec(
            "kinreach/UR5MultiStep-v0", num_envs=4, vectorization_mode="vector_entry_point", backend="mujoco"
        )
        env.reset(seed=0)
        return env

    batch, untouched = make(), make()
    blow_up(batch.unwrapped.episodes.world._batch._plant, 2, np.nan)
    actions = np.full((4, 6), 0.5)
    observations, rewards, terminated, truncated, info = batch.step(actions)
    assert truncated.tolist() == info["impossible"].tolist() == [False, False, True, False]
    assert [reason.split(":")[0] for reason in info["impossible_reason"]] == ["", "", "diverged", ""]
    assert not terminated.any()
    assert rewards[2] == -100.0
    assert batch.observation_space.contains(observations)
    expected = untouched.step(actions)[0]
    np.testing.assert_array_equal(observations[[0, 1, 3]], expected[[0, 1, 3]])


@pytest.mark.parametrize("actuation", ["tuned", "report"])
def test_pressing_ends_as_impossible_with_the_reason(actuation):
    env = gym.make("kinreach/ButtonPress-v0", actuation=actuation).unwrapped
    batch = gym.make_vec(
        "kinreach/ButtonPress-v0", num_envs=3, vectorization_mode="vector_entry_point", actuation=actuation
    )
    env.reset(seed=0)
    batch.reset(seed=0)
    assert env.step(13)[4]["impossible_reason"] == ""
    cases = 0
    for speed in SPEEDS:
        env.reset(seed=0)
        batch.reset(seed=0)
        env._world.qd[0, 1] = batch.unwrapped.episodes.world.qd[1, 1] = speed
        *_, truncated, info = env.step(13)
        assert truncated
        assert info["impossible"]
        assert info["impossible_reason"].startswith("diverged")
        reasons = batch.step(np.full(3, 13))[4]["impossible_reason"]
        assert reasons.tolist() == ["", info["impossible_reason"], ""]
        cases += 1
    assert cases == len(SPEEDS)
