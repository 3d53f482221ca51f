"""Environments that can be watched, and their policies, by the names of the command line and of the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym

from kinreach._registration import BUTTON, LIFT, MOVING, MULTI, OBSTACLES, REAL_ARM, SINGLE, SPACE
from kinreach.baselines._button_controller import AnalyticButtonPolicy
from kinreach.baselines._grasp_policy import GraspPolicy
from kinreach.baselines._loop import Policy, RandomPolicy, as_policy
from kinreach.baselines._policies import LearnedPolicy, load_policy, needed_options, pretrained_names, trained_arm
from kinreach.baselines._solver_policy import SolverPolicy
from kinreach.compare._task import Method, get_task
from kinreach.demo._film import FILM_FPS
from kinreach.errors import raise_unknown
from kinreach.kinematics._solvers import SOLVERS, new_solver

Environment = gym.Env[Any, Any]

#: Of policies that are trained for an arm that their card does not name.
ARM = "ur5"
#: Otherwise than in the comparison: an episode that can be watched to its end.
SHORTER: Mapping[str, Mapping[str, Any]] = {REAL_ARM: {"balls": 4, "budgets": (0, 5, 20)}}


@dataclass(frozen=True)
class DemoTask:
    """An environment that can be watched.

    Attributes:
        analytic: Makes its analytic policy from the environment.
        policy, steps, printed: Defaults of the command line.
        solvers: Names of solvers that can act in it.
        comparison: The task of `kinreach.compare` in it, whose options it has and whose methods can act; or none.
        drawn: Whether the environment draws itself.
        fps: Frames per second of a film, in the time of the simulation.
        done: Text for success in a film.
    """

    name: str
    analytic: Callable[[Environment], Policy]
    policy: str = "analytic"
    steps: int = 20
    printed: str = "reward"
    solvers: tuple[str, ...] = ()
    comparison: str = ""
    drawn: bool = True
    fps: int = FILM_FPS
    done: str = "reached"

    @property
    def settings(self) -> Mapping[str, Any]:
        """Defaults of the options of its environment."""
        return SHORTER.get(self.name, get_task(self.comparison).options if self.comparison else {})

    @property
    def methods(self) -> Mapping[str, Method]:
        """Of the comparison, by name."""
        return get_task(self.comparison).methods if self.comparison else {}


def solver_policy(name: str, env: Environment) -> SolverPolicy:
    """Return a solver of a name, for the arm of a reach environment."""
    return SolverPolicy(new_solver(name, env.get_wrapper_attr("kinematics")), env)


def _reach(name: str, comparison: str = "") -> DemoTask:
    return DemoTask(
        name,
        lambda env: solver_policy("closed-form", env),
        solvers=tuple(SOLVERS),
        comparison=comparison,
    )


def _compared(name: str, comparison: str, *, policy: str, steps: int, fps: int = FILM_FPS) -> DemoTask:
    return DemoTask(
        name,
        lambda env: as_policy(get_task(comparison).methods[policy].make(env)),
        policy=policy,
        steps=steps,
        comparison=comparison,
        drawn=False,
        fps=fps,
    )


TASKS: Mapping[str, DemoTask] = {
    "single": _reach(SINGLE),
    "multi": _reach(MULTI),
    "space": _reach(SPACE, "space"),
    "real-arm": _compared(REAL_ARM, "real-arm", policy="identified", steps=6),
    "moving": _compared(MOVING, "moving", policy="interception", steps=200, fps=30),
    "obstacles": _compared(OBSTACLES, "obstacles", policy="path", steps=20),
    "lift": DemoTask(
        LIFT,
        lambda env: GraspPolicy(new_solver("closed-form", env.get_wrapper_attr("kinematics")), env),
        steps=5,
        comparison="lift",
        done="lifted",
    ),
    # By default this is the test that the course report describes.
    "button": DemoTask(
        BUTTON,
        lambda env: AnalyticButtonPolicy(env.get_wrapper_attr("options").actuation),
        policy="random",
        steps=10_000,
        printed="action,observation",
    ),
}
#: Policies without training, by name; each is made from the task, the environment and the seed.
POLICIES: Mapping[str, Callable[[DemoTask, Environment, int], Policy]] = {
    "random": lambda task, env, seed: RandomPolicy(env.action_space, seed=seed),
    "analytic": lambda task, env, seed: task.analytic(env),
}


def trained_for(environment: str, arm: str | None = None, *, eyes: bool = False) -> list[str]:
    """Return names of the package's policies for an environment, of all arms or of the arm of a name.

    With `eyes` those that observe pictures, instead of those that observe the goal.
    """
    found = {name: load_policy(name) for name in pretrained_names()}
    return [
        name
        for name, policy in found.items()
        if policy.card.environment == environment
        and arm in (None, trained_arm(policy).get("arm", ARM))
        and bool(policy.network.eyes) == eyes
    ]


def all_trained(environment: str) -> list[str]:
    """Return names of the package's policies for an environment, of every arm and with eyes or without."""
    return [*trained_for(environment), *trained_for(environment, eyes=True)]


def trained_policy(name: str, environment: str) -> LearnedPolicy | None:
    """Return a policy of the package for an environment, or from a file; None where the name is of neither."""
    known = name in all_trained(environment) or bool(Path(name).suffix)
    return load_policy(name, environment=environment) if known else None


def options_for(name: str, environment: str) -> dict[str, Any]:
    """Return the options that a trained policy needs (`needed_options`); none for other policies."""
    policy = trained_policy(name, environment)
    return {} if policy is None else needed_options(policy)


def make_policy(name: str, task: DemoTask, env: Environment, *, seed: int = 0) -> Policy:
    """Return a policy by name, or a trained one: of the package, or from a file."""
    if name in POLICIES:
        return POLICIES[name](task, env, seed)
    if name in task.solvers:
        return solver_policy(name, env)
    if name in task.methods:
        return as_policy(task.methods[name].make(env))
    policy = trained_policy(name, task.name)
    if policy is None:
        known = (*POLICIES, *task.solvers, *task.methods, *all_trained(task.name))
        raise_unknown(f"policy for {task.name}", name, ("a file of a policy", *known))
    return policy
