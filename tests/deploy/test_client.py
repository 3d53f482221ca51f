"""kinreach's client on the simulated UR: it reads, runs programs, and stops them."""

import gc
import os
import socket
import struct
import threading
from contextlib import closing, suppress
from dataclasses import replace

import numpy as np
import pytest

from kinreach.deploy import Move, Program, SimulatedUR, URClient, _client, _server
from kinreach.deploy._connection import LostError
from kinreach.deploy._rtde import NOT_FOUND, Kind, package, type_of
from kinreach.deploy._script_port import ScriptPort
from kinreach.deploy._states import _VARIABLES, StateReader
from kinreach.errors import InputError, RobotError
from kinreach.kinematics import ArmKinematics, Trajectory, pose
from kinreach.robots import get_arm
from kinreach.robots.inside import JOINTS
from tests.deploy.conftest import CALIBRATION, connected

ARM = get_arm("ur5e").calibrated(CALIBRATION).with_tool([0, 0, 0.1, 0, 0, 0])
KIN = ArmKinematics.of(ARM, base="base")
HOME = np.array(ARM.home)


@pytest.fixture
def robot():
    log = []
    with SimulatedUR(ARM, rtde_port=0, script_port=0, speed=8.0, log=log.append) as served:
        served.log = log
        yield served


def to(goal, **settings):
    return Program.of(KIN, HOME, [Move("movej", goal, settings.get("speed", 1.0), 2.0)])


def test_the_state_is_that_of_the_arm(client):
    state = client.read()
    np.testing.assert_allclose(state.actual_q, HOME, atol=1e-6)
    np.testing.assert_allclose(pose(state.tcp_pose), KIN.fk(state.actual_q), atol=1e-9)
    np.testing.assert_allclose(state.tcp_offset, [0, 0, 0.1, 0, 0, 0], atol=1e-9)
    assert (state.robot_mode, state.safety_mode, state.runtime_state, state.speed_scaling) == (7, 1, 1, 1.0)
    assert client.next_state().time - client.next_state().time == pytest.approx(-0.002)


def wait_for_clock(robot, seconds):
    """Let this time pass on the robot's own clock, seen by another client."""
    with connected(robot) as watch:
        end = watch.read().time + seconds
        while watch.read().time < end:
            pass


@pytest.mark.parametrize("seconds", [10.0, 60.0])
@pytest.mark.slow
def test_the_state_is_the_newest_however_long_nobody_reads(robot, client, seconds):
    """None is from before it was asked for, and the connection is kept."""
    for each in robot._clients:  # what is not read waits at the robot, which disconnects the client at a megabyte
        each.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
    asked = 0
    for idle in (0.0, seconds, 0.0, 0.1, 0.0):
        if idle:
            wait_for_clock(robot, idle)
        now = robot.controller.time
        assert client.read().time >= now - 0.0021
        asked += 1
    client._states._asked = 0.0  # as if it was long ago
    now = robot.controller.time
    assert client.next_state().time >= now - 0.0021
    assert asked == 5
    assert not any("does not read" in line for line in robot.log)


def test_every_state_is_kept_while_a_program_runs(robot, monkeypatch):
    """However slowly they are looked at; and again only some afterwards."""
    monkeypatch.setattr("kinreach.deploy._states.KEPT", 20)
    seen = []

    def dawdle(state):
        seen.append(state.time)
        if len(seen) in (20, 100):
            wait_for_clock(robot, 0.2)

    with connected(robot) as client:
        done = client.run(to(np.add(HOME, [0.2, 0, 0, 0, 0, 0])), watch=dawdle)
        wait_for_clock(robot, 0.2)
        assert len(client._states._waiting) <= 20
    np.testing.assert_allclose(np.diff(seen), 0.002, atol=1e-9)
    assert done.missing == 0
    assert len(seen) > 200


