"""How natural a posture of the UR5 is: the thesis's natural-arm and gripper-angle errors (section 3.4.4).

`q` is one posture or a stack of them, shape (..., 6), in the base_link convention [rad], with the thesis's names
j0 ... j5 for its entries (shoulder_pan, shoulder_lift, elbow, wrist_1, wrist_2, wrist_3). Results have the leading
dimensions; for one posture they are floats. Tensors of torch stay on their device and in their precision, with
gradients; their values are not checked.

Where the thesis leaves something open:

*   **Natural branches.** Branch A is j0 <= 0 and j2 >= 0, branch B is j0 >= 0 and j2 <= 0. At j0 = j2 = 0 both hold,
    and the posture is natural if it is so on either: the branch with the smaller posture error counts. Outside both
    the natural-arm error is 25; the gripper-angle error needs a branch there too, and takes the one that the elbow's
    sign names, for the elbow decides to which side the pentagon bends.
*   **Angles.** The thesis draws alpha, beta and gamma and gives no formula. They are -j1, j2, -j3 on branch A and
    pi + j1, -j2, pi + j3 on branch B, which makes delta pi/2 exactly where the gripper is perpendicular. Nothing is
    wrapped: with joints within ±pi a gripper that is perpendicular a turn further (delta = pi/2 ± 2 pi) has the error
    2 pi, as in the thesis's algebra.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import MAX_ANGLE, Floats, as_floats, check_entries, check_tensor, is_tensor
from kinreach._tensors import namespace
from kinreach.errors import InputError

#: Natural-arm error of a posture on neither branch.
UNNATURAL_ERROR = 25.0

_HALF_PI = math.pi / 2
_DOF = 6

Flags = NDArray[np.bool_]


class PentagonAngles(NamedTuple):
    """Angles of the pentagon of figure 3.4 [rad], each of shape (...).

    Attributes:
        alpha: At the shoulder, figure 3.5.
        beta: Of the elbow, figure 3.6; the pentagon's interior angle is pi - beta.
        gamma: At wrist_1, figure 3.7.
        delta: At the gripper; pi/2 where it is perpendicular to the ground.
    """

    alpha: Floats
    beta: Floats
    gamma: Floats
    delta: Floats


class _Joints(NamedTuple):
    """j0 ... j4 of the thesis, each of shape (...); j5 turns the gripper about its own axis and changes nothing."""

    j0: Floats
    j1: Floats
    j2: Floats
    j3: Floats
    j4: Floats


def pentagon_angles(q: ArrayLike) -> PentagonAngles:
    r"""Compute the angles of the pentagon that the arm makes with the ground (section 3.4.4, figures 3.4-3.7).

    .. math::

        (\alpha, \beta, \gamma) = \begin{cases}
        (-j_1,\ j_2,\ -j_3) & \text{branch A} \\
        (\pi + j_1,\ -j_2,\ \pi + j_3) & \text{branch B}
        \end{cases}
        \qquad \delta = 2\pi - \gamma - (\pi - \beta) - \alpha

    because the interior angles of a pentagon sum to 3 pi, and two of them are right angles.

    Args:
        q: Postures [rad], shape (..., 6).

    Returns:
        The angles [rad], each of shape (...).

    Raises:
        InputError: Wrong shape, or an angle that is not finite.
    """
    _, j1, j2, j3, _ = joints = _joints(q)
    xp = namespace(j1)
    on_b = _on_branch_b(joints, xp)
    alpha = xp.where(on_b, math.pi + j1, -j1)[()]
    beta = xp.where(on_b, -j2, j2)[()]
    gamma = xp.where(on_b, math.pi + j3, -j3)[()]
    return PentagonAngles(alpha, beta, gamma, 2.0 * math.pi - gamma - (math.pi - beta) - alpha)


def posture_errors(q: ArrayLike) -> tuple[Floats, Floats]:
    """Compute the two parts of `posture_error` [rad], n and |pi/2 - delta|, each of shape (...)."""
    j0, _, j2, _, _ = joints = _joints(q)
    xp = namespace(j0)
    wrist, angle = _errors_on(_on_branch_b(joints, xp), joints, xp)
    natural = ((j0 <= 0.0) & (j2 >= 0.0)) | ((j0 >= 0.0) & (j2 <= 0.0))
    return xp.where(natural, wrist, UNNATURAL_ERROR)[()], angle


def posture_error(q: ArrayLike) -> Floats:
    r"""Compute the error of the posture (section 3.4.4), with the angles of `pentagon_angles`.

    .. math::

        r_e = n + |\pi/2 - \delta|, \qquad n = \begin{cases}
        |j_4 + \pi/2| & j_0 \le 0 \text{ and } j_2 \ge 0 \text{ (branch A)} \\
        |j_4 - \pi/2| & j_0 \ge 0 \text{ and } j_2 \le 0 \text{ (branch B)} \\
        25 & \text{otherwise}
        \end{cases}

    The first part is how far wrist_2 is from where the gripper points down in a natural posture. The second is
    ``|j1 + j2 + j3 + pi/2|`` on branch A and ``|j1 + j2 + j3 + 3 pi/2|`` on B: with wrist_2 at the branch's ∓pi/2, the
    tilt of the tool axis from straight down, plus whole turns.

    Args:
        q: Postures [rad], shape (..., 6).

    Returns:
        r_e [rad], shape (...).

    Raises:
        InputError: Wrong shape, or an angle that is not finite.
    """
    natural, angle = posture_errors(q)
    return natural + angle


def _joints(q: Any) -> _Joints:
    if is_tensor(q):
        check_tensor("q", q, (_DOF,))
        return _Joints(*q.unbind(-1)[: _DOF - 1])
    q = as_floats("q", q)
    if q.ndim == 0 or q.shape[-1] != _DOF:
        raise InputError(f"q must have shape (..., {_DOF}), got {q.shape}")
    check_entries("q", q, MAX_ANGLE)
    return _Joints(*(q[..., joint] for joint in range(_DOF - 1)))


def _on_branch_b(joints: _Joints, xp: Any) -> Flags:
    """Whether branch B counts: the elbow decides, with a straight elbow the base, and with both at 0 the errors.

    The joints are arrays of the library `xp`.
    """
    j0, _, j2, _, _ = joints
    straight = j2 == 0.0
    on_b: Flags = (j2 < 0.0) | (straight & (j0 > 0.0))
    if xp is not np or straight.any():  # to ask a tensor would wait for its device
        error_a, error_b = (sum(_errors_on(xp.full_like(straight, branch), joints, xp)) for branch in (False, True))
        on_b = xp.where(straight & (j0 == 0.0), error_b < error_a, on_b)
    return on_b


def _errors_on(on_b: Flags, joints: _Joints, xp: Any) -> tuple[Floats, Floats]:
    """Errors of wrist_2 and of the gripper's angle, |pi/2 - delta| with the pentagon's angles put in, on a branch."""
    _, j1, j2, j3, j4 = joints
    bend = j1 + j2 + j3
    wrist_2 = xp.where(on_b, j4 - _HALF_PI, j4 + _HALF_PI)
    return abs(wrist_2), abs(xp.where(on_b, bend + 3.0 * _HALF_PI, bend + _HALF_PI))
