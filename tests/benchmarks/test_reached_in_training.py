"""Goals reached in training: rows are those of the logs, and the page has that of the package's."""

import numpy as np
import pytest

from benchmarks.logs import load_logs
from benchmarks.studies.reached_in_training import main, row
from benchmarks.studies.tables import DATA, as_csv
from kinreach.baselines._learning_curve import COLUMNS, curve_csv

KNOWN = ("steps", "episodes", "reached")


def test_the_published_row_is_that_of_the_logs(capsys):
    assert main(["thesis-ppo-single"]) == 0
    printed = capsys.readouterr().out
    kept = (DATA / "reached-in-training.csv").read_text(encoding="utf-8").splitlines()
    assert as_csv(printed).splitlines() == kept[:2]
    counts = [int(count) for count in printed.splitlines()[-1].split("|")[4].split("/")]
    logs = load_logs("thesis-ppo-single")
    assert len(counts) == len(logs) == 5
    for count, log in zip(counts, logs.values(), strict=True):
        assert count == pytest.approx(np.nansum(log["reached"] * np.diff(log["episodes"], prepend=0)), abs=0.5)
        assert count > 10


def test_trainings_are_those_of_the_folder(tmp_path):
    for seed, reached in enumerate((0.0, 0.25, 0.5)):
        folder = tmp_path / "ppo-single" / f"seed-{seed}"
        folder.mkdir(parents=True)
        windows = [[100, 100, 0.01], [200, 200, reached]]
        rows = [
            [one.get(name, 0.0) for name in COLUMNS]
            for one in (dict(zip(KNOWN, window, strict=True)) for window in windows)
        ]
        (folder / "curve.csv").write_text(curve_csv(rows, COLUMNS))
        (folder / "run.json").write_text("{}")
    assert row("ppo-single", tmp_path).startswith("| `ppo-single` | 3 | 200 | 1 / 26 / 51 | 26 [")
