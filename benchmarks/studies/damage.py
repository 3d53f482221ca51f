"""A damaged UR5: inverse kinematics that knows the fault, that finds it out by looks, and a policy that learns again.

    python -m benchmarks.studies.damage                  # the table
    python -m benchmarks.studies.damage --engine ray     # each fault a task
    python -m benchmarks.studies.damage | python -m benchmarks.studies.tables damage

A joint that is stuck, one that is 2 degrees off, or a link that is bent by 3 degrees and 5 mm; the ball on the table,
the tool straight down. Kinematics only. Reached: within 10 mm, the tool within 0.15 rad, as `kinreach/Reach-v0` has it.
Intervals are over faults: the percentile bootstrap draws faults, not balls, and where all faults agree there is none.
Finished faults are kept in `--out`.
"""

from __future__ import annotations

import argparse
import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.parts import each, kept
from benchmarks.studies.tables import head, line
from kinreach._checks import Floats, check_count
from kinreach._files import make_writable
from kinreach._jobs import add_options
from kinreach._rotations import placement, rpy
from kinreach._statistics import bootstrap_intervals, mean
from kinreach.baselines._policies import LearnedPolicy, load_policy
from kinreach.baselines.expert import tool_down_postures
from kinreach.baselines.random_arms import on_table, ur5
from kinreach.cli import Parser, finish
from kinreach.compare._methods.learned import Trained, Tuned
from kinreach.compare._real_arm import LEARNED_POLICY
from kinreach.envs._reach.reach_task import TOOL_DOWN
from kinreach.envs.real_arm import MEDIAN_LENGTH, NOISE
from kinreach.kinematics import ArmKinematics
from kinreach.kinematics._chain import SerialChain
from kinreach.robots import ArmDescription, get_arm
from kinreach.robots._identification import IdentifiedArm, Prior
from kinreach.robots._urdf import parse_urdf, set_origin
from kinreach.thesis import REACHED_DISTANCE, REACHED_POSTURE_ERROR

PROG = "python -m benchmarks.studies.damage"
STUCK, OFFSET, BENT = "a joint stuck", "a joint 2° off", "a link bent by 3° and 5 mm"
KINDS = (STUCK, OFFSET, BENT)
LOOKS = (5, 10, 20, 50)
#: How far a frame of a damaged arm may be from the data sheet [m, rad].
PRIOR = Prior(base=(5e-3, 0.05), links=(5e-3, 0.05), tool=(1e-3, 0.0))
SIGMA = NOISE / MEDIAN_LENGTH
#: Of the numeric inverse kinematics: first weight of the tool's direction beside a distance [m/rad], random starts, and
#: the steps between two changes of the weight.
LEVER, STARTS, ROUNDS = 0.1, 20, (60, *(10,) * 8)
#: Share of what counts as reached that needs no further steps.
SOLVED = 1e-4
#: Seed of the first fault. Constants were chosen on faults of smaller seeds.
FIRST = 1000
#: Of a fault, by method: balls reached, median distance [mm].
Tried = Mapping[str, tuple[int, float]]
#: Angles that a stuck joint is looked for at.
ANGLES = np.linspace(-math.pi, math.pi, 721)


@dataclass(frozen=True)
class Damage:
    """A damaged arm.

    Attributes:
        arm: Its description.
        chain: What it really is, from the world to the tip.
        stuck: Index of the joint that does not move, or None.
        at: The angle it is stuck at [rad].
    """

    arm: ArmDescription
    chain: SerialChain
    stuck: int | None = None
    at: float = 0.0

    def executed(self, q: Floats) -> Floats:
        """The postures (m, 6) that are taken where these are commanded."""
        return held(q, self.stuck, self.at)


def held(q: Floats, joint: int | None, angle: float) -> Floats:
    """Postures (m, 6) with one joint at an angle [rad]."""
    q = q.copy()
    if joint is not None:
        q[:, joint] = angle
    return q


def damage(kind: str, rng: np.random.Generator) -> Damage:
    """An arm with a fault in a random joint."""
    arm = get_arm("ur5-thesis")
    joint = int(rng.integers(6))
    if kind == STUCK:
        at = arm.home[joint] + rng.uniform(-0.3, 0.3)
        stuck = arm.with_limits({arm.joints[joint]: (at - 1e-4, at + 1e-4)})
        return Damage(replace(stuck, name=f"ur5_stuck_{joint}"), ur5().chain, joint, at)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    turn = np.array([0.0, 0.0, math.radians(2.0) * rng.choice((-1, 1))]) if kind == OFFSET else math.radians(3.0) * axis
    shift = np.zeros(3) if kind == OFFSET else 5e-3 * axis[[1, 2, 0]]
    robot = parse_urdf(arm.urdf)
    origin = next(j for j in robot.findall("joint") if j.get("name") == arm.joints[joint]).find("origin")
    given = {} if origin is None else origin.attrib
    before = placement(*([float(v) for v in given.get(key, "0 0 0").split()] for key in ("xyz", "rpy")))
    T = before @ placement(shift.tolist(), turn.tolist())
    set_origin(robot, arm.joints[joint], T[:3, 3], rpy(T[:3, :3]))
    broken = replace(arm, name=f"ur5_{joint}_off", build_urdf=partial(str, ET.tostring(robot, encoding="unicode")))
    return Damage(broken, ArmKinematics(broken, tip="tcp", base="world").chain)


