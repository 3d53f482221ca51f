"""The whole comparison, small, on the real solvers and the real simulation."""

import csv
import json
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from kinreach.compare import Settings, compare
from kinreach.compare.deciding import GIVEN
from kinreach.compare.methods import METHODS
from kinreach.compare.tasks import REACH_TASKS

GOALS = 5
TIMES = ("solve_s", "accept_s")


@pytest.fixture(scope="module", params=sorted(REACH_TASKS))
def finished(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Settings, Path]:
    """An uninterrupted comparison of all methods of a task: its settings and its directory."""
    settings = Settings(task=request.param, goals=GOALS, seed=7)
    out = tmp_path_factory.mktemp(request.param)
    compare(settings, out)
    return settings, out


def _rows(out: Path) -> list[dict[str, str]]:
    """Rows of `results.csv` without the times that a clock measured."""
    rows = csv.DictReader((out / "results.csv").read_text().splitlines())
    return [{key: value for key, value in row.items() if key not in TIMES} for row in rows]


def _refuse_constant(name: str) -> Any:
    raise AssertionError(f"{name} is not JSON")


def test_results_follow_their_schema(finished: tuple[Settings, Path]) -> None:
    settings, out = finished
    results = json.loads((out / "results.json").read_text(), parse_constant=_refuse_constant)
    schema = json.loads(files("kinreach.compare").joinpath("results.schema.json").read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(results, schema)
    assert [method["name"] for method in results["methods"]] == list(METHODS[settings.task])
    assert {method["goals"] for method in results["methods"]} == {GOALS}


def test_the_schema_refuses_what_is_wrong(finished: tuple[Settings, Path]) -> None:
    results = json.loads((finished[1] / "results.json").read_text())
    schema = json.loads(files("kinreach.compare").joinpath("results.schema.json").read_text())
    for change in (
        {"reached": 1.5},
        {"distance_mm": {"median": 1.0}},
        {"success_at_mm": {}},
        {"extra": 0},
        {"kind": "magic"},
    ):
        wrong = results | {"methods": [results["methods"][0] | change]}
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(wrong, schema)


def test_without_cameras_nothing_is_seen_and_older_results_are_valid(finished: tuple[Settings, Path]) -> None:
    results = json.loads((finished[1] / "results.json").read_text())
    settings = results["settings"]
    assert (settings["observation"], settings["camera"]) == ("geometric", None)
    for method in results["methods"]:
        for key in ("observed_error_mm", "look_ms"):
            assert method[key] == method[f"{key}_ci"] == {"median": None, "p95": None}
    rows = list(csv.DictReader((finished[1] / "results.csv").read_text().splitlines()))
    assert {row[key] for row in rows for key in ("seen_x", "seen_y", "seen_z", "seen_error", "look_s")} == {""}
    new = {"kind"} | {
        f"{key}{end}" for key in ("observed_error_mm", "look_ms", "move_error_mm", "budget_mm") for end in ("", "_ci")
    }
    older = {
        "methods": [{key: value for key, value in m.items() if key not in new} for m in results["methods"]],
        "settings": {key: value for key, value in settings.items() if key not in ("observation", "camera")},
        "versions": results["versions"],
    }
    schema = json.loads(files("kinreach.compare").joinpath("results.schema.json").read_text())
    jsonschema.validate(older, schema)


def test_every_goal_and_method_has_its_row(finished: tuple[Settings, Path]) -> None:
    settings, out = finished
    pairs = [(int(row["goal"]), row["method"]) for row in _rows(out)]
    assert pairs == [(goal, method) for goal in range(GOALS) for method in settings.methods]
    positions = {(row["goal"], row["x"], row["y"], row["z"]) for row in _rows(out)}
    assert len(positions) == GOALS


def test_only_results_are_left(finished: tuple[Settings, Path]) -> None:
    names = {path.name for path in finished[1].iterdir()}
    pictures = {"errors.png", "success.png", "times.png", "budget.png"}
    assert names == {"results.json", "results.csv", "report.html", *pictures}
    for path in finished[1].glob("*.png"):
        assert path.read_bytes().startswith(b"\x89PNG")
        assert path.stat().st_size > 10_000


def test_the_parts_of_every_distance_sum_to_it(finished: tuple[Settings, Path]) -> None:
    rows = [row for row in _rows(finished[1]) if row["status"] == "completed"]
    assert len(rows) > 3 * GOALS
    for row in rows:
        parts = [float(row[part]) for part in ("seeing", "deciding", "moving")]
        assert sum(parts) == pytest.approx(float(row["distance"]), abs=1e-15)
        assert parts[0] == 0.0  # what is told is the truth
        assert abs(parts[1]) <= float(row["ik_error"]) + 1e-15
        assert abs(parts[2]) <= float(row["move_error"]) + 1e-15
    results = json.loads((finished[1] / "results.json").read_text())
    for method in results["methods"]:
        *parts, distance = method["budget_mm"].values()
        assert sum(parts) == pytest.approx(distance, rel=1e-9)
        assert method["kind"] in GIVEN


@pytest.mark.usefixtures("no_figures")
def test_the_same_seed_gives_the_same_numbers(finished: tuple[Settings, Path], tmp_path: Path) -> None:
    settings, out = finished
    compare(settings, tmp_path)
    assert len(_rows(tmp_path)) == GOALS * len(settings.methods)
    assert _rows(tmp_path) == _rows(out)


@pytest.mark.usefixtures("no_figures")
def test_an_interrupted_comparison_goes_on_and_ends_as_if_it_had_not_been(
    finished: tuple[Settings, Path], tmp_path: Path
) -> None:
    settings, out = finished
    stop_after = len(settings.methods) + 2  # in the middle of the second goal
    (tmp_path / "results.json").write_text("older results")

    def interrupt(done: int, total: int) -> None:
        if done == stop_after:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        compare(settings, tmp_path, progress=interrupt)
    assert (tmp_path / "results.json").read_text() == "older results"
    seen: list[int] = []
    compare(settings, tmp_path, progress=lambda done, total: seen.append(done))
    assert seen == list(range(stop_after, GOALS * len(settings.methods) + 1))
    assert _rows(tmp_path) == _rows(out)
    assert not (tmp_path / "records.jsonl").exists()


@pytest.mark.usefixtures("no_figures")
def test_other_settings_other_code_or_fresh_do_not_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(done: int, total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    settings = Settings(task="arm3", methods=("closed-form",), goals=3)
    changes = [(replace(settings, goals=4), "0" * 12, False), (settings, "1" * 12, False), (settings, "0" * 12, True)]
    for again, digest, fresh in changes:
        monkeypatch.setattr("kinreach.provenance.source_digest", lambda: "0" * 12)
        with pytest.raises(KeyboardInterrupt):
            compare(settings, tmp_path, fresh=True, progress=interrupt)
        monkeypatch.setattr("kinreach.provenance.source_digest", lambda digest=digest: digest)
        seen: list[int] = []
        compare(again, tmp_path, fresh=fresh, progress=lambda done, total, seen=seen: seen.append(done))
        assert seen[0] == 0
        assert len(_rows(tmp_path)) == again.goals


@pytest.mark.usefixtures("no_figures")
def test_a_method_does_the_same_whoever_else_is_compared(finished: tuple[Settings, Path], tmp_path: Path) -> None:
    settings, out = finished
    compare(replace(settings, methods=("lm",)), tmp_path)
    alone = _rows(tmp_path)
    assert len(alone) == GOALS
    assert [row for row in _rows(out) if row["method"] == "lm"] == alone


def test_the_closed_form_reaches_every_goal(finished: tuple[Settings, Path]) -> None:
    settings, out = finished
    rows = [row for row in _rows(out) if row["method"] == "closed-form"]
    assert [(row["reached"], row["status"]) for row in rows] == [("1", "completed")] * GOALS
    assert max(float(row["ik_error"]) for row in rows) < 1e-9
    assert max(float(row["distance"]) for row in rows) < 0.001
    for row in rows:
        assert float(row["reward"]) == (20.0 if settings.task == "ur5" else -float(row["distance"]))
