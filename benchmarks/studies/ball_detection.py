"""How exactly the cameras find the ball: 3-D error and time of both pipelines, cameras and three resolutions.

    python -m benchmarks.studies.ball_detection [--positions 200] [--seed 0]
    python -m benchmarks.studies.ball_detection --picture docs/images/cameras.png

The balls are drawn from the UR5's goal area, its four corners first. Both pipelines get the same pictures.
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.studies.tables import head, line
from kinreach._files import replacing
from kinreach._statistics import p95
from kinreach.cli import Parser, finish
from kinreach.robots import get_arm
from kinreach.sim._rendering import FrameRenderer
from kinreach.sim._simulation import ArmSimulation
from kinreach.vision._ball_finder import PIPELINES, find_ball
from kinreach.vision._cameras import RGBDCamera, SensorNoise
from kinreach.vision._goal_view import CameraGoalView, geometric_goal_view, goals_in_world

PROG = "python -m benchmarks.studies.ball_detection"

CAMERAS = [camera.name for camera in get_arm("ur5-thesis").goal_cameras]
RESOLUTIONS = ((1280, 720), (640, 360), (320, 180))
NOISE = SensorNoise(rgb_sigma=6.0, depth_sigma=0.002)
#: The goal as both cameras together say it: the mean of what they found.
BOTH = "both"
PICTURE_GOAL = (0.47, -0.12, -0.175)

#: Pipeline, whether with noise, camera or `BOTH`, height of the picture.
Case = tuple[str, bool, str, int]


@dataclass
class Measured:
    """Errors [mm] and misses of every case; times [ms] by height and by what was done."""

    errors: dict[Case, list[float]] = field(default_factory=lambda: defaultdict(list))
    misses: dict[Case, int] = field(default_factory=lambda: defaultdict(int))
    times: dict[tuple[int, str], list[float]] = field(default_factory=lambda: defaultdict(list))


def goals_of(count: int, seed: int) -> np.ndarray:
    """Corners of the goal area, then balls drawn from it [m], shape (count, 3)."""
    region = get_arm("ur5-thesis").workcell.goals
    corners = [(x, y, region.z[0]) for x in region.x for y in region.y]
    return np.array([*corners, *region.sample(np.random.default_rng(seed), count)])[:count]


def measure(count: int, seed: int) -> Measured:
    """Show every ball to both cameras at every resolution, without noise and with it."""
    simulation = ArmSimulation("ur5-thesis")
    radius = simulation.arm.workcell.ball_radius
    goals = goals_of(count, seed)
    truth = geometric_goal_view("ur5-thesis", goals).reshape(count, len(CAMERAS), 3)
    result = Measured()
    for width, height in RESOLUTIONS:
        shape = (count, len(CAMERAS), 3)
        views = {(pipeline, noisy): np.full(shape, np.nan) for pipeline in PIPELINES for noisy in (False, True)}
        with FrameRenderer(simulation.model, width=width, height=height, shadows=False) as renderer:
            for index, name in enumerate(CAMERAS):
                camera = RGBDCamera(simulation, name, width=width, height=height, renderer=renderer)
                rng = np.random.default_rng(seed)
                for row, (goal, true) in enumerate(zip(goals, truth[:, index], strict=True)):
                    simulation.place_ball(goal)
                    start = time.perf_counter()
                    clean = camera.capture()
                    result.times[height, "render"].append((time.perf_counter() - start) * 1e3)
                    for noisy, image in ((False, clean), (True, NOISE.apply(clean, rng))):
                        for pipeline in PIPELINES:
                            start = time.perf_counter()
                            fix = find_ball(image.rgb, image.depth, camera.intrinsics, radius, pipeline=pipeline)
                            if not noisy:
                                result.times[height, pipeline].append((time.perf_counter() - start) * 1e3)
                            case = (pipeline, noisy, name, height)
                            if fix is None:
                                result.misses[case] += 1
                            else:
                                views[pipeline, noisy][row, index] = fix.position
                                result.errors[case].append(float(np.linalg.norm(fix.position - true)) * 1e3)
        for (pipeline, noisy), view in views.items():
            found = ~np.isnan(view).any(axis=2)
            off = np.linalg.norm(goals_in_world(simulation.arm, view.reshape(count, -1), found) - goals, axis=1)
            result.errors[pipeline, noisy, BOTH, height] = (1e3 * off[found.any(axis=1)]).tolist()
            result.misses[pipeline, noisy, BOTH, height] = int((~found.any(axis=1)).sum())
    return result


def error_table(result: Measured) -> str:
    """Mean, p95 and largest error [mm] of every case, as Markdown."""
    columns = [(pipeline, noisy) for pipeline in PIPELINES for noisy in (False, True)]
    names = [f"{pipeline}{', noise' if noisy else ''}" for pipeline, noisy in columns]
    lines = [head("camera", *names)]
    for name in (*CAMERAS, BOTH):
        for width, height in RESOLUTIONS:
            cells = [_error_cell(result, (*column, name, height)) for column in columns]
            lines.append(line(f"{name} {width}x{height}", *cells))
    return "\n".join(lines)


def _error_cell(result: Measured, case: Case) -> str:
    errors, misses = np.array(result.errors[case]), result.misses[case]
    cell = f"{errors.mean():.2f} / {p95(errors):.2f} / {errors.max():.2f}" if errors.size else "none found"
    return f"{cell} ({misses} missed)" if misses else cell


def time_table(result: Measured) -> str:
    """Shortest times [ms], as Markdown."""
    steps = ("render", *PIPELINES)
    lines = [head("picture", "render RGB and depth", *(f"find, {pipeline}" for pipeline in PIPELINES))]
    for width, height in RESOLUTIONS:
        cells = [f"{min(result.times[height, step]):.1f}" for step in steps]
        lines.append(line(f"{width}x{height}", *cells))
    return "\n".join(lines)


def draw(path: Path) -> None:
    """Both cameras' pictures of a typical goal, the found circle and its 3-D error drawn in, as a PNG file."""
    from matplotlib.patches import Circle

    from kinreach.plots._style import new_figure

    simulation = ArmSimulation("ur5-thesis")
    simulation.place_ball(PICTURE_GOAL)
    with CameraGoalView("ur5-thesis") as view:
        look = view.measure(simulation)
    truth = geometric_goal_view("ur5-thesis", PICTURE_GOAL).reshape(-1, 3)
    note = f"the ball at {PICTURE_GOAL} m in the world; its true centre is known to the simulation"
    figure, axes = new_figure("Where each camera finds the ball", size=(9.0, 3.4), columns=2, note=note, bare=True)
    for ax, name, image, fix, true in zip(axes, CAMERAS, look.images, look.fixes, truth, strict=True):
        ax.imshow(image.rgb)
        if fix is None:
            ax.set_title(f"{name} camera: no ball found", loc="left", fontsize=11)
            continue
        u, v, r = fix.circle
        error = np.linalg.norm(fix.position - true) * 1e3
        ax.set_title(f"{name} camera · {error:.2f} mm off", loc="left", fontsize=11)
        left = u > view.width / 2
        inset = ax.inset_axes((0.02 if left else 0.68, 0.035, 0.30, 0.533))
        inset.imshow(image.rgb)
        inset.set(xlim=(u - 2 * r, u + 2 * r), ylim=(v + 2 * r, v - 2 * r), xticks=[], yticks=[])
        inset.plot(u, v, "+", color="white", markersize=12)
        for connector in ax.indicate_inset_zoom(inset, edgecolor="black", alpha=0.8).connectors or ():
            connector.set_visible(False)
        for target in (ax, inset):
            target.add_patch(Circle((u, v), r, fill=False, color="lime", linewidth=1.5))
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=180)


def main(argv: list[str] | None = None) -> int:
    """Print the tables, or draw the picture."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--positions", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--picture", type=Path, help="only draw what the cameras see, to this PNG file")
    args = parser.parse_args(argv)
    if args.positions < 1:
        parser.error(f"--positions must be at least 1, got {args.positions}")
    if args.picture:
        draw(args.picture)
        return 0
    result = measure(args.positions, args.seed)
    print(f"{error_table(result)}\n\n{time_table(result)}")
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
