"""Whether the ball is found in other light and beside other things: both pipelines on the same pictures, 640x360.

    python -m benchmarks.studies.light_and_clutter [--positions 100] [--seed 0]
    python -m benchmarks.studies.light_and_clutter --picture docs/images/light.png

Lamps are turned up and down in the scene, and things are put into it; a gradient is one of the picture, and noise comes
last, as in a camera. Balls are those of `ball_detection`.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.studies.ball_detection import NOISE, PICTURE_GOAL, goals_of
from benchmarks.studies.tables import head, line, share
from kinreach._files import replacing
from kinreach._statistics import median, p95
from kinreach.cli import Parser, finish
from kinreach.robots import get_arm
from kinreach.sim._engine import mujoco
from kinreach.sim._rendering import FrameRenderer
from kinreach.sim._scene import BALL, BALL_COLOUR, build_scene
from kinreach.vision._ball_finder import PIPELINES, find_ball
from kinreach.vision._cameras import Intrinsics, RGBDImage, SensorNoise
from kinreach.vision._goal_view import geometric_goal_view, goal_camera_poses

PROG = "python -m benchmarks.studies.light_and_clutter"

WIDTH, HEIGHT = 640, 360
#: A ball that is off by more than reaching allows is worse than none [m].
WRONG = 0.01
NO_NOISE = SensorNoise()
COLOURS = {"hybrid": "lime", "thesis": "deepskyblue"}
PICTURE_SEED = 2
AWAY = (0.0, 0.0, -50.0)
ARM = get_arm("ur5-thesis")
CAMERAS = [camera.name for camera in ARM.goal_cameras]
RADIUS = ARM.workcell.ball_radius
#: Edge of a square as large as the ball's disk [m].
EDGE = RADIUS * np.sqrt(np.pi)
#: Things that can be put into the scene: shape, half sizes [m], colour.
THINGS: dict[str, tuple[str, Sequence[float], tuple[float, float, float, float]]] = {
    "square": ("BOX", (EDGE / 2, EDGE / 2, 5e-4), BALL_COLOUR),
    "green ball": ("SPHERE", (RADIUS, 0, 0), (0.05, 0.55, 0.12, 1.0)),
    "orange ball": ("SPHERE", (RADIUS, 0, 0), (0.90, 0.45, 0.05, 1.0)),
    "screen": ("BOX", (0.05, 0.05, 5e-4), (0.45, 0.45, 0.47, 1.0)),
}


@dataclass(frozen=True)
class Situation:
    """What is seen.

    Attributes:
        name: Of the row.
        light: All lamps, against the usual.
        gradient: Brightness at the dark and at the bright edge of the picture, against that of the scene.
        noise: Of the sensor.
        thing: What lies somewhere beside the ball, key of `THINGS`.
        facing: Whether it is where the ball would be instead, and faces the camera.
        hidden: Whether a screen hides half of the ball.
        ball: Whether there is a ball.
    """

    name: str
    light: float = 1.0
    gradient: tuple[float, float] = (1.0, 1.0)
    noise: SensorNoise = NO_NOISE
    thing: str | None = None
    facing: bool = False
    hidden: bool = False
    ball: bool = True


SITUATIONS = (
    *(Situation(f"light x {light:g}", light=light) for light in (0.25, 0.35, 0.5, 1.0, 1.5, 2.0)),
    Situation("gradient 0.25 to 1.75", gradient=(0.25, 1.75)),
    Situation("noise", noise=NOISE),
    Situation("noise, light x 0.25", light=0.25, noise=NOISE),
    Situation("noise, light x 0.5", light=0.5, noise=NOISE),
    Situation("a red square beside it", thing="square"),
    Situation("a green ball beside it", thing="green ball"),
    Situation("an orange ball beside it", thing="orange ball"),
    Situation("half hidden", hidden=True),
    Situation("a red square, no ball", thing="square", ball=False),
    Situation("a red square held up, no ball", thing="square", facing=True, ball=False),
    Situation("an orange ball, no ball", thing="orange ball", ball=False),
)


class Studio:
    """The scene with things to put into it; to be closed."""

    def __init__(self) -> None:
        spec = build_scene(ARM, visual=False)
        for name, (shape, size, colour) in THINGS.items():
            body = spec.worldbody.add_body(name=name, mocap=True, pos=AWAY)
            kind = getattr(mujoco.mjtGeom, f"mjGEOM_{shape}")
            body.add_geom(type=kind, size=size, rgba=colour, contype=0, conaffinity=0)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key("home").id)
        head, lamps = self.model.vis.headlight, self.model
        self._lamps = [head.ambient, head.diffuse, head.specular, lamps.light_diffuse, lamps.light_specular]
        self._usual = [lamp.copy() for lamp in self._lamps]
        self._renderer = FrameRenderer(self.model, width=WIDTH, height=HEIGHT, shadows=False)
        self.intrinsics = {mount.name: Intrinsics.from_fovy(mount.fovy, WIDTH, HEIGHT) for mount in ARM.cameras}

    def close(self) -> None:
        """Free the renderers' graphics memory."""
        self._renderer.close()

    def take(self, situation: Situation, camera: str, goal: np.ndarray, rng: np.random.Generator) -> RGBDImage:
        """What a camera sees of a ball at `goal` in the world [m], and of what is beside it."""
        for lamp, usual in zip(self._lamps, self._usual, strict=True):
            lamp[:] = situation.light * usual
        for name in (BALL, *THINGS):
            self._put(name, AWAY)
        if situation.ball:
            self._put(BALL, goal)
        if situation.facing:
            turn = np.empty(4)
            mujoco.mju_mat2Quat(turn, goal_camera_poses(ARM)[CAMERAS.index(camera)][:3, :3].ravel())
            self._put(situation.thing, goal, turn)
        elif situation.thing is not None:
            away, angle = rng.uniform(0.06, 0.15), rng.uniform(-np.pi, np.pi)
            height = 0.0 if "ball" in situation.thing else 1e-3 - RADIUS
            self._put(situation.thing, goal + np.array([away * np.cos(angle), away * np.sin(angle), height]))
        if situation.hidden:
            self._hide(camera, goal, rng.uniform(-np.pi, np.pi))
        rgb = self._renderer.rgb(self.data, camera).astype(np.float32)
        dark, bright = situation.gradient
        angle = rng.uniform(-np.pi, np.pi)
        rows, columns = np.mgrid[-1 : 1 : HEIGHT * 1j, -1 : 1 : WIDTH * 1j]
        along = (rows * np.sin(angle) + columns * np.cos(angle)) / (abs(np.sin(angle)) + abs(np.cos(angle)))
        rgb *= (dark + (bright - dark) * (along + 1) / 2)[..., None].astype(np.float32)
        image = RGBDImage(rgb.clip(0, 255).astype(np.uint8), self._renderer.depth(self.data, camera))
        return situation.noise.apply(image, rng)

    def _put(self, name: str, place: Any, turn: Any = (1.0, 0.0, 0.0, 0.0)) -> None:
        index = self.model.body(name).mocapid[0]
        self.data.mocap_pos[index], self.data.mocap_quat[index] = place, turn

    def _hide(self, camera: str, goal: np.ndarray, angle: float) -> None:
        """A screen between a camera and the ball, its edge in the middle of the ball and at an angle in the picture."""
        T = goal_camera_poses(ARM)[CAMERAS.index(camera)]
        aside = np.cos(angle) * T[:3, 0] + np.sin(angle) * T[:3, 1]
        turn = np.empty(4)
        axes = np.column_stack([aside, np.cross(T[:3, 2], aside), T[:3, 2]])
        mujoco.mju_mat2Quat(turn, axes.ravel())
        half = THINGS["screen"][1][0]
        self._put("screen", 0.3 * T[:3, 3] + 0.7 * goal + half * aside, turn)


