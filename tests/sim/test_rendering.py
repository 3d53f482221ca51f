import ctypes.util
import itertools
import os
import subprocess
import sys

import mujoco
import numpy as np
import pytest

from kinreach.errors import InputError, UnknownNameError
from kinreach.robots import get_arm
from kinreach.sim import ArmSimulation, render
from kinreach.sim.inside import BALL_GROUP, FrameRenderer, camera_rotation
from tests.cases import slow

WIDTH, HEIGHT = 320, 180


@pytest.fixture(scope="module")
def scene(needs_gl):
    return ArmSimulation("ur5-thesis", visual=True)


def test_cameras_look_at_their_targets_with_up_upwards():
    mounts = [mount for name in ("ur5-thesis", "arm3") for mount in get_arm(name).cameras]
    assert {mount.name for mount in mounts} == {"front", "wrist", "overview"}
    for mount in mounts:
        R = camera_rotation(mount)
        np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-12)
        assert np.linalg.det(R) > 0
        view = np.subtract(mount.target, mount.position)
        np.testing.assert_allclose(-R[:, 2], view / np.linalg.norm(view), atol=1e-12)
        assert R[:, 1] @ mount.up > 0
        assert abs(R[:, 0] @ mount.up) < 1e-12


@pytest.mark.parametrize("camera", ["front", "wrist", "overview"])
@pytest.mark.slow
def test_pictures_show_the_red_ball(scene, camera):
    scene.reset()
    scene.place_ball((0.45, 0.05, -0.175))
    frame = render(scene, camera, width=WIDTH, height=HEIGHT).astype(int)
    assert frame.shape == (HEIGHT, WIDTH, 3)
    red = (frame[..., 0] > 90) & (frame[..., 1] < 60) & (frame[..., 2] < 60)
    assert 15 < red.sum() < 0.05 * WIDTH * HEIGHT
    scene.place_ball((0.0, 0.0, -5.0))
    frame = render(scene, camera, width=WIDTH, height=HEIGHT).astype(int)
    assert not ((frame[..., 0] > 90) & (frame[..., 1] < 60) & (frame[..., 2] < 60)).any()


def test_frames_do_not_depend_on_what_was_drawn_before(scene):
    with FrameRenderer(scene.model, width=64, height=36, shadows=False) as renderer:
        scene.reset()
        first = renderer.rgb(scene.data, "wrist")
        scene.move(np.array(scene.arm.home) + 0.2)
        assert not np.array_equal(first, renderer.rgb(scene.data, "wrist"))
        scene.reset()
        np.testing.assert_array_equal(first, renderer.rgb(scene.data, "wrist"))


def test_drawing_does_not_change_the_state(scene):
    scene.reset()
    before = [scene.data.qpos.copy(), scene.data.qvel.copy(), scene.data.qacc_warmstart.copy()]
    render(scene, width=64, height=36)
    for old, new in zip(before, (scene.data.qpos, scene.data.qvel, scene.data.qacc_warmstart), strict=True):
        np.testing.assert_array_equal(old, new)


def test_unusable_requests_are_refused(scene):
    with pytest.raises(UnknownNameError, match="available: front, overview, wrist"):
        render(scene, "back", width=64, height=36)
    with pytest.raises(InputError, match="at most 1920"):
        render(scene, width=4000, height=36)
    with pytest.raises(InputError, match="at least 1"):
        render(scene, width=0, height=36)


PHYSICS_ONLY = """
import sys
from kinreach.sim import ArmSimulation
assert ArmSimulation("arm3").move([0.1, 0.1, 0.1]).reached
assert not any(name.startswith("OpenGL") for name in sys.modules), "a graphics library was loaded"
print("moved")
"""


@pytest.mark.parametrize("library", [None, *slow("disable")])
def test_physics_loads_no_graphics(library):
    assert run(PHYSICS_ONLY, library) == "moved"


MISSING = """
from kinreach.sim import ArmSimulation, render
from kinreach.errors import InstallationError
simulation = ArmSimulation("arm3")
assert simulation.move([0.1, 0.1, 0.1]).reached
try:
    render(simulation, width=8, height=8)
except InstallationError as error:
    print(error)
"""


