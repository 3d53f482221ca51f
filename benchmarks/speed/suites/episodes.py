"""Single-step episodes of the UR5 under full dynamics: simulations alone, in a loop and as a batch; environments."""

from __future__ import annotations

import time
from contextlib import closing
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.speed.measure import Contender, interleaved
from benchmarks.speed.sections import Options, Progress, Section, Target
from benchmarks.speed.suites import PROFILED
from benchmarks.speed.tables import rate_row, samples, short_of_cores
from kinreach._checks import Floats
from kinreach._registration import SINGLE
from kinreach.envs._reach.reach_task import TOOL_DOWN
from kinreach.errors import KinreachError
from kinreach.kinematics import URKinematics
from kinreach.sim import ArmSimulation, BatchSimulation

#: Least number of episodes per second of the environment on two cores.
PER_SECOND = 500.0
#: Episodes in a round, and those of `--quick`.
FULL, QUICK = 256, 32
LOOP = "Python loop, `ArmSimulation`"
BATCHES = {1: "`BatchSimulation`, one thread", 2: "`BatchSimulation`, two threads"}
THREADS = 2
REACHING = "UR5SingleStep-v0, mujoco, tool-down actions, 2 threads"
RANDOM = "UR5SingleStep-v0, mujoco, random actions, 2 threads"

TEXT = """\
{count} episodes in a round. The first rows are simulations alone: a reset, a two-phase move from home to a tool-down
posture at the goal, and the tip's position read. The batch ends where the loop does, bit for bit; the tip is
{median:.2f} mm from the goal in the median, {worst:.2f} at most. Then the environment, a native batch: a reset with the
same goals and a step with the same postures as actions, of which {reached:.0f} % reached the goal by the task's own
criterion. The target is judged on it. With one free core two threads are no faster than one: `cores` says how many
there were.

The last row has random actions instead, of which {blocked:.0f} % were impossible: something, or the arm itself, was in
the way. Such a move goes on until the arm, pressed against what is there, is found to stand still, and contacts make a
step dearer. Other random postures are farther from home. Simulated time of a move in the mean, and what each second of
it cost on one thread: {costs}.

{profiled}: under random actions 90 % of a batch's time was MuJoCo's step (`cProfile`). Here `perf record` showed that
step spread flatly: a quarter of the samples were collision detection, the rest kinematics, dynamics and the solver."""


def section(options: Options, progress: Progress, again: str) -> Section:
    """Measure.

    Raises:
        KinreachError: The batch does not do what the loop does, or the environment does not do what the batch does.
    """
    count = QUICK if options.quick else FULL
    goals, targets = goals_and_targets(count, options.seed)
    random = np.random.default_rng(options.seed).uniform(-1.0, 1.0, targets.shape)
    loop = ArmSimulation("ur5-thesis")
    batches = {threads: BatchSimulation("ur5-thesis", count, threads=threads) for threads in BATCHES}
    tips = serial(loop, targets)
    error = np.linalg.norm(tips - goals, axis=1)
    if any(not np.array_equal(batched(batch, targets), tips) for batch in batches.values()):
        raise KinreachError("the batch of simulations does not do what one after the other does")
    made = gym.make_vec(SINGLE, num_envs=count, vectorization_mode="vector_entry_point", threads=THREADS)
    with closing(made) as env:
        env.reset(seed=options.seed)
        info = episode(env, goals, targets / np.pi)
        if not np.allclose(info["distance"], error, rtol=0.0, atol=1e-9):
            raise KinreachError("the environment does not do what the batch of simulations does")
        blocked = episode(env, goals, random)["impossible"]
        contenders = [
            Contender(LOOP, partial(serial, loop, targets), count),
            *(Contender(name, partial(batched, batches[n], targets), count) for n, name in BATCHES.items()),
            Contender(REACHING, partial(episode, env, goals, targets / np.pi), count),
            Contender(RANDOM, partial(episode, env, goals, random), count),
        ]
        timings = interleaved(
            contenders, options.rounds, on_round=lambda done, rounds: progress("episodes under dynamics", done, rounds)
        )
    return Section(
        title="Episodes under full dynamics",
        text=TEXT.format(
            count=count,
            median=float(1e3 * np.median(error)),
            worst=float(1e3 * error.max()),
            reached=100 * info["reached"].mean(),
            blocked=100 * blocked.mean(),
            costs=_costs(
                batches[1],
                {
                    "tool-down": targets,
                    "random, attained": np.pi * random[~blocked],
                    "random, impossible": np.pi * random[blocked],
                },
            ),
            profiled=PROFILED,
        ),
        columns=("", "episodes/s, median", "episodes/s, worst round", "x the loop", "cores"),
        rows=[rate_row(name, timings, (LOOP,)) for name in timings],
        again=again,
        targets=[
            Target(
                "single-step episodes of the environment under full dynamics, two threads",
                PER_SECOND,
                "at least",
                float(1 / np.median(timings[REACHING])),
                "episodes/s",
                short_of_cores(timings, REACHING, THREADS),
            )
        ],
        samples=samples(timings),
    )


def _costs(simulation: BatchSimulation, kinds: dict[str, Floats]) -> str:
    """What each kind of moves takes, as far as there are moves of it."""
    parts = []
    for name, targets in kinds.items():
        if len(targets):
            seconds, processor = cost(simulation, targets)
            parts.append(f"{name} {seconds:.2f} s and {1e3 * processor:.2g} ms")
    return "; ".join(parts)


def goals_and_targets(count: int, seed: int) -> tuple[Floats, Floats]:
    """Goals on the table [m], shape (count, 3), and postures that reach them from above [rad], shape (count, 6)."""
    kinematics = URKinematics("ur5-thesis", tip="tcp", base="world")
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
    """Move all arms at once; return the tips [m], shape (n, 3)."""
    ids = np.arange(len(targets))
    simulation.reset(ids)
    simulation.move(ids, targets)
    return simulation.tip_positions


def cost(simulation: BatchSimulation, targets: Floats) -> tuple[float, float]:
    """How long moves from home take in the mean [s, simulated], and the processor's time for each of these seconds."""
    ids = np.arange(len(targets))
    simulation.reset(ids)
    start = time.process_time()
    moves = simulation.move(ids, targets)
    processor = time.process_time() - start
    simulated = sum(move.duration for move in moves)
    return simulated / len(moves), processor / simulated


def episode(env: gym.vector.VectorEnv[Any, Any, Any], goals: Floats, actions: Floats) -> dict[str, Any]:
    """One episode of every environment; what its only step says of it."""
    env.reset(options={"goal": goals})
    info: dict[str, Any] = env.step(actions)[-1]["final_info"]
    return info
