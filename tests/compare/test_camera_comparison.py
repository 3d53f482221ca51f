"""The comparison on what the cameras saw: small, with real pictures where they can be drawn."""

import csv
import json
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from kinreach.compare import Settings, compare
from kinreach.compare.observation import CameraSettings
from kinreach.compare.reach_figures import draw_errors, draw_times
from kinreach.compare.tasks import UR5Task

GOALS = 5
TIMES = ("solve_s", "accept_s", "look_s")
SETTINGS = Settings(goals=GOALS, seed=7, observation="camera")


@pytest.fixture(scope="module")
def out(needs_gl: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory of an uninterrupted comparison of all methods."""
    folder = tmp_path_factory.mktemp("camera")
    compare(SETTINGS, folder)
    return folder


def _rows(folder: Path) -> list[dict[str, str]]:
    """Rows of `results.csv` without the times that a clock measured."""
    rows = csv.DictReader((folder / "results.csv").read_text().splitlines())
    return [{key: value for key, value in row.items() if key not in TIMES} for row in rows]


def _results(folder: Path) -> Any:
    return json.loads((folder / "results.json").read_text())


def _schema() -> Any:
    return json.loads(files("kinreach.compare").joinpath("results.schema.json").read_text())


def _point(row: dict[str, str], prefix: str = "") -> list[float]:
    return [float(row[f"{prefix}{axis}"]) for axis in "xyz"]


def test_results_follow_the_schema_and_say_what_was_seen(out: Path) -> None:
    results = _results(out)
    jsonschema.validate(results, _schema())
    assert results["settings"]["observation"] == "camera"
    assert results["settings"]["camera"] == {
        "pipeline": "hybrid", "width": 640, "height": 360, "rgb_noise": 0.0, "depth_noise": 0.0
    }  # fmt: skip
    assert "hybrid pipeline, 640x360, no noise" in results["settings"]["terms"]["observation"]
    for method in results["methods"]:
        assert 0 < method["observed_error_mm"]["median"] <= method["observed_error_mm"]["p95"] < 3
        assert method["observed_error_mm"] == results["methods"][0]["observed_error_mm"]
        assert method["look_ms"]["median"] > 0


def test_the_schema_wants_what_was_seen_exactly_if_cameras_looked(out: Path) -> None:
    results, schema = _results(out), _schema()
    first, settings = results["methods"][0], results["settings"]
    without = {key: value for key, value in first.items() if key != "observed_error_mm"}
    never = {"median": None, "p95": None}
    wrong = [
        results | {"methods": [without]},
        results | {"methods": [first | {"look_ms": never}]},
        results | {"settings": settings | {"camera": None}},
        results | {"settings": settings | {"camera": settings["camera"] | {"pipeline": "magic"}}},
        results | {"settings": settings | {"observation": "geometric", "camera": None}},
    ]
    for document in wrong:
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(document, schema)


def test_all_methods_are_told_the_same_and_that_is_nearly_the_goal(out: Path) -> None:
    rows = _rows(out)
    assert len(rows) == GOALS * len(SETTINGS.methods)
    assert len({(row["goal"], row["seen_x"], row["seen_y"], row["seen_z"], row["seen_error"]) for row in rows}) == GOALS
    for row in rows:
        error = float(row["seen_error"])
        assert error == pytest.approx(np.linalg.norm(np.subtract(_point(row, "seen_"), _point(row))), abs=1e-12)
        assert 0 < error < 0.003


def test_the_closed_form_goes_where_it_was_told_and_reaches_every_ball(out: Path) -> None:
    rows = [row for row in _rows(out) if row["method"] == "closed-form"]
    assert [(row["reached"], row["reward"]) for row in rows] == [("1", "20.0")] * GOALS
    kinematics = UR5Task().kinematics
    for row in rows:
        tip = kinematics.fk([float(value) for value in row["q"].split()])[:3, 3]
        np.testing.assert_allclose(tip, _point(row, "seen_"), atol=1e-9)
        assert float(row["ik_error"]) < 1e-9
        assert abs(float(row["distance"]) - float(row["seen_error"])) < 0.001  # what the move adds or takes away
        parts = [float(row[part]) for part in ("seeing", "deciding", "moving")]
        assert sum(parts) == pytest.approx(float(row["distance"]), abs=1e-15)
        assert parts[0] > 0.5 * float(row["distance"])


@pytest.mark.usefixtures("no_figures")
def test_an_interrupted_comparison_goes_on_and_ends_as_if_it_had_not_been(out: Path, tmp_path: Path) -> None:
    stop_after = len(SETTINGS.methods) + 2  # in the middle of the second goal

    def interrupt(done: int, total: int) -> None:
        if done == stop_after:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        compare(SETTINGS, tmp_path, progress=interrupt)
    seen: list[int] = []
    compare(SETTINGS, tmp_path, progress=lambda done, total: seen.append(done))
    assert seen == list(range(stop_after, GOALS * len(SETTINGS.methods) + 1))
    assert _rows(tmp_path) == _rows(out)


@pytest.mark.usefixtures("no_figures")
def test_noise_is_that_of_seed_and_goal_whoever_is_compared(needs_gl: None, tmp_path: Path) -> None:
    camera = CameraSettings(width=320, height=180, rgb_noise=6.0, depth_noise=0.002)
    both = Settings(methods=("closed-form", "lm"), goals=3, seed=7, observation="camera", camera=camera)
    compare(both, tmp_path / "both")
    compare(replace(both, methods=("lm",), goals=2), tmp_path / "alone")
    alone = _rows(tmp_path / "alone")
    assert len(alone) == 2
    assert alone == [row for row in _rows(tmp_path / "both") if row["method"] == "lm"][:2]


@pytest.mark.usefixtures("no_figures", "stand_in")
def test_other_cameras_do_not_go_on(tmp_path: Path) -> None:
    def interrupt(done: int, total: int) -> None:
        if done == 1:
            raise KeyboardInterrupt

    settings = replace(SETTINGS, methods=("closed-form",), goals=2)
    changes = [
        replace(settings, observation="geometric", camera=None),
        replace(settings, camera=CameraSettings(pipeline="thesis")),
        replace(settings, camera=CameraSettings(width=320, height=180)),
        replace(settings, camera=CameraSettings(rgb_noise=1.0)),
        replace(settings, camera=CameraSettings(depth_noise=0.001)),
    ]
    for again, first_seen in [(settings, 1), *((change, 0) for change in changes)]:
        with pytest.raises(KeyboardInterrupt):
            compare(settings, tmp_path, fresh=True, progress=interrupt)
        seen: list[int] = []
        compare(again, tmp_path, progress=lambda done, total, seen=seen: seen.append(done))
        assert seen[0] == first_seen


@pytest.mark.usefixtures("no_figures")
def test_methods_that_are_left_are_told_what_the_finished_ones_were(stand_in: Any, tmp_path: Path) -> None:
    stand_in.sigma = 0.001

    def interrupt(done: int, total: int) -> None:
        if done == 3:  # in the middle of the second goal
            raise KeyboardInterrupt

    settings = replace(SETTINGS, methods=("closed-form", "lm"), goals=3)
    with pytest.raises(KeyboardInterrupt):
        compare(settings, tmp_path, progress=interrupt)
    compare(settings, tmp_path)
    resumed = stand_in.made[-1]
    assert len(resumed.looks) == 2  # the untimed one, and at the third goal
    assert len({row["seen_error"] for row in _rows(tmp_path)}) == 3


@pytest.mark.usefixtures("no_figures")
def test_a_ball_that_no_camera_finds_is_impossible_for_all_alike(stand_in: Any, tmp_path: Path) -> None:
    stand_in.blind = (2,)  # the second goal: an untimed look comes first
    results = compare(replace(SETTINGS, goals=3), tmp_path)
    jsonschema.validate(_results(tmp_path), _schema())
    blind = [row for row in _rows(tmp_path) if row["goal"] == "1"]
    assert [row["method"] for row in blind] == list(SETTINGS.methods)
    for row in blind:
        assert (row["status"], row["reason"]) == ("no ball found", "no camera found the ball")
        assert (row["impossible"], row["reached"], row["reward"]) == ("1", "0", "-100.0")
        assert {row[key] for key in ("q", "move_s", "ik_error", "seen_x", "seen_error", "candidates")} == {""}
        assert float(row["distance"]) > 0.01
    for method in results["methods"]:
        assert method["outcomes"] == {"completed": 2, "no ball found": 1}
        assert method["impossible"] == pytest.approx(1 / 3)
        assert method["observed_error_mm"]["p95"] < 1e-9  # of the two that were found
        assert method["solve_ms"]["median"] > 0


def test_no_ball_at_all_is_a_result_too(stand_in: Any, tmp_path: Path) -> None:
    stand_in.found = (False, False)
    results = compare(replace(SETTINGS, methods=("closed-form", "lm"), goals=2), tmp_path)
    jsonschema.validate(_results(tmp_path), _schema())
    for method in results["methods"]:
        assert (method["impossible"], method["reward_mean"]) == (1.0, -100.0)
        for key in ("observed_error_mm", "solve_ms", "ik_error_mm", "move_s", "candidates"):
            assert method[key] == {"median": None, "p95": None}
        assert method["look_ms"]["median"] > 0
    assert (tmp_path / "errors.png").stat().st_size > 10_000


@pytest.mark.usefixtures("no_figures")
def test_figures_show_what_the_cameras_saw(stand_in: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in.sigma = 0.001
    kept: dict[str, Any] = {}

    def keep(out: Path, trials: Any, results: Any) -> dict[str, Path]:
        kept.update(trials=trials, results=results)
        return {}

    monkeypatch.setattr("kinreach.compare.figures.write_all", keep)
    compare(replace(SETTINGS, methods=("closed-form", "lm"), goals=3), tmp_path)
    left, right = draw_errors(**kept).axes
    names = [label.get_text() for label in left.get_yticklabels()]
    assert names == ["cameras", "closed-form", "lm"]
    seen = sorted(1e3 * trial.seen_error for trial in kept["trials"] if trial.method == "lm")
    for axes in (left, right):
        assert sorted(axes.collections[0].get_offsets()[:, 0]) == pytest.approx(seen)
    (times,) = draw_times(**kept).axes
    assert [label.get_text() for label in times.get_yticklabels()] == ["closed-form", "lm"]
