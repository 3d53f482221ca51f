"""Damped least squares on Pinocchio, with damping that fades as the goal comes near."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from kinreach._checks import Floats
from kinreach.kinematics._goals import Goal
from kinreach.kinematics._solvers.iterative import Descend, Descent, GoalTask, IterativeSolver

#: Damping per unit of the squared error E = |e|^2 / 2 ...
DAMPING = 0.1
#: ... and the part that stays at the goal, so that the step is defined in singular postures.
DAMPING_BIAS = 1e-6


class LevenbergMarquardtSolver(IterativeSolver):
    r"""Levenberg-Marquardt, damped by the error.

    .. math::

        (J^\top J + \lambda W)\, \Delta q = J^\top e, \qquad
        \lambda = 0.1 E + 10^{-6}, \quad E = \tfrac{1}{2} |e|^2

    W is the unit matrix, but for joints that slide (`JointSpace.damping`).

    Damping by the error itself is robust for goals out of reach and near singularities, and converges quadratically
    where E vanishes (Sugihara, "Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method", IEEE
    T-RO 27(5), 2011; proportional to E as in Chan and Lawrence, "General inverse kinematics with the error damped
    pseudoinverse", ICRA 1988). Each step is projected into the joint limits: a joint that would be pushed through one
    is held, and the others take the step without it (see `JointSpace` for joints that turn full circle). `iterative`
    has the equations of e and J.

    The arguments are those of `IterativeSolver`. Threads may share an instance.
    """

    name: ClassVar[str] = "lm"

    def _descender(self, goal: Goal) -> Descend:
        from scipy.linalg.lapack import dposv  # takes as long to import as Pinocchio

        task = GoalTask(self.kin, goal, self.tolerance)
        lower, upper = self.joint_space.search_lower, self.joint_space.search_upper
        damping = np.diag(self.joint_space.damping)

        def step_from(e: Floats, J: Floats) -> Floats:
            A = J.T.dot(J) + (0.5 * DAMPING * e.dot(e) + DAMPING_BIAS) * damping
            return dposv(A, J.T.dot(e))[1]

        def descend(q: Floats) -> Descent:
            for step in range(self.max_iterations):
                e, J = task.linearise(q)
                if task.reached(e):
                    return Descent(q, step)
                dq = step_from(e, J)
                held = ((q <= lower) & (dq < 0)) | ((q >= upper) & (dq > 0))
                if held.any():
                    dq = step_from(e, np.where(held, 0.0, J))
                q = np.minimum(np.maximum(q + dq, lower), upper)
            return Descent(q, self.max_iterations)

        return descend
