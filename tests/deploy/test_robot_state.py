"""What ports 30001 to 30003 send: the layouts of the maker's client interfaces, with the state of the controller."""

import socket
import struct

import numpy as np
import pytest

from kinreach.deploy import SimulatedUR
from kinreach.deploy._controller import Controller
from kinreach.deploy._primary import news_in
from kinreach.deploy._robot_state import real_time_state, state
from kinreach.robots import get_arm
from tests.deploy.test_rtde import PATIENCE, alive

#: Places of the fields of port 30003, in numbers of 8 bytes after the size.
FIELDS = {
    "time": 0, "target_q": 1, "target_qd": 7, "target_qdd": 13, "actual_q": 31, "actual_qd": 37, "tool": 55,
    "tool_speed": 61, "force": 67, "target_tool": 73, "target_tool_speed": 79, "robot_mode": 94, "joint_modes": 95,
    "safety_mode": 101, "speed_scaling": 117, "outputs": 130, "program": 131, "safety_status": 138, "payload": 142,
    "centre": 143, "inertia": 146,
}  # fmt: skip


def moving(name):
    ur = Controller(get_arm(name).with_tool([0.01, -0.02, 0.15, 0.3, 0, 0]))
    goal = np.add(ur.arm.home, 0.3).tolist()
    setup = "set_target_payload(1.5, [0.01, 0.02, 0.03], [1, 2, 3, 4, 5, 6])\n  set_standard_digital_out(3, True)"
    ur.start(f"def f():\n  {setup}\n  movej({goal}, a=3, v=0.5)\nend\n")
    for _ in range(100 if ur.cycle < 0.005 else 25):
        ur.tick()
    assert np.abs(ur.target_qd).min() > 0.1
    return ur


def parts_of(package):
    size, kind = struct.unpack_from(">iB", package)
    assert (size, kind) == (len(package), 16)
    found, place = {}, 5
    while place < size:
        length, part = struct.unpack_from(">IB", package, place)
        found[part] = package[place + 5 : place + length]
        place += length
    assert place == size
    return found


@pytest.mark.parametrize(("name", "masterboard"), [("ur5e", 75), ("ur5", 72)])
def test_the_state_of_the_primary_interface(name, masterboard):
    ur = moving(name)
    parts = parts_of(state(ur))
    sizes = {0: 47, 1: 251, 2: 37, 3: masterboard, 4: 101, 7: 61, 8: 9}
    assert {kind: len(part) + 5 for kind, part in parts.items()} == sizes
    stamp, *flags = struct.unpack_from(">Q7?", parts[0])
    assert (stamp, flags) == (round(1e6 * ur.time), [True, True, True, False, False, True, False])
    assert struct.unpack_from(">BBddd", parts[0], 15) == (7, 0, 1.0, 1.0, 1.0)
    joints = np.array(struct.unpack(">" + "dddffffB" * 6, parts[1])).reshape(6, 8)
    np.testing.assert_array_equal(joints[:, :3].T, [ur.actual_q, ur.target_q, ur.actual_qd])
    assert (joints[:, 7] == 253).all()
    assert struct.unpack_from(">II", parts[3]) == (0, 8)
    np.testing.assert_allclose(struct.unpack(">12d", parts[4])[:6], ur.tcp_pose(ur.actual_q), atol=1e-12)
    np.testing.assert_allclose(struct.unpack(">12d", parts[4])[6:], [0.01, -0.02, 0.15, 0.3, 0, 0], atol=1e-12)
    assert not any(parts[7])  # no force
    assert struct.unpack(">B??B", parts[8])[:3] == (0, False, False)  # of the teach button: not pressed, not enabled
    assert list(news_in(bytearray(state(ur)))) == []  # the client looks for the kinematics only


