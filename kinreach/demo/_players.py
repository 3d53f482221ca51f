"""Environments that the demo and the page play, and the players for each of them, by name."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import load_env_creator

from kinreach._objects import load_module
from kinreach._registration import ENVIRONMENTS, KINEMATIC_ENVIRONMENTS, REAL_ARM
from kinreach.baselines import RandomPolicy, load_policy
from kinreach.baselines.inside import (
    LearnedPolicy,
    Policy,
    SolverPolicy,
    as_policy,
    pretrained_names,
)
from kinreach.compare import Method, Task
from kinreach.compare.inside import all_tasks, resolve_methods
from kinreach.errors import InputError, raise_unknown
from kinreach.kinematics import ArmKinematics
from kinreach.kinematics.inside import SOLVERS, new_solver
from kinreach.robots import THESIS_ARM, ArmDescription

RANDOM = "random"
#: Options of environments that the page lets the user choose.
CHOICES = frozenset(("arm", "observation", "backend"))
#: Otherwise than in the comparison: an episode that can be watched to its end.
SHORTER: Mapping[str, Mapping[str, Any]] = {REAL_ARM: {"balls": 4, "budgets": (0, 5, 20)}}


@dataclass(frozen=True)
class Playable:
    """A registered environment.

    Attributes:
        choices: Which of `CHOICES` are options of it.
        solvable: Whether solvers of inverse kinematics can act in it.
        drawn: Whether it has a `render_mode`.
        tasks: Comparisons in it.
    """

    name: str
    choices: frozenset[str]
    solvable: bool
    drawn: bool
    tasks: tuple[Task, ...]

    @property
    def options(self) -> Mapping[str, Any]:
        """Options of an episode besides the choices: those of the comparison."""
        own = (task.options for task in self.tasks if task.environment == self.name)
        return SHORTER.get(self.name, next(own, {}))

    def methods(self, arm: str | None = None) -> dict[str, Method]:
        """Return the methods of its comparisons by name: all, or those for an arm or for tasks without one."""
        return {
            name: method
            for task in self.tasks
            for name, method in task.methods.items()
            if (method.environment or task.environment) == self.name and (arm is None or task.arm in ("", arm))
        }

    @property
    def trained_in(self) -> str:
        """Id of the environment that policies for this one are trained in: the one with dynamics."""
        points = KINEMATIC_ENVIRONMENTS.get(self.name)
        return next((name for name, others in ENVIRONMENTS.items() if others == points), self.name)

    def trained(self, arm: str | None = None, *, eyes: bool = False) -> list[str]:
        """Return names of the package's policies for it, of all arms or of the arm of a name.

        With `eyes` those that observe pictures, instead of those that observe the goal.
        """
        found = {name: load_policy(name) for name in pretrained_names()}
        return [
            name
            for name, policy in found.items()
            if policy.card.environment == self.trained_in
            and arm in (None, policy.arm or THESIS_ARM)
            and bool(policy.network.eyes) == eyes
        ]

    def policy(self, name: str) -> LearnedPolicy | None:
        """Return a policy of the package for it, or from a file; None where the name is of neither."""
        known = name in self._all_trained() or (":" not in name and bool(Path(name).suffix))
        return load_policy(name, environment=self.trained_in) if known else None

    def needed(self, player: str) -> dict[str, Any]:
        """Return the options that a trained player needs; none for other players."""
        policy = self.policy(player)
        return {} if policy is None else policy.needed_options

    def players(self, arm: ArmDescription, *, observation: str = "") -> tuple[str, ...]:
        """Return names for `new_player`, solvers first; with pictures only policies that see them, or need none."""
        eyes = observation == "pixels"
        closed = self.solvable and ArmKinematics.of(arm).knows_all_postures
        solvers = [name for name in SOLVERS if self.solvable and (closed or name != "closed-form")]
        trained = self.trained(arm.name if "arm" in self.choices else None, eyes=eyes)
        shipped = {f"policy {name}" for name in self.trained()}
        methods = [
            name
            for name, method in self.methods(arm.name).items()
            if not eyes and not (method.is_policy and shipped & set(method.versions))
        ]
        return (*(name for name in dict.fromkeys((*solvers, *methods, *trained)) if name != RANDOM), RANDOM)

    def new_player(self, name: str, env: gym.Env[Any, Any], *, seed: int = 0) -> Policy:
        methods = self.methods()
        if name == RANDOM:
            return RandomPolicy(env.action_space, seed=seed)
        if name in SOLVERS and self.solvable:
            return SolverPolicy(new_solver(name, env.get_wrapper_attr("kinematics")), env)
        if name in methods:
            return as_policy(methods[name].make(env))
        if ":" in name:
            task = Task(self.name, self.name, self.name, resets=lambda count, seed, env: (), methods={}, columns=())
            (method,) = resolve_methods(task, [name]).values()
            return as_policy(method.make(env))
        policy = self.policy(name)
        if policy is None:
            names = (*(SOLVERS if self.solvable else ()), *methods, *self._all_trained())
            raise_unknown(f"policy for {self.name}", name, ("a file of a policy", RANDOM, *names))
        return policy

    def _all_trained(self) -> list[str]:
        """Return names of the package's policies for it, of every arm and with eyes or without."""
        return [*self.trained(), *self.trained(eyes=True)]


def playable_names() -> tuple[str, ...]:
    compared = (task.environment for task in all_tasks())
    return tuple(dict.fromkeys((*ENVIRONMENTS, *compared, *KINEMATIC_ENVIRONMENTS)))


def playable(name: str) -> Playable:
    """Look up an environment by its id; for `module:id` the module is imported first."""
    module, _, name = name.rpartition(":")
    if module:
        load_module("environment", module, f"{module}:{name}")
    try:
        spec = gym.spec(name)
    except gym.error.Error as error:
        raise InputError(f"there is no environment {name!r}: {error}") from None
    made: Any = load_env_creator(spec.entry_point) if isinstance(spec.entry_point, str) else spec.entry_point
    return Playable(
        name,
        choices=CHOICES & set(inspect.signature(made).parameters) - set(spec.kwargs),
        solvable=hasattr(made, "action_for"),
        drawn="rgb_array" in getattr(made, "metadata", {}).get("render_modes", ()),
        tasks=tuple(t for t in all_tasks() if name in (t.environment, *t.variants)),
    )


def new_player(name: str, env: gym.Env[Any, Any], *, seed: int = 0) -> Policy:
    """Make a player for an environment.

    Args:
        name: One of `Playable.players`; of a policy of the package; the path of a policy's file; or
            `module:attribute`, a solver, a policy or a class of one, as for `kinreach.compare`.
        env: From `gym.make`.
        seed: Of the player.

    Raises:
        InputError: Unknown name, the file is not a policy, or it is for another environment.
    """
    return playable(env.spec.id).new_player(name, env, seed=seed)  # type: ignore[union-attr]
