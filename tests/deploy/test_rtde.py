"""The simulated UR is read by `ur_rtde`, and no client can harm it."""

import socket
import struct
import threading
import time
from contextlib import closing, suppress
from inspect import signature

import numpy as np
import pytest

from kinreach.deploy import SimulatedUR, URClient
from kinreach.deploy._controller import Controller
from kinreach.deploy._primary import Message, news_in
from kinreach.deploy._rtde import (
    FORMATS,
    HEADER,
    IN_USE,
    NOT_FOUND,
    Kind,
    RobotMode,
    RtdeRecipe,
    RuntimeState,
    SafetyMode,
    names_in,
    package,
    packages_in,
    type_of,
)
from kinreach.deploy._server import _OUTPUTS, output
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, pose, pose_vector
from kinreach.robots import get_arm
from tests.deploy.conftest import CALIBRATION, TOOL

#: So long a client waits for an answer [s].
PATIENCE = 30.0


@pytest.fixture(scope="module")
def address(simulated):
    return simulated("--arm", "ur5e", "--calibration", str(CALIBRATION), "--tool", TOOL)[0]


def in_one_cycle(client, *getters):
    """What ur_rtde's getters return, all of one state: its thread may replace the state between two of them."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        before = client.getTimestamp()
        values = [getattr(client, getter)() for getter in getters]
        if client.getTimestamp() == before:
            return values
    raise AssertionError("no state lasted as long as it takes to read it")


class TestUrRtde:
    """The real package as the client; its calls hold Python's lock, so that the robot is in another process."""

    def test_the_receive_interface_reads_a_moving_arm(self, address):
        rtde_receive = pytest.importorskip("rtde_receive")
        kin = ArmKinematics(
            get_arm("ur5e").calibrated(CALIBRATION), tool=[float(word) for word in TOOL.split(",")], base="base"
        )
        client = rtde_receive.RTDEReceiveInterface(address)
        try:
            home = np.array(kin.arm.home)
            np.testing.assert_allclose(client.getActualQ(), home, atol=1e-6)
            assert (client.getRobotMode(), client.getSafetyMode(), client.getRuntimeState()) == (7, 1, 1)
            assert client.getSpeedScaling() == 1.0
            goal = np.add(home, [0.2, -0.1, 0.1, 0.0, 0.1, 0.0])
            with socket.create_connection((address, 30002)) as script:
                script.sendall(f"movej({goal.tolist()}, a=1.4, v=0.5)\n".encode())
                rows, moved, deadline = [], False, time.monotonic() + PATIENCE
                while not (moved and client.getRuntimeState() == 1) and time.monotonic() < deadline:
                    rows.append((client.getTimestamp(), client.getActualQ(), client.getActualQd(), client.getTargetQ(),
                                 client.getActualTCPPose()))  # fmt: skip
                    moved |= client.getRuntimeState() == 2
                    time.sleep(0.003)
            target, q, T = in_one_cycle(client, "getTargetQ", "getActualQ", "getActualTCPPose")
            np.testing.assert_allclose(target, goal, atol=1e-12)
            np.testing.assert_allclose(q, goal, atol=1e-3)
            np.testing.assert_allclose(pose(T), kin.fk(np.array(q)), atol=1e-9)
        finally:
            client.disconnect()
        times = np.array([row[0] for row in rows])
        assert (np.diff(times) >= 0).all()
        assert np.ptp(times) > 0.3
        speeds, targets = np.abs([row[2] for row in rows]), np.array([row[3] for row in rows])
        assert 0.4 < speeds.max() < 0.55
        assert len(np.unique(targets, axis=0)) > 5  # on a busy machine this process sees few of the states

    def test_the_io_interface_moves_the_speed_slider(self, address):
        rtde_io, rtde_receive = pytest.importorskip("rtde_io"), pytest.importorskip("rtde_receive")
        outputs, inputs = rtde_receive.RTDEReceiveInterface(address), rtde_io.RTDEIOInterface(address)
        try:
            for fraction in (0.25, 0.0, 1.0):
                assert inputs.setSpeedSlider(fraction)
                deadline = time.monotonic() + PATIENCE
                while outputs.getSpeedScaling() != fraction and time.monotonic() < deadline:
                    time.sleep(0.01)
                assert outputs.getTargetSpeedFraction() == outputs.getSpeedScaling() == fraction
        finally:
            inputs.disconnect()
            outputs.disconnect()

    def test_a_protective_stop_is_reported(self, address):
        rtde_receive = pytest.importorskip("rtde_receive")
        client = rtde_receive.RTDEReceiveInterface(address)
        try:
            below = [-1.5708, 0.2, 0.0, -1.5708, -1.5708, 0.0]  # through the table
            with socket.create_connection((address, 30002)) as script:
                script.sendall(f"movej({below}, a=5, v=3)\n".encode())
                deadline = time.monotonic() + PATIENCE
                while client.getSafetyMode() == 1 and time.monotonic() < deadline:
                    time.sleep(0.01)
            assert (client.getSafetyMode(), client.getRuntimeState()) == (3, 1)
            assert client.isProtectiveStopped()
            assert client.getSpeedScaling() == 0.0
        finally:
            client.disconnect()


