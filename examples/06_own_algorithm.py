"""Trains TQC with a network of your own for a moment, exports and evaluates it.

    python examples/06_own_algorithm.py
    kinreach train examples.06_own_algorithm:RECIPE

This shows the plumbing only: with 1920 steps the policy learns nothing. Needs the extra
`train` and `pip install sb3-contrib`.
"""

import json
from pathlib import Path

from kinreach.baselines import (
    Algorithm,
    Networks,
    Recipe,
    evaluate,
    load_policy,
    register_algorithm,
    register_recipe,
    train,
)

register_algorithm(Algorithm("TQC", "sb3_contrib:TQC"))

RECIPE = register_recipe(
    Recipe(
        name="tqc-single",
        summary="TQC with a deeper network; the thesis's reward, not below -30.",
        environment="kinreach/UR5SingleStep-v0",
        options={"backend": "kinematic"},
        algorithm="TQC",
        networks=Networks(hidden=(64, 64, 32), activation="silu", features="scaled"),
        settings={
            "learning_starts": 320,
            "batch_size": 128,
            "train_freq": 1,
            "gradient_steps": 1,
            "gamma": 0.0,
        },
        reward="floored",
        steps=1920,
        num_envs=32,
        segments=2,
        window=640,
    )
)

if __name__ == "__main__":
    folder = Path("results/train/tqc-single/seed-0")
    train(RECIPE, folder, seed=0, fresh=True)
    print("files:", *sorted(path.name for path in folder.iterdir()))
    run = json.loads((folder / "run.json").read_text())
    print("trained:", run["recipe"]["algorithm"])

    policy = load_policy(folder / "policy.safetensors")
    layers = [weight.shape[0] for weight, _ in policy.network.layers]
    print("network:", layers, policy.network.activation)
    summary = evaluate(policy, goals=200, options={"backend": "kinematic"}).summary()
    print(
        f"on {summary['goals']} held-out goals: "
        f"{summary['distance_mm']['median']:.0f} mm in the median"
    )
