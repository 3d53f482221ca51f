"""A calibrated arm is the true one in simulation, collision checker and environments; methods may believe otherwise."""

import gymnasium
import numpy as np

import kinreach  # noqa: F401 (registers the environments)
from kinreach.kinematics import CollisionChecker, URKinematics
from kinreach.robots import PUBLISHED_CALIBRATIONS, get_arm
from kinreach.sim import ArmSimulation

FILE = PUBLISHED_CALIBRATIONS["ur5_a"]
GOAL, DOWN = np.array([0.45, 0.1, -0.15]), (0.0, 0.0, -1.0)


def test_the_simulated_arm_is_the_real_one():
    arm = get_arm("ur5-thesis").calibrated(FILE)
    home, simulation = np.array(arm.home), ArmSimulation(arm)
    real = URKinematics.from_calibration(FILE, model="ur5", tip="tcp", base="world")
    nominal = URKinematics("ur5", tip="tcp", base="world")
    checker = CollisionChecker(arm)
    misses = []
    for kin in (real, nominal):
        result = kin.axis_goal(GOAL, DOWN, home, accept=checker.free)
        assert result.success
        simulation.reset()
        assert simulation.move(result.q).reached
        misses.append(np.linalg.norm(simulation.tip_position - GOAL))
    assert misses[0] < 1e-4 < 8e-4 < misses[1]
    np.testing.assert_allclose(simulation.tip_position, real.fk(simulation.q)[:3, 3], atol=1e-6)


def test_an_environment_of_the_real_arm():
    """The same action ends elsewhere; goals and reward stay as they are."""
    ends = []
    for arm in ("ur5-thesis", get_arm("ur5-thesis").calibrated(FILE)):
        env = gymnasium.make("kinreach/UR5SingleStep-v0", arm=arm, observation="geometric", backend="kinematic")
        _, info = env.reset(seed=3)
        posture = (
            URKinematics("ur5", tip="tcp", base="world").axis_goal(info["goal"], DOWN, get_arm("ur5-thesis").home).q
        )
        *_, info = env.step(np.asarray(posture / np.pi, dtype=env.action_space.dtype))
        ends.append(info["distance"])
        env.close()
    assert ends[0] < 1e-6
    assert 3e-4 < ends[1] < 1e-2
