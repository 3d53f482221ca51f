"""The plant of MuJoCo Warp, on an engine that MuJoCo plays: states, moves, and what becomes of the others.

`test_warp.py` has Warp itself, which takes minutes to compile.
"""

from copy import copy
from types import SimpleNamespace

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from kinreach.envs._lift.lift_task import grasping_arm
from kinreach.errors import InputError, UnknownNameError
from kinreach.sim import BatchSimulation
from kinreach.sim import _warp_plant as warp_plant
from kinreach.sim.inside import SHAPES, Grasping, Objects

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


def in_vectors(field):
    """A field with the shape that it has on the device: bounding boxes are two vectors each."""
    return field.reshape(-1, 2, 3) if field.shape[1:] == (6,) else field


class Engine:
    """What is used of the packages `warp` and `mujoco_warp`."""

    def __init__(self):
        self.LOG_WARNING, self.config, self.scopes, self.inside = 30, SimpleNamespace(log_level=20), [], False
        self.put = 0

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

    def put_model(self, model, *, batch_sizes=None):
        assert self.inside
        self.one, self.put = mujoco.MjData(model), self.put + 1
        fields = {name: Array(size * [in_vectors(getattr(model, name))]) for name, size in (batch_sizes or {}).items()}
        return SimpleNamespace(shared=copy(model), **fields)

    def put_data(self, model, start, *, nworld, nconmax, njmax):
        assert self.inside
        assert np.abs(start.xpos).sum() > 0.1  # what follows from the posture is computed
        assert njmax == (6 if model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC else 4) * nconmax
        assert nconmax >= 32
        fields = {name: Array(np.tile(getattr(start, name), (nworld, 1))) for name in warp_plant._STATE}
        none = SimpleNamespace(worldid=Array([]), geom=Array(np.empty((0, 2))), dist=Array([]))
        return SimpleNamespace(**fields, contact=none, nacon=Array([0]))

    def kinematics(self, model, data):
        assert self.inside
        self.placed = data.qpos.values.copy()

    def collision(self, model, data):
        """Contacts of all, the last simulation's first, and behind them what an earlier step left."""
        assert self.inside
        np.testing.assert_array_equal(self.placed, data.qpos.values)
        found = []
        for row, qpos in reversed([*enumerate(self.placed)]):
            one = self.model_of(model, row)
            self.one.qpos[:] = qpos
            mujoco.mj_kinematics(one, self.one)
            mujoco.mj_collision(one, self.one)
            found += [(row, tuple(contact.geom), contact.dist) for contact in self.one.contact]
        data.nacon.values = np.array([len(found)])
        for array, values in zip(vars(data.contact).values(), zip(*found, (0, (3, 4), -1.0), strict=True), strict=True):
            array.values = np.array(values)

    def model_of(self, model, row):
        for name, field in vars(model).items():
            if name != "shared":
                own = getattr(model.shared, name)
                own[:] = field.values[row].reshape(own.shape)
        return model.shared

    def set_const(self, model, data, *, restore):
        assert self.inside
        assert not restore
        for row in range(len(data.qpos.values)):
            one = self.model_of(model, row)
            mujoco.mj_setConst(one, mujoco.MjData(one))
            for name in warp_plant._FOLLOWING:
                getattr(model, name).values[row] = getattr(one, name)

    def step(self, model, data):
        assert self.inside
        for row in range(len(data.qpos.values)):
            for name in warp_plant._STATE:
                getattr(self.one, name)[:] = getattr(data, name).values[row]
            mujoco.mj_step(self.model_of(model, row), self.one)
            for name in warp_plant._STATE:
                getattr(data, name).values[row] = getattr(self.one, name)


@pytest.fixture
def engine(monkeypatch):
    engine = Engine()
    monkeypatch.setattr(warp_plant, "load_extra", lambda package, extra: engine if extra == "warp" else None)
    return engine


def native(name, **options):
    return gym.make_vec(f"kinreach/{name}-v0", 2, vectorization_mode="vector_entry_point", **options)


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


