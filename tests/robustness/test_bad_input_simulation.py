"""Simulations under fuzz: MuJoCo is given nothing that it warns of, aborts on or reads past the end of."""

import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from kinreach.errors import InputError
from kinreach.sim import ArmSimulation, BatchSimulation
from kinreach.sim.inside import MoveStatus
from tests.robustness.fuzzing import NUMBERS, bad_arrays, things

SIZES = {"arm3": 3, "ur5-thesis": 6}


@pytest.fixture(scope="module")
def simulations():
    return {arm: ArmSimulation(arm) for arm in SIZES}


@pytest.fixture(scope="module")
def batch():
    return BatchSimulation("arm3", 4)


def angles(*shape, most=3.0):
    return arrays(np.float64, shape, elements=st.floats(-most, most))


@pytest.mark.parametrize("arm", SIZES)
def test_one_simulation(arm, simulations, fuzzed):
    simulation, n = simulations[arm], SIZES[arm]

    def run(case):
        start, target, ball = case
        try:
            simulation.reset(start)
            np.testing.assert_array_equal(simulation.q, simulation.arm.home if start is None else np.asarray(start))
        except InputError:
            simulation.reset()
        before = simulation.q
        try:
            simulation.place_ball(ball)
            np.testing.assert_array_equal(simulation.ball_position, np.asarray(ball).astype(float))
        except InputError:
            simulation.place_ball([0.4, 0.0, 0.0])
        move = simulation.move(target)
        wanted = np.asarray(target).astype(float)
        controller = simulation.controller
        assert np.isfinite(move.q).all()
        np.testing.assert_array_equal(move.q, simulation.q)
        assert (move.status is MoveStatus.OUT_OF_LIMITS) == bool(controller.outside_limits(wanted).any())
        assert not move.reached or np.abs(move.q - wanted).max() <= controller.tolerance
        assert move.reached or move.reason
        if move.status is MoveStatus.OUT_OF_LIMITS:
            np.testing.assert_array_equal(move.q, before)

    near = st.none() | angles(n, most=0.4).map(lambda q: q + simulation.arm.home)
    targets = near.filter(lambda q: q is not None) | angles(n) | bad_arrays((n,)) | angles(n, most=1e308)
    balls = angles(3) | angles(3, most=1e6) | bad_arrays((3,))
    fuzzed(st.tuples(near | bad_arrays((n,)), targets, balls), run, share=0.6)


def test_a_batch(batch, fuzzed):
    def run(case):
        action, ids, values = case
        before = batch.q, batch.ball_positions
        try:
            if action == "reset":
                batch.reset(ids, values)
            elif action == "ball":
                batch.place_ball(ids, values)
            else:
                moves = batch.move(ids, values)
                assert len(moves) == len(ids)
                assert all(np.isfinite(move.q).all() for move in moves)
        except InputError:
            for old, now in zip(before, (batch.q, batch.ball_positions), strict=True):
                np.testing.assert_array_equal(old, now)
            raise
        given = np.asarray(ids).astype(int)
        assert given.tolist() == sorted(set(given.tolist()))
        others = np.setdiff1d(np.arange(4), given)
        np.testing.assert_array_equal(batch.q[others], before[0][others])
        assert np.isfinite(batch.q).all()

    kinds = st.sampled_from(["u1", "u8", "i1", "i8", "f8", "?"])
    numbers = st.lists(st.integers(0, 4) | st.integers(0, 255), max_size=5)
    wild = st.tuples(numbers, kinds).map(lambda pair: np.array(pair[0]).astype(pair[1]))
    good = st.sets(st.integers(0, 3), min_size=1).map(sorted)
    ids = good | good.map(np.array) | good.map(lambda rows: np.array(rows, dtype=np.uint8)) | wild | things()
    rows = st.integers(0, 4).flatmap(lambda k: angles(k, 3, most=1.5)) | angles(3, most=1.5) | bad_arrays((2, 3))
    fuzzed(st.tuples(st.sampled_from(["reset", "ball", "move"]), ids, rows), run)


@pytest.mark.parametrize("kind", [ArmSimulation, BatchSimulation])
def test_what_simulations_are_made_of(kind, fuzzed):
    def run(case):
        name, value = case
        options = {"count": 2} if kind is BatchSimulation else {}
        simulation = kind(**{"arm": "arm3", **options, name: value})
        moved = simulation.move([0.1, 0.1, 0.1]) if kind is ArmSimulation else simulation.move([0], [[0.1] * 3])[0]
        assert np.isfinite(moved.q).all()

    names = ["arm", "timestep", "tolerance"] + (["count", "threads"] if kind is BatchSimulation else [])
    values = NUMBERS | things() | st.integers(-3, 40) | st.floats(0.001, 0.02)
    fuzzed(st.tuples(st.sampled_from(names), values), run, share=0.4)


@pytest.mark.parametrize("count", [2**17 + 1, 10**12, 10**400, -1, 0])
def test_more_simulations_than_there_can_be_are_refused_at_once(count):
    with pytest.raises(InputError, match=r"count must be at (most 131072|least 1), got"):
        BatchSimulation("arm3", count)
    with pytest.raises(InputError, match=r"threads must be at (most 1024|least 1), got"):
        BatchSimulation("arm3", 1, threads=count)


def test_a_device_is_for_warp():
    with pytest.raises(InputError, match=r"device is for backend='warp'.* got 'cuda:7'"):
        BatchSimulation("arm3", 2, device="cuda:7")


def test_ids_that_do_not_ascend_are_refused_in_unsigned_numbers_too(batch):
    """Differences of unsigned numbers are never negative: 1 - 2 is 255 in eight bits."""
    for ids in ([0, 2, 1, 3], [0, 200, 1], [3, 0]):
        with pytest.raises(InputError, match="ids must be"):
            batch.move(np.array(ids, dtype=np.uint8), np.zeros((len(ids), 3)))


@pytest.mark.parametrize("name", ["", "nowhere", "a\0b", None, 5, b"tcp", [], "x" * 5000, "\ud800"])
def test_frames_that_are_none_are_refused(simulations, name):
    with pytest.raises(InputError):
        simulations["ur5-thesis"].T_world_frame(name)
