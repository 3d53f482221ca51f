"""Plants of a controller: one simulation or many, behind the same arrays, and where an arm's joints are in them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from copy import copy
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.robots import ArmDescription
from kinreach.robots.inside import followers
from kinreach.sim._engine import mujoco

Ids = NDArray[np.intp]

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
#: Warnings after which MuJoCo starts a simulation afresh, in the middle of whatever it was doing.
_UNSTABLE = [
    int(kind)
    for kind in (
        mujoco.mjtWarning.mjWARN_BADQPOS,
        mujoco.mjtWarning.mjWARN_BADQVEL,
        mujoco.mjtWarning.mjWARN_BADQACC,
    )
]
#: Where a batch has the number of warnings, beside where the last one was.
_NUMBER = 1


class Contacts(NamedTuple):
    """Contacts in k simulations; every array has a row for each contact.

    Attributes:
        rows: In which of the simulations, from 0 to k - 1.
        bodies: Ids of both bodies, shape (contacts, 2).
        depths: How far they are in each other [m].
    """

    rows: NDArray[np.intp]
    bodies: NDArray[np.intp]
    depths: Floats


class Plant(Protocol):
    """Simulations of one model; row i of every array belongs to simulation i.

    Attributes:
        model: The scene (`mujoco.MjModel`).
        qpos, qvel, ctrl: MuJoCo's arrays of these names, shapes (count, ...); live, a write is the state.
    """

    model: Any
    qpos: Floats
    qvel: Floats
    ctrl: Floats

    @property
    def time(self) -> Floats:
        """Simulated time [s], shape (count,)."""
        ...

    def home(self, ids: Ids) -> None:
        """Put some into the scene's keyframe, at time 0."""
        ...

    def states(self, ids: Ids) -> Floats:
        """Copy the full states of some, for `put_back`, shape (k, size)."""
        ...

    def put(self, ids: Ids, states: Floats) -> None:
        """Put some, ascending, shape (k,), into states that they or others were in, and mark them as not diverged."""
        ...

    def put_back(self, ids: Ids, states: Floats) -> None:
        """Put some into states as `put`, but at rest."""
        ...

    def diverged(self, ids: Ids) -> NDArray[np.bool_]:
        """Return which were found unstable since they were last reset or put back, shape (k,)."""
        ...

    def model_of(self, index: int) -> Any:
        """Return the model (`mujoco.MjModel`) of one, to read; valid until the next call."""
        ...

    def contacts(self, ids: Ids, posed: Callable[[Any, Floats], Any]) -> Contacts:
        """Return the contacts of some in their present postures; `posed` is as of `JointController`."""
        ...

    def own(self, name: str) -> NDArray[Any]:
        """Return a field of the model, live, with a row for each simulation; from now on each has its own."""
        ...

    def update(self, ids: Ids) -> None:
        """Compute what follows from the fields of the models that were written."""
        ...

    def follow(self, ids: Ids, servos: Any, setpoints: Floats, substeps: int) -> None:
        """Simulate some forward while their servos get one setpoint after the other.

        Args:
            ids: Which, ascending, shape (k,).
            servos: Where the servos are in `ctrl`: a slice or an array of integers.
            setpoints: Of the servos, shape (periods, k, servos); the last remains.
            substeps: Timesteps between two setpoints.
        """
        ...


def _contacts(plant: Plant, ids: Ids, posed: Callable[[Any, Floats], Any]) -> Contacts:
    counts, bodies, depths = [], [np.empty((0, 2), dtype=np.intp)], [np.empty(0)]
    for index in ids:
        model = plant.model_of(index)
        data = posed(model, plant.qpos[index])
        counts.append(data.ncon)
        if data.ncon:  # making MuJoCo's list of contacts, even of none, takes longer than a step
            bodies.append(model.geom_bodyid[data.contact.geom])
            depths.append(-data.contact.dist)
    return Contacts(np.repeat(np.arange(len(ids)), counts), np.concatenate(bodies), np.concatenate(depths))


