"""The list of mutants fits the sources, and what is run for one tells a test that notices from one that does not."""

import json
from collections import Counter
from dataclasses import replace

import pytest

from kinreach.errors import InputError
from tools.mutants import by_hand as mutants
from tools.mutants.by_hand import Mutant, read_mutants, summary, verdict


def test_every_mutant_is_a_change_of_one_place_and_its_tests_are_there(root):
    found, texts = read_mutants(), {}
    for mutant in found:
        text = texts.setdefault(mutant.file, (root / mutant.file).read_text(encoding="utf-8"))
        assert mutant.applied(text) != text, mutant.id
        for test in mutant.tests:
            file, _, name = test.partition("::")
            assert not name or f"def {name}(" in (root / file).read_text(encoding="utf-8"), (mutant.id, test)
    counts = Counter(mutant.area for mutant in found)
    assert counts["named"] >= 12
    assert counts.total() - counts["named"] >= 60
    assert set(counts) >= {"kinematics", "sim", "envs", "baselines", "compare"}


def test_the_documentation_says_what_was_found(root):
    rows = list(json.loads(mutants.RESULTS.read_text(encoding="utf-8")).values())
    assert [row["id"] for row in rows] == [mutant.id for mutant in read_mutants()]
    assert sum(row["killed_by"] is not None for row in rows) >= mutants.GOAL * len(rows)
    page = (root / "docs/reference/promises.md").read_text(encoding="utf-8")
    assert f"lists {len(rows)} mistakes" in page
    assert f"notice all {sum(row['killed_by'] is not None for row in rows)}" in page


SQUARE = Mutant("toy-square", "toy", "square.py", "x * x", "x + x", "squares are doubles", ("test_square.py",))


@pytest.fixture
def toy(tmp_path):
    (tmp_path / "square.py").write_text("def square(x):\n    return x * x\n")
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = slow\n")
    (tmp_path / "test_square.py").write_text(
        "from square import square\n\n\ndef test_of_two():\n    assert square(2) == 4\n\n\n"
        "def test_of_a_third():\n    assert square(3) == 9\n"
    )
    return tmp_path


@pytest.mark.slow
def test_a_mutant_is_killed_by_the_first_test_that_fails_and_leaves_no_trace(toy):
    before = (toy / "square.py").read_text(), (toy / "square.py").stat().st_mtime_ns
    found = verdict(toy, SQUARE, full=False)
    assert (found["killed_by"], found["scope"]) == ("test_square.py::test_of_a_third", "covering")
    survivor = replace(SQUARE, tests=("test_square.py::test_of_two",))
    assert verdict(toy, survivor, full=False)["killed_by"] is None
    assert ((toy / "square.py").read_text(), (toy / "square.py").stat().st_mtime_ns) == before


def test_a_covering_test_that_fails_by_itself_is_said(toy):
    (toy / "test_square.py").write_text("def test_that_fails():\n    assert False\n")
    with pytest.raises(InputError, match="without a mutant the covering tests fail"):
        mutants.check_passing(toy, ["test_square.py"])


def test_a_text_that_occurs_twice_is_no_mutant():
    with pytest.raises(InputError, match="occurs 2 times"):
        SQUARE.applied("x * x + x * x")


def test_the_summary_counts_by_area():
    rows = [
        {"id": "a-1", "area": "a", "killed_by": "tests/t.py::test"},
        {"id": "a-2", "area": "a", "killed_by": None},
        {"id": "b-1", "area": "b", "killed_by": "tests/t.py::test"},
    ]
    assert summary(rows)[1:] == ["| a | 2 | 1 | `a-2` |", "| b | 1 | 1 | - |", "| all | 3 | 2 | `a-2` |"]
