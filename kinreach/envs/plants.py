"""What a controller moves: one simulation or many of them, behind the same arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from kinreach.envs.engine import mujoco
from kinreach.kinematics.goals import Floats

Ids = NDArray[np.intp]


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

    def follow(self, ids: Ids, servos: Any, setpoints: Floats, substeps: int) -> None:
        """Simulate some forward while their servos are told one setpoint after the other.

        Args:
            ids: Which, ascending, shape (k,).
            servos: Where the servos are in `ctrl`: a slice or an array of integers.
            setpoints: What they are told, shape (periods, k, servos); the last remains.
            substeps: Timesteps between two setpoints.
        """
        ...


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
        """Simulated time [s], shape (1,)."""
        return np.array([self.data.time])

    def follow(self, ids: Ids, servos: Any, setpoints: Floats, substeps: int) -> None:
        """Simulate forward; see `Plant.follow`."""
        for setpoint in setpoints[:, 0]:
            self.data.ctrl[servos] = setpoint
            mujoco.mj_step(self.model, self.data, substeps)
            if self.watch is not None:
                self.watch()


class BatchPlant:
    """Many simulations, stepped by MuJoCo's batch.

    Attributes:
        batch: MuJoCo's batch.
    """

    def __init__(self, model: Any, batch: Any) -> None:
        self.model = model
        self.batch = batch
        self.qpos: Floats = batch.bind("qpos")
        self.qvel: Floats = batch.bind("qvel")
        self.ctrl: Floats = batch.bind("ctrl")
        self._time: Floats = batch.bind("time")

    @property
    def time(self) -> Floats:
        """Simulated time [s], shape (count,)."""
        return self._time

    def follow(self, ids: Ids, servos: Any, setpoints: Floats, substeps: int) -> None:
        """Simulate forward, in one call; see `Plant.follow`."""
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
