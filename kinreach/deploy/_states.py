"""The state of a robot as RTDE reports it, in every control cycle."""

from __future__ import annotations

import struct
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic

import numpy as np

from kinreach._checks import Floats, shown
from kinreach.deploy._connection import TIMEOUT, Connection
from kinreach.deploy._controller import REGISTER, RUN_REGISTER
from kinreach.deploy._rtde import (
    NOT_FOUND,
    PROTOCOL,
    Kind,
    RobotMode,
    RtdeRecipe,
    RuntimeState,
    SafetyMode,
    names_in,
    package,
    packages_in,
)
from kinreach.errors import InputError, RobotError

#: Variables that are read; old controllers do not have those in `_OPTIONAL`.
_PROGRESS, _RUN = f"output_int_register_{REGISTER}", f"output_int_register_{RUN_REGISTER}"
_OPTIONAL = ("tcp_offset", _PROGRESS, _RUN)
_VARIABLES = (
    "timestamp", "target_q", "target_qd", "actual_q", "actual_qd", "actual_TCP_pose", "robot_mode", "safety_mode",
    "runtime_state", "speed_scaling", *_OPTIONAL,
)  # fmt: skip
#: Speeds up to this are rest for an arm that no program moves [rad/s]: measured speeds have noise.
REST = 0.01
#: Safety modes in which the arm can move.
_SAFE = (SafetyMode.NORMAL, SafetyMode.REDUCED)
#: States that are kept for `StateReader.next`, and how long a caller may be away and still get them [s].
KEPT, AWAY = 1000, 1.0
#: So many states may wait before the newest one is looked at beside the next.
BEHIND = 10
#: So often who waits for a state looks whether it was interrupted [s].
GLANCE = 0.05


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
        run: Integer register 25, the number of a program's run; None if it is not reported.
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
    run: int | None = None

    @property
    def trouble(self) -> str:
        """Why the arm must not be moved, or does not do what its program says; empty if nothing is wrong."""
        if self.safety_mode not in _SAFE:
            return f"{_word(SafetyMode, self.safety_mode)} (safety mode {self.safety_mode})"
        if self.robot_mode != RobotMode.RUNNING:
            return f"{_word(RobotMode, self.robot_mode)} (robot mode {self.robot_mode})"
        numbers = np.concatenate([
            self.target_q, self.target_qd, self.actual_q, self.actual_qd, self.tcp_pose,
            () if self.tcp_offset is None else self.tcp_offset, (self.time, self.speed_scaling),
        ])  # fmt: skip
        return "" if np.isfinite(numbers).all() else "it reports NaN or infinity"

    @property
    def is_paused(self) -> bool:
        return self.runtime_state in (RuntimeState.PAUSING, RuntimeState.PAUSED, RuntimeState.RESUMING)

    @property
    def is_halted(self) -> bool:
        """Whether a stop of the safety system, or power that is off, keeps the arm from moving."""
        return self.safety_mode not in _SAFE or self.robot_mode != RobotMode.RUNNING

    @property
    def stands(self) -> bool:
        """Whether the arm is at rest and no program can move it; NaN is no rest."""
        at_rest = bool(np.abs(self.actual_qd).max() <= REST)
        return at_rest and (self.runtime_state == RuntimeState.STOPPED or self.is_halted)


def _word(modes: type[RobotMode] | type[SafetyMode], number: int) -> str:
    try:
        return modes(number).name.lower().replace("_", " ")
    except ValueError:
        return "an unknown mode"


