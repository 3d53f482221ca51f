"""Calibrated UR arms: every posture beside ssik's, times, and singular poses; two Markdown tables.

    python -m benchmarks.studies.calibrated_arms                  # minutes: ssik's branches are read from a file
    python -m benchmarks.studies.calibrated_arms --oracle FILE    # ssik prepares each robot anew: 2 to 12 minutes each

The robots are those of `kinreach.robots.PUBLISHED_CALIBRATIONS`: figures of real arms from public repositories.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from time import process_time

import numpy as np

from benchmarks.speed.peers.analytic import eaik_of, general_ssik_of
from benchmarks.studies.tables import head, line
from kinreach._checks import Floats
from kinreach._rotations import pose_error
from kinreach.cli import Parser, finish
from kinreach.errors import InputError
from kinreach.kinematics import URKinematics
from kinreach.kinematics._ur.kinematics import CalibratedURKinematics
from kinreach.robots import PUBLISHED_CALIBRATIONS

PROG = "python -m benchmarks.studies.calibrated_arms"
DATA = Path(__file__).resolve().parents[2] / "tests" / "data"
ORACLE = DATA / "calibrated_branches.npz"
ROBOTS = tuple(PUBLISHED_CALIBRATIONS)
#: Two postures are the same if no joint differs by more [rad]: the stored ones are in single precision.
SAME = 1e-3
VALID = 1e-9
#: Of the first table; times are those of the processor.
COLUMNS = (
    "robot", "of ssik's branches", "generating posture", "postures a pose", "largest error [m, rad]",
    "preparation [s]", "one pose [ms]", "a pose of a batch [us]", "ssik: preparation [s]", "ssik: one pose [ms]",
)  # fmt: skip


def arm_of(robot: str) -> CalibratedURKinematics:
    """Kinematics of one of the robots, from the driver's file."""
    kin = URKinematics.from_calibration(PUBLISHED_CALIBRATIONS[robot], model=robot.split("_")[0])
    assert isinstance(kin, CalibratedURKinematics)
    return kin


def oracle_postures(kin: URKinematics, rng: np.random.Generator, few: int = 6) -> dict[str, Floats]:
    """Postures (m, 6) by case: random, and next to the data sheet's singularities."""

    def some(count: int, **joints: object) -> Floats:
        q = rng.uniform(-np.pi, np.pi, (count, 6))
        for name, value in joints.items():
            q[:, int(name[1:]) - 1] = value
        return q

    g = kin.geometry
    shoulder = some(50 * few)
    ratio = -(g.a2 * np.cos(shoulder[:, 1]) + g.a3 * np.cos(shoulder[:, 1] + shoulder[:, 2])) / g.d5
    shoulder, ratio = shoulder[np.abs(ratio) < 1][:few], ratio[np.abs(ratio) < 1][:few]
    shoulder[:, 3] = np.arcsin(ratio) - shoulder[:, 1] - shoulder[:, 2]
    straight = rng.choice((0.0, np.pi), few)
    return {
        "random": some(40),
        "elbow": some(few, q3=rng.uniform(-0.05, 0.05, few)),
        "elbow0": some(few, q3=0.0),
        "wrist0": some(few, q5=straight),
        "wrist": some(few, q5=straight + rng.uniform(-0.02, 0.02, few)),
        "upright": some(few, q2=-np.pi / 2, q3=0.0, q4=-np.pi / 2, q5=0.0),
        "zero": some(few, q2=0.0, q3=0.0, q4=0.0, q5=0.0),
        "shoulder": shoulder,
    }


def ask_ssik(robot: str) -> dict[str, Floats]:
    """What ssik's general_6r finds: postures asked for, counts and branches of each case, and its seconds."""
    kin = arm_of(robot)
    start = process_time()
    arm = general_ssik_of(kin)
    preparation, times, result = process_time() - start, [], {}
    for case, postures in oracle_postures(kin, np.random.default_rng(11)).items():
        counts, branches = [], [np.empty((0, 6))]
        for T in kin.fk(postures):
            start = process_time()
            q = arm.solve(T)
            times.append(process_time() - start)
            q = q[[max(pose_error(T, kin.fk(each))) < VALID for each in q]]  # some near upright are no solutions
            counts.append(len(q))
            branches.append(q)
        result[f"{robot} {case} postures"], result[f"{robot} {case} counts"] = postures, np.array(counts)
        result[f"{robot} {case} branches"] = np.vstack(branches).astype(np.float32)
    result[f"{robot} seconds"] = np.array([preparation, np.median(times)])
    return result


