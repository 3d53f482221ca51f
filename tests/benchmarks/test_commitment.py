"""The study of commitment: its axis, its table, and cells that are kept."""

from contextlib import closing
from importlib import resources

import numpy as np
import pytest

pytest.importorskip("torch")
from benchmarks.logs import policies_in
from benchmarks.studies import commitment
from benchmarks.studies.moving_ball import make_world
from benchmarks.studies.trainings import POLICY
from kinreach.errors import InputError

PRETRAINED = resources.files("kinreach.baselines") / "pretrained"


def test_the_axis_grows_with_delay_and_speed_and_with_a_weaker_arm():
    values = [commitment.lateness(delay, 0.8) for delay in (0.0, 0.05, 0.1, 0.2)]
    assert values[0] == 0.0
    assert (np.diff(values) > 0.1).all()
    # rest to rest, 0.16 m / 0.475 m, without reaching the joint's speed; the ball takes 0.35 m / 0.8 m/s
    assert values[-1] == pytest.approx(2.0 * np.sqrt(0.16 / 0.475 / 10.0) / (0.35 / 0.8), rel=1e-6)
    assert commitment.lateness(0.2, 1.2) > values[-1]
    assert commitment.lateness(0.2, 0.8, 0.7) > values[-1]


def test_the_table_is_resumed_and_drawn(tmp_path, capsys, monkeypatch):
    runs = tmp_path / "runs" / "seed-0"
    runs.mkdir(parents=True)
    (runs / POLICY).write_bytes((PRETRAINED / "gradient-moving.safetensors").read_bytes())
    figure, out = tmp_path / "figure.png", ["--out", str(tmp_path / "cells")]
    learned = ["network", "network-then-interception"]
    arguments = ["--methods", "last-sight", *learned, "--delays", "0.05", "0.2", "--speeds", "0.4", "--strengths", "1",
                 "--rule", "ignored", "--balls", "3", "--trainings", str(runs.parent), *out]  # fmt: skip
    assert commitment.main(arguments) == 0
    table = capsys.readouterr().out
    rows = [[cell.strip() for cell in row.strip("|").split("|")] for row in table.partition("\n\n")[0].splitlines()]
    assert rows[0][5:] == [f"`{name}`" for name in ("last-sight", *learned)]
    assert [row[:5] for row in rows[2:]] == [
        ["0.15", "50", "0.4", "1", "ignored"],
        ["0.30", "200", "0.4", "1", "ignored"],
    ]
    with monkeypatch.context() as patch:
        patch.setattr(commitment, "rollout", None)  # nothing is played again
        assert commitment.main([*arguments, "--figure", str(figure)]) == 0
    assert capsys.readouterr().out == table
    assert figure.stat().st_size > 10_000
    (runs / POLICY).write_bytes((PRETRAINED / "gradient-moving-clear.safetensors").read_bytes())
    played, rollout = [], commitment.rollout
    monkeypatch.setattr(commitment, "rollout", lambda *given: played.append(given) or rollout(*given))
    assert commitment.main(arguments) == 0
    assert len(played) == 2 * len(learned)  # in each world those of another policy under the old name