class StateReader:
    """Reads the states of a robot, in a thread: the newest one is there whenever it is asked for.

    Args:
        address: Host name or IP address.
        port: Of RTDE.

    Attributes:
        cycle: Of the controller [s]; so often there is a state.

    Raises:
        RobotError: There is no answer, or not one of a UR.
    """

    def __init__(self, address: str, port: int) -> None:
        self.address, self.patience = address, TIMEOUT
        self._buffer, self._arrived = bytearray(), threading.Condition()
        self._waiting: deque[bytes] = deque(maxlen=KEPT)
        #: Of the bytes that came: how many pieces, and the last one of them that had the newest state.
        self._chunks, self._up_to_date = 0, 0
        self._newest, self._asked = b"", 0.0
        self._failure: Exception | None = None
        self._connection = Connection(address, port)
        try:
            self.cycle, self._recipe = self._set_up()
        except BaseException:
            self._connection.close()
            raise
        self.take(b"", more=False)
        self._connection.deliver(self)

    def close(self) -> None:
        self._connection.close()
        self._waiting.clear()
        self._failure = self._failure or ConnectionError("it was closed")

    def read(self) -> RobotState:
        """Return the newest state: it came after this call.

        Raises:
            RobotError: As `next`.
        """
        return self._state(self._fresh()[-1])

    def read_all(self) -> list[RobotState]:
        """Return all states after the one that was returned last; the last one is the newest.

        Raises:
            RobotError: As `next`.
        """
        return [self._state(payload) for payload in self._fresh()]

    def ahead(self) -> list[RobotState]:
        """Return the newest state if `next` is far behind it, and nothing otherwise."""
        with self._arrived:
            newest = [self._newest] if len(self._waiting) > BEHIND else []
        return [self._state(payload) for payload in newest]

    def _fresh(self) -> list[bytes]:
        self._connection.check_process()
        with self._arrived:
            # what is being received now may have begun before this call
            after = self._chunks + 1
            self._wait_until(lambda: self._up_to_date > after)
            waiting = list(self._waiting)
            self._waiting.clear()
            self._asked = monotonic()
            return waiting

    def next(self, check: Callable[[], None] | None = None) -> RobotState:
        """Return the state that follows the one that was returned last; after a pause of a second, the newest.

        Args:
            check: Called from time to time while it waits; what it raises is raised.

        Raises:
            RobotError: The connection is lost, no state comes, or it is used in another process than where it was made.
        """
        self._connection.check_process()
        with self._arrived:
            away = self._waiting.maxlen is not None and monotonic() - self._asked > AWAY
            if not away:
                self._wait_until(lambda: bool(self._waiting), check)
                self._asked = monotonic()
                return self._state(self._waiting.popleft())
        return self.read()

    def keep_all(self, *, whether: bool) -> None:
        """Keep every state for `next`, however long it takes to ask for it; or again only the latest ones."""
        with self._arrived:
            self._waiting = deque(self._waiting, maxlen=None if whether else KEPT)

    def take(self, data: bytes, *, more: bool) -> None:
        self._buffer += data
        states = [payload[1:] for kind, payload in packages_in(self._buffer) if kind == Kind.DATA]
        with self._arrived:
            self._chunks += 1
            if states:
                self._waiting.extend(states)
                self._newest = states[-1]
                self._up_to_date = self._up_to_date if more else self._chunks
            self._arrived.notify_all()

    def lose(self, error: Exception) -> None:
        with self._arrived:
            self._failure = self._failure or error
            self._arrived.notify_all()

    def _wait_until(self, condition: Callable[[], bool], check: Callable[[], None] | None = None) -> None:
        deadline = monotonic() + self.patience
        while not condition():
            if self._failure is not None:
                raise self._error(self._failure)
            remaining = deadline - monotonic()
            if remaining <= 0.0:
                raise self._error(TimeoutError(f"no state for {self.patience:.3g} s"))
            if check is not None:
                check()
            self._arrived.wait(min(remaining, GLANCE))

    def _state(self, payload: bytes) -> RobotState:
        try:
            values = self._recipe.unpack(payload)
        except InputError as error:
            raise self._error(error) from None
        vectors = {name: np.array(value) for name, value in values.items()}
        progress, run = (int(values[name][0]) if name in values else None for name in (_PROGRESS, _RUN))
        return RobotState(
            values["timestamp"][0], vectors["target_q"], vectors["target_qd"], vectors["actual_q"],
            vectors["actual_qd"], vectors["actual_TCP_pose"], int(values["robot_mode"][0]),
            int(values["safety_mode"][0]), int(values["runtime_state"][0]), values["speed_scaling"][0],
            vectors.get("tcp_offset"), progress, run,
        )  # fmt: skip

    def _set_up(self) -> tuple[float, RtdeRecipe]:
        """Set up RTDE at the rate of the controller; return its cycle and what a state has."""
        self._send(Kind.PROTOCOL_VERSION, struct.pack(">H", PROTOCOL))
        if self._answer(Kind.PROTOCOL_VERSION) != b"\x01":
            raise self._refused(f"has no RTDE protocol {PROTOCOL}; its software is too old")
        self._send(Kind.CONTROLLER_VERSION)
        version = self._answer(Kind.CONTROLLER_VERSION)
        rate = 500.0 if len(version) == 16 and struct.unpack_from(">I", version)[0] >= 5 else 125.0
        names = list(_VARIABLES)
        for _ in range(2):
            self._send(Kind.SETUP_OUTPUTS, struct.pack(">d", rate) + ",".join(names).encode())
            types = names_in(self._answer(Kind.SETUP_OUTPUTS)[1:])
            missing = [name for name, kind in zip(names, types, strict=False) if kind == NOT_FOUND]
            if not missing:
                break
            names = [name for name in names if name not in missing]
        lacking = [name for name in _VARIABLES if name not in (*names, *_OPTIONAL)]
        if len(types) != len(names) or lacking:
            raise self._refused(f"does not know {', '.join(lacking) or 'what is asked for'}")
        try:
            recipe = RtdeRecipe(names, types)
        except KeyError as error:
            raise self._refused(f"has a type {shown(error.args[0])}, which RTDE has not") from None
        self._send(Kind.START)
        if self._answer(Kind.START) != b"\x01":
            raise self._refused("refuses to send its state")
        return 1.0 / rate, recipe

    def _send(self, kind: Kind, payload: bytes = b"") -> None:
        self._connection.send(package(kind, payload))

    def _answer(self, wanted: Kind) -> bytes:
        """Return the payload of the next package of a kind, without those before it."""
        deadline = monotonic() + self.patience
        try:
            while True:
                for kind, payload in packages_in(self._buffer):
                    if kind == wanted:
                        return payload
                if monotonic() > deadline:
                    raise TimeoutError("no answer")
                data = self._connection.socket.recv(65536)
                if not data:
                    raise ConnectionError("the connection was closed")
                self._buffer += data
        except (InputError, OSError) as error:
            raise self._error(error) from None

    def _error(self, error: Exception) -> RobotError:
        if isinstance(error, OSError):
            return self._connection.lost(error)
        return RobotError(f"what answers at {self.address} is not a UR: {error}")

    def _refused(self, what: str) -> RobotError:
        return RobotError(f"the robot at {self.address} {what}")
