"""Learning curves that come with the package or were trained, and what a policy does step by step."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from kinreach.baselines.learning_curve import COLUMNS, read_curve
from kinreach.baselines.loop import rollout_batch
from kinreach.baselines.policies import LearnedPolicy, load_policy, needed_options
from kinreach.checks import Floats, as_floats, check_count, check_known, check_number, check_path, shown
from kinreach.envs.reach.task import ReachTask
from kinreach.errors import InputError, raise_unknown
from kinreach.files import read_text
from kinreach.registration import MULTI, SINGLE

Array = np.ndarray[Any, Any]

#: Columns by name.
Log = dict[str, Array]

#: What there can be of a seed.
CURVE, EPISODE, REWARDS = "curve", "episode", "rewards"
#: Size of a `run.json` [bytes].
MOST_RUN = 16 * 1024 * 1024
#: Most rows of a shipped learning curve, and most samples of what followed a step.
MOST_ROWS, MOST_SAMPLES = 750, 7600


def log_names() -> list[str]:
    """Recipes whose logs come with the package."""
    return sorted(folder.name for folder in _shipped().iterdir() if folder.is_dir())


def load_logs(recipe: str, what: str = CURVE, *, runs: str | Path | None = None) -> dict[int, Log]:
    """Logs of all seeds of a recipe.

    Args:
        recipe: Its name.
        what: `"curve"`: the learning curve; `"episode"`: one episode step by step; `"rewards"`: what followed a step.
        runs: Folder of own training runs, `<recipe>/seed-<k>/`, instead of what comes with the package; unfinished
            ones do not count. There, `"rewards"` needs a learning curve with a row for each step.

    Returns:
        Columns by seed and name; what is empty is NaN.

    Raises:
        UnknownNameError: There are no logs of the recipe, or no such `what`.
        InputError: There are logs, but not these, or a file is damaged.
    """
    check_known("kind of log", what, (CURVE, EPISODE, REWARDS))
    if runs is not None:
        found = dict(_of_runs(_own(runs, recipe), what))
    else:
        check_known("logs of the recipe", recipe, log_names())
        with resources.as_file(_shipped() / recipe) as folder:
            ending = ".csv" if what == CURVE else f"-{what}.csv"
            files = {path.name.removesuffix(ending).removeprefix("seed-"): path for path in folder.glob(f"*{ending}")}
            found = {int(seed): read_curve(path) for seed, path in sorted(files.items()) if seed.isdecimal()}
    if not found:
        raise InputError(f"there is no {what} of {recipe!r}")
    return found


def logged_policies(recipe: str, *, runs: str | Path | None = None) -> dict[int, LearnedPolicy]:
    """Policies of all seeds of a recipe, where they come with the logs.

    Args:
        recipe: Its name.
        runs: As for `load_logs`.

    Raises:
        InputError: There are none, or a file is damaged.
    """
    with resources.as_file(_shipped() / _folder(recipe)) as folder:
        where = folder if runs is None else _own(runs, recipe)
        pattern = "seed-*.safetensors" if runs is None else "seed-*/policy.safetensors"
        found = {}
        for file in sorted(where.glob(pattern)):
            policy = load_policy(file)
            found[policy.card.seed] = policy
    if not found:
        raise InputError(f"there are no policies with the logs of {recipe!r}")
    return found


def thinned(log: Mapping[str, Array], most: int = MOST_ROWS) -> Log:
    """A learning curve in wider windows, all of the same number of rows; an incomplete last one is left out.

    Steps and episodes are those at the end of a window. What is of a step is averaged over the steps of the window,
    what is of an episode over the episodes that ended in it.

    Args:
        log: Columns by name, those of `COLUMNS`.
        most: Most rows.

    Raises:
        InputError: Columns are missing, or `most` is below 1.
    """
    given: object = log
    if missing := [name for name in COLUMNS if not isinstance(given, Mapping) or name not in given]:
        raise InputError(f"a learning curve needs the columns {', '.join(missing)}")
    most = check_count("the number of rows", most)
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


def sampled_returns(log: Mapping[str, Array], gamma: float, most: int = MOST_SAMPLES) -> Log:
    """What followed single steps of training, discounted; with γ = 0 just their rewards.

    Args:
        log: A learning curve with a row for each step.
        gamma: Discount factor.
        most: Most samples; they are equally far apart.

    Returns:
        `steps` and `discounted`, each of shape (n,).

    Raises:
        InputError: The rows are of more than one step, `gamma` is outside 0 … 1, or `most` is below 1.
    """
    most = check_count("the number of samples", most)
    gamma = check_number("gamma", gamma, least=0.0, most=1.0)
    steps, episodes = log["steps"], log["episodes"]
    if not np.array_equal(steps, np.arange(1, len(steps) + 1)):
        raise InputError("what followed a step needs a learning curve with a row for each step: train with window=1")
    returns = discounted_returns(log["reward"], np.diff(episodes, prepend=0.0) > 0, gamma)
    every = -(-len(steps) // most) or 1
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


def _shipped() -> Any:
    return resources.files("kinreach.baselines") / "logs"


def _folder(recipe: str) -> str:
    """The name of a recipe, which is that of a folder and leads to no other."""
    given: object = recipe
    if not isinstance(given, str) or given != Path(given).name or "\0" in given:
        raise_unknown("logs of the recipe", shown(given), log_names())
    return given


def _own(runs: str | Path, recipe: str) -> Path:
    """Folder of own runs of a recipe, if files in it can have a path at all."""
    return check_path("runs", check_path("runs", runs) / _folder(recipe) / "seed-0" / "policy.safetensors").parents[1]


def _of_runs(runs: Path, what: str) -> Iterator[tuple[int, Log]]:
    for folder in sorted(runs.glob("seed-*")):
        seed = folder.name.removeprefix("seed-")
        file = folder / ("episode.csv" if what == EPISODE else "curve.csv")
        finished = (folder / "run.json").exists()
        if not (seed.isdecimal() and finished and file.exists()):
            continue
        log = read_curve(file)
        if what == REWARDS:
            log = sampled_returns(log, _discount(folder / "run.json"))
        yield int(seed), thinned(log) if what == CURVE else log


def _discount(run: Path) -> float:
    """The discount factor that a run was trained with."""
    try:
        return float(json.loads(read_text(run, "the run", most=MOST_RUN))["recipe"]["settings"]["gamma"])
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise InputError(f"{run} does not say the discount factor: {error}") from None


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
    given = {**needed_options(policy), **(options or {})}
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