def numeric(chain: SerialChain, points: Floats, *, stuck: int | None = None, at: float = 0.0) -> Floats:
    """Postures that bring the tip to points and the tool down, as near to what counts as reached as is found.

    Damped least squares from the closed form's postures and from random ones. What is further from its bound, place or
    direction, weighs more in the next round: the larger of the two is what decides.

    Args:
        chain: What is believed of the arm.
        points: [m], shape (m, 3).
        stuck: Index of a joint that does not move.
        at: Its angle [rad].
    """
    free = np.array([joint != stuck for joint in range(6)])
    nominal = tool_down_postures(ur5(), points)
    near, worst = _descended(chain, held(nominal, stuck, at), points, free)
    if worst.max() < SOLVED:
        return near
    anywhere = np.random.default_rng(0).uniform(-math.pi, math.pi, (STARTS, *nominal.shape)).reshape(-1, 6)
    found = _descended(chain, held(anywhere, stuck, at), np.tile(points, (STARTS, 1)), free)
    q = np.concatenate([near[None], found[0].reshape(STARTS, *nominal.shape)])
    worst = np.concatenate([worst[None], found[1].reshape(STARTS, -1)])
    best = np.maximum(worst, SOLVED).argmin(axis=0)  # the closed form's posture where it does: looks are near it
    return q[best, np.arange(len(points))]


