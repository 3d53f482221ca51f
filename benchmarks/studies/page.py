"""How soon the page answers, and what open and closed tabs leave behind: `python -m benchmarks.studies.page`.

The tabs have no browser, so that what is measured is the server. Printed are, for the nominal and the calibrated UR5,
the times from the message of a dragged target to the answer's being on its way, with all postures; then memory and
threads of the server after tabs that were opened, used and closed.

Options: `--drags N`, `--tabs N`.
"""

from __future__ import annotations

import argparse
import gc
import threading
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from benchmarks.studies.tab import Tab, wait_for
from benchmarks.studies.tables import head, line
from kinreach._checks import Floats
from kinreach.cli import Parser, finish
from kinreach.robots import PUBLISHED_CALIBRATIONS
from kinreach.view._cli import setup_of
from kinreach.view._server import Server

PROG = "python -m benchmarks.studies.page"
CALIBRATION = PUBLISHED_CALIBRATIONS["ur5_a"]
PORT = 8700
#: How far a drag goes from one message to the next [m].
STEP = 0.004
#: All targets are in this box in front of the UR5 [m].
LOW, HIGH = np.array([0.25, -0.45, -0.15]), np.array([0.75, 0.45, 0.45])


def drags(arm: str, calibration: Path | None, count: int) -> Floats:
    """Seconds from the message of a dragged target to the answer's being on its way, with all postures, shape (count,).

    The target wanders through the space over the table, its tool pointing down.
    """
    server = Server(setup_of(arm, calibration=None if calibration is None else str(calibration)), port=PORT)
    rng, seconds = np.random.default_rng(0), []
    try:
        with Tab(server) as tab:
            panel = tab.page.target
            position, way = (LOW + HIGH) / 2, rng.normal(size=3)
            for _ in range(count):
                way = 0.9 * way + 0.4 * rng.normal(size=3)
                position = np.clip(position + STEP * way / np.linalg.norm(way), LOW, HIGH)
                panel.draw_s = 0.0
                tab.drag("/target/goal", position)
                wait_for(lambda: panel.draw_s)
                seconds.append(panel.draw_s)
    finally:
        server.stop()
    return np.array(seconds)


def tabs(count: int, *, every: int) -> list[tuple[int, float, int]]:
    """Memory [MB] and threads of this process after so many tabs, each opened, used in all its parts, and closed."""
    server = Server(setup_of("ur5-thesis", calibration=str(CALIBRATION), simple=True), port=PORT)
    process, found = psutil.Process(), []
    try:
        for number in range(1, count + 1):
            with Tab(server) as tab:
                target = tab.page.target
                target.draw_s = 0.0
                tab.drag("/target/goal", target.T[:3, 3] + (0.05, 0.05, 0.0))
                wait_for(lambda target=target: target.draw_s)
                tab.page.show("Real arm")
                panel: Any = tab.page.show("Episodes")
                wait_for(lambda panel=panel: panel.playing)
                tab.page.show("Results")
            wait_for(lambda: not server.pages)
            del tab, target, panel
            if number % every == 0:
                gc.collect()
                found.append((number, process.memory_info().rss / 1e6, threading.active_count()))
    finally:
        server.stop()
    return found


def main(argv: list[str] | None = None) -> int:
    """Print both tables as Markdown."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drags", type=int, default=300, metavar="N", help="default: %(default)s")
    parser.add_argument("--tabs", type=int, default=25, metavar="N", help="default: %(default)s")
    arguments = parser.parse_args(argv)
    print(head("arm", "drags", "median, ms", "p95, ms", "slowest, ms"))
    for name, calibration in (("UR5 by its data sheet", None), ("UR5 calibrated", CALIBRATION)):
        seconds = 1e3 * drags("ur5-thesis", calibration, arguments.drags)
        median, p95 = np.quantile(seconds, (0.5, 0.95))
        print(line(name, len(seconds), *(f"{value:.1f}" for value in (median, p95, seconds.max()))))
    print(f"\n{head('tabs opened, used and closed', 'memory, MB', 'threads')}")
    for number, memory, threads in tabs(arguments.tabs, every=5):
        print(line(number, f"{memory:.0f}", threads))
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