def test_few_states_wait_for_a_client_that_runs_no_program(robot, monkeypatch):
    monkeypatch.setattr("kinreach.deploy._states.KEPT", 20)
    with connected(robot) as client:
        wait_for_clock(robot, 0.1)
        assert len(client._states._waiting) <= 20


def test_threads_end_with_their_client(robot):
    before = threading.active_count()
    for _ in range(5):
        with connected(robot) as one:
            one.read()
            assert threading.active_count() == before + 2
        assert threading.active_count() == before

    def fail():
        with connected(robot):
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    forgotten = connected(robot)
    forgotten.read()
    del forgotten
    gc.collect()
    assert threading.active_count() == before
    one = connected(robot)
    one.close()
    one.close()  # twice is as good


def test_a_forked_process_has_no_connection_and_harms_none(client):
    """Its parent has the threads; both would share the robot's answers."""
    client.read()
    ours, theirs = os.pipe()
    child = os.fork()
    if child == 0:  # nothing of pytest may run here
        said = []
        for use in (client.read, client.next_state, client.stop):
            try:
                use()
            except RobotError as error:
                said.append(str(error))
        client.close()
        os.write(theirs, "\n".join(said).encode())
        os._exit(0)
    os.close(theirs)
    with os.fdopen(ours) as pipe:
        said = pipe.read().splitlines()
    assert os.waitpid(child, 0)[1] == 0
    assert len(said) == 3
    assert all("belongs to the process that opened it" in line for line in said)
    assert client.read().time > 0.0


def test_an_old_controller_knows_fewer_variables(robot, monkeypatch):
    known = _server.type_of
    monkeypatch.setattr(
        _server, "type_of", lambda name, **inputs: NOT_FOUND if name == "tcp_offset" else known(name, **inputs)
    )
    with connected(robot) as one:
        state = one.read()
    assert state.tcp_offset is None
    np.testing.assert_allclose(state.actual_q, HOME, atol=1e-6)


@pytest.mark.slow
def test_a_program_runs_and_is_recorded(client):
    goal, seen = np.add(HOME, [0.3, -0.1, 0.1, 0.0, 0.2, 0.0]), []
    for target in (goal, HOME):
        start = client.read().actual_q
        program = Program.of(KIN, start, [Move("movej", target, 1.0, 2.0)])
        done = client.run(program, watch=seen.append)
        assert (done.status, done.reason) == (2, "")
        np.testing.assert_allclose(done.commanded.q[-1], target, atol=1e-6)
        np.testing.assert_allclose(done.measured.q, done.commanded.q, atol=0.01)
        np.testing.assert_allclose(np.diff(done.commanded.t), 0.002, atol=1e-9)  # no cycle is missing
        assert done.missing == 0
        assert 0.7 < np.abs(done.measured.qd).max() < 0.8  # half of the way at 2 rad/s^2
    assert len(seen) > 300


@pytest.mark.slow
def test_why_a_robot_does_not_run_a_program_is_said(robot, client):
    with pytest.raises(RobotError, match=r"does not stand where the program begins: elbow_joint is 0.100"):
        client.run(Program.of(KIN, np.add(HOME, [0, 0, 0.1, 0, 0, 0]), [Move("movej", HOME, 1.0, 2.0)]))
    client.send(to(np.add(HOME, [1.5, 0, 0, 0, 0, 0]), speed=0.2).text)
    while client.next_state().runtime_state != 2:
        pass
    with pytest.raises(RobotError, match=r"runs a program already"):
        client.run(to(HOME))
    client.stop()
    assert client.read().runtime_state == 1
    q = client.read().actual_q
    down = np.add(q, [0, 2.0, -1.2, 0, 0, 0])
    said = r"the robot at 127.0.0.1 stopped: protective stop \(safety mode 3\): collision: .* touches table"
    with pytest.raises(RobotError, match=said):
        client.run(Program.of(KIN, q, [Move("movej", down, 2.0, 5.0)]))
    with pytest.raises(RobotError, match=r"is not ready: protective stop \(safety mode 3\)"):
        client.run(Program.of(KIN, q, [Move("movej", down, 2.0, 5.0)]))
    robot.release()
    while client.next_state().safety_mode == 3:
        pass
    assert client.run(Program.of(KIN, client.read().actual_q, [Move("movej", q, 1.0, 2.0)])).status == 2


