"""Methods among obstacles that go through waypoints: postures alone, free lines, planned paths, policies."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from typing import Any

import gymnasium as gym
import numpy as np

from kinreach._checks import Floats
from kinreach.baselines import load_policy
from kinreach.baselines.inside import Policy
from kinreach.envs.inside import ObstaclesEnv, reach_task
from kinreach.errors import PathError
from kinreach.kinematics import joint_line, plan_path
from kinreach.robots.inside import between_phases

#: Time limit of a path's search [s].
TIMEOUT = 5.0


class Waypoints:
    """Go from one waypoint to the next, and stay at the last one.

    Args:
        waypoints: From the first observation to the postures [rad], shape (m, 6).

    Attributes:
        reason: Why there are none, or empty.
    """

    def __init__(self, env: ObstaclesEnv, waypoints: Callable[[Any], Floats]) -> None:
        self._env, self._waypoints = env, waypoints
        self._left: Iterator[Floats] | None = None
        self._target: Floats | None = None
        self.reason = ""

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        self._left, self._target, self.reason = None, None, ""

    def act(self, observation: Any) -> Any:
        if self._left is None:
            try:
                self._left = iter(self._waypoints(observation))
            except PathError as error:
                self.reason = str(error)
                return None
        self._target = next(self._left, self._target)
        return None if self._target is None else self._env.action_for(self._target)


class Steps:
    """A policy of small changes of the joint angles, of `kinreach/UR5MultiStep-v0`."""

    def __init__(self, env: ObstaclesEnv, policy: Policy) -> None:
        self._env, self._policy = env, policy

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        self._policy.reset(observation, info)

    def act(self, observation: Any) -> Any:
        """Return the action that asks for the changed posture, within the joint limits."""
        change = reach_task.MULTI_STEP.scale * np.clip(self._policy.act(observation), -1.0, 1.0)
        return np.clip(self._env.action_for(observation[6:12] + change), -1.0, 1.0)


def from_above(env: ObstaclesEnv, target: Floats) -> Floats:
    """Return the waypoints of the thesis's two phases: shoulder_lift moves last."""
    return np.array([between_phases(env.arm, env.home, target), target])


def solver_from_above(env: gym.Env[Any, Any]) -> Waypoints:
    """Go to the closed form's nearest acceptable posture in two phases."""
    world: Any = env.unwrapped
    return Waypoints(world, lambda observation: from_above(world, _nearest(world)))


def free_way(env: gym.Env[Any, Any]) -> Waypoints:
    """Go to the nearest posture at the goal, of all branches and turns of the tool, that has a free way.

    The way is straight, or from above.
    """
    world: Any = env.unwrapped

    def waypoints(observation: Any) -> Floats:
        goals = world.goal_postures()
        for goal in sorted(goals, key=lambda q: float(np.abs(q - world.home).max())):
            for points in (goal[None], from_above(world, goal)):
                with suppress(PathError):
                    return joint_line(world.clearance, [world.home, *points])[1:]
        raise PathError(f"the straight way to each of {len(goals)} postures, and that from above, is blocked")

    return Waypoints(world, waypoints)


def path_to_one(env: gym.Env[Any, Any]) -> Waypoints:
    """Follow a path to the closed form's nearest acceptable posture."""
    world: Any = env.unwrapped
    return Waypoints(
        world, lambda observation: plan_path(world.clearance, world.home, _nearest(world), timeout=TIMEOUT)[1:]
    )


def path_to_any(env: gym.Env[Any, Any]) -> Waypoints:
    """Follow a path to the first posture that is found at the goal, of all branches and turns of the tool."""
    world: Any = env.unwrapped
    return Waypoints(
        world, lambda observation: plan_path(world.clearance, world.home, world.goal_postures(), timeout=TIMEOUT)[1:]
    )


def trained_posture(name: str) -> Callable[[gym.Env[Any, Any]], Waypoints]:
    """Return a maker of a policy of `kinreach/UR5SingleStep-v0`, whose posture is approached in two phases."""

    def make(env: gym.Env[Any, Any]) -> Waypoints:
        world: Any = env.unwrapped
        policy = load_policy(name)
        return Waypoints(world, lambda observation: from_above(world, world.posture_for(policy.act(observation))))

    return make


def trained_steps(name: str) -> Callable[[gym.Env[Any, Any]], Steps]:
    """Return a maker of a policy of `kinreach/UR5MultiStep-v0`."""
    return lambda env: Steps(env.unwrapped, load_policy(name))  # type: ignore[arg-type]


def _nearest(world: ObstaclesEnv) -> Floats:
    goals = world.goal_postures()
    return np.asarray(goals[np.abs(goals - world.home).max(axis=1).argmin()])
