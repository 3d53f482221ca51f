"""One posture near a seed for one pose of the UR5: the closed form beside iterative solvers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from benchmarks.speed.measure import EachContender, interleaved_each
from benchmarks.speed.peers import rtb, tracik
from benchmarks.speed.peers.base import IKPeer, installed
from benchmarks.speed.peers.mink_peer import MinkSolver
from benchmarks.speed.peers.pink_peer import PinkSolver
from benchmarks.speed.poses import FLANGE, random_poses
from benchmarks.speed.suite import Cell, Chart, Options, Progress, Section
from benchmarks.speed.suites import PROFILED
from benchmarks.speed.times import calls, medians, samples, time_cells
from kinreach.checks import Floats
from kinreach.kinematics import PoseGoal, UR5Kinematics
from kinreach.kinematics.goals import pose_error
from kinreach.kinematics.solvers import LevenbergMarquardtSolver, Solver, Tolerance
from kinreach.kinematics.solvers.placo_solver import PlacoSolver
from kinreach.kinematics.solvers.qp_solver import QPSolver

TOLERANCE = Tolerance()
#: A solver stops within the tolerance, as it computes it; ours is computed anew.
ROUNDING = 1.0 + 1e-6
LIMIT_SLACK = 1e-6
OURS = "kinreach, nearest"
COLUMNS = (
    "one posture near a seed", "solved [%]", "from the seed alone [%]", "median [us]", "p95 [us]",
    "x kinreach", "of the rounds",
)  # fmt: skip

TEXT = """\
{poses} poses of tool0, drawn from postures within +-pi; all start from the same home posture. A posture counts when
Pinocchio's forward kinematics puts it within {position:g} m and {orientation:g} rad of the pose and all joints are
within +-pi. The closed form gives the posture nearest to the seed over all branches and windings; the others give some
posture. Times are of all calls, failures included.

placo, pink, mink and kinreach's own two solvers run the same loop until the tolerance is met: at most {steps} steps
an attempt, and up to {restarts} restarts from random postures. Steps of placo, pink, mink and QP last 0.2 s under
the URDF's speed limits, and joints that turn full circle are folded into their limits at the end. roboticstoolbox may
search as often; TRAC-IK restarts by itself until {timeout:g} ms are over, and runs two threads.

{profiled}: the loops took 9 steps on half of the poses. In a step of pink, 60 % of the time built the quadratic
program in Python, 16 % was qpsolvers with daqp; in one of mink, half and a third. The closed form's nearest posture was
a sixth the formulas, a quarter limits, windings and sorting, a quarter the forward kinematics that tells its error; the
rest was checks of the input and the objects that are returned."""


def section(options: Options, progress: Progress, again: str) -> Section:
    """Measure."""
    T = random_poses(np.random.default_rng(options.seed), 20 if options.quick else 200)
    seed: Floats = np.array(FLANGE.arm.home)
    peers, missing = installed(_makers(seed))
    contenders = [EachContender(OURS, lambda pose: FLANGE.nearest(pose, seed), list(T), "nearest(T, seed)")]
    contenders += [
        EachContender(name, peer.call, [peer.prepare(pose) for pose in T], peer.note, peer=name not in _OWN)
        for name, peer in peers.items()
    ]
    timings = interleaved_each(
        contenders, options.rounds, on_round=lambda done, of: progress("one pose, near a seed", done, of)
    )
    rows: list[list[Cell]] = [[OURS, _solved(lambda pose: FLANGE.nearest(pose, seed).q[None], T), None]]
    for name, peer in peers.items():
        if name in timings:
            once = partial(_postures, peer, peer.once) if peer.once else None
            rows.append([name, _solved(peer.solve, T), _solved(once, T) if once else None])
    for row in rows:
        row += time_cells(timings, str(row[0]), OURS)
    return Section(
        title="One pose of the UR5, one posture near a seed",
        text=TEXT.format(
            poses=len(T),
            position=TOLERANCE.position,
            orientation=TOLERANCE.orientation,
            steps=30,
            restarts=rtb.SEARCHES - 1,
            timeout=1e3 * tracik.TIMEOUT,
            profiled=PROFILED,
        )
        + "\n\n"
        + calls(contenders),
        columns=COLUMNS,
        rows=rows,
        again=again,
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
}
_OWN = ("kinreach, LM", "kinreach, QP")


def _makers(seed: Floats) -> dict[str, Callable[[], IKPeer]]:
    makers: dict[str, Callable[[], IKPeer]] = {name: partial(_loop, kind, seed) for name, kind in _SOLVERS.items()}
    makers["roboticstoolbox"] = partial(rtb.make, seed, TOLERANCE)
    makers["TRAC-IK"] = partial(tracik.make, seed, TOLERANCE)
    return makers


def _loop(kind: type[Any], seed: Floats) -> IKPeer:
    """A solver that is iterated and restarted."""
    solver: Solver = kind(UR5Kinematics(), tolerance=TOLERANCE)
    once: Solver = kind(UR5Kinematics(), tolerance=TOLERANCE, max_restarts=0)

    def postures(result: Any) -> Floats:
        return result.q[None] if result.success else np.empty((0, 6))

    loop = "solve_ik(configuration, [task], dt, ...), in a loop"
    note = loop if kind in (PinkSolver, MinkSolver) else f"{kind.__name__}(kin).solve(goal, seed)"
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
