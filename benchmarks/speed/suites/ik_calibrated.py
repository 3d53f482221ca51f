"""Inverse kinematics of a UR with its factory calibration: all branches of one pose, and of many."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from time import perf_counter

import numpy as np

from benchmarks.speed.measure import LAP, Contender, EachContender, Timings, interleaved, interleaved_each
from benchmarks.speed.peers.analytic import eaik_of, general_ssik_of
from benchmarks.speed.peers.base import IKPeer, installed
from benchmarks.speed.sections import Cell, Chart, Options, Progress, Section, Target
from benchmarks.speed.tables import calls, medians, samples, time_cells
from benchmarks.studies.calibrated_arms import arm_of
from kinreach._checks import Floats
from kinreach.errors import InputError
from kinreach.kinematics import URKinematics
from kinreach.kinematics._ur.kinematics import CalibratedURKinematics

AGAIN = "python -m benchmarks.speed --suite ik-calibrated"
#: The robot for which ssik takes the least time to prepare.
ROBOT, MODEL = "ur10e_a", "ur10e"
OURS, NOMINAL, SSIK = "kinreach, calibrated", "kinreach, data sheet", "ssik, general_6r"
#: Most that a pose may take, alone and in a batch [us], and the preparation [s].
ALONE, IN_BATCH, PREPARATION = 40.0, 20.0, 1.0
COLUMNS = ("all branches", "solutions", "median [us]", "p95 [us]", "x ssik", "of the rounds")
BATCH_COLUMNS = ("time of a pose [us]", "median", "worst round", "x ssik", "of the rounds")
WHY = (
    "a wall time, and the machine was busy; run with priority, `--suite ik-calibrated --quick` says 26 us a pose of "
    "a batch of 1000. What it takes of the processor is in "
    "[Accuracy](accuracy.md#eight-real-arms)"
)

TEXT = """\
{poses} poses of tool0 in random postures of a real UR10e (`kinreach.robots.PUBLISHED_CALIBRATIONS`: {robot}), whose
axes neither meet nor are parallel. kinreach fits the nearest arm with a closed form when it is made
({preparation:.2g} s). It finds each branch by Newton's method, or all by elimination where branches may merge
([how](accuracy.md#calibrated-urs)). ssik prepares a solver for one arm first, which takes minutes if its cache does
not have the arm{prepared}. EAIK has no class for such an arm, and ur-analytic-ik takes no calibration.
For comparison the closed form of the data sheet on the same
poses, which misses them by millimetres."""
BATCH_TEXT = """\
{poses} poses of the same arm at once. ssik is called in a loop over the first {looped}. Calls are repeated until a turn
has lasted a quarter of a second."""


def run(options: Options, progress: Progress) -> list[Section]:
    """Measure (`benchmarks.speed.suites.Run`)."""
    start = perf_counter()
    kin = arm_of(ROBOT)
    kin.all_solutions(np.eye(4))
    preparation = perf_counter() - start
    nominal = URKinematics(MODEL)
    start = perf_counter()
    peers, missing = installed({"EAIK": partial(eaik_of, kin), SSIK: _ssik(kin, options)})
    prepared = f"; here it took {perf_counter() - start:.0f} s" if SSIK in peers else ""
    return [
        _one(options, progress, kin, nominal, peers, missing, preparation, prepared),
        _many(options, progress, kin, nominal, peers),
    ]


def _ssik(kin: CalibratedURKinematics, options: Options) -> Callable[[], IKPeer]:
    def make() -> IKPeer:
        if options.quick:
            raise InputError("its preparation takes minutes; not with --quick")
        return general_ssik_of(kin)

    return make


def _one(
    options: Options,
    progress: Progress,
    kin: CalibratedURKinematics,
    nominal: URKinematics,
    peers: dict[str, IKPeer],
    missing: dict[str, str],
    preparation: float,
    prepared: str,
) -> Section:
    poses = list(_poses(kin, 50 if options.quick else 300, options.seed))
    contenders = [
        EachContender(OURS, kin.all_solutions, poses, "all_solutions(T)"),
        EachContender(NOMINAL, nominal.all_solutions, poses, "all_solutions(T)"),
    ]
    solutions = {
        OURS: np.mean([len(kin.all_solutions(pose)) for pose in poses]),
        NOMINAL: np.mean([len(nominal.all_solutions(pose)) for pose in poses]),
    }
    for name, peer in peers.items():
        contenders.append(EachContender(name, peer.call, [peer.prepare(pose) for pose in poses], peer.note, peer=True))
        solutions[name] = np.mean([len(peer.solve(pose)) for pose in poses])
    timings = interleaved_each(
        contenders, options.rounds, on_round=lambda done, of: progress("calibrated, one pose", done, of)
    )
    text = TEXT.format(poses=len(poses), robot=ROBOT, preparation=preparation, prepared=prepared)
    rows: list[list[Cell]] = [
        [name, round(float(solutions[name]), 2), *time_cells(timings, name, SSIK)] for name in timings
    ]
    alone = 1e6 * float(np.median(timings[OURS]))
    return Section(
        title="One pose of a calibrated UR10e, all branches",
        text=text + "\n\n" + calls(contenders),
        columns=COLUMNS,
        rows=rows,
        again=AGAIN,
        targets=[
            Target("a calibrated UR, one pose, all branches", ALONE, "at most", alone, "us", WHY),
            Target("a calibrated UR, made ready", PREPARATION, "at most", preparation, "s", WHY),
        ],
        missing=missing | timings.failed,
        charts=[_chart("calibrated UR, one pose, all branches", timings, list(peers), "us")],
        samples=samples(timings),
    )


def _many(
    options: Options, progress: Progress, kin: CalibratedURKinematics, nominal: URKinematics, peers: dict[str, IKPeer]
) -> Section:
    count, looped = (1000, 10) if options.quick else (10_000, 50)
    T = _poses(kin, count, options.seed)
    contenders = [
        Contender(OURS, partial(kin.batch, T), count, "batch(T)"),
        Contender(NOMINAL, partial(nominal.batch, T), count, "batch(T)"),
    ]
    for name, peer in peers.items():
        given = [peer.prepare(pose) for pose in T[:looped]]
        loop = partial(_each, peer, given)
        contenders.append(Contender(name, loop, looped, f"{peer.note}, in a loop", peer=True))
    timings = interleaved(
        contenders, options.rounds, lap=LAP, on_round=lambda done, of: progress("calibrated, batch", done, of)
    )
    each = 1e6 * float(np.median(timings[OURS]))
    return Section(
        title="Many poses of a calibrated UR10e",
        text=BATCH_TEXT.format(poses=f"{count:,}".replace(",", " "), looped=looped) + "\n\n" + calls(contenders),
        columns=BATCH_COLUMNS,
        rows=[[name, *time_cells(timings, name, SSIK)] for name in timings],
        again=AGAIN,
        targets=[Target(f"a calibrated UR, a pose of a batch of {count}", IN_BATCH, "at most", each, "us", WHY)],
        missing=dict(timings.failed),
        charts=[_chart("calibrated UR, many poses", timings, list(peers), "us per pose")],
        samples=samples(timings),
    )


def _poses(kin: CalibratedURKinematics, count: int, seed: int) -> Floats:
    return kin.fk(np.random.default_rng(seed).uniform(-np.pi, np.pi, (count, kin.n)))


def _each(peer: IKPeer, given: list[object]) -> None:
    for pose in given:
        peer.call(pose)


def _chart(title: str, timings: Timings, peers: list[str], unit: str) -> Chart:
    return Chart(title, bars=medians(timings), x=unit, peers=peers)
