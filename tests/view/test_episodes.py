"""Episodes as they are recorded, without a browser."""

import gymnasium as gym
import mujoco
import numpy as np
import pytest

import kinreach  # noqa: F401
from kinreach._registration import BUTTON, MOVING, MULTI, REAL_ARM, SINGLE, SPACE
from kinreach.demo.inside import new_player
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics
from kinreach.robots import get_arm
from kinreach.view import _html as html
from kinreach.view._episodes import EpisodeRequest, Stopped, circled
from kinreach.view._figure import Figure
from kinreach.view._mujoco_scene import MujocoScene, _triangles


@pytest.fixture(scope="module")
def episodes():
    """One episode of each environment by its name."""
    asked = {
        "single": EpisodeRequest(SINGLE, "closed-form", get_arm("ur5-thesis")),
        "multi": EpisodeRequest(MULTI, "ppo-multi", get_arm("ur5-thesis"), options={"backend": "kinematic"}),
        "space": EpisodeRequest(SPACE, "lm", get_arm("ur5-thesis"), seed=3),
        "button": EpisodeRequest(BUTTON, "analytic", get_arm("ur5-thesis")),
        "moving": EpisodeRequest(MOVING, "interception", get_arm("ur5-thesis"), seed=3),
        "real arm": EpisodeRequest(REAL_ARM, "look-again", get_arm("ur5-thesis"), seed=1),
    }
    return {name: (recording, recording.play(simple=True)) for name, recording in asked.items()}


EPISODES = ("single", "multi", "space", "button", "moving", "real arm")


@pytest.mark.parametrize("name", EPISODES)
@pytest.mark.slow
def test_an_episode_is_what_the_loop_says(episodes, name):
    _, episode = episodes[name]
    assert len(episode.steps) == episode.trial["steps"] >= 1
    assert sum(step.reward for step in episode.steps) == pytest.approx(episode.trial["return"], abs=1e-9)
    assert episode.steps[-1].distance == pytest.approx(episode.trial["distance"])
    steps = [frame.step for frame in episode.frames]
    assert steps == sorted(steps)
    assert (steps[0], steps[-1]) == (0, len(episode.steps))
    assert episode.trial["reached"]
    assert episode.verdict.startswith("Reached after ")
    if name in ("single", "multi", "space", "button"):
        np.testing.assert_allclose(episode.goal, episode.trial["goal"])


@pytest.mark.parametrize("name", ["single", "button", "moving", "real arm"])
def test_a_motion_has_frames_at_the_clocks_pace(episodes, name):
    _, episode = episodes[name]
    times = np.array([frame.time for frame in episode.frames])
    assert len(times) > 10
    gaps = np.diff(times)
    assert gaps.min() >= 0
    assert gaps.max() < 0.06


def test_frames_end_where_the_arm_ends(episodes):
    """By forward kinematics of the posture that the trial ended in."""
    import pinocchio as pin

    for name in ("single", "multi", "space"):
        _, episode = episodes[name]
        figure = Figure(ArmKinematics.of(episode.arm, base="world"), simple=True)
        expected, frame, compared = figure.poses(np.array(episode.trial["q"])), episode.frames[-1], 0
        for link, pose in zip(figure.links, expected, strict=True):
            if link in episode.scene.links and not link.startswith("finger"):
                found = frame.poses[episode.scene.links.index(link)]
                np.testing.assert_allclose(found[:3], pose[:3], atol=2e-6)
                assert abs(pin.Quaternion(*found[3:]).angularDistance(pin.Quaternion(*pose[3:]))) < 1e-5
                compared += 1
        assert compared >= 7
        ball = frame.poses[episode.scene.links.index("ball"), :3]
        np.testing.assert_allclose(ball, episode.goal, atol=1e-12)


def test_taking_a_frame_leaves_the_simulation_as_it_is():
    """The same episode with and without frames, to the bit."""
    asked = EpisodeRequest(SINGLE, "closed-form", get_arm("ur5-thesis"), seed=5)
    from kinreach.baselines import rollout

    env = gym.make(SINGLE, arm=get_arm("ur5-thesis"))
    (plain,) = rollout(env, new_player("closed-form", env), [{"seed": 5}])
    watched = asked.play(simple=True).trial
    assert watched["q"] == plain["q"]
    assert watched["move_s"] == plain["move_s"]


