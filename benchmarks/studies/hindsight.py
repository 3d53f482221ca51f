"""SAC with hindsight experience replay on goal environments: a learning curve of several seeds.

    python -m benchmarks.studies.hindsight --out results/hindsight

Rewards are sparse. Each seed has a folder with `curve.csv` (actions, reached of the test's goals in percent, median
distance at the end of an episode), and what the training goes on from: the command begun again skips what is done.
Not measured yet.
"""

from __future__ import annotations

import argparse
import csv
import warnings
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import SAC, HerReplayBuffer

import kinreach  # noqa: F401 (registers the environments)
from kinreach._files import make_writable
from kinreach.baselines import SB3VecEnv

ENVIRONMENT = "kinreach/Reach-v0"
OPTIONS = {"steps": "multi", "backend": "kinematic", "goal_env": True, "reward": "sparse", "max_episode_steps": 50}
NUM_ENVS, TEST_GOALS, TEST_SEED = 16, 100, 10_000
COLUMNS = ("steps", "reached %", "distance mm")


def batch(count: int) -> SB3VecEnv:
    """Return a native batch of the goal environment."""
    return SB3VecEnv(gym.make_vec(ENVIRONMENT, count, "vector_entry_point", **OPTIONS))


def learner(env: SB3VecEnv, seed: int) -> SAC:
    """Return an untrained learner."""
    return SAC(
        "MultiInputPolicy",
        env,
        replay_buffer_class=HerReplayBuffer,
        replay_buffer_kwargs={"n_sampled_goal": 4, "goal_selection_strategy": "future"},
        buffer_size=400_000,
        batch_size=256,
        gamma=0.95,
        learning_rate=1e-3,
        learning_starts=2_000,
        gradient_steps=8,
        policy_kwargs={"net_arch": [256, 256]},
        seed=seed,
    )


def tested(model: SAC, env: SB3VecEnv) -> tuple[float, float]:
    """Return the share of the test's goals that are reached [%], and the median distance at the end [mm]."""
    env.seed(TEST_SEED)
    seen: Any = env.reset()
    ended, reached, distance = np.zeros(env.num_envs, bool), np.zeros(env.num_envs, bool), np.zeros(env.num_envs)
    while not ended.all():
        seen, _, done, infos = env.step(model.predict(seen, deterministic=True)[0])
        for index in np.flatnonzero(done & ~ended):
            reached[index], distance[index] = infos[index]["is_success"], infos[index]["distance"]
        ended |= done
    return 100 * float(reached.mean()), 1000 * float(np.median(distance))


def train(folder: Path, seed: int, steps: int, every: int) -> None:
    """Train one seed, or go on with it, and write its curve."""
    make_writable(folder)
    curve, saved, buffer = folder / "curve.csv", folder / "model.zip", folder / "buffer.pkl"
    env, test = batch(NUM_ENVS), batch(TEST_GOALS)
    if curve.exists():  # written last
        with curve.open(newline="", encoding="utf-8") as file:
            rows = list(csv.reader(file))
        if int(rows[-1][0]) >= steps:
            return
        model = SAC.load(saved, env=env)
        with warnings.catch_warnings():  # episodes that were under way are cut off, as it warns
            warnings.filterwarnings("ignore", message="The last trajectory")
            model.load_replay_buffer(buffer, truncate_last_traj=True)
    else:
        rows, model = [list(COLUMNS)], learner(env, seed)
    while model.num_timesteps < steps:
        model.learn(every, reset_num_timesteps=False)
        reached, distance = tested(model, test)
        rows.append([str(model.num_timesteps), f"{reached:.1f}", f"{distance:.2f}"])
        model.save(saved)
        model.save_replay_buffer(buffer)
        with curve.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows(rows)
        print(f"seed {seed}: {model.num_timesteps} actions, {reached:.1f} % reached, {distance:.2f} mm", flush=True)


def main(arguments: list[str] | None = None) -> None:
    """Train the seeds one after the other."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.studies.hindsight", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/hindsight"), help="folder of the seeds")
    parser.add_argument("--seeds", type=int, default=5, help="how many (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=400_000, help="actions of a training (default: %(default)s)")
    parser.add_argument("--every", type=int, default=20_000, help="actions between two tests (default: %(default)s)")
    given = parser.parse_args(arguments)
    torch.set_num_threads(1)
    for seed in range(given.seeds):
        train(given.out / f"seed-{seed}", seed, given.steps, given.every)


if __name__ == "__main__":
    main()
