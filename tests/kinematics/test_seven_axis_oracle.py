"""Seven axes: nothing that reaches a pose is beside its curves, near every singularity and for every arm of ssik.

`tools/endurance` has more poses.
"""

import numpy as np
import pytest

from benchmarks.ik_arms.self_motions import ARMS, arm_of
from tools.endurance.self_motions import SINGULAR, beside, near_singular_posture, near_singularity, reached_by_newton

#: Poses near each of a Panda's singularities, and of each arm.
POSES, ORACLE_POSES = 12, 6


@pytest.mark.slow
@pytest.mark.parametrize("where", SINGULAR)
def test_next_to_its_singularities_a_panda_loses_no_posture(where):
    """The posture behind the pose is on a curve, exact, and `nearest` returns nothing farther."""
    within = near_singularity(where, range(POSES))
    assert within >= POSES // 4 or where in ("elbow stretched", "shoulder straight and elbow stretched")


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_next_to_singular_postures_of_any_kind_no_posture_is_lost(name):
    pytest.importorskip("ssik")
    assert near_singular_posture(name, range(POSES)) >= POSES // 3


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_what_newtons_method_reaches_from_anywhere_is_on_the_curves(name):
    pytest.importorskip("ssik")
    assert reached_by_newton(name, range(ORACLE_POSES)) >= 50 * ORACLE_POSES


def test_an_xarm7_has_eight_curves_at_a_folded_elbow():
    """Two of them, through this posture, were lost."""
    pytest.importorskip("ssik")
    kin = arm_of("xArm7", False)
    q = np.array([0.94275769, -1.36096347, -1.59056325, -3.13653089, 2.21175882, -1.36126508, 1.97164097])
    T = kin.fk(q)
    motions = kin.self_motions(T, limits=False)
    assert len(motions) == 8
    assert all(curve.closed for curve in motions)
    assert [beside([curve], q[None]).item() for curve in motions].count(False) == 1
    found = kin.nearest(T, q)
    assert found.success
    assert np.abs(found.q - q).max() < 1e-6
