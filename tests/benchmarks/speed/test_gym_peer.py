"""Peers in processes of their own: the protocol, and every way in which a peer can be missing."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import pytest

from benchmarks.speed.peers.gym_child import play, random_actions, serve
from benchmarks.speed.peers.gym_peer import PANDA, REACHER, GymPeer, PeerEnvironment, gym_peers
from kinreach.errors import InstallationError

EPISODE = 3
MODULE = f"""
import os, gymnasium
print("a library that greets on standard output", flush=True)
os.write(1, b"and one that does so in C\\n")
class Fake(gymnasium.Env):
    action_space = gymnasium.spaces.Box(-1, 1, (2,))
    observation_space = gymnasium.spaces.Box(-1, 1, (3,))
    left = 0
    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.left = {EPISODE}
        return self.observation_space.sample(), {{}}
    def step(self, action):
        if self.left == 0 or os.path.exists("broken"):
            raise RuntimeError("cannot step")
        self.left -= 1
        return self.observation_space.sample(), 1.0, False, self.left == 0, {{}}
gymnasium.register("Fake-v0", entry_point=Fake)
"""
FAKE = PeerEnvironment("Fake-v0", "fake_peer", ("numpy", "no-such-package"), "KINREACH_BENCH_PYTHON_FAKE")


@pytest.fixture
def fake(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> PeerEnvironment:
    """A peer that kinreach's own Python finds."""
    (tmp_path / "fake_peer.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.delenv(FAKE.variable, raising=False)
    return FAKE


def other_python(folder: Path, monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    """A program that is started instead of a Python."""
    path = folder / "python"
    path.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
    path.chmod(0o755)
    monkeypatch.setenv(FAKE.variable, str(path))


class TestProtocol:
    def test_plays_and_says_what_it_is(self, fake):
        with GymPeer(fake) as peer:
            python = ".".join(map(str, sys.version_info[:3]))
            assert peer.description.startswith("numpy ")
            assert peer.description.endswith(f", no-such-package None, Python {python}")
            times = [peer.play(steps) for steps in (1, 10, 100)]
            assert all(0 < seconds < 60 for seconds in times)

    def test_a_step_that_fails_is_told_and_the_peer_goes_on(self, fake, tmp_path):
        with GymPeer(fake) as peer:
            (tmp_path / "broken").touch()
            with pytest.raises(InstallationError, match="RuntimeError: cannot step"):
                peer.play(5)
            (tmp_path / "broken").unlink()
            assert peer.play(5) > 0

    @pytest.mark.slow
    def test_trains(self, fake):
        settings = {"n_steps": 16, "batch_size": 16, "n_epochs": 1, "policy_kwargs": {"net_arch": [8]}}
        with GymPeer(fake) as peer:
            took = peer.ppo(64, 2, settings)
        assert took["actions"] == 64
        parts = [took[part] for part in ("environment", "choosing", "updating")]
        assert min(parts) > 0
        assert sum(parts) <= took["wall"]

    def test_the_process_ends_with_the_peer(self, fake):
        with GymPeer(fake) as peer:
            process = peer._process
            assert process.poll() is None
        assert process.returncode is not None
        with pytest.raises(ValueError, match="closed file"):
            peer.play(1)

    def test_a_peer_that_died_is_told(self, fake):
        with GymPeer(fake) as peer:
            peer._process.kill()
            peer._process.wait()
            with pytest.raises(InstallationError, match="the process of Fake-v0 ended"):
                peer.play(1)


class TestMissing:
    def test_module_that_is_not_there(self, fake, tmp_path):
        (tmp_path / "fake_peer.py").unlink()
        with gym_peers([fake]) as (peers, missing):
            assert peers == {}
        assert missing == {"Fake-v0": "ModuleNotFoundError: No module named 'fake_peer'"}

    def test_python_that_is_not_there(self, fake, tmp_path, monkeypatch):
        monkeypatch.setenv(fake.variable, str(tmp_path / "nowhere"))
        with gym_peers([fake]) as (peers, missing):
            assert peers == {}
        assert fake.variable in missing["Fake-v0"]
        assert "No such file" in missing["Fake-v0"]

    @pytest.mark.parametrize(
        ("script", "message"),
        [
            ("echo 'something broke' >&2; exit 3", "the process of Fake-v0 ended: something broke"),
            ("exit 3", "the process of Fake-v0 ended: exit 3"),
            ("echo 'no JSON'; exec sleep 60", "Fake-v0 answers b'no JSON'"),
            ("exec sleep 60", "Fake-v0 does not answer for 0.5 s"),
        ],
    )
    def test_process_that_is_no_peer(self, fake, tmp_path, monkeypatch, script, message):
        other_python(tmp_path, monkeypatch, script)
        start = time.monotonic()
        with pytest.raises(InstallationError, match=message):
            GymPeer(fake, start=0.5)
        assert time.monotonic() - start < 30  # it is not waited for

    def test_one_missing_does_not_keep_the_others(self, fake):
        absent = PeerEnvironment("Absent-v0", "no_such_module", (), "KINREACH_BENCH_PYTHON_ABSENT")
        with gym_peers([absent, fake]) as (peers, missing):
            assert list(peers) == ["Fake-v0"]
            assert peers["Fake-v0"].play(2) > 0
        assert list(missing) == ["Absent-v0"]


def test_another_python_gets_no_path_of_ours_and_one_thread(fake, tmp_path, monkeypatch):
    other_python(
        tmp_path,
        monkeypatch,
        'echo "{\\"python\\": \\"path=$PYTHONPATH threads=$OMP_NUM_THREADS\\", \\"versions\\": {}}"; exec sleep 60',
    )
    with GymPeer(fake) as peer:
        assert peer.description.endswith("path= threads=1")


def test_real_peers_are_there_or_named():
    with gym_peers([PANDA, REACHER]) as (peers, missing):
        assert set(peers) | set(missing) == {"PandaReach-v3", "Reacher-v5"}
        assert set(peers) & set(missing) == set()
        assert "Reacher-v5" in peers or os.environ.get(REACHER.variable)  # kinreach brings its packages
        assert all(peer.play(60) > 0 for peer in peers.values())  # beyond the end of an episode of 50 steps


class Counting:
    """An environment that ends every third step and counts."""

    def __init__(self) -> None:
        import gymnasium as gym

        self.action_space = gym.spaces.Discrete(5)
        self.steps: list[int] = []
        self.resets = 0

    def reset(self) -> None:
        self.resets += 1

    def step(self, action: int) -> tuple[int, float, bool, bool, dict]:
        self.steps.append(action)
        ends = len(self.steps) % EPISODE == 0
        return 0, 0.0, ends and len(self.steps) % 2 == 0, ends and len(self.steps) % 2 == 1, {}


def test_play_takes_the_actions_in_turn_and_resets_at_ends():
    env = Counting()
    actions = random_actions(env, 4)
    assert actions == random_actions(env, 4)
    assert actions != random_actions(env, 5)
    play(env, actions[:4], 20)
    assert env.steps == (actions[:4] * 5)
    assert env.resets == 20 // EPISODE


def test_serve_says_what_does_not_start():
    answers: list[dict] = []
    serve({"name": "X", "module": "no.such.module", "packages": [], "seed": 0}, iter([]), answers.append)
    assert answers == [{"error": "ModuleNotFoundError: No module named 'no'"}]
