"""A whole comparison: settings in, measured trials, results on disk."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from kinreach import provenance, statistics
from kinreach.compare import figures, report
from kinreach.compare.checkpoint import Checkpoint
from kinreach.compare.contests import CONTESTS
from kinreach.compare.settings import Settings
from kinreach.compare.tables import trials_csv
from kinreach.compare.trials import Trial
from kinreach.files import make_writable, write_text

#: Called with the number of finished trials and the number of all trials.
Progress = Callable[[int, int], None]


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
        InputError: A policy does not come with the package, or its file cannot be read, is none, or is for another
            task.
    """
    out = Path(out)
    make_writable(out)
    contest = CONTESTS[settings.task](settings)
    versions, machine = provenance.versions(), provenance.machine()
    for method in contest.methods.values():
        versions |= method.versions
    identity = {"settings": settings.to_dict(), "versions": versions, "machine": machine}
    total = settings.goals * len(contest.methods)
    with contest.trying() as run:
        checkpoint = Checkpoint(
            out / "records.jsonl",
            identity,
            contest.trial,
            belongs=lambda trial: trial.method in contest.methods and trial.goal in range(settings.goals),
            fresh=fresh,
        )
        progress(len(checkpoint.trials), total)
        for trial in run(tuple(checkpoint.trials)):
            checkpoint.add(trial)
            progress(len(checkpoint.trials), total)
    order = list(contest.methods)
    trials = sorted(checkpoint.trials, key=lambda trial: (trial.goal, order.index(trial.method)))
    results = {
        "methods": [contest.summarise(name, [trial for trial in trials if trial.method == name]) for name in order],
        "settings": {
            **settings.to_dict(),
            "command": command,
            "terms": contest.terms(),
            "confidence": statistics.CONFIDENCE,
            "intervals": f"Wilson for rates; percentile bootstrap with {statistics.RESAMPLES} resamples for the rest",
            "machine": machine,
        },
        "versions": versions,
    }
    _write(out, trials, results)
    checkpoint.remove()
    return results


def _write(out: Path, trials: list[Trial], results: dict[str, Any]) -> None:
    write_text(out / "results.csv", trials_csv(trials))
    drawn = figures.write_all(out, trials, results)
    report.write_report(out / "report.html", trials, results, drawn)
    write_text(out / "results.json", json.dumps(results, indent=2, allow_nan=False) + "\n")
