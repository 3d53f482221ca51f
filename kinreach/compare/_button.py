"""The task `button`: its methods, columns and figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np

from kinreach._registration import BUTTON
from kinreach._statistics import QUANTILES, RATE, SPREAD, Column, Trial, thousandfold
from kinreach.baselines import HELD_OUT, AnalyticButtonPolicy, RandomPolicy, load_policy
from kinreach.baselines.inside import policy_version
from kinreach.compare import _curves as curves
from kinreach.compare import _figures as figures
from kinreach.compare._task import (
    CHANCE,
    CONTROLLER,
    Method,
    Task,
    common_columns,
)
from kinreach.envs.inside import ButtonDrawing, ButtonOptions, ButtonState, button_task, torque_model
from kinreach.sim.inside import PosedScene

#: Distance between the environment's seeds of two comparisons, above `MAX_GOALS`.
SPACING = 2**32


def _analytic(env: gym.Env[Any, Any]) -> AnalyticButtonPolicy:
    return AnalyticButtonPolicy(env.unwrapped.options.actuation)  # type: ignore[attr-defined]


def _resets(count: int, seed: int, env: gym.Env[Any, Any]) -> Sequence[Mapping[str, Any]]:
    return [{"seed": HELD_OUT + SPACING * seed + index} for index in range(count)]


def _pressed(trial: Trial) -> bool:
    return bool(trial["reached"])


def decision_ms(trial: Trial) -> float:
    return 1e3 * float(trial["solve_s"]) / int(trial["steps"])


def _column(column: Column) -> Column:
    """Return a column of all tasks for this one; its reward is the sum over the episode."""
    value = "return" if column.key == "reward_mean" else column.value
    show = {"reached": "", "distance_mm": "", "success_at_mm.1": "", "impossible": "", "solve_ms": ""}
    return replace(column, value=value, show=show.get(column.key, column.show))


def _scene(env: gym.Env[Any, Any], trial: Trial) -> PosedScene:
    """Return the arm and the button after the last step."""
    options: ButtonOptions = env.unwrapped.options  # type: ignore[attr-defined]
    scene = PosedScene(options.arm, model=torque_model(options.arm, options.motors))
    scene.put(trial["q"])
    pressed = ButtonState.PRESSED if trial["pressed"] else ButtonState(int(trial["wrong_press"]))
    ButtonDrawing(scene.model).show(scene.data.mocap_pos, np.array(trial["goal"]), pressed)
    return scene


def _notes(results: Mapping[str, Any]) -> list[str]:
    diverged = {m["name"]: m["outcomes"]["diverged"] for m in results["methods"] if "diverged" in m["outcomes"]}
    options = results["settings"]["options"]
    return [
        *(f"The simulation diverged for {name}: {count} episodes." for name, count in diverged.items()),
        f"At most {options['max_episode_steps']} steps for all methods, actuation {options['actuation']}.",
        f"A press counts at d < {1e3 * button_task.PRESS_RADIUS:g} mm; "
        "the 95 % interval of the share pressed is Wilson's.",
        "Steps, wrong presses, energy (sum of torque² dt), reward: of whole episodes, pressed or not.",
        "Time: simulated in MuJoCo, of pressed episodes. Decision: wall time of one, on one thread.",
    ]


BUTTON_TASK = Task(
    name="button",
    title="3-DOF arm under torque: press the button",
    environment=BUTTON,
    # 100 steps of the tuned actuation are 4 s, nearly twice what the analytic controller ever needed
    options={"max_episode_steps": 100, "actuation": "tuned"},
    variants=(BUTTON,),
    resets=_resets,
    methods={
        "analytic": Method(_analytic, CONTROLLER),
        "ppo": Method(lambda env: load_policy("button"), versions=policy_version("button")),
        "random": Method(lambda env: RandomPolicy(env.action_space), CHANCE),
    },
    columns=(
        Column("pressed", "reached", RATE, "pressed % [95 % CI]", "interval"),
        Column("steps", "steps", SPREAD, "steps\nmedian / p95", "quantiles", digits=3),
        *map(_column, common_columns(_pressed)),
        Column("wrong_presses", "wrong_presses", SPREAD, "wrong\npresses\nmean", "mean"),
        Column("energy", "energy", SPREAD, "energy\nN²m²s\nmedian", "median"),
        Column("decision_ms", decision_ms, QUANTILES, "decision ms\nmedian / p95", "quantiles"),
    ),
    figures={
        "pressed": curves.draw_pressed,
        "map": figures.draw_map,
        "episodes": figures.draw_strip_grid(
            "How episodes end, and what they take",
            {
                "distance at the end of the episode [mm]": (thousandfold("distance"), False),
                "wrong presses in an episode": (lambda trial: trial["wrong_presses"], True),
                "energy, sum of torque² dt [N²m²s]": (lambda trial: trial["energy"], False),
                "wall time per decision, one thread [ms]": (decision_ms, False),
            },
            marks={"distance at the end of the episode [mm]": 1e3 * button_task.PRESS_RADIUS},
            legend="dot: one goal · bar: median · dashed: within this a press counts",
        ),
    },
    reached="the button is pressed with the tip within 50 mm of it before the episode ends",
    terms={
        "goal": "target and start of an episode of kinreach/ButtonPress-v0: the target uniform in the four "
        "quadrants, kept if some posture reaches it; joints within 0.1 rad of upright and 0.1 rad/s of rest; the "
        f"environment's seeds are {HELD_OUT} + {SPACING} seed + index, which no training draws",
        "distance": "end effector to the target after the last step, in the simulation",
        "reward": "the environment's, summed over the episode",
        "timing": "methods take turns in random order on every goal, each after one untimed decision; one process, one "
        "thread, one environment; the time of a step is that of choosing the action",
    },
    notes=_notes,
    ranked=("decision_ms",),  # any press within 50 mm counts: to be nearer is worth nothing
    scene=_scene,
)

TASKS = (BUTTON_TASK,)
