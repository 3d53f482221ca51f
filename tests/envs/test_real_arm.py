"""An arm that is not its data sheet: what is wrong is wrong by as much as is said, and looks are counted."""

import os
import re

import gymnasium as gym
import mujoco
import numpy as np
import pytest

import kinreach  # noqa: F401
from kinreach._registration import REAL_ARM
from kinreach.baselines.expert import tool_down_postures
from kinreach.envs.real_arm import (
    BASE_TURN,
    BUDGET,
    CAMERAS_OFF,
    CAMERAS_TURN,
    ECCENTRICITY,
    GEOMETRIC,
    GRAVITY,
    HYSTERESIS,
    LINK_MASSES,
    MOVES,
    NONGEOMETRIC,
    PAYLOAD,
    POSTURE,
    SEEN_BALL,
    SEEN_TIP,
    STAND_CENTRE,
    STAND_STIFFNESS,
    STIFFNESS,
    TOOL_OFF,
    UR5S,
    true_arm,
    workplace,
)
from kinreach.errors import InputError, UnknownNameError
from kinreach.kinematics import ArmKinematics, URKinematics
from kinreach.robots import PUBLISHED_CALIBRATIONS, get_arm

RIGID = (*GEOMETRIC, "all")


def make(**options):
    return gym.make(REAL_ARM, disable_env_checker=True, **options)


@pytest.mark.parametrize("errors", RIGID)
def test_what_is_off(errors):
    """Beside Pinocchio, of the data sheet and of the calibrated arm."""
    seen = 0
    for robot in UR5S:
        links = errors in ("links", "all")
        arm = get_arm("ur5-thesis").calibrated(PUBLISHED_CALIBRATIONS[robot]) if links else "ur5-thesis"
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


def postures(count, seed=0):
    """Over the table, the tool down."""
    kin = URKinematics("ur5-thesis", tip="tcp", base="world")
    balls = kin.arm.workcell.draw_goals(np.random.default_rng(seed), count)
    return kin, tool_down_postures(kin, balls), balls


def joints_of(errors, q, start=None):
    return workplace(errors, "ur5_a", np.random.default_rng(1)).joints(q, q[:1] if start is None else start)


def test_gears_give_way_as_pinocchios_gravity_says():
    """The torques of a payload at the tip are what gravity adds when Pinocchio's model carries it."""
    pin = pytest.importorskip("pinocchio")
    kin, q, _ = postures(40)
    loaded, last = kin.model.copy(), kin.model.joints[kin.n].id
    placement = kin.model.frames[kin.tip_frame].placement
    loaded.appendBodyToJoint(last, pin.Inertia(PAYLOAD, placement.translation, np.zeros((3, 3))), pin.SE3.Identity())
    models = [(model, model.createData()) for model in (loaded, kin.model)]
    more, less = (np.array([pin.computeGeneralizedGravity(*model, one) for one in q]) for model in models)
    np.testing.assert_allclose(q - joints_of("sag", q), (more - less) / STIFFNESS, atol=1e-9)
    assert 5e-4 < np.abs(more - less).max() / STIFFNESS[0] < 2e-3


def test_the_stand_bends_as_far_as_the_centre_of_mass_is_out():
    """Beside Pinocchio's centre of mass; links are taken for rods, and the gripper for the last link's mass."""
    pin = pytest.importorskip("pinocchio")
    kin, q, balls = postures(40)
    place = workplace("mount", "ur5_a", np.random.default_rng(0))
    masses = [inertia.mass for inertia in kin.model.inertias][1:]
    np.testing.assert_allclose(masses[:5], LINK_MASSES[:5], atol=1e-3)
    centres = np.array([pin.centerOfMass(kin.model, kin.data, one) for one in q])
    moment = GRAVITY * (pin.computeTotalMass(kin.model) * centres + PAYLOAD * balls)
    tilt = np.linalg.norm(moment[:, :2], axis=1) / STAND_STIFFNESS
    moved = place.tips(q) - balls
    out = np.hypot(balls[:, 2] + STAND_CENTRE, np.linalg.norm(balls[:, :2], axis=1))
    np.testing.assert_allclose(np.linalg.norm(moved, axis=1), tilt * out, rtol=0.25)
    assert (moved[:, 2] < 0).all()


