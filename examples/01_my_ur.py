"""Prints every posture of your UR for a pose, and joint angles for a row of poses.

    python examples/01_my_ur.py [kinematics.yaml MODEL]

Poses are as the pendant shows them, the arm has its calibration and its tool. Without a
file it takes a published calibration of a UR5e. Needs no extra.
"""

import sys

import numpy as np

from kinreach.kinematics import CollisionChecker, URKinematics, pose, pose_vector
from kinreach.robots import PUBLISHED_CALIBRATIONS, Tool

np.set_printoptions(suppress=True)
file, model = PUBLISHED_CALIBRATIONS["ur5e_a"], "ur5e"
if len(sys.argv) == 3:
    file, model = sys.argv[1:]

# x, y, z, rx, ry, rz from the flange [m, rad], and the tool's shape
tool = Tool.tube([0, 0, 0.15, 0, 0, 0], radius=0.03)
# "base" is the pendant's frame
kin = URKinematics.from_calibration(file, model=model, tool=tool, base="base")
checker = CollisionChecker(kin, obstacles=())  # the arm with itself and its tool

q_now = np.radians([-90, -90, 90, -90, -90, 0])
print("now:", pose_vector(kin.fk(q_now)).round(4))

goal = pose([-0.4, 0.1, 0.3, 3.14, 0, 0])
solutions = kin.all_solutions(goal, seed=q_now)  # nearest first
for branch, q in zip(solutions.branch, solutions.q, strict=True):
    print(branch, np.degrees(q).round(2), checker.reason(q) or "free")

for x in (-0.3, -0.5, -0.7, -0.9):  # a row of poses, each near the one before
    answer = kin.nearest(pose([x, 0.1, 0.3, 3.14, 0, 0]), q_now, accept=checker.free)
    found = np.degrees(answer.q).round(2) if answer.success else answer.reason
    print(f"x {x:.1f} m:", found)
    q_now = answer.q

nominal = URKinematics(model, tool=tool, base="base")
off = pose_vector(nominal.fk(q_now))[:3] - pose_vector(kin.fk(q_now))[:3]
print(f"the data sheet puts the tool {1000 * np.linalg.norm(off):.2f} mm off there")
