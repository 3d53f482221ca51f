import numpy as np
import pytest

from kinreach.errors import InputError, InstallationError, UnknownNameError
from kinreach.sim import ArmSimulation
from kinreach.sim.inside import FrameRenderer
from kinreach.vision import Intrinsics, RGBDCamera, RGBDImage, SensorNoise

WIDTH, HEIGHT = 320, 180
CAMERAS = ("front", "wrist")


@pytest.fixture
def renderer(needs_gl, ur5):
    with FrameRenderer(ur5.model, width=WIDTH, height=HEIGHT, shadows=False) as renderer:
        yield renderer


@pytest.fixture
def camera_of(ur5, renderer):
    return lambda name: RGBDCamera(ur5, name, width=WIDTH, height=HEIGHT, renderer=renderer)


def in_camera(camera, points):
    T = np.linalg.inv(camera.T_world_camera)
    return points @ T[:3, :3].T + T[:3, 3]


def test_deprojecting_undoes_projecting():
    rng = np.random.default_rng(0)
    camera = Intrinsics(640, 480, 500.0, 510.0, 320.5, 239.0)
    p = rng.uniform((-1, -1, 0.1), (1, 1, 3), (20, 10, 3))
    uv = camera.project(p)
    assert uv.shape == (20, 10, 2)
    np.testing.assert_allclose(camera.deproject(uv[..., 0], uv[..., 1], p[..., 2]), p, atol=1e-12)
    assert camera.deproject(np.arange(5.0), 3.0, 1.0).shape == (5, 3)


@pytest.mark.parametrize("fovy", [20.0, 58.0, 100.0])
def test_pixels_are_counted_at_their_centres(fovy):
    camera = Intrinsics.from_fovy(fovy, 64, 36)
    np.testing.assert_allclose(camera.project((0, 0, 1)), (31.5, 17.5))
    top = np.tan(np.radians(fovy / 2))
    np.testing.assert_allclose(camera.project((-top * 64 / 36, -top, 1)), (-0.5, -0.5), atol=1e-9)
    np.testing.assert_allclose(camera.project((top * 64 / 36, top, 1)), (63.5, 35.5), atol=1e-9)


def test_unusable_points_and_cameras_are_refused():
    camera = Intrinsics.from_fovy(58.0, 64, 36)
    with pytest.raises(InputError, match=r"shape \(\.\.\., 3\), got \(2,\)"):
        camera.project((1.0, 2.0))
    for z in (0.0, -1.0):
        with pytest.raises(InputError, match="in front of the camera"):
            camera.project([(0, 0, 1.0), (0, 0, z)])
    with pytest.raises(InputError, match=r"must fit together, got the shapes \(2,\), \(3,\) and \(\)"):
        camera.deproject([0, 1], [0, 1, 2], 1.0)
    for name, arguments in (("fovy", (0.0, 64, 36)), ("fovy", (180.0, 64, 36)), ("width", (58.0, 0, 36))):
        with pytest.raises(InputError, match=name):
            Intrinsics.from_fovy(*arguments)


@pytest.mark.parametrize("name", CAMERAS)
def test_the_ball_is_drawn_where_it_is_projected(ur5, camera_of, goals, name):
    camera, radius = camera_of(name), ur5.arm.workcell.ball_radius
    off = []
    for goal in goals[:24]:
        ur5.place_ball(goal)
        rgb = camera.capture().rgb.astype(int)
        rows, columns = np.nonzero(rgb[..., 0] - rgb[..., 1:].max(axis=-1) > 50)
        x, y, z = in_camera(camera, goal)
        # The outline of a ball is an ellipse whose middle is farther from the axis than the projected centre.
        off.append((columns.mean(), rows.mean()) - camera.intrinsics.project((x, y, z - radius**2 / z)))
    assert len(off) == 24
    assert np.abs(off).max() < 0.3
    assert np.abs(np.mean(off, axis=0)).max() < 0.1  # half a pixel would show