def measure(studio: Studio, situation: Situation, count: int, seed: int) -> dict[tuple[str, str], np.ndarray]:
    """Errors [m] by pipeline and camera, shape (count,): NaN where nothing was found, infinite for what is no ball."""
    goals = goals_of(count, seed)
    truth = geometric_goal_view(ARM, goals).reshape(count, len(CAMERAS), 3)
    errors = {(pipeline, camera): np.full(count, np.nan) for pipeline in PIPELINES for camera in CAMERAS}
    for index, camera in enumerate(CAMERAS):
        rng = np.random.default_rng([seed, index])
        for row, goal in enumerate(goals):
            image = studio.take(situation, camera, goal, rng)
            for pipeline in PIPELINES:
                fix = find_ball(image.rgb, image.depth, studio.intrinsics[camera], RADIUS, pipeline=pipeline)
                if fix is not None:
                    off = float(np.linalg.norm(fix.position - truth[row, index]))
                    errors[pipeline, camera][row] = off if situation.ball else np.inf
    return errors


def table(studio: Studio, count: int, seed: int) -> str:
    """A row for each situation, both cameras together, as Markdown."""
    what = ("found, % [95 % CI]", "wrong, % [95 % CI]", "median / p95, mm")
    columns = [f"{pipeline}: {one}" for pipeline in PIPELINES for one in what]
    lines = [head("situation", *columns)]
    for situation in SITUATIONS:
        errors = measure(studio, situation, count, seed)
        cells = []
        for pipeline in PIPELINES:
            mm = 1e3 * np.concatenate([errors[pipeline, camera] for camera in CAMERAS])
            found = mm[~np.isnan(mm)]
            right = found[found <= 1e3 * WRONG]
            spread = f"{median(right):.2f} / {p95(right):.2f}" if len(right) else "-"
            cells += [share(len(found), len(mm)), share(len(found) - len(right), len(mm)), spread]
        lines.append(line(situation.name, *cells))
    return "\n".join(lines)


