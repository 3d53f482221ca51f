"""Straight-line programs compute what their formula says, and no more than they have to."""

from __future__ import annotations

import numpy as np
import pytest

from kinreach.kinematics.straight_line import Program, apply


def steps(formula, inputs):
    return len(Program(formula, inputs)._steps)


def formula(x):
    a, b, c = x
    d = (a + b) * c - 0.5 * (b - a) * (b - a)
    e = 1.0 / (2.0 + apply(np.cos, d) * apply(np.sin, a))
    return [d, e, -d * e, apply(np.minimum, apply(np.absolute, d), e), a, 3.0]


def plain(a, b, c):
    d = (a + b) * c - 0.5 * (b - a) * (b - a)
    e = 1.0 / (2.0 + np.cos(d) * np.sin(a))
    return [d, e, -(d * e), np.minimum(np.abs(d), e), a, 3.0]


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("count", [1, 5, 1000])
def test_a_program_computes_its_formula(dtype, count):
    x = np.random.default_rng(0).uniform(-2, 2, (3, count)).astype(dtype)
    before = x.copy()
    program = Program(formula, 3)
    for _ in range(2):  # nothing is left behind from the first run
        results = program(x)
        np.testing.assert_array_equal(x, before)
        for result, expected in zip(results, plain(*x), strict=True):
            np.testing.assert_allclose(result, expected, rtol=1e-5 if dtype == np.float32 else 1e-14)
        assert all(result.dtype == dtype for result in results[:4])


def test_what_is_known_is_not_computed():
    assert steps(lambda x: [0.0 * x[0], 1.0 * x[0], x[0] + 0.0, x[0] - 0.0], 1) == 0
    assert steps(lambda x: [-1.0 * (x[0] * -1.0)], 1) == 0
    assert steps(lambda x: [x[0] * -1.0 + x[1]], 2) == 1
    assert steps(lambda x: [x[0] * -x[1] + x[1]], 2) == 2
    assert steps(lambda x: [apply(np.cos, 0.0) * x[0]], 1) == 0


def test_what_occurs_twice_is_computed_once():
    assert steps(lambda x: [(x[0] + x[1]) * (x[0] + x[1])], 2) == 2


def test_what_nobody_needs_is_left_out():
    def wasteful(x):
        apply(np.tan, x[0])
        return [x[0] * 2.0]

    assert steps(wasteful, 1) == 1


def test_results_are_not_overwritten():
    def chained(x):
        a = x[0] + 1.0
        b = a * 2.0
        return [a, b, b - 3.0]

    a, b, c = Program(chained, 1)([np.arange(4.0)])
    np.testing.assert_array_equal(a, np.arange(4.0) + 1)
    np.testing.assert_array_equal(b, 2 * a)
    np.testing.assert_array_equal(c, b - 3)
