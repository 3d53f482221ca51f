"""Trials: every method on every goal, the same goals for all, resumable, and written whole or not at all."""

import csv
import json
from contextlib import contextmanager
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from kinreach._files import locked
from kinreach._jobs import Serial
from kinreach._statistics import Column, success_columns, summarise
from kinreach.compare import _runner as runner
from kinreach.compare import compare
from kinreach.compare._runner import MAX_SEED, RECORDS, WARM_UP_SEED, prepare, run_trials
from kinreach.compare._task import arm_version
from kinreach.errors import InputError, OutputError, UnknownNameError
from kinreach.robots import get_arm

#: Not the same in two runs: clocks.
CLOCKS = {"solve_s", "accept_s"}


def plain(trials):
    return [{name: value for name, value in trial.items() if name not in CLOCKS} for trial in trials]


def prepared(task, methods=(), goals=6, seed=0):
    return prepare(
        task, methods, goals=goals, seed=seed, arm=None, observation=None, options=None, command="again"
    )  # fmt: skip


def test_a_disk_that_is_full_leaves_whole_lines(toy, tmp_path, monkeypatch):
    records = runner.Records(tmp_path / RECORDS, {"goals": 1}, prepared(toy, ["right"]), fresh=True)
    records.add({"goal": 0})
    before, opened = records.path.read_bytes(), type(tmp_path).open

    def half(path, *arguments, **options):
        file = opened(path, *arguments, **options)
        write = file.write

        def fill(text):
            write(text[:5])
            file.flush()
            raise OSError(28, "No space left on device")

        file.write = fill
        return file

    with monkeypatch.context() as patch:
        patch.setattr(type(tmp_path), "open", half)
        with pytest.raises(OutputError, match=f"cannot write .*{RECORDS}: No space left on device"):
            records.add({"goal": 1})
    assert records.path.read_bytes() == before
    assert records.trials == [{"goal": 0}]
    records.add({"goal": 2})
    assert [json.loads(line) for line in records.path.read_text().splitlines()] == [{"goals": 1}, *records.trials]


def numbers(results):
    """Results without their times."""
    kept = json.loads(json.dumps(results))
    for entry in kept["methods"]:
        for name in ("solve_ms", "solve_ms_ci", "accept_ms", "accept_ms_ci"):
            entry.pop(name, None)
    return kept


def rows_of(path):
    return list(csv.DictReader(path.read_text().splitlines()))


class Interrupted(Exception):
    pass


def interrupt_after(count):
    def progress(done, total):
        if done == count:
            raise Interrupted

    return progress


def test_every_method_meets_every_goal_once(toy):
    trials = list(run_trials(prepared(toy, goals=7)))
    assert sorted((trial["goal_index"], trial["method"]) for trial in trials) == [
        (goal, method) for goal in range(7) for method in ("near", "right", "wild")
    ]
    for goal in range(7):
        goals = {tuple(trial["goal"]) for trial in trials if trial["goal_index"] == goal}
        assert len(goals) == 1  # the same for all


def test_a_goal_is_done_before_the_next_and_methods_take_turns(toy):
    order = [(trial["goal_index"], trial["method"]) for trial in run_trials(prepared(toy, goals=20))]
    assert [goal for goal, _ in order] == sorted(goal for goal, _ in order)
    assert {method for _, method in order[::3]} == {"right", "near", "wild"}  # who goes first changes


def test_the_first_goals_do_not_depend_on_how_many_there_are(toy):
    few, many = (list(run_trials(prepared(toy, ["right"], goals=n, seed=4))) for n in (3, 9))
    assert plain(few) == plain(many[:3])


def test_the_warm_up_is_never_compared():
    assert WARM_UP_SEED > MAX_SEED


def test_what_is_measured(toy):
    results = compare(toy, goals=20, seed=1)
    right, near, wild = results["methods"]
    assert (right["reached"], near["reached"], wild["reached"]) == (1.0, 1.0, 0.0)
    assert right["distance_mm"]["median"] == 0.0
    assert near["distance_mm"]["median"] == pytest.approx(5.0)
    assert (near["success_at_mm"]["10"], near["success_at_mm"]["2"]) == (1.0, 0.0)
    assert wild["impossible"] == 1.0
    assert set(wild["success_at_mm"].values()) == {0.0}  # what was impossible succeeded nowhere, however near it was
    assert wild["outcomes"] == {"beyond": 20}
    assert wild["move_s"] == {"median": None, "p95": None}
    assert all(entry["goals"] == 20 for entry in results["methods"])


