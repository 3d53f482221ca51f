"""What two fingers close around, by geometry alone."""

import numpy as np
import pytest

from kinreach._rotations import turn
from kinreach.envs._lift.episodes import closes
from kinreach.sim.inside import Objects

#: What is turned or moved, the shape, and by how much it may be: of fingers 22 mm wide that come open by 10 cm.
GEOMETRY = [
    ("across", "ball", 0.008), ("behind", "ball", 0.02), ("ahead", "ball", 0.006), ("behind", "large ball", 0.03),
    ("tilt", "ball", 0.3), ("turn", "cube", 0.3), ("squeeze", "ball", -0.002), ("beside", "ball", 0.027),
]  # fmt: skip


@pytest.mark.parametrize(("what", "shape", "bound"), GEOMETRY)
def test_what_fingers_close_around_by_geometry(what, shape, bound):
    """The object at the tip, half an object of 2 cm beside a finger, and so on: just within the bound, and just not."""
    size = 0.035 if shape == "large ball" else 0.02
    kind = Objects(np.array([int(shape == "cube")]), *np.array([[size], [0.05], [1.0]]))
    verdicts = []
    for value in (bound - 1e-6, bound + 1e-6):
        for sign in (-1, 1):
            by = {name: sign * value if name == what else 0.0 for name in ("across", "beside", "tilt", "turn")}
            along = {"behind": -value, "ahead": value}.get(what, 0.0)
            x, y = (turn(np.eye(3)[axis], angle) for axis, angle in ((0, np.pi), (1, by["tilt"])))
            T = np.eye(4)
            T[:3, :3] = turn(np.eye(3)[2], by["turn"]) @ y @ x
            place = T[:3, :3] @ [by["across"], by["beside"], along]
            opening = 2 * size + (value if what == "squeeze" else -0.01)
            given = T[None], np.array([opening]), place[None], np.zeros(1), kind
            verdicts.append(bool(closes(*given, sides=(0.05, 0.05))[0]))
    assert verdicts == [True, True, False, False]
    from_below = np.eye(4)[None], np.zeros(1), np.zeros((1, 3)), np.zeros(1), kind
    assert not closes(*from_below, sides=(0.05, 0.05))[0]
