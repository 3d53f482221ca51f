"""An arm that is nothing but a URDF file moves: its servos' gains, damping and limits are derived from the file."""

from pathlib import Path

import example_robot_data
import gymnasium as gym
import numpy as np
import pytest

import kinreach  # noqa: F401 (registers the environments)
from kinreach.kinematics import ArmKinematics, CollisionChecker
from kinreach.robots import ArmDescription, BoxRegion, Workcell
from kinreach.sim import ArmSimulation, BatchSimulation

CELL = Workcell(goals=BoxRegion(x=(0.3, 0.5), y=(-0.2, 0.2), z=(0.1, 0.4)))


@pytest.fixture(scope="module")
def panda():
    robots = Path(example_robot_data.getModelPath("panda_description/urdf/panda.urdf"))
    return ArmDescription.from_urdf(robots / "panda_description/urdf/panda.urdf", workcell=CELL)


@pytest.fixture(scope="module")
def postures(panda):
    """Postures of the Panda free of collisions [rad]."""
    kinematics = ArmKinematics(panda, base="world")
    checker = CollisionChecker(kinematics)
    drawn = np.random.default_rng(0).uniform(kinematics.lower, kinematics.upper, (60, kinematics.n))
    return np.array([q for q in drawn if checker.free(q)][:16])


def test_the_panda_arrives_everywhere(panda, postures):
    assert len(postures) == 16
    simulation = ArmSimulation(panda)
    positions = ArmKinematics(panda, base="world").positions(postures)
    for q, position in zip(postures, positions, strict=True):
        simulation.reset()
        move = simulation.move(q)
        assert move.reached, move.reason
        assert move.error < 5e-4
        np.testing.assert_allclose(simulation.tip_position, position, atol=1e-3)


def test_a_batch_of_pandas_moves_as_one_does(panda, postures):
    simulation, batch = ArmSimulation(panda), BatchSimulation(panda, 4)
    moves = batch.move(np.arange(4), postures[:4])
    for move, q in zip(moves, postures[:4], strict=True):
        simulation.reset()
        np.testing.assert_array_equal(move.q, simulation.move(q).q)


@pytest.mark.parametrize("backend", ["kinematic", "mujoco"])
def test_the_panda_reaches_in_an_environment(panda, postures, backend):
    env = gym.make("kinreach/UR5SingleStep-v0", arm=panda, backend=backend).unwrapped
    reached = 0
    for q in postures[:6]:
        goal = env.kinematics.positions(q)
        observation, info = env.reset(options={"goal": goal})
        np.testing.assert_array_equal(observation[:3], goal.astype(np.float32))
        _, reward, terminated, _, info = env.step(env.action_for(q))
        assert terminated
        assert reward == -info["distance"]
        reached += info["reached"]
    assert reached == 6


def test_the_panda_can_be_looked_at(panda, needs_gl):
    env = gym.make("kinreach/UR5SingleStep-v0", arm=panda, render_mode="rgb_array")
    env.reset(seed=0)
    frame = env.render()
    env.close()
    assert frame.std() > 10  # something is to be seen
