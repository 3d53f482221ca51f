"""mink (Zakka): a frame task in a quadratic program, on MuJoCo."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from benchmarks.speed.peers.base import coordinate_axis
from benchmarks.speed.peers.frame_task import STEP, FrameTaskSolver
from kinreach.checks import Floats
from kinreach.engines import load
from kinreach.kinematics.arm import ArmKinematics
from kinreach.kinematics.solvers import Tolerance

#: Levenberg-Marquardt damping of the task, chosen as pink's, and damping of the program.
TASK_DAMPING, DAMPING = 0.1, 1e-6


class MinkSolver(FrameTaskSolver):
    """mink on the arm's joints in MuJoCo."""

    name: ClassVar[str] = "mink"

    def __init__(self, kin: ArmKinematics, *, tolerance: Tolerance, max_restarts: int = 20) -> None:
        super().__init__(kin, tolerance=tolerance, max_restarts=max_restarts)
        import mink

        self._solve_ik, self._pose_type = mink.solve_ik, mink.SE3
        model = _chain(kin, self.joint_space.search_lower, self.joint_space.search_upper)
        self._configuration = mink.Configuration(model)
        self._task = mink.FrameTask("tip", "site", position_cost=1.0, orientation_cost=1.0, lm_damping=TASK_DAMPING)
        speeds = dict(zip(kin.arm.joints, kin.velocity_limit, strict=True))
        self._limits = [mink.ConfigurationLimit(model), mink.VelocityLimit(model, speeds)]

    def _pose(self, T: Floats) -> Any:
        return self._pose_type.from_matrix(T)

    def _velocity(self) -> Floats:
        velocity: Floats = self._solve_ik(
            self._configuration, [self._task], STEP, "daqp", damping=DAMPING, limits=self._limits
        )
        return velocity


def _chain(kin: ArmKinematics, lower: Floats, upper: Floats) -> Any:
    """The arm's joints and its tip as a MuJoCo model in the world frame; bodies without shape."""
    import mujoco

    pin: Any = load("pinocchio")
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    body = spec.worldbody
    for index, name in enumerate(kin.arm.joints):
        placement = kin.model.jointPlacements[index + 1]
        x, y, z, w = pin.Quaternion(placement.rotation).coeffs()
        body = body.add_body(name=f"link_{index + 1}", pos=placement.translation, quat=[w, x, y, z])
        body.mass, body.inertia, body.explicitinertial = 1.0, np.full(3, 0.01), True
        limited = np.isfinite(lower[index])
        span = [lower[index], upper[index]] if limited else [0.0, 0.0]
        axis = np.eye(3)[coordinate_axis(kin, index)]
        body.add_joint(name=name, axis=axis, limited=int(limited), range=span)
    placement = kin.model.frames[kin.tip_frame].placement
    x, y, z, w = pin.Quaternion(placement.rotation).coeffs()
    body.add_site(name="tip", pos=placement.translation, quat=[w, x, y, z])
    return spec.compile()
