import csv

import mujoco
import numpy as np
import pytest

from benchmarks.studies import ball_detection, light_and_clutter
from kinreach.errors import InputError, UnknownNameError
from kinreach.robots import get_arm
from kinreach.sim import ArmSimulation
from kinreach.vision import (
    CameraGoalView,
    Intrinsics,
    RGBDCamera,
    SensorNoise,
    find_ball,
    geometric_goal_view,
    goal_in_world,
)

NOWHERE = (0.0, 0.0, -5.0)
NOISE = SensorNoise(rgb_sigma=6.0, depth_sigma=0.002)


@pytest.fixture(scope="module")
def view(needs_gl):
    with CameraGoalView("ur5-thesis") as view:
        yield view


@pytest.fixture(scope="module")
def looks(view, goals):
    """What both cameras see of every goal, at the default resolution and without noise."""
    simulation = ArmSimulation("ur5-thesis")
    looks = []
    for goal in goals:
        simulation.place_ball(goal)
        looks.append(view.measure(simulation))
    return looks


def errors_mm(values, goals):
    """Distance of what each camera says from the truth, shape (n, 2)."""
    return np.linalg.norm((values - geometric_goal_view("ur5-thesis", goals)).reshape(-1, 2, 3), axis=-1) * 1e3


def test_perfect_cameras_are_those_of_mujoco(ur5, goals):
    mujoco.mj_forward(ur5.model, ur5.data)
    expected = []
    for name in ("front", "wrist"):
        R = ur5.data.camera(name).xmat.reshape(3, 3) * (1, -1, -1)  # x right, y up, z back -> optical
        expected.append((goals - ur5.data.camera(name).xpos) @ R)
    values = geometric_goal_view("ur5-thesis", goals)
    assert values.shape == (len(goals), 6)
    np.testing.assert_allclose(values, np.hstack(expected), atol=1e-9)
    assert (values[:, [2, 5]] > 0.25).all()


def test_perfect_cameras_take_any_shape(goals):
    values = geometric_goal_view(get_arm("ur5-thesis"), goals)
    assert geometric_goal_view("ur5-thesis", goals[0]).shape == (6,)
    np.testing.assert_allclose(
        geometric_goal_view("ur5-thesis", goals[:60].reshape(3, 20, 3))[2, 19], values[59], atol=1e-12
    )
    assert geometric_goal_view("ur5-thesis", np.empty((0, 3))).shape == (0, 6)


@pytest.mark.parametrize("found", [(True, True), (True, False), (False, True)])
def test_the_goal_comes_back_from_what_was_found(goals, found):
    for goal, values in zip(goals, geometric_goal_view("ur5-thesis", goals), strict=True):
        kept = np.where(np.repeat(found, 3), values, 0.0)
        np.testing.assert_allclose(goal_in_world("ur5-thesis", kept, found), goal, atol=1e-12)
    assert len(goals) >= 60


def test_two_cameras_that_disagree_are_averaged():
    one, other = np.array((0.4, 0.1, -0.175)), np.array((0.41, 0.12, -0.17))
    values = np.concatenate([geometric_goal_view("ur5-thesis", one)[:3], geometric_goal_view("ur5-thesis", other)[3:]])
    np.testing.assert_allclose(goal_in_world("ur5-thesis", values, (True, True)), (one + other) / 2, atol=1e-12)


def test_what_no_camera_found_is_nowhere():
    assert goal_in_world("ur5-thesis", np.zeros(6), (False, False)) is None


def test_unusable_requests_are_refused(ur5):
    with pytest.raises(InputError, match=r"shape \(\.\.\., 3\), got \(2, 2\)"):
        geometric_goal_view("ur5-thesis", np.zeros((2, 2)))
    with pytest.raises(InputError, match="finite"):
        geometric_goal_view("ur5-thesis", (0.4, np.nan, 0.0))
    with pytest.raises(InputError, match="values"):
        goal_in_world("ur5-thesis", np.zeros(5), (True, True))
    with pytest.raises(InputError, match="2 truth values"):
        goal_in_world("ur5-thesis", np.zeros(6), (1.0, 0.0))
    with pytest.raises(InputError, match="no camera of arm 'arm3' measures the goal"):
        geometric_goal_view("arm3", np.zeros(3))
    with pytest.raises(UnknownNameError, match="available: hybrid, thesis"):
        CameraGoalView("ur5-thesis", pipeline="best")
    with pytest.raises(UnknownNameError, match="available: hybrid, thesis"):
        CameraGoalView("ur5-thesis", pipeline=None)
    for options, said in (
        ({"noise": "x"}, "noise must be a SensorNoise or None, got 'x'"),
        ({"width": -3}, "width must be at least 1"),
        ({"height": 1.5}, "height must be an integer"),
    ):
        with pytest.raises(InputError, match=said):
            CameraGoalView("ur5-thesis", **options)
    with pytest.raises(InputError, match="noise must be a SensorNoise or None, got 'x'"):
        RGBDCamera(ArmSimulation("ur5-thesis"), "front").capture(noise="x", rng=np.random.default_rng(0))
    with pytest.raises(InputError, match="view is of ur5-thesis, got a simulation of arm3"):
        CameraGoalView("ur5-thesis").measure(ArmSimulation("arm3"))


