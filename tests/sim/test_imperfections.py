"""Arms with friction, damping, an unknown load and noisy encoders: statics is the oracle."""

import gymnasium as gym
import numpy as np
import pytest

import kinreach  # noqa: F401 (registers the environments)
from kinreach.errors import InputError, UnknownNameError
from kinreach.kinematics import URKinematics
from kinreach.robots import get_arm
from kinreach.sim import ArmSimulation, BatchSimulation
from kinreach.sim.inside import IDEAL, Imperfections, as_imperfections

GRAVITY = 9.81
COUNT = 12
KIN = URKinematics("ur5-thesis", tip="tcp", base="world")


def postures(count=COUNT, seed=0):
    """Tool-down postures at goals of the table."""
    goals = KIN.arm.workcell.goals.sample(np.random.default_rng(seed), count)
    home = np.array(KIN.arm.home)
    goals[:, 2] += 0.05
    return np.array([KIN.axis_goal(goal, (0.0, 0.0, -1.0), seed=home).q for goal in goals])


def moved(**flaws):
    arms = BatchSimulation("ur5-thesis", COUNT, imperfections=flaws)
    targets = postures()
    moves = arms.move(np.arange(COUNT), targets)
    assert all(move.reached for move in moves)
    return arms, arms.q - targets


def test_a_load_bends_the_servos_as_statics_says():
    """Torque of the weight, by the Jacobian transposed, over the stiffness of each servo."""
    mass = 0.5
    gains = np.array(get_arm("ur5-thesis").position_gains)
    (arms, loaded), (_, ideal) = moved(payload=mass), moved()
    for off, q in zip(loaded - ideal, arms.q, strict=True):
        torque = KIN.jacobian(q)[:3].T @ [0.0, 0.0, -mass * GRAVITY]
        np.testing.assert_allclose(off, torque / gains, atol=1e-4)
    assert np.abs(loaded).max() > 4e-4


@pytest.mark.parametrize("share", [0.02, 0.05])
def test_friction_holds_a_joint_off_by_no_more_than_it_can_bear(share):
    arms, off = moved(friction=share)
    effort = arms.model.jnt_actfrcrange[arms.controller.qpos, 1]
    bound = share * effort / np.array(get_arm("ur5-thesis").position_gains)
    assert (np.abs(off) < bound + 1e-4).all()
    assert np.median(np.abs(off).max(axis=1)) > 0.2 * bound.max()


def test_damping_takes_the_same_torque_at_every_speed_in_proportion():
    model = BatchSimulation("ur5-thesis", 1, imperfections={"damping": 0.05}).model
    plain = BatchSimulation("ur5-thesis", 1).model
    added = (model.dof_damping - plain.dof_damping)[:6]
    np.testing.assert_allclose(added, 0.05 * model.jnt_actfrcrange[:6, 1])
    assert (added > 1.0).all()


def test_noise_of_encoders_is_that_of_the_move_alone_or_in_a_batch():
    flaws = {"friction": 0.02, "damping": 0.01, "payload": 0.2, "encoder_noise": 1e-4}
    _, off = moved(**flaws)
    alone = ArmSimulation("ur5-thesis", imperfections=flaws)
    for index, target in enumerate(postures()[:4]):
        alone.reset()
        assert alone.move(target).reached
        np.testing.assert_array_equal(alone.q - target, off[index])
    _, noisy = moved(encoder_noise=1e-4)
    _, ideal = moved()
    changes = noisy - ideal
    assert len(np.unique(changes)) == changes.size
    assert 1e-5 < changes.std() < 1e-4


def test_an_ideal_arm_is_the_default():
    (_, default), (_, zero) = moved(), moved(friction=0.0, payload=0.0)
    np.testing.assert_array_equal(default, zero)
    assert as_imperfections(None) == as_imperfections({}) == Imperfections() == IDEAL


@pytest.mark.parametrize("vector", [False, True])
def test_environments_take_them(vector):
    options = {"imperfections": {"payload": 2.0}}
    seen = []
    for given in (options, {}):
        if vector:
            env = gym.make_vec("kinreach/UR5SingleStep-v0", 1, vectorization_mode="vector_entry_point", **given)
            env.reset(seed=0)
            q = env.step(postures()[:1] / np.pi)[4]["final_info"]["q"][0]
        else:
            env = gym.make("kinreach/UR5SingleStep-v0", **given)
            env.reset(seed=0)
            q = env.step(postures()[0] / np.pi)[4]["q"]
        env.close()
        seen.append(np.abs(q - postures()[0]).max())
    assert seen[0] > 1e-3
    assert seen[1] < 1e-4


def test_what_cannot_be_is_refused():
    with pytest.raises(UnknownNameError, match="damping"):
        ArmSimulation("ur5-thesis", imperfections={"rust": 1.0})
    for flaws in ({"friction": -0.1}, {"payload": np.nan}, {"friction": 2.0}, 0.5):
        with pytest.raises(InputError):
            BatchSimulation("ur5-thesis", 1, imperfections=flaws)
    with pytest.raises(InputError, match="dynamics"):
        gym.make("kinreach/UR5SingleStep-v0", backend="kinematic", imperfections={"payload": 0.5})
