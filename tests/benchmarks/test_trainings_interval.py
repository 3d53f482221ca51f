"""The interval of several trainings: against scipy, by hand, and that it covers what it promises to cover."""

from math import comb

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats

from benchmarks.studies.trainings import trainings_interval
from kinreach._statistics import bootstrap_intervals, mean, median, p95, wilson_interval
from kinreach.errors import InputError
from tests.cases import slow

CASES = 400
#: Of the share of intervals that hold the truth, 95 % by right: three of its standard deviations in that many cases.
LEAST_COVERED = 0.95 - 3 * (0.95 * 0.05 / CASES) ** 0.5


def reached(shares: list[float], goals: int) -> np.ndarray:
    """Trainings that reach these shares of the goals."""
    return np.arange(goals) < np.round(np.array(shares)[:, None] * goals)


@pytest.mark.parametrize("confidence", [0.8, 0.95, 0.99])
@pytest.mark.parametrize("trainings", [2, 3, 5, 10, 30])
def test_it_is_students_where_goals_leave_no_doubt(trainings, confidence):
    each = np.random.default_rng(trainings).normal(3.0, 2.0, trainings)
    oracle = stats.ttest_1samp(each, 0.0).confidence_interval(confidence)
    for statistic in (mean, median, p95):  # of equal values all the same
        found = trainings_interval(np.repeat(each[:, None], 7, axis=1), statistic, confidence=confidence, resamples=50)
        assert found == pytest.approx((oracle.low, oracle.high), abs=1e-9)


def test_shares_by_hand():
    # 13, 52, 74, 74 and 100 %: mean 62.6, deviation 32.5, t of four degrees of freedom 2.776: 62.6 ± 40.4. The goals:
    # Wilson's interval of 626 in 1000 is 62.6 - 3.04 to 62.6 + 2.94. Their squares add up to 40.5 below.
    low, high = trainings_interval(reached([0.13, 0.52, 0.74, 0.74, 1.0], 1000))
    assert (low, high) == (pytest.approx(0.626 - 0.405, abs=5e-4), 1.0)


@pytest.mark.parametrize(("share", "successes"), [(0.0, 0), (1.0, 200), (0.3, 60)])
@pytest.mark.parametrize("trainings", [1, 2, 5])
def test_equal_shares_leave_the_doubt_of_the_goals(share, successes, trainings):
    found = trainings_interval(reached([share] * trainings, 200))
    assert found == pytest.approx(wilson_interval(successes, 200), abs=1e-12)


@pytest.mark.parametrize("statistic", [mean, median, p95])
def test_one_training_leaves_the_doubt_of_the_goals(statistic):
    values = np.random.default_rng(3).lognormal(size=(1, 150))
    (goals,) = bootstrap_intervals(values[0], (statistic,), seed=8)
    assert trainings_interval(values, statistic, seed=8) == pytest.approx(goals)


@pytest.mark.slow
def test_it_is_never_narrower_than_either_part():
    rng = np.random.default_rng(11)
    cases = 0
    for _ in range(200):
        trainings, goals = rng.integers(2, 7), rng.integers(5, 60)
        shares = rng.random((trainings, goals)) < rng.beta(2, 1, (trainings, 1))
        for values, bounds in ((shares, (0.0, 1.0)), (rng.exponential(rng.random((trainings, 1)), shares.shape), ())):
            each = values.mean(axis=1)
            low, high = trainings_interval(values, least=0.0, resamples=100)
            spread = stats.t.ppf(0.975, trainings - 1) * stats.sem(each)
            assert 0 <= low <= max(0.0, each.mean() - spread) + 1e-12
            assert high >= min(bounds[1] if bounds else np.inf, each.mean() + spread) - 1e-12
            if bounds:
                count = values.sum() / trainings
                assert low <= wilson_interval(int(np.floor(count)), goals)[0] + 1e-12
                assert wilson_interval(int(np.ceil(count)), goals)[1] - 1e-12 <= high <= 1
            cases += 1
    assert cases == 400


