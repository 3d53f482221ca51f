"""Prints the distance to the goal while a plain PyTorch loop learns: 814 mm, then 79.

The network then stands in a comparison. It reaches no goal yet: the median of its
distances shows how far it has come.

    python examples/08_pytorch_loop.py

A policy gradient without a library, on 4096 arms at once, in some 25 seconds. An
episode is one action, so its reward is the whole return: the gradient is REINFORCE's,
with the rewards of a batch brought to mean 0 and deviation 1. Needs the extra `train`.
"""

import gymnasium as gym
import numpy as np
import torch
from torch import nn

import kinreach  # noqa: F401  (registers the environments)
from kinreach.compare import compare

torch.manual_seed(0)
torch.set_num_threads(1)  # a network this small is quickest on one
envs = gym.make_vec(
    "kinreach/UR5SingleStep-v0",
    num_envs=4096,
    vectorization_mode="vector_entry_point",
    backend="kinematic",
)
observations, _ = envs.reset(seed=0)
network = nn.Sequential(
    nn.Linear(13, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, 6)
)
optimizer = torch.optim.Adam(network.parameters(), lr=3e-3)
UPDATES = 600

for update in range(UPDATES):
    # standard deviation of the actions, whose range is -1 to 1
    exploration = 0.3 * 0.05 ** (update / UPDATES)
    mean = network(torch.as_tensor(observations, dtype=torch.float32))
    chosen = torch.distributions.Normal(mean, exploration)
    actions = chosen.sample()
    observations, rewards, _, _, info = envs.step(
        actions.clamp(-1, 1).numpy().astype(np.float32)
    )

    # -100 for a collision would drown the rest
    rewards = torch.as_tensor(rewards, dtype=torch.float32).clamp(min=-10)
    advantages = (rewards - rewards.mean()) / (rewards.std() + 1e-6)
    loss = -(chosen.log_prob(actions).sum(dim=1) * advantages).mean()
    optimizer.param_groups[0]["lr"] = 3e-3 * (1 - update / UPDATES)
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
    if update % 50 == 0 or update == UPDATES - 1:
        last = info["final_info"]
        print(
            f"update {update:3d}: "
            f"distance {1000 * np.median(last['distance']):4.0f} mm in the median, "
            f"{100 * last['impossible'].mean():3.0f} % impossible"
        )


def learned(observation: np.ndarray) -> np.ndarray:
    """The action of the network for one observation."""
    with torch.no_grad():
        action = network(torch.as_tensor(observation, dtype=torch.float32))
    return action.clamp(-1, 1).numpy()


for row in compare("ur5", methods=["closed-form", learned], goals=50)["methods"]:
    print(
        f"{row['name']}: {100 * row['reached']:.0f} % reached, "
        f"{row['distance_mm']['median']:.2f} mm in the median"
    )
