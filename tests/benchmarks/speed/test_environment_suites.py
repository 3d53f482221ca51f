"""The suites of environments and training, with as little of everything as there can be."""

from __future__ import annotations

import contextlib
import re
import sys
from collections import Counter

import numpy as np
import pytest

from benchmarks.speed.measure import Timings
from benchmarks.speed.peers.gym_child import learning_seconds
from benchmarks.speed.peers.gym_peer import PANDA, REACHER
from benchmarks.speed.sections import Options
from benchmarks.speed.suites import env, episodes, train
from benchmarks.speed.tables import median_rates, rate_row, short_of_cores, time_row
from kinreach.errors import DrawingError, KinreachError

TINY = Options(rounds=1, quick=True, seed=3)


@pytest.fixture
def no_peers(monkeypatch, tmp_path):
    """Peers that do not start."""
    for peer in (PANDA, REACHER):
        monkeypatch.setenv(peer.variable, str(tmp_path / "nowhere"))


class TestEnvironments:
    @pytest.fixture
    def tiny(self, monkeypatch):
        monkeypatch.setattr(env, "QUICK", env.Amounts(0.01, 2, 1))
        monkeypatch.setattr(env, "KINEMATIC", 8)
        monkeypatch.setattr(episodes, "QUICK", 4)

    @pytest.mark.slow
    def test_sections(self, checked, tiny, no_peers):
        told = []
        steps, dynamics, resets = checked(env.run(TINY, lambda *what: told.append(what)))
        names = [row[0] for row in steps.rows]
        assert len(names) == len(set(names)) == 12
        assert sum("thread" in str(name) for name in names) == 4
        assert all(row[1] > 0 and row[2] > 0 and row[3] is None for row in steps.rows)
        assert set(steps.missing) == {"PandaReach-v3", "Reacher-v5"}
        assert steps.targets == []  # there is nothing to compare with
        assert [row[0] for row in dynamics.rows][-2:] == [episodes.REACHING, episodes.RANDOM]
        assert len(resets.rows) + len(resets.missing) == 3
        assert {what for what, *_ in told} == {"steps of environments", "episodes under dynamics", "resets"}

    def test_what_is_opened_is_closed(self, tiny, no_peers, monkeypatch):
        made, closed = Counter(), Counter()
        for name in ("make", "make_vec"):
            monkeypatch.setattr(env.gym, name, _noted(getattr(env.gym, name), made, closed))
        monkeypatch.setattr(env, "interleaved", lambda *args, **settings: Timings())
        env._steps(TINY, lambda *what: None)
        assert made == {"make": 5, "make_vec": 7}
        assert set(closed) == set(range(12))

    def test_resets_close_also_what_cannot_be_drawn(self, tiny, monkeypatch):
        made, closed = Counter(), Counter()
        make = _noted(env.gym.make, made, closed)

        def refusing(task, **settings):
            made_env = make(task, **settings)
            if settings:
                monkeypatch.setattr(made_env, "reset", _refuse)
            return made_env

        monkeypatch.setattr(env.gym, "make", refusing)
        section = env._resets(TINY, lambda *what: None)
        assert len(section.missing) == 2
        assert [row[0] for row in section.rows] == ['observation="geometric"']
        assert set(closed) == {0, 1, 2}

    def test_ratio_to_the_peer(self):
        timings = Timings()
        timings |= {PANDA.name: np.array([1.0, 4.0, 9.0]), "ours": np.array([1e-3, 2e-3, 1e-3])}
        (target,) = env._times_panda(timings, {"task": "ours"})
        assert target.measured == pytest.approx(2000)
        assert target.met

    def test_without_stable_baselines3(self, monkeypatch):
        monkeypatch.setitem(sys.modules, "kinreach.baselines._vec_envs", None)
        missing: dict[str, str] = {}
        assert env._learners_batch(contextlib.ExitStack(), 0, 1, missing) == []
        assert list(missing) == ["stable-baselines3"]

    def test_a_batch_that_does_something_else_is_no_result(self, tiny, monkeypatch):
        monkeypatch.setattr(episodes, "batched", lambda simulation, targets: targets[:, :3])
        with pytest.raises(KinreachError, match="does not do what"):
            episodes.section(TINY, lambda *what: None, "again")

    def test_the_target_is_judged_on_the_environment(self, checked, tiny):
        (section,) = checked([episodes.section(TINY, lambda *what: None, "python -m benchmarks.speed --suite env")])
        rows = {row[0]: row for row in section.rows}
        assert list(rows) == [episodes.LOOP, *episodes.BATCHES.values(), episodes.REACHING, episodes.RANDOM]
        (target,) = section.targets
        assert (target.bound, target.kind, target.measured) == (500, "at least", rows[episodes.REACHING][1])
        assert "of which 100 % reached the goal" in section.text
        assert re.search(r"\d+ % were impossible", section.text)
        assert re.search(r"tool-down [\d.]+ s and [\d.]+ ms; .*random, impossible [\d.]+ s and ", section.text)

    def test_an_environment_that_does_something_else_is_no_result(self, tiny, monkeypatch):
        monkeypatch.setattr(episodes, "episode", lambda env, goals, actions: {"distance": np.ones(len(goals))})
        with pytest.raises(KinreachError, match="the environment does not do what"):
            episodes.section(TINY, lambda *what: None, "again")

    def test_how_long_moves_take(self):
        """Simulated times beside those of a loop; the text has only the kinds of moves that there were."""
        targets = episodes.goals_and_targets(3, 5)[1]
        loop = episodes.ArmSimulation("ur5")
        wanted = []
        for target in targets:
            loop.reset()
            wanted.append(loop.move(target).duration)
        batch = episodes.BatchSimulation("ur5", 4)
        took, processor = episodes.cost(batch, targets)
        assert took == pytest.approx(np.mean(wanted), rel=1e-12)
        assert 0 < processor < 10
        said = episodes._costs(batch, {"a": targets, "none": targets[:0]})
        assert said.startswith(f"a {took:.2f} s and ")
        assert "none" not in said

    def test_goals_are_reached_from_above(self):
        goals, targets = episodes.goals_and_targets(16, 5)
        kinematics = episodes.UR5Kinematics(tip="tcp", base="world")
        T = kinematics.fk(targets)
        np.testing.assert_allclose(T[:, :3, 3], goals, atol=1e-9)
        np.testing.assert_allclose(T[:, :3, 2] @ episodes.TOOL_DOWN, 1.0, atol=1e-9)


