"""Tables that fit, and a CSV that says everything."""

import csv
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from kinreach.compare.deciding import POLICY, SOLVER
from kinreach.compare.methods import METHODS
from kinreach.compare.reach_contest import ReachContest
from kinreach.compare.reach_tables import budget_table, methods_table
from kinreach.compare.summary import summarise
from kinreach.compare.tables import TABLE_WIDTH, ending, number, trials_csv
from kinreach.compare.trials import ReachTrial

TrialFactory = Callable[..., list[ReachTrial]]


@pytest.fixture
def results(make_trials: TrialFactory, impossible: ReachTrial) -> dict[str, Any]:
    """Results with wide numbers and all methods there are."""
    wide = make_trials(150, distance=0.3456, solve_s=0.1234, move_s=12.345, reached=False, reward=-12.345)
    summary = summarise("any", POLICY, [*wide, impossible])
    return {
        "methods": [summary | {"name": name} for name in METHODS["ur5"]],
        "settings": {
            "goals": 151,
            "seed": 0,
            "command": "python -m kinreach.compare",
            "terms": {"reached": "d < 1 cm"},
        },
    }


@pytest.fixture
def seen(results: dict[str, Any], make_trials: TrialFactory) -> dict[str, Any]:
    """The same, and cameras that looked."""
    summary = summarise("lm", SOLVER, make_trials(3, seen_error=0.00444, look_s=0.8391))
    looks = {key: summary[key] for key in ("observed_error_mm", "look_ms")}
    camera = {"pipeline": "thesis", "width": 1280, "height": 720, "rgb_noise": 12.5, "depth_noise": 0.0025}
    return {
        "methods": [method | looks for method in results["methods"]],
        "settings": results["settings"] | {"observation": "camera", "camera": camera},
    }


def _printed(results: dict[str, Any], width: int) -> list[str]:
    console = Console(width=width, file=io.StringIO(), highlight=False)
    console.print(methods_table(results, title="a title"))
    return [line.rstrip() for line in console.file.getvalue().splitlines()]  # type: ignore[attr-defined]


def test_the_table_fits_into_its_width_with_nothing_cut(results: dict[str, Any]) -> None:
    lines = _printed(results, TABLE_WIDTH)
    assert len(lines) == 3 + len(results["methods"])
    assert 80 < max(map(len, lines)) <= TABLE_WIDTH
    assert lines == _printed(results, 400)


def test_every_method_has_its_row_with_its_numbers(results: dict[str, Any]) -> None:
    rows = [line.split() for line in _printed(results, TABLE_WIDTH)[3:]]
    assert [row[0] for row in rows] == list(METHODS["ur5"])
    assert {" ".join(row[1:]) for row in rows} == {"0.0 [0.0, 2.5] 346 / 346 0.0 0.7 -12.9 123 / 123 12.3"}


def test_what_the_cameras_saw_is_a_column_and_fits(seen: dict[str, Any], results: dict[str, Any]) -> None:
    lines = _printed(seen, TABLE_WIDTH)
    assert 80 < max(map(len, lines)) <= TABLE_WIDTH
    assert lines == _printed(seen, 400)
    rows = [line.split() for line in lines[3:]]
    assert {" ".join(row[1:]) for row in rows} == {"0.0 [0.0, 2.5] 4.44 346 / 346 0.0 0.7 -12.9 123 / 123 12.3"}
    assert "seen" not in " ".join(_printed(results, TABLE_WIDTH))


def test_the_error_budget_adds_up_and_fits(results: dict[str, Any]) -> None:
    console = Console(width=TABLE_WIDTH, file=io.StringIO(), highlight=False)
    console.print(budget_table(results))
    lines = [line.rstrip() for line in console.file.getvalue().splitlines()]  # type: ignore[attr-defined]
    assert 80 < max(map(len, lines)) <= TABLE_WIDTH
    rows = [line.split() for line in lines[3:]]
    assert [row[0] for row in rows] == list(METHODS["ur5"])
    assert {" ".join(row[1:]) for row in rows} == {"0.00 -0.50 2.00 346 0 / 0 0 / 0"}


def test_columns_are_two_spaces_apart_where_they_fit(seen: dict[str, Any]) -> None:
    short = seen | {"methods": [method for method in seen["methods"] if len(method["name"]) <= len("closed-form")]}
    assert _printed(short, TABLE_WIDTH)[2].startswith("method       reached")
    assert _printed(seen, TABLE_WIDTH)[2].startswith("method            reached")


def test_footnotes_say_what_was_seen_and_how(seen: dict[str, Any], results: dict[str, Any]) -> None:
    notes = ReachContest.notes(seen)
    assert max(map(len, notes)) <= TABLE_WIDTH
    said = " ".join(notes)
    assert all(part in said for part in ("thesis pipeline, 1280x720, noise 12.5 levels, 2.5 mm", "p95 4.44", "839 ms"))
    assert "Seen" not in " ".join(ReachContest.notes(results))


def test_footnotes_name_the_command_and_fit(results: dict[str, Any]) -> None:
    notes = [*ReachContest.notes(results), *ending(results, Path("results/compare-ur5"), list(ReachContest.figures))]
    assert any("python -m kinreach.compare" in note for note in notes)
    assert max(map(len, notes)) <= TABLE_WIDTH


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "-"), (0.0, "0.00"), (123.4, "123"), (12.34, "12.3"), (1.234, "1.23"), (0.1234, "0.12"), (0.01234, "0.012"),
     (0.001234, "0.0012"), (1.2e-9, "1e-9"), (-0.5, "-0.50")],
)  # fmt: skip
def test_number(value: float | None, text: str) -> None:
    assert number(value) == text


def test_csv_has_a_row_per_trial_with_every_value(make_trials: TrialFactory, impossible: ReachTrial) -> None:
    (good,) = make_trials(1)
    rows = list(csv.DictReader(io.StringIO(trials_csv([good, impossible]))))
    assert len(rows) == 2
    assert float(rows[0]["distance"]) == good.distance
    assert tuple(map(float, rows[0]["q"].split())) == good.q
    assert (rows[0]["reached"], rows[1]["reached"]) == ("1", "0")
    assert (rows[1]["q"], rows[1]["move_s"], rows[1]["status"]) == ("", "", "out of reach")
