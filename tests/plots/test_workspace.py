"""The picture of a workspace says what `kinreach check` prints, for its seed."""

import numpy as np
import pytest

from kinreach.kinematics import URKinematics, check
from kinreach.plots.inside import draw_workspace


@pytest.mark.parametrize("seed", [0, 7])
def test_agility_is_measured_against_the_reach_of_the_same_seed(seed):
    kin = URKinematics("ur5e")
    (cells,) = draw_workspace(kin, seed=seed).axes[0].collections
    scale = check.reach_of(kin, seed=seed).farthest
    agility = [check.smallest_singular_value(kin, q, scale) for q in check.random_postures(kin, check.POSTURES, seed)]
    alone = np.isclose(cells.get_array()[:, None], agility, rtol=1e-12, atol=0.0).any(axis=1)
    assert alone.sum() >= 5  # cells at the edge that hold one posture
