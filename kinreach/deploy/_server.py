"""A simulated UR on this machine: RTDE, the dashboard and the script ports of a simulated controller.

One thread reads from the clients, lets a control cycle pass when it is due, and sends. No client can keep it waiting:
no socket blocks, what clients want is done in small parts between the cycles, and what waits for a client or from it is
bounded. A client that sends what is not for its port, does not read, or never comes to an end is disconnected.
"""

from __future__ import annotations

import ipaddress
import math
import os
import queue
import re
import selectors
import socket
import struct
import threading
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from time import monotonic
from typing import Any, Self

import numpy as np

from kinreach._checks import check_count, check_number, printable, shown
from kinreach._rotations import quick_pose_vector
from kinreach.deploy._controller import MAX_DEVIATION, Controller
from kinreach.deploy._dashboard import DASHBOARD_PORT, FAREWELLS, GREETING, answer, not_understood
from kinreach.deploy._model import DhFigures
from kinreach.deploy._primary import (
    KEY,
    PRIMARY_PORT,
    RUNTIME_EXCEPTION,
    STARTED,
    STOPPED,
    Message,
    figures_package,
    message_package,
)
from kinreach.deploy._robot_state import STATE_PERIOD, real_time_state, state
from kinreach.deploy._rtde import (
    HEADER,
    IN_USE,
    JOINT_MODES,
    MAX_NAMES,
    NOT_FOUND,
    PROTOCOL,
    REAL_TIME_PORT,
    RTDE_PORT,
    SCRIPT_PORT,
    VERSIONS,
    Kind,
    RobotMode,
    RtdeRecipe,
    RuntimeState,
    SafetyMode,
    error_message,
    names_in,
    package,
    packages_in,
    type_of,
)
from kinreach.deploy._script_tree import ScriptError
from kinreach.deploy._urscript import MAX_CHARACTERS, MAX_LINE
from kinreach.errors import InputError
from kinreach.robots import ArmDescription, get_arm

#: Clients of a port, bytes that may wait for one, and unfinished programs of all of them [bytes].
MAX_CLIENTS, MAX_WAITING, MAX_UNFINISHED = 32, 2**20, 2 * MAX_CHARACTERS
#: Bytes that are read from a client at a time, and packages or lines that are taken from it before the next one.
READ, PACKAGES, LINES = 2**14, 16, 100
#: How long a program or a package may be unfinished, how long a client may be silent where others wait for its place,
#: and the time between two looks for such clients [s].
UNFINISHED, SILENT, SWEEP = 30.0, 5.0, 0.1
#: Longest program that has its first control cycle before another is taken; a longer one yields to what comes while
#: it is read [characters].
SHORT = 20_000
#: Longest command of the dashboard [bytes].
MAX_COMMAND = 1000
#: Lines of the log that are a client's.
MAX_SAYINGS = 20
#: Largest delay behind real time that the simulation catches up with [s].
PATIENCE = 0.2
#: Bits of `safety_status_bits`.
_SAFETY_BITS = {
    SafetyMode.NORMAL: 1, SafetyMode.PROTECTIVE_STOP: 1 << 2 | 1 << 10,
    SafetyMode.ROBOT_EMERGENCY_STOP: 1 << 6 | 1 << 7 | 1 << 10,
}  # fmt: skip

#: Packages that a client may send, with their least and largest sizes [bytes].
_SIZES: Mapping[int, tuple[int, int]] = {
    Kind.PROTOCOL_VERSION: (5, 5), Kind.CONTROLLER_VERSION: (3, 3), Kind.START: (3, 3), Kind.PAUSE: (3, 3),
    Kind.TEXT_MESSAGE: (3, 1024), Kind.SETUP_OUTPUTS: (11, 11 + MAX_NAMES), Kind.SETUP_INPUTS: (3, 3 + MAX_NAMES),
    Kind.DATA: (3, 2**14),
}  # fmt: skip
#: What the first line of a program looks like, and bytes that no program has.
_FIRST = re.compile(
    rb"\s*(#|\$|[A-Za-z_]\w*\s*[(=]|set\s+(sim|real)\b"
    rb"|(def|sec|thread|global|local|if|while|for|halt|return|sync|pause|end|run)\b)"
)
#: Words that begin a program of several lines, and a definition that has arguments.
_DEFINITIONS = (b"def ", b"sec ", b"def\t", b"sec\t")
_DEFINED, _CALLED = re.compile(rb"\s*def\s+(\w+)"), re.compile(rb"\s*(\w+)\s*\(\s*\)")
_ARGUMENTS = re.compile(rb"\s*(?:def|sec)\s+(\w+)\s*\(\s*[A-Za-z_]")
_CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1f\x7f]")