def test_a_program_that_is_refused_does_not_begin(robot, client, monkeypatch):
    monkeypatch.setattr("kinreach.deploy._client.START_TIMEOUT", 0.3)
    program = to(HOME + 0.1)
    monkeypatch.setattr(Program, "text_of_run", lambda *_: "def f():\n  freedrive_mode()\nend\n")
    with pytest.raises(RobotError, match=r"did not begin: line 2, .*: function 'freedrive_mode'.*remote"):
        client.run(program)
    monkeypatch.setattr(URClient, "send", lambda *_: None)
    with pytest.raises(RobotError, match=r"did not begin; is it in remote control"):  # for another reason
        client.run(program)


def test_a_trajectory_is_streamed(client):
    t = np.linspace(0, 1, 100)
    share, rate = (1 - np.cos(np.pi * t)) / 2, np.pi / 2 * np.sin(np.pi * t)
    way = np.array([0.3, 0, 0.1, 0, 0, 0.2])
    motion = Trajectory(JOINTS, t, HOME + np.outer(share, way), np.outer(rate, way))
    done = client.run(Program.of(KIN, HOME, motion))
    np.testing.assert_allclose(done.commanded.q[-1], HOME + way, atol=1e-4)
    assert done.commanded.duration > 1.25  # the motion and what passes before it begins; a busy machine adds to it


@pytest.mark.slow
def test_a_minute_is_streamed(robot, client):
    """By the robot's cycles: it takes as long as the motion, and follows it with one lag, however long it was read."""
    t = np.linspace(0, 19 * np.pi, 1000)
    way = np.full(6, 0.1)
    motion = Trajectory(JOINTS, t, HOME + np.outer(np.sin(t) ** 2, way), np.outer(np.sin(2 * t), way))
    done = client.run(Program.of(KIN, HOME, motion))
    assert done.missing == 0
    cycles, q = np.rint(done.commanded.t / 0.002), done.commanded.q
    np.testing.assert_array_equal(np.diff(cycles), 1)
    moved = np.flatnonzero((np.diff(q, axis=0) != 0.0).any(axis=1))
    first, last = moved[0], moved[-1] + 1
    assert t[-1] < 0.002 * (last - first) < t[-1] + 0.5  # the last posture is held until the arm stands
    off = {}
    for lag in range(50):
        s = 0.002 * (np.arange(last - first) - lag)
        s = s[(s >= 0.0) & (s <= t[-1])]
        rows = np.arange(len(s)) + first + lag
        off[lag] = np.abs(HOME + np.outer(np.sin(s) ** 2, way) - q[rows]).max()
    assert len(s) > 29_000
    assert min(off.values()) < 1e-4  # a cycle that is lost or doubled moves all that comes after it by 2e-4
    np.testing.assert_allclose(q[-1], motion.q[-1], atol=1e-4)


@pytest.mark.parametrize("address", ["", "a b\n", "x" * 300, 7])
def test_bad_addresses(address):
    with pytest.raises((InputError, RobotError), match=r"address|no robot answers"):
        URClient(address)


def test_nobody_answers(free_address):
    with pytest.raises(RobotError, match=r"no robot answers at 127\.\d+\.\d+\.\d+:30004: Connection refused"):
        URClient(free_address())


def test_a_robot_without_a_script_port_leaves_no_connection(robot):
    threads = threading.active_count()
    with socket.create_server(("127.0.0.1", 0)) as server:
        unused = server.getsockname()[1]
    with pytest.raises(RobotError, match=f"no robot answers at 127.0.0.1:{unused}"):
        URClient(robot.address, rtde_port=robot.rtde_port, script_port=unused)
    assert threading.active_count() == threads


