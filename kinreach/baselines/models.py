"""From a recipe to environments and a model of stable-baselines3."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import DQN, PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.noise import NormalActionNoise, VectorizedActionNoise

from kinreach.baselines.algorithms import (
    AdaptivePPO,
    AdaptiveRate,
    Exploration,
    ObservationFeatures,
    PosturePolicy,
    RankedPPO,
)
from kinreach.baselines.learning_curve import LearningCurve
from kinreach.baselines.recipes import Recipe
from kinreach.baselines.rewards import REWARDS
from kinreach.baselines.vec_envs import SB3VecEnv, TriesVecEnv
from kinreach.envs.reach.task import SINGLE_STEP
from kinreach.robots import get_arm
from kinreach.robots.workcell import BoxRegion

#: Algorithms by the name that recipes use.
ALGORITHMS: Mapping[str, type[BaseAlgorithm]] = {
    "PPO": PPO,
    "AdaptivePPO": AdaptivePPO,
    "RankedPPO": RankedPPO,
    "SAC": SAC,
    "TD3": TD3,
    "DQN": DQN,
}
_ACTIVATIONS = {"tanh": torch.nn.Tanh, "silu": torch.nn.SiLU, "relu": torch.nn.ReLU}

#: Seed of the observations whose mean and spread scale the network's inputs, and how many.
_SCALE_SEED, _SCALE_SAMPLE = 1, 2048

#: What the features `"button"` divide by: cosines and sines, two positions [m], joint velocities [rad/s], difference of
#: the positions [m], push state.
BUTTON_SCALE = (*(1.0,) * 6, *(2 / 3,) * 6, *(2.5,) * 3, *(0.5,) * 3, 1.0)


@dataclass(frozen=True, eq=False)
class Trainee:
    """A model with its environments.

    Attributes:
        model: Of stable-baselines3.
        env: What it acts in.
        curve: The batch beneath, which counts.
    """

    model: BaseAlgorithm
    env: SB3VecEnv
    curve: LearningCurve


def build(recipe: Recipe, seed: int, *, steps: int) -> Trainee:
    """A fresh model and its environments.

    Args:
        recipe: What to train.
        seed: Of the networks.
        steps: Planned actions, to which schedules refer.
    """
    tries = recipe.settings.get("tries", 1)
    batch = gym.make_vec(
        recipe.environment, num_envs=recipe.num_envs, vectorization_mode="vector_entry_point", **recipe.options
    )
    curve = LearningCurve(batch, window=recipe.window, trace_after=recipe.trace_after)
    reward = REWARDS[recipe.reward]
    if tries > 1:
        goals = _wider_goals(recipe.margin)
        env: SB3VecEnv = TriesVecEnv(
            curve, tries=tries, draw=goals.sample, steps=recipe.walk, reward=reward, blur=recipe.blur
        )
    else:
        env = SB3VecEnv(curve, reward=reward)
    settings = _settings(recipe, env)
    if issubclass(ALGORITHMS[recipe.algorithm], AdaptivePPO):
        settings["planned_steps"] = steps
    policy = PosturePolicy if recipe.networks.posture else "MlpPolicy"
    model = ALGORITHMS[recipe.algorithm](
        policy, env, policy_kwargs=_policy(recipe), seed=seed, device="cpu", verbose=0, **settings
    )
    return Trainee(model, env, curve)


def _wider_goals(margin: float) -> BoxRegion:
    """The table area with a margin [m]."""
    region: Any = get_arm("ur5").workcell.goals
    (x0, x1), (y0, y1) = region.x, region.y
    return BoxRegion((x0 - margin, x1 + margin), (y0 - margin, y1 + margin), region.z)


def _settings(recipe: Recipe, env: SB3VecEnv) -> dict[str, Any]:
    """Keyword arguments of the algorithm, with the parts that recipes write as plain values put together."""
    settings = dict(recipe.settings)
    settings.pop("adam", None)
    if "minibatches" in settings:
        settings["batch_size"] = recipe.num_envs * settings["n_steps"] // settings.pop("minibatches")
    if "exploration" in settings and settings["exploration"] is not None:
        schedule = Exploration(**settings["exploration"])
        settings["exploration"] = schedule.scaled(1.0 / SINGLE_STEP.scale) if recipe.networks.posture else schedule
    if "adaptive" in settings:
        settings["adaptive"] = AdaptiveRate(**settings["adaptive"])
    if "action_noise" in settings:
        size = env.action_space.shape[0]  # type: ignore[index]
        noise = NormalActionNoise(np.zeros(size), np.full(size, settings["action_noise"]))
        settings["action_noise"] = VectorizedActionNoise(noise, recipe.num_envs)
    return settings


def _policy(recipe: Recipe) -> dict[str, Any]:
    """Keyword arguments of the policy."""
    networks = recipe.networks
    actor = list(networks.hidden)
    policy: dict[str, Any] = {"activation_fn": _ACTIVATIONS[networks.activation]}
    if issubclass(ALGORITHMS[recipe.algorithm], PPO):
        policy["net_arch"] = {"pi": actor, "vf": [] if recipe.algorithm == "RankedPPO" else actor}
    else:
        policy["net_arch"] = actor
    if networks.std != 1.0:
        policy["log_std_init"] = math.log(networks.std)
    if networks.features != "raw":
        policy |= {"features_extractor_class": ObservationFeatures, "features_extractor_kwargs": _features(recipe)}
    if networks.posture:
        home = np.array(get_arm("ur5").home) / SINGLE_STEP.scale
        policy["head"] = {"gain": 1.0 / SINGLE_STEP.scale, "shift": home.tolist()}
        policy["paired"] = recipe.algorithm == "RankedPPO"
    if "adam" in recipe.settings:
        policy["optimizer_kwargs"] = dict(recipe.settings["adam"])
    return policy


def _features(recipe: Recipe) -> dict[str, Any]:
    """Constants of the normalisation, and the waves.

    Mean and spread of first observations; what does not vary among them is only shifted. Those of the button task all
    begin upright and almost at rest: their spread says nothing, `BUTTON_SCALE` stands in for it.
    """
    if recipe.networks.features == "button":
        return {"mean": [0.0] * len(BUTTON_SCALE), "scale": BUTTON_SCALE}
    batch = gym.make_vec(
        recipe.environment, num_envs=_SCALE_SAMPLE, vectorization_mode="vector_entry_point", **recipe.options
    )
    observations = np.asarray(batch.reset(seed=_SCALE_SEED)[0])
    batch.close()
    if recipe.networks.features == "goal waves":
        observations = observations[:, :6]
    scale = observations.std(axis=0)
    scale = np.where(scale < 1e-6, 1.0, scale)
    waves = (0.5, 1.0, 2.0) if recipe.networks.features == "goal waves" else ()
    return {"mean": observations.mean(axis=0).tolist(), "scale": scale.tolist(), "waves": waves}
