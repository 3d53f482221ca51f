"""How `Push-v0` and `PickAndPlace-v0` begin: `python -m tools.objects_picture` writes docs/images/objects.jpg.

It needs OpenGL.
"""

from __future__ import annotations

from pathlib import Path

import gymnasium as gym
import numpy as np
from PIL import Image

import kinreach  # noqa: F401 (registers the environments)

OUT = Path(__file__).resolve().parents[1] / "docs/images/objects.jpg"
IDS = ("kinreach/Push-v0", "kinreach/PickAndPlace-v0")
SEED = 1


def picture(name: str) -> Image.Image:
    """Draw an environment after its reset."""
    env = gym.make(name, render_mode="rgb_array")
    env.reset(seed=SEED)
    frame = np.asarray(env.render(), dtype=np.uint8)
    env.close()
    return Image.fromarray(frame)


def main() -> None:
    """Draw the two beside each other."""
    left, right = (picture(name) for name in IDS)
    # the arm and the table, without the floor beside them
    box = (150, 0, 560, left.height)
    width = box[2] - box[0]
    sheet = Image.new("RGB", (2 * width, left.height))
    sheet.paste(left.crop(box), (0, 0))
    sheet.paste(right.crop(box), (width, 0))
    sheet.save(OUT, quality=90)


if __name__ == "__main__":
    main()
