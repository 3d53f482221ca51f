"""Lifting: scripted grasps with the solvers, trained policies, and what fails where."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from matplotlib.figure import Figure

from kinreach._checks import Floats, listed
from kinreach._registration import LIFT
from kinreach._rotations import turn
from kinreach._statistics import MEAN, QUANTILES, RATE, Column, Trial, thousandfold
from kinreach.compare._button import decision_ms
from kinreach.compare._figures import origin
from kinreach.compare._methods.resolve import policy_method
from kinreach.compare._tabletop import scene_with_object
from kinreach.compare._task import SOLVER, Method, Task, episode_seed, of_reached
from kinreach.envs.inside import lift_task
from kinreach.kinematics import PoseGoal, Solver
from kinreach.kinematics.inside import new_solver
from kinreach.plots import new_figure
from kinreach.plots.inside import name_label
from kinreach.robots import THESIS_ARM
from kinreach.sim.inside import Scene

#: Stages at which a grasp can fail, in their order, and how tables and figures call them.
_STAGES = {
    "seen": "not seen",
    "reached": "not reached",
    "closed": "not closed",
    "slipped": "slipped",
    "dropped": "dropped",
}
CAUSES = tuple(_STAGES)
#: Title of the second table.
TIME_TABLE = "Distances and times"
#: How much narrower than the object the fingers are set [m], so that each presses with its whole force, 120 N.
SQUEEZE = 0.024
#: Least height of the tip above the table [m]; the fingers end 10 mm beyond it.
MIN_HEIGHT = 0.012
#: Least distance from an object to the finger that its size brings near the tip, while that is open [m].
BESIDE = 0.004
#: Turns of the fingers that are tried around a ball or a cylinder; a cube has one for each pair of faces.
TURNS = 6
UP = np.array([0.0, 0.0, 1.0])


def _resets(count: int, seed: int, env: gym.Env[Any, Any]) -> Sequence[Mapping[str, Any]]:
    return [{"seed": episode_seed(seed, index)} for index in range(count)]


def _failed(cause: str) -> Callable[[Trial], bool]:
    return lambda trial: trial["cause"] == cause


def _scripted(name: str) -> Method:
    return Method(lambda env: GraspPolicy(new_solver(name, env.unwrapped.kinematics), env), SOLVER)  # type: ignore[attr-defined]


def _scene(env: gym.Env[Any, Any], trial: Trial) -> Scene:
    return scene_with_object(env, trial, {name: trial[name] for name in ("shape", "size", "mass", "friction")})


def draw_causes(trials: Sequence[Trial], results: Mapping[str, Any]) -> Figure:
    """Draw the share that each method lifts, and what failed in the rest."""
    methods, shades = results["methods"], ("#111111", "#444444", "#777777", "#a6a6a6", "#d0d0d0")
    shapes = results["settings"]["options"].get("shapes", ("object",))
    figure, (axes,) = new_figure(
        f"{listed([f'{shape}s' for shape in shapes])} lifted, and what failed".capitalize(),
        size=(8.0, 1.3 + 0.5 * len(methods)),
        grid="x",
        note=f"the first stage that failed in the last attempt · {origin(results)}",
    )
    for row, method in enumerate(methods):
        left = 100.0 * method["reached"]
        axes.barh(row, left, color=method["colour"], height=0.6)
        axes.text(1.0, row, f"{left:.1f}", va="center", color="white", fontsize=9, weight="bold")
        for cause, shade in zip(CAUSES, shades, strict=True):
            share = 100.0 * method["failed"][cause]
            axes.barh(row, share, left=left, color=shade, height=0.6, label=_STAGES[cause] if row == 0 else None)
            left += share
    axes.set_yticks(range(len(methods)), [name_label(method["name"]) for method in methods])
    axes.set_ylim(len(methods) - 0.4, -0.6)
    axes.set_xlim(0.0, 100.0)
    axes.set_xlabel("% of the objects")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=len(CAUSES), frameon=False, fontsize=8)
    return figure


class GraspPolicy:
    """Grasp objects of `kinreach/Lift-v0` with postures of a solver, in single steps.

    The fingers are as in the start pose, turned outwards with the object; on a cube they are parallel to its faces.
    The first turn with an accepted posture is used.

    Args:
        solver: For the arm of the environment, from the world to the tip.

    Attributes:
        diagnostics: Iterations of the solver, and poses that were asked for.
        reason: Why the last action was None, else empty.
    """

    def __init__(self, solver: Solver, env: gym.Env[Any, Any]) -> None:
        self._solver, self._env = solver, env.unwrapped
        task: Any = self._env
        self._home: Floats = task.home
        self._sides: tuple[float, float] = task.arm.gripper.sides
        self._upright: Floats = task.kinematics.fk(self._home)[:3, :3]
        if self._upright[2, 2] > -0.5:  # the tool starts ahead or upwards
            self._upright = np.diag([1.0, -1.0, -1.0])
        self.diagnostics: Mapping[str, float] = {}
        self.reason = ""

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        """Do nothing: a grasp depends on the observation only."""

    def act(self, observation: Any) -> Any:
        """Return the action of a grasp; None if no camera saw the object or no posture is accepted."""
        env: Any = self._env
        iterations = poses = 0
        self.reason = "no camera found the object"
        if observation[lift_task.SEEN].any():
            for T in self._poses(observation):
                found: Any = self._solver.solve(PoseGoal(T), self._home, accept=env.accept)
                iterations, poses, self.reason = iterations + found.iterations, poses + 1, found.reason
                if found.success:
                    self.diagnostics = {"iterations": iterations, "poses": poses}
                    return env.grasp_action(found.q, max(0.0, 2.0 * observation[lift_task.SIZE] - SQUEEZE))
        self.diagnostics = {"iterations": iterations, "poses": poses}
        return None

    def _poses(self, observation: Floats) -> Iterator[Floats]:
        place, size = observation[lift_task.SEEN].copy(), float(observation[lift_task.SIZE])
        place[2] += max(0.0, MIN_HEIGHT - size)
        outwards = math.atan2(place[1], place[0])
        step, first, beyond = math.pi / TURNS, 0.0, size + BESIDE - self._sides[0]
        if observation[lift_task.IS_CUBE]:
            step = math.pi / 2
            first = float(
                lift_task.face_angle(
                    observation[lift_task.FACES] - math.atan2(self._upright[1, 1], self._upright[0, 1])
                )
            )
        for count in range(round(2 * math.pi / step)):
            T = np.eye(4)
            aside = (count + 1) // 2 * (-1) ** count * step
            T[:3, :3], T[:3, 3] = turn(UP, outwards + first + aside) @ self._upright, place
            if beyond > 0.0:
                T[:3, 3] += beyond * T[:3, 1]
            yield T


LIFT_TASK = Task(
    name="lift",
    title="A UR5 grasps an object and lifts it",
    environment=LIFT,
    arm=THESIS_ARM,
    arm_title="it grasps an object and lifts it",
    options={"attempts": 2},
    variants=(LIFT,),
    observations=("geometric", "camera"),
    resets=_resets,
    methods={
        **{name: _scripted(name) for name in ("closed-form", "placo")},
        "ranked-lift": policy_method("ranked-lift", LIFT),
        "ranked-lift-range": policy_method("ranked-lift-range", LIFT),
        "ppo-lift-multi": policy_method("ppo-lift-multi", LIFT, steps=lift_task.MULTI),
    },
    columns=(
        Column("reached", "reached", RATE, "lifted %\n[95 % CI]", "interval"),
        *(
            Column(f"failed.{cause}", _failed(cause), RATE, _STAGES[cause].replace(" ", "\n") + "\n%", "share")
            for cause in CAUSES
        ),
        Column("impossible", "impossible", RATE, "impos-\nsible %", "share"),
        Column("attempts", "attempts", MEAN, "actions\nmean", "mean"),
        Column(
            "distance_mm", thousandfold("distance"), QUANTILES, "distance at\nthe grasp, mm", "quantiles", TIME_TABLE
        ),
        Column("posture_error", "posture_error", QUANTILES, "posture\nerror, rad", "median", TIME_TABLE),
        Column("clearance_mm", thousandfold("clearance"), QUANTILES, "height at\nthe end, mm", "median", TIME_TABLE),
        Column("move_s", of_reached("move_s"), QUANTILES, "move s\nmedian", "median", TIME_TABLE),
        Column("solve_ms", decision_ms, QUANTILES, "a decision\nms", "quantiles", TIME_TABLE),
    ),
    figures={"causes": draw_causes},
    scene=_scene,
    reached=f"the object's lowest point is {lift_task.HEIGHT:g} m above the table for {lift_task.HOLD:g} s, "
    "and the object touches both fingers and nothing that stands around",
    terms={
        "goal": "an object that lies on the table, free, under MuJoCo's dynamics: its place uniform on the table area, "
        "turned anyhow; a red ball of 25 mm radius and 50 g, friction 1, unless the options say otherwise",
        "attempts": "grasps that may be tried; before each the arm looks at the object from its start posture",
        "accept": "solvers' postures, of the grasp and 0.15 m above it: no collision (self, table, mount, pedestal, "
        "floor)",
        "causes": "the first stage that failed in the last attempt: seen by a camera, reached by the tip (within 20 mm "
        "of its middle), closed (it touches both fingers), slipped before it was up, dropped afterwards",
        "distance": "tip to the object's middle when the fingers begin to close",
        "execution": "a controller in MuJoCo: above the grasp, down, fingers closed in 0.5 s, up, still for 0.5 s",
    },
)

TASKS = (LIFT_TASK,)
