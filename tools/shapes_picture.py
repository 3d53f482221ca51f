"""What is drawn of a UR and what collides: `python -m tools.shapes_picture` writes docs/images/ur_shapes.jpg.

It needs OpenGL.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image

from kinreach.robots import CameraMount, get_arm
from kinreach.sim._rendering import FrameRenderer
from kinreach.sim._scene import BALL, scene_model

OUT = Path(__file__).resolve().parents[1] / "docs/images/ur_shapes.jpg"
WIDTH, HEIGHT = 480, 400
POSTURE = np.radians([-70.0, -70.0, 105.0, -125.0, -90.0, 20.0])
CAMERA = CameraMount("overview", "world", (1.25, -0.75, 0.65), (0.23, 0.03, 0.33), fovy=36.0)
#: Arms, and whether they are drawn or shown as they collide.
SHOWN = (("ur5", True), ("ur5e", True), ("ur5e", False))


def picture(name: str, *, drawn: bool) -> Image.Image:
    """Draw an arm in `POSTURE`."""
    model = scene_model(replace(get_arm(name), cameras=(CAMERA,)), visual=drawn)
    data = mujoco.MjData(model)
    for joint, angle in zip(get_arm(name).joints, POSTURE, strict=True):
        data.joint(joint).qpos[0] = angle
    model.geom_rgba[model.geom_bodyid == model.body(BALL).id, 3] = 0.0
    with FrameRenderer(model, width=2 * WIDTH, height=2 * HEIGHT) as renderer:
        return Image.fromarray(renderer.rgb(data, CAMERA.name)).resize((WIDTH, HEIGHT), Image.Resampling.LANCZOS)


def main() -> None:
    """Draw the arms beside each other."""
    sheet = Image.new("RGB", (len(SHOWN) * WIDTH, HEIGHT))
    for index, (name, drawn) in enumerate(SHOWN):
        sheet.paste(picture(name, drawn=drawn), (index * WIDTH, 0))
    sheet.save(OUT, quality=88)


if __name__ == "__main__":
    main()
