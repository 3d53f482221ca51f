"""Inverse kinematics of many poses of the UR5 at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from kinreach.bench.measure import LAP, Contender, interleaved
from kinreach.bench.peers.analytic import ANALYTIC
from kinreach.bench.peers.base import installed, silent
from kinreach.bench.poses import FLANGE, random_poses
from kinreach.bench.rates import short_of_cores
from kinreach.bench.suite import Chart, Options, Progress, Section, Target
from kinreach.bench.times import batch_rows, calls, median_ratio, medians, samples
from kinreach.kinematics.goals import Floats

AGAIN = "python -m kinreach.bench --suite ik-batch"
OURS, NEAREST, REFERENCE = "kinreach, batch", "kinreach, nearest_batch", "EAIK, IK_batched"
#: How many times as fast as EAIK the batch has to be.
BOUND = 10.0
COLUMNS = ("batch", "median [us per pose]", "p95", "x EAIK", "of the rounds", "cores")

TEXT = """\
{poses} poses of tool0, drawn from postures within +-pi; all branches. Peers without a batch are called in a loop over
the first {looped} of them. Poses are in the peer's own frames before the clock runs. Calls are repeated
until a turn has lasted a quarter of a second, after one that does not count: the first call after another contender
finds its memory given back to the kernel, and takes twice as long.

kinreach works on structure-of-arrays blocks of 4096 poses that stay in the cache, in numpy, whose arctan2 takes 2 ns
with AVX-512. By a profile, 60 % of the time is arithmetic within the blocks, 17 % is fresh memory for the answer
(38 MB for 100 000 poses), and the rest is moving poses and answers between memory and cache. `nearest_batch` takes
three times as long: it turns all 48 joints of a pose's eight branches into the winding next to the seed, and picks one
branch."""


def run(options: Options, progress: Progress) -> list[Section]:
    """Measure; see `kinreach.bench.suite.Suite`."""
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
            contenders.append(Contender(REFERENCE, batch, count, "IK_batched(T, 1)", peer=True))
        given = [peer.prepare(pose) for pose in T[:looped]]
        loop = partial(_each, peer.call, given)
        contenders.append(Contender(f"{name}, in a loop", loop, looped, peer.note, peer=True))
    with silent():
        timings = interleaved(
            contenders, options.rounds, lap=LAP, on_round=lambda done, of: progress("batch of poses", done, of)
        )
    targets = []
    if REFERENCE in timings:
        faster = median_ratio(timings, REFERENCE, OURS)
        why = short_of_cores(timings, OURS, 1) or "where the time goes says the profile in the text"
        if options.quick:
            why = f"--quick: a batch of {count} fills only one block; the target is meant for 100 000 poses"
        what = f"{OURS} of {count}, times as fast"
        targets.append(Target(what, BOUND, "at least", faster, "x EAIK's IK_batched", why))
    return [
        Section(
            title="Many poses of the UR5",
            text=TEXT.format(poses=f"{count:,}".replace(",", " "), looped=looped) + "\n\n" + calls(contenders),
            columns=COLUMNS,
            rows=batch_rows(contenders, timings, REFERENCE),
            again=AGAIN,
            targets=targets,
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


def _each(call: Callable[[Any], object], given: Sequence[Floats]) -> None:
    for pose in given:
        call(pose)
