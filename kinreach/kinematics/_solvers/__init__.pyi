from .base import SOLVERS as SOLVERS
from .base import ClosedFormSolver as ClosedFormSolver
from .base import Solver as Solver
from .base import Tolerance as Tolerance
from .base import new_solver as new_solver
from .levenberg_marquardt import LevenbergMarquardtSolver as LevenbergMarquardtSolver
from .placo_solver import PlacoSolver as PlacoSolver
from .qp_solver import QPSolver as QPSolver
