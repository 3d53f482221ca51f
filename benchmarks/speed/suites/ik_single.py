"""Inverse kinematics of one pose of the UR5: all branches, and one posture near a seed."""

from __future__ import annotations

import numpy as np

from benchmarks.speed.measure import EachContender, Timings, clock_seconds, interleaved_each, ratios
from benchmarks.speed.peers.analytic import ANALYTIC
from benchmarks.speed.peers.base import installed, silent
from benchmarks.speed.poses import FLANGE, random_poses
from benchmarks.speed.suite import Cell, Chart, Options, Progress, Section, Target
from benchmarks.speed.suites import PROFILED, ik_seeded
from benchmarks.speed.times import calls, median_ratio, medians, samples, time_cells
from kinreach.kinematics.ur.closed_form import solve_pose

AGAIN = "python -m benchmarks.speed --suite ik-single"
REFERENCE = "EAIK"
FORMULAS, PUBLIC, ARRAY = "kinreach, formulas", "kinreach, public call", "kinreach, public call and array"
BOUND = 1.0
COLUMNS = ("all branches", "solutions", "median [us]", "p95 [us]", "x EAIK", "of the rounds")

TEXT = """\
{poses} poses of tool0, drawn from postures within +-pi; each call returns every branch. Each call is timed on its own
(reading the clock takes {clock:.2g} us of it). A pose is turned into the peer's own frames before the clock runs.

The formulas, with 20 arctangents and 7 square roots, run in pure Python on floats (`kinreach.kinematics.ur.closed_form`); the
peers are C++. What bounds the formulas is the interpreter. The public call also checks that the pose is a finite rigid
motion, and applies joint limits; it takes {public:.3g} times as long as the formulas. The array of the postures is made
when it is asked for, which takes {array:.2g} times as long as the formulas once more.

{profiled}: of the time that the public call adds to the formulas two fifths go into reading and checking the pose, a
quarter into the object that it returns, the rest into calls and defaults."""
WHY = (
    "what comes on top of the formulas is checks of the input and the object that is returned, both in the "
    "interpreter; the profile is in the section below"
)


def run(options: Options, progress: Progress) -> list[Section]:
    """Measure; see `benchmarks.speed.suite.Suite`."""
    return [_all_branches(options, progress), ik_seeded.section(options, progress, AGAIN)]


def _all_branches(options: Options, progress: Progress) -> Section:
    T = random_poses(np.random.default_rng(options.seed), 100 if options.quick else 1000)
    poses = [np.ascontiguousarray(pose) for pose in T]
    geometry = FLANGE.geometry
    peers, missing = installed(ANALYTIC)
    contenders = [
        EachContender(
            FORMULAS,
            lambda rows: solve_pose(rows, geometry),
            [FLANGE._flange_rows(pose) for pose in poses],
            "solve_pose(rows, geometry)",
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
        for name, why in ((FORMULAS, ""), (PUBLIC, WHY)):
            ratio = median_ratio(timings, name, REFERENCE)
            targets.append(Target(f"{name}, one pose, all branches", BOUND, "at most", ratio, "x EAIK", why))
    return Section(
        title="One pose of the UR5, all branches",
        text=_text(timings, len(poses)) + "\n\n" + calls(contenders),
        columns=COLUMNS,
        rows=rows,
        again=AGAIN,
        targets=targets,
        missing=missing | timings.failed,
        charts=[Chart("one pose, all branches", bars=medians(timings), x="us", peers=list(peers))],
        samples=samples(timings),
    )


def _text(timings: Timings, poses: int) -> str:
    public, array = (ratios(timings, name, FORMULAS) for name in (PUBLIC, ARRAY))
    return TEXT.format(
        poses=poses,
        clock=1e6 * clock_seconds(),
        public=np.median(public),
        array=np.median(array - public),
        profiled=PROFILED,
    )
