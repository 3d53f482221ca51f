"""Which library draws: the first that works, and what is said if none does."""

import importlib.util
import os
import sys
from types import SimpleNamespace

import pytest

from kinreach.errors import DrawingError, InstallationError
from kinreach.sim import ArmSimulation, render
from kinreach.sim import _rendering as rendering
from tests.cases import slow
from tests.sim.test_rendering import run


def test_without_a_library_one_error_names_the_packages(monkeypatch):
    def missing(name):
        raise AttributeError(f"no {name}")

    monkeypatch.setattr(rendering, "_context", missing)
    monkeypatch.setattr(rendering, "_forget", lambda *_: None)
    with pytest.raises(InstallationError, match=r"no egl.*no osmesa.*libegl1 libgl1.*libosmesa6"):
        rendering._first_working(["egl", "osmesa"])


NO_TRACE = """
import os, sys
from kinreach.errors import InstallationError
from kinreach.sim import _rendering

def fails(name):
    print(os.environ.get("PYOPENGL_PLATFORM"))
    sys.modules[f"mujoco.{name}"] = sys.modules["OpenGL"] = sys
    os.environ.setdefault("PYOPENGL_PLATFORM", name)
    raise ImportError(name)

_rendering._context = fails
try:
    _rendering._first_working(["egl", "osmesa"])
except InstallationError:
    print(os.environ.get("PYOPENGL_PLATFORM"), {"mujoco.egl", "mujoco.osmesa", "OpenGL"} & set(sys.modules))
"""


@pytest.mark.parametrize("platform", [*slow(None), "glx"])
def test_a_library_that_fails_leaves_nothing_to_the_next(platform):
    """MuJoCo sets PyOpenGL's platform before it fails; the next library would be bound to it."""
    chosen = "" if platform is None else f"import os; os.environ['PYOPENGL_PLATFORM'] = {platform!r}"
    assert run(chosen + NO_TRACE, None).split("\n") == [str(platform), str(platform), f"{platform} set()"]


def test_a_fork_of_a_process_that_has_drawn_does_not_draw(monkeypatch):
    monkeypatch.setattr(rendering, "_drawing_process", None)
    monkeypatch.setattr(rendering.os, "getpid", lambda: 7)
    for _ in range(2):
        rendering._refuse_after_fork()
    assert rendering._drawing_process == 7
    monkeypatch.setattr(rendering.os, "getpid", lambda: 8)
    with pytest.raises(DrawingError, match="forked from one that had drawn already"):
        rendering._refuse_after_fork()
    with pytest.raises(DrawingError, match="forked from one that had drawn already"):  # before a library is touched
        render(ArmSimulation("ur5e"), width=8, height=8)
    assert rendering._drawing_process == 7


@pytest.fixture
def choosing():
    """The module as it is imported, whatever these tests make of its choice on a machine that does not draw."""
    spec = importlib.util.find_spec(rendering.__name__)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("system", "wanted", "tried"),
    [
        ("Linux", None, ["egl", "osmesa"]), ("Linux", " EGL ", ["egl"]), ("Linux", "osmesa", ["osmesa"]),
        ("Linux", "glfw", None), ("Darwin", None, None), ("Windows", "egl", None), ("Linux", "", ["egl", "osmesa"]),
    ],
)  # fmt: skip
def test_which_libraries_are_tried(choosing, monkeypatch, system, wanted, tried):
    """On Linux the one that is wanted, else both; MuJoCo then draws with the one that works."""
    monkeypatch.setattr(choosing.platform, "system", lambda: system)
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    if wanted is not None:
        monkeypatch.setenv("MUJOCO_GL", wanted)
    asked, module = [], SimpleNamespace(GLContext="before")
    monkeypatch.setattr(choosing, "_first_working", lambda names: asked.append(names) or "works")
    monkeypatch.setitem(sys.modules, "mujoco.rendering.classic.gl_context", module)
    choosing._choose_library()
    assert (asked, module.GLContext) == (([], "before") if tried is None else ([tried], "works"))


@pytest.mark.parametrize("wanted", ["disable", "vulkan"])
def test_a_library_that_does_not_draw_is_refused(choosing, monkeypatch, wanted):
    monkeypatch.setattr(choosing.platform, "system", lambda: "Linux")
    monkeypatch.setenv("MUJOCO_GL", wanted)
    with pytest.raises(InstallationError, match=f"MUJOCO_GL='{wanted}' names no library that draws here; unset it"):
        choosing._choose_library()


@pytest.mark.parametrize("before", [None, "glx"])
def test_a_failed_attempt_is_forgotten(monkeypatch, before):
    """A platform that was set before is not; modules of other names stay."""
    kept = ("mujoco.osmesa", "OpenGLU", "mujoco_egl")
    for name in ("OpenGL", "OpenGL.GL", "mujoco.egl", "mujoco.egl.egl_ext", *kept):
        monkeypatch.setitem(sys.modules, name, SimpleNamespace())
    monkeypatch.setenv("PYOPENGL_PLATFORM", "egl")
    rendering._forget("egl", before)
    assert os.environ.get("PYOPENGL_PLATFORM") == (None if before is None else "egl")
    left = {name for name in sys.modules if name.startswith(("OpenGL", "mujoco.egl", "mujoco.osmesa", "mujoco_egl"))}
    assert left == {*kept}
