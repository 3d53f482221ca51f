"""Inverse-kinematics solvers behind one protocol: the closed form, and three iterative ones to compare it with."""

from kinreach.kinematics.solvers.base import ClosedFormSolver, Solver, Tolerance
from kinreach.kinematics.solvers.levenberg_marquardt import LevenbergMarquardtSolver
from kinreach.kinematics.solvers.placo_solver import PlacoSolver
from kinreach.kinematics.solvers.qp_solver import QPSolver

__all__ = ["ClosedFormSolver", "LevenbergMarquardtSolver", "PlacoSolver", "QPSolver", "Solver", "Tolerance"]