def recall(robot: str, kin: CalibratedURKinematics, oracle: Mapping[str, Floats]) -> tuple[int, int]:
    """How many of ssik's branches are among ours, and how many there are."""
    found = asked = 0
    for name in oracle:
        if name.startswith(f"{robot} ") and name.endswith(" postures"):
            case = name.removesuffix(" postures")
            batch = kin.batch(kin.fk(oracle[name]), limits=False)
            ends = np.cumsum(oracle[f"{case} counts"])[:-1]
            theirs = np.split(oracle[f"{case} branches"], ends)
            for q, valid, branches in zip(batch.q, batch.valid, theirs, strict=True):
                found += sum(_distance(branch, q[valid]) < SAME for branch in branches)
                asked += len(branches)
    return found, asked


def singular_postures(kin: CalibratedURKinematics, case: str, rng: np.random.Generator, count: int) -> Floats:
    """Postures (count, 6) at which the calibrated arm itself is singular: det J = 0, by bisection along one joint.

    Args:
        kin: The arm.
        case: "elbow", "wrist", "shoulder" or "wrist and shoulder": which of the data sheet's singularities is near.
        rng: Source of the other joints.
        count: How many.
    """
    joint = {"elbow": 2, "wrist": 4, "shoulder": 3, "wrist and shoulder": 4}[case]
    g, chain = kin.geometry, kin._calibrated.chain
    q = rng.uniform(-np.pi, np.pi, (40 * count, 6))
    if "shoulder" in case:
        ratio = -(g.a2 * np.cos(q[:, 1]) + g.a3 * np.cos(q[:, 1] + q[:, 2])) / g.d5
        q, ratio = q[np.abs(ratio) < 0.9], ratio[np.abs(ratio) < 0.9]
        q[:, 3] = np.arcsin(ratio) - q[:, 1] - q[:, 2]
    if case == "elbow":
        q[:, 2] = 0.0
    if "wrist" in case:
        q[:, 4] = rng.choice((0.0, np.pi), len(q))

    def determinant(angle: Floats) -> Floats:
        moved = q.copy()
        moved[:, joint] += angle
        return np.asarray(np.linalg.det(chain.jacobian(moved)[1]), dtype=np.float64)

    low, high = np.full(len(q), -0.1), np.full(len(q), 0.1)
    bracketed = determinant(low) * determinant(high) < 0
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = determinant(low) * determinant(middle) <= 0
        low, high = np.where(below, low, middle), np.where(below, middle, high)
    q[:, joint] += low
    q = q[bracketed][:count]
    assert len(q) == count
    return q


def _beyond(kin: CalibratedURKinematics, q: Floats, distance: float) -> Floats:
    """Poses (m, 4, 4) of singular postures, moved in the direction in which the arm cannot move."""
    T = kin.fk(q)
    for pose, posture in zip(T, q, strict=True):
        along = np.linalg.svd(kin.jacobian(posture))[0][:, -1]
        pose[:3, 3] += distance * along[:3]
        pose[:3, :3] = (np.eye(3) + distance * np.cross(np.eye(3), -along[3:])) @ pose[:3, :3]
    return T


def _down(kin: CalibratedURKinematics, rng: np.random.Generator, count: int) -> Floats:
    """Poses (count, 4, 4) with the tool straight down, the first axis and the last parallel."""
    T = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (count, 1, 1))
    turn, reach = rng.uniform(-np.pi, np.pi, count), -kin.geometry.a2 - kin.geometry.a3
    radius = rng.uniform(0.45, 0.75, count) * reach
    T[:, 0, 3], T[:, 1, 3], T[:, 2, 3] = radius * np.cos(turn), radius * np.sin(turn), rng.uniform(-0.2, 0.2, count)
    return T


Cases = dict[str, Callable[[CalibratedURKinematics, np.random.Generator, int], Floats]]


def _at(case: str, distance: float = 0.0) -> Callable[[CalibratedURKinematics, np.random.Generator, int], Floats]:
    return lambda kin, rng, count: _beyond(kin, singular_postures(kin, case, rng, count), distance)


def _of(case: str) -> Callable[[CalibratedURKinematics, np.random.Generator, int], Floats]:
    return lambda kin, rng, count: kin.fk(oracle_postures(kin, rng, count)[case][:count])


