"""Finds a UR5e's calibration in poses typed from its pendant, and solves with it.

    python examples/16_calibrate.py [SOURCE]

SOURCE is a .urp, its export (.script), a recording of RTDE, or a table of joint angles
and poses. Without one it writes twenty rows as a pendant shows them, of a published
calibration. The picture of the errors is results/calibration.png. Needs no extra.
"""

import csv
import sys
from pathlib import Path

import numpy as np

from kinreach.kinematics import URKinematics, pose, pose_vector
from kinreach.plots import draw_calibration
from kinreach.robots import PUBLISHED_CALIBRATIONS, calibrate

HEADER = [f"{joint} [deg]" for joint in ("Base", "Shoulder", "Elbow")]
HEADER += [f"Wrist {number} [deg]" for number in (1, 2, 3)]
HEADER += ["X [mm]", "Y [mm]", "Z [mm]", "RX [rad]", "RY [rad]", "RZ [rad]"]
TOOL = [0, 0, 0.15, 0, 0, 0]


def typed(file: Path) -> Path:
    """Write what the pendant of a UR5e shows, rounded as it shows it."""
    real = URKinematics.from_calibration(
        PUBLISHED_CALIBRATIONS["ur5e_a"], model="ur5e", tool=TOOL, base="base"
    )
    home = np.array(real.arm.home)
    q = home + np.random.default_rng(0).uniform(-1.2, 1.2, (20, 6))
    poses = pose_vector(real.fk(q))
    poses[:, :3] *= 1000
    positions, turns = poses[:, :3].round(2), poses[:, 3:].round(3)
    rows = np.hstack([np.degrees(q).round(2), positions, turns])
    with file.open("w", newline="") as lines:
        csv.writer(lines).writerows([HEADER, *rows.tolist()])
    return file


results = Path("results")
results.mkdir(exist_ok=True)
source = sys.argv[1] if len(sys.argv) > 1 else typed(results / "pendant.csv")
found = calibrate(source, tool=None if len(sys.argv) > 1 else TOOL)
print("\n".join(found.statement()))
if found.missing:
    sys.exit("the rows do not determine the calibration")
found.save(results / "my_robot.yaml")
if found.fit is not None:
    draw_calibration(found).savefig(results / "calibration.png")

kin = URKinematics.from_calibration(
    results / "my_robot.yaml", model=found.models[0], tool=found.tcp, base="base"
)
goal = pose([-0.4, 0.1, 0.3, 3.14, 0, 0])
print(np.degrees(kin.nearest(goal, kin.arm.home).q).round(2), "degrees")
