"""Pictures of every environment: films of other people's wrappers, cameras, sizes, windows."""

import zlib
from types import SimpleNamespace

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from gymnasium.wrappers import RecordEpisodeStatistics, RecordVideo

import kinreach  # noqa: F401 (registers the environments)
from kinreach.errors import InputError, UnknownNameError
from kinreach.sim import ArmSimulation
from kinreach.sim.inside import FrameRenderer
from tests.cases import stand_in

IDS = sorted(name for name in gym.registry if name.startswith("kinreach/"))
#: Trays that are small.
QUICK = {"kinreach/RealArm-v0": {"balls": 2, "budgets": (0, 5), "again": 1}}
SMALL = {"render_width": 64, "render_height": 36}
STEPS = 4
#: Those that were not drawn in the first versions.
OTHERS = [f"kinreach/{name}-v0" for name in ("Moving", "Obstacles", "RealArm", "RandomArm")]


def made(name, mode, **options):
    env = gym.make(name, render_mode=mode, disable_env_checker=True, **{**QUICK.get(name, {}), **options})
    env.action_space.seed(1)
    return env


class Places:
    """A renderer without graphics: every pixel is a number of where all bodies are, and of the camera."""

    def __init__(self, model, *, width, height, shadows):
        self.model, self.shape = model, (height, width, 3)

    def rgb(self, data, camera):
        mujoco.mj_kinematics(self.model, data)
        return np.full(self.shape, zlib.crc32(np.round(data.xpos, 6).tobytes() + repr(camera).encode()) % 256, np.uint8)

    def depth(self, data, camera):
        return self.rgb(data, camera)[..., 0]

    def close(self):
        pass


def film(name, films, folder):
    """Record an episode as CleanRL's `--capture-video` does: the frames, and whether the arm moved."""
    env = RecordEpisodeStatistics(RecordVideo(made(name, "rgb_array", **SMALL), str(folder)))
    env.reset(seed=0)
    moved = over = False
    steps = 0
    while not over and steps < STEPS:
        *_, terminated, truncated, info = env.step(env.action_space.sample())
        moved |= not info["impossible"] or "Obstacles" in name
        over, steps = terminated or truncated, steps + 1
    env.close()
    (frames,) = films
    assert len(frames) == 1 + steps
    assert {(frame.shape, frame.dtype) for frame in frames} == {((36, 64, 3), np.dtype(np.uint8))}
    assert not moved or any((frame != frames[0]).any() for frame in frames)
    return frames


@pytest.mark.parametrize("name", IDS)
@pytest.mark.slow
def test_every_id_is_filmed(name, films, tmp_path, monkeypatch):
    """A frame of every reset and step, of what the arm does."""
    stand_in(monkeypatch, FrameRenderer, Places)
    film(name, films, tmp_path / "film")
    env = made(name, None).unwrapped
    env.reset(seed=0)
    assert env.render_mode is None
    assert env.render() is None


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHERS)
def test_films_are_no_plain_colour(name, films, needs_gl, tmp_path):
    assert min(frame.std() for frame in film(name, films, tmp_path / "film")) > 10.0


@pytest.mark.parametrize("name", OTHERS)
def test_ids_without_a_simulation_of_bodies_have_every_mode(name, monkeypatch):
    """Without graphics, and with a window that shows nothing."""
    stand_in(monkeypatch, FrameRenderer, Places)
    shown = []
    window = SimpleNamespace(sync=lambda: shown.append(name), close=lambda: shown.append("closed"))
    monkeypatch.setattr("kinreach.sim._picture.SceneViewer", lambda model, data, *, camera: window)
    monkeypatch.setattr("time.sleep", lambda seconds: None)
    shapes = {}
    for mode in ("human", "rgb_array_list", "depth_array"):
        env = made(name, mode, **SMALL).unwrapped
        for seed in range(2):
            env.reset(seed=seed)
            env.step(env.action_space.sample())
        shapes[mode] = np.shape(env.render())
        env.close()
    assert shown.count(name) >= 2
    assert shown[-1] == "closed"
    assert shapes["depth_array"] == (36, 64)
    assert shapes["rgb_array_list"][0] >= 1
    assert shapes["rgb_array_list"][1:] == (36, 64, 3)