#: A register: direction, type, the first of 32 bits, or its number.
_REGISTER = re.compile(r"(input|output)_(bit|int|double)_registers?_?(?:(0|32)_to_\d+|(\d+))")

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
    "tcp_offset": lambda ur: quick_pose_vector(ur.tcp),
    "payload": lambda ur: (ur.payload,),
    "payload_cog": lambda ur: ur.centre_of_mass,
    "payload_inertia": lambda ur: ur.inertia,
    "target_gravity": lambda ur: ur.gravity,
    "control_step": lambda ur: (round(ur.time / ur.cycle),),
    "joint_position_deviation_ratio": lambda ur: (deviation(ur),),
    "actual_digital_output_bits": lambda ur: (ur.io.digital,),
    "actual_configurable_digital_output_bits": lambda ur: (ur.io.digital >> 8 & 255,),
    "standard_analog_output0": lambda ur: (ur.io.analog[0],),
    "standard_analog_output1": lambda ur: (ur.io.analog[1],),
    "tool_output_voltage": lambda ur: (ur.io.tool_voltage,),
    "robot_mode": lambda ur: (ur.robot_mode,),
    "joint_mode": lambda ur: (JOINT_MODES[ur.robot_mode],) * 6,
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

    It is not URSim: programs are URScript without sockets and forces, and the dashboard has no program to load.
    `ur_rtde`'s interfaces read and control it: start it in a process of its own, as `kinreach simulate-ur`, because
    they hold Python's lock while they connect.

    It runs in its own thread within `with`, or in the calling thread by `serve`.

    Args:
        arm: Name of a UR, or its description, with its calibration and tool.
        q: Start posture [rad], shape (6,); the arm's home by default.
        address: A loopback address, such as 127.0.0.2 for a second robot.
        rtde_port: 0 for a free one.
        script_port: As `rtde_port`. With 30002 ports 30001 and 30003 take scripts, too, and the dashboard is on 29999;
            with another one the dashboard and the real-time interface are on free ports.
        speed: How many times faster than real time.
        log: Called with each line of the controller's log, in the thread that serves: it must return at once.

    Attributes:
        arm, address: As given.
        rtde_port, script_port, dashboard_port, real_time_port: In use.
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
        self._announced: str | None = None
        figures = DhFigures.of(self.controller.kinematics)
        self.greeting = b"" if figures is None else figures_package(figures)
        self._next_state = 0.0
        self._selector = selectors.DefaultSelector()
        self._clients: list[_Client] = []
        self._stopping = threading.Event()
        self._requests: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()
        self._instead: dict[str, tuple[float, ...]] = {}
        self._thread: threading.Thread | None = None
        self._inputs_in_use: dict[str, _Client] = {}
        self._busy: dict[_Client, None] = {}  # in their order; they have sent what has not been taken yet
        self._starting: Generator[None, None, None] | None = None
        self._is_short = False
        self._due = self._next_sweep = 0.0
        try:
            self.rtde_port = self._listen(rtde_port, _RtdeClient)
            self.script_port = self._listen(script_port, _ScriptClient)
            are_usual = script_port == SCRIPT_PORT
            if are_usual:
                self._listen(PRIMARY_PORT, _ScriptClient)
            self.real_time_port = self._listen(REAL_TIME_PORT if are_usual else 0, _RealTimeClient)
            self.dashboard_port = self._listen(DASHBOARD_PORT if are_usual else 0, _DashboardClient)
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
        self._due = monotonic()
        while not self._stopping.is_set():
            has_work = self._busy or self._starting is not None
            for key, events in self._selector.select(0.0 if has_work else max(0.0, self._due - monotonic())):
                key.data(events)
                self._tick_when_due()
            while not self._requests.empty():
                self._requests.get()()
            for client in list(self._busy):
                client.work()
                self._tick_when_due()
            self._go_on_starting()
            self._tick_when_due()

    def _tick_when_due(self) -> None:
        """Let a control cycle pass if it is time for it."""
        if (now := monotonic()) < self._due:
            return
        cycle = self.controller.cycle / self.speed
        self.controller.tick()
        self._announce()
        self._publish()
        self._due = self._due + cycle if now - self._due < PATIENCE else now + cycle
        if now >= self._next_sweep:
            self._next_sweep = now + SWEEP
            for client in [client for client in self._clients if now - client.unfinished_since > UNFINISHED]:
                client.dismiss(f"what it sends has not come to an end within {UNFINISHED:g} s")

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
            RtdeRecipe([name], [kind]).pack({name: given})
        except struct.error:
            raise InputError(f"the type of {name} is {kind}, got {shown(given)}") from None
        self._requests.put(lambda: self._instead.update({name: given}))

    def drop(self, client: _Client) -> None:
        """Close the connection of a client and forget it."""
        if client in self._clients:
            self._clients.remove(client)
            self._busy.pop(client, None)
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
        """Set a client's inputs: the speed slider, outputs by their masks, and registers."""
        ur = self.controller
        for kind, first in (("standard_", 0), ("configurable_", 8), ("tool_", 16)):
            mask, bits = (int(values.get(f"{kind}digital_output{end}", (0,))[0]) for end in ("_mask", ""))
            for bit in range(8):
                if mask >> bit & 1:
                    ur.io.set_digital(first + bit, is_on=bool(bits >> bit & 1))
        for output in range(2):
            share = values.get(f"standard_analog_output_{output}", (math.nan,))[0]
            if int(values.get("standard_analog_output_mask", (0,))[0]) >> output & 1 and 0.0 <= share <= 1.0:
                ur.io.analog[output] = share
        for name, given in values.items():
            set_register(ur, name, given[0])
        if "speed_slider_fraction" in values and values.get("speed_slider_mask", (1,))[0]:
            fraction = values["speed_slider_fraction"][0]
            if not 0.0 <= fraction <= 1.0:  # NaN, too
                self._log(f"speed slider must be from 0 to 1, got {fraction:g}: it stays")
            elif fraction != self.controller.speed_slider:
                self.controller.speed_slider = fraction
                self._log(f"speed slider at {100 * fraction:.0f} %")

    def run_script(self, text: str) -> None:
        """Run a script; if it is refused, send the reason to the clients of the script ports."""
        self._starting, self._is_short = self.controller.starting(text), len(text) <= SHORT
        self._go_on_starting()

    @property
    def _is_starting(self) -> bool:
        """Whether the last program, unless it is long, waits for its first control cycle."""
        return self.controller.is_fresh or (self._starting is not None and self._is_short)

    def _go_on_starting(self) -> None:
        """Read a part of the program that was sent last, for at most half a control cycle."""
        until = monotonic() + self.controller.cycle / 2.0
        while self._starting is not None:
            try:
                next(self._starting)
            except StopIteration:
                self._starting = None
            except InputError as error:
                self._starting = None
                if not isinstance(error, ScriptError):  # the controller has not said it
                    self._log(str(error))
                line = error.line if isinstance(error, ScriptError) else 1
                self._tell_clients(Message(RUNTIME_EXCEPTION, "", str(error)), line=line)
            if monotonic() > until:
                break
        self._announce()

    def mark(self, client: _Client, *, busy: bool) -> None:
        """Note whether a client has sent what can be taken and has not been taken yet."""
        if busy and client in self._clients:
            self._busy[client] = None
        else:
            self._busy.pop(client, None)

    def check_unfinished(self) -> None:
        """Dismiss the client with the longest unfinished program if all of them together are too long."""
        clients = [client for client in self._clients if isinstance(client, _ScriptClient)]
        if sum(len(client.program) for client in clients) > MAX_UNFINISHED:
            max(clients, key=lambda client: len(client.program)).dismiss("the unfinished programs are too long")

    def _log(self, text: str) -> None:
        if self._tell is not None:
            self._tell(text)
        if text.startswith(("protective stop:", "emergency stop:")):
            self._tell_clients(Message(KEY, text.partition(":")[0].capitalize(), text))
        elif text.startswith("program stopped:"):
            self._tell_clients(Message(RUNTIME_EXCEPTION, "", text))

    def _announce(self) -> None:
        """Tell the clients of the script ports which program has ended and which has begun, by their names."""
        name = self.controller.program_name
        if name is not self._announced:
            for title, program in ((STOPPED, self._announced), (STARTED, name)):
                if program is not None:
                    self._tell_clients(Message(KEY, title, program))
            self._announced = name

    def _tell_clients(self, message: Message, *, line: int = 1) -> None:
        data = message_package(message, self.controller.time, line=line)
        for client in list(self._clients):
            if type(client) is _ScriptClient:
                client.send(data)

    def _listen(self, port: int, kind: type[_Client]) -> int:
        try:
            server = socket.create_server((self.address, port), backlog=MAX_CLIENTS)
        except OSError as error:
            raise InputError(
                f"cannot serve at {self.address}:{port}: {os.strerror(error.errno or 0)}; if another robot or URSim "
                "is there, give another address of this machine, such as 127.0.0.2, or other ports"
            ) from None
        server.setblocking(False)

        number, turned_away = int(server.getsockname()[1]), False

        def accept(_: int) -> None:
            nonlocal turned_away
            for _ in range(MAX_CLIENTS):
                try:
                    connection, _address = server.accept()
                except OSError:  # nobody more, or it has gone already
                    return
                if self._has_room(kind):
                    self._welcome(kind(self, connection))
                    turned_away = False
                    continue
                connection.close()
                if not turned_away:  # one line for all that come now
                    self._log(f"a client is refused: port {number} has {MAX_CLIENTS} already")
                turned_away = True

        self._selector.register(server, selectors.EVENT_READ, accept)
        return number

    def _welcome(self, client: _Client) -> None:
        client.socket.setblocking(False)
        with suppress(OSError):  # it has gone already
            client.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._clients.append(client)
        self._selector.register(client.socket, selectors.EVENT_READ, client.handle)
        client.greet()

    def _has_room(self, kind: type[_Client]) -> bool:
        """Return whether another client may come, if need be instead of the last one that only keeps a place."""
        clients = [client for client in self._clients if type(client) is kind]
        if len(clients) < MAX_CLIENTS:
            return True
        silent = [client for client in clients if not client.has_spoken and monotonic() - client.since > SILENT]
        if silent:
            silent[-1].dismiss("it says nothing, and another one needs its place")
        return bool(silent)

    def _publish(self) -> None:
        ur, values = self.controller, dict[str, Sequence[float]](self._instead)
        due = [client for client in self._clients if isinstance(client, _RtdeClient) and client.is_due(ur.time)]
        for client in due:
            for name in client.outputs.names:
                if name not in values:
                    values[name] = output(ur, name)
        for client in due:
            client.send(package(Kind.DATA, bytes([1]) + client.outputs.pack(values)))
        if (now := monotonic()) >= self._next_state:  # in real time: clients wait for a state for half a second
            self._next_state = now + STATE_PERIOD
            self._stream(_ScriptClient, state)
        self._stream(_RealTimeClient, real_time_state)

    def _stream(self, kind: type[_ScriptClient], state_of: Callable[[Controller], bytes]) -> None:
        """Send the state to the clients of a port that have read all that they got, as far as this is known here."""
        if clients := [
            client for client in self._clients if type(client) is kind and not (client.waiting or client.has_gone)
        ]:
            data = state_of(self.controller)
            for client in clients:
                client.send(data)


