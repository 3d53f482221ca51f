"""A simulated UR on this machine: RTDE and the script ports of a simulated controller.

One thread reads from the clients, lets a control cycle pass when it is due, and sends. No client can keep it waiting:
no socket blocks, and a client that does not read is disconnected.
"""

from __future__ import annotations

import ipaddress
import math
import os
import queue
import selectors
import socket
import struct
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Self

from kinreach._checks import check_count, check_number, shown
from kinreach.deploy._controller import Controller
from kinreach.deploy._rtde import (
    HEADER,
    IN_USE,
    NOT_FOUND,
    PROTOCOL,
    RTDE_PORT,
    SCRIPT_PORT,
    Kind,
    Recipe,
    RobotMode,
    RuntimeState,
    SafetyMode,
    error_message,
    names_in,
    package,
    packages_in,
    type_of,
)
from kinreach.deploy._urscript import MAX_CHARACTERS, ScriptError
from kinreach.errors import InputError
from kinreach.kinematics import pose_vector
from kinreach.robots import ArmDescription, get_arm

#: The second port that takes scripts.
PRIMARY_PORT = 30001
#: Clients of a port, and bytes that may wait for one.
MAX_CLIENTS, MAX_WAITING = 32, 2**20
#: Largest delay behind real time that the simulation catches up with [s].
PATIENCE = 0.2
#: Messages on a script port: kind of the package, and kinds of messages in it.
ROBOT_MESSAGE, KEY, RUNTIME_EXCEPTION = 20, 7, 10
#: Versions that a CB3 and an e-Series controller answer with.
VERSIONS = {125: (3, 15, 8, 0), 500: (5, 12, 0, 0)}
#: `joint_mode` of a joint that runs, and of one without power.
JOINT_RUNNING, JOINT_POWER_OFF = 253, 239
#: Bits of `safety_status_bits`.
_SAFETY_BITS = {
    SafetyMode.NORMAL: 1, SafetyMode.PROTECTIVE_STOP: 1 << 2 | 1 << 10,
    SafetyMode.ROBOT_EMERGENCY_STOP: 1 << 6 | 1 << 7 | 1 << 10,
}  # fmt: skip

_OUTPUTS: Mapping[str, Callable[[Controller], Sequence[float]]] = {
    "timestamp": lambda ur: (ur.time,),
    "target_q": lambda ur: ur.target_q.tolist(),
    "target_qd": lambda ur: ur.target_qd.tolist(),
    "target_qdd": lambda ur: ur.target_qdd.tolist(),
    "actual_q": lambda ur: ur.actual_q.tolist(),
    "actual_qd": lambda ur: ur.actual_qd.tolist(),
    "actual_TCP_pose": lambda ur: ur.tcp_pose(ur.actual_q).tolist(),
    "actual_TCP_speed": lambda ur: ur.tcp_speed(ur.actual_q, ur.actual_qd).tolist(),
    "target_TCP_pose": lambda ur: ur.tcp_pose(ur.target_q).tolist(),
    "target_TCP_speed": lambda ur: ur.tcp_speed(ur.target_q, ur.target_qd).tolist(),
    "tcp_offset": lambda ur: pose_vector(ur.tcp).tolist(),
    "payload": lambda ur: (ur.payload,),
    "robot_mode": lambda ur: (ur.robot_mode,),
    "joint_mode": lambda ur: (JOINT_RUNNING if ur.robot_mode is RobotMode.RUNNING else JOINT_POWER_OFF,) * 6,
    "safety_mode": lambda ur: (ur.safety_mode,),
    "safety_status": lambda ur: (ur.safety_mode,),
    "safety_status_bits": lambda ur: (_SAFETY_BITS[ur.safety_mode],),
    "robot_status_bits": lambda ur: (
        (ur.robot_mode is RobotMode.RUNNING) + 2 * (ur.runtime_state is RuntimeState.PLAYING),
    ),
    "runtime_state": lambda ur: (ur.runtime_state,),
    "speed_scaling": lambda ur: (ur.speed_scaling,),
    "target_speed_fraction": lambda ur: (ur.speed_slider,),
}


