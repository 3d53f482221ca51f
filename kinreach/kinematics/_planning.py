"""Paths in joint space: straight from waypoint to waypoint, or planned around obstacles by RRTConnect."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import MAX_ANGLE, Floats, as_floats, check_count, check_entries, check_number
from kinreach._rotations import TURN
from kinreach.errors import InputError, PathError
from kinreach.kinematics._arm import ArmKinematics
from kinreach.kinematics._branches import postures_of
from kinreach.kinematics._collision import CollisionChecker
from kinreach.kinematics._motion_check import MotionCheck, check_waypoints
from kinreach.kinematics._solutions import SLACK, IKSolutions, nearest_windings

#: How far a point of the arm may move between two samples during the search [m]. The path is then checked so that
#: nothing is missed; if something was, the search is repeated with half of this.
SEARCH_STEP = 0.1
#: Number of random parts of a path that are replaced by straight lines where these are free.
SHORTCUTS = 25
#: A search for a nearer way is for one whose travel is below this part of the best. It takes that many steps of the
#: trees, in one search after the other, and where the first way took many, four times as many as that, up to the last
#: number.
NEARER, LOOKS, MOST_LOOKS = 0.95, 1500, 30_000
#: A goal posture that is farther away grows its tree so many steps after the one before it.
HEAD_START = 1000
#: Largest change of a posture in one step of a tree [rad, each joint weighted by how far it moves the arm].
RANGE = 0.3
#: After so many steps of the trees the search is in a narrow passage. From then on a posture from which a step was
#: blocked is grown only towards what is nearer than a radius [rad, weighted likewise]; every later step from it changes
#: the radius by a share.
NARROW, RADIUS, ADAPTATION = 3000, 1.5, 0.001
MAX_SEED = 2**32 - 2


def joint_line(checker: CollisionChecker, waypoints: ArrayLike, *, keeps: float = 0.0) -> Floats:
    """Return a path that is straight in joint space from waypoint to waypoint, checked.

    Args:
        checker: Of the arm and what stands around it, with a margin that each sample of the path keeps; nothing between
            two samples is missed.
        waypoints: Postures [rad], shape (m, n).
        keeps: Distance from everything that the path keeps between its samples, too [m]; 0.2 mm or more below the
            margin. The nearer they are, the more samples are taken.

    Returns:
        The waypoints, shape (m, n).

    Raises:
        PathError: A waypoint is out of the joint limits, or something is nearer than the margin; has the place.
        InputError: Malformed waypoints, or a checker without a margin.

    Examples:
        >>> from kinreach.kinematics import CollisionChecker, joint_line
        >>> checker = CollisionChecker("ur5e", margin=0.005)
        >>> home = checker.kinematics.arm.home
        >>> joint_line(checker, [home, [0.5, *home[1:]]]).shape
        (2, 6)
    """
    motion = MotionCheck(checker, keeps)
    path = as_waypoints(waypoints, checker.kinematics.n)
    check_waypoints(motion, path)
    return path


def plan_path(
    checker: CollisionChecker,
    start: ArrayLike,
    goals: ArrayLike | IKSolutions,
    *,
    branch: int | str | None = None,
    max_travel: float | None = None,
    seed: int = 0,
    timeout: float = 1.0,
    keeps: float = 0.0,
) -> Floats:
    """Plan a path around obstacles to the goal posture that is nearest along it: the near way.

    The travel of a path is the largest way of a joint, max_i sum_k |q_i(k+1) - q_i(k)|, and the straight line to a goal
    posture has the least there is. So where the straight line to the nearest one is free, it is the path. Where it is
    blocked, a posture that is farther away is a goal only if it is nearer than the detours to those before it:
    RRTConnect [1] grows a tree from the start and one from the goal postures, the nearest ones first, always the
    smaller one [2]; the path is shortened; then it looks for one with less travel, in the only box where such a path
    can be, |q_i - s_i| + |g_i - q_i| below the best travel for each joint i. The result depends on the seed only, not
    on the time that it takes, unless that runs out.

    Give it all solutions of a pose, `kin.all_solutions(T)`: some may be blocked where others are free. Two
    windings of each are goals: the one nearest to the start, and the one nearest to the middle of the joints' ranges.
    Postures are goals as they are.

    A search that takes long is in a narrow passage; then postures next to obstacles are grown only towards what is near
    them, with an adaptive radius [3].

    [1] Kuffner and LaValle, RRT-Connect: An efficient approach to single-query path planning, ICRA 2000.
    [2] Kuffner and LaValle, An efficient approach to path planning using balanced bidirectional RRT search, CMU 2005.
    [3] Jaillet et al., Adaptive tuning of the sampling domain for dynamic-domain RRTs, IROS 2005.

    Args:
        checker: Of the arm and what stands around it, with a margin that each sample of the path keeps; nothing between
            two samples is missed. `CollisionChecker("ur5e", obstacles=[*workcell.obstacles, ...], margin=0.005)`.
        start: Posture [rad], shape (n,).
        goals: The solutions of a pose; or postures [rad], shape (n,) or (k, n).
        branch: Of the solutions of a pose, only those of this one: its index, words of `branch_words`, such as
            "right, up", or "same" for that of the start.
        max_travel: Largest way of a joint [rad].
        seed: Of the random numbers.
        timeout: Time after which no path is found [s].
        keeps: As for `joint_line`.

    Returns:
        Waypoints [rad], shape (m, n), from the start to one of the goals, straight in joint space between them.

    Raises:
        PathError: The start collides, no goal is free or near enough, or no path was found in time; names links and
            obstacles.
        InputError: Malformed input, a checker without a margin, or a pose without solutions, or without any of that
            branch.

    Examples:
        >>> from kinreach.kinematics import CollisionChecker, plan_path
        >>> checker = CollisionChecker("ur5e", margin=0.005)
        >>> home = checker.kinematics.arm.home
        >>> path = plan_path(checker, home, [0.5, *home[1:]])
        >>> path.shape[1], bool(checker.free(path[-1]))
        (6, True)
    """
    motion = MotionCheck(checker, keeps)
    kin = checker.kinematics
    start = kin.as_posture("start", start)
    if isinstance(goals, IKSolutions):
        if not goals.success:
            raise InputError(f"the goal has no posture: {goals.reason}")
        goals = _windings(kin, start, goals.q if branch is None else postures_of(kin, goals, branch, start))
    elif branch is not None:
        raise InputError("branch chooses among the solutions of a pose, kin.all_solutions(T); postures are their own")
    goals = as_waypoints(np.atleast_2d(as_floats("goals", goals)), kin.n, name="goals")
    seed = check_count("seed", seed, least=0, most=MAX_SEED)
    deadline = time.monotonic() + check_number("timeout", timeout, above=0.0, most=3600.0)
    if reason := _why_not(motion, start):
        raise PathError(f"the start is not free: {reason}", q=start)
    goals = _free_goals(motion, start, goals)
    most = math.inf if max_travel is None else check_number("max_travel [rad]", max_travel, above=0.0, most=MAX_ANGLE)
    if (nearest_travel := travel(np.array([start, goals[0]]))) > most:
        raise PathError(
            f"a joint would turn by {nearest_travel:.3g} rad ({math.degrees(nearest_travel):.0f}°) to the nearest of "
            f"{len(goals)} free goal postures; max_travel is {most:.4g} rad"
        )
    path = _near_way(motion, start, goals, most, np.random.default_rng(seed), deadline)
    if path is None:
        nearest = checker.distance(start)
        raise PathError(
            f"no path was found within {timeout:g} s to any of {len(goals)} free goal postures"
            f"{'' if max_travel is None else f' with a travel of {most:g} rad at most'}; the start is "
            f"{nearest.distance:.3g} m from {' - '.join(nearest.pair)}"
        )
    return path


def travels(path: Floats) -> Floats:
    """Return the way that each joint makes along a path [rad], shape (n,)."""
    return np.asarray(np.abs(np.diff(path, axis=0)).sum(axis=0))


def travel(path: Floats) -> float:
    """Return the largest of them."""
    return float(travels(path).max())


def _near_way(
    motion: MotionCheck, start: Floats, goals: Floats, most: float, rng: np.random.Generator, deadline: float
) -> Floats | None:
    """Return the path of the least travel that is found to any of some goals, sorted by theirs; None if time runs out.

    No goal is looked at that is farther away than the best path is long, or than the largest travel.
    """
    least = np.abs(goals - start).max(axis=1)
    goals = goals[least <= most]
    least = least[least <= most]
    best = next((np.array([start, goal]) for goal in goals if motion.motion_free(start, goal)), None)
    step, steps, left = SEARCH_STEP, 0, math.inf if best is None else LOOKS
    most_at_once = left
    while left > 0:
        bound = most if best is None else NEARER * travel(best)
        if best is not None and bound <= least[0]:
            break
        found, taken = _search(
            motion, start, goals[least <= bound], bound, rng, step, min(left, most_at_once), deadline
        )
        steps, left = steps + taken, left - taken
        if found is None:
            if best is None or time.monotonic() >= deadline:
                break
            continue
        path = _shortened(motion, found, rng, step)
        proven = _proven(motion, path)
        if not proven:  # where a shortcut touched, what was found is shortened by proven ones
            path = _shortened(motion, found, rng, None)
            proven = _proven(motion, path)
        if not proven:
            step /= 2.0
        elif travel(path) > most:
            continue
        elif best is None:
            best, left = path, max(LOOKS, min(4 * steps, MOST_LOOKS))
            most_at_once = max(LOOKS, steps)
        elif travel(path) < travel(best):
            best = path
    return best


def _windings(kin: ArmKinematics, start: Floats, goals: Floats) -> Floats:
    """Return the goals in the full turns nearest to the start and to the middle of the limits, shape (k, n)."""
    found, (low, high) = [], kin.sampling_limits
    for near in (start, (low + high) / 2.0):
        turns = ~kin.slides if kin.slides.any() else None
        wound, within = nearest_windings(goals.T, near[:, None], kin.lower, kin.upper, turns=turns)
        found.append(wound.T[within])
    return np.unique(np.vstack(found).round(12), axis=0) if any(map(len, found)) else goals


def as_waypoints(waypoints: ArrayLike, n: int, *, name: str = "waypoints") -> Floats:
    """Return postures as an array of shape (m, n) with at least one row, or raise an `InputError`."""
    path = as_floats(name, waypoints)
    if path.ndim != 2 or path.shape[1] != n or not len(path):
        raise InputError(f"{name} must have shape (m, {n}) with m at least 1, got {path.shape}")
    check_entries(name, path, MAX_ANGLE)
    return path


def _why_not(motion: MotionCheck, q: Floats) -> str:
    checker = motion.checker
    reason = checker.reason(q)
    if reason and checker.kinematics.within_limits(q) and (gap := checker.distance(q).distance) > 0.0:
        return f"{reason} are {1e3 * gap:.2g} mm apart, the margin is {1e3 * checker.margin:g} mm"
    return reason


def _free_goals(motion: MotionCheck, start: Floats, goals: Floats) -> Floats:
    """The goals that are within the limits and free, nearest first."""
    kin = motion.checker.kinematics
    free = np.array([kin.within_limits(goal) and motion.free(goal) for goal in goals])
    if not free.any():
        reasons = dict.fromkeys(_why_not(motion, goal) for goal in goals)
        count = len(np.unique(np.cos(goals - start).round(6), axis=0))  # a full turn makes no other posture
        raise PathError(f"none of the {count} goal postures is free: {'; '.join(reasons)}")
    order = np.argsort(np.abs(goals[free] - start).max(axis=1), kind="stable")
    return goals[free][order]


def _search(
    motion: MotionCheck,
    start: Floats,
    goals: Floats,
    bound: float,
    rng: np.random.Generator,
    step: float,
    most: float,
    deadline: float,
) -> tuple[Floats | None, int]:
    """Search a path by RRTConnect whose motions are free at samples `step` apart.

    Args:
        motion: Judges motions.
        start: Posture [rad].
        goals: Postures, each with a larger travel than the one before it.
        bound: Travel of interest [rad]; a path that is found may have more.
        rng: Draws postures.
        step: Between two samples [m].
        most: Steps of the trees after which there is no path.
        deadline: Time at which there is none [s].

    Returns:
        The path or None, and how many steps it took.
    """
    of_start, of_goals = _Tree(motion, start, step), _Tree(motion, goals[0], step)
    planted, taken = 1, 0
    lower, upper = _sampled_range(motion.checker.kinematics, start, goals[:1], bound)
    while taken < most and time.monotonic() < deadline:
        taken += 1
        if taken > HEAD_START * planted and planted < len(goals):
            of_goals.plant(goals[planted])
            planted += 1
            lower, upper = _sampled_range(motion.checker.kinematics, start, goals[:planted], bound)
        # the tree in the narrower place is the smaller one, and needs the tries
        grown, other = (of_start, of_goals) if len(of_start) < len(of_goals) else (of_goals, of_start)
        bounded = taken > NARROW
        node = grown.extend(lower + rng.random(len(lower)) * (upper - lower), bounded=bounded)
        if node is None:
            continue
        q = grown.postures[node]
        met = other.extend(q, bounded=bounded)
        while met is not None and other.postures[met] is not q:
            met = other.extend(q, bounded=bounded)
        if met is not None:
            path = [*grown.branch(node)[::-1], *other.branch(met)[1:]]
            return np.array(path if grown is of_start else path[::-1]), taken
    return None, taken


class _Tree:
    """Postures, each with a free motion from an earlier one, its parent; roots have none."""

    def __init__(self, motion: MotionCheck, root: Floats, step: float) -> None:
        self._motion, self._step = motion, step
        # a joint counts in distances as far as it moves the arm
        self._scale = np.sqrt(motion.reach / motion.reach.max())
        self.postures: list[Floats] = []
        self._parents: list[int | None] = []
        self._radii: list[float] = []  # infinite where no step was blocked
        self._scaled = np.zeros((2, len(root)))
        self._squares = np.zeros(len(self._scaled))
        self.plant(root)

    def __len__(self) -> int:
        return len(self.postures)

    def plant(self, root: Floats) -> None:
        """Add a posture that has no parent."""
        self._add(root, None)

    def extend(self, toward: Floats, *, bounded: bool) -> int | None:
        """Go from the nearest posture towards another one, at most by `RANGE`; return the new one, None if blocked.

        With `bounded`, a posture beyond the radius of the nearest one is not tried.
        """
        target, count = toward * self._scale, len(self)
        nearest = int((self._squares[:count] - 2.0 * (self._scaled[:count] @ target)).argmin())
        q, way = self.postures[nearest], target - self._scaled[nearest]
        distance = math.sqrt(way @ way)
        if bounded and distance > self._radii[nearest]:
            return None
        end = toward if distance <= RANGE else q + RANGE / distance * (toward - q)
        if not (self._motion.free(end) and self._motion.motion_free(q, end, step=self._step)):
            radius = self._radii[nearest]
            self._radii[nearest] = RADIUS if radius == math.inf else max(RANGE, (1.0 - ADAPTATION) * radius)
            return None
        self._radii[nearest] *= 1.0 + ADAPTATION
        self._add(end, nearest)
        return count

    def branch(self, node: int | None) -> list[Floats]:
        """The postures from a node to its root."""
        found = []
        while node is not None:
            found.append(self.postures[node])
            node = self._parents[node]
        return found

    def _add(self, q: Floats, parent: int | None) -> None:
        node, scaled = len(self), q * self._scale
        if node == len(self._scaled):
            self._scaled = np.concatenate([self._scaled, np.zeros_like(self._scaled)])
            self._squares = np.concatenate([self._squares, np.zeros_like(self._squares)])
        self._scaled[node], self._squares[node] = scaled, scaled @ scaled
        self.postures.append(q)
        self._parents.append(parent)
        self._radii.append(math.inf)


def _sampled_range(kin: ArmKinematics, start: Floats, goals: Floats, bound: float = math.inf) -> tuple[Floats, Floats]:
    """Return the range of random postures: one turn about start and goals, or more where these are farther apart.

    A UR's joints have two turns: their whole range holds each posture 64 times. Nor is a posture q of interest with
    |q_i - s_i| + |g_i - q_i| above the bound on the travel, for the start s and every goal g.
    """
    known = np.vstack([start, goals])
    low, high = known.min(axis=0), known.max(axis=0)
    missing = (TURN - (high - low)).clip(0.0) / 2.0
    low, high = np.maximum(low - missing, kin.lower), np.minimum(high + missing, kin.upper)
    if bound < math.inf:
        spare = (bound - np.abs(goals - start)) / 2.0
        low = np.maximum(low, (np.minimum(goals, start) - spare).min(axis=0))
        high = np.minimum(high, (np.maximum(goals, start) + spare).max(axis=0))
    return low - SLACK, high + SLACK


def _shortened(motion: MotionCheck, path: Floats, rng: np.random.Generator, step: float | None) -> Floats:
    """Shorten a path: leave out waypoints, replace random parts by straight lines, and leave out waypoints again.

    The ends of such lines may be next to another waypoint, and a robot would stop there.
    """
    points = _left_out(motion, [*path], step)
    for _ in range(SHORTCUTS):
        lengths = _lengths(motion, points)
        ends = np.concatenate([[0.0], lengths.cumsum()])
        one, other = np.sort(rng.uniform(0.0, ends[-1], 2))
        i, j = (int(np.searchsorted(ends, at, side="right").clip(1, len(lengths))) - 1 for at in (one, other))
        if i == j:
            continue
        a = points[i] + (one - ends[i]) / lengths[i] * (points[i + 1] - points[i])
        b = points[j] + (other - ends[j]) / lengths[j] * (points[j + 1] - points[j])
        if motion.motion_free(a, b, step=step):
            points[i + 1 : j + 1] = [a, b]
    return np.array(_left_out(motion, points, step))


def _proven(motion: MotionCheck, path: Floats) -> bool:
    return all(motion.motion_free(a, b) for a, b in pairwise(path))


def _left_out(motion: MotionCheck, points: list[Floats], step: float | None) -> list[Floats]:
    """Leave out waypoints between two that a free straight line connects."""
    first = 0
    while first < len(points) - 2:
        last = len(points) - 1
        while last > first + 1 and not motion.motion_free(points[first], points[last], step=step):
            last -= 1
        del points[first + 1 : last]
        first += 1
    return points


def _lengths(motion: MotionCheck, points: Sequence[Floats]) -> Floats:
    return np.abs(np.diff(points, axis=0)) @ motion.reach
