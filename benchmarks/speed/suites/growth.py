"""Cost of a pose, a step and an episode against how many there are at once, with the memory that it takes."""

from __future__ import annotations

import time
from contextlib import ExitStack, closing
from functools import partial

import gymnasium as gym
import numpy as np

from benchmarks.speed.child import peak_memory
from benchmarks.speed.measure import LAP, Contender, Timings, interleaved
from benchmarks.speed.peers.analytic import make_eaik
from benchmarks.speed.peers.base import installed
from benchmarks.speed.sections import Cell, Chart, Options, Progress, Section
from benchmarks.speed.suites import PROFILED
from benchmarks.speed.suites.episodes import batched, goals_and_targets
from benchmarks.speed.tables import median_ratio, samples
from kinreach._registration import SINGLE
from kinreach.kinematics import URKinematics
from kinreach.sim import BatchSimulation

AGAIN = "python -m benchmarks.speed --suite growth"
#: Sizes, and those of `--quick`.
POSES = (1, 10, 100, 1_000, 10_000, 100_000, 1_000_000)
ENVIRONMENTS = (1, 4, 16, 64, 256, 1_024, 4_096, 16_384, 65_536)
SIMULATIONS = (1, 2, 8, 32, 128, 512)
QUICK: dict[tuple[int, ...], tuple[int, ...]] = {
    POSES: (1, 10_000),
    ENVIRONMENTS: (1, 4_096),
    SIMULATIONS: (1, 32),
}
#: EAIK takes many seconds for more.
MAX_EAIK = 100_000
MAX_ROUNDS = 5
THREADS = (1, 2)

_POSES_CODE = """\
import numpy as np
from kinreach.kinematics import URKinematics
kinematics, q = URKinematics("ur5-thesis"), np.random.default_rng(0).uniform(-np.pi, np.pi, ({n}, 6))
"""
IK_CODE = _POSES_CODE + "T = kinematics.fk(q); kinematics.batch(T)"
FK_CODE = _POSES_CODE + "kinematics.fk(q)"
ENV_CODE = """\
import gymnasium, numpy as np, kinreach
env = gymnasium.make_vec("{id}", num_envs={n}, vectorization_mode="vector_entry_point",
                         backend="kinematic")
env.reset(seed=0)
env.step(np.zeros(({n}, 6)))
"""
DYNAMICS_CODE = """\
import numpy as np
from benchmarks.speed.suites.episodes import batched, goals_and_targets
from kinreach.sim import BatchSimulation
batched(BatchSimulation("ur5-thesis", {n}), goals_and_targets({n}, 0)[1])
"""

POSES_TEXT = """\
Batches of random poses, all eight branches (`UR5Kinematics.batch`). EAIK's `IK_batched` is on one thread beside it (the
suite `ik-batch` also calls EAIK in a loop), and forward kinematics of as many postures. Memory is the most that a fresh
process held that did it once, its inputs included.{blank}

Of these sizes, inverse kinematics is cheapest a pose in batches of {ik}, forward kinematics in batches of {fk}. Both
run over blocks of 4096, whose numbers stay in the second-level cache. The eight branches of six angles of a pose are
384 bytes that are written once, a posture's pose is 128.

{profiled}, by `perf record`: a batch of one was 54 % numpy's machinery for calls on arrays of one element and 34 % the
interpreter; single poses have a path of their own, `all_solutions`. At 10 000 poses arithmetic was what remains: three
quarters of the samples were numpy's loops, of which atan2 was the largest single one (18 % of all). At a million 42 %
of the samples were the kernel clearing the pages of the result: inverse kinematics was then bound by memory, not by
arithmetic. Forward kinematics was from 10 000 on (a third of the samples were the kernel's)."""
BLANK_TEXT = (
    " EAIK is timed with up to {most} poses: at what it took for one of those, a single call with {largest} would take "
    "{seconds:.2g} s, so its cells are empty beyond."
)

ENVIRONMENTS_TEXT = """\
Steps of `kinreach/UR5SingleStep-v0` with the kinematic backend; each is a whole episode, its reset included. Memory is
that of a fresh process after a reset and a step.

Of these sizes, a step is cheapest in a batch of {cheapest}. Seeding is not part of the step: the first reset, which
seeds the generators, took {seeding:.3g} us for each of {most} environments, once.{memory}

{profiled}, by `perf record` and `cProfile`: one environment was the interpreter (42 %) and numpy's machinery for calls
(37 %), which a batch shares out; with 4096 environments numpy's loops counted most (45 %). Beyond 16 384 the arrays of
a step were so large that they came fresh from the kernel each time (a fifth of the samples cleared pages and served
faults). Of the memory of an environment two thirds were goals that are drawn ahead, 256 of them, and most of the rest
its two generators (`tracemalloc`)."""
MEMORY_TEXT = " Each of them takes {kilobytes:.2g} kB of memory."

