"""Prints how many goals are reached before and after 2400 actions with hindsight.

    python examples/21_hindsight.py

Goals are in the air, and actions move the tip. The reward is 0 within 1 cm of the goal,
else -1. The replay buffer also takes places that were reached as goals, so that TD3 has
something to learn from. Needs the extra `train`.
"""

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import TD3, HerReplayBuffer
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.vec_env import VecNormalize

import kinreach  # noqa: F401  (registers the environments)
from kinreach.baselines import SB3VecEnv


def environments(count: int) -> VecNormalize:
    """Return a native batch of a goal environment, with scaled observations."""
    batch = gym.make_vec(
        "kinreach/Reach-v0",
        num_envs=count,
        vectorization_mode="vector_entry_point",
        steps="multi",
        backend="kinematic",
        control="position",
        goal_env=True,
        reward="sparse",
        tilt=0.0,
        start_spread=0.0,
        max_episode_steps=25,
    )
    return VecNormalize(SB3VecEnv(batch), norm_reward=False)


def reached(model: TD3, scales: VecNormalize, count: int = 100) -> int:
    """Return how many of new goals are reached."""
    env = environments(count)
    env.obs_rms, env.training = scales.obs_rms, False
    env.seed(1_000)
    seen, over, found = env.reset(), np.zeros(count, bool), 0
    while not over.all():
        seen, _, done, infos = env.step(model.predict(seen, deterministic=True)[0])
        found += sum(infos[i]["is_success"] for i in np.flatnonzero(done & ~over))
        over |= done
    return found


if __name__ == "__main__":
    torch.set_num_threads(1)  # a network this small is quickest on one
    env = environments(8)
    model = TD3(
        "MultiInputPolicy",
        env,
        replay_buffer_class=HerReplayBuffer,
        replay_buffer_kwargs={"n_sampled_goal": 4},
        action_noise=NormalActionNoise(np.zeros(3), np.full(3, 0.2)),
        batch_size=512,
        gamma=0.9,
        tau=0.05,
        learning_rate=2e-3,
        learning_starts=800,
        gradient_steps=8,
        policy_kwargs={"net_arch": [64, 64]},
        seed=0,
    )
    print(f"before: {reached(model, env)} of 100 goals reached")
    model.learn(2_400)
    print(f"after: {reached(model, env)} of 100 goals reached")