def test_success_counts_what_ended_within_the_tolerance():
    ends = [0.4, 0.6, 0.9, 1.1, 1.9, 2.1, 4.9, 5.1, 9.9, 10.1, 19.9, 20.1, 49.9, 50.1]
    trials = [{"distance": 1e-3 * end, "here": here} for end in ends for here in (True, False)]
    found = summarise(success_columns(lambda trial: trial["here"]), trials)["success_at_mm"]
    within = {"50": 13, "20": 11, "10": 9, "5": 7, "2": 5, "1": 3, "0.5": 1}
    assert found == {tolerance: count / len(trials) for tolerance, count in within.items()}


def test_an_interrupted_comparison_goes_on_and_ends_as_if_it_had_not_been(toy, tmp_path):
    whole = compare(toy, goals=5, out=tmp_path / "whole")
    with pytest.raises(Interrupted):
        compare(toy, goals=5, out=tmp_path / "torn", progress=interrupt_after(7))
    kept = (tmp_path / "torn" / RECORDS).read_text().splitlines()
    assert len(kept) == 1 + 7
    started = []
    resumed = compare(toy, goals=5, out=tmp_path / "torn", progress=lambda done, total: started.append((done, total)))
    assert started[0] == (7, 15)
    assert numbers(resumed) == numbers(whole)
    assert not (tmp_path / "torn" / RECORDS).exists()
    rows = [rows_of(tmp_path / name / "results.csv") for name in ("whole", "torn")]
    assert plain(rows[0]) == plain(rows[1])
    assert len(rows[0]) == 15


@pytest.mark.parametrize("spoil", [
    lambda text: text[:-20],  # the last line was cut short
    lambda text: text.replace('"near"', '"nobody"', 1),
    lambda text: text + "garbage\n",
    lambda text: "{}\n" + text,
    lambda text: "",
    lambda text: text + text.splitlines()[-1] + "\n",  # a trial twice
], ids=["cut", "unknown method", "garbage", "another identity", "empty", "twice"])  # fmt: skip
def test_damaged_records_are_measured_again(toy, tmp_path, spoil):
    whole = compare(toy, goals=4, out=tmp_path / "whole")
    with pytest.raises(Interrupted):
        compare(toy, goals=4, out=tmp_path / "torn", progress=interrupt_after(6))
    records = tmp_path / "torn" / RECORDS
    records.write_text(spoil(records.read_text()))
    assert numbers(compare(toy, goals=4, out=tmp_path / "torn")) == numbers(whole)


def test_other_settings_do_not_go_on(toy, tmp_path):
    with pytest.raises(Interrupted):
        compare(toy, goals=4, out=tmp_path, progress=interrupt_after(6))
    started = []
    compare(toy, goals=4, seed=1, out=tmp_path, progress=lambda done, total: started.append(done))
    assert started[0] == 0


def test_another_arm_of_the_same_name_does_not_go_on(tmp_path):
    arm, started = get_arm("ur5-thesis"), []
    with pytest.raises(Interrupted):
        compare("ur5", ["closed-form"], arm=arm, goals=3, out=tmp_path, progress=interrupt_after(2))
    narrow = arm.with_limits({"wrist_3_joint": (-3.0, 3.0)})
    assert narrow.name == arm.name
    for which in (arm, narrow):
        with pytest.raises(Interrupted):
            compare(
                "ur5", ["closed-form"], arm=which, goals=3, out=tmp_path,
                progress=lambda done, total: (started.append(done), interrupt_after(done)(done, total)),
            )  # fmt: skip
    assert started == [2, 0]


def test_policies_are_for_the_arm_that_they_were_trained_on(monkeypatch):
    monkeypatch.setattr(runner.Environments, "policy", lambda environments, method: None)
    own = get_arm("ur5-thesis")
    others = (replace(own, name="mine"), "ur5", "ur3-thesis")
    for arm, all_of_them in (("ur5-thesis", True), (own, True), *((other, False) for other in others)):
        task = prepare(
            "ur5", (), goals=1, seed=0, arm=arm, observation=None, options={"backend": "kinematic"}, command=""
        ).task  # fmt: skip
        assert ("ranked-single" in task.methods) == all_of_them
        assert {"closed-form", "lm"} <= set(task.methods)


