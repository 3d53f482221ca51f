"""What other settings do on the problems in cages that `plan_path` does not solve within a second.

    python -m benchmarks.paths.hard

Printed is how many of the problems each planner solves within 1 s of processor time, and which in the time that it has.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from itertools import count
from types import SimpleNamespace
from typing import Any

import numpy as np
from ompl import base

from benchmarks.paths.cli import LIMIT
from benchmarks.paths.planners import kinreach
from benchmarks.paths.problems import MARGIN, Problem, generated, ur5e
from benchmarks.studies.tables import head, line
from kinreach._checks import check_count
from kinreach.cli import Parser, finish
from kinreach.kinematics import CollisionChecker
from kinreach.kinematics import _planning as planning

PROG = "python -m benchmarks.paths.hard"
#: Of the first hundred cages, those that took longer than a second on a busy machine, or were not solved.
CAGES = (1, 6, 7, 42, 51, 57, 88)
RANGES = (0.15, 0.3, 0.45, 0.6)
#: A search begins anew after so much processor time [s].
ANEW = 0.2

Search = Callable[[CollisionChecker, np.ndarray, Any, float, int], np.ndarray | None]


def with_range(longest: float) -> Search:
    """`plan_path` with another longest step of a tree [rad]."""

    def search(checker: CollisionChecker, start: np.ndarray, goals: Any, seconds: float, seed: int) -> Any:
        planning.RANGE = longest
        return kinreach(checker, start, goals, seconds, seed=seed)

    return search


def anew(checker: CollisionChecker, start: np.ndarray, goals: Any, seconds: float, seed: int) -> Any:
    """`plan_path` with one seed after another."""
    planning.RANGE, end = RANGES[1], time.process_time() + seconds
    for attempt in count():
        left = end - time.process_time()
        if left <= 0.0:
            return None
        path = kinreach(checker, start, goals, min(left, ANEW), seed=1000 * seed + attempt)
        if path is not None:
            return path
    return None


SEARCHES: dict[str, Search] = {f"range {longest:g} rad": with_range(longest) for longest in RANGES} | {
    f"range {RANGES[1]:g} rad, anew each {ANEW:g} s": anew
}


def by_the_processor() -> None:
    """Let `plan_path` count processor time, so that other programs do not matter."""
    planning.time = SimpleNamespace(monotonic=time.process_time)  # type: ignore[assignment]

    def ends_in(seconds: float) -> Any:
        end = time.process_time() + seconds
        return base.PlannerTerminationCondition(lambda: time.process_time() > end)

    base.timedPlannerTerminationCondition = ends_in


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cages", default=",".join(map(str, CAGES)), help="default: %(default)s")
    parser.add_argument("--range", type=float, metavar="RAD", help="only with this range")
    parser.add_argument("--seconds", type=int, default=2, help="of processor time (default: %(default)s)")
    parser.add_argument("--seeds", type=int, default=2, help="default: %(default)s")
    arguments = parser.parse_args(argv)
    seconds, seeds = check_count("--seconds", arguments.seconds), check_count("--seeds", arguments.seeds)
    cages = [check_count("--cages", int(word), least=0) for word in arguments.cages.split(",")]
    searches = SEARCHES if arguments.range is None else {f"range {arguments.range:g} rad": with_range(arguments.range)}
    by_the_processor()
    kin, problems = ur5e(), [problem for problem in generated("cage", max(cages) + 1) if problem.index in cages]
    print(head("planner", "searches", f"solved within {LIMIT:g} s", f"cages solved in {seconds} s"))
    for name, search in searches.items():
        in_time, solved = 0, set()
        for problem in problems:
            for seed in range(seeds):
                took = _took(kin, problem, search, seconds, seed)
                in_time += took <= LIMIT
                solved |= {problem.index} if np.isfinite(took) else set()
        print(line(name, len(problems) * seeds, in_time, ", ".join(map(str, sorted(solved)))), flush=True)
    return 0


def _took(kin: Any, problem: Problem, search: Search, seconds: float, seed: int) -> float:
    """Processor time to a path [s]; infinite where there is none."""
    checker = CollisionChecker(kin, obstacles=problem.obstacles, margin=MARGIN)
    began = time.process_time()
    path = search(checker, problem.start, kin.all_solutions(kin.fk(problem.goal)), seconds, seed)
    return float("inf") if path is None else time.process_time() - began


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
