"""All postures for a target: which can be used, and why the others cannot."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from math import pi

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats, check_known, listed
from kinreach.errors import NoShapesError
from kinreach.kinematics import (
    ArmKinematics,
    AxisGoal,
    ClosedFormKinematics,
    CollisionChecker,
    Goal,
    IKResult,
    LevenbergMarquardtSolver,
    PalletizerKinematics,
    PoseGoal,
    PositionGoal,
    SixAxisKinematics,
    SlidingKinematics,
    Solver,
    URKinematics,
)
from kinreach.kinematics.inside import SLACK, SOLVERS, Miss, Shortfall, nearest_windings, new_solver
from kinreach.robots import ArmDescription
from kinreach.view._names import angle, branch_name, length, place, plain
from kinreach.view._policy_solver import PolicySolver

#: Kinds of goals.
POSE, AXIS, POINT = "position and orientation", "position and direction", "position only"
#: Name of the posture on a self-motion that the user chose.
ALONG = "on the chosen curve"
#: Starts of the search for postures of an arm without a closed form.
STARTS = 8
#: Postures nearer than this in every joint are the same [rad].
SAME = 1e-3
#: Calls of a solver that are timed, and time after which no other is [s].
CALLS, MOST_TIME = 20, 0.2
#: Depths inside the border of the data sheet's reach at which a calibrated arm's postures are tried [m].
DEPTHS = (0.0, 1e-3, 3e-3, 1e-2, 3e-2)
#: Distance from its axis at which the motion of a turning tool counts [m].
LEVER = 0.2


class State(Enum):
    """Whether a posture can be used, or why not."""

    USABLE = "can be used"
    COLLIDES = "collides"
    LIMITS = "outside the joint limits"
    UNREACHED = "out of reach"


#: Verbs for several postures.
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
        state: Whether it can be used.
        reason: Why not, one sentence; empty if it can be used.
        q: Joint angles [rad], shape (n,); None if the branch does not reach.
        pairs: Names of links and boxes that touch.
        distance: From the posture before [rad].
        shortfall: What is missing if the branch of a UR does not reach, else None.
    """

    branch: int
    name: str
    state: State
    reason: str = ""
    q: Floats | None = None
    pairs: tuple[tuple[str, str], ...] = ()
    distance: float = np.inf
    shortfall: Shortfall | None = None


@dataclass(frozen=True)
class Approach:
    """The nearest posture to a target that is not reached.

    Attributes:
        q: In this posture [rad], shape (n,).
        distance: Of the tip from the target [m].
        turned: Angle of the tool from the goal's [rad].
        proven: Whether it is proven to be the nearest with the tool turned as asked; else it is the end of a search.
    """

    q: Floats
    distance: float
    turned: float
    proven: bool


@dataclass(frozen=True)
class Answer:
    """The answer to a target.

    Attributes:
        goal: Of the target.
        seed: Posture before [rad].
        postures: By branch index.
        shown: Index of the posture to show: the nearest that can be used, else the nearest that reaches; -1 if none
            does.
        verdict: One or two sentences.
        approach: The nearest posture if none reaches, else None.
    """

    goal: Goal
    seed: Floats
    postures: tuple[Posture, ...]
    shown: int
    verdict: str
    approach: Approach | None

    @property
    def usable(self) -> int:
        """Number of postures that can be used."""
        return sum(posture.state is State.USABLE for posture in self.postures)


@dataclass(frozen=True)
class Finish:
    """The result of a solver, and its time [s]: the median of so many calls after the first."""

    solver: str
    result: IKResult
    seconds: float
    calls: int