@pytest.fixture
def robot():
    log = []
    with SimulatedUR("ur5e", rtde_port=0, script_port=0, speed=20.0, log=log.append) as served:
        served.log = log
        yield served


class Client:
    """RTDE by hand, so that it can be wrong."""

    def __init__(self, robot):
        self.socket = socket.create_connection((robot.address, robot.rtde_port), timeout=PATIENCE)
        self.buffer = bytearray()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()

    def ask(self, kind, payload=b""):
        self.socket.sendall(package(kind, payload))
        return self.next(kind)

    def next(self, wanted):
        while True:
            for kind, payload in packages_in(self.buffer):
                if kind == wanted:
                    return payload
            data = self.socket.recv(65536)
            if not data:
                raise ConnectionError
            self.buffer += data

    def next_kind(self):
        """The kind of the next package."""
        while True:
            for kind, _ in packages_in(self.buffer):
                return kind
            self.buffer += self.socket.recv(65536)

    def begin(self, names, frequency=125.0):
        assert self.ask(Kind.PROTOCOL_VERSION, b"\0\2") == b"\1"
        types = names_in(self.ask(Kind.SETUP_OUTPUTS, struct.pack(">d", frequency) + ",".join(names).encode())[1:])
        assert self.ask(Kind.START) == b"\1"
        return RtdeRecipe(names, types)


def alive(robot):
    """Whether a new client is served."""
    with Client(robot) as client:
        recipe = client.begin(["timestamp", "actual_q"])
        first, second = (recipe.unpack(client.next(Kind.DATA)[1:])["timestamp"][0] for _ in range(2))
        return second > first


def test_types_are_those_of_the_guide():
    assert type_of("actual_q") == "VECTOR6D"
    assert type_of("runtime_state") == "UINT32"
    assert type_of("output_int_register_24") == type_of("input_int_register_47", inputs=True) == "INT32"
    assert type_of("output_bit_register_64") == "BOOL"
    assert type_of("speed_slider_fraction", inputs=True) == "DOUBLE"
    for name in ("", "actual_Q", "output_int_register_48", "output_bit_register_63", "speed_slider_fraction"):
        assert type_of(name) == NOT_FOUND
    assert type_of("actual_q", inputs=True) == type_of("output_int_register_1", inputs=True) == NOT_FOUND


def test_numbers_are_those_of_the_guides():
    """Ports, kinds of packages, and modes, of Universal Robots' guides to RTDE and to its interfaces."""
    robot = ["DISCONNECTED", "CONFIRM_SAFETY", "BOOTING", "POWER_OFF", "POWER_ON", "IDLE", "BACKDRIVE", "RUNNING",
             "UPDATING_FIRMWARE"]  # fmt: skip
    assert {mode.name: mode.value for mode in RobotMode} == {
        "NO_CONTROLLER": -1, **{name: i for i, name in enumerate(robot)}
    }  # fmt: skip
    safety = ["NORMAL", "REDUCED", "PROTECTIVE_STOP", "RECOVERY", "SAFEGUARD_STOP", "SYSTEM_EMERGENCY_STOP",
              "ROBOT_EMERGENCY_STOP", "VIOLATION", "FAULT", "VALIDATE_JOINT_ID", "UNDEFINED_SAFETY_MODE"]  # fmt: skip
    assert {mode.name: mode.value for mode in SafetyMode} == {name: i for i, name in enumerate(safety, start=1)}
    runtime = ["STOPPING", "STOPPED", "PLAYING", "PAUSING", "PAUSED", "RESUMING"]
    assert {state.name: state.value for state in RuntimeState} == {name: i for i, name in enumerate(runtime)}
    kinds = {"TEXT_MESSAGE": 77, "DATA": 85, "PROTOCOL_VERSION": 86, "CONTROLLER_VERSION": 118, "SETUP_OUTPUTS": 79,
             "SETUP_INPUTS": 73, "START": 83, "PAUSE": 80}  # fmt: skip
    assert {kind.name: kind.value for kind in Kind} == kinds
    ports = {each.__name__: {name: given.default for name, given in signature(each).parameters.items()
                             if name.endswith("_port")} for each in (SimulatedUR, URClient)}  # fmt: skip
    assert ports == {"SimulatedUR": {"rtde_port": 30004, "script_port": 30002},
                     "URClient": {"rtde_port": 30004, "script_port": 30001}}  # fmt: skip


