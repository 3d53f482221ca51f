"""What may come to the ports of the simulated UR: it ends in a closed connection, and harms nobody."""

import fcntl
import selectors
import signal
import socket
import struct
import time
from contextlib import ExitStack, suppress

import numpy as np
import pytest

from kinreach.deploy import SimulatedUR, _server
from kinreach.deploy._rtde import HEADER, Kind, package
from kinreach.deploy._script_tree import ScriptError
from kinreach.deploy._urscript import MAX_LINE, parse, parsing
from tests.deploy.test_rtde import PATIENCE, Client, alive

#: A program that moves at once, and what would be seen of it.
MOVE = b"movej([0, -1.57, 1.57, -1.57, -1.57, 0], a=1, v=1)\n"
HELLO = package(Kind.PROTOCOL_VERSION, b"\0\2")


@pytest.fixture
def robot():
    log = []
    with SimulatedUR("ur5e", rtde_port=0, script_port=0, speed=20.0, log=log.append) as served:
        served.log = log
        yield served


def connected(robot, port):
    return socket.create_connection((robot.address, getattr(robot, f"{port}_port")), timeout=PATIENCE)


def until_closed(client):
    """Read until the robot closes the connection."""
    with suppress(ConnectionError, BrokenPipeError):
        while client.recv(65536):
            pass


def http(method, more=b""):
    head = method + b" / HTTP/1.1\r\nHost: 127.0.0.1:30002\r\nOrigin: http://a.example\r\nContent-Type: text/plain\r\n"
    return head + more + b"\r\n" + MOVE + b"def f():\n  " + MOVE + b"end\n"


#: What comes to both ports, and is for none of them.
ANYWHERE = {
    **{f"HTTP {method.decode()}": http(method) for method in (
        b"GET", b"POST", b"HEAD", b"PUT", b"OPTIONS", b"DELETE", b"PATCH", b"CONNECT", b"TRACE")},
    "a WebSocket": http(b"GET", b"Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"),
    "HTTP/2": b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + MOVE,
    "TLS": b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(range(200)) + b"\n" + MOVE,
    "TURN": struct.pack(">HHI", 3, 80, 0x2112A442) + bytes(12) + b"\x00\x06\x00\x40\n" + MOVE,
    "SSH": b"SSH-2.0-OpenSSH_9.6\r\n" + MOVE,
    "SMTP": b"HELO a.example\r\n" + MOVE,
    "Redis": b"*1\r\n$4\r\nPING\r\n" + MOVE,
    "a SIP invitation": b"INVITE sip:a@b SIP/2.0\r\n" + MOVE,
    "zeros": bytes(5000) + b"\n" + MOVE,
    "random bytes": np.random.default_rng(8).bytes(3000) + b"\n" + MOVE,
}  # fmt: skip
FOR_ONE_PORT = {
    "script": {
        "an endless line": b"x = " + b"1" * 200_000,
        "an endless line in a program": b"def f():\n  x = " + b"1" * 200_000,
        "a long line": b"x = " + b"1" * MAX_LINE + b"\n" + MOVE,
        "a control sign in a program": b"def f():\n  \x1b[2J\n" + MOVE + b"end\n",
        "RTDE": HELLO + package(Kind.SETUP_OUTPUTS, struct.pack(">d", 125.0) + b"actual_q\n") + MOVE,
    },
    "rtde": {
        "a script": b"def f():\n" + MOVE + b"end\n",
        "a script of one line": MOVE,
        **{f"{size} bytes of kind {kind.name}": HELLO + HEADER.pack(size, kind) for size, kind in (
            (0, Kind.START), (2, Kind.START), (4, Kind.START), (4, Kind.PAUSE), (6, Kind.PROTOCOL_VERSION),
            (4, Kind.CONTROLLER_VERSION), (1025, Kind.TEXT_MESSAGE), (10, Kind.SETUP_OUTPUTS),
            (2060, Kind.SETUP_OUTPUTS), (2052, Kind.SETUP_INPUTS), (16385, Kind.DATA),
            *((65535, kind) for kind in Kind))},
        **{f"kind {kind}": HEADER.pack(3, kind) for kind in sorted(set(range(256)) - set(Kind))[::15]},
    },
    "dashboard": {
        "an endless command": b"popup " + b"1" * 200_000,
        "a long command": b"popup " + b"1" * _server.MAX_COMMAND + b"\n" + b"shutdown\n",
        "RTDE": HELLO + b"\nshutdown\n",
        "a script of one line": MOVE,
        "a script": b"def f():\n" + MOVE + b"end\n",
    },
}  # fmt: skip
FOR_ONE_PORT["real_time"] = FOR_ONE_PORT["script"]


