"""A client of a UR that reads its state by RTDE, sends programs, waits for their end, and stops them."""

from __future__ import annotations

import socket
import struct
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from time import monotonic
from typing import Self

import numpy as np

from kinreach._checks import Floats, check_count, printable, shown
from kinreach.deploy._controller import FINISHED, NOT_AT_START, REGISTER, Recording
from kinreach.deploy._program import STOP_SCRIPT, Program
from kinreach.deploy._rtde import (
    NOT_FOUND,
    PROTOCOL,
    RTDE_PORT,
    Kind,
    Recipe,
    RobotMode,
    RuntimeState,
    SafetyMode,
    names_in,
    package,
    packages_in,
)
from kinreach.deploy._server import KEY, PRIMARY_PORT, ROBOT_MESSAGE, RUNTIME_EXCEPTION
from kinreach.errors import InputError, RobotError
from kinreach.kinematics._trajectory import Trajectory
from kinreach.robots._ur import JOINTS

#: Longest time for an answer, for the start of a program, and in addition for each of its characters [s].
TIMEOUT, START_TIMEOUT, READING_TIME = 3.0, 3.0, 1e-5
#: Variables that are read; old controllers do not have those in `_OPTIONAL`.
_OPTIONAL = ("tcp_offset", f"output_int_register_{REGISTER}")
_VARIABLES = (
    "timestamp", "target_q", "target_qd", "actual_q", "actual_qd", "actual_TCP_pose", "robot_mode", "safety_mode",
    "runtime_state", "speed_scaling", *_OPTIONAL,
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class RobotState:
    """The state of a UR.

    Attributes:
        time: Of the controller [s].
        target_q, actual_q: Joint angles [rad], shape (6,).
        target_qd, actual_qd: Speeds [rad/s], shape (6,).
        tcp_pose: Tool centre point in `base`, `[x, y, z, rx, ry, rz]` [m, rad], shape (6,).
        tcp_offset: Tool centre point on the flange, as `tcp_pose`; None if the controller does not report it.
        robot_mode, safety_mode, runtime_state: RTDE's numbers.
        speed_scaling: Speed of program time, 0 to 1.
        register: Integer register 24, the progress of kinreach's programs; None if it is not reported.
    """

    time: float
    target_q: Floats
    target_qd: Floats
    actual_q: Floats
    actual_qd: Floats
    tcp_pose: Floats
    robot_mode: int
    safety_mode: int
    runtime_state: int
    speed_scaling: float
    tcp_offset: Floats | None
    register: int | None


class URClient:
    """A connection to a UR, real or simulated. Use it in `with`, by one thread.

    Args:
        address: Host name or IP address.
        rtde_port: Port of RTDE.
        script_port: Port for programs and messages.

    Raises:
        RobotError: There is no answer, or not one of a UR.
    """

    def __init__(self, address: str, *, rtde_port: int = RTDE_PORT, script_port: int = PRIMARY_PORT) -> None:
        given: object = address
        if not isinstance(given, str) or not given.isprintable() or not 0 < len(given) < 254:
            raise InputError(f"the address of a robot must be a host name or an IP address, got {shown(address)}")
        self.address, self._buffer, self._messages = address, bytearray(), bytearray()
        self._silence = TIMEOUT  # after so long the connection counts as lost
        ports = [check_count(name, port, most=65535) for name, port in (("rtde_port", rtde_port),
                                                                        ("script_port", script_port))]  # fmt: skip
        self._rtde = self._connect(ports[0])
        try:
            self._script = self._connect(ports[1])
        except RobotError:
            self._rtde.close()
            raise
        try:
            self._recipe = self._set_up()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection; a program that runs goes on."""
        self._rtde.close()
        self._script.close()

    def next_state(self) -> RobotState:
        """Return the next state; there is one for each control cycle.

        Raises:
            RobotError: The connection is lost.
        """
        values = self._recipe.unpack(self._wait_for(Kind.DATA)[1:])
        vectors = {name: np.array(value) for name, value in values.items()}
        register = values.get(f"output_int_register_{REGISTER}")
        return RobotState(
            values["timestamp"][0], vectors["target_q"], vectors["target_qd"], vectors["actual_q"],
            vectors["actual_qd"], vectors["actual_TCP_pose"], int(values["robot_mode"][0]),
            int(values["safety_mode"][0]), int(values["runtime_state"][0]), values["speed_scaling"][0],
            vectors.get("tcp_offset"), None if register is None else int(register[0]),
        )  # fmt: skip

    def read(self) -> RobotState:
        """Return the robot's latest state.

        Raises:
            RobotError: As `next_state`.
        """
        try:
            self._rtde.setblocking(False)
            while data := self._rtde.recv(65536):
                self._buffer += data
        except BlockingIOError:
            pass
        except OSError as error:
            raise self._lost(error) from None
        finally:
            with suppress(OSError):  # closed
                self._rtde.settimeout(self._silence)
        size = 3 + 1 + self._recipe.size
        while len(self._buffer) >= 2 * size and self._buffer[2] == Kind.DATA:
            del self._buffer[:size]  # what is older
        return self.next_state()

    def send(self, script: str) -> None:
        """Send a program; the running one ends.

        Raises:
            RobotError: The connection is lost.
        """
        try:
            self._script.sendall(script.encode())
        except OSError as error:
            raise self._lost(error) from None

    def stop(self) -> None:
        """Stop the robot by `stopj`, within a control cycle.

        Raises:
            RobotError: The connection is lost.
        """
        self.send(STOP_SCRIPT)

    def check_ready(self, program: Program) -> None:
        """Check that the robot can run a program now.

        Raises:
            RobotError: It is not running, is stopped, runs another program, or stands elsewhere.
        """
        state = self.read()
        if state.robot_mode != RobotMode.RUNNING:
            raise self._error(f"is not ready: robot mode {state.robot_mode}; power it on and release the brakes")
        if state.safety_mode not in (SafetyMode.NORMAL, SafetyMode.REDUCED):
            raise self._error(f"is stopped: safety mode {state.safety_mode}; release it first")
        if state.runtime_state != RuntimeState.STOPPED:
            raise self._error("runs a program already; end that one first")
        off = np.abs(state.actual_q - program.start)
        if not off.max() <= program.tolerance:
            joint = int(off.argmax())
            way = f"{JOINTS[joint]} is {off[joint]:.4f} rad off, {program.tolerance:g} at most"
            raise self._error(f"does not stand where the program begins: {way}; plan again")

    def run(self, program: Program, *, watch: Callable[[RobotState], object] | None = None) -> Recording:
        """Send a program and wait for its end. Ctrl-C stops the robot at once, and is raised again when it stands.

        Args:
            program: Try it in simulation before.
            watch: Called with each state.

        Returns:
            `commanded` and `measured`, each a `Trajectory` with a sample for each control cycle.

        Raises:
            RobotError: The robot does not begin or finish the program; the message has the robot's reason, if any.
        """
        self.check_ready(program)
        states = [self.read()]
        text = program.text
        try:
            self.send(text)
            self._follow(states, watch, READING_TIME * len(text))
        except BaseException as error:
            with suppress(RobotError):
                self.stop()
            if not isinstance(error, RobotError):
                self._wait_until_it_stands(states)
            raise
        end = states[-1]
        if end.safety_mode not in (SafetyMode.NORMAL, SafetyMode.REDUCED):
            raise RobotError(f"the robot stopped: {self._reason() or f'safety mode {end.safety_mode}'}")
        if end.register == NOT_AT_START:
            raise RobotError("the robot did not move: it does not stand at the start posture of the program")
        if end.register not in (None, FINISHED):
            raise RobotError(f"the program ended before its last move{self._reason(': ')}")
        return _recording(states)

    def _follow(self, states: list[RobotState], watch: Callable[[RobotState], object] | None, reading: float) -> None:
        """Collect states until the program has ended; a robot may be silent while it reads a long one."""
        deadline, began = monotonic() + START_TIMEOUT + reading, False
        self._be_patient(TIMEOUT + reading)
        while not began or states[-1].runtime_state != RuntimeState.STOPPED:
            states.append(self.next_state())
            if not began and states[-1].runtime_state == RuntimeState.PLAYING:
                began = True
                self._be_patient(TIMEOUT)
            if watch is not None:
                watch(states[-1])
            if not began and monotonic() > deadline:
                raise self._error(f"did not begin{self._reason(': ')}; is it in remote control?")

    def _be_patient(self, seconds: float) -> None:
        self._silence = seconds
        self._rtde.settimeout(seconds)

    def _wait_until_it_stands(self, states: list[RobotState]) -> None:
        deadline = monotonic() + TIMEOUT
        while np.abs(states[-1].actual_qd).max() > 0.001 or states[-1].runtime_state == RuntimeState.PLAYING:
            states.append(self.next_state())
            if monotonic() > deadline:
                raise self._error("still moves: use its emergency stop")

    def _reason(self, before: str = "") -> str:
        """The robot's last message on the script port about its program."""
        self._script.setblocking(False)
        try:
            while data := self._script.recv(65536):
                self._messages += data
        except OSError:  # nothing more
            pass
        finally:
            self._script.settimeout(TIMEOUT)
        text = ""
        while len(self._messages) >= 15:
            (size,) = struct.unpack_from(">i", self._messages)
            if not 5 <= size <= len(self._messages):
                break
            message = bytes(self._messages[4:size])
            del self._messages[:size]
            if message[0] == ROBOT_MESSAGE and message[10] == RUNTIME_EXCEPTION:
                text = message[19:].decode("utf-8", "replace")
            elif message[0] == ROBOT_MESSAGE and message[10] == KEY and len(message) > 20:
                text = message[20 + message[19] :].decode("utf-8", "replace")
        return f"{before}{printable(text)}" if text else ""

    def _connect(self, port: int) -> socket.socket:
        try:
            connection = socket.create_connection((self.address, port), TIMEOUT)
        except (OSError, UnicodeError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise RobotError(f"no robot answers at {self.address}:{port}: {reason}") from None
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return connection

    def _set_up(self) -> Recipe:
        """Set up RTDE at the rate of the controller."""
        self._send(Kind.PROTOCOL_VERSION, struct.pack(">H", PROTOCOL))
        if self._wait_for(Kind.PROTOCOL_VERSION) != b"\x01":
            raise self._error(f"has no RTDE protocol {PROTOCOL}; its software is too old")
        self._send(Kind.CONTROLLER_VERSION)
        version = self._wait_for(Kind.CONTROLLER_VERSION)
        rate = 500.0 if len(version) == 16 and struct.unpack_from(">I", version)[0] >= 5 else 125.0
        names = list(_VARIABLES)
        for _ in range(2):
            self._send(Kind.SETUP_OUTPUTS, struct.pack(">d", rate) + ",".join(names).encode())
            types = names_in(self._wait_for(Kind.SETUP_OUTPUTS)[1:])
            missing = [name for name, kind in zip(names, types, strict=False) if kind == NOT_FOUND]
            if not missing:
                break
            names = [name for name in names if name not in missing]
        if len(types) != len(names) or set(_VARIABLES) - set(names) - set(_OPTIONAL):
            raise self._error(f"does not know {', '.join(missing) or 'what is asked for'}")
        try:
            recipe = Recipe(names, types)
        except KeyError as error:
            raise self._error(f"has a type {shown(error.args[0])}, which RTDE has not") from None
        self._send(Kind.START)
        if self._wait_for(Kind.START) != b"\x01":
            raise self._error("refuses to send its state")
        return recipe

    def _send(self, kind: Kind, payload: bytes = b"") -> None:
        try:
            self._rtde.sendall(package(kind, payload))
        except OSError as error:
            raise self._lost(error) from None

    def _wait_for(self, wanted: Kind) -> bytes:
        """Return the payload of the next package of a kind, without those before it."""
        deadline = monotonic() + self._silence
        while True:
            try:
                for kind, payload in packages_in(self._buffer):
                    if kind == wanted:
                        return payload
                if monotonic() > deadline:
                    raise TimeoutError("no answer")
                data = self._rtde.recv(65536)
                if not data:
                    raise ConnectionError("the connection was closed")
            except InputError as error:
                raise RobotError(f"what answers at {self.address} is not a UR: {error}") from None
            except OSError as error:
                raise self._lost(error) from None
            self._buffer += data

    def _error(self, what: str) -> RobotError:
        return RobotError(f"the robot at {self.address} {what}")

    def _lost(self, error: OSError) -> RobotError:
        return RobotError(f"the connection to the robot at {self.address} is lost: {error.strerror or error}")


def _recording(states: list[RobotState]) -> Recording:
    """Make the recording of a motion from its states, each time once."""
    t = np.array([state.time for state in states])
    kept = np.flatnonzero(np.diff(t, prepend=-np.inf) > 0)
    rows = [states[index] for index in kept]

    def column(name: str) -> Floats:
        return np.array([getattr(state, name) for state in rows])

    t = t[kept] - t[kept[0]]
    return Recording(
        Trajectory(JOINTS, t, column("target_q"), column("target_qd")),
        Trajectory(JOINTS, t, column("actual_q"), column("actual_qd")),
        rows[-1].register or 0,
        "",
    )
