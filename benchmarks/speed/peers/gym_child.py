"""What plays and trains in a peer's own process; ours are played and trained by the same functions.

The text of this module is handed to another interpreter, which may be older and need not have kinreach: it imports
nothing of kinreach, and Gymnasium and stable-baselines3 only where they are used. That process reads requests from its
standard input and answers on its standard output, one JSON object a line.
"""

from __future__ import annotations

import importlib
import json
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

#: Random actions that are drawn before the clock runs.
ACTIONS = 256


def random_actions(env: Any, seed: int) -> list[Any]:
    """Actions to play with, drawn from the environment's action space."""
    env.action_space.seed(seed)
    return [env.action_space.sample() for _ in range(ACTIONS)]


def play(env: Any, actions: list[Any], steps: int) -> None:
    """Step a single environment, and reset it where an episode ends."""
    for step in range(steps):
        _, _, terminated, truncated, _ = env.step(actions[step % len(actions)])
        if terminated or truncated:
            env.reset()


def ppo_seconds(vec_env: Any, steps: int, settings: dict[str, Any], seed: int) -> dict[str, float]:
    """Train PPO of stable-baselines3 on one of its vector environments, and time it; see `learning_seconds`.

    Args:
        vec_env: The environment.
        steps: Actions.
        settings: Keyword arguments of `PPO`, those of the policy included.
        seed: Of everything.
    """
    from stable_baselines3 import PPO

    named = hasattr(vec_env.observation_space, "spaces")
    vec_env.seed(seed)
    model = PPO("MultiInputPolicy" if named else "MlpPolicy", vec_env, seed=seed, device="cpu", verbose=0, **settings)
    return learning_seconds(model, vec_env, steps)


def learning_seconds(model: Any, vec_env: Any, steps: int) -> dict[str, float]:
    """Time of `learn` and of its parts.

    Args:
        model: An on-policy algorithm of stable-baselines3.
        vec_env: Its environments.
        steps: Actions.

    Returns:
        `actions` done and, in seconds: `wall`, `processor`, `environment` (steps and resets), `choosing` (the rest of
        the rollouts: the network's actions, and the buffer) and `updating` (gradients).
    """
    spent = dict.fromkeys(("stepping", "resetting", "rollouts", "updating"), 0.0)
    for owner, method, name in (
        (vec_env, "step_wait", "stepping"),
        (vec_env, "reset", "resetting"),
        (model, "collect_rollouts", "rollouts"),
        (model, "train", "updating"),
    ):
        setattr(owner, method, _timed(getattr(owner, method), spent, name))
    processor, wall = time.process_time(), time.perf_counter()
    model.learn(steps, log_interval=None)
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    return {
        "actions": float(model.num_timesteps),
        "wall": wall,
        "processor": processor,
        "environment": spent["stepping"] + spent["resetting"],
        "choosing": spent["rollouts"] - spent["stepping"],  # resets come before the rollouts
        "updating": spent["updating"],
    }


def _timed(call: Callable[..., Any], spent: dict[str, float], name: str) -> Callable[..., Any]:
    def timed(*args: Any, **kwargs: Any) -> Any:
        start = time.perf_counter()
        try:
            return call(*args, **kwargs)
        finally:
            spent[name] += time.perf_counter() - start

    return timed


def serve(setup: dict[str, Any], requests: Iterator[str], answer: Callable[[dict[str, Any]], None]) -> None:
    """Make an environment, say which packages it is of, and do what is asked until nothing more is.

    Args:
        setup: `name` of the environment, `module` that registers it, `packages` whose versions are told, `seed`.
        requests: One JSON object a line: `{"play": steps}`, or `{"ppo": {"steps", "envs", "settings"}}`.
        answer: Takes the answers; `{"error": ...}` where something failed.
    """
    try:
        importlib.import_module(setup["module"])
        import gymnasium

        env = gymnasium.make(setup["name"])
        env.reset(seed=setup["seed"])
        actions = random_actions(env, setup["seed"])
        answer({"python": platform.python_version(), "versions": _versions(setup["packages"])})
    except Exception as error:
        answer({"error": f"{type(error).__name__}: {error}"})
        return
    for line in requests:
        request = json.loads(line)
        try:
            if "play" in request:
                start = time.perf_counter()
                play(env, actions, request["play"])
                answer({"wall": time.perf_counter() - start})
            else:
                answer(_ppo(setup, **request["ppo"]))
        except Exception as error:
            answer({"error": f"{type(error).__name__}: {error}"})


def _ppo(setup: dict[str, Any], steps: int, envs: int, settings: dict[str, Any]) -> dict[str, float]:
    import torch
    from stable_baselines3.common.env_util import make_vec_env

    torch.set_num_threads(1)
    vec_env = make_vec_env(setup["name"], n_envs=envs, seed=setup["seed"])
    try:
        return ppo_seconds(vec_env, steps, settings, setup["seed"])
    finally:
        vec_env.close()


def _versions(packages: list[str]) -> dict[str, str | None]:
    from importlib import metadata

    found: dict[str, str | None] = {}
    for package in packages:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = None
    return found


def main() -> None:
    """Serve on the standard streams; what libraries print there is sent where their errors go."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)

    def answer(value: dict[str, Any]) -> None:
        answers.write(json.dumps(value) + "\n")
        answers.flush()

    serve(json.loads(sys.argv[1]), iter(sys.stdin), answer)


if __name__ == "__main__":
    main()
