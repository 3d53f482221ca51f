"""What is written into the frames of a film: method, distance, end, the tip enlarged, and what the cameras saw."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from kinreach._checks import Floats
from kinreach._statistics import number
from kinreach.plots import INK
from kinreach.plots.inside import method_colours
from kinreach.sim.inside import BALL, CAMERA, OBJECT, Scene, mujoco
from kinreach.vision.inside import BallFix, GoalMeasurement

#: Width and height of a film [pixels].
SIZE = (960, 540)
REACHED, MISSED = "#1a7f37", "#b42318"
#: Radii of the view of the tip [mm]: the smallest that the distance fits into is shown.
RADII = (1.0, 10.0, 100.0)
#: Radius of that view, and distance of things from the border of the frame [pixels].
VIEW, MARGIN = 74, 18
#: Width of the cameras' pictures, and how far from the ball the circle around it is drawn [pixels].
LOOK, AROUND = 240, 5
FOUND = "#ffd400"


class Moment(NamedTuple):
    """What a frame shows.

    Attributes:
        offset: From the goal to the tip as the camera sees it, to the right and up [m], shape (2,).
        distance: Of tip and goal [m].
    """

    offset: Floats
    distance: float


class Caption:
    """Follows a scene, and writes into its frames.

    Attributes:
        goal: Of the episode, where the scene has no ball [m], shape (3,).
    """

    #: Colours that it writes with, besides the policy's.
    COLOURS = ("#ffffff", INK, REACHED, MISSED, FOUND, "#b8b8b8", "#dc0a08")

    def __init__(self, policy: str, *, done: str = "reached") -> None:
        self.done = done
        self.name = policy
        self.colour = method_colours([self.name])[self.name]
        self.goal: Any = None
        self.verdict, self.reached = "", False
        self._looks: list[Image.Image] = []
        self._moments: list[Moment | None] = []

    def follow(self, scene: Scene) -> None:
        """Remember where tip and goal are in the frame that was just drawn."""
        model, data = scene.model, scene.data
        thing, ball = (mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) for name in (OBJECT, BALL))
        goal = self.goal if ball < 0 else data.mocap_pos[model.body_mocapid[ball]] if thing < 0 else data.xpos[thing]
        if goal is None:
            self._moments.append(None)
            return
        away = data.site_xpos[model.nsite - 1] - np.asarray(goal)
        axes = data.cam_xmat[mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, CAMERA)].reshape(3, 3)
        self._moments.append(Moment(away @ axes[:, :2], float(np.linalg.norm(away))))

    def see(self, names: Sequence[str], look: GoalMeasurement | None) -> None:
        """Show from now on what the cameras of these names saw, with a circle around the ball that was found."""
        seen = () if look is None else zip(names, look.images, look.fixes, strict=True)
        self._looks = [_circled(name, image.rgb, fix) for name, image, fix in seen]

    def moments(self, count: int) -> list[Moment | None]:
        """Return what the last frames showed, and forget all."""
        found, self._moments = self._moments[-count:], []
        return found

    def write(self, frame: Any, moment: Moment | None) -> Any:
        """Return a frame with everything written in."""
        image = Image.fromarray(frame)
        bottom = SIZE[1] - MARGIN
        for look in reversed(self._looks):
            bottom -= look.height
            image.paste(look, (MARGIN, bottom))
        draw = ImageDraw.Draw(image)
        height = 116 if self.verdict else 82
        draw.rounded_rectangle((MARGIN, MARGIN, MARGIN + 300, MARGIN + height), 8, fill="white")
        draw.ellipse((MARGIN + 14, MARGIN + 17, MARGIN + 28, MARGIN + 31), fill=self.colour)
        draw.text((MARGIN + 38, MARGIN + 10), self.name, font=_font(22, bold=True), fill=INK)
        distance = "" if moment is None else f"distance {number(1e3 * moment.distance)} mm"
        draw.text((MARGIN + 14, MARGIN + 44), distance, font=_font(22), fill=INK)
        if self.verdict:
            colour = REACHED if self.reached else MISSED
            draw.text((MARGIN + 14, MARGIN + 78), self.verdict, font=_font(22, bold=True), fill=colour)
        if moment is not None and 1e3 * moment.distance <= RADII[-1]:
            self._enlarge(draw, moment)
        return np.asarray(image)

    def _enlarge(self, draw: ImageDraw.ImageDraw, moment: Moment) -> None:
        """Draw the goal as a cross and the tip as a dot, within a circle of a radius that is written beside it."""
        radius = next(radius for radius in RADII if 1e3 * moment.distance <= radius)
        x, y = SIZE[0] - MARGIN - VIEW - 10, MARGIN + VIEW + 10
        draw.rounded_rectangle((x - VIEW - 10, y - VIEW - 10, x + VIEW + 10, y + VIEW + 36), 8, fill="white")
        for share in (1.0, 0.5):
            r = round(share * VIEW)
            draw.ellipse((x - r, y - r, x + r, y + r), outline="#b8b8b8", width=1)
        draw.line((x - 9, y, x + 9, y), fill="#dc0a08", width=3)
        draw.line((x, y - 9, x, y + 9), fill="#dc0a08", width=3)
        across, up = 1e3 * moment.offset / radius * VIEW
        draw.ellipse((x + across - 6, y - up - 6, x + across + 6, y - up + 6), fill=self.colour)
        text = f"tip, circle: {radius:g} mm"
        font = _font(15)
        draw.text((x - draw.textlength(text, font=font) / 2, y + VIEW + 10), text, font=font, fill=INK)


def _circled(name: str, rgb: Any, fix: BallFix | None) -> Image.Image:
    """Return a camera's picture with its name, and a circle around the ball."""
    scale = LOOK / rgb.shape[1]
    picture = Image.fromarray(rgb).resize((LOOK, round(scale * rgb.shape[0])))
    if fix is not None:
        u, v, r = (scale * part for part in fix.circle)
        box = (u - r - AROUND, v - r - AROUND, u + r + AROUND, v + r + AROUND)
        ImageDraw.Draw(picture).ellipse(box, outline=FOUND, width=3)
    whole = Image.new("RGB", (LOOK + 4, picture.height + 26), "white")
    whole.paste(picture, (2, 24))
    text = f"{name} camera: ball {'found' if fix is not None else 'not found'}"
    ImageDraw.Draw(whole).text((8, 2), text, font=_font(15), fill=INK)
    return whole


@cache
def _font(size: int, *, bold: bool = False) -> Any:
    folder = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    return ImageFont.truetype(str(folder / f"DejaVuSans{'-Bold' * bold}.ttf"), size)