def test_times_of_a_cluster_are_not_said_to_be_of_this_machine(toy, tmp_path, monkeypatch):
    @contextmanager
    def engine(name, address):
        yield Serial()

    monkeypatch.setattr(runner, "open_engine", engine)
    for options in ({}, {"out": tmp_path}):
        results = compare(toy, ["right"], goals=1, engine="ray", address="auto", **options)
        assert results["settings"]["machine"] == {"engine": "ray"}


def test_an_arm_has_another_version_whatever_of_it_changes():
    arm = get_arm("ur5-thesis")
    changes = {
        "home": (*arm.home[:5], 0.1), "meshes": "triangles", "title": "another", "gripper": None,
        "joints": arm.joints[::-1],
    }  # fmt: skip
    cell = replace(arm.workcell, obstacles=arm.workcell.obstacles[:1])
    goals = replace(arm.workcell, goals=arm.workcell.goals.wider(0.01))
    others = [replace(arm, **{name: value}) for name, value in changes.items() if getattr(arm, name) != value]
    others += [replace(arm, workcell=each) for each in (cell, goals)]
    assert len(others) >= 6
    versions = [arm_version(each)["arm ur5-thesis"] for each in (arm, *others)]
    assert len(set(versions)) == len(versions)

    class Mine:
        def sample(self, rng, count):
            return np.zeros((count, 3))

    mine = [replace(arm, workcell=replace(arm.workcell, goals=Mine())) for _ in range(2)]
    assert arm_version(mine[0]) == arm_version(mine[1]) != arm_version(arm)  # it has no text of its own


def test_two_comparisons_do_not_write_into_one_folder(toy, tmp_path):
    with locked(tmp_path, "a comparison"), pytest.raises(OutputError, match="a comparison is writing into"):
        compare(toy, goals=2, out=tmp_path)
    assert not any(tmp_path.iterdir())
    compare(toy, goals=2, out=tmp_path)


def test_a_task_may_report_what_it_likes(toy, tmp_path):
    for columns in ((Column("steps", "steps", "mean"),), (Column("reached", "reached", "rate"),)):
        compare(replace(toy, columns=columns), ["near", "right"], goals=2, out=tmp_path, fresh=True)
        assert (tmp_path / "report.html").exists()


def test_finished_results_of_another_comparison_are_not_overwritten(toy, tmp_path):
    compare(toy, goals=3, out=tmp_path)
    before = (tmp_path / "results.json").read_text()
    with pytest.raises(InputError, match=r"another comparison \(goals 3, not 4; seed 0, not 2\).*fresh"):
        compare(toy, goals=4, seed=2, out=tmp_path)
    assert (tmp_path / "results.json").read_text() == before
    assert compare(toy, goals=3, out=tmp_path)["settings"]["goals"] == 3  # the same again is welcome
    for unknown, said in (("mine", "not written by"), ('{"settings": {"goals": 3}, "versions": {}}', "seed")):
        (tmp_path / "results.json").write_text(unknown)
        with pytest.raises(InputError, match=said):
            compare(toy, goals=3, out=tmp_path)
        assert (tmp_path / "results.json").read_text() == unknown
    assert compare(toy, goals=4, seed=2, out=tmp_path, fresh=True)["settings"]["goals"] == 4


def test_results_name_the_arm(toy):
    """As the environment has it; the toy has none."""
    cases = (
        (toy, "right", {}, ""),
        ("ur5", "closed-form", {}, "ur5-thesis"),
        ("ur5", "closed-form", {"arm": "ur10"}, "ur10"),
        ("arm3", "closed-form", {}, "arm3"),
        ("button", "random", {"max_episode_steps": 2}, "arm3"),
        ("moving", "first-sight", {}, "ur5-thesis"),
        ("real-arm", "data-sheet", {"budgets": (0,)}, "ur5-thesis"),
        ("obstacles", "closed-form", {}, "ur5-thesis"),
    )
    for task, method, options, arm in cases:
        assert compare(task, [method], goals=1, options=options)["settings"]["arm"] == arm


