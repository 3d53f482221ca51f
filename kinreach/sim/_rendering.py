"""Pictures of a scene, with or without a screen.

Which library draws is decided when the first frame is asked for, never at import: on Linux EGL, then OSMesa (or just
the one that `MUJOCO_GL` names); elsewhere MuJoCo's own choice. An OpenGL library does not survive a fork: a child that
is forked after the first frame gets an error when it draws, instead of waiting for ever. Start worker processes with
`spawn` or `forkserver`.
"""

from __future__ import annotations

import importlib
import math
import os
import platform
import sys
from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats, check_count, check_known
from kinreach.errors import DrawingError, InstallationError
from kinreach.sim._engine import mujoco

if TYPE_CHECKING:
    from kinreach.sim._simulation import ArmSimulation

_PACKAGES = {"egl": "libegl1 libgl1", "osmesa": "libosmesa6"}
_PROBE_SIZE = 8
#: What else there is to set: neither of these needs a screen.
_REMEDY = "may be the reason: unset it, or set it to egl or osmesa, which need no screen"


#: A camera: its name, or its place and what it looks at, six numbers [m].
Viewpoint = str | Sequence[float]


def camera_id(model: Any, name: str) -> int:
    check_known("camera", name, [model.camera(i).name for i in range(model.ncam)])
    return mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, name)


def aim(view: Any, place: Floats, target: Floats) -> None:
    """Put a free camera (`mujoco.MjvCamera`) at a place and turn it to a target, shape (3,) each [m]."""
    ahead = target - place
    view.lookat[:] = target
    view.distance = float(np.linalg.norm(ahead))
    view.azimuth = math.degrees(math.atan2(ahead[1], ahead[0]))
    view.elevation = math.degrees(math.atan2(ahead[2], math.hypot(ahead[0], ahead[1])))


class FrameRenderer:
    """Draws frames of one size of one model; to be closed, or used as a context manager.

    With shadows and reflections a frame takes two to five times as long.

    Attributes:
        frames: Number of drawn frames.

    Raises:
        InputError: A size is not a positive integer, or larger than the scene's off-screen buffer.
        DrawingError: The library refused, or this process was forked from one that had drawn.
        InstallationError: No OpenGL library works; the message names the packages.
    """

    def __init__(self, model: Any, *, width: int = 1280, height: int = 720, shadows: bool = True) -> None:
        most = model.vis.global_
        width = check_count("width", width, most=most.offwidth)
        height = check_count("height", height, most=most.offheight)
        _refuse_after_fork()
        _choose_library()
        self.model = model
        self.width, self.height = width, height
        self.frames = 0
        try:
            self._renderer = mujoco.Renderer(model, height, width)
        except Exception as error:  # of the libraries, each has errors of its own
            wanted = os.environ.get("MUJOCO_GL", "")
            named = f"; MUJOCO_GL={wanted!r} {_REMEDY}" if wanted and wanted.lower().strip() not in _PACKAGES else ""
            raise DrawingError(f"cannot draw frames of {width}x{height} pixels: {error}{named}") from error
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self._renderer.scene.flags[flag] = shadows

    def rgb(self, data: Any, camera: Viewpoint) -> NDArray[np.uint8]:
        """Draw a colour picture of a state (`mujoco.MjData`), shape (height, width, 3)."""
        self._renderer.disable_depth_rendering()
        return self._draw(data, camera)

    def depth(self, data: Any, camera: Viewpoint) -> NDArray[np.float32]:
        """Draw the depth of each pixel along a camera's optical axis [m], shape (height, width)."""
        self._renderer.enable_depth_rendering()
        return self._draw(data, camera)

    def _draw(self, data: Any, camera: Viewpoint) -> Any:
        _refuse_after_fork()
        view = mujoco.MjvCamera()
        if isinstance(camera, str):
            view.type = mujoco.mjtCamera.mjCAMERA_FIXED
            view.fixedcamid = camera_id(self.model, camera)
        else:
            aim(view, np.array(camera[:3]), np.array(camera[3:]))
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_camlight(self.model, data)
        try:
            # A floor without end is laid out around the camera, and otherwise around that of the frame before.
            mujoco.mjv_updateCamera(self.model, data, view, self._renderer.scene)
            self._renderer.update_scene(data, view)
            frame = self._renderer.render()
        except Exception as error:
            raise DrawingError(
                f"cannot draw frame {self.frames + 1} of {self.width}x{self.height} pixels, camera {camera}: {error}"
            ) from error
        self.frames += 1
        return frame

    def close(self) -> None:
        self._renderer.close()

    def __enter__(self) -> FrameRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