@pytest.mark.parametrize(("name", "size"), [("ur5e", 1220), ("ur5", 1116)])
def test_the_state_of_the_real_time_interface(name, size):
    ur = moving(name)
    data = real_time_state(ur)
    assert (len(data), struct.unpack_from(">i", data)[0]) == (size, size)
    numbers = np.array(struct.unpack(f">{(size - 4) // 8}d", data[4:]))
    q, qd, target, speed = ur.actual_q, ur.actual_qd, ur.target_q, ur.target_qd
    wanted = {
        "time": [ur.time], "target_q": target, "target_qd": speed, "target_qdd": ur.target_qdd, "actual_q": q,
        "actual_qd": qd, "tool": ur.tcp_pose(q), "tool_speed": ur.tcp_speed(q, qd), "force": np.zeros(6),
        "target_tool": ur.tcp_pose(target), "target_tool_speed": ur.tcp_speed(target, speed), "robot_mode": [7],
        "joint_modes": [253] * 6, "safety_mode": [1], "speed_scaling": [1], "outputs": [8], "program": [2],
        "safety_status": [1], "payload": [1.5], "centre": [0.01, 0.02, 0.03], "inertia": [1, 2, 3, 4, 5, 6],
    }  # fmt: skip
    compared = 0
    for field, values in wanted.items():
        if FIELDS[field] < len(numbers):
            np.testing.assert_array_equal(numbers[FIELDS[field] :][: len(values)], values, err_msg=field)
            compared += 1
    assert compared == (len(FIELDS) if name == "ur5e" else len(FIELDS) - 3)


def received(client, count):
    data = b""
    while len(data) < count:
        data += (more := client.recv(count - len(data)))
        assert more
    return data


def test_states_come_in_time_and_wait_for_nobody():
    """At times on the script ports, and in every cycle on the real-time port, which takes programs, too."""
    log = []
    with (
        SimulatedUR("ur5e", rtde_port=0, script_port=0, speed=4, log=log.append) as robot,
        socket.create_connection((robot.address, robot.script_port), PATIENCE) as slow,
        socket.create_connection((robot.address, robot.real_time_port), PATIENCE) as fast,
        socket.socket() as deaf,
    ):
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        deaf.connect((robot.address, robot.real_time_port))
        received(deaf, 4)
        (served,) = [client for client in robot._clients if client.socket.getpeername() == deaf.getsockname()]
        served.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        fast.sendall(b"set_payload(2.5, [0, 0, 0])\n")
        times, payloads = [], [0.0]
        while len(times) < 100 or payloads[-1] != 2.5:
            numbers = struct.unpack(">i152d", received(fast, 1220))[1:]
            times.append(numbers[FIELDS["time"]])
            payloads.append(numbers[FIELDS["payload"]])
        np.testing.assert_allclose(np.diff(times), 0.002, atol=1e-9)
        stamps = []
        while len(stamps) < 4:
            size, kind = struct.unpack(">iB", received(slow, 5))
            body = received(slow, size - 5)
            if kind == 16 and body[4] == 0:  # begins with the mode
                stamps.append(struct.unpack_from(">Q", body, 5)[0])
        assert (np.diff(stamps) > 0).all()
        assert served in robot._clients
        assert 0 < len(served.waiting) <= 1220
        assert alive(robot)
    assert not [line for line in log if "disconnected" in line]


def test_who_sends_a_program_and_closes_is_read_to_the_end():
    """The state that it does not read makes its end a reset, which comes before its program is read."""
    robot = SimulatedUR("ur5e", rtde_port=0, script_port=0, log=(log := []).append)
    try:
        with socket.create_connection((robot.address, robot.script_port), PATIENCE) as client:
            ((accept, events),) = robot._selector.select(PATIENCE)
            accept.data(events)
            received(client, 100)  # not all
            client.sendall(b"textmsg(7)\n")
        (served,) = robot._clients
        for _ in range(1000):
            robot._stream(type(served), state)
            if served.has_gone:
                break
        assert served.has_gone
        while robot._clients:
            for key, events in robot._selector.select(PATIENCE):
                key.data(events)
            served.work()
        while robot._starting is not None:
            robot._go_on_starting()
        robot.controller.tick()
        assert "textmsg: 7" in log
    finally:
        robot.close()
