"""Collision checks of straight lines in joint space that miss nothing between two samples."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats, check_number
from kinreach.errors import InputError, PathError
from kinreach.kinematics._collision import PATH_MARGIN, CollisionChecker

#: Margins below this make paths slow to check, and so do distances to keep that are nearer to the margin [m].
MIN_MARGIN, MIN_REST = 5e-4, 2e-4


class MotionCheck:
    """Checks motions between postures.

    While joint i turns by dq_i, no point of the arm moves farther than the sum of |dq_i| r_i, where r_i is the largest
    distance of anything that the joint carries from its axis; nor does it relative to another link. A motion is
    sampled so that this sum is at most twice the rest of the checker's margin above the distance to keep from one
    sample to the next. Every posture is within that rest of a sample, and a sample is farther than the margin from
    everything: the distance is kept everywhere, and nothing is missed.

    Args:
        checker: With a margin.
        keeps: Distance from everything that the whole motion keeps, not only its samples [m].

    Attributes:
        reach: The distances r_i [m], shape (n,).

    Raises:
        InputError: The checker has a margin below 0.5 mm, or less than 0.2 mm above the distance to keep.
    """

    def __init__(self, checker: CollisionChecker, keeps: float = 0.0) -> None:
        check_number("keeps", keeps, least=0.0)
        least = max(MIN_MARGIN, keeps + MIN_REST)
        if checker.margin < least * (1.0 - 1e-9):
            raise InputError(
                f"paths need a CollisionChecker with a margin of at least {least:g} m, got {checker.margin:g}; with "
                f"CollisionChecker(..., margin={keeps + PATH_MARGIN:g}) nothing between two samples is missed"
            )
        self.checker, self.reach = checker, checker.reach
        self._step = 2.0 * (checker.margin - keeps)

    def free(self, q: Floats) -> bool:
        """Return whether a posture is farther than the margin from everything, regardless of joint limits."""
        return not self.checker._collides(q)

    def motion_free(self, start: Floats, end: Floats, *, step: float | None = None) -> bool:
        """Return whether a motion is free, without its two ends.

        A point moves at most `step` [m] between two samples; by default so little that nothing is missed.
        """
        way = end - start
        count = self._samples(way, self._step if step is None else step)
        return not self.checker._any_collides(start + _coarse_to_fine(count)[:, None] / count * way)

    def first_collision(self, start: Floats, end: Floats) -> float | None:
        """Return at which part of a motion, from 0 to 1, the first sample collides; None if it is free."""
        way = end - start
        count = self._samples(way, self._step)
        return next((index / count for index in range(count + 1) if not self.free(start + index / count * way)), None)

    def _samples(self, way: Floats, step: float) -> int:
        return max(1, int(np.ceil(np.abs(way) @ self.reach / step)))


def check_waypoints(motion: MotionCheck, waypoints: Floats) -> None:
    """Check the straight lines from one waypoint to the next."""
    kin, checker = motion.checker.kinematics, motion.checker
    outside = kin.past_limits(waypoints).any(axis=1)
    if outside.any():
        index = int(outside.argmax())
        raise PathError(f"waypoint {index} is {checker.reason(waypoints[index])}", index=index, q=waypoints[index])
    for index, (start, end) in enumerate(pairwise(waypoints)):
        fraction = motion.first_collision(start, end)
        if fraction is not None:
            q = start + fraction * (end - start)
            raise PathError(
                f"collision {100 * fraction:.0f} % of the way from waypoint {index} to {index + 1}, at q = "
                f"{np.round(q, 3).tolist()}: {checker.reason(q)}",
                index=index,
                fraction=fraction,
                q=q,
            )


@lru_cache(maxsize=1024)
def _coarse_to_fine(count: int) -> NDArray[np.int64]:
    """The numbers from 1 to count - 1, so that wide gaps are filled first."""
    order: list[int] = []
    stride = 1 << (count - 1).bit_length()
    while stride > 1:
        order += range(stride // 2, count, stride)
        stride //= 2
    return np.array(order, dtype=np.int64)
