"""A whole comparison: settings in, measured trials, results on disk."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from kinreach import provenance, statistics
from kinreach.compare import figures
from kinreach.compare.budget import MEANING
from kinreach.compare.checkpoint import Checkpoint
from kinreach.compare.deciding import GIVEN, Method
from kinreach.compare.methods import new_method, short_name
from kinreach.compare.observation import looking, what_is_told
from kinreach.compare.runner import run_trials
from kinreach.compare.settings import Settings
from kinreach.compare.summary import summarise
from kinreach.compare.tables import trials_csv
from kinreach.compare.tasks import TASKS, Task
from kinreach.compare.trials import Trial
from kinreach.envs.controller import TOLERANCE
from kinreach.envs.simulation import ArmSimulation
from kinreach.files import make_writable, write_text
from kinreach.kinematics.solvers.base import Tolerance

#: Called with the number of finished trials and the number of all trials.
Progress = Callable[[int, int], None]

#: What all tasks give every method alike.
_COMMON_TERMS = {
    "tolerance": f"numeric solvers stop within {Tolerance().position:g} m and {Tolerance().orientation:g} rad",
    "execution": "from the start posture, in MuJoCo: one move, two-phase; a policy of several steps moves all joints "
    f"at once and decides after each move; a move is done when every joint rests within {TOLERANCE:g} rad",
    "timing": "methods take turns in random order on every goal after untimed warm-up decisions; one process, one "
    "thread, one goal at a time; a policy's time is that of its features and its network, summed over its decisions",
    "error_budget": f"seeing, deciding and moving: {MEANING}; the parts sum to the distance",
}


def compare(
    settings: Settings,
    out: str | Path,
    *,
    fresh: bool = False,
    command: str = "kinreach.compare.compare(...)",
    progress: Progress = lambda done, total: None,
) -> dict[str, Any]:
    """Measure every method on every goal and write the results.

    Interrupted, it leaves the finished trials in `out/records.jsonl`; called again with the same settings (and the
    same code, versions and machine) it goes on from there. The file disappears when the results are written.

    Args:
        settings: What to compare.
        out: Directory for `results.json`, `results.csv` and the figures; created if need be.
        fresh: Measure everything, even if an interrupted comparison could go on.
        command: How to get the same again, written into the results.
        progress: Told how far it is.

    Returns:
        The contents of `results.json`.

    Raises:
        OutputError: `out` cannot be written.
        InstallationError: A method's packages are missing, or cameras are to look and nothing can be drawn.
        InputError: A policy's file cannot be read, is none, or is for another task.
    """
    out = Path(out)
    make_writable(out)
    task = TASKS[settings.task]()
    methods = {short_name(name): new_method(task, name) for name in settings.methods}
    versions, machine = provenance.versions(), provenance.machine()
    for method in methods.values():
        versions |= method.versions
    identity = {"settings": settings.to_dict(), "versions": versions, "machine": machine}
    total = settings.goals * len(methods)
    goals = task.goals(settings.goals, settings.seed)
    simulation = ArmSimulation(arm=task.arm_name)
    with looking(task, settings.camera, settings.seed) as look:
        checkpoint = Checkpoint(out / "records.jsonl", identity, fresh=fresh)
        progress(len(checkpoint.trials), total)
        for trial in run_trials(task, methods, goals, simulation, look=look, done=tuple(checkpoint.trials)):
            checkpoint.add(trial)
            progress(len(checkpoint.trials), total)
    order = list(methods)
    trials = sorted(checkpoint.trials, key=lambda trial: (trial.goal, order.index(trial.method)))
    results = {
        "methods": [
            summarise(name, method.kind, [trial for trial in trials if trial.method == name])
            for name, method in methods.items()
        ],
        "settings": {
            **settings.to_dict(),
            "command": command,
            **_conditions(task, settings, methods),
            "machine": machine,
        },
        "versions": versions,
    }
    _write(out, trials, results)
    checkpoint.remove()
    return results


def _conditions(task: Task, settings: Settings, methods: Mapping[str, Method]) -> dict[str, Any]:
    kinds = {method.kind for method in methods.values()}
    given = {f"given to a {kind}": words for kind, words in GIVEN.items() if kind in kinds}
    return {
        "terms": {**task.terms(), "observation": what_is_told(settings.camera), **given, **_COMMON_TERMS},
        "confidence": statistics.CONFIDENCE,
        "intervals": f"Wilson for rates; percentile bootstrap with {statistics.RESAMPLES} resamples for the rest",
    }


def _write(out: Path, trials: list[Trial], results: dict[str, Any]) -> None:
    write_text(out / "results.csv", trials_csv(trials))
    figures.write_all(out, trials, results)
    write_text(out / "results.json", json.dumps(results, indent=2, allow_nan=False) + "\n")
