"""The fuzz tests' own machinery: what fails is found, and what is counted was run."""

import pytest
from hypothesis import strategies as st

from kinreach._checks import shown
from kinreach.errors import InputError
from tests.robustness.fuzzing import fuzz


def test_cases_and_refusals_are_counted():
    seen = []

    def run(case):
        seen.append(case)
        if case % 2:
            raise InputError("odd")

    tally = fuzz(st.integers(0, 10**6), run, both=False)
    assert tally.cases == len(seen) >= 8
    assert tally.refused == sum(case % 2 for case in seen)


def test_other_errors_are_found():
    with pytest.raises(ZeroDivisionError):
        fuzz(st.just(0), lambda case: 1 / case, least=0)


def test_values_are_shown_briefly_whatever_they_are():
    class Odd:
        def __repr__(self):
            raise RuntimeError("no text")

    endless = []
    endless.append(endless)
    for value in (Odd(), 10**9999, "x" * 10**6, [0] * 10**6, endless, b"\xff" * 999, {i: i for i in range(999)}):
        assert 0 < len(shown(value)) < 300
