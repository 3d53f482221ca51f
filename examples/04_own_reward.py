"""Prints what the thesis's reward and one of your own pay for eight postures at a ball.

    python examples/04_own_reward.py

The thesis pays for a natural posture. This reward pays for any posture near the goal,
and less for long ways. Needs no extra.
"""

import gymnasium as gym
import numpy as np

import kinreach  # noqa: F401  (registers the environments)
from kinreach.kinematics import URKinematics

kin = URKinematics("ur5-thesis", tip="tcp", base="world")
home = np.array(kin.arm.home)


def reward(
    distance: np.ndarray, q: np.ndarray, impossible: np.ndarray
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Of k steps at once: distances (k,), postures (k, n), truth values (k,)."""
    terms = {
        "distance": -distance,
        "way": -0.1 * np.linalg.norm(q - home, axis=1),
        "impossible": -5.0 * impossible,
    }
    return sum(terms.values()), terms


thesis = gym.make("kinreach/UR5SingleStep-v0", backend="kinematic")
own = gym.make("kinreach/UR5SingleStep-v0", backend="kinematic", reward=reward)
_, info = thesis.reset(seed=0)
for q in kin.axis_solutions(info["goal"], [0, 0, -1], seed=home).q:
    paid = []
    for env in (thesis, own):
        env.reset(seed=0)
        _, value, _, _, info = env.step((q / np.pi).astype(np.float32))
        paid.append(value)
    terms = ", ".join(
        f"{name} {value:.2f}" for name, value in info["reward_terms"].items()
    )
    print(
        f"{np.linalg.norm(q - home):.2f} rad from home: "
        f"thesis {paid[0]:.2f}, this reward {paid[1]:.2f} ({terms})"
    )

batch = gym.make_vec(
    "kinreach/UR5SingleStep-v0",
    num_envs=4096,
    vectorization_mode="vector_entry_point",
    backend="kinematic",
    reward=reward,
)
batch.action_space.seed(0)
batch.reset(seed=0)
_, rewards, *_ = batch.step(batch.action_space.sample())
print(
    f"4096 random actions: {rewards.mean():.2f} in the mean, "
    f"{rewards.max():.2f} for the best"
)
