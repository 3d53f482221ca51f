"""Random arms of every class against Pinocchio: is a posture lost or wrong, are one pose and many solved alike?

    python -m benchmarks.ik_arms.fuzz --arms 200 --seed 1

Six axes: a class one after the other, at either end, half of them 1e-9 to 1e-3 off it, with random limits. Poses are
random, and singular: wrist, elbow and shoulder, two and all three at once, exactly or a little beside. The posture that
made a pose has to be found, or one to which the arm can move while its tip stays. Every tenth arm has seven axes: the
posture has to be on a curve, and the tip stands still along it.
"""

from __future__ import annotations

import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.ik_arms.random_arms import (
    CLASSES,
    OTHERS,
    RIGHT,
    Judge,
    apart,
    kinematics,
    moves_to,
    random_motion,
    regular_arm,
    some_arm,
)
from benchmarks.ik_arms.self_motions import faultless, faults
from kinreach._checks import Floats, check_count
from kinreach._rotations import wrapped
from kinreach.cli import Parser, finish
from kinreach.kinematics._general_6r import Chain
from kinreach.kinematics._seven_axis.kinematics import SevenAxisKinematics
from kinreach.kinematics._six_axis.dh import DenavitHartenberg
from kinreach.kinematics._six_axis.kinematics import SixAxisKinematics

PROG = "python -m benchmarks.ik_arms.fuzz"
NAMES = [*CLASSES, *OTHERS]
#: The joint (0 is the first) whose angle makes an arm singular; the wrist counts from the arm without other ones.
SINGULAR = {"elbow": 2, "shoulder": 1, "wrist": 4}
CASES = (
    "wrist", "elbow", "shoulder", "wrist elbow", "wrist shoulder", "elbow shoulder", "wrist elbow shoulder",
    "right angles", "upright", "random",
)  # fmt: skip
#: How far singular poses are beside the singularity [rad].
BESIDE = (0.0, 0.0, 1e-12, 1e-9, 1e-7, 1e-5)
#: A pose is missed by more than this [m, rad]; postures are one if they differ by less [rad].
RIGHT_POSE, SAME = 1e-6, 1e-5
#: Angles at which a singular one is sought.
GRID = np.linspace(-np.pi, np.pi, 37) + 0.1


@dataclass
class Arm:
    """A random six-axis arm.

    Attributes:
        name: Its class.
        kin: kinreach's kinematics, a `SixAxisKinematics` unless it refuses the arm.
        judge: Pinocchio's.
        form: The arm of the class from the end at which it begins, and its parameters.
        backwards: Whether that is the tip.
    """

    name: str
    kin: Any
    judge: Judge
    form: tuple[Chain, DenavitHartenberg]
    backwards: bool


def six_axes(seed: int, index: int, folder: Path) -> tuple[Arm, np.random.Generator]:
    """An arm by its number, and the generator of its postures."""
    rng, name = np.random.default_rng([seed, index]), NAMES[index % len(NAMES)]
    backwards = bool(rng.integers(2))
    off = 0.0 if rng.random() < 0.5 else 10 ** rng.uniform(-9, -3)
    some = regular_arm if name in CLASSES and rng.random() < 0.6 else some_arm
    state = rng.bit_generator.state
    nominal = some(rng, name)
    rng.bit_generator.state = state
    chain = some(rng, name, backwards=backwards, off=off)
    form = Chain(nominal), DenavitHartenberg.of(nominal, length=1e-9, angle=1e-9)
    return Arm(name, kinematics(folder, chain), Judge(chain), form, backwards), rng


def postures(arm: Arm, rng: np.random.Generator, count: int) -> Iterator[tuple[str, Floats]]:
    """Some postures of each case, and what that is."""
    for case in CASES:
        for _ in range(count):
            beside, one = rng.choice(BESIDE), np.random.default_rng(rng.integers(2**31))
            q = _posture(case, *arm.form, beside, one)
            if q is not None:
                yield f"{case}, {beside:g} beside", wrapped(-q[::-1] if arm.backwards else q)


