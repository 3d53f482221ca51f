"""Inverse kinematics of one pose of the UR5: all branches, and one posture near a seed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from benchmarks.speed.measure import EachContender, Timings, clock_seconds, interleaved_each, ratios
from benchmarks.speed.peers.analytic import ANALYTIC, make_eaik
from benchmarks.speed.peers.base import IKPeer, installed, silent
from benchmarks.speed.peers.numeric import (
    SEARCHES,
    TIMEOUT,
    IkpySolver,
    MinkSolver,
    PinkSolver,
    make_optik,
    make_roboticstoolbox,
    make_trac_ik,
)
from benchmarks.speed.poses import FLANGE, random_poses
from benchmarks.speed.sections import Cell, Chart, Options, Progress, Section, Target
from benchmarks.speed.suites import PROFILED
from benchmarks.speed.tables import calls, median_ratio, medians, samples, time_cells
from kinreach._checks import Floats
from kinreach._rotations import pose_error
from kinreach.kinematics import PoseGoal, URKinematics
from kinreach.kinematics._core import NULL, doubles, lib, new_rows
from kinreach.kinematics._solvers import LevenbergMarquardtSolver, Solver, Tolerance
from kinreach.kinematics._solvers.placo_solver import PlacoSolver
from kinreach.kinematics._solvers.qp_solver import QPSolver

AGAIN = "python -m benchmarks.speed --suite ik-single"
REFERENCE = "EAIK"
FORMULAS, PUBLIC, ARRAY = "kinreach, formulas", "kinreach, public call", "kinreach, public call and array"
BOUND, NEAR_BOUND = 0.7, 0.6
BRANCHES_COLUMNS = ("all branches", "solutions", "median [us]", "p95 [us]", "x EAIK", "of the rounds")

BRANCHES_TEXT = """\
{poses} poses of tool0, drawn from postures within +-pi; each call returns every branch. Each call is timed on its own
(reading the clock takes {clock:.2g} us of it). A pose is turned into the peer's own frames before the clock runs.

The formulas are the compiled core's, called with pointers that are kept. The public call also reads the pose, makes
memory for the postures and the object that it returns; it takes {public:.3g} times as long as the formulas. Both check
that the pose is a finite rigid motion, and apply joint limits. Arrays of the postures are made when they are asked for,
which takes {array:.2g} times as long as the formulas once more. The peers are C++ or Rust; they return arrays, IK-Geo
a list."""
WHY = "what comes on top of the formulas is in the interpreter: reading the pose, and the object that is returned"


def run(options: Options, progress: Progress) -> list[Section]:
    """Measure (`benchmarks.speed.suites.Run`)."""
    return [_all_branches(options, progress), _near_a_seed(options, progress)]


def _all_branches(options: Options, progress: Progress) -> Section:
    T = random_poses(np.random.default_rng(options.seed), 100 if options.quick else 1000)
    poses = [np.ascontiguousarray(pose) for pose in T]
    peers, missing = installed(ANALYTIC)
    contenders = [
        EachContender(
            FORMULAS,
            _formulas(),
            [doubles(pose) for pose in poses],
            "kr_solutions(KR_UR, ur, arm, T, NULL, 1, tol, rows)",
        ),
        EachContender(PUBLIC, FLANGE.all_solutions, poses, "all_solutions(T)"),
        EachContender(ARRAY, lambda pose: FLANGE.all_solutions(pose).q, poses, "all_solutions(T).q"),
    ]
    solutions: dict[str, float] = dict.fromkeys(
        (c.name for c in contenders), float(np.mean([len(FLANGE.all_solutions(pose)) for pose in poses]))
    )
    with silent():
        for name, peer in peers.items():
            contenders.append(EachContender(name, peer.call, [peer.prepare(p) for p in poses], peer.note, peer=True))
            solutions[name] = float(np.mean([len(peer.solve(pose)) for pose in poses]))
        timings = interleaved_each(
            contenders, options.rounds, on_round=lambda done, of: progress("one pose, all branches", done, of)
        )
    rows: list[list[Cell]] = [
        [c.name, round(solutions[c.name], 2), *time_cells(timings, c.name, REFERENCE)]
        for c in contenders
        if c.name in timings
    ]
    targets = []
    if REFERENCE in timings:
        ratio = median_ratio(timings, PUBLIC, REFERENCE)
        targets.append(Target(f"{PUBLIC}, one pose, all branches", BOUND, "at most", ratio, "x EAIK", WHY))
    return Section(
        title="One pose of the UR5, all branches",
        text=_text(timings, len(poses)) + "\n\n" + calls(contenders),
        columns=BRANCHES_COLUMNS,
        rows=rows,
        again=AGAIN,
        targets=targets,
        missing=missing | timings.failed,
        charts=[Chart("one pose, all branches", bars=medians(timings), x="us", peers=list(peers))],
        samples=samples(timings),
    )


def _text(timings: Timings, poses: int) -> str:
    public, array = (ratios(timings, name, FORMULAS) for name in (PUBLIC, ARRAY))
    return BRANCHES_TEXT.format(
        poses=poses,
        clock=1e6 * clock_seconds(),
        public=np.median(public),
        array=np.median(array - public),
    )


def _formulas() -> Callable[[Any], int]:
    arguments, rows, solve = FLANGE._arguments, new_rows(8), lib.kr_solutions
    return lambda T: solve(*arguments, T, NULL, 1, 1e-7, rows)


TOLERANCE = Tolerance()
#: A solver stops within the tolerance, as it computes it; ours is computed anew.
ROUNDING = 1.0 + 1e-6
LIMIT_SLACK = 1e-6
NEAREST, EAIK_NEAREST = "kinreach, nearest", "EAIK, nearest branch"
SEED_COLUMNS = (
    "one posture near a seed", "solved [%]", "from the seed alone [%]", "median [us]", "p95 [us]",
    "x kinreach", "of the rounds",
)  # fmt: skip

SEED_TEXT = """\
{poses} poses of tool0, drawn from postures within +-pi; all start from the same home posture. A posture counts when
Pinocchio's forward kinematics puts it within {position:g} m and {orientation:g} rad of the pose and all joints are
within +-pi. kinreach gives the posture nearest to the seed over all branches and windings. EAIK has no such call: its
row picks the branch of `IK(T).Q` nearest to the seed. The others give some posture.
Times are of all calls, failures included.

