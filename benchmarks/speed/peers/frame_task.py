"""What pink and mink share: both follow a frame task by quadratic programs, in the same loop, under the same names."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np

from kinreach.checks import Floats
from kinreach.kinematics.goals import Goal
from kinreach.kinematics.solvers import Tolerance
from kinreach.kinematics.solvers.iterative import STALLED, Descend, Descent, IterativeSolver, goal_frame

#: Duration of one step [s].
STEP = 0.2


class FrameTaskSolver(IterativeSolver):
    """The loop of `solve_ik` and `integrate_inplace`, until it is near enough, with the restarts of our own solvers.

    Speed limits are those of the URDF, and joints that turn full circle have no position limit on the way, as in
    `PlacoSolver`.
    """

    #: The peer's own; set by the subclass.
    _configuration: Any
    _task: Any

    @abstractmethod
    def _pose(self, T: Floats) -> Any:
        """A pose (4, 4) as the peer takes it."""

    @abstractmethod
    def _velocity(self) -> Floats:
        """Velocity of the joints [rad/s], shape (n,), that the peer's program finds for the next step."""

    def _descender(self, goal: Goal) -> Descend:
        self._task.set_target(self._pose(self.kin.T_world_base @ goal_frame(goal)))
        return self._descend

    def _descend(self, q: Floats) -> Descent:
        task, configuration = self._task, self._configuration
        configuration.update(q)
        for step in range(self.max_iterations):
            if _near(task.compute_error(configuration), self.tolerance):
                return Descent(configuration.q, step)
            velocity = self._velocity()
            configuration.integrate_inplace(velocity, STEP)
            if np.abs(velocity).max() * STEP < STALLED:
                return Descent(configuration.q, step + 1)
        return Descent(configuration.q, self.max_iterations)


def _near(error: Floats, tolerance: Tolerance) -> bool:
    """Whether the error of a frame task, position [m] then orientation [rad], shape (6,), is within a tolerance."""
    p, o = error[:3], error[3:]
    return bool(p.dot(p) <= tolerance.position**2 and o.dot(o) <= tolerance.orientation**2)
