"""Analytic inverse kinematics on and next to the UR5's singularities: how often it comes back empty or wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.speed.peers.analytic import WITH_APPROXIMATE
from benchmarks.speed.peers.base import installed, silent
from benchmarks.speed.poses import CASES, FLANGE
from benchmarks.speed.sections import Cell, Options, Progress, Section, Target
from kinreach._checks import Floats
from kinreach._rotations import pose_error
from kinreach.kinematics._arm import ArmKinematics

AGAIN = "python -m benchmarks.speed --suite ik-edge-cases"
TOLERANCE = 1e-6
OURS = "kinreach"

#: Pose (4, 4) in, solutions (k, 6) out.
Solve = Callable[[Floats], Floats]

TEXT = """\
Share of poses without any valid solution, in percent; in brackets the share of returned solutions that are wrong.
A solution is valid when Pinocchio's forward kinematics puts tool0 within 1e-6 m and 1e-6 rad of the pose. {poses} poses
a case, each of which a posture within +-pi reaches to 1e-8.

kinreach clamps what leaves its domain by rounding, and chooses the free wrist angle so that the elbow can still reach.
Every solution in which something was clamped or moved is checked by forward kinematics
(`kinreach/kinematics/_core/ur.c`)."""


@dataclass(frozen=True)
class Tally:
    """Result of one method on one case: shares in percent, and the largest error of its valid solutions [m, rad]."""

    empty: float
    spurious: float
    worst: float


def judge(solve: Solve, poses: Floats, arm: ArmKinematics = FLANGE) -> Tally:
    """Run a method over poses, shape (count, 4, 4), and check all it returns by forward kinematics of the arm.

    A method that raises on a pose has come back empty.
    """
    empty = spurious = returned = 0
    worst = 0.0
    for T in poses:
        try:
            solutions = solve(T)
        except Exception:  # of somebody else's code
            solutions = np.empty((0, 6))
        errors = np.array([max(pose_error(T, arm.fk(q))) for q in solutions])
        valid = errors[errors <= TOLERANCE]
        returned += len(errors)
        spurious += len(errors) - len(valid)
        empty += len(valid) == 0
        worst = max(worst, *valid, 0.0)
    return Tally(100 * empty / len(poses), 100 * spurious / max(returned, 1), worst)


def run(options: Options, progress: Progress) -> list[Section]:
    """Measure (`benchmarks.speed.suites.Run`)."""
    peers, missing = installed(WITH_APPROXIMATE)
    methods: dict[str, Solve] = {OURS: lambda T: FLANGE.all_solutions(T).q}
    methods |= {name: peer.solve for name, peer in peers.items()}
    count = 20 if options.quick else 200
    rows: list[list[Cell]] = []
    most_empty = most_wrong = 0.0
    for done, (case, make) in enumerate(CASES.items(), start=1):
        T = make(np.random.default_rng(options.seed), count)
        with silent():
            tallies = {name: judge(solve, T) for name, solve in methods.items()}
        ours = tallies[OURS]
        most_empty, most_wrong = max(most_empty, ours.empty), max(most_wrong, ours.spurious)
        cells = [f"{tally.empty:g} ({tally.spurious:.1f})" for tally in tallies.values()]
        rows.append([case, *cells, f"{ours.worst:.0e}"])
        progress("singular poses", done, len(CASES))
    return [
        Section(
            title="Singular poses of the UR5",
            text=TEXT.format(poses=count),
            columns=("case", *methods, "kinreach's largest error"),
            rows=rows,
            again=AGAIN,
            targets=[
                Target("kinreach, empty in any case", 0.0, "at most", most_empty, "%"),
                Target("kinreach, wrong in any case", 0.0, "at most", most_wrong, "%"),
            ],
            missing=missing,
        )
    ]
