"""Past obstacles: a path gets through where postures alone are blocked; and motions keep the arm's limits."""

import pytest

from kinreach.cli import EXIT_ERROR, main
from kinreach.compare import compare, get_task

METHODS = ["closed-form", "from-above", "free-way", "path", "ranked-multi"]


@pytest.fixture(scope="module")
def results():
    found = compare("obstacles", METHODS, goals=8, options={"clutter": (0, 16)}, motion=True)
    return {entry["name"]: entry for entry in found["methods"]}


@pytest.mark.slow
def test_without_obstacles_all_arrive(results):
    for name in METHODS:
        assert results[name]["reached_among"]["0"] == 1.0, name
        assert results[name]["reached_among"]["4"] is None


def test_paths_get_through_where_postures_are_blocked(results):
    among = {name: results[name]["reached_among"]["16"] for name in METHODS}
    assert among["path"] >= 3 / 4
    assert among["closed-form"] <= among["free-way"] <= among["path"]
    for name in ("closed-form", "ranked-multi"):
        assert among[name] < 0.7, name
    assert results["path"]["impossible"] <= 1 / 8


def test_ways_are_measured(results):
    assert results["closed-form"]["moves"]["median"] == 1.0
    assert results["from-above"]["moves"]["median"] == 2.0
    assert results["ranked-multi"]["moves"]["median"] >= 8
    for name in METHODS:
        assert results[name]["length"]["median"] > 0.5
        assert 0.5 < results[name]["move_s"]["median"] < 10.0


def test_motions_keep_the_limits(results):
    """As everywhere: rest to rest through the same postures."""
    for name in METHODS:
        entry = results[name]
        for part in ("speed", "acceleration", "jerk"):
            assert 5.0 < entry[f"motion_{part}"]["p95"] <= 100.1, (name, part)
        assert entry["motion_s"]["median"] > 0.8 * entry["move_s"]["median"]
    assert results["ranked-multi"]["motion_s"]["median"] > 2.0 * results["closed-form"]["motion_s"]["median"]


def test_a_task_without_postures_has_no_motion(tmp_path, capsys):
    arguments = ["--task", "moving", "--motion", "--goals", "1"]
    assert main(["compare", *arguments, "--out", str(tmp_path)]) == EXIT_ERROR
    said = "'moving' does not move its arm from posture to posture; leave out --motion"
    assert said in capsys.readouterr().err


@pytest.mark.slow
def test_on_disk(tmp_path, capsys):
    arguments = ["--task", "obstacles", "--goals", "2", "--clutter", "4", "--methods", "closed-form", "--motion"]
    assert main(["compare", *arguments, "--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "Motions within the arm's limits" in out
    assert "--seed 0 --motion --clutter 4 --out" in out
    for figure in get_task("obstacles").figures:
        assert (tmp_path / f"{figure}.png").stat().st_size > 10_000


def test_bad_input(tmp_path, capsys):
    assert main(["compare", "--task", "obstacles", "--clutter", "40", "--out", str(tmp_path)]) == EXIT_ERROR
    assert "clutter must be at most 20" in capsys.readouterr().err
