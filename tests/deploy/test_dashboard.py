"""The dashboard answers in the words of the maker's manuals, and does what it says."""

import socket

import pytest

from kinreach.deploy import SimulatedUR
from kinreach.deploy._controller import Controller
from kinreach.deploy._dashboard import GREETING, answer
from kinreach.deploy._rtde import RobotMode
from kinreach.errors import InputError
from kinreach.robots import get_arm
from tests.deploy.test_rtde import PATIENCE, alive

LOOP = "def loop():\n  while True:\n    sync()\n  end\nend\n"


@pytest.fixture
def ur():
    controller = Controller(get_arm("ur5e"), log=(log := []).append)
    controller.log = log
    return controller


def ticked(ur, seconds):
    for _ in range(round(seconds / ur.cycle)):
        ur.tick()
    return ur


def test_answers_at_rest(ur):
    wanted = {
        "running": "Program running: false", "robotmode": "Robotmode: RUNNING", "safetymode": "Safetymode: NORMAL",
        "safetystatus": "Safetystatus: NORMAL", "programState": "STOPPED <unnamed>", "is in remote control": "true",
        "get loaded program": "No program loaded", "isProgramSaved": "false <unnamed>", "get robot model": "UR5",
        "PolyscopeVersion": "URSoftware 5.12.0.0 (simulated)", "version": "5.12.0.0", "close popup": "closing popup",
        "close safety popup": "closing safety popup", "restart safety": "Restarting safety", "stop": "Stopped",
        "play": "Failed to execute: play", "pause": "Failed to execute: pause", "quit": "Disconnected",
        "load a {}.urp": "File not found: a {}.urp", "load installation default.installation":
        "File not found: default.installation", "popup hello": "showing popup", "addToLog a b": "Added log message",
        "get operational mode": "NONE", "unlock protective stop": "Protective stop releasing",
    }  # fmt: skip
    assert {command: answer(ur, command) for command in wanted} == wanted
    assert answer(ur, "get serial number").isdigit()
    for unknown in ("", "Play", "play ", "popup", "load", "getUserRole", "movej([0,0,0,0,0,0])", "GET / HTTP/1.1"):
        assert answer(ur, unknown) is None
    assert ur.runtime_state == 1


def test_a_cb3_has_its_own_commands():
    ur = Controller(get_arm("ur10"))
    assert answer(ur, "PolyscopeVersion") == "URSoftware 3.15.8.0 (simulated)"
    assert (answer(ur, "get robot model"), answer(ur, "getUserRole")) == ("UR10", "NONE")
    for command in ("safetystatus", "is in remote control", "version", "get operational mode"):
        assert answer(ur, command) is None


def test_a_program_is_paused_resumed_and_stopped(ur):
    ur.start(LOOP)
    assert (answer(ur, "running"), answer(ur, "programState")) == ("Program running: true", "PLAYING loop")
    assert answer(ur, "play") == "Failed to execute: play"  # it plays already
    assert answer(ur, "pause") == "Pausing program"
    assert answer(ticked(ur, 1.0), "programState") == "PAUSED loop"
    assert answer(ur, "pause") == "Failed to execute: pause"
    assert answer(ur, "play") == "Starting program"
    assert answer(ticked(ur, 1.0), "programState") == "PLAYING loop"
    assert answer(ur, "stop") == "Stopped"
    assert answer(ticked(ur, 0.1), "programState") == "STOPPED <unnamed>"
    assert ur.log == [
        "program loop is running", "program is paused", "program is resumed", "program ended by request"
    ]  # fmt: skip


def test_power_and_brakes(ur):
    ur.start(LOOP)
    for command, said, mode in (("power off", "Powering off", RobotMode.POWER_OFF),
                                ("power on", "Powering on", RobotMode.IDLE),
                                ("brake release", "Brake releasing", RobotMode.RUNNING),
                                ("power off", "Powering off", RobotMode.POWER_OFF),
                                ("brake release", "Brake releasing", RobotMode.RUNNING)):  # fmt: skip
        assert answer(ur, command) == said
        assert answer(ticked(ur, 0.1), "robotmode") == f"Robotmode: {mode.name}"
        assert answer(ur, "programState") == "STOPPED <unnamed>"
        if mode is not RobotMode.RUNNING:
            with pytest.raises(InputError, match=r"power of the arm is off|brakes are closed"):
                ur.start(LOOP)
    on, off, free = "the power of the arm is on", "the power of the arm is off", "the brakes are released"
    running, ended = "program loop is running", "program ended by request"
    assert [line for line in ur.log if "refused" not in line] == [running, off, ended, on, free, off, on, free]
    ur.start(LOOP)
    ur.emergency_stop()
    for command in ("power on", "brake release", "unlock protective stop", "restart safety"):  # none ends it
        assert answer(ur, command)
        assert (answer(ur, "safetymode"), answer(ur, "robotmode")) == (
            "Safetymode: ROBOT_EMERGENCY_STOP", "Robotmode: POWER_OFF")  # fmt: skip


def test_who_leaves_may_take_the_power(ur):
    assert (answer(ur, "quit"), answer(ur, "robotmode")) == ("Disconnected", "Robotmode: RUNNING")
    assert (answer(ur, "shutdown"), answer(ur, "robotmode")) == ("Shutting down", "Robotmode: POWER_OFF")


def test_a_protective_stop_is_unlocked_after_five_seconds(ur):
    ur.start("protective_stop()")
    ticked(ur, 0.1)
    assert answer(ur, "safetystatus") == "Safetystatus: PROTECTIVE_STOP"
    assert "line 1 of the program asked for it" in ur.reason
    ticked(ur, 4.8)
    assert answer(ur, "unlock protective stop").startswith("Cannot unlock protective stop until 5s after occurrence")
    assert answer(ticked(ur, 0.2), "unlock protective stop") == "Protective stop releasing"
    assert answer(ur, "safetystatus") == "Safetystatus: NORMAL"


def test_over_the_network():
    log = []
    with (
        SimulatedUR("ur5e", rtde_port=0, script_port=0, speed=20, log=log.append) as robot,
        socket.create_connection((robot.address, robot.dashboard_port), PATIENCE) as client,
    ):
        lines = client.makefile("rb")
        assert lines.readline().decode() == f"{GREETING}\n"
        client.sendall(b"\r\nrobotmode\r\n\nwhat is this\n" + b"addToLog a\x1b[2J\n" * 30 + b"quit\nrunning\n")
        said = lines.read().decode().splitlines()
        assert said[:2] == ["Robotmode: RUNNING", "could not understand: 'what is this'"]
        assert said[2:] == ["Added log message"] * 30 + ["Disconnected"]
        assert len(log) == 21  # and not all of them
        assert all(line.isprintable() for line in log)
        assert alive(robot)