def _noted(make, made, closed):
    """`make` of Gymnasium that counts what it makes, and notes which of it is closed."""

    def noting(*args, **kwargs):
        number = made.total()
        made[make.__name__] += 1
        opened = make(*args, **kwargs)
        close = opened.close

        def closing(*args, **kwargs):
            closed[number] += 1
            close(*args, **kwargs)

        opened.close = closing
        return opened

    return noting


def _refuse(**settings):
    raise DrawingError("no OpenGL")


class TestRates:
    def timings(self) -> Timings:
        timings = Timings()
        timings |= {"a": np.array([0.5, 0.25, 0.25]), "b": np.array([1.0, 1.0, 2.0])}
        timings.cores |= {"a": 1.93, "b": 0.5}
        return timings

    def test_row(self):
        assert rate_row("a", self.timings(), ("b", "nobody")) == ["a", 4.0, 2.0, 4.0, None, 1.93]
        assert rate_row("b", self.timings(), note="elsewhere")[-1] == "elsewhere"
        assert median_rates(self.timings()) == {"a": 4.0, "b": 1.0}
        assert time_row("a", self.timings(), 0.5) == ["a", 0.5, 1.0, 1.93]

    def test_busy_machine(self):
        assert short_of_cores(self.timings(), "a", 2) == ""
        assert short_of_cores(self.timings(), "b", 1) == "the machine was busy: of 1 core the measurement had 0.50"
        assert "of 2 cores" in short_of_cores(self.timings(), "b", 2)


class TestTraining:
    def test_rows(self, checked, no_peers, monkeypatch):
        monkeypatch.setattr(train, "QUICK_ACTIONS", 2048)
        (section,) = checked(train.run(TINY, lambda *what: None))
        assert [row[0] for row in section.rows] == [train.RECIPE, train.BATCH]
        assert set(section.missing) == {PANDA.name}
        for row in section.rows:
            cells = dict(zip(section.columns, row, strict=True))
            assert cells["actions"] == 2048
            assert cells[f"x {PANDA.name}"] is None
            assert 0 < cells["actions/s, worst round"] <= cells["actions/s, median"]
            shares = [cells[f"{part} [%]"] for part in (*train.PARTS, "rest")]
            assert sum(shares) == pytest.approx(100)
            assert min(shares) > 0

    def test_peer_in_the_table(self):
        ours = {"actions": 100.0, "wall": 1.0, "processor": 1.0, "environment": 0.25, "choosing": 0.25, "updating": 0.5}
        theirs = {**ours, "actions": 10.0, "wall": 2.0}
        slower = {**ours, "wall": 4.0, "environment": 1.0, "choosing": 1.0, "updating": 2.0}
        rows = train._rows({train.BATCH: [ours, slower, ours], train.PEER: [theirs] * 3})
        assert rows[0] == [train.BATCH, 100, 100.0, 25.0, 20.0, 25.0, 25.0, 50.0, 0.0, 1.0, 1.0]
        assert rows[1][2:5] == [5.0, 5.0, 1.0]

    def test_rest_is_taken_round_by_round(self):
        """In no round do the parts take longer than the whole; their medians do, together."""
        part = dict(zip(train.PARTS, (0.2, 0.2, 0.6), strict=True))
        rounds = [{**part, train.PARTS[i]: part[train.PARTS[i]] - 0.1} for i in range(3)]
        rows = train._rows({train.BATCH: [{"actions": 1.0, "wall": 1.0, "processor": 1.0, **each} for each in rounds]})
        assert rows[0][5:9] == pytest.approx([20.0, 20.0, 60.0, 10.0])

    def test_without_torch(self, monkeypatch):
        monkeypatch.setitem(sys.modules, "torch", None)
        (section,) = train.run(TINY, lambda *what: None)
        assert section.rows == []
        assert list(section.missing) == ["stable-baselines3"]

    def test_parts_of_learning_add_up(self):
        class Clocked:
            """A model and its environment, of which the times are known to be ordered."""

            num_timesteps = 12

            def reset(self):
                return 0

            def step_wait(self):
                return sum(range(30_000))

            def collect_rollouts(self):
                return [self.step_wait() for _ in range(4)]

            def train(self):
                return sum(range(60_000))

            def learn(self, steps, log_interval):
                assert (steps, log_interval) == (12, None)
                self.reset()
                for _ in range(3):
                    self.collect_rollouts()
                    self.train()

        both = Clocked()
        took = learning_seconds(both, both, 12)
        parts = [took[part] for part in ("environment", "choosing", "updating")]
        assert min(parts) > 0
        assert took["environment"] > took["choosing"]
        assert sum(parts) <= took["wall"]
        assert took["actions"] == 12
