"""What tests of every part share."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

from kinreach.envs import ArmSimulation, render
from kinreach.errors import InstallationError

# The same examples every time, on machines of any speed: what fails, a change has broken.
settings.register_profile("kinreach", derandomize=True, deadline=None)
settings.load_profile("kinreach")

ROOT = Path(__file__).resolve().parents[1]

PythonRunner = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture(scope="session")
def root() -> Path:
    """The repository."""
    return ROOT


@pytest.fixture(scope="session")
def needs_gl() -> None:
    """Skip where nothing can be drawn, with the reason; fail instead where `KINREACH_REQUIRE_GL` is set, as in CI."""
    try:
        render(ArmSimulation("ur5"), width=8, height=8)
    except InstallationError as error:
        if os.environ.get("KINREACH_REQUIRE_GL"):
            pytest.fail(f"KINREACH_REQUIRE_GL is set, and nothing can be drawn: {error}")
        pytest.skip(str(error))


@pytest.fixture
def run_python(tmp_path: Path) -> PythonRunner:
    """`run_python(*arguments, before=folder, input=text)`: a fresh interpreter in an empty folder.

    kinreach comes from this repository; modules and distributions in `before` hide the installed ones.
    """

    def run(*arguments: str, before: Path | None = None, input: str | None = None) -> subprocess.CompletedProcess[str]:
        paths = [str(path) for path in (before, ROOT) if path is not None]
        return subprocess.run(
            [sys.executable, *arguments],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
            input=input,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )

    return run
