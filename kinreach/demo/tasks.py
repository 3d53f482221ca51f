"""Environments that can be watched, and who may act in them, by the names of the command line and of the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym

from kinreach.baselines.button_controller import AnalyticButtonPolicy
from kinreach.baselines.policies import load_policy, pretrained_names, trained_arm
from kinreach.baselines.rollout import Policy, RandomPolicy
from kinreach.baselines.solver_policy import SolverPolicy
from kinreach.errors import raise_unknown
from kinreach.kinematics.solvers import SOLVERS, new_solver
from kinreach.registration import BUTTON, MULTI, SINGLE, SPACE

Environment = gym.Env[Any, Any]

#: Of policies that are trained for an arm that their card does not name.
ARM = "ur5"


@dataclass(frozen=True)
class DemoTask:
    """An environment that can be watched.

    Attributes:
        name: Its id at Gymnasium.
        options: Arguments of the command line that are arguments of the environment.
        analytic: Makes its analytic policy from the environment.
        policy, steps, printed: What the command line does if it is not told.
        solvers: Names of solvers that can act in it.
    """

    name: str
    options: tuple[str, ...]
    analytic: Callable[[Environment], Policy]
    policy: str = "analytic"
    steps: int = 20
    printed: str = "reward"
    solvers: tuple[str, ...] = ()


def solver_policy(name: str, env: Environment) -> SolverPolicy:
    """A solver of a name, for the arm of a reach environment."""
    return SolverPolicy(new_solver(name, env.get_wrapper_attr("kinematics")), env)


def _reach(name: str) -> DemoTask:
    return DemoTask(
        name, ("observation", "backend"), lambda env: solver_policy("closed-form", env), solvers=tuple(SOLVERS)
    )


TASKS: Mapping[str, DemoTask] = {
    "single": _reach(SINGLE),
    "multi": _reach(MULTI),
    "space": _reach(SPACE),
    # By default this is the test that the course report describes.
    "button": DemoTask(
        BUTTON,
        ("actuation",),
        lambda env: AnalyticButtonPolicy(env.get_wrapper_attr("options").actuation),
        policy="random",
        steps=10_000,
        printed="action,observation",
    ),
}
#: Policies that nobody trained, by name; each is made from the task, the environment and the seed.
POLICIES: Mapping[str, Callable[[DemoTask, Environment, int], Policy]] = {
    "random": lambda task, env, seed: RandomPolicy(env.action_space, seed=seed),
    "analytic": lambda task, env, seed: task.analytic(env),
}


def trained_for(environment: str, arm: str | None = None, *, eyes: bool = False) -> list[str]:
    """Names of the package's policies for an environment, of all arms or of the arm of a name.

    Args:
        environment: Its id.
        arm: Name of the arm.
        eyes: Those that see pictures, instead of those that are told of the goal.
    """
    found = {name: load_policy(name) for name in pretrained_names()}
    return [
        name
        for name, policy in found.items()
        if policy.card.environment == environment
        and arm in (None, trained_arm(policy).get("arm", ARM))
        and bool(policy.network.eyes) == eyes
    ]


def make_policy(name: str, task: DemoTask, env: Environment, *, seed: int = 0) -> Policy:
    """A policy by name, or a trained one: of the package, or from a file.

    Args:
        name: Of `POLICIES`, of the task's `solvers`, or of a policy of the package; or the path of a policy file.
        task: What it will do.
        env: Where.
        seed: Of what it draws.

    Raises:
        InputError: There is none of that name, the file is no policy, or it is for another environment.
    """
    if name in POLICIES:
        return POLICIES[name](task, env, seed)
    if name in task.solvers:
        return solver_policy(name, env)
    trained = trained_for(task.name)
    if name not in trained and not Path(name).suffix:
        raise_unknown(f"policy for {task.name}", name, ("a file of a policy", *POLICIES, *task.solvers, *trained))
    return load_policy(name, environment=task.name)
