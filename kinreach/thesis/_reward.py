"""The reward of the thesis (section 3.4.4) as a pure function of the distance and the posture.

`d` is the distance from the tcp to the goal [m], `q` a posture of the UR5 in the base_link convention [rad] or a stack
of them, shape (..., 6). Results have the broadcast leading dimensions; for one posture they are numbers, for tensors of
torch tensors on their device, unchecked.

Where the thesis leaves something open:

*   **Sign.** Its reward_distance is -d, of which there is no logarithm: r_d is a function of d.
*   **Reached.** "10 - r_e higher than 9.85" and "r_e smaller than 0.15" are the same in the thesis, but not in floating
    point: 10 - r_e is 9.85 for the numbers next to 0.15 on either side. The second decides; at 0.15 nothing is reached.
*   **Impossible** comes before everything else: -100 wherever the arm ends up, and not reached.
*   **d = 0** has no r_d in the thesis; it is +inf here, the limit. The reward does not use it: a special case replaces
    r_d below 0.01 m.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import Floats, as_flags, as_floats, check_tensor, is_tensor
from kinreach._tensors import flags_like, like, namespace
from kinreach.errors import InputError
from kinreach.thesis._posture import posture_errors

#: Distance below which the arm is at the goal [m].
REACHED_DISTANCE = 0.01
#: Posture error below which the goal is reached, if the arm is at it [rad].
REACHED_POSTURE_ERROR = 0.15

#: What being at the goal, reaching it, and an impossible action earn.
NEAR_REWARD = 10.0
REACHED_REWARD = 20.0
IMPOSSIBLE_REWARD = -100.0

Flags = NDArray[np.bool_]


class RewardTerms(NamedTuple):
    """Terms of the reward, each of shape (...). `sum(terms)` is the reward, to the last bit.

    Added from left to right; the posture's terms come first because then the sum is also the thesis's r_d - r_e to
    the last bit. `_asdict()` gives the terms by name.

    Attributes:
        natural_arm: Minus the natural-arm error; 0 where the action was impossible or the goal is reached.
        gripper_angle: Minus the gripper-angle error; 0 in the same cases.
        distance: r_d; 0 in every special case.
        special: 10 below 0.01 m, 20 where the goal is reached, -100 where the action was impossible, else 0.
    """

    natural_arm: Floats
    gripper_angle: Floats
    distance: Floats
    special: Floats


@dataclass(frozen=True)
class ReachReward:
    """The reward of postures at distances from the goal.

    Attributes:
        reward: Shape (...).
        terms: Its terms.
        posture_error: r_e of the postures [rad], shape (...), whatever the special case.
        reached: Whether the goal is reached, shape (...): possible, d < 0.01 m and r_e < 0.15.
    """

    reward: Floats
    terms: RewardTerms
    posture_error: Floats
    reached: Flags


def distance_reward(d: ArrayLike) -> Floats:
    r"""Compute the reward of the distance, r_d (section 3.4.4, figure 3.8).

    .. math::

        r_d = \begin{cases} 1 - d/2 & d \ge 2 \\ 0.5 - 0.5 \log_2 d & d < 2 \end{cases}

    Both are 0 at d = 2 m. r_d falls with d, and is +inf at d = 0.

    Args:
        d: Distance from the tcp to the goal [m], shape (...).

    Returns:
        r_d, shape (...).

    Raises:
        InputError: A distance is negative or not finite.

    Examples:
        >>> from kinreach.thesis import distance_reward
        >>> distance_reward([4.0, 0.5, 0.125]).tolist()
        [-1.0, 1.0, 2.0]
    """
    distances = _distances(d)
    with np.errstate(divide="ignore"):
        return _distance_reward(distances, namespace(distances))


def reach_reward(d: ArrayLike, q: ArrayLike, *, impossible: ArrayLike = False) -> ReachReward:
    r"""Compute the thesis's reward with its special cases (section 3.4.4).

    .. math::

        r = \begin{cases}
        -100 & \text{the action was impossible} \\
        20 & d < 0.01 \text{ and } r_e < 0.15 \text{: the goal is reached} \\
        10 - r_e & d < 0.01 \text{ otherwise} \\
        r_d - r_e & \text{else}
        \end{cases}

    Args:
        d: Distance from the tcp to the goal [m]; its shape broadcasts with (...).
        q: Postures in which the arm stands [rad], shape (..., 6).
        impossible: Whether the action could not be executed; its shape broadcasts with (...).

    Returns:
        The reward and its terms, the posture error, and whether the goal is reached.

    Raises:
        InputError: Wrong shapes, a negative distance, or a value that is not finite.
    """
    away: Any = _distances(d)
    natural, angle = posture_errors(like(away, q) if is_tensor(away) else q)
    if is_tensor(natural):
        xp, away, failed = namespace(natural), like(natural, away), flags_like(natural, impossible)
        broadcast = xp.broadcast_tensors
    else:
        xp, failed = np, as_flags("impossible", impossible)[()]
        broadcast = xp.broadcast_arrays
    if not np.shape(natural) == away.shape == failed.shape:
        try:
            natural, angle, away, failed = broadcast(natural, angle, away, failed)
        except (ValueError, RuntimeError):
            shapes = f"d {away.shape}, q {(*np.shape(natural), 6)}, impossible {failed.shape}"
            raise InputError(f"leading shapes do not fit: {shapes}") from None
    return reward_of_errors(away, natural, angle, failed)


def reward_of_errors(away: Any, natural: Any, angle: Any, failed: Any) -> ReachReward:
    """Compute `reach_reward` from checked distances and the two errors of a posture, all of one shape."""
    xp = namespace(natural)
    r_e = natural + angle
    at_goal = away < REACHED_DISTANCE
    near = at_goal & ~failed
    reached = near & (r_e < REACHED_POSTURE_ERROR)
    without_posture, without_distance = reached | failed, near | failed
    paid = xp.where(reached, REACHED_REWARD, xp.where(near, NEAR_REWARD, xp.zeros_like(away)))
    terms = RewardTerms(
        natural_arm=xp.where(without_posture, 0.0, 0.0 - natural)[()],
        gripper_angle=xp.where(without_posture, 0.0, 0.0 - angle)[()],
        distance=xp.where(without_distance, 0.0, _distance_reward(xp.where(at_goal, REACHED_DISTANCE, away), xp))[()],
        special=xp.where(failed, IMPOSSIBLE_REWARD, paid)[()],
    )
    reward = terms.natural_arm + terms.gripper_angle + terms.distance + terms.special
    return ReachReward(reward, terms, r_e, reached)


def _distances(d: Any) -> Floats:
    if is_tensor(d):
        check_tensor("d", d, ())
        return d
    d = as_floats("d", d)
    usable = (d >= 0.0) & (d < np.inf)
    if not usable.all():
        raise InputError(f"d must be finite and not negative, got {d[~usable][0]} m")
    return d[()]


def _distance_reward(d: Floats, xp: Any) -> Floats:
    return xp.where(d >= 2.0, 1.0 - d / 2.0, 0.5 - 0.5 * xp.log2(d))[()]
