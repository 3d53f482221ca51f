"""Time along a path: jerk-limited from waypoint to waypoint by ruckig, or through rounded corners by toppra."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import Floats, as_floats, check_number, shown
from kinreach._engines import load_extra
from kinreach.errors import InputError
from kinreach.kinematics._arm import ArmKinematics
from kinreach.kinematics._planning import as_waypoints
from kinreach.kinematics._trajectory import Trajectory
from kinreach.robots import ArmDescription
from kinreach.robots.inside import JOINTS, UR_ACCELERATION, ur_speeds

#: Full acceleration is reached in this time [s]. No maker of an arm known to kinreach publishes a limit of its jerk.
ACCELERATION_TIME = 0.1
MAX_LIMIT, MAX_RATE = 1e6, 1e5
#: Two waypoints that are nearer are the same [rad].
SAME = 1e-9
#: Points of a path at which toppra checks the limits: at least, and for each piece.
GRID, GRID_PER_PIECE = 200, 8


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Limits of an arm's joints in a motion. The arrays are read-only.

    Attributes:
        joints: Names of the joints.
        speed: [rad/s], shape (n,).
        acceleration: [rad/s^2], shape (n,).
        jerk: [rad/s^3], shape (n,).

    Raises:
        InputError: A limit is not above 0, or not one for each joint.
    """

    joints: tuple[str, ...]
    speed: Floats
    acceleration: Floats
    jerk: Floats

    def __post_init__(self) -> None:
        for part in ("speed", "acceleration", "jerk"):
            object.__setattr__(self, part, _per_joint(part, getattr(self, part), self.joints))

    @classmethod
    def of(
        cls,
        arm: str | ArmDescription | ArmKinematics,
        *,
        speed: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        jerk: ArrayLike | None = None,
    ) -> MotionLimits:
        """Return the limits of an arm, or lower ones.

        Speeds are those of the URDF, for a UR no more than its data sheet's. Accelerations are 5 rad/s^2 for a UR: the
        conservative choice of the maker's example for MoveIt (`ur_moveit_config`), since the data sheets have none. For
        other arms they are what the controller of the simulation commands (`ArmDescription.acceleration_limit`). The
        jerk reaches them in 0.1 s; it is a choice.

        Args:
            arm: Kinematics, description or name of the arm.
            speed: Lower ones [rad/s], one number or one for each joint.
            acceleration: Others [rad/s^2].
            jerk: Others [rad/s^3].

        Raises:
            InputError: A speed above that of the joint, or a limit that is not above 0.
        """
        kin = arm if isinstance(arm, ArmKinematics) else ArmKinematics(arm)
        joints, own = kin.arm.joints, np.minimum(kin.velocity_limit, MAX_LIMIT)
        own = np.where(own > 0.0, own, kin.arm.speed_limit)
        most = kin.arm.acceleration_limit
        if joints == JOINTS:
            own, most = np.minimum(own, ur_speeds(kin.arm.name)), min(most, UR_ACCELERATION)
        speeds = own if speed is None else _per_joint("speed", speed, joints)
        for name, wanted, bound in zip(joints, speeds, own, strict=True):
            if wanted > bound * (1.0 + SAME):
                raise InputError(f"speed of {name} must be at most {bound:.4g} rad/s, got {wanted:.4g}")
        given = np.full(kin.n, most) if acceleration is None else _per_joint("acceleration", acceleration, joints)
        return cls(joints, speeds, given, given / ACCELERATION_TIME if jerk is None else as_floats("jerk", jerk))


def time_waypoints(waypoints: ArrayLike, limits: MotionLimits, *, rate: float = 500.0) -> Trajectory:
    """Return the fastest motion along straight lines in joint space that stops at each waypoint, by ruckig [3].

    Speed, acceleration and jerk are limited. The path is that of the waypoints, to rounding: what was checked is what
    moves.

    [3] Berscheid and Kröger, Jerk-limited real-time trajectory generation with arbitrary target states, RSS 2021.

    Args:
        waypoints: Postures [rad], shape (m, n).
        limits: Of the joints.
        rate: Samples per second [Hz]; each waypoint is a sample, too.

    Returns:
        A trajectory that begins and ends at rest.

    Raises:
        InputError: Malformed input.
        InstallationError: Ruckig is not installed (the extra `paths`).
    """
    path = as_waypoints(waypoints, len(limits.joints))
    rate = check_number("rate", rate, above=0.0, most=MAX_RATE)
    times, states = [np.zeros(1)], [np.array([[path[0], np.zeros_like(path[0])]])]
    for start, end in pairwise(path):
        if np.abs(end - start).max() <= SAME:
            continue
        t, state = _rest_to_rest(start, end, limits, rate)
        times.append(times[-1][-1] + t)
        states.append(state)
    q, qd = np.concatenate(states).swapaxes(0, 1)
    return Trajectory(limits.joints, np.concatenate(times), q, qd)