def test_files_say_the_same(toy, tmp_path):
    results = compare(toy, goals=3, out=tmp_path)
    assert (tmp_path / "results.json").read_text() == json.dumps(results, indent=2) + "\n"
    assert results["settings"]["observation"] == "geometric"
    assert results["settings"]["machine"]["processor"]
    texts = sorted(path.name for path in tmp_path.iterdir() if path.suffix != ".png")  # pictures need OpenGL
    assert texts == ["report.html", "results.csv", "results.json"]
    rows = rows_of(tmp_path / "results.csv")
    assert [row["method"] for row in rows] == ["right", "near", "wild"] * 3
    assert np.mean([float(row["distance"]) for row in rows if row["method"] == "near"]) == pytest.approx(0.005)


def test_a_method_does_the_same_whoever_else_is_compared(toy):
    alone = list(run_trials(prepared(toy, ["near"])))
    among = [trial for trial in run_trials(prepared(toy)) if trial["method"] == "near"]
    assert plain(alone) == plain(among)


def test_options_reach_the_environment(toy):
    assert compare(toy, ["right"], goals=3, options={"offset": 0.02})["methods"][0]["reached"] == 0.0


@pytest.mark.parametrize(("arguments", "said"), [
    ({"goals": 0}, "goals must be at least 1"),
    ({"goals": 2.5}, "goals must be an integer"),
    ({"seed": -1}, "seed must be at least 0"),
    ({"seed": 2**63}, "seed must be at most"),
    ({"methods": ["right", "right"]}, "named twice"),
    ({"methods": [3]}, "a method is a name, a solver"),
    ({"observation": "camera"}, "available: geometric"),
    ({"arm": "ur6"}, "unknown arm"),
])  # fmt: skip
def test_unusable_arguments_are_refused_before_anything_is_written(toy, tmp_path, arguments, said):
    with pytest.raises(InputError, match=said):
        compare(toy, **{"out": tmp_path / "out", **arguments})
    assert not (tmp_path / "out").exists()


def test_unknown_names_list_those_there_are(toy):
    with pytest.raises(UnknownNameError, match="available: near, right, wild"):
        compare(toy, ["left"])
    with pytest.raises(UnknownNameError, match=r"available: arm3, button, .*ur5"):
        compare("ur7")
    with pytest.raises(InputError, match="a task is a name or a Task"):
        compare(7)


@pytest.mark.parametrize(("value", "summary", "said"), [
    (lambda trial: 0.5, "rate", "column 'mine' is a rate: values must be True, False or None, got 0.5"),
    (lambda trial: "yes", "rate", "column 'mine' is a rate: .* got 'yes'"),
    (lambda trial: "far", "quantiles", "column 'mine' must have numbers or None, got 'far'"),
    (lambda trial: trial["nothing"], "mean", "column 'mine' fails: KeyError: 'nothing'"),
])  # fmt: skip
def test_a_column_that_cannot_be_summarised_is_refused_before_anything_is_measured(toy, value, summary, said, tmp_path):
    task = replace(toy, columns=[*toy.columns, Column("mine", value, summary)])
    with pytest.raises(InputError, match=rf"{said} \(method '(right|near|wild)', warm-up goal 0\)"):
        compare(task, goals=3, out=tmp_path)
    assert len((tmp_path / RECORDS).read_text().splitlines()) == 1  # no trial
    for good in (None, True, np.True_, 0, 1.0):
        column = Column("mine", lambda trial, good=good: good, summary)
        compare(replace(toy, columns=[*toy.columns, column]), ["right"], goals=1)


def test_a_summary_that_is_unknown_is_refused():
    with pytest.raises(UnknownNameError, match="'shares'; available: mean, quantiles, rate, spread"):
        Column("mine", "reached", "shares")


def test_every_environment_is_closed(tmp_path, closings, monkeypatch):
    monkeypatch.setattr("kinreach.compare._figures.write_figures", lambda *arguments: {})  # they take seconds
    made = closings(gym, "make")
    compare("ur5", methods=["closed-form"], goals=1, out=tmp_path)
    assert len(made) >= 1
    assert all(close.called for close in made)
