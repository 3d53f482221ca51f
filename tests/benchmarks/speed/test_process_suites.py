"""The suites that start processes: imports, the comparison, and growth with its memory."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.speed.child import ChildRun
from benchmarks.speed.measure import Timings
from benchmarks.speed.sections import Options
from benchmarks.speed.suites import compare, growth, startup
from kinreach.compare._task import get_task

TINY = Options(rounds=1, quick=True, seed=3)


class TestStartup:
    @pytest.fixture(autouse=True)
    def few(self, monkeypatch):
        monkeypatch.setattr(
            startup, "PROGRAMS", (startup.PYTHON, startup.NUMPY, startup.GYMNASIUM, startup.OURS, startup.KINEMATICS)
        )
        monkeypatch.setattr(startup, "STARTS", 1)
        monkeypatch.setattr(startup, "OBSERVATIONS", 3)

    def test_sections(self, checked):
        imports, decisions = checked(startup.run(TINY, lambda *what: None))
        bare, _, _, ours, kinematics = imports.rows
        programs = ["pass", "import numpy", "import gymnasium", "import kinreach", "import kinreach.kinematics"]
        assert [row[0] for row in imports.rows] == [f"`{program}`" for program in programs]
        assert bare[4] == 0.0
        if sys.platform == "linux":
            assert bare[5] < ours[5] < kinematics[5]  # each holds what the one before it holds, and more
        assert [(target.bound, target.unit) for target in imports.targets] == [(0.3, "s"), (0.8, "s")]
        assert [row[0] for row in decisions.rows] == list(startup.POLICIES)
        assert all(row[4] > 0 for row in decisions.rows)
        assert decisions.targets[0].bound == 50
        assert decisions.targets[0].measured == decisions.rows[0][1]

    def test_shares_are_of_what_our_import_adds(self):
        timings = Timings()
        for code, seconds in (
            (startup.PYTHON, 1.0),
            (startup.NUMPY, 2.0),
            (startup.GYMNASIUM, 4.0),
            (startup.OURS, 5.0),
        ):
            timings[f"`{code}`"] = np.array([seconds, 10 * seconds, seconds])
        assert startup._share(timings, startup.NUMPY) == 25.0
        assert startup._share(timings, startup.GYMNASIUM) == 75.0

    def test_busy(self):
        assert startup._busy([ChildRun(1.0, 0.95, "")]) == ""
        assert "40 %" in startup._busy([ChildRun(1.0, 0.4, ""), ChildRun(2.0, 0.8, "")])


class TestCompare:
    def fake(self, monkeypatch, processor: float, *, first: float | None = 0.25) -> list[list[str]]:
        """A comparison that was done in 80 s, with the median time of its first method."""
        started: list[list[str]] = []

        def run_child(arguments: list[str]) -> ChildRun:
            started.append(arguments)
            median = {"median": 0.25, "p95": 0.5}
            methods = [
                {"name": name, "solve_ms": {"median": time, "p95": 0.5}, "accept_ms": median, "iterations": median}
                for name, time in (("a", first), ("b", 0.25))
            ]
            folder = Path(arguments[arguments.index("--out") + 1])
            (folder / "results.json").write_text(json.dumps({"methods": methods}), encoding="utf-8")
            return ChildRun(80.0, processor, "")

        monkeypatch.setattr(compare, "run_child", run_child)
        return started

    def test_default_is_judged(self, checked, monkeypatch):
        started = self.fake(monkeypatch, 79.0)
        (section,) = checked(compare.run(Options(rounds=3, seed=3), lambda *what: None))
        assert len(started) == 1
        assert started[0][:6] == ["-m", "kinreach.compare", "--goals", "200", "--seed", "3"]
        assert section.rows == [["a", 0.25, 0.5, 0.25, 0.25], ["b", 0.25, 0.5, 0.25, 0.25]]
        (target,) = section.targets
        assert (target.bound, target.measured, target.met, target.why) == (90.0, 80.0, True, "")

    @pytest.mark.parametrize(("first", "bars"), [(None, {"b": 0.25}), (0.0, {"a": 0.0, "b": 0.25})])
    def test_what_was_not_timed_has_no_bar(self, checked, monkeypatch, first, bars):
        self.fake(monkeypatch, 79.0, first=first)
        (section,) = checked(compare.run(TINY, lambda *what: None))
        assert section.rows[0][1] == first
        assert section.charts[0].bars == bars

    def test_busy_machine_is_told(self, monkeypatch):
        self.fake(monkeypatch, 40.0)
        (section,) = compare.run(Options(), lambda *what: None)
        assert "busy" in section.targets[0].why

    def test_few_goals_are_not_judged(self, checked, monkeypatch):
        started = self.fake(monkeypatch, 79.0)
        (section,) = checked(compare.run(TINY, lambda *what: None))
        assert started[0][3] == str(compare.QUICK_GOALS)
        assert section.targets == []
        assert "without `--quick`" in section.text

    def test_results_have_what_is_read(self):
        keys = {column.key for column in get_task("ur5").columns}
        assert {"solve_ms", "accept_ms", "iterations"} <= keys


class TestGrowth:
    @pytest.fixture(autouse=True)
    def few(self, monkeypatch):
        self.asked: list[str] = []
        sizes = {growth.POSES: (1, 50), growth.ENVIRONMENTS: (1, 5), growth.SIMULATIONS: (1, 3)}
        monkeypatch.setattr(growth, "QUICK", sizes)
        monkeypatch.setattr(growth, "LAP", 0.001)
        monkeypatch.setattr(growth, "peak_memory", self.peak_memory)

    def peak_memory(self, code: str) -> float:
        """The program is run here, where nothing has to be loaded for it."""
        self.asked.append(code)
        exec(compile(code, "growth", "exec"), {})
        return float(len(self.asked))

    def test_sections(self, checked):
        poses, environments, dynamics = checked(growth.run(TINY, lambda *what: None))
        assert [row[0] for row in poses.rows] == [1, 50]
        assert [row[0] for row in environments.rows] == [1, 5]
        assert [row[0] for row in dynamics.rows] == [1, 3]
        assert len(set(self.asked)) == 8  # of inverse and forward kinematics, and of each of the others
        assert all("{" not in code for code in self.asked)
        lines = poses.charts[0].lines
        assert {"IK", "FK"} <= set(lines)
        assert [x for x, _ in lines["IK"]] == [1.0, 50.0]
        assert set(dynamics.charts[0].lines) == {"one thread", "two threads"}
        for row in environments.rows:
            assert row[1] * row[2] == pytest.approx(1e6)
        assert all(f"{growth.PROFILED}" in section.text for section in (poses, environments, dynamics))
        assert "Each of them takes 2.5e+02 kB of memory." in environments.text  # 1 MB for four more

    def test_the_texts_say_what_the_run_said(self):
        timings = Timings()
        timings |= {f"IK {n}": np.array([time]) for n, time in ((1, 9.0), (10, 2.0), (100, 3.0))}
        assert growth._cheapest(timings, (1, 10, 100), "IK") == 10
        assert growth._memory((1, 101), [140.0, 141.0]) == " Each of them takes 10 kB of memory."
        assert growth._memory((1, 101), [None, None]) == ""

    def test_an_empty_cell_of_the_peer_is_explained(self):
        timings = Timings()
        timings |= {"EAIK 10": np.array([1e-5]), "EAIK 100": np.array([8e-6])}
        said = growth._blank(timings, (10, 100, 1000))
        assert "with up to 100 poses" in said
        assert "a single call with 1000 would take 0.008 s" in said
        assert growth._blank(timings, (10, 100)) == growth._blank(Timings(), (10, 100)) == ""

    def test_environments_are_closed(self, monkeypatch):
        closed = []
        make = growth.gym.make_vec

        def noting(*args, num_envs, **kwargs):
            batch = make(*args, num_envs=num_envs, **kwargs)
            close = batch.close
            batch.close = lambda: (closed.append(num_envs), close())
            return batch

        monkeypatch.setattr(growth.gym, "make_vec", noting)
        monkeypatch.setattr(growth, "peak_memory", lambda code: None)
        growth._environments(TINY, lambda *what: None)
        assert sorted(closed) == [1, 5]

    def test_without_eaik(self, monkeypatch):
        monkeypatch.setitem(sys.modules, "eaik.IK_HP", None)
        section = growth._poses(TINY, lambda *what: None)
        assert list(section.missing) == ["EAIK"]
        assert all(row[2] is None and row[4] is None for row in section.rows)
        assert set(section.charts[0].lines) == {"IK", "FK"}

    def test_sizes(self):
        for sizes in (growth.POSES, growth.ENVIRONMENTS, growth.SIMULATIONS):
            assert growth._sizes(sizes, Options()) == sizes
        assert growth.POSES[-1] == 1_000_000
        assert growth.ENVIRONMENTS[-1] == 65_536
        assert growth.SIMULATIONS[-1] == 512
