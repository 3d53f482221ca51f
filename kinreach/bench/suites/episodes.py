"""Single-step episodes of the UR5 under full dynamics: a Python loop, and the native batch on one thread and on two."""

from __future__ import annotations

from functools import partial

import numpy as np

from kinreach.bench.measure import Contender, interleaved
from kinreach.bench.rates import rate_row, short_of_cores
from kinreach.bench.suite import Options, Progress, Section, Target
from kinreach.bench.suites import PROFILED
from kinreach.bench.times import samples
from kinreach.envs import ArmSimulation, BatchSimulation
from kinreach.errors import KinreachError
from kinreach.kinematics import UR5Kinematics
from kinreach.kinematics.goals import Floats

TOOL_DOWN = (0.0, 0.0, -1.0)
#: Least number of episodes per second on two cores.
PER_SECOND = 500.0
#: Episodes in a round, and those of `--quick`.
FULL, QUICK = 256, 32
LOOP = "Python loop, `ArmSimulation`"
BATCHES = {1: "`BatchSimulation`, one thread", 2: "`BatchSimulation`, two threads"}

TEXT = """\
{count} episodes in a round: a reset, a two-phase move from home to a tool-down posture at the goal, and the tip's
position read. The batch ends where the loop does, bit for bit; the tip is {median:.2f} mm from the goal in the median,
{worst:.2f} at most. With one free core two threads are no faster than one: `cores` says how many there were.

{profiled}: under random actions 90 % of a batch's time was MuJoCo's step (`cProfile`). Here `perf record` showed that
step spread flatly: a quarter of the samples were collision detection, the rest kinematics, dynamics and the solver."""


def section(options: Options, progress: Progress, again: str) -> Section:
    """Measure.

    Raises:
        KinreachError: The batch does not do what the loop does.
    """
    count = QUICK if options.quick else FULL
    goals, targets = goals_and_targets(count, options.seed)
    loop = ArmSimulation("ur5")
    batches = {threads: BatchSimulation("ur5", count, threads=threads) for threads in BATCHES}
    tips = serial(loop, targets)
    error = 1e3 * np.linalg.norm(tips - goals, axis=1)
    if any(not np.array_equal(batched(batch, targets), tips) for batch in batches.values()):
        raise KinreachError("the batch of simulations does not do what one after the other does")
    contenders = [
        Contender(LOOP, partial(serial, loop, targets), count),
        *(Contender(name, partial(batched, batches[n], targets), count) for n, name in BATCHES.items()),
    ]
    timings = interleaved(
        contenders, options.rounds, on_round=lambda done, rounds: progress("episodes under dynamics", done, rounds)
    )
    return Section(
        title="Episodes under full dynamics",
        text=TEXT.format(count=count, median=float(np.median(error)), worst=float(error.max()), profiled=PROFILED),
        columns=("", "episodes/s, median", "episodes/s, worst round", "x the loop", "cores"),
        rows=[rate_row(name, timings, (LOOP,)) for name in timings],
        again=again,
        targets=[
            Target(
                "single-step episodes under full dynamics, two threads",
                PER_SECOND,
                "at least",
                float(1 / np.median(timings[BATCHES[2]])),
                "episodes/s",
                short_of_cores(timings, BATCHES[2], 2),
            )
        ],
        samples=samples(timings),
    )


def goals_and_targets(count: int, seed: int) -> tuple[Floats, Floats]:
    """Goals on the table [m], shape (count, 3), and postures that reach them from above [rad], shape (count, 6)."""
    kinematics = UR5Kinematics(tip="tcp", base="world")
    home = np.array(kinematics.arm.home)
    goals = kinematics.arm.workcell.goals.sample(np.random.default_rng(seed), count)
    return goals, np.array([kinematics.axis_goal(goal, TOOL_DOWN, home).q for goal in goals])


def serial(simulation: ArmSimulation, targets: Floats) -> Floats:
    """One episode after the other; the tips' positions [m], shape (n, 3)."""
    tips = []
    for target in targets:
        simulation.reset()
        simulation.move(target)
        tips.append(simulation.tip_position)
    return np.array(tips)


def batched(simulation: BatchSimulation, targets: Floats) -> Floats:
    """All episodes at once."""
    ids = np.arange(len(targets))
    simulation.reset(ids)
    simulation.move(ids, targets)
    return simulation.tip_positions
