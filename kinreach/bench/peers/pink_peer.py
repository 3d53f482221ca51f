"""pink (Caron et al.): a frame task in a quadratic program, on Pinocchio."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from kinreach.engines import load
from kinreach.kinematics.arm import ArmKinematics
from kinreach.kinematics.goals import Floats, Goal
from kinreach.kinematics.solvers import Tolerance
from kinreach.kinematics.solvers.goal_task import goal_frame
from kinreach.kinematics.solvers.iterative import STALLED, Descend, Descent, IterativeSolver

#: Limit [rad] for joints that turn full circle: no search gets there.
NO_LIMIT = 100.0
#: Duration of one step [s].
STEP = 0.2
#: Levenberg-Marquardt damping of the task: of 1, 0.1, 0.01, 0.001 and 1e-6 the one with which it succeeds most often.
DAMPING = 0.1


class PinkSolver(IterativeSolver):
    """pink's loop of `solve_ik` and `integrate_inplace`, until it is near enough, with the restarts of our own solvers.

    Speed limits are those of the URDF, and joints that turn full circle have no position limit on the way, as in
    `PlacoSolver`.
    """

    name: ClassVar[str] = "pink"

    def __init__(self, kin: ArmKinematics, *, tolerance: Tolerance, max_restarts: int = 20) -> None:
        super().__init__(kin, tolerance=tolerance, max_restarts=max_restarts)
        import pink

        pin = load("pinocchio")
        self._solve_ik = pink.solve_ik
        self._SE3 = pin.SE3
        model = kin.model.copy()
        model.lowerPositionLimit = np.maximum(self.joint_space.search_lower, -NO_LIMIT)
        model.upperPositionLimit = np.minimum(self.joint_space.search_upper, NO_LIMIT)
        self._configuration = pink.Configuration(model, model.createData(), np.zeros(kin.n))
        self._task = pink.tasks.FrameTask(kin.arm.tips[kin.tip], 1.0, 1.0, lm_damping=DAMPING)

    def _descender(self, goal: Goal) -> Descend:
        task, configuration, solve_ik = self._task, self._configuration, self._solve_ik
        task.set_target(self._SE3(self.kin.T_world_base @ goal_frame(goal)))

        def descend(q: Floats) -> Descent:
            configuration.update(q)
            for step in range(self.max_iterations):
                if near(task.compute_error(configuration), self.tolerance):
                    return Descent(configuration.q, step)
                velocity = solve_ik(configuration, [task], STEP, solver="daqp")
                configuration.integrate_inplace(velocity, STEP)
                if np.abs(velocity).max() * STEP < STALLED:
                    return Descent(configuration.q, step + 1)
            return Descent(configuration.q, self.max_iterations)

        return descend


def near(error: Any, tolerance: Tolerance) -> bool:
    """Whether the error of a frame task, position [m] then orientation [rad], shape (6,), is within a tolerance."""
    p, o = error[:3], error[3:]
    return bool(p.dot(p) <= tolerance.position**2 and o.dot(o) <= tolerance.orientation**2)
