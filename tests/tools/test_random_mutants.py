"""Random changes of the syntax tree: each is a program, none is text for people, and the right tests are asked."""

import ast
import dataclasses
import json
import shutil

import pytest

from tools.mutants import by_hand as mutants
from tools.mutants import drawn as random_mutants
from tools.mutants.drawn import Covering, Forked, changes, draw, equivalents, judge, report

pytestmark = pytest.mark.slow

SOURCE = '''
"""A module: 1 + 1."""
from typing import Final
__all__ = ["square"]
MOST: Final[int] = 3
Names = dict[str, 7]

def square(x: int = 2, *, least: float | None = None) -> int:
    """The square, 2 * 2."""
    if x < 0 and not least:
        raise ValueError(f"x must be at least {0 + 1}, got {x}")
    for each in range(x):
        if any([each > MOST, x != 5]):
            continue
        x += 1
    print(x, *zip([x], strict=True), sep="", help="1 + 1")
    return max(x, 0) * x
'''

SHAPES = """
from functools import cache
SIDES = 4

def times(factor):
    def scaled(x):
        return factor * x
    return scaled

@cache
def area(side=2):
    return side * side

class Square:
    name = "square"

    @property
    def around(self):
        return SIDES * 3

KNOWN, TWICE = area(), times(2)
"""
SHAPES_TESTS = """
from kinreach.shapes import KNOWN, TWICE, Square, area, times

def test_area():
    assert area() == 4

def test_times():
    assert TWICE(3) + times(5)(1) == 11

def test_around():
    assert Square().around == 12
"""
STATE_TESTS = """
from kinreach import shapes

def test_state():
    shapes.SIDES += 1
    assert shapes.SIDES == 5
"""


def test_every_change_is_another_program_and_not_of_a_text():
    found = changes("square.py", SOURCE)
    programs = {ast.unparse(ast.parse(mutant.applied(SOURCE))) for mutant in found}
    assert len(programs) == len(found) >= 30
    assert ast.unparse(ast.parse(SOURCE)) not in programs
    said = {" ".join(mutant.id.split()[1:]) for mutant in found}
    assert said >= {
        "x < 0 -> (x <= 0)", "x < 0 -> (x > 0)", "x < 0 and not least -> (x < 0 or not least)", "not least -> (least)",
        "any -> all", "max -> min", "max(x, 0) * x -> (max(x, 0) / x)", "max(x, 0) -> max(x)", "3 -> 4", "3 -> -3",
        "continue -> break", "x += 1 -> x -= 1", "x += 1 -> pass", "return max(x, 0) * x -> return",
    }  # fmt: skip
    kept = ast.unparse(ast.parse(SOURCE)).splitlines()
    for text in ('"""A module: 1 + 1."""', '"""The square, 2 * 2."""', "__all__ = ['square']", "Names = dict[str, 7]"):
        (line,) = (line for line in kept if text in line)
        assert all(line in program for program in programs)
    assert all("got {x}" in program or "pass" in program for program in programs)
    assert all("float | None" in program for program in programs)
    assert all("strict=True" in program for program in programs if "zip(" in program)


def test_draws_are_the_same_again_and_by_the_number_of_lines():
    texts = {"long.py": SOURCE * 9, "short.py": SOURCE}
    drawn = draw(texts, 3, 200)
    assert len({mutant.id for mutant in drawn}) == 200
    assert [mutant.id for mutant in draw(texts, 3, 50)] == [mutant.id for mutant in drawn[:50]]
    assert {mutant.id for mutant in draw(texts, 4, 50)} != {mutant.id for mutant in drawn[:50]}
    assert 150 < sum(mutant.file == "long.py" for mutant in drawn) < 200


