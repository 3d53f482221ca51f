"""An algorithm and a network of a user's own in `train`: `python examples/06_own_algorithm.py`.

TQC of sb3-contrib (`pip install sb3-contrib`) with three layers of SiLU, for a few steps: enough to see that it trains,
is exported and evaluated, far too few to learn. On the command line the same:

    python -m kinreach.train examples.06_own_algorithm:RECIPE
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
        settings={"learning_starts": 320, "batch_size": 128, "train_freq": 1, "gradient_steps": 1, "gamma": 0.0},
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
    print("trained:", json.loads((folder / "run.json").read_text())["recipe"]["algorithm"])

    policy = load_policy(folder / "policy.safetensors")
    print("network:", [weight.shape[0] for weight, _ in policy.network.layers], policy.network.activation)
    summary = evaluate(policy, goals=200, options={"backend": "kinematic"}).summary()
    print(f"on {summary['goals']} held-out goals: {summary['distance_mm']['median']:.0f} mm in the median")
