"""Learning curves and policies of the published trainings, one folder a recipe, and episodes of a policy step by step.

`python -m benchmarks.logs.build` makes them from training runs.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import Floats, as_floats, check_known
from kinreach._registration import MULTI, SINGLE
from kinreach.baselines._learning_curve import COLUMNS, read_curve
from kinreach.baselines._loop import rollout_batch
from kinreach.baselines._policies import LearnedPolicy, load_policy
from kinreach.envs._reach.reach_task import ReachTask
from kinreach.envs.inside import in_doubles
from kinreach.errors import InputError

Array = np.ndarray[Any, Any]

#: Columns by name.
Log = dict[str, Array]

#: Kinds of logs of a seed.
CURVE, EPISODE, REWARDS = "curve", "episode", "rewards"
#: Most rows of a learning curve, and most samples of discounted rewards.
MAX_ROWS, MAX_SAMPLES = 750, 7600
FOLDER = Path(__file__).resolve().parent


def log_names() -> list[str]:
    """Recipes whose logs are here."""
    return sorted(folder.name for folder in FOLDER.iterdir() if any(folder.glob("seed-*.csv")))


def load_logs(recipe: str, what: str = CURVE, *, runs: str | Path | None = None) -> dict[int, Log]:
    """Logs of all seeds of a recipe.

    Args:
        recipe: Its name.
        what: `"curve"`: the learning curve; `"episode"`: one episode step by step; `"rewards"`: the discounted rewards
            after a step.
        runs: Folder of your own training runs, `<recipe>/seed-<k>/`, instead of the logs here; unfinished runs are left
            out. There, `"rewards"` needs a learning curve with a row for each step.

    Returns:
        Columns by seed and name; what is empty is NaN.

    Raises:
        UnknownNameError: There are no logs of the recipe, or no such `what`.
        InputError: There are logs, but not these, or a file is damaged.
    """
    check_known("kind of log", what, (CURVE, EPISODE, REWARDS))
    if runs is not None:
        found = dict(_of_runs(Path(runs) / recipe, what))
    else:
        check_known("logs of the recipe", recipe, log_names())
        ending = ".csv" if what == CURVE else f"-{what}.csv"
        paths = sorted((FOLDER / recipe).glob(f"seed-*{ending}"))
        seeds = {path.name.removesuffix(ending).removeprefix("seed-"): path for path in paths}
        found = {int(seed): read_curve(path) for seed, path in seeds.items() if seed.isdecimal()}
    if not found:
        raise InputError(f"there is no {what} of {recipe!r}")
    return found


def logged_policies(recipe: str, *, runs: str | Path | None = None) -> dict[int, LearnedPolicy]:
    """Policies of all seeds of a recipe, as far as they are kept with the logs; arguments as of `load_logs`.

    Raises:
        InputError: There are none, or a file is damaged.
    """
    policies = [load_policy(file) for file in policies_in(Path(runs or FOLDER) / recipe)]
    if not policies:
        raise InputError(f"there are no policies with the logs of {recipe!r}")
    return {policy.card.seed: policy for policy in policies}


def policies_in(folder: Path) -> list[Path]:
    """Policies of all seeds of a recipe, in the folder of its trainings or of its logs, `seed-0.safetensors`."""
    return sorted(folder.glob("seed-*/policy.safetensors")) or sorted(folder.glob("seed-*.safetensors"))


def thinned(log: Mapping[str, Array], most: int = MAX_ROWS) -> Log:
    """A learning curve in wider windows, all of the same number of rows; an incomplete last one is left out.

    Steps and episodes are those at the end of a window. What is of a step is averaged over the steps of the window,
    what is of an episode over the episodes that ended in it.

    Args:
        log: Columns by name, those of `COLUMNS`.
        most: Most rows.
    """
    rows = len(log["steps"])
    width = -(-rows // most) or 1
    shape = (rows // width, width)

    def windows(values: Array) -> Array:
        return values[: shape[0] * width].reshape(shape)

    found: Log = {}
    for name in COLUMNS:
        if name in ("steps", "episodes"):
            found[name] = windows(log[name])[:, -1]
            continue
        counted = log["steps"] if name in ("reward", "impossible") else log["episodes"]
        values, weights = windows(log[name]), windows(np.diff(counted, prepend=0.0))
        weights = np.where(np.isnan(values), 0.0, weights)
        total = weights.sum(axis=1)
        sums = (np.nan_to_num(values) * weights).sum(axis=1)
        found[name] = np.divide(sums, total, out=np.full(shape[0], np.nan), where=total > 0)
    return found


def sampled_returns(log: Mapping[str, Array], gamma: float, most: int = MAX_SAMPLES) -> Log:
    """Discounted rewards from single steps of training to the end of their episodes; with γ = 0 their rewards.

    Args:
        log: A learning curve with a row for each step.
        gamma: Discount factor.
        most: Most samples. They are equally far apart, by a prime number, so that they do not fall into step with
            episodes of one length.

    Returns:
        `steps` and `discounted`, each of shape (n,).

    Raises:
        InputError: The rows are of more than one step.
    """
    steps, episodes = log["steps"], log["episodes"]
    if not np.array_equal(steps, np.arange(1, len(steps) + 1)):
        raise InputError("discounted rewards need a learning curve with a row for each step: train with window=1")
    returns = discounted_returns(log["reward"], np.diff(episodes, prepend=0.0) > 0, gamma)
    every = -(-len(steps) // most) or 1
    while any(every % divisor == 0 for divisor in range(2, every)):
        every += 1
    return {"steps": steps[every - 1 :: every], "discounted": returns[every - 1 :: every]}


def discounted_returns(rewards: Array, ends: Array, gamma: float) -> Floats:
    """Discounted sum of the rewards from each step to the end of its episode (thesis 2.4), shape (n,).

    Args:
        rewards: Of successive steps, shape (n,). What follows the last step counts as nothing.
        ends: Whether an episode ended with the step, shape (n,).
        gamma: Discount factor, 0 to 1.
    """
    returns = np.empty(len(rewards))
    following = 0.0
    for step in range(len(rewards) - 1, -1, -1):
        following = rewards[step] + (0.0 if ends[step] else gamma * following)
        returns[step] = following
    return returns


def reached_per_thousand(log: Mapping[str, Array], *, of: str) -> Array:
    """How often a goal was reached in a thousand episodes, or steps, shape (n,): one value for each window.

    Args:
        log: A learning curve.
        of: `"episodes"` or `"steps"`.

    Raises:
        UnknownNameError: Neither of them.
    """
    check_known("unit", of, ("episodes", "steps"))
    ended = np.diff(log["episodes"], prepend=0.0)
    counts = np.nan_to_num(log["reached"]) * ended
    per = ended if of == "episodes" else np.diff(log["steps"], prepend=0.0)
    return 1000 * np.divide(counts, per, out=np.full(len(per), np.nan), where=per > 0)


def _of_runs(runs: Path, what: str) -> Iterator[tuple[int, Log]]:
    for folder in sorted(runs.glob("seed-*")):
        seed = folder.name.removeprefix("seed-")
        file = folder / ("episode.csv" if what == EPISODE else "curve.csv")
        finished = (folder / "run.json").exists()
        if not (seed.isdecimal() and finished and file.exists()):
            continue
        log = read_curve(file)
        if what == REWARDS:
            log = sampled_returns(log, json.loads((folder / "run.json").read_text())["recipe"]["settings"]["gamma"])
        yield int(seed), thinned(log) if what == CURVE else log


@dataclass(frozen=True, eq=False)
class Trace:
    """Episodes side by side; row 0 is the start, row k is after step k.

    After the end of its episode an arm stays where it is in here.

    Attributes:
        distance: To the goal [m], shape (steps + 1, n).
        q: Joint angles [rad], shape (steps + 1, n, joints).
        posture_error: r_e [rad], shape (steps, n).
        reward: Shape (steps, n); after the end not a number.
        reached: Whether the goal was reached at the end, shape (n,).
        impossible: Whether the last action was, shape (n,).
    """

    distance: Floats
    q: Floats
    posture_error: Floats
    reward: Floats
    reached: Any
    impossible: Any


def trace(policy: LearnedPolicy, goals: ArrayLike, *, options: Mapping[str, Any] | None = None) -> Trace:
    """Play one deterministic episode for each goal.

    Args:
        policy: For one of the thesis's reach tasks, on any arm.
        goals: Positions in the world [m], shape (n, 3).
        options: Of the environment; those which the policy was trained with, unless they say otherwise.

    Raises:
        InputError: The policy is for another environment, or sees pictures, the goals are malformed, or options that
            the environment does not take.
    """
    goals = as_floats("goals", goals)
    environment = policy.card.environment
    if environment not in (SINGLE, MULTI):
        raise InputError(f"a trace needs a policy for {SINGLE} or {MULTI}, got one for {environment}")
    if policy.network.eyes:
        raise InputError(f"a trace needs a policy that observes numbers; {policy.name} takes pictures")
    if goals.ndim != 2 or goals.shape[1] != 3 or not len(goals):
        raise InputError(f"goals must have shape (n, 3), got {goals.shape}")
    given = {**in_doubles(environment), **policy.needed_options, **(options or {})}
    env: Any = gym.make_vec(environment, num_envs=len(goals), vectorization_mode="vector_entry_point", **given)
    try:
        return _play(env, policy, goals)
    finally:
        env.close()


def _play(env: Any, policy: LearnedPolicy, goals: Floats) -> Trace:
    task: ReachTask = env.unwrapped.task
    start = np.tile(task.home, (len(goals), 1))
    first = np.linalg.norm(task.kinematics.positions(start) - goals, axis=1)
    q, distance = [start], [first]
    posture_error: list[Floats] = []
    reward: list[Floats] = []

    def keep(observations: Any, rewards: Any, info: Mapping[str, Any], pending: Any) -> None:
        q.append(np.where(pending[:, None], observations[:, task.layout.q], q[-1]))
        distance.append(np.where(pending, info["distance"], distance[-1]))
        posture_error.append(np.where(pending, info["posture_error"], posture_error[-1] if posture_error else np.nan))
        reward.append(np.where(pending, rewards, np.nan))

    trials = rollout_batch(env, policy, seed=0, options={"goal": goals}, watch=keep)
    return Trace(
        distance=np.array(distance),
        q=np.array(q),
        posture_error=np.array(posture_error),
        reward=np.array(reward),
        reached=np.array([trial["reached"] for trial in trials]),
        impossible=np.array([trial["impossible"] for trial in trials]),
    )