def test_every_output_is_the_controllers():
    """On the way, at rest, and in a protective stop; speeds by differences of poses."""
    ur = Controller(get_arm("ur5e").calibrated(CALIBRATION).with_tool([0.01, -0.02, 0.15, 0.3, 0, 0]))
    at_rest = outputs(ur)
    assert (at_rest["timestamp"], at_rest["robot_status_bits"], at_rest["runtime_state"]) == ((0.0,), (1,), (1,))
    goal = np.add(ur.arm.home, [0.4, -0.2, 0.2, 0.3, -0.2, 0.1]).tolist()
    ur.start(f"def f():\n  set_payload(1.25, [0, 0, 0])\n  movej({goal}, a=3, v=0.5)\nend\n")
    for _ in range(150):
        ur.tick()
    before = outputs(ur)
    ur.speed_slider = 0.75
    for _ in range(2):
        ur.tick()
    now, dt = outputs(ur), 2 * ur.cycle
    assert now["timestamp"][0] == pytest.approx(152 / 500)
    for kind in ("target", "actual"):
        T_before, T = (pose(each[f"{kind}_TCP_pose"]) for each in (before, now))
        np.testing.assert_allclose(T, ur.kinematics.fk(now[f"{kind}_q"]) @ ur.tcp, atol=1e-12)
        spin = pose_vector(T @ np.linalg.inv(T_before))[3:] / dt
        moved = np.concatenate([(T - T_before)[:3, 3] / dt, spin])
        mean = np.mean([before[f"{kind}_TCP_speed"], now[f"{kind}_TCP_speed"]], axis=0)
        np.testing.assert_allclose(mean, moved, atol=2e-3)
        np.testing.assert_allclose(np.subtract(now[f"{kind}_q"], before[f"{kind}_q"]) / dt,
                                   np.mean([before[f"{kind}_qd"], now[f"{kind}_qd"]], axis=0), atol=5e-3)  # fmt: skip
    np.testing.assert_array_equal(now["target_qdd"], ur.target_qdd)
    np.testing.assert_allclose(now["tcp_offset"], [0.01, -0.02, 0.15, 0.3, 0, 0], atol=1e-9)
    assert now["speed_scaling"][0] == pytest.approx(1.0 - dt * 4.0)
    numbers = {"payload": 1.25, "robot_mode": 7, "safety_mode": 1, "safety_status": 1, "safety_status_bits": 1,
               "robot_status_bits": 3, "runtime_state": 2, "target_speed_fraction": 0.75}  # fmt: skip
    assert {name: now[name] for name in numbers} == {name: (value,) for name, value in numbers.items()}
    assert now["joint_mode"] == (253,) * 6
    ur.registers[7] = -3
    assert (output(ur, "output_int_register_7"), output(ur, "output_int_register_8")) == ((-3,), (0,))
    assert output(ur, "tool_mode") == ()
    ur.run("movel(p[0, 0, 3, 0, 0, 0])")
    stopped = outputs(ur)
    numbers = {
        "safety_mode": 3,
        "safety_status": 3,
        "safety_status_bits": 0b10000000100,
        "speed_scaling": 0,
        "robot_status_bits": 1,
    }
    assert {name: stopped[name] for name in numbers} == {name: (value,) for name, value in numbers.items()}


def outputs(ur):
    """All outputs that the simulation knows, by name; each has the shape of its type."""
    values = {name: output(ur, name) for name in _OUTPUTS}
    for name, value in values.items():
        assert RtdeRecipe([name], [type_of(name)]).unpack(RtdeRecipe([name], [type_of(name)]).pack(values))[
            name
        ] == tuple(value)
    return values


def test_recipes_pack_and_unpack_every_type():
    rng, tried = np.random.default_rng(0), set()
    for _ in range(200):
        types = rng.choice(list(FORMATS), size=rng.integers(1, 9)).tolist()
        recipe = RtdeRecipe([f"v{index}" for index in range(len(types))], types)
        values = {name: tuple(rng.integers(0, 2, len(zeros)).tolist()) for name, zeros in recipe.zeros.items()}
        assert recipe.unpack(recipe.pack(values)) == values
        assert recipe.unpack(recipe.pack({})) == recipe.zeros
        with pytest.raises(InputError, match=r"bytes"):
            recipe.unpack(recipe.pack(values) + b"\0")
        tried |= set(types)
    assert tried == set(FORMATS)


