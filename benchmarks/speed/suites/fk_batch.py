"""Forward kinematics of many postures of the UR5 at once."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from benchmarks.speed.measure import LAP, Contender, interleaved
from benchmarks.speed.peers.base import installed
from benchmarks.speed.peers.numeric import elementary_transforms
from benchmarks.speed.sections import Chart, Options, Progress, Section
from benchmarks.speed.suites import PROFILED
from benchmarks.speed.tables import batch_rows, calls, median_ratio, medians, samples, times_as_fast
from kinreach._checks import Floats
from kinreach._engines import load
from kinreach.errors import KinreachError
from kinreach.kinematics import ArmKinematics

AGAIN = "python -m benchmarks.speed --suite fk-batch"
OURS, POSITIONS = "kinreach, fk", "kinreach, positions"
ALL_FRAMES, ONE_FRAME = PINOCCHIO = ("Pinocchio, all frames", "Pinocchio, one frame")
ROBOTICS = "roboticstoolbox"
pin: Any = load("pinocchio")

#: How far results may be apart [m, and entries of rotations].
AGREE = 1e-10
#: How many times as fast as the quicker of the Python loops over Pinocchio the batch has to be.
BOUND = 5.0
COLUMNS = (
    "time of a posture [us]", "median", "worst round", "x all frames", "of the rounds", "x one frame", "of the rounds",
    "cores",
)  # fmt: skip

TEXT = """\
{postures} postures within +-pi; the pose of tool0 as a matrix (4, 4), all of them in one array at the end. Pinocchio is
called for each posture in a Python loop: as its examples do (all frames), and the quickest way (one frame). Their
results agree to 1e-10 before anything is timed.

kinreach's formula is brought to as few numpy calls as possible, on blocks of 4096 postures that stay in the cache.
`positions`, which leaves the rotation out, takes {positions:.2g} of its time.

{profiled}: 85 % of the formula's time was arithmetic within the blocks. Of Pinocchio's loop over all frames, a quarter
was `forwardKinematics` and a fifth the placement of 26 frames. The rest was turning one of them into a matrix on the
Python side."""


def run(options: Options, progress: Progress) -> list[Section]:
    """Measure (`benchmarks.speed.suites.Run`)."""
    count, looped = (4096, 500) if options.quick else (100_000, 10_000)
    q = np.random.default_rng(options.seed).uniform(-np.pi, np.pi, (count, 6))
    some = q[:looped]
    kin = ArmKinematics("ur5-thesis", tip="tool0", base="world")
    peers, missing = installed({ROBOTICS: lambda: elementary_transforms(kin)})
    contenders = [
        Contender(OURS, partial(kin.fk, q), count, "fk(q)"),
        Contender(POSITIONS, partial(kin.positions, q), count, "positions(q)"),
        Contender(ALL_FRAMES, partial(_all_frames, kin, some), looped, "forwardKinematics, updateFramePlacements"),
        Contender(ONE_FRAME, partial(_one_frame, kin, some), looped, "forwardKinematics, updateFramePlacement"),
    ]
    results = [_all_frames(kin, some), _one_frame(kin, some)]
    if ROBOTICS in peers:
        robot = peers[ROBOTICS]
        results.append(np.asarray(robot.eval(some)))
        contenders.append(Contender(ROBOTICS, partial(robot.eval, q), count, "ETS.eval(q)", peer=True))
    _check(kin.fk(some), results)
    timings = interleaved(
        contenders, options.rounds, lap=LAP, on_round=lambda done, of: progress("batch of postures", done, of)
    )
    what = f"{OURS} of {count}, times as fast as Pinocchio's quickest"
    text = TEXT.format(
        postures=f"{count:,}".replace(",", " "),
        positions=median_ratio(timings, POSITIONS, OURS),
        profiled=PROFILED,
    )
    return [
        Section(
            title="Many postures of the UR5",
            text=text + "\n\n" + calls(contenders),
            columns=COLUMNS,
            rows=batch_rows(contenders, timings, *PINOCCHIO),
            again=AGAIN,
            targets=times_as_fast(timings, OURS, PINOCCHIO, what=what, bound=BOUND),
            missing=missing | timings.failed,
            charts=[
                Chart(
                    "forward kinematics",
                    bars=medians(timings),
                    x="us per posture",
                    peers=[*PINOCCHIO, ROBOTICS],
                )
            ],
            samples=samples(timings),
        )
    ]


def _all_frames(kin: ArmKinematics, q: Floats) -> Floats:
    """Pinocchio's loop as its examples write it."""
    model, data, frame = kin.model, kin.data, kin.tip_frame
    T = np.empty((len(q), 4, 4))
    for row, posture in enumerate(q):
        pin.forwardKinematics(model, data, posture)
        pin.updateFramePlacements(model, data)
        T[row] = data.oMf[frame].homogeneous
    return T


def _one_frame(kin: ArmKinematics, q: Floats) -> Floats:
    """Pinocchio's loop with the one frame that is asked for."""
    model, data, frame = kin.model, kin.data, kin.tip_frame
    T = np.empty((len(q), 4, 4))
    for row, posture in enumerate(q):
        pin.forwardKinematics(model, data, posture)
        T[row] = pin.updateFramePlacement(model, data, frame).homogeneous
    return T


def _check(ours: Floats, others: list[Floats]) -> None:
    for other in others:
        if np.abs(ours - other).max() > AGREE:
            raise KinreachError(f"forward kinematics differs by {np.abs(ours - other).max():.2g}")
