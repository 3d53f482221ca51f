"""Processes that are timed from start to end, and the memory that they held."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from benchmarks.speed.child import peak_memory, run_child
from kinreach.errors import KinreachError

needs_proc = pytest.mark.skipif(sys.platform != "linux", reason="memory is read from /proc")


def test_times_and_output():
    idle = run_child(["-c", "import time; time.sleep(0.3); print('slept')"])
    assert idle.output == "slept\n"
    assert idle.wall >= 0.3
    busy = run_child(["-c", "import time\nwhile time.process_time() < 0.3: pass"])
    assert busy.processor >= 0.3
    assert busy.wall >= 0.3
    assert 0 < idle.processor < busy.processor


def test_kinreach_is_the_one_that_runs_the_benchmark(tmp_path):
    import kinreach

    assert run_child(["-c", "import kinreach; print(kinreach.__file__)"], cwd=tmp_path).output.strip() == (
        kinreach.__file__
    )


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("raise ValueError('the last line')", "ended with 1: ValueError: the last line"),
        ("import sys; sys.exit(7)", "ended with 7: it said nothing"),
        ("import os; os.kill(os.getpid(), 9)", "ended with -9: it said nothing"),
    ],
)
def test_a_process_that_fails_is_told(code, message):
    with pytest.raises(KinreachError, match=message):
        run_child(["-c", code])


@needs_proc
def test_memory_is_that_of_the_process_at_its_peak():
    held = np.ones(40_000_000)  # 320 MB in this process: none of the child's business
    nothing = peak_memory("pass")
    peak = peak_memory("a = b'x' * 200_000_000; del a")
    assert held[-1] == 1.0
    assert nothing is not None
    assert peak is not None
    assert 3 < nothing < 100
    assert 195 < peak - nothing < 215
