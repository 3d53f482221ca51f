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

    def step(self, ids: Ids, substeps: int) -> None:
        """Simulate those of the given ids (ascending) forward by a number of timesteps."""
        ...


class SinglePlant:
    """One simulation on a `mujoco.MjData` that others may read and draw.

    Attributes:
        watch: Called after every `step`.
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

    def step(self, ids: Ids, substeps: int) -> None:
        """Simulate forward."""
        mujoco.mj_step(self.model, self.data, substeps)
        if self.watch is not None:
            self.watch()


class BatchPlant:
    """Many simulations, stepped by MuJoCo's own threads.

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

    def step(self, ids: Ids, substeps: int) -> None:
        """Simulate forward."""
        everyone = len(ids) == len(self.ctrl)  # saves MuJoCo the check of the ids, 3 % of the time of 64 simulations
        self.batch.step(ids=None if everyone else ids, nstep=substeps)


def rows_and_columns(rows: Any, columns: Any) -> Any:
    """Index of some rows and columns of a matrix, each a slice or an array of integers."""
    return (rows, columns) if isinstance(rows, slice) or isinstance(columns, slice) else np.ix_(rows, columns)
