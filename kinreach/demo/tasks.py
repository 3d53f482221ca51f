"""What can be watched: environments by short name, with their policies and how they are run by default."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym

from kinreach.baselines.button_controller import AnalyticButtonPolicy
from kinreach.baselines.policies import load_policy, pretrained_names
from kinreach.baselines.rollout import AnalyticReachPolicy, Policy, RandomPolicy
from kinreach.errors import raise_unknown
from kinreach.registration import BUTTON, MULTI, SINGLE


@dataclass(frozen=True)
class DemoTask:
    """One environment.

    Attributes:
        name: Its id at Gymnasium.
        options: Arguments of the command line that are arguments of the environment.
        analytic: Makes its analytic policy from the arguments of the command line.
        policy, steps, printed: What the command line does if it is not told.
    """

    name: str
    options: tuple[str, ...]
    analytic: Callable[[Any], Policy]
    policy: str = "analytic"
    steps: int = 20
    printed: str = "reward"


_REACH_OPTIONS = ("observation", "backend")
TASKS: Mapping[str, DemoTask] = {
    "single": DemoTask(SINGLE, _REACH_OPTIONS, lambda arguments: AnalyticReachPolicy("single")),
    "multi": DemoTask(MULTI, _REACH_OPTIONS, lambda arguments: AnalyticReachPolicy("multi")),
    # By default this is the test that the course report describes.
    "button": DemoTask(
        BUTTON,
        ("actuation",),
        lambda arguments: AnalyticButtonPolicy(arguments.actuation),
        policy="random",
        steps=10_000,
        printed="action,observation",
    ),
}
#: Policies that nobody trained, by name; each is made from the task, the environment and the arguments.
POLICIES: Mapping[str, Callable[[DemoTask, gym.Env[Any, Any], Any], Policy]] = {
    "random": lambda task, env, arguments: RandomPolicy(env.action_space, seed=arguments.seed),
    "analytic": lambda task, env, arguments: task.analytic(arguments),
}


def make_policy(name: str, task: DemoTask, env: gym.Env[Any, Any], arguments: Any) -> Policy:
    """A policy by name, or a trained one: of the package, or from a file.

    Raises:
        InputError: There is none of that name, the file is no policy, or it is for another environment.
    """
    if name in POLICIES:
        return POLICIES[name](task, env, arguments)
    trained = [policy for policy in pretrained_names() if load_policy(policy).card.environment == task.name]
    if name not in trained and not Path(name).suffix:
        raise_unknown(f"policy for {task.name}", name, ("a file of a policy", *POLICIES, *trained))
    return load_policy(name, environment=task.name)
