"""The CSV files of the appendix: what they leave out, and that none is forgotten by its page."""

import csv
import io
import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks.studies.tables import DATA, as_csv, head, line, main

APPENDIX = Path(__file__).parents[2] / "docs" / "studies" / "appendix"


def test_every_file_is_on_a_page_and_has_whole_rows():
    files = sorted(file.name for file in DATA.glob("*.csv"))
    shown = [
        name
        for page in APPENDIX.parent.rglob("*.md")
        for name in re.findall(r"^<!-- table (?:appendix/)?data/(\S+) -->$", page.read_text(), re.MULTILINE)
    ]
    assert sorted(shown) == files
    assert len(files) >= 25
    for name in files:
        rows = list(csv.reader((DATA / name).read_text(encoding="utf-8").splitlines()))
        assert len({len(row) for row in rows}) == 1 < len(rows), name


def test_what_is_read_back_is_what_was_printed():
    rng = np.random.default_rng(0)
    columns = 0
    for _ in range(50):
        cells = rng.integers(0, 3, (4, 5))
        rows = [[f"{value} [{value}, {value + 1}]" if value else "0" for value in row] for row in cells]
        names = [f"column {number}, %" for number in range(5)]
        found = list(csv.reader(io.StringIO(as_csv("\n".join([head(*names), *(line(*row) for row in rows)])))))
        kept = cells.any(axis=0)
        assert found == [list(np.array(row)[kept]) for row in [names, *rows]]
        columns += kept.sum()
    assert 50 < columns < 250


@pytest.mark.parametrize(("cell", "zero"), [("0.0", True), ("0 / 0", True), ("0.0 [0.0, 0.4]", False)])
def test_what_counts_as_zero(cell, zero):
    assert as_csv(f"{head('name', 'value')}\n{line('a', cell)}") == (
        "name\na\n" if zero else f"name,value\na,{_quoted(cell)}\n"
    )


def _quoted(cell):
    return f'"{cell}"' if "," in cell else cell


def test_the_command_writes_the_tables_of_its_input(tmp_path, monkeypatch):
    printed = f"some words\n\n{head('a')}\n{line(1)}\n\n{head('b')}\n{line(2)}"
    monkeypatch.setattr("sys.stdin", io.StringIO(printed))
    assert main(["one", "two", "--out", str(tmp_path)]) == 0
    assert [(tmp_path / f"{name}.csv").read_text() for name in ("one", "two")] == ["a\n1\n", "b\n2\n"]


def test_a_table_without_a_name_is_refused(run_python):
    done = run_python(
        "-c",
        "import io, sys; sys.stdin = io.StringIO(''); sys.argv[1:] = ['one']; "
        "import runpy; runpy.run_module('benchmarks.studies.tables', run_name='__main__')",
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert "standard input has 0 tables, but 1 names were given" in done.stderr


def test_what_never_was_is_a_dash():
    rng = np.random.default_rng(1)
    values = rng.normal(0, 3, 60).round(1)
    cells = [f"{value} [{-value}, -]" if value > 0 else f"- / {value}" for value in values]
    found = as_csv("\n".join([head("a"), *map(line, cells)])).splitlines()[1:]
    assert [cell.strip('"') for cell in found] == [
        f"{value} [{-value}, –]" if value > 0 else f"– / {value}" for value in values
    ]
    assert 10 < (values > 0).sum() < 50
