"""Single-step episodes of the UR5 under full dynamics: a Python loop, and the native batch on one thread and on two.

    python -m benchmarks.episodes [--goals 256] [--rounds 7]

An episode is a reset, a two-phase move from home to a tool-down posture at the goal, and the tip's position read.
Rounds are interleaved, so that a busy machine hits all alike; trust the ratios. With one free core the batch on two
threads cannot be faster than on one: CPU time over wall time says how many cores it had.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable

import numpy as np

from kinreach.envs import ArmSimulation, BatchSimulation
from kinreach.kinematics import UR5Kinematics

TOOL_DOWN = (0.0, 0.0, -1.0)


def serial(simulation: ArmSimulation, targets: np.ndarray) -> np.ndarray:
    """One episode after the other; the tips' positions [m], shape (n, 3)."""
    tips = []
    for target in targets:
        simulation.reset()
        simulation.move(target)
        tips.append(simulation.tip_position)
    return np.array(tips)


def batched(simulation: BatchSimulation, targets: np.ndarray) -> np.ndarray:
    """All episodes at once."""
    ids = np.arange(len(targets))
    simulation.reset(ids)
    simulation.move(ids, targets)
    return simulation.tip_positions


def measure(jobs: dict[str, Callable[[], object]], rounds: int) -> dict[str, np.ndarray]:
    """Wall and CPU time [s] of every job in each of the interleaved rounds, shape (rounds, 2)."""
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, job in jobs.items():
            wall, cpu = time.perf_counter(), time.process_time()
            job()
            times[name].append((time.perf_counter() - wall, time.process_time() - cpu))
    return {name: np.array(rows) for name, rows in times.items()}


def table(times: dict[str, np.ndarray], episodes: int) -> str:
    """Markdown."""
    lines = [
        "| | episodes/s, median | best | episodes per CPU second | faster, median of rounds | cores |",
        "|---|---|---|---|---|---|",
    ]
    reference = next(iter(times.values()))[:, 0]
    for name, rows in times.items():
        wall, cpu = rows.T
        per_second = [f"{episodes / seconds:.0f}" for seconds in (np.median(wall), wall.min(), np.median(cpu))]
        ratios = [f"{np.median(reference / wall):.2f}x", f"{np.median(cpu / wall):.2f}"]
        lines.append(f"| {' | '.join([name, *per_second, *ratios])} |")
    return "\n".join(lines)


def main(argv: list[str] | None = None) -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--goals", type=int, default=256)
    parser.add_argument("--rounds", type=int, default=7)
    args = parser.parse_args(argv)
    kinematics = UR5Kinematics(tip="tcp", base="world")
    home = np.array(kinematics.arm.home)
    goals = kinematics.arm.workcell.goals.sample(np.random.default_rng(0), args.goals)
    targets = np.array([kinematics.axis_goal(goal, TOOL_DOWN, home).q for goal in goals])
    loop = ArmSimulation("ur5")
    batches = {threads: BatchSimulation("ur5", args.goals, threads=threads) for threads in (1, 2)}
    error = np.linalg.norm(serial(loop, targets) - goals, axis=1)
    if any(not np.array_equal(batched(batch, targets), serial(loop, targets)) for batch in batches.values()):
        print("the batch does not do what the loop does", file=sys.stderr)
        return 1
    times = measure(
        {
            "Python loop, `ArmSimulation`": lambda: serial(loop, targets),
            "`BatchSimulation`, one thread": lambda: batched(batches[1], targets),
            "`BatchSimulation`, two threads": lambda: batched(batches[2], targets),
        },
        args.rounds,
    )
    print(table(times, args.goals))
    print(
        f"\nThe tip ends {1e3 * np.median(error):.2f} mm from the goal in the median, {1e3 * error.max():.2f} at most."
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
