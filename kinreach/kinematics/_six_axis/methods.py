"""How the postures of a six-axis arm are found, one class a way; all give the same."""

from __future__ import annotations

from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.kinematics._angles import wrapped
from kinreach.kinematics._general_6r import EXACT, MAX_POSTURES, Chain, General6R, newton
from kinreach.kinematics._six_axis.batch import solve_poses
from kinreach.kinematics._six_axis.closed_form import DecoupledArm, Doubt, NotDecoupled
from kinreach.kinematics._six_axis.dh import DenavitHartenberg
from kinreach.kinematics._solutions import ANGLES, BRANCH, Row
from kinreach.kinematics._ur.geometry import BRANCHES

#: Lengths [m] and angles [rad] below which an arm of the closed form has zeros: exactly, and nearly.
EXACTLY, NEARLY = (1e-9, 1e-9), (3e-3, 5e-3)
#: How far an arm of the closed form may be off its parameters [m, rad], and one that is nearly of it.
EXACT_FIT, NEAR_FIT = 1e-10, 0.03
#: By how many times that a pose may be missed by the closed form and yet be reached.
CAUTION = 10.0
#: Newton's method moves a joint no further than this on the way to the posture of the same branch [rad].
FAR = 0.1
#: Random postures by which a method is judged, and the share that elimination has to find again.
TRIALS, MIN_SHARE = 100, 0.98
#: Two postures nearer than this are one [rad].
SAME = 1e-6
_JOINTS = 6


class Method(Protocol):
    """Finds every posture of poses.

    Attributes:
        branches: Most postures of a pose.
    """

    branches: int

    def one(self, T: Floats, seed: Floats, tol: float) -> list[Row]:
        """Compute the postures for a pose (4, 4): branch index, flags and angles of each, by branch index.

        Joints that are free keep the seed's value, as far as they can.
        """

    def many(self, T: Floats, seeds: Floats, tol: float) -> tuple[Floats, NDArray[np.bool_]]:
        """Compute postures (6, branches, m) for poses (m, 4, 4), NaN where there is none, and which there are."""


class ClosedForm:
    """An arm that decouples, to rounding."""

    branches = BRANCHES

    def __init__(self, arm: DecoupledArm) -> None:
        self._arm = arm

    def one(self, T: Floats, seed: Floats, tol: float) -> list[Row]:
        return sorted(self._arm.solve(T, tol=tol, seed=seed.tolist()))

    def many(self, T: Floats, seeds: Floats, tol: float) -> tuple[Floats, NDArray[np.bool_]]:
        q, valid, _ = solve_poses(self._arm, T, seeds, tol)
        return q, valid


class NearClosedForm:
    """An arm that almost decouples: Newton's method from the closed form, and elimination where that may miss one.

    Args:
        arm: The arm that decouples.
        placements: The arm itself, as in `Chain`.
        off: How far their poses are apart [m, rad].
    """

    branches = MAX_POSTURES

    def __init__(self, arm: DecoupledArm, placements: Floats, off: float) -> None:
        self._arm, self._off = arm, CAUTION * off
        self._chain = Chain(placements)

    @cached_property
    def _general(self) -> General6R:
        method = General6R(self._chain)
        method.tried(_random_postures())
        return method

    def one(self, T: Floats, seed: Floats, tol: float) -> list[Row]:
        doubt = Doubt(self._off, self._arm.size)
        start = self._arm.solve(T, tol=EXACT, seed=seed.tolist(), doubt=doubt)
        found = np.array([row[ANGLES] for row in start]).reshape(-1, _JOINTS)
        q, off = newton(self._chain, found, np.broadcast_to(T, (len(found), 4, 4)))
        if not doubt.found and all(
            flags == 0 and miss < EXACT and moved < FAR
            for (_, flags, *_), miss, moved in zip(start, off, np.abs(q - found).max(axis=1, initial=0.0), strict=True)
        ):
            return sorted((row[BRANCH], 0, *angles) for row, angles in zip(start, wrapped(q).tolist(), strict=True))
        return self._by_elimination(T, q[off < EXACT], start, tol)

    def many(self, T: Floats, seeds: Floats, tol: float) -> tuple[Floats, NDArray[np.bool_]]:
        q, valid = np.full((_JOINTS, MAX_POSTURES, len(T)), np.nan), np.zeros((MAX_POSTURES, len(T)), dtype=np.bool_)
        start, exists, doubtful = solve_poses(self._arm, T, seeds, EXACT, off=self._off)
        branch, row = np.nonzero(exists & ~doubtful)
        found, off = newton(self._chain, start[:, branch, row].T, T[row])
        moved = np.abs(found - start[:, branch, row].T).max(axis=1, initial=0.0)
        good = (off < EXACT) & (moved < FAR)
        q[:, branch, row], valid[branch, row] = wrapped(found).T, good
        doubtful[row[~good]] = True
        for index in np.flatnonzero(doubtful):
            q[..., index], valid[:, index] = np.nan, False
            for branch_, _, *angles in self.one(T[index], seeds[index], tol):
                q[:, branch_, index], valid[branch_, index] = angles, True
        return q, valid

    def _by_elimination(self, T: Floats, known: Floats, start: list[Row], tol: float) -> list[Row]:
        """Postures of a pose near a singular one; those near the closed form's have its branch index."""
        (found,) = self._general.solve(T[None], tol=tol)
        every: list[Floats] = []
        for q in wrapped(np.vstack([known, found])):
            if not any(np.abs(wrapped(q - other)).max() < SAME for other in every):
                every.append(q)
        rows, taken = [], set()
        for q in every[:MAX_POSTURES]:
            near = [row[BRANCH] for row in start if np.abs(wrapped(q - row[ANGLES])).max() < FAR]
            branch = next((one for one in near if one not in taken), None)
            rows.append((branch, q))
            taken.add(branch)
        spare = iter([one for one in [*range(BRANCHES, MAX_POSTURES), *range(BRANCHES)] if one not in taken])
        return sorted((next(spare) if branch is None else branch, 0, *q.tolist()) for branch, q in rows)


