"""Looks that were taken beforehand are what rendering says, up to which of them is whose."""

from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from scipy.stats import ks_2samp

from kinreach.envs._lift.lift_task import LiftOptions
from kinreach.envs._reach import observers
from kinreach.envs._reach.observers import (
    CameraObserver,
    Measurements,
    PixelObserver,
    RememberedObserver,
    goal_observer,
)
from kinreach.envs._reach.reach_task import SINGLE_STEP, ReachOptions, ReachTask, goal_block

#: Small and noisy pictures, in which the thesis's pipeline is 3 mm off and misses one ball in seven.
PICTURES = {"pipeline": "thesis", "width": 160, "height": 90, "rgb_noise": 60.0}
LOOKS = 80


@pytest.fixture(scope="module")
def task(needs_gl):
    return ReachTask(ReachOptions(backend="kinematic", observation="camera", looks=LOOKS, **PICTURES), SINGLE_STEP)


@pytest.fixture(scope="module")
def remembered(task):
    observer = goal_observer(task)
    assert isinstance(observer, RememberedObserver)
    return observer


@pytest.mark.slow
def test_goals_are_seen_as_well_as_by_rendering(task, remembered):
    goals = task.arm.workcell.draw_goals(np.random.default_rng(5), LOOKS)
    rendering = CameraObserver(task.arm, task.options)
    rendered = rendering.measure(goals, np.zeros(LOOKS, dtype=np.intp), [np.random.default_rng(1)])
    rendering.close()
    found = remembered.measure(goals, np.arange(LOOKS), [])
    true = goal_block(task.arm, goals).reshape(-1, 2, 3)
    compared = 0
    for camera in (0, 1):
        both = [
            np.linalg.norm((looks.views.reshape(-1, 2, 3) - true)[looks.found[:, camera], camera], axis=1)
            for looks in (rendered, found)
        ]
        assert ks_2samp(*both).pvalue > 0.01
        compared += min(len(one) for one in both)
    assert compared > 1.5 * LOOKS
    assert 0.05 < 1 - rendered.found.mean() < 0.3
    assert abs(rendered.found.mean() - found.found.mean()) < 0.1


@pytest.mark.slow
def test_where_a_look_was_taken_the_goal_is_seen_as_it_was(task, remembered):
    rng = np.random.default_rng(0)
    goals = task.arm.workcell.draw_goals(rng, LOOKS)
    rendering = CameraObserver(task.arm, task.options)
    rendered = rendering.measure(goals, np.zeros(LOOKS, dtype=np.intp), [rng])
    rendering.close()
    found = remembered.measure(goals, np.arange(LOOKS), [])
    np.testing.assert_allclose(found.views, rendered.views, atol=1e-12)
    np.testing.assert_array_equal(found.found, rendered.found)
    np.testing.assert_allclose(found.seen, rendered.seen, atol=1e-12)
    lost = ~found.found
    assert 10 < lost.sum() < LOOKS
    assert (found.views.reshape(-1, 2, 3)[lost] == 0).all()


@pytest.mark.usefixtures("needs_gl")
@pytest.mark.parametrize(("noise", "least"), [({"rgb_noise": 30.0}, 1e-6), ({"depth_noise": 0.002}, 1e-5)])
@pytest.mark.slow
def test_each_noise_of_the_cameras_moves_where_balls_are_seen(noise, least):
    """Under the same random numbers, on more than half of the balls; without any they are seen alike."""
    small = {"backend": "kinematic", "observation": "camera", "width": 160, "height": 90}
    plain, task = (ReachTask(ReachOptions(**small, **more), SINGLE_STEP) for more in ({}, noise))
    goals = plain.arm.workcell.draw_goals(np.random.default_rng(2), 8)
    seen = []
    for each in (plain, plain, task):
        observer = CameraObserver(each.arm, each.options)
        seen.append(observer.measure(goals, np.zeros(8, dtype=np.intp), [np.random.default_rng(3)]).seen)
        observer.close()
    np.testing.assert_array_equal(seen[0], seen[1])
    moved = np.linalg.norm(seen[2] - seen[0], axis=1)
    assert (moved > least).sum() >= 5, moved


@pytest.mark.parametrize("options", [ReachOptions, LiftOptions])
def test_noises_of_the_cameras_are_those_that_were_given(options):
    noise = options(observation="camera", rgb_noise=3.0, depth_noise=0.002).noise
    assert (noise.rgb_sigma, noise.depth_sigma) == (3.0, 0.002)


class Squinting:
    """Cameras that are off by a number for each goal, and do not find some; without graphics."""

    made: ClassVar[list["Squinting"]] = []

    def __init__(self, arm, options):
        self.arm, self.asked, self.closed = arm, [], 0
        self.made.append(self)

    def measure(self, goals, ids, rngs):
        self.asked.append((goals, ids, rngs))
        off = 1e-3 * np.sin(np.arange(6 * len(goals))).reshape(-1, 6)
        found = np.random.default_rng(8).random((len(goals), 2)) < 0.7
        views = np.where(np.repeat(found, 3, axis=1), goal_block(self.arm, goals) + off, 0.0)
        return Measurements(views, found, goals)

    def close(self):
        self.closed += 1


