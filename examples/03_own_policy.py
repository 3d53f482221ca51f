"""Two policies of a user's own beside the closed form: `python examples/03_own_policy.py`.

The first is a function from an observation to an action, here a memory of 5000 goals instead of a network; the second a
file that stable-baselines3 saved. On the command line the file's name is a method, too:

    python -m kinreach.compare --methods closed-form,results/model.zip --goals 50
"""

import gymnasium as gym
import numpy as np
from scipy.spatial import cKDTree
from stable_baselines3 import PPO

import kinreach  # noqa: F401  (registers the environments)
from kinreach.compare import compare
from kinreach.kinematics import UR5Kinematics
from kinreach.vision import geometric_goal_view

kin = UR5Kinematics(tip="tcp", base="world")
goals = kin.arm.workcell.goals.sample(np.random.default_rng(1), 5000)  # not those of the comparison
postures = np.array([kin.axis_goal(goal, [0, 0, -1], seed=kin.arm.home).q for goal in goals])
tree = cKDTree(geometric_goal_view("ur5", goals))  # the first six numbers of an observation


def memory(observation: np.ndarray) -> np.ndarray:
    """The posture that reached the most similar of the goals."""
    _, index = tree.query(observation[:6])
    return postures[index] / np.pi


model = PPO("MlpPolicy", gym.make("kinreach/UR5SingleStep-v0", backend="kinematic"), n_steps=256, gamma=0.0, seed=0)
model.learn(2048)
model.save("results/model.zip")

for row in compare("ur5", methods=["closed-form", memory, "results/model.zip"], goals=50)["methods"]:
    print(
        f"{row['name']}: {100 * row['reached']:.0f} % reached, {row['distance_mm']['median']:.2f} mm in the median, "
        f"{100 * row['impossible']:.0f} % impossible"
    )
