"""What the methods are told about a goal: where it truly is, or where the cameras of the environments saw it.

A goal is looked at once, before any method decides: all of them are told of the same look. Solvers are told a position,
policies are given what each camera measured, as the environment's agent is. The cameras, the ways of finding the ball
and the noise are those of the environments.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from kinreach.checks import Floats
from kinreach.compare.tasks import ReachTask
from kinreach.envs.reach.options import check_cameras
from kinreach.sim.simulation import ArmSimulation
from kinreach.vision.cameras import SensorNoise
from kinreach.vision.goal_view import CameraGoalView, goal_in_world

CAMERA, GEOMETRIC = "camera", "geometric"

#: Seed of the goals that are looked at, and decided on, before those that are timed: the first look loads the graphics
#: library, and first decisions fill caches. It is above all seeds of comparisons (`kinreach.compare.settings`), so that
#: none of these goals is ever compared.
WARM_UP_SEED = 2**63


@dataclass(frozen=True)
class CameraSettings:
    """How the cameras look, with the names and values of the environments' options.

    Attributes:
        pipeline: How the ball is found in the pictures, `"hybrid"` or `"thesis"`.
        width, height: Size of the pictures [pixels]; the thesis's are 1280x720.
        rgb_noise: Standard deviation of the colours' noise [levels of 255].
        depth_noise: Standard deviation of the depth's noise [m].

    Raises:
        UnknownNameError: There is no such pipeline.
        InputError: A size or a noise that cannot be.
    """

    pipeline: str = "hybrid"
    width: int = 640
    height: int = 360
    rgb_noise: float = 0.0
    depth_noise: float = 0.0

    def __post_init__(self) -> None:
        check_cameras(self.pipeline, self.width, self.height, self.rgb_noise, self.depth_noise)

    def __str__(self) -> str:
        noise = f"noise {self.rgb_noise:g} levels, {1e3 * self.depth_noise:g} mm"
        return (
            f"{self.pipeline} pipeline, {self.width}x{self.height}, "
            f"{noise if self.rgb_noise or self.depth_noise else 'no noise'}"
        )


@dataclass(frozen=True, eq=False)
class Sight:
    """What is known of a goal before it is solved.

    Attributes:
        position: Where the methods are told it is, in the world [m], shape (3,); None if no camera found the ball.
        look_s: Wall time of the look [s]; None where nobody looked and the position is the true one.
        view: Where each of the two cameras saw it, in its own frame [m], shape (6,), with zeros for one that did not
            find the ball; None where nobody looked.
    """

    position: Floats | None
    look_s: float | None = None
    view: Floats | None = None


#: Index of a goal and where it truly is, in the world [m], shape (3,), to what the methods are told.
Look = Callable[[int, Floats], Sight]


def true_position(index: int, position: Floats) -> Sight:
    """What perfect cameras say; the `Look` of the geometric observation."""
    return Sight(position)


def what_is_told(camera: CameraSettings | None) -> str:
    """What the methods are told about a goal, in words, for the record beside the results."""
    if camera is None:
        return "geometric: every method is told where the goal truly is, policies as perfect cameras would say it"
    return (
        f"camera: every method is told where the arm's two cameras saw the ball from the start posture, solvers the "
        f"mean of those that found it, policies what each of them measured, zeros for one that did not find it "
        f"({camera}); the verdict is about the true ball; a ball that none found is impossible"
    )


@contextmanager
def looking(task: ReachTask, camera: CameraSettings | None, seed: int) -> Iterator[Look]:
    """How goals are looked at, until the context ends.

    Args:
        task: Whose arm looks, from its start posture.
        camera: How the cameras look; None for the true position.
        seed: Of the sensors' noise, together with the index of the goal: a goal is seen alike whatever was looked at
            before it.

    Raises:
        InstallationError: There is no library to draw with; the message names the packages.
        InputError: Pictures larger than the scene's off-screen buffer.
    """
    if camera is None:
        yield true_position
        return
    noise = SensorNoise(rgb_sigma=camera.rgb_noise, depth_sigma=camera.depth_noise)
    simulation = ArmSimulation(task.arm)  # of its own, never moved: always in the start posture
    with CameraGoalView(
        task.arm, width=camera.width, height=camera.height, pipeline=camera.pipeline, noise=noise
    ) as view:

        def look(index: int, position: Floats) -> Sight:
            rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))
            simulation.place_ball(position)
            start = time.perf_counter()
            seen = view.look(simulation, rng)
            told = goal_in_world(task.arm, seen.values, seen.found)
            return Sight(told, time.perf_counter() - start, seen.values)

        look(0, task.goals(1, WARM_UP_SEED)[0])
        yield look
