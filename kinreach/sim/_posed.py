"""Scene of an arm without dynamics: it is put into postures."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import MAX_DISTANCE, Floats, as_vector
from kinreach.robots import ArmDescription
from kinreach.sim._engine import mujoco
from kinreach.sim._plants import ArmJoints
from kinreach.sim._scene import BALL, scene_model

#: Time between two postures of `go` [s].
PERIOD = 0.02


class PosedScene:
    """An arm, its work cell and the ball, drawn where they are put; nothing moves by itself.

    Attributes:
        data: MuJoCo's state.
        watch: Called in the course of `go`.
    """

    def __init__(self, arm: ArmDescription, *, model: Any = None) -> None:
        self.arm = arm
        self.model: Any = scene_model(arm) if model is None else model
        self.data: Any = mujoco.MjData(self.model)
        self.watch: Callable[[], object] | None = None
        mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key("home").id)
        self._joints = ArmJoints(arm, self.model)
        self._ball = int(self.model.body(BALL).mocapid[0])

    @property
    def q(self) -> Floats:
        """Posture [rad], shape (n,)."""
        return self.data.qpos[self._joints.qpos].copy()

    def put(self, q: ArrayLike, *, ball: ArrayLike | None = None, time: float | None = None) -> None:
        """Put the arm into a posture (n,) [rad], within its limits or not; ball [m] and time [s] stay if not given."""
        self._joints.put(self.data.qpos[None], slice(None), as_vector("q", q, len(self.arm.joints)))
        if ball is not None:
            self.data.mocap_pos[self._ball] = as_vector("ball", ball, 3, most=MAX_DISTANCE)
        if time is not None:
            self.data.time = time

    def go(self, q: ArrayLike, *, ball: ArrayLike | None = None) -> None:
        """Move to a posture smoothly, all joints together, the fastest at the arm's limit of speed.

        Arguments and errors are those of `put`; the ball is placed at the start.
        """
        start, end = self.q, as_vector("q", q, len(self.arm.joints))
        seconds = 1.5 * float(np.abs(end - start).max()) / self.arm.speed_limit
        count = max(1, round(seconds / PERIOD))
        for share in np.linspace(0.0, 1.0, count + 1)[1:]:
            self.put(start + share**2 * (3.0 - 2.0 * share) * (end - start), ball=ball, time=self.data.time + PERIOD)
            if self.watch is not None:
                self.watch()
