"""Forward kinematics of many postures of the UR5 at once."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from kinreach.bench.measure import LAP, Contender, interleaved
from kinreach.bench.peers import rtb
from kinreach.bench.peers.base import installed
from kinreach.bench.suite import Chart, Options, Progress, Section, Target
from kinreach.bench.times import batch_rows, calls, median_ratio, medians, samples
from kinreach.engines import load
from kinreach.errors import KinreachError
from kinreach.kinematics import ArmKinematics
from kinreach.kinematics.goals import Floats

AGAIN = "python -m kinreach.bench --suite fk-batch"
OURS, POSITIONS = "kinreach, fk", "kinreach, positions"
REFERENCE, ONE_FRAME, ROBOTICS = "Pinocchio, all frames", "Pinocchio, one frame", "roboticstoolbox"
pin: Any = load("pinocchio")

#: How far results may be apart [m, and entries of rotations].
AGREE = 1e-10
#: How many times as fast as a Python loop over Pinocchio the batch has to be.
BOUND = 5.0
COLUMNS = ("batch", "median [us per posture]", "p95", "x Pinocchio", "of the rounds", "cores")

TEXT = """\
{postures} postures within +-pi; the pose of tool0 as a matrix (4, 4), all of them in one array at the end. Pinocchio is
called for each posture in a Python loop: as its examples do (all frames), and the quickest way (one frame). Their
results agree to 1e-10 before anything is timed.

kinreach's formula is brought to as few numpy calls as possible, on blocks of 4096 postures that stay in the cache. By
a profile, 85 % of its time is arithmetic within the blocks; `positions`, which leaves the rotation out, takes less than
half. Of Pinocchio's loop over all frames, a quarter is `forwardKinematics`, a fifth is the placement of 26 frames,
and the rest is turning one of them into a matrix on the Python side."""


def run(options: Options, progress: Progress) -> list[Section]:
    """Measure; see `kinreach.bench.suite.Suite`."""
    count, looped = (4096, 500) if options.quick else (100_000, 10_000)
    q = np.random.default_rng(options.seed).uniform(-np.pi, np.pi, (count, 6))
    kin = ArmKinematics("ur5", tip="tool0", base="world")
    peers, missing = installed({ROBOTICS: lambda: rtb.sequence(kin)})
    contenders = [
        Contender(OURS, partial(kin.fk, q), count, "fk(q)"),
        Contender(POSITIONS, partial(kin.positions, q), count, "positions(q)"),
        Contender(REFERENCE, partial(_all_frames, kin, q[:looped]), looped, "forwardKinematics, updateFramePlacements"),
        Contender(ONE_FRAME, partial(_one_frame, kin, q[:looped]), looped, "forwardKinematics, updateFramePlacement"),
    ]
    results = [_all_frames(kin, q[:looped]), _one_frame(kin, q[:looped])]
    if ROBOTICS in peers:
        robot = peers[ROBOTICS]
        results.append(np.asarray(robot.eval(q[:looped])))
        contenders.append(Contender(ROBOTICS, partial(robot.eval, q), count, "ETS.eval(q)", peer=True))
    _check(kin.fk(q[:looped]), results)
    timings = interleaved(
        contenders, options.rounds, lap=LAP, on_round=lambda done, of: progress("batch of postures", done, of)
    )
    targets = [
        Target(f"{OURS} of {count}, times as fast", BOUND, "at least", median_ratio(timings, name, OURS), f"x {name}")
        for name in (REFERENCE, ONE_FRAME)
    ]
    return [
        Section(
            title="Many postures of the UR5",
            text=TEXT.format(postures=f"{count:,}".replace(",", " ")) + "\n\n" + calls(contenders),
            columns=COLUMNS,
            rows=batch_rows(contenders, timings, REFERENCE),
            again=AGAIN,
            targets=targets,
            missing=missing | timings.failed,
            charts=[
                Chart(
                    "forward kinematics",
                    bars=medians(timings),
                    x="us per posture",
                    peers=[REFERENCE, ONE_FRAME, ROBOTICS],
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
