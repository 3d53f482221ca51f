"""Prints how two policies of your own do: a function, and a network of another library.

    python examples/03_own_policy.py
    kinreach compare --methods closed-form,results/model.safetensors --goals 50

The function remembers 5000 goals, and reaches. The network shows the plumbing only:
stable-baselines3 trains it for 2048 steps, far too few; `export_policy` writes the
file that `compare` takes. Needs the extra `train`.
"""

import gymnasium as gym
import numpy as np
from scipy.spatial import cKDTree
from stable_baselines3 import PPO

import kinreach  # noqa: F401  (registers the environments)
from kinreach.baselines import export_policy
from kinreach.compare import compare
from kinreach.kinematics import URKinematics
from kinreach.vision import geometric_goal_view

ENVIRONMENT = "kinreach/UR5SingleStep-v0"
kin = URKinematics("ur5-thesis", tip="tcp", base="world")
rng, home = np.random.default_rng(1), kin.arm.home
goals = kin.arm.workcell.goals.sample(rng, 5000)  # not those of the comparison
postures = np.array([kin.axis_goal(goal, [0, 0, -1], seed=home).q for goal in goals])
# the first six numbers of an observation
tree = cKDTree(geometric_goal_view("ur5-thesis", goals))


def memory(observation: np.ndarray) -> np.ndarray:
    """The posture that reached the most similar of the goals."""
    _, index = tree.query(observation[:6])
    return postures[index] / np.pi


env = gym.make(ENVIRONMENT, backend="kinematic")
model = PPO("MlpPolicy", env, n_steps=256, gamma=0.0, seed=0)
model.learn(2048)
export_policy(model, "results/model.safetensors", environment=ENVIRONMENT)

methods = ["closed-form", memory, "results/model.safetensors"]
for row in compare("ur5", methods=methods, goals=50)["methods"]:
    print(
        f"{row['name']}: {100 * row['reached']:.0f} % reached, "
        f"{row['distance_mm']['median']:.2f} mm in the median, "
        f"{100 * row['impossible']:.0f} % impossible"
    )
