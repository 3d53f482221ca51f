"""Recipes for reaching: the thesis's, those that reach, and one for the Panda."""

from __future__ import annotations

import math
from dataclasses import replace

from kinreach._registration import MOVING, MULTI, RANDOM_ARM, SINGLE, SPACE
from kinreach.baselines._recipes.base import Networks, Recipe

#: Defaults of Stable Baselines' PPO2: 4 minibatches, 4 epochs, clip 0.2 of ratios and of values, λ 0.95, entropy 0.01,
#: value 0.5, gradient 0.5 (OpenAI Baselines' own have no entropy bonus and a rate of 3e-4). Its actions, and the
#: standard deviation of 1 that it begins with, are in the units of the thesis, radians in single-step and degrees in
#: multi-step (3.4.3); here an action of 1 is half the range: π rad and 5 degrees.
_THESIS_PPO2 = {
    "n_epochs": 4,
    "minibatches": 4,
    "clip_range": 0.2,
    "clip_range_vf": 0.2,
    "gae_lambda": 0.95,
    "ent_coef": 0.01,
    "vf_coef": 0.5,
    "max_grad_norm": 0.5,
}
_GOAL_WAVES = Networks(activation="silu", features="goal waves", posture=True)
_RANKED = {
    "tries": 8,
    "n_steps": 1,
    "n_epochs": 2,
    "minibatches": 4,
    "gamma": 0.0,
    "gae_lambda": 1.0,
    "clip_range": 0.2,
    "max_grad_norm": 0.5,
    "exploration": {"first": 0.2, "last": 5e-5, "until": 0.85},
    "adaptive": {"first": 3e-3, "target_kl": 0.05, "decay": 0.15},
    "adam": {"betas": (0.9, 0.99), "eps": 1e-5},
}

#: A look is the costly part: 32 tries for each, and a batch of 16 looks at a time.
_LOOKS = {
    **_RANKED,
    "looks": 600,
    "tries": 32,
    "minibatches": 1,
    "exploration": {"first": 0.2, "last": 3e-4, "until": 0.85},
    "adaptive": {"first": 1e-3, "target_kl": 0.05, "decay": 0.15},
}
#: Of what goes down a gradient: next to no exploration, and a rate that falls from the first update to the last.
_DESCENT = {
    "n_steps": 1,
    "n_epochs": 2,
    "gamma": 0.0,
    "exploration": {"first": 1e-4, "last": 1e-4, "until": 1.0},
    "adaptive": {"first": 3e-3, "target_kl": 1.0, "decay": 1.0},
    "adam": {"betas": (0.9, 0.99), "eps": 1e-5},
}

#: The thesis has one arm, which takes 128 steps between two updates. Each is an episode, the policy stays the same
#: meanwhile, and with γ 0 nothing of one enters what another is worth: 128 arms that take one step are the same data,
#: in the same four minibatches of 32, in a tenth of the time.
_THESIS_SINGLE = Recipe(
    name="thesis-ppo-single",
    summary="The thesis's single-step path planning: PPO2 in radians, γ 0, 128 steps an update, rate 1e-3.",
    environment=SINGLE,
    algorithm="PPO2",
    steps=150_000,
    num_envs=128,
    networks=Networks(std=1 / math.pi),
    options={"backend": "kinematic"},
    settings={**_THESIS_PPO2, "gain": 1 / math.pi, "gamma": 0.0, "n_steps": 1, "learning_rate": 1e-3},
    window=128,
)
#: Four arms make the 4096 steps of an update, ten episodes each and a part of one; with one arm it would be forty.
_THESIS_MULTI = Recipe(
    name="thesis-ppo-multi",
    trace_after=25_000,
    summary="The thesis's multi-step path planning: PPO2 in degrees, γ 0.99, 4096 steps an update, rate 2.5e-4.",
    environment=MULTI,
    algorithm="PPO2",
    steps=150_000,
    num_envs=4,
    networks=Networks(std=1 / 5),
    options={"backend": "kinematic"},
    settings={**_THESIS_PPO2, "gain": 1 / 5, "gamma": 0.99, "n_steps": 1024, "learning_rate": 2.5e-4},
)
PPO_MULTI = Recipe(
    name="ppo-multi",
    summary="PPO with scheduled exploration and an adaptive rate, γ 0.7; the thesis's reward, not below -30.",
    environment=MULTI,
    options={"backend": "kinematic", "end_on_reached": False},
    algorithm="AdaptivePPO",
    steps=5_000_000,
    num_envs=1024,
    reward="floored",
    networks=Networks(activation="silu", features="scaled"),
    settings={
        "n_steps": 16,
        "n_epochs": 4,
        "minibatches": 4,
        "gamma": 0.7,
        "gae_lambda": 0.9,
        "clip_range": 0.2,
        "vf_coef": 0.5,
        "max_grad_norm": 0.5,
        "exploration": {"first": 0.5, "last": 0.05, "until": 0.8},
        "adaptive": {"first": 1e-3, "target_kl": 0.02},
        "adam": {"eps": 1e-5},
    },
    window=20_480,
)

