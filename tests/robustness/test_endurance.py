"""The endurance checks' own machinery: what was not checked is no success, and what fails is found."""

import re
import sys

import pytest

from tools import digest
from tools.endurance import __main__ as endurance
from tools.endurance import results, storage
from tools.endurance.outcome import BrokenPromiseError, Outcome

FUZZ_TEST = """
from hypothesis import strategies as st
from tests.robustness.fuzzing import fuzz

def test_numbers(fuzzed):
    def run(case):
        assert case != {bad}
    fuzzed(st.integers(0, 10**6), run, both=False)
"""


@pytest.mark.parametrize(
    ("found", "code", "said"),
    [
        (Outcome(3, "disks", "all [/fine]"), 0, "digest: 3 disks: all [/fine]"),
        (Outcome(0, "disks", "no file systems"), 1, "digest: NOT CHECKED: no file systems"),
        ("two bits differ [/x]", 1, "digest: BROKEN: two bits differ [/x]"),
    ],
)
def test_only_what_was_checked_and_held_is_a_success(found, code, said, monkeypatch, capsys):
    monkeypatch.setattr(endurance, "_in_a_process", lambda name, quick: found)
    monkeypatch.setattr(sys, "argv", ["endurance", "--only", "digest"])
    assert endurance.main() == code
    assert said in capsys.readouterr().out


@pytest.mark.slow
def test_disks_are_not_checked_where_nothing_can_be_mounted(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PATH", str(tmp_path))  # no unshare
    assert storage.full_disks(tmp_path).count == 0
    monkeypatch.setattr(sys, "argv", ["endurance", "--quick", "--only", "disks"])
    assert endurance.main() == 1
    assert "NOT CHECKED" in capsys.readouterr().out


def test_all_modules_with_fuzz_tests_are_run():
    modules = {path.name: path.read_text(encoding="utf-8") for path in results.TESTS.glob("test_*.py")}
    fuzzed = {name for name, content in modules.items() if re.search(r"\bfuzzed\(", content)} - {"test_endurance.py"}
    assert set(results.MODULES) == fuzzed
    assert len(results.MODULES) == len(fuzzed) >= 10


@pytest.fixture
def run_of(tmp_path, monkeypatch):
    """`run_of(content)`: the check, with one module of this content."""

    def run(content):
        (tmp_path / "conftest.py").write_text("from tests.robustness.conftest import fuzzed, pytest_terminal_summary\n")
        (tmp_path / "test_it.py").write_text(content)
        monkeypatch.setattr(results, "MODULES", [str(tmp_path / "test_it.py")])
        return results.fuzzing(1)

    return run


@pytest.mark.slow
def test_fuzzed_cases_are_counted(run_of):
    assert run_of(FUZZ_TEST.format(bad=-1)) == Outcome(260, "cases", "1 tests, 0 refused, the others right")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("content", "said"),
    [(FUZZ_TEST.format(bad="case"), "exit code 1"), ("def test_nothing(): pass", "no count"), ("", "exit code 5")],
)
def test_fuzz_tests_that_fail_or_do_not_run_are_found(content, said, run_of):
    with pytest.raises(BrokenPromiseError, match=said):
        run_of(content)


def test_other_digests_are_found(tmp_path, monkeypatch):
    assert results.digests(2).count == 2
    lines = digest.REFERENCE.read_text(encoding="utf-8").splitlines()
    other = [re.sub(r"^forward .*", f"forward {0:016} {0:016} 52000", line) for line in lines]
    assert other != lines
    monkeypatch.setattr(digest, "REFERENCE", tmp_path / "digest.txt")
    for kept, said in ((other, "forward: DIFFERENT"), (lines[:-1], "not of these results")):
        digest.REFERENCE.write_text("\n".join(kept))
        with pytest.raises(BrokenPromiseError, match=said):
            results.digests(2)
