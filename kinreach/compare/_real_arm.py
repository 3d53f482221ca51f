"""Arms with errors: methods with the data sheet that look, identify or learn."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import gymnasium as gym

from kinreach._registration import REAL_ARM
from kinreach._statistics import QUANTILES, RATE, Column, Trial, thousandfold
from kinreach.baselines import load_policy
from kinreach.baselines.inside import policy_version
from kinreach.compare._curves import draw_looks
from kinreach.compare._methods.learned import Informed, LearnedCorrection, Trained, Tuned
from kinreach.compare._methods.models import ALL_PARAMETERS, JOINT_TERMS, REGISTERED, DataSheet, Identified, Residual
from kinreach.compare._methods.practice import Learner, LookingPolicy
from kinreach.compare._task import Method, Task, episode_seed
from kinreach.envs.inside import real_arm
from kinreach.sim.inside import PosedScene

#: Kinds of methods.
MODEL, LEARNED, BOTH = "model", "policy", "model and learning"
#: Policies of the data sheet's arm, and of arms with random errors.
LEARNED_POLICY, INFORMED_POLICY = "space-single", "random-arms"


def _method(learner: Callable[[Any], Learner], kind: str, *, again: bool = True, policy: str = "") -> Method:
    versions = policy_version(policy) if policy else {}
    return Method(lambda env: LookingPolicy(learner, env, again=again), kind, versions=versions)


def _policy_method(learner: Callable[[Any], Learner], *, again: bool = True) -> Method:
    return _method(learner, LEARNED, again=again, policy=LEARNED_POLICY)


METHODS: Mapping[str, Method] = {
    "data-sheet": _method(lambda env: DataSheet(), MODEL, again=False),
    "look-again": _method(lambda env: DataSheet(), MODEL),
    "registered": _method(lambda env: Identified(REGISTERED, env.noise), MODEL),
    "identified": _method(lambda env: Identified(ALL_PARAMETERS, env.noise), MODEL),
    "identified-joints": _method(lambda env: Identified(ALL_PARAMETERS, env.noise, JOINT_TERMS), MODEL),
    "residual": _method(lambda env: Residual(env.noise), BOTH),
    "correction": _method(lambda env: LearnedCorrection(env.noise), BOTH),
    "correction-joints": _method(lambda env: LearnedCorrection(env.noise, joints=True), BOTH),
    "policy": _policy_method(lambda env: Trained(load_policy(LEARNED_POLICY)), again=False),
    "policy-again": _policy_method(lambda env: Trained(load_policy(LEARNED_POLICY))),
    "policy-tuned": _policy_method(lambda env: Tuned(load_policy(LEARNED_POLICY), env.noise)),
    "policy-informed": Method(
        lambda env: Informed(load_policy(INFORMED_POLICY), env),
        LEARNED,
        versions=policy_version(INFORMED_POLICY),
    ),
}

#: Titles of the tables of single errors.
ALONE = {
    "links": "The links alone, of four published calibrations",
    "tool": "The tool alone, 5 mm off",
    "base": "The base alone, turned by 0.5 degrees",
    "cameras": "The cameras alone, 2 mm and 0.3 degrees off",
    "sag": "The gears' compliance alone, under 5 kg",
    "backlash": "The gears' hysteresis alone, one minute of arc",
    "encoders": "The encoders alone, 0.6 mrad over a turn",
    "mount": "The stand alone, bent by the arm and 5 kg",
    "nongeometric": "These four together",
    "everything": "All eight together",
}
ALL = "all"
TIME_TABLE = "Time"


def error_mm(errors: str, budget: int, again: int) -> Callable[[Trial], float | None]:
    """Return a function of a trial: the median distance after some looks [mm], None for other errors."""
    value = thousandfold(f"error_{budget}_{again}")
    return lambda trial: value(trial) if trial["errors"] == errors else None


def _heading(budget: int, again: int) -> str:
    return f"{budget} looks\n{f'+ {again} there' if again else 'mm'}"


def _columns() -> tuple[Column, ...]:
    shown = {(budget, 0) for budget in real_arm.BUDGETS} | {(0, 1), (0, 2), (20, 1)}
    return tuple(
        Column(
            f"{errors}.looks_{budget}_{again}",
            error_mm(errors, budget, again),
            QUANTILES,
            _heading(budget, again),
            "median" if (budget, again) in shown else "",
            title,
        )
        for errors, title in ((ALL, ""), *ALONE.items())
        for budget in real_arm.BUDGETS
        for again in range(real_arm.RealArmOptions().again + 1)
    )


def _resets(count: int, seed: int, env: gym.Env[Any, Any]) -> list[dict[str, Any]]:
    """Return resets with all errors of the first robot, of the next, and so on with other draws."""
    options: real_arm.RealArmOptions = env.unwrapped.options  # type: ignore[attr-defined]
    errors, robots = options.errors, options.calibrations
    return [
        {
            "seed": episode_seed(seed, index // len(errors)),
            "options": {
                "errors": errors[index % len(errors)],
                "calibration": robots[index // len(errors) % len(robots)],
            },
        }
        for index in range(count)
    ]


def _true_scene(env: gym.Env[Any, Any], trial: Trial) -> PosedScene:
    """Return the true arm at the first ball, after the last move to it."""
    scene: PosedScene = env.unwrapped.scene  # type: ignore[attr-defined]
    scene.put(trial["q"], ball=trial["goal"])
    return scene


REAL_ARM_TASK = Task(
    name="real-arm",
    title="A UR5 whose links, tool, base and cameras are a little off",
    environment=REAL_ARM,
    resets=_resets,
    methods=METHODS,
    columns=(
        *_columns(),
        Column("reached", "reached", RATE),
        Column("distance_mm", thousandfold("distance"), QUANTILES),
        Column("solve_ms", thousandfold("solve_s"), QUANTILES, "decisions of\na workplace, ms", "median", TIME_TABLE),
    ),
    figures={"looks": draw_looks(real_arm.BUDGETS, partial(error_mm, ALL))},
    reached=f"the tip ends within {1e3 * real_arm.REACHED_WITHIN:g} mm of half of the balls after the last look",
    terms={
        "goal": "a workplace: a true UR5, the directions of what is off, 50 balls uniform on the table area, and noise",
        "look": "the arm goes to a posture, the cameras measure the tip: 0.14 mm off in the median, as the ball",
        "errors": "links: published calibrations of four UR5; tool 5 mm off; base turned by 0.5 degrees; cameras 2 mm "
        "and 0.3 degrees off; each alone and all at once; by --errors also gears that give way under 5 kg, their "
        "hysteresis, encoders off their axes, and a stand that bends",
        "error": "distance from tip to ball, median of the 50 balls; the tables have its median over workplaces",
        "there": "the tip is seen beside the ball, and goes there again, for methods that look again",
        "move": "kinematic: a posture is taken as it is",
    },
    notes=lambda results: [
        "Tables: median error in mm. Looks before; + 1 there: in the second move to a ball, having seen the first.",
        "The balls themselves are seen 0.14 mm off in the median: no method can do better in the first move.",
    ],
    scene=_true_scene,
)

TASKS = (REAL_ARM_TASK,)