def draw(studio: Studio, path: Path) -> None:
    """What the front camera sees in each situation and what was found, as a PNG file."""
    from matplotlib.patches import Circle

    from kinreach.plots._style import INK, new_figure

    shown = [situation for situation in SITUATIONS if situation.ball]
    goal = np.array(PICTURE_GOAL)
    truth = geometric_goal_view(ARM, goal).reshape(-1, 3)[0]
    title = "What each pipeline finds in other light, and beside other things"
    figure, axes = new_figure(title, size=(9.4, 7.4), rows=-(-len(shown) // 5), columns=5, bare=True)
    u, v = studio.intrinsics["front"].project(truth)
    for ax, situation in zip(axes, shown, strict=False):
        image = studio.take(situation, "front", goal, np.random.default_rng(PICTURE_SEED))
        ax.imshow(image.rgb)
        ax.set(xlim=(u - 80, u + 80), ylim=(v + 70, v - 70))
        lines = []
        for (pipeline, colour), width in zip(COLOURS.items(), (2.2, 1.2), strict=True):
            fix = find_ball(image.rgb, image.depth, studio.intrinsics["front"], RADIUS, pipeline=pipeline)
            if fix is None:
                lines.append(f"{pipeline}: not found")
                continue
            lines.append(f"{pipeline}: {1e3 * np.linalg.norm(fix.position - truth):.1f} mm off")
            ax.add_patch(Circle((fix.circle.u, fix.circle.v), fix.circle.r, fill=False, color=colour, linewidth=width))
        ax.set_title(situation.name, fontsize=9, weight="bold", color=INK, loc="left", pad=27)
        ax.annotate("\n".join(lines), (0, 1.02), xycoords="axes fraction", fontsize=8.5, color=INK, va="bottom")
    rest = axes[len(shown) :]
    if rest:
        for place, (pipeline, colour) in enumerate(COLOURS.items()):
            rest[0].plot(0.1, 0.75 - 0.2 * place, "o", ms=14, mfc="none", mec=colour, mew=2.5)
            rest[0].annotate(f"found by\n{pipeline}", (0.25, 0.75 - 0.2 * place), fontsize=9, va="center")
        rest[0].set(xlim=(0, 1), ylim=(0, 1))
    with replacing(path) as temporary:
        figure.savefig(temporary)


def main(argv: list[str] | None = None) -> int:
    """Print the table, or draw the picture."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--positions", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--picture", type=Path, help="only draw what is found, to this PNG file")
    args = parser.parse_args(argv)
    if args.positions < 1:
        parser.error(f"--positions must be at least 1, got {args.positions}")
    with closing(Studio()) as studio:
        if args.picture:
            draw(studio, args.picture)
        else:
            print(table(studio, args.positions, args.seed))
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
