"""Prints the mean reward before and after stable-baselines3's PPO trains on 256 arms.

    python examples/07_stable_baselines3.py
    kinreach compare --methods ppo-single,results/reach.safetensors --goals 50

It goes from collisions to rewards above 0 in 60 000 steps, too few to reach a goal.
`kinreach train ppo-single` is PPO that does. Needs the extra `train`.
"""

import gymnasium as gym
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecMonitor

import kinreach  # noqa: F401  (registers the environments)
from kinreach.baselines import SB3VecEnv, export_policy

ENVIRONMENT = "kinreach/UR5SingleStep-v0"
torch.set_num_threads(1)  # a network this small is quickest on one
batch = gym.make_vec(
    ENVIRONMENT,
    num_envs=256,
    vectorization_mode="vector_entry_point",
    backend="kinematic",
)
env = VecMonitor(SB3VecEnv(batch))
policy = {"net_arch": [64, 64], "log_std_init": -1.5}
model = PPO(
    "MlpPolicy",
    env,
    n_steps=8,
    batch_size=512,
    gamma=0.0,
    learning_rate=1e-3,
    policy_kwargs=policy,
    seed=0,
)
print(f"mean reward before: {evaluate_policy(model, env, n_eval_episodes=256)[0]:.1f}")
model.learn(60_000)
print(f"mean reward after: {evaluate_policy(model, env, n_eval_episodes=256)[0]:.1f}")
export_policy(model, "results/reach.safetensors", environment=ENVIRONMENT)
