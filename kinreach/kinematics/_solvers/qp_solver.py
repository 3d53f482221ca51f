"""Differential inverse kinematics as a quadratic program, iterated to convergence."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from kinreach._checks import Floats
from kinreach.errors import InstallationError
from kinreach.kinematics._goals import Goal
from kinreach.kinematics._solvers.iterative import STALLED, Descend, Descent, GoalTask, SteppingSolver

#: Levenberg-Marquardt damping per unit of the squared error, as the frame tasks of pink and mink have it ...
DAMPING = 0.01
#: ... and the part that stays at the goal and makes the program strictly convex.
DAMPING_BIAS = 1e-6


class QPSolver(SteppingSolver):
    r"""The step of pink and mink, with daqp behind qpsolvers.

    Each step solves

    .. math::

        \min_{\Delta q} \; |J \Delta q - e|^2 + \mu |\Delta q|^2, \quad \mu = 0.01 |e|^2 + 10^{-6}
        \quad \text{with} \quad \max(l - q, -v \Delta t) \le \Delta q \le \min(u - q, v \Delta t)

    with the limits l and u and the URDF's joint speed limits v, and the last term weighted by `JointSpace.damping`
    where joints slide (Kanoun et al., "Kinematic control of redundant manipulators", IEEE T-RO 27(4), 2011; the damping
    is Sugihara's, as in `LevenbergMarquardtSolver`). Joints that turn full circle have no position limit on the way
    (see `JointSpace`). `iterative` has the equations of e and J. Threads may share an instance.

    The arguments are those of `SteppingSolver`.

    Raises:
        InputError: A count, a tolerance or `dt` cannot be used.
        InstallationError: qpsolvers cannot be loaded.
    """

    name: ClassVar[str] = "qp"

    def _prepare(self) -> None:
        try:  # only this solver needs it
            from qpsolvers import solve_qp
        except ImportError as error:
            raise InstallationError(f"{error}; the QP solver needs: pip install 'qpsolvers[daqp]'") from error
        self._solve_qp = solve_qp

    def _descender(self, goal: Goal) -> Descend:
        task = GoalTask(self.kin, goal, self.tolerance)
        lower, upper = self.joint_space.search_lower, self.joint_space.search_upper
        largest_step = self.dt * self.kin.velocity_limit
        damping = np.diag(self.joint_space.damping)
        solve_qp = self._solve_qp

        def descend(q: Floats) -> Descent:
            for step in range(self.max_iterations):
                e, J = task.linearise(q)
                if task.reached(e):
                    return Descent(q, step)
                H = J.T.dot(J) + (DAMPING * e.dot(e) + DAMPING_BIAS) * damping
                lb = np.maximum(lower - q, -largest_step)
                ub = np.minimum(upper - q, largest_step)
                if len(q) == 1:  # daqp refuses problems of one variable
                    dq = np.clip(J.T.dot(e) / H[0], lb, ub)
                else:
                    dq = solve_qp(H, -J.T.dot(e), lb=lb, ub=ub, solver="daqp")
                if dq is None:
                    return Descent(q, step)
                q = q + dq
                if np.abs(dq).max() < STALLED:
                    return Descent(q, step + 1)
            return Descent(q, self.max_iterations)

        return descend
