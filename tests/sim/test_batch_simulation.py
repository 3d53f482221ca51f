import importlib
from unittest.mock import Mock

import mujoco
import numpy as np
import pytest

from kinreach.errors import InputError, UnknownNameError
from kinreach.sim import ArmSimulation, BatchSimulation
from kinreach.sim.inside import MoveStatus

COUNT = 66


@pytest.fixture(scope="module")
def targets(tool_down, goals):
    """Goals, presses into the table, random postures (most of them in collision) and targets out of limits."""
    rng = np.random.default_rng(3)
    home = np.array(ArmSimulation("ur5-thesis").arm.home)
    return np.array(
        [
            *(tool_down(goal) for goal in goals[:24]),
            *(tool_down(goal - [0.0, 0.0, 0.08]) for goal in goals[:10]),
            *rng.uniform(-np.pi, np.pi, (26, 6)),
            home,
            home + 0.01,
            *(home + 5.0 * np.eye(6)[[3, 0]]),
            tool_down((0.45, 0.0, -0.191)),
            tool_down((0.45, 0.1, -0.189)),
        ]
    )


def state(model, data):
    values = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION))
    mujoco.mj_getState(model, data, values, mujoco.mjtState.mjSTATE_INTEGRATION)
    return values


def as_tuple(result):
    return (result.status, result.reason, result.duration, *result.q, result.error, result.touches)


def end_of(batch, i, result):
    return as_tuple(result), batch.tip_positions[i].tolist(), state(batch.model, batch.batch.get_data(i)).tolist()


@pytest.fixture(scope="module")
def alone(targets):
    """What each target leads to from home in a simulation of its own."""
    simulation = ArmSimulation("ur5-thesis")
    ends = []
    for target in targets:
        simulation.reset()
        result = simulation.move(target)
        values = state(simulation.model, simulation.data).tolist()
        ends.append((as_tuple(result), simulation.tip_position.tolist(), values))
    return ends


def test_the_targets_are_mixed(alone):
    assert len(alone) == COUNT
    seen = [result[0] for result, *_ in alone]
    for status in (MoveStatus.REACHED, MoveStatus.BLOCKED, MoveStatus.COLLISION, MoveStatus.OUT_OF_LIMITS):
        assert seen.count(status) >= 2


@pytest.mark.parametrize(("count", "threads"), [(COUNT, 1), (COUNT, 2), (33, 2), (5, 1), (1, 1)])
def test_each_is_bit_for_bit_what_it_would_be_alone(targets, alone, count, threads):
    batch = BatchSimulation("ur5-thesis", count, threads=threads)
    compared = 0
    for first in range(0, COUNT if count > 1 else 8, count):
        some = targets[first : first + count]
        ids = np.arange(len(some))
        batch.reset(ids)
        for i, result in enumerate(batch.move(ids, some)):
            assert end_of(batch, i, result) == alone[first + i]
            compared += 1
    assert compared == (COUNT if count > 1 else 8)


def test_those_that_are_not_moved_stand_still(targets, alone):
    batch = BatchSimulation("ur5-thesis", 7, threads=2)
    before = batch.batch.state.copy()
    ids = [1, 2, 5]
    for i, target, result in zip(ids, (20, 27, 40), batch.move(ids, targets[[20, 27, 40]]), strict=True):
        assert end_of(batch, i, result) == alone[target]
    others = [0, 3, 4, 6]
    np.testing.assert_array_equal(batch.batch.state[others], before[others])
    batch.reset(ids)
    np.testing.assert_array_equal(batch.batch.state, before)


@pytest.mark.slow
def test_moves_from_wherever_the_last_one_ended(targets):
    chosen = np.array([0, 24, 30, 36, 41, 50])
    batch, serial = BatchSimulation("ur5-thesis", len(chosen), threads=2), ArmSimulation("ur5-thesis")
    everyone = np.arange(len(chosen))
    for two_phase in (False, True):
        batch.reset(everyone)
        moves = [batch.move(everyone, targets[chosen + k], two_phase=two_phase) for k in range(3)]
        for i, start in enumerate(chosen):
            serial.reset()
            for k in range(3):
                alone = serial.move(targets[start + k], two_phase=two_phase)
                assert as_tuple(moves[k][i]) == as_tuple(alone)
            np.testing.assert_array_equal(serial.q, batch.q[i])