def test_packages_come_whole_however_they_are_cut():
    rng, parts = np.random.default_rng(1), 0
    for _ in range(50):
        sent = [(int(rng.integers(256)), rng.bytes(int(rng.integers(300)))) for _ in range(5)]
        stream = b"".join(HEADER.pack(3 + len(payload), kind) + payload for kind, payload in sent)
        cuts = np.sort(rng.integers(0, len(stream), 6))
        buffer, got = bytearray(), []
        for piece in np.split(np.frombuffer(stream, np.uint8), cuts):
            buffer += piece.tobytes()
            got += list(packages_in(buffer))
            parts += 1
        assert got == sent
        assert not buffer
    assert parts == 350


def test_the_robot_reports_what_it_is_told_to(robot):
    """Stops, pauses and values that no robot should have, each from another thread than the robot's own."""
    truth = {"robot_mode": 7, "safety_mode": 1, "runtime_state": 1, "robot_status_bits": 1, "safety_status_bits": 1}

    def until(client, recipe, **wanted):
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            values = recipe.unpack(client.next(Kind.DATA)[1:])
            if all(values[name] == (value,) for name, value in {**truth, **wanted}.items()):
                return values
        raise AssertionError(values)

    script = socket.create_connection((robot.address, robot.script_port), timeout=PATIENCE)
    with Client(robot) as client, script:
        recipe = client.begin([*truth, "actual_q", "joint_mode"], 500.0)
        until(client, recipe)
        script.sendall(b"def f():\n  sleep(3000)\nend\n")
        until(client, recipe, runtime_state=2, robot_status_bits=3)
        robot.pause()
        until(client, recipe, runtime_state=4)
        robot.resume()
        until(client, recipe, runtime_state=2, robot_status_bits=3)
        robot.report("actual_q", [float("nan")] * 6)
        while not np.isnan(until(client, recipe, runtime_state=2, robot_status_bits=3)["actual_q"]).all():
            pass
        robot.report("robot_mode", [5])
        until(client, recipe, robot_mode=5, runtime_state=2, robot_status_bits=3)
        robot.report("robot_mode", None)
        robot.emergency_stop()
        stopped = until(
            client, recipe, robot_mode=3, safety_mode=7, robot_status_bits=0, safety_status_bits=0b10011000000
        )
        assert stopped["joint_mode"] == (239,) * 6
        stream, said = bytearray(), []
        while not any(isinstance(news, Message) and news.title == "Emergency stop" for news in said):
            stream += script.recv(4096)
            said += list(news_in(stream))
        titles = [news.title for news in said if isinstance(news, Message)]
        assert titles == ["PROGRAM_XXX_STARTED", "Emergency stop", "PROGRAM_XXX_STOPPED"]
        assert [news.text for news in said if isinstance(news, Message)][::2] == ["f", "f"]
        robot.report("actual_q", None)
        robot.release()
        assert np.isfinite(until(client, recipe)["actual_q"]).all()
    for name, values, reason in (
        ("speed", [1], "no output variable 'speed'"),
        ("actual_q", [1], "type of actual_q is VECTOR6D"),
        ("robot_mode", [float("nan")], "type of robot_mode is INT32"),
    ):
        with pytest.raises(InputError, match=reason):
            robot.report(name, values)


def test_the_frequency_is_that_of_the_recipe(robot):
    with Client(robot) as client:
        recipe = client.begin(["timestamp"], 50.0)
        stamps = [recipe.unpack(client.next(Kind.DATA)[1:])["timestamp"][0] for _ in range(30)]
    np.testing.assert_allclose(np.diff(stamps), 0.02, atol=1e-9)


def test_a_pause_ends_the_data_and_a_start_goes_on(robot):
    with Client(robot) as client:
        client.begin(["timestamp"])
        client.next(Kind.DATA)
        assert client.ask(Kind.PAUSE) == b"\1"
        client.buffer.clear()
        paused = robot.controller.time
        while robot.controller.time < paused + 0.1:  # fifty cycles
            client.socket.sendall(package(Kind.CONTROLLER_VERSION))
            assert client.next_kind() == Kind.CONTROLLER_VERSION
        client.ask(Kind.START)
        client.next(Kind.DATA)


def test_wrong_versions_are_refused_and_may_be_asked_again(robot):
    with Client(robot) as client:
        for version in (b"\0\0", b"\0\1", b"\0\3", b"\xff\xff"):
            assert client.ask(Kind.PROTOCOL_VERSION, version) == b"\0"
        assert client.ask(Kind.PROTOCOL_VERSION, b"\0\2") == b"\1"
        assert struct.unpack(">4I", client.ask(Kind.CONTROLLER_VERSION))[0] == 5
    with Client(robot) as client:  # without version 2
        client.socket.sendall(package(Kind.SETUP_OUTPUTS, struct.pack(">d", 125.0) + b"actual_q"))
        message = client.next(Kind.TEXT_MESSAGE)
        length = message[0]
        assert b"protocol 2" in message[1 : 1 + length]
        assert message[1 + length :] == b"\x08kinreach\x01"  # the source, and an error
        with pytest.raises((ConnectionError, OSError)):
            client.next(Kind.DATA)
    assert alive(robot)


