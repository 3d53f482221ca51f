"""Paths around obstacles: free where nothing was looked at, the same for a seed, and refused with the reason."""

from itertools import pairwise

import numpy as np
import pytest

from kinreach.errors import InputError, PathError
from kinreach.kinematics import CollisionChecker, URKinematics, joint_line, plan_path
from kinreach.kinematics import _planning as planning
from kinreach.kinematics._motion_check import MotionCheck
from kinreach.robots import Box, Obstacle, get_arm

MARGIN = 0.005
WALL = Box("wall", (0.5, 0.02, 0.5), (0.45, 0.0, 0.25))
POST = Obstacle("post", (0.04, 1.0), (-0.4, -0.3, 0.5, 0.3, 0.0, 0.0))


@pytest.fixture(scope="module")
def kin():
    return URKinematics("ur5e", base="world")


def checker_with(*obstacles, margin=MARGIN):
    return CollisionChecker("ur5e", obstacles=[*get_arm("ur5e").workcell.obstacles, *obstacles], margin=margin)


@pytest.fixture(scope="module")
def checker():
    return checker_with(WALL, POST)


def tool_down(x, y, z):
    return np.array([[1.0, 0.0, 0.0, x], [0.0, -1.0, 0.0, y], [0.0, 0.0, -1.0, z], [0.0, 0.0, 0.0, 1.0]])


def across(kin, checker, seed):
    """A free start on one side of the wall, and the solutions of the mirrored pose on the other."""
    rng = np.random.default_rng(seed)
    while True:
        x, y, z = rng.uniform((0.3, 0.15, 0.1), (0.55, 0.4, 0.3))
        free = [q for q in kin.all_solutions(tool_down(x, y, z), seed=kin.arm.home).q if checker.free(q)]
        goals = kin.all_solutions(tool_down(x, -y, z))
        if free and any(checker.free(q) for q in goals.q):
            return free[0], goals


def dense(path, step=0.002):
    """The path with samples so near that no joint moves farther from one to the next [rad]."""
    samples = [path[:1]]
    for a, b in pairwise(path):
        count = int(np.ceil(np.abs(b - a).max() / step))
        samples.append(a + np.linspace(0.0, 1.0, count + 1)[1:, None] * (b - a))
    return np.vstack(samples)


def test_paths_around_a_wall_are_free_everywhere(kin, checker):
    exact = checker_with(WALL, POST, margin=0.0)
    turned = 0
    for seed in range(12):
        start, goals = across(kin, checker, seed)
        goal = [q for q in goals.q if checker.free(q)][-1]
        path = plan_path(checker, start, goal, seed=seed, timeout=20.0)
        assert (path[-1] == goal).all()
        turned += len(path) > 2
        assert (path[0] == start).all()
        assert np.linalg.norm(kin.fk(path[-1])[:3, 3] * [1, -1, 1] - kin.fk(start)[:3, 3]) < 1e-6
        samples = dense(path)
        assert not exact.impossible(samples).any()
        assert (joint_line(checker, path) == path).all()
    assert turned >= 4  # the others are straight


def test_the_same_seed_gives_the_same_path(kin, checker):
    start, goals = across(kin, checker, 3)
    goal = [q for q in goals.q if checker.free(q)][-1]
    paths = [plan_path(checker, start, goal, seed=seed, timeout=20.0) for seed in (5, 5, 6)]
    assert len(paths[0]) > 2
    assert np.array_equal(paths[0], paths[1])
    assert not np.array_equal(paths[0], paths[2])


def test_a_path_ends_in_a_goal_that_is_free(kin, checker):
    """Of all solutions of poses some collide: alone they are refused, among the others left out."""
    refused = 0
    for seed in range(10):
        start, goals = across(kin, checker, seed)
        free = [q for q in goals.q if checker.free(q)]
        path = plan_path(checker, start, goals, timeout=20.0)
        ends = [np.abs((path[-1] - q + np.pi) % (2 * np.pi) - np.pi).max() for q in free]
        assert min(ends) < 1e-9
        for q in goals.q:
            if not checker.free(q):
                refused += 1
                with pytest.raises(PathError, match="none of the 1 goal postures is free: "):
                    plan_path(checker, start, q)
    assert refused > 10


def test_an_elbow_is_not_turned_over_itself(kin):
    """The winding nearest to the start is out of reach for the elbow; the other one is a goal, too."""
    checker = checker_with()
    start = np.array([0.0, -1.8, 2.2, -2.0, -1.57, 0.0])
    goal = np.array([0.0, -1.2, -2.2, 1.8, 1.57, 0.0])
    assert checker.free(start)
    assert checker.free(goal)
    path = plan_path(checker, start, kin.all_solutions(kin.fk(goal)), timeout=20.0)
    assert np.abs(path[:, 2]).max() < np.pi