def test_the_map_has_both_rules_and_differences_of_the_same_balls(tmp_path, capsys, monkeypatch, texts):
    """The network is by default that of the world's delay, other trainings are named after their folder."""
    for seed in range(2):
        for folder in ("one", "two", "other"):
            (tmp_path / folder).mkdir(exist_ok=True)
            (tmp_path / folder / f"seed-{seed}.safetensors").touch()
    monkeypatch.setattr(commitment, "NETWORKS", {0.05: tmp_path / "one", 0.2: tmp_path / "two"})
    asked, drawn = [], []

    def touched(method, file, options, **others):
        asked.append((method, options["delay"], options["collisions"], file and file.parent.name))
        return [True, method != "interception", True, False]

    monkeypatch.setattr(commitment, "touched", touched)
    monkeypatch.setattr(commitment, "_saved", lambda figure, file: drawn.append(figure))
    given = ["--speeds", "0.8", "--strengths", "1", "--learners", str(tmp_path / "other"), "--out", str(tmp_path)]
    assert commitment.main([*given, "--figure", str(tmp_path / "map.png")]) == 0
    *tables, note = capsys.readouterr().out.split("\n\n")
    (head, _, *rows), (_, _, *differences), (_, _, *kinds) = (
        [[cell.strip() for cell in row.strip("|").split("|")] for row in table.splitlines()] for table in tables
    )
    assert "seed 5252" in note
    assert note.endswith("by kind of path: straight, circle, random.\n")
    # of the balls of `touched` the first and the last are straight
    assert [row[5:] for row in kinds] == 4 * [["50 / 0 / 100", *4 * ["50 / 100 / 100"]]]
    names = ["interception", "scenarios", "network", "network-then-interception", "other"]
    assert head[4:] == ["collisions", *(f"`{name}`" for name in names)]
    assert [row[1:5:3] for row in rows] == [["50", "count"], ["50", "ignored"], ["200", "count"], ["200", "ignored"]]
    for row in rows:
        assert [cell.split()[0] for cell in row[5:]] == ["50.0", "75.0", "75.0", "75.0", "75.0"]
    assert [row[5] for row in differences] == 4 * [f"`{name}`" for name in names[2:]]
    for row in differences:
        assert [cell.split()[0] for cell in row[6:]] == ["+25.0", "+0.0"]
    folders = {(name, delay): folder for name, delay, _, folder in asked}
    assert [folders["network", delay] for delay in (0.05, 0.2)] == ["one", "two"]
    assert [folders["network-then-interception", delay] for delay in (0.05, 0.2)] == ["one", "two"]
    assert {folders["other", delay] for delay in (0.05, 0.2)} == {"other"}
    assert len(asked) == 4 * (2 + 3 * 2)
    assert {"collisions ignored", "collisions count", *names} <= {*texts(drawn[0])}
    assert not any("hollow" in text for text in texts(drawn[0]))
    assert commitment.main([*given, "--strengths", "1", "0.7", "--figure", str(tmp_path / "map.png")]) == 0
    note = "squares: 50 ms late · circles: 200 ms late · hollow: an arm of 70 %"
    assert any(text.endswith(note) for text in texts(drawn[1]))
    for panel in drawn[1].axes:
        for marker, style in (("s", "--"), ("o", "-")):  # of a delay, a line and hollow points for each method
            points = [line for line in panel.lines if line.get_marker() == marker and len(line.get_xdata())]
            assert [line.get_linestyle() for line in points] == len(names) * [style, "None"]
            for line, hollow in zip(points[::2], points[1::2], strict=True):
                assert line.get_color() == hollow.get_color()
                assert (line.get_xdata() < hollow.get_xdata()).all()  # a weaker arm is later
            assert len({line.get_color() for line in points}) == len(names)


def test_a_difference_has_the_interval_of_trainings_and_balls():
    rng = np.random.default_rng(0)
    network, planner = rng.random((5, 400)) < 0.7, rng.random((1, 400)) < 0.5
    middle, low, high = (float(part) for part in commitment.difference(network, planner).replace("[", "").replace(
        ",", "").replace("]", "").split())  # fmt: skip
    assert middle == pytest.approx(100.0 * (network.mean() - planner.mean()), abs=0.05)
    one = 100.0 * np.sqrt((0.7 * 0.3 / 5 + 0.25) / 400)  # of balls; trainings add to it
    assert 1.96 * one < high - middle < 6.0 * one
    assert 1.96 * one < middle - low < 6.0 * one
    assert commitment.difference(planner, planner) == "+0.0 [+0.0, +0.0]"


