"""One solver on one arm, judged by Pinocchio; and the answers of all solvers beside each other."""

from __future__ import annotations

import gc
import resource
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.ik_arms.arms import SEVEN, class_of, postures, singular_poses
from benchmarks.ik_arms.child import forked
from benchmarks.ik_arms.solvers import SSIK, Kinreach, Solver
from benchmarks.studies.calibrated_arms import ORACLE, ROBOTS
from kinreach._checks import Floats
from kinreach._rotations import pose_error
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics

#: A posture is right if its tip is no farther from the pose [m, rad].
RIGHT = 1e-6
#: Two postures are one if no joint differs by more [rad]: of lists, and of samples along curves.
SAME, ON_CURVE = 1e-3, 0.1
#: Share of the poses of an arm with seven axes that are asked for: each has hundreds of postures.
SEVENTH = 6


@dataclass(frozen=True)
class Effort:
    """How much is measured.

    Attributes:
        poses: Random poses of each arm.
        singular: Poses of each singular case.
        blocks: Blocks of which times are medians.
        batch: Poses of a batch.
        limit: Processor time of one solver on one arm [s].
    """

    poses: int = 60
    singular: int = 8
    blocks: int = 5
    batch: int = 10_000
    limit: int = 10


def asked(name: str, kin: ArmKinematics, effort: Effort) -> Floats:
    """The random postures (m, n) whose poses are asked for."""
    return postures(name, kin, -(-effort.poses // SEVENTH) if class_of(kin) == SEVEN else effort.poses)


def measure(name: str, kin: ArmKinematics, kind: type[Solver], effort: Effort) -> dict[str, Any]:
    """Results of a solver on an arm; with `refused` if there are none."""
    if kind is SSIK and name in ROBOTS:
        return _stored(name, effort)
    try:
        return dict(forked(_row, name, kin, kind, effort, limit=effort.limit))
    except InputError as error:
        return {"refused": str(error).replace(f"of {kin.arm.name} ", "")}


def _row(name: str, kin: ArmKinematics, kind: type[Solver], effort: Effort) -> dict[str, Any]:
    start = time.process_time()
    solver = kind(kin)
    preparation = time.process_time() - start
    seven = class_of(kin) == SEVEN
    T = kin.fk(asked(name, kin, effort))
    right, wrong = zip(*(_answer(kin, solver, pose) for pose in T), strict=True)
    row: dict[str, Any] = {"preparation": preparation, "found": [q.round(6).tolist() for q in right]}
    row |= {"wrong": sum(wrong), "returned": sum(wrong) + sum(map(len, right)), "singular": {}}
    for case, poses in ({} if seven else singular_poses(kin, effort.singular)).items():
        answers = [_answer(kin, solver, pose) for pose in poses]
        empty = sum(len(q) == 0 for q, _ in answers)
        row["singular"][case] = [len(poses), empty, sum(count for _, count in answers)]
    row["megabytes"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    signal.setitimer(signal.ITIMER_PROF, 0.0)  # under this timer the kernel's clock moves by ticks
    start = time.process_time()
    while time.process_time() - start < 0.03:
        pass
    own: Kinreach | None = solver if isinstance(solver, Kinreach) else _or_none(kin)
    row["single"], row["ratio"] = _times(solver.all, own.all if own else None, T, effort, batch=False)
    if many := getattr(solver, "batch", None):
        row["batch"], row["batch_ratio"] = _times(many, getattr(own, "batch", None), T, effort, batch=True)
    return row


def _or_none(kin: ArmKinematics) -> Kinreach | None:
    try:
        return Kinreach(kin)
    except Exception:
        return None


def _answer(kin: ArmKinematics, solver: Solver, T: Floats) -> tuple[Floats, int]:
    """The right postures of a pose, and the number of wrong ones; a solver that raises has none."""
    try:
        q = np.asarray(solver.all(T), dtype=np.float64).reshape(-1, kin.n)
    except Exception:
        return np.empty((0, kin.n)), 0
    good = [bool(np.isfinite(each).all() and max(pose_error(T, kin.fk(each))) <= RIGHT) for each in q]
    return q[good], len(q) - sum(good)


def _times(
    call: Callable[[Floats], object], own: Callable[[Floats], object] | None, T: Floats, effort: Effort, *, batch: bool
) -> tuple[float, float | None]:
    """Processor seconds a pose, and as a multiple of kinreach's: medians over blocks that take turns with its own."""
    start = time.process_time()
    with suppress(Exception):
        call(T if batch else T[0])
    first = max((time.process_time() - start) / (len(T) if batch else 1), 1e-6)
    count = min(effort.batch, max(int(0.3 / first), 1)) if batch else min(len(T), max(int(0.03 / first), 1))
    given = [np.resize(T, (count, 4, 4))] if batch else list(T[:count])

    def block(function: Callable[[Floats], object]) -> float:
        start = time.process_time()
        for each in given:
            with suppress(Exception):
                function(each)
        return (time.process_time() - start) / count

    gc.collect()
    gc.disable()
    others = [] if own is None or own == call else [own]
    blocks = np.array([[block(each) for each in (call, *others)] for _ in range(effort.blocks + 1)])[1:]
    gc.enable()
    ratio = float(np.median(blocks[:, 0] / blocks[:, 1])) if others else None
    return float(np.median(blocks[:, 0])), 1.0 if own == call else ratio


def _stored(name: str, effort: Effort) -> dict[str, Any]:
    """What `benchmarks.studies.calibrated_arms --oracle` kept of ssik's general_6r."""
    with np.load(ORACLE) as stored:
        counts, seconds = stored[f"{name} random counts"], stored[f"{name} seconds"]
        found = np.split(stored[f"{name} random branches"].astype(np.float64), np.cumsum(counts)[:-1])[: effort.poses]
    row = {"preparation": seconds[0], "single": seconds[1], "found": [q.round(6).tolist() for q in found]}
    return {**row, "wrong": 0, "returned": sum(map(len, found)), "singular": {}, "ratio": None, "megabytes": None}


def recalls(rows: dict[str, dict[str, Any]], generating: Floats) -> tuple[dict[str, list[float]], float]:
    """Compare the answers of all solvers on one arm.

    Args:
        rows: Solver -> what `measure` returned.
        generating: The postures whose poses were asked for, shape (m, n).

    Returns:
        Solver -> shares of the union of all postures, of the generating postures, and of poses with an answer; and the
        number of postures of the union a pose.
    """
    tolerance = ON_CURVE if generating.shape[1] == 7 else SAME
    answering = {name: row["found"] for name, row in rows.items() if "found" in row}
    tally = {name: np.zeros(3) for name in answering}
    total = 0
    for index, q in enumerate(generating):
        answers = {name: np.array(found[index]).reshape(-1, len(q)) for name, found in answering.items()}
        union = q[None]
        for found in answers.values():
            for each in found:
                if not _among(each, union, tolerance):
                    union = np.vstack([union, each])
        total += len(union)
        for name, found in answers.items():
            kept = sum(_among(each, found, tolerance) for each in union)
            tally[name] += (kept, _among(q, found, tolerance), len(found) > 0)
    each_of = np.array([total, len(generating), len(generating)])
    return {name: list(100 * counts / each_of) for name, counts in tally.items()}, total / len(generating)


def _among(q: Floats, others: Floats, tolerance: float) -> bool:
    away = others - q
    away -= 2 * np.pi * np.rint(away / (2 * np.pi))
    return bool((np.abs(away).max(axis=1) < tolerance).any())
