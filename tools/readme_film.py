"""The README's film: `python -m tools.readme_film` writes docs/images/ur5e.gif; it needs OpenGL.

What it shows is `COMMAND` in four steps: a pose as on the pendant, the postures that reach it, the way around a box as
it ran in MuJoCo, and the program.
"""

from __future__ import annotations

import argparse
import shlex
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib
import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.cluster.vq import kmeans2

from kinreach._checks import Floats
from kinreach.cli import Parser, finish
from kinreach.deploy._move_cli import _parser
from kinreach.deploy._moving import MotionFlags, TriedMotion
from kinreach.robots import CameraMount, get_arm
from kinreach.sim._rendering import FrameRenderer
from kinreach.sim._scene import BALL, scene_model
from kinreach.view._draw import BRANCH_COLOURS

PROG = "python -m tools.readme_film"
FILE = Path(__file__).parents[1] / "docs/images/ur5e.gif"
#: The command that the film shows, which the README has, and its goal.
GOAL = "-0.45,0.3,0.2,3.14,0,0"
COMMAND = (
    f"kinreach move --arm ur5e --from -130,-90,90,-90,-90,0 --degrees --to {GOAL} "
    "--box 0,0.47,0.21,0.08,0.34,0.42 --speed 0.5 --blend 0.05 --script motion.script"
)
WIDTH, HEIGHT = 720, 450
#: Milliseconds of a frame, and colours of the file.
FRAME_MS, COLOURS = 60, 256
CAMERA = CameraMount("overview", "world", (1.62, -0.22, 0.82), (0.12, 0.02, 0.32), fovy=38.0)
#: Frames: that a step stands still, that a posture takes to appear, that all take to go, and that the arm takes back.
STILL, APPEARS, GOES, BACK = 14, 4, 8, 22
#: How much of a posture is seen, and its colour if it collides.
OPACITY, RED = 0.6, (214, 30, 30)
#: Letters of a step and of code [pixels].
STEP, CODE = 25, 19
#: Length of the target's axes [m], and their colours.
AXIS, AXES = 0.12, ((214, 48, 49), (39, 145, 80), (40, 100, 200))

Pixels = NDArray[np.uint8]


class Stage:
    """The scene of a motion, drawn from one place.

    Attributes:
        empty: Depths without the arm [m].
    """

    def __init__(self, motion: TriedMotion) -> None:
        arm = replace(motion.kinematics.arm, cameras=(CAMERA,))
        self.model: Any = scene_model(arm)
        self.data: Any = mujoco.MjData(self.model)
        self._qpos = [int(self.model.joint(name).qposadr[0]) for name in arm.joints]
        self.model.geom_rgba[self.model.geom_bodyid == self.model.body(BALL).id, 3] = 0.0
        self._renderer = FrameRenderer(self.model, width=WIDTH, height=HEIGHT)
        base = self.model.body("base_link").id
        own = [self._carries(body, base) for body in range(self.model.nbody)]
        links, colours = np.array(own)[self.model.geom_bodyid], self.model.geom_rgba.copy()
        self.model.geom_rgba[links, 3] = 0.0
        self.empty = self._renderer.depth(self.data, CAMERA.name).copy()
        self.model.geom_rgba[:] = colours

    def _carries(self, body: int, base: int) -> bool:
        while body not in (0, base):
            body = int(self.model.body_parentid[body])
        return body == base

    def at(self, q: Floats) -> Pixels:
        """Draw a posture (6,) [rad]."""
        self.data.qpos[self._qpos] = q
        return self._renderer.rgb(self.data, CAMERA.name).copy()

    def depth(self, q: Floats) -> NDArray[np.float32]:
        """Return the distance of what each pixel shows [m]."""
        self.data.qpos[self._qpos] = q
        return self._renderer.depth(self.data, CAMERA.name).copy()

    def point(self, position: Floats) -> tuple[float, float]:
        """Return where a point of the world [m] is in the picture."""
        forward = np.array(CAMERA.target) - CAMERA.position
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, (0, 0, 1))
        right /= np.linalg.norm(right)
        x, y, z = np.array([right, np.cross(forward, right), forward]) @ (position - CAMERA.position)
        focal = HEIGHT / 2 / np.tan(np.radians(CAMERA.fovy) / 2)
        return WIDTH / 2 + focal * x / z, HEIGHT / 2 + focal * y / z


