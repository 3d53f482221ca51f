"""The window of a scene begins with the view of a camera."""

import sys
import threading
import time
from contextlib import nullcontext
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

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