def test_reset_restores_the_whole_state(targets):
    batch, fresh = BatchSimulation("ur5-thesis", 4), ArmSimulation("ur5-thesis")
    expected = state(fresh.model, fresh.data)
    batch.place_ball([0, 2], [[0.4, 0.1, 0.0], [0.5, 0.0, 0.0]])
    batch.move(np.arange(4), targets[22:26])
    batch.reset([0, 1, 3])
    states = np.array([state(batch.model, batch.batch.get_data(i)) for i in range(4)])
    np.testing.assert_array_equal(states[[0, 1, 3]], np.tile(expected, (3, 1)))
    assert not np.array_equal(states[2], expected)


def test_reset_to_postures():
    batch = BatchSimulation("ur5-thesis", 3)
    q = np.array([[-1.2, -1.0, 1.4, -2.0, -1.5, 0.4], [-1.0, -1.2, 1.4, -2.0, -1.5, 0.4]])
    batch.reset([0, 2], q)
    np.testing.assert_array_equal(batch.q, [q[0], batch.arm.home, q[1]])
    batch.reset([0, 1], q[0])
    np.testing.assert_array_equal(batch.q, [q[0], q[0], q[1]])
    assert all(result.reached for result in batch.move([0, 1, 2], batch.q))


def test_balls_are_where_they_were_put():
    batch = BatchSimulation("ur5-thesis", 3)
    default = ArmSimulation("ur5-thesis").ball_position
    places = np.array([[0.4, 0.1, -0.175], [0.5, -0.1, -0.175]])
    batch.place_ball([0, 2], places)
    np.testing.assert_array_equal(batch.ball_positions, [places[0], default, places[1]])
    batch.place_ball([0, 1, 2], places[1])
    np.testing.assert_array_equal(batch.ball_positions, np.tile(places[1], (3, 1)))


def test_other_arms_and_no_simulations_to_move():
    batch, serial = BatchSimulation("arm3", 2), ArmSimulation("arm3")
    targets = np.array([(1.0, 0.8, 0.9), (1.0, 2.0, 1.5)])
    for target, result in zip(targets, batch.move([0, 1], targets), strict=True):
        serial.reset()
        assert as_tuple(result) == as_tuple(serial.move(target))
    assert batch.move([], np.empty((0, 3))) == []


@pytest.mark.parametrize("ids", [[1, 0], [0, 0], [0, 3], [-1, 0], [0.5], [[0]], 1, [True, False, True]])
def test_malformed_ids_are_errors(ids):
    batch = BatchSimulation("arm3", 3)
    for call in (batch.reset, lambda i: batch.place_ball(i, np.zeros(3)), lambda i: batch.move(i, np.zeros((1, 3)))):
        with pytest.raises(InputError, match="ids must be"):
            call(ids)


def test_malformed_values_are_errors():
    batch = BatchSimulation("arm3", 3)
    with pytest.raises(InputError, match=r"targets must have shape \(2, 3\), got \(3,\)"):
        batch.move([0, 1], np.zeros(3))
    with pytest.raises(InputError, match="targets must be finite"):
        batch.move([0], [[0.0, np.nan, 0.0]])
    with pytest.raises(InputError, match="positions must be finite"):
        batch.place_ball([0], [[0.0, np.inf, 0.0]])
    with pytest.raises(InputError, match="link_1_joint = 4 rad is outside its limits"):
        batch.reset([0], [[4.0, 0.0, 0.0]])
    for count, threads in ((0, 1), (1, 0)):
        with pytest.raises(InputError, match="at least 1"):
            BatchSimulation("arm3", count, threads=threads)
    with pytest.raises(UnknownNameError, match="available: arm3"):
        BatchSimulation("ur7", 2)


def test_many_simulations_that_cannot_be_are_refused(monkeypatch):
    """More than the memory holds, as MuJoCo says it; drawn ones whose model is one for all."""

    module = importlib.import_module("mujoco.batch")
    for failure in (MemoryError("no room"), ValueError("no room")):
        monkeypatch.setattr(module, "Batch", Mock(side_effect=failure))
        with pytest.raises(InputError, match=r"^3 simulations do not fit into the memory: no room$"):
            BatchSimulation("arm3", 3)
    with pytest.raises(InputError, match="simulations with backend='warp' have one model: nothing can be drawn"):
        BatchSimulation("arm3", 3, backend="warp", drawn=["ball"])