class TargetModel:
    """Answers targets for one arm. Not to be used by two threads at a time.

    Args:
        arm: Name or description.
        tip: Short name of the tip frame; default is the arm's own.
        policies: Names or files of trained policies for it, as solvers.

    Attributes:
        kinematics: Goals are for its tip, in the world.
        checker: None for an arm without shapes.
        kinds: Of goals for this arm.
        turns: Which joints turn, shape (n,); the others slide.
        lower, upper: Joint limits that count [rad, m], shape (n,).
        solvers: Names of solvers and policies for `solve`.

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
        if n < 6 and isinstance(self.kinematics, SlidingKinematics | PalletizerKinematics):
            self.kinds = (POSE, POINT)
        self.turns: NDArray[np.bool_] = ~self.kinematics.slides
        lower, upper = self.kinematics.lower, self.kinematics.upper
        endless = (upper - lower > 8.0 * pi) & self.turns  # on the page within one turn each way, as its slider says
        self.lower, self.upper = np.where(endless, -2.0 * pi, lower), np.where(endless, 2.0 * pi, upper)
        self._search = LevenbergMarquardtSolver(self.kinematics, max_restarts=0)
        closed = isinstance(self.kinematics, ClosedFormKinematics)
        self.solvers = (*(name for name in SOLVERS if closed or name != "closed-form"), *policies)
        self._solvers: dict[str, Solver] = {}

    @property
    def home(self) -> Floats:
        """The arm's start posture [rad], shape (n,)."""
        return np.array(self.kinematics.arm.home, dtype=np.float64)

    def limit_joints(self, bound: float) -> None:
        """Limit all joints that turn to `-bound` … `bound` [rad], within the arm's own limits."""
        lower, upper = self.kinematics.lower, self.kinematics.upper
        self.lower = np.where(self.turns, np.clip(-bound, lower, upper), lower)
        self.upper = np.where(self.turns, np.clip(bound, lower, upper), upper)

    def goal(self, kind: str, T: Floats) -> Goal:
        """Make a goal from a frame (4, 4) in the world.

        Raises:
            UnknownNameError: The kind is not one of `kinds`.
        """
        check_known("kind of goal", kind, self.kinds)
        if kind == POSE:
            return PoseGoal(T)
        return AxisGoal(T[:3, 3], T[:3, 2]) if kind == AXIS else PositionGoal(T[:3, 3])

    def answer(self, goal: Goal, seed: Floats) -> Answer:
        """Find and judge all postures for a goal.

        Args:
            goal: For the tip, in the world.
            seed: Posture the arm stands in [rad], shape (n,).

        Raises:
            InputError: The goal or the seed is malformed.
        """
        postures = tuple(sorted(self._postures(goal, seed), key=lambda posture: posture.branch))
        reached = [i for i, posture in enumerate(postures) if posture.q is not None]
        shown = min(reached, key=lambda i: (postures[i].state is not State.USABLE, postures[i].distance), default=-1)
        approach = self._approach(goal, seed) if not reached else None
        return Answer(goal, seed, postures, shown, self._verdict(goal, postures, approach), approach)

    def along(self, answer: Answer, curve: int, q: Floats) -> Answer:
        """Add a posture (7,) [rad] on a curve of the self-motion to an answer; it replaces the last one added."""
        posture = replace(self._judged(curve, q, answer.seed), name=ALONG)
        postures = (*(other for other in answer.postures if other.name != ALONG), posture)
        shown = answer.shown if answer.shown >= 0 else len(postures) - 1
        verdict = self._verdict(answer.goal, postures, None)
        return replace(answer, postures=postures, shown=shown, verdict=verdict, approach=None)

    def solve(self, goal: Goal, seed: Floats, names: Sequence[str] | None = None) -> list[Finish]:
        """Solve a goal by several solvers, which accept only postures without collisions.

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
            result = solver.solve(goal, seed, accept=accept)  # the first call of some solvers takes longer
            taken: list[float] = []
            while len(taken) < CALLS and sum(taken) < MOST_TIME:
                start = time.perf_counter()
                solver.solve(goal, seed, accept=accept)
                taken.append(solver.seconds if isinstance(solver, PolicySolver) else time.perf_counter() - start)
            finishes.append(Finish(name, result, float(np.median(taken)), len(taken)))
        return finishes

    def slowest_motion(self, q: Floats) -> float:
        """Return the motion of the tool in its slowest direction for one radian of the joints in all [m/rad].

        It is the smallest singular value of the Jacobian, 0 in a singular posture. Turning counts by the motion at a
        lever of `LEVER`; for fewer than six joints only the position counts.
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
        if isinstance(self.kinematics, URKinematics):
            for branch, shortfall in self.kinematics.shortfalls(goal.frame()).items():
                if branch not in found:
                    name = branch_name(self.kinematics, branch)
                    yield Posture(branch, name, State.UNREACHED, _why_short(shortfall), shortfall=shortfall)

    def complete(self, goal: Goal) -> bool:
        """Return whether all postures for a goal are found."""
        if isinstance(self.kinematics, SixAxisKinematics | SlidingKinematics | PalletizerKinematics):
            return isinstance(goal, PoseGoal)
        return isinstance(self.kinematics, ClosedFormKinematics)

    def _found(self, goal: Goal, seed: Floats) -> Iterator[tuple[int, Floats]]:
        """Branches and principal angles of postures that reach, without limits."""
        kinematics = self.kinematics
        if not self.complete(goal):
            kept: list[Floats] = []
            for result in self._ends(goal, seed):
                if result.success and not any(np.abs(result.q - q).max() < SAME for q in kept):
                    yield len(kept), result.q
                    kept.append(result.q)
            return
        if isinstance(kinematics, SlidingKinematics | PalletizerKinematics):
            solutions = kinematics.all_solutions(goal.frame(), seed=seed, limits=False)
        elif isinstance(kinematics, URKinematics | SixAxisKinematics):
            if isinstance(goal, AxisGoal):
                solutions = kinematics.axis_solutions(goal.position, goal.axis, seed=seed, limits=False)
            else:
                solutions = kinematics.all_solutions(goal.frame(), seed=seed, limits=False)
        else:
            solutions = kinematics.all_solutions(goal.position, seed=seed, limits=False)  # type: ignore[attr-defined]
        yield from zip(solutions.branch.tolist(), solutions.q, strict=True)

    def _ends(self, goal: Goal, seed: Floats) -> list[IKResult]:
        """Ends of searches from fixed starts."""
        rng, kinematics = np.random.default_rng(0), self.kinematics
        starts = [seed, self.home, *rng.uniform(*kinematics.sampling_limits, (STARTS - 2, kinematics.n))]
        return [self._search.solve(goal, start) for start in starts]

    def _approach(self, goal: Goal, seed: Floats) -> Approach:
        """The nearest posture of a UR; for other arms the best end of several searches."""
        if isinstance(self.kinematics, URKinematics):
            T = goal.frame()
            nearest = self.kinematics.nearest_in_reach(T)
            way = nearest[:3, 3] - T[:3, 3]
            for depth in DEPTHS:
                nearest[:3, 3] = T[:3, 3] + way * (1.0 + depth / np.linalg.norm(way))
                near = PoseGoal(nearest) if isinstance(goal, PoseGoal) else AxisGoal(nearest[:3, 3], nearest[:3, 2])
                found = [self._judged(branch, q, seed) for branch, q in self._found(near, seed)]
                if found:
                    best = min(found, key=lambda posture: (posture.state is not State.USABLE, posture.distance))
                    return self._approached(goal, best.q, proven=True)  # type: ignore[arg-type]
        ends = self._ends(goal, seed)
        return self._approached(goal, min(ends, key=lambda end: end.position_error).q, proven=False)

    def _approached(self, goal: Goal, q: Floats, *, proven: bool) -> Approach:
        return Approach(q, *goal.error(self.kinematics.fk(q)), proven)

    def _judged(self, branch: int, q: Floats, seed: Floats) -> Posture:
        name = branch_name(self.kinematics, branch)
        wound, within = nearest_windings(q, seed, self.lower, self.upper, turns=self.turns)
        if not within:
            return Posture(branch, name, State.LIMITS, self._why_outside(q), q)
        q = wound
        pairs = () if self.checker is None else self.checker.contacts(q)
        reason = f"collision: {listed([self._touch(pair) for pair in pairs])}" if pairs else ""
        state = State.COLLIDES if pairs else State.USABLE
        return Posture(branch, name, state, reason, q, pairs, float(np.linalg.norm(q - seed)))

    def _touch(self, pair: tuple[str, str]) -> str:
        """A contact in words, boxes last."""
        a, b = sorted(pair, key=lambda name: name in {box.name for box in self.kinematics.arm.workcell.obstacles})
        return f"{plain(a)} touches {plain(b)}"

    def _why_outside(self, q: Floats) -> str:
        joints = [
            f"{plain(name)} would be at {place(value, slides=slides)}, allowed is {place(low, slides=slides)} to "
            f"{place(high, slides=slides)}"
            for name, value, low, high, slides in self._outside(q)
        ]
        return f"joint limit: {listed(joints)}"

    def _outside(self, q: Floats) -> Iterator[tuple[str, float, float, float, bool]]:
        """Joints that cannot be within their limits: name, nearest place to these, the limits, and if it slides."""
        wound, _ = nearest_windings(q, np.zeros(len(q)), self.lower, self.upper, turns=self.turns)
        rows = np.stack([q, wound, self.lower, self.upper]).tolist()
        for name, turns, at, nearest, low, high in zip(
            self.kinematics.arm.joints, self.turns.tolist(), *rows, strict=True
        ):
            if turns and nearest > high + SLACK:
                yield name, at + 2 * pi * round(((low + high) / 2 - at) / (2 * pi)), low, high, False
            elif not turns and not low - SLACK <= at <= high + SLACK:
                yield name, at, low, high, True

    def _excess(self, q: Floats) -> float:
        """Sum of the ways beyond the joint limits [rad, m]."""
        return sum(max(low - value, value - high) for _, value, low, high, _ in self._outside(q))

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
        if approach.proven:
            near = f"With the tool turned as asked the tip comes within {off} of it (amber)."
            return f"No posture reaches this target. {short}. {near}" if short else f"No posture reaches it. {near}"
        turned = f" and {angle(approach.turned)}" if approach.turned > SAME else ""
        proof = "" if self.complete(goal) else ", which is not a proof"
        return (
            f"No posture reaches this target: the nearest of {STARTS} searches ends {off}{turned} away (amber){proof}."
        )


def _missing_least(postures: Sequence[Posture]) -> str:
    """A sentence on the smallest shortfall; empty if there is none."""
    shortfalls = [posture.shortfall for posture in postures if posture.shortfall is not None]
    if not shortfalls:
        return ""
    sentence = _why_short(min(shortfalls, key=lambda shortfall: shortfall.missing))
    return sentence[0].upper() + sentence[1:]


def _why_short(shortfall: Shortfall) -> str:
    missing = length(shortfall.missing)
    if shortfall.part is Miss.SHOULDER_CYLINDER:
        return (
            f"too near the first axis by {missing}: the wrist would be {length(shortfall.needed)} from it, and the "
            f"shoulder's offset keeps it {length(shortfall.bound)} away"
        )
    if shortfall.part is Miss.ELBOW_OUT:
        return (
            f"too far by {missing}: the wrist would be {length(shortfall.needed)} from the shoulder, and the stretched "
            f"elbow reaches {length(shortfall.bound)}"
        )
    return (
        f"too near by {missing}: the wrist would be {length(shortfall.needed)} from the shoulder, and the folded elbow "
        f"keeps it {length(shortfall.bound)} away"
    )
