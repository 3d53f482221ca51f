"""The endurance checks: what was not checked is no success, and every module with fuzz tests is run."""

import re
import sys

import pytest

from tools.endurance import __main__ as endurance
from tools.endurance import results, storage
from tools.endurance.outcome import Outcome


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
    fuzzed = {name for name, content in modules.items() if re.search(r"\bfuzzed\(", content)}
    assert set(results.MODULES) == fuzzed
    assert len(results.MODULES) == len(fuzzed) >= 10
