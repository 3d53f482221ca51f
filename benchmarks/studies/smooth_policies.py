"""What a multi-step policy's motion asks of a real arm's drives, and what makes it smooth enough.

    python -m benchmarks.studies.smooth_policies

The postures that a policy asks for in the comparison `ur5`, one each 0.1 s, are made a command at 500 Hz in several
ways. Printed are the largest speed, acceleration and jerk of each as multiples of the joints' limits, how long it
takes, and how far the tip is at most from the way along straight joint lines through the postures.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any

import gymnasium as gym
import numpy as np
from ruckig import InputParameter, OutputParameter, Ruckig
from scipy.spatial import cKDTree

import kinreach  # noqa: F401 (registers the environments)
from benchmarks.studies.tables import head, line
from kinreach._checks import Floats, check_count
from kinreach._registration import MULTI, SINGLE
from kinreach.baselines import load_policy, rollout
from kinreach.baselines._solver_policy import SolverPolicy
from kinreach.cli import Parser, finish
from kinreach.compare._motion import MotionRecorder, peaks
from kinreach.compare._reach import goals_of
from kinreach.compare._task import resets_to
from kinreach.kinematics import ArmKinematics, MotionLimits, time_path, time_waypoints
from kinreach.kinematics._solvers import new_solver
from kinreach.kinematics._trajectory import Trajectory

PROG = "python -m benchmarks.studies.smooth_policies"
#: Time between two decisions, and between two samples of the command [s].
DECISION, CYCLE = 0.1, 0.002
#: Time constants of the filter that are tried [s], in this order.
FILTERS = (0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3)
#: A filter has come to its end when no joint is farther from it [rad].
ARRIVED = 1e-7
#: Samples of the way that a command is compared with are so near to each other [rad].
FINE = 2e-4
POLICIES = {"ppo-multi": "ppo-multi", "ranked-multi": "ranked-multi"}


def _trajectory(limits: MotionLimits, q: Floats, qd: Floats | None = None) -> Trajectory:
    """A command at 500 Hz; without speeds, a posture is held until the next one."""
    speeds = np.diff(q, axis=0, prepend=q[:1]) / CYCLE if qd is None else qd
    return Trajectory(limits.joints, CYCLE * np.arange(len(q)), q, speeds)


def raw(points: Floats, limits: MotionLimits) -> Trajectory:
    """Each posture is commanded as soon as it is decided."""
    return _trajectory(limits, np.vstack([points[:1], np.repeat(points[1:], round(DECISION / CYCLE), axis=0)]))


def interpolated(points: Floats, limits: MotionLimits) -> Trajectory:
    """Straight from one posture to the next during the time between two decisions."""
    at = np.linspace(0.0, len(points) - 1, 1 + (len(points) - 1) * round(DECISION / CYCLE))
    return _trajectory(limits, np.column_stack([np.interp(at, np.arange(len(points)), angles) for angles in points.T]))


def filtered(constant: float) -> Callable[[Floats, MotionLimits], Trajectory]:
    """Return `interpolated` through three first-order low-pass filters of this time constant [s] in a row."""

    def command(points: Floats, limits: MotionLimits) -> Trajectory:
        wanted, share = interpolated(points, limits).q, CYCLE / (constant + CYCLE)
        stages, taken = [points[0].copy() for _ in range(3)], [points[0]]
        step = 0
        while step < len(wanted) or np.abs(taken[-1] - points[-1]).max() > ARRIVED:
            before = wanted[min(step, len(wanted) - 1)]
            for stage in stages:
                stage += share * (before - stage)
                before = stage
            taken.append(before.copy())
            step += 1
        return _trajectory(limits, np.array(taken))

    return command


def following(points: Floats, limits: MotionLimits) -> Trajectory:
    """Ruckig at 500 Hz, on its way to the newest posture; it stops only at the last."""
    n = points.shape[1]
    follower, wanted, out = Ruckig(n, CYCLE), InputParameter(n), OutputParameter(n)
    wanted.current_position = wanted.target_position = points[0].tolist()
    wanted.max_velocity, wanted.max_acceleration, wanted.max_jerk = (
        values.tolist() for values in (limits.speed, limits.acceleration, limits.jerk)
    )
    q, qd = [points[0]], [np.zeros(n)]
    for target in points[1:]:
        wanted.target_position = target.tolist()
        for _ in range(round(DECISION / CYCLE)):
            follower.update(wanted, out)
            q.append(np.array(out.new_position))
            qd.append(np.array(out.new_velocity))
            out.pass_to_input(wanted)
    while np.abs(q[-1] - points[-1]).max() > 1e-6 or np.abs(qd[-1]).max() > 1e-6:
        follower.update(wanted, out)
        q.append(np.array(out.new_position))
        qd.append(np.array(out.new_velocity))
        out.pass_to_input(wanted)
    return _trajectory(limits, np.array(q), np.array(qd))


WAYS: Mapping[str, Callable[[Floats, MotionLimits], Trajectory]] = {
    "raw: each posture as it is decided": raw,
    "straight between decisions": interpolated,
    "ruckig, follows the newest posture": following,
    "ruckig, stops at each posture": time_waypoints,
    "toppra, through all postures, known beforehand": lambda points, limits: time_path(points, limits, tolerance=0.01),
}


def postures_of(name: str, count: int) -> list[Floats]:
    """The postures that a policy asks for on so many goals, those of the comparison, each with the start [rad]."""
    environment = MULTI if name in POLICIES else SINGLE
    env = gym.make(environment, disable_env_checker=True)
    solver = SolverPolicy(new_solver("closed-form", env.unwrapped.kinematics), env)  # type: ignore[attr-defined]
    policy: Any = load_policy(POLICIES[name]) if name in POLICIES else solver
    found = []
    for reset in resets_to(goals_of(env, count, 0), 0):
        recorder = MotionRecorder()
        (trial,) = rollout(env, policy, [reset], watch=recorder)
        if trial["reached"]:
            found.append(np.array(recorder.points))
    return found


def off_way(kinematics: ArmKinematics, motion: Trajectory, points: Floats) -> float:
    """Largest distance of the tip from its way along straight joint lines through the postures [m]."""
    way = np.vstack([np.linspace(a, b, 2 + int(np.abs(b - a).max() / FINE)) for a, b in pairwise(points)])
    near, _ = cKDTree(kinematics.positions(way)).query(kinematics.positions(motion.q))
    return float(near.max())


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--goals", type=int, default=50, help="of the comparison (default: %(default)s)")
    count = check_count("--goals", parser.parse_args(argv).goals)
    kinematics = ArmKinematics.of("ur5-thesis", tip="tcp", base="world")
    limits = MotionLimits.of(kinematics)
    print(head("policy", "command", "s, median", "speed", "acceleration", "jerk", "off its way, mm"))
    for name in (*POLICIES, "closed-form"):
        motions = postures_of(name, count)
        ways = dict(WAYS)
        if name == "closed-form":
            ways = {"ruckig, one motion": time_waypoints}
        else:
            smooth = next((c for c in FILTERS if _worst([filtered(c)(p, limits) for p in motions], limits) <= 1.0), 0.0)
            for constant in dict.fromkeys((FILTERS[0], smooth or FILTERS[-1])):
                ways[f"low-pass, three times {constant:g} s"] = filtered(constant)
        for way, command in ways.items():
            made = [command(points, limits) for points in motions]
            worst = np.max([list(peaks(motion, limits).values()) for motion in made], axis=0)
            far = max(off_way(kinematics, motion, points) for motion, points in zip(made, motions, strict=True))
            seconds = float(np.median([motion.duration for motion in made]))
            shares = ["above 1000" if share > 1000.0 else f"{share:.{2 if share < 10.0 else 0}f}" for share in worst]
            print(line(name, way, f"{seconds:.2f}", *shares, f"{1e3 * far:.1f}"), flush=True)
    return 0


def _worst(motions: list[Trajectory], limits: MotionLimits) -> float:
    return max(share for motion in motions for share in peaks(motion, limits).values())


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