@pytest.mark.slow
def test_every_goal_is_found_within_a_millimetre_and_a_half(looks, goals):
    assert all(look.found.all() for look in looks)
    assert errors_mm(np.array([look.values for look in looks]), goals).max() < 1.5
    fused = np.array([goal_in_world("ur5-thesis", look.values, look.found) for look in looks])
    assert np.linalg.norm(fused - goals, axis=1).max() < 0.0015
    assert len(looks) == len(goals) >= 60


@pytest.mark.slow
def test_every_goal_is_found_within_three_millimetres_under_noise(looks, goals):
    radius, rng, found = get_arm("ur5-thesis").workcell.ball_radius, np.random.default_rng(0), []
    cameras = get_arm("ur5-thesis").goal_cameras
    for look in looks[::2]:
        for mount, image in zip(cameras, look.images, strict=True):
            noisy = NOISE.apply(image, rng)
            fix = find_ball(noisy.rgb, noisy.depth, Intrinsics.from_fovy(mount.fovy, 640, 360), radius)
            assert fix is not None
            found.append(fix.position)
    assert errors_mm(np.reshape(found, (-1, 6)), goals[::2]).max() < 3.0
    assert len(found) >= 60


def test_the_thesis_pipeline_finds_every_goal_within_bounds(looks, goals):
    camera, radius = Intrinsics.from_fovy(58.0, 640, 360), get_arm("ur5-thesis").workcell.ball_radius
    fixes = [find_ball(i.rgb, i.depth, camera, radius, pipeline="thesis") for look in looks for i in look.images]
    assert None not in fixes
    errors = errors_mm(np.reshape([fix.position for fix in fixes], (-1, 6)), goals)
    assert errors.mean() < 3.0
    assert errors.max() < 15.0


def test_seeded_looks_repeat(ur5, needs_gl):
    with CameraGoalView("ur5-thesis", width=320, height=180, noise=NOISE) as view:
        one, same, other = (view.measure(ur5, np.random.default_rng(seed)) for seed in (1, 1, 2))
        with pytest.raises(InputError, match="Generator"):
            view.measure(ur5)
    np.testing.assert_array_equal(one.values, same.values)
    assert one.found.all()
    assert other.found.all()
    assert not np.array_equal(one.values, other.values)


def test_what_is_not_found_is_zero(ur5, view):
    ur5.place_ball(NOWHERE)
    look = view.measure(ur5)
    np.testing.assert_array_equal(look.values, np.zeros(6))
    np.testing.assert_array_equal(look.found, (False, False))
    assert look.fixes == (None, None)
    assert [image.rgb.shape for image in look.images] == [(360, 640, 3)] * 2
    only_front = (0.80, 0.0, -0.175)
    ur5.place_ball(only_front)
    look = view.measure(ur5)
    np.testing.assert_array_equal(look.found, (True, False))
    np.testing.assert_array_equal(look.values[3:], np.zeros(3))
    np.testing.assert_allclose(goal_in_world("ur5-thesis", look.values, look.found), only_front, atol=0.002)


@pytest.mark.slow
def test_one_view_serves_many_scenes_and_closes_twice(goals, needs_gl):
    view = CameraGoalView("ur5-thesis", width=640, height=360)
    plain, drawn = ArmSimulation("ur5-thesis"), ArmSimulation("ur5-thesis", visual=True)
    for simulation in (plain, drawn, plain):
        simulation.place_ball(goals[5])
        look = view.measure(simulation)
        assert look.found.all()
        assert errors_mm(look.values, goals[5]).max() < 1.5
    view.close()
    view.close()
    assert view.measure(plain).found.all()
    view.close()


@pytest.mark.slow
def test_the_published_tables_have_the_rows_that_the_studies_print(root, needs_gl, capsys):
    appendix = root / "docs" / "studies/appendix"
    published = (appendix / "seeing.md").read_text()
    with (appendix / "data" / "light-and-clutter.csv").open(encoding="utf-8") as file:
        situations = [row[0] for row in csv.reader(file)]
    assert ball_detection.main(["--positions", "1"]) == 0
    assert light_and_clutter.main(["--positions", "1"]) == 0

    def words(text):
        return [line.split("|")[1] for line in text.splitlines() if line.startswith("|")]

    fresh = words(capsys.readouterr().out)
    assert fresh[:16] == words(published)[:16]
    assert [word.strip() for word in fresh[16:] if "---" not in word] == situations
    assert len(fresh) == 11 + 5 + 2 + len(light_and_clutter.SITUATIONS)
