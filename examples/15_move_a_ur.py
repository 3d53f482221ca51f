"""Picks a goal, plans, runs the program on a simulated UR, plots how well it follows.

    python examples/15_move_a_ur.py [film]

The plot is results/move_a_ur.png, the film results/move_a_ur.gif. Needs no extra, but
OpenGL for the film.
"""

import sys
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

from kinreach.deploy import Move, Program, SimulatedUR, URClient
from kinreach.kinematics import ArmKinematics, CollisionChecker, plan_path, pose
from kinreach.robots import (
    PUBLISHED_CALIBRATIONS,
    Box,
    CameraMount,
    Tool,
    Workcell,
    get_arm,
)
from kinreach.sim import ArmSimulation, render

# a UR5e with its calibration and a tool, at a table with a wall on it
arm = get_arm("ur5e").calibrated(PUBLISHED_CALIBRATIONS["ur5e_a"])
arm = arm.with_tool(Tool.tube([0, 0, 0.1, 0, 0, 0], 0.03))
wall = Box("wall", (0.5, 0.02, 0.5), (0.47, 0.0, 0.25))
boxes = (*arm.workcell.obstacles, wall)
camera = CameraMount("overview", "world", (1.5, -1.1, 1.0), (0.2, 0.0, 0.25), fovy=40.0)
cell = Workcell(obstacles=boxes, touching=arm.workcell.touching)
arm = replace(arm, workcell=cell, cameras=(camera,))

kin = ArmKinematics.of(arm, base="base")
checker = CollisionChecker(kin, margin=0.005)
start = np.array(arm.home) - [0.7, 0, 0, 0, 0, 0]
goal = pose([-0.45, 0.35, 0.2, 3.14, 0, 0])  # behind the wall, as on the pendant
path = plan_path(checker, start, kin.all_solutions(goal, seed=start))
print(f"{len(path) - 1} straight lines in joint space, all free")

moves = [Move("movej", q, speed=1.0, acceleration=2.0) for q in path[1:]]
program = Program.of(kin, start, moves)
print(f"{len(program.text.splitlines())} lines of URScript")

# the ports of a real UR are taken without these arguments
with SimulatedUR(arm, q=start, rtde_port=0, script_port=0, speed=4) as ur:
    ports = {"rtde_port": ur.rtde_port, "script_port": ur.script_port}
    with URClient(ur.address, **ports) as robot:
        done = robot.run(program)
        reached = pose(robot.read().tcp_pose)
off = np.abs(done.measured.q - done.commanded.q).max()
print(f"{done.commanded.duration:.1f} s, joints within {1000 * off:.0f} mrad")
miss = 1000 * np.linalg.norm(reached[:3, 3] - goal[:3, 3])
print(f"by the robot's own model its tool is {miss:.1f} mm from the goal")

Path("results").mkdir(exist_ok=True)
figure, axes = plt.subplots(2, 3, figsize=(9, 4.5), sharex=True, layout="constrained")
t = done.commanded.t
for axis, name, q, measured in zip(
    axes.flat, kin.arm.joints, done.commanded.q.T, done.measured.q.T, strict=True
):
    axis.plot(t, q, lw=3, alpha=0.4, label="commanded")
    axis.plot(t, measured, lw=1, color="black", label="measured")
    axis.set(title=name.removesuffix("_joint") + " [rad]")
axes[0, 0].legend()
figure.supxlabel("time [s]")
figure.savefig("results/move_a_ur.png", dpi=110)

if sys.argv[1:] == ["film"]:
    scene, frames = ArmSimulation(arm, visual=True), []
    for time in np.arange(0, t[-1] + 0.8, 0.06):
        scene.reset(done.measured.at(time)[0])
        scene.place_ball([0.0, 0.0, -0.5])  # the scene has one, under the table
        scene.contacts()  # puts the links where they are
        image = Image.fromarray(render(scene, width=960, height=600))
        frames.append(image.quantize(128, Image.Quantize.FASTOCTREE))
    film = {"append_images": frames[1:], "duration": 60, "loop": 0}
    frames[0].save("results/move_a_ur.gif", save_all=True, **film)
