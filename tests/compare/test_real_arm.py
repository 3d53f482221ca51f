"""When the model is wrong: who looks finds out, and nobody does better than what is seen."""

import json
import re

import numpy as np
import pytest

from benchmarks.studies import corrections
from kinreach.cli import EXIT_ERROR, main
from kinreach.compare import compare, get_task
from kinreach.robots import PUBLISHED_CALIBRATIONS

GOALS = 5


@pytest.fixture(scope="module")
def results():
    return {entry["name"]: entry for entry in compare("real-arm", goals=GOALS)["methods"]}


def mm(results, method, errors, budget, again=0):
    return results[method][errors][f"looks_{budget}_{again}"]["median"]


@pytest.mark.slow
def test_the_data_sheet_misses_by_what_is_wrong(results):
    assert mm(results, "data-sheet", "tool", 50, 2) == pytest.approx(5.0, abs=0.1)
    assert 3.0 < mm(results, "data-sheet", "base", 0) < 6.0
    for errors in ("links", "tool", "base", "cameras", "all"):
        assert mm(results, "data-sheet", errors, 0) == mm(results, "data-sheet", errors, 50, 2)


@pytest.mark.slow
def test_who_looks_again_comes_to_what_is_seen(results):
    for method in ("look-again", "registered", "identified", "residual", "correction"):
        for errors in ("tool", "all"):
            assert mm(results, method, errors, 0) > 1.5
            assert 0.1 < mm(results, method, errors, 0, 2) < 0.3


@pytest.mark.slow
def test_looks_beforehand_are_worth_as_much(results):
    for method in ("identified", "residual", "correction"):
        line = [mm(results, method, "all", budget) for budget in (0, 5, 10, 20, 50)]
        assert line[0] > 5 * line[1]
        assert line[1] > line[-1]
        assert line[-1] < 0.25
    assert mm(results, "identified", "all", 10) < mm(results, "registered", "all", 10) + 0.05
    assert mm(results, "policy-tuned", "base", 20) < 0.2 * mm(results, "policy", "base", 20)


@pytest.mark.slow
def test_who_was_trained_on_random_arms_makes_something_of_looks(results):
    line = [mm(results, "policy-informed", "all", budget) for budget in (0, 5, 50)]
    assert line[0] > 3.0
    assert line[0] > 3 * line[1] > 3 * line[2]
    assert mm(results, "policy-informed", "all", 0, 1) < 0.5


@pytest.mark.slow
def test_trainings_of_the_corrections_differ_little(tmp_path, capsys, monkeypatch):
    arguments = ["--seeds", "2", "--goals", "3", "--out", str(tmp_path)]
    assert corrections.main(arguments) == 0
    printed = capsys.readouterr().out
    rows = [line.strip("| ").split(" | ") for line in printed.splitlines()[2:]]
    assert [row[0] for row in rows] == 5 * ["all"] + 6 * ["everything"]
    assert [row[1] for row in rows[:2]] == ["`identified`", "`residual`"]
    for learned, spread in ((rows[2:5], 0.02), (rows[8:], 0.03)):
        values = np.array([[float(cell.split()[0]) for cell in row[2:]] for row in learned])
        assert values.shape == (3, 4)
        assert 0.1 < values.min() <= values.max() < 0.5
        assert 0.0 < np.ptp(values, axis=0).max() < spread
        np.testing.assert_allclose(values[2], values[:2].mean(axis=0), atol=2e-3)
    monkeypatch.setattr(corrections, "compare", None)  # nothing is measured again
    assert corrections.main(arguments) == 0
    assert capsys.readouterr().out == printed


@pytest.mark.slow
def test_the_same_again_and_all_methods_alike():
    one, two = (
        compare("real-arm", ["look-again", "identified"], goals=2, seed=7)["methods"],
        compare("real-arm", ["identified", "look-again"], goals=2, seed=7)["methods"],
    )
    for a, b in zip(one, reversed(two), strict=True):
        assert a["links"] == b["links"]
        assert a["tool"] == b["tool"]
    other = compare("real-arm", ["look-again"], goals=2, seed=8)["methods"]
    assert other[0]["tool"] != one[0]["tool"]


@pytest.mark.slow
def test_on_disk(tmp_path, capsys):
    arguments = ["--task", "real-arm", "--goals", "5", "--methods", "look-again,residual", "--looks", "0,10"]
    assert main(["compare", *arguments, "--again", "1", "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "The links alone" in said
    assert "10 looks" in said
    assert "50 looks" not in said
    found = json.loads((tmp_path / "results.json").read_text())
    assert found["settings"]["options"] == {"again": 1, "budgets": [0, 10]}
    assert (tmp_path / "looks.png").stat().st_size > 20_000


def test_another_calibration_in_the_same_file_does_not_go_on(tmp_path):
    file, started = tmp_path / "mine.yaml", []

    def stop_at_two(done, total):
        started.append(done)
        if done == 2:
            raise KeyboardInterrupt

    for name in ("ur5_a", "ur5_a", "ur5_b"):
        file.write_text(PUBLISHED_CALIBRATIONS[name].read_text())
        compare_two = {"goals": 3, "options": {"calibrations": [str(file)]}, "out": tmp_path / "out"}
        with pytest.raises(KeyboardInterrupt):
            compare("real-arm", ["look-again"], **compare_two, progress=stop_at_two)
    assert started == [0, 1, 2, 2, 0, 1, 2]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--looks", "-3"], "a budget of looks must be at least 0, got -3"),
        (["--looks", "many"], "--looks must be numbers"),
        (["--again", "-1"], "again must be at least 0"),
        (["--calibrations", "ur5e_a"], "it fits ur5e|cannot read"),
        (["--arm", "ur10"], "takes no other arm"),
    ],
)
def test_bad_input(arguments, said, tmp_path, capsys):
    assert main(["compare", "--task", "real-arm", *arguments, "--out", str(tmp_path)]) == EXIT_ERROR
    assert re.search(said, capsys.readouterr().err)


def test_a_figure_of_few():
    trials = [{"method": "look-again", "errors": "all", "error_0_0": 1e-3 * v} for v in (1, 2, 3)]
    results = {
        "methods": [{"name": "look-again", "colour": "#000000"}],
        "settings": {"goals": 3, "seed": 0, "command": ""},
    }
    figure = get_task("real-arm").figures["looks"](trials, results)
    (line,) = figure.axes[0].lines
    np.testing.assert_allclose(line.get_ydata(), [2.0])
