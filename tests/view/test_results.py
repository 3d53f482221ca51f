"""Files of comparisons as the page opens them."""

import json
import shutil

import numpy as np
import pytest

from kinreach.errors import InputError
from kinreach.plots.inside import method_colours
from kinreach.view import _html as html
from kinreach.view import read_results
from kinreach.view._snippet import results_program


@pytest.fixture
def copied(comparison, tmp_path):
    """A copy to spoil."""
    return shutil.copytree(comparison, tmp_path / "copy")


def test_ends_are_those_that_the_comparison_counted(comparison):
    results = read_results(comparison / "results.json")
    summary = json.loads((comparison / "results.json").read_text())
    assert results.arm == "ur5-thesis"
    assert results.goals.shape == (4, 3)
    assert list(results.colours) == [method["name"] for method in summary["methods"]]
    for method in summary["methods"]:
        ends = [ends[method["name"]] for ends in results.ends]
        assert np.mean([end.reached for end in ends]) == method["reached"]
        assert 1000 * np.median([end.distance for end in ends]) == pytest.approx(
            method["distance_mm"]["median"], rel=1e-3
        )
        for end, goal in zip(ends, results.goals, strict=True):
            assert np.linalg.norm(end.tip - goal) == pytest.approx(end.distance, abs=1e-9)
            assert end.q.shape == (6,)
    colours = method_colours(results.colours)
    assert {name: "#{:02X}{:02X}{:02X}".format(*rgb) for name, rgb in results.colours.items()} == colours
    assert read_results(comparison).file == results.file
    for name in results.colours:
        assert results.distances(name).tolist() == [ends[name].distance for ends in results.ends]
    assert np.isnan(results.distances("nobody")).all()


@pytest.mark.parametrize(
    ("settings", "arm"),
    [
        ({"arm": "ur10-thesis"}, "ur10-thesis"),
        ({"arm": ""}, ""),
        ({"arm": "mine"}, ""),
        ({"arm": None}, ""),
        ({}, ""),
    ],
)
def test_the_arm_is_the_one_that_is_named(copied, settings, arm):
    path = copied / "results.json"
    content = json.loads(path.read_text())
    assert content["settings"].pop("arm") == "ur5-thesis"
    content["settings"] |= settings
    path.write_text(json.dumps(content))
    assert read_results(copied).arm == arm


def test_postures_end_where_the_tips_are(comparison):
    from kinreach.kinematics import URKinematics

    kinematics, compared = URKinematics("ur5-thesis", tip="tcp", base="world"), 0
    for ends in read_results(comparison).ends:
        for end in ends.values():
            assert np.linalg.norm(kinematics.fk(end.q)[:3, 3] - end.tip) < 1e-5
            compared += 1
    assert compared == 12


def no_methods(folder):
    (folder / "results.json").write_text('{"methods": [], "settings": {}}')


def no_json(folder):
    (folder / "results.json").write_text("closed-form reached everything")


def deep(folder):
    (folder / "results.json").write_text("[" * 100_000)


def other_json(folder):
    (folder / "results.json").write_text('{"policies": {"ranked-single": 1}}')


def not_a_number(folder):
    text = (folder / "results.json").read_text()
    (folder / "results.json").write_text(text.replace('"goals": 4', '"goals": NaN', 1))


def no_trials(folder):
    (folder / "results.csv").unlink()


def one_line(folder):
    (folder / "results.csv").write_text((folder / "results.csv").read_text().splitlines()[0])


def other_table(folder):
    (folder / "results.csv").write_text("a,b\n1,2\n")


def nothing(folder):
    (folder / "results.csv").write_text("")


def binary(folder):
    (folder / "results.csv").write_bytes(bytes(range(256)))


def bad_vector(folder):
    lines = (folder / "results.csv").read_text().splitlines()
    column = lines[0].split(",").index("goal")
    row = lines[1].split(",")
    row[column] = "0.5 inf 0.2"
    (folder / "results.csv").write_text("\n".join([lines[0], ",".join(row)]))


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (no_methods, "was not written by a comparison: it must have 1 to 64 methods, got 0"),
        (no_json, "is not JSON"),
        (deep, "is not JSON"),
        (other_json, "it has no list 'methods'"),
        (not_a_number, "NaN is not a JSON number"),
        (no_trials, "cannot read"),
        (one_line, "it has no trials"),
        (other_table, "it has no column 'goal_index'"),
        (nothing, "it has no column 'goal_index'"),
        (binary, "is not UTF-8 text"),
        (bad_vector, "goal must be 3 numbers within"),
    ],
)
def test_what_no_comparison_wrote_is_refused_in_a_sentence(copied, spoil, said):
    spoil(copied)
    with pytest.raises(InputError) as refused:
        read_results(copied)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)
    assert str(copied) in str(refused.value)


def test_names_are_escaped_and_printable(copied):
    path = copied / "results.json"
    content = json.loads(path.read_text())
    hostile = "<script>alert(1)</script>"
    content["methods"][0]["name"] = hostile
    path.write_text(json.dumps(content))
    trials = copied / "results.csv"
    trials.write_text(trials.read_text().replace("closed-form", hostile))
    results = read_results(copied)
    assert hostile in results.colours
    assert "<script>" not in html.ends(results, 0, hostile)


def test_a_copied_program_says_the_same(comparison, capsys):
    results = read_results(comparison)
    exec(compile(results_program(results, 2), "copied", "exec"), {})
    said = capsys.readouterr().out.splitlines()
    assert said[0] == str(results.goals[2])
    for method, end in results.ends[2].items():
        assert any(line.startswith(f"{method} {end.reached} {end.distance}") for line in said)
