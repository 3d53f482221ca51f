"""Processes killed at random moments (SIGKILL): nothing is half-written, and going on ends as without interruption."""

from __future__ import annotations

import csv
import io
import json
import multiprocessing
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

import benchmarks.learners  # noqa: F401 (registers its recipes)
from kinreach import _provenance as provenance
from kinreach.baselines._policies import load_policy
from kinreach.baselines._recipes import get_recipe
from kinreach.baselines._training import train
from kinreach.compare import compare
from tools.endurance.outcome import Outcome, demand

#: One that has everything imported already, and forks.
CONTEXT = multiprocessing.get_context("forkserver")
CONTEXT.set_forkserver_preload(["tools.endurance.kills"])
#: Wait that long for a process [s], as nothing here takes a tenth of it.
PATIENCE = 300.0
#: Columns of `results.csv` that are measured by the clock.
TIMES = ("solve_s", "accept_s", "look_s")
RECIPES = {
    "ranked-single": {"num_envs": 32, "steps": 32 * 192, "segments": 12, "window": 512},
    "sac-single": {"num_envs": 8, "steps": 480, "segments": 12, "window": 64},
}
COMPARISON = {"methods": ("closed-form", "placo", "lm", "ranked-single"), "seed": 3}


@dataclass(frozen=True)
class Work:
    """Something that writes a folder, can be killed, and goes on when it is called again.

    Attributes:
        run: Does it.
        result: What must not depend on interruptions, from the folder.
    """

    run: Callable[[Path], object]
    result: Callable[[Path], Any]


def trained(name: str, folder: Path) -> None:
    """Train a small version of a recipe, or go on with it."""
    settings = dict(get_recipe(name).settings)
    if name == "sac-single":
        settings |= {"learning_starts": 80, "batch_size": 16}
    train(replace(get_recipe(name), settings=settings, **RECIPES[name]), folder, seed=4, resume=True)


def training_result(folder: Path) -> tuple[bytes, str]:
    """The policy with all that its card says, and the learning curve."""
    return (folder / "policy.safetensors").read_bytes(), (folder / "curve.csv").read_text(encoding="utf-8")


def compared(folder: Path, goals: int = 25) -> None:
    """Run a small comparison, or go on with it."""
    provenance.source_digest = lambda: "0" * 12  # somebody may edit a module meanwhile
    compare(**COMPARISON, goals=goals, out=folder)


def comparison_result(folder: Path) -> Any:
    """All trials and the share of each outcome, but for what is measured by the clock."""
    rows = list(csv.DictReader(io.StringIO((folder / "results.csv").read_text(encoding="utf-8"))))
    results = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    trials = [{name: value for name, value in row.items() if name not in TIMES} for row in rows]
    return trials, [(method["name"], method["outcomes"], method["reached"]) for method in results["methods"]]


def _train_single(folder: Path) -> None:
    trained("ranked-single", folder)


def _train_sac(folder: Path) -> None:
    trained("sac-single", folder)


WORKS = {
    "training": Work(_train_single, training_result),
    "off-policy training": Work(_train_sac, training_result),
    "comparison": Work(compared, comparison_result),
}


def kill_and_go_on(work: Work, folder: Path, *, kills: int, seed: int = 0) -> Outcome:
    """Kill a job at random moments until that has happened often enough; it must end as if nothing had been.

    Args:
        work: What is killed, again and again, until it comes to its end; then it begins anew.
        folder: An empty one.
        kills: How many at least.
        seed: Of the moments.

    Raises:
        BrokenPromiseError: A file was not whole, the result is another one, or something was left behind.
    """
    began = time.perf_counter()
    demand(_ran_to_its_end(work, folder / "whole", None), "the uninterrupted run was interrupted")
    duration = time.perf_counter() - began
    expected, names = work.result(folder / "whole"), _names(folder / "whole")
    rng = np.random.default_rng(seed)
    killed = files = rounds = 0
    while killed < kills:
        place = folder / f"round-{rounds}"
        while not _ran_to_its_end(work, place, rng.uniform(0.0, duration)):
            killed += 1
            files += whole_files(place)
        demand(work.result(place) == expected, f"after interruptions {place} has another result")
        demand(_names(place) == names, f"{place} has {_names(place)}, not {names}")
        rounds += 1
    return Outcome(killed, "kills", f"{rounds} times to the end, {files} files looked at, all whole")


def _ran_to_its_end(work: Work, folder: Path, seconds: float | None) -> bool:
    """Whether a process could finish before it was killed."""
    ours, theirs = CONTEXT.Pipe()
    process = CONTEXT.Process(target=_begin, args=(theirs, work.run, folder))
    process.start()
    theirs.close()
    demand(ours.poll(PATIENCE), "the process does not begin")
    ours.recv()
    process.join(PATIENCE if seconds is None else seconds)
    if process.is_alive():
        process.kill()
        process.join(PATIENCE)
    ours.close()
    code = process.exitcode
    process.close()
    demand(code in (0, -signal.SIGKILL), f"going on in {folder} failed (exit code {code})")
    return code == 0


def _begin(pipe: Any, run: Callable[[Path], object], folder: Path) -> None:
    torch.set_num_threads(1)
    pipe.send("ready")
    run(folder)


def _names(folder: Path) -> set[str]:
    """What is in a folder, hidden things too."""
    return {path.name for path in folder.iterdir()}


def whole_files(folder: Path) -> int:
    """Read every result in a folder to its end; those that are being written are hidden, and do not count.

    Returns:
        How many there were.

    Raises:
        BrokenPromiseError: One is not whole.
    """
    count = 0
    for path in sorted(folder.glob("[!.]*")) if folder.exists() else []:
        look = READERS.get(path.suffix)
        if look is None:
            demand(path.is_dir(), f"{path.name} is of no known kind")
            continue
        try:
            look(path)
        except Exception as error:
            demand(False, f"{path} is not whole: {error}")
        count += 1
    return count


def _read_csv(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    lengths = {len(row) for row in csv.reader(io.StringIO(text))}
    demand(text.endswith("\n") and len(lengths) == 1, "rows are cut short")


def _read_records(path: Path) -> None:
    """Trials are appended: the last line, and no other, may be cut short."""
    *lines, _ = path.read_text(encoding="utf-8").split("\n")
    for line in lines:
        json.loads(line)


def _read_page(path: Path) -> None:
    demand(path.read_text(encoding="utf-8").rstrip().endswith("</html>"), "the page has no end")


READERS: dict[str, Callable[[Path], object]] = {
    ".csv": _read_csv,
    ".json": lambda path: json.loads(path.read_text(encoding="utf-8")),
    ".jsonl": _read_records,
    ".html": _read_page,
    ".png": lambda path: Image.open(path).load(),
    ".pt": lambda path: torch.load(path, weights_only=True),
    ".safetensors": load_policy,
}
