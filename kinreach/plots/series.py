"""From what a training run logged to what a figure shows. Pure functions on arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kinreach.checks import Floats, as_floats, check_count, shown
from kinreach.errors import InputError
from kinreach.plots.checks import as_drawn

#: What one seed logged: positions on the horizontal axis, increasing, and values there.
Run = tuple[ArrayLike, ArrayLike]


class Band(NamedTuple):
    """Several seeds at once, each of shape (n,).

    Attributes:
        x: Where.
        median, low, high: Median, minimum and maximum over the seeds.
    """

    x: Floats
    median: Floats
    low: Floats
    high: Floats


def seed_band(runs: Sequence[Run]) -> Band:
    """Median and range over seeds.

    Seeds that logged at other places than the first are interpolated linearly to where that did; what not all have
    reached is left out, and so are values that are not numbers: what there was nothing to log for.

    Args:
        runs: (x, y) of every seed, arrays of shape (n,), n may differ.

    Raises:
        InputError: No run, arrays that do not fit, x that does not increase, or seeds that have no x in common.
    """
    given: object = runs
    if not isinstance(given, Sequence) or not all(isinstance(run, Sequence) and len(run) == 2 for run in given):
        raise InputError(f"runs must be pairs of x and y, got {shown(runs)}")
    if not runs:
        raise InputError("a band needs at least one run")
    curves = [_curve(x, y) for x, y in runs]
    first = curves[0][0]
    low, high = max(x[0] for x, _ in curves), min(x[-1] for x, _ in curves)
    at = first[(first >= low) & (first <= high)]
    if not at.size:
        raise InputError("the runs have no stretch of x in common")
    values = np.array([np.interp(at, x, y) for x, y in curves])
    return Band(at, np.median(values, axis=0), values.min(axis=0), values.max(axis=0))


def moving_mean(values: ArrayLike, window: int) -> Floats:
    """Mean of each value and up to `window - 1` before it, shape (n,).

    Raises:
        InputError: Not one-dimensional, or a window below 1.
    """
    values = _line("values", values)
    window = check_count("window", window, most=2**62)
    sums = np.cumsum(np.concatenate([[0.0], values]))
    ends = np.arange(1, len(values) + 1)
    starts = np.maximum(ends - window, 0)
    return (sums[ends] - sums[starts]) / (ends - starts)


def per_block(flags: ArrayLike, block: int = 1000) -> tuple[Floats, Floats]:
    """How often something happened in each full block, as in the thesis's "reached per 1000".

    Args:
        flags: Whether it happened, in each episode or step, shape (n,).
        block: Length of a block.

    Returns:
        Where each block ends, and how often it happened in it, each of shape (n // block,).

    Raises:
        InputError: Not one-dimensional, or a block below 1.
    """
    happened = _line("flags", flags)
    block = check_count("block", block)
    count = len(happened) // block
    counts = happened[: count * block].reshape(count, block).sum(axis=1)
    return as_floats("ends", np.arange(1, count + 1) * block), as_floats("counts", counts)


def discounted_returns(rewards: ArrayLike, ends: ArrayLike, gamma: float) -> Floats:
    """Discounted sum of what follows each step up to the end of its episode (thesis 2.4), its own reward included.

    Args:
        rewards: Of successive steps, shape (n,).
        ends: Whether an episode ended with the step, shape (n,). What follows the last step counts as nothing.
        gamma: Discount factor, 0 to 1.

    Returns:
        Shape (n,).

    Raises:
        InputError: Shapes that do not fit, or a factor outside 0 … 1.
    """
    rewards, ends = _line("rewards", rewards), _line("ends", ends)
    if rewards.shape != ends.shape:
        raise InputError(f"rewards and ends must have the same length, got {len(rewards)} and {len(ends)}")
    factor: object = gamma
    if not (isinstance(factor, int | float) and 0 <= factor <= 1):
        raise InputError(f"gamma must be from 0 to 1, got {shown(gamma)}")
    returns = np.empty_like(rewards)
    following = 0.0
    for step in range(len(rewards) - 1, -1, -1):
        following = rewards[step] + (0.0 if ends[step] else gamma * following)
        returns[step] = following
    return returns


def _curve(x: ArrayLike, y: ArrayLike) -> tuple[Floats, Floats]:
    x, y = _line("x", x), _line("y", y)
    if x.shape != y.shape or not x.size or (np.diff(x) <= 0).any():
        raise InputError(f"a run needs increasing x and as many y, got {len(x)} and {len(y)} numbers")
    known = ~np.isnan(y)
    if not known.any():
        raise InputError("a run has no y that is a number")
    return x[known], y[known]


def _line(name: str, values: ArrayLike) -> Floats:
    array = as_drawn(name, values)
    if array.ndim != 1:
        raise InputError(f"{name} must be one-dimensional, got shape {array.shape}")
    return array
