"""Prints how far the data sheet misses a goal on a calibrated UR5, and the exact IK.

    python examples/11_calibrated_ur.py [kinematics.yaml MODEL]

Both go to one goal in a simulation of the calibrated arm. Without a file it takes a
published calibration of a UR5. Needs no extra.
"""

import sys

import numpy as np

from kinreach.kinematics import CollisionChecker, URKinematics
from kinreach.robots import PUBLISHED_CALIBRATIONS, get_arm, read_calibration
from kinreach.sim import ArmSimulation

file, model = PUBLISHED_CALIBRATIONS["ur5_a"], "ur5"
if len(sys.argv) == 3:
    file, model = sys.argv[1:]

calibration = read_calibration(file, model)
print(
    "tilts of the axes [mrad]:",
    (1000 * calibration.tilts).round(1),
    "offsets [mm]:",
    (1000 * calibration.offsets).round(1),
)

tool = [0, 0, 0.2, 0, 0, 0]  # its centre point on the flange, as on the pendant
nominal = URKinematics(model, tool=tool, base="world")
real = URKinematics.from_calibration(file, model=model, tool=tool, base="world")
q = np.random.default_rng(0).uniform(-np.pi, np.pi, (1000, 6))
off = 1000 * np.linalg.norm(real.positions(q) - nominal.positions(q), axis=1)
print(
    f"the data sheet is {np.median(off):.1f} mm off in the median, "
    f"{off.max():.1f} mm at most"
)

# the truth; a method may still believe in the data sheet
arm = get_arm(model).calibrated(file).with_tool(tool)
checker, simulation = CollisionChecker(arm), ArmSimulation(arm)
home, goal = np.array(arm.home), np.array([0.45, 0.1, 0.05])
T = real.fk(real.axis_goal(goal, [0, 0, -1], home).q)
solutions = real.all_solutions(T)
print(
    f"{len(solutions)} postures for one pose, "
    f"branches {solutions.branch.tolist()}, {solutions.residual.max():.0e} off"
)
for name, kin in (("data sheet", nominal), ("calibrated", real)):
    result = kin.axis_goal(goal, [0, 0, -1], home, accept=checker.free)
    simulation.reset()
    move = simulation.move(result.q)
    miss = 1000 * np.linalg.norm(simulation.tip_position - goal)
    print(f"{name}: {move.status.value}, {miss:.2f} mm from the goal")