def test_contacts_are_those_of_mujoco():
    """A box a little in the floor, and a capsule that is let down on it."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>
        <body name="lower" pos="0 0 0.09"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body>
        <body name="upper" pos="0 0 1"><freejoint/><geom type="capsule" size="0.1 0.2"/></body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    scene = MujocoScene(model)
    assert scene.links == ("lower", "upper")
    poses, contacts = scene.take(data)
    np.testing.assert_allclose(poses[:, :3], [(0, 0, 0.09), (0, 0, 1)])
    assert {contact.bodies for contact in contacts} == {("world", "lower")}
    assert len(contacts) == 4
    assert all(abs(contact.position[2]) < 0.011 for contact in contacts)
    data.qpos[9] = 0.35
    assert {"lower", "upper"} in [set(contact.bodies) for contact in scene.take(data)[1]]
    assert data.ncon == 0  # of the state that was looked at
    for piece, radius in zip(scene.fine, (np.sqrt(3) * 0.1, 0.3), strict=True):
        assert np.linalg.norm(piece.vertices, axis=1).max() == pytest.approx(radius, rel=1e-3)


def test_the_ball_rolls_and_the_arm_follows(episodes):
    _, episode = episodes["moving"]
    balls = np.array([frame.poses[episode.scene.links.index("ball"), :3] for frame in episode.frames])
    times = np.array([frame.time for frame in episode.frames])
    np.testing.assert_allclose(np.diff(times), 1 / 30, atol=1e-12)
    speeds = np.linalg.norm(np.diff(balls, axis=0), axis=1) * 30
    np.testing.assert_allclose(speeds, episode.trial["speed"], rtol=0.02)
    assert episode.facts == {"speed": episode.trial["speed"], "path": episode.trial["path"]}
    finger = [frame.poses[episode.scene.links.index("finger_left"), :3] for frame in episode.frames]
    assert np.linalg.norm(finger[-1] - finger[0]) > 0.1


def test_the_true_arm_goes_to_every_ball(episodes):
    """By the distances that the environment says; the believed arm is in the same posture, and elsewhere."""
    from kinreach.kinematics import URKinematics

    recording, episode = episodes["real arm"]
    assert len(episode.steps) == 3 * 3
    believed = URKinematics("ur5-thesis", tip="tcp", base="world")
    palm = episode.scene.links.index("gripper_palm")
    gaps, apart = [], []
    for step, said in enumerate(episode.steps[:1]):
        frames = [frame for frame in episode.frames if frame.step == step]
        balls = np.array([frame.poses[episode.scene.links.index("ball"), :3] for frame in frames])
        for place in np.unique(balls, axis=0):
            *_, there = (frame for frame, ball in zip(frames, balls, strict=True) if (ball == place).all())
            x, y, z, *_ = there.poses[palm]
            gaps.append(abs(np.linalg.norm(np.array([x, y, z]) - place) - 0.2))
            apart.append(np.linalg.norm(believed.fk(there.believed)[:3, 3] - place))
        assert len(gaps) == 4
        assert said.distance > 1e-3
        assert np.median(gaps) < 0.02
        assert 1e-4 < np.median(apart) < 0.02
    assert set(episode.facts) == {"errors", "calibration"}
    assert f"calibration {episode.facts['calibration']}" in html.moment(episode, episode.frames[-1])
    assert recording.made_with == {"balls": 4, "budgets": (0, 5, 20)}


class Pointing(gym.Env):
    """From outside of the package: an arm without a scene, which turns."""

    observation_space = gym.spaces.Box(-1.0, 1.0, (1,))
    action_space = gym.spaces.Box(-1.0, 1.0, (1,))

    def __init__(self, arm="arm3"):
        self.arm = get_arm(arm) if isinstance(arm, str) else arm

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.q = np.array(self.arm.home)
        return np.zeros(1, np.float32), {"q": self.q}

    def step(self, action):
        self.q = self.q + 0.1 * float(action[0])
        return np.full(1, 0.1, np.float32), 1.5, False, False, {"q": self.q}


class Blind(Pointing):
    """Without an arm, or without a posture."""

    def __init__(self, has_arm=False):
        super().__init__()
        if not has_arm:
            del self.arm

    def reset(self, *, seed=None, options=None):
        return np.zeros(1, np.float32), {}


@pytest.mark.slow
def test_an_environment_from_outside_is_played(monkeypatch):
    gym.register("outside/Pointing-v0", entry_point=Pointing)
    gym.register("outside/Blind-v0", entry_point=Blind)
    gym.register("outside/Armed-v0", entry_point=Blind, kwargs={"has_arm": True})
    monkeypatch.setattr("kinreach.view._episodes.MAX_STEPS", 30)
    try:
        episode = EpisodeRequest("outside/Pointing-v0", f"{__name__}:turn", get_arm("panda")).play(simple=True)
        assert (len(episode.steps), episode.trial["return"]) == (30, 45.0)
        assert episode.verdict == "Not reached after 30 steps."
        assert episode.goal is None
        assert html.moment(episode, episode.frames[-1]).count("reward 1.5") == 1
        angle = ArmKinematics.of("panda", base="world")
        figure = Figure(angle, simple=True)
        hand = episode.scene.links.index("panda_hand")
        expected = figure.poses(np.array(get_arm("panda").home) + 3.0)[figure.links.index("panda_hand"), :3]
        np.testing.assert_allclose(episode.frames[-1].poses[hand, :3], expected, atol=1e-6)
        episode = EpisodeRequest("outside/Pointing-v0", f"{__name__}:turn_once", get_arm("panda")).play(simple=True)
        assert [step.reward for step in episode.steps] == [1.5, 0.0]  # nothing is gained by giving up
        for name, said in (("Blind", "it has no `arm`"), ("Armed", "no posture `q` in its info")):
            with pytest.raises(InputError, match=f"outside/{name}-v0 cannot be drawn: .*{said}"):
                EpisodeRequest(f"outside/{name}-v0", "random", get_arm("panda")).play()
    finally:
        for name in ("Pointing", "Blind", "Armed"):
            del gym.registry[f"outside/{name}-v0"]


def turn(observation):
    """Always the same way."""
    return np.ones(1, np.float32)


def turn_once(observation):
    """And give up."""
    return None if observation[0] else np.ones(1, np.float32)


def test_what_cannot_be_played_is_refused(tmp_path):
    ur5 = get_arm("ur5-thesis")
    with pytest.raises(InputError, match="unknown policy for kinreach/UR5SingleStep-v0 'wisdom'"):
        EpisodeRequest(SINGLE, "wisdom", ur5).play()
    with pytest.raises(InputError, match=r"cannot read the policy .*missing\.safetensors"):
        EpisodeRequest(SINGLE, str(tmp_path / "missing.safetensors"), ur5).play()


def test_nobody_waits_for_an_episode_any_more():
    from threading import Event

    stop = Event()
    stop.set()
    with pytest.raises(Stopped):
        EpisodeRequest(SINGLE, "closed-form", get_arm("ur5-thesis")).play(simple=True, stop=stop)


@pytest.mark.slow
def test_a_copied_program_plays_the_same(episodes, capsys):
    for name, (recording, episode) in episodes.items():
        arm = repr(recording.arm.name)
        exec(compile(recording.program(arm), f"copied {name}", "exec"), {})
        reached, steps, distance, _ = capsys.readouterr().out.split()
        assert (reached, int(steps)) == ("True", len(episode.steps)), name
        assert float(distance) == pytest.approx(episode.trial["distance"])


def test_the_cameras_look_at_the_ball(episodes, needs_gl):
    _, episode = episodes["single"]
    seen = episode.measure_goal()
    assert seen.found.all()
    for index in range(2):
        picture = circled(seen, index)
        changed = np.argwhere((picture != seen.images[index].rgb).any(axis=-1))
        fix = seen.fixes[index].circle
        distances = np.hypot(changed[:, 1] - fix.u, changed[:, 0] - fix.v)
        assert len(changed) > 30
        assert fix.r < distances.min() + 1
        assert distances.max() < fix.r + 8
    assert episodes["button"][1].measure_goal() is None


def test_every_kind_of_shape_has_its_size():
    kinds = {
        "box": "0.1 0.2 0.3",
        "sphere": "0.2",
        "capsule": "0.1 0.3",
        "cylinder": "0.2 0.1",
        "ellipsoid": "0.1 0.2 0.3",
    }
    geoms = "".join(f'<geom type="{kind}" size="{size}"/>' for kind, size in kinds.items())
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{geoms}</worldbody></mujoco>")
    expected = {"box": (0.1, 0.2, 0.3), "sphere": (0.2,) * 3, "capsule": (0.1, 0.1, 0.4), "cylinder": (0.2, 0.2, 0.1),
                "ellipsoid": (0.1, 0.2, 0.3)}  # fmt: skip
    for index, kind in enumerate(kinds):
        vertices, faces = _triangles(model, index)
        np.testing.assert_allclose(np.abs(vertices).max(axis=0), expected[kind], rtol=0.03)
        assert faces.max() < len(vertices)