def output(ur: Controller, name: str) -> Sequence[float]:
    if name in _OUTPUTS:
        return _OUTPUTS[name](ur)
    return register(ur, name)


def deviation(ur: Controller) -> float:
    """Return how far the arm is from its target, as a part of what stops it."""
    return float(np.abs(ur.target_q - ur.actual_q).max()) / MAX_DEVIATION


@cache
def _register_parts(name: str) -> tuple[Any, ...]:
    """Return what the name of a register says; only names that RTDE has come here."""
    return found.groups() if (found := _REGISTER.fullmatch(name)) else ()


def register(ur: Controller, name: str) -> Sequence[float]:
    """Return the value of a general purpose register, nothing for another name."""
    if not (found := _register_parts(name)):
        return ()
    way, kind, first, number = found
    if kind == "bit" and first is not None:  # 32 of them
        bits = ur.io.booleans if way == "output" else ur.io.given_booleans
        return (sum(bits.get(int(first) + bit, False) << bit for bit in range(32)),)
    tables: Mapping[tuple[str, str], Mapping[int, float]] = {
        ("output", "int"): ur.registers, ("output", "double"): ur.io.floats, ("output", "bit"): ur.io.booleans,
        ("input", "int"): ur.io.given_integers, ("input", "double"): ur.io.given_floats,
        ("input", "bit"): ur.io.given_booleans,
    }  # fmt: skip
    return (tables[way, kind].get(int(number), 0),)


