"""Windings of joints within limits: the core's of one posture, numpy's of many, and all that there are."""

from __future__ import annotations

import numpy as np
import pytest

from kinreach._rotations import turns_about_z
from kinreach.kinematics._core import Struct, doubles, lib
from kinreach.kinematics.inside import nearest_windings


def nearest_winding(q, seed, lower, upper):
    """The core's winding of one posture of joints that turn about one axis, or None."""
    n, found = len(q), np.empty(len(q))
    T = turns_about_z(np.array([q.sum()]))[0]
    placements = np.tile(np.eye(4)[:3].ravel(), n + 1).tolist()
    arm = Struct("kr_arm", n=n, lower=lower.tolist(), upper=upper.tolist(), placements=placements)
    return (
        found
        if lib.kr_allowed(arm.pointer, 0, doubles(T), doubles(q), doubles(seed), True, 1e-9, doubles(found))
        else None
    )


def test_the_slack_at_both_limits_is_the_same_for_one_and_for_many():
    lower, upper = np.array([-1.0, -np.pi]), np.array([1.0, np.pi])
    cases = 0
    for end, sign in ((lower, -1.0), (upper, 1.0)):
        for past, inside in ((5e-10, True), (5e-9, False), (-5e-9, True)):
            q = np.array([end[0] + sign * past, 0.3])
            one = nearest_winding(q, np.zeros(2), lower, upper)
            many, within = nearest_windings(q[:, None], np.zeros((2, 1)), lower, upper)
            assert (one is not None) == inside
            assert within.tolist() == [inside]
            if inside:
                np.testing.assert_array_equal(one, many[:, 0])
                np.testing.assert_array_equal(one, q)
            cases += 1
    assert cases == 6


def test_windings_are_the_nearest_of_all_however_far_the_seed_is():
    rng, turns = np.random.default_rng(3), 2 * np.pi * np.arange(-60, 61)
    lower, width = rng.uniform(-9, 0, 400), rng.uniform(0.5, 14, 400)
    q, seed = rng.uniform(-np.pi, np.pi, 400), rng.uniform(-300, 300, 400)
    upper = lower + width
    many, within = nearest_windings(q, seed, lower, upper)
    counts = {True: 0, False: 0}
    for i in range(400):
        allowed = q[i] + turns
        allowed = allowed[(allowed >= lower[i]) & (allowed <= upper[i])]
        one = nearest_winding(q[[i]], seed[[i]], lower[[i]], upper[[i]])
        assert (one is not None) == (lower[i] <= many[i] <= upper[i]) == (len(allowed) > 0)
        counts[one is not None] += 1
        if one is not None:
            best = allowed[np.abs(allowed - seed[i]).argmin()]
            assert (one[0], many[i]) == pytest.approx((best, best), abs=1e-9)
    assert not within
    assert min(counts.values()) > 50
