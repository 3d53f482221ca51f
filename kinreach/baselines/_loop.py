"""The loop between policies and environments.

A policy is any object with `reset(observation, info)` and `act(observation)`: a solver, a network, a script, chance.
`as_policy` makes one of a function, of a stable-baselines3 model, or of an object with `act` alone.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Protocol
from zlib import crc32

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from kinreach._checks import shown
from kinreach._statistics import COMPLETED, MISSED, Trial
from kinreach.baselines._batch import last_step
from kinreach.errors import InputError

Watch = Callable[[gym.Env[Any, Any], Mapping[str, Any]], object]
#: Called with observations, rewards and `info` of a batch's step, and which environments are in their first episode.
WatchBatch = Callable[[NDArray[Any], NDArray[Any], Mapping[str, Any], NDArray[np.bool_]], object]


class Policy(Protocol):
    """An object that chooses actions.

    Optional: `reason`, why its last action was None; `diagnostics`, numbers about its last decision by name, such as
    `iterations`, which a trial sums up; and `check_spaces(observation_space, action_space)`, which raises an
    `InputError` for spaces that it cannot act in.
    """

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        """Begin an episode with what the environment's reset returned."""
        ...

    def act(self, observation: Any) -> Any:
        """Return the action for an observation, or None to forfeit the episode."""
        ...


class FunctionPolicy:
    """A policy without memory: a function from an observation to an action."""

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self._function = function

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        """Do nothing: a function has no memory."""

    def act(self, observation: Any) -> Any:
        return self._function(observation)


class RandomPolicy:
    """Draw actions uniformly, seeded by `seed` and the first observation of an episode.

    Args:
        action_space: Of the environment.
        seed: Of the draws.
    """

    def __init__(self, action_space: spaces.Space[Any], *, seed: int = 0) -> None:
        self._space = action_space
        self._seed = seed

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        """Start the draws of an episode."""
        if isinstance(observation, Mapping):  # pictures, mostly
            start = [crc32(np.ascontiguousarray(part).tobytes()) for part in observation.values()]
        else:
            content = np.ascontiguousarray(observation).tobytes()
            start = [crc32(content)] if len(content) % 4 else np.frombuffer(content, dtype=np.uint32).tolist()
        entropy = np.random.SeedSequence([self._seed, *start])
        self._space.seed(int(entropy.generate_state(1)[0]))

    def act(self, observation: Any) -> Any:
        """Draw an action, whatever the observation."""
        return self._space.sample()


def as_policy(given: Any) -> Policy:
    """Make a policy of one, of a model with stable-baselines3's `predict`, or of a function of the observation."""
    if callable(getattr(given, "act", None)):
        return given if callable(getattr(given, "reset", None)) else FunctionPolicy(given.act)
    if callable(getattr(given, "predict", None)):
        return FunctionPolicy(lambda observation: given.predict(observation, deterministic=True)[0])
    if callable(given):
        return FunctionPolicy(given)
    raise InputError(f"a policy has act(observation), predict(observation) or is a function, got {shown(given)}")


def rollout(
    env: gym.Env[Any, Any], policy: Policy, resets: Iterable[Mapping[str, Any]], *, watch: Watch | None = None
) -> Iterator[Trial]:
    """Play one episode after another, each from its start to its end.

    Args:
        env: The environment.
        policy: Acts.
        resets: Keyword arguments of `env.reset`, one mapping an episode: `seed`, `options`.
        watch: Called with the environment and its `info` after every reset and step, for example to draw it.

    Yields:
        A trial an episode: the numbers, truth values, texts and vectors of the environment's last `info`, and
        `steps`, `reward` (of the last step), `return` (sum of all), `solve_s` (wall time of the policy [s]), and the
        sums of the policy's `diagnostics`.

    Examples:
        >>> import gymnasium as gym
        >>> import kinreach
        >>> from kinreach.baselines import RandomPolicy, rollout
        >>> env = gym.make("kinreach/UR5SingleStep-v0", observation="geometric", backend="kinematic")
        >>> trials = list(rollout(env, RandomPolicy(env.action_space), [{"seed": seed} for seed in range(3)]))
        >>> len(trials), trials[0]["steps"]
        (3, 1)
    """
    _check_spaces(policy, env.observation_space, env.action_space)
    for reset in resets:
        yield _episode(env, policy, reset, watch)


def _check_spaces(policy: Policy, observations: spaces.Space[Any], actions: spaces.Space[Any]) -> None:
    check = getattr(policy, "check_spaces", None)
    if check is not None:
        check(observations, actions)


