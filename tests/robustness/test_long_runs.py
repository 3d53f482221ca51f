"""Long runs, shortened."""

import numpy as np
import pytest

from tests.cases import slow
from tools.endurance import long_runs
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


@pytest.mark.slow
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
