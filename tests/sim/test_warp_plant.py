"""The plant of MuJoCo Warp, on an engine that MuJoCo plays: states, moves, and what becomes of the others.

`test_warp.py` has Warp itself, which takes minutes to compile.
"""

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from kinreach.errors import InputError
from kinreach.sim import BatchSimulation
from kinreach.sim import _warp_plant as warp_plant

COUNT = 3
HOME = np.array([-np.pi / 2, -np.pi / 2, np.pi / 2, -np.pi / 2, -np.pi / 2, 0.0])
TARGETS = np.add(HOME, [[0.2, -0.1, 0.3, 0.1, 0.2, -0.4], [-0.3, 0.2, -0.2, 0.3, 0.0, 0.5]])


class Array:
    """An array on the device, in single precision."""

    def __init__(self, values):
        self.values = np.array(values, dtype=np.float32)

    def assign(self, values):
        assert values.dtype == np.float32
        assert values.shape == self.values.shape
        self.values = values.copy()

    def numpy(self):
        return self.values


class Engine:
    """What is used of the packages `warp` and `mujoco_warp`."""

    def __init__(self):
        self.LOG_WARNING, self.config, self.scopes, self.inside = 30, SimpleNamespace(log_level=20), [], False

    def get_device(self, name):
        if name not in (None, "cpu"):
            raise ValueError(f"no {name}")
        return "the processor"

    def get_devices(self):
        return ["cpu"]

    def ScopedDevice(self, device):
        self.scopes.append(device)
        return self

    def __enter__(self):
        self.inside = True

    def __exit__(self, *_):
        self.inside = False

    def put_model(self, model):
        assert self.inside
        self.one = mujoco.MjData(model)
        return model

    def put_data(self, model, start, *, nworld, nconmax, njmax):
        assert self.inside
        assert np.abs(start.xpos).sum() > 0.1  # what follows from the posture is computed
        assert njmax == 4 * nconmax
        assert nconmax >= 32
        fields = {name: Array(np.tile(getattr(start, name), (nworld, 1))) for name in warp_plant._STATE}
        return SimpleNamespace(**fields)

    def step(self, model, data):
        assert self.inside
        for row in range(len(data.qpos.values)):
            for name in warp_plant._STATE:
                getattr(self.one, name)[:] = getattr(data, name).values[row]
            mujoco.mj_step(model, self.one)
            for name in warp_plant._STATE:
                getattr(data, name).values[row] = getattr(self.one, name)


@pytest.fixture
def engine(monkeypatch):
    engine = Engine()
    monkeypatch.setattr(warp_plant, "load_extra", lambda package, extra: engine if extra == "warp" else None)
    return engine


def batches():
    return [BatchSimulation("ur5-thesis", COUNT, backend=backend) for backend in ("warp", "mujoco")]


def test_moves_are_those_of_mujoco_and_the_others_stand_still(engine):
    ours, theirs = batches()
    before, pairs = ours.q, []
    np.testing.assert_array_equal(before, COUNT * [HOME])
    for batch in (ours, theirs):
        batch.place_ball([1], (0.4, 0.1, -0.1))
        pairs.append(batch.move([0, 2], TARGETS))
    for mine, other in zip(*pairs, strict=True):
        assert mine.status is other.status
        np.testing.assert_allclose(mine.q, other.q, atol=1e-5)
        assert mine.duration == pytest.approx(other.duration, abs=1e-9)
    np.testing.assert_array_equal(ours.q[1], before[1])
    np.testing.assert_array_equal(ours.ball_positions, theirs.ball_positions)
    assert ours._plant.time.tolist() == [pairs[0][0].duration, 0.0, pairs[0][1].duration]
    assert set(engine.scopes) == {"the processor"}
    assert engine.config.log_level == 30


def test_states_are_copied_put_back_and_reset(engine):
    batch, twin = (BatchSimulation("ur5-thesis", COUNT, backend="warp") for _ in range(2))
    everyone = np.arange(COUNT)
    fresh = batch._plant.states(everyone)
    batch.place_ball(everyone, np.random.default_rng(0).normal(size=(COUNT, 3)))
    batch.move([0, 2], TARGETS)
    moved = batch._plant.states(everyone)
    assert (moved != fresh).any(axis=1).all()
    twin._plant.put(everyone, moved)
    np.testing.assert_array_equal(twin._plant.states(everyone), moved)
    np.testing.assert_array_equal(twin.ball_positions, batch.ball_positions)
    again = [one.move([0, 1], TARGETS[::-1]) for one in (batch, twin)]
    for mine, other in zip(*again, strict=True):
        np.testing.assert_array_equal(mine.q, other.q)
    batch.reset([1])
    np.testing.assert_array_equal(batch._plant.states(everyone)[1], fresh[1])
    batch.reset(everyone)
    np.testing.assert_array_equal(batch._plant.states(everyone), fresh)


@pytest.mark.parametrize(("field", "wrong"), [("qvel", 1e11), ("qvel", -1e11), ("qpos", np.nan)])
def test_an_unstable_simulation_is_put_back_to_where_it_stood(engine, field, wrong, monkeypatch):
    batch = BatchSimulation("ur5-thesis", COUNT, backend="warp")
    before, step = batch.q, engine.step

    def unstable(model, data):
        step(model, data)
        getattr(data, field).values[1, 2] = wrong

    monkeypatch.setattr(engine, "step", unstable)
    moves = batch.move([0, 1], TARGETS)
    assert [move.status.value for move in moves] == ["reached", "diverged"]
    np.testing.assert_array_equal(batch.q[1], before[1])
    assert not batch._plant.qvel[1].any()
    assert not batch._plant.diverged(np.array([0, 1])).any()
    monkeypatch.setattr(engine, "step", step)
    assert batch.move([1], TARGETS[:1])[0].reached


def test_an_unknown_device_is_refused_with_those_there_are(engine):
    with pytest.raises(InputError, match=r"no device 'cuda:7' here: no cuda:7; available: cpu"):
        BatchSimulation("ur5-thesis", 1, backend="warp", device="cuda:7")