def _posture(case: str, chain: Chain, dh: DenavitHartenberg, beside: float, rng: np.random.Generator) -> Floats | None:
    q: Floats = rng.uniform(-np.pi, np.pi, 6)
    if case in ("right angles", "upright"):
        steps = rng.integers(-1, 3, 6) * RIGHT if case == "right angles" else rng.integers(0, 2, 6) * np.pi
        turned = (steps + beside * rng.normal(size=6) - dh.offset) * dh.sign
        return np.where((case == "upright") & (rng.random(6) < 0.15), q, turned)
    for word in (word for word in SINGULAR if word in case):
        joint, function = SINGULAR[word], _determinant(chain)
        other = rng.uniform(-np.pi, np.pi, 6) if word == "wrist" else q  # no other singularity hides it
        angle = _root(_on_axis_1(chain) if word == "shoulder" and "elbow" in case else function, other, joint, rng)
        if angle is None:
            return None
        q[joint] = angle
    for joint in (joint for word, joint in SINGULAR.items() if word in case):
        q[joint] += beside * rng.choice([-1, 1])
    return q


def _determinant(chain: Chain) -> Callable[[Floats], Floats]:
    return lambda q: np.asarray(np.linalg.det(chain.jacobian(q)[1]))


def _on_axis_1(chain: Chain) -> Callable[[Floats], Floats]:
    """How far the point of axis 6 next to axis 5 is from the plane of axis 1 and the direction of axis 2."""

    def distance(q: Floats) -> Floats:
        joints = [Chain(np.stack([*chain.placements[: joint + 1], np.eye(4)])) for joint in (1, 4, 5)]
        frames = [each.fk(q[:, : len(each.placements) - 1]) for each in joints]
        second, fifth, sixth = (frame[:, :, 2] for frame in frames)
        first, away = chain.placements[0], frames[1][:, :, 3] - frames[2][:, :, 3]
        cosine = (fifth * sixth).sum(axis=1)
        along = (away * sixth).sum(axis=1) - cosine * (away * fifth).sum(axis=1)
        point = frames[2][:, :, 3] + (along / np.maximum(1.0 - cosine * cosine, 1e-12))[:, None] * sixth
        return np.asarray((np.cross(first[:3, 2], point - first[:3, 3]) * second).sum(axis=1))

    return distance


def _root(function: Callable[[Floats], Floats], q: Floats, joint: int, rng: np.random.Generator) -> float | None:
    """An angle of a joint at which a function of the posture is 0, or None."""

    def at(angles: Floats) -> Floats:
        moved = np.repeat(q[None], len(angles), axis=0)
        moved[:, joint] = angles
        return function(moved)

    values = at(GRID)
    changes = np.flatnonzero(values[1:] * values[:-1] < 0)
    if len(changes):
        first = rng.choice(changes)
        low, high, sign = GRID[first], GRID[first + 1], np.sign(values[first])
        for _ in range(70):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if np.sign(at(np.array([middle]))[0]) == sign else (low, middle)
    else:  # it may touch 0
        low, high = GRID[np.abs(values).argmin()] + (-0.18, 0.18)
        for _ in range(90):
            a, b = low + (high - low) / 3, high - (high - low) / 3
            low, high = (low, b) if np.subtract(*np.abs(at(np.array([a, b])))) < 0 else (a, high)
    angle = float(0.5 * (low + high))
    return angle if len(changes) or abs(at(np.array([angle]))[0]) < 1e-12 else None


def faults_of(arm: Arm, q: Floats) -> list[str]:
    """What is wrong with the postures for the pose of one, the joint limits left out."""
    T, kin = arm.judge.fk(q), arm.kin
    found = kin.all_solutions(T, limits=False)
    wrong = [f"wrong by {off:.0e}" for one in found.q if (off := np.abs(arm.judge.fk(one) - T).max()) > RIGHT_POSE]
    if not len(found):
        return ["empty"]
    for several in (T[None], np.stack([T, arm.judge.fk(np.full(6, 0.5)), T])):
        batch = kin.batch(several, limits=False)
        if np.flatnonzero(batch.valid[-1]).tolist() != sorted(found.branch.tolist()):
            wrong.append("other branches in a batch")
        elif any(
            apart(one, same[None]) > RIGHT_POSE for one, same in zip(batch.q[-1][batch.valid[-1]], found.q, strict=True)
        ):
            wrong.append("other angles in a batch")
    if apart(q, found.q) > SAME:
        known = np.vstack([found.q, kin.all_solutions(T, limits=False, seed=q).q])  # the seed's, where a joint is free
        chain = Chain(kin._placements)
        if (
            apart(q, known) > SAME
            and not moves_to(chain, q, known, T)
            and not any(moves_to(chain, one, q[None], T) for one in known)
        ):
            wrong.append(f"the posture is lost, the nearest is {apart(q, found.q):.1e} rad away")
    return list(dict.fromkeys(wrong))