def test_the_robot_itself_refuses_to_begin_elsewhere(client, monkeypatch):
    """As where somebody moves it between the check and the program."""
    elsewhere = Program.of(KIN, np.add(HOME, [0, 0, 0.1, 0, 0, 0]), [Move("movej", HOME, 1.0, 2.0)])
    with pytest.raises(RobotError, match=r"does not stand where the program begins: elbow_joint is 0.1000 rad off"):
        client.check_ready(elsewhere)
    monkeypatch.setattr(URClient, "_check_ready", lambda *_: None)
    with pytest.raises(RobotError, match=r"did not move: it does not stand where the program begins"):
        client.run(elsewhere)
    np.testing.assert_allclose(client.read().actual_q, HOME, atol=1e-6)


def test_numbers_of_runs_are_never_that_of_the_one_before(monkeypatch):
    drawn = [6, 6, 6, 8]
    monkeypatch.setattr(_client, "randbelow", lambda below: drawn.pop(0) if below == 2**31 - 1 else None)
    assert (_client._number(), _client._number(7), drawn) == (7, 9, [])


def test_what_is_known_of_a_robot_that_was_to_stop(client):
    state, motion = client.read(), _client._motion
    assert motion(state, taken=True) == "a program still runs"
    assert motion(state, taken=False) == "it does not take the stop"
    moving = replace(state, actual_qd=np.array([0.1, -0.3, 0, 0, 0, 0]))
    assert motion(moving, taken=True) == "a joint moves at 0.30 rad/s"
    lost = replace(moving, time=np.nan)
    assert motion(lost, taken=True) == "it reports NaN or infinity"


