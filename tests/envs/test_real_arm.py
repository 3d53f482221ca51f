"""An arm that is not its data sheet: what is wrong is wrong by as much as is said, and looks are counted."""

import os

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import kinreach  # noqa: F401
from kinreach._registration import REAL_ARM
from kinreach.baselines._expert import tool_down_postures
from kinreach.envs._real_arm import BUDGET, ERRORS, MOVES, POSTURE, SEEN_BALL, SEEN_TIP, UR5S, true_arm, workplace
from kinreach.errors import InputError, UnknownNameError
from kinreach.kinematics import ArmKinematics, UR5Kinematics
from kinreach.robots import PUBLISHED_CALIBRATIONS, get_arm


def make(**options):
    return gym.make(REAL_ARM, disable_env_checker=True, **options)


@pytest.mark.parametrize("errors", ERRORS)
def test_what_is_off(errors):
    """Beside Pinocchio, of the data sheet and of the calibrated arm."""
    seen = 0
    for robot in UR5S:
        links = errors in ("links", "all")
        arm = get_arm("ur5").calibrated(PUBLISHED_CALIBRATIONS[robot]) if links else "ur5"
        kin = ArmKinematics(arm, tip="tcp", base="world")
        for seed in range(5):
            place = workplace(errors, robot, np.random.default_rng(seed))
            q = np.random.default_rng(seed).uniform(-3, 3, (40, 6))
            tips, poses = place.tips(q), np.array([kin.fk(one) for one in q])
            away = np.linalg.norm(tips - poses[:, :3, 3], axis=1)
            if errors == "tool":
                np.testing.assert_allclose(away, 5e-3, atol=1e-10)
            elif errors == "base":
                radius = np.linalg.norm(poses[:, :2, 3], axis=1)
                np.testing.assert_allclose(away, 2 * radius * np.sin(np.radians(0.25)), atol=1e-10)
            elif errors != "all":
                assert away.max() < 1e-10
            moved = np.linalg.norm(place.seen(tips) - tips, axis=1)
            if errors in ("cameras", "all"):
                assert 1e-3 < np.median(moved) < 2e-2
                apart = np.linalg.norm(tips[:, None] - tips, axis=2)
                np.testing.assert_allclose(
                    np.linalg.norm(place.seen(tips)[:, None] - place.seen(tips), axis=2), apart, atol=1e-12
                )
            else:
                assert moved.max() == 0.0
            seen += 1
    assert seen == 20


def test_an_episode():
    env = make(budgets=(0, 5), again=1, balls=8, errors=("all",))
    observation, info = env.reset(seed=3)
    assert info["errors"] == "all"
    assert info["calibration"] in UR5S
    kin, world = UR5Kinematics(tip="tcp", base="world"), env.unwrapped
    moves = []
    for budget, again in ((0, 0), (0, 1), (5, 0), (5, 1)):
        assert (observation[:, BUDGET] == budget).all()
        assert (observation[:, MOVES] == again).all()
        if again == 0:
            assert world.looks_left == budget
            assert not observation[:, SEEN_TIP].any()
            with pytest.raises(InputError, match="looks left"):
                world.look(np.zeros((budget + 1, 6)))
        q = tool_down_postures(kin, observation[:, SEEN_BALL])
        observation, reward, over, truncated, info = env.step(q / np.pi)
        moves.append(info[f"error_{budget}_{again}"])
        assert info["distance"] == moves[-1] > 1e-3
        assert reward < 0
        assert not truncated
        np.testing.assert_array_equal(info["q"], np.pi * np.clip(q[0] / np.pi, -1, 1))
        assert np.linalg.norm(kin.fk(info["q"])[:3, 3] - info["goal"]) < 0.05
    assert over
    np.testing.assert_allclose(observation[:, POSTURE], q)
    assert len(set(moves)) == 1  # the same postures
    with pytest.raises(InputError, match="over"):
        env.step(q / np.pi)
    assert world.look(q[:2]).shape == (2, 3)
    assert world.looks_left == 3
    again, _ = env.reset(seed=3)
    first, _ = make(budgets=(0, 5), again=1, balls=8, errors=("all",)).reset(seed=3)
    np.testing.assert_array_equal(again, first)


def test_noise_is_as_said():
    env = make(balls=20_000, errors=("tool",))
    observation, _ = env.reset(seed=0)
    off = np.linalg.norm(observation[:, SEEN_BALL] - env.unwrapped._balls, axis=1)
    assert np.median(off) == pytest.approx(1.4e-4, rel=0.02)


def test_gymnasium_agrees():
    check_env(gym.make(REAL_ARM, balls=3).unwrapped, skip_render_check=True)


