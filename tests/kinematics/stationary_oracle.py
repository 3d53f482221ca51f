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
        self.chain, self.n, self.p = kin.chain, kin.n, T[:3, 3]
        self.W = np.outer(T[:3, 2], [0.0, 0.0, 1.0]) if axis_only else T[:3, :3]
        self.lower, self.upper = kin.lower, kin.upper

    def derivatives(self, q):
        """Trace, its gradient, Jacobian of the position (m, n, 3), rest of the way, axes and rotations of postures."""
        T, J = self.chain.fk(q), self.chain.jacobian(q).swapaxes(1, 2)
        R, z = T[:, :3, :3], J[:, :, 3:]
        a = sum(np.cross(R[:, :, c], self.W[:, c]) for c in range(3))
        return (R * self.W).sum((1, 2)), np.einsum("mir,mr->mi", z, a), J[:, :, :3], self.p - T[:, :3, 3], z, R

    def _hessian(self, parts, multipliers):
        f, _, J, _, z, R = parts
        S, H = self.W @ R.swapaxes(1, 2), np.empty((len(f), self.n, self.n))
        for i in range(self.n):
            for j in range(i, self.n):
                turned = np.einsum("mr,mrs,ms->m", z[:, j], S, z[:, i]) - (z[:, i] * z[:, j]).sum(1) * f
                H[:, i, j] = H[:, j, i] = turned - (multipliers * np.cross(z[:, i], J[:, j])).sum(1)
        return H

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


def _distinct(q, f):
    kept = []
    for i in range(len(q)):
        if not any(np.abs(wrapped(q[i] - q[k])).max() < 1e-4 for k in kept):
            kept.append(i)
    return q[kept], f[kept]