placo, pink, mink and kinreach's own two solvers run the same loop until the tolerance is met: at most {steps} steps
an attempt, and up to {restarts} restarts from random postures. Steps of placo, pink, mink and QP last 0.2 s under
the URDF's speed limits, and joints that turn full circle are folded into their limits at the end. ikpy has as many
restarts. Its search ends by itself. roboticstoolbox may search as often. OptIK has as
many, and {timeout:g} ms. TRAC-IK restarts by itself until {timeout:g} ms are over, and runs two threads.

{profiled}: the loops took 9 steps on half of the poses. In a step of pink, 60 % of the time built the quadratic
program in Python, 16 % was qpsolvers with daqp; in one of mink, half and a third. Of the closed form's nearest posture
a sixth was the formulas, a quarter limits, windings and sorting, and a quarter the forward kinematics of its error.
The rest was checks of the input and the objects that are returned."""


def _near_a_seed(options: Options, progress: Progress) -> Section:
    T = random_poses(np.random.default_rng(options.seed), 20 if options.quick else 200)
    seed: Floats = np.array(FLANGE.arm.home)
    peers, missing = installed(_makers(seed))
    contenders = [EachContender(NEAREST, lambda pose: FLANGE.nearest(pose, seed), list(T), "nearest(T, seed)")]
    contenders += [
        EachContender(name, peer.call, [peer.prepare(pose) for pose in T], peer.note, peer=name not in _OWN)
        for name, peer in peers.items()
    ]
    timings = interleaved_each(
        contenders, options.rounds, on_round=lambda done, of: progress("one pose, near a seed", done, of)
    )
    rows: list[list[Cell]] = [[NEAREST, _solved(lambda pose: FLANGE.nearest(pose, seed).q[None], T), None]]
    for name, peer in peers.items():
        if name in timings:
            once = partial(_postures, peer, peer.once) if peer.once else None
            rows.append([name, _solved(peer.solve, T), _solved(once, T) if once else None])
    for row in rows:
        row += time_cells(timings, str(row[0]), NEAREST)
    return Section(
        title="One pose of the UR5, one posture near a seed",
        text=SEED_TEXT.format(
            poses=len(T),
            position=TOLERANCE.position,
            orientation=TOLERANCE.orientation,
            steps=30,
            restarts=SEARCHES - 1,
            timeout=1e3 * TIMEOUT,
            profiled=PROFILED,
        )
        + "\n\n"
        + calls(contenders),
        columns=SEED_COLUMNS,
        rows=rows,
        again=AGAIN,
        targets=[
            Target(f"{NEAREST}, one posture near a seed", NEAR_BOUND, "at most", ratio, "x EAIK and numpy", WHY)
            for ratio in ([median_ratio(timings, NEAREST, EAIK_NEAREST)] if EAIK_NEAREST in timings else [])
        ],
        missing=missing | timings.failed,
        charts=[
            Chart(
                "one posture near a seed",
                bars=medians(timings),
                x="us",
                peers=[name for name in peers if name not in _OWN],
            )
        ],
        samples=samples(timings),
    )


_SOLVERS: dict[str, type[Any]] = {
    "placo": PlacoSolver,
    "kinreach, LM": LevenbergMarquardtSolver,
    "kinreach, QP": QPSolver,
    "pink": PinkSolver,
    "mink": MinkSolver,
    "ikpy": IkpySolver,
}
_LOOP = "solve_ik(configuration, [task], dt, ...), in a loop"
_NOTES: dict[type[Any], str] = {
    PinkSolver: _LOOP,
    MinkSolver: _LOOP,
    IkpySolver: 'inverse_kinematics_frame(T, initial_position, orientation_mode="all"), restarted',
}
_OWN = ("kinreach, LM", "kinreach, QP")


def _makers(seed: Floats) -> dict[str, Callable[[], IKPeer]]:
    makers: dict[str, Callable[[], IKPeer]] = {EAIK_NEAREST: partial(_nearest_branch, seed)}
    makers |= {name: partial(_loop, kind, seed) for name, kind in _SOLVERS.items()}
    makers["roboticstoolbox"] = partial(make_roboticstoolbox, seed, TOLERANCE)
    makers["OptIK"] = partial(make_optik, seed, TOLERANCE)
    makers["TRAC-IK"] = partial(make_trac_ik, seed, TOLERANCE)
    return makers


def _nearest_branch(seed: Floats) -> IKPeer:
    """EAIK, and of its branches, whose angles are within +-pi, the one nearest to the seed."""
    branches = make_eaik()

    def call(T: Floats) -> Floats:
        q = branches.postures(branches.call(T))
        return q[np.argsort(((q - seed) ** 2).sum(axis=1))[:1]]

    return IKPeer(f"{branches.note}, then the nearest row", branches.prepare, call, lambda q: q)


def _loop(kind: type[Any], seed: Floats) -> IKPeer:
    """A solver that is iterated and restarted."""
    solver: Solver = kind(URKinematics("ur5-thesis"), tolerance=TOLERANCE)
    once: Solver = kind(URKinematics("ur5-thesis"), tolerance=TOLERANCE, max_restarts=0)

    def postures(result: Any) -> Floats:
        return result.q[None] if result.success else np.empty((0, 6))

    note = _NOTES.get(kind, f"{kind.__name__}(kin).solve(goal, seed)")
    return IKPeer(note, PoseGoal, lambda goal: solver.solve(goal, seed), postures, lambda goal: once.solve(goal, seed))


def _postures(peer: IKPeer, call: Callable[[Any], Any], pose: Floats) -> Floats:
    return peer.postures(call(peer.prepare(pose)))


def _solved(solve: Callable[[Floats], Floats], poses: Sequence[Floats] | Floats) -> float:
    """Share of poses [%] for which a posture comes back that is near enough and within the limits."""
    return 100.0 * float(np.mean([any(map(partial(_good, pose), solve(pose))) for pose in poses]))


def _good(pose: Floats, q: Floats) -> bool:
    position, orientation = pose_error(pose, FLANGE.fk(q))
    near = position <= ROUNDING * TOLERANCE.position and orientation <= ROUNDING * TOLERANCE.orientation
    return near and FLANGE.within_limits(q, tolerance=LIMIT_SLACK)
