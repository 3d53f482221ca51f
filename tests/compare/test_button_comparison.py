"""The whole comparison on the button task, small, in the real environment."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from kinreach import cli
from kinreach.baselines.policies import pretrained_names
from kinreach.compare import Settings, compare
from kinreach.compare.button.players import GIVEN, PRETRAINED
from kinreach.compare.tasks.button import EpisodeSettings

GOALS = 6
NAMES = ["analytic", "untrained", "random"]
EPISODE = EpisodeSettings(max_steps=60)
CONTRACT = ("name", "goals", "reached", "reached_ci", "distance_mm", "success_at_mm", "impossible", "reward_mean",
            "solve_ms", "move_s")  # fmt: skip


@pytest.fixture(scope="module")
def finished(button_policy: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Settings, Path]:
    """An uninterrupted comparison: its settings and its directory."""
    methods = ("analytic", str(button_policy), "random")
    settings = Settings(task="button", methods=methods, goals=GOALS, seed=7, episode=EPISODE)
    out = tmp_path_factory.mktemp("button")
    compare(settings, out)
    return settings, out


def _rows(out: Path) -> list[dict[str, str]]:
    """Rows of `results.csv` without the time that a clock measured."""
    rows = csv.DictReader((out / "results.csv").read_text().splitlines())
    return [{key: value for key, value in row.items() if key != "solve_s"} for row in rows]


def _results(out: Path) -> Any:
    return json.loads((out / "results.json").read_text())


def _schema() -> Any:
    return json.loads(files("kinreach.compare").joinpath("results.schema.json").read_text())


def test_results_follow_their_schema_and_the_contract(finished: tuple[Settings, Path]) -> None:
    results = _results(finished[1])
    jsonschema.validate(results, _schema())
    assert [method["name"] for method in results["methods"]] == NAMES
    for method in results["methods"]:
        assert set(CONTRACT) <= set(method)
        assert method["goals"] == GOALS
        assert method["pressed"] == method["reached"]
    settings = results["settings"]
    assert settings["episode"] == {"max_steps": 60, "actuation": "tuned"}
    assert "at most 60 steps of 40 ms" in settings["terms"]["execution"]
    assert {settings["terms"][f"given to a {kind}"] for kind in GIVEN} == set(GIVEN.values())
    assert any(name.startswith("policy ") for name in results["versions"])


def test_the_schema_refuses_what_is_wrong(finished: tuple[Settings, Path]) -> None:
    results, schema = _results(finished[1]), _schema()
    first, settings = results["methods"][0], results["settings"]
    wrong = [
        results | {"methods": [first | {"extra": 0}]},
        results | {"methods": [{key: value for key, value in first.items() if key != "energy"}]},
        results | {"methods": [first | {"steps": {"median": 1.0, "p95": 2.0}}]},
        results | {"methods": [first | {"iterations": {"median": 1.0, "p95": 2.0}}]},
        results | {"settings": settings | {"task": "ur5"}},
        results | {"settings": settings | {"episode": None}},
    ]
    for document in wrong:
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(document, schema)


def test_every_goal_and_method_has_its_row_and_methods_the_same_targets(finished: tuple[Settings, Path]) -> None:
    rows = _rows(finished[1])
    assert [(int(row["goal"]), row["method"]) for row in rows] == [(g, name) for g in range(GOALS) for name in NAMES]
    assert len({(row["goal"], row["x"], row["y"], row["z"]) for row in rows}) == GOALS
    assert {row["reached"] for row in rows if row["method"] == "analytic"} == {"1"}
    assert {row["move_s"] for row in rows if row["reached"] == "0"} == {""}


def test_files_are_those_of_the_task(finished: tuple[Settings, Path]) -> None:
    out = finished[1]
    names = {path.name for path in out.iterdir()}
    assert names == {"results.json", "results.csv", "report.html", "pressed.png", "episodes.png"}
    for path in out.glob("*.png"):
        assert path.read_bytes().startswith(b"\x89PNG")
        assert path.stat().st_size > 10_000
    page = (out / "report.html").read_text(encoding="utf-8")
    assert all(name in page for name in NAMES)
    assert "wrong\npresses, mean" in page


@pytest.mark.usefixtures("no_figures")
def test_the_same_seed_gives_the_same_numbers(finished: tuple[Settings, Path], tmp_path: Path) -> None:
    settings, out = finished
    compare(settings, tmp_path)
    assert len(_rows(tmp_path)) == GOALS * 3
    assert _rows(tmp_path) == _rows(out)
    again, first = _results(tmp_path), _results(out)
    clocks = ("solve_ms", "solve_ms_ci", "decision_ms", "decision_ms_ci")
    for method in (*again["methods"], *first["methods"]):
        for clock in clocks:
            del method[clock]
    assert again["methods"] == first["methods"]


@pytest.mark.usefixtures("no_figures")
def test_an_interrupted_comparison_goes_on_and_ends_as_if_it_had_not_been(
    finished: tuple[Settings, Path], tmp_path: Path
) -> None:
    settings, out = finished

    def interrupt(done: int, total: int) -> None:
        if done == 5:  # in the middle of the second goal
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        compare(settings, tmp_path, progress=interrupt)
    seen: list[int] = []
    compare(settings, tmp_path, progress=lambda done, total: seen.append(done))
    assert seen == list(range(5, 3 * GOALS + 1))
    assert _rows(tmp_path) == _rows(out)
    assert not (tmp_path / "records.jsonl").exists()
    with pytest.raises(KeyboardInterrupt):
        compare(settings, tmp_path, fresh=True, progress=interrupt)
    other = replace(settings, episode=replace(EPISODE, max_steps=3))
    counted: list[int] = []
    compare(other, tmp_path, progress=lambda done, total: counted.append(done))
    assert counted[0] == 0
    assert {row["steps"] for row in _rows(tmp_path)} == {"3"}


def test_the_defaults_are_a_hundred_steps_and_the_tuned_actuation() -> None:
    settings = Settings(task="button")
    assert settings.methods == ("analytic", "ppo", "random")
    assert settings.to_dict()["episode"] == {"max_steps": 100, "actuation": "tuned"}
    assert Settings().to_dict()["episode"] is None


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize("options", ["", " --max-steps 40", " --max-steps 40 --actuation report"])
def test_the_command_prints_the_table_and_how_to_get_it_again(
    options: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("kinreach.compare.cli.write_scene", lambda *_: "")
    argv = f"compare --task button --methods random,analytic --goals 2{options}".split()
    assert cli.main(argv) == 0
    said = capsys.readouterr().out
    results = _results(tmp_path / "results" / "compare-button")
    command = f"kinreach compare --task button --methods random,analytic --goals 2 --seed 0{options}"
    assert results["settings"]["command"] == command
    assert command in said
    assert [line.split()[0] for line in said.splitlines()[4:6]] == ["random", "analytic"]
    assert "{pressed,episodes}.png" in said


def test_a_policy_that_does_not_come_with_the_package_is_one_clear_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("kinreach.baselines.policies.pretrained_names", lambda: ["multi", "single"])
    assert cli.main(["compare", "--task", "button", "--goals", "1", "--out", str(tmp_path)]) == cli.EXIT_ERROR
    out, err = capsys.readouterr()
    assert out == ""
    assert err == "kinreach compare: error: there is no policy 'button'; a file, or one of: multi, single\n"
    assert list(tmp_path.iterdir()) == []


def test_no_learning_library_is_loaded(run_python: Any, button_policy: Path) -> None:
    code = (
        "import sys\n"
        "from kinreach.compare import Settings, compare, report\n"
        "report.write_report = lambda *_: None\n"
        f"compare(Settings(task='button', methods=('analytic', {str(button_policy)!r}, 'random'), goals=1), 'out')\n"
        "print(sorted({'torch', 'stable_baselines3', 'tensorboard'} & set(sys.modules)))"
    )
    done = run_python("-c", code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.skipif(PRETRAINED not in pretrained_names(), reason="the package does not have this policy")
@pytest.mark.usefixtures("no_figures")
def test_the_policy_of_the_package_presses(tmp_path: Path) -> None:
    results = compare(Settings(task="button", goals=40, seed=1), tmp_path)
    pressed = {method["name"]: method["pressed"] for method in results["methods"]}
    assert list(pressed) == ["analytic", "ppo", "random"]
    assert min(pressed["analytic"], pressed["ppo"]) > 0.9 > pressed["random"]
