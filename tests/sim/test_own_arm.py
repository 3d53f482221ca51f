"""An arm that is nothing but a URDF file moves: its servos' gains, damping and limits are derived from the file."""

from pathlib import Path

import example_robot_data
import gymnasium as gym
import numpy as np
import pytest

import kinreach  # noqa: F401 (registers the environments)
from kinreach.compare import compare
from kinreach.kinematics import ArmKinematics, CollisionChecker
from kinreach.robots import ArmDescription, BoxRegion, Workcell
from kinreach.sim import ArmSimulation, BatchSimulation
from kinreach.sim.inside import PosedScene, mujoco
from tests.kinematics.test_coupled_and_sliding import COUPLED_WRIST, PALLETIZER, RAIL, SCARA, chain, written

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


@pytest.mark.parametrize(
    "joints", [SCARA, PALLETIZER, RAIL, COUPLED_WRIST], ids=["scara", "palletizer", "rail", "wrist"]
)
def test_joints_that_slide_or_follow_others_arrive(joints, tmp_path):
    """With the tip where kinematics has it, and those that follow where they follow to, on the way, too."""
    names = [name for name, _, options in joints if "mimic" not in options]
    kin = written(tmp_path, chain(*joints), joints=names)
    checker = CollisionChecker(kin)
    drawn = np.random.default_rng(2).uniform(*kin.sampling_limits, (60, kin.n))
    ways = np.linspace(np.array(kin.arm.home), drawn, 20, axis=1)
    targets = np.array([way[-1] for way in ways if not checker.impossible(way).any()][:5])
    assert len(targets) == 5
    batch, simulation, slack = BatchSimulation(kin.arm, 5), ArmSimulation(kin.arm), []
    moves = batch.move(np.arange(5), targets)
    for move, target in zip(moves, targets, strict=True):
        assert move.reached, move.reason
        assert move.error < 5e-4
        np.testing.assert_allclose(kin.positions(move.q), kin.positions(target), atol=5e-4)

    def watch():
        where = [float(simulation.data.joint(name).qpos[0]) for name, _, _ in joints]
        slack.append(max(abs(at - how.factor * simulation.q[how.entry] - how.offset)
                         for at, how in zip(where, kin.moves, strict=True)))  # fmt: skip

    simulation.watch = watch
    np.testing.assert_array_equal(simulation.move(targets[0]).q, moves[0].q)
    assert max(slack) < 0.01
    assert slack[-1] < 1e-5
    np.testing.assert_allclose(simulation.tip_position, kin.positions(simulation.q), atol=1e-5)
    scene = PosedScene(kin.arm)
    for q in targets:
        simulation.reset(q)
        scene.put(q)
        mujoco.mj_kinematics(scene.model, scene.data)
        tip = scene.data.body(kin.arm.tips[kin.arm.default_tip]).xpos
        np.testing.assert_allclose(simulation.tip_position, kin.positions(q), atol=1e-9)
        np.testing.assert_allclose(tip, kin.positions(q), atol=1e-9)


@pytest.mark.parametrize("joints", [SCARA, PALLETIZER], ids=["scara", "palletizer"])
def test_solvers_of_slides_and_followers_are_compared(joints, tmp_path):
    """A SCARA's tip is always below its first joint, and so are its goals."""
    methods = ["closed-form", "lm"]
    found = compare("ur5", arm=written(tmp_path, chain(*joints)).arm, methods=methods, goals=3)["methods"]
    assert [method["name"] for method in found] == methods
    assert [method["reached"] for method in found] == [1.0, 1.0]


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


@pytest.mark.slow
def test_the_panda_can_be_looked_at(panda, needs_gl):
    env = gym.make("kinreach/UR5SingleStep-v0", arm=panda, render_mode="rgb_array")
    env.reset(seed=0)
    frame = env.render()
    env.close()
    assert frame.std() > 10  # something is to be seen
