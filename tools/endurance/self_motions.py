"""Self-motions of seven-axis arms: nothing that reaches a pose is beside its curves, near singularities and anywhere.

Postures come from the pose's making and from Newton's method out of random ones, and curves are compared with cubics
between their samples: nothing here is what the curves are made by.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from benchmarks.ik_arms.self_motions import ARMS, arm_of
from kinreach._checks import Floats
from kinreach.kinematics import ArmKinematics
from kinreach.kinematics._seven_axis.curves import SelfMotion
from kinreach.kinematics._seven_axis.kinematics import SevenAxisKinematics
from tools.endurance.outcome import Outcome, demand

#: Angles of a Panda's joints (0 is the first) at its singularities and where its links are in line, and how far beside
#: [rad]. Within the limits the elbow is bent by 0.07 and more.
SINGULAR = {
    "elbow stretched": ({3: 0.0}, 0.01, 0.07),
    "elbow within its limits": ({3: -0.0698}, 0.0, 0.05),
    "shoulder straight": ({1: 0.0}, 1e-6, 0.07),
    "wrist straight": ({5: 0.0}, 1e-6, 0.07),
    "shoulder straight and elbow stretched": ({1: 0.0, 3: 0.0}, 1e-3, 0.07),
}
#: Random starts of Newton's method at a pose, and its steps.
STARTS, STEPS = 300, 25
#: A cubic between two samples is nearer than this to the curve [rad].
CUBIC = 2e-3
#: Steps to a singular posture, by how much each joint is moved for the slope [rad], and a singular value of none.
DOWNHILL, SLOPE, AT_SINGULARITY = 40, 1e-7, 1e-4
#: By how much a pose may be missed [m, rad], and a seed that reaches it [rad].
MISSED, SAME = 1e-9, 1e-6


def beside_singularities(count: int) -> Outcome:
    """`count` poses next to each singularity of a Panda, and next to singular postures of each of eight arms."""
    within = sum(near_singularity(where, range(count)) for where in SINGULAR)
    tried = sum(near_singular_posture(name, range(count)) for name in ARMS)
    return Outcome(
        count * (len(SINGULAR) + len(ARMS)),
        "poses",
        f"{within + tried:,} postures within the limits, each the nearest to itself",
    )


def from_anywhere(count: int) -> Outcome:
    """`count` poses of each of eight arms."""
    compared = sum(reached_by_newton(name, range(count)) for name in ARMS)
    return Outcome(count * len(ARMS), "poses", f"{compared:,} postures on their curves")


def near_singularity(where: str, indices: Iterable[int]) -> int:
    """The posture behind each pose is on a curve, exact, and `nearest` returns nothing farther.

    Returns:
        How many of the postures were within the limits.

    Raises:
        BrokenPromiseError: It is not.
    """
    kin, within = _panda(), 0
    for index in indices:
        q = _made_near(kin, *SINGULAR[where], np.random.default_rng([index, *where.encode()]))
        within += _found_again(kin, q, f"{where}, pose {index}")
    return within


def near_singular_posture(name: str, indices: Iterable[int]) -> int:
    """As `near_singularity`, next to singular postures to which the Jacobian's smallest singular value leads.

    Args:
        name: One of `benchmarks.ik_arms.self_motions.ARMS`.
        indices: Seeds of postures.

    Returns:
        How many were next to a singular one, all within the limits.

    Raises:
        BrokenPromiseError: A posture is on no curve, or is not the nearest to itself.
    """
    kin, singular = arm_of(name, False), 0
    for index in indices:
        rng = np.random.default_rng([index, 13])
        q, least = _downhill(kin, rng.uniform(-np.pi, np.pi, 7))
        q = _wrapped(q + rng.normal(size=7) * 10.0 ** rng.uniform(-3.0, -1.0))
        within = _found_again(kin, q, f"{name}, singular pose {index}")
        singular += within and least < AT_SINGULARITY
    return singular


def _found_again(kin: SevenAxisKinematics, q: Floats, where: str) -> bool:
    """Demand that a posture is on a curve and nearest to itself; return whether it is within the limits."""
    T = kin.fk(q)
    motions = kin.self_motions(T, limits=False).curves
    demand(not beside(motions, q[None]).any(), f"{where}: its posture is on no curve")
    missed = max(np.abs(kin.fk(curve.q) - T).max() for curve in motions)
    demand(missed < MISSED, f"{where}: missed by {missed:.1e}")
    if not kin.within_limits(q):
        return False
    found = kin.nearest(T, q)
    right = found.success and max(found.position_error, found.orientation_error) < MISSED
    demand(right and np.linalg.norm(found.q - q) < SAME, f"{where}: nearest is {found}")
    return True


def _downhill(kin: ArmKinematics, q: Floats) -> tuple[Floats, float]:
    """A posture to which the slope of the smallest singular value leads, and that value there."""
    for _ in range(DOWNHILL):
        values = np.linalg.svd(kin.jacobian(q + np.vstack([np.zeros(7), SLOPE * np.eye(7)])))[1][:, 5]
        slope = (values[1:] - values[0]) / SLOPE
        if values[0] < AT_SINGULARITY:
            break
        step = -values[0] / max(float(slope @ slope), AT_SINGULARITY) * slope
        q = q + step * min(1.0, 0.5 / float(np.abs(step).max()))
    return q, float(values[0])


def reached_by_newton(name: str, indices: Iterable[int]) -> int:
    """What Newton's method reaches from anywhere is on the curves of a pose.

    Args:
        name: One of `benchmarks.ik_arms.self_motions.ARMS`.
        indices: Seeds of poses.

    Returns:
        How many postures were compared.

    Raises:
        BrokenPromiseError: One of them is on no curve.
    """
    kin, compared = arm_of(name, False), 0
    for index in indices:
        rng = np.random.default_rng([index, 11])
        q = rng.uniform(-np.pi, np.pi, 7)
        T = kin.fk(q)
        motions = kin.self_motions(T, limits=False).curves
        postures = np.vstack([q, _reached_from_anywhere(kin, T, rng)])
        demand(not beside(motions, postures).any(), f"{name}, pose {index}: a posture is on no curve")
        compared += len(postures)
    return compared


def beside(motions: Sequence[SelfMotion], q: Floats) -> NDArray[np.bool_]:
    """Which of postures (m, 7) are on no curve, by their distance from the cubics between its samples."""
    nearest = np.full(len(q), np.inf)
    for curve in motions:
        ends = np.arange(len(curve.q) - (not curve.closed)) if len(curve.q) > 1 else np.empty(0, dtype=int)
        samples = np.linalg.norm(_wrapped(q[:, None] - curve.q), axis=2)
        nearest = np.minimum(nearest, samples.min(axis=1))
        begin, end = curve.q[ends], curve.q[(ends + 1) % len(curve.q)]
        out, into = curve.tangent[ends], curve.tangent[(ends + 1) % len(curve.q)]
        away = _wrapped(end - begin)
        length = np.linalg.norm(away, axis=1, keepdims=True)
        row, piece = np.nonzero(samples[:, ends] < length[:, 0] + CUBIC)
        u = np.linspace(0.0, 1.0, 81)[:, None, None]
        cubics = u**2 * (3.0 - 2.0 * u) * away + length * u * (1.0 - u) * ((1.0 - u) * out - u * into)
        apart = np.linalg.norm(_wrapped(q[row] - begin[piece]) - cubics[:, piece], axis=2).min(axis=0, initial=np.inf)
        np.minimum.at(nearest, row, apart)
    return nearest > CUBIC


def _panda() -> SevenAxisKinematics:
    kin = ArmKinematics.of("panda")
    assert isinstance(kin, SevenAxisKinematics)
    return kin


def _wrapped(q: Floats) -> Floats:
    return (q + np.pi) % (2.0 * np.pi) - np.pi


def _made_near(
    kin: ArmKinematics, angles: dict[int, float], least: float, most: float, rng: np.random.Generator
) -> Floats:
    """A posture with some joints so far beside angles, within the limits if these are."""
    q = rng.uniform(kin.lower, kin.upper)
    for joint, angle in angles.items():
        beside_it = rng.choice([-1.0, 1.0]) * rng.uniform(least, most)
        q[joint] = angle - abs(beside_it) if least == 0.0 else angle + beside_it
    return q


def _reached_from_anywhere(kin: ArmKinematics, T: Floats, rng: np.random.Generator) -> Floats:
    """Postures that reach a pose, by damped Newton steps from random ones."""
    q = rng.uniform(-np.pi, np.pi, (STARTS, 7))
    for _ in range(STEPS):
        reached = kin.fk(q)
        turn = T[:3, :3] @ reached[:, :3, :3].transpose(0, 2, 1)
        axis = 0.5 * np.stack([turn[:, i, j] - turn[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1)
        error = np.concatenate([T[:3, 3] - reached[:, :3, 3], axis], axis=1)
        J = kin.jacobian(q)
        damped = J @ J.transpose(0, 2, 1) + 1e-3 * np.linalg.norm(error, axis=1)[:, None, None] ** 2 * np.eye(6)
        step = (J.transpose(0, 2, 1) @ np.linalg.solve(damped + 1e-15 * np.eye(6), error[..., None]))[..., 0]
        q += step * np.minimum(1.0, 0.5 / np.maximum(np.abs(step).max(axis=1), 0.5))[:, None]
    return q[np.abs(kin.fk(q) - T).max(axis=(1, 2)) < 1e-11]
