"""The border of what the thesis counts as reached, to the last bit of the posture error."""

import math

import numpy as np

from kinreach.thesis import _reward as reward_geometry
from kinreach.thesis import reach_reward

PI = math.pi
#: Tool straight down in a natural posture.
DOWN = np.array([-PI / 2, -PI / 2, PI / 2, -PI / 2, -PI / 2, 0.0])


def test_boundary_is_decided_by_the_posture_error(monkeypatch):
    """The number next below 0.15 is smaller than 0.15, but 10 minus it is not higher than 9.85."""
    r_e = math.nextafter(0.15, 0.0)
    assert 10.0 - r_e == 9.85
    monkeypatch.setattr(reward_geometry, "posture_errors", lambda q: (r_e, 0.0))
    assert reach_reward(0.005, DOWN).reached
    assert reach_reward(0.005, DOWN).reward == 20.0
    monkeypatch.setattr(reward_geometry, "posture_errors", lambda q: (0.15, 0.0))
    assert not reach_reward(0.005, DOWN).reached
    assert reach_reward(0.005, DOWN).reward == 10.0 - 0.15