class Elimination:
    """Any other arm."""

    branches = MAX_POSTURES

    def __init__(self, general: General6R) -> None:
        self._general = general

    def one(self, T: Floats, seed: Floats, tol: float) -> list[Row]:
        (found,) = self._general.solve(T[None], tol=tol)
        return [(index, 0, *q) for index, q in enumerate(found.tolist())]

    def many(self, T: Floats, seeds: Floats, tol: float) -> tuple[Floats, NDArray[np.bool_]]:
        q, valid = np.full((_JOINTS, MAX_POSTURES, len(T)), np.nan), np.zeros((MAX_POSTURES, len(T)), dtype=np.bool_)
        for row, found in enumerate(self._general.solve(T, tol=tol)):
            q[:, : len(found), row], valid[: len(found), row] = found.T, True
        return q, valid


class Backwards:
    """The same arm from its tip to its base.

    Args:
        method: Of the arm that begins with the last joint.
    """

    def __init__(self, method: Method) -> None:
        self._method, self.branches = method, method.branches

    def one(self, T: Floats, seed: Floats, tol: float) -> list[Row]:
        rows = self._method.one(np.linalg.inv(T), -seed[::-1], tol)
        return [(branch, flags, *[-angle for angle in q[::-1]]) for branch, flags, *q in rows]

    def many(self, T: Floats, seeds: Floats, tol: float) -> tuple[Floats, NDArray[np.bool_]]:
        q, valid = self._method.many(np.linalg.inv(T), -seeds[:, ::-1], tol)
        return -q[::-1], valid


def method_of(placements: Floats) -> Method | float:
    """Choose how an arm is solved: in closed form, nearly so, or by elimination, from its base or from its tip.

    Args:
        placements: The arm, as in `Chain`.

    Returns:
        The method; or, if there is none, the share of random postures that elimination finds again.
    """
    back: Floats = np.asarray(np.linalg.inv(placements[::-1]), dtype=np.float64)
    for (length, angle), most in ((EXACTLY, EXACT_FIT), (NEARLY, NEAR_FIT)):
        fits = []
        for way in (placements, back):
            dh = DenavitHartenberg.of(way, length=length, angle=angle)
            off = _apart(dh, Chain(way))
            try:
                fits.append((off, DecoupledArm(dh)) if off < most else None)
            except NotDecoupled:
                fits.append(None)
        if any(fits):
            backwards = fits[0] is None or (fits[1] is not None and most > EXACT_FIT and fits[1][0] < fits[0][0])
            off, arm = fits[backwards]
            method = (
                ClosedForm(arm) if most == EXACT_FIT else NearClosedForm(arm, back if backwards else placements, off)
            )
            return Backwards(method) if backwards else method
    q = _random_postures()
    ways = (placements, q), (back, -q[:, ::-1])
    methods = [General6R(Chain(way)) for way, _ in ways]
    shares = [general.tried(postures) for general, (_, postures) in zip(methods, ways, strict=True)]
    best = int(np.argmax(shares))
    if shares[best] < MIN_SHARE:
        return shares[best]
    return Backwards(Elimination(methods[best])) if best else Elimination(methods[best])


def _apart(dh: DenavitHartenberg, chain: Chain) -> float:
    """How far the poses of two arms are apart at most, over random postures [m, rad]."""
    q = _random_postures()
    return float(np.abs(dh.fk(q)[:, :3] - chain.fk(q)).max())


def _random_postures() -> Floats:
    return np.random.default_rng(0).uniform(-np.pi, np.pi, (TRIALS, _JOINTS))
