"""Intervals against hand-worked values, and that they cover what they promise to cover."""

import numpy as np
import pytest

from kinreach._statistics import bootstrap_intervals, mean, median, number, p95, trials_csv, wilson_interval
from kinreach.errors import InputError


def test_wilson_by_hand() -> None:
    # k = 8 of n = 10, z = 1.96: centre (0.8 + 0.19207) / 1.38415 = 0.71674, half width 0.22660.
    assert wilson_interval(8, 10) == pytest.approx((0.4901625, 0.9433178), abs=1e-6)


def test_wilson_ends_exactly_at_the_ends() -> None:
    assert wilson_interval(0, 50)[0] == 0.0
    assert wilson_interval(50, 50)[1] == 1.0


@pytest.mark.parametrize(("successes", "total"), [(0, 0), (-1, 5), (6, 5), (1, -1), (1, 10**400), (10**400, 5)])
def test_wilson_refuses_what_is_no_rate(successes: int, total: int) -> None:
    with pytest.raises(InputError, match="must be at"):
        wilson_interval(successes, total)


def test_rows_are_drawn_together() -> None:
    values = np.random.default_rng(5).lognormal(size=200)
    one = np.array(bootstrap_intervals(values, (median, p95)))
    np.testing.assert_allclose(bootstrap_intervals([values, values], (median, p95)), one, rtol=1e-12)
    np.testing.assert_allclose(bootstrap_intervals([values, -values], (mean,)), [(0.0, 0.0)], atol=1e-12)


def test_bootstrap_of_one_value_is_that_value() -> None:
    assert bootstrap_intervals([2.5], (median, mean)) == [(2.5, 2.5)] * 2


def test_bootstrap_of_equal_values_has_no_width() -> None:
    assert bootstrap_intervals([3.25] * 7, (median, mean, p95)) == [(3.25, 3.25)] * 3


def test_bootstrap_of_two_values_by_hand() -> None:
    # The mean of two draws from {0, 1} is 0, 0.5 or 1 with 1/4, 1/2, 1/4: the 2.5 % and 97.5 % quantiles are 0 and 1.
    assert bootstrap_intervals([0.0, 1.0], (mean,)) == [(0.0, 1.0)]
    # The inner half of that distribution: quantiles at 0.3 and 0.7 are both 0.5.
    assert bootstrap_intervals([0.0, 1.0], (mean,), confidence=0.4) == [(0.5, 0.5)]


def test_bootstrap_is_the_same_for_the_same_seed_and_in_any_number_of_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.random.default_rng(1).normal(size=101)
    whole = bootstrap_intervals(values, (median, p95), seed=3)
    monkeypatch.setattr("kinreach._statistics._BLOCK", 7 * values.size)
    assert bootstrap_intervals(values, (median, p95), seed=3) == whole
    assert bootstrap_intervals(values, (median, p95), seed=4) != whole


def test_bootstrap_covers_the_true_mean_about_as_often_as_promised() -> None:
    rng = np.random.default_rng(0)
    covered = 0
    for _ in range(300):
        ((low, high),) = bootstrap_intervals(rng.normal(2.0, 1.0, 60), (mean,), resamples=400)
        covered += low <= 2.0 <= high
    assert 0.90 <= covered / 300 <= 0.98


@pytest.mark.parametrize("values", [[], [1.0, np.nan], [np.inf], [[[1.0]]], ["a"]])
def test_bootstrap_refuses_what_it_cannot_resample(values: list[float]) -> None:
    with pytest.raises(InputError, match="bootstrap"):
        bootstrap_intervals(values, (mean,))


def test_reducers() -> None:
    values = np.arange(101.0)
    assert (median(values), mean(values), p95(values)) == (50.0, 50.0, 95.0)


RATE = ("wilson", lambda **options: wilson_interval(3, 10, **options))
BOOTSTRAP = ("bootstrap", lambda **options: bootstrap_intervals(np.arange(10.0), (median,), **options))
CONFIDENCES = [{"confidence": value} for value in (float("nan"), 0.0, 1.0, 1.5, -1, np.inf, "x", None, True)]
COUNTS = [{"resamples": value} for value in (0, -3, 1.5, "a", 10**9)] + [{"seed": value} for value in (-1, "a", 1.5)]


@pytest.mark.parametrize(
    ("interval", "options"),
    [(each, options) for each in (RATE, BOOTSTRAP) for options in CONFIDENCES]
    + [(BOOTSTRAP, options) for options in COUNTS],
    ids=lambda given: given[0] if isinstance(given, tuple) else str(given),
)
def test_options_that_cannot_be_are_refused(interval, options) -> None:
    """A confidence of NaN gave an interval of NaN."""
    with pytest.raises(InputError, match=next(iter(options))):
        interval[1](**options)
    low, high = np.ravel(interval[1](confidence=np.float32(0.5)))
    assert low < high


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "-"), (0.0, "0.00"), (0.5, "0.50"), (9.994, "9.99"), (10.0, "10.0"), (99.94, "99.9"), (100.0, "100"),
     (1234.6, "1235"), (0.1, "0.10"), (0.0999, "0.10"), (0.0123, "0.012"), (1e-3, "0.0010"), (9.9e-4, "1e-3"),
     (4.2e-13, "4e-13"), (-0.02, "-0.020"), (-12.34, "-12.3")],
)  # fmt: skip
def test_numbers_have_two_or_three_digits(value: float | None, text: str) -> None:
    assert number(value) == text


def test_a_number_may_have_its_own_digits() -> None:
    assert [number(1234.5678, digits) for digits in (2, 4, 6)] == ["1.2e+03", "1235", "1234.57"]


def test_trials_as_csv() -> None:
    trials = [{"a": 1, "b": True, "c": [1.5, 2]}, {"a": None, "d": "x,\x1by"}]
    assert trials_csv(trials) == 'a,b,c,d\n1,1,1.5 2,\n,,,"x,\\x1by"\n'
