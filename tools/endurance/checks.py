"""All checks, with their sizes: of a full run, and of a quick one."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tools import digest
from tools.endurance import five_axes, kills, long_runs, results, self_motions, storage, workers
from tools.endurance.outcome import Outcome


@dataclass(frozen=True)
class Check:
    """Something that is promised.

    Attributes:
        promise: In a few words.
        run: Checks it with so many cases, see below.
        full, quick: How many.
    """

    promise: str
    run: Callable[[int], Outcome]
    full: int
    quick: int


def _killed(name: str) -> Callable[[int], Outcome]:
    def check(count: int) -> Outcome:
        with tempfile.TemporaryDirectory() as folder:
            return kills.kill_and_go_on(kills.WORKS[name], Path(folder), kills=count)

    return check


def _disks(count: int) -> Outcome:
    """On `count` disks of different sizes for each job."""
    with tempfile.TemporaryDirectory() as folder:
        return storage.full_disks(Path(folder), sizes=storage.SIZES[:count])


CHECKS = {
    "kill-training": Check("a killed training goes on to the same policy", _killed("training"), 25, 2),
    "kill-off-policy": Check("so does one with a replay buffer", _killed("off-policy training"), 10, 2),
    "kill-comparison": Check("a killed comparison goes on to the same results", _killed("comparison"), 25, 2),
    "disks": Check("a full or read-only disk: one line, nothing lost", _disks, len(storage.SIZES), 2),
    "kinematic-steps": Check("no leak, no drift without dynamics", long_runs.kinematic_steps, 1_000_000, 20_000),
    "dynamics-steps": Check("no leak, no drift with dynamics", long_runs.dynamics_steps, 100_000, 500),
    "torque-steps": Check("no leak, no drift under torque", long_runs.torque_steps, 100_000, 5_000),
    "camera-resets": Check("no leak, no drift with cameras", long_runs.camera_resets, 10_000, 50),
    "contexts": Check("renderers give everything back", long_runs.graphics_contexts, 200, 20),
    "threads": Check("one instance per thread: the same bits", workers.in_threads, 10, 1),
    "processes": Check("forked, spawned and pickled: the same bits", lambda _: workers.in_processes(), 1, 1),
    "killed-workers": Check("a dead worker is an error and no hang", workers.killed_worker, 30, 2),
    "self-motions": Check("eight seven-axis arms lose no posture", self_motions.from_anywhere, 100, 2),
    "singular-self-motions": Check(
        "nor do they beside their singularities", self_motions.beside_singularities, 1000, 4
    ),
    "five-axes": Check(
        "four and five axes lose nothing stationary", lambda count: five_axes.many_starts(range(count)), 10_000, 40
    ),
    "fuzz": Check("whatever is handed in: right, or refused", results.fuzzing, len(results.MODULES), 2),
    "digest": Check("the results of tools/digest.txt", results.digests, len(digest.RESULTS), 4),
}


def run(name: str, count: int) -> Outcome:
    """Run the check of that name with so many cases."""
    return CHECKS[name].run(count)
