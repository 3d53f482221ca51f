"""Joint angles for your own UR: `python examples/01_my_ur.py [kinematics.yaml MODEL]`.

Your calibration, your tool, poses as the pendant shows them in, joint angles out. Without a file a published
calibration of a UR5e is used. In a shell: `kinreach ik --arm ur5e --calibration FILE --tool 0,0,0.15,0,0,0 --pose ...`.
"""

import sys

import numpy as np

from kinreach.kinematics import CollisionChecker, URKinematics, pose, pose_vector
from kinreach.robots import PUBLISHED_CALIBRATIONS, Tool

np.set_printoptions(suppress=True)
file, model = sys.argv[1:] if len(sys.argv) == 3 else (PUBLISHED_CALIBRATIONS["ur5e_a"], "ur5e")

tool = Tool.tube([0, 0, 0.15, 0, 0, 0], radius=0.03)  # x, y, z, rx, ry, rz from the flange, in metres; its shape
kin = URKinematics.from_calibration(file, model=model, tool=tool, base="base")  # base: the pendant's frame
checker = CollisionChecker(kin, obstacles=())  # the arm with itself and its tool

q_now = np.radians([-90, -90, 90, -90, -90, 0])
print("now:", pose_vector(kin.fk(q_now)).round(4))

solutions = kin.all_solutions(pose([-0.4, 0.1, 0.3, 3.14, 0, 0]), seed=q_now)  # nearest first
for branch, q in zip(solutions.branch, solutions.q, strict=True):
    print(branch, np.degrees(q).round(2), checker.reason(q) or "free")

for x in (-0.3, -0.5, -0.7, -0.9):  # a row of poses, each near the one before
    answer = kin.nearest(pose([x, 0.1, 0.3, 3.14, 0, 0]), q_now, accept=checker.free)
    print(f"x {x:.1f} m:", np.degrees(answer.q).round(2) if answer.success else answer.reason)
    q_now = answer.q

nominal = URKinematics(model, tool=tool, base="base")
off = pose_vector(nominal.fk(q_now))[:3] - pose_vector(kin.fk(q_now))[:3]
print(f"the data sheet puts the tool {1000 * np.linalg.norm(off):.2f} mm off there")