@pytest.fixture
def toy(tmp_path):
    """A package with a test that notices, one that does not, and one that is not asked."""
    for folder in ("kinreach", "tests", "tools/mutants"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "pytest.ini").write_text(
        "[pytest]\nmarkers = slow\npythonpath = .\naddopts = --import-mode=importlib\n"
    )
    (tmp_path / "kinreach/square.py").write_text(
        "def square(x):\n    return x * x\n\n\ndef cube(x):\n    return x**3\n"
    )
    for name, number, result in (("square", 1, 1), ("square", 3, 9), ("cube", 3, 27)):
        (tmp_path / f"tests/test_{name}_{number}.py").write_text(
            f"from kinreach.square import {name}\n\n\ndef test():\n    assert {name}({number}) == {result}\n"
        )
    for package in ("kinreach", "tools", "tools/mutants"):
        (tmp_path / package / "__init__.py").touch()
    for plugin in ("covering", "forked"):
        shutil.copy(mutants.ROOT / f"tools/mutants/{plugin}.py", tmp_path / "tools/mutants")
    return tmp_path


def test_the_tests_that_enter_a_function_are_asked_and_kill(toy):
    random_mutants.write_map(toy, toy / "map.json")
    found = json.loads((toy / "map.json").read_text())
    assert list(found["seconds"]) == [f"tests/test_{name}.py::test" for name in ("cube_3", "square_1", "square_3")]
    assert found["lines"]["kinreach/square.py"]["2"] == [1, 2]
    text = (toy / "kinreach/square.py").read_text()
    (divided,) = (mutant for mutant in changes("kinreach/square.py", text) if mutant.new == "(x / x)")
    row = judge(toy, divided, Covering(toy / "map.json"), full=False)
    assert (row["killed_by"], row["tests"]) == ("tests/test_square_3.py::test", 2)
    harmless = dataclasses.replace(divided, new="x ** 2")
    assert judge(toy, harmless, Covering(toy / "map.json"), full=False)["killed_by"] is None
    assert (toy / "kinreach/square.py").read_text() == text


def test_a_process_that_forks_judges_as_new_ones_do(toy):
    """Closures, methods and what was cached are the mutant's; what a test does to the process is gone after it."""
    source = toy / "kinreach/shapes.py"
    source.write_text(SHAPES)
    for name, tests in (("shapes", SHAPES_TESTS), ("state", STATE_TESTS)):
        (toy / f"tests/test_{name}.py").write_text(tests)
    random_mutants.write_map(toy, toy / "map.json")
    covering, judged = Covering(toy / "map.json"), 0
    forked = Forked(toy)
    for mutant in changes("kinreach/shapes.py", SHAPES):
        rows = [judge(toy, mutant, covering, full=False, forked=process) for process in (forked, None)]
        assert rows[0]["killed_by"] == rows[1]["killed_by"], mutant.id
        judged += 1
    forked.close()
    assert judged >= 12


def test_what_changes_nothing_is_not_counted(monkeypatch, capsys):
    """A reason is that of a line, wherever it stands, not of the same change on another line."""
    why = {("square.py", "if x < 0 and not least:", "0 -> 1"): "never one"}
    monkeypatch.setattr(random_mutants, "equivalents", lambda: why)
    moved = [mutant for mutant in changes("square.py", "\n" + SOURCE) if mutant.change == "0 -> 1"]
    excused, other = (next(one for one in moved if one.source.startswith(word)) for word in ("if", "return"))
    results = {excused.id: {"killed_by": None}, other.id: {"killed_by": "tests/t.py::t"}}
    assert report([excused, other], results) == 0
    assert "1 of 1 killed; 1 more change nothing" in capsys.readouterr().out
    results[other.id] = {"killed_by": None}
    assert report([excused, other], results) == 1
    assert f"{other.id}: NOT NOTICED" in capsys.readouterr().out


def test_every_equivalent_has_its_place_and_its_reason(root):
    entries, known = equivalents(), {}
    for (file, line, change), why in entries.items():
        if file not in known:
            found = changes(file, (root / file).read_text(encoding="utf-8"))
            known[file] = {mutant.anywhere for mutant in found}
        assert (file, line, change) in known[file]
        assert len(why) > 15
    assert len(entries) > 50
