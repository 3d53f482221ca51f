"""Many simulations stepped by MuJoCo Warp: on a GPU, or on Warp's CPU device, in single precision.

A step is that of MuJoCo to some 1e-7 rad, contacts included, as long as both find the same points of contact. Where
the edge of a box is in another box Warp finds two (by clipping faces) and MuJoCo up to four (by a function for boxes):
an arm that is held there slides otherwise, and the verdict is the same.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach._engines import load_extra
from kinreach.errors import InputError
from kinreach.sim._engine import mujoco
from kinreach.sim._plants import Contacts, Ids, ManyPlant, rows_and_columns

#: Room for contacts in each simulation.
CONTACTS = 64
#: Rows of one to the solver, of pyramidal cones and of those of free objects.
PYRAMID, ELLIPTIC = 4, 6
#: What goes on from one step to the next, beside the time: MuJoCo's names.
_STATE = ("qpos", "qvel", "ctrl", "qacc_warmstart")
#: Fields that all simulations have in common, and those that follow from others.
_COMMON, _FOLLOWING = "geom_type", ("body_subtreemass", "body_invweight0", "dof_invweight0", "actuator_acc0")
#: Velocities beyond which MuJoCo calls a simulation unstable (`mjMAXVAL`).
_UNSTABLE = 1e10


class WarpPlant(ManyPlant):
    """Many simulations, stepped by MuJoCo Warp; a `Plant`.

    States are kept in double precision and computed in single. All simulations are stepped; only the states of those
    that are asked for are updated. Free objects are of one shape in all simulations.

    Raises:
        InstallationError: MuJoCo Warp is not installed.
        InputError: Unknown device.
    """

    def __init__(self, model: Any, count: int, *, device: str | None = None) -> None:
        super().__init__(model)
        self._warp, self._mjw = load_extra("warp", "warp"), load_extra("mujoco_warp", "warp")
        self._warp.config.log_level = max(self._warp.config.log_level, self._warp.LOG_WARNING)
        try:
            self.device = self._warp.get_device(device)
        except (ValueError, RuntimeError) as error:
            available = ", ".join(str(name) for name in self._warp.get_devices())
            raise InputError(f"there is no device {device!r} here: {error}; available: {available}") from None
        start = mujoco.MjData(model)
        self._home = model.key("home").id
        mujoco.mj_resetDataKeyframe(model, start, self._home)
        mujoco.mj_forward(model, start)
        rows = CONTACTS * (ELLIPTIC if model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC else PYRAMID)
        with self._warp.ScopedDevice(self.device):
            self._model = self._mjw.put_model(model)
            self._batched: tuple[Any, ...] = ()
            self._data = self._mjw.put_data(model, start, nworld=count, nconmax=CONTACTS, njmax=rows)
        self._found = (self._data.contact.worldid, self._data.contact.geom, self._data.contact.dist)
        self._start = {name: np.array(getattr(start, name)) for name in (*_STATE, "mocap_pos")}
        self._arrays = {name: np.tile(self._start[name], (count, 1)) for name in _STATE}
        self.qpos: Floats = self._arrays["qpos"]
        self.qvel: Floats = self._arrays["qvel"]
        self.ctrl: Floats = self._arrays["ctrl"]
        self.mocap: Floats = np.tile(self._start["mocap_pos"], (count, 1, 1))
        self._time, self._diverged = np.empty(count), np.empty(count, dtype=np.bool_)

    @property
    def time(self) -> Floats:
        return self._time

    def home(self, ids: Ids) -> None:
        for name, array in self._arrays.items():
            array[ids] = self._start[name]
        self.mocap[ids] = self._start["mocap_pos"]
        self._time[ids] = 0.0
        self._diverged[ids] = False

    def states(self, ids: Ids) -> Floats:
        parts = [array[ids] for array in self._arrays.values()]
        return np.concatenate([*parts, self.mocap[ids].reshape(len(ids), -1), self._time[ids, None]], axis=1)

    def put(self, ids: Ids, states: Floats) -> None:
        widths = [array.shape[1] for array in self._arrays.values()]
        *parts, mocap, time = np.split(states, np.cumsum([*widths, self.mocap[0].size]), axis=1)
        for array, part in zip(self._arrays.values(), parts, strict=True):
            array[ids] = part
        self.mocap[ids] = mocap.reshape(self.mocap[ids].shape)
        self._time[ids] = time[:, 0]
        self._diverged[ids] = False

    def put_back(self, ids: Ids, states: Floats) -> None:
        self.put(ids, states)
        self.qvel[ids] = self._arrays["qacc_warmstart"][ids] = 0.0

    def diverged(self, ids: Ids) -> NDArray[np.bool_]:
        return self._diverged[ids]

    def contacts(self, ids: Ids, posed: Callable[[Any, Floats], Any]) -> Contacts:
        data = self._data
        with self._warp.ScopedDevice(self.device):
            data.qpos.assign(self.qpos.astype(np.float32))
            self._mjw.kinematics(self._model, data)
            self._mjw.collision(self._model, data)
            found = [array.numpy()[: int(data.nacon.numpy()[0])] for array in self._found]
        rows = np.full(len(self.qpos), -1)
        rows[ids] = np.arange(len(ids))
        row = rows[found[0]]
        here = row >= 0
        return Contacts(row[here], self.model.geom_bodyid[found[1][here]], -found[2][here].astype(np.float64))

    def _expanded(self, name: str) -> NDArray[Any]:
        field = getattr(self.model, name)
        return np.tile(field, (len(self.qpos), *np.ones(field.ndim, dtype=int)))

    def update(self, ids: Ids) -> None:
        one, count = self.model_of(0), len(self.qpos)
        fields = {name: rows for name, rows in self._fields.items() if name != _COMMON}
        batched = (*one.geom_type, *fields)
        with self._warp.ScopedDevice(self.device):
            if batched != self._batched:
                mujoco.mj_setConst(one, mujoco.MjData(one))
                self._model = self._mjw.put_model(one, batch_sizes=dict.fromkeys((*fields, *_FOLLOWING), count))
                self._batched = batched
            for name, rows in fields.items():
                array = getattr(self._model, name)
                array.assign(rows.astype(np.float32).reshape(array.numpy().shape))
            self._mjw.set_const(self._model, self._data, restore=False)

    def follow(self, ids: Ids, servos: Any, setpoints: Floats, substeps: int) -> None:
        data, rows = self._data, rows_and_columns(ids, servos)
        with self._warp.ScopedDevice(self.device):
            for name, array in self._arrays.items():
                getattr(data, name).assign(array.astype(np.float32))
            for setpoint in setpoints:
                self.ctrl[rows] = setpoint
                data.ctrl.assign(self.ctrl.astype(np.float32))
                for _ in range(substeps):
                    self._mjw.step(self._model, data)
            for name in ("qpos", "qvel", "qacc_warmstart"):
                self._arrays[name][ids] = getattr(data, name).numpy()[ids]
        self._time[ids] += len(setpoints) * substeps * self.model.opt.timestep
        sound = (np.abs(self.qvel[ids]) < _UNSTABLE).all(axis=1) & np.isfinite(self.qpos[ids]).all(axis=1)
        self._diverged[ids] |= ~sound
