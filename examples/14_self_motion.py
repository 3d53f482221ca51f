"""Prints and draws the curves of postures of a Panda for one pose, and the best ones.

    python examples/14_self_motion.py

The picture is results/self_motion.png. Needs no extra.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from example_robot_data.robots_loader import getModelPath

from kinreach.kinematics import ArmKinematics, CollisionChecker

file = "panda_description/urdf/panda.urdf"
panda = ArmKinematics.from_urdf(f"{getModelPath(file)}/{file}", tip="panda_hand_tcp")
seed = np.array([0.4, -0.6, 0.3, -2.1, 0.2, 1.7, 0.6])
T = panda.fk(seed)

for curve in panda.self_motions(T):
    print(f"a curve of {curve.total:.2f} rad, closed: {curve.closed}")
    plt.plot(curve.q[:, 0], curve.q[:, 6])

checker = CollisionChecker(panda, meshes="hulls")
best = {
    "nearest": panda.nearest(T, seed + 0.5, accept=checker.free),
    "manipulable": panda.manipulable(T),
    "clearest": panda.clearest(T, checker),
}
for name, found in best.items():
    print(f"{name}: {found.q.round(2)} on curve {found.branch}")
    plt.plot(found.q[0], found.q[6], "o", label=name)

plt.xlabel("joint 1 [rad]"), plt.ylabel("joint 7 [rad]"), plt.legend()
Path("results").mkdir(exist_ok=True)
plt.savefig("results/self_motion.png", dpi=120)