@pytest.mark.parametrize("port", list(FOR_ONE_PORT))
def test_what_is_not_for_a_port_is_not_read(robot, port):
    """One line of the log for each, no motion, and whoever listens hears on."""
    attacks = {**ANYWHERE, **FOR_ONE_PORT[port]}
    with Client(robot) as bystander:
        bystander.begin(["timestamp"], 500.0)
        for what, data in attacks.items():
            before = len(robot.log)
            with connected(robot, port) as client:
                with suppress(OSError):  # it does not read to the end
                    client.sendall(data)
                until_closed(client)
            lines = robot.log[before:]
            assert len(lines) == 1, (what, lines)
            assert lines[0].startswith("a client is disconnected: "), what
            assert lines[0].isprintable()
            assert len(lines[0]) < 200
        bystander.buffer.clear()
        bystander.next(Kind.DATA)
    assert len(attacks) > 20
    assert alive(robot)
    assert not robot.controller.target_qd.any()
    np.testing.assert_array_equal(robot.controller.target_q, robot.arm.home)


def test_the_first_line_decides_however_it_is_cut(robot):
    rng, tried = np.random.default_rng(0), 0
    for data in (http(b"POST"), ANYWHERE["TLS"], b"\r\n \n" + http(b"GET")):
        for _ in range(4):
            with connected(robot, "script") as client, suppress(OSError):
                for part in np.split(np.frombuffer(data, np.uint8), np.sort(rng.integers(0, len(data), 20))):
                    client.sendall(part.tobytes())
                until_closed(client)
            tried += 1
    assert tried == 12
    assert alive(robot)
    assert not robot.controller.target_qd.any()


def test_programs_as_people_send_them_are_read(robot):
    """Comments, names, definitions and calls may come first; what is refused keeps its connection for the reason."""
    for first in (b"# a comment", b"  def f():", b"x = 3", b"  textmsg(1)", b"foo()", b"sec s():", b"global a = 1"):
        with connected(robot, "script") as client:
            client.sendall(b"\n" + first + b"\n" + (b"end\n" if first.endswith(b":") else b""))
            client.sendall(b"foo()\n")
            said = b""
            while b"'foo'" not in said:
                data = client.recv(4096)
                assert data, first
                said += data
    assert not any("disconnected" in line for line in robot.log)


