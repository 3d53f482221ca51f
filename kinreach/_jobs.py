"""Where jobs run: here, one after the other, or as tasks of Ray, on this machine's cores or on a cluster.

A job is an argument of a generator function that depends on nothing else. Engines yield the same values at other
times. Ray schedules jobs, and restarts those of dead workers and nodes.
"""

from __future__ import annotations

import argparse
import math
import os
import platform
import socket
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from itertools import islice
from typing import Any, Protocol, TypeVar

from kinreach import _provenance as provenance
from kinreach._checks import check_known
from kinreach._engines import load_extra
from kinreach.errors import ClusterError, InputError, InstallationError

Part = TypeVar("Part")
Job = TypeVar("Job")
Value = TypeVar("Value")

SERIAL, RAY = "serial", "ray"
#: Most jobs of one run: Ray keeps a record of each.
MAX_JOBS = 10_000


class Engine(Protocol):
    """Where jobs run: in this process, in several, or on a cluster."""

    def split(self, parts: Sequence[Part], least: int) -> list[Sequence[Part]]:
        """Divide work into jobs.

        Args:
            parts: In their order.
            least: Smallest number of parts that is worth the start of a job.
        """
        ...

    def map(
        self, function: Callable[[Job], Iterator[Value]], jobs: Sequence[Job], *, threads: int = 1, together: int = 1
    ) -> Iterator[tuple[int, Value]]:
        """Yield pairs of a job's number and one of its values, those of one job in order.

        Args:
            function: From a job to its values.
            jobs: All of them.
            threads: Number that a job computes with.
            together: Number of values that are sent at once.
        """
        ...


class Serial:
    """One job after the other, in this process."""

    def split(self, parts: Sequence[Part], least: int) -> list[Sequence[Part]]:
        """Return everything as one job."""
        return [parts]

    def map(
        self, function: Callable[[Job], Iterator[Value]], jobs: Sequence[Job], *, threads: int = 1, together: int = 1
    ) -> Iterator[tuple[int, Value]]:
        """Run one job after the other; see `Engine.map`."""
        for number, job in enumerate(jobs):
            for value in function(job):
                yield number, value


class Ray:
    """Each job a task of the Ray cluster that this process is connected to.

    Args:
        ray: The package.
    """

    def __init__(self, ray: Any) -> None:
        self._ray = ray

    def split(self, parts: Sequence[Part], least: int) -> list[Sequence[Part]]:
        """Jobs of `least` parts, or of more where they would be more than `MAX_JOBS`."""
        size = max(least, math.ceil(len(parts) / MAX_JOBS))
        return [parts[first : first + size] for first in range(0, len(parts), size)]

    def map(
        self, function: Callable[[Job], Iterator[Value]], jobs: Sequence[Job], *, threads: int = 1, together: int = 1
    ) -> Iterator[tuple[int, Value]]:
        """As `Engine.map`.

        Raises:
            ClusterError: A task was lost more often than Ray runs it again, or the cluster died.
            KinreachError: What a job raised.
        """
        ray = self._ray
        task = ray.remote(num_returns="streaming", num_cpus=threads, max_retries=3)(_values)
        try:
            shared = ray.put((function, _versions(), together))
            streams = {task.remote(shared, job): number for number, job in enumerate(jobs)}
            while streams:
                for stream in ray.wait(list(streams), num_returns=1)[0]:
                    try:
                        values = ray.get(next(stream))
                    except StopIteration:
                        del streams[stream]
                        continue
                    for value in values:
                        yield streams[stream], value
        except ray.exceptions.RayTaskError as error:
            raise error.cause from error
        except ray.exceptions.RayError as error:
            raise ClusterError(f"the cluster lost a task: {str(error).strip().splitlines()[0]}") from error


def _values(
    shared: tuple[Callable[[Job], Iterator[Value]], Mapping[str, Any], int], job: Job
) -> Iterator[tuple[Value, ...]]:
    """Yield a job's values in groups, which are the same however often Ray runs it.

    Raises:
        InstallationError: The node has other versions than the driver.
    """
    function, versions, together = shared
    for name, here in _versions().items():
        if here != versions[name]:
            version = f"{here or 'no'} {name}, the driver {versions[name] or 'none'}"
            raise InstallationError(f"the node {platform.node()} has {version}: install the same on all")
    values = function(job)
    while group := tuple(islice(values, together)):
        yield group


@cache
def _versions() -> dict[str, str | None]:
    return provenance.versions((*provenance.DISTRIBUTIONS, "torch", "stable-baselines3"))


@contextmanager
def open_engine(name: str = SERIAL, address: str | None = None) -> Iterator[Engine]:
    """Open an engine for the length of the block.

    A process that is connected to a Ray cluster already uses that one.

    Args:
        name: `"serial"` or `"ray"`.
        address: Of a running Ray cluster, `host:port`, or `auto` for the one of this machine; Ray is started on this
            machine if None.

    Raises:
        InstallationError: Ray is not installed.
        InputError: Unknown engine, or an address of the serial one.
        ClusterError: Nothing answers at the address.
    """
    check_known("engine", name, (SERIAL, RAY))
    if name == SERIAL:
        if address is not None:
            raise InputError(f"an address is that of a Ray cluster: engine {RAY!r}, not {SERIAL!r}")
        yield Serial()
        return
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")  # else a warning of what will change
    ray = load_extra("ray", RAY)
    if ray.is_initialized():
        yield Ray(ray)
        return
    if address is not None:
        _check_address(address)
    try:
        ray.init(address=address or "local", include_dashboard=None if address else False, log_to_driver=False,
                 logging_level="ERROR")  # fmt: skip
    except (ConnectionError, RuntimeError, ValueError) as error:
        where = f"no Ray cluster answers at {address}" if address else "Ray does not start"
        raise ClusterError(f"{where}: {str(error).strip().splitlines()[0]}") from error
    try:
        yield Ray(ray)
    finally:
        ray.shutdown()


def _check_address(address: str) -> None:
    """Check that a cluster's address accepts connections; Ray itself would try for minutes.

    Raises:
        InputError: The address is malformed.
        ClusterError: Nothing accepts a connection.
    """
    if address == "auto":
        return
    host, _, port = address.rpartition(":")
    if not host or "/" in host or not port.isdecimal() or int(port) >= 2**16:
        raise InputError(f"the address of a Ray cluster is host:port, such as 10.0.0.1:6379, or auto; got {address!r}")
    try:
        socket.create_connection((host.strip("[]"), int(port)), 5.0).close()
    except OSError as error:
        raise ClusterError(
            f"no Ray cluster answers at {address} ({error.strerror or error}): check the address, and that "
            "`ray start --head` runs there"
        ) from error


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add `--engine` and `--address` to a command."""
    parser.add_argument(
        "--engine",
        default=SERIAL,
        metavar="ENGINE",
        help="what runs it: serial, or ray: on all cores of this machine, or of a cluster (default: %(default)s)",
    )
    parser.add_argument("--address", metavar="HOST:PORT", help="of a running Ray cluster, or auto (default: start one)")