#: The process that has used the graphics library; a child that is forked from it must not.
_drawing_process: int | None = None


def _refuse_after_fork() -> None:
    global _drawing_process
    if _drawing_process is None:
        _drawing_process = os.getpid()
    if _drawing_process != os.getpid():
        raise DrawingError(
            "this process was forked from one that had drawn already, and an OpenGL library does not survive that; "
            'start workers another way, such as gym.make_vec(..., vector_kwargs={"context": "spawn"})'
        )


def render(
    simulation: ArmSimulation, camera: str = "overview", *, width: int = 1280, height: int = 720, shadows: bool = True
) -> NDArray[np.uint8]:
    """Draw one picture of a simulation, shape (height, width, 3); for many keep a `FrameRenderer`.

    Raises:
        UnknownNameError: Unknown camera.
        InputError: The frame is too large.
        InstallationError: No OpenGL library works.
        DrawingError: The library refused or failed, or this process was forked from one that had drawn.
    """
    with FrameRenderer(simulation.model, width=width, height=height, shadows=shadows) as renderer:
        return renderer.rgb(simulation.data, camera)


@cache
def _choose_library() -> None:
    """Make MuJoCo draw with a library that works here.

    MuJoCo chooses at import and, left alone on Linux, takes GLFW, which needs a screen.
    """
    wanted = os.environ.get("MUJOCO_GL", "").lower().strip()
    if platform.system() != "Linux" or wanted == "glfw":
        return
    if wanted and wanted not in _PACKAGES:
        raise InstallationError(
            f"cannot draw: MUJOCO_GL={wanted!r} names no library that draws here; unset it, set it to egl or osmesa, "
            "or glfw with a screen"
        )
    context = _first_working([wanted] if wanted else list(_PACKAGES))
    importlib.import_module("mujoco.rendering.classic.gl_context").GLContext = context  # type: ignore[attr-defined]


def _first_working(names: Sequence[str]) -> Any:
    failures = []
    platform_before = os.environ.get("PYOPENGL_PLATFORM")
    for name in names:
        try:
            return _context(name)
        except Exception as error:  # a missing library shows as ImportError, AttributeError, OSError or GLError
            failures.append(f"{name}: {type(error).__name__}: {error}")
            _forget(name, platform_before)
    packages = ", or ".join(f"apt install {_PACKAGES[name]}" for name in names)
    raise InstallationError(f"cannot draw, no OpenGL library works here: {'; '.join(failures)}. Do: {packages}")


def _context(name: str) -> Any:
    """MuJoCo's context class for a library, after making one as a test."""
    context = importlib.import_module(f"mujoco.{name}").GLContext
    probe = context(_PROBE_SIZE, _PROBE_SIZE)
    probe.make_current()
    probe.free()
    return context


def _forget(name: str, platform_before: str | None) -> None:
    """Undo a failed attempt: PyOpenGL binds its platform once, at import."""
    if platform_before is None:
        os.environ.pop("PYOPENGL_PLATFORM", None)
    for module in [m for m in sys.modules if m == "OpenGL" or m.startswith(("OpenGL.", f"mujoco.{name}"))]:
        del sys.modules[module]
