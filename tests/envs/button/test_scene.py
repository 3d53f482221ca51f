"""The scene under torque: its dynamics are Pinocchio's, its good looks change nothing, its button shows its state."""

from types import SimpleNamespace

import gymnasium as gym
import mujoco
import numpy as np
import pinocchio as pin
import pytest

import kinreach
from kinreach.envs._button.world import AWAY
from kinreach.envs.inside import ACTUATIONS, ButtonState, torque_model
from kinreach.kinematics import Arm3Kinematics
from kinreach.robots import get_arm

NAME = "kinreach/ButtonPress-v0"
KIN = Arm3Kinematics(base="world")
TARGET = (0.4, 0.3, 0.3)
STILL, PRESS = 13, 40


def make(**options):
    assert kinreach.__version__
    return gym.make(NAME, **options)


@pytest.mark.parametrize("actuation", ACTUATIONS.values(), ids=list(ACTUATIONS))
def test_accelerations_are_those_of_pinocchio(actuation):
    model = torque_model(get_arm("arm3"), actuation, visual=False)
    data = mujoco.MjData(model)
    reference = KIN.model.copy()
    reference.armature = np.array(actuation.armature)
    scratch = reference.createData()
    gears, damping = np.array(actuation.gears), np.array(actuation.damping)
    rng = np.random.default_rng(0)
    compared = 0
    for _ in range(300):
        q, qd, control = rng.uniform(-1.5, 1.5, 3), rng.normal(0, 3, 3), rng.integers(-10, 11, 3)
        data.qpos, data.qvel, data.ctrl = q, qd, control
        mujoco.mj_forward(model, data)
        if data.ncon == 0:
            torque = control * gears - damping * qd
            expected = pin.aba(reference, scratch, q, qd, torque)
            np.testing.assert_allclose(data.qacc, expected, rtol=1e-9, atol=1e-9)
            compared += 1
    assert compared >= 200


def test_the_torque_of_the_tuned_set_is_the_effort_of_the_urdf():
    model = torque_model(get_arm("arm3"), ACTUATIONS["tuned"], visual=False)
    np.testing.assert_array_equal(10 * np.array(ACTUATIONS["tuned"].gears), model.jnt_actfrcrange[:, 1])


@pytest.mark.parametrize("actuation", list(ACTUATIONS))
def test_drawing_changes_no_motion(actuation):
    plain, drawn = make(actuation=actuation), make(actuation=actuation, render_mode="rgb_array")
    for env in (plain, drawn):
        env.reset(seed=4)
    touched = 0
    for action in np.random.default_rng(0).integers(0, 54, 300):
        results = [env.step(action) for env in (plain, drawn)]
        np.testing.assert_array_equal(results[0][0], results[1][0])
        touched += plain.unwrapped._world.data.ncon > 0
    assert touched >= 10


def shown(env):
    """The states of the button whose caps are not out of sight."""
    world = env.unwrapped._world
    places = {
        state: world.data.mocap_pos[world.model.body(f"button_{state.name.lower()}").mocapid[0]]
        for state in ButtonState
    }
    return [state for state, place in places.items() if (place != AWAY).any()]


def test_the_button_shows_its_state():
    env = make(render_mode="rgb_array")
    q = KIN.all_solutions(TARGET).q[0]
    env.reset(seed=0)
    assert shown(env) == [ButtonState.IDLE]
    env.step(PRESS)
    assert shown(env) == [ButtonState.WRONG]
    env.step(STILL)
    assert shown(env) == [ButtonState.IDLE]
    env.reset(options={"goal": TARGET, "q": q})
    env.step(PRESS)
    assert shown(env) == [ButtonState.PRESSED]
    env.reset()
    assert shown(env) == [ButtonState.IDLE]


def green(frame):
    """Number of pixels that are clearly green."""
    r, g, b = (frame[..., i].astype(int) for i in range(3))
    return int(((g > r + 60) & (g > b + 40)).sum())


def test_pictures_show_ball_and_press(needs_gl):
    env = make(render_mode="rgb_array")
    q = KIN.all_solutions(TARGET).q[0]
    env.reset(seed=0, options={"goal": TARGET})
    before = env.render()
    assert before.shape == (360, 640, 3)
    assert before.dtype == np.uint8
    r, g, b = (before[..., i].astype(int) for i in range(3))
    assert ((r > 140) & (g < 60) & (b < 60)).sum() > 50  # the red ball
    assert green(before) == 0
    env.reset(options={"goal": TARGET, "q": q})
    env.step(PRESS)
    assert green(env.render()) > 50
    env.close()


@pytest.mark.parametrize("actuation", list(ACTUATIONS))
@pytest.mark.slow
def test_a_list_of_frames_is_the_motion_in_the_time_of_the_simulation(actuation, needs_gl):
    env = make(render_mode="rgb_array_list", actuation=actuation)
    env.reset(seed=0)
    steps = round(0.4 / ACTUATIONS[actuation].period)
    for _ in range(steps):
        env.step(STILL)
    assert len(env.render()) in (10, 11)  # at 25 frames per second
    assert len(env.render()) == 1  # nothing moved since
    env.close()


def test_depth_is_measured_in_metres(needs_gl):
    env = make(render_mode="depth_array")
    env.reset(seed=0)
    depth = env.render()
    assert depth.shape == (360, 640)
    assert 1.5 < depth[180:300, 300:340].min() < 3.0
    env.close()


def test_the_window_shows_the_press_that_ends_an_episode(monkeypatch):
    """Even where the last picture was taken a moment before."""
    states = []
    viewer = SimpleNamespace(sync=lambda: states.append(shown(env)), close=lambda: None)
    monkeypatch.setattr("kinreach.sim._picture.SceneViewer", lambda model, data, *, camera: viewer)
    monkeypatch.setattr("time.sleep", lambda seconds: None)
    q = KIN.all_solutions(TARGET).q[0]
    for actuation in ACTUATIONS:
        env = make(render_mode="human", actuation=actuation)
        env.reset(seed=0, options={"goal": TARGET, "q": q})
        assert states[-1] == [ButtonState.IDLE]
        assert env.step(PRESS)[2]
        assert states[-1] == [ButtonState.PRESSED]
        env.reset(seed=1)
        assert states[-1] == [ButtonState.IDLE]
        env.close()


def test_the_viewer_runs_no_faster_than_the_clock(monkeypatch):
    """With a viewer that opens no window and a clock that only sleeping moves."""
    clock, syncs = [0.0], []
    viewer = SimpleNamespace(sync=lambda: syncs.append(clock[0]), close=lambda: syncs.append("closed"))
    monkeypatch.setattr("kinreach.sim._picture.SceneViewer", lambda model, data, *, camera: viewer)
    monkeypatch.setattr("time.monotonic", lambda: clock[0])
    monkeypatch.setattr("time.sleep", lambda seconds: clock.__setitem__(0, clock[0] + seconds))
    env = make(render_mode="human", actuation="report")
    env.reset(seed=0)
    assert len(syncs) == 1  # what begins is shown
    for _ in range(250):
        env.step(STILL)
    assert len(syncs) == pytest.approx(26, abs=1)
    assert clock[0] == pytest.approx(1.0, abs=0.05)
    for _ in range(2):
        env.close()
    assert syncs.count("closed") == 1