def test_hysteresis_and_encoders():
    _, q, _ = postures(30)
    rng = np.random.default_rng(0)
    below, above = q - rng.uniform(0.01, 1, q.shape), q + rng.uniform(0.01, 1, q.shape)
    from_below, from_above = (
        np.array([joints_of("backlash", q[[i]], start[[i]])[0] for i in range(len(q))]) for start in (below, above)
    )
    np.testing.assert_allclose(from_above - from_below, HYSTERESIS, atol=1e-15)
    np.testing.assert_allclose(0.5 * (from_above + from_below), q, atol=1e-15)
    turn = np.linspace(-np.pi, np.pi, 721)[:, None] * np.ones(6)
    off = joints_of("encoders", turn) - turn
    np.testing.assert_allclose(off.max(axis=0), ECCENTRICITY, rtol=1e-4)
    np.testing.assert_allclose(off.mean(axis=0), 0.0, atol=2e-6)
    assert len({int(k) for k in off.argmax(axis=0)}) == 6


def test_errors_are_as_large_as_the_page_says(root):
    text = " ".join((root / "docs/environments/real_arm.md").read_text(encoding="utf-8").split())
    text = re.sub(r"(?<=\d) (?=\d{3} )", ",", text)
    said = [
        f"its tool is {1e3 * TOOL_OFF:g} mm off",
        f"its base is turned by {np.degrees(BASE_TURN):g}°",
        f"mounted {1e3 * CAMERAS_OFF:g} mm and {np.degrees(CAMERAS_TURN):g}° off",
        f"under {PAYLOAD:g} kg at the tip",
        f"{STIFFNESS[0]:,.0f} N m/rad in base, shoulder and elbow, {STIFFNESS[3]:,.0f} in the wrists",
        f"{60 * np.degrees(HYSTERESIS):g} arcmin",
        f"{1e3 * ECCENTRICITY:.1f} mrad once a turn",
        f"{STAND_STIFFNESS:,.0f} N m/rad",
        f"{2 * STAND_CENTRE:g} m high",
    ]
    assert [each for each in said if each not in text] == []
    assert STIFFNESS.shape == (6,)
    assert pytest.approx(9.81) == GRAVITY
    assert pytest.approx(0.02 / 32.5) == ECCENTRICITY


def test_errors_add_up():
    """All four bend the arm by about what they do one by one, each by less than a millimetre and a half."""
    _, q, balls = postures(60)
    alone = [workplace(e, "ur5_a", np.random.default_rng(1)).tips(q) - balls for e in NONGEOMETRIC]
    together = workplace("nongeometric", "ur5_a", np.random.default_rng(1)).tips(q) - balls
    np.testing.assert_allclose(together, sum(alone), atol=2e-5)
    sizes = [np.median(np.linalg.norm(one, axis=1)) for one in alone]
    assert 5e-5 < min(sizes) < max(sizes) < 1.5e-3
    everything = workplace("everything", "ur5_a", np.random.default_rng(1))
    rigid = workplace("all", "ur5_a", np.random.default_rng(1))
    np.testing.assert_array_equal(everything.cameras, rigid.cameras)
    assert np.linalg.norm(everything.tips(q) - rigid.tips(q) - together, axis=1).max() < 5e-5


def test_the_way_to_a_ball_counts():
    """The same postures in another order end elsewhere, by the gears' hysteresis alone."""
    _, q, _ = postures(6)
    ends = []
    for order in (np.arange(6), np.arange(6)[::-1]):
        env = make(budgets=(5,), again=0, balls=6, errors=("backlash",), noise=1e-9).unwrapped
        env.reset(seed=0)
        env.look(q[:5])
        env.step(q[order] / np.pi)
        ends.append(env.episodes.observe()[0, np.argsort(order), SEEN_TIP])
    apart = np.linalg.norm(ends[0] - ends[1], axis=1)
    assert 1e-5 < np.median(apart) < 5e-4


