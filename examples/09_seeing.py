"""Prints where both RGB-D cameras see a ball at three places, and how far off that is.

    python examples/09_seeing.py

It also keeps the last picture, with a circle around the ball, as `results/seeing.jpg`.
Needs no extra, but OpenGL (EGL or OSMesa).
"""

from pathlib import Path

import cv2
import numpy as np

from kinreach.sim import ArmSimulation
from kinreach.vision import RGBDCamera, SensorNoise, find_ball

simulation = ArmSimulation("ur5-thesis")
radius = simulation.arm.workcell.ball_radius
noise, rng = SensorNoise(rgb_sigma=6.0, depth_sigma=0.002), np.random.default_rng(0)

with RGBDCamera(simulation, "front") as front, RGBDCamera(simulation, "wrist") as wrist:
    for goal in ([0.35, -0.25, -0.175], [0.45, 0.10, -0.175], [0.60, 0.28, -0.175]):
        simulation.place_ball(goal)
        for camera in (front, wrist):
            image = camera.capture(noise=noise, rng=rng)
            ball = find_ball(image.rgb, image.depth, camera.intrinsics, radius)
            if ball is None:
                print(f"{camera.name}: no ball in the picture")
                continue
            # from the camera's frame to the world
            position = camera.T_world_camera @ [*ball.position, 1.0]
            error = 1000 * np.linalg.norm(position[:3] - goal)
            distance = np.linalg.norm(ball.position)
            x, y, z = position[:3]
            print(
                f"{camera.name}: ball {distance:.3f} m away "
                f"at ({x:.4f}, {y:.4f}, {z:.4f}), {error:.2f} mm off"
            )

picture = np.ascontiguousarray(image.rgb[..., ::-1])  # OpenCV's order of colours
if ball is not None:
    cv2.circle(
        picture,
        (round(ball.circle.u), round(ball.circle.v)),
        round(ball.circle.r) + 3,
        (0, 255, 255),
        2,
    )
Path("results").mkdir(exist_ok=True)
cv2.imwrite("results/seeing.jpg", picture)