class SinglePlant:
    """One simulation on a `mujoco.MjData` that others may read and draw.

    Attributes:
        watch: Called after every setpoint.
    """

    def __init__(self, model: Any, data: Any) -> None:
        self.model = model
        self.data = data
        self.qpos: Floats = data.qpos[None]
        self.qvel: Floats = data.qvel[None]
        self.ctrl: Floats = data.ctrl[None]
        self.watch: Callable[[], object] | None = None

    def __reduce__(self) -> tuple[type[SinglePlant], tuple[Any, Any]]:
        return SinglePlant, (self.model, self.data)  # a copy's arrays are to be those of its own data

    @property
    def time(self) -> Floats:
        return np.array([self.data.time])

    def home(self, ids: Ids) -> None:
        mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key("home").id)

    def states(self, ids: Ids) -> Floats:
        state = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, state, _STATE)
        return state[None]

    def put(self, ids: Ids, states: Floats) -> None:
        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_setState(self.model, self.data, states[0], _STATE)

    def put_back(self, ids: Ids, states: Floats) -> None:
        self.put(ids, states)
        self.data.qvel[:] = self.data.qacc_warmstart[:] = 0.0

    def diverged(self, ids: Ids) -> NDArray[np.bool_]:
        return np.array([any(self.data.warning[kind].number for kind in _UNSTABLE)])

    def model_of(self, index: int) -> Any:
        return self.model

    def contacts(self, ids: Ids, posed: Callable[[Any, Floats], Any]) -> Contacts:
        return _contacts(self, ids, posed)

    def own(self, name: str) -> NDArray[Any]:
        field: NDArray[Any] = getattr(self.model, name)
        return field[None]

    def update(self, ids: Ids) -> None:
        mujoco.mj_setConst(self.model, mujoco.MjData(self.model))

    def follow(self, ids: Ids, servos: Any, setpoints: Floats, substeps: int) -> None:
        for setpoint in setpoints[:, 0]:
            self.data.ctrl[servos] = setpoint
            mujoco.mj_step(self.model, self.data, substeps)
            if self.watch is not None:
                self.watch()


class ManyPlant(ABC):
    """Many simulations of a model, in some of whose fields each may have its own values."""

    def __init__(self, model: Any) -> None:
        self.model = model
        self._fields: dict[str, NDArray[Any]] = {}
        self._one: Any = None

    @abstractmethod
    def _expanded(self, name: str) -> NDArray[Any]:
        """Return a field of the model with a row for each simulation, live."""

    def own(self, name: str) -> NDArray[Any]:
        if name not in self._fields:
            self._fields[name] = self._expanded(name)
        return self._fields[name]

    def model_of(self, index: int) -> Any:
        if not self._fields:
            return self.model
        if self._one is None:
            self._one = copy(self.model)
        for name, rows in self._fields.items():
            getattr(self._one, name)[:] = rows[index]
        return self._one


