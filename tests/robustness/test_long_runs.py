"""Long runs, shortened."""

from contextlib import nullcontext

import numpy as np
import pytest

from tests.cases import slow
from tools.endurance import long_runs
from tools.endurance.checks import CHECKS
from tools.endurance.outcome import BrokenPromiseError


@pytest.mark.parametrize(
    ("check", "rounds"),
    [*slow((long_runs.kinematic_steps, 4000)), (long_runs.dynamics_steps, 60), (long_runs.torque_steps, 600)],
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


@pytest.mark.parametrize("slack", [2**20, long_runs.SLACK, long_runs.KEPT])
def test_memory_is_held_to_the_slack_of_the_run(slack, monkeypatch):
    def usage(grown):
        held = iter([100 * 2**20] * (long_runs.PARTS - 1) + [100 * 2**20 + grown])
        again = iter([100 * 2**20] * long_runs.PARTS)
        return lambda: long_runs.Usage(next(held, None) or next(again), 5, 5)

    monkeypatch.setattr(long_runs.Usage, "now", usage(slack))
    steps = lambda: (float(i) for i in range(100))  # noqa: E731
    assert long_runs._endure(steps, 10, "steps", slack=slack).count == 20
    monkeypatch.setattr(long_runs.Usage, "now", usage(slack + 2**16))
    with pytest.raises(BrokenPromiseError, match="memory has grown"):
        long_runs._endure(steps, 10, "steps", slack=slack)


@pytest.mark.parametrize(
    ("runs", "passes"), [((100, 172, 172), True), ((100, 172, 244, 250), True), ((100, 172, 244, 316), False)]
)
def test_only_what_every_run_leaves_behind_is_a_leak(runs, passes, monkeypatch):
    held = (run * 2**20 for run in runs for _ in range(long_runs.PARTS))
    monkeypatch.setattr(long_runs.Usage, "now", lambda: long_runs.Usage(next(held), 5, 5))
    with nullcontext() if passes else pytest.raises(BrokenPromiseError, match="every run leaves memory behind"):
        long_runs._endure(lambda: (float(i) for i in range(100)), 10, "steps")
    assert next(held, None) is None


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
    assert len(CHECKS) >= 14
    assert all(1 <= check.quick <= check.full for check in CHECKS.values())
    kills = sum(
        check.full for name, check in CHECKS.items() if name in ("kill-training", "kill-off-policy", "kill-comparison")
    )
    assert kills >= 50
