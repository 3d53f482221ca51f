"""Identification of an arm from measured positions of its tip: least squares over its frames, with a prior.

Every frame of the chain, with base and tool, may be off by a small translation and a small turn. Measurements are
positions of the tip in known postures; the frames are the most probable ones (maximum a posteriori, Gauss-Newton).
Parameters that the measurements do not determine stay at the prior, so that no minimal set of parameters is needed
(Hollerbach and Wampler 1996, Int. J. Robotics Research 15). Joints may deviate from their commands by more parameters,
such as their compliance.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from kinreach._checks import Floats
from kinreach.kinematics._chain import SerialChain, turns_about_z

#: Steps of Gauss-Newton: the model is nearly linear in errors of a few millimetres.
STEPS = 4


class Prior(NamedTuple):
    """Standard deviations of how far frames are from where the data sheet has them, (translation [m], turn [rad]).

    Zeros stand for the data sheet's values.

    Attributes:
        base: Of the arm in the world in which the tip is seen.
        links: Of each joint in the frame of the joint before.
        tool: Of the tip on the last joint.
    """

    base: tuple[float, float]
    links: tuple[float, float]
    tool: tuple[float, float]

    def deviations(self, joints: int) -> Floats:
        """Those of each frame's translation (3) and turn (3), shape (joints + 1, 6)."""
        parts = [self.base, *[self.links] * (joints - 1), self.tool]
        return np.repeat(np.array(parts), 3, axis=1)


class JointTerms(NamedTuple):
    """How joints deviate from their commands, as a sum of terms with unknown factors.

    Attributes:
        of: From postures (m, n) [rad] to each joint's deviation by each term, shape (m, n, k).
        spread: Standard deviations of the factors, shape (k,).
    """

    of: Callable[[Floats], Floats]
    spread: Floats


class IdentifiedArm:
    """The most probable arm, and its uncertainty.

    Args:
        chain: The arm by its data sheet.
        q: Postures [rad], shape (m, n).
        seen: Measured positions of the tip [m], shape (m, 3).
        prior: Of the frames.
        noise: Standard deviation of each measured coordinate [m], above zero.
        terms: Deviations of the joints that are identified, too.

    Attributes:
        chain: The arm, without deviations of the joints.
    """

    def __init__(
        self,
        chain: SerialChain,
        q: Floats,
        seen: Floats,
        *,
        prior: Prior,
        noise: float,
        terms: JointTerms | None = None,
    ) -> None:
        spread = prior.deviations(chain.joints).ravel()
        self._free, frames_end = spread > 0.0, len(spread)
        if terms is not None:
            spread = np.concatenate([spread, terms.spread])
            self._free = np.concatenate([self._free, terms.spread > 0.0])
        precision = np.diag(1.0 / spread[self._free] ** 2)
        offsets: Floats = np.zeros(int(self._free.sum()))
        self._placements: Floats = chain.placements
        self._terms, self._factors = terms, np.zeros(len(spread) - frames_end)
        for _ in range(STEPS):
            frames, J = self._linearised(q)
            missed = (seen - frames[-1][:, :3, 3]).ravel() + J @ offsets
            information = J.T @ J / noise**2 + precision
            offsets = np.asarray(np.linalg.solve(information, J.T @ missed / noise**2))
            errors = np.zeros(len(spread))
            errors[self._free] = offsets
            self._placements = moved_frames(chain.placements, errors[:frames_end].reshape(-1, 6))
            self._factors = errors[frames_end:]
        self._covariance = np.linalg.inv(information)
        *links, tip = self._placements
        self.chain = SerialChain(links, [np.array((0.0, 0.0, 1.0))] * len(links), tip)

    def positions(self, q: Floats) -> Floats:
        """Compute positions of the tip in postures (m, n) [m], shape (m, 3); for few faster than the chain."""
        return self._frames(q)[-1][:, :3, 3]

    def doubt(self, q: Floats) -> float:
        """Compute the standard deviation of the tip's coordinates over postures (m, n) [m]."""
        J = self._linearised(q)[1]
        return float(np.sqrt(np.einsum("ij,jk,ik->i", J, self._covariance, J).mean()))

    def _frames(self, q: Floats) -> list[Floats]:
        return frames_of(self._placements, q if self._terms is None else q + self._terms.of(q) @ self._factors)

    def _linearised(self, q: Floats) -> tuple[list[Floats], Floats]:
        """The frames in postures (m, n), and how the tips move with the free parameters, shape (3 m, k)."""
        frames = self._frames(q)
        J = slopes(frames)
        if self._terms is not None:
            J = np.concatenate([J, joint_slopes(J, self._terms.of(q))], axis=1)
        return frames, J[:, self._free]


def moved_frames(placements: Floats, errors: Floats) -> Floats:
    """Placements (k, 4, 4), each followed by a small translation [m] and a turn [rad] (Rodrigues), shape (k, 6)."""
    moved = np.tile(np.eye(4), (len(errors), 1, 1))
    angle = np.linalg.norm(errors[:, 3:], axis=1)[:, None, None]
    K = _cross(errors[:, 3:])
    half = np.sinc(angle / (2.0 * np.pi))
    moved[:, :3, :3] += np.sinc(angle / np.pi) * K + 0.5 * half * half * K @ K
    moved[:, :3, 3] = errors[:, :3]
    return placements @ moved


def frames_of(placements: Floats, q: Floats) -> list[Floats]:
    """Each joint's frame before it turns, and the tip's, in the base frame: n + 1 arrays (m, 4, 4).

    Args:
        placements: Of the chain's frames, shape (n + 1, 4, 4), or of m chains, shape (n + 1, m, 4, 4).
        q: Postures [rad], shape (m, n).
    """
    frames, T = [], np.tile(np.eye(4), (len(q), 1, 1))
    for placement, angle in zip(placements, [*q.T, None], strict=True):
        T = T @ placement
        frames.append(T)
        if angle is not None:
            T = T @ turns_about_z(angle)
    return frames


def slopes(frames: list[Floats]) -> Floats:
    """How the tips move with small motions of the frames in themselves, shape (3 m, 6 (n + 1))."""
    tips = frames[-1][:, :3, 3]
    columns = []
    for frame in frames:
        R = frame[:, :3, :3]
        arm = np.einsum("mji,mj->mi", R, tips - frame[:, :3, 3])
        columns += [R, -R @ _cross(arm)]
    return np.concatenate(columns, axis=2).reshape(3 * len(tips), -1)


def joint_slopes(J: Floats, terms: Floats) -> Floats:
    """How the tips move with the factors of joint terms (m, n, k), shape (3 m, k), from the `slopes` there."""
    m, n, k = terms.shape
    turns = J[:, 5 : 6 * n : 6].reshape(m, 3, n)  # a joint turns about its frame's z axis
    return (turns @ terms).reshape(3 * m, k)


def _cross(vectors: Floats) -> Floats:
    """The matrices of the cross products with vectors (m, 3), shape (m, 3, 3)."""
    x, y, z = vectors.T
    zero = np.zeros(len(vectors))
    return np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
