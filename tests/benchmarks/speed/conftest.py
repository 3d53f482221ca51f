"""What the tests of the benchmark share: suites that take no time, and a check of what real ones return."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

import pytest

from benchmarks.speed.sections import Chart, Section, Target
from benchmarks.speed.suites import SUITES

CHARTS = [
    Chart("bars", bars={"ours": 1.0, "theirs": 20.0}, x="us", peers=["theirs"]),
    Chart("lines", lines={"ours": [(1.0, 3.0), (10.0, 0.1)]}, x="poses", y="us"),
]


@pytest.fixture
def checked() -> Callable[[list[Section]], list[Section]]:
    """Passes sections on whose rows fit, and that JSON gives back as they were."""

    def check(sections: list[Section]) -> list[Section]:
        for section in sections:
            assert section.rows
            assert all(len(row) == len(section.columns) for row in section.rows)
            assert section.again.startswith("python -m benchmarks.speed --suite ")
            assert Section.from_json(json.loads(json.dumps(section.to_json()))) == section
        return sections

    return check


@pytest.fixture
def suites(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, Any]]:
    """Three suites in place of the real ones: what they run, which of them were played, whether they draw charts."""
    fake: dict[str, Any] = {"runs": {}, "played": [], "charts": False}

    def make(name: str) -> Callable:
        def run(options, progress):
            fake["played"].append(name)
            progress("measuring", 1, 1)
            return [_section(name, seed=options.seed, charts=fake["charts"])]

        return run

    real = dict(SUITES)
    SUITES.clear()  # the dictionary itself, which other modules have imported
    for name in ("one", "two", "three"):
        fake["runs"][name] = make(name)
        module = ModuleType(f"benchmarks.speed.suites.{name}")
        module.run = lambda options, progress, name=name: fake["runs"][name](options, progress)
        monkeypatch.setitem(sys.modules, module.__name__, module)
        SUITES[name] = f"suite {name}"
    yield fake
    SUITES.clear()
    SUITES.update(real)


def _section(title: str, *, seed: int = 0, charts: bool = True) -> Section:
    return Section(
        title=f"Section {title}",
        text="Measured with care.",
        columns=("contender", "us", "x theirs", "of the rounds"),
        rows=[
            ["ours", 1.23456, 0.5, "0.4 ... 0.6"],
            ["theirs|they", 12345.6, None, None],
            ["seed", seed, 1, ""],
        ],
        again=f"python -m benchmarks.speed --suite {title}",
        targets=[
            Target(f"{title}, time", 1.0, "at most", 0.5, "x theirs"),
            Target(f"{title}, rate", 10.0, "at least", 8.0, "steps/s", "MuJoCo's step is 90 % of it"),
        ],
        missing={"absent": "not installed (no module absent)"},
        charts=CHARTS if charts else [],
        samples={"ours": [1e-6, 2e-6]},
    )
