"""Prints the time of forward and inverse kinematics of a million poses, for two arms.

    python examples/10_million_fk_ik.py

Everything is numpy. Blocks of 50 000 keep the memory at some 100 MB; the calls take any
number. It takes 10 seconds. Needs no extra.
"""

from time import perf_counter

import numpy as np

from kinreach.kinematics import Arm3Kinematics, UR5Kinematics

COUNT, BLOCK = 1_000_000, 50_000
rng = np.random.default_rng(0)

for kin in (UR5Kinematics(tip="tcp", base="world"), Arm3Kinematics(base="world")):
    seconds = {"fk": 0.0, "batch": 0.0, "nearest_batch": 0.0}
    solutions, solved, worst = 0, 0, 0.0
    for _ in range(COUNT // BLOCK):
        q = rng.uniform(kin.lower, kin.upper, (BLOCK, kin.n))

        start = perf_counter()
        T = kin.fk(q)  # (n, 4, 4)
        seconds["fk"] += perf_counter() - start

        start = perf_counter()
        solutions += int(
            kin.batch(T).valid.sum()
        )  # all branches: 8 of the UR5, 4 of the 3-DOF arm
        seconds["batch"] += perf_counter() - start

        start = perf_counter()
        nearest = kin.nearest_batch(
            T, kin.arm.home
        )  # one posture each, the nearest to home within the limits
        seconds["nearest_batch"] += perf_counter() - start

        solved += int(nearest.success.sum())
        error = np.linalg.norm(
            kin.positions(nearest.q[nearest.success]) - T[nearest.success, :3, 3],
            axis=1,
        )
        worst = max(worst, float(error.max()))
    times = ", ".join(f"{name} {1e6 * s / COUNT:.2f} us" for name, s in seconds.items())
    print(
        f"{kin.arm.name}: {solved} of {COUNT} solved, "
        f"{solutions / COUNT:.2f} postures each, {1000 * worst:.0e} mm off"
    )
    print(f"{kin.arm.name}: a pose takes {times}")