def set_register(ur: Controller, name: str, value: float) -> None:
    """Set a general purpose input register that a client writes; other names are left alone."""
    if not (found := _register_parts(name)):
        return
    _, kind, first, number = found
    if first is not None:
        ur.io.given_booleans.update({int(first) + bit: bool(int(value) >> bit & 1) for bit in range(32)})
    elif kind == "bit":
        ur.io.given_booleans[int(number)] = bool(value)
    elif kind == "int":
        ur.io.given_integers[int(number)] = int(value)
    else:
        ur.io.given_floats[int(number)] = value


class _Client:
    """A connection with buffers for what was received and what has to be sent.

    Attributes:
        since: When it was made [s].
        has_spoken: Whether it has sent something complete.
        has_gone: Whether nothing can be sent to it any more.
        unfinished_since: When it began with what is not complete yet [s]; infinity if there is no such thing.
    """

    def __init__(self, robot: SimulatedUR, connection: socket.socket) -> None:
        self.robot, self.socket = robot, connection
        self.received, self.waiting = bytearray(), bytearray()
        self.since, self.unfinished_since = monotonic(), math.inf
        self.has_spoken, self.has_gone, self.sayings = False, False, 0

    def greet(self) -> None:
        """Send what a client gets on connecting."""

    def handle(self, events: int) -> None:
        if events & selectors.EVENT_WRITE:
            self.send(b"")
        if events & selectors.EVENT_READ and self not in self.robot._busy:
            try:
                data = self.socket.recv(READ)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if not data:
                self.robot.drop(self)
                return
            self.received += data
            self.robot.mark(self, busy=True)

    def work(self) -> None:
        """Process a part of what was received."""
        if self not in self.robot._clients:  # another one's work ended it
            return
        try:
            more = self.take()
        except InputError as error:
            self.dismiss(str(error))
            return
        if not self.is_unfinished():
            self.unfinished_since = math.inf
        elif self.unfinished_since == math.inf:
            self.unfinished_since = monotonic()
        self.robot.mark(self, busy=more)

    def send(self, data: bytes) -> None:
        """Send now or later; disconnect a client that does not read.

        One that has closed its connection is read to the end first: many send a program and close.
        """
        if self.has_gone:
            return
        had = bool(self.waiting)
        self.waiting += data
        try:
            del self.waiting[: self.socket.send(self.waiting)]
        except BlockingIOError:
            pass
        except OSError:
            self.has_gone = True
            self.waiting.clear()
        if len(self.waiting) > MAX_WAITING:
            self.robot._log("a client is disconnected: it does not read")
            self.robot.drop(self)
        elif bool(self.waiting) != had:
            self.robot.watch(self, selectors.EVENT_READ | (selectors.EVENT_WRITE if self.waiting else 0))

    def take(self) -> bool:
        """Process a few complete parts of `received`; return whether there may be more."""
        raise NotImplementedError

    def is_unfinished(self) -> bool:
        """Return whether there is a part that is not complete."""
        return bool(self.received)

    def dismiss(self, why: str) -> None:
        """End the connection, and report why."""
        self.robot._log(f"a client is disconnected: {why}")
        self.send(self.farewell(why))
        self.robot.drop(self)

    def farewell(self, why: str) -> bytes:
        """Return the last message to the client."""
        raise NotImplementedError

    def hear(self, text: str) -> None:
        """Put a text of the client into the log, unless there are many of them."""
        self.sayings += 1
        if self.sayings <= MAX_SAYINGS:
            self.robot._log(f"a client says: {shown(text)}")
        elif self.sayings == MAX_SAYINGS + 1:
            self.robot._log("a client says more, which is left out")