def test_objects_of_one_shape_have_sizes_masses_and_friction_of_their_own(engine):
    ids, worlds, rng = np.arange(COUNT), [], np.random.default_rng(0)
    numbers = [rng.uniform(*ends, COUNT) for ends in ((0.015, 0.035), (0.02, 0.3), (0.3, 1.5))]
    places = np.column_stack([rng.uniform(0.4, 0.5, COUNT), rng.uniform(-0.2, 0.2, COUNT), np.full(COUNT, -0.2)])
    for backend in ("warp", "mujoco"):
        world = Grasping(BatchSimulation(grasping_arm("ur5-thesis"), COUNT, backend=backend, objects=1))
        world.reset(ids, np.tile(HOME, (COUNT, 1)))
        for shape in ("cylinder", "cube"):
            world.put(ids, 0, Objects(np.full(COUNT, SHAPES.index(shape)), *numbers), places, numbers[2])
        world.rest(ids, 0.4)
        worlds.append(world)
    assert engine.put == 3  # as it was made, for cylinders, for cubes
    ours, theirs = worlds
    for mine, other in zip(ours.pose(), theirs.pose(), strict=True):
        np.testing.assert_allclose(mine, other, atol=1e-5)
    for index in ids:
        one = ours._plant.model_of(index)
        assert one.geom("object").size == pytest.approx(3 * [numbers[0][index]])
        mujoco.mj_setConst(one, mujoco.MjData(one))
        for name in warp_plant._FOLLOWING:
            found = getattr(ours._plant._model, name).numpy()[index]
            np.testing.assert_allclose(found, getattr(one, name), rtol=1e-5, atol=1e-12)
    ours.put(ids[:1], 0, Objects(np.array([1]), *(one[1:2] for one in numbers)), places[:1], np.zeros(1))
    assert engine.put == 3
    size = ours._plant._model.geom_size.numpy()[:, ours._geoms[0], 0]
    np.testing.assert_allclose(size, numbers[0][[1, 1, 2]], rtol=1e-6)


@pytest.mark.parametrize(
    ("name", "options"),
    [("Lift", {"steps": "multi", "clutter": True}), ("Push", {}), ("PickAndPlace", {"shape": "cylinder"})],
)
def test_environments_with_objects_are_those_of_mujoco(engine, name, options):
    actions, told = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 2, 7)), []
    for backend in ("warp", "mujoco"):
        envs = native(name, backend=backend, **options)
        envs.reset(seed=0)
        width = envs.single_action_space.shape[0]
        told.append([envs.step(action[:, :width])[:4] for action in actions])
        envs.close()
    for ours, theirs in zip(*told, strict=True):
        for mine, other in zip(ours, theirs, strict=True):
            np.testing.assert_allclose(mine, other, rtol=0, atol=1e-3)


def test_one_environment_and_shapes_of_all_kinds_are_refused(engine):
    for name in ("Lift", "PickAndPlace"):
        with pytest.raises(InputError, match="is of native batches"):
            gym.make(f"kinreach/{name}-v0", backend="warp")
        with pytest.raises(UnknownNameError, match="unknown backend 'brax'"):
            native(name, backend="brax")
        with pytest.raises(InputError, match="is of the dynamics: use backend=\"mujoco\", got 'warp'"):
            native(name, backend="warp", randomise={"payload": (0.0, 0.5)})
    with pytest.raises(InputError, match=r"objects of one shape, got shapes=\('ball', 'cube'\)"):
        native("Lift", backend="warp", shapes=("ball", "cube"))
    envs = native("Lift", backend="warp", shapes=("cube",))
    with pytest.raises(UnknownNameError, match=r"unknown shape 'ball'.*cube"):
        envs.reset(options={"shape": "ball"})


def test_grasps_are_those_of_mujoco(engine):
    """Two that hold an object, one of them beside another object, and an arm in the table."""
    ids, told = np.arange(COUNT), []
    postures = np.add(HOME, [6 * [0.1], 6 * [-0.1], [0.0, 1.2, 0.0, 0.0, 0.0, 0.0]])
    for backend in ("warp", "mujoco"):
        simulation = BatchSimulation(grasping_arm("ur5-thesis"), COUNT, backend=backend, objects=2)
        world, cubes = Grasping(simulation), Objects(np.ones(COUNT, dtype=int), *np.full((3, COUNT), 0.03))
        world.reset(ids, postures)
        tips, away = simulation.tip_positions, np.array([3.0, 0.0, 0.0])
        for which, places in ((0, tips + away), (1, tips + np.outer((0.015, 1.0, 2.0), away))):
            world.put(ids, which, cubes, places, np.zeros(COUNT))
        world.put_at(ids[:2], tips[:2], np.array([np.eye(3)] * 2))
        world.put_fingers(ids[:2], np.full(2, 0.055))
        told.append([world.grasp(some) for some in (ids, ids[1:])])
    for pair in zip(*told, strict=True):
        for mine, other in zip(*pair, strict=True):
            np.testing.assert_allclose(mine, other, rtol=0, atol=1e-6)
    whole, some = told[0]
    assert whole.gripped.tolist() == [True, True, False]
    assert whole.collides.tolist() == [False, False, True]
    assert whole.held.tolist() == [False, True, False]
    assert some.gripped.tolist() == [True, False]