DYNAMICS_TEXT = f"""\
Episodes under full dynamics, as in the suite `env`, in batches on one thread and on two.

What a batch costs besides MuJoCo's step, the Python that plans the moves and looks whether joints have arrived, hardly
grows with the number; MuJoCo steps each by itself. Two threads share out the simulations, and not the rest. One
simulation cannot be shared: its row shows what noise and threads do to a ratio that should be 1. Read rows of a few
with that in mind. `cores that two had` says how much of two cores there was.

{PROFILED}: with 256 simulations the step was 90 % of the time (`cProfile`, random actions)."""


def run(options: Options, progress: Progress) -> list[Section]:
    """Measure (`benchmarks.speed.suites.Run`)."""
    return [part(options, progress) for part in (_poses, _environments, _dynamics)]


def _poses(options: Options, progress: Progress) -> Section:
    kinematics = URKinematics("ur5-thesis")
    rng = np.random.default_rng(options.seed)
    peers, missing = installed({"EAIK": make_eaik})
    contenders = []
    sizes = _sizes(POSES, options)
    for n in sizes:
        q = rng.uniform(-np.pi, np.pi, (n, 6))
        T = kinematics.fk(q)
        contenders.append(Contender(f"IK {n}", partial(kinematics.batch, T), n))
        contenders.append(Contender(f"FK {n}", partial(kinematics.fk, q), n))
        if n <= MAX_EAIK and "EAIK" in peers and peers["EAIK"].batch is not None:
            contenders.append(Contender(f"EAIK {n}", peers["EAIK"].batch(T), n, peer=True))
    timings = _timed("batches of poses", contenders, options, progress)
    rows: list[list[Cell]] = []
    for n in sizes:
        progress("memory of batches of poses", sizes.index(n), len(sizes))
        ratio = median_ratio(timings, f"EAIK {n}", f"IK {n}") if f"EAIK {n}" in timings else None
        times = (_us(timings, f"{what} {n}") for what in ("IK", "EAIK", "FK"))
        rows.append([n, *times, ratio, *(peak_memory(code.format(n=n)) for code in (IK_CODE, FK_CODE))])
    return Section(
        title="Growth: poses",
        text=POSES_TEXT.format(
            ik=_cheapest(timings, sizes, "IK"),
            fk=_cheapest(timings, sizes, "FK"),
            blank=_blank(timings, sizes),
            profiled=PROFILED,
        ),
        columns=(
            "poses",
            "IK [us a pose]",
            "EAIK [us a pose]",
            "FK [us a pose]",
            "EAIK / IK",
            "memory with IK [MB]",
            "with FK [MB]",
        ),
        rows=rows,
        again=AGAIN,
        missing=missing | timings.failed,
        charts=[
            Chart(
                "cost of a pose",
                lines=_lines(timings, sizes, ("IK", "EAIK", "FK")),
                x="poses in a batch",
                y="us a pose",
            )
        ],
        samples=samples(timings),
    )


def _environments(options: Options, progress: Progress) -> Section:
    sizes = _sizes(ENVIRONMENTS, options)
    contenders = []
    with ExitStack() as opened:
        for n in sizes:
            env = gym.make_vec(SINGLE, num_envs=n, vectorization_mode="vector_entry_point", backend="kinematic")
            opened.enter_context(closing(env))
            start = time.perf_counter()
            env.reset(seed=options.seed)
            seeding = time.perf_counter() - start  # of the largest, in the end
            actions = np.random.default_rng(options.seed).uniform(-1.0, 1.0, (n, 6))
            contenders.append(Contender(f"step {n}", partial(env.step, actions), n))
        timings = _timed("kinematic environments", contenders, options, progress)
    rows: list[list[Cell]] = []
    for n in sizes:
        progress("memory of kinematic environments", sizes.index(n), len(sizes))
        us = _us(timings, f"step {n}")
        rows.append([n, us, None if us is None else 1e6 / us, peak_memory(ENV_CODE.format(n=n, id=SINGLE))])
    return Section(
        title="Growth: kinematic environments",
        text=ENVIRONMENTS_TEXT.format(
            cheapest=_cheapest(timings, sizes, "step"),
            seeding=1e6 * seeding / sizes[-1],
            most=sizes[-1],
            memory=_memory(sizes, [row[-1] for row in rows]),
            profiled=PROFILED,
        ),
        columns=("environments", "us a step", "steps/s", "memory [MB]"),
        rows=rows,
        again=AGAIN,
        charts=[
            Chart(
                "cost of a kinematic step",
                lines=_lines(timings, sizes, ("step",)),
                x="environments in a batch",
                y="us a step",
            )
        ],
        samples=samples(timings),
    )


