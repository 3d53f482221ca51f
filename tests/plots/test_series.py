from __future__ import annotations

import numpy as np
import pytest

from kinreach.errors import InputError
from kinreach.plots import discounted_returns, moving_mean, per_block, seed_band

CASES = 50


def test_band_holds_every_seed():
    cases = 0
    for seed in range(CASES):
        rng = np.random.default_rng(seed)
        x = np.cumsum(rng.uniform(0.1, 2.0, 30))
        ys = rng.normal(size=(int(rng.integers(1, 7)), 30))
        band = seed_band([(x, y) for y in ys])
        assert np.array_equal(band.x, x)
        assert np.array_equal(band.median, np.median(ys, axis=0))
        assert (band.low <= ys).all()
        assert (ys <= band.high).all()
        assert (band.low == ys.min(axis=0)).all()
        cases += 1
    assert cases == CASES


def test_band_of_seeds_that_logged_elsewhere():
    """A straight line is the same wherever it was sampled; what one seed has not reached is left out."""
    first, second = np.arange(0.0, 101.0, 10.0), np.arange(5.0, 66.0, 3.0)
    band = seed_band([(first, 2 * first), (second, 2 * second + 4)])
    assert band.x.tolist() == [10, 20, 30, 40, 50, 60]
    assert band.median == pytest.approx(2 * band.x + 2)
    assert band.high - band.low == pytest.approx(np.full(6, 4.0))


def test_band_leaves_out_what_was_not_logged():
    x = np.arange(6.0)
    band = seed_band([(x, [np.nan, 1, 2, np.nan, 4, 5]), (x, x + 1)])
    assert band.x.tolist() == [1, 2, 4, 5]
    assert band.median == pytest.approx(band.x + 0.5)


def test_moving_mean_is_a_convolution():
    cases = 0
    for seed in range(CASES):
        rng = np.random.default_rng(seed)
        values, window = rng.normal(size=60), int(rng.integers(1, 60))
        means = moving_mean(values, window)
        assert means[window - 1 :] == pytest.approx(np.convolve(values, np.full(window, 1 / window), mode="valid"))
        assert means[:window] == pytest.approx([values[: k + 1].mean() for k in range(window)])
        cases += 1
    assert cases == CASES


def test_per_block_counts_full_blocks():
    flags = np.zeros(3500, dtype=bool)
    flags[[0, 999, 1000, 3200]] = True  # the last one is in a block that is not full
    ends, counts = per_block(flags)
    assert ends.tolist() == [1000, 2000, 3000]
    assert counts.tolist() == [2, 1, 0]


def test_discounted_returns_are_the_sums():
    cases = 0
    for seed in range(CASES):
        rng = np.random.default_rng(seed)
        rewards, ends, gamma = rng.normal(size=40), rng.random(40) < 0.15, float(rng.uniform())
        returns = discounted_returns(rewards, ends, gamma)
        for step in range(40):
            later = np.flatnonzero(ends[step:])
            stop = step + (later[0] + 1 if later.size else 40 - step)
            assert returns[step] == pytest.approx(sum(gamma**k * r for k, r in enumerate(rewards[step:stop])))
            cases += 1
    assert cases == 40 * CASES


def test_the_thesis_sum():
    """Section 5.2: a reward of 2 for 100 steps with gamma 0.99 makes 126.79 (100 terms; the thesis's 101st is 0.73)."""
    returns = discounted_returns(np.full(101, 2.0), np.arange(101) == 100, 0.99)
    assert returns[1] == pytest.approx(126.79, abs=0.01)
    assert returns[0] - 0.99**100 * 2 == pytest.approx(126.79, abs=0.01)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: seed_band([]), "at least one run"),
        (lambda: seed_band([([0, 1], [1.0])]), "as many y, got 2 and 1"),
        (lambda: seed_band([([1, 1], [1.0, 2.0])]), "increasing x"),
        (lambda: seed_band([([0, 1], [1, 2]), ([2, 3], [1, 2])]), "in common"),
        (lambda: seed_band([([0, 1], [np.nan, np.nan])]), "no y that is a number"),
        (lambda: moving_mean([1.0], 0), "window must be at least 1, got 0"),
        (lambda: moving_mean([[1.0]], 1), r"values must be one-dimensional, got shape \(1, 1\)"),
        (lambda: per_block([True], 0), "block must be at least 1, got 0"),
        (lambda: discounted_returns([1.0], [True, False], 0.9), "same length, got 1 and 2"),
        (lambda: discounted_returns([1.0], [True], 1.1), "gamma must be from 0 to 1, got 1.1"),
    ],
)
def test_malformed_input_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()