class TestSlowClients:
    @pytest.mark.parametrize(
        ("port", "part"),
        [("script", b"def f():\n"), ("script", b"x"), ("rtde", b"\0"), ("dashboard", b"popup"),
         ("rtde", HEADER.pack(2000, Kind.SETUP_OUTPUTS))],
    )  # fmt: skip
    def test_what_never_comes_to_an_end_is_ended(self, robot, port, part, monkeypatch):
        """Silent, or with another byte again and again; who has sent something complete stays."""
        with connected(robot, "script") as idle, connected(robot, port) as still, connected(robot, port) as slow:
            idle.sendall(b"foo()\n")
            said = b""
            while b"'foo'" not in said:  # after the robot's figures, which everybody gets
                said += (data := idle.recv(4096))
                assert data
            monkeypatch.setattr(_server, "UNFINISHED", 0.3)
            slow.sendall(part)
            still.sendall(part)
            until_closed(still)
            with suppress(OSError):
                while True:
                    slow.sendall(b" ")
            idle.sendall(b"foo()\n")
            while b"'foo'" not in idle.recv(4096):
                pass
        assert sum("has not come to an end within 0.3 s" in line for line in robot.log) == 2

    def test_a_complete_package_begins_the_time_anew(self, monkeypatch):
        """A client whose packages are always cut is not one that never comes to an end."""
        robot, now = SimulatedUR("ur5e", rtde_port=0, script_port=0), [0.0]
        monkeypatch.setattr(_server, "monotonic", lambda: now[0])
        left, right = socket.socketpair()
        with left, right:
            client = _server._RtdeClient(robot, left)
            robot._clients.append(client)
            for step in range(20):
                now[0] = float(step)
                client.received += (HELLO if step == 0 else HELLO[2:]) + HELLO[:2]
                client.work()
                assert client.unfinished_since == step
            client.received += HELLO[2:]
            client.work()
            assert client.unfinished_since == float("inf")
            robot._clients.remove(client)
        robot.close()

    @pytest.mark.slow
    def test_who_does_not_read_is_dropped_with_one_line(self, robot):
        with Client(robot) as deaf:
            deaf.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            deaf.begin([f"output_double_register_{n}" for n in range(48)] + ["actual_q"], 500.0)
            (served,) = robot._clients
            with Client(robot) as bystander:
                recipe = bystander.begin(["timestamp"], 500.0)
                most = 0
                while served in robot._clients:
                    bystander.next(Kind.DATA)
                    most = max(most, len(served.waiting))
                first, second = (recipe.unpack(bystander.next(Kind.DATA)[1:])["timestamp"][0] for _ in range(2))
        assert second > first
        assert most <= _server.MAX_WAITING + 1000
        assert robot.log == ["a client is disconnected: it does not read"]

    @pytest.mark.parametrize("port", ["script", "rtde", "dashboard", "real_time"])
    def test_half_closed_connections_are_closed(self, robot, port):
        with ExitStack() as stack:
            for how in (socket.SHUT_WR, socket.SHUT_RDWR) * 5:
                client = stack.enter_context(connected(robot, port))
                client.sendall(HELLO if port == "rtde" else MOVE[:20])
                client.shutdown(how)
                until_closed(client)
            assert alive(robot)
        assert not robot.controller.target_qd.any()


