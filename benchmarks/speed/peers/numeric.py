"""Iterative solvers of the UR5: roboticstoolbox, TRAC-IK, OptIK, pink, mink and ikpy."""

from __future__ import annotations

import contextlib
import tempfile
from abc import abstractmethod
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from benchmarks.speed.peers.base import IKPeer, coordinate_axis
from kinreach._checks import Floats
from kinreach._engines import load
from kinreach.kinematics._arm import ArmKinematics
from kinreach.kinematics._goals import Goal
from kinreach.kinematics._solvers import Tolerance
from kinreach.kinematics._solvers.iterative import STALLED, Descend, Descent, IterativeSolver
from kinreach.kinematics._solvers.placo_solver import NO_LIMIT

#: Searches that it may start, as the other solvers with restarts: one from the seed and 20 from random postures.
SEARCHES = 21


def make_roboticstoolbox(seed: Floats, tolerance: Tolerance) -> IKPeer:
    """Roboticstoolbox (Corke, Haviland), in C++: `ik_LM` of the UR5.

    Its residual is half the squared norm of the error, metres and radians alike; the bound is the one that implies
    the position's tolerance.

    Args:
        seed: Posture to start from [rad], shape (6,).
        tolerance: How near is reached.
    """
    robot = elementary_transforms(ArmKinematics("ur5-thesis", tip="tool0"))
    bound = tolerance.position**2 / 2

    def call(T: Floats) -> Any:
        return robot.ik_LM(T, q0=seed, tol=bound, slimit=SEARCHES)

    def once(T: Floats) -> Any:
        return robot.ik_LM(T, q0=seed, tol=bound, slimit=1)

    def postures(found: Any) -> Floats:
        return np.atleast_2d(found.q) if found.success else np.empty((0, 6))

    note = f"ik_LM(T, q0, tol={bound:g}, slimit={SEARCHES})"
    return IKPeer(note, np.ascontiguousarray, call, postures, once=once)


def elementary_transforms(kin: ArmKinematics) -> Any:
    """The arm as an `ETS` with its limits, from base to tip."""
    from roboticstoolbox import ET, ETS

    turns = (ET.Rx, ET.Ry, ET.Rz)
    parts = []
    for index in range(kin.n):
        placement = kin.model.jointPlacements[index + 1].homogeneous
        parts.append(ET.SE3(kin.T_base_world @ placement if index == 0 else placement))
        turn = turns[coordinate_axis(kin, index)]
        parts.append(turn(jindex=index, qlim=[kin.lower[index], kin.upper[index]]))
    parts.append(ET.SE3(kin.model.frames[kin.tip_frame].placement.homogeneous))
    return ETS(parts)


#: Longest that it may search for one pose [s]; its own 5 ms leave some poses unsolved.
TIMEOUT = 0.05


def make_trac_ik(seed: Floats, tolerance: Tolerance) -> IKPeer:
    """TRAC-IK (Beeson and Ames) by its Python binding pytracik: two solvers in C++ that run side by side.

    By default it is as fast as it can be (`solver_type="Speed"`).

    Args:
        seed: Posture to start from [rad], shape (6,).
        tolerance: How near is reached. It has one bound for each component of the error, metres and radians alike:
            the position's over the root of three.
    """
    from trac_ik import TracIK

    epsilon = tolerance.position / 3**0.5
    with _ur5_file() as (file, base, tip):
        solver = TracIK(base, tip, file, timeout=TIMEOUT, epsilon=epsilon)

    def call(pose: tuple[Floats, Floats]) -> Any:
        return solver.ik(*pose, seed)

    def postures(found: Any) -> Floats:
        return np.empty((0, 6)) if found is None else np.atleast_2d(found)

    note = f"TracIK(..., timeout={TIMEOUT}, epsilon={epsilon:.3g}).ik(p, R, seed)"
    return IKPeer(note, lambda T: (T[:3, 3].copy(), T[:3, :3].copy()), call, postures)


def make_optik(seed: Floats, tolerance: Tolerance) -> IKPeer:
    """OptIK (Wang) by its Python binding optik-py: a quasi-Newton method in Rust with restarts, on one thread.

    Args:
        seed: Posture to start from [rad], shape (6,).
        tolerance: How near is reached. Its bound is of half the squared norm of the error, metres and radians alike.
    """
    from optik import Robot, SolverConfig

    bound, start = tolerance.position**2 / 2, seed.tolist()
    with _ur5_file() as (file, base, tip):
        robot = Robot.from_urdf_file(file, base, tip)
    robot.set_parallelism(1)
    config = SolverConfig(max_time=TIMEOUT, max_restarts=SEARCHES - 1, tol_f=bound)
    alone = SolverConfig(max_time=TIMEOUT, max_restarts=1, tol_f=bound)

    def postures(found: Any) -> Floats:
        return np.empty((0, 6)) if found is None else np.atleast_2d(found[0])

    note = f"ik(SolverConfig(max_time={TIMEOUT}, max_restarts={SEARCHES - 1}, tol_f={bound:g}), T, seed)"
    return IKPeer(
        note,
        lambda T: T.tolist(),
        lambda T: robot.ik(config, T, start),
        postures,
        once=lambda T: robot.ik(alone, T, start),
    )


