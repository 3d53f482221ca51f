"""The comparison from its command line: how long it takes, and how long its methods take to decide."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

from benchmarks.speed.child import run_child
from benchmarks.speed.sections import Cell, Chart, Options, Progress, Section, Target
from benchmarks.speed.suites import PROFILED
from kinreach.compare._runner import DEFAULT_GOALS

AGAIN = "python -m benchmarks.speed --suite compare"
#: Goals with `--quick`, for which the target does not hold; and the longest that the default may take [s].
QUICK_GOALS, LONGEST = 5, 90.0

TEXT = """\
`python -m kinreach.compare --goals {goals}`, once, from the start of its process to its end: {wall:.1f} s, of which the
processor worked {processor:.1f} s. The table has the time that a method takes to decide where to move, and how much of
it are the acceptance tests. For a policy of many steps it is the sum over its decisions. Each decision is on one
thread.

Methods take turns on every goal; what they decide is then simulated.

{profiled}: of 20 goals (`cProfile`), a trial took 8 ms, simulated moves included. The rest is the same for any number
of goals. Most of it was the report's pictures of the scene (in software on a machine without a graphics card), then
the diagrams, and imports."""
UNJUDGED = "\n\nThe target is for {goals} goals: without `--quick`."


def run(options: Options, progress: Progress) -> list[Section]:
    """Measure (`benchmarks.speed.suites.Run`)."""
    goals = QUICK_GOALS if options.quick else DEFAULT_GOALS
    progress(f"the comparison on {goals} goals", 0, 1)
    with tempfile.TemporaryDirectory() as folder:
        command = ["-m", "kinreach.compare", "--goals", str(goals), "--seed", str(options.seed), "--out", folder]
        done = run_child(command)
        methods = json.loads((Path(folder) / "results.json").read_text(encoding="utf-8"))["methods"]
    progress(f"the comparison on {goals} goals", 1, 1)
    rows: list[list[Cell]] = [
        [m["name"], m["solve_ms"]["median"], m["solve_ms"]["p95"], m["accept_ms"]["median"], m["iterations"]["median"]]
        for m in methods
    ]
    medians = {m["name"]: m["solve_ms"]["median"] for m in methods}
    decided = {name: float(median) for name, median in medians.items() if median is not None}
    text = TEXT.format(goals=goals, wall=done.wall, processor=done.processor, profiled=PROFILED)
    targets = []
    if options.quick:
        text += UNJUDGED.format(goals=DEFAULT_GOALS)
    else:
        what = f"the default comparison, {goals} goals and {len(methods)} methods"
        targets.append(Target(what, LONGEST, "at most", done.wall, "s", _busy(done.wall, done.processor)))
    return [
        Section(
            title="The comparison",
            text=text,
            columns=("method", "decision, median [ms]", "p95 [ms]", "tests, median [ms]", "iterations, median"),
            rows=rows,
            again=AGAIN,
            targets=targets,
            charts=[Chart("time to decide", bars=decided, x="ms")],
            samples={"wall per goal": [done.wall / goals], "processor per goal": [done.processor / goals]},
        )
    ]


def _busy(wall: float, processor: float) -> str:
    return "" if processor > 0.9 * wall else f"the machine was busy: of {wall:.1f} s the comparison had {processor:.1f}"
