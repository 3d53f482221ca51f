"""Where goals may be is checked when it is said."""

import numpy as np
import pytest

from kinreach.errors import InputError
from kinreach.robots import BoxRegion


@pytest.mark.parametrize("bad", [(0.5, 0.3), (np.nan, 0.3), (0.3,), (0.1, 0.2, 0.3), "ab", None, (-np.inf, 0.0)])
@pytest.mark.parametrize("coordinate", ["x", "y", "z"])
def test_ranges_that_are_none_are_refused_by_name(coordinate, bad):
    ranges = {"x": (0.3, 0.6), "y": (-0.2, 0.2), "z": (0.1, 0.1), coordinate: bad}
    with pytest.raises(InputError, match=rf"\b{coordinate}\b"):
        BoxRegion(**ranges)


def test_goals_are_in_their_box():
    low, high = np.array([0.3, -0.2, 0.1]), np.array([0.6, 0.2, 0.1])
    drawn = BoxRegion(*zip(low.tolist(), high.tolist(), strict=True)).sample(np.random.default_rng(0), 500)
    assert len(drawn) == 500
    assert ((drawn >= low) & (drawn <= high)).all()
