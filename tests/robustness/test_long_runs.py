"""Long runs, shortened; and digests of results, which are to be the same wherever they are computed."""

import sys

import numpy as np
import pytest

from tools import digest
from tools.endurance import long_runs
from tools.endurance.checks import CHECKS
from tools.endurance.outcome import BrokenPromiseError


@pytest.mark.parametrize(
    ("check", "rounds"),
    [(long_runs.kinematic_steps, 4000), (long_runs.dynamics_steps, 60), (long_runs.torque_steps, 600)],
)
def test_memory_stays_flat_and_a_seed_means_the_same_twice(check, rounds):
    assert check(rounds).count == 2 * rounds


@pytest.mark.slow
@pytest.mark.usefixtures("needs_gl")
@pytest.mark.parametrize(("check", "rounds"), [(long_runs.camera_resets, 40), (long_runs.graphics_contexts, 10)])
def test_cameras_give_everything_back(check, rounds):
    assert check(rounds).count == 2 * rounds


def test_a_leak_is_found():
    kept = []

    def leak():
        while True:
            kept.append(np.ones(9 * 2**19))  # 36 MiB, more than the allocator keeps in stock
            yield kept[-1][:1]

    with pytest.raises(BrokenPromiseError, match="memory has grown"):
        long_runs._endure(leak, 10, "steps")


def test_an_open_handle_is_found(tmp_path):
    kept = []

    def leak():
        while True:
            kept.append((tmp_path / "file").open("w"))
            yield 0.0

    with pytest.raises(BrokenPromiseError, match="handles"):
        long_runs._endure(leak, 20, "steps")
    for file in kept:
        file.close()


def test_drift_is_found():
    state = 0

    def drift():
        nonlocal state
        while True:
            state += 1
            yield float(state > 33)

    with pytest.raises(BrokenPromiseError, match="differ in part 7"):
        long_runs._endure(drift, 20, "steps")


def test_every_check_has_a_quick_version():
    assert len(CHECKS) >= 12
    assert all(1 <= check.quick <= check.full for check in CHECKS.values())
    kills = sum(
        check.full for name, check in CHECKS.items() if name in ("kill-training", "kill-off-policy", "kill-comparison")
    )
    assert kills >= 50


@pytest.mark.parametrize("name", ["forward", "closed_form", "arm3", "moves", "policies"])
def test_digests_repeat(name):
    first, again = (digest.digests(digest.RESULTS[name]) for _ in range(2))
    assert first == again
    assert first[2] > 100


def test_digests_tell_results_apart(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(digest, "RESULTS", {"one": lambda: iter([[1.0, 2.0]]), "two": lambda: iter([[3.0]])})
    monkeypatch.setattr(sys, "argv", ["digest"])
    assert digest.main() == 0
    (tmp_path / "known").write_text(capsys.readouterr().out)
    monkeypatch.setattr(sys, "argv", ["digest", "--check", str(tmp_path / "known")])
    assert digest.main() == 0
    assert capsys.readouterr().out.count("same bits") == 2
    for changed, code, verdict in ((3.0 + 1e-13, 0, "same to 1e-9"), (3.0 + 1e-6, 1, "DIFFERENT")):
        monkeypatch.setitem(digest.RESULTS, "two", lambda changed=changed: iter([[changed]]))
        assert digest.main() == code
        assert verdict in capsys.readouterr().out
