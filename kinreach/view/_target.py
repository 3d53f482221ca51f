"""One target and all postures for it: which can be used, and why the others cannot, in words."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from math import pi

import numpy as np

from kinreach._checks import Floats, check_known
from kinreach.kinematics import (
    ArmKinematics,
    AxisGoal,
    CollisionChecker,
    IKResult,
    PoseGoal,
    PositionGoal,
    SixAxisKinematics,
    URKinematics,
)
from kinreach.kinematics._chain import rotation_to
from kinreach.kinematics._closed_form import ClosedFormKinematics
from kinreach.kinematics._collision import NoShapesError, Pair
from kinreach.kinematics._goals import Goal, goal_error
from kinreach.kinematics._solutions import ANGLES, BRANCH, nearest_winding
from kinreach.kinematics._solvers import SOLVERS, LevenbergMarquardtSolver, Solver, new_solver
from kinreach.kinematics._ur.geometry import Miss
from kinreach.kinematics._ur.reach import Shortfall
from kinreach.robots import ArmDescription
from kinreach.view._names import angle, branch_name, length, listed, plain
from kinreach.view._policy_solver import PolicySolver

#: What may be asked of the tool, by the words of the page.
POSE, AXIS, POINT = "position and orientation", "position and direction", "position only"
#: The posture on a self-motion that the user has gone to.
ALONG = "on the chosen curve"
#: Starts of the search for postures of an arm without a closed form.
STARTS = 8
#: Two postures nearer than this in every joint are one [rad].
SAME = 1e-3
#: A calibrated arm's border is elsewhere: so much further in than that of the data sheet's [m] postures are looked for.
DEEPER = (0.0, 1e-3, 3e-3, 1e-2, 3e-2)
#: Where the motion of a turning tool is measured: this far from its axis [m].
LEVER = 0.2


class State(Enum):
    """What may be done with a posture."""

    USABLE = "can be used"
    COLLIDES = "collides"
    LIMITS = "outside the joint limits"
    UNREACHED = "out of reach"


#: Of several postures.
_PLURAL = {
    State.COLLIDES: "collide",
    State.LIMITS: "are outside the joint limits",
    State.UNREACHED: "do not reach",
}


@dataclass(frozen=True)
class Posture:
    """One branch of the inverse kinematics.

    Attributes:
        branch: Its index.
        name: For people.
        state: What may be done with it.
        reason: Why not, one sentence; empty if it can be used.
        q: Joint angles [rad], shape (n,); None where the branch does not reach.
        pairs: What touches.
        stiffness: `slowest_motion` in it [m/rad].
        distance: How far it is from the posture the arm stood in [rad].
        lack: What is missing where the branch of a UR does not reach, else None.
    """

    branch: int
    name: str
    state: State
    reason: str = ""
    q: Floats | None = None
    pairs: tuple[Pair, ...] = ()
    stiffness: float = 0.0
    distance: float = np.inf
    lack: Shortfall | None = None


@dataclass(frozen=True)
class Approach:
    """How near the arm comes to a target that it does not reach.

    Attributes:
        q: In this posture [rad], shape (n,).
        distance: Of the tip from the target [m].
        turned: Angle of the tool from what was asked [rad].
        least: Whether there is nothing nearer with the tool turned as asked; else it is where a search ended.
    """

    q: Floats
    distance: float
    turned: float
    least: bool


@dataclass(frozen=True)
class Answer:
    """The answer to a target.

    Attributes:
        goal: What was asked.
        seed: Posture the arm stood in [rad].
        postures: By branch index.
        shown: The posture the arm takes, an index of `postures`: the nearest that can be used, else the nearest that
            reaches; -1 if none does.
        verdict: One or two sentences.
        approach: How near the arm comes, if no posture reaches; else None.
        seconds: How long all of it took.
    """

    goal: Goal
    seed: Floats
    postures: tuple[Posture, ...]
    shown: int
    verdict: str
    approach: Approach | None
    seconds: float

    @property
    def usable(self) -> int:
        """How many postures can be used."""
        return sum(posture.state is State.USABLE for posture in self.postures)


@dataclass(frozen=True)
class Finish:
    """Where one solver ended, and how long it took [s]."""

    solver: str
    result: IKResult
    seconds: float


class TargetModel:
    """Answers targets for one arm. Not to be used by two threads at a time.

    Args:
        arm: Name or description.
        tip: Short name of the tip frame; default is the arm's own.
        policies: Names or files of trained policies for it, as solvers.

    Attributes:
        kinematics: Goals are for its tip, in the world.
        checker: None for an arm without shapes.
        kinds: What may be asked of the tool.
        lower, upper: Joint limits that count [rad], shape (n,).
        solvers: Names of solvers and policies that can be put beside each other.

    Raises:
        UnknownNameError: Unknown arm or tip.
        InputError: The arm's collision shapes cannot be read.
    """

    def __init__(self, arm: str | ArmDescription, *, tip: str | None = None, policies: Sequence[str] = ()) -> None:
        self.kinematics = ArmKinematics.of(arm, tip=tip, base="world")
        try:
            self.checker: CollisionChecker | None = CollisionChecker(self.kinematics)
        except NoShapesError:
            self.checker = None
        n = self.kinematics.n
        self.kinds = (POINT,) if n < 6 else (POSE, AXIS) if n == 6 else (POSE, AXIS, POINT)
        self.lower, self.upper = self.kinematics.lower.copy(), self.kinematics.upper.copy()
        self._search = LevenbergMarquardtSolver(self.kinematics, max_restarts=0)
        closed = isinstance(self.kinematics, ClosedFormKinematics)
        self.solvers = (*(name for name in SOLVERS if closed or name != "closed-form"), *policies)
        self._solvers: dict[str, Solver] = {}

    @property
    def home(self) -> Floats:
        """The arm's start posture [rad], shape (n,)."""
        return np.array(self.kinematics.arm.home, dtype=np.float64)

    def limit_joints(self, bound: float) -> None:
        """Let no joint turn farther than `bound` [rad] from 0, nor farther than the arm's own limits."""
        lower, upper = self.kinematics.lower, self.kinematics.upper
        self.lower, self.upper = np.clip(-bound, lower, upper), np.clip(bound, lower, upper)

    def goal(self, kind: str, T: Floats) -> Goal:
        """Make a goal from a frame (4, 4) in the world.

        Raises:
            UnknownNameError: The arm cannot be asked for that.
        """
        check_known("kind of goal", kind, self.kinds)
        if kind == POSE:
            return PoseGoal(T)
        return AxisGoal(T[:3, 3], T[:3, 2]) if kind == AXIS else PositionGoal(T[:3, 3])

    def answer(self, goal: Goal, seed: Floats) -> Answer:
        """Find and judge all postures for a goal; the arm goes to the nearest one.

        Args:
            goal: For the tip, in the world.
            seed: Posture the arm stands in [rad], shape (n,).

        Raises:
            InputError: The goal or the seed is malformed.
        """
        start = time.perf_counter()
        postures = tuple(sorted(self._postures(goal, seed), key=lambda posture: posture.branch))
        reached = [i for i, posture in enumerate(postures) if posture.q is not None]
        shown = min(reached, key=lambda i: (postures[i].state is not State.USABLE, postures[i].distance), default=-1)
        approach = self._approach(goal, seed) if not reached else None
        verdict = self._verdict(goal, postures, approach)
        return Answer(goal, seed, postures, shown, verdict, approach, time.perf_counter() - start)

    def along(self, answer: Answer, curve: int, q: Floats) -> Answer:
        """Add a posture (7,) [rad] on a curve of the target's self-motion to an answer, in the place of the last."""
        posture = replace(self._judged(curve, q, answer.seed), name=ALONG)
        postures = (*(other for other in answer.postures if other.name != ALONG), posture)
        shown = answer.shown if answer.shown >= 0 else len(postures) - 1
        verdict = self._verdict(answer.goal, postures, None)
        return replace(answer, postures=postures, shown=shown, verdict=verdict, approach=None)

    def solve(self, goal: Goal, seed: Floats, names: Sequence[str] | None = None) -> list[Finish]:
        """Put a goal to solvers, one after the other; each may take only postures that do not collide.

        Args:
            goal: For the tip, in the world.
            seed: Posture to start from [rad], shape (n,); policies start from the arm's start pose.
            names: Of `solvers`, by default all.

        Raises:
            UnknownNameError: Unknown solver.
            InputError: A policy that is for another task or arm.
        """
        accept = None if self.checker is None else self.checker.free
        finishes = []
        for name in self.solvers if names is None else names:
            check_known("solver", name, self.solvers)
            solver = self._solver(name)
            start = time.perf_counter()
            result = solver.solve(goal, seed, accept=accept)
            seconds = solver.seconds if isinstance(solver, PolicySolver) else time.perf_counter() - start
            finishes.append(Finish(name, result, seconds))
        return finishes

    def slowest_motion(self, q: Floats) -> float:
        """Return how far the tool moves while the joints turn by one radian in all, in its slowest direction [m/rad].

        It is the smallest singular value of the Jacobian, 0 in a singular posture. Turning counts as what it moves
        at a lever of `LEVER`; of an arm with fewer than six joints only the position counts.
        """
        J = self.kinematics.jacobian(q)
        J = np.vstack([J[:3], LEVER * J[3:]]) if self.kinematics.n >= 6 else J[:3]
        return float(np.linalg.svd(J, compute_uv=False)[-1])

    def nearest_singularity(self, q: Floats) -> str:
        """Name the singularity that a posture is nearest to; empty for an arm other than a UR."""
        if not isinstance(self.kinematics, URKinematics):
            return ""
        g = self.kinematics.geometry
        _, q2, q3, q4, q5, _ = q.tolist()
        out = g.a2 * np.cos(q2) + g.a3 * np.cos(q2 + q3) + g.d5 * np.sin(q2 + q3 + q4)
        _, name = min(
            (abs(np.sin(q5)), "wrist: the axes of wrist 1 and wrist 3 are parallel"),
            (abs(np.sin(q3)), "elbow: it is stretched or folded"),
            (abs(out) / g.stretched, "shoulder: the wrist is above the first axis"),
        )
        return name

    def _solver(self, name: str) -> Solver:
        if name not in self._solvers:
            kinematics = self.kinematics
            self._solvers[name] = new_solver(name, kinematics) if name in SOLVERS else PolicySolver(name, kinematics)
        return self._solvers[name]

    def _postures(self, goal: Goal, seed: Floats) -> Iterator[Posture]:
        found: set[int] = set()
        for branch, q in self._found(goal, seed):
            found.add(branch)
            yield self._judged(branch, q, seed)
        for branch, lack in self._missing(goal).items():
            if branch not in found:
                name = branch_name(self.kinematics, branch)
                yield Posture(branch, name, State.UNREACHED, _why_short(lack), lack=lack)

    def complete(self, goal: Goal) -> bool:
        """Return whether all postures for a goal are found, not just some."""
        if isinstance(self.kinematics, SixAxisKinematics):
            return isinstance(goal, PoseGoal)
        return isinstance(self.kinematics, ClosedFormKinematics)

    def _found(self, goal: Goal, seed: Floats) -> Iterator[tuple[int, Floats]]:
        """Branch and principal angles of the postures that reach, whatever the limits."""
        kinematics = self.kinematics
        if not self.complete(goal):
            yield from self._searched(goal, seed)
            return
        if isinstance(kinematics, URKinematics | SixAxisKinematics):
            if isinstance(goal, AxisGoal):
                solutions = kinematics.axis_solutions(goal.position, goal.axis, seed=seed, limits=False)
            else:
                solutions = kinematics.all_solutions(goal.T, seed=seed, limits=False)  # type: ignore[union-attr]
        else:
            solutions = kinematics.all_solutions(goal.position, seed=seed, limits=False)  # type: ignore[attr-defined]
        for row in solutions.found:
            yield row[BRANCH], np.array(row[ANGLES])

    def _searched(self, goal: Goal, seed: Floats) -> Iterator[tuple[int, Floats]]:
        """Postures of an arm without a closed form, from its own and from random starts that are always the same."""
        kept: list[Floats] = []
        for result in self._ends(goal, seed):
            if result.success and not any(np.abs(result.q - q).max() < SAME for q in kept):
                yield len(kept), result.q
                kept.append(result.q)

    def _ends(self, goal: Goal, seed: Floats) -> list[IKResult]:
        rng, kinematics = np.random.default_rng(0), self.kinematics
        starts = [seed, self.home, *rng.uniform(kinematics.lower, kinematics.upper, (STARTS - 2, kinematics.n))]
        return [self._search.solve(goal, start) for start in starts]

    def _approach(self, goal: Goal, seed: Floats) -> Approach:
        """The nearest that the arm comes; of an arm that is not a UR, the nearest of several searches' ends."""
        if isinstance(self.kinematics, URKinematics):
            T = _frame(goal)
            nearest = self.kinematics.nearest_in_reach(T)
            way = nearest[:3, 3] - T[:3, 3]
            for deeper in DEEPER:
                nearest[:3, 3] = T[:3, 3] + way * (1.0 + deeper / np.linalg.norm(way))
                found = [self._judged(branch, q, seed) for branch, q in self._found(self._like(goal, nearest), seed)]
                if found:
                    best = min(found, key=lambda posture: (posture.state is not State.USABLE, posture.distance))
                    return self._approached(goal, best.q, least=True)  # type: ignore[arg-type]
        ends = self._ends(goal, seed)
        return self._approached(goal, min(ends, key=lambda end: end.position_error).q, least=False)

    def _approached(self, goal: Goal, q: Floats, *, least: bool) -> Approach:
        return Approach(q, *goal_error(goal, self.kinematics.fk(q)), least)

    def _like(self, goal: Goal, T: Floats) -> Goal:
        return PoseGoal(T) if isinstance(goal, PoseGoal) else AxisGoal(T[:3, 3], T[:3, 2])

    def _missing(self, goal: Goal) -> dict[int, Shortfall]:
        return self.kinematics.shortfalls(_frame(goal)) if isinstance(self.kinematics, URKinematics) else {}

    def _judged(self, branch: int, q: Floats, seed: Floats) -> Posture:
        name = branch_name(self.kinematics, branch)
        wound = nearest_winding(q.tolist(), seed.tolist(), self.lower.tolist(), self.upper.tolist())
        if wound is None:
            return Posture(branch, name, State.LIMITS, self._why_outside(q), q, (), self.slowest_motion(q), np.inf)
        q = np.array(wound)
        pairs = () if self.checker is None else self.checker.contacts(q)
        reason = f"collision: {listed([self._touch(pair) for pair in pairs])}" if pairs else ""
        state = State.COLLIDES if pairs else State.USABLE
        distance = float(np.linalg.norm(q - seed))
        return Posture(branch, name, state, reason, q, pairs, self.slowest_motion(q), distance)

    def _touch(self, pair: Pair) -> str:
        """Two that touch, what does not move last."""
        a, b = sorted(pair, key=lambda name: name in {box.name for box in self.kinematics.arm.workcell.obstacles})
        return f"{plain(a)} touches {plain(b)}"

    def _why_outside(self, q: Floats) -> str:
        joints = [
            f"{plain(name)} would be at {angle(value)}, allowed is {angle(low)} to {angle(high)}"
            for name, value, low, high in self._outside(q)
        ]
        return f"joint limit: {listed(joints)}"

    def _outside(self, q: Floats) -> Iterator[tuple[str, float, float, float]]:
        """Joints without a turn within their limits: name, the angle nearest to these, and the limits [rad]."""
        for name, at, low, high in zip(
            self.kinematics.arm.joints, q.tolist(), self.lower.tolist(), self.upper.tolist(), strict=True
        ):
            if nearest_winding([at], [0.0], [low], [high]) is None:
                yield name, at + 2 * pi * round(((low + high) / 2 - at) / (2 * pi)), low, high

    def _excess(self, q: Floats) -> float:
        """By how much a posture is outside the joint limits, all joints together [rad]."""
        return sum(max(low - value, value - high) for _, value, low, high in self._outside(q))

    def _verdict(self, goal: Goal, postures: Sequence[Posture], approach: Approach | None) -> str:
        counts = Counter(posture.state for posture in postures)
        usable, total = counts[State.USABLE], len(postures)
        if approach is not None:
            return self._out_of_reach(goal, postures, approach)
        if usable:
            searched = "" if self.complete(goal) else " They were found by a search; there may be more."
            return f"{usable} of {total} postures can be used.{searched}"
        parts = [
            f"{'all ' if counts[state] == total else ''}{counts[state]} {_PLURAL[state]}"
            for state in _PLURAL
            if counts[state]
        ]
        reached = ((posture, posture.q) for posture in postures if posture.q is not None)
        nearest, _ = min(reached, key=lambda pair: (pair[0].distance, self._excess(pair[1])))
        return f"No posture can be used: {listed(parts)}. The nearest: {nearest.reason}."

    def _out_of_reach(self, goal: Goal, postures: Sequence[Posture], approach: Approach) -> str:
        short = _missing_least(postures)
        off = length(approach.distance)
        if approach.least:
            near = f"With the tool turned as asked the tip comes within {off} of it (amber)."
            return f"No posture reaches this target. {short}. {near}" if short else f"No posture reaches it. {near}"
        turned = f" and {angle(approach.turned)}" if approach.turned > SAME else ""
        proof = "" if self.complete(goal) else ", which is not a proof"
        return (
            f"No posture reaches this target: the nearest of {STARTS} searches ends {off}{turned} away (amber){proof}."
        )


