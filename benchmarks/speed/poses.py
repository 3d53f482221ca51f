"""Poses of a UR on and next to the singularities, for benchmarks and tests.

Every case is a function of a random generator, a count and the arm's kinematics (the UR5's if none is given), and
returns poses of tool0 in base_link, (count, 4, 4), that a posture within +-pi reaches to 1e-8.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from kinreach.kinematics import URKinematics

Poses = np.ndarray
FLANGE = URKinematics("ur5-thesis")


def _postures(rng: np.random.Generator, count: int) -> np.ndarray:
    return rng.uniform(-np.pi, np.pi, (count, 6))


def random_poses(rng: np.random.Generator, count: int, arm: URKinematics = FLANGE) -> Poses:
    """Poses of random postures: the regular case."""
    return arm.fk(_postures(rng, count))


def wrist_singular(rng: np.random.Generator, count: int, arm: URKinematics = FLANGE) -> Poses:
    """Sin q5 = 0: wrist_3 is parallel to the three middle axes."""
    q = _postures(rng, count)
    q[:, 4] = rng.choice((0.0, np.pi), count)
    return arm.fk(q)


def elbow_stretched(rng: np.random.Generator, count: int, arm: URKinematics = FLANGE) -> Poses:
    """Elbow at q3 = 0."""
    q = _postures(rng, count)
    q[:, 2] = 0.0
    return arm.fk(q)


def elbow_overstretched(rng: np.random.Generator, count: int, arm: URKinematics = FLANGE) -> Poses:
    """Elbow at q3 = 0, then 1e-9 m further out along the arm."""
    q = _postures(rng, count)
    q[:, 2] = 0.0
    T = arm.fk(q)
    along = np.column_stack([np.cos(q[:, 0]) * np.cos(q[:, 1]), np.sin(q[:, 0]) * np.cos(q[:, 1]), np.sin(q[:, 1])])
    T[:, :3, 3] += 1e-9 * along * (1.0, 1.0, -1.0)  # base_link is the DH base turned by pi; a2 and a3 are negative
    return T


def _on_shoulder_cylinder(rng: np.random.Generator, count: int, arm: URKinematics, inside: float) -> Poses:
    """Poses whose wrist centre has the distance d4 - inside from the first axis."""
    g, q = arm.geometry, _postures(rng, 4 * count)
    ratio = -(g.a2 * np.cos(q[:, 1]) + g.d5 * np.sin(q[:, 1] + q[:, 2] + q[:, 3])) / g.a3
    usable = np.abs(ratio) < 1.0
    q, ratio = q[usable][:count], ratio[usable][:count]
    pitch = q[:, 1] + q[:, 2] + q[:, 3]
    q[:, 2] = np.arccos(ratio) - q[:, 1]
    q[:, 3] = pitch - q[:, 1] - q[:, 2]
    q = (q + np.pi) % (2 * np.pi) - np.pi
    T = arm.fk(q)
    centre = T[:, :3, 3] - g.d6 * T[:, :3, 2]
    T[:, :2, 3] += centre[:, :2] * ((g.d4 - inside) / np.hypot(centre[:, 0], centre[:, 1]) - 1.0)[:, None]
    return T


def shoulder_singular(rng: np.random.Generator, count: int, arm: URKinematics = FLANGE) -> Poses:
    """Wrist centre exactly on the cylinder of radius d4 around the first axis."""
    return _on_shoulder_cylinder(rng, count, arm, 0.0)


def shoulder_inside(rng: np.random.Generator, count: int, arm: URKinematics = FLANGE) -> Poses:
    """Wrist centre 1e-9 m inside that cylinder."""
    return _on_shoulder_cylinder(rng, count, arm, 1e-9)


def float32_poses(rng: np.random.Generator, count: int, arm: URKinematics = FLANGE) -> Poses:
    """Random poses rounded to single precision, as messages and neural networks deliver them."""
    return random_poses(rng, count, arm).astype(np.float32).astype(np.float64)


def upright(rng: np.random.Generator, count: int, arm: URKinematics = FLANGE) -> Poses:
    """Arm straight up: shoulder, elbow and wrist are singular at once."""
    q = np.zeros((count, 6))
    q[:, [0, 5]] = rng.uniform(-np.pi, np.pi, (count, 2))
    q[:, [1, 3]] = -np.pi / 2
    return arm.fk(q)


def zero_configuration(rng: np.random.Generator, count: int, arm: URKinematics = FLANGE) -> Poses:
    """All joints at zero but the first and the last: elbow stretched and sin q5 = 0."""
    q = np.zeros((count, 6))
    q[:, [0, 5]] = rng.uniform(-np.pi, np.pi, (count, 2))
    q[0] = 0.0
    return arm.fk(q)


#: Name as published -> the function that makes the poses.
CASES: dict[str, Callable[..., Poses]] = {
    "random poses": random_poses,
    "sin q5 = 0 exactly": wrist_singular,
    "elbow q3 = 0 exactly": elbow_stretched,
    "elbow 1e-9 m past stretch": elbow_overstretched,
    "shoulder r = d4 exactly": shoulder_singular,
    "shoulder r = d4 - 1e-9": shoulder_inside,
    "target rounded to float32": float32_poses,
    "arm upright": upright,
    "UR zero configuration": zero_configuration,
}
