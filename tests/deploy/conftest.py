"""A simulated UR in a process of its own, as a user starts it."""

import os
import subprocess
import sys
from itertools import count
from pathlib import Path

import pytest

from kinreach.deploy import URClient
from kinreach.robots import PUBLISHED_CALIBRATIONS

ROOT = Path(__file__).parents[2]
TOOL = "0.01,-0.02,0.15,0.3,0,0"
CALIBRATION = PUBLISHED_CALIBRATIONS["ur5e_a"]
NUMBERS = count(1)


def connected(robot):
    """A client of a robot in this process."""
    return URClient(robot.address, rtde_port=robot.rtde_port, script_port=robot.script_port)


@pytest.fixture
def client(robot):
    """A client of the module's own `robot`."""
    with connected(robot) as one:
        yield one


@pytest.fixture(scope="session")
def free_address():
    """`free_address()`: a loopback address where nobody listens, so that the ports of a UR are free."""

    def address() -> str:
        number = os.getpid()
        return f"127.{100 + next(NUMBERS) % 100}.{number >> 8 & 255}.{number & 255 or 1}"

    return address


@pytest.fixture(scope="session")
def simulated(free_address):
    """`simulated(*flags)`: the address of `kinreach simulate-ur` with these flags, and its process."""
    processes = []

    def start(*flags):
        address = free_address()
        process = subprocess.Popen(
            [sys.executable, "-m", "kinreach", "simulate-ur", "--address", address, *flags],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )  # fmt: skip
        processes.append(process)
        first = process.stdout.readline()
        assert address in first, first + process.stdout.read()
        return address, process

    yield start
    for process in processes:
        process.terminate()
        process.wait(60)
        process.stdout.close()
