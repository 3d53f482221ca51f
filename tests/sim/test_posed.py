"""A scene that is put into postures: where things are, and the way that is shown between two of them."""

import numpy as np
import pytest

from kinreach.errors import InputError
from kinreach.kinematics import URKinematics
from kinreach.robots import get_arm
from kinreach.sim.inside import PosedScene, build_scene, mujoco

ARM = get_arm("ur5-thesis")
BALL = (0.4, 0.1, -0.1)
#: Time between two postures [s]; short enough that every frame of a film is another.
PERIOD = 0.02


@pytest.fixture
def scene():
    return PosedScene(ARM, model=build_scene(ARM, visual=False).compile())


def test_arm_ball_and_clock_are_where_they_are_put(scene):
    np.testing.assert_array_equal(scene.q, ARM.home)
    q = np.array(ARM.home) + 7.0  # beyond its limits
    scene.put(q, ball=BALL, time=2.5)
    np.testing.assert_array_equal(scene.q, q)
    scene.put(ARM.home)
    mujoco.mj_kinematics(scene.model, scene.data)
    np.testing.assert_allclose(
        scene.data.body("tcp").xpos, URKinematics("ur5-thesis", tip="tcp", base="world").positions(ARM.home), atol=1e-9
    )
    np.testing.assert_array_equal(scene.data.body("ball").xpos, BALL)
    assert scene.data.time == 2.5
    for wrong in ({"q": np.zeros(5)}, {"q": ARM.home, "ball": (0, 0)}, {"q": ARM.home, "ball": (0, 0, 2e6)}):
        with pytest.raises(InputError):
            scene.put(**wrong)


@pytest.mark.parametrize("turn", [0.0, 0.01, 2.0])
def test_a_way_is_smooth_and_at_its_fastest_at_the_limit(scene, turn):
    ends, balls, times = [scene.q], [], [0.0]

    def watch():
        ends.append(scene.q)
        balls.append(scene.data.mocap_pos[0].copy())
        times.append(scene.data.time)

    scene.watch = watch
    way = turn * np.array([1.0, -0.5, 0.0, 0.2, 0.0, -1.0])
    scene.go(ARM.home + way, ball=BALL)
    np.testing.assert_allclose(ends[-1], ARM.home + way, atol=1e-15)
    np.testing.assert_array_equal(balls, len(balls) * [BALL])
    np.testing.assert_allclose(np.diff(times), PERIOD)
    if turn < 1.0:
        assert len(ends) == 2
        return
    share = np.array(ends - np.array(ARM.home)) @ way / (way @ way)
    np.testing.assert_allclose(ends - np.array(ARM.home), share[:, None] * way, atol=1e-12)
    np.testing.assert_allclose(share, 1.0 - share[::-1], atol=1e-12)
    speeds = np.abs(np.diff(ends, axis=0)).max(axis=1) / PERIOD
    assert 0.98 * ARM.speed_limit < speeds.max() < 1.02 * ARM.speed_limit
    assert speeds[0] == pytest.approx(speeds[-1])
    assert speeds[0] < 0.15 * ARM.speed_limit
    scene.watch = None
    scene.go(ARM.home)
    np.testing.assert_array_equal(scene.q, ARM.home)
    assert len(ends) == len(times)
