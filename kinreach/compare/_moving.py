"""Touching a rolling ball: the closed form at an old sight or with a forecast, and policies."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from matplotlib.figure import Figure

from kinreach._registration import MOVING
from kinreach._statistics import QUANTILES, RATE, Column, Trial, number, thousandfold
from kinreach.compare._button import decision_ms
from kinreach.compare._curves import draw_shares
from kinreach.compare._figures import origin
from kinreach.compare._methods.interception import FirstSight, Interception, LastSight
from kinreach.compare._methods.resolve import policy_method
from kinreach.compare._methods.scenarios import Scenarios
from kinreach.compare._task import CONTROLLER, Method, Replay, Task, of_reached, resets_in_turn
from kinreach.envs.inside import moving as ball
from kinreach.kinematics import ArmKinematics
from kinreach.plots import INK, new_figure
from kinreach.plots.inside import name_label, text_colour, view_from_the_robot
from kinreach.robots import THESIS_ARM

#: Title of the second table.
TIME_TABLE = "Distances and times"
#: Sights that are observed: as many as any policy was trained with.
SIGHTS = 20
#: Policy that also acts before the planner does.
_LEARNED = policy_method("gradient-moving-clear", MOVING)


def _resets(count: int, seed: int, env: gym.Env[Any, Any]) -> list[dict[str, Any]]:
    """Return all paths at the first speed, then at the next, and so on with other balls."""
    options: ball.MovingOptions = env.unwrapped.options  # type: ignore[attr-defined]
    cases = [{"speed": speed, "path": path} for speed in options.speeds for path in options.paths]
    return resets_in_turn(cases, count, seed)


def touched(*, speed: float | None = None, path: str | None = None) -> Callable[[Trial], bool | None]:
    """Return a function of a trial: whether the ball was touched, None if it rolled otherwise."""

    def value(trial: Trial) -> bool | None:
        other = (speed is not None and trial["speed"] != speed) or (path is not None and trial["path"] != path)
        return None if other else bool(trial["reached"])

    return value


def _rates(group: str, path: str | None, table: str) -> list[Column]:
    return [
        Column(f"{group}.{speed}", touched(speed=speed, path=path), RATE, f"{speed:g}\nm/s", "share", table)
        for speed in ball.SPEEDS
    ]


def draw_paths(trials: Sequence[Trial], results: Mapping[str, Any], replay: Replay) -> Figure:
    """Draw how tip and ball go, seen from above: a row for each method, a column for each kind of path.

    The speed is that at which the methods differ most; of each kind it is the first ball of that speed.
    """
    methods = results["methods"]
    speeds = sorted({trial["speed"] for trial in trials})
    speed = max(speeds, key=lambda one: _spread(trials, one))
    kinds = sorted({trial["path"] for trial in trials}, key=list(ball.PATHS).index)
    goals = {
        kind: min(t["goal_index"] for t in trials if (t["speed"], t["path"]) == (speed, kind))
        for kind in kinds
        if any((t["speed"], t["path"]) == (speed, kind) for t in trials)
    }
    note = f"from above, the robot below · dotted: the ball, from the ring on · line: the tip · {origin(results)}"
    figure, axes = new_figure(
        f"Balls at {speed:g} m/s, and the tip", size=(2.5 * len(goals) + 0.6, 0.9 + 2.6 * len(methods)),
        rows=len(methods), columns=len(goals), note=note, grid="none",
    )  # fmt: skip
    kinematics = ArmKinematics(THESIS_ARM, tip="tcp", base="world")
    panels, everything = iter(axes), []
    for method in methods:
        for kind, goal in goals.items():
            panel, infos = next(panels), replay(method["name"], goal)
            balls = np.array([info["goal"] for info in infos])
            tips = kinematics.positions(np.array([info["q"] for info in infos]))
            panel.plot(balls[:, 1], balls[:, 0], color=INK, lw=1.2, ls=":", zorder=3)
            panel.plot(balls[0, 1], balls[0, 0], "o", ms=6, mfc="white", mec=INK, zorder=3)
            panel.plot(tips[:, 1], tips[:, 0], color=method["colour"], lw=1.6)
            touched = bool(infos[-1]["is_success"])
            mark = {"marker": "o", "mfc": method["colour"]} if touched else {"marker": "X", "mfc": "white"}
            panel.plot(tips[-1, 1], tips[-1, 0], ms=8, mec=method["colour"], ls="", **mark)
            verdict = "touched" if touched else f"missed by {number(1e3 * infos[-1]['distance'])} mm"
            panel.set_title(f"{kind}: {verdict}", loc="left", fontsize=9, color=INK)
            everything.append(np.concatenate([balls, tips])[:, :2])
        first = axes[methods.index(method) * len(goals)]
        first.annotate(
            name_label(method["name"]), (0, 1.16), xycoords="axes fraction", fontsize=10, weight="bold",
            color=text_colour(method["colour"]),
        )  # fmt: skip
    for panel in axes:  # the same scale in all
        view_from_the_robot(panel, *np.concatenate(everything).T, margin=0.03)
        panel.label_outer()
    return figure


def _spread(trials: Sequence[Trial], speed: float) -> float:
    """Return how much the methods differ in the share of balls that they touch at a speed."""
    shares: dict[str, list[bool]] = {}
    for trial in trials:
        if trial["speed"] == speed:
            shares.setdefault(trial["method"], []).append(bool(trial["reached"]))
    return float(np.var([np.mean(own) for own in shares.values()]))


def _notes(results: Mapping[str, Any]) -> list[str]:
    """Return which speeds are missing because there are fewer goals than kinds of balls."""
    options, goals = results["settings"]["options"], results["settings"]["goals"]
    speeds, paths = options.get("speeds", ball.SPEEDS), len(options.get("paths", ball.PATHS))
    left = ", ".join(f"{speed:g}" for speed in speeds[-(-goals // paths) :])
    return [f"No goal is left for balls at {left} m/s: give at least {len(speeds) * paths}."] if left else []


def _act_first(env: gym.Env[Any, Any]) -> Any:
    return Interception(env, first=_LEARNED.make(env))


MOVING_TASK = Task(
    name="moving",
    title="A UR5 and a rolling ball",
    environment=MOVING,
    options={"sights": SIGHTS},
    variants=(MOVING,),
    resets=_resets,
    methods={
        "first-sight": Method(FirstSight, CONTROLLER),
        "last-sight": Method(LastSight, CONTROLLER),
        "interception": Method(Interception, CONTROLLER),
        "scenarios": Method(Scenarios, CONTROLLER),
        "act-first": Method(_act_first, CONTROLLER, versions=_LEARNED.versions),
        "gradient-moving": policy_method("gradient-moving", MOVING),
        "gradient-moving-clear": _LEARNED,
        "ppo": policy_method("ppo-moving", MOVING),
        "ppo-moving-clear": policy_method("ppo-moving-clear", MOVING),
    },
    columns=(
        Column("reached", "reached", RATE, "all, %\n[95 % CI]", "interval"),
        *_rates("touched", None, ""),
        *(column for path in ball.PATHS for column in _rates(path, path, f"Paths: {path}")),
        Column("impossible", "impossible", RATE, "collided\n%", "share"),
        Column("distance_mm", thousandfold("distance"), QUANTILES, "least\ndistance, mm", "quantiles", TIME_TABLE),
        Column("time_s", of_reached("time"), QUANTILES, "time to\ntouch, s", "median", TIME_TABLE),
        Column("solve_ms", decision_ms, QUANTILES, "a decision\nms", "median", TIME_TABLE),
    ),
    figures={
        "speeds": draw_shares(
            "speed",
            title="Rolling balls that are touched",
            label="speed of the ball [m/s]",
            of="balls, all three kinds of paths",
        )
    },
    paths=draw_paths,
    reached="the tip comes within 10 mm of the ball's centre, in 3 s at most and before the ball leaves the table "
    "area, without a collision of arm or fingers on the way (--collisions false allows them)",
    terms={
        "goal": "a ball that rolls over the table: straight on, on a circle of 0.12 m, or with a sideways acceleration "
        f"within {ball.SIDEWAYS:g} m/s² that is drawn anew every {ball.HOLD:g} s",
        "sight": f"{ball.FRAMES} a second, {1e3 * ball.DELAY:g} ms old, 0.14 mm off in the median",
        "arm": "a UR5 whose joints keep their limits of speed and acceleration; a collision ends the episode",
        "distance": "the least of tip and ball's centre in the episode",
    },
    notes=_notes,
)

TASKS = (MOVING_TASK,)
