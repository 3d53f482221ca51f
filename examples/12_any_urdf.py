"""Prints what an arm can do, from its URDF: class, reach, singular postures, solvers.

    python examples/12_any_urdf.py [FILE.urdf [TIP]]

Without a file the arm is an xArm 7: seven joints. Needs no extra.
"""

import sys

import numpy as np
from example_robot_data.robots_loader import getModelPath

from kinreach.compare import compare
from kinreach.kinematics import (
    ArmKinematics,
    CollisionChecker,
    LevenbergMarquardtSolver,
    PoseGoal,
    QPSolver,
    check,
)
from kinreach.robots import ArmDescription

xarm = "xarm_description/urdf/xarm7.urdf"
file = sys.argv[1] if len(sys.argv) > 1 else f"{getModelPath(xarm)}/{xarm}"
arm = ArmDescription.from_urdf(file, tip=sys.argv[2] if len(sys.argv) > 2 else None)

kin = ArmKinematics.of(arm)
kind = type(kin).__name__
reach = check.reach_of(kin)
print(
    f"{arm.name}: {kin.n} joints, tip {kin.tip}, {kind}, reaches {reach.farthest:.2f} m"
)

q = check.random_postures(kin, 10_000, seed=0)
print(
    "10000 poses at once,",
    f"{np.abs(kin.fk(q)[0] - kin.fk(q[0])).max():.0e} from Pinocchio's",
)

singular = check.singular_postures(kin, reach.farthest)
print(
    f"{len(singular.q)} singular postures; "
    f"in one, joints 2 to {kin.n} are at {singular.q[0, 1:].round(2) + 0.0}"
)

# the arm with itself: a URDF does not describe what is around it
checker = CollisionChecker(kin)
for solver in (LevenbergMarquardtSolver(kin), QPSolver(kin)):
    results = [
        solver.solve(PoseGoal(kin.fk(posture)), arm.home, accept=checker.free)
        for posture in q[:50]
    ]
    solved = [result for result in results if result.success]
    worst = max(result.position_error for result in solved)
    print(
        f"{solver.name}: {len(solved)} of 50 poses without a collision, "
        f"within {1000 * worst:.2f} mm"
    )
print(
    "the first that was missed:\n ",
    next((result.reason for result in results if not result.success), "none"),
)

(row,) = compare("ur5", arm=arm, methods=["lm"], goals=10)["methods"]
print(
    f"compare, lm: {100 * row['reached']:.0f} % reached under dynamics, "
    f"{row['distance_mm']['median']:.2f} mm off"
)