def faults_within(arm: Arm, rng: np.random.Generator, folder: Path) -> list[str]:
    """What is wrong with the postures for a random pose within random limits of up to a turn."""
    low, high = -rng.uniform(0.5, 2 * np.pi, 6), rng.uniform(0.5, 2 * np.pi, 6)
    kin: Any = kinematics(folder, arm.kin._placements, np.stack([low, high]))
    q = rng.uniform(low, high)
    T = arm.judge.fk(q)
    found, wrong = kin.all_solutions(T), []
    if not ((found.q >= low - 1e-9) & (found.q <= high + 1e-9)).all():
        wrong.append("outside the limits")
    if apart(q, found.q) > SAME:
        wrong.append("within the limits, but lost")
    nearest = kin.nearest(T, q)
    if not nearest.success or np.abs(nearest.q - q).max() > SAME:
        wrong.append("the nearest has another winding")
    return wrong


def seven_axes(seed: int, index: int, folder: Path) -> list[str]:
    """What is wrong with the curves of a random posture of a random arm."""
    rng = np.random.default_rng([seed, index, 7])
    kin = kinematics(folder, np.array([random_motion(rng, 0.4, np.pi) for _ in range(8)]))
    if not isinstance(kin, SevenAxisKinematics):
        return ["refused"]
    _, row = faults(kin, rng.uniform(-np.pi, np.pi, 7))
    return [] if faultless(row) else [f"lost {row['lost']}, open {row['open']}, off {row['missed']}, {row['motion']}"]


def main() -> int:
    """Try arm by arm; print what is wrong, and a table."""
    parser = Parser(prog=PROG, description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--arms", type=int, default=110, metavar="N", help="default: %(default)s")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of all arms (default: %(default)s)")
    parser.add_argument("--first", type=int, default=0, metavar="I", help="begin with this one (default: %(default)s)")
    parser.add_argument("--poses", type=int, default=1, metavar="N", help="of each case (default: %(default)s)")
    arguments = parser.parse_args()
    count, poses = check_count("--arms", arguments.arms), check_count("--poses", arguments.poses)
    seed, first = check_count("--seed", arguments.seed, least=0), check_count("--first", arguments.first, least=0)
    table: dict[tuple[str, str], list[float]] = {}

    def tried(index: int, name: str, way: str, case: str, find: Callable[[], list[str]]) -> None:
        start = time.process_time()
        wrong = find()
        tally = table.setdefault((name, way), [0, 0, 0.0])
        table[name, way] = [tally[0] + 1, tally[1] + bool(wrong), tally[2] + time.process_time() - start]
        for each in wrong:
            print(f"arm {index} ({name}, {way}), {case}: {each}", flush=True)

    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        for index in range(first, first + count):
            if index % 10 == 9:
                tried(index, "seven axes", "", "random", lambda: seven_axes(seed, index, folder))  # noqa: B023
                continue
            arm, rng = six_axes(seed, index, folder)
            if not isinstance(arm.kin, SixAxisKinematics):
                tried(index, arm.name, "refused", "", lambda: ["refused"])
                continue
            for case, q in postures(arm, rng, poses):
                tried(index, arm.name, arm.kin.solved, case, lambda: faults_of(arm, q))  # noqa: B023
            tried(index, arm.name, arm.kin.solved, "limits", lambda: faults_within(arm, rng, folder))  # noqa: B023
    rows = Table("arms", "solved", "poses", "with a fault", "ms a pose, the checks included")
    for (name, way), (number, bad, seconds) in sorted(table.items()):
        rows.add_row(name, way, str(number), str(bad), f"{1e3 * seconds / number:.0f}")
    Console().print(rows)
    return int(any(bad for _, bad, _ in table.values()))


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