RANKED_SINGLE = Recipe(
    name="ranked-single",
    summary="Ranked PPO: eight postures tried for every goal, dense reward in training.",
    environment=SINGLE,
    algorithm="RankedPPO",
    steps=4_000_000,
    num_envs=2048,
    reward="dense",
    blur=5e-4,
    beyond=0.02,
    networks=_GOAL_WAVES,
    settings=_RANKED,
    window=20_480,
    options={"backend": "kinematic"},
)
#: Corners of the finger tips, from the tip [m].
FINGERS = [[x, y, 0.01] for x in (-0.011, 0.011) for y in (-0.062, 0.062)]
_RIGHT = math.pi / 2
_SPACE_SINGLE = replace(
    RANKED_SINGLE,
    name="space-single",
    summary="Analytic policy gradient through forward kinematics: goals in a volume, tool directions, other starts.",
    environment=SPACE,
    algorithm="AnalyticGradient",
    reward="own",
    steps=1_000_000,
    num_envs=4096,
    blur=0.0,
    networks=replace(_GOAL_WAVES, hidden=(128, 128)),
    window=40_960,
    options={"backend": "kinematic", "tilt": 30.0, "start_spread": 0.3},
    settings={
        **_DESCENT,
        "tries": 1,
        "n_epochs": 8,
        "minibatches": 8,
        # the thesis's other branch, where wrist_1 stays within its limits; in that of the start pose 4 % of the goals
        # need it beyond them
        "around": [_RIGHT, -_RIGHT, -_RIGHT, -_RIGHT, _RIGHT, 0.0],
        "feelers": FINGERS,
        # wrist_1 meets the upper arm where the elbow is folded by more than 2.82; the tool gives way by up to 0.15 rad
        "largest": [math.pi, math.pi, 2.8, math.pi, math.pi, math.pi],
    },
)

_MOVING_GRADIENT = Recipe(
    name="gradient-moving",
    summary="A rolling ball: analytic gradient of where the arm and the ball will be; the last six sights are seen.",
    environment=MOVING,
    options={"sights": 6, "collisions": False},
    algorithm="MovingGradient",
    steps=1_200_000,
    num_envs=2048,
    networks=replace(_GOAL_WAVES, hidden=(128, 128), features="sights"),
    settings={**_DESCENT, "minibatches": 2},
    window=40_960,
)

_MOVING_CLEAR = Recipe(
    name="gradient-moving-clear",
    summary="A rolling ball: analytic gradient of whole episodes, without collisions; a share of the possible motion.",
    environment=MOVING,
    options={"sights": 20},
    algorithm="EpisodeGradient",
    # each update plays 256 episodes of its own; the actions are those of the learning curve
    steps=64_000,
    num_envs=16,
    networks=Networks(hidden=(128, 128), activation="silu", features="steering"),
    settings={
        "balls": 256,
        "n_steps": 1,
        "batch_size": 16,
        "gamma": 0.0,
        "max_grad_norm": 1.0,
        "exploration": _DESCENT["exploration"],
        "adaptive": {"first": 2e-3, "target_kl": 1.0, "decay": 1.0},
        "adam": {"betas": (0.9, 0.98)},
        # the elbow and both wrists stay away from where links meet
        "low": [-math.pi, -math.pi, -2.9, -2.95, -0.5 * math.pi - 1.0, -math.pi],
        "high": [math.pi, math.pi, 2.9, 0.0, -0.5 * math.pi + 1.0, math.pi],
    },
    segments=40,
    window=6400,
)

