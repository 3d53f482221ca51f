"""Reaching past obstacles: postures alone, planned paths, and policies that do not see them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym

from kinreach._registration import OBSTACLES
from kinreach._statistics import QUANTILES, RATE, Column, Trial, thousandfold
from kinreach.baselines.inside import policy_version
from kinreach.compare._curves import draw_shares
from kinreach.compare._figures import draw_strip_grid
from kinreach.compare._methods import waypoints as ways
from kinreach.compare._reach import METHODS
from kinreach.compare._task import PLANNER, POLICY, SOLVER, Method, Task, of_reached, resets_in_turn
from kinreach.envs.inside import MAX_CLUTTER, ObstaclesOptions
from kinreach.kinematics.inside import PATH_MARGIN

#: Title of the second table.
WAY_TABLE = "Ways of the goals that were reached"
#: The default margin in words.
MARGIN = f"{1e3 * PATH_MARGIN:g} mm unless --margin is given"


def _resets(count: int, seed: int, env: gym.Env[Any, Any]) -> list[dict[str, Any]]:
    """Return a scene with each number of obstacles, then the next ones."""
    options: ObstaclesOptions = env.unwrapped.options  # type: ignore[attr-defined]
    return resets_in_turn([{"clutter": clutter} for clutter in options.clutter], count, seed)


def _reached_among(count: int) -> Callable[[Trial], bool | None]:
    return lambda trial: bool(trial["reached"]) if trial["clutter"] == count else None


OBSTACLES_TASK = Task(
    name="obstacles",
    title="UR5: the tip on the ball, the tool down, past obstacles on the table",
    environment=OBSTACLES,
    resets=_resets,
    methods={
        **METHODS,
        "from-above": Method(ways.solver_from_above, SOLVER),
        "free-way": Method(ways.free_way, PLANNER),
        "path-to-one": Method(ways.path_to_one, PLANNER),
        "path": Method(ways.path_to_any, PLANNER),
        **{
            name: Method(trained(name), POLICY, versions=policy_version(name))
            for trained, names in (
                (ways.trained_posture, ("ppo-single", "ranked-single")),
                (ways.trained_steps, ("ppo-multi", "ranked-multi")),
            )
            for name in names
        },
    },
    columns=(
        Column("reached", "reached", RATE, "all, %\n[95 % CI]", "interval"),
        *(
            Column(f"reached_among.{count}", _reached_among(count), RATE, f"{count} ob-\nstacles", "share")
            for count in range(MAX_CLUTTER + 1)
        ),
        Column("impossible", "impossible", RATE, "collided or\nno way, %", "share"),
        Column("distance_mm", thousandfold("distance"), QUANTILES, "distance mm\nmedian / p95"),
        Column("solve_ms", thousandfold("solve_s"), QUANTILES, "to plan, ms\nmedian / p95", "quantiles"),
        Column("length", of_reached("length"), QUANTILES, "length, rad\nmedian / p95", "quantiles", WAY_TABLE),
        Column("moves", of_reached("steps"), QUANTILES, "moves\nmedian / p95", "quantiles", WAY_TABLE, digits=3),
        Column("move_s", of_reached("move_s"), QUANTILES, "duration, s\nmedian / p95", "quantiles", WAY_TABLE),
    ),
    figures={
        "clutter": draw_shares(
            "clutter", title="Goals reached past obstacles", label="obstacles on the table", of="goals"
        ),
        "ways": draw_strip_grid(
            "Ways, and what they cost",
            {
                "length of the way, of goals reached [rad]": (of_reached("length"), False),
                "duration of the motion, of goals reached [s]": (of_reached("move_s"), False),
                "wall time to plan, one thread [ms]": (thousandfold("solve_s"), False),
                "moves, of goals reached": (of_reached("steps"), True),
            },
            marks={},
            legend="dot: one goal · bar: median",
        ),
    },
    reached="the tip ends within 10 mm of the ball, the tool within 0.15 rad of straight down, and nothing of the arm "
    "touched anything on the way",
    terms={
        "goal": "a ball on the table among boxes of 4 to 10 cm across and 10 to 40 cm high, drawn until the start "
        f"posture and one posture at the ball keep the margin ({MARGIN}) from everything; a scene may have no free way",
        "execution": "from waypoint to waypoint, each a straight line in joint space, from rest to rest, in MuJoCo",
        "collision": "the motion that the arm made, sampled every 0.002 rad and judged by the exact checker, no margin",
        "accept": f"postures, lines and paths keep the margin ({MARGIN}) from everything",
        "timing": "methods take turns in random order on every goal, each after one untimed decision; one process, one "
        "thread; the checker knows the obstacles beforehand; the clock runs while a method decides, summed over its "
        "decisions",
    },
    notes=lambda results: [
        "Length: Euclidean norm over joints. Duration: simulated, each move from rest to rest.",
        "Policies observe the goal and the joints, not the obstacles. Nothing but arm and boxes is in this world.",
    ],
)

TASKS = (OBSTACLES_TASK,)