def _episode(env: gym.Env[Any, Any], policy: Policy, reset: Mapping[str, Any], watch: Watch | None) -> Trial:
    observation, info = env.reset(**reset)
    if watch is not None:
        watch(env, info)
    start = time.perf_counter()
    policy.reset(observation, info)
    solve_s = time.perf_counter() - start
    steps, reward, returned, over = 0, 0.0, 0.0, False
    efforts: dict[str, float] = {}
    while not over:
        start = time.perf_counter()
        action = policy.act(observation)
        solve_s += time.perf_counter() - start
        for name, value in getattr(policy, "diagnostics", {"iterations": 1}).items():
            efforts[name] = efforts.get(name, 0) + value
        if action is None:
            observation, reward, terminated, truncated, info = forfeit(env, getattr(policy, "reason", ""), info)
        else:
            observation, gained, terminated, truncated, info = env.step(action)
            reward = float(gained)
        steps += 1
        returned += reward
        over = terminated or truncated
        if watch is not None:
            watch(env, info)
    return {**flat(info), "steps": steps, "reward": reward, "return": returned, "solve_s": solve_s, **efforts}


def forfeit(env: gym.Env[Any, Any], reason: str, info: Mapping[str, Any]) -> tuple[Any, float, bool, bool, Any]:
    """End an episode in which a policy found no action, by the environment's own `forfeit`.

    Without one, the episode ends with the last `info`, nothing reached, and no reward.
    """
    judge = getattr(env.unwrapped, "forfeit", None)
    if judge is not None:
        return judge(reason)
    verdict = {"reached": False, "is_success": False, "impossible": True, "status": "forfeited"}
    return None, 0.0, True, False, {**info, **verdict, "impossible_reason": reason}


def rollout_batch(
    env: VectorEnv[Any, Any, Any],
    policy: Policy,
    *,
    seed: int,
    options: Mapping[str, Any] | None = None,
    watch: WatchBatch | None = None,
) -> list[Trial]:
    """Play the first episode of every environment of a batch, all in step; return a trial for each.

    Trials are as `rollout` yields them, without clocks. Episodes may start anew in the step in which they end. The
    seeds count up from `seed`; `watch` is called after every step.
    """
    _check_spaces(policy, env.single_observation_space, env.single_action_space)
    count = env.num_envs
    trials: list[Trial] = [{} for _ in range(count)]
    steps, returned = np.zeros(count, dtype=np.int64), np.zeros(count)
    pending = np.ones(count, dtype=np.bool_)
    observations, info = env.reset(seed=seed, options=None if options is None else dict(options))
    policy.reset(observations, info)
    while pending.any():
        observations, rewards, terminated, truncated, info = env.step(policy.act(observations))
        steps += pending
        returned += np.where(pending, rewards, 0.0)
        if watch is not None:
            ended = np.flatnonzero(terminated | truncated)
            seen = observations
            if len(ended):
                seen = np.array(observations)
                seen[ended] = np.stack(list(info["final_obs"][ended]))
            watch(seen, rewards, last_step(info), pending.copy())
        over = np.flatnonzero((terminated | truncated) & pending)
        for index in over:
            trials[index] = {
                **flat(_row(info, index)),
                "steps": int(steps[index]),
                "reward": float(rewards[index]),
                "return": float(returned[index]),
            }
        pending[over] = False
    return trials


def _row(info: Mapping[str, Any], index: int) -> dict[str, Any]:
    """Return what a batch's info holds of one environment's last step."""
    last = info.get("final_info", info)
    return {
        name: values[index]
        for name, values in last.items()
        if isinstance(values, np.ndarray) and len(values) and not name.startswith(("_", "final_"))
    }


def flat(info: Mapping[str, Any]) -> Trial:
    """Return numbers, truth values, texts and vectors of an `info` as Python's types; None if not finite."""
    found = {name: _plain(value) for name, value in info.items() if not isinstance(value, Mapping)}
    found.setdefault("reached", bool(found.get("is_success", False)))
    found.setdefault("impossible", False)
    found.setdefault("status", COMPLETED if found["reached"] else MISSED)
    return found


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return _vector(value) if value.ndim else _plain(value[()])
    if isinstance(value, np.bool_ | bool):
        return bool(value)
    if isinstance(value, np.integer | int):
        return int(value)
    if isinstance(value, np.floating | float):
        return float(value) if np.isfinite(value) else None
    return value if isinstance(value, str) else None


def _vector(values: NDArray[Any]) -> list[Any] | None:
    finite = values.dtype.kind != "f" or bool(np.isfinite(values).all())
    return values.ravel().tolist() if finite else None
