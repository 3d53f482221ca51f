"""Speed of the closed form against EAIK in one run: single pose with all branches, and a batch on one core.

    python -m benchmarks.closed_form_speed [--poses 100000] [--rounds 7]

Rounds are interleaved and the best of each is compared, so that a busy machine hits both alike; trust the ratios.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchmarks.edge_cases import FLANGE, random_poses
from benchmarks.peers import eaik_robot
from kinreach.kinematics.ur_ik import solve_pose

SINGLES = 1000


def each(solve: Callable[[Any], object], targets: Sequence[Any]) -> None:
    """Call `solve` on every target and drop what it returns."""
    for target in targets:
        solve(target)


def best_us(jobs: dict[str, tuple[Callable[[], object], int]], rounds: int) -> dict[str, float]:
    """Best time per pose [us] of each job over interleaved rounds."""
    best = dict.fromkeys(jobs, np.inf)
    for _ in range(rounds):
        for name, (job, count) in jobs.items():
            start = time.perf_counter()
            job()
            best[name] = min(best[name], (time.perf_counter() - start) / count * 1e6)
    return best


def main(argv: list[str] | None = None) -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=100_000)
    parser.add_argument("--rounds", type=int, default=7)
    args = parser.parse_args(argv)
    T = random_poses(np.random.default_rng(0), args.poses)
    robot, tool = eaik_robot()
    T_eaik = T @ np.linalg.inv(tool)
    singles = [np.ascontiguousarray(t) for t in T[:SINGLES]]
    singles_eaik = [np.ascontiguousarray(t) for t in T_eaik[:SINGLES]]
    rows = [FLANGE._flange_rows(t) for t in singles]
    geometry = FLANGE.geometry
    q = np.random.default_rng(1).uniform(-np.pi, np.pi, (args.poses, 6))
    single = best_us(
        {
            "EAIK, IK(T).Q": (lambda: each(lambda t: robot.IK(t).Q, singles_eaik), SINGLES),
            "kinreach, solve_pose on floats": (lambda: each(lambda r: solve_pose(r, geometry), rows), SINGLES),
            "kinreach, all_solutions(T), checked input": (lambda: each(FLANGE.all_solutions, singles), SINGLES),
            "kinreach, all_solutions(T).q": (lambda: each(lambda t: FLANGE.all_solutions(t).q, singles), SINGLES),
        },
        5 * args.rounds,
    )
    batch = best_us(
        {
            "EAIK, IK_batched, one thread": (lambda: robot.IK_batched(T_eaik, 1), args.poses),
            "kinreach, batch": (lambda: FLANGE.batch(T), args.poses),
            "kinreach, nearest_batch": (lambda: FLANGE.nearest_batch(T, q), args.poses),
            "kinreach, fk": (lambda: FLANGE.fk(q), args.poses),
        },
        args.rounds,
    )
    for title, times in (("single pose, all branches", single), (f"batch of {args.poses}", batch)):
        reference = next(iter(times.values()))
        print(f"\n{title}: us per pose, and time as a multiple of EAIK's")
        for name, us in times.items():
            print(f"  {name:44s} {us:8.3f}   {us / reference:6.3f}x")
    return 0


if __name__ == "__main__":
    sys.exit(main())
