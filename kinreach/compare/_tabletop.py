"""Objects brought to a place by pushing or grasping, in the comparison."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, cast

import gymnasium as gym
import numpy as np

from kinreach._registration import PICK_AND_PLACE, PUSH
from kinreach._statistics import MEAN, QUANTILES, RATE, Column, Trial, thousandfold
from kinreach.baselines import RandomPolicy
from kinreach.baselines.inside import PickAndPlaceScript, PushScript, TabletopScript
from kinreach.compare._button import decision_ms
from kinreach.compare._methods.resolve import policy_method
from kinreach.compare._task import CHANCE, CONTROLLER, Method, Task, episode_seed, of_reached
from kinreach.robots import THESIS_ARM
from kinreach.sim.inside import Scene


def scene_with_object(env: gym.Env[Any, Any], trial: Trial, start: Mapping[str, Any]) -> Scene:
    """Return arm, fingers and object after the last step, after a reset with the options `start`."""
    spec: Any = env.spec
    drawn: Any = gym.make(spec, render_mode="rgb_array").unwrapped
    drawn.reset(seed=env.unwrapped.np_random_seed, options=start)
    world, only = drawn.episodes.world, np.zeros(1, dtype=np.intp)
    world.reset(only, np.array([trial["q"]]))
    world.put_fingers(only, np.array([trial["opening"]]))
    world.put_at(only, np.array([trial["position"]]), np.reshape(trial["rotation"], (1, 3, 3)))
    scene: Scene = drawn.scene
    return scene


def _scene(env: gym.Env[Any, Any], trial: Trial) -> Scene:
    """Return the scene with the ball that marks the goal."""
    scene: Any = scene_with_object(env, trial, {})
    scene.place_ball(trial["goal"])
    return cast("Scene", scene)


def _columns() -> tuple[Column, ...]:
    return (
        Column("reached", "reached", RATE, "at the goal %\n[95 % CI]", "interval"),
        Column("steps", of_reached("steps"), QUANTILES, "steps\nmedian / p95", "quantiles"),
        Column("distance_mm", thousandfold("distance"), QUANTILES, "distance mm\nmedian / p95", "quantiles"),
        Column("impossible", "impossible", RATE, "colli-\nsions %", "share"),
        Column("reward_mean", "reward", MEAN, "reward\nmean", "mean"),
        Column("solve_ms", decision_ms, QUANTILES, "a decision\nms", "quantiles"),
    )


def _resets(count: int, seed: int, env: gym.Env[Any, Any]) -> Sequence[Mapping[str, Any]]:
    return [{"seed": episode_seed(seed, index)} for index in range(count)]


def _task(name: str, environment: str, title: str, arm_title: str, script: type[TabletopScript], goal: str) -> Task:
    scripted = Method(script, CONTROLLER)
    return Task(
        name=name,
        title=title,
        environment=environment,
        arm=THESIS_ARM,
        arm_title=arm_title,
        arm_methods={joints: {"script": scripted} for joints in (5, 6)},
        variants=(environment,),
        resets=_resets,
        methods={
            "script": scripted,
            f"imitated-{name}": policy_method(f"imitated-{name}", environment),
            "random": Method(lambda env: RandomPolicy(env.action_space), CHANCE),
        },
        columns=_columns(),
        scene=_scene,
        reached="the object's middle is within 20 mm of the goal before the episode ends",
        terms={
            "goal": goal,
            "distance": "the object's middle to the goal after the last step, in the simulation",
            "steps": "of 40 ms, of episodes that ended at the goal; at most 200",
            "script": "closed-form inverse kinematics for the tip's way, from what is observed",
            "imitated": "a network that learned from the script's answers, and asks no kinematics",
        },
    )


TASKS = (
    _task(
        "push",
        PUSH,
        "A UR5 pushes a cube to a place on the table",
        "it pushes a cube to a place on the table",
        PushScript,
        "a cube of 50 mm and 50 g on the table, turned anyhow, and a place 6 to 20 cm from it",
    ),
    _task(
        "pick-and-place",
        PICK_AND_PLACE,
        "A UR5 brings a cube to a place",
        "it brings a cube to a place",
        PickAndPlaceScript,
        "a cube of 50 mm and 50 g on the table, turned anyhow, and a place that is on the table, too, or up to 20 cm "
        "higher; each half of the goals",
    ),
)
