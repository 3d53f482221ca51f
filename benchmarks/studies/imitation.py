"""Pushing, and pick-and-place, learned from the script's answers: learning curves of the policies alone.

    python -m benchmarks.studies.imitation --figure docs/images/imitation.png

The recipes `imitated-push` and `imitated-pick-and-place` are trained with five seeds. After each part of a training the
policy is tried, without the script, on goals that no training draws. Each seed has a folder with the run, as `kinreach
train` leaves it, and `reached.csv` (actions, reached in percent, median distance at the end of an episode, processor
time of the training); the command begun again skips what is done. A seed that was interrupted while its policy was
tried is trained anew.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from time import process_time

import numpy as np

from benchmarks.studies.reached_curves import draw, numbers_of, rows_of, write_rows
from benchmarks.studies.tables import head, line
from benchmarks.studies.trainings import Trainings, with_interval
from kinreach._checks import check_count
from kinreach.baselines import evaluate, get_recipe
from kinreach.baselines._training import CHECKPOINT, RUN, make_folder, read_checkpoint, run_identity, segments
from kinreach.cli import Parser, finish
from kinreach.plots._colours import own_colour

PROG = "python -m benchmarks.studies.imitation"
TITLES = {"imitated-push": "Push-v0", "imitated-pick-and-place": "PickAndPlace-v0"}
CURVE = "reached.csv"


def train(name: str, folder: Path, seed: int, goals: int) -> None:
    """Train one seed, or go on with it, and write its curve."""
    recipe, rows = get_recipe(name), rows_of(folder / CURVE)
    if (folder / RUN).exists():
        return
    make_folder(folder)
    identity, checkpoint = run_identity(recipe, seed, 1), folder / CHECKPOINT
    state = read_checkpoint(checkpoint, identity) if checkpoint.exists() else None
    resume = state is not None and state["segment"] + 2 == len(rows)  # with the names of the columns
    rows = rows if resume else rows[:1]
    took = float(rows[-1][-1]) if resume else 0.0
    began = process_time()
    for policy in segments(recipe, folder, identity, resume=resume):
        took += process_time() - began
        found = evaluate(policy, goals=goals)
        reached, distance = 100.0 * found.reached.mean(), 1000.0 * np.median(found.measures["distance"])
        rows.append([str(policy.card.steps), f"{reached:.2f}", f"{distance:.2f}", f"{took:.1f}"])
        write_rows(folder / CURVE, rows)
        print(
            f"{name}, seed {seed}: {', '.join(rows[-1])}; collided {100.0 * found.impossible.mean():.1f} %", flush=True
        )
        began = process_time()


def main(argv: list[str] | None = None) -> int:
    """Train what is not trained yet, print a Markdown table, and draw a figure."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("results/imitation"), help="folder of the trainings")
    parser.add_argument("--only", nargs="+", choices=TITLES, default=list(TITLES), help="some (default: %(default)s)")
    parser.add_argument("--seeds", type=int, default=5, help="how many (default: %(default)s)")
    parser.add_argument("--goals", type=int, default=300, help="that policies are tried on (default: %(default)s)")
    parser.add_argument("--figure", type=Path, metavar="FILE", help="PNG file")
    given = parser.parse_args(argv)
    for name in ("seeds", "goals"):
        check_count(f"--{name}", getattr(given, name))
    folders = {name: [given.out / name / f"seed-{seed}" for seed in range(given.seeds)] for name in given.only}
    for seed in range(given.seeds):
        for name in given.only:
            train(name, folders[name][seed], seed, given.goals)
    curves = {TITLES[name]: [numbers_of(folder / CURVE) for folder in each] for name, each in folders.items()}
    print(head("recipe", "reached, % [95 % CI]", "single trainings, %", "collided, %", "training, s of processor"))
    for name, seeds in zip(folders, curves.values(), strict=True):
        found = Trainings.evaluated(name, folders[name], goals=given.goals, options={})
        each = ", ".join(f"{100.0 * share:.1f}" for share in found.reached.mean(axis=1))
        took = [one[-1, -1] for one in seeds]
        reached = with_interval(found.reached, unit=100, decimals=1)
        collided = f"{100.0 * found.impossible.mean():.1f}"
        print(line(f"`{name}`", reached, each, collided, f"{min(took):.0f}–{max(took):.0f}"), flush=True)
    if given.figure is not None:
        colours = dict(zip(curves, (own_colour("ppo-single"), own_colour("closed-form")), strict=False))
        note = f"{PROG}; the policies alone, {given.goals} goals that no training draws; thin: seeds"
        draw(curves, colours, given.figure, title="Objects brought to places, learned from a script", note=note)
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
