"""Numbers that options may have: both ends are accepted, and what is just beyond is refused."""

import math

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import load_env_creator

from kinreach._registration import LIFT, SINGLE, SPACE
from kinreach.envs.inside import ButtonOptions, ObstaclesOptions
from kinreach.envs.moving import MovingOptions
from kinreach.envs.real_arm import RealArmOptions
from kinreach.errors import InputError
from kinreach.sim import ArmSimulation, BatchSimulation
from kinreach.sim.inside import Imperfections
from kinreach.vision import Intrinsics, SensorNoise, circle_votes, find_ball

LiftOptions, ReachOptions, SpaceOptions = (
    load_env_creator(gym.spec(name).entry_point).Options for name in (LIFT, SINGLE, SPACE)
)
CAMERA = Intrinsics(16, 16, 10.0, 10.0, 8.0, 8.0)


def reach(**option):
    return ReachOptions(backend="kinematic", **option)


def listed(kind, name):
    return lambda **option: kind(**{name: (option[name],)})


def space(**option):
    return SpaceOptions(**option)


def intrinsics(**option):
    return Intrinsics(**{"width": 9, "height": 9, "fx": 9.0, "fy": 9.0, "cx": 0.0, "cy": 0.0, **option})


def ball(radius):
    return find_ball(np.zeros((16, 16, 3), np.uint8), np.zeros((16, 16), np.float32), CAMERA, radius)


def table(axis):
    return lambda table: LiftOptions(table=tuple(np.eye(3)[axis] * table))


#: What is made, the option, its least and its largest value.
BOUNDS = [
    (reach, "width", 16, 16384), (reach, "height", 16, 16384), (reach, "rgb_noise", 0.0, 255.0),
    (reach, "depth_noise", 0.0, 1.0), (reach, "exposure", 1.0, 100.0), (reach, "looks", 0, 10**6),
    (reach, "tolerance", 0.0, math.pi), (reach, "margin", 0.0, 1e6),
    (space, "goal_height", 0.0, 2.0), (space, "tilt", 0.0, 90.0), (space, "start_spread", 0.0, math.pi),
    (ButtonOptions, "frames", 1, 16),
    (MovingOptions, "delay", 0.0, 1.0), (MovingOptions, "noise", 0.0, 0.1), (MovingOptions, "sights", 1, 90),
    (MovingOptions, "strength", 0.1, 1.0), (MovingOptions, "margin", 0.0, 1e6),
    (listed(MovingOptions, "speeds"), "speeds", 5e-324, 2.0),
    (RealArmOptions, "again", 0, 20), (RealArmOptions, "balls", 1, 100_000), (RealArmOptions, "noise", 1e-9, 1.0),
    (listed(ObstaclesOptions, "clutter"), "clutter", 0, 20), (ObstaclesOptions, "margin", 5e-4, 0.05),
    (listed(LiftOptions, "sizes"), "sizes", 0.01, 0.045), (listed(LiftOptions, "masses"), "masses", 1e-3, 1.0),
    (listed(LiftOptions, "frictions"), "frictions", 0.0, 3.0), (LiftOptions, "attempts", 1, 10),
    *((table(axis), "table", -0.05, 0.05) for axis in range(3)),
    (LiftOptions, "margin", 0.0, 1e6), (LiftOptions, "rgb_noise", 0.0, 255.0), (LiftOptions, "depth_noise", 0.0, 1.0),
    (Imperfections, "friction", 0.0, 1.0), (Imperfections, "damping", 0.0, 10.0),
    (Imperfections, "payload", 0.0, 100.0), (Imperfections, "encoder_noise", 0.0, 0.1),
    (SensorNoise, "rgb_sigma", 0.0, 1e3), (SensorNoise, "depth_sigma", 0.0, 1e3), (SensorNoise, "exposure", 1.0, 100.0),
    (intrinsics, "width", 1, 2**16), (intrinsics, "height", 1, 2**16), (intrinsics, "fx", 1e-6, 1e9),
    (intrinsics, "fy", 1e-6, 1e9), (intrinsics, "cx", -1e9, 1e9), (intrinsics, "cy", -1e9, 1e9),
    (lambda fovy: Intrinsics.from_fovy(fovy, 16, 16), "fovy", None, 179.9),
    (ball, "radius", 1e-4, 0.2),
    (lambda radius: circle_votes(np.zeros((2, 2), dtype=bool), radius), "radius", 0.5, 1024.0),
    (lambda tolerance: ArmSimulation("arm3", tolerance=tolerance), "tolerance", 1e-13, math.pi),
    (lambda timestep: ArmSimulation("arm3", timestep=timestep), "timestep", 1e-5, 0.02),
    (lambda objects: ArmSimulation("arm3", objects=objects), "objects", 0, 2),
    (lambda objects: BatchSimulation("arm3", 1, objects=objects), "objects", 0, 2),
]  # fmt: skip


def beyond(value, side):
    return value + side * (1 if isinstance(value, int) else 1e-9 * max(abs(value), 1e-3))


@pytest.mark.parametrize(("make", "name", "least", "most"), BOUNDS, ids=lambda each: str(each)[:20])
def test_both_ends_are_accepted_and_nothing_beyond(make, name, least, most):
    for value, side in ((least, -1), (most, 1)):
        if value is None:
            continue
        make(**{name: value})
        with pytest.raises(InputError):
            make(**{name: beyond(value, side)})