def test_unknown_variables_are_named_and_nothing_begins(robot):
    with Client(robot) as client:
        client.ask(Kind.PROTOCOL_VERSION, b"\0\2")
        answer = client.ask(Kind.SETUP_OUTPUTS, struct.pack(">d", 125.0) + b"actual_q,nonsense,")
        assert answer == b"\0VECTOR6D,NOT_FOUND"
        assert client.ask(Kind.START) == b"\0"


def test_an_input_belongs_to_one_client_until_it_goes(robot):
    names = b"speed_slider_mask,speed_slider_fraction"
    with Client(robot) as one, Client(robot) as other:
        for client in (one, other):
            client.ask(Kind.PROTOCOL_VERSION, b"\0\2")
        assert one.ask(Kind.SETUP_INPUTS, names) == b"\1UINT32,DOUBLE"
        assert other.ask(Kind.SETUP_INPUTS, names) == f"\0{IN_USE},{IN_USE}".encode()
        recipe = other.begin(["target_speed_fraction"], 500.0)
        for fraction, taken in ((0.5, 0.5), (float("nan"), 0.5), (7.0, 0.5), (0.125, 0.125)):
            one.socket.sendall(package(Kind.DATA, b"\1" + struct.pack(">Id", 1, fraction)))
            one.ask(Kind.CONTROLLER_VERSION)  # what was sent before is done when this is answered
            assert robot.controller.speed_slider == taken
        seen, deadline = 1.0, time.monotonic() + PATIENCE
        while seen != taken and time.monotonic() < deadline:
            seen = recipe.unpack(other.next(Kind.DATA)[1:])["target_speed_fraction"][0]
        assert seen == taken
        one.socket.close()
        deadline = time.monotonic() + PATIENCE
        while (answer := other.ask(Kind.SETUP_INPUTS, names)) != b"\1UINT32,DOUBLE" and time.monotonic() < deadline:
            time.sleep(0.01)
        assert answer == b"\1UINT32,DOUBLE"


BAD = {
    "a size of nothing": struct.pack(">HB", 0, 86),
    "a size below the header": struct.pack(">HB", 2, 86),
    "an unknown kind": package(Kind.PROTOCOL_VERSION, b"\0\2") + struct.pack(">HB", 3, 7),
    "a version of one byte": package(Kind.PROTOCOL_VERSION, b"\2"),
    "a version of nine bytes": package(Kind.PROTOCOL_VERSION, b"\2" * 9),
    "no frequency": package(Kind.PROTOCOL_VERSION, b"\0\2") + package(Kind.SETUP_OUTPUTS, b"abc"),
    "NaN Hz": package(Kind.PROTOCOL_VERSION, b"\0\2") + package(Kind.SETUP_OUTPUTS, struct.pack(">d", float("nan"))),
    "1e9 Hz": package(Kind.PROTOCOL_VERSION, b"\0\2") + package(Kind.SETUP_OUTPUTS, struct.pack(">d", 1e9)),
    "names of 60 kB": package(Kind.PROTOCOL_VERSION, b"\0\2") + package(Kind.SETUP_INPUTS, b"x," * 30000),
    "names that are no text": package(Kind.PROTOCOL_VERSION, b"\0\2") + package(Kind.SETUP_INPUTS, b"\xff\xfe"),
    "data without a recipe": package(Kind.PROTOCOL_VERSION, b"\0\2") + package(Kind.DATA, b"\1abc"),
    "empty data": package(Kind.PROTOCOL_VERSION, b"\0\2") + package(Kind.DATA),
    "data of another size": package(Kind.PROTOCOL_VERSION, b"\0\2")
    + package(Kind.SETUP_INPUTS, b"speed_slider_fraction") + package(Kind.DATA, b"\1abc"),
    "random bytes": np.random.default_rng(3).bytes(70_000),
}  # fmt: skip


def test_bad_packages_end_the_connection_and_nothing_else(robot):
    with Client(robot) as bystander:
        bystander.begin(["timestamp"])
        for what, data in BAD.items():
            with Client(robot) as client:
                client.socket.sendall(data)
                with pytest.raises((ConnectionError, OSError)):
                    client.next(-1)
                assert robot.controller.safety_mode == 1, what
        bystander.buffer.clear()
        bystander.next(Kind.DATA)
    assert alive(robot)


