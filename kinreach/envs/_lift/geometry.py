"""Whether fingers close around an object, by geometry: no contact forces, nothing moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.envs._lift.lift_task import face_angle
from kinreach.sim.inside import CUBE, SHAPES, Objects

#: Along the width of a finger the object's middle may be so far from the tip, and along the tool so far behind it or
#: ahead of it [m]: the pads are 22 mm wide and end 10 mm beyond the tip.
ACROSS, BEHIND, AHEAD = 0.008, 0.030, 0.006
#: Largest tilt of the tool, and largest angle between the fingers and the faces of a cube [rad].
TILT, TURN = 0.3, 0.3
#: How much narrower than the object the fingers want to be [m], and how much room they have beside it.
SQUEEZE, ROOM = 0.002, 0.003


def closes(
    T: Floats, openings: Floats, places: Floats, yaws: Floats, kinds: Objects, *, come_open: float
) -> NDArray[np.bool_]:
    """Return which of k grasps hold what they are to hold.

    Args:
        T: Tips in the world, shape (k, 4, 4); z points ahead, the fingers move along y.
        openings: To which they close [m], shape (k,).
        places: Middles of the objects in the world [m], shape (k, 3).
        yaws: Their turns about the vertical [rad], shape (k,).
        kinds: What they are.
        come_open: How wide the fingers are open before [m].
    """
    x, y, z = np.einsum("kji,kj->ik", T[:, :3, :3], places - T[:, :3, 3])
    turned = face_angle(np.arctan2(T[:, 1, 1], T[:, 0, 1]) - yaws)
    cube = kinds.shape == SHAPES.index(CUBE)
    half = kinds.size * np.where(cube, np.abs(np.cos(turned)) + np.abs(np.sin(turned)), 1.0)
    around = np.abs(y) + half <= come_open / 2 - ROOM
    straight = (T[:, 2, 2] <= -np.cos(TILT)) & (~cube | (np.abs(turned) <= TURN))
    between = (np.abs(x) <= ACROSS) & (z >= -np.minimum(BEHIND, kinds.size)) & (z <= AHEAD)
    return np.asarray(around & straight & between & (openings <= 2 * kinds.size - SQUEEZE))
