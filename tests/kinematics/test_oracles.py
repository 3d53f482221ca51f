"""The solution sets of three independent libraries agree with ours."""

import numpy as np
import pytest

from benchmarks.speed.peers.analytic import ANALYTIC
from benchmarks.speed.peers.base import silent
from benchmarks.speed.poses import FLANGE, random_poses
from kinreach._rotations import pose_error

pytest.importorskip("eaik")
pytest.importorskip("ssik")
pytest.importorskip("ur_analytic_ik")


def wrapped(q):
    return (q + np.pi) % (2 * np.pi) - np.pi


def angular_distance(a, b):
    return np.abs(wrapped(a[:, None] - b[None])).max(axis=2)


@pytest.mark.parametrize("peer", ANALYTIC)
def test_solution_sets_agree(peer):
    solve = ANALYTIC[peer]().solve
    compared = 0
    for T in random_poses(np.random.default_rng(9), 1000):
        with silent():
            theirs = solve(T)
        ours = FLANGE.all_solutions(T).q
        exact = np.array([max(pose_error(T, FLANGE.fk(q))) < 1e-6 for q in theirs])
        assert exact.all()
        distance = angular_distance(ours, theirs)
        assert (distance.min(axis=0) < 1e-5).all(), "a solution of the peer is missing from ours"
        assert (distance.min(axis=1) < 1e-5).all(), "a solution of ours is missing from the peer's"
        compared += len(ours)
    assert compared > 7000