def test_policies_of_trainings_and_of_logs_are_found(tmp_path):
    for name in (
        "runs/seed-0/policy.safetensors",
        "runs/seed-1/curve.csv",
        "logs/seed-1.safetensors",
        "logs/seed-0.csv",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    assert policies_in(tmp_path / "runs") == [tmp_path / "runs/seed-0/policy.safetensors"]
    assert policies_in(tmp_path / "logs") == [tmp_path / "logs/seed-1.safetensors"]
    assert policies_in(tmp_path / "none") == []


def test_frames_are_timed(tmp_path, capsys, monkeypatch):
    """By a clock that only deciding moves."""
    clock = [0.0]
    runs = tmp_path / "seed-0"
    runs.mkdir()
    (runs / POLICY).write_bytes((PRETRAINED / "gradient-moving.safetensors").read_bytes())
    act = commitment.LearnedPolicy.act

    def slow(self, observation):
        clock[0] += 0.25
        return act(self, observation)

    monkeypatch.setattr(commitment.LearnedPolicy, "act", slow)
    monkeypatch.setattr("time.process_time", lambda: clock[0])
    monkeypatch.setattr(commitment, "TIMED", 2)
    arguments = ["--times", "--methods", "network", "last-sight", "--trainings", str(tmp_path), "--speeds", "0.8"]
    assert commitment.main([*arguments, "--out", str(tmp_path / "cells")]) == 0
    assert capsys.readouterr().out.splitlines()[2:] == ["| `network` | 2.5e+02 |", "| `last-sight` | 0 |"]


def test_shares_are_drawn_against_times(tmp_path, capsys, monkeypatch, texts):
    """A panel for each world, a line for the planners of one kind, at the times that were measured."""
    drawn = []
    monkeypatch.setattr(commitment, "touched", lambda method, *others, **more: [method == "interception", True])
    monkeypatch.setattr(
        commitment, "frame_time", lambda method, *others, **more: 0.02 if method.endswith("n") else 0.004
    )
    monkeypatch.setattr(commitment, "_saved", lambda figure, file: drawn.append(figure))
    arguments = ["--times", "--methods", "interception", "interception@3", "ppo", "--delays", "0.2", "--strengths", "1",
                 "--rule", "ignored", "--out", str(tmp_path / "cells")]  # fmt: skip
    assert commitment.main([*arguments, "--speeds", "0.4", "0.8", "--figure", str(tmp_path / "f.png")]) == 0
    (figure,) = drawn
    assert {"0.4 m/s, 200 ms late", "0.8 m/s, 200 ms late", "interception", "ppo"} <= {*texts(figure)}
    assert any(text.endswith("a decision in 1, 3 frames") for text in texts(figure))
    for panel in figure.axes:
        lines = [
            line.get_xydata().tolist() for line in panel.lines if len(line.get_xdata()) and line.get_marker() == "o"
        ]
        assert lines == [[[20.0, 100.0], [4.0, 50.0]], [[4.0, 50.0]]]


def test_panels_of_arms_of_two_strengths_or_rules_have_titles_of_their_own(tmp_path, monkeypatch, texts):
    drawn = []
    monkeypatch.setattr(commitment, "touched", lambda *others, **more: [False, True])
    monkeypatch.setattr(commitment, "frame_time", lambda *others, **more: 0.02)
    monkeypatch.setattr(commitment, "_saved", lambda figure, file: drawn.append(figure))
    given = ["--times", "--methods", "interception", "--delays", "0.2", "--speeds", "0.4", "--figure",
             str(tmp_path / "f.png"), "--out", str(tmp_path / "cells")]  # fmt: skip
    assert commitment.main([*given, "--rule", "count", "--strengths", "1", "0.7"]) == 0
    assert {f"0.4 m/s, 200 ms late, strength {strength}" for strength in ("1", "0.7")} <= {*texts(drawn[0])}
    assert commitment.main([*given, "--strengths", "1"]) == 0
    assert {f"0.4 m/s, 200 ms late, collisions {rule}" for rule in ("count", "ignored")} <= {*texts(drawn[1])}


@pytest.mark.parametrize("method", ["second-sight", "network-than-scenarios"])
def test_an_unknown_method_is_answered_with_those_there_are(tmp_path, method):
    with pytest.raises(InputError, match=f"unknown method '{method}'; available: .*interception, .*network"):
        commitment.main(["--methods", "last-sight", method, "--out", str(tmp_path / "cells")])
    assert not list((tmp_path / "cells").glob("*"))


@pytest.mark.parametrize("method", ["ppo@2", "interception@", "scenarios@3x", "network-then-scenarios@", "scenarios@0"])
def test_frames_of_a_planner_are_checked_before_anything_is_played(tmp_path, monkeypatch, method):
    monkeypatch.setattr(commitment, "rollout", None)
    with pytest.raises(InputError, match=r"NAME@FRAMES with one of interception, scenarios|frames of .* at least 1"):
        commitment.main(["--methods", "last-sight", method, "--out", str(tmp_path / "cells")])


@pytest.mark.parametrize("method", ["network", "network-then-interception", "network-then-scenarios"])
def test_a_network_needs_trainings_that_ended(tmp_path, method):
    given = ["--methods", method, "--out", str(tmp_path / "cells")]
    needed = r"needs --trainings with finished trainings, seed-0/policy\.safetensors and others: "
    with pytest.raises(InputError, match=f"`{method}` {needed}{tmp_path} has none"):
        commitment.main([*given, "--trainings", str(tmp_path)])
    with pytest.raises(InputError, match=f"`{method}` {needed}the logs have none for sights 0.1 s late"):
        commitment.main([*given, "--delays", "0.1"])


def test_a_planner_decides_in_every_so_many_frames():
    with closing(make_world({"collisions": False})) as env:
        assert commitment._planner("scenarios@4", env)._every == 4
        assert commitment._planner("interception", env)._every == 1


@pytest.mark.parametrize("given", [["--learners", "a/x", "b/x"], ["--methods", "ppo", "--learners", "a/ppo"]])
def test_two_methods_of_one_name_are_refused(given, tmp_path):
    """The second would be played in the first one's place."""
    with pytest.raises(InputError, match=r"two methods are named (x|ppo); folders of --learners"):
        commitment.main([*given, "--out", str(tmp_path)])
