"""Arms of four and five axes: nothing stationary that Newton's method finds from random postures is missed."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from kinreach._rotations import wrapped
from kinreach.kinematics import FiveAxisKinematics
from tests.kinematics.five_axis_arms import FIGURES, kinematics_of, orientations, owned, random_joints
from tests.kinematics.stationary_oracle import Oracle
from tools.endurance.outcome import Outcome, demand

#: Random starts at a pose, arms of random geometry of each number of joints, and what counts as the same posture [rad].
STARTS, ARMS, SAME = 60, 100, 1e-4


def many_starts(count: int) -> Outcome:
    """`count` poses, half of them on arms that people own, half on random ones, with orientations of any kind."""
    tried = missed = 0
    with tempfile.TemporaryDirectory() as folder:
        for index in range(count):
            rng = np.random.default_rng([index, 17])
            kin = _arm(Path(folder), index, rng)
            T = kin.fk(rng.uniform(-np.pi, np.pi, kin.n))
            T[:3, :3] = orientations(rng)
            found = kin.all_solutions(T, limits=False)
            demand(len(found) and found.residual[:, 0].max() < 1e-9, f"pose {index}: missed its point")
            for q in Oracle(kin, T).stationary(rng, STARTS)[0]:
                missed += np.abs(wrapped(found.q - q)).max(axis=1).min() > SAME
                tried += 1
    demand(missed == 0, f"{missed} of {tried:,} postures are missed")
    return Outcome(count, "poses", f"{tried:,} postures of many starts, each found")


def _arm(folder: Path, index: int, rng: np.random.Generator) -> FiveAxisKinematics:
    names = sorted(FIGURES)
    if index % 2:
        return owned(folder, names[index // 2 % len(names)])
    arm = index // 2 % (2 * ARMS)
    return kinematics_of(folder, *random_joints(4 + arm % 2, np.random.default_rng([arm, 18])))
