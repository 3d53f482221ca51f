"""Prints how often a script pushes a cube to a place: an environment of your own.

    python examples/18_own_environment.py

The task is the class `Push`; arm, contact, spaces and batches are there already. The
script goes behind the cube, as seen from the goal, and pushes. Needs no extra.
"""

import gymnasium as gym
import numpy as np

from kinreach.envs import TabletopState, TabletopTask, register_tabletop
from kinreach.robots import BoxRegion


class Push(TabletopTask):
    """Push a cube with closed fingers to a place on the table, within 15 mm."""

    fingers, opening = False, 0.0

    def sample(
        self, rng: np.random.Generator, count: int, region: BoxRegion
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Draw the cube's place and turn, and a goal 8 to 15 cm away from it."""
        places, turns = region.sample(rng, count)[:, :2], rng.uniform(-1, 1, count)
        way, turn = rng.uniform([0.08, -np.pi], [0.15, np.pi], (count, 2)).T
        goals = places + way[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
        height = np.full(count, region.z[0] + self.size)
        return places, turns, np.column_stack([goals, height])

    def achieved(self, state: TabletopState) -> np.ndarray:
        """The place of the cube."""
        return state.position

    def success(self, achieved: np.ndarray, goals: np.ndarray) -> np.ndarray:
        """Whether it is there."""
        return np.linalg.norm(achieved - goals, axis=1) < 0.015


register_tabletop("mine/Push-v0", Push, max_episode_steps=200)


def script(env: gym.Env, info: dict) -> np.ndarray:
    """Return the next action: over the table behind the cube, down, and push."""
    kin, q = env.unwrapped.kinematics, info["q"]
    tip, cube, goal = info["tip"], info["position"], kin.fk(q)
    way = (info["goal"] - cube) * [1, 1, 0]
    ahead = way / np.linalg.norm(way)
    along = (tip - cube) @ ahead
    aside = tip - cube - along * ahead
    aside, above = aside * [1, 1, 0], tip[2] - cube[2]
    if above < 0.02 and along < 0 and np.linalg.norm(aside) < 0.03:
        step = 0.005 * ahead - 0.3 * aside - [0, 0, above]  # push, and keep in line
    else:
        step = cube - 0.07 * ahead - tip
        if np.linalg.norm(step[:2]) > 0.01:  # not there yet: stay above
            step = np.append(step[:2] * (above > 0.06), 0.08 - above)
    x = ahead * np.sign(ahead @ goal[:3, 0])  # the wide side of the closed fingers
    goal[:3, :3] = np.column_stack([x, np.cross([0, 0, -1], x), [0, 0, -1]])
    goal[:3, 3] += step * min(1, 0.02 / np.linalg.norm(step))
    change = kin.nearest(goal, q).q - q
    return np.clip(change / np.radians(5), -1, 1).astype(np.float32)


if __name__ == "__main__":
    env = gym.make("mine/Push-v0")
    steps = []
    for seed in range(20):
        _, info = env.reset(seed=seed)
        over, count = False, 0
        while not over:
            _, _, ended, cut, info = env.step(script(env, info))
            over, count = ended or cut, count + 1
        if info["is_success"]:
            steps.append(count)
    print(f"pushed to the goal: {len(steps)} of 20, in {np.median(steps):.0f} steps")

    batch = gym.make_vec("mine/Push-v0", num_envs=8)
    batch.reset(seed=0)
    batch.action_space.seed(0)
    _, rewards, *_ = batch.step(batch.action_space.sample())
    print(f"{batch.num_envs} random actions: {rewards.mean():.2f} in the mean")
