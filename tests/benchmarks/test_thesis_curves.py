"""What the thesis reads off its curves: tables are those of the logs, and rows are what they are called."""

import numpy as np
import pytest

from benchmarks.studies.tables import DATA, as_csv
from benchmarks.studies.thesis_curves import (
    ACTIONS,
    UPDATE,
    Row,
    above_zero,
    across_updates,
    due_to_impossible,
    possible,
    possible_each,
    reached,
    tables,
)
from kinreach._statistics import median


def test_the_published_tables_are_those_of_the_logs():
    found = tables()
    for table, name in zip(found, ("curves-single", "curves-multi", "curves-single-more"), strict=True):
        assert as_csv(table) == (DATA / f"{name}.csv").read_text(encoding="utf-8")
        assert table.count("\n") >= 9


def test_rewards_are_those_of_possible_steps():
    rng = np.random.default_rng(0)
    impossible, rewards = rng.random((40, 250)) < 0.2, rng.normal(1.0, 3.0, (40, 250))
    log = {
        "reward": np.where(impossible, -100.0, rewards).mean(axis=1),
        "impossible": impossible.mean(axis=1),
        "episodes": 250.0 * np.arange(1, 41),
        "reached": (rewards > 5).mean(axis=1),
    }
    rows = np.arange(40) >= 30
    assert possible(log, rows) == pytest.approx(rewards[rows][~impossible[rows]].mean())
    assert reached(log, rows) == (rewards[rows] > 5).sum() > 50
    rising = {"reward": np.linspace(-2, 2, 40), "impossible": np.zeros(40), "episodes": log["episodes"]}
    last = above_zero(rising)
    assert 4500 < last < 5500
    assert possible(rising, np.abs(rising["episodes"] - last) <= 1000) <= 0


def windows(steps, impossible, width=10 * ACTIONS):
    """A learning curve of single steps."""
    rows = len(steps) // width * width
    found = {"reward": np.where(impossible, -100.0, steps), "impossible": impossible}
    found = {name: values[:rows].reshape(-1, width).mean(axis=1) for name, values in found.items()}
    return {**found, "steps": width * np.arange(1.0, rows // width + 1)}


def test_fluctuations_are_told_from_impossible_steps():
    rng = np.random.default_rng(0)
    steps, never = rng.normal(1.0, 1.0, 150_000), np.zeros(150_000, dtype=bool)
    assert due_to_impossible(windows(steps, never)) == pytest.approx(0.0, abs=1e-12)
    share = due_to_impossible(windows(steps, rng.random(150_000) < 0.005))
    assert 0.97 < share < 1.0  # -101 in five of a thousand steps, against a deviation of 1 in each
    log = windows(steps, never)
    assert possible_each(log) == pytest.approx(log["reward"])


def test_changes_over_an_update_are_those_of_the_updates():
    """A reward that is constant between two updates, and one that updates do not change."""
    rng = np.random.default_rng(1)
    never = np.zeros(150 * 1000, dtype=bool)
    noise = rng.normal(0.0, 0.1, len(never))
    rollout = np.arange(len(never)) // UPDATE
    levels = rng.normal(0.0, 1.0, rollout[-1] + 1)
    assert across_updates(windows(levels[rollout] + noise, never)) > 50
    assert across_updates(windows(noise, never)) == pytest.approx(1.0, abs=0.35)


def test_a_row_has_every_seed_and_an_interval():
    row = Row("distance", "-", 0, np.array([[0.01, 0.03, 0.02], [0.04, 0.06, 0.05]]), statistic=median, unit=1e3)
    cells = [cell.strip() for cell in row.cells().strip("|").split("|")]
    assert cells[:4] == ["distance", "-", "20", "50"]
    assert cells[4].startswith("35 [0, ")  # two seeds: Student's t is wide