class TestManyClients:
    def test_many_that_say_nothing_keep_nobody_out(self, robot, monkeypatch):
        """They are turned away while those before them may be silent; later these make room. Who has spoken stays."""
        monkeypatch.setattr(_server, "SILENT", float("inf"))
        with ExitStack() as stack:
            first = stack.enter_context(Client(robot))
            first.ask(Kind.CONTROLLER_VERSION)
            for _ in range(50):
                stack.enter_context(connected(robot, "rtde"))
                stack.enter_context(connected(robot, "script"))
            for port in ("rtde", "script"):
                until_closed(stack.enter_context(connected(robot, port)))  # all before it are there now
            assert len(robot._clients) <= 2 * _server.MAX_CLIENTS
            full = [f"a client is refused: port {port} has 32 already" for port in (robot.rtde_port, robot.script_port)]
            assert sorted(robot.log) == sorted(full)  # one line for all
            monkeypatch.setattr(_server, "SILENT", 0.0)
            assert alive(robot)
            with connected(robot, "script") as client:
                client.sendall(b"textmsg(5)\n")
                with Client(robot) as other:
                    while "textmsg: 5" not in robot.log:
                        other.ask(Kind.CONTROLLER_VERSION)
            first.ask(Kind.CONTROLLER_VERSION)  # it has spoken, and stays
        assert sum("says nothing, and another one needs its place" in line for line in robot.log) >= 2

    def test_a_flood_does_not_stop_the_clock(self, robot):
        """Packages and programs are taken a few at a time, with control cycles between."""
        ticks = robot.controller._ticks
        count = 4000
        with Client(robot) as client:
            selector = selectors.DefaultSelector()
            selector.register(client.socket, selectors.EVENT_READ | selectors.EVENT_WRITE)
            client.socket.setblocking(False)
            flood, answered = package(Kind.CONTROLLER_VERSION) * count, 0
            while answered < count * (HEADER.size + 16):
                ((_, events),) = selector.select(PATIENCE)
                if events & selectors.EVENT_READ:
                    answered += len(client.socket.recv(65536))
                if flood and events & selectors.EVENT_WRITE:
                    flood = flood[client.socket.send(flood) :]
                elif not flood:
                    selector.modify(client.socket, selectors.EVENT_READ)
        assert robot.controller._ticks - ticks > count / _server.PACKAGES / 2
        ticks = robot.controller._ticks
        with connected(robot, "script") as client:
            client.sendall(b"textmsg(1)\n" * 500 + b"textmsg(2)\n")
            while "textmsg: 2" not in robot.log:
                assert alive(robot)
        assert robot.controller._ticks - ticks > 250

    def test_a_client_that_talks_is_not_heard_for_ever(self, robot):
        with Client(robot) as client:
            for number in range(200):
                client.socket.sendall(package(Kind.TEXT_MESSAGE, f"\x05hello {number}\0\0".encode()))
            client.ask(Kind.CONTROLLER_VERSION)
        assert len(robot.log) == _server.MAX_SAYINGS + 1
        assert robot.log[-1] == "a client says more, which is left out"


