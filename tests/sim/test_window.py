"""The window of a scene begins with the view of a camera."""

import re
import sys
import threading
import time
from contextlib import nullcontext
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from kinreach.errors import InstallationError
from kinreach.sim import _picture as viewers


class Window:
    """What MuJoCo's viewer hands out; its thread draws for a moment after it was closed."""

    def __init__(self, model, data, **bars):
        self.cam, self.bars, self.syncs, self._closed = mujoco.MjvCamera(), bars, 0, threading.Event()
        self.thread = threading.Thread(target=lambda: self._closed.wait() and time.sleep(0.1))
        self.thread.start()

    def lock(self):
        return nullcontext()

    def sync(self):
        self.syncs += 1

    def close(self):
        self._closed.set()


@pytest.mark.parametrize("camera", ["overview", "front", "wrist"])
def test_a_window_begins_with_the_view_of_the_camera(ur5, camera, monkeypatch):
    windows = []
    monkeypatch.setattr(viewers, "_check_screen", lambda: None)
    launch = lambda *given, **bars: windows.append(Window(*given, **bars)) or windows[-1]  # noqa: E731
    monkeypatch.setitem(sys.modules, "mujoco.viewer", SimpleNamespace(launch_passive=launch))
    mujoco.mj_forward(ur5.model, ur5.data)
    viewer = viewers.SceneViewer(ur5.model, ur5.data, camera=camera)
    (window,) = windows
    assert window.bars == {"show_left_ui": False, "show_right_ui": False}
    place, ahead, up, right = (np.empty(3) for _ in range(4))
    mujoco.mjv_cameraFrame(place, ahead, up, right, ur5.data, window.cam)
    fixed = ur5.data.camera(camera)
    np.testing.assert_allclose(place, fixed.xpos, atol=1e-6)
    np.testing.assert_allclose(ahead, -fixed.xmat.reshape(3, 3)[:, 2], atol=1e-6)
    middle = ur5.model.stat.center - window.cam.lookat
    assert abs(middle @ ahead) < 1e-6  # zooming and turning are about what is in the middle of the scene
    viewer.sync()
    assert window.syncs == 2
    viewer.close()
    assert not window.thread.is_alive()
    viewer.close()


@pytest.mark.parametrize("place", [(1.0, 2.0, 0.5, 0.1, -0.2, 0.3), (-0.4, 0.3, 1.5, 0.3, 0.3, 0.0)])
def test_a_window_begins_at_a_place_that_looks_at_another(ur5, place, monkeypatch):
    windows = []
    monkeypatch.setattr(viewers, "_check_screen", lambda: None)
    launch = lambda *given, **bars: windows.append(Window(*given, **bars)) or windows[-1]  # noqa: E731
    monkeypatch.setitem(sys.modules, "mujoco.viewer", SimpleNamespace(launch_passive=launch))
    viewers.SceneViewer(ur5.model, ur5.data, camera=place).close()
    (window,) = windows
    eye, ahead, up, right = (np.empty(3) for _ in range(4))
    mujoco.mjv_cameraFrame(eye, ahead, up, right, ur5.data, window.cam)
    np.testing.assert_allclose(eye, place[:3], atol=1e-6)
    way = np.subtract(place[3:], place[:3])
    np.testing.assert_allclose(ahead, way / np.linalg.norm(way), atol=1e-6)
    np.testing.assert_allclose(window.cam.lookat, place[3:], atol=1e-12)


class Glfw:
    """GLFW on a machine without a screen, or with one; it says its errors to whoever wants to hear them."""

    def __init__(self, *errors):
        self.errors, self.hook, self.begun = errors, "theirs", 0

    def set_error_callback(self, hook):
        before, self.hook = self.hook, hook
        return before

    def init(self):
        self.begun += 1
        for number, what in enumerate(self.errors):
            self.hook(65550 + number, what)
        return not self.errors


def reason(monkeypatch, library):
    """Why no window opens on Linux; a library that is None is not installed."""
    monkeypatch.setattr(viewers.platform, "system", lambda: "Linux")
    monkeypatch.setitem(sys.modules, "glfw", library)
    with pytest.raises(InstallationError) as error:
        viewers._check_screen()
    said, _, remedy = str(error.value).partition(". Without a screen use ")
    assert remedy == 'render_mode="rgb_array", or a virtual screen: apt install xvfb, then xvfb-run python ...'
    return said


def test_without_a_screen_all_reasons_are_said(monkeypatch):
    for errors, said in (
        ((b"no X11",), "cannot open a window: (65550) no X11"),
        ((b"no X11", b"no \xff"), "cannot open a window: (65550) no X11; (65551) no \ufffd"),
    ):
        library = Glfw(*errors)
        assert reason(monkeypatch, library) == said
        assert (library.hook, library.begun) == ("theirs", 1)
    assert re.match("cannot open a window: .*glfw", reason(monkeypatch, None))


def test_with_a_screen_nothing_is_refused(monkeypatch):
    """Other systems than Linux are not asked."""
    for system, library, begun in (("Linux", Glfw(), 1), ("Darwin", Glfw(b"no screen"), 0)):
        monkeypatch.setattr(viewers.platform, "system", lambda system=system: system)
        monkeypatch.setitem(sys.modules, "glfw", library)
        viewers._check_screen()
        assert (library.hook, library.begun) == ("theirs", begun)


def test_what_was_drawn_is_told_after_each_colour_frame(ur5, monkeypatch):
    """Not after a depth image."""
    told, drawn = [], []

    class Frames:
        def __init__(self, model, **_):
            pass

        def rgb(self, data, view):
            drawn.append("rgb")
            return len(drawn)

        def depth(self, data, view):
            drawn.append("depth")

    monkeypatch.setattr(viewers, "FrameRenderer", Frames)
    for mode in ("rgb_array", "depth_array", "rgb_array"):
        picture = viewers.ScenePicture(ur5, mode=mode)
        picture.frame()
        picture.drawn = lambda scene: told.append((scene, len(drawn)))
        picture.frame()
    assert told == [(ur5, 2), (ur5, 6)]