def _rest_to_rest(start: Floats, end: Floats, limits: MotionLimits, rate: float) -> tuple[Floats, Floats]:
    """Times after the first (k,), and angles and speeds there (k, 2, n).

    The part of the way is what ruckig moves: its own synchronization of joints in phase gives up where they have
    different limits, and then they leave the line.
    """
    ruckig = load_extra("ruckig", "paths")
    way = end - start
    most = np.maximum(np.abs(way), 1e-12)
    part = ruckig.InputParameter(1)
    part.current_position, part.target_position = [0.0], [1.0]
    part.max_velocity = [float((limits.speed / most).min())]
    part.max_acceleration = [float((limits.acceleration / most).min())]
    part.max_jerk = [float((limits.jerk / most).min())]
    profile = ruckig.Trajectory(1)
    outcome = ruckig.Ruckig(1).calculate(part, profile)
    if outcome.value < 0:
        raise InputError(f"ruckig finds no motion from {start} to {end} within these limits: {outcome}")
    t = _samples(profile.duration, rate)[1:]
    covered = np.array([profile.at_time(at)[:2] for at in t])
    states = covered * way
    states[:, 0] += start
    states[-1] = end, np.zeros_like(end)
    return t, states


def time_path(
    waypoints: ArrayLike,
    limits: MotionLimits,
    *,
    tolerance: float = 0.01,
    blends: ArrayLike | None = None,
    rate: float = 500.0,
) -> Trajectory:
    """Return the fastest motion along a path that does not stop at its waypoints, by toppra [2].

    Corners are rounded by parabolas. Speed and acceleration are limited, the jerk is not. The rounded path is not that
    of the waypoints: check it by `joint_line(checker, trajectory.q)`.

    [2] Pham and Pham, A new approach to time-optimal path parameterization based on reachability analysis, T-RO 2018.

    Args:
        waypoints: Postures [rad], shape (m, n).
        limits: Of the joints.
        tolerance: Largest distance from a waypoint in joint space [rad], the Euclidean norm over joints.
        blends: Instead of it: how far before and after each inner waypoint its corner is rounded [rad], likewise;
            a number, or shape (m - 2,).
        rate: Samples per second [Hz].

    Returns:
        A trajectory that begins and ends at rest.

    Raises:
        InputError: Malformed input, or blends that overlap; the message names them.
        InstallationError: toppra is not installed (the extra `paths`).
    """
    path = as_waypoints(waypoints, len(limits.joints))
    rate = check_number("rate", rate, above=0.0, most=MAX_RATE)
    tolerance = check_number("tolerance", tolerance, above=0.0, most=np.pi)
    given = None if blends is None else _blends(blends, path)
    kept = np.concatenate([[True], np.linalg.norm(np.diff(path, axis=0), axis=1) > SAME])
    path = path[kept]
    if len(path) == 1:
        return Trajectory(limits.joints, np.zeros(1), path, np.zeros_like(path))
    rounded = _RoundedPath(path, tolerance, given)
    return _fastest(rounded, limits, rate)


