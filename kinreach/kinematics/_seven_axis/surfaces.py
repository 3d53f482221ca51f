"""Surfaces of postures of a seven-axis arm's pose: where two pairs of axes coincide it has more freedom than a curve.

With the shoulder and the wrist of an arm such as an iiwa straight, joint 1 turns against joint 3, and joint 5 against
joint 7. From one posture a surface is covered outwards: a step in each of some directions of the plane in which the
joints move without the tip, and back to the pose by the shortest way. Singular values below `FREE` are 0 there: beside
a pose with a surface are others whose curves go all over it, and between them the postures miss the pose by less than
`ON_SURFACE`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach._rotations import wrapped
from kinreach.kinematics._general_6r import Chain

#: Singular values below this are 0 on a surface [m/rad, 1].
FREE = 1e-6
#: A posture is on a surface if it misses the pose by less [m, rad].
ON_SURFACE = 5e-10
#: Steps over a surface by the joint that moves most [rad], and how near two of its postures are, in shares of a step.
STRIDES, SPACING = (0.4, 0.8, 1.6), 0.7
#: Most postures of a surface with the shorter strides.
ENOUGH = 1000
#: A surface has at least so many postures; what has fewer is one posture, or a few.
LEAST = 12
#: Steps of Newton's method back to the pose, and where it ends [m, rad].
NEWTON, REACHED = 5, 1e-13
#: Directions in which a surface is covered, and those in which a family of three parameters is.
_TURNS = np.pi / 3.0 * np.arange(6)
_FLAT = np.column_stack([np.zeros(6), np.cos(_TURNS), np.sin(_TURNS)])
_CORNERS = np.stack(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0]), axis=-1).reshape(-1, 3) / np.sqrt(3.0)
_SOLID = np.vstack([np.eye(3), -np.eye(3), _CORNERS])


def surfaces_through(loop: Chain, q: Floats, T: Floats) -> tuple[list[Floats], Floats]:
    """Cover the surfaces of a pose (4, 4) on which some of its postures (m, 7) are.

    Returns:
        For each surface postures all over it (k, 7); and those of the given ones that are on none.
    """
    if len(q):  # from the most singular ones: others may be a little beside
        q = q[np.argsort(np.linalg.svd(loop.jacobian(q)[1])[1][:, 5], kind="stable")]
    found: list[Floats] = []
    others = [q[:0]]
    while len(q):
        cover = q[:0]
        for stride in STRIDES:
            cover = _covered(loop, q[:1], T, stride)
            if len(cover) <= ENOUGH:
                break
        if len(cover) < LEAST:
            others.append(q[:1])
            q = q[1:]
            continue
        found.append(cover)
        q = q[~on_cover(cover, q, stride)]
    return found, np.vstack(others)


def on_cover(cover: Floats, q: Floats, stride: float = STRIDES[0]) -> NDArray[np.bool_]:
    """Which of postures (m, 7) are as near to some of a surface (k, 7) as those are to each other."""
    return _farthest_joint(q, cover).min(axis=1, initial=np.inf) < stride


def moved_onto(loop: Chain, q: Floats, T: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Bring postures (m, 7) to a surface of a pose (4, 4) by the shortest way.

    Returns:
        Postures; how far they miss the pose [m, rad], shape (m,); the Jacobian's singular values (m, 6); and its right
        singular vectors (m, 7, 7), of which the last do not move the tip.
    """
    q = q.copy()
    for left in range(NEWTON, -1, -1):
        error, J, off = loop.step(q, T[None])
        U, s, V = np.linalg.svd(J)
        if not left or (off < REACHED).all():
            break
        inverse = np.divide(1.0, s, out=np.zeros_like(s), where=s > FREE)
        way = (((error[:, None] @ U)[:, 0] * inverse)[:, None] @ V[:, :6])[:, 0]
        q += way * np.minimum(1.0, 0.3 / np.maximum(np.abs(way).max(axis=1), 0.3))[:, None]
    return q, off, s, V


def _covered(loop: Chain, start: Floats, T: Floats, stride: float) -> Floats:
    """Postures (k, 7) all over the surface through one of them (1, 7), until there are more than `ENOUGH`."""
    cover = fresh = start
    most = ENOUGH if stride < STRIDES[-1] else 2 * ENOUGH
    while len(fresh) and len(cover) <= most:
        _, s, V = np.linalg.svd(loop.step(fresh, T[None])[1])
        solid = s[:, 4] < FREE
        steps = np.vstack([_FLAT @ V[~solid, 4:].reshape(-1, 3, 7), np.empty((0, 6, 7))]).reshape(-1, 7)
        more = (_SOLID @ V[solid, 4:].reshape(-1, 3, 7)).reshape(-1, 7)
        begins = np.vstack([np.repeat(fresh[~solid], len(_FLAT), axis=0), np.repeat(fresh[solid], len(_SOLID), axis=0)])
        steps = np.vstack([steps, more])
        steps *= stride / np.abs(steps).max(axis=1, keepdims=True)
        q, off, s, _ = moved_onto(loop, begins + steps, T)
        slipped = np.linalg.norm(q - begins - steps, axis=1) > 0.5 * stride
        q = wrapped(q[(off < ON_SURFACE) & (s[:, 5] < FREE) & ~slipped])
        q = q[_farthest_joint(q, cover).min(axis=1, initial=np.inf) > SPACING * stride]
        kept: list[int] = []
        apart = _farthest_joint(q, q) > SPACING * stride
        for row in range(len(q)):
            if apart[row, kept].all():
                kept.append(row)
        fresh = q[kept]
        cover = np.vstack([cover, fresh])
    return cover


def _farthest_joint(q: Floats, others: Floats) -> Floats:
    """Differences of postures (m, 7) and (k, 7) in the joint that differs most [rad], shape (m, k)."""
    most = np.zeros((len(q), len(others)))
    for joint in range(q.shape[1]):
        np.maximum(most, np.abs(wrapped(q[:, joint, None] - others[:, joint])), out=most)
    return most