class _RtdeClient(_Client):
    def __init__(self, robot: SimulatedUR, connection: socket.socket) -> None:
        super().__init__(robot, connection)
        self.protocol = 1
        self.outputs = RtdeRecipe((), ())
        self.period, self.due = math.inf, math.inf
        self.inputs: list[RtdeRecipe] = []

    def is_due(self, now: float) -> bool:
        if now < self.due - 1e-9:
            return False
        self.due = (self.due if self.due > now - self.period else now) + self.period
        return True

    def farewell(self, why: str) -> bytes:
        return error_message(why)

    def take(self) -> bool:
        for taken, (kind, payload) in enumerate(packages_in(self.received, _SIZES), start=1):
            self.process(kind, payload)
            self.has_spoken, self.unfinished_since = True, math.inf
            if taken == PACKAGES:
                return True
        return False

    def process(self, kind: int, payload: bytes) -> None:
        if kind == Kind.PROTOCOL_VERSION:
            (wanted,) = _unpacked(">H", payload)
            self.protocol = PROTOCOL if wanted == PROTOCOL else self.protocol
            self.send(package(Kind.PROTOCOL_VERSION, bytes([wanted == PROTOCOL])))
        elif kind == Kind.CONTROLLER_VERSION:
            version = VERSIONS[self.robot.controller.rate]
            self.send(package(Kind.CONTROLLER_VERSION, struct.pack(">4I", *version)))
        elif kind == Kind.TEXT_MESSAGE:
            self.hear(payload[1:-1].decode("ascii", "replace"))
        elif self.protocol != PROTOCOL:
            raise InputError(f"RTDE protocol {PROTOCOL} is served: ask for it first")
        elif kind == Kind.SETUP_OUTPUTS:
            self.set_up_outputs(payload)
        elif kind == Kind.SETUP_INPUTS:
            self.set_up_inputs(payload)
        elif kind == Kind.DATA:
            self.take_inputs(payload)
        else:  # START or PAUSE
            accepted = bool(self.outputs.names) or bool(self.inputs) or kind == Kind.PAUSE
            self.due = -math.inf if kind == Kind.START and self.outputs.names else math.inf
            self.send(package(Kind(kind), bytes([accepted])))

    def set_up_outputs(self, payload: bytes) -> None:
        most = self.robot.controller.rate
        (frequency,) = _unpacked(">d", payload[:8])
        if not 1.0 <= frequency <= most:
            raise InputError(f"the frequency of RTDE must be from 1 to {most} Hz, got {frequency:g}")
        names = names_in(payload[8:])
        types = [type_of(name) for name in names]
        accepted = bool(names) and NOT_FOUND not in types
        self.due = math.inf
        self.outputs = RtdeRecipe(names, types) if accepted else RtdeRecipe((), ())
        self.period = 1.0 / frequency
        self.send(package(Kind.SETUP_OUTPUTS, bytes([accepted]) + ",".join(types).encode()))

    def set_up_inputs(self, payload: bytes) -> None:
        """Take a recipe of inputs; its number goes back."""
        names = names_in(payload)
        types = self.robot.claim(names, self)
        accepted = bool(names) and not {IN_USE, NOT_FOUND} & set(types) and len(self.inputs) < 255
        if accepted:
            self.inputs.append(RtdeRecipe(names, types))
        self.send(package(Kind.SETUP_INPUTS, bytes([len(self.inputs) if accepted else 0]) + ",".join(types).encode()))

    def take_inputs(self, payload: bytes) -> None:
        number = payload[0] if payload else 0
        if not 1 <= number <= len(self.inputs):
            raise InputError(f"there is no input recipe {number}")
        self.robot.set_inputs(self.inputs[number - 1].unpack(payload[1:]))