@pytest.mark.parametrize("name", [name for name in IDS if name not in (*OTHERS, "kinreach/ButtonPress-v0")])
def test_a_window_shows_where_a_step_has_led(name, monkeypatch):
    """The last that it is told to show is the scene as it stands then."""
    shown = []

    def window(model, data, *, camera):
        return SimpleNamespace(sync=lambda: shown.append(data.qpos.copy()), close=lambda: None)

    monkeypatch.setattr("kinreach.sim._picture.SceneViewer", window)
    monkeypatch.setattr("time.sleep", lambda seconds: None)
    env = made(name, "human").unwrapped
    for seed in (0, 1):
        env.reset(seed=seed)
        count, before = len(shown), env.scene.data.qpos.copy()
        action = np.full(env.action_space.shape, 0.1 + 0.1 * seed)
        action[:6] += env.home / np.pi if "Single" in name or "Reach" in name or "Lift" in name else 0.0
        env.step(action)
        assert len(shown) > count
        np.testing.assert_array_equal(shown[-1], env.scene.data.qpos)
        assert (shown[-1] != before).any()
    env.close()


@pytest.mark.parametrize("name", OTHERS)
def test_a_scene_shows_the_arm_as_it_is_whenever_it_is_asked_for(name):
    """One that is asked for in mid-episode is where one has come that followed from the start; states come with it."""
    early, late = (made(name, None).unwrapped for _ in range(2))
    for env in (early, late):
        env.reset(seed=3)
    calls, home, begun = [], early.scene.q, early.scene.data.time
    early.scene.watch = lambda: calls.append(early.scene.data.time)
    rng, over, steps = np.random.default_rng(1), False, 0
    while steps < 2 and not over:
        before = len(calls)
        action = home / np.pi - [0.0, 0.05, 0.0, 0.0, 0.0, 0.0] + rng.uniform(-0.02, 0.02, early.action_space.shape)
        for env in (early, late):
            *_, over, _, info = env.step(action)
        steps += 1
        assert len(calls) > before
        if name in ("kinreach/Moving-v0", "kinreach/RandomArm-v0"):
            assert calls == pytest.approx([begun + (step + 1) / early.metadata["render_fps"] for step in range(steps)])
    here, ball = early.scene.q, early.scene.data.mocap_pos[0].copy()
    assert np.abs(here - home).max() > 1e-3
    if name != "kinreach/RealArm-v0":  # of a tray, the last ball is shown
        np.testing.assert_allclose(here, early.episodes.q[0], atol=1e-12)
        np.testing.assert_allclose(ball, info["goal"], atol=1e-12)
    state = late.save_state()
    for _ in range(2):
        np.testing.assert_allclose(late.scene.q, here, atol=1e-12)
        np.testing.assert_allclose(late.scene.data.mocap_pos[0], ball, atol=1e-12)
        late.reset(seed=4)
        np.testing.assert_array_equal(late.scene.q, home)
        late.restore_state(state)


@pytest.mark.parametrize("name", IDS)
def test_a_restored_environment_draws_what_was_restored(name, monkeypatch):
    """As if it had been drawn from the start; where nothing is drawn while bodies move, of a state without pictures."""
    stand_in(monkeypatch, FrameRenderer, Places)
    plain, drawn, same = (made(name, mode, **SMALL).unwrapped for mode in (None, "rgb_array", "rgb_array"))
    for env, seed in ((plain, 3), (drawn, 4), (same, 3)):
        env.reset(seed=seed)
    action = plain.action_space.sample()
    for env in (plain, same):
        env.step(action)
    frames = [drawn.render()]
    drawn.restore_state((plain if name in OTHERS else same).save_state())
    frames += [drawn.render(), same.render()]
    np.testing.assert_array_equal(frames[1], frames[2])
    assert (frames[0] != frames[1]).any()


@pytest.mark.parametrize("name", [f"kinreach/{name}-v0" for name in ("ButtonPress", "UR5MultiStepKinematic", "Reach")])
def test_a_batch_draws_each_environment_as_it_would_be_drawn_alone(name, monkeypatch):
    """Its arm where it stands, and its ball; after resets and steps, over the ends of episodes."""
    stand_in(monkeypatch, FrameRenderer, Places)
    options = {"max_episode_steps": 2} if "Reach" not in name else {"backend": "kinematic"}
    batch = gym.make_vec(name, 3, "vector_entry_point", render_mode="rgb_array", autoreset_mode="NextStep", **SMALL,
                         **options)  # fmt: skip
    batch.reset(seed=5)
    singles, drawn = [made(name, "rgb_array", **SMALL, **options) for _ in range(3)], []
    for row, env in enumerate(singles):
        env.reset(seed=5 + row)
    over = np.zeros(3, dtype=bool)
    for _ in range(5):
        frames = batch.render()
        assert len(frames) == 3
        for frame, env in zip(frames, singles, strict=True):
            np.testing.assert_array_equal(frame, env.render())
            drawn.append(int(frame[0, 0, 0]))
        actions = np.full(3, 13) if "Button" in name else np.full((3, 6), 0.3)
        batch.step(actions)
        for row, env in enumerate(singles):
            if over[row]:
                env.reset()
            over[row] = not over[row] and any(env.step(actions[row])[2:4])
    assert len(set(drawn)) >= 9


