"""Looks that were taken beforehand are what rendering says, up to which of them is whose."""

import numpy as np
import pytest
from scipy.stats import ks_2samp

from kinreach.envs._lift.lift_task import LiftOptions
from kinreach.envs._reach.observers import CameraObserver, RememberedObserver, goal_observer
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
