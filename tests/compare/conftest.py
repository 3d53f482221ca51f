"""Trials made up for tests of what is done with trials."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from kinreach.compare.trials import Trial

TrialFactory = Callable[..., list[Trial]]

_GOOD = Trial(
    goal=0,
    method="closed-form",
    x=0.4,
    y=-0.1,
    z=-0.175,
    reached=True,
    impossible=False,
    status="completed",
    reason="",
    distance=0.0015,
    posture_error=0.002,
    reward=20.0,
    ik_error=1e-12,
    iterations=0,
    restarts=0,
    candidates=1,
    solve_s=2e-4,
    accept_s=1e-4,
    move_s=1.25,
    q=(0.1, -1.5, 1.5, -1.5, -1.5, 0.0),
)


@pytest.fixture
def make_trials() -> TrialFactory:
    """`make_trials(n, **values)`: good trials on goals 0 … n - 1, but for the given values."""
    return lambda count, **values: [replace(_GOOD, goal=index, **values) for index in range(count)]


@pytest.fixture
def impossible() -> Trial:
    """A trial in which no posture was found."""
    nothing = {"q": None, "move_s": None, "reached": False, "reward": -100.0}
    return replace(_GOOD, impossible=True, status="out of reach", reason="too far", distance=0.5, **nothing)
