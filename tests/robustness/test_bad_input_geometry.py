"""Collision checks, the reward and where cameras see a goal, under fuzz."""

import math

import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, Cause, CollisionChecker
from kinreach.robots import Box
from kinreach.thesis import distance_reward, pentagon_angles, posture_error, reach_reward
from kinreach.vision import geometric_goal_view, goal_in_world
from tests.robustness.fuzzing import NUMBERS, bad_arrays, things

CHECKERS = {arm: CollisionChecker(arm) for arm in ("ur5-thesis", "arm3")}


def angles(*shape, most=7.0):
    return arrays(np.float64, shape, elements=st.floats(-most, most))


@pytest.mark.parametrize("arm", CHECKERS)
def test_collision_checker(arm, fuzzed):
    checker, n = CHECKERS[arm], ArmKinematics(arm).n

    def run(q):
        contacts, clearance = checker.contacts(q), checker.distance(q)
        assert checker.in_collision(q) is bool(contacts)
        assert checker.free(q) is not bool(contacts)
        assert set(contacts) <= set(checker.pairs)
        assert math.isfinite(clearance.distance)
        turned = (np.asarray(q).astype(float) + np.pi) % (2 * np.pi) - np.pi
        assert checker.contacts(turned) == contacts or abs(clearance.distance) < 1e-6

    fuzzed(bad_arrays((n,)) | angles(n) | angles(n, most=1e5), run)


def test_obstacles(fuzzed):
    q = np.zeros(3)

    def run(case):
        name, size, position, margin = case
        checker = CollisionChecker(
            "arm3", obstacles=[Box("far", (1, 1, 1), (50, 0, 0)), Box(name, size, position)], margin=margin
        )
        contacts = checker.contacts(q)
        hits = [pair for pair in contacts if name in pair]
        assert checker.in_collision(q) is bool(contacts)
        near = checker.distance(q)
        assert math.isfinite(near.distance)
        # all of the arm is within 3 m
        gap = np.maximum(np.abs(np.array(position, dtype=float)) - np.array(size, dtype=float) / 2, 0).max() - 3.0
        assert gap <= margin or not hits

    triple = st.tuples(*[st.floats(1e-3, 1000)] * 3) | st.tuples(*[NUMBERS] * 3) | things()
    names = st.sampled_from(["box", "far", "base_link"]) | things()
    margins = st.just(0.0) | st.just(0.0) | st.floats(0, 2) | NUMBERS | things()
    fixed = st.tuples(
        st.just("box"), st.tuples(*[st.floats(1e-3, 1000)] * 3), st.tuples(*[st.floats(-1000, 1000)] * 3), margins
    )
    fuzzed(fixed | st.tuples(names, triple, triple, margins), run, share=0.6)


@pytest.mark.parametrize("obstacles", [5, "box", [None], [Box("a", (1, 1, 1), (0, 0, 0))] * 2, {"a": 1}])
def test_what_is_no_list_of_boxes_is_refused(obstacles):
    with pytest.raises(InputError):
        CollisionChecker("arm3", obstacles=obstacles)


def test_causes(fuzzed):
    checker, kin = CHECKERS["ur5-thesis"], ArmKinematics("ur5-thesis")

    def run(q):
        causes = checker.causes(q)
        rows = np.asarray(q).astype(float)
        assert causes.shape == (len(rows),)
        for row, cause in zip(rows, causes, strict=True):
            if np.abs(row).max() > 1e6 or not kin.within_limits(row):
                assert cause == Cause.LIMITS
            else:
                assert (cause != Cause.NONE) == checker.in_collision(row)
                assert bool(checker.reason(row)) == (cause != Cause.NONE)
        assert [checker.causes(row[None])[0] for row in rows] == causes.tolist()

    fuzzed(bad_arrays((2, 6)) | angles(3, 6, most=3.1) | angles(2, 6, most=1e300), run)


def test_reward(fuzzed):
    def run(case):
        d, q, impossible = case
        scored = reach_reward(d, q, impossible=impossible)
        assert np.isfinite(scored.reward).all()
        np.testing.assert_array_equal(sum(scored.terms), scored.reward)
        np.testing.assert_array_equal(posture_error(q) + 0 * scored.posture_error, scored.posture_error)
        assert np.isfinite(pentagon_angles(q)).all()
        d, q = np.asarray(d).astype(float), np.asarray(q).astype(float)
        failed = np.broadcast_to(np.asarray(impossible).astype(bool), np.shape(scored.reward))
        assert (np.asarray(scored.reward)[failed] == -100).all()
        if d.shape == () and d > 0:
            expected = 1 - d / 2 if d >= 2 else 0.5 - 0.5 * math.log2(d)
            assert distance_reward(d) == pytest.approx(expected, rel=1e-12)

    distances = st.floats(0, 3) | NUMBERS | bad_arrays((2,)) | bad_arrays(())
    postures = angles(6) | angles(2, 6) | bad_arrays((6,)) | bad_arrays((2, 6))
    flags = st.booleans() | st.just(False) | arrays(np.bool_, 2) | bad_arrays((2,))
    fuzzed(st.tuples(distances, postures, flags), run, share=2)


def test_goal_views(fuzzed):
    def run(case):
        goals, found = case
        view = geometric_goal_view("ur5-thesis", goals)
        points = np.asarray(goals).astype(float)
        assert view.shape == (*points.shape[:-1], 6)
        assert np.isfinite(view).all()
        if points.shape == (3,):
            back = goal_in_world("ur5-thesis", view, found)
            assert back is None or np.abs(back - points).max() <= 1e-9 * (1 + np.abs(points).max())

    flags = arrays(np.bool_, 2) | bad_arrays((2,))
    goals = angles(3) | angles(4, 3) | bad_arrays((3,))
    fuzzed(st.tuples(goals, flags), run)
