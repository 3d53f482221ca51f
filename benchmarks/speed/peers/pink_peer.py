"""pink (Caron et al.): a frame task in a quadratic program, on Pinocchio."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from benchmarks.speed.peers.frame_task import STEP, FrameTaskSolver
from kinreach.checks import Floats
from kinreach.engines import load
from kinreach.kinematics.arm import ArmKinematics
from kinreach.kinematics.solvers import Tolerance
from kinreach.kinematics.solvers.placo_solver import NO_LIMIT

#: Levenberg-Marquardt damping of the task: of 1, 0.1, 0.01, 0.001 and 1e-6 the one with which it succeeds most often.
DAMPING = 0.1


class PinkSolver(FrameTaskSolver):
    """pink on the arm's Pinocchio model."""

    name: ClassVar[str] = "pink"

    def __init__(self, kin: ArmKinematics, *, tolerance: Tolerance, max_restarts: int = 20) -> None:
        super().__init__(kin, tolerance=tolerance, max_restarts=max_restarts)
        import pink

        self._solve_ik = pink.solve_ik
        self._pose_type = load("pinocchio").SE3
        model = kin.model.copy()
        model.lowerPositionLimit = np.maximum(self.joint_space.search_lower, -NO_LIMIT)
        model.upperPositionLimit = np.minimum(self.joint_space.search_upper, NO_LIMIT)
        self._configuration = pink.Configuration(model, model.createData(), np.zeros(kin.n))
        self._task = pink.tasks.FrameTask(kin.arm.tips[kin.tip], 1.0, 1.0, lm_damping=DAMPING)

    def _pose(self, T: Floats) -> Any:
        return self._pose_type(T)

    def _velocity(self) -> Floats:
        velocity: Floats = self._solve_ik(self._configuration, [self._task], STEP, solver="daqp")
        return velocity
