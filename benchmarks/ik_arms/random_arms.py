"""Random six-axis arms of every class and near it, with turned bases and tips, and Pinocchio, which judges them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.ik_arms.arms import urdf
from kinreach._checks import Floats
from kinreach._engines import load
from kinreach.kinematics import ArmKinematics
from kinreach.kinematics._general_6r import Chain

pin: Any = load("pinocchio")

RIGHT = np.pi / 2
#: What holds for the lengths [m] and angles [rad] between axes: index from 0, value.
CLASSES: dict[str, dict[str, dict[int, float]]] = {
    "spherical wrist": {"a": {3: 0, 4: 0}, "d": {4: 0}},
    "spherical wrist, axes 2 and 3 parallel": {"a": {3: 0, 4: 0}, "d": {4: 0}, "alpha": {1: 0}},
    "spherical wrist, axes 1 and 2 meet": {"a": {0: 0, 3: 0, 4: 0}, "d": {4: 0}},
    "spherical wrist, axes 1 and 2 parallel": {"a": {3: 0, 4: 0}, "d": {4: 0}, "alpha": {0: 0}},
    "right angles": {"a": {3: 0, 4: 0}, "d": {4: 0}, "alpha": {0: RIGHT, 1: 0, 2: RIGHT, 3: -RIGHT, 4: RIGHT}},
    "three parallel axes": {"alpha": {1: 0, 2: 0}},
    "three parallel axes, 5 and 6 meet": {"a": {4: 0}, "alpha": {1: 0, 2: 0}},
    "three parallel axes, right angles": {"a": {4: 0}, "alpha": {0: -RIGHT, 1: 0, 2: 0, 3: RIGHT, 4: -RIGHT}},
}
#: Pairs of neighbouring axes that meet, and none of them three in one point.
OTHERS: dict[str, tuple[int, ...]] = {"two pairs that meet": (0, 4), "two pairs in the middle": (1, 3), "no class": ()}


def motion(turn: float, along: float, out: float, tilt: float) -> Floats:
    """Return the pose Rz(turn) Tz(along) Tx(out) Rx(tilt), shape (4, 4)."""
    c, s, ct, st = np.cos(turn), np.sin(turn), np.cos(tilt), np.sin(tilt)
    return np.array(
        [
            [c, -s * ct, s * st, out * c],
            [s, c * ct, -c * st, out * s],
            [0, st, ct, along],
            [0, 0, 0, 1],
        ]
    )


def random_motion(rng: np.random.Generator, length: float, angle: float) -> Floats:
    """A motion with lengths [m] and angles [rad] up to these."""
    a, b, c, d = rng.uniform(-1, 1, 4) * (angle, length, length, angle)
    return motion(a, b, c, d)


def some_figures(rng: np.random.Generator, name: str) -> tuple[Floats, Floats, Floats, Floats]:
    """Random Denavit-Hartenberg figures a, d [m], alpha and turn [rad] of a class or of `OTHERS`, each (6,)."""
    a, d = rng.choice([-1, 1], (2, 6)) * rng.uniform(0.1, 0.5, (2, 6))
    alpha, turn = rng.choice([-1, 1], 6) * rng.uniform(0.5, 1.5, 6), rng.uniform(-np.pi, np.pi, 6)
    if name in CLASSES:
        _set(CLASSES[name], a, d, alpha)
    else:
        a[list(OTHERS[name])] = 0.0
    return a, d, alpha, turn


def some_arm(rng: np.random.Generator, name: str, *, backwards: bool = False, off: float = 0.0) -> Floats:
    """A random arm of a class or of `OTHERS` with a turned tip, as in `Chain`; each joint is `off` [m, rad] its class.

    `backwards` begins with the last joint.
    """
    a, d, alpha, turn = some_figures(rng, name)
    links = [motion(turn[i], d[i], a[i], alpha[i]) for i in range(5)]
    return _placed(rng, [random_motion(rng, 0.3, np.pi), *links, random_motion(rng, 0.2, np.pi)], backwards, off)


def regular_arm(rng: np.random.Generator, name: str, *, backwards: bool = False, off: float = 0.0) -> Floats:
    """As `some_arm` of a class, but joints begin at quarter turns, many angles are right, and many lengths 0."""
    zero = rng.random((2, 6)) < 0.3
    a, d = np.where(zero, 0.0, rng.choice([-1, 1], (2, 6)) * rng.uniform(0.1, 0.5, (2, 6)))
    alpha = rng.choice([-1, 1], 6) * np.where(rng.random(6) < 0.7, RIGHT, rng.uniform(0.5, 1.5, 6))
    turn = rng.integers(-1, 3, 8) * RIGHT
    a[1:3], d[3] = np.where(a[1:3] == 0.0, 0.3, a[1:3]), d[3] or 0.2
    _set(CLASSES[name], a, d, alpha)
    a[0] = a[0] or 0.15 * (alpha[0] == 0.0)  # axes 1 and 2 are two axes
    links = [motion(turn[i], d[i], a[i], alpha[i]) for i in range(5)]
    return _placed(rng, [motion(turn[6], 0.2, 0, RIGHT), *links, motion(turn[7], 0.1, 0, 0)], backwards, off)


def _set(values: dict[str, dict[int, float]], a: Floats, d: Floats, alpha: Floats) -> None:
    for given, key in ((a, "a"), (d, "d"), (alpha, "alpha")):
        for index, value in values.get(key, {}).items():
            given[index] = value


def _placed(rng: np.random.Generator, chain: list[Floats], backwards: bool, off: float) -> Floats:
    if backwards:
        chain = list(np.linalg.inv(chain[::-1]))
    return np.array([step @ random_motion(rng, off, off) for step in chain])


def kinematics(folder: Path, chain: Floats, limits: Floats | None = None) -> ArmKinematics:
    """The arm of a URDF in a folder; arguments as of `urdf`."""
    file = folder / "arm.urdf"
    file.write_text(urdf(chain, limits), encoding="utf-8")
    return ArmKinematics.from_urdf(file)


def apart(q: Floats, others: Floats) -> float:
    """How far a posture is from the nearest of others, in the joint that differs most [rad]."""
    return float(np.abs((others - q + np.pi) % (2 * np.pi) - np.pi).max(axis=-1).min(initial=np.inf))


class Judge:
    """Pinocchio's pose of the last link of a URDF.

    Args:
        chain: The arm, as in `Chain`.
    """

    def __init__(self, chain: Floats) -> None:
        self._model = pin.buildModelFromXML(urdf(chain))
        self._data = self._model.createData()
        self._tip = self._model.getFrameId(f"l{len(chain)}")

    def fk(self, q: Floats) -> Floats:
        """The pose of a posture, shape (4, 4)."""
        pin.framesForwardKinematics(self._model, self._data, np.asarray(q))
        return np.array(self._data.oMf[self._tip].homogeneous)

    def shoulder_and_wrist(self, q: Floats) -> list[Floats]:
        """The points of axis 1 next to axis 2, and of axis 6 next to axis 5."""
        self.fk(q)
        axes = [self._data.oMi[joint] for joint in range(1, 7)]
        found = []
        for one, other in ((axes[0], axes[1]), (axes[5], axes[4])):
            z, along = one.rotation[:, 2], other.rotation[:, 2]
            s, _ = np.linalg.lstsq(np.column_stack([z, -along]), other.translation - one.translation, rcond=None)[0]
            found.append(one.translation + s * z)
        return found


def moves_to(chain: Chain, q: Floats, others: Floats, T: Floats) -> bool:
    """Whether the arm can move from a posture to one of others, with each posture on the way within 1e-8 of a pose.

    It follows the curve of such postures either way.
    """

    def off(q: Floats) -> float:
        return float(np.linalg.norm(chain.step(q[None], T[None])[0]))

    def null(q: Floats) -> Floats:
        _, s, V = np.linalg.svd(chain.step(q[None], T[None])[1][0])
        return np.asarray(V[s < max(1e-3, 1.5 * s[-1])])

    for way in [sign * row for row in null(q) for sign in (1, -1)]:
        at, t = q, way
        for _ in range(300):
            nearest = others[np.abs((others - at + np.pi) % (2 * np.pi) - np.pi).max(axis=1).argmin()]
            rest = (nearest - at + np.pi) % (2 * np.pi) - np.pi
            step = rest if np.abs(rest).max() < 0.06 else 0.04 * t
            new = at + step
            for _ in range(5):
                error, J, _ = chain.step(new[None], T[None])
                new = new + np.linalg.lstsq(np.vstack([J[0], t]), [*error[0], 0.0], rcond=1e-6)[0]
            if apart(new, nearest[None]) < 1e-2:
                return True
            if off(new) > 1e-8 or np.abs(new - at - step).max() > 0.03:
                break
            N = null(new)
            t = N.T @ (N @ (new - at))
            if np.linalg.norm(t) < 0.3 * np.linalg.norm(new - at):
                break
            at, t = new, t / np.linalg.norm(t)
    return False
