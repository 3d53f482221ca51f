"""The study of damage: faults are what they are called, and who knows them reaches."""

import csv
import re

import numpy as np
import pytest

pytest.importorskip("torch")
from benchmarks.studies import damage as study
from benchmarks.studies import relearning
from benchmarks.studies.damage import (
    BENT,
    KINDS,
    OFFSET,
    STUCK,
    by_looks,
    damage,
    main,
    numeric,
    reached,
    share_of_faults,
)
from benchmarks.studies.relearning import KNOWN, SHIPPED, curve
from benchmarks.studies.tables import DATA, as_csv
from kinreach.baselines.expert import tool_down_postures
from kinreach.baselines.random_arms import on_table, ur5
from kinreach.errors import InputError


@pytest.mark.parametrize("kind", KINDS)
def test_known_faults(kind):
    seen = set()
    for seed in range(4):
        rng = np.random.default_rng(seed)
        fault = damage(kind, rng)
        balls = ur5().arm.workcell.draw_goals(rng, 8)
        q = rng.uniform(-1, 1, (50, 6)) + fault.arm.home
        apart = np.linalg.norm(fault.chain.positions(fault.executed(q)) - ur5().chain.positions(q), axis=1)
        unaware = reached(fault, tool_down_postures(ur5(), balls), balls)[0]
        known = reached(fault, numeric(fault.chain, balls, stuck=fault.stuck, at=fault.at), balls)[0]
        assert known >= unaware
        if kind != STUCK:
            assert known == 8
        if kind == BENT:
            assert apart.max() > 4e-3
        if kind == OFFSET:
            assert fault.stuck is None
        seen.add(fault.stuck if kind == STUCK else round(float(apart.max()), 6))
    assert len(seen) >= 2


def test_a_stuck_elbow_is_worked_around():
    """Balls that need another posture than the closed form's: from its posture alone one of these 40 is found."""
    rng = np.random.default_rng(9)
    fault = damage(STUCK, rng)
    balls = ur5().arm.workcell.draw_goals(rng, 40)
    assert fault.stuck == 2
    assert reached(fault, numeric(fault.chain, balls, stuck=2, at=fault.at), balls)[0] >= 15


def test_a_posture_near_the_looks_is_kept():
    """A ball out of reach starts a search anywhere; what the closed form's posture leads to is kept for the others."""
    chain, balls = ur5().chain, ur5().arm.workcell.draw_goals(np.random.default_rng(0), 20)
    far = numeric(chain, np.vstack([balls, [[3.0, 0.0, 0.0]]]))[:-1]
    assert np.abs(far - numeric(chain, balls)).max() < 1e-3


@pytest.mark.parametrize("kind", KINDS)
def test_looks_find_it(kind):
    found = known = 0
    for seed in range(4):
        rng = np.random.default_rng(10 + seed)
        fault = damage(kind, rng)
        balls = ur5().arm.workcell.draw_goals(rng, 10)
        q = tool_down_postures(ur5(), on_table(20))
        seen = fault.chain.positions(fault.executed(q)) + rng.normal(0, 9e-5, (20, 3))
        found += reached(fault, by_looks(q, seen, balls), balls)[0]
        known += reached(fault, numeric(fault.chain, balls, stuck=fault.stuck, at=fault.at), balls)[0]
    assert found >= known - 1
    assert known >= (10 if kind == STUCK else 40)


def test_the_table(capsys, tmp_path, monkeypatch):
    arguments = ["--faults", "1", "--balls", "4", "--out", str(tmp_path)]
    assert main(arguments) == 0
    table = capsys.readouterr().out
    monkeypatch.setattr(study, "tried", None)  # no fault is tried again
    assert main(arguments) == 0
    assert capsys.readouterr().out == table
    header, *rows = csv.reader(as_csv(table).splitlines())
    assert header == ["method", *KINDS]
    assert len(rows) == 11
    assert all(re.fullmatch(r"[\d.]+; [\d.]+ mm", cell) for row in rows for cell in row[1:])
    assert header == published("damage")[0]
    assert [row[0] for row in published("damage")] == ["method", *(row[0] for row in rows)]


def rows_of(capsys):
    """The printed table, as it becomes a file."""
    return list(csv.reader(as_csv(capsys.readouterr().out).splitlines()))


def published(name):
    return list(csv.reader((DATA / f"{name}.csv").read_text(encoding="utf-8").splitlines()))


def test_intervals_are_over_faults():
    """Balls of one fault are reached or missed together: more balls say nothing of other faults."""
    few = share_of_faults([0.0, 1.0, 0.0, 1.0, 0.5, 0.5])
    low, high = map(float, re.fullmatch(r"50\.0 \[([\d.]+), ([\d.]+)\]", few).groups())
    assert low <= 25.0
    assert high >= 75.0
    assert share_of_faults([1.0] * 12) == "100.0"


def test_a_policy_learns_again(capsys):
    """What 3000 episodes mend: nearly every ball, from less than a third, at a fault that the policy feels."""
    before, after = (curve(BENT, 10, 0, SHIPPED, 50, 3000)[n] for n in (0, 3000))
    assert before[0] < 0.3
    assert after[0] > 0.9
    assert curve(BENT, 10, 0, KNOWN, 50, 0)[0][0] == 1.0


def test_the_table_of_learning_again(capsys, tmp_path, monkeypatch):
    arguments = ["--faults", "1", "--balls", "4", "--most", "1000", "--out", str(tmp_path)]
    assert relearning.main(arguments) == 0
    header, *rows = printed = rows_of(capsys)
    monkeypatch.setattr(relearning, "curve", None)  # no policy learns again
    assert relearning.main(arguments) == 0
    assert rows_of(capsys) == printed
    assert header == ["begun with", "episodes", "processor, s", *KINDS] == published("relearning")[0]
    assert [row[:2] for row in rows] == [row[:2] for row in published("relearning")[1:4]]
    with pytest.raises(InputError, match="--most must be at least 1"):
        relearning.main(["--most", "0"])


def test_the_outcome_is_the_criterion():
    rng = np.random.default_rng(0)
    fault = damage(BENT, rng)
    balls = ur5().arm.workcell.draw_goals(rng, 200)
    q = tool_down_postures(ur5(), balls) + rng.normal(0, 0.02, (200, 6))
    good = relearning.outcome(fault, q / np.pi, balls, np.zeros((200, 3))) > -1
    assert 10 < good.sum() < 190
    assert [reached(fault, q[[i]], balls[[i]])[0] for i in range(200)] == good.astype(int).tolist()