def _descended(chain: SerialChain, q: Floats, points: Floats, free: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """The best postures (m, 6) on the way from some by free joints, and how far they are from reaching points (m,)."""
    q, best, least, lever = q.copy(), q, np.full(len(q), np.inf), np.full(len(q), LEVER)
    for steps in ROUNDS:
        for _ in range(steps):
            error, J = _misses(chain, q, points, lever)
            J = J[:, :, free]
            H = J.transpose(0, 2, 1) @ J + 1e-6 * np.eye(int(free.sum()))
            step = np.linalg.solve(H, (J.transpose(0, 2, 1) @ error[:, :, None]))[:, :, 0]
            q[:, free] = np.clip(q[:, free] + np.clip(step, -0.3, 0.3), -math.pi, math.pi)
        apart, off = _of_bounds(chain.fk(q), points)
        worst = np.maximum(apart, off)
        best, least = np.where((worst < least)[:, None], q, best), np.minimum(worst, least)
        if least.max() < SOLVED:
            break
        lever *= np.clip(np.sqrt((off + 1e-9) / (apart + 1e-9)), 0.5, 2.0)
    return best, least


def _misses(chain: SerialChain, q: Floats, points: Floats, lever: Floats) -> tuple[Floats, Floats]:
    """What is missing in position and, by a lever (m,), in direction, shape (m, 6), and its slopes (m, 6, 6)."""
    T, J = chain.fk(q), chain.jacobian(q)
    turn = np.cross(T[:, :3, 2], np.array(TOOL_DOWN))
    error = np.concatenate([points - T[:, :3, 3], lever[:, None] * turn], axis=1)
    J = J.copy()
    J[:, 3:] *= lever[:, None, None]
    return error, J


def _of_bounds(T: Floats, points: Floats) -> tuple[Floats, Floats]:
    """How far tips are from points and from pointing down, as shares of what counts as reached, each (m,)."""
    apart = np.linalg.norm(T[:, :3, 3] - points, axis=1)
    off = np.arccos(np.clip(-T[:, 2, 2], -1.0, 1.0))
    return apart / REACHED_DISTANCE, off / REACHED_POSTURE_ERROR


def by_looks(q: Floats, seen: Floats, balls: Floats) -> Floats:
    """Inverse kinematics of the fault that explains looks best: a joint that is stuck, or frames that are off.

    Args:
        q: Commanded [rad], shape (m, 6).
        seen: Where the tip was seen [m], shape (m, 3).
        balls: [m], shape (n, 3).

    Returns:
        Postures [rad], shape (n, 6).
    """
    chain = ur5().chain
    *links, tip = IdentifiedArm(chain.placements, q, seen, prior=PRIOR, noise=SIGMA).placements
    arm = SerialChain(links, [np.array((0.0, 0.0, 1.0))] * len(links), tip)
    rest = np.linalg.norm(arm.positions(q) - seen)
    suspects = []
    for joint in range(6):
        held_there = np.concatenate([held(q, joint, angle) for angle in ANGLES])
        off = np.linalg.norm(chain.positions(held_there).reshape(len(ANGLES), len(q), 3) - seen, axis=(1, 2))
        suspects.append((float(off.min()), joint, float(ANGLES[off.argmin()])))
    least, joint, angle = min(suspects)
    # a stuck joint has one number to explain everything with; the angles tried are 0.5 degrees apart
    if least < max(3.0 * rest, 4e-3 * math.sqrt(len(q))):
        fine = np.linspace(angle - 0.01, angle + 0.01, 81)
        off = [np.linalg.norm(chain.positions(held(q, joint, a)) - seen) for a in fine]
        found = numeric(chain, balls, stuck=joint, at=float(fine[int(np.argmin(off))]))
        found[:, joint] = np.median(q[:, joint])  # as commanded so far: where it hardly moved, it may be off, not stuck
        return found
    return numeric(arm, balls)


def how_far(fault: Damage, q: Floats, points: Floats) -> Floats:
    """How far commanded postures are from reaching points, shape (m,): below 1 counts as reached."""
    return np.maximum(*_of_bounds(fault.chain.fk(fault.executed(q)), points))


def reached(fault: Damage, q: Floats, balls: Floats) -> tuple[int, float]:
    """How many balls commanded postures reach, and the median distance [mm]."""
    apart, off = _of_bounds(fault.chain.fk(fault.executed(q)), balls)
    return int((np.maximum(apart, off) < 1.0).sum()), 1e3 * REACHED_DISTANCE * float(np.median(apart))


def found_before(kind: str, seed: int, count: int, folder: str) -> Tried:
    """The result of `tried`, from its file if there is one."""
    return kept(Path(folder), {"kind": kind, "fault": seed, "balls": count}, lambda: tried(kind, seed, count))


def tried(kind: str, seed: int, count: int) -> Tried:
    """What each method makes of a fault, on the same balls."""
    policy = load_policy(LEARNED_POLICY)
    rng = np.random.default_rng(seed)
    fault = damage(kind, rng)
    balls = ur5().arm.workcell.draw_goals(rng, count)
    q = tool_down_postures(ur5(), on_table(LOOKS[-1]))
    noise = rng.normal(0.0, SIGMA, (LOOKS[-1], 3))
    seen = fault.chain.positions(fault.executed(q)) + noise
    own = Trained(policy).aim(on_table(LOOKS[-1]))
    own_seen = fault.chain.positions(fault.executed(own)) + noise
    methods: dict[str, Callable[[], Floats]] = {
        "closed form, unaware": partial(tool_down_postures, ur5(), balls),
        "IK, fault known": partial(numeric, fault.chain, balls, stuck=fault.stuck, at=fault.at),
        f"`{LEARNED_POLICY}`, unaware": partial(Trained(policy).aim, balls),
    }
    for n in LOOKS:
        methods[f"IK, fault from {n} looks"] = partial(by_looks, q[:n], seen[:n], balls)
        methods[f"`{LEARNED_POLICY}`, tuned on {n} looks"] = partial(tuned, policy, own[:n], own_seen[:n], balls)
    found = {}
    for name, method in methods.items():
        found[name] = reached(fault, method(), balls)
    return found


def tuned(policy: LearnedPolicy, q: Floats, seen: Floats, balls: Floats) -> Floats:
    """Postures of a policy whose last layer was tuned on what its own moves led to."""
    learner = Tuned(policy, SIGMA)
    learner.learn(q, seen)
    return learner.aim(balls)


def share_of_faults(shares: Sequence[float]) -> str:
    """The mean share of several faults in percent, with its 95 % interval over them unless all are equal."""
    percent = 100.0 * np.array(shares)
    middle = f"{percent.mean():.1f}"
    if np.ptp(percent) == 0.0:
        return middle
    ((low, high),) = bootstrap_intervals(percent, (mean,))
    return f"{middle} [{low:.1f}, {high:.1f}]"


def off_by(distances: Sequence[float]) -> str:
    """The median of distances [mm]."""
    return f"{round(float(np.median(distances)), 2):.3g} mm"


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table: of each method and fault the share of balls reached, and the median distance."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--faults", type=int, default=60, help="of each kind (default: %(default)s)")
    parser.add_argument("--balls", type=int, default=40, help="for each fault (default: %(default)s)")
    parser.add_argument("--out", type=Path, default=Path("results/damage"), help="where finished faults are kept")
    add_options(parser)
    arguments = parser.parse_args(argv)
    check_count("--faults", arguments.faults)
    check_count("--balls", arguments.balls)
    make_writable(arguments.out)
    out = str(arguments.out.resolve())
    seeds = range(FIRST, FIRST + arguments.faults)
    parts: list[Any] = [(kind, seed, arguments.balls, out) for kind in KINDS for seed in seeds]
    faults = each(arguments, found_before, parts)
    found = [list(islice(faults, arguments.faults)) for _ in KINDS]
    print(head("method", *KINDS))
    for name in found[0][0]:
        rows = [[fault[name] for fault in kind] for kind in found]
        shares = (share_of_faults([hits / arguments.balls for hits, _ in row]) for row in rows)
        distances = (off_by([middle for _, middle in row]) for row in rows)
        print(line(name, *map("; ".join, zip(shares, distances, strict=True))))
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
