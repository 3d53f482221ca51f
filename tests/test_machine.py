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

TIDY = """
import tempfile
from pathlib import Path

def test_tidy(tmp_path):
    (tmp_path / "kept").touch()
    with tempfile.TemporaryDirectory():
        pass
"""

UNTIDY = f"""{TIDY}
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


@pytest.mark.parametrize(
    ("tests", "left", "options"),
    [(TIDY, None, ("-p", "no:cacheprovider")), (UNTIDY, r"home/\.telemetry, tmp/SB3-\w+$", ("-n", "1"))],
)
def test_a_run_that_leaves_something_behind_fails(tests, left, options, run_python, tmp_path, monkeypatch):
    monkeypatch.delenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", raising=False)  # "-n" needs one
    (tmp_path / "test_own.py").write_text(tests)
    done = run_python("-m", "pytest", "-q", "-p", "tests.conftest", *options, "test_own.py")
    assert f"{1 + (tests == UNTIDY)} passed" in done.stdout
    assert done.returncode == (0 if left is None else 1)
    assert bool(left) == ("left behind" in done.stdout)
    assert left is None or re.search(f"left behind: {left}", done.stdout, re.MULTILINE)
