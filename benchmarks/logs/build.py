"""Make the learning curves of this folder from training runs: `python -m benchmarks.logs.build RUNS [RECIPE ...]`.

RUNS is what `python -m kinreach.train RECIPE --seeds K --out RUNS` leaves: `<recipe>/seed-<k>/curve.csv`. Discounted
rewards (`--rewards`) need runs whose learning curves have a row for each step.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.logs import CURVE, EPISODE, FOLDER, REWARDS, Log, load_logs
from kinreach._files import make_writable, replacing, write_text
from kinreach.baselines._learning_curve import curve_csv
from kinreach.errors import InputError

#: Significant digits; counts are exact.
DIGITS = 4
COUNTS = ("steps", "episodes")
#: Seeds whose policies a notebook or a table looks into, by recipe.
POLICIES = {
    name: range(5)
    for name in (
        "gradient-moving-clear",
        "gradient-moving-late",
        "gradient-moving-late-weak",
        "ppo-multi-ending",
        "thesis-ppo-single",
        "thesis-ppo-multi",
    )
} | {"gradient-moving-rough": range(1)}


def write_logs(recipe: str, what: str, runs: Path, folder: Path) -> int:
    """Write one kind of log of all seeds that have it.

    Args:
        recipe: Its name.
        what: As for `load_logs`.
        runs: Folder of the runs.
        folder: Of all logs.

    Returns:
        How many bytes were written.

    Raises:
        InputError: No seed has it, or a file is damaged.
        OutputError: The file system refused.
    """
    written = 0
    for seed, log in load_logs(recipe, what, runs=runs).items():
        make_writable(folder / recipe)
        text = _csv(log)
        write_text(folder / recipe / f"seed-{seed}{'' if what == CURVE else f'-{what}'}.csv", text)
        written += len(text)
    return written


def _csv(log: Log) -> str:
    rows = zip(*([_cell(value, name) for value in values] for name, values in log.items()), strict=True)
    return curve_csv(list(rows), tuple(log))


def _cell(value: float, name: str) -> float | None:
    if value != value:
        return None
    return float(value) if name in COUNTS else float(f"{value:.{DIGITS}g}")


def main(argv: list[str] | None = None) -> int:
    """Write the logs of all runs, or of some recipes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, help="folder with a folder for each recipe")
    parser.add_argument("recipes", nargs="*", help="default: all in the folder")
    parser.add_argument("--rewards", type=Path, metavar="RUNS", help="runs with a row for each step")
    args = parser.parse_args(argv)
    for recipe in args.recipes or sorted(path.name for path in args.runs.iterdir() if path.is_dir()):
        for what, runs in ((CURVE, args.runs), (EPISODE, args.runs), (REWARDS, args.rewards)):
            try:
                written = write_logs(recipe, what, runs, FOLDER) if runs is not None else 0
            except InputError:
                if what == CURVE:
                    raise
                continue  # most recipes have nothing but curves
            if written:
                print(f"{recipe}: {what}, {written / 1e3:.0f} kB")
        for seed in POLICIES.get(recipe, ()):
            policy = (args.runs / recipe / f"seed-{seed}" / "policy.safetensors").read_bytes()
            with replacing(FOLDER / recipe / f"seed-{seed}.safetensors") as temporary:
                temporary.write_bytes(policy)
            print(f"{recipe}: policy of seed {seed}, {len(policy) / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