@pytest.mark.parametrize("name", [f"kinreach/{name}-v0" for name in ("UR5SingleStep", "UR5MultiStep", "Reach")])
def test_without_dynamics_the_scene_moves_where_it_is_drawn_only(name):
    """Elsewhere nobody waits for it; what steps return is the same."""
    plain, drawn = (made(name, mode, backend="kinematic").unwrapped for mode in (None, "rgb_array"))
    goals = [env.reset(seed=2)[1]["goal"] for env in (plain, drawn)]
    home, ball = plain.scene.q, plain.scene.ball_position
    np.testing.assert_array_equal(drawn.scene.ball_position, goals[1])
    assert (ball != goals[0]).any()
    action = home / np.pi - 0.05 if "Multi" not in name else np.full(6, 0.5)
    steps = [env.step(action) for env in (plain, drawn)]
    np.testing.assert_array_equal(steps[0][0], steps[1][0])
    np.testing.assert_array_equal(plain.scene.q, home)
    np.testing.assert_array_equal(plain.scene.ball_position, ball)
    np.testing.assert_allclose(drawn.scene.q, steps[1][-1]["q"], atol=1e-12)
    assert np.abs(drawn.scene.q - home).max() > 0.02


@pytest.mark.parametrize("name", [f"kinreach/{name}-v0" for name in ("UR5SingleStep", "UR5MultiStep", "Reach")])
def test_under_dynamics_the_ball_lies_at_the_goal_of_the_episode(name):
    env = made(name, None).unwrapped
    for seed in range(3):
        _, info = env.reset(seed=seed)
        np.testing.assert_array_equal(env.scene.ball_position, info["goal"])


def test_a_camera_may_stand_anywhere(needs_gl):
    """From 12 places it looks at the ball, which is in the middle of the picture."""
    simulation, rng = ArmSimulation("ur5-thesis", visual=False), np.random.default_rng(5)
    ball, red = np.array([0.5, 0.1, -0.175]), 0
    simulation.place_ball(ball)
    with FrameRenderer(simulation.model, width=33, height=19, shadows=False) as renderer:
        for _ in range(12):
            place = ball + rng.uniform([0.2, -0.4, 0.2], [0.5, 0.4, 0.6])
            pixel = renderer.rgb(simulation.data, (*place, *ball))[9, 16].astype(int)
            red += pixel[0] > 100 > 2 * pixel[1]
    assert red == 12


def test_a_camera_without_a_target_looks_at_the_middle_of_the_scene(monkeypatch):
    asked = []
    stand_in(monkeypatch, FrameRenderer, Places)
    monkeypatch.setattr(FrameRenderer, "rgb", lambda self, data, camera: asked.append(camera))
    for camera in ("front", (0.9, 0.3, 0.6), [0.9, 0.3, 0.6, 0.5, 0.0, 0.1]):
        env = made("kinreach/UR5SingleStep-v0", "rgb_array", render_camera=camera).unwrapped
        env.reset(seed=0)
        env.render()
        batch = gym.make_vec(
            "kinreach/UR5SingleStep-v0", 1, "vector_entry_point", render_mode="rgb_array", render_camera=camera
        )
        batch.reset(seed=0)
        batch.render()
        assert asked[-1] == asked[-2]
    view = env.data.camera("overview")
    along, way = -view.xmat.reshape(3, 3)[:, 2], np.array(asked[2][3:]) - view.xpos
    assert asked[0] == "front"
    np.testing.assert_allclose(asked[2][:3], (0.9, 0.3, 0.6))
    np.testing.assert_allclose(np.cross(along, way), 0.0, atol=1e-12)
    assert asked[4] == (0.9, 0.3, 0.6, 0.5, 0.0, 0.1)


@pytest.mark.parametrize("name", ["kinreach/Moving-v0", "kinreach/RealArm-v0"])
def test_cameras_and_sizes_that_cannot_be_are_refused_at_once(name):
    with pytest.raises(UnknownNameError, match=r"camera.*'side'.*overview"):
        made(name, "rgb_array", render_camera="side")
    for camera in ((1.0, 2.0), (0.0, 0.0, np.nan), 7.0, "three", (1e9, 0, 0)):
        with pytest.raises(InputError, match=r"camera"):
            made(name, "rgb_array", render_camera=camera)
    with pytest.raises(InputError, match=r"at least 0\.001 m away"):
        made(name, "rgb_array", render_camera=(0.5, 0.0, 0.0, 0.5, 0.0, 0.0))
    for width in (0, 1921, 1.5):
        with pytest.raises(InputError, match=r"render_width \[px\]"):
            made(name, "rgb_array", render_width=width)
