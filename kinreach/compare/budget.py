"""Where the distance that is left comes from: seeing the goal, deciding where to go, and moving there.

From the goal to the tip it is three steps: to where the goal was seen, from there to where forward kinematics puts the
tip in the commanded posture, and from there to where the tip is in the simulation. Lengths of vectors do not add up,
but their components along one direction do: each step's component along the line from the goal to the tip is its part
of the distance. The three parts sum to the distance, goal by goal and therefore also in the mean; a part is negative
where its step takes the tip back towards the goal.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinreach.checks import Floats


class Budget(NamedTuple):
    """Parts of one distance [m]; their sum is the distance."""

    seeing: float
    deciding: float
    moving: float


#: What the numbers of a budget mean, for people.
MEANING = "component of each error along the line from the goal to the tip, mean over completed moves"


def budget(goal: Floats, told: Floats, meant: Floats, tip: Floats) -> Budget:
    """The parts of the distance from the goal to the tip, all in the world [m], shape (3,).

    Args:
        goal: Where the goal is.
        told: Where the method was told that it is.
        meant: Where the tip would be in the commanded posture.
        tip: Where the tip is.
    """
    whole = tip - goal
    distance = float(np.linalg.norm(whole))
    if distance == 0.0:
        return Budget(0.0, 0.0, 0.0)
    direction = whole / distance
    return Budget(*(float(step @ direction) for step in (told - goal, meant - told, tip - meant)))