class SimulatedUR:
    """A UR that is simulated in MuJoCo and answers on the ports of a real one, on this machine only.

    It is not URSim: RTDE (protocol 2) and the script port are served, not the dashboard; programs are those that
    kinreach writes. `ur_rtde`'s receive and I/O interfaces read it; its control interface needs a real robot or URSim.

    It runs in its own thread within `with`, or in the calling thread by `serve`.

    Args:
        arm: Name of a UR, or its description, with its calibration and tool.
        q: Start posture [rad], shape (6,); the arm's home by default.
        address: A loopback address, such as 127.0.0.2 for a second robot.
        rtde_port: 0 for a free one.
        script_port: As `rtde_port`. With 30002 port 30001 takes scripts, too.
        speed: How many times faster than real time.
        log: Called with each line of the controller's log, in the thread that serves.

    Attributes:
        arm, address: As given.
        rtde_port, script_port: In use.
        controller: The simulated controller. While the robot runs, only its thread may use it.

    Raises:
        UnknownNameError: There is no arm of that name.
        InputError: Not a UR, not a loopback address, a port that is in use, or a start posture that cannot be used.
    """

    def __init__(
        self,
        arm: str | ArmDescription,
        *,
        q: Sequence[float] | None = None,
        address: str = "127.0.0.1",
        rtde_port: int = RTDE_PORT,
        script_port: int = SCRIPT_PORT,
        speed: float = 1.0,
        log: Callable[[str], object] | None = None,
    ) -> None:
        self.arm, self.address = get_arm(arm), _loopback(address)
        for name, port in (("rtde_port", rtde_port), ("script_port", script_port)):
            check_count(name, port, least=0, most=65535)
        self.speed = check_number("speed", speed, above=0.0, most=1e6)
        self._tell = log
        self.controller = Controller(self.arm, q=q, log=self._log)
        self._selector = selectors.DefaultSelector()
        self._clients: list[_Client] = []
        self._stopping = threading.Event()
        self._requests: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()
        self._instead: dict[str, tuple[float, ...]] = {}
        self._thread: threading.Thread | None = None
        self._inputs_in_use: dict[str, _Client] = {}
        try:
            self.rtde_port = self._listen(rtde_port, _RtdeClient)
            self.script_port = self._listen(script_port, _ScriptClient)
            if script_port == SCRIPT_PORT:
                self._listen(PRIMARY_PORT, _ScriptClient)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        self._thread = threading.Thread(target=self.serve, name="simulated UR", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop, and close all connections and ports."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        for client in list(self._clients):
            self.drop(client)
        for key in list(self._selector.get_map().values()) if self._selector.get_map() else []:
            self._selector.unregister(key.fileobj)
            key.fileobj.close()  # type: ignore[union-attr]
        self._selector.close()

    def serve(self) -> None:
        """Run in this thread until `close` is called in another one, or Ctrl-C."""
        cycle = self.controller.cycle / self.speed
        due = time.monotonic()
        while not self._stopping.is_set():
            for key, events in self._selector.select(max(0.0, due - time.monotonic())):
                key.data(events)
            while not self._requests.empty():
                self._requests.get()()
            now = time.monotonic()
            if now >= due:
                self.controller.tick()
                self._publish()
                due = due + cycle if now - due < PATIENCE else now + cycle

    def release(self) -> None:
        """Release a stop; after a protective one the arm is put back to where the stopped program began."""
        self._requests.put(self.controller.release)

    def emergency_stop(self) -> None:
        """Press the emergency stop, until `release`: the program ends, the arm brakes, and its power is off."""
        self._requests.put(self.controller.emergency_stop)

    def pause(self) -> None:
        """Pause the program that runs, as on the pendant, until `resume`."""
        self._requests.put(self.controller.pause)

    def resume(self) -> None:
        """Let a paused program go on."""
        self._requests.put(self.controller.resume)

    def report(self, name: str, values: Sequence[float] | None) -> None:
        """Report something else than the truth, to try what a client does with it.

        Args:
            name: An output variable of RTDE, such as `actual_q` or `robot_mode`.
            values: All of its numbers, which may be NaN; None for the truth again.

        Raises:
            InputError: There is no such variable, or it has another number of values.
        """
        if (kind := type_of(name)) == NOT_FOUND:
            raise InputError(f"RTDE has no output variable {shown(name)}")
        if values is None:
            self._requests.put(lambda: self._instead.pop(name, None))
            return
        given = tuple(values)
        try:
            Recipe([name], [kind]).pack({name: given})
        except struct.error:
            raise InputError(f"the type of {name} is {kind}, got {shown(given)}") from None
        self._requests.put(lambda: self._instead.update({name: given}))

    def drop(self, client: _Client) -> None:
        """Close the connection of a client and forget it."""
        if client in self._clients:
            self._clients.remove(client)
            self._selector.unregister(client.socket)
            client.socket.close()
            self._inputs_in_use = {name: by for name, by in self._inputs_in_use.items() if by is not client}

    def watch(self, client: _Client, events: int) -> None:
        """Set the events that a client's socket is polled for."""
        self._selector.modify(client.socket, events, client.handle)

    def claim(self, names: Sequence[str], client: _Client) -> list[str]:
        """Return the types of inputs that a client wants to write; `IN_USE` for what another one writes."""
        types = [type_of(name, inputs=True) for name in names]
        types = [IN_USE if self._inputs_in_use.get(name, client) is not client else kind
                 for name, kind in zip(names, types, strict=True)]  # fmt: skip
        if not {IN_USE, NOT_FOUND} & set(types):
            self._inputs_in_use.update(dict.fromkeys(names, client))
        return types

    def set_inputs(self, values: Mapping[str, Sequence[float]]) -> None:
        """Set a client's inputs; only the speed slider has an effect."""
        if "speed_slider_fraction" in values and values.get("speed_slider_mask", (1,))[0]:
            fraction = values["speed_slider_fraction"][0]
            if not 0.0 <= fraction <= 1.0:  # NaN, too
                self._log(f"speed slider must be from 0 to 1, got {fraction:g}: it stays")
            elif fraction != self.controller.speed_slider:
                self.controller.speed_slider = fraction
                self._log(f"speed slider at {100 * fraction:.0f} %")

    def run_script(self, text: str) -> None:
        """Run a script; if it is refused, send the reason to the clients of the script ports."""
        try:
            self.controller.start(text)
        except ScriptError as error:
            self._tell_clients(RUNTIME_EXCEPTION, struct.pack(">ii", error.line, 1), str(error))
        except InputError as error:
            self._log(str(error))
            self._tell_clients(RUNTIME_EXCEPTION, struct.pack(">ii", 1, 1), str(error))

    def _log(self, text: str) -> None:
        if self._tell is not None:
            self._tell(text)
        if text.startswith(("protective stop:", "emergency stop:")):
            title = text.partition(":")[0].capitalize().encode()
            self._tell_clients(KEY, struct.pack(">iiB", 0, 0, len(title)) + title, text)
        elif text.startswith("program stopped:"):
            self._tell_clients(RUNTIME_EXCEPTION, struct.pack(">ii", 1, 1), text)

    def _tell_clients(self, kind: int, head: bytes, text: str) -> None:
        stamp = struct.pack(">QbB", int(1e6 * self.controller.time), -1, kind)
        body = bytes([ROBOT_MESSAGE]) + stamp + head + text.encode("utf-8", "replace")[:2000]
        for client in list(self._clients):
            if isinstance(client, _ScriptClient):
                client.send(struct.pack(">i", 4 + len(body)) + body)

    def _listen(self, port: int, kind: type[_Client]) -> int:
        try:
            server = socket.create_server((self.address, port), backlog=MAX_CLIENTS)
        except OSError as error:
            raise InputError(
                f"cannot serve at {self.address}:{port}: {os.strerror(error.errno or 0)}; if another robot or URSim "
                "is there, give another address of this machine, such as 127.0.0.2, or other ports"
            ) from None
        server.setblocking(False)

        def accept(_: int) -> None:
            try:
                connection, _address = server.accept()
            except OSError:  # it has gone already
                return
            if sum(isinstance(client, kind) for client in self._clients) >= MAX_CLIENTS:
                self._log(f"a client is refused: port {port} has {MAX_CLIENTS} already")
                connection.close()
                return
            connection.setblocking(False)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            client = kind(self, connection)
            self._clients.append(client)
            self._selector.register(connection, selectors.EVENT_READ, client.handle)

        self._selector.register(server, selectors.EVENT_READ, accept)
        return int(server.getsockname()[1])

    def _publish(self) -> None:
        ur, values = self.controller, dict[str, Sequence[float]](self._instead)
        due = [client for client in self._clients if isinstance(client, _RtdeClient) and client.is_due(ur.time)]
        for client in due:
            for name in client.outputs.names:
                if name not in values:
                    values[name] = output(ur, name)
        for client in due:
            client.send(package(Kind.DATA, bytes([1]) + client.outputs.pack(values)))


def output(ur: Controller, name: str) -> Sequence[float]:
    if name in _OUTPUTS:
        return _OUTPUTS[name](ur)
    if name.startswith("output_int_register_"):
        return (ur.registers.get(int(name.rpartition("_")[2]), 0),)
    return ()


class _Client:
    """A connection with buffers for what was received and what has to be sent."""

    def __init__(self, robot: SimulatedUR, connection: socket.socket) -> None:
        self.robot, self.socket = robot, connection
        self.received, self.waiting = bytearray(), bytearray()

    def handle(self, events: int) -> None:
        if events & selectors.EVENT_WRITE:
            self.send(b"")
        if events & selectors.EVENT_READ:
            try:
                data = self.socket.recv(65536)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if not data:
                self.robot.drop(self)
                return
            self.received += data
            try:
                self.take()
            except InputError as error:
                self.refuse(str(error))
                self.robot.drop(self)

    def send(self, data: bytes) -> None:
        """Send now or later; disconnect a client that does not read."""
        had = bool(self.waiting)
        self.waiting += data
        try:
            del self.waiting[: self.socket.send(self.waiting)]
        except BlockingIOError:
            pass
        except OSError:
            self.robot.drop(self)
            return
        if len(self.waiting) > MAX_WAITING:
            self.robot._log("a client is disconnected: it does not read")
            self.robot.drop(self)
        elif bool(self.waiting) != had:
            self.robot.watch(self, selectors.EVENT_READ | (selectors.EVENT_WRITE if self.waiting else 0))

    def take(self) -> None:
        """Process the complete parts of `received`."""
        raise NotImplementedError

    def refuse(self, why: str) -> None:
        """Report why the connection ends."""
        self.robot._log(f"a client is disconnected: {why}")


class _RtdeClient(_Client):
    def __init__(self, robot: SimulatedUR, connection: socket.socket) -> None:
        super().__init__(robot, connection)
        self.protocol = 1
        self.outputs = Recipe((), ())
        self.period, self.due = math.inf, math.inf
        self.inputs: list[Recipe] = []

    def is_due(self, now: float) -> bool:
        if now < self.due - 1e-9:
            return False
        self.due = (self.due if self.due > now - self.period else now) + self.period
        return True

    def refuse(self, why: str) -> None:
        super().refuse(why)
        self.send(error_message(why))

    def take(self) -> None:
        for kind, payload in packages_in(self.received):
            if kind == Kind.PROTOCOL_VERSION:
                (wanted,) = _unpacked(">H", payload)
                self.protocol = PROTOCOL if wanted == PROTOCOL else self.protocol
                self.send(package(Kind.PROTOCOL_VERSION, bytes([wanted == PROTOCOL])))
            elif kind == Kind.CONTROLLER_VERSION:
                rate = round(1.0 / self.robot.controller.cycle)
                self.send(package(Kind.CONTROLLER_VERSION, struct.pack(">4I", *VERSIONS[rate])))
            elif kind == Kind.TEXT_MESSAGE:
                self.robot._log(f"a client says: {shown(payload[1:-1].decode('ascii', 'replace'))}")
            elif self.protocol != PROTOCOL:
                raise InputError(f"RTDE protocol {PROTOCOL} is served: ask for it first")
            elif kind == Kind.SETUP_OUTPUTS:
                self.set_up_outputs(payload)
            elif kind == Kind.SETUP_INPUTS:
                self.set_up_inputs(payload)
            elif kind == Kind.DATA:
                self.take_inputs(payload)
            elif kind in (Kind.START, Kind.PAUSE):
                accepted = bool(self.outputs.names) or bool(self.inputs) or kind == Kind.PAUSE
                self.due = -math.inf if kind == Kind.START and self.outputs.names else math.inf
                self.send(package(Kind(kind), bytes([accepted])))
            else:
                raise InputError(f"RTDE has no package of kind {kind}")

    def set_up_outputs(self, payload: bytes) -> None:
        most = round(1.0 / self.robot.controller.cycle)
        (frequency,) = _unpacked(">d", payload[:8])
        if not 1.0 <= frequency <= most:
            raise InputError(f"the frequency of RTDE must be from 1 to {most} Hz, got {frequency:g}")
        names = names_in(payload[8:])
        types = [type_of(name) for name in names]
        accepted = bool(names) and NOT_FOUND not in types
        self.due = math.inf
        self.outputs = Recipe(names, types) if accepted else Recipe((), ())
        self.period = 1.0 / frequency
        self.send(package(Kind.SETUP_OUTPUTS, bytes([accepted]) + ",".join(types).encode()))

    def set_up_inputs(self, payload: bytes) -> None:
        """Take a recipe of inputs; its number goes back."""
        names = names_in(payload)
        types = self.robot.claim(names, self)
        accepted = bool(names) and not {IN_USE, NOT_FOUND} & set(types) and len(self.inputs) < 255
        if accepted:
            self.inputs.append(Recipe(names, types))
        self.send(package(Kind.SETUP_INPUTS, bytes([len(self.inputs) if accepted else 0]) + ",".join(types).encode()))

    def take_inputs(self, payload: bytes) -> None:
        number = payload[0] if payload else 0
        if not 1 <= number <= len(self.inputs):
            raise InputError(f"there is no input recipe {number}")
        self.robot.set_inputs(self.inputs[number - 1].unpack(payload[1:]))


class _ScriptClient(_Client):
    """A client of a script port: a program is one line, or all lines from `def` to an `end` that is not indented."""

    def __init__(self, robot: SimulatedUR, connection: socket.socket) -> None:
        super().__init__(robot, connection)
        self.lines: list[str] = []
        self.size = 0

    def take(self) -> None:
        *lines, rest = bytes(self.received).split(b"\n") if b"\n" in self.received else [bytes(self.received)]
        self.received = bytearray(rest)
        for line in lines:
            self.take_line(line)
        if self.size + len(self.received) > MAX_CHARACTERS:
            raise InputError(f"a program may have {MAX_CHARACTERS} bytes")

    def take_line(self, line: bytes) -> None:
        """Add a line to the program, and run it if it is complete."""
        text = line.decode("utf-8", "replace").rstrip()
        if not self.lines and not text:
            return
        self.lines.append(text)
        self.size += len(line) + 1
        if not self.lines[0].startswith("def ") or text == "end":
            program, self.lines, self.size = "\n".join(self.lines), [], 0
            self.robot.run_script(program)


def _unpacked(form: str, payload: bytes) -> tuple[Any, ...]:
    if len(payload) != struct.calcsize(form):
        raise InputError(f"an RTDE package has {HEADER.size + len(payload)} bytes, too few or too many for its kind")
    return struct.unpack(form, payload)


def _loopback(address: object) -> str:
    """Return a loopback address of this machine; refuse others, so that nobody else can move the robot."""
    try:
        given = ipaddress.IPv4Address("127.0.0.1" if address == "localhost" else address)
    except ValueError:
        raise InputError(f"address must be one of this machine, such as 127.0.0.1, got {shown(address)}") from None
    if not given.is_loopback:
        raise InputError(f"address must be one of this machine alone, 127.0.0.1 to 127.255.255.254, got {given}")
    return str(given)