class TestLongPrograms:
    @pytest.mark.slow
    def test_a_long_program_is_read_while_time_passes(self, robot):
        """And one that comes meanwhile takes its place: the long one never moves."""
        long = b"def long():\n" + b"  x = -1\n" * 20_000 + b"  " + MOVE + b"end\n"
        with connected(robot, "script") as client, Client(robot) as bystander:
            bystander.begin(["timestamp"], 500.0)
            ticks = robot.controller._ticks
            client.sendall(long)
            while "program long is running" not in robot.log:
                bystander.next(Kind.DATA)
            assert robot.controller._ticks - ticks > 20
            client.sendall(b"def stop():\n  stopj(4)\nend\n" + long + b"def stop():\n  stopj(4)\nend\n")
            while robot.log.count("program stop is running") < 2:
                bystander.next(Kind.DATA)
            while robot.controller.runtime_state != 1:
                bystander.next(Kind.DATA)
        assert robot.log.count("program long is running") == 1

    @pytest.mark.slow
    def test_unfinished_programs_are_bounded_together(self, robot, monkeypatch):
        monkeypatch.setattr(_server, "MAX_UNFINISHED", 400_000)
        parts = b"  sleep(1)\n" * 20_000  # 220 kB
        with connected(robot, "script") as one, connected(robot, "script") as other:
            one.sendall(b"def f():\n" + parts[: len(parts) // 2])
            with suppress(OSError):
                other.sendall(b"def f():\n" + 2 * parts)
            until_closed(other)
            assert alive(robot)
            one.sendall(b"end\n")
            with Client(robot) as bystander:
                while "program f is running" not in robot.log:
                    bystander.ask(Kind.CONTROLLER_VERSION)
        assert sum("unfinished programs are too long" in line for line in robot.log) == 1

    def test_reading_is_divided(self, monkeypatch):
        """A part is a statement, or some lines; a number of statements is the most."""
        for text, statements, most in (("x = 1\n" * 700, 700, 770), ("#\n" * 7000, 0, 80)):
            parts = sum(1 for _ in parsing(f"def f():\n{text}end\n"))
            assert max(statements, 60) <= parts <= most
        monkeypatch.setattr("kinreach.deploy._urscript.MAX_STATEMENTS", 1000)
        assert len(parse("def f():\n" + "x=1\n" * 1000 + "end\n").body) == 1000
        with pytest.raises(ScriptError, match=r"line 1002, column .*: a program may have 1000 statements"):
            parse("def f():\n" + "x=1\n" * 1001 + "end\n")


@pytest.mark.slow
def test_seeded_noise_harms_nobody(robot):
    """Random bytes, and packages, programs and commands with some bytes changed, cut or repeated, at their ports."""
    rng = np.random.default_rng(12)
    good = {
        "rtde": HELLO + package(Kind.SETUP_OUTPUTS, struct.pack(">d", 125.0) + b"timestamp,actual_q")
        + package(Kind.SETUP_INPUTS, b"speed_slider_mask,speed_slider_fraction") + package(Kind.START)
        + package(Kind.DATA, b"\1" + struct.pack(">Id", 1, 0.5)) + package(Kind.PAUSE),
        "script": b"def f():\n  q = get_actual_joint_positions()\n  if norm(q[0]) > 9:\n    sleep(1)\n  end\n"
        b"  textmsg(\"a\")\nend\nset_tcp(p[0, 0, 0.1, 0, 0, 0])\n",
        "dashboard": b"robotmode\nprogramState\npopup a\npause\nplay\nstop\nPolyscopeVersion\nload a.urp\nquit\n",
    }  # fmt: skip
    ended = dict.fromkeys(good, 0)
    with Client(robot) as bystander:
        bystander.begin(["timestamp"], 500.0)
        for case in range(300):
            port = list(good)[case % 3]
            data = bytearray(good[port])
            if case % 5 == 0:
                data = bytearray(rng.bytes(int(rng.integers(1, 3000))))
            for _ in range(rng.integers(1, 6)):
                place = int(rng.integers(len(data)))
                match rng.integers(4):
                    case 0:
                        data[place] = rng.integers(256)
                    case 1:
                        del data[place : place + int(rng.integers(1, 9))]
                        data += b"\0"
                    case 2:
                        data[place:place] = data[place : place + 30]
                    case 3:
                        data[place:place] = rng.bytes(4)
            with connected(robot, port) as client:
                with suppress(OSError):
                    client.sendall(data)
                    client.shutdown(socket.SHUT_WR)
                until_closed(client)
                ended[port] += 1
            bystander.buffer.clear()
            bystander.next(Kind.DATA)
    assert ended == dict.fromkeys(good, 100)
    assert alive(robot)
    assert robot.controller.safety_mode == 1


@pytest.mark.parametrize("reader", ["waits", "is gone"])
@pytest.mark.slow
def test_a_log_that_nobody_reads_stops_nobody(simulated, reader):
    """Not the robot, and not its end by Ctrl-C."""
    address, process = simulated("--arm", "ur5e", "--no-cell")
    attempts = fcntl.fcntl(process.stdout.fileno(), 1031, 4096) // 20  # F_SETPIPE_SZ
    assert attempts > 200
    if reader == "is gone":
        attempts = 5
        for _ in range(3):  # what it says before it serves
            process.stdout.readline()
        process.stdout.close()
    for _ in range(attempts):
        with socket.create_connection((address, 30002), PATIENCE) as client:
            client.sendall(b"GET / HTTP/1.1\r\n")
            until_closed(client)
    there = type("Robot", (), {"address": address, "rtde_port": 30004})
    assert alive(there)
    process.send_signal(signal.SIGINT)
    assert process.wait(PATIENCE) == 130


def test_a_robot_without_work_waits_for_its_next_cycle(monkeypatch):
    """It looks at its connections some times in a cycle of 2 ms, not as often as a processor can."""
    looks = []

    class Counting(selectors.DefaultSelector):
        def select(self, timeout=None):
            looks.append(timeout)
            return super().select(timeout)

    monkeypatch.setattr(selectors, "DefaultSelector", Counting)
    with SimulatedUR("ur5e", rtde_port=0, script_port=0) as robot, connected(robot, "script"):
        time.sleep(0.3)
    assert 10 < len(looks) < 1500
