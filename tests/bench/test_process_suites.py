"""The suites that start processes: imports, the comparison, and growth with its memory."""

from __future__ import annotations

import json
import sys
from importlib import resources
from pathlib import Path

import pytest

from kinreach.bench.child import ChildRun
from kinreach.bench.suite import Options
from kinreach.bench.suites import compare, growth, startup

TINY = Options(rounds=1, quick=True, seed=3)


class TestStartup:
    @pytest.fixture(autouse=True)
    def few(self, monkeypatch):
        monkeypatch.setattr(startup, "PROGRAMS", (startup.PYTHON, startup.GYMNASIUM, startup.OURS, startup.KINEMATICS))
        monkeypatch.setattr(startup, "STARTS", 1)
        monkeypatch.setattr(startup, "OBSERVATIONS", 3)

    def test_sections(self, checked):
        imports, decisions = checked(startup.run(TINY, lambda *what: None))
        bare, _, ours, kinematics = imports.rows
        programs = ["pass", "import gymnasium", "import kinreach", "import kinreach.kinematics"]
        assert [row[0] for row in imports.rows] == [f"`{program}`" for program in programs]
        assert bare[4] == 0.0
        if sys.platform == "linux":
            assert bare[5] < ours[5] < kinematics[5]  # each holds what the one before it holds, and more
        assert [(target.bound, target.unit) for target in imports.targets] == [(0.3, "s"), (0.8, "s")]
        assert [row[0] for row in decisions.rows] == list(startup.POLICIES)
        assert decisions.targets[0].bound == 50
        assert decisions.targets[0].measured == decisions.rows[0][1]

    def test_busy(self):
        assert startup._busy([ChildRun(1.0, 0.95, "")]) == ""
        assert "40 %" in startup._busy([ChildRun(1.0, 0.4, ""), ChildRun(2.0, 0.8, "")])


class TestCompare:
    def fake(self, monkeypatch, processor: float) -> list[list[str]]:
        """A comparison that was done in 80 s."""
        started: list[list[str]] = []

        def run_child(arguments: list[str]) -> ChildRun:
            started.append(arguments)
            median = {"median": 0.25, "p95": 0.5}
            methods = [
                {"name": name, "solve_ms": median, "accept_ms": median, "iterations": median} for name in ("a", "b")
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
        schema = resources.files("kinreach.compare") / "results.schema.json"
        kinds = json.loads(schema.read_text(encoding="utf-8"))["$defs"]
        required = {*kinds["method"]["required"], *kinds["reach"]["required"]}
        assert {"name", "solve_ms", "accept_ms", "iterations"} <= required


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
