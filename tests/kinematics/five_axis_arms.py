"""Arms of four and five axes: figures of those that people own, typed from data sheets, and random ones."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from kinreach.kinematics import ArmKinematics

HALF = np.pi / 2
#: Of each joint its place in the one before (x, y, z, roll, pitch, yaw), axis and limits; and the tip's place [m, rad].
FIGURES = {
    "so101": (
        [
            ((0.0388, 0, 0.0624, np.pi, 0, -np.pi), "0 0 1", -1.92, 1.92),
            ((-0.0304, -0.0183, -0.0542, -HALF, -HALF, 0), "0 0 1", -1.745, 1.745),
            ((-0.11257, -0.028, 0, 0, 0, HALF), "0 0 1", -1.69, 1.69),
            ((-0.1349, 0.0052, 0, 0, 0, -HALF), "0 0 1", -1.658, 1.658),
            ((0, -0.0611, 0.0181, HALF, 0.0487, np.pi), "0 0 1", -2.744, 2.841),
        ],
        (-0.0079, -0.0002, -0.0981, 0, np.pi, 0),
    ),
    "koch": (
        [
            ((0, 0, 0.055, 0, 0, 0), "0 0 1", -2.1, 2.1),
            ((0.014, 0, 0.044, 0, 0, 0), "0 1 0", -1.9, 1.7),
            ((0.018, 0, 0.108, 0, 0, 0), "0 1 0", -1.6, 1.9),
            ((0.1, 0, 0.004, 0, 0, 0), "0 1 0", -1.9, 1.8),
            ((0.045, 0.011, 0, 0, 0, 0), "1 0 0", -2.6, 2.6),
        ],
        (0.09, 0, -0.012, 0, HALF, 0),
    ),
    "wx250": (
        [
            ((0, 0, 0.072, 0, 0, 0), "0 0 1", -np.pi, np.pi),
            ((0, 0, 0.03865, 0, 0, 0), "0 1 0", -1.885, 1.990),
            ((0.04975, 0, 0.25, 0, 0, 0), "0 1 0", -2.147, 1.606),
            ((0.25, 0, 0, 0, 0, 0), "0 1 0", -1.745, 2.147),
            ((0.065, 0, 0, 0, 0, 0), "1 0 0", -np.pi, np.pi),
        ],
        (0.0936, 0, 0, 0, HALF, 0),
    ),
    "vx300": (
        [
            ((0, 0, 0.079, 0, 0, 0), "0 0 1", -np.pi, np.pi),
            ((0, 0, 0.04805, 0, 0, 0), "0 1 0", -1.763, 1.763),
            ((0.05955, 0, 0.3, 0, 0, 0), "0 1 0", -1.763, 1.606),
            ((0.3, 0, 0, 0, 0, 0), "0 1 0", -1.868, 2.269),
            ((0.0697, 0, 0, 0, 0, 0), "1 0 0", -np.pi, np.pi),
        ],
        (0.1368, 0, 0, 0, HALF, 0),
    ),
    "xarm5": (
        [
            ((0, 0, 0.267, 0, 0, 0), "0 0 1", -2 * np.pi, 2 * np.pi),
            ((0, 0, 0, -HALF, 0, 0), "0 0 1", -2.059, 2.094),
            ((0.053, -0.2845, 0, 0, 0, 0), "0 0 1", -3.927, 0.192),
            ((0.0775, 0.3425, 0, 0, 0, 0), "0 0 1", -1.693, np.pi),
            ((0.076, 0.097, 0, -HALF, 0, 0), "0 0 1", -2 * np.pi, 2 * np.pi),
        ],
        (0, 0, 0.172, 0, 0, 0),
    ),
    "px100": (
        [
            ((0, 0, 0.0508, 0, 0, 0), "0 0 1", -np.pi, np.pi),
            ((0, 0, 0.04225, 0, 0, 0), "0 1 0", -1.937, 1.867),
            ((0.035, 0, 0.1, 0, 0, 0), "0 1 0", -2.112, 1.606),
            ((0.1, 0, 0, 0, 0, 0), "0 1 0", -1.745, 2.147),
        ],
        (0.1086, 0, 0, 0, HALF, 0),
    ),
}


def urdf_of(joints, tip, name="arm"):
    """A URDF of joints as in `FIGURES`."""

    def place(numbers):
        x, y, z, *rpy = map(float, numbers)
        return f'<origin xyz="{x!r} {y!r} {z!r}" rpy="{" ".join(map(repr, rpy))}"/>'

    text = "".join(f'<link name="l{i}"/>' for i in range(len(joints) + 1)) + '<link name="tip"/>'
    for i, (numbers, axis, lower, upper) in enumerate(joints, start=1):
        text += (
            f'<joint name="j{i}" type="revolute"><parent link="l{i - 1}"/><child link="l{i}"/>{place(numbers)}'
            f'<axis xyz="{axis}"/><limit lower="{float(lower)!r}" upper="{float(upper)!r}" effort="1" velocity="2"/>'
            "</joint>"
        )
    text += f'<joint name="end" type="fixed"><parent link="l{len(joints)}"/><child link="tip"/>{place(tip)}</joint>'
    return f'<robot name="{name}">{text}</robot>'


def kinematics_of(folder, joints, tip, name="arm"):
    file = folder / f"{name}.urdf"
    file.write_text(urdf_of(joints, tip, name))
    return ArmKinematics.from_urdf(file, tip="tip")


def owned(folder, name):
    """The kinematics of an arm of `FIGURES`."""
    return kinematics_of(folder, *FIGURES[name], name)


def random_joints(n, rng, *, reach=0.3, limits=(-np.pi, np.pi)):
    """Joints and a tip of no special geometry."""

    def place():
        return (*rng.uniform(-reach, reach, 3), *Rotation.random(rng=rng).as_euler("xyz"))

    return [(place(), "0 0 1", *limits) for _ in range(n)], place()


def random_pitched_joints(n, rng, *, limits=(-np.pi, np.pi)):
    """As `random_joints`, with axes 2, 3 and 4 parallel: in a row or against each other, the base upright or not."""

    def at(reach):
        return tuple(rng.uniform(-reach, reach, 3))

    def any_way():
        return tuple(Rotation.random(rng=rng).as_euler("xyz"))

    def along():
        return (np.pi if rng.integers(2) else 0.0, 0.0, rng.uniform(-3, 3))

    def across():
        return (HALF, 0.0, rng.uniform(-1, 1))

    base = (*at(0.2), *any_way()) if rng.integers(2) else (*at(0.1), 0, 0, 0)
    second = (*at(0.1), *(across() if rng.integers(5) else any_way()))
    places = [base, second, (*at(0.3), *along()), (*at(0.3), *along())]
    if n == 5:
        places.append((*at(0.1), *(across() if rng.integers(4) else any_way())))
    tip = (*(at(0.1) if rng.integers(4) else (0, 0, 0.1)), *any_way())
    return [(place, "0 0 1", *limits) for place in places], tip


def orientations(rng):
    return Rotation.random(rng=rng).as_matrix()