def test_the_scene_is_the_true_arm():
    """Its tip is where looks are taken; who watches sees every look and every ball, and the arm at it in the end."""
    env, seen = make(balls=2, budgets=(5,), again=0).unwrapped, 0
    for errors in ERRORS:
        env.reset(seed=4, options={"errors": errors})
        scene, ends = env.scene, []
        scene.watch = lambda scene=scene, ends=ends: ends.append(scene.q)
        for q in np.random.default_rng(0).uniform(-3, 3, (4, 1, 6)):
            env.look(q)
            mujoco.mj_kinematics(scene.model, scene.data)
            np.testing.assert_allclose(scene.data.body("tcp").xpos, env._place.tips(q)[0], atol=1e-9)
            np.testing.assert_allclose(ends[-1], q[0], atol=1e-12)
            seen += 1
        env.step(np.stack([0.5 * q[0], q[0]]) / np.pi)
        np.testing.assert_array_equal(scene.data.mocap_pos[0], env._balls[1])
        assert sum(np.allclose(end, 0.5 * q[0]) for end in ends) == 1
        np.testing.assert_allclose(ends[-1], q[0], atol=1e-12)
        assert np.abs(np.diff(ends, axis=0)).max() <= 1.05 * scene.arm.speed_limit * 0.02
        assert scene.data.time == pytest.approx(0.02 * len(ends))
    assert seen == 20


@pytest.mark.parametrize(
    ("options", "error", "said"),
    [
        ({"budgets": (-1, 5)}, InputError, "a budget of looks must be at least 0, got -1"),
        ({"budgets": (5, 0)}, InputError, "must increase"),
        ({"budgets": (7,)}, UnknownNameError, "0, 10, 100, 20, 5, 50"),
        ({"budgets": ()}, InputError, "at least one"),
        ({"again": -1}, InputError, "again must be at least 0"),
        ({"balls": 0}, InputError, "balls must be at least 1"),
        ({"noise": 0.0}, InputError, "noise"),
        ({"errors": ("gravity",)}, UnknownNameError, "gravity"),
        ({"errors": "all"}, InputError, "list"),
        ({"calibrations": (str(PUBLISHED_CALIBRATIONS["ur10e_a"]),)}, InputError, "it fits ur10e"),
        ({"calibrations": ("nowhere.yaml",)}, InputError, "cannot read"),
        ({"calibrations": (5,)}, InputError, "calibration cannot be a path, got 5"),
        ({"calibrations": (["ur5_a"],)}, InputError, "calibration cannot be a path"),
        ({"calibrations": (300 * "x",)}, InputError, "too long"),
        ({"arm": "ur5"}, InputError, "unexpected keyword"),
    ],
)
def test_bad_options(options, error, said):
    with pytest.raises(error, match=said):
        make(**options)


def test_bad_input():
    env = make(balls=2)
    with pytest.raises(InputError, match="reset"):
        env.unwrapped.step(np.zeros((2, 6)))
    for options, said in (({"goal": 1}, "goal"), (5, "must be a mapping")):
        with pytest.raises(InputError, match=said):
            env.unwrapped.reset(options=options)
    env.reset(seed=0)
    for action in (np.zeros(6), np.full((2, 6), np.nan)):
        with pytest.raises(InputError, match="action"):
            env.unwrapped.step(action)
    with pytest.raises(InputError, match="postures"):
        env.unwrapped.look([0, 0, 0])
    assert len(true_arm("ur5_a").joints) == 6


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"errors": "tool", "calibration": "nonsense"}, "cannot read the calibration nonsense"),
        ({"errors": "all", "calibration": 300 * "x"}, "too long"),
        ({"errors": "gravity"}, "gravity"),
        ({"goal": 1}, "unknown reset options"),
    ],
)
def test_a_refused_reset_changes_nothing(options, said):
    env, same = make(balls=4).unwrapped, make(balls=4).unwrapped
    for world in (env, same):
        world.reset(seed=1)
    with pytest.raises((InputError, UnknownNameError), match=said):
        env.reset(seed=2, options=options)
    for _ in range(2):
        np.testing.assert_array_equal(env.reset()[0], same.reset()[0])


def test_a_calibration_that_was_edited_is_read_again(tmp_path):
    file = tmp_path / "arm.yaml"
    homes = []
    for name in ("ur5_a", "ur5_b"):
        file.write_bytes(PUBLISHED_CALIBRATIONS[name].read_bytes())
        os.utime(file, ns=(len(homes), len(homes)))
        homes.append(ArmKinematics.of(true_arm(str(file))).fk(np.zeros(6)))
    assert np.abs(homes[0] - homes[1]).max() > 1e-4
