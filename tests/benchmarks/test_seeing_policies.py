"""Every shipped policy is in the table of the page with each way of seeing that it can have, or said not to be."""

import csv
from pathlib import Path

from benchmarks.studies.seeing_policies import SIGHTS, row, sights
from kinreach.baselines._policies import load_policy, pretrained_names

PAGE = Path(__file__).parents[2] / "docs" / "studies/appendix/seeing.md"


def test_every_shipped_policy_is_accounted_for():
    text = PAGE.read_text(encoding="utf-8").partition("## What policies make of it")[2]
    table = (PAGE.parent / "data" / "seeing-policies.csv").read_text(encoding="utf-8").splitlines()
    rows = [(row[0].strip("`"), row[1]) for row in list(csv.reader(table))[1:]]
    wanted = [(name, sight) for name in pretrained_names() for sight in sights(load_policy(name))]
    assert rows == wanted
    assert {sight for _, sight in rows} == set(SIGHTS)
    said = text.partition("```")[0]
    left_out = [name for name in pretrained_names() if not sights(load_policy(name))]
    assert [name for name in left_out if f"`{name}`" not in said] == []
    assert len(left_out) >= 5
    assert len(wanted) >= 19


def test_a_row_is_of_its_goals(needs_gl):
    cells = [cell.strip() for cell in row("ranked-single", "seen, hybrid", 3).strip("|").split("|")]
    assert cells[:4] == ["`ranked-single`", "seen, hybrid", "100.0", "100.0 [43.9, 100.0]"]