class _ScriptClient(_Client):
    """A client of a script port: a program is one line, or all lines from `def` to an `end` that is not indented.

    What is no text, or does not begin as a program does, ends the connection: a web page can send to this port, and its
    browser puts a line of HTTP first.
    """

    def __init__(self, robot: SimulatedUR, connection: socket.socket) -> None:
        super().__init__(robot, connection)
        self.program, self.defined = bytearray(), b""

    def farewell(self, why: str) -> bytes:
        return message_package(Message(RUNTIME_EXCEPTION, "", f"line 1: {why}"), self.robot.controller.time)

    def greet(self) -> None:
        self.send(self.robot.greeting)

    def is_unfinished(self) -> bool:
        return bool(self.received or self.program)

    def take(self) -> bool:
        for _ in range(LINES):
            end = self.received.find(b"\n")
            if end < 0:
                if len(self.received) > MAX_LINE:
                    raise InputError(f"a line may have {MAX_LINE} bytes")
                return False
            if self.robot._is_starting:
                return True
            line = bytes(self.received[:end])
            del self.received[: end + 1]
            if self.take_line(line.rstrip()):
                break
        return True

    def take_line(self, line: bytes) -> bool:
        """Add a line to the program, and run it if it is complete; return whether it is."""
        if len(line) > MAX_LINE:
            raise InputError(f"a line may have {MAX_LINE} bytes, got {len(line)}")
        if _CONTROL.search(line):
            raise InputError(f"what it sends is no text: {shown(line[:40])}")
        if not self.program and not line:
            return False
        if not self.has_spoken and not self.program and not _FIRST.match(line):
            raise InputError(f"what it sends is not URScript: {shown(line[:40].decode('utf-8', 'replace'))}")
        if not self.program and line.lstrip().startswith(b"#"):
            return False
        if not self.program and (called := _CALLED.fullmatch(line)) and called[1] == self.defined:
            return False  # who defines a program and calls it means the one that runs already
        self.program += line + b"\n"
        if len(self.program) > MAX_CHARACTERS:
            raise InputError(f"a program may have {MAX_CHARACTERS} bytes")
        if self.is_complete(line):
            program, self.program = self.program, bytearray()
            defined = _DEFINED.match(program)
            self.defined = b"" if defined is None else defined[1]
            self.has_spoken, self.unfinished_since = True, math.inf
            self.robot.run_script(program[:-1].decode("utf-8", "replace"))
            return True
        if len(self.program) % READ < len(line) + 1:
            self.robot.check_unfinished()
        return False

    def is_complete(self, line: bytes) -> bool:
        """Return whether a program ends with this line, its last one until now.

        A function with arguments is no program before it is called, in the next line.
        """
        if line == b"end":
            return _ARGUMENTS.match(self.program) is None
        called = _ARGUMENTS.match(self.program)
        if called is not None:
            return b"\nend\n" in self.program and line.startswith(called[1] + b"(")
        return not self.program.lstrip().startswith(_DEFINITIONS)


