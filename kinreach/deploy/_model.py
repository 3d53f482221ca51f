"""Whether a robot is the arm that kinreach has, by its own forward kinematics, without a motion.

Models of UR have the same axes and other lengths. In one posture two of them may have the flange at the same place, so
five postures are compared: they determine every length, and all that a calibration may change.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from kinreach._checks import Floats
from kinreach._rotations import pose_error
from kinreach.kinematics import ArmKinematics, pose, pose_vector
from kinreach.robots import ArmDescription
from kinreach.robots.inside import FLANGE, UR_LENGTHS, nominal_dh

#: Postures in which the flange is compared [rad]. Chosen among random ones: the two most similar models, ur3 and ur3e,
#: are 28.9 mm apart in one of them, all others 64 mm or more, and the five determine every figure of a calibration.
POSTURES = (
    (2.2, 2.6, -1.1, 2.6, 3.0, 2.5), (2.9, -2.1, -0.5, 1.2, 0.0, 2.3), (-2.4, -1.3, -2.9, -1.6, -0.4, 2.0),
    (-1.5, 2.3, -2.6, 1.4, 1.4, -0.4), (1.8, -2.2, 2.5, 2.9, -2.0, 1.4),
)  # fmt: skip
#: Largest distance of the robot's own poses from kinreach's [m, degrees]: with its calibration (0.08 mm on the one
#: controller whose poses were typed from its pendant), and by the data sheet.
MAX_OFF_CALIBRATED, MAX_OFF = (5e-4, 0.1), (2e-2, 2.0)
#: Decimals of poses in a program [m, rad].
ROUNDED = 9
#: Largest difference of an arm's poses from those by its Denavit-Hartenberg figures: rounding [m, 1].
RESIDUAL = 1e-8
#: Sine of the angle below which two axes are parallel.
PARALLEL = 1e-10
#: Models whose distances from an arm differ by less than this have the same lengths [m].
SAME = 1e-6


@dataclass(frozen=True)
class ModelCheck:
    """What a robot's own kinematics must say for a program to move it.

    Attributes:
        postures: Joint angles [rad], shape (k, 6).
        poses: The flange there in the controller's frame `base`, `[x, y, z, rx, ry, rz]` [m, rad], shape (k, 6).
        most: Largest distance [m] and angle [degrees] of the robot's own poses from these.
    """

    postures: tuple[tuple[float, ...], ...]
    poses: tuple[tuple[float, ...], ...]
    most: tuple[float, float]

    @classmethod
    def of(cls, arm: ArmDescription) -> ModelCheck:
        """Return the check for a UR, with the bounds of its calibration or of the data sheet."""
        fk = ArmKinematics(arm, tip=FLANGE, base="base").fk
        poses = [pose_vector(fk(np.array(q))).round(ROUNDED) + 0.0 for q in POSTURES]
        return cls(POSTURES, tuple(tuple(six.tolist()) for six in poses), allowed(arm))

    def difference(self, fk: Callable[[Floats], Floats]) -> tuple[float, float]:
        """Return the largest distance [m] and angle [degrees] of another arm's flange, by its `fk` in `base`."""
        errors = [pose_error(pose(here), fk(np.array(q))) for q, here in zip(self.postures, self.poses, strict=True)]
        far, turned = np.array(errors).max(axis=0).tolist()
        return far, float(np.degrees(turned))


