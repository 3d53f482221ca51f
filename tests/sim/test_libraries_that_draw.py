"""Which library draws: the first that works, and what is said if none does."""

import pytest

from kinreach.errors import InstallationError
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
