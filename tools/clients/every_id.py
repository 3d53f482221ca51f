"""Every id: the checkers of Gymnasium and stable-baselines3, and a short training with PPO."""

import time
import warnings

import gymnasium as gym
import torch
from gymnasium.utils.env_checker import check_env as check_by_gymnasium
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env as check_by_sb3
from stable_baselines3.common.env_util import make_vec_env
from torch.nn.utils import parameters_to_vector

import kinreach

IDS = sorted(name for name in gym.registry if name.startswith(f"{kinreach.__name__}/"))
STEPS, MIN_IDS = 64, 13


if __name__ == "__main__":
    torch.set_num_threads(1)
    for name in IDS:
        began = time.perf_counter()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of spaces that are not flat, or not within [-1, 1]
            check_by_gymnasium(gym.make(name).unwrapped, skip_render_check=True)
            check_by_sb3(gym.make(name).unwrapped, skip_render_check=True)
        env = make_vec_env(f"kinreach:{name}", 2, seed=0)
        model = PPO("MlpPolicy", env, n_steps=STEPS // 4, batch_size=STEPS // 4, n_epochs=2, seed=0, device="cpu")
        before = parameters_to_vector(model.policy.parameters()).detach()
        model.learn(STEPS)
        after = parameters_to_vector(model.policy.parameters()).detach()
        env.close()
        assert model.num_timesteps == STEPS, (name, model.num_timesteps)
        assert torch.isfinite(after).all(), name
        assert not torch.equal(before, after), name
        print(f"{name}: both checkers, {STEPS} steps of PPO, {time.perf_counter() - began:.0f} s", flush=True)
    assert len(IDS) >= MIN_IDS, IDS
    print(f"{len(IDS)} ids")