def test_an_episode():
    env = make(budgets=(0, 5), again=1, balls=8, errors=("all",))
    observation, info = env.reset(seed=3)
    assert info["errors"] == "all"
    assert info["calibration"] in UR5S
    kin, world = URKinematics("ur5-thesis", tip="tcp", base="world"), env.unwrapped
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


def test_a_move_pays_minus_the_mean_distance_and_is_judged_by_the_median():
    """One of three balls far off changes the mean alone; ends without errors but noise are reached."""
    kin, near, far = URKinematics("ur5-thesis", tip="tcp", base="world"), 0, 0
    env = make(budgets=(0,), again=1, balls=3, noise=1e-9).unwrapped
    for seed, errors in enumerate((*RIGID, *NONGEOMETRIC)):
        _, info = env.reset(seed=seed, options={"errors": errors, "calibration": "ur5_a"})
        assert info["distance"] == info["error_0_0"] == info["error_0_1"] == np.inf
        place, balls, start = env.episodes.place(0), env.episodes.balls[0].copy(), np.array(kin.arm.home)
        aims = [tool_down_postures(kin, balls)]
        aims.append(tool_down_postures(kin, 2 * balls - place.tips(aims[0], start)))  # the errors taken off
        aims[1][0, 0] += 0.3
        for move, q in enumerate(aims):
            observation, reward, over, _, info = env.step(q / np.pi)
            tips = place.tips(q, start)
            away, start = np.linalg.norm(tips - balls, axis=1), q[-1]
            assert reward == info["reward_terms"]["distance"] == pytest.approx(-np.mean(away), abs=1e-9)
            assert info["distance"] == info[f"error_0_{move}"] == pytest.approx(np.median(away), abs=1e-9)
            assert info["reached"] == info["is_success"] == (np.median(away) < 5e-4)
            assert not info["impossible"]
            np.testing.assert_allclose(observation[:, SEEN_TIP], place.seen(tips), atol=1e-6)
            assert over == (move == 1)
            near, far = near + info["reached"], far + (not info["reached"])
        assert info["reached"]
        assert reward < -0.02
    assert near >= 9
    assert far >= 4


def test_a_batch_looks_as_single_environments_do():
    options = {"balls": 3, "budgets": (0, 5), "again": 0, "errors": ("everything",)}
    batch = gym.make_vec(REAL_ARM, 3, "vector_entry_point", **options).unwrapped
    singles = [make(**options).unwrapped for _ in range(3)]
    batch.reset(seed=7)
    q = np.random.default_rng(0).uniform(-1, 1, (3, 4, 6))
    with pytest.raises(InputError, match="there are 0 looks left, got 4"):
        batch.look(q)
    batch.step(np.zeros((3, 3, 6)))
    for wrong in (q[:2], q[0], np.full_like(q, np.nan)):
        with pytest.raises(InputError, match=r"postures must be finite and have shape \(3, m, 6\)"):
            batch.look(wrong)
    seen, again = batch.look(q), batch.look(q[:, :1])
    ends = batch.step(q[:, :3] / np.pi)
    compared = 0
    for index, env in enumerate(singles):
        env.reset(seed=7 + index)
        env.step(np.zeros((3, 6)))
        np.testing.assert_array_equal(seen[index], env.look(q[index]))
        np.testing.assert_array_equal(again[index], env.look(q[index, :1]))
        *_, info = env.step(q[index, :3] / np.pi)
        assert info["error_5_0"] == ends[4]["final_info"]["error_5_0"][index]
        compared += 1
    assert compared == 3


def test_noise_is_as_said():
    env = make(balls=20_000, errors=("tool",))
    observation, _ = env.reset(seed=0)
    off = np.linalg.norm(observation[:, SEEN_BALL] - env.unwrapped.episodes.balls[0], axis=1)
    assert np.median(off) == pytest.approx(1.4e-4, rel=0.02)


