"""Processes of our own that are timed from their start to their end."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import kinreach
from kinreach.errors import KinreachError

#: Put behind a program, this tells the most memory that the process held; what the system's own accounting says of a
#: child includes what its parent held before the program was loaded.
PEAK = "\nprint(next((line.split()[1] for line in open('/proc/self/status') if line.startswith('VmHWM')), ''))"


@dataclass(frozen=True)
class ChildRun:
    """A finished process.

    Attributes:
        wall: From start to end [s].
        processor: Of all its threads [s].
        output: What it wrote.
    """

    wall: float
    processor: float
    output: str


def run_child(arguments: Sequence[str], *, cwd: Path | None = None) -> ChildRun:
    """Run Python, with this kinreach on its path, and wait for its end.

    Args:
        arguments: For example `["-c", "import numpy"]`.
        cwd: Where it runs.

    Raises:
        KinreachError: It did not end well; the message is the last line of its output.
    """
    paths = [str(Path(kinreach.__file__).parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])]
    surroundings = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as complaints:
        start = time.perf_counter()
        process = subprocess.Popen(
            [sys.executable, *arguments], stdin=subprocess.DEVNULL, stdout=output, stderr=complaints, cwd=cwd,
            env=surroundings,
        )  # fmt: skip
        try:
            _, status, usage = os.wait4(process.pid, 0)
        except BaseException:
            process.kill()
            process.wait()
            raise
        wall = time.perf_counter() - start
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0:
            lines = _text(complaints).split("\n")
            words = next((line.strip() for line in reversed(lines) if line.strip()), "it wrote nothing")
            raise KinreachError(f"python {' '.join(arguments)} ended with {process.returncode}: {words}")
        return ChildRun(wall, usage.ru_utime + usage.ru_stime, _text(output))


def peak_memory(code: str) -> float | None:
    """Most memory that a fresh process held while it ran some code [MB]; None where the system does not tell.

    Raises:
        KinreachError: It did not end well.
    """
    if not Path("/proc/self/status").exists():
        return None
    return float(run_child(["-c", code + PEAK]).output.split()[-1]) * 1024 / 1e6


def _text(file: Any) -> str:
    file.seek(0)
    return bytes(file.read()).decode(errors="replace")
