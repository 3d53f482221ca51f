"""Training per second: the recipe `ranked-single`, and PPO with the same settings on our batch and on PandaReach-v3."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.speed.peers.gym_child import learning_seconds, ppo_seconds
from benchmarks.speed.peers.gym_peer import PANDA, gym_peers
from benchmarks.speed.sections import Cell, Options, Progress, Section
from benchmarks.speed.suites import PROFILED
from kinreach._registration import MULTI
from kinreach.baselines._recipes import get_recipe
from kinreach.errors import InstallationError

AGAIN = "python -m benchmarks.speed --suite train"
#: Actions of an update, environments of ours and of the peer's, and what both are told besides.
UPDATE, OURS, PEERS = 2048, 2048, 8
#: Actions that a round takes, of ours and of the peer; and with `--quick`.
ACTIONS, PEER_ACTIONS = 102_400, 2 * UPDATE
QUICK_ACTIONS, QUICK_PEER_ACTIONS = 10_240, UPDATE
SETTINGS: dict[str, Any] = {"batch_size": 512, "n_epochs": 2, "policy_kwargs": {"net_arch": [64, 64]}}
#: More rounds say no more.
MAX_ROUNDS = 5
PARTS = ("environment", "choosing", "updating")
RECIPE, BATCH = "recipe `ranked-single`, UR5SingleStep-v0", f"PPO, UR5MultiStep-v0, native batch of {OURS}"
PEER = f"PPO, {PANDA.name}, {PEERS} one after the other"
Run = Callable[[], dict[str, float]]

TEXT = f"""\
Training for a short, fixed number of actions on one thread, `learn` alone. PPO is stable-baselines3's with the same
settings for both: {UPDATE} actions an update, minibatches of {SETTINGS["batch_size"]}, {SETTINGS["n_epochs"]} epochs,
two layers of 64. Environments are vectorised as each package offers it: ours as a native batch, {PANDA.name}'s by
stable-baselines3's `make_vec_env`. The ratio is taken within a round; its median over the rounds is shown.

Environment is the time in its steps and resets, choosing the rest of the rollouts (the network's actions, the buffer),
updating the gradients; the rest is stable-baselines3's own. Each of these shares is the median of its rounds. With a
native batch the network is what there is to wait for, with {PANDA.name} the environment.

{PROFILED}: of the environment's time in a run of `ranked-single` of {ACTIONS} actions almost half was the seeding of
2048 generators at the start. A longer run does not notice it; `--quick` notices it most."""


def run(options: Options, progress: Progress) -> list[Section]:
    """Measure (`benchmarks.speed.suites.Run`)."""
    missing: dict[str, str] = {}
    columns = ("", "actions", "actions/s, median", "actions/s, worst round", f"x {PANDA.name}",
               *(f"{part} [%]" for part in PARTS), "rest [%]", "wall [s]", "processor [s]")  # fmt: skip
    rows: list[list[Cell]] = []
    samples: dict[str, list[float]] = {}
    try:
        ours = _ours(options)
    except ImportError as error:
        missing["stable-baselines3"] = f"nothing can be trained: {' '.join(str(error).split())}"
    else:
        times = _rounds(ours, options, progress, missing)
        rows = _rows(times)
        samples = {name: [taken["wall"] / taken["actions"] for taken in each] for name, each in times.items()}
    return [Section("Training", TEXT, columns, rows, AGAIN, missing=missing, samples=samples)]


def _ours(options: Options) -> dict[str, Run]:
    import torch  # noqa: F401 (whoever lacks it is told so)

    from kinreach.baselines import _vec_envs as vec_envs  # noqa: F401

    actions = QUICK_ACTIONS if options.quick else ACTIONS
    return {RECIPE: partial(_recipe, actions, options.seed), BATCH: partial(_batch, actions, options.seed)}


def _rounds(
    ours: dict[str, Run], options: Options, progress: Progress, missing: dict[str, str]
) -> dict[str, list[dict[str, float]]]:
    """Return the times of every contender, round by round; they take turns."""
    import torch

    times: dict[str, list[dict[str, float]]] = {name: [] for name in (*ours, PEER)}
    rounds = 1 if options.quick else min(options.rounds, MAX_ROUNDS)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with gym_peers((PANDA,), seed=options.seed) as (peers, absent):
            missing |= absent
            settings = {**SETTINGS, "n_steps": UPDATE // PEERS}
            for done in range(rounds):
                for name, train in ours.items():
                    times[name].append(train())
                if PANDA.name not in missing:
                    try:
                        steps = QUICK_PEER_ACTIONS if options.quick else PEER_ACTIONS
                        times[PEER].append(peers[PANDA.name].ppo(steps, PEERS, settings))
                    except InstallationError as error:
                        missing[PANDA.name] = str(error)
                progress("training", done + 1, rounds)
    finally:
        torch.set_num_threads(threads)
    return {name: each for name, each in times.items() if len(each) == rounds}


def _rows(times: dict[str, list[dict[str, float]]]) -> list[list[Cell]]:
    rates = {name: np.array([taken["actions"] / taken["wall"] for taken in each]) for name, each in times.items()}
    rows: list[list[Cell]] = []
    for name, each in times.items():
        wall, processor = (float(np.median([taken[what] for taken in each])) for what in ("wall", "processor"))
        parts = np.array([[100 * taken[part] / taken["wall"] for part in PARTS] for taken in each])
        shares = [float(share) for share in np.median(np.column_stack([parts, 100 - parts.sum(axis=1)]), axis=0)]
        ratio = float(np.median(rates[name] / rates[PEER])) if PEER in rates else None
        actions = int(each[0]["actions"])
        rate = rates[name]
        rows.append([name, actions, float(np.median(rate)), float(rate.min()), ratio, *shares, wall, processor])
    return rows


def _recipe(actions: int, seed: int) -> dict[str, float]:
    from kinreach.baselines._models import build

    trainee = build(get_recipe("ranked-single"), seed, steps=actions)
    try:
        trainee.env.seed(seed)
        return learning_seconds(trainee.model, trainee.env, actions)
    finally:
        trainee.env.close()


def _batch(actions: int, seed: int) -> dict[str, float]:
    from kinreach.baselines._vec_envs import SB3VecEnv

    batch = gym.make_vec(MULTI, num_envs=OURS, vectorization_mode="vector_entry_point", backend="kinematic")
    env = SB3VecEnv(batch)
    try:
        return ppo_seconds(env, actions, {**SETTINGS, "n_steps": UPDATE // OURS}, seed)
    finally:
        env.close()
