"""What trained policies press on held-out targets, by recipe and by seed: the table of docs/button.md.

python -m kinreach.train button --seeds 5         (and the other recipes)
python -m benchmarks.button_policies results/train
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from kinreach.baselines.evaluation import evaluate
from kinreach.baselines.learned import load_policy
from kinreach.baselines.recipes import BUTTON, RECIPES
from kinreach.statistics import bootstrap_intervals, mean, median, wilson_interval

HEADINGS = (
    "recipe", "seed", "pressed, % [95 % CI]", "steps, median [95 % CI]", "wrong presses an episode [95 % CI]",
    "training, s of processor",
)  # fmt: skip


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table, a row for each seed and one for all seeds of a recipe together."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, help="the folder that `kinreach train --out` wrote to")
    parser.add_argument("--goals", type=int, default=1000, help="targets, the same for every seed")
    arguments = parser.parse_args(argv)
    print(f"| {' | '.join(HEADINGS)} |\n|{'---|' * len(HEADINGS)}")
    for recipe in (name for name, recipe in RECIPES.items() if recipe.environment == BUTTON):
        files = sorted((arguments.runs / recipe).glob("seed-*/policy.safetensors"))
        episodes, seconds = [], []
        for file in files:
            policy = load_policy(file)
            found = evaluate(policy, goals=arguments.goals, options=policy.card.recipe["options"])
            wrong, steps = found.measures["wrong_presses"], found.measures["steps"]
            episodes.append((found.reached, steps, wrong))
            seconds.append(json.loads((file.parent / "run.json").read_text(encoding="utf-8"))["cpu_seconds"])
            print(row(recipe, str(policy.card.seed), *episodes[-1], f"{seconds[-1]:.0f}"), flush=True)
        if len(files) > 1:
            together = [np.concatenate(values) for values in zip(*episodes, strict=True)]
            span = f"{min(seconds):.0f}–{max(seconds):.0f}"
            print(row(recipe, f"all {len(files)}", *together, span), flush=True)
    return 0


def row(recipe: str, seed: str, pressed: np.ndarray, steps: np.ndarray, wrong: np.ndarray, seconds: str) -> str:
    """A row; the steps are those of the episodes in which the button was pressed."""
    low, high = wilson_interval(int(pressed.sum()), len(pressed))
    needed = "no press"
    if pressed.any():
        ((first, last),) = bootstrap_intervals(steps[pressed], (median,), resamples=500)
        needed = f"{median(steps[pressed]):.0f} [{first:.0f}, {last:.0f}]"
    ((least, most),) = bootstrap_intervals(wrong.astype(float), (mean,), resamples=500)
    cells = (
        f"`{recipe}`",
        seed,
        f"{100 * pressed.mean():.1f} [{100 * low:.1f}, {100 * high:.1f}]",
        needed,
        f"{wrong.mean():.2f} [{least:.2f}, {most:.2f}]",
        seconds,
    )
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    raise SystemExit(main())
