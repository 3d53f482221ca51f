"""Identification of an arm from measured positions or poses of its tip: least squares over its frames, with a prior.

Every frame of the chain, with base and tool, may be off by a small translation and a small turn. Measurements are
positions or poses of the tip in known postures; the frames are the most probable ones (maximum a posteriori,
Gauss-Newton).
Parameters that the measurements do not determine stay at the prior, so that no minimal set of parameters is needed
(Hollerbach and Wampler 1996, Int. J. Robotics Research 15). Joints may deviate from their commands by more parameters,
such as their compliance.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from kinreach._checks import Floats
from kinreach._rotations import turns_about_z

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
    r"""The most probable arm, and its uncertainty.

    .. math::

        \min_x \; \sum_{i=1}^{m} w_i \frac{|y_i - p(q_i; x)|^2}{\sigma^2} + \sum_k \frac{x_k^2}{s_k^2}, \qquad
        \Sigma = \left(J^\top J / \sigma^2 + S^{-2}\right)^{-1}

    over the errors x of the frames and the factors of the joints' terms, with their prior deviations s, the
    measurements y and the noise.

    Args:
        placements: Of the arm by its data sheet, A0 to An of `T = A0 Rz(q0) A1 Rz(q1) ... An`, shape (n + 1, 4, 4).
        q: Postures [rad], shape (m, n).
        seen: Measured positions of the tip [m], shape (m, 3), or its poses, shape (m, 4, 4).
        prior: Of the frames.
        noise: Standard deviation of each measured coordinate [m], above zero; of poses also of the rotation vector's
            [rad].
        terms: Deviations of the joints that are identified, too.
        weights: Of the postures, shape (m,); default is 1.
        steps: Of Gauss-Newton.

    Attributes:
        placements: Of the identified arm, without deviations of the joints, shape (n + 1, 4, 4).
        cost: Sum of the squared deviations from the data sheet, each in units of its standard deviation.
        covariance: Of the free parameters, shape (k, k).
        determined: How many of them the measurements determine rather than the prior.
    """

    def __init__(
        self,
        placements: Floats,
        q: Floats,
        seen: Floats,
        *,
        prior: Prior,
        noise: float | tuple[float, float],
        terms: JointTerms | None = None,
        weights: Floats | None = None,
        steps: int = STEPS,
    ) -> None:
        spread = prior.deviations(len(placements) - 1).ravel()
        self._free, frames_end = spread > 0.0, len(spread)
        if terms is not None:
            spread = np.concatenate([spread, terms.spread])
            self._free = np.concatenate([self._free, terms.spread > 0.0])
        prior_rows = np.diag(1.0 / spread[self._free])
        position, turn = noise if isinstance(noise, tuple) else (noise, 0.0)
        lever = position / turn if turn else 0.0  # turns as lengths, so that all rows have one noise
        roots = None if weights is None else np.sqrt(weights)
        offsets: Floats = np.zeros(int(self._free.sum()))
        self.placements: Floats = placements
        self._terms, self._factors = terms, np.zeros(len(spread) - frames_end)
        for _ in range(steps):
            frames, J = self._linearised(q)
            missed = (seen[:, :3, 3] if lever else seen) - frames[-1][:, :3, 3]
            if lever:
                J = np.concatenate([J, lever * self._turn_slopes(frames, q)])
                missed = np.concatenate([missed, lever * turns_between(frames[-1], seen)])
            if roots is not None:
                rows = np.tile(roots, 2) if lever else roots
                J, missed = J * np.repeat(rows, 3)[:, None], missed * rows[:, None]
            offset_missed = missed.ravel() + J @ offsets
            # by QR: the normal equations lose the directions that exact measurements hardly determine
            Q, R = np.linalg.qr(np.concatenate([J / position, prior_rows]))
            offsets = np.linalg.solve(R, Q[: J.shape[0]].T @ (offset_missed / position))
            errors = np.zeros(len(spread))
            errors[self._free] = offsets
            self.placements = moved_frames(placements, errors[:frames_end].reshape(-1, 6))
            self._factors = errors[frames_end:]
        self.cost = float(np.sum((prior_rows @ offsets) ** 2))
        inverse = np.linalg.inv(R)
        self.covariance: Floats = np.asarray(inverse @ inverse.T)
        self._root: Floats = R
        self.determined = float(len(offsets) - self._variances(prior_rows).sum())

    def positions(self, q: Floats) -> Floats:
        """Compute positions of the tip in postures (m, n) [m], shape (m, 3); for few faster than the chain."""
        return self._frames(q)[-1][:, :3, 3]

    def poses(self, q: Floats) -> Floats:
        """Compute poses of the tip in postures (m, n), shape (m, 4, 4)."""
        return self._frames(q)[-1]

    def doubt(self, q: Floats) -> float:
        """Compute the standard deviation of the tip's coordinates over postures (m, n) [m]."""
        J = self._linearised(q)[1]
        return float(np.sqrt(self._variances(J).mean()))

    def doubts(self, q: Floats) -> tuple[Floats, Floats]:
        """Compute the expected error of the tip in postures (m, n), root mean square: [m] and [rad], shape (m,)."""
        frames, J = self._linearised(q)
        apart, turned = (
            np.sqrt(self._variances(slope).reshape(-1, 3).sum(axis=1)) for slope in (J, self._turn_slopes(frames, q))
        )
        return apart, turned

    def _variances(self, J: Floats) -> Floats:
        """Of what depends on the parameters by rows (m, k), shape (m,): sums of squares, so that none is below 0."""
        return np.asarray((np.linalg.solve(self._root.T, J.T) ** 2).sum(axis=0))

    def _frames(self, q: Floats) -> list[Floats]:
        return frames_of(self.placements, q if self._terms is None else q + self._terms.of(q) @ self._factors)

    def _linearised(self, q: Floats) -> tuple[list[Floats], Floats]:
        """The frames in postures (m, n), and how the tips move with the free parameters, shape (3 m, k)."""
        frames = self._frames(q)
        return frames, self._with_terms(slopes(frames), q)

    def _turn_slopes(self, frames: list[Floats], q: Floats) -> Floats:
        return self._with_terms(turn_slopes(frames), q)

    def _with_terms(self, J: Floats, q: Floats) -> Floats:
        if self._terms is not None:
            J = np.concatenate([J, joint_slopes(J, self._terms.of(q))], axis=1)
        return J[:, self._free]


def turns_between(T: Floats, other: Floats) -> Floats:
    """Return the rotation vectors from poses (m, 4, 4) to others, in the base frame [rad], shape (m, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(other[:, :3, :3] @ T[:, :3, :3].swapaxes(1, 2)).as_rotvec()


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

    The fit needs every frame, and each posture may be of another chain; `kinreach.kinematics` has the tip's alone, and
    of thousands of postures four times as fast.

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


def turn_slopes(frames: list[Floats]) -> Floats:
    """How the tips turn with small motions of the frames in themselves, shape (3 m, 6 (n + 1))."""
    columns = [part for frame in frames for part in (np.zeros_like(frame[:, :3, :3]), frame[:, :3, :3])]
    return np.concatenate(columns, axis=2).reshape(3 * len(frames[0]), -1)


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