_PPO_MOVING = replace(
    _MOVING_GRADIENT,
    name="ppo-moving",
    summary="The same by PPO: trial and error, with the same sights.",
    algorithm="AdaptivePPO",
    num_envs=1024,
    steps=3_000_000,
    settings={**PPO_MULTI.settings, "gamma": 0.9, "exploration": {"first": 0.3, "last": 0.01, "until": 0.8}},
)

REACH_RECIPES = (
    _MOVING_GRADIENT,
    _MOVING_CLEAR,
    _PPO_MOVING,
    replace(
        _PPO_MOVING,
        name="ppo-moving-clear",
        summary="As ppo-moving, with a level tool above the table; collisions count in the last 30 % of the training.",
        algorithm="LateCollisionsPPO",
        steps=4_000_000,
        reward="level",
        options={"sights": 6},
        settings={**_PPO_MOVING.settings, "exploration": {"first": 0.3, "last": 0.01, "until": 0.7}, "until": 0.7},
        segments=13,
    ),
    replace(
        _MOVING_GRADIENT,
        name="random-arms",
        summary="Arms with random errors, with a summary of looks: analytic gradient through the true arm.",
        environment=RANDOM_ARM,
        options={},
        algorithm="RandomArmGradient",
        networks=replace(_MOVING_GRADIENT.networks, features="arms"),
        settings={**_MOVING_GRADIENT.settings, "n_epochs": 8, "minibatches": 4},
    ),
    _THESIS_SINGLE,
    _THESIS_MULTI,
    Recipe(
        name="ppo-single",
        summary="PPO with scheduled exploration and an adaptive rate; the thesis's reward, not below -30.",
        environment=SINGLE,
        options={"backend": "kinematic"},
        algorithm="AdaptivePPO",
        steps=2_000_000,
        num_envs=4096,
        reward="floored",
        networks=_GOAL_WAVES,
        settings={
            "n_steps": 1,
            "n_epochs": 4,
            "minibatches": 4,
            "gamma": 0.0,
            "gae_lambda": 1.0,
            "clip_range": 0.2,
            "vf_coef": 0.5,
            "max_grad_norm": 0.5,
            "exploration": {"first": 1.0, "last": 0.006, "until": 0.7},
            "adaptive": {"first": 1e-3, "target_kl": 0.03},
            "adam": {"eps": 1e-5},
        },
        window=20_480,
    ),
    PPO_MULTI,
    RANKED_SINGLE,
    replace(
        RANKED_SINGLE,
        name="panda-single",
        summary="As ranked-single, for the Panda: no camera, no posture that is asked for, only the distance and "
        "collisions.",
        steps=1_000_000,
        blur=0.0,
        options={"backend": "kinematic", "arm": "panda"},
    ),
    replace(
        RANKED_SINGLE,
        name="pixels-single",
        summary="As ranked-single, from both cameras' pictures: convolutions with a spatial softmax, 32 tries for a "
        "look.",
        steps=2_048_000,
        num_envs=512,
        blur=0.0,
        networks=replace(_GOAL_WAVES, hidden=(128, 128), features="looks"),
        settings=_LOOKS,
        options={"backend": "kinematic", "width": 128, "height": 72},
    ),
    _SPACE_SINGLE,
    replace(
        _SPACE_SINGLE,
        name="space-multi",
        summary="As space-single, in steps of up to 5 degrees.",
        steps=250_000,
        num_envs=1024,
        walk=40,  # half a turn of the first joint, and some
        window=409_600,
        settings={**_SPACE_SINGLE.settings, "n_epochs": 32, "minibatches": 2},
        options={**_SPACE_SINGLE.options, "steps": "multi", "end_on_reached": False},
    ),
    replace(
        RANKED_SINGLE,
        name="ranked-multi",
        summary="Ranked PPO: eight postures walked to for every goal, dense reward in training.",
        environment=MULTI,
        options={"backend": "kinematic", "end_on_reached": False},
        steps=2_000_000,
        num_envs=1024,
        walk=16,  # any posture which the arm has reason to take: 80 degrees at 5 degrees a step
        window=163_840,
    ),
)