@pytest.mark.parametrize("name", CAMERAS)
def test_depth_is_metric_along_the_optical_axis(ur5, camera_of, goals, name):
    camera = camera_of(name)
    ur5.place_ball((0.0, 0.0, -5.0))
    depth = camera.capture().depth
    assert depth.dtype == np.float32
    table = np.array([(x, y, -0.20) for x, y in goals[:, :2]])
    uv = camera.intrinsics.project(in_camera(camera, table))
    columns, rows = np.rint(uv).astype(int).T
    points = camera.intrinsics.deproject(columns, rows, depth[rows, columns])
    T = camera.T_world_camera
    height = points @ T[:3, :3].T[:, 2] + T[2, 3]
    assert len(height) == len(goals) >= 60
    np.testing.assert_allclose(height, -0.20, atol=2e-4)


def test_the_frame_is_optical_and_moves_with_the_link(ur5):
    camera = RGBDCamera(ur5, "wrist")
    before, q = camera.T_world_camera, ur5.q
    R = before[:3, :3]
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) > 0
    assert R[2, 2] < -0.9  # at home the wrist camera looks down
    np.testing.assert_allclose(RGBDCamera(ur5, "front").T_world_camera[:3, 1], (0, 0, -1), atol=0.5)
    in_tool = np.linalg.inv(ur5.T_world_frame("tool0")) @ before
    ur5.reset(q + 0.3)
    np.testing.assert_allclose(ur5.T_world_frame("tool0") @ in_tool, camera.T_world_camera, atol=1e-9)
    assert np.abs(camera.T_world_camera - before).max() > 0.05


def test_a_shared_renderer_and_an_own_one_draw_the_same(ur5, camera_of):
    with RGBDCamera(ur5, "front", width=WIDTH, height=HEIGHT) as own:
        image = own.capture()
        shared = camera_of("front").capture()
        camera_of("wrist").capture()
        np.testing.assert_array_equal(image.rgb, shared.rgb)
        np.testing.assert_array_equal(image.depth, shared.depth)
        own.close()
        own.close()
        np.testing.assert_array_equal(own.capture().rgb, image.rgb)
    own.close()


