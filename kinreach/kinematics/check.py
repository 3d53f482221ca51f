"""Measurements of an arm before you rely on it: reach, inverse kinematics, singular postures.

Everything is measured on random postures within the limits, with a seed, and judged by forward kinematics.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from kinreach._checks import Floats
from kinreach.errors import InputError, InstallationError, NoShapesError
from kinreach.kinematics._arm import POSE_JOINTS, ArmKinematics
from kinreach.kinematics._by_geometry import ByGeometry
from kinreach.kinematics._closed_form import ClosedFormKinematics
from kinreach.kinematics._collision import CollisionChecker
from kinreach.kinematics._five_axis import FiveAxisKinematics
from kinreach.kinematics._goals import PoseGoal, PositionGoal
from kinreach.kinematics._solvers import ClosedFormSolver, LevenbergMarquardtSolver, PlacoSolver, QPSolver, Solver
from kinreach.robots import PosePairs

#: Random postures that reach, collisions and calibrations are measured on.
POSTURES = 2000
#: Number of random postures next to which singular ones are searched, and of angles of each joint.
STARTS, ANGLES = 12, 25
#: Smallest singular value below which a posture is singular, for an arm scaled to 1 m.
SINGULAR = 1e-6
#: The same for arms with more than six joints, and how often each of their joints is turned.
NEARLY_SINGULAR, ROUNDS = 1e-4, 4
#: An angle of a joint recurs if it is singular next to this share of the random postures.
RECURRING = 0.25
#: Largest error of a goal that counts as reached [m], [rad].
REACHED = (1e-4, 1e-3)


@dataclass(frozen=True)
class Reach:
    """Positions of the tip in random postures, from the arm's first joint [m].

    Attributes:
        farthest, usual: Largest distance, and the one that 95 % of the postures are within.
        highest, lowest: Of the tip.
    """

    farthest: float
    usual: float
    highest: float
    lowest: float


@dataclass(frozen=True)
class Collisions:
    """How much of the joint space is in collision.

    Attributes:
        pairs: Pairs of links that are checked.
        share: Share of random postures that collide.
        home_free: Whether the start posture does not.
    """

    pairs: int
    share: float
    home_free: bool


@dataclass(frozen=True)
class Solved:
    """How one solver does on poses of random postures.

    Attributes:
        name: Of the solver.
        success: Share of the poses that were reached within the limits, by forward kinematics.
        singular: Share of the singular poses; NaN where none are known.
        time: Median and 95 % quantile of a solution's time [s].
        error: Largest error of the position [m] where it was reached.
    """

    name: str
    success: float
    singular: float
    time: tuple[float, float]
    error: float


@dataclass(frozen=True)
class Deviation:
    """How far one arm is from another in the same postures: the calibrated from its data sheet.

    Attributes:
        tip: Positions of the tip of the true one, from the first joint [m], shape (n, 3).
        position: Distances [m], shape (n,).
        orientation: Angles [rad], shape (n,).
    """

    tip: Floats
    position: Floats
    orientation: Floats


@dataclass(frozen=True)
class Explained:
    """How well an arm explains a recording.

    Attributes:
        tool: Tool centre point on the flange: the recording's or the given one, else the one that explains it best,
            shape (4, 4).
        recovered: Whether it is the latter.
        position: Errors of the tool's position [m], shape (m,).
        orientation: Errors of its orientation [rad], shape (m,); empty if the recording has none.
        speed: Errors of its speed by the Jacobian [m/s], shape (m,); empty if the recording has none.
        tracking: Largest difference of a joint from its command [rad], shape (m,); empty likewise.
    """

    tool: Floats
    recovered: bool
    position: Floats
    orientation: Floats
    speed: Floats
    tracking: Floats


@dataclass(frozen=True)
class NearestOrientations:
    """What an arm of four or five axes leaves of orientations, at points that it reaches.

    Attributes:
        left: Least angle to a random orientation [rad], shape (m,).
        down: Share of the points at which the z axis can point against that of the base.
        time: Median time of a solution [s].
    """

    left: Floats
    down: float
    time: float


def explained(flange: ArmKinematics, pairs: PosePairs, tool: Floats | None = None) -> Explained:
    """Compare a recording with an arm.

    Args:
        flange: Kinematics of the arm's flange in the frame of the poses.
        pairs: The recording.
        tool: Tool centre point on the flange, shape (4, 4); default is what the recording says, else it is found.
    """
    F = flange.fk(pairs.q)
    known = tool if tool is not None else pairs.tcp
    T = F @ (pairs.tool_on(F) if known is None else known)
    position = np.linalg.norm(T[:, :3, 3] - pairs.positions, axis=1)
    orientation = speed = tracking = np.empty(0)
    if pairs.has_rotations:
        orientation = Rotation.from_matrix(T[:, :3, :3].swapaxes(1, 2) @ pairs.seen[:, :3, :3]).magnitude()
    if pairs.velocity is not None:
        joints, seen = pairs.velocity
        twist = np.einsum("mij,mj->mi", flange.jacobian(pairs.q), joints)
        twist[:, :3] += np.cross(twist[:, 3:], T[:, :3, 3] - F[:, :3, 3])  # from the flange to the tool
        speed = np.linalg.norm(twist[:, :3] - seen[:, :3], axis=1)
    if pairs.target is not None:
        tracking = np.abs(pairs.q - pairs.target).max(axis=1)
    return Explained((np.linalg.inv(F) @ T)[0], known is None, position, orientation, speed, tracking)


def random_postures(kin: ArmKinematics, count: int, seed: int) -> Floats:
    """Draw postures within the limits, and within a turn of each joint [rad], shape (count, n)."""
    return np.random.default_rng(seed).uniform(*_ranges(kin), (count, kin.n))


def _ranges(kin: ArmKinematics) -> tuple[Floats, Floats]:
    """Ends of each joint's range within ±pi, and of all of it where it lies beyond [rad], shape (n,)."""
    low, high = np.maximum(kin.lower, -np.pi), np.minimum(kin.upper, np.pi)
    beyond = low >= high  # a joint without end is not
    return np.where(beyond, kin.lower, low), np.where(beyond, kin.upper, high)


