"""Solvers of inverse kinematics as policies."""

from __future__ import annotations

import inspect
import time
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np

from kinreach._checks import Floats, shown
from kinreach.baselines._loop import Policy
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, IKResult, Solver


class SolverPolicy:
    """Move the arm to a solver's posture for the goal of an episode.

    The goal is where the cameras saw it (`info["seen"]`). Postures must pass the environment's acceptance test; after
    a refusal the solver tries another branch or a restart.

    Args:
        solver: For the arm of the environment, in the world frame.
        env: A reach environment.
        proposer: A policy for the same environment whose first action is the solver's start; by default it starts at
            the arm's posture.

    Attributes:
        diagnostics: Iterations, restarts, candidates (postures put to the acceptance test) and its time [s].
        reason: Why the last action was None, else empty.
    """

    def __init__(self, solver: Solver, env: gym.Env[Any, Any], *, proposer: Policy | None = None) -> None:
        self._solver = solver
        reach: Any = env.unwrapped
        _check_solver(solver, reach.kinematics)
        self._env = reach
        self._proposer = proposer
        self.diagnostics: Mapping[str, float] = {}
        self.reason = ""
        self._seed: Floats = np.empty(0)
        self._seen: Floats = np.empty(0)
        self._target: Floats | None = None

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        self._seed, self._seen = np.asarray(info["q"]), np.asarray(info["seen"])
        self._target = None
        if self._proposer is not None:
            self._proposer.reset(observation, info)

    def act(self, observation: Any) -> Any:
        """Return the action; None if no camera found the goal or the solver finds no posture."""
        self.diagnostics = {"iterations": 0}
        if self._target is None:
            self._target = self._solve(observation)
        return None if self._target is None else self._env.action_for(self._target)

    def _solve(self, observation: Any) -> Floats | None:
        if not np.isfinite(self._seen).all():
            self.reason = "no camera found the ball"
            return None
        seed = self._seed
        if self._proposer is not None:
            seed = self._env.posture_for(self._proposer.act(observation))
        test = _Acceptance(self._env)
        result: Any = self._solver.solve(self._env.ik_goal(self._seen), seed, accept=test)
        if not isinstance(result, IKResult):
            raise InputError(f"solve() must return an IKResult, see IKResult.of; got {shown(result)}")
        self.diagnostics = {
            "iterations": result.iterations,
            "restarts": result.restarts,
            "candidates": test.calls,
            "accept_s": test.seconds,
        }
        self.reason = result.reason
        return result.q if result.success else None


def _check_solver(solver: Any, wanted: ArmKinematics) -> None:
    """Check that a solver accepts an acceptance test and has the environment's base and tip."""
    parameters = inspect.signature(solver.solve).parameters.values()
    if not any(one.name == "accept" or one.kind is one.VAR_KEYWORD for one in parameters):
        raise InputError(f"{type(solver).__name__}.solve() must take accept=, the test that postures have to pass")
    for found in vars(solver).values() if hasattr(solver, "__dict__") else ():
        if isinstance(found, ArmKinematics) and (found.base, found.tip) != (wanted.base, wanted.tip):
            raise InputError(
                f"{type(solver).__name__} solves for the tip {found.tip!r} in {found.base!r}, the task asks for "
                f"{wanted.tip!r} in {wanted.base!r}; hand over the class, which is then given the task's kinematics"
            )


class _Acceptance:
    """An environment's acceptance test with a clock."""

    def __init__(self, env: Any) -> None:
        self._env = env
        self.seconds = 0.0
        self.calls = 0

    def __call__(self, q: Floats) -> bool:
        start = time.perf_counter()
        accepted = bool(self._env.accept(q))
        self.seconds += time.perf_counter() - start
        self.calls += 1
        return accepted
