"""Arms under torque: one simulation, or a native batch of them, behind the same arrays."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from kinreach.envs.button.actuation import Actuation
from kinreach.envs.button.scene import ButtonDrawing, ButtonState, torque_model
from kinreach.envs.engine import mujoco
from kinreach.kinematics.goals import Floats
from kinreach.robots import ArmDescription

Ids = NDArray[np.intp]


class TorqueWorld(Protocol):
    """A number of equal arms; row i of every array belongs to arm i, in the world frame.

    Attributes:
        q, qd: Joint angles [rad] and velocities [rad/s], shape (count, 3); live.
        tip: Positions of the end effector [m], shape (count, 3); live.
    """

    count: int
    q: Floats
    qd: Floats
    tip: Floats

    def reset(self, ids: Ids, targets: Floats, q: Floats, qd: Floats) -> None:
        """Put whole states back: arms without torque, in given states, all of shape (k, 3)."""
        ...

    def step(self, control: Floats) -> None:
        """Simulate one step of the environment under controls, shape (count, 3)."""
        ...

    def show(self, state: ButtonState) -> None:
        """Let the button that is drawn, if there is one, show what came of a step."""
        ...


class SingleTorqueWorld:
    """One arm under torque; a `kinreach.envs.picture.Scene`.

    Args:
        arm: Whose scene.
        actuation: Motors, friction and time.
        visual: Make it look good, with the button.

    Attributes:
        model, data: MuJoCo's.
        watch: Called after every step, when the button shows what came of it.
    """

    count = 1

    def __init__(self, arm: ArmDescription, actuation: Actuation, *, visual: bool) -> None:
        self.model: Any = torque_model(arm, actuation, visual=visual)
        self.data: Any = mujoco.MjData(self.model)
        self.watch: Callable[[], object] | None = None
        self._frame_skip = actuation.frame_skip
        self._drawing = ButtonDrawing(self.model)
        self._target: Floats = np.zeros(3)
        tip = self.model.body(arm.tips[arm.default_tip]).id
        self.q: Floats = self.data.qpos[None]
        self.qd: Floats = self.data.qvel[None]
        self.tip: Floats = self.data.xpos[None, tip]

    def reset(self, ids: Ids, targets: Floats, q: Floats, qd: Floats) -> None:
        """Put the whole state back."""
        mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key("home").id)
        self.q[:], self.qd[:] = q, qd
        self._target = targets[0]
        self._drawing.show(self.data.mocap_pos, self._target, ButtonState.IDLE)
        mujoco.mj_fwdPosition(self.model, self.data)

    def step(self, control: Floats) -> None:
        """Simulate one step of the environment."""
        self.data.ctrl[:] = control[0]
        mujoco.mj_step(self.model, self.data, self._frame_skip)
        mujoco.mj_kinematics(self.model, self.data)  # after a step the poses are those before its last substep

    def show(self, state: ButtonState) -> None:
        """Let the button show a state, and whoever watches see it."""
        self._drawing.show(self.data.mocap_pos, self._target, state)
        if self.watch is not None:
            self.watch()


class BatchTorqueWorld:
    """Many arms under torque, bit for bit what as many `SingleTorqueWorld` would do.

    Args:
        arm: Whose scene.
        actuation: Motors, friction and time.
        count: Number of arms.
        threads: Threads that step them.
    """

    def __init__(self, arm: ArmDescription, actuation: Actuation, count: int, *, threads: int = 1) -> None:
        self.count = count
        model = torque_model(arm, actuation, visual=False)
        self._batch: Any = importlib.import_module("mujoco.batch").Batch(model, count, threads)
        self._frame_skip = actuation.frame_skip
        self._home = model.key("home").id
        self._drawing = ButtonDrawing(model)
        self.q: Floats = self._batch.bind("qpos")
        self.qd: Floats = self._batch.bind("qvel")
        self.tip: Floats = self._batch.bind("xpos")[:, model.body(arm.tips[arm.default_tip]).id]
        self._ctrl: Floats = self._batch.bind("ctrl")
        self._mocap: Floats = self._batch.bind("mocap_pos")

    def reset(self, ids: Ids, targets: Floats, q: Floats, qd: Floats) -> None:
        """Put whole states back."""
        stages = mujoco.mjtStage
        self._batch.reset(ids=ids, keyframe=self._home, stage=stages.mjSTAGE_NONE)
        self.q[ids], self.qd[ids] = q, qd
        for index, target in zip(ids, targets, strict=True):
            self._drawing.show(self._mocap[index], target, ButtonState.IDLE)
        self._batch.forward(ids=ids, stage=stages.mjSTAGE_POS)

    def step(self, control: Floats) -> None:
        """Simulate one step of the environment."""
        self._ctrl[:] = control
        self._batch.step(nstep=self._frame_skip, stage=mujoco.mjtStage.mjSTAGE_POS)

    def show(self, state: ButtonState) -> None:
        """Nothing is drawn of a batch."""
