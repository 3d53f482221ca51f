"""Motions between two samples, by bounds of how far any point moves; and what a planner samples and shortens."""

import importlib

import numpy as np
import pytest

from kinreach.errors import InputError, PathError
from kinreach.kinematics import ArmKinematics, CollisionChecker, URKinematics, _planning, joint_line, plan_path
from kinreach.kinematics._motion_check import MotionCheck
from kinreach.robots import Obstacle, Tool, get_arm
from tests.kinematics.test_planning import POST, WALL, across, checker_with


@pytest.mark.parametrize("arm", ["ur5e", "ur3e", "panda"])
def test_random_postures_are_within_one_turn_about_start_and_goals(arm):
    """Farther where these are farther apart, and nowhere past a limit."""
    kin, rng, slack = ArmKinematics(arm), np.random.default_rng(4), 1e-8
    bound, turns, apart = 0, 0, 0
    for _ in range(300):
        known = rng.uniform(np.maximum(kin.lower, -6.2), np.minimum(kin.upper, 6.2), (rng.integers(2, 6), kin.n))
        low, high = known.min(axis=0), known.max(axis=0)
        lower, upper = _planning._sampled_range(kin, known[0], known[1:])
        middle, half = (low + high) / 2, np.maximum(high - low, 2 * np.pi) / 2
        np.testing.assert_allclose(lower, np.maximum(middle - half, kin.lower), rtol=0, atol=slack)
        np.testing.assert_allclose(upper, np.minimum(middle + half, kin.upper), rtol=0, atol=slack)
        assert ((lower < low) & (high < upper)).all()
        wide = high - low > 2 * np.pi
        cut = (middle - half < kin.lower) | (middle + half > kin.upper)
        bound, turns, apart = bound + cut.sum(), turns + (~wide & ~cut).sum(), apart + wide.sum()
    assert bound > 100
    assert min(turns, apart) > 100 or arm == "panda"


@pytest.mark.slow
def test_a_distance_is_kept_between_samples_too():
    """A thin tool passes a small ball by 10.5 mm half way between two samples, which are 12 mm and more from it."""
    arm = get_arm("ur5e").with_tool(Tool.tube([0, 0, 0.4, 0, 0, 0], 0.002))
    kin = ArmKinematics(arm, base="world")
    alone = MotionCheck(CollisionChecker(kin, obstacles=[], margin=0.012))
    rng, passed = np.random.default_rng(2), 0
    while not passed:
        start = rng.uniform(-3.0, 3.0, 6)
        end = start + 0.3 * rng.choice([-1, 1]) * np.eye(6)[0]
        if not (alone.free(start) and alone.free(end) and alone.motion_free(start, end)):
            continue
        samples = alone._samples(end - start, 0.024)
        between = start + (samples // 2 + 0.5) / samples * (end - start)
        tip = kin.fk(between)
        place = tip[:3, 3] + 0.0125 * tip[:3, 2]
        ball = Obstacle("ball", (0.002,), pose=(*place, 0, 0, 0))
        checker = CollisionChecker(kin, obstacles=[ball], margin=0.012)
        if not MotionCheck(checker).motion_free(start, end):  # it is near a sample
            continue
        passed += 1
        assert checker.distance(between).distance < 0.011
        assert joint_line(checker, [start, end]).shape == (2, 6)
        for keeps in (0.0, 0.0104):
            assert MotionCheck(checker, keeps).motion_free(start, end) is (keeps == 0.0)
        with pytest.raises(PathError, match=r"collision .*ball"):
            joint_line(checker, [start, end], keeps=0.0104)
        nearer = CollisionChecker(kin, obstacles=[ball], margin=0.0095)
        assert joint_line(nearer, [start, end], keeps=0.009).shape == (2, 6)
    for keeps, reason in (
        (0.0119, r"of at least 0\.0121 m, got 0\.012; .*margin=0\.0169"),
        (-0.001, "keeps"),
        (np.nan, "keeps"),
    ):
        with pytest.raises(InputError, match=reason):
            joint_line(checker, [start], keeps=keeps)


def test_no_point_moves_farther_than_the_reach_of_the_joints_says():
    """The bound that the samples stand on, against corners of boxes about each shape."""
    checker = checker_with(WALL, POST)
    motion, model, geometry = MotionCheck(checker), checker.model, checker.geometry
    pin = importlib.import_module("pinocchio")
    rng = np.random.default_rng(1)

    def corners(q):
        data, placed = model.createData(), geometry.createData()
        pin.updateGeometryPlacements(model, data, geometry, placed, q)
        found = []
        for shape, place in zip(geometry.geometryObjects, placed.oMg, strict=True):
            centre, radius = shape.geometry.aabb_center, shape.geometry.aabb_radius
            found += [place.act(centre + radius * way) for way in np.vstack([np.eye(3), -np.eye(3)])]
        return np.array(found)

    nearest = 0.0
    for _ in range(200):
        q, joint = rng.uniform(-3.0, 3.0, 6), rng.integers(6)
        turned = q + 0.01 * (np.arange(6) == joint)
        moved = np.linalg.norm(corners(turned) - corners(q), axis=1).max()
        assert moved <= 0.01 * motion.reach[joint] + 1e-12
        nearest = max(nearest, moved / (0.01 * motion.reach[joint]))
    assert nearest > 0.5


def test_detours_are_shortened(monkeypatch):
    """No waypoint is needless, and random parts that become straight make some paths shorter."""
    kin, checker = URKinematics("ur5e", base="world"), checker_with(WALL, POST)
    motion, shorter, most = MotionCheck(checker), 0, _planning.SHORTCUTS
    monkeypatch.setattr(_planning, "LOOKS", 0)  # no search for another way
    monkeypatch.setattr(_planning, "MOST_LOOKS", 0)
    for seed in range(6):
        start, goals = across(kin, checker, seed)
        goal = [q for q in goals.q if checker.free(q)][-1]
        lengths = {}
        for shortcuts in (most, 0):
            monkeypatch.setattr(_planning, "SHORTCUTS", shortcuts)
            path = plan_path(checker, start, goal, seed=seed, timeout=20.0)
            lengths[shortcuts] = np.abs(np.diff(path, axis=0)).sum(axis=0) @ motion.reach
        assert not any(motion.motion_free(a, b) for a, b in zip(path[:-2], path[2:], strict=True))
        assert lengths[most] <= lengths[0] + 1e-9
        shorter += lengths[most] < 0.98 * lengths[0]
    assert shorter >= 2