def test_the_last_reason_counts_however_the_messages_are_cut():
    """As the script port sends them: others between, and pieces of any size."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = ScriptPort(*silent.getsockname())
        check_reasons(port)
        port.close()


def check_reasons(port):
    head = struct.pack(">QbB", 5, -1, 10)
    key = bytes([20]) + struct.pack(">QbB", 5, -1, 7)
    kinds = {
        "": [
            bytes([20]) + struct.pack(">QbB", 5, -1, 0) + b"a label",
            bytes([16]) + b"state of the robot, " * 3,
            b"\x14", key, key + bytes(8), head[:1] + head,
        ],
        "text": [bytes([20]) + head + struct.pack(">ii", 3, 1) + "line 3: ä".encode()],
        "key": [key + struct.pack(">iiB", 0, 0, 5) + b"Title" + b"collision"],
        "name": [key + struct.pack(">iiB", 0, 0, 19) + b"PROGRAM_XXX_STARTED" + b"f"],
    }  # fmt: skip
    said = {"text": "line 3: ä", "key": "collision"}
    rng, heard = np.random.default_rng(0), 0
    for _ in range(30):
        port.forget()
        order = rng.choice(list(kinds), 5)
        parts = [body for kind in order for body in kinds[kind]]
        stream = b"".join(struct.pack(">i", 4 + len(body)) + body for body in parts)
        for piece in np.split(np.frombuffer(stream, np.uint8), np.sort(rng.integers(0, len(stream), 6))):
            port.take(piece.tobytes(), more=False)
        wanted = [said[kind] for kind in order if kind in said]
        if wanted:
            assert port.reason(": ") == f": {wanted[-1]}"
        assert port.started == ["f"] * list(order).count("name")
        heard += bool(wanted)
    assert 20 < heard < 30
    for rubbish in (b"HTTP/1.1 400 Bad Request\r\n", b"\0\0\0\4\x14", b"\xff" * 50):  # of no UR
        port.take(rubbish, more=False)
        assert not port._buffer


def test_a_robot_that_falls_silent_is_lost_in_time(monkeypatch):
    """Before the first answer, and once it has answered."""
    monkeypatch.setattr("kinreach.deploy._connection.TIMEOUT", 0.3)
    monkeypatch.setattr("kinreach.deploy._states.TIMEOUT", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        with pytest.raises(RobotError, match=r"connection to the robot at 127\.0\.0\.1 is lost: (timed out|no answer)"):
            URClient("127.0.0.1", rtde_port=port, script_port=port)


def test_a_robot_that_no_longer_reports_is_lost(robot, client):
    """The connection is there, and nothing comes."""
    robot._publish = lambda: None
    client._states.patience = 0.2

    def read_on(use):
        while True:  # what had come before
            use()

    for use in (client.read, client.read, client.next_state):
        with pytest.raises(LostError, match=r"connection to the robot at 127\.0\.0\.1 is lost: no state for 0.2 s"):
            read_on(use)


@pytest.mark.parametrize("use", [URClient.read, URClient.next_state, URClient.stop])
def test_a_client_that_is_closed_has_lost_its_robot(client, use):
    client.close()
    with pytest.raises(LostError, match=r"connection to the robot at 127\.0\.0\.1 is lost"):
        use(client)


#: What a server that is no UR may answer to the first question.
ANSWERS = {
    "hangs up": (b"", "connection was closed"),
    "another protocol": (package(Kind.PROTOCOL_VERSION, b"\0"), "no RTDE protocol 2"),
    "HTTP": (b"HTTP/1.1 400 Bad Request\r\n\r\n" + b"x" * 70_000, "closed|no answer|not a UR"),
    "a size of nothing": (b"\0\0V", "is not a UR: an RTDE package has"),
}


def answers(*types, start=b"\1"):
    """A controller's answers to all questions before the first state."""
    parts = [(Kind.PROTOCOL_VERSION, b"\1"), (Kind.CONTROLLER_VERSION, struct.pack(">4I", 5, 11, 0, 0))]
    parts += [*((Kind.SETUP_OUTPUTS, b"\1" + each.encode()) for each in types), (Kind.START, start)]
    return b"".join(package(*part) for part in parts)


TYPES = ",".join(type_of(name) for name in _VARIABLES)
ANSWERS |= {
    "no time": (answers(NOT_FOUND + TYPES[6:], TYPES[7:]), "does not know timestamp$"),
    "fewer types than names": (answers("DOUBLE"), "does not know what is asked for"),
    "an unknown type": (answers(TYPES.replace("DOUBLE", "FLOAT", 1)), "has a type 'FLOAT', which RTDE has not"),
    "not now": (answers(TYPES, start=b"\0"), "the robot at 127.0.0.1 refuses to send its state"),
}


@pytest.mark.parametrize("what", ANSWERS)
def test_what_answers_is_no_ur(what):
    answer, reason = ANSWERS[what]
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve():
            connection, _ = server.accept()
            with connection:
                connection.recv(100)
                connection.sendall(answer)
                connection.shutdown(socket.SHUT_WR)
                with suppress(ConnectionError):
                    while connection.recv(4096):
                        pass

        thread = threading.Thread(target=serve)
        thread.start()
        port = server.getsockname()[1]
        with pytest.raises(RobotError, match=reason), closing(StateReader("127.0.0.1", port)) as reader:
            reader.read()
        thread.join()


def test_a_state_of_another_size_is_of_no_ur(client):
    with pytest.raises(RobotError, match=r"127.0.0.1 is not a UR: an RTDE data package has 20 bytes, its recipe \d+"):
        client._states._state(bytes(20))


def test_a_lost_connection_is_said(robot, client):
    robot.close()

    def read_on():
        while True:
            client.next_state()

    with pytest.raises(LostError, match=r"connection to the robot at 127.0.0.1 is lost") as lost:
        read_on()
    assert isinstance(lost.value, ConnectionError)
    with pytest.raises(LostError):
        client.read()