@pytest.mark.parametrize(
    ("library", "packages"),
    [(None, ("libegl1 libgl1", "libosmesa6")), *slow(("egl", ("libegl1 libgl1",)), ("osmesa", ("libosmesa6",)))],
)
def test_a_missing_library_stops_pictures_and_not_physics(library, packages):
    message = run(MISSING, library)
    assert message.startswith("cannot draw")
    assert all(package in message for package in packages)


OSMESA = """
import numpy as np
from kinreach.sim import ArmSimulation, render

simulation = ArmSimulation("ur5-thesis")
simulation.place_ball((0.45, 0.05, -0.175))
red, green, blue = np.moveaxis(render(simulation, "front", width=320, height=180).astype(int), -1, 0)
loaded = open("/proc/self/maps").read()
print(((red > 90) & (green < 60) & (blue < 60)).sum(), "libOSMesa" in loaded, "libEGL" in loaded)
"""


@pytest.mark.slow
def test_osmesa_draws_too(needs_gl):
    if ctypes.util.find_library("OSMesa") is None:
        pytest.skip("OSMesa is not installed: apt install libosmesa6")
    red, *libraries = run(OSMESA, "osmesa").split()
    assert 15 < int(red) < 0.05 * WIDTH * HEIGHT
    assert libraries == ["True", "False"]


def run(program, library):
    environment = {key: value for key, value in os.environ.items() if key not in ("MUJOCO_GL", "PYOPENGL_PLATFORM")}
    if library is not None:
        environment["MUJOCO_GL"] = library
    environment["PYTHONPATH"] = os.pathsep.join(path for path in sys.path if path)
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize("camera", ["front", "wrist"])
@pytest.mark.slow
def test_every_goal_is_seen_whole_from_home(scene, camera):
    scene = ArmSimulation(scene.arm)  # drawn by its collision shapes, which hide more than the visual meshes do
    region = scene.arm.workcell.goals
    alone = mujoco.MjvOption()
    alone.geomgroup[:] = 0
    alone.geomgroup[BALL_GROUP] = 1
    ball = scene.model.geom("ball").id
    seen = 0
    with mujoco.Renderer(scene.model, HEIGHT, WIDTH) as renderer:
        renderer.enable_segmentation_rendering()
        for slow in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            renderer.scene.flags[slow] = False
        for x, y in [*itertools.product(region.x, region.y), (np.mean(region.x), np.mean(region.y))]:
            scene.place_ball((x, y, region.z[0]))
            mujoco.mj_forward(scene.model, scene.data)
            masks = []
            for option in (None, alone):
                renderer.update_scene(scene.data, camera, option)
                picture = renderer.render()
                masks.append((picture[..., 0] == ball) & (picture[..., 1] == mujoco.mjtObj.mjOBJ_GEOM))
            rows, columns = np.nonzero(masks[1])
            inside = rows.min() > 0 and rows.max() < HEIGHT - 1 and columns.min() > 0 and columns.max() < WIDTH - 1
            assert inside, f"the ball at ({x:.2f}, {y:.2f}) is cut off by the picture's edge"
            np.testing.assert_array_equal(*masks, err_msg=f"the ball at ({x:.2f}, {y:.2f}) is hidden")
            seen += 1
    assert seen == 5


@pytest.mark.parametrize(
    ("library", "remedy"),
    [("nonsense", "unset it, set it to egl or osmesa"), ("off", "unset it"), ("glfw", "set it to egl or osmesa")],
)
@pytest.mark.slow
def test_a_setting_with_which_nothing_is_drawn_is_named_with_its_remedy(library, remedy):
    """By a process without a screen, as the one that is asked to draw on a server."""
    code = "import kinreach.sim as s; s.render(s.ArmSimulation(), width=32, height=18)"
    environment = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    found = subprocess.run([sys.executable, "-c", code], env={**environment, "MUJOCO_GL": library},
                           capture_output=True, text=True, check=False)  # fmt: skip
    assert found.returncode == 1
    last = found.stderr.splitlines()[-1]
    assert f"MUJOCO_GL={library!r}" in last
    assert remedy in last
