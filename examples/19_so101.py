"""Follows a tool path with an SO-101 at 50 Hz, joint angles in degrees as in LeRobot.

    python examples/19_so101.py

Five joints meet every point, and the orientation as nearly as they can. Beside it
placo as LeRobot calls it: a step a tick, weights 1 and 0.01. Needs the extra placo.
"""

import math

import numpy as np
import placo

from kinreach.kinematics import ArmKinematics, pose

kin = ArmKinematics.of("so101")
names = [f"{joint}.pos" for joint in kin.arm.joints]

# a circle of 14 cm in 8 s, the tool ahead, down by 35 degrees and aside by 17
turn = pose([0, 0, 0, 0, 0, 0.3]) @ pose([0, 0, 0, 0, 0.6, 0])
path = np.tile(turn @ kin.fk(kin.arm.home), (8 * 50, 1, 1))
phase = np.linspace(0, 2 * np.pi, len(path))
y, z = 0.07 * np.sin(phase), 0.12 + 0.07 * np.cos(phase)
path[:, :3, 3] = np.column_stack([np.full(len(path), 0.25), y, z])

robot = placo.RobotWrapper("", placo.Flags.ignore_collisions, kin.arm.urdf)
solver = placo.KinematicsSolver(robot)
solver.mask_fbase(True)
task = solver.add_frame_task(kin.arm.tips[kin.tip], np.eye(4))
task.configure("tip", "soft", 1.0, 0.01)


def exactly(degrees: np.ndarray, T: np.ndarray) -> np.ndarray:
    """Return the posture near the last one: with any margin it never jumps."""
    return np.degrees(kin.nearest(T, np.radians(degrees), margin=math.inf).q)


def by_placo(degrees: np.ndarray, T: np.ndarray) -> np.ndarray:
    """Return the posture one step nearer to both."""
    for joint, angle in zip(kin.arm.joints, np.radians(degrees), strict=True):
        robot.set_joint(joint, angle)
    robot.update_kinematics()
    task.T_world_frame = T
    solver.solve(True)
    return np.degrees([robot.get_joint(joint) for joint in kin.arm.joints])


for name, step in (("kinreach", exactly), ("placo", by_placo)):
    q = [np.degrees(kin.nearest(path[0], kin.arm.home).q)]
    for T in path:
        q.append(step(q[-1], T))
    tips = kin.fk(np.radians(q[1:]))
    off = 1000 * np.linalg.norm(tips[:, :3, 3] - path[:, :3, 3], axis=1)
    cosine = (np.einsum("nij,nij->n", tips[:, :3, :3], path[:, :3, :3]) - 1) / 2
    left, most = np.degrees(np.arccos(cosine)), np.abs(np.diff(q, axis=0)).max()
    print(f"{name}: {np.median(off):.2f} mm off the path, {off.max():.2f} at most")
    print(f"  orientation up to {left.max():.0f} degrees off, {most:.1f} a tick")
    print(" ", dict(zip(names, q[100].round(1).tolist(), strict=True)))
