"""Newton's method for arms that are almost URs: exact next to a posture, and harmless where it does not converge."""

from __future__ import annotations

import numpy as np
import pytest

from kinreach.kinematics import URKinematics
from kinreach.kinematics._chain import SerialChain
from kinreach.kinematics._ur.refine import EXACT, FAR, ROWS, Refinement
from kinreach.robots import PUBLISHED_CALIBRATIONS
from tests.cases import slow


@pytest.fixture(scope="module", params=["ur5_a", *slow("ur3e_a", "ur10e_a")])
def chain(request):
    name = request.param
    kin = URKinematics.from_calibration(PUBLISHED_CALIBRATIONS[name], model=name.partition("_")[0])
    *placements, tip = kin._solver.chain.placements
    return SerialChain(placements, [np.array((0.0, 0.0, 1.0))] * 6, tip)


def test_it_arrives_from_near_starts(chain):
    """More rows than are computed at a time, several starts for one pose, and turns that the starts have."""
    refinement, rng = Refinement(chain.placements), np.random.default_rng(0)
    q = rng.uniform(-3.0, 3.0, (1500, 6))
    q[:, [2, 4]] = rng.uniform(0.3, 2.8, (1500, 2)) * rng.choice(
        [-1, 1], (1500, 2)
    )  # no elbow and no wrist is straight
    wanted, row = refinement.wanted(chain.fk(q)), np.repeat(np.arange(1500), 2)
    turns = 2 * np.pi * rng.integers(-1, 2, (6, 3000))
    starts = q[row].T + rng.uniform(-2e-3, 2e-3, (6, 3000)) + turns
    found, arrived = refinement.near(starts, row, wanted)
    assert len(row) > ROWS
    assert arrived.mean() > 0.97  # the others are next to the singular posture of the shoulder
    np.testing.assert_allclose(found[:, arrived], (q[row].T + turns)[:, arrived], atol=1e-8)
    np.testing.assert_allclose(chain.fk(found[:, arrived].T), chain.fk(q)[row[arrived]], atol=1e-11)
    np.testing.assert_array_equal(found[:, ~arrived], starts[:, ~arrived])


def test_where_it_does_not_arrive_the_start_comes_back(chain):
    """Out of reach, singular, or so far away that another posture is nearer; no warning is given."""
    refinement, rng = Refinement(chain.placements), np.random.default_rng(1)
    starts = np.concatenate([rng.uniform(-3, 3, (6, 300)), np.zeros((6, 5)), np.full((6, 5), np.pi / 2)], axis=1)
    T = chain.fk(rng.uniform(-3, 3, (310, 6)))
    T[::2, :3, 3] += 5.0
    found, arrived = refinement.near(starts, np.arange(310), refinement.wanted(T))
    np.testing.assert_array_equal(found[:, ~arrived], starts[:, ~arrived])
    assert not arrived[::2].any()
    assert (np.abs(found - starts).max(axis=0) < FAR).all()


def test_what_has_not_arrived_goes_on_and_what_has_stays(chain):
    refinement, rng = Refinement(chain.placements), np.random.default_rng(2)
    q = rng.uniform(-3.0, 3.0, (1500, 6))
    wanted = refinement.wanted(chain.fk(q))
    starts = q.T + rng.uniform(-0.015, 0.015, (6, 1500))
    found, arrived = refinement.near(starts, np.arange(1500), wanted)
    with np.errstate(all="ignore"):
        once, off = refinement.refined(starts, wanted)
        twice, still_off = refinement.refined(once, wanted)
    at_first, later = off < EXACT, (off >= EXACT) & (still_off < EXACT)
    near = np.abs(np.where(at_first, once, twice) - starts).max(axis=0) < FAR
    assert (at_first & near).sum() > 500
    assert (later & near).sum() > 50
    np.testing.assert_array_equal(arrived, (at_first | later) & near)
    np.testing.assert_array_equal(found[:, at_first & near], once[:, at_first & near])
    np.testing.assert_array_equal(found[:, later & near], twice[:, later & near])