class _RealTimeClient(_ScriptClient):
    """A client of the real-time interface: it hears the state in every control cycle, and no messages."""

    def farewell(self, why: str) -> bytes:
        return b""

    def greet(self) -> None:
        """It begins with the next state."""


class _DashboardClient(_Client):
    """A client of the dashboard. If its first line is no command, its connection ends, as on the script ports."""

    def greet(self) -> None:
        self.tell(GREETING)

    def tell(self, text: str) -> None:
        self.send(f"{text}\n".encode())

    def farewell(self, why: str) -> bytes:
        return f"{why}\n".encode()

    def take(self) -> bool:
        for _ in range(LINES):
            end = self.received.find(b"\n")
            if max(end, len(self.received) if end < 0 else 0) > MAX_COMMAND:
                raise InputError(f"a command may have {MAX_COMMAND} bytes")
            if end < 0:
                return False
            line = bytes(self.received[:end]).strip()
            del self.received[: end + 1]
            if line and self.take_command(line):
                return False
        return True

    def take_command(self, line: bytes) -> bool:
        """Do what a line says; return whether the connection has ended."""
        command = printable(line.decode("utf-8", "replace"))
        said = answer(self.robot.controller, command)
        if said is None and not self.has_spoken:
            raise InputError(f"what it sends is no command of the dashboard: {shown(command[:40])}")
        self.has_spoken, self.unfinished_since = True, math.inf
        if command.startswith(("popup ", "addToLog ")):
            self.hear(command.partition(" ")[2])
        self.tell(not_understood(command) if said is None else said)
        if command in FAREWELLS:
            self.robot.drop(self)
        return self not in self.robot._clients


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