class DhFigures(NamedTuple):
    """Denavit-Hartenberg figures as a controller has them.

    The pose of the flange in `base` is the product of `Rz(q + theta) Tz(d) Tx(a) Rx(alpha)` over the joints.

    Attributes:
        theta, alpha: [rad], shape (6,).
        a, d: [m], shape (6,).
    """

    theta: Floats
    a: Floats
    d: Floats
    alpha: Floats

    @classmethod
    def by_data_sheet(cls, model: str) -> DhFigures:
        """Return the figures of a model, a key of `UR_LENGTHS`."""
        return cls(*nominal_dh(model))

    @classmethod
    def of(cls, kinematics: ArmKinematics) -> DhFigures | None:
        """Return the figures of a UR, by the common normals of its axes; None if no figures give its poses.

        Args:
            kinematics: Of the flange, in the frame `base`.
        """
        flange, axes = kinematics.fk(np.zeros(6)), kinematics.jacobian(np.zeros(6)).T
        lines = [(axis[3:], flange[:3, 3] + np.cross(axis[3:], axis[:3])) for axis in axes]
        nominal = cls.by_data_sheet(nearest_models(kinematics.fk)[0]).frames(np.zeros(6))
        frames = [np.eye(4)]
        for (z_before, before), (z, place), near in zip(lines, lines[1:], nominal[1:], strict=False):
            frames.append(_normal_frame(z_before, before, z, place, near[:3, 0]))
        frames.append(flange)
        if not np.isfinite(frames).all():  # two axes coincide
            return None
        steps = np.array([np.linalg.inv(one) @ other for one, other in pairwise(frames)])
        theta = np.arctan2(steps[:, 1, 0], steps[:, 0, 0])
        a = steps[:, 0, 3] * np.cos(theta) + steps[:, 1, 3] * np.sin(theta)
        figures = cls(theta, a, steps[:, 2, 3], np.arctan2(steps[:, 2, 1], steps[:, 2, 2]))
        off = [np.abs(figures.fk(np.array(q)) - kinematics.fk(np.array(q))).max() for q in POSTURES]
        return figures if max(off) < RESIDUAL else None

    def frames(self, q: Floats) -> list[Floats]:
        """Compute the poses of the frames of base, joints and flange in `base`, 7 of shape (4, 4)."""
        frames = [np.eye(4)]
        cos, sin = np.cos(q + self.theta), np.sin(q + self.theta)
        across, along = np.cos(self.alpha), np.sin(self.alpha)
        for c, s, ca, sa, a, d in zip(cos, sin, across, along, self.a, self.d, strict=True):
            step = np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0.0, sa, ca, d], [0, 0, 0, 1]])
            frames.append(frames[-1] @ step)
        return frames

    def fk(self, q: Floats) -> Floats:
        """Compute the pose of the flange in `base`, shape (4, 4)."""
        return self.frames(q)[-1]


def allowed(arm: ArmDescription) -> tuple[float, float]:
    """Return how far the poses of a robot may be from those of an arm [m, degrees]."""
    return MAX_OFF_CALIBRATED if is_calibrated(arm) else MAX_OFF


def is_calibrated(arm: ArmDescription) -> bool:
    return "_calibrated" in arm.name


def apart(most: tuple[float, float], far: float, turned: float) -> bool:
    """Return whether a distance [m] or an angle [degrees] is above the largest ones, or NaN."""
    return not (far <= most[0] and turned <= most[1])


def nearest_models(fk: Callable[[Floats], Floats]) -> list[str]:
    """Return the models whose data sheet is nearest to an arm by its `fk`; several have the same lengths."""
    places = np.array([fk(np.array(q))[:3, 3] for q in POSTURES])
    far = {model: float(np.linalg.norm(places - sheet, axis=1).max()) for model, sheet in _places().items()}
    least = min(far.values())
    return [model for model, distance in far.items() if distance < least + SAME]


@cache
def _places() -> dict[str, Floats]:
    """Return where each model's data sheet has the flange in the postures [m], shape (k, 3)."""
    return {
        model: np.array([DhFigures.by_data_sheet(model).fk(np.array(q))[:3, 3] for q in POSTURES])
        for model in UR_LENGTHS
    }


def _normal_frame(z_before: Floats, before: Floats, z: Floats, place: Floats, near: Floats) -> Floats:
    """Return the frame of an axis whose x is the common normal with the axis before, in the direction of `near`."""
    way, normal = place - before, np.cross(z_before, z)
    sine = float(np.linalg.norm(normal))
    if sine < PARALLEL:
        normal, along = way - (way @ z) * z, 0.0
    else:
        along = float(np.linalg.det([way, z_before, normal])) / sine**2
    T = np.eye(4)
    with np.errstate(invalid="ignore", divide="ignore"):
        x = normal * np.sign(normal @ near) / np.linalg.norm(normal)
    T[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    T[:3, 3] = place + along * z
    return T
