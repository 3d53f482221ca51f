"""The command line of the page: refused in one line, and served to this machine only."""

import re
import shutil
import socket
import subprocess
import sys
from pathlib import Path
from urllib.request import urlopen

import pytest

from kinreach import view
from kinreach.cli import run_command
from kinreach.robots import ArmDescription, get_arm
from kinreach.view import _cli


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--arm", "ur6"], "unknown arm 'ur6'; available: arm3, panda, so101, ur10"),
        (["--arm", "missing.urdf"], "missing.urdf"),
        (["--port", "0"], "port must be at least 1"),
        (["--port", "70000"], "port must be at most 65535"),
        (["--calibration", "missing.yaml"], "missing.yaml"),
        (["--arm", "arm3", "--calibration", "missing.yaml"], "unknown UR model 'arm3'"),
        (["--policy", "wisdom"], "there is no policy 'wisdom'"),
        (["--policy", "README.md"], "is not a policy"),
        (["--policy", "nobody:Nothing"], "cannot import the policy nobody:Nothing"),
        (["--environment", "kinreach/Nothing-v0"], "there is no environment 'kinreach/Nothing-v0'"),
        (["--environment", "nobody:a/B-v0"], "cannot import the environment nobody:a/B-v0"),
        (["--results", "missing.json"], "cannot read the results missing.json"),
        (["--results", "README.md"], "is not JSON"),
        (["--tip", "elbow"], "unknown tip 'elbow'"),
    ],
)
def test_bad_input_ends_in_one_line(arguments, said, capsys):
    assert run_command("view", arguments, prog="kinreach view") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("kinreach view: error: ")
    assert said in line


def test_a_missing_extra_is_said_in_one_line(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "viser", None)
    assert run_command("view", [], prog="kinreach view") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("the page needs: pip install 'kinreach[view]'")


def test_a_page_is_opened_and_served_until_ctrl_c(monkeypatch, capsys):
    pytest.importorskip("viser")
    done = []

    class Standin:
        address = "http://127.0.0.1:8123"

        def __init__(self, setup, *, port):
            done.append((setup.arm.name, setup.simple, port))

        def stop(self):
            done.append("stopped")

    class Waiting:
        def wait(self):
            done.append("waits")
            raise KeyboardInterrupt

    monkeypatch.setattr(_cli, "Server", Standin)
    monkeypatch.setattr(_cli.threading, "Event", Waiting)
    monkeypatch.setattr(_cli.webbrowser, "open", done.append)
    for more, simple, port in (([], False, 8080), (["--simple", "--open", "--port", "8123"], True, 8123)):
        with pytest.raises(KeyboardInterrupt):
            _cli.main(["--arm", "arm3", *more], prog="view")
        opened = [Standin.address] if more else []
        assert done == [("arm3", simple, port), *opened, "waits", "stopped"]
        assert capsys.readouterr().out.startswith(f"{Standin.address}  (only on this machine")
        done.clear()


@pytest.mark.parametrize("terminal", [True, False])
def test_a_terminal_shows_that_it_starts(terminal, monkeypatch, capsys):
    monkeypatch.setattr("kinreach.cli.run", lambda module, argv, *, prog: 0)
    monkeypatch.setattr("sys.stderr.isatty", lambda: terminal)
    assert run_command("view", [], prog="kinreach view") == 0
    assert capsys.readouterr().err == "starting ...\n" * terminal


def test_the_face_has_its_names_only():
    assert view.TargetModel("arm3").kinds == ("position only",)
    with pytest.raises(AttributeError, match="attribute nothing"):
        view.nothing  # noqa: B018


@pytest.mark.slow
def test_it_is_served_here_and_nowhere_else():
    """On the loopback address; other addresses of the machine are not listened to; Ctrl-C ends it."""
    pytest.importorskip("viser")
    command = [sys.executable, "-m", "kinreach.view", "--arm", "arm3", "--port", "8391"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        line = server.stdout.readline()
        port = int(re.match(r"http://127\.0\.0\.1:(\d+)  \(only on this machine", line).group(1))
        assert b"<html" in urlopen(f"http://127.0.0.1:{port}", timeout=60).read().lower()
        with pytest.raises(OSError, match="refused"):
            socket.create_connection(("127.0.0.2", port), timeout=10)
    finally:
        server.send_signal(2)
        _, err = server.communicate(timeout=60)
    assert server.returncode == 130
    assert err.strip() == "python -m kinreach.view: interrupted"


def test_the_pages_code_names_the_same_arm(tmp_path):
    """Of a URDF whose meshes are in a folder of packages."""
    from kinreach.view._cli import setup_of

    robots = Path(str(get_arm("ur5").package_root())) / "example-robot-data/robots/ur_description"
    shutil.copytree(robots / "meshes/ur5", tmp_path / "share/ur_description/meshes/ur5")
    file = tmp_path / "mine.urdf"
    text = (robots / "urdf/ur5_robot.urdf").read_text()
    file.write_text(text.replace("example-robot-data/robots/ur_description", "ur_description"))
    setup = setup_of(str(file), tip="wrist_3_link", package_dirs=[str(tmp_path / "share")])
    arm = eval(setup.expression, {"ArmDescription": ArmDescription})
    assert (arm.default_tip, arm.urdf) == ("wrist_3_link", setup.arm.urdf)
    assert setup.model().checker is not None


def test_an_environment_of_ones_own_comes_first(tmp_path, monkeypatch):
    """Its module is loaded here, and named in the program that is copied."""
    from kinreach.view._cli import setup_of
    from kinreach.view._episodes import EpisodeRequest

    (tmp_path / "own_arms.py").write_text(
        "import gymnasium as gym\n"
        "from kinreach.envs._reach.env import UR5SingleStepEnv\n"
        "gym.register('own/Reach-v0', entry_point=UR5SingleStepEnv)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    setup = setup_of("ur5-thesis", environment="own_arms:own/Reach-v0")
    assert (setup.first, setup.environments[0]) == ("Episodes", "own_arms:own/Reach-v0")
    asked = EpisodeRequest(setup.environments[0], "closed-form", setup.arm, options={"backend": "kinematic"})
    assert asked.play(simple=True).trial["reached"]
    assert "gym.make('own_arms:own/Reach-v0', arm='ur5', backend='kinematic')" in asked.program("'ur5'")
