"""Other people's clients on the simulated UR, as `make ur-clients` tries them, and what UR's own client sends."""

import re
import socket
import struct
import sys
from importlib.util import find_spec

import numpy as np
import pytest

from kinreach.deploy import SimulatedUR
from kinreach.deploy._rtde import RtdeRecipe, names_in
from tests.deploy.test_rtde import PATIENCE, Client
from tests.deploy.test_rtde import Kind as K
from tools.ur_clients.__main__ import CLIENTS, PAGE, REASONS, table, tried

MODULES = {"ur_rtde": "rtde_control", "urx": "urx"}
#: The recipes that Universal Robots' client for Python ships: names and types.
RECORD = {
    "DOUBLE": "timestamp actual_execution_time speed_scaling target_speed_fraction actual_momentum actual_main_voltage "
    "actual_robot_voltage actual_robot_current joint_position_deviation_ratio",
    "VECTOR6D": "target_q target_qd target_qdd target_current target_moment actual_q actual_qd actual_current "
    "joint_control_output actual_TCP_pose actual_TCP_speed actual_TCP_force target_TCP_pose target_TCP_speed "
    "joint_temperatures actual_joint_voltage",
    "UINT64": "actual_digital_input_bits actual_digital_output_bits",
    "INT32": "robot_mode safety_status",
    "VECTOR6INT32": "joint_mode",
    "VECTOR3D": "actual_tool_accelerometer",
    "UINT32": "runtime_state",
}
#: What the program on the robot does in its example of a control loop.
CONTROL = """def control():
  while True:
    write_output_integer_register(0, 1)
    while read_input_integer_register(0) != 1:
      sync()
    end
    x = p[0, 0, 0, 0, 0, 0]
    i = 0
    while i < 6:
      x[i] = read_input_float_register(i)
      i = i + 1
    end
    movej(get_inverse_kin(x), a=3, v=2)
    write_output_integer_register(0, 0)
    while read_input_integer_register(0) == 1:
      sync()
    end
  end
end
"""


@pytest.mark.slow
@pytest.mark.parametrize("client", CLIENTS)
def test_a_client_does_what_the_page_says(client, simulated):
    if find_spec(MODULES[client]) is None:
        pytest.skip(f"{client} is not installed here: `make ur-clients` tries it in an environment of its own")
    address, _ = simulated("--arm", "ur5e")
    rows = tried(client, address, sys.executable)
    kept = PAGE.read_text(encoding="utf-8")
    for line in table(rows).splitlines()[2:]:
        assert line in kept
    assert len(rows) >= 12


def test_the_page_gives_a_reason_for_what_does_not_work():
    rows = [line.split(" | ") for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| ur")]
    fails = {call for row in rows if len(row) == 4 for call in re.findall(r"`([^`]*)`: ", row[3])}
    assert fails == {call for _, call in REASONS}
    assert sum(row[2].count("`") // 2 for row in rows if len(row) == 4) > 60


@pytest.fixture
def robot():
    with SimulatedUR("ur5e", rtde_port=0, script_port=0, speed=20.0) as served:
        yield served


def begun(client, names, types, frequency=125.0):
    """Begin as UR's client does, which compares the types with those of its file."""
    assert client.ask(K.PROTOCOL_VERSION, b"\0\2") == b"\1"
    assert len(client.ask(K.CONTROLLER_VERSION)) == 16
    said = client.ask(K.SETUP_OUTPUTS, struct.pack(">d", frequency) + ",".join(names).encode())
    assert names_in(said[1:]) == types
    return RtdeRecipe(names, types)


def test_urs_client_records_with_its_recipe(robot):
    types = {name: kind for kind, names in RECORD.items() for name in names.split()}
    with Client(robot) as client:
        recipe = begun(client, list(types), list(types.values()))
        assert client.ask(K.START) == b"\1"
        rows = [recipe.unpack(client.next(K.DATA)[1:]) for _ in range(50)]
        assert client.ask(K.PAUSE) == b"\1"
    np.testing.assert_allclose(np.diff([row["timestamp"][0] for row in rows]), 0.008, atol=1e-9)
    assert rows[-1]["robot_mode"] == (7,)
    np.testing.assert_allclose(rows[-1]["actual_q"], robot.arm.home, atol=1e-4)


def test_urs_client_controls_with_its_recipes(robot):
    """Two poses in turn, each confirmed by the program on the robot, with the register that it watches."""
    setpoint, watched = [f"input_double_register_{n}" for n in range(6)], ["input_int_register_0"]
    poses = [[-0.12, -0.43, 0.14, 0, 3.11, 0.04], [-0.12, -0.51, 0.21, 0, 3.11, 0.04]]
    with Client(robot) as client:
        state = begun(client, ["target_q", "target_qd", "output_int_register_0"], ["VECTOR6D", "VECTOR6D", "INT32"])
        numbers = [client.ask(K.SETUP_INPUTS, ",".join(names).encode())[0] for names in (setpoint, watched)]
        with socket.create_connection((robot.address, robot.script_port), PATIENCE) as script:
            script.sendall(CONTROL.encode())
        assert client.ask(K.START) == b"\1"

        def send(number, form, *values):
            client.socket.sendall(struct.pack(">HBB", 4 + struct.calcsize(form), K.DATA, number))
            client.socket.sendall(struct.pack(form, *values))

        def until(value):
            while (now := state.unpack(client.next(K.DATA)[1:]))["output_int_register_0"] != (value,):
                pass
            return now

        reached = 0
        for pose in poses:
            until(1)
            send(numbers[0], ">6d", *pose)
            send(numbers[1], ">i", 1)
            q = until(0)["target_q"]
            np.testing.assert_allclose(robot.controller.tcp_pose(np.array(q))[:3], pose[:3], atol=1e-6)
            send(numbers[1], ">i", 0)
            reached += 1
    assert reached == 2
