"""How often an analytic IK comes back empty on and next to the UR5's singularities: ours beside three peers.

    python -m benchmarks.singular_cases [--poses 200] [--seed 0] [--out FILE]

A solution counts when forward kinematics (Pinocchio) puts tool0 within 1e-6 m and 1e-6 rad of the target and every
joint is within +-pi, turned by full turns where that helps. "spurious" is the share of returned solutions that miss.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.edge_cases import CASES, FLANGE
from benchmarks.peers import PEERS, PeerSolve, silent
from kinreach.kinematics.goals import pose_error

TOLERANCE = 1e-6


@dataclass(frozen=True)
class Tally:
    """Result of one method on one case: shares in percent, and the largest error of its valid solutions."""

    empty: float
    spurious: float
    worst: float


def judge(solve: PeerSolve, poses: np.ndarray) -> Tally:
    """Run a method over poses and check all it returns by forward kinematics."""
    empty = spurious = returned = 0
    worst = 0.0
    for T in poses:
        errors = np.array([max(pose_error(T, FLANGE.fk(q))) for q in solve(T)])
        valid = errors[errors <= TOLERANCE]
        returned += len(errors)
        spurious += len(errors) - len(valid)
        empty += len(valid) == 0
        worst = max(worst, *valid, 0.0)
    return Tally(100 * empty / len(poses), 100 * spurious / max(returned, 1), worst)


def table(poses: int, seed: int) -> str:
    """The comparison as a Markdown table."""
    methods: dict[str, PeerSolve] = {"kinreach": lambda T: FLANGE.all_solutions(T).q}
    methods |= {name: make() for name, make in PEERS.items()}
    head = f"| case ({poses} poses each, seed {seed}) | " + " | ".join(methods) + " | kinreach's largest error |"
    lines = [head, "|---" * (len(methods) + 2) + "|"]
    for name, make in CASES.items():
        T = make(np.random.default_rng(seed), poses)
        with silent():
            tallies = [judge(solve, T) for solve in methods.values()]
        cells = [f"{t.empty:g} ({t.spurious:.1f})" for t in tallies]
        lines.append(f"| {name} | " + " | ".join(cells) + f" | {tallies[0].worst:.0e} |")
    return "\n".join(lines)


def main(argv: list[str] | None = None) -> int:
    """Print the table, and write it where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args(argv)
    text = (
        "Share of poses without any valid solution, in percent "
        "(in brackets: share of returned solutions that are wrong)"
        f"\n\n{table(args.poses, args.seed)}\n"
    )
    print(text)
    if args.out:
        args.out.write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
