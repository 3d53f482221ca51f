"""A world less exact: the table of the docs is that of the file, and trainings differ by the world that they are in."""

from dataclasses import replace

import numpy as np
import pytest

import benchmarks.learners  # noqa: F401 (registers its recipes)
from benchmarks.logs import FOLDER
from kinreach.baselines import read_curve

pytest.importorskip("stable_baselines3")

from benchmarks.studies import ppo2, thesis_world
from benchmarks.studies.tables import DATA, as_csv
from benchmarks.studies.thesis_world import COLUMNS, TASKS, WORLDS, table, trained
from kinreach.baselines import HELD_OUT, get_recipe
from kinreach.vision import geometric_goal_view

FILE = FOLDER / "thesis-ppo-single" / "worlds.csv"


def rows():
    columns = read_curve(FILE)
    assert tuple(columns) == COLUMNS
    return [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]


def test_the_published_table_is_that_of_the_file():
    found = rows()
    assert as_csv(table(found)) == (DATA / "worlds.csv").read_text(encoding="utf-8")
    assert [(row["multi"], row["world"], row["seed"]) for row in found] == [
        (multi, world, seed) for multi in range(2) for world in range(len(WORLDS)) for seed in range(5)
    ]


def test_what_was_told_is_what_the_readings_say():
    """The same trainings as those of the most faithful reading in the other tables."""
    compared = 0
    for multi, name in enumerate(("thesis-ppo-single", "thesis-ppo-multi")):
        columns = read_curve(FOLDER / name / "readings.csv")
        faithful = np.flatnonzero(
            [all(columns[flag][i] == getattr(ppo2.FAITHFUL, flag) for flag in ppo2.FLAGS)
             and columns["natural_arm"][i] and columns["gripper"][i] for i in range(len(columns["seed"]))]
        )  # fmt: skip
        told = [row for row in rows() if (row["multi"], row["world"]) == (multi, 0)]
        for row, other in zip(told, faithful, strict=True):
            assert row["distance_0"] == pytest.approx(columns["distance"][other], abs=0.01)
            compared += 1
    assert compared == 10


def test_recipes_train_in_the_same_worlds():
    for name, world in (("thesis-ppo-single-camera", "seen"), ("thesis-ppo-single-tolerance", "inexact joints")):
        assert get_recipe(name).options == {"backend": "kinematic", **WORLDS[world]}
    assert get_recipe("thesis-ppo-multi-camera").options == get_recipe("thesis-ppo-single-camera").options


def test_trainings_differ_by_their_world(tmp_path, monkeypatch):
    plan = ppo2.PLANS["single"]
    monkeypatch.setattr(thesis_world, "PLANS", {"single": replace(plan, stack=replace(plan.stack, steps=512))})
    views = geometric_goal_view("ur5-thesis", ppo2.goals(HELD_OUT, 20))
    told, loose = (trained(tmp_path, "single", world, views) for world in ("told", "inexact joints"))
    assert [len(told), len(loose)] == [5, 5]
    for one, other in zip(told, loose, strict=True):
        assert one["distance_0"] == one["distance_1"]  # exact views are what is told
        assert one["distance_0"] != one["distance_2"]
        assert one["distance_0"] != other["distance_0"]
    assert trained(tmp_path, "single", "told", views) == told
    assert set(TASKS) == {"single", "multi"}
