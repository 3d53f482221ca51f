"""What the tests themselves promise: to run without OpenGL and X11, and to leave nothing behind."""

import re

import mujoco
import pytest

from kinreach.errors import InstallationError
from kinreach.sim import ArmSimulation, render

DRAW = """
from kinreach.errors import InstallationError
from kinreach.sim import ArmSimulation, render

try:
    print(render(ArmSimulation("arm3"), width=8, height=8).shape)
except InstallationError as error:
    print(error)
"""

TESTS = """
import tempfile
from pathlib import Path

def test_tidy(tmp_path):
    (tmp_path / "kept").touch()
    with tempfile.TemporaryDirectory():
        pass


def test_untidy():
    (Path.home() / ".telemetry").touch()
    tempfile.mkdtemp(prefix="SB3-")
"""


def test_who_does_not_ask_cannot_draw():
    arm = ArmSimulation("arm3")
    with pytest.raises(InstallationError, match="needs_gl"):
        render(arm, width=8, height=8)
    with pytest.raises(InstallationError, match="needs_gl"):
        mujoco.Renderer(arm.model, 8, 8)


def test_nor_can_a_process_that_it_starts(run_python):
    done = run_python("-c", DRAW)
    assert done.stdout.startswith("cannot draw, no OpenGL library works here"), done.stderr


def test_who_asks_can(run_python, needs_gl):
    assert run_python("-c", DRAW).stdout.strip() == "(8, 8, 3)"
    assert render(ArmSimulation("arm3"), width=8, height=8).shape == (8, 8, 3)


def test_a_run_that_leaves_something_behind_fails(run_python, tmp_path):
    (tmp_path / "test_own.py").write_text(TESTS)
    done = run_python("-m", "pytest", "-q", "-p", "tests.conftest", "-p", "no:cacheprovider", "test_own.py")
    assert "2 passed" in done.stdout
    assert done.returncode == 1
    assert re.search(r"left behind: home/\.telemetry, tmp/SB3-\w+$", done.stdout, re.MULTILINE)