def test_truncated_packages_wait_and_harm_nobody(robot):
    with Client(robot) as client:
        client.socket.sendall(struct.pack(">HB", 2000, Kind.SETUP_OUTPUTS) + b"abc")
        assert alive(robot)
        client.socket.sendall(b"d")
    assert alive(robot)


@pytest.mark.slow
def test_clients_that_vanish_or_do_not_read_are_dropped(robot):
    for number in range(20):
        client = Client(robot)
        client.begin(["timestamp", "actual_q", "actual_TCP_pose"], 500.0)
        if number % 2:  # a reset instead of an end
            client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        client.socket.close()
    with Client(robot) as deaf:
        deaf.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        deaf.begin([f"output_double_register_{n}" for n in range(48)] + ["actual_q"], 500.0)
        deadline = time.monotonic() + PATIENCE
        while robot._clients and time.monotonic() < deadline:  # its megabyte is soon full, at 20 times real time
            time.sleep(0.05)
        assert not robot._clients
    assert alive(robot)


def test_small_packages_are_sent_at_once(robot):
    """Nagle's algorithm would hold a state back until the last one is acknowledged, some 40 ms on a quiet client."""
    with Client(robot) as client:
        assert client.ask(Kind.PROTOCOL_VERSION, b"\0\2") == b"\1"
        (served,) = robot._clients
        assert served.socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


def test_too_many_clients_are_turned_away(robot):
    clients = [Client(robot) for _ in range(40)]
    try:
        answered = 0
        for client in clients:
            with suppress(OSError):
                answered += client.ask(Kind.PROTOCOL_VERSION, b"\0\2") == b"\1"
        assert answered == 32
        refused = f"a client is refused: port {robot.rtde_port} has 32 already"
        assert [line for line in robot.log if "refused" in line] == [refused]  # one for all that come now
    finally:
        for client in clients:
            client.socket.close()
    deadline = time.monotonic() + PATIENCE
    while robot._clients and time.monotonic() < deadline:
        time.sleep(0.01)
    assert alive(robot)


def test_nothing_is_left_when_it_closes():
    before = set(threading.enumerate())
    for _ in range(3):
        with SimulatedUR("ur5e", rtde_port=0, script_port=0) as robot:
            client = Client(robot)
            client.begin(["timestamp"])
            ports = robot.rtde_port, robot.script_port
        with pytest.raises((ConnectionError, OSError)):
            client.next(-1)
        client.socket.close()
        for port in ports:
            with pytest.raises(OSError, match=r"refused"):
                socket.create_connection((robot.address, port), timeout=PATIENCE)
        robot.close()  # twice is as good
    assert set(threading.enumerate()) <= before


@pytest.mark.parametrize("address", ["0.0.0.0", "192.168.1.4", "::1", "robot", "", None, "127.0.0.256"])
def test_other_addresses_than_this_machines_own_are_refused(address):
    with pytest.raises(InputError, match=r"this machine"):
        SimulatedUR("ur5e", address=address)


def test_a_port_in_use_is_named(robot):
    with pytest.raises(InputError, match=f"cannot serve at 127.0.0.1:{robot.rtde_port}: .*in use; if another robot"):
        SimulatedUR("ur5e", rtde_port=robot.rtde_port, script_port=0)
    with socket.socket() as free:
        free.bind((robot.address, 0))
        number = free.getsockname()[1]
    with pytest.raises(InputError, match=f"cannot serve at 127.0.0.1:{robot.script_port}: "):
        SimulatedUR("ur5e", rtde_port=number, script_port=robot.script_port)
    with pytest.raises(ConnectionRefusedError):  # the port that it had opened is closed
        socket.create_connection((robot.address, number), timeout=PATIENCE)


@pytest.mark.parametrize("arm", ["panda", "arm3"])
def test_only_a_ur_has_a_controller(arm):
    with pytest.raises(InputError, match=r"is not a UR"):
        SimulatedUR(arm)


