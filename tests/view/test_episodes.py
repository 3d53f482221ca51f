"""Episodes as they are recorded, without a browser."""

import mujoco
import numpy as np
import pytest

from kinreach.demo.tasks import TASKS
from kinreach.errors import InputError
from kinreach.robots import get_arm
from kinreach.view.episodes import Recording, Stopped, circled
from kinreach.view.mujoco_scene import MujocoScene


@pytest.fixture(scope="module")
def episodes():
    """One episode of each environment by its name."""
    asked = {
        "single": Recording("single", "closed-form", get_arm("ur5")),
        "multi": Recording("multi", "ppo-multi", get_arm("ur5"), options={"backend": "kinematic"}),
        "space": Recording("space", "lm", get_arm("ur5"), seed=3),
        "button": Recording("button", "analytic", get_arm("arm3")),
    }
    return {name: (recording, recording.play(simple=True)) for name, recording in asked.items()}


@pytest.mark.parametrize("name", TASKS)
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
    np.testing.assert_allclose(episode.goal, episode.trial["goal"])


@pytest.mark.parametrize("name", ["single", "button"])
def test_a_motion_has_frames_at_the_clocks_pace(episodes, name):
    _, episode = episodes[name]
    times = np.array([frame.time for frame in episode.frames])
    assert len(times) > 15
    gaps = np.diff(times)
    assert gaps.min() >= 0
    assert gaps.max() < 0.06


def test_frames_end_where_the_arm_ends(episodes):
    """By forward kinematics of the posture that the trial ended in."""
    import pinocchio as pin

    from kinreach.kinematics import kinematics_of
    from kinreach.view.figure import Figure

    for name in ("single", "multi", "space"):
        _, episode = episodes[name]
        figure = Figure(kinematics_of(episode.arm, base="world"), simple=True)
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
    import gymnasium as gym

    asked = Recording("single", "closed-form", get_arm("ur5"), seed=5)
    env = gym.make(TASKS["single"].name, arm=get_arm("ur5"))
    from kinreach.baselines.rollout import rollout
    from kinreach.demo.tasks import make_policy

    (plain,) = rollout(env, make_policy("closed-form", TASKS["single"], env), [{"seed": 5}])
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


def test_what_cannot_be_played_is_refused(tmp_path):
    ur5 = get_arm("ur5")
    with pytest.raises(InputError, match="unknown policy for kinreach/UR5SingleStep-v0 'wisdom'"):
        Recording("single", "wisdom", ur5).play()
    with pytest.raises(InputError, match=r"cannot read the policy .*missing\.safetensors"):
        Recording("single", str(tmp_path / "missing.safetensors"), ur5).play()
    with pytest.raises(InputError, match="has no closed form"):
        Recording("single", "closed-form", get_arm("panda")).play()


def test_nobody_waits_for_an_episode_any_more():
    from threading import Event

    stop = Event()
    stop.set()
    with pytest.raises(Stopped):
        Recording("single", "closed-form", get_arm("ur5")).play(simple=True, stop=stop)


def test_a_copied_program_plays_the_same(episodes, capsys):
    for name, (recording, episode) in episodes.items():
        arm = repr(recording.arm.name)
        exec(compile(recording.program(arm), f"copied {name}", "exec"), {})
        reached, steps, distance, _ = capsys.readouterr().out.split()
        assert (reached, int(steps)) == ("True", len(episode.steps))
        assert float(distance) == pytest.approx(episode.trial["distance"])


def test_the_cameras_look_at_the_ball(episodes, needs_gl):
    _, episode = episodes["single"]
    seen = episode.look()
    assert seen.found.all()
    for index in range(2):
        picture = circled(seen, index)
        changed = np.argwhere((picture != seen.images[index].rgb).any(axis=-1))
        fix = seen.fixes[index].circle
        distances = np.hypot(changed[:, 1] - fix.u, changed[:, 0] - fix.v)
        assert len(changed) > 30
        assert fix.r < distances.min() + 1
        assert distances.max() < fix.r + 8
    assert episodes["button"][1].look() is None
