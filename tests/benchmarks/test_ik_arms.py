"""`python -m benchmarks.ik_arms`: a solver that misses postures loses, one that returns wrong ones is caught."""

import csv
import json

import numpy as np
import pytest

from benchmarks.ik_arms import self_motions
from benchmarks.ik_arms.arms import CASES, arm, singular_poses
from benchmarks.ik_arms.measure import recalls
from benchmarks.ik_arms.page import _goal
from benchmarks.ik_arms.self_motions import COLUMNS, COMPARED, faultless, read, summary
from benchmarks.ik_arms.solvers import Kinreach
from kinreach import cli

pytest.importorskip("ssik")
PROG = "python -m benchmarks.ik_arms"


class Broken(Kinreach):
    """Leaves out every other posture, bends another by a milliradian, and fails beside the singular poses."""

    name = "broken"

    def all(self, T):
        q = super().all(T)[::2]
        q[1:2] += 1e-3
        return q


class Endless(Kinreach):
    """Never returns."""

    name = "endless"

    def all(self, T):
        while True:
            pass


class Refusing(Kinreach):
    """Takes no arm."""

    name = "refusing"

    def __init__(self, kin):
        raise ValueError(f"no method for\n{kin.n} joints")


def call(*argv):
    try:
        return cli.run("benchmarks.ik_arms.cli", argv, prog=PROG)
    except SystemExit as leaving:
        return int(leaving.code or 0)


@pytest.fixture(scope="module")
def broken(tmp_path_factory):
    """What the command wrote for two arms and a solver that misses postures: its folder, and the rows of its table."""
    folder = tmp_path_factory.mktemp("broken")
    return folder, entered(folder, "Broken", "puma560_ik,ur5e_ik")


def entered(tmp_path, kind, arms="puma560_ik"):
    assert not call("--quick", "--poses", "4", "--arms", arms, "--solver", f"{__name__}:{kind}", "--out", str(tmp_path))
    with open(tmp_path / "ik_arms.csv", newline="", encoding="utf-8") as file:
        return {(row["arm"], row["solver"]): row for row in csv.DictReader(file)}


def test_a_broken_solver_loses(broken):
    folder, rows = broken
    assert {solver for _, solver in rows} >= {"kinreach", "ssik", "EAIK", "TRAC-IK", "broken"}
    for name in ("puma560_ik", "ur5e_ik"):
        ours, broken = rows[name, "kinreach"], rows[name, "broken"]
        assert (float(ours["recall"]), float(ours["generating"]), int(ours["wrong"])) == (100, 100, 0)
        assert all(int(ours[f"{case}: empty"]) == 0 < int(ours[f"{case}: poses"]) for case in CASES)
        assert float(broken["recall"]) < 50
        assert int(broken["wrong"]) >= 2
        assert float(broken["single"]) > 0
    assert rows["ur5e_ik", "kinreach"]["class"] == "three parallel axes"
    page = (folder / "ik_arms.md").read_text(encoding="utf-8")
    assert "| broken | 1 of 1 |" in page
    assert "ur-analytic-ik, 1 arm: UR models by their data sheets only" in page
    assert (folder / "ik_arms.png").stat().st_size > 10_000


def test_results_are_kept_and_refusals_told(tmp_path):
    entered(tmp_path, "Refusing")
    file = tmp_path / "puma560_ik.json"
    kept = json.loads(file.read_text(encoding="utf-8"))
    kept["rows"]["kinreach"]["preparation"] = 12345.0
    file.write_text(json.dumps(kept), encoding="utf-8")
    rows = entered(tmp_path, "Endless")
    assert float(rows["puma560_ik", "kinreach"]["preparation"]) == pytest.approx(12345, rel=1e-3)
    assert rows["puma560_ik", "endless"]["refused"] == "more than 6 s of processor time"
    assert json.loads(file.read_text(encoding="utf-8"))["rows"]["refusing"]["refused"] == "no method for 6 joints"


def test_the_study_of_self_motions_goes_on_and_counts_what_is_lost(tmp_path, monkeypatch):
    out, asked = tmp_path / "self_motions.csv", []

    def row(name, errors, posture, *, full):
        asked.append((name, errors, posture))
        lost = name == "Gen3" and posture == 1
        row = dict.fromkeys(COLUMNS, 0) | {"arm": name, "errors": int(errors), "posture": posture, "lost": int(lost)}
        return row if full else row | dict.fromkeys(COMPARED, "")

    monkeypatch.setattr(self_motions, "checked", row)
    for count in ("1", "2", "2"):
        monkeypatch.setattr("sys.argv", ["study", "--postures", count, "--full", "1", "--out", str(out)])
        assert self_motions.main() == 0
    assert len(asked) == len(set(asked)) == 32
    rows = read(out)
    assert sum(map(faultless, rows)) == 30
    told = {line[0]: (line[1], line[4]) for line in summary(rows)}
    assert len(told) == 16
    assert (told["Gen3"], told["Gen3, with errors"]) == (("1 of 2", "0 of 1"), ("1 of 2", "0 of 1"))
    assert told["Panda"] == ("2 of 2", "0 of 1")


def test_goals_are_met_or_missed(broken):
    """The page names each goal of the table, and how many arms miss it."""
    assert _goal("recall", [100.0, 99.0], 100.0, "%", least=True) == (
        "* recall, at least 100 %: **missed** by 1 of 2 (median 99.5, worst 99)."
    )
    assert _goal("one pose", [59.0, 10.0], 60.0, "us") == "* one pose, at most 60 us: met (median 34.5, worst 59)."
    assert _goal("one pose", [], 60.0, "us") == "* one pose: not measured."
    goals = (broken[0] / "ik_arms.md").read_text(encoding="utf-8").split("## Goals")[1].split("##")[0]
    assert "* recall, at least 100 %: met (median 100, worst 100)." in goals
    assert "* singular poses without an answer, at most 0: met" in goals
    assert "* seven axes, one pose: not measured." in goals
    assert goals.count("\n* ") == 10


@pytest.mark.parametrize("argv", [("--arms", "puma"), ("--solver", "no_module:A"), ("--solver", "csv:QUOTE_ALL")])
def test_bad_input_is_one_line(argv, tmp_path, capsys):
    assert call(*argv, "--out", str(tmp_path)) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_recall_counts_postures_that_only_others_find():
    rows = {"a": {"found": [[[0.0, 1.0]]]}, "b": {"found": [[[2 * np.pi, 1.0], [0.5, 0.5]]]}, "c": {"refused": "x"}}
    shares, union = recalls(rows, np.array([[0.0, 1.0]]))
    assert (shares, union) == ({"a": [50, 100, 100], "b": [100, 100, 100]}, 2)


@pytest.mark.parametrize("name", ["puma560_ik", "z1_ik", "gen3_lite_ik"])
def test_singular_poses_are_singular(name):
    kin, counted = arm(name), 0
    ours = Kinreach(kin)
    for case, poses in singular_poses(kin, 4).items():
        if not case.startswith("beside"):
            for T in poses:
                q = ours.all(T)
                counted += min(np.linalg.svd(kin.jacobian(each))[1][-1] for each in q) < 1e-4
    assert counted >= 10