#: What is asked for: poses of the data sheet's singular postures, and of the arm's own.
CASES: Cases = {
    "random, rounded to float32": lambda kin, rng, count: (
        kin.fk(rng.uniform(-np.pi, np.pi, (count, 6))).astype(np.float32).astype(np.float64)
    ),
    "tool straight down": _down,
    "sin q5 = 0": _of("wrist0"),
    "q3 = 0": _of("elbow0"),
    "upright": _of("upright"),
    "zero": _of("zero"),
    "own wrist": _at("wrist"),
    "own elbow": _at("elbow"),
    "own shoulder": _at("shoulder"),
    "own elbow + 1e-9": _at("elbow", 1e-9),
    "own elbow - 1e-9": _at("elbow", -1e-9),
}


def _distance(q: Floats, others: Floats) -> float:
    away = others - q
    away -= 2 * np.pi * np.rint(away / (2 * np.pi))
    return float(np.abs(away).max(axis=1).min(initial=np.inf))


def _robot_row(robot: str, oracle: Mapping[str, Floats], poses: int, seed: int) -> str:
    start = process_time()
    kin = arm_of(robot)
    kin.batch(np.eye(4)[None])
    preparation = process_time() - start
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (poses, 6))
    T = kin.fk(q)
    start = process_time()
    batch = kin.batch(T, limits=False)
    each = (process_time() - start) / poses
    kept, worst = 0, 0.0
    for posture, pose, row, valid in zip(q, T, batch.q, batch.valid, strict=True):
        kept += _distance(posture, row[valid]) < SAME
        worst = max(worst, *(max(pose_error(pose, kin.fk(found))) for found in row[valid][:2]))
    times = []
    for pose in T[:1000]:
        start = process_time()
        kin.all_solutions(pose)
        times.append(process_time() - start)
    found, asked = recall(robot, kin, oracle)
    theirs = oracle[f"{robot} seconds"]
    cells = (
        robot,
        f"{100 * found / asked:.2f} % of {asked}",
        f"{100 * kept / poses:.2f} %",
        f"{batch.valid.sum() / poses:.2f}",
        f"{worst:.0e}",
        f"{preparation:.2f}",
        f"{1e3 * np.median(times):.2f}",
        f"{1e6 * each:.0f}",
        f"{theirs[0]:.0f}",
        f"{1e3 * theirs[1]:.1f}",
    )
    return line(*cells)


def _eaik_says() -> str:
    """Return EAIK's class of a calibrated arm, or its error."""
    try:
        eaik_of(arm_of(ROBOTS[0]))
    except ImportError:
        return "EAIK is not installed"
    except InputError as error:
        return f"EAIK: {error}"
    return f"EAIK takes {ROBOTS[0]}"


def main(argv: list[str] | None = None) -> int:
    """Print the tables, or write ssik's branches."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=10_000, help="of each robot, random")
    parser.add_argument("--singular", type=int, default=50, help="poses of each robot in each singular case")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--robots", default=",".join(ROBOTS), help="some of them")
    parser.add_argument("--oracle", metavar="FILE", help="ask ssik, and write what it finds")
    arguments = parser.parse_args(argv)
    robots = arguments.robots.split(",")
    if arguments.oracle:
        np.savez_compressed(arguments.oracle, **{k: v for robot in robots for k, v in ask_ssik(robot).items()})
        return 0
    with np.load(ORACLE) as stored:
        oracle = {name: stored[name] for name in stored}
    print(head(*COLUMNS))
    for robot in robots:
        print(_robot_row(robot, oracle, arguments.poses, arguments.seed), flush=True)
    print(f"\n{_eaik_says()}\n\n{head('case', *robots, 'largest error')}")
    arms = {robot: arm_of(robot) for robot in robots}
    for case, make in CASES.items():
        cells, worst = [], 0.0
        for kin in arms.values():
            T = make(kin, np.random.default_rng(arguments.seed), arguments.singular)
            batch = kin.batch(T, limits=False)
            errors = [max(pose_error(T[i], kin.fk(batch.q[i, j]))) for i, j in np.argwhere(batch.valid)]
            empty = 100 * (~batch.valid.any(axis=1)).mean()
            cells.append(f"{empty:g} / {100 * np.mean(np.array(errors) > 1e-7):g}")
            worst = max(worst, *errors)
        print(line(case, *cells, f"{worst:.0e}"), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
