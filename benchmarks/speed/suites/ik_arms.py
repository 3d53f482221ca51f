"""Inverse kinematics of one pose of arms that are no URs: six axes of every kind, and seven."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from benchmarks.ik_arms.arms import arm
from benchmarks.ik_arms.solvers import SSIK
from benchmarks.speed.measure import EachContender, interleaved_each
from benchmarks.speed.peers.analytic import eaik_of
from benchmarks.speed.peers.base import IKPeer, installed, silent
from benchmarks.speed.sections import Cell, Options, Progress, Section, Target
from benchmarks.speed.tables import median_ratio, samples, time_cells
from kinreach.kinematics import ArmKinematics

AGAIN = "python -m benchmarks.speed --suite ik-arms"
#: Arms that ssik ships, by what their axes are; and the most that one pose may take, as a multiple of EAIK's time or
#: where EAIK has no class for the arm in us.
ARMS = {
    "spherical wrist": ("puma560_ik", "irb6700_ik"),
    "three parallel axes": ("cr5_ik", "z1_ik"),
    "six axes, no closed form": ("xarm6_ik", "jaco2_ik"),
    "seven axes": ("franka_panda_ik", "iiwa7_ik", "xarm7_ik"),
}
#: Who takes part.
PEERS = {**dict.fromkeys(tuple(ARMS)[:2], ("EAIK", "ssik")), tuple(ARMS)[2]: ("ssik",)}
TIMES_EAIK, ANY_SIX, CURVES, NEAREST = 1.2, 80.0, 15e3, 20e3
OURS, NEAR = "kinreach", "kinreach, nearest"
COLUMNS = ("arm", "axes", "solver", "median [us]", "p95 [us]", "x kinreach", "of the rounds")
TEXT = """\
{poses} poses of each arm in random postures, {redundant} of one with seven axes. kinreach gives every posture
(`all_solutions`), with seven axes every curve of postures (`self_motions`). `nearest` gives the posture nearest to a
seed. EAIK has no class for arms without a closed form, and no solver but kinreach's lists curves."""
WHY = "the arms that are over it are in the table"


def run(options: Options, progress: Progress) -> list[Section]:
    """Measure (`benchmarks.speed.suites.Run`)."""
    counts = {6: 20 if options.quick else 200, 7: 2 if options.quick else 20}
    rows: list[list[Cell]] = []
    worst = {"closed": 0.0, "any": 0.0, "curves": 0.0, "nearest": 0.0}
    missing: dict[str, str] = {}
    everything: dict[str, Any] = {}
    for axes, names in ARMS.items():
        for name in names:
            judge = arm(name)
            kin: Any = ArmKinematics.of(judge.arm, tip=judge.tip)
            rng = np.random.default_rng(options.seed)
            low, high = np.maximum(kin.lower, -np.pi), np.minimum(kin.upper, np.pi)
            poses = list(kin.fk(rng.uniform(low, high, (counts[kin.n], kin.n))))
            every = kin.self_motions if kin.n > 6 else kin.all_solutions
            seed = np.clip(0.5 * (low + high), kin.lower, kin.upper)
            contenders = [
                EachContender(OURS, every, poses),
                EachContender(NEAR, lambda T, kin=kin, seed=seed: kin.nearest(T, seed), poses),
            ]
            makers = {"EAIK": partial(eaik_of, kin), "ssik": partial(_ssik, kin)}
            peers, left = installed({peer: makers[peer] for peer in PEERS.get(axes, ())})
            missing |= left
            for peer, made in peers.items():
                contenders.append(EachContender(peer, made.call, [made.prepare(T) for T in poses], peer=True))
            with silent():
                timings = interleaved_each(
                    contenders, options.rounds, on_round=lambda done, of, name=name: progress(name, done, of)
                )
            alone = {OURS: 1e6 * float(np.median(timings[OURS])), NEAR: 1e6 * float(np.median(timings[NEAR]))}
            if kin.n > 6:
                worst["curves"], worst["nearest"] = (
                    max(worst["curves"], alone[OURS]),
                    max(worst["nearest"], alone[NEAR]),
                )
            elif "EAIK" in timings:
                worst["closed"] = max(worst["closed"], median_ratio(timings, OURS, "EAIK"))
            else:
                worst["any"] = max(worst["any"], alone[OURS])
            rows += [[name.removesuffix("_ik"), axes, each, *time_cells(timings, each, OURS)] for each in timings]
            everything |= {f"{name}, {each}": values for each, values in samples(timings).items()}
    goals = (
        ("six axes with a closed form, one pose, all branches", "closed", TIMES_EAIK, "x EAIK"),
        ("any six axes, one pose, all branches", "any", ANY_SIX, "us"),
        ("seven axes, one pose, all curves", "curves", CURVES, "us"),
        ("seven axes, one pose, the nearest posture", "nearest", NEAREST, "us"),
    )
    targets = [Target(what, most, "at most", worst[key], unit, WHY) for what, key, most, unit in goals]
    return [
        Section(
            title="One pose of other arms",
            text=TEXT.format(poses=counts[6], redundant=counts[7]),
            columns=COLUMNS,
            rows=rows,
            again=AGAIN,
            targets=targets,
            missing=missing,
            samples=everything,
        )
    ]


def _ssik(kin: ArmKinematics) -> IKPeer:
    solver = SSIK(kin)
    return IKPeer("solve(T)", lambda T: T, solver.all, lambda q: q)