class TestScriptPort:
    """Programs come in any pieces, from anybody, and what is no program harms nobody."""

    MOVE = b"def f():\n  movej([-1.4, -1.57, 1.57, -1.57, -1.57, 0], a=1.4, v=0.5)\nend\n"

    @staticmethod
    def script(robot):
        return socket.create_connection((robot.address, robot.script_port), timeout=PATIENCE)

    @staticmethod
    def greeting(client):
        """The package that a client gets first: the robot's state, of which the only part is its kinematics."""
        data = client.recv(230, socket.MSG_WAITALL)
        assert struct.unpack_from(">iBIB", data) == (230, 16, 225, 5)

    @staticmethod
    def message(client):
        """The next message, after the states before it."""
        while True:
            size, kind = struct.unpack(">iB", head := client.recv(5, socket.MSG_WAITALL))
            data = head + client.recv(size - 5, socket.MSG_WAITALL)
            if kind == 20:
                return data

    @staticmethod
    def wait_for(condition):
        deadline = time.monotonic() + PATIENCE
        while not condition() and time.monotonic() < deadline:
            time.sleep(0.005)
        assert condition()

    def test_a_program_comes_in_pieces(self, robot):
        with self.script(robot) as client:
            for at in range(0, len(self.MOVE), 7):
                client.sendall(self.MOVE[at : at + 7])
                time.sleep(0.001)
            self.wait_for(lambda: abs(robot.controller.target_q[0] + 1.4) < 1e-9)

    def test_half_a_program_moves_nothing(self, robot):
        with self.script(robot) as client:
            client.sendall(self.MOVE[:-4])
        with self.script(robot) as client:
            client.sendall(b"\n\n\r\n" + self.MOVE[: len(self.MOVE) // 2])
            assert alive(robot)
        assert alive(robot)
        assert robot.controller.target_q[0] == pytest.approx(-1.5708, abs=1e-4)

    def test_a_refusal_goes_to_the_clients_of_the_port(self, robot):
        with self.script(robot) as one, self.script(robot) as other:
            for client in (one, other):
                self.greeting(client)
            other.sendall(b"def f():\n  movej([0, 0])\n  force_mode()\nend\n")
            for client in (one, other):
                message = self.message(client)
                assert message[14] == 10
                assert struct.unpack_from(">i", message, 15) == (3,)
                assert b"function 'force_mode'" in message

    @pytest.mark.parametrize(
        "data",
        [b"\xff\xfe\n", b"\0" * 1000 + b"\n", b"def \n" + b"x\n" * 5000 + b"end\n", b"(" * 10_000 + b"\n"],
        ids=["no text", "zeros", "nonsense", "brackets"],
    )
    def test_what_is_no_program_is_refused(self, robot, data):
        with self.script(robot) as client:
            self.greeting(client)
            client.sendall(data)
            assert b"line 1" in self.message(client)
        assert alive(robot)

    def test_a_program_without_an_end_is_dropped(self, robot, monkeypatch):
        monkeypatch.setattr("kinreach.deploy._server.MAX_CHARACTERS", 100_000)
        with self.script(robot) as client, suppress(OSError):
            self.greeting(client)
            client.sendall(b"def f():\n" + b"  sleep(1)\n" * 20_000)
            while client.recv(4096):
                pass
        assert not robot._clients
        assert alive(robot)
        assert robot.controller.runtime_state == 1


NEWER = {
    "DOUBLE": "joint_position_deviation_ratio collision_detection_ratio actual_robot_energy_consumed "
    "actual_robot_braking_energy_dissipated euromap67_24V_voltage euromap67_24V_current payload",
    "VECTOR6D": "actual_TCP_acceleration target_TCP_acceleration wrench_calc_from_currents target_base_acceleration "
    "target_base_wrench ft_raw_wrench payload_inertia actual_current_as_torque",
    "VECTOR3D": "target_gravity payload_cog",
    "INT32": "encoder0_raw encoder1_raw time_scale_source",
    "UINT32": "euromap67_input_bits euromap67_output_bits script_control_line",
    "UINT64": "control_step",
}


def test_variables_of_newer_controllers_are_there(robot):
    """A client with UR's shipped recipe ends at the first name that a robot does not have."""
    names = [name for each in NEWER.values() for name in each.split()]
    with Client(robot) as client:
        recipe = client.begin(names, 500.0)
        first, second = (recipe.unpack(client.next(Kind.DATA)[1:]) for _ in range(2))
    assert {name: type_of(name) for name in names} == {
        name: kind for kind, each in NEWER.items() for name in each.split()
    }
    assert second["control_step"] > first["control_step"]
    assert 0.0 <= first["joint_position_deviation_ratio"][0] < 0.1
    assert first["target_gravity"] == (0.0, 0.0, 9.82)
    assert first["ft_raw_wrench"] == (0.0,) * 6


def test_inputs_change_what_they_name_and_nothing_else():
    """Outputs by their masks, registers by their numbers, and the speed slider where its mask is not 0."""
    rng, tried, log = np.random.default_rng(0), 0, []
    with closing(SimulatedUR("ur5e", rtde_port=0, script_port=0, log=log.append)) as robot:
        ur = robot.controller
        for _ in range(40):
            before, analog, slider = int(rng.integers(1 << 18)), rng.uniform(0, 1, 2).tolist(), ur.speed_slider
            ur.io.digital, ur.io.analog = before, analog.copy()
            expected, values = before, {}
            for kind, first, width in (("standard_", 0, 8), ("configurable_", 8, 8), ("tool_", 16, 2)):
                mask, bits = (int(rng.integers(1 << width)) for _ in range(2))
                if rng.random() < 0.7:
                    values |= {f"{kind}digital_output_mask": (mask,), f"{kind}digital_output": (bits,)}
                    expected = expected & ~(mask << first) | (bits & mask) << first
            mask, shares = int(rng.integers(4)), rng.choice([-0.1, 0.0, 0.4, 1.0, 1.1, np.nan], 2).tolist()
            values |= {"standard_analog_output_mask": (mask,)}
            values |= {f"standard_analog_output_{i}": (share,) for i, share in enumerate(shares)}
            for i, share in enumerate(shares):
                analog[i] = share if mask >> i & 1 and 0.0 <= share <= 1.0 else analog[i]
            word, place = int(rng.integers(1 << 32)), int(rng.integers(24, 48))
            registers = {
                "input_bit_registers32_to_63": word, f"input_bit_register_{64 + place}": bool(rng.integers(2)),
                f"input_int_register_{place}": int(rng.integers(-9, 9)),
                f"input_double_register_{place}": float(rng.normal()),
            }  # fmt: skip
            fraction, wanted = float(rng.choice([0.0, 0.3, 0.8, 1.0, 1.5, np.nan])), int(rng.integers(2))
            values |= {name: (value,) for name, value in registers.items()}
            values |= {"speed_slider_fraction": (fraction,), "speed_slider_mask": (wanted,)}
            robot.set_inputs(values)
            assert ur.io.digital == expected
            assert ur.io.analog == analog
            for name, value in registers.items():
                assert output(ur, name) == (value,)
            assert output(ur, "input_bit_registers0_to_31") == (0,)
            assert [output(ur, f"output_{kind}_register_{place}") for kind in ("int", "double")] == [(0,), (0,)]
            if not wanted:
                assert ur.speed_slider == slider
            elif not 0.0 <= fraction <= 1.0:
                assert ur.speed_slider == slider
                assert log[-1] == f"speed slider must be from 0 to 1, got {fraction:g}: it stays"
            else:
                assert ur.speed_slider == fraction
                assert slider == fraction or log[-1] == f"speed slider at {100 * fraction:.0f} %"
            tried += 1
        robot.set_inputs({"speed_slider_fraction": (0.55,)})
        assert ur.speed_slider == 0.55
        words = ["input_bit_register_64", "input_bit_registers32_to_63", "input_bit_registers0_to_31"]
        for name, value in zip(words, (1, 0x80000001, 0x80000001), strict=True):
            robot.set_inputs({name: (value,)})  # each leaves those before it as they are
        assert [output(ur, name) for name in words] == [(True,), (0x80000001,), (0x80000001,)]
    assert tried == 40
    assert {line.partition(" ")[0] for line in log} == {"speed"}


def test_a_client_writes_outputs_and_registers_that_programs_read(robot):
    names = [
        "standard_digital_output_mask",
        "standard_digital_output",
        "input_int_register_24",
        "input_double_register_2",
        "standard_analog_output_mask",
        "standard_analog_output_0",
        "standard_analog_output_1",
        "input_bit_registers32_to_63",
        "input_bit_register_65",
    ]
    seen = ["actual_digital_output_bits", "input_int_register_24", "input_double_register_2", "output_int_register_3"]
    seen += ["standard_analog_output0", "standard_analog_output1", *names[-2:], "input_bit_register_66"]
    with Client(robot) as client, Client(robot) as watch:
        client.ask(Kind.PROTOCOL_VERSION, b"\0\2")
        answer = client.ask(Kind.SETUP_INPUTS, ",".join(names).encode())
        number, types = answer[0], answer[1:].decode().split(",")
        given = (0b110, 0b010, -5, 0.25, 0b10, 0.5, 1.0, 1 << 31 | 0b101, True)
        values = {name: (value,) for name, value in zip(names, given, strict=True)}
        client.socket.sendall(package(Kind.DATA, bytes([number]) + RtdeRecipe(names, types).pack(values)))
        recipe = watch.begin(seen, 500.0)
        while (state := recipe.unpack(watch.next(Kind.DATA)[1:]))["input_double_register_2"] != (0.25,):
            pass
        assert state[seen[0]] == (0b010,)
        assert state[seen[1]] == (-5,)
        before, analog = state[seen[4]], state[seen[5]]
        assert before < analog  # only the one of the mask is set, to its largest current or voltage
        assert [state[name] for name in seen[-3:]] == [(1 << 31 | 0b101,), (True,), (False,)]
        with socket.create_connection((robot.address, robot.script_port), PATIENCE) as script:
            script.sendall(b"write_output_integer_register(3, read_input_integer_register(24))\n")
            while recipe.unpack(watch.next(Kind.DATA)[1:])[seen[3]] != (-5,):
                pass