def _missing_least(postures: Sequence[Posture]) -> str:
    """The sentence of the branch that is nearest to reaching; empty if none has a shortfall."""
    lacks = [posture.lack for posture in postures if posture.lack is not None]
    if not lacks:
        return ""
    least = _why_short(min(lacks, key=lambda lack: lack.lack))
    return least[0].upper() + least[1:]


def _frame(goal: Goal) -> Floats:
    """A frame (4, 4) that a goal for six joints asks for; any, where one turn is free."""
    if isinstance(goal, PoseGoal):
        return goal.T
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation_to(goal.axis), goal.position  # type: ignore[union-attr]
    return T


def _why_short(lack: Shortfall) -> str:
    missing = length(lack.lack)
    if lack.part is Miss.SHOULDER_CYLINDER:
        return (
            f"too near the first axis by {missing}: the wrist would be {length(lack.needed)} from it, and the "
            f"shoulder's offset keeps it {length(lack.bound)} away"
        )
    if lack.part is Miss.ELBOW_OUT:
        return (
            f"too far by {missing}: the wrist would be {length(lack.needed)} from the shoulder, and the stretched "
            f"elbow reaches {length(lack.bound)}"
        )
    return (
        f"too near by {missing}: the wrist would be {length(lack.needed)} from the shoulder, and the folded elbow "
        f"keeps it {length(lack.bound)} away"
    )