def frames(motion: TriedMotion) -> Iterator[Image.Image]:
    """The four steps, and the way back to the first frame."""
    stage, kin = Stage(motion), motion.kinematics
    T = kin.T_world_base @ motion.goals[0]
    start, path = motion.start, motion.done.commanded
    first = stage.at(start)
    pose = f"p[{GOAL.replace(',', ', ')}]"
    step = "1  A pose from the pendant"
    for count in range(STILL + 12):
        shown = "" if count < 4 else pose
        yield lettered(first, step, [shown] if shown else [], stage=stage, T=T if shown else None)

    solutions = kin.all_solutions(motion.goals[0], seed=start)
    free = [bool(motion.checker.free(q)) for q in solutions.q]
    here = stage.depth(start)
    ghosts = []
    for q, branch, usable in zip(solutions.q, solutions.branch, free, strict=True):
        depth = stage.depth(q)
        seen = (depth < stage.empty - 1e-3) & (depth < here - 1e-3)
        colour = BRANCH_COLOURS[int(branch)] if usable else RED
        ghosts.append((seen, 0.35 * stage.at(q) + 0.65 * np.array(colour)))

    def with_ghosts(opacities: Sequence[float]) -> Pixels:
        mixed = first.astype(float)
        for opacity, (seen, tinted) in zip(opacities, ghosts, strict=True):
            mixed[seen] += opacity * (tinted - mixed)[seen]
        return mixed.astype(np.uint8)

    total = len(ghosts)
    step = f"2  {total} postures reach it, {sum(free)} are free"
    for count in range(APPEARS * total + STILL):
        opacities = [OPACITY * float(np.clip(count / APPEARS - index, 0, 1)) for index in range(total)]
        number = min(count // APPEARS + 1, total)
        lines = [f"{number} of {total}"]
        yield lettered(with_ghosts(opacities), step, lines, stage=stage, T=T)
    nearest = int(np.abs(solutions.q - path.q[-1]).max(axis=1).argmin())
    for count in range(2 * GOES):  # the one that is chosen goes last
        opacities = [OPACITY * float(np.clip((index == nearest) + 1 - count / GOES, 0, 1)) for index in range(total)]
        yield lettered(with_ghosts(opacities), step, [f"{total} of {total}"], stage=stage, T=T)

    step = "3  The way around the box, tried in MuJoCo"
    for time in np.arange(0.0, path.t[-1] + FRAME_MS / 1000, FRAME_MS / 1000):
        q = path.at(min(time, path.t[-1]))[0]
        yield lettered(stage.at(q), step, [f"{min(time, path.t[-1]):.1f} s"], stage=stage, T=T)

    step = "4  The program for the robot"
    last = stage.at(path.q[-1])
    program = [line.strip() for line in motion.program.text.splitlines()]
    lines = [program[0], *(short(line) for line in program if line.startswith("movej(["))]
    for count in range(6 * len(lines) + 2 * STILL):
        yield lettered(last, step, lines[: count // 6 + 1], stage=stage, T=T)
    for count in range(1, BACK):
        share = count / BACK
        share = share * share * (3 - 2 * share)
        yield lettered(stage.at(path.at((1 - share) * path.t[-1])[0]), "", [], stage=stage)


def short(line: str) -> str:
    """Write a motion of a program so that it fits into the picture: joint angles with two decimals."""
    name, numbers = line.split("([")
    angles = ", ".join(f"{float(number):.2f}" for number in numbers.partition("]")[0].split(","))
    return f"  {name}([{angles}], …)"


def lettered(pixels: Pixels, step: str, lines: Sequence[str], *, stage: Stage, T: Floats | None = None) -> Image.Image:
    """Draw the target's axes into a frame, and what is said above and below."""
    image = Image.fromarray(pixels)
    draw = ImageDraw.Draw(image, "RGBA")
    if T is not None:
        origin = stage.point(T[:3, 3])
        for axis, colour in zip(T[:3, :3].T, AXES, strict=True):
            draw.line([origin, stage.point(T[:3, 3] + AXIS * axis)], fill=colour, width=5)
        draw.ellipse([origin[0] - 6, origin[1] - 6, origin[0] + 6, origin[1] + 6], fill=(30, 30, 35))
    if step:
        draw.text((20, 14), step, font=font("DejaVuSans-Bold", STEP), fill=(25, 30, 38))
    if lines:
        letters = font("DejaVuSansMono", CODE)
        width = max(draw.textlength(line, font=letters) for line in lines)
        top = HEIGHT - 20 - 28 * len(lines)
        draw.rectangle([12, top - 8, 32 + width, HEIGHT - 12], fill=(255, 255, 255, 215))
        for index, line in enumerate(lines):
            draw.text((22, top + 28 * index), line, font=letters, fill=(25, 30, 38))
    return image


def font(name: str, size: int) -> ImageFont.FreeTypeFont:
    """Return letters of matplotlib's."""
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / f"fonts/ttf/{name}.ttf"), size)


def palette_of(images: Sequence[Image.Image]) -> Image.Image:
    """Return colours near to those of every third image, by k-means from an octree's; rare ones weigh more.

    Without it a pale posture in front of the floor is pink in one frame and grey in the next.
    """
    shown = np.concatenate([np.asarray(image) for image in images[::3]])
    octree = Image.fromarray(shown).quantize(COLOURS, Image.Quantize.FASTOCTREE)
    first = np.reshape(octree.getpalette() or [], (-1, 3))[:COLOURS].astype(float)
    colours, counts = np.unique((shown.reshape(-1, 3) // 2).astype(np.int64) @ (1 << 16, 1 << 8, 1), return_counts=True)
    weighed = np.repeat(colours, np.maximum(1, np.sqrt(counts) / 4).astype(int))
    pixels = 2.0 * np.stack([weighed >> 16, weighed >> 8 & 255, weighed & 255], axis=1) + 1.0
    with warnings.catch_warnings(action="ignore"):  # of colours that no pixel is nearest to
        found, _ = kmeans2(pixels, first, iter=12, minit="matrix")
    palette = Image.new("P", (1, 1))
    palette.putpalette(np.round(found).astype(np.uint8).tobytes())
    return palette


def motion() -> TriedMotion:
    """Plan and try what `COMMAND` says."""
    arguments = _parser("kinreach move").parse_args(shlex.split(COMMAND)[2:])
    flags = MotionFlags.of(arguments)
    planner = flags.planner(flags.surrounded(get_arm(arguments.arm)))
    return planner.tried(flags.posture(planner.kinematics))


def main(argv: list[str] | None = None) -> int:
    """Write the film."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=FILE, metavar="FILE", help="default: docs/images/ur5e.gif")
    arguments = parser.parse_args(argv)
    images = list(frames(motion()))
    palette = palette_of(images)
    first, *rest = (image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images)
    first.save(arguments.out, save_all=True, append_images=rest, duration=FRAME_MS, loop=0, optimize=False)
    print(f"{arguments.out}: {len(images)} frames, {arguments.out.stat().st_size / 1e6:.1f} MB")
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
