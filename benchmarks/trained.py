"""What trained reach policies do on held-out goals, over all seeds of every recipe: the tables of docs/training.md.

python -m kinreach.train single --seeds 5         (and the other recipes)
python -m benchmarks.trained results/train --goals 10000
python -m benchmarks.trained results/train --recipes single,multi --backend mujoco --goals 1000
python -m benchmarks.trained results/train --recipes single,multi --backend mujoco --observation camera --goals 500
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from kinreach.baselines.evaluation import Evaluation, evaluate
from kinreach.baselines.learned import load_policy
from kinreach.baselines.recipes import BUTTON, RECIPES
from kinreach.statistics import bootstrap_intervals, median, p95, wilson_interval

HEADINGS = (
    "recipe", "seeds", "reached, % [95 % CI]", "worst seed, %", "median, mm [95 % CI]", "p95, mm", "within 1 mm, %",
    "within 2 mm, %", "worst seed: median, mm", "impossible, %", "steps", "training, s of processor",
)  # fmt: skip


def main() -> None:
    """Print a Markdown table, one row per recipe."""
    arguments = parse()
    print(f"| {' | '.join(HEADINGS)} |\n|{'---|' * len(HEADINGS)}")
    reach = [name for name, recipe in RECIPES.items() if recipe.environment != BUTTON]
    for recipe in arguments.recipes.split(",") if arguments.recipes else reach:
        folders = sorted((Path(arguments.runs) / recipe).glob("seed-*"))
        finished = [folder for folder in folders if (folder / "policy.safetensors").exists()]
        if finished:
            print(row(recipe, finished, arguments), flush=True)


def row(recipe: str, folders: list[Path], arguments: argparse.Namespace) -> str:
    """Evaluate the policies of one recipe together."""
    options = {"backend": arguments.backend, "observation": arguments.observation}
    found = [
        evaluate(load_policy(folder / "policy.safetensors"), goals=arguments.goals, options=options)
        for folder in folders
    ]
    seconds = [json.loads((folder / "run.json").read_text())["cpu_seconds"] for folder in folders]
    pooled = Evaluation(
        np.concatenate([one.reached for one in found]),
        np.concatenate([one.impossible for one in found]),
        {name: np.concatenate([one.measures[name] for one in found]) for name in found[0].measures},
    )
    reached, mm = pooled.reached, 1e3 * pooled.measures["distance"]
    low, high = wilson_interval(int(reached.sum()), len(reached))
    ((m_low, m_high),) = bootstrap_intervals(mm, (median,), resamples=500)
    within = [100 * np.mean((mm <= limit) & ~pooled.impossible) for limit in (1, 2)]
    cells = [
        f"`{recipe}`",
        len(found),
        f"{100 * reached.mean():.2f} [{100 * low:.2f}, {100 * high:.2f}]",
        f"{100 * min(one.reached.mean() for one in found):.2f}",
        f"{median(mm):.3g} [{m_low:.3g}, {m_high:.3g}]",
        f"{p95(mm):.3g}",
        *(f"{share:.2f}" for share in within),
        f"{max(1e3 * median(one.measures['distance']) for one in found):.3g}",
        f"{100 * pooled.impossible.mean():.2f}",
        f"{np.median(pooled.measures['steps']):.0f}",
        f"{min(seconds):.0f}–{max(seconds):.0f}",
    ]
    return f"| {' | '.join(map(str, cells))} |"


def parse() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", help="the folder that `kinreach train --out` wrote to")
    parser.add_argument("--recipes", metavar="A,B", help="default: all that were trained")
    parser.add_argument("--goals", type=int, default=1000)
    parser.add_argument("--backend", default="kinematic")
    parser.add_argument("--observation", default="geometric")
    return parser.parse_args()


if __name__ == "__main__":
    main()
