"""The study of errors that no frame describes: its table, rows that are kept, and the published file."""

import csv
import re

import numpy as np
import pytest

pytest.importorskip("torch")
from benchmarks.studies import nongeometric
from benchmarks.studies.tables import DATA
from kinreach.errors import InputError


def rows_of(table):
    """Cells of the rows of a Markdown table."""
    return [line.strip("| ").split(" | ") for line in table.splitlines()[2:]]


def test_the_table_is_resumed(tmp_path, capsys, monkeypatch):
    arguments = ["--errors", "sag", "everything", "--methods", "data-sheet", "identified-joints", "--goals", "4"]
    assert nongeometric.main([*arguments, "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    alone, together = re.findall(r"(?:^\|.*\|\n)+", printed, re.MULTILINE)
    (_, *sag), (_, *found) = rows_of(alone)
    everything, learned = rows_of(together)
    assert [sag[0], found[0], everything[0], learned[0]] == 2 * ["`data-sheet`", "`identified-joints`"]
    sag, found, everything, learned = (
        [float(cell.split()[0]) for cell in row[1:]] for row in (sag, found, everything, learned)
    )
    assert 0.5 < sag[0] < 1.5
    assert 3.0 < everything[0] < 9.0
    assert max(np.ptp(sag), np.ptp(everything)) < 0.03  # whoever knows the data sheet alone
    assert max(found[2], learned[2]) < 0.3
    monkeypatch.setattr(nongeometric, "rollout", None)  # nothing is played again
    assert nongeometric.main([*arguments, "--out", str(tmp_path)]) == 0
    assert capsys.readouterr().out == printed
    with pytest.raises(InputError, match="--goals must be at least 1"):
        nongeometric.main(["--goals", "0", "--out", str(tmp_path)])


def test_intervals_are_over_robots_where_robots_differ():
    """A robot on which every workplace is worse widens the interval, however many workplaces there are."""
    found = [
        {"robot": name, "mm": [0.2 + 0.1 * (name == "d") + 1e-3 * place] * len(nongeometric.CELLS)}
        for name in "abcd"
        for place in range(50)
    ]
    over_robots, over_workplaces = nongeometric.cells("everything", found)[0], nongeometric.cells("sag", found)[0]
    low, high = (
        [float(bound) for bound in cell.partition("[")[2].rstrip("]").split(", ")]
        for cell in (over_workplaces, over_robots)
    )
    assert high[1] - high[0] > 3 * (low[1] - low[0])


def test_the_published_rows_are_all_there():
    alone, together = (
        list(csv.reader((DATA / f"{name}.csv").read_text(encoding="utf-8").splitlines()))
        for name in ("nongeometric", "all-errors")
    )
    assert alone[0] == ["what is off", *together[0]] == ["what is off", "method", *nongeometric.CELLS]
    assert [row[:2] for row in alone[1:]] == [
        [kind, f"`{name}`"] for kind in nongeometric.KINDS[:-1] for name in nongeometric.METHODS
    ]
    assert [row[0] for row in together[1:]] == [f"`{name}`" for name in nongeometric.METHODS]
