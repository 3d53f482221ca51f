"""What the tests have of the machine: folders of their own, and graphics only where a test asks for them."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

import pytest

from kinreach.errors import InstallationError
from kinreach.sim import _rendering as rendering
from kinreach.sim.inside import mujoco

#: The shared libraries that draw, or open a window.
GRAPHICS = ("EGL", "GL", "OSMesa", "X11")


class SessionFolder:
    """A home and a temporary folder for one run of the tests; both are empty at its end, or something was left behind.

    Args:
        caches: Where matplotlib's fonts, Warp's kernels and the like are kept from run to run; None: nowhere.
        results: The folder that commands write into by themselves: no test makes it.
    """

    def __init__(self, caches: Path | None, results: Path) -> None:
        self._results = None if results.exists() else results
        self._folder = tempfile.TemporaryDirectory(prefix="kinreach-", ignore_cleanup_errors=True)
        self.path = Path(self._folder.name)
        for name in ("home", "tmp", "no-graphics"):
            (self.path / name).mkdir()
        caches = caches or self.path / "caches"
        for name in GRAPHICS:
            for version in ("", *(f".{number}" for number in range(10))):  # PyOpenGL tries them all
                (self.path / "no-graphics" / f"lib{name}.so{version}").touch()
        self._patch = pytest.MonkeyPatch()
        self._patch.setenv("HOME", str(self.path / "home"))
        self._patch.setenv("TMPDIR", str(self.path / "tmp"))
        self._patch.setattr(tempfile, "tempdir", None)  # it was read from the environment before
        self._patch.setenv("XDG_CACHE_HOME", str(caches))
        self._patch.setenv("MPLCONFIGDIR", str(caches / "matplotlib"))
        self._patch.setenv("XDG_CONFIG_HOME", str(self.path / "config"))  # a browser's
        self._patch.setenv("IPYTHONDIR", str(self.path / "ipython"))
        self._patch.setenv("SB3_LOGDIR", str(caches / "stable-baselines3"))  # else a folder for every training
        self._patch.setenv("TORCHINDUCTOR_CACHE_DIR", str(caches / "torchinductor"))
        self._patch.setenv("RAY_TMPDIR", str(self.path))  # logs that it keeps, and sockets, whose paths must be short
        self._patch.setenv("ORT_DISABLE_TELEMETRY", "1")  # onnxruntime's

    def left(self) -> list[str]:
        """What lies in the two folders, without those that pytest, Ray and Warp keep: Warp until its process ends.

        And the folder of results, if it was not there before.
        """
        found = [path for name in ("home", "tmp") for path in (self.path / name).iterdir()]
        ours = [path for path in found if path.name != ".ray" and not path.name.startswith(("pytest-of-", "wp_pch_"))]
        made = [str(self._results)] if self._results and self._results.exists() else []
        return sorted(str(path.relative_to(self.path)) for path in ours) + made

    def close(self) -> None:
        """Remove the folders."""
        self._patch.undo()
        self._folder.cleanup()


@contextmanager
def no_graphics() -> Iterator[None]:
    """Nothing can be drawn here or in a process that is started from here, as on a machine without OpenGL and X11."""
    hidden = Path(os.environ["TMPDIR"]).parent / "no-graphics"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LD_LIBRARY_PATH", str(hidden), prepend=os.pathsep)  # the loader finds these, and they are empty
        patch.setattr(rendering, "_choose_library", _refuse)
        patch.setattr(mujoco, "Renderer", _refuse)
        yield


def _refuse(*_: object) -> NoReturn:
    raise InstallationError("cannot draw: this test does not ask for the fixture `needs_gl`")


def compile_kernels_quickly() -> None:
    """Have Warp compile its kernels without optimization, in half the time: tests take few steps. Skip without it."""
    pytest.importorskip("mujoco_warp")
    pytest.importorskip("warp").config.optimization_level = 0