def test_a_goal_has_the_error_of_the_nearest_look(monkeypatch):
    """Which is found here by all distances; looks are drawn from the work cell, the same ones each time."""
    monkeypatch.setattr(observers, "CameraObserver", Squinting)
    Squinting.made.clear()
    task = ReachTask(ReachOptions(backend="kinematic", observation="camera", looks=LOOKS, **PICTURES), SINGLE_STEP)
    observer = goal_observer(task)
    assert isinstance(observer, RememberedObserver)
    (cameras,) = Squinting.made
    assert cameras.closed == 1
    ((looks, ids, (rng,)),) = cameras.asked
    expected = np.random.default_rng(0)
    np.testing.assert_array_equal(looks, task.arm.workcell.draw_goals(expected, LOOKS))
    assert rng.bit_generator.state == expected.bit_generator.state
    np.testing.assert_array_equal(ids, np.zeros(LOOKS))
    goals = task.arm.workcell.draw_goals(np.random.default_rng(5), 60)
    measured = observer.measure(goals, np.arange(60), [])
    taken = cameras.measure(looks, ids, [])
    nearest = np.linalg.norm(goals[:, None] - looks, axis=2).argmin(axis=1)
    np.testing.assert_array_equal(measured.found, taken.found[nearest])
    found = measured.found.repeat(3, axis=1)
    errors = (taken.views - goal_block(task.arm, looks))[nearest]
    np.testing.assert_allclose((measured.views - goal_block(task.arm, goals))[found], errors[found], atol=1e-12)
    assert (measured.views[~found] == 0).all()
    assert 30 < found.sum() < found.size - 30
    off = np.linalg.norm(measured.seen - goals, axis=1)
    seen = measured.found.any(axis=1)
    assert np.isnan(off[~seen]).all()
    assert 0.0 < off[seen].max() < 2e-3
    assert 40 < seen.sum() < 60
    assert observer.last is None
    observer.close()
    assert cameras.closed == 1


class Looking:
    """A camera without graphics, whose depths are where joints, ball and fingers are, and something far away."""

    made: ClassVar[list["Looking"]] = []

    def __init__(self, simulation, name, *, width, height):
        self.simulation, self.name, self.shape, self.closed = simulation, name, (height, width), 0
        self.made.append(self)

    def capture(self, *, noise, rng):
        assert (noise.rgb_sigma, noise.depth_sigma) == (3.0, 0.002)
        data, gripper = self.simulation.data, self.simulation.arm.gripper
        depth = np.full(self.shape, 12.0, np.float32)
        depth[0, :6] = self.simulation.q + 4.0
        depth[1, :3] = data.mocap_pos[self.simulation.model.body("ball").mocapid[0]] + 1.0
        depth[2, :2] = [data.joint(name).qpos[0] for name in gripper.joints]
        rgb = np.full((*self.shape, 3), rng.integers(256), np.uint8)
        return SimpleNamespace(rgb=rgb, depth=depth)

    def close(self):
        self.closed += 1


@pytest.mark.parametrize("opened", [True, False])
def test_pictures_are_of_the_posture_the_goal_and_the_opening(opened, monkeypatch):
    """Each row has its own, and its own noise; a posture beyond a limit is drawn at the limit."""
    monkeypatch.setattr(observers, "RGBDCamera", Looking)
    Looking.made.clear()
    options = ReachOptions(
        backend="kinematic", observation="pixels", width=32, height=18, rgb_noise=3.0, depth_noise=0.002
    )
    task, rng = ReachTask(options, SINGLE_STEP), np.random.default_rng(4)
    observer, gripper = PixelObserver(task.arm, options), task.arm.gripper
    assert [(camera.name, camera.shape) for camera in Looking.made] == [("front", (18, 32)), ("wrist", (18, 32))]
    limits = Looking.made[0].simulation.controller
    q = rng.uniform(limits.lower, limits.upper, (5, 6))
    q[0, 2] = limits.upper[2] + 1e-4
    goals, openings = task.arm.workcell.draw_goals(rng, 5), rng.uniform(0.01, 0.15, 5)
    seeds = [np.random.default_rng(seed) for seed in range(5)]
    seen = observer.measure(q, goals, seeds, openings if opened else None)
    assert observer.space.contains({name: part[0] for name, part in seen.items()})
    fingers = openings if opened else np.full(5, gripper.opening)
    np.testing.assert_array_equal(seen["gripper"], fingers[:, None])
    np.testing.assert_allclose(np.exp(1j * seen["joints"]), np.exp(1j * q), atol=1e-12)
    drawn = [np.random.default_rng(seed).integers(256, size=2) for seed in range(5)]
    for column, name in enumerate(("front", "wrist")):
        depth = seen[f"{name}_depth"][..., 0]
        np.testing.assert_allclose(depth[:, 0, :6] - 4.0, np.clip(q, limits.lower, limits.upper), atol=1e-6)
        np.testing.assert_allclose(depth[:, 1, :3] - 1.0, goals, atol=1e-6)
        np.testing.assert_allclose(depth[:, 2, :2], np.column_stack([fingers, fingers]) / 2, atol=1e-6)
        assert (depth[:, 3:] == 10.0).all()
        for row in range(5):
            assert (seen[f"{name}_rgb"][row] == drawn[row][column]).all()
    observer.close()
    assert [camera.closed for camera in Looking.made] == [1, 1]