def from_first_joint(kin: ArmKinematics, positions: Floats) -> Floats:
    """Express positions of the base frame from the first joint's origin [m]."""
    shoulder = kin.model.jointPlacements[1].translation
    return positions - (kin.T_base_world[:3, :3] @ shoulder + kin.T_base_world[:3, 3])


def reach_of(kin: ArmKinematics, *, seed: int = 0) -> Reach:
    """Measure how far the tip reaches.

    Raises:
        InputError: It stays where it is.
    """
    tip = from_first_joint(kin, kin.positions(random_postures(kin, POSTURES, seed)))
    distance = np.linalg.norm(tip, axis=1)
    if distance.max() < SINGULAR:
        raise InputError(
            f"arm {kin.arm.name!r}: no joint moves the tip {kin.tip!r} to another place; name another link as its tip"
        )
    return Reach(
        float(distance.max()), float(np.quantile(distance, 0.95)), float(tip[:, 2].max()), float(tip[:, 2].min())
    )


def collisions_of(kin: ArmKinematics, *, seed: int = 0) -> Collisions | None:
    """Measure self-collisions of the arm without its work cell; None for an arm without shapes.

    Raises:
        InputError: Its shapes cannot be read, or one is missing.
    """
    try:
        checker = CollisionChecker(kin, obstacles=())
    except NoShapesError:
        if kin.arm.missing_shapes:
            raise
        return None
    colliding = [checker.in_collision(q) for q in random_postures(kin, POSTURES // 4, seed)]
    return Collisions(len(checker.pairs), float(np.mean(colliding)), checker.free(kin.arm.home))


def smallest_singular_value(kin: ArmKinematics, q: Floats, scale: float) -> float:
    """Return the smallest singular value of the Jacobian, lengths in units of `scale` [m].

    With fewer than six joints it is that of the positional part.
    """
    J = kin.jacobian(q)
    J[:3] /= scale
    return float(np.linalg.svd(J if kin.n >= POSE_JOINTS else J[:3], compute_uv=False)[-1])


@dataclass(frozen=True)
class Singular:
    """Singular postures.

    Attributes:
        q: The postures [rad], shape (k, n).
        start: Number of the random posture that each was found next to, shape (k,).
    """

    q: Floats
    start: NDArray[np.int64]

    def recurring(self, joint: int) -> list[float]:
        """Angles that a joint has in singular postures next to many random ones [rad], to 0.01."""
        pairs = {
            (round(float(angle), 2) + 0.0, int(start))
            for angle, start in zip(self.q[:, joint], self.start, strict=True)
        }
        counts = Counter(angle for angle, _ in pairs)
        return sorted(angle for angle, count in counts.items() if count >= RECURRING * STARTS)


def singular_postures(kin: ArmKinematics, scale: float, *, seed: int = 0) -> Singular:
    """Find singular postures next to random ones by turning a joint to where the smallest singular value is least.

    With up to six joints one turn is enough. An arm with more is singular where several joints are at certain angles:
    they are turned one after the other, and postures count from `NEARLY_SINGULAR` on. `scale` is the unit of lengths
    [m], such as the reach.
    """
    spare = kin.n > POSE_JOINTS
    ways = [tuple(range(kin.n)) * ROUNDS] if spare else [(joint,) for joint in range(kin.n)]
    found: list[Floats] = []
    starts: list[int] = []
    for number, start in enumerate(random_postures(kin, STARTS, seed)):
        for way in ways:
            q, value = start, np.inf
            for joint in way:
                q, value = _least_agile(kin, q, joint, scale)
            if value < (NEARLY_SINGULAR if spare else SINGULAR):
                found.append(q)
                starts.append(number)
    return Singular(np.array(found).reshape(-1, kin.n), np.array(starts, dtype=np.int64))


def _least_agile(kin: ArmKinematics, q: Floats, joint: int, scale: float) -> tuple[Floats, float]:
    """The posture with one joint turned to where the smallest singular value is least, and that value."""

    def turned(angle: float) -> Floats:
        return np.concatenate([q[:joint], [angle], q[joint + 1 :]])

    def value(angle: float) -> float:
        return smallest_singular_value(kin, turned(angle), scale)

    low, high = (end[joint] for end in _ranges(kin))
    angles = np.linspace(low, high, ANGLES)
    best, step = angles[int(np.argmin([value(angle) for angle in angles]))], angles[1] - angles[0]
    bounds = (max(low, best - step), min(high, best + step))
    least = minimize_scalar(value, bounds=bounds, method="bounded", options={"xatol": 1e-12})
    return turned(float(least.x)), float(least.fun)


def solvers_of(kin: ArmKinematics) -> list[Solver]:
    """Return the solvers that the arm and this installation have; each has solved once, so that none is timed cold."""
    makers: list[Callable[[ArmKinematics], Solver]] = [PlacoSolver, LevenbergMarquardtSolver, QPSolver]
    if isinstance(kin, ClosedFormKinematics):
        makers.insert(0, ClosedFormSolver)
    solvers = []
    for make in makers:
        try:
            solver = make(kin)
            solver.solve(goal_of(kin, np.array(kin.arm.home)), kin.arm.home)
        except InstallationError:
            continue
        solvers.append(solver)
    return solvers


def goal_of(kin: ArmKinematics, q: Floats) -> PoseGoal | PositionGoal:
    """Return the pose of the tip in a posture as a goal; its position with fewer than six joints that turn."""
    T = kin.fk(q)
    return PoseGoal(T) if kin.n >= POSE_JOINTS or isinstance(kin, ByGeometry) else PositionGoal(T[:3, 3])


def solved(kin: ArmKinematics, solver: Solver, postures: Floats, singular: Floats) -> Solved:
    """Try a solver on the poses of random postures (m, n) and of singular ones (k, n), from the start posture."""
    done, times, errors = [], [], [0.0]
    for q in (*postures, *singular):
        goal = goal_of(kin, q)
        start = perf_counter()
        result = solver.solve(goal, kin.arm.home)
        times.append(perf_counter() - start)
        within = result.position_error <= REACHED[0] and result.orientation_error <= REACHED[1]
        done.append(within and kin.within_limits(result.q))
        if done[-1]:
            errors.append(result.position_error)
    regular = len(postures)
    share = float(np.mean(done[regular:])) if len(singular) else float("nan")
    median, late = np.quantile(times[:regular], (0.5, 0.95)).tolist()
    return Solved(solver.name, float(np.mean(done[:regular])), share, (median, late), max(errors))


def nearest_orientations(kin: FiveAxisKinematics, postures: Floats, *, seed: int = 0) -> NearestOrientations:
    """Ask for a random orientation, and for the tip straight down, at the point of each posture (m, n)."""
    rng, left, times, met = np.random.default_rng(seed + 2), [], [], []
    for T in kin.fk(postures):
        T[:3, :3] = Rotation.random(rng=rng).as_matrix()
        start = perf_counter()
        found = kin.nearest(T, kin.arm.home)
        times.append(perf_counter() - start)
        left.append(found.orientation_error)
        directed = kin.axis_solutions(T[:3, 3], [0.0, 0.0, -1.0])
        met.append(len(directed) > 0 and directed.left[0] <= REACHED[1])
    return NearestOrientations(np.array(left), float(np.mean(met)), float(np.median(times)))


def deviation(real: ArmKinematics, believed: ArmKinematics, *, seed: int = 0, count: int = POSTURES) -> Deviation:
    """Compute how far the tips of a real arm and of another description of it are apart in the same postures."""
    q = random_postures(real, count, seed)
    T, expected = real.fk(q), believed.fk(q)
    angle = Rotation.from_matrix(expected[:, :3, :3].swapaxes(1, 2) @ T[:, :3, :3]).magnitude()
    distance = np.linalg.norm(T[:, :3, 3] - expected[:, :3, 3], axis=1)
    return Deviation(from_first_joint(real, T[:, :3, 3]), distance, angle)


def quantiles(values: Floats | Sequence[float]) -> tuple[float, float, float]:
    """Return the median, the 95 % quantile and the largest value."""
    median, late, most = np.quantile(values, (0.5, 0.95, 1.0)).tolist()
    return median, late, most
