"""Inverse kinematics of many poses of the UR5 at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from benchmarks.speed.measure import LAP, Contender, Timings, interleaved
from benchmarks.speed.peers.analytic import ANALYTIC
from benchmarks.speed.peers.base import installed, silent
from benchmarks.speed.poses import FLANGE, random_poses
from benchmarks.speed.sections import Chart, Options, Progress, Section, Target
from benchmarks.speed.tables import batch_rows, calls, median_ratio, medians, samples, short_of_cores, times_as_fast
from kinreach._checks import Floats

AGAIN = "python -m benchmarks.speed --suite ik-batch"
OURS, NEAREST = "kinreach, batch", "kinreach, nearest_batch"
LOOP = "{}, in a loop"
#: How EAIK is asked for many poses; neither way is always the quicker one.
BATCHED, LOOPED = EAIK = ("EAIK, IK_batched", LOOP.format("EAIK"))
#: How many times as fast as EAIK's quickest way the batch has to be.
BOUND = 10.0
COLUMNS = (
    "time of a pose [us]", "median", "worst round", "x IK_batched", "of the rounds", "x EAIK's loop", "of the rounds",
    "cores",
)  # fmt: skip

TEXT = """\
{poses} poses of tool0, drawn from postures within +-pi; all branches. Peers without a batch are called in a loop over
the first {looped} of them. EAIK, which has one, is timed both ways, and compared by the quicker. Poses
are in the peer's own frames before the clock runs. Calls are repeated until a turn has lasted a quarter of a second,
after one that does not count: the first call after another contender finds its memory given back to the kernel.

kinreach solves one pose after the other in the compiled core, on one thread (`threads=` takes more, for the same bits).
The answer is 384 bytes a pose. `nearest_batch` takes {nearest:.3g} times as long: it turns all 48 joints of a pose's
eight branches into the winding next to the seed, and picks one branch."""


def run(options: Options, progress: Progress) -> list[Section]:
    """Measure (`benchmarks.speed.suites.Run`)."""
    count, looped = (4096, 100) if options.quick else (100_000, 5000)
    rng = np.random.default_rng(options.seed)
    T = random_poses(rng, count)
    seeds = rng.uniform(-np.pi, np.pi, (count, 6))
    contenders = [
        Contender(OURS, partial(FLANGE.batch, T), count, "batch(T)"),
        Contender(NEAREST, partial(FLANGE.nearest_batch, T, seeds), count, "nearest_batch(T, seeds)"),
    ]
    peers, missing = installed(ANALYTIC)
    for name, peer in peers.items():
        if peer.batch is not None:
            batch = peer.batch(T)
            contenders.append(Contender(BATCHED, batch, count, "IK_batched(T, 1)", peer=True))
        given = [peer.prepare(pose) for pose in T[:looped]]
        loop = partial(_each, peer.call, given)
        contenders.append(Contender(LOOP.format(name), loop, looped, peer.note, peer=True))
    with silent():
        timings = interleaved(
            contenders, options.rounds, lap=LAP, on_round=lambda done, of: progress("batch of poses", done, of)
        )
    text = TEXT.format(
        poses=f"{count:,}".replace(",", " "),
        looped=looped,
        nearest=median_ratio(timings, NEAREST, OURS),
    )
    return [
        Section(
            title="Many poses of the UR5",
            text=text + "\n\n" + calls(contenders),
            columns=COLUMNS,
            rows=batch_rows(contenders, timings, *EAIK),
            again=AGAIN,
            targets=_targets(timings, count, options),
            missing=missing | timings.failed,
            charts=[
                Chart(
                    "many poses, all branches",
                    bars=medians(timings),
                    x="us per pose",
                    peers=[c.name for c in contenders if c.peer],
                )
            ],
            samples=samples(timings),
        )
    ]


def _targets(timings: Timings, count: int, options: Options) -> list[Target]:
    why = short_of_cores(timings, OURS, 1) or "which arm, processor and compiler it was says the page"
    if options.quick:
        why = f"--quick: a batch of {count} fills only one block; the target is meant for 100 000 poses"
    what = f"{OURS} of {count}, times as fast as EAIK's quickest"
    return times_as_fast(timings, OURS, EAIK, what=what, bound=BOUND, why=why)


def _each(call: Callable[[Any], object], given: Sequence[Floats]) -> None:
    for pose in given:
        call(pose)