@pytest.mark.slow
def test_shares_are_covered_where_trainings_differ():
    """Trainings draw their own probability to succeed; taking their episodes for independent trials covers little."""
    rng = np.random.default_rng(0)
    covered = pooled = cases = 0
    for _ in range(CASES):
        values = rng.random((5, 300)) < rng.beta(6, 4, (5, 1))
        low, high = trainings_interval(values)
        covered += low <= 0.6 <= high
        low, high = wilson_interval(int(values.sum()), values.size)
        pooled += low <= 0.6 <= high
        cases += 1
    assert cases == CASES
    assert covered / CASES >= LEAST_COVERED
    assert pooled / CASES < 0.4


@pytest.mark.parametrize(("statistic", "spread"), [(mean, 0.2), (median, 0.2), *slow((mean, 0.0), (mean, 1.0))])
def test_distances_are_covered_where_trainings_and_goals_differ(statistic, spread):
    """Goals are harder or easier for all trainings alike; trainings are worse or better on all goals alike."""
    rng = np.random.default_rng(1)
    covered = cases = 0
    for _ in range(CASES):
        each = rng.normal(4.0, spread, (5, 1)) + rng.normal(0.0, 1.0, 100) + rng.normal(0.0, 0.5, (5, 100))
        low, high = trainings_interval(each, statistic, resamples=200)
        covered += low <= 4.0 <= high
        cases += 1
    assert cases == CASES
    assert covered / CASES >= LEAST_COVERED - 0.01  # the percentile bootstrap of 100 goals is a little narrow by itself


def test_shares_are_covered_where_trainings_are_equal():
    rng = np.random.default_rng(2)
    covered = 0
    for _ in range(CASES):
        low, high = trainings_interval(rng.random((5, 50)) < 0.98)
        covered += low <= 0.98 <= high
    assert covered / CASES >= LEAST_COVERED


def test_where_one_training_in_five_fails_it_holds_as_often_as_the_docs_say(root):
    """Trainings that reach every goal or none: of five, every number of failures with its probability."""
    held = 0.0
    for failures in range(6):
        low, high = trainings_interval(np.repeat(np.arange(5) >= failures, 1000).reshape(5, 1000))
        held += comb(5, failures) * 0.2**failures * 0.8 ** (5 - failures) * (low <= 0.8 <= high)
    for page in (
        "docs/reference/numbers.md",
        "docs/studies/appendix/trainings.md",
        "docs/studies/appendix/button.md",
        "benchmarks/studies/trainings.py",
    ):
        assert f"{100 * held:.0f} %" in (root / page).read_text(encoding="utf-8"), page


def test_the_same_values_give_the_same_interval():
    values = np.random.default_rng(4).normal(size=(4, 60))
    assert trainings_interval(values, median) == trainings_interval(values.tolist(), median)
    assert trainings_interval(values, median, seed=1) != trainings_interval(values, median, seed=2)


def test_the_order_of_trainings_and_of_goals_does_not_matter():
    values = np.random.default_rng(5).random((5, 40)) < 0.7
    assert trainings_interval(values[::-1, ::-1]) == pytest.approx(trainings_interval(values), abs=1e-12)


@pytest.mark.parametrize("values", [np.arange(10.0).reshape(2, 5), np.eye(2, 5, dtype=bool)], ids=["numbers", "shares"])
@pytest.mark.parametrize(
    "options",
    [{"confidence": value} for value in (float("nan"), 0.0, 1.0, 1.5, -1.0)]
    + [{"least": 5.0, "most": 3.0}, {"least": float("nan")}, {"most": float("nan")}],
)
def test_options_that_cannot_be_are_refused(values, options):
    with pytest.raises(InputError, match=r"confidence|least"):
        trainings_interval(values, **options)


@pytest.mark.parametrize("values", [[], [[]], [1.0, 2.0], [[1.0, np.nan]], [[np.inf], [1.0]]])
def test_what_is_not_a_table_of_trainings_is_refused(values):
    with pytest.raises(InputError, match="a row of finite numbers for each training"):
        trainings_interval(values)


@pytest.mark.slow
@settings(max_examples=50, deadline=None, derandomize=True)
@given(arrays(np.float64, st.tuples(st.integers(1, 4), st.integers(1, 9)), elements=st.floats(-1e150, 1e150)))
def test_any_finite_values_have_an_interval_around_their_mean(values):
    low, high = trainings_interval(values, resamples=20)
    middle = values.mean(axis=1).mean()
    assert np.isfinite([low, high]).all()
    assert low <= middle <= high
    assert values.min() <= trainings_interval(values, resamples=20, least=values.min(), most=values.max())[0]
