"""The dashboard of the simulated robot: a command is a line, and so is its answer.

Commands and answers are those of Universal Robots' manuals of the dashboard server, for CB3 and e-Series. Programs come
over the ports that take scripts, so that there are none to load.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from kinreach.deploy._controller import Controller
from kinreach.deploy._rtde import VERSIONS, RuntimeState, SafetyMode
from kinreach.robots.inside import ur_model

DASHBOARD_PORT = 29999
GREETING = "Connected: Universal Robots Dashboard Server"
#: How long a protective stop cannot be unlocked [s].
LOCKED = 5.0
_STATES = {
    RuntimeState.STOPPED: "STOPPED", RuntimeState.PLAYING: "PLAYING", RuntimeState.PAUSED: "PAUSED",
    RuntimeState.PAUSING: "PAUSED", RuntimeState.RESUMING: "PLAYING",
}  # fmt: skip


def _play(ur: Controller) -> str:
    if ur.runtime_state not in (RuntimeState.PAUSING, RuntimeState.PAUSED):
        return "Failed to execute: play"
    ur.resume()
    return "Starting program"


def _pause(ur: Controller) -> str:
    if ur.runtime_state not in (RuntimeState.PLAYING, RuntimeState.RESUMING):
        return "Failed to execute: pause"
    ur.pause()
    return "Pausing program"


def _after(act: Callable[[Controller], None], said: str) -> Callable[[Controller], str]:
    """Return a command that lets the controller do something, and its answer."""

    def command(ur: Controller) -> str:
        act(ur)
        return said

    return command


def _unlock(ur: Controller) -> str:
    if ur.time - ur.stopped_at < LOCKED:
        return (
            "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of protective stop before "
            "unlocking"
        )
    if ur.safety_mode is SafetyMode.PROTECTIVE_STOP:
        ur.release()
    return "Protective stop releasing"


def _version(ur: Controller) -> str:
    return ".".join(map(str, VERSIONS[ur.rate]))


def _running(ur: Controller) -> str:
    return f"Program running: {str(ur.runtime_state is not RuntimeState.STOPPED).lower()}"


_COMMANDS: Mapping[str, Callable[[Controller], str]] = {
    "play": _play,
    "pause": _pause,
    "stop": _after(Controller.end_program, "Stopped"),
    "running": _running,
    "robotmode": lambda ur: f"Robotmode: {ur.robot_mode.name}",
    "safetymode": lambda ur: f"Safetymode: {ur.safety_mode.name}",
    "programState": lambda ur: f"{_STATES[ur.runtime_state]} {ur.program_name or '<unnamed>'}",
    "get loaded program": lambda ur: "No program loaded",
    "isProgramSaved": lambda ur: "false <unnamed>",
    "close popup": lambda ur: "closing popup",
    "close safety popup": lambda ur: "closing safety popup",
    "restart safety": lambda ur: "Restarting safety",
    "power on": _after(Controller.power_on, "Powering on"),
    "power off": _after(Controller.power_off, "Powering off"),
    "brake release": _after(Controller.release_brakes, "Brake releasing"),
    "unlock protective stop": _unlock,
    "PolyscopeVersion": lambda ur: f"URSoftware {_version(ur)} (simulated)",
    "get serial number": lambda ur: "20000000000",
    "get robot model": lambda ur: (ur_model(ur.arm.name) or "UR").upper().removesuffix("E"),
}
#: Commands of the controllers that have them: CB3, e-Series and later.
_OF_CB3: Mapping[str, Callable[[Controller], str]] = {"getUserRole": lambda ur: "NONE"}
_OF_E_SERIES: Mapping[str, Callable[[Controller], str]] = {
    "safetystatus": lambda ur: f"Safetystatus: {ur.safety_mode.name}",
    "is in remote control": lambda ur: "true",
    "version": _version,
    "get operational mode": lambda ur: "NONE",
    "clear operational mode": lambda ur: (
        "No longer controlling the operational mode. Current operational mode: 'NONE'."
    ),
}
#: Commands that a text follows, with their answers.
_WITH_TEXT: Mapping[str, str] = {
    "popup ": "showing popup",
    "addToLog ": "Added log message",
    "load installation ": "File not found: {}",
    "load ": "File not found: {}",
}
#: Commands after which the connection ends.
FAREWELLS: Mapping[str, str] = {"quit": "Disconnected", "shutdown": "Shutting down"}


def answer(ur: Controller, command: str) -> str | None:
    """Do what a command says and return the answer; None for what is no command of this controller."""
    if command in FAREWELLS:
        if command == "shutdown":  # of the arm; the simulation itself goes on
            ur.power_off()
        return FAREWELLS[command]
    others = _OF_CB3 if ur.rate == 125 else _OF_E_SERIES
    if (act := _COMMANDS.get(command) or others.get(command)) is not None:
        return act(ur)
    for start, said in _WITH_TEXT.items():
        if command.startswith(start):
            return said.format(command.removeprefix(start))
    return None


def not_understood(command: str) -> str:
    """Return the answer to what is no command."""
    return f"could not understand: '{command}'"
