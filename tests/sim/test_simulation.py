import copy
import pickle

import mujoco
import numpy as np
import pytest

from kinreach.errors import InputError, UnknownNameError
from kinreach.sim import ArmSimulation


def full_state(simulation):
    state = np.empty(mujoco.mj_stateSize(simulation.model, mujoco.mjtState.mjSTATE_INTEGRATION))
    mujoco.mj_getState(simulation.model, simulation.data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    return state


@pytest.mark.parametrize("name", ["ur5-thesis", "arm3"])
def test_reset_restores_the_whole_state(name):
    simulation = ArmSimulation(name)
    fresh = full_state(simulation)
    rng = np.random.default_rng(0)
    for _ in range(5):
        simulation.place_ball(rng.normal(size=3))
        simulation.data.xfrc_applied[:] = rng.normal(size=simulation.data.xfrc_applied.shape)
        simulation.move(rng.uniform(simulation.controller.lower, simulation.controller.upper))
        assert not np.array_equal(full_state(simulation), fresh)
        simulation.reset()
        np.testing.assert_array_equal(full_state(simulation), fresh)


def test_two_runs_are_identical(tool_down, goals):
    def run(simulation):
        states = []
        for goal in goals[:4]:
            simulation.reset()
            simulation.place_ball(goal)
            simulation.move(tool_down(goal))
            states.append(full_state(simulation))
        return np.array(states)

    used = ArmSimulation("ur5-thesis")
    first = run(used)
    np.testing.assert_array_equal(first, run(used))
    np.testing.assert_array_equal(first, run(ArmSimulation("ur5-thesis")))


def test_reset_to_a_posture_stays_there(ur5):
    q = np.array([-1.2, -1.0, 1.4, -2.0, -1.5, 0.4])
    ur5.reset(q)
    mujoco.mj_step(ur5.model, ur5.data, 500)
    np.testing.assert_allclose(ur5.q, q, atol=1e-4)


def test_reset_refuses_postures_out_of_limits(ur5):
    with pytest.raises(InputError, match=r"elbow_joint = 4 rad is outside its limits \[-3.14159, 3.14159\]"):
        ur5.reset([0, 0, 4, 0, 0, 0])
    with pytest.raises(InputError, match="shape"):
        ur5.reset(np.zeros(7))


def test_ball_is_where_it_was_put(ur5):
    ur5.place_ball((0.4, 0.1, -0.175))
    np.testing.assert_array_equal(ur5.ball_position, (0.4, 0.1, -0.175))
    np.testing.assert_array_equal(ur5.T_world_frame("ball")[:3, 3], (0.4, 0.1, -0.175))
    with pytest.raises(InputError, match="position"):
        ur5.place_ball((0.4, np.inf, 0))


def test_contacts_name_both_and_change_nothing(ur5, tool_down):
    ur5.reset(tool_down((0.45, 0.0, -0.205)))
    before = full_state(ur5)
    found = ur5.contacts()
    assert {(touch.link, touch.other) for touch in found} == {("finger_left", "table"), ("finger_right", "table")}
    assert all(touch.depth == pytest.approx(0.015, abs=1e-4) and not touch.with_itself for touch in found)
    assert str(found[0]).endswith("touches table")
    np.testing.assert_array_equal(full_state(ur5), before)


def test_what_is_read_does_not_follow_the_state(ur5):
    q, ball = ur5.q, ur5.ball_position
    ur5.data.qpos[:] += 0.1
    ur5.data.mocap_pos[:] += 0.1
    np.testing.assert_array_equal(q, ur5.arm.home)
    assert not np.array_equal(ball, ur5.ball_position)


def test_unknown_names_are_answered_with_the_known_ones(ur5):
    with pytest.raises(UnknownNameError, match=r"tool9.*available.*tool0"):
        ur5.T_world_frame("tool9")
    with pytest.raises(UnknownNameError, match="available: arm3"):
        ArmSimulation("ur7")


def test_whoever_watches_is_called_in_every_control_period(ur5):
    times = []
    ur5.watch = lambda: times.append(ur5.data.time)
    result = ur5.move(ur5.q + 0.3)
    assert times[-1] == result.duration
    np.testing.assert_allclose(np.diff(times, prepend=0.0), times[0], atol=1e-12)
    assert len(times) > 50
    ur5.watch = None
    assert ur5.move(ur5.q - 0.3).reached
    assert times[-1] == result.duration


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda simulation: pickle.loads(pickle.dumps(simulation))])
def test_copies_do_the_same_on_their_own(ur5, tool_down, duplicate):
    ur5.place_ball((0.4, 0.1, -0.175))
    twin = duplicate(ur5)
    result = twin.move(tool_down((0.4, 0.1, -0.175)))
    np.testing.assert_array_equal(ur5.q, ur5.arm.home)
    np.testing.assert_array_equal(ur5.move(tool_down((0.4, 0.1, -0.175))).q, result.q)
    np.testing.assert_array_equal(full_state(ur5), full_state(twin))
