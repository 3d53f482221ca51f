"""`python -m benchmarks.speed` on a terminal: its bar is seen while what compiled code prints is not."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys

import pytest

PROGRAM = """
import os, sys
from types import ModuleType
from kinreach import cli
from benchmarks.speed.peers.base import silent
from benchmarks.speed.sections import Section
from benchmarks.speed.suites import SUITES

def run(options, progress):
    with silent():
        for done in range(3):
            os.write(1, b"prattle")
            os.write(2, b"prattle")
            progress("in silence", done + 1, 3)
    return [Section("The table", "", ("a name", "seconds"), [["a contender", 1.0]], "again")]

SUITES.clear()
for name in ("one", "two"):
    module = ModuleType("benchmarks.speed.suites." + name)
    module.run = run
    sys.modules[module.__name__] = module
    SUITES[name] = ""
sys.exit(cli.run("benchmarks.speed.cli", ["--out", sys.argv[1]], prog="speed"))
"""


def on_terminal(folder: str, *, everything: bool) -> tuple[str, str]:
    """What a run shows on a terminal, and what it writes to a pipe that is its standard output."""
    master, slave = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, folder],
        stdin=slave, stdout=slave if everything else subprocess.PIPE, stderr=slave,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "100"},
    )  # fmt: skip
    os.close(slave)
    piped = process.stdout.read() if process.stdout else b""
    shown = b""
    while True:
        try:
            part = os.read(master, 65536)
        except OSError:  # how Linux tells that the other end is closed
            break
        if not part:
            break
        shown += part
    os.close(master)
    if process.stdout:
        process.stdout.close()
    assert process.wait(60) == 0, shown
    return shown.decode(), piped.decode()


@pytest.mark.parametrize("everything", [False, True])
def test_bar_is_seen_and_chatter_is_not(tmp_path, everything):
    shown, piped = on_terminal(str(tmp_path), everything=everything)
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown)
    assert [f"{done}/3" for done in (1, 2, 3) if f"{done}/3" in plain] == ["1/3", "2/3", "3/3"]
    assert "in silence" in plain
    assert "prattle" not in shown + piped
    tables = [line for line in (shown if everything else piped).splitlines() if "The table" in line]
    assert len(tables) == 2
    for line in tables:
        assert not re.search("[━/]", line.rpartition("\x1b[2K")[2]), f"the bar is left beside it: {line!r}"