def test_noise_repeats_with_its_seed_and_has_the_asked_size(camera_of):
    camera, noise = camera_of("front"), SensorNoise(rgb_sigma=6.0, depth_sigma=0.002)
    clean = camera.capture()
    one, same, other = (camera.capture(noise=noise, rng=np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.rgb, same.rgb)
    np.testing.assert_array_equal(one.depth, same.depth)
    assert not np.array_equal(one.rgb, other.rgb)
    assert not np.array_equal(one.depth, other.depth)
    middle = (clean.rgb > 30) & (clean.rgb < 225)
    assert middle.sum() > 50_000
    assert (one.rgb.astype(int) - clean.rgb)[middle].std() == pytest.approx(6.0, rel=0.02)
    assert (one.depth - clean.depth).std() == pytest.approx(0.002, rel=0.02)
    assert (one.rgb.dtype, one.depth.dtype) == (np.uint8, np.float32)


def test_noise_makes_a_picture_neither_darker_nor_brighter():
    """Levels are rounded: cut off, every picture would be half a level darker."""
    grey = RGBDImage(np.full((200, 300, 3), 128, np.uint8), np.ones((200, 300), np.float32))
    for sigma in (0.4, 3.0, 9.0):
        noisy = SensorNoise(rgb_sigma=sigma).apply(grey, np.random.default_rng(0)).rgb.astype(np.float64)
        assert abs(noisy.mean() - 128) < 5 * sigma / np.sqrt(noisy.size) + 0.01
        assert noisy.std() == pytest.approx(np.hypot(sigma, 1 / np.sqrt(12)), rel=0.15)


def test_noise_stays_in_range_and_no_noise_changes_nothing():
    image = RGBDImage(np.full((20, 30, 3), 254, np.uint8), np.full((20, 30), 0.001, np.float32))
    noisy = SensorNoise(50.0, 0.1).apply(image, np.random.default_rng(0))
    assert noisy.rgb.min() > 50
    assert noisy.rgb.max() == 255
    assert noisy.depth.min() == 0.0
    quiet = SensorNoise().apply(image, np.random.default_rng(0))
    np.testing.assert_array_equal(quiet.rgb, image.rgb)
    np.testing.assert_array_equal(quiet.depth, image.depth)


def test_exposure_is_one_factor_for_a_picture():
    """Uniform in its logarithm between 1/exposure and exposure; colours are rounded and end at 255."""
    image = RGBDImage(np.tile(np.array([100, 40, 200], np.uint8), (8, 9, 1)), np.ones((8, 9), np.float32))
    noise, logs = SensorNoise(exposure=2.0), []
    for seed in range(300):
        seen = noise.apply(image, np.random.default_rng(seed))
        factor = 2.0 ** np.random.default_rng(seed).uniform(-1.0, 1.0)
        np.testing.assert_allclose(
            seen.rgb, np.tile(np.minimum(factor * np.array([100, 40, 200]), 255), (8, 9, 1)), atol=0.51
        )
        np.testing.assert_array_equal(seen.depth, image.depth)
        logs.append(np.log2(seen.rgb[0, 0, 0] / 100))
    assert -1.01 < min(logs) < -0.98
    assert 0.98 < max(logs) < 1.01


@pytest.mark.parametrize("name", ["rgb_sigma", "depth_sigma"])
@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_impossible_noise_is_refused(name, value):
    with pytest.raises(InputError, match=name):
        SensorNoise(**{name: value})


def test_unusable_requests_are_refused(ur5):
    with pytest.raises(UnknownNameError, match="available: front, overview, wrist"):
        RGBDCamera(ur5, "back")
    with pytest.raises(InputError, match="Generator"):
        RGBDCamera(ur5, "front").capture(noise=SensorNoise(rgb_sigma=1.0))
    with pytest.raises(InputError, match="at most 1920"):
        RGBDCamera(ur5, "front", width=4000, height=2000).capture()


def test_a_renderer_of_another_size_or_scene_is_refused(ur5, renderer):
    with pytest.raises(InputError, match=f"640x360, got one of {WIDTH}x{HEIGHT}"):
        RGBDCamera(ur5, "front", renderer=renderer)
    with pytest.raises(InputError, match="own scene"):
        RGBDCamera(ArmSimulation("arm3"), "overview", width=WIDTH, height=HEIGHT, renderer=renderer)


def test_no_graphics_before_the_first_picture(ur5, monkeypatch):
    def missing(*_, **__):
        raise InstallationError("no library")

    monkeypatch.setattr(FrameRenderer, "__init__", missing)
    camera = RGBDCamera(ur5, "front")
    assert camera.T_world_camera.shape == (4, 4)
    with pytest.raises(InstallationError, match="no library"):
        camera.capture()
    camera.close()


def test_a_camera_closes_its_own_renderer_and_no_other(ur5, monkeypatch):
    made = []

    class Renderer:
        def __init__(self, model, *, width, height, shadows):
            self.model, self.width, self.height, self.closed = model, width, height, 0
            made.append(self)

        def rgb(self, data, camera):
            return np.zeros((self.height, self.width, 3), np.uint8)

        def depth(self, data, camera):
            return np.ones((self.height, self.width), np.float32)

        def close(self):
            self.closed += 1

    monkeypatch.setattr("kinreach.vision._cameras.FrameRenderer", Renderer)
    with RGBDCamera(ur5, "front", width=16, height=9) as camera:
        for _ in range(2):
            assert camera.capture().rgb.shape == (9, 16, 3)
    assert [renderer.closed for renderer in made] == [1]
    camera.close()
    assert made[0].closed == 1
    camera.capture()
    camera.close()
    assert [renderer.closed for renderer in made] == [1, 1]
    shared = Renderer(ur5.model, width=16, height=9, shadows=False)
    with RGBDCamera(ur5, "front", width=16, height=9, renderer=shared) as camera:
        camera.capture()
    assert (len(made), shared.closed) == (3, 0)
