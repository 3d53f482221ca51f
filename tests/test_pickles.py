"""Results and descriptions can be pickled and copied: for workers, queues and caches."""

import copy
import importlib
import pickle
from dataclasses import fields, is_dataclass

import numpy as np
import pytest

from kinreach.deploy import Move, Program
from kinreach.deploy._client import RobotState
from kinreach.deploy._controller import Recording
from kinreach.kinematics import (
    Arm3Kinematics,
    ArmKinematics,
    AxisGoal,
    CalibratedURKinematics,
    MotionLimits,
    NearestOrientationGoal,
    PoseGoal,
    PositionGoal,
    SevenAxisKinematics,
    SixAxisKinematics,
    Tolerance,
    Trajectory,
    URKinematics,
)
from kinreach.robots import PUBLISHED_CALIBRATIONS, Obstacle, PosePairs, QuadrantRegion, Tool, calibrate, get_arm
from kinreach.robots._urdf import Solid
from kinreach.vision import Intrinsics, RGBDImage, SensorNoise
from kinreach.vision.inside import BallFix, GoalMeasurement

#: Packages whose exported dataclasses are tried.
FACES = ("kinreach.deploy", "kinreach.kinematics", "kinreach.robots", "kinreach.vision")


def samples():
    """Instances of every exported dataclass, and the kinematics that make some of them."""
    ur5, cell = URKinematics("ur5"), get_arm("ur5-thesis").workcell
    calibrated = URKinematics.from_calibration(PUBLISHED_CALIBRATIONS["ur5_a"], model="ur5")
    arm3, six, seven = Arm3Kinematics(), SixAxisKinematics("ur5"), SevenAxisKinematics("panda")
    motions = seven.self_motions(seven.fk(np.array(seven.arm.home)))
    assert isinstance(calibrated, CalibratedURKinematics)
    q = np.array([0.3, -1.2, 1.4, 0.2, 0.9, -0.4])
    far = np.eye(4)
    far[0, 3] = 9.0
    picture = RGBDImage(np.zeros((4, 6, 3), np.uint8), np.ones((4, 6)))
    fix = BallFix((3.0, 2.0, 1.0), q[:3])
    return [
        ur5, arm3, six, seven, calibrated, ArmKinematics("panda"), motions, motions[0],
        *(kin.all_solutions(kin.fk(q)) for kin in (ur5, six, calibrated)),
        arm3.all_solutions(arm3.fk(q[:3])[:3, 3]),
        ur5.all_solutions(far), ur5.nearest(ur5.fk(q), q), ur5.batch(ur5.fk(q)[None]),
        ur5.nearest_batch(ur5.fk(q)[None], q[None]),
        Tolerance(), PoseGoal(far), AxisGoal(q[:3]), PositionGoal(q[:3]), NearestOrientationGoal(far),
        MotionLimits.of("ur5"), motion := Trajectory(("one", "two"), [0.0, 0.5], np.zeros((2, 2)), np.ones((2, 2))),
        Recording(motion, motion, 2, ""), move := Move("movej", q, 0.5, 1.0), Program(q, q, (move,)),
        RobotState(0.5, q, q, q, q, q, 7, 1, 1, 1.0, None, 2),
        *(get_arm(name) for name in ("ur5", "arm3", "panda")),
        get_arm("ur5-thesis").calibrated(PUBLISHED_CALIBRATIONS["ur5_a"]),
        cell, *cell.obstacles, cell.goals, *get_arm("ur5-thesis").cameras, get_arm("ur5-thesis").gripper,
        Tool.tube(np.array([0, 0, 0.1, 0, 0, 0]), 0.03, mass=1.0), Solid((0.1, 0.2, 0.3)),
        calibrate(PUBLISHED_CALIBRATIONS["ur5_a"], arm="ur5"),
        Obstacle("ball", (0.1,), (1.0,) * 6), QuadrantRegion((0.1, 0.7), (0.0, 0.7)),
        PosePairs("rows.csv", np.zeros((2, 6)), np.tile(np.eye(4), (2, 1, 1)), None, ("line 2", "line 3")),
        picture, fix, GoalMeasurement(q, np.array([True, False]), (fix, None), (picture, picture)),
        Intrinsics.from_fovy(0.8, 64, 48), SensorNoise(),
    ]  # fmt: skip


def same(one, other):
    """Whether two values are equal, field by field; functions are equal by their names."""
    assert type(one) is type(other)
    if is_dataclass(one):
        return all(same(getattr(one, field.name), getattr(other, field.name)) for field in fields(one))
    if isinstance(one, np.ndarray):
        np.testing.assert_array_equal(one, other)
        return True
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if type(one).__name__ == "SelfMotions":
        return same(list(one.curves), list(other.curves))
    if type(one).__name__ == "SelfMotion":
        return same([one.q, one.tangent, one.at(0.3)], [other.q, other.tangent, other.at(0.3)])
    if hasattr(one, "fk"):
        q = np.full(one.n, 0.2)
        return bool((one.fk(q) == other.fk(q)).all())
    return one == other or repr(one).split(" at ")[0] == repr(other).split(" at ")[0]


@pytest.mark.parametrize("again", [lambda value: pickle.loads(pickle.dumps(value)), copy.deepcopy],
                         ids=["pickle", "deepcopy"])  # fmt: skip
def test_what_is_exported_comes_back_as_it_was(again):
    tried = set()
    for value in samples():
        tried.add(type(value).__name__)
        back = again(value)
        if type(value).__name__ == "IKSolutions":
            names = ("q", "branch", "singularity", "residual", "status", "reason", "rows")
            assert all(same(getattr(value, name), getattr(back, name)) for name in names)
            assert again(back).residual.tolist() == value.residual.tolist()
        else:
            assert same(value, back), value
    for face in FACES:
        module = importlib.import_module(face)
        exported = {name for name in module.__all__ if isinstance(getattr(module, name), type)}
        classes = {name for name in exported if is_dataclass(getattr(module, name))}
        assert classes - tried == set(), face
    assert len(tried) > 20