def _dynamics(options: Options, progress: Progress) -> Section:
    sizes = _sizes(SIMULATIONS, options)
    contenders = []
    for n in sizes:
        targets = goals_and_targets(n, options.seed)[1]
        for threads in THREADS:
            simulation = BatchSimulation("ur5-thesis", n, threads=threads)
            episodes = partial(batched, simulation, targets)
            contenders.append(Contender(_threads(threads, n), episodes, n))
    timings = _timed("simulations", contenders, options, progress)
    rows: list[list[Cell]] = []
    for n in sizes:
        progress("memory of simulations", sizes.index(n), len(sizes))
        one, two = (_threads(threads, n) for threads in THREADS)
        per_second = (float(1 / np.median(timings[name])) for name in (one, two))
        faster = median_ratio(timings, one, two)
        rows.append([n, *per_second, faster, round(timings.cores[two], 2), peak_memory(DYNAMICS_CODE.format(n=n))])
    return Section(
        title="Growth: simulations with dynamics",
        text=DYNAMICS_TEXT,
        columns=(
            "simulations",
            "episodes/s, one thread",
            "episodes/s, two threads",
            "two / one",
            "cores that two had",
            "memory [MB]",
        ),
        rows=rows,
        again=AGAIN,
        charts=[
            Chart(
                "cost of an episode with dynamics",
                lines=_lines(timings, sizes, tuple(_threads(threads) for threads in THREADS)),
                x="simulations in a batch",
                y="us an episode",
            )
        ],
        samples=samples(timings),
    )


def _sizes(full: tuple[int, ...], options: Options) -> tuple[int, ...]:
    return QUICK[full] if options.quick else full


def _timed(what: str, contenders: list[Contender], options: Options, progress: Progress) -> Timings:
    rounds = min(options.rounds, MAX_ROUNDS)
    return interleaved(contenders, rounds, lap=LAP, on_round=lambda done, all_rounds: progress(what, done, all_rounds))


def _threads(threads: int, n: int | None = None) -> str:
    name = "one thread" if threads == 1 else "two threads"
    return name if n is None else f"{name} {n}"


def _us(timings: Timings, name: str) -> float | None:
    return float(1e6 * np.median(timings[name])) if name in timings else None


def _cheapest(timings: Timings, sizes: tuple[int, ...], name: str) -> int:
    """The size at which one takes least."""
    return min(sizes, key=lambda n: float(np.median(timings[f"{name} {n}"])))


def _blank(timings: Timings, sizes: tuple[int, ...]) -> str:
    """Sentences that say why EAIK's cells are empty where they are; nothing where it was not timed at all."""
    timed = [n for n in sizes if f"EAIK {n}" in timings]
    if not timed or timed[-1] == sizes[-1]:
        return ""
    seconds = 1e-6 * (_us(timings, f"EAIK {timed[-1]}") or 0.0)
    return BLANK_TEXT.format(most=timed[-1], seconds=seconds * sizes[-1], largest=sizes[-1])


def _memory(sizes: tuple[int, ...], megabytes: list[Cell]) -> str:
    """A sentence that says what one among the most takes more than one alone; empty where memory is not told."""
    one, most = megabytes[0], megabytes[-1]
    if not isinstance(one, float) or not isinstance(most, float):
        return ""
    return MEMORY_TEXT.format(kilobytes=1e3 * (most - one) / (sizes[-1] - sizes[0]))


def _lines(timings: Timings, sizes: tuple[int, ...], names: tuple[str, ...]) -> dict[str, list[tuple[float, float]]]:
    """Microseconds against size, of those that were timed."""
    lines: dict[str, list[tuple[float, float]]] = {}
    for name in names:
        points = [(float(n), us) for n in sizes if (us := _us(timings, f"{name} {n}")) is not None]
        if points:
            lines[name] = points
    return lines
