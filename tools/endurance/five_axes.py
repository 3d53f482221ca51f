"""Arms of four and five axes: nothing stationary that Newton's method finds from random postures is missed.

`python -m tools.endurance.five_axes 0 2500` checks a part of the poses; a third number is the step between them.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from kinreach._rotations import joints_apart
from kinreach.kinematics import FiveAxisKinematics
from tests.kinematics.five_axis_arms import (
    FIGURES,
    kinematics_of,
    orientations,
    owned,
    random_joints,
    random_pitched_joints,
)
from tests.kinematics.stationary_oracle import Oracle
from tools.endurance.outcome import Outcome, demand

#: Random starts at a pose, arms of random geometry of each number of joints, and what counts as the same posture [rad].
STARTS, ARMS, SAME = 60, 100, 1e-4


def many_starts(indices: Sequence[int]) -> Outcome:
    """Poses of any orientation: on random arms, on random ones with three parallel axes, on owned ones."""
    tried, missed = 0, []
    with tempfile.TemporaryDirectory() as folder:
        for index in indices:
            found, lost = at_pose(Path(folder), index)
            tried += found
            missed += [index] * lost
    demand(not missed, f"{len(missed)} of {tried:,} postures are missed, at poses {', '.join(map(str, missed))}")
    return Outcome(len(indices), "poses", f"{tried:,} postures of many starts, each found")


def at_pose(folder: Path, index: int) -> tuple[int, int]:
    """How many postures many starts find at a pose, and how many of them the arm's kinematics miss."""
    rng = np.random.default_rng([index, 17])
    kin = _arm(folder, index, rng)
    T = kin.fk(rng.uniform(-np.pi, np.pi, kin.n))
    T[:3, :3] = orientations(rng)
    found = kin.all_solutions(T, limits=False)
    demand(len(found) and found.residual[:, 0].max() < 1e-9, f"pose {index}: missed its point")
    q = Oracle(kin, T).stationary(rng, STARTS)[0]
    return len(q), sum(joints_apart(found.q, each).min() > SAME for each in q)


def _arm(folder: Path, index: int, rng: np.random.Generator) -> FiveAxisKinematics:
    names, number = sorted(FIGURES), index // 4
    if index % 4 == 1:
        return owned(folder, names[number % len(names)])
    arm = index // 2 % (2 * ARMS) if index % 2 == 0 else number % (2 * ARMS)
    geometry = random_pitched_joints if index % 4 == 3 else random_joints
    return kinematics_of(folder, *geometry(4 + arm % 2, np.random.default_rng([arm, 18])))


if __name__ == "__main__":
    print(many_starts(range(*map(int, sys.argv[1:]))))