class BatchPlant(ManyPlant):
    """Many simulations, stepped by MuJoCo's batch.

    Attributes:
        mocap: Places of what is moved from outside [m], shape (count, bodies, 3).
    """

    def __init__(self, model: Any, batch: Any) -> None:
        super().__init__(model)
        self.batch = batch
        self.mocap: Floats = batch.bind("mocap_pos")
        self._home = model.key("home").id
        self.qpos: Floats = batch.bind("qpos")
        self.qvel: Floats = batch.bind("qvel")
        self.ctrl: Floats = batch.bind("ctrl")
        self._time: Floats = batch.bind("time")
        self._warmstart: Floats = batch.bind("qacc_warmstart")

    @property
    def time(self) -> Floats:
        return self._time

    def home(self, ids: Ids) -> None:
        self.batch.reset(ids=ids, keyframe=self._home, stage=mujoco.mjtStage.mjSTAGE_NONE)

    def states(self, ids: Ids) -> Floats:
        return self.batch.state[ids]

    def put(self, ids: Ids, states: Floats) -> None:
        self.batch.reset(ids=ids, stage=mujoco.mjtStage.mjSTAGE_NONE)
        self.batch.state[ids] = states

    def put_back(self, ids: Ids, states: Floats) -> None:
        self.put(ids, states)
        self.qvel[ids] = self._warmstart[ids] = 0.0

    def diverged(self, ids: Ids) -> NDArray[np.bool_]:
        return self.batch.warning[ids][:, _UNSTABLE, _NUMBER].any(axis=1)

    def contacts(self, ids: Ids, posed: Callable[[Any, Floats], Any]) -> Contacts:
        return _contacts(self, ids, posed)

    def _expanded(self, name: str) -> NDArray[Any]:
        rows: NDArray[Any] = self.batch.expand(name)
        return rows

    def update(self, ids: Ids) -> None:
        self.batch.set_const(ids)

    def follow(self, ids: Ids, servos: Any, setpoints: Floats, substeps: int) -> None:
        periods, count = setpoints.shape[:2]
        control = np.empty((count, periods, substeps, self.ctrl.shape[1]))
        control[:] = self.ctrl[ids, None, None]
        control[..., servos] = setpoints.swapaxes(0, 1)[:, :, None]
        everyone = len(ids) == len(self.ctrl)  # saves MuJoCo the check of the ids
        self.batch.rollout(
            periods * substeps, control.reshape(count, periods * substeps, -1), record=(), ids=None if everyone else ids
        )


def rows_and_columns(rows: Any, columns: Any) -> Any:
    """Index of some rows and columns of a matrix, each a slice or an array of integers."""
    return (rows, columns) if isinstance(rows, slice) or isinstance(columns, slice) else np.ix_(rows, columns)


def as_index(addresses: Sequence[int]) -> slice | NDArray[np.intp]:
    """Return where the joints are in one of MuJoCo's arrays; a slice (a view, and faster) if they lie side by side."""
    index = np.array(addresses, dtype=np.intp)
    if (np.diff(index) == 1).all():
        return slice(int(index[0]), int(index[-1]) + 1)
    return index


class ArmJoints:
    """The joints of an arm in a scene.

    MuJoCo has a number for a joint that follows another, too, and a constraint that brings it where the other has it.

    Attributes:
        qpos, dof: Where the arm's joints are in MuJoCo's `qpos` and `qvel`, without those that follow them.
    """

    def __init__(self, arm: ArmDescription, model: Any) -> None:
        joints = [model.joint(name) for name in arm.joints]
        self.qpos = as_index([joint.qposadr[0] for joint in joints])
        self.dof = as_index([joint.dofadr[0] for joint in joints])
        follow = followers(arm)
        self._any = bool(follow)
        self._leader = np.array([arm.joints.index(how.joint) for how in follow.values()], dtype=np.intp)
        self._factor = np.array([how.factor for how in follow.values()])
        self._offset = np.array([how.offset for how in follow.values()])
        self._their_qpos = np.array([model.joint(name).qposadr[0] for name in follow], dtype=np.intp)
        self._their_dof = np.array([model.joint(name).dofadr[0] for name in follow], dtype=np.intp)

    def put(self, qpos: Floats, rows: Any, q: Floats) -> None:
        """Write postures into some rows of MuJoCo's `qpos`, shape (count, nq).

        Args:
            qpos: MuJoCo's array, live.
            rows: A slice, or k integers.
            q: Postures [rad, m], shape (k, n), or (n,) for the same in all.
        """
        qpos[rows_and_columns(rows, self.qpos)] = q
        if self._any:
            qpos[rows_and_columns(rows, self._their_qpos)] = q[..., self._leader] * self._factor + self._offset

    def spread(self, change: Floats, full: Floats) -> None:
        """Write a change of the arm's joints, shape (n,), into that of everything, shape (nv,)."""
        full[self.dof] = change
        if self._any:
            full[self._their_dof] = change[self._leader] * self._factor

    def gathered(self, full: Floats) -> Floats:
        """Return what forces on everything, shape (nv,), are to the arm's joints, shape (n,)."""
        own: Floats = full[self.dof].copy()
        if self._any:
            np.add.at(own, self._leader, full[self._their_dof] * self._factor)
        return own
