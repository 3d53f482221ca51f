"""The readings of the thesis's PPO2: tables of the docs are those of the files, cells are what they are called."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from kinreach._registration import MULTI, SINGLE
from kinreach.baselines import read_curve

pytest.importorskip("stable_baselines3")

from benchmarks.logs import FOLDER, trace
from benchmarks.studies import ppo2
from benchmarks.studies.ppo2 import (
    FAITHFUL,
    PLANS,
    READING,
    Cell,
    deviations,
    goals,
    main,
    play,
    pooled,
    seed_by_seed,
    table,
)
from benchmarks.studies.side_by_side import Networks
from benchmarks.studies.tables import DATA, as_csv
from kinreach.baselines import HELD_OUT, load_policy


def published(name):
    return (DATA / f"{name}.csv").read_text(encoding="utf-8")


def rows(*path):
    columns = read_curve(FOLDER.joinpath(*path))
    return [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]


def test_the_published_table_is_that_of_the_file():
    found = rows("thesis-ppo-single", "readings.csv")
    for make, name in ((table, "single"), (seed_by_seed, "single-seeds"), (deviations, "single-deviations")):
        assert as_csv(make(found, SINGLE)) == published(name)
    seeds = {}
    for row in found:
        seeds.setdefault(tuple(row[name] for name in READING), []).append(row["seed"])
    assert list(seeds.values()) == [list(range(5))] * len(seeds)
    assert len(seeds) >= 7


def test_four_times_as_many_episodes_are_those_of_the_file():
    found = rows("thesis-ppo-single", "long.csv")
    for make, name in ((table, "single-long"), (seed_by_seed, "single-long-seeds")):
        assert as_csv(make(found, SINGLE)) == published(name)
    whole, alone = ([row for row in found if row["natural_arm"] == row["gripper"] == paid] for paid in (1, 0))
    assert (len(whole), len(alone)) == (20, 5)
    assert sorted(row["reached"] for row in whole)[14:] == [0, 0.4, 2.5, 4.7, 11.6, 21.1]
    assert 1000 < min(row["reached_training"] for row in whole) < max(row["reached_training"] for row in whole) < 3710
    assert [row["impossible"] for row in whole].count(100) == 1
    assert 49 < min(row["distance_end"] for row in alone) < max(row["distance_end"] for row in alone) < 255


def test_random_actions_are_those_of_the_file():
    found = rows("thesis-ppo-single", "random.csv")
    assert as_csv(table(found, SINGLE)) == published("single-random")
    assert [(row["random"], row["seed"]) for row in found] == [
        (share, seed) for share in (0.1, 0.3) for seed in range(5)
    ]
    assert {row["reached_training"] for row in found} == {row["reached"] for row in found} == {0}
    assert 135 < min(row["distance"] for row in found[:5]) < max(row["distance"] for row in found[:5]) < 745


def test_the_published_tables_of_multi_step_are_those_of_the_files():
    for name, cells, seeds in (
        ("readings.csv", 19, range(5)),
        ("updates.csv", 2, range(5)),
        ("readings-2M.csv", 16, range(1)),
        ("long.csv", 4, range(5)),
        ("longest.csv", 4, range(5)),
    ):
        found = rows("thesis-ppo-multi", name)
        file = {"readings.csv": "multi", "readings-2M.csv": "multi-readings"}.get(name, f"multi-{name[:-4]}")
        assert as_csv(table(found, MULTI)) == published(file)
        for make, what in ((seed_by_seed, "seeds"), (deviations, "deviations")) if name.startswith("long") else ():
            assert as_csv(make(found, MULTI)) == published(f"{file}-{what}")
        if name == "readings.csv":
            assert as_csv(pooled(found)) == published("multi-pooled")
        trained = {}
        for row in found:
            trained.setdefault(tuple(row[flag] for flag in READING), []).append(row["seed"])
        assert list(trained.values()) == [list(seeds)] * cells


def test_distances_at_half_are_between_looks():
    found = ppo2._looks([(100, 50.0), (200, 30.0), (300, 10.0), (400, 20.0)])
    assert found == {"distance_half": 30.0, "distance_end": 20.0}
    assert ppo2._looks([(80, 50.0), (160, 40.0), (240, 20.0)])["distance_half"] == pytest.approx(45.0)


def test_trainings_are_pooled_by_what_they_share():
    rng = np.random.default_rng(0)
    found = [
        {**dict(zip(READING, rng.integers(0, 2, len(READING)).astype(float), strict=True)), "distance": value}
        for value in rng.uniform(10, 99, 200)
    ]
    counts = [int(line.split("|")[2]) for line in pooled(found).splitlines()[2:]]
    whole = sum(row["natural_arm"] * row["gripper"] for row in found)
    assert len(counts) == 8
    assert sum(counts) == 3 * whole > 90
    one = [{**row, **dict.fromkeys(READING, 1.0)} for row in found]
    assert pooled(one) == ""


def test_cells_have_names_of_their_own():
    for plan in PLANS.values():
        names = [cell.name for cell in plan.cells]
        assert len(set(names)) == len(names) >= 2
    assert FAITHFUL.name == "terminal-raw-clip-stable"
    single, multi = (FAITHFUL.trained(environment, 3) for environment in (SINGLE, MULTI))
    assert (single.rate, multi.rate, single.entropy) == (1e-3, 2.5e-4, 0.01)
    assert (single.gain * math.pi, multi.std * 5) == pytest.approx((1.0, 1.0))
    openai = Cell(openai=True, raw=False).trained(SINGLE, 0)
    assert (openai.rate, openai.entropy, openai.gain, openai.std) == pytest.approx((1.2e-3, 0.0, 1.0, 1 / math.pi))


@pytest.mark.parametrize("environment", [SINGLE, MULTI])
def test_policies_played_together_do_what_each_does_alone(environment):
    jobs = [FAITHFUL.trained(environment, seed) for seed in (0, 1, 2)]
    networks = Networks(jobs, shared=False)
    for index, one in enumerate(jobs):
        networks.weights["mean.b"].data[index] += one.gain**-1 * 0.3 * (index - 1)
    places = goals(HELD_OUT, 5)
    found = play(networks, 3, environment, places)
    stack = replace(PLANS["single"].stack, environment=environment)
    for index in range(3):
        alone = trace(networks.policy(index, stack), places, options={"backend": "kinematic"})
        np.testing.assert_allclose(found.distance[index], alone.distance[-1], atol=1e-5)
        np.testing.assert_allclose(found.posture_error[index], alone.posture_error[-1], atol=1e-4)
        np.testing.assert_array_equal(found.impossible[index], alone.impossible)
    assert np.ptp(found.distance, axis=0).min() > 1e-3


def test_what_is_missing_is_trained_and_shown(tmp_path, monkeypatch, capsys):

    plan = replace(PLANS["single"], stack=replace(PLANS["single"].stack, steps=512, looks=1), cells=[FAITHFUL], seeds=2)
    monkeypatch.setattr(ppo2, "PLANS", {"single": plan})
    monkeypatch.setattr(ppo2, "GOALS", 20)
    file = tmp_path / "rows.csv"
    figure = tmp_path / "figure.png"
    assert main([str(tmp_path), "--plan", "single", "--csv", str(file), "--figure", str(figure)]) == 0
    assert figure.read_bytes().startswith(b"\x89PNG")
    printed = capsys.readouterr().out
    assert table(ppo2.rows(tmp_path, "single"), SINGLE) in printed
    runs = sorted((tmp_path / "single" / FAITHFUL.name).glob("*.json"))
    assert [json.loads(run.read_text())["seed"] for run in runs] == [0, 1]
    cards = [load_policy(run.with_suffix(".safetensors")).card for run in runs]
    assert [(card.environment, card.seed, card.steps) for card in cards] == [(SINGLE, 0, 512), (SINGLE, 1, 512)]
    assert len(read_curve(file)["seed"]) == 2
    more = replace(plan, cells=[FAITHFUL, replace(FAITHFUL, raw=False)])
    monkeypatch.setattr(ppo2, "PLANS", {"single": more})
    figure.unlink()
    assert main([str(tmp_path), "--plan", "single", "--no-train", "--figure", str(figure)]) == 0
    assert figure.exists()  # of what was trained
    monkeypatch.setattr(ppo2, "PLANS", {"single": plan})
    before = [run.stat().st_mtime_ns for run in runs]
    assert main([str(tmp_path), "--plan", "single"]) == 0
    assert [run.stat().st_mtime_ns for run in runs] == before