def test_what_cannot_be_planned_is_refused_with_the_reason(kin, checker, monkeypatch):
    start, goals = across(kin, checker, 0)
    folded = np.array([0.0, -np.pi / 2, 3.0, -np.pi / 2, -np.pi / 2, 0.0])
    beyond = np.full(6, 7.0)
    with pytest.raises(PathError, match="the start is not free: upper_arm_link - wrist_1_link") as caught:
        plan_path(checker, folded, goals)
    assert (caught.value.q == folded).all()
    with pytest.raises(PathError, match="the start is not free: out of limits: shoulder_pan_joint"):
        plan_path(checker, beyond, goals)
    with pytest.raises(PathError, match=r"none of the 2 goal postures is free: .*out of limits"):
        plan_path(checker, start, [folded, beyond])
    with pytest.raises(InputError, match="the goal has no posture: "):
        plan_path(checker, start, kin.all_solutions(tool_down(5.0, 0.0, 0.0)))
    with pytest.raises(InputError, match=r"margin of at least 0\.0005 m, got 0"):
        plan_path(checker_with(margin=0.0), start, goals)
    with pytest.raises(InputError, match=r"goals must have shape \(m, 6\)"):
        plan_path(checker, start, np.zeros((0, 6)))
    for wrong in ({"seed": -1}, {"seed": 1.5}, {"timeout": 0.0}):
        with pytest.raises(InputError, match="must be"):
            plan_path(checker, start, goals, **wrong)


def test_there_is_an_end_to_the_search():
    """An elbow that may turn beyond the upper arm, bent on either side of it: the upper arm is between them."""
    arm = get_arm("ur5e").with_limits({"elbow_joint": (-2 * np.pi, 2 * np.pi)})
    start = np.array([0.0, -1.8, 2.2, -2.0, -1.57, 0.0])
    goal = np.array([0.0, -1.2, 2 * np.pi - 2.2, 1.8, 1.57, 0.0])
    with pytest.raises(PathError, match=r"no path was found within 0\.2 s to any of 1 free goal postures"):
        plan_path(CollisionChecker(arm, margin=MARGIN), start, goal, timeout=0.2)


def test_a_joint_line_says_where_it_collides(kin, checker):
    start = kin.all_solutions(tool_down(0.45, 0.25, 0.2), seed=kin.arm.home).q[0]
    over = np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0])
    with pytest.raises(PathError, match=r"collision \d+ % of the way from waypoint 1 to 2, at q = ") as caught:
        joint_line(checker, [start, start + 0.1 * over, start - 5.0 * over])
    error = caught.value
    assert error.index == 1
    assert checker.in_collision(error.q)
    np.testing.assert_allclose(error.q, start + (0.1 - 5.1 * error.fraction) * over, atol=1e-12)
    with pytest.raises(PathError, match="waypoint 1 is out of limits: elbow_joint"):
        joint_line(checker, [start, start + 9.0 * np.eye(6)[2]])
    with pytest.raises(InputError, match=r"waypoints must have shape \(m, 6\)"):
        joint_line(checker, start)


def test_nothing_between_two_samples_is_missed(checker):
    exact = checker_with(WALL, POST, margin=0.0)
    rng = np.random.default_rng(0)
    counts = {True: 0, False: 0}
    for _ in range(400):
        start = rng.uniform(-3.0, 3.0, 6)
        end = start + rng.normal(0.0, 0.25, 6)
        try:
            joint_line(checker, [start, end])
        except PathError:
            counts[False] += 1
        else:
            counts[True] += 1
            assert not exact.impossible(dense(np.array([start, end]))).any()
    assert min(counts.values()) > 50


def test_in_a_narrow_passage_blocked_postures_grow_only_to_what_is_near(kin, checker, monkeypatch):
    """Others cost no collision check; a step that succeeds widens the radius, one that is blocked narrows it."""
    motion, judged = MotionCheck(checker), []
    tree = planning._Tree(motion, np.array(kin.arm.home), planning.SEARCH_STEP)
    monkeypatch.setattr(motion, "free", lambda q: judged.append(q) or len(judged) in free)
    monkeypatch.setattr(motion, "motion_free", lambda *ends, step: True)
    root, free = tree.postures[0], set()
    beyond = root + 2.0 * planning.RADIUS / tree._scale
    assert tree.extend(beyond, bounded=True) is None, "not blocked before: tried"
    assert (len(judged), tree._radii) == (1, [planning.RADIUS])
    for _ in range(5):
        assert tree.extend(beyond, bounded=True) is None
    assert len(judged) == 1
    near = root + 0.5 * planning.RANGE / tree._scale / np.sqrt(kin.n)
    assert tree.extend(near, bounded=True) is None
    assert tree._radii == [pytest.approx(planning.RADIUS * (1.0 - planning.ADAPTATION))]
    assert tree.extend(beyond, bounded=False) is None, "tried, because the search is not long yet"
    assert len(judged) == 3
    for _ in range(5000):
        tree.extend(near, bounded=True)
    assert tree._radii == [planning.RANGE]
    free.add(len(judged) + 1)
    assert tree.extend(near, bounded=True) == 1
    assert tree._radii == [pytest.approx(planning.RANGE * (1.0 + planning.ADAPTATION)), np.inf]


def test_paths_through_narrow_passages_are_free(kin, checker, monkeypatch):
    """As if every search was long from its first step on."""
    monkeypatch.setattr(planning, "NARROW", 0)
    detours = 0
    for seed in range(6):
        start, goals = across(kin, checker, seed)
        path = plan_path(checker, start, goals, seed=seed, timeout=60.0)
        assert all(MotionCheck(checker).motion_free(a, b) for a, b in pairwise(path))
        np.testing.assert_array_equal(path[0], start)
        detours += len(path) > 2
    assert detours >= 3