class _RoundedPath:
    """Straight lines in joint space with parabolas at the corners, by the length of the way; toppra's interface.

    Args:
        points: Different waypoints, shape (m, n).
        tolerance: Largest distance of a corner from its waypoint [rad].
        blends: How far from its waypoint each corner begins, shape (m - 2,), or None.
    """

    def __init__(self, points: Floats, tolerance: float, blends: Floats | None) -> None:
        way = np.diff(points, axis=0)
        length = np.linalg.norm(way, axis=1)
        along = way / length[:, None]
        turn = np.linalg.norm(np.diff(along, axis=0), axis=1)
        if blends is None:
            half = np.minimum(length[:-1], length[1:]) / 2.0
            blends = np.minimum(half, 4.0 * tolerance / np.maximum(turn, 1e-12))
        around = np.concatenate([[0.0], blends, [0.0]])
        straight = length - around[:-1] - around[1:]
        count = len(length)
        # pieces in turn: a line, a corner, a line, ...
        self._origin = np.empty((2 * count - 1, points.shape[1]))
        self._first, self._second = np.empty_like(self._origin), np.zeros_like(self._origin)
        sizes = np.empty(2 * count - 1)
        self._origin[::2], self._first[::2] = points[:-1] + around[:-1, None] * along, along
        sizes[::2] = straight
        self._origin[1::2], self._first[1::2] = points[1:-1] - blends[:, None] * along[:-1], along[:-1]
        sizes[1::2] = 2.0 * blends
        self._second[1::2] = np.diff(along, axis=0) / np.maximum(2.0 * blends, 1e-12)[:, None]
        self._starts = np.concatenate([[0.0], sizes.clip(0.0).cumsum()])
        self.dof = points.shape[1]
        self.duration = float(self._starts[-1])
        self.path_interval = np.array([0.0, self.duration])

    @property
    def grid(self) -> Floats:
        """Where the limits are checked: the ends of the pieces, and points between them."""
        pieces = [np.linspace(a, b, GRID_PER_PIECE, endpoint=False) for a, b in pairwise(self._starts) if b - a > SAME]
        points = np.unique(np.concatenate([*pieces, np.linspace(0.0, self.duration, GRID), [self.duration]]))
        return points[np.concatenate([[True], np.diff(points) > SAME])]

    def __call__(self, s: Any, order: int = 0) -> Floats:
        s = np.asarray(s, dtype=np.float64)
        piece = np.searchsorted(self._starts, s, side="right").clip(1, len(self._origin)) - 1
        x = (s - self._starts[piece])[..., None]
        first, second = self._first[piece], self._second[piece]
        if order == 0:
            return self._origin[piece] + x * (first + 0.5 * x * second)
        return first + x * second if order == 1 else second


def _fastest(path: _RoundedPath, limits: MotionLimits, rate: float) -> Trajectory:
    constraint, algorithm = (load_extra(f"toppra.{name}", "paths") for name in ("constraint", "algorithm"))
    both = np.array([-1.0, 1.0])
    instance = algorithm.TOPPRA(
        [
            constraint.JointVelocityConstraint(limits.speed[:, None] * both),
            constraint.JointAccelerationConstraint(
                limits.acceleration[:, None] * both,
                discretization_scheme=constraint.DiscretizationType.Interpolation,
            ),
        ],
        path,
        gridpoints=path.grid,
        parametrizer="ParametrizeConstAccel",
    )
    motion = instance.compute_trajectory(0.0, 0.0)
    if motion is None:
        raise InputError("toppra finds no motion along this path within these limits")
    t = _samples(motion.duration, rate)
    q, qd, qdd = motion(t), motion(t, 1), motion(t, 2)
    qd[[0, -1]] = 0.0
    # the limits hold at the points of the grid; between them they may be passed by some thousandths
    mean = np.diff(qd, axis=0) / np.diff(t)[:, None]
    steepest = max((np.abs(rates) / limits.acceleration).max() for rates in (qdd, mean))
    slower = max(1.0, (np.abs(qd) / limits.speed).max(), np.sqrt(steepest))
    return Trajectory(limits.joints, t * slower, q, qd / slower)


def _samples(duration: float, rate: float) -> Floats:
    """Times at a rate, and the end [s]; a sample that is nearly at the end is left out."""
    return np.append(np.arange(max(np.ceil(duration * rate - 1e-3), 1)) / rate, duration)


def _blends(blends: ArrayLike, path: Floats) -> Floats:
    """How far from its waypoint each corner begins, shape (m - 2,), checked."""
    given = as_floats("blends", blends)
    count = max(len(path) - 2, 0)
    if given.ndim == 0:
        given = np.full(count, given)
    if given.shape != (count,) or not (np.isfinite(given).all() and (given > 0.0).all()):
        raise InputError(f"blends must be a number above 0, or {count} of them, got {shown(blends)}")
    around = np.concatenate([[0.0], given, [0.0]])
    for index, (start, end) in enumerate(pairwise(path)):
        length = float(np.linalg.norm(end - start))
        if length <= SAME:
            raise InputError(f"waypoint {index + 1} is where the one before it is; blends need different ones")
        if around[index] + around[index + 1] > length:
            raise InputError(
                f"the blends at waypoints {index} and {index + 1} overlap: {around[index]:g} + {around[index + 1]:g} "
                f"rad on a way of {length:.4g} rad"
            )
    return given


def _per_joint(name: str, value: ArrayLike, joints: tuple[str, ...]) -> Floats:
    numbers = as_floats(name, value)
    if numbers.ndim == 0:
        numbers = np.full(len(joints), numbers)
    if numbers.shape != (len(joints),) or not ((numbers > 0.0) & (numbers <= MAX_LIMIT)).all():
        raise InputError(
            f"{name} must be a number above 0, or one for each of {len(joints)} joints, got {shown(value)}"
        )
    numbers = numbers.copy()
    numbers.flags.writeable = False
    return numbers
