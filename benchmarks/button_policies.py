"""What trained policies press on held-out targets, all seeds of a recipe together: the table of docs/button.md.

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
    "recipe", "seeds", "pressed, % [95 % CI]", "every seed, %", "steps, median [95 % CI]",
    "wrong presses an episode [95 % CI]", "every seed", "training, s of processor",
)  # fmt: skip


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table, a row for each recipe that was trained."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, help="the folder that `kinreach train --out` wrote to")
    parser.add_argument("--goals", type=int, default=1000, help="targets, the same for every seed")
    arguments = parser.parse_args(argv)
    print(f"| {' | '.join(HEADINGS)} |\n|{'---|' * len(HEADINGS)}")
    for recipe in (name for name, recipe in RECIPES.items() if recipe.environment == BUTTON):
        files = sorted((arguments.runs / recipe).glob("seed-*/policy.safetensors"))
        if files:
            print(row(recipe, files, arguments.goals), flush=True)
    return 0


def row(recipe: str, files: list[Path], goals: int) -> str:
    """Evaluate the policies of one recipe; the steps are those of the episodes in which the button was pressed."""
    options = RECIPES[recipe].options
    found = [evaluate(load_policy(file), goals=goals, options=options) for file in files]
    seconds = [json.loads((file.parent / "run.json").read_text(encoding="utf-8"))["cpu_seconds"] for file in files]
    pressed = np.concatenate([one.reached for one in found])
    steps = np.concatenate([one.measures["steps"] for one in found])[pressed]
    wrong = np.concatenate([one.measures["wrong_presses"] for one in found]).astype(float)
    low, high = wilson_interval(int(pressed.sum()), len(pressed))
    ((least, most),) = bootstrap_intervals(wrong, (mean,), resamples=500)
    needed = "no press"
    if len(steps):
        ((first, last),) = bootstrap_intervals(steps, (median,), resamples=500)
        needed = f"{median(steps):.0f} [{first:.0f}, {last:.0f}]"
    cells = (
        f"`{recipe}`",
        str(len(files)),
        f"{100 * pressed.mean():.1f} [{100 * low:.1f}, {100 * high:.1f}]",
        ", ".join(f"{100 * one.reached.mean():.1f}" for one in found),
        needed,
        f"{wrong.mean():.2f} [{least:.2f}, {most:.2f}]",
        ", ".join(f"{one.measures['wrong_presses'].mean():.2f}" for one in found),
        f"{min(seconds):.0f}–{max(seconds):.0f}",
    )
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    raise SystemExit(main())
