"""Shapes and masses of the UR models: cylinders along the joints' axes and the tubes.

A UR is made of joints of a few sizes and tubes between them. The numbers are read, to the millimetre, off the maker's
visual meshes (Universal_Robots_ROS2_Description 2.4.5); masses are those of its data sheets. No
meshes exist of UR8 Long, UR15 and UR18: they have the shapes of a UR20 in proportion to their lengths.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from typing import Any

from kinreach.robots._urdf import Solid

#: From, to and radius of a cylinder [m].
Span = tuple[float, float, float]


@dataclass(frozen=True)
class URShape:
    """Cylinders of a UR's links [m], and masses [kg].

    Heights are along the axis of the joint that carries the link, measured from the plane of the base's axis.

    Attributes:
        base: Along the base's axis from the floor, two of them.
        shoulder: Along the base's axis from the height of the shoulder; and how far the housing reaches to the side.
        upper_arm: At the shoulder, at the elbow, and the height and the radius of the tube.
        forearm: At the elbow, at wrist_1, and the height and the radius of the tube.
        collars: Length along the tube from the joint's axis, and radius, at the upper arm's two ends and the elbow.
        wrist_1, wrist_2: Along the own axis, ending at the middle of the next joint's housing; and along that.
        wrist_3: From the flange backwards: length and radius.
        masses: Of shoulder, upper arm, forearm and the three wrists.
    """

    base: tuple[Span, Span]
    shoulder: tuple[Span, float]
    upper_arm: tuple[Span, Span, tuple[float, float]]
    forearm: tuple[Span, Span, tuple[float, float]]
    collars: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
    wrist_1: tuple[float, Span]
    wrist_2: tuple[float, Span]
    wrist_3: tuple[float, float]
    masses: tuple[float, ...]

    def scaled(self, factor: float) -> URShape:
        """Return the shape in another size; masses scale with the volume."""

        def times(value: Any, factor: float) -> Any:
            if isinstance(value, tuple):
                return tuple(times(each, factor) for each in value)
            return round(value * factor, 4)

        sizes = {name: times(value, factor) for name, value in vars(self).items()}
        return URShape(**(sizes | {"masses": times(self.masses, factor**3)}))


_UR3E = URShape(
    base=((0.0, 0.04, 0.064), (0.04, 0.095, 0.055)),
    shoulder=((-0.057, 0.047, 0.047), 0.063),
    upper_arm=((0.063, 0.177, 0.047), (0.066, 0.177, 0.039), (0.120, 0.033)),
    forearm=((-0.006, 0.069, 0.038), (-0.019, 0.077, 0.032), (0.027, 0.027)),
    collars=((0.075, 0.045), (0.065, 0.037), (0.055, 0.032)),
    wrist_1=(-0.054, (-0.050, 0.047, 0.032)),
    wrist_2=(-0.035, (-0.047, 0.050, 0.032)),
    wrist_3=(0.042, 0.032),
    masses=(1.98, 3.4445, 1.437, 0.871, 0.805, 0.261),
)
_UR5E = URShape(
    base=((0.0, 0.05, 0.075), (0.05, 0.099, 0.062)),
    shoulder=((-0.064, 0.060, 0.060), 0.074),
    upper_arm=((0.074, 0.210, 0.060), (0.060, 0.210, 0.060), (0.138, 0.043)),
    forearm=((-0.041, 0.060, 0.058), (-0.049, 0.060, 0.038), (0.007, 0.038)),
    collars=((0.088, 0.058), (0.088, 0.058), (0.088, 0.049)),
    wrist_1=(-0.074, (-0.054, 0.056, 0.039)),
    wrist_2=(-0.046, (-0.057, 0.053, 0.039)),
    wrist_3=(0.046, 0.038),
    masses=(3.761, 8.058, 2.846, 1.37, 1.3, 0.365),
)
_UR10E = URShape(
    base=((0.0, 0.05, 0.095), (0.05, 0.099, 0.080)),
    shoulder=((-0.082, 0.076, 0.076), 0.095),
    upper_arm=((0.095, 0.269, 0.076), (0.098, 0.245, 0.060), (0.176, 0.055)),
    forearm=((-0.018, 0.100, 0.058), (-0.016, 0.106, 0.046), (0.039, 0.043)),
    collars=((0.108, 0.075), (0.085, 0.058), (0.088, 0.058)),
    wrist_1=(-0.068, (-0.067, 0.058, 0.047)),
    wrist_2=(-0.053, (-0.057, 0.068, 0.047)),
    wrist_3=(0.049, 0.045),
    masses=(7.369, 13.051, 3.989, 2.1, 1.98, 0.615),
)
_UR16E = URShape(**{**vars(_UR10E), "masses": (7.369, 10.45, 4.321, 2.18, 2.033, 0.907)})
_UR20 = URShape(
    base=((0.0, 0.05, 0.123), (0.05, 0.108, 0.102)),
    shoulder=((-0.128, 0.090, 0.090), 0.134),
    upper_arm=((0.129, 0.351, 0.091), (0.143, 0.336, 0.076), (0.258, 0.076)),
    forearm=((-0.035, 0.148, 0.076), (-0.009, 0.125, 0.051), (0.043, 0.057)),
    collars=((0.190, 0.090), (0.085, 0.076), (0.170, 0.074)),
    wrist_1=(-0.077, (-0.085, 0.052, 0.050)),
    wrist_2=(-0.075, (-0.054, 0.084, 0.050)),
    wrist_3=(0.070, 0.050),
    masses=(16.343, 29.632, 7.879, 3.054, 3.126, 0.926),
)
_UR30 = URShape(**{**vars(_UR20), "masses": (16.343, 28.542, 7.156, 3.054, 3.126, 0.926)})
#: Of the sum of d4, d5 and d6 of a UR20 that those of a UR15 are.
_UR15 = _UR20.scaled(0.9)

_UR3 = URShape(
    base=((0.0, 0.04, 0.064), (0.04, 0.086, 0.055)),
    shoulder=((-0.066, 0.046, 0.046), 0.054),
    upper_arm=((0.054, 0.177, 0.046), (0.069, 0.177, 0.039), (0.120, 0.033)),
    forearm=((0.0, 0.078, 0.038), (-0.019, 0.070, 0.032), (0.027, 0.027)),
    collars=_UR3E.collars,
    wrist_1=(-0.046, (-0.042, 0.046, 0.032)),
    wrist_2=(-0.046, (-0.048, 0.041, 0.032)),
    wrist_3=(0.041, 0.032),
    masses=(2.0, 3.42, 1.26, 0.8, 0.8, 0.35),
)
_UR5 = URShape(
    base=((0.0, 0.012, 0.075), (0.012, 0.021, 0.066)),
    shoulder=((-0.065, 0.060, 0.060), 0.071),
    upper_arm=((0.071, 0.204, 0.060), (0.071, 0.204, 0.060), (0.136, 0.050)),
    forearm=((-0.019, 0.071, 0.058), (-0.041, 0.064, 0.038), (0.0165, 0.038)),
    collars=_UR5E.collars,
    wrist_1=(-0.046, (-0.047, 0.057, 0.039)),
    wrist_2=(-0.046, (-0.057, 0.047, 0.039)),
    wrist_3=(0.034, 0.038),
    masses=(3.7, 8.393, 2.33, 1.219, 1.219, 0.1879),
)
_UR10 = URShape(
    base=((0.0, 0.02, 0.095), (0.02, 0.038, 0.090)),
    shoulder=((-0.089, 0.075, 0.075), 0.086),
    upper_arm=((0.086, 0.263, 0.075), (0.116, 0.238, 0.061), (0.176, 0.054)),
    forearm=((-0.013, 0.116, 0.060), (-0.020, 0.110, 0.046), (0.048, 0.043)),
    collars=_UR10E.collars,
    wrist_1=(-0.054, (-0.062, 0.057, 0.046)),
    wrist_2=(-0.054, (-0.057, 0.062, 0.046)),
    wrist_3=(0.031, 0.045),
    masses=(7.1, 12.7, 4.27, 2.0, 2.0, 0.365),
)

#: Shapes by model; of others see `kinreach.robots._ur.shape_of`.
UR_SHAPES = {
    "ur3": _UR3, "ur3e": _UR3E, "ur5": _UR5, "ur5e": _UR5E, "ur8long": _UR15, "ur10": _UR10, "ur10e": _UR10E,
    "ur15": _UR15, "ur16e": _UR16E, "ur18": _UR15, "ur20": _UR20, "ur30": _UR30,
}  # fmt: skip


def link_solids(shape: URShape, lengths: Sequence[float]) -> dict[str, tuple[Solid, ...]]:
    """Cylinders by link, in the frames of `kinreach.robots._ur.nominal_urdf`; the first carries the link's mass."""
    _, a2, a3, d4, d5, d6 = lengths
    low, side = shape.shoulder[0], shape.shoulder[1]
    at_shoulder, at_elbow, upper = shape.upper_arm
    from_elbow, at_wrist, fore = shape.forearm
    near, far, elbow = shape.collars
    wrist_1, across_1 = shape.wrist_1
    wrist_2, across_2 = shape.wrist_2
    length, radius = shape.wrist_3
    lower, higher, r = across_1
    return {
        "base_link": tuple(_along_z(*span) for span in shape.base),
        "shoulder_link": (_along_z(*low), _along_y(0.0, side, low[2])),
        "upper_arm_link": (
            _along_z(0.0, -a2, upper[1], y=upper[0] - d4),
            _along_y(at_shoulder[0] - d4, at_shoulder[1] - d4, at_shoulder[2]),
            _along_y(at_elbow[0] - d4, at_elbow[1] - d4, at_elbow[2], z=-a2),
            _along_z(0.0, *near, y=upper[0] - d4),
            _along_z(-a2 - far[0], -a2, far[1], y=upper[0] - d4),
        ),
        "forearm_link": (
            _along_z(0.0, -a3, fore[1], y=fore[0] - d4),
            _along_y(from_elbow[0] - d4, from_elbow[1] - d4, from_elbow[2]),
            _along_y(at_wrist[0] - d4, at_wrist[1] - d4, at_wrist[2], z=-a3),
            _along_z(0.0, *elbow, y=fore[0] - d4),
        ),
        "wrist_1_link": (_along_z(-higher, -lower, r), _along_y(wrist_1, 0.0, r)),
        "wrist_2_link": (_along_y(*across_2, z=d5), _along_z(d5 + wrist_2, d5, across_2[2])),
        "wrist_3_link": (_along_y(d6 - length, d6, radius),),
    }


def _along_z(start: float, end: float, radius: float, *, y: float = 0.0) -> Solid:
    return Solid((radius, end - start), (0.0, y, (start + end) / 2))


def _along_y(start: float, end: float, radius: float, *, z: float = 0.0) -> Solid:
    return Solid((radius, end - start), (0.0, (start + end) / 2, z), (pi / 2, 0.0, 0.0))
