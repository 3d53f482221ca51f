"""Postures with the tip at a point at which the orientation error is stationary: Newton's method from many starts.

Written apart from the core, in numpy, and without any of an arm's geometry. With limits by scipy's SLSQP.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from kinreach._rotations import wrapped

STEPS = 40


class Oracle:
    """Stationary postures of an arm for a point and an orientation, or for a point and a direction of the z axis.

    Args:
        kin: The arm.
        T: The pose, shape (4, 4).
        axis_only: Its third column is the direction; else the orientation counts.
    """

    def __init__(self, kin, T, *, axis_only=False):
        self.placements, self.n, self.p = kin.chain.placements, kin.n, T[:3, 3]
        self.W = np.outer(T[:3, 2], [0.0, 0.0, 1.0]) if axis_only else T[:3, :3]
        self.lower, self.upper = kin.lower, kin.upper

    def derivatives(self, q):
        """Trace, its gradient, Jacobian of the position (m, n, 3), rest of the way, axes and rotations of postures."""
        R, p, z, o = np.broadcast_to(np.eye(3), (len(q), 3, 3)), np.zeros((len(q), 3)), [], []
        for A, angle in zip(self.placements, [*q.T, None], strict=True):
            R, p = R @ A[:3, :3], p + R @ A[:3, 3]
            if angle is not None:
                z.append(R[:, :, 2])
                o.append(p)
                c, s, x, y = np.cos(angle)[:, None], np.sin(angle)[:, None], R[:, :, 0], R[:, :, 1]
                R = np.stack([c * x + s * y, c * y - s * x, z[-1]], axis=2)
        z, S = np.stack(z, axis=1), R @ self.W.T
        a = np.stack([S[:, 1, 2] - S[:, 2, 1], S[:, 2, 0] - S[:, 0, 2], S[:, 0, 1] - S[:, 1, 0]], axis=1)
        J = _cross(z, p[:, None] - np.stack(o, axis=1))
        return np.trace(S, axis1=1, axis2=2), (z @ a[:, :, None])[:, :, 0], J, self.p - p, z, R

    def _hessian(self, parts, multipliers):
        f, _, J, _, z, R = parts
        turned = z @ R @ self.W.T @ z.swapaxes(1, 2) - z @ z.swapaxes(1, 2) * f[:, None, None]
        H = np.triu(turned - _cross(multipliers[:, None], z) @ J.swapaxes(1, 2))
        return H + np.triu(H, 1).swapaxes(1, 2)

    def stationary(self, rng, starts):
        """Postures that Newton's method converges to from random starts at the point, and their traces."""
        n, q = self.n, rng.uniform(-np.pi, np.pi, (starts, self.n))
        for _ in range(STEPS):
            parts = self.derivatives(q)
            J, away = parts[2], parts[3]
            step = _solved(np.einsum("mir,mis->mrs", J, J) + 1e-6 * np.eye(3), away)
            q = q + _short(np.einsum("mir,mr->mi", J, step), 0.5)
        q = q[np.linalg.norm(self.derivatives(q)[3], axis=1) < 1e-4]
        if not len(q):
            return q, np.empty(0)
        parts = self.derivatives(q)
        J = parts[2]
        start = np.einsum("mir,mi->mr", J, parts[1])
        multipliers = _solved(np.einsum("mir,mis->mrs", J, J) + 1e-12 * np.eye(3), start)
        for _ in range(STEPS):
            J = parts[2]
            K = np.zeros((len(q), n + 3, n + 3))
            K[:, :n, :n], K[:, :n, n:], K[:, n:, :n] = self._hessian(parts, multipliers), -J, J.swapaxes(1, 2)
            x = _solved(K + 1e-15 * np.eye(n + 3), np.hstack([-parts[1], parts[3]]))
            q, multipliers = q + _short(x[:, :n], 0.3), x[:, n:]
            parts = self.derivatives(q)
        rest = np.abs(parts[1] - np.einsum("mir,mr->mi", parts[2], multipliers)).max(axis=1)
        there = (rest < 1e-9) & (np.linalg.norm(parts[3], axis=1) < 1e-9) & (parts[0] > -1 + 1e-6)
        return _distinct(wrapped(q[there]), parts[0][there])

    def least_within_limits(self, rng, starts):
        """Postures at which SLSQP ends from random starts within the limits, and their traces."""
        ends = []
        for q in rng.uniform(self.lower, self.upper, (starts, self.n)):
            found = minimize(
                lambda q: tuple(-part[0] for part in self.derivatives(q[None])[:2]),
                q,
                jac=True,
                bounds=list(zip(self.lower, self.upper, strict=True)),
                constraints={
                    "type": "eq",
                    "fun": lambda q: -self.derivatives(q[None])[3][0],
                    "jac": lambda q: self.derivatives(q[None])[2][0].T,
                },
                method="SLSQP",
                options={"ftol": 1e-13, "maxiter": 200},
            )
            if found.success and np.linalg.norm(self.derivatives(found.x[None])[3]) < 1e-7 and -found.fun > -1 + 1e-5:
                ends.append((found.x, -found.fun))
        return np.array([q for q, _ in ends]).reshape(-1, self.n), np.array([f for _, f in ends])


def _solved(A, b):
    with np.errstate(all="ignore"):
        try:
            return np.linalg.solve(A, b[..., None])[..., 0]
        except np.linalg.LinAlgError:
            return np.full_like(b, np.nan)


def _short(step, most):
    return step / np.maximum(1.0, np.abs(step).max(axis=1, keepdims=True) / most)


def _cross(a, b):
    return a[..., [1, 2, 0]] * b[..., [2, 0, 1]] - a[..., [2, 0, 1]] * b[..., [1, 2, 0]]


def _distinct(q, f):
    kept = []
    for i in range(len(q)):
        if not (np.abs(wrapped(q[i] - q[kept])).max(axis=1) < 1e-4).any():
            kept.append(i)
    return q[kept], f[kept]