@contextlib.contextmanager
def _ur5_file() -> Iterator[tuple[str, str, str]]:
    """The UR5's URDF as a file, and its links of base and flange."""
    arm = ArmKinematics("ur5-thesis", tip="tool0").arm
    with tempfile.TemporaryDirectory() as folder:
        urdf = Path(folder) / "arm.urdf"
        urdf.write_text(arm.urdf, encoding="utf-8")
        yield str(urdf), arm.base, arm.tips["tool0"]


#: Duration of one step [s].
STEP = 0.2


class FrameTaskSolver(IterativeSolver):
    """What pink and mink share: both follow a frame task by quadratic programs, under the same names.

    The loop of `solve_ik` and `integrate_inplace`, until it is near enough, with the restarts of our own solvers.

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
        self._task.set_target(self._pose(self.kin.T_world_base @ goal.frame()))
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


#: Levenberg-Marquardt damping of the task: of 1, 0.1, 0.01, 0.001 and 1e-6 the one with which it succeeds most often.
PINK_DAMPING = 0.1


class PinkSolver(FrameTaskSolver):
    """pink (Caron et al.) on the arm's Pinocchio model."""

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
        self._task = pink.tasks.FrameTask(kin.arm.tips[kin.tip], 1.0, 1.0, lm_damping=PINK_DAMPING)

    def _pose(self, T: Floats) -> Any:
        return self._pose_type(T)

    def _velocity(self) -> Floats:
        velocity: Floats = self._solve_ik(self._configuration, [self._task], STEP, solver="daqp")
        return velocity


#: Levenberg-Marquardt damping of the task, chosen as pink's, and damping of the program.
MINK_DAMPING, PROGRAM_DAMPING = 0.1, 1e-6


class MinkSolver(FrameTaskSolver):
    """mink (Zakka) on the arm's joints in MuJoCo."""

    name: ClassVar[str] = "mink"

    def __init__(self, kin: ArmKinematics, *, tolerance: Tolerance, max_restarts: int = 20) -> None:
        super().__init__(kin, tolerance=tolerance, max_restarts=max_restarts)
        import mink

        self._solve_ik, self._pose_type = mink.solve_ik, mink.SE3
        model = _chain(kin, self.joint_space.search_lower, self.joint_space.search_upper)
        self._configuration = mink.Configuration(model)
        self._task = mink.FrameTask("tip", "site", position_cost=1.0, orientation_cost=1.0, lm_damping=MINK_DAMPING)
        speeds = dict(zip(kin.arm.joints, kin.velocity_limit, strict=True))
        self._limits = [mink.ConfigurationLimit(model), mink.VelocityLimit(model, speeds)]

    def _pose(self, T: Floats) -> Any:
        return self._pose_type.from_matrix(T)

    def _velocity(self) -> Floats:
        velocity: Floats = self._solve_ik(
            self._configuration, [self._task], STEP, "daqp", damping=PROGRAM_DAMPING, limits=self._limits
        )
        return velocity


class IkpySolver(IterativeSolver):
    """ikpy (Manceron): SciPy's least squares on the whole frame, restarted as our own solvers are."""

    name: ClassVar[str] = "ikpy"

    def __init__(self, kin: ArmKinematics, *, tolerance: Tolerance, max_restarts: int = 20) -> None:
        super().__init__(kin, tolerance=tolerance, max_restarts=max_restarts)
        from ikpy.chain import Chain
        from ikpy.link import OriginLink, URDFLink

        placements = [kin.model.jointPlacements[index + 1] for index in range(kin.n)]
        placements.append(kin.model.frames[kin.tip_frame].placement)
        space = self.joint_space
        links = [OriginLink()]
        for index, placement in enumerate(placements):
            moves = index < kin.n
            links.append(
                URDFLink(
                    kin.arm.joints[index] if moves else "tip",
                    placement.translation,
                    load("pinocchio").rpy.matrixToRpy(placement.rotation),
                    rotation=np.eye(3)[coordinate_axis(kin, index)] if moves else None,
                    bounds=(space.search_lower[index], space.search_upper[index]) if moves else None,
                    joint_type="revolute" if moves else "fixed",
                )
            )
        self._chain = Chain(links, active_links_mask=[False, *[True] * kin.n, False])

    def _descender(self, goal: Goal) -> Descend:
        target = self.kin.T_world_base @ goal.frame()

        def descend(q: Floats) -> Descent:
            start = np.concatenate([[0.0], q, [0.0]])
            found = self._chain.inverse_kinematics_frame(target, initial_position=start, orientation_mode="all")
            return Descent(np.array(found[1:-1]), 1)

        return descend


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
