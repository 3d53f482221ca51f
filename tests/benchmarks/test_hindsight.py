"""The training with hindsight goes on where it was."""

import csv

import pytest

pytest.importorskip("stable_baselines3")


@pytest.mark.slow
def test_a_curve_goes_on(tmp_path, monkeypatch, capsys):
    from benchmarks.studies import hindsight

    monkeypatch.setattr(hindsight, "TEST_GOALS", 4)
    found = []
    for steps in (400, 800, 800):
        figure = tmp_path / "curves.png"
        options = ["--seeds", "1", "--steps", str(steps), "--every", "400", "--figure", str(figure)]
        assert hindsight.main(["--out", str(tmp_path), "--only", "position", "joints", "push", *options]) == 0
        with (tmp_path / "position" / "seed-0" / "curve.csv").open(newline="", encoding="utf-8") as file:
            found.append(list(csv.reader(file)))
    assert [len(rows) for rows in found] == [2, 3, 3]
    assert found[1][:2] == found[0]
    assert found[2] == found[1]
    assert [row[0] for row in found[1]] == ["steps", "400", "800"]
    said = capsys.readouterr().out
    assert said.count("Reach-v0, position, seed 0:") == said.count("Push-v0, position, seed 0:") == 2
    assert said.count("| Reach-v0, joints | 1 cm, 0.15 rad |") == 3
    assert said.count("| Push-v0, position | 5 cm |") == 3
    assert figure.stat().st_size > 10_000