@pytest.mark.parametrize("errors", RIGID)
def test_the_scene_is_the_true_arm(errors):
    """Its tip is where looks are taken; who watches sees every look and every ball, and the arm at it in the end."""
    env = make(balls=2, budgets=(5,), again=0).unwrapped
    with pytest.raises(InputError, match="reset the environment"):
        _ = env.scene
    env.reset(seed=4, options={"errors": errors})
    scene, ends, seen = env.scene, [], 0
    np.testing.assert_array_equal(scene.q, env.believed.home)
    np.testing.assert_array_equal(scene.data.mocap_pos[0], env.episodes.balls[0][0])
    scene.watch = lambda: ends.append(scene.q)
    for q in np.random.default_rng(0).uniform(-3, 3, (2, 1, 6)):
        env.look(q)
        mujoco.mj_kinematics(scene.model, scene.data)
        np.testing.assert_allclose(scene.data.body("tcp").xpos, env.episodes.place(0).tips(q)[0], atol=1e-9)
        np.testing.assert_allclose(ends[-1], q[0], atol=1e-12)
        seen += 1
    env.step(np.stack([0.5 * q[0], q[0]]) / np.pi)
    np.testing.assert_array_equal(scene.data.mocap_pos[0], env.episodes.balls[0][1])
    assert sum(np.allclose(end, 0.5 * q[0]) for end in ends) == 1
    np.testing.assert_allclose(ends[-1], q[0], atol=1e-12)
    assert np.abs(np.diff(ends, axis=0)).max() <= 1.05 * scene.arm.speed_limit * 0.02
    assert scene.data.time == pytest.approx(0.02 * len(ends))
    assert seen == 2
    assert env.scene is scene


@pytest.mark.parametrize(
    ("options", "error", "said"),
    [
        ({"budgets": (-1, 5)}, InputError, "a budget of looks must be at least 0, got -1"),
        ({"budgets": (5, 0)}, InputError, "must increase"),
        ({"budgets": (7,)}, UnknownNameError, "0, 10, 100, 20, 5, 50"),
        ({"budgets": ()}, InputError, "at least one"),
        ({"errors": ("gravity",)}, UnknownNameError, "gravity"),
        ({"errors": "all"}, InputError, "list"),
        ({"calibrations": (str(PUBLISHED_CALIBRATIONS["ur10e_a"]),)}, InputError, "it fits ur10e"),
        ({"calibrations": ("nowhere.yaml",)}, InputError, "cannot read"),
        ({"calibrations": (5,)}, InputError, "calibration cannot be a path, got 5"),
        ({"calibrations": (["ur5_a"],)}, InputError, "calibration cannot be a path"),
        ({"calibrations": (300 * "x",)}, InputError, "too long"),
        ({"arm": "ur5"}, InputError, "unexpected keyword"),
        ({"balls": 0}, InputError, "balls must be at least 1, got 0"),
        ({"balls": 100_001}, InputError, "balls must be at most 100000, got 100001"),
        ({"balls": 2.5}, InputError, "balls must be"),
        ({"again": -1}, InputError, "again must be at least 0, got -1"),
        ({"again": 21}, InputError, "again must be at most 20, got 21"),
        ({"noise": 0.0}, InputError, r"noise \[m\] must be finite and at least 1e-09 and at most 1, got 0"),
        ({"noise": 1.1}, InputError, r"noise \[m\] must be .* at most 1, got 1.1"),
    ],
)
def test_bad_options(options, error, said):
    with pytest.raises(error, match=said):
        make(**options)


def test_options_may_be_as_small_and_as_large_as_is_said():
    env = make(balls=1, again=20, noise=1e-9, budgets=(100,))
    (observation, _), moves, over = env.reset(seed=0), 0, False
    assert observation.shape == (1, 14)
    while not over:
        observation, _, over, _, info = env.step(np.zeros((1, 6)))
        moves += 1
    assert moves == 21
    assert np.isfinite(info["error_100_20"])
    assert make(balls=2, again=0, noise=1.0).observation_space.shape == (2, 14)


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
