"""The window of `render_mode="human"`, on a virtual screen."""

import re
import shutil
import subprocess

import pytest

from tests.cases import slow

PROGRAM = """
import struct, sys, time
import gymnasium as gym
import numpy as np
import kinreach

def red_on_screen():
    dump = open(sys.argv[2], "rb").read()  # an X window dump: a header of big-endian words, colours, pixels
    words = struct.unpack(">25I", dump[:100])
    width, height, line = words[4], words[5], words[12]
    pixels = np.frombuffer(dump, np.uint8, height * line, words[0] + 12 * words[19]).reshape(height, line)
    blue, green, red = (pixels[:, k : 4 * width : 4].astype(int) for k in range(3))
    return int(((red > 120) & (green < 60) & (blue < 60)).sum())

env = gym.make("kinreach/UR5SingleStep-v0", backend=sys.argv[1], render_mode="human")
env.reset(seed=0)
assert red_on_screen() == 0
env.step(np.array([-1.8, -1.0, 1.9, -2.47, -np.pi / 2, 0.0]) / np.pi)
for _ in range(2000):
    if (red := red_on_screen()) > 30:
        break
    time.sleep(0.1)
env.reset()
env.step(np.zeros(6))
env.close()
env.close()
print(red)
"""

NO_SCREEN = """
import gymnasium as gym
import kinreach
from kinreach.errors import InstallationError

env = gym.make("kinreach/UR5SingleStep-v0", backend="kinematic", render_mode="human")
env.reset(seed=0)
try:
    env.step([0.0] * 6)
except InstallationError as error:
    print(error)
env.close()
"""

#: Other threads may warn while it is found out whether there is a screen.
ASKED = """
import sys, warnings
import glfw
from kinreach.sim import _picture as viewer
from kinreach.errors import InstallationError

def forbidden(*_, **__):
    raise AssertionError("the filters of all threads are changed")

warnings.catch_warnings = warnings.simplefilter = warnings.filterwarnings = forbidden
warnings.warn = forbidden
theirs = []
hook = None if sys.argv[1] == "none" else lambda code, description: theirs.append(code)
glfw.set_error_callback(hook)
for _ in range(2):
    try:
        viewer._check_screen()
        print("a screen")
    except InstallationError as error:
        print(error)
assert glfw.set_error_callback(None) is hook
assert theirs == []
"""


@pytest.fixture
def screen(tmp_path, monkeypatch, needs_gl):
    """A virtual screen; the file that always shows what is on it."""
    if shutil.which("Xvfb") is None:
        pytest.skip("there is no virtual screen here: apt install xvfb")
    command = ["Xvfb", "-displayfd", "1", "-screen", "0", "800x600x24", "-nolisten", "tcp", "-fbdir", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as server:
        monkeypatch.setenv("DISPLAY", f":{server.stdout.readline().strip()}")
        yield tmp_path / "Xvfb_screen0"
        server.terminate()


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["mujoco", "kinematic"])
def test_the_viewer_shows_the_ball_and_closes(screen, run_python, backend):
    done = run_python("-c", PROGRAM, backend, str(screen))
    assert done.returncode == 0, done.stderr
    assert 30 < int(done.stdout) < 5000


@pytest.mark.parametrize("hook", [*slow("none"), "own"])
def test_to_ask_for_a_screen_changes_nothing_of_the_process(run_python, hook):
    done = run_python("-c", ASKED, hook)
    assert done.returncode == 0, done.stderr
    first, again = done.stdout.splitlines()
    assert first == again
    assert re.match(r"cannot open a window: \(\d+\) X11: Failed to load Xlib\. Without a screen use", first)


@pytest.mark.slow
def test_with_a_screen_nothing_is_said(screen, run_python):
    done = run_python("-c", ASKED, "own")
    assert (done.returncode, done.stdout) == (0, 2 * "a screen\n"), done.stderr


@pytest.mark.slow
def test_without_a_screen_the_error_says_what_to_do(run_python, needs_gl):
    done = run_python("-c", NO_SCREEN)
    assert done.returncode == 0, done.stderr
    assert "cannot open a window" in done.stdout
    assert "rgb_array" in done.stdout
    assert "xvfb" in done.stdout
