"""Trajectories as files: ROS 2's JointTrajectory as JSON, and CSV. Nothing in a file is executed."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from kinreach._checks import check_path, shown
from kinreach._files import read_text, write_text
from kinreach._tables import Table, read_table
from kinreach.deploy._program import Program
from kinreach.deploy._urscript import MAX_CHARACTERS
from kinreach.errors import InputError
from kinreach.kinematics import Trajectory

#: Largest file [bytes]; nanoseconds of a second.
MAX_BYTES, NANO = 2**28, 1_000_000_000
#: Ending of the column with the speeds of a joint.
VELOCITY = "_velocity"
#: Endings of the files: ROS 2's message, a table, URScript.
JSON, CSV, SCRIPTS = ".json", ".csv", (".script", ".urscript")


def write_trajectory(trajectory: Trajectory, file: str | Path) -> None:
    """Write a trajectory to a file in the format of its ending.

    - `.json`: ROS 2's `trajectory_msgs/JointTrajectory`, times to the nanosecond.
    - `.csv`: a column `time` [s], one for each joint [rad], and one for each joint's speed [rad/s], named
      `JOINT_velocity`.

    For URScript see `Program`.

    Args:
        trajectory: Of any arm.
        file: Path; a file that is there is replaced.

    Raises:
        InputError: Another ending, or samples that are closer than a nanosecond.
        OutputError: It cannot be written.
    """
    path = check_path("file", file)
    if path.suffix == JSON:
        write_text(path, json.dumps(_message(trajectory), indent=1))
    elif path.suffix == CSV:
        text = io.StringIO()
        rows = csv.writer(text, lineterminator="\n")
        rows.writerow(["time", *trajectory.joints, *(f"{joint}{VELOCITY}" for joint in trajectory.joints)])
        rows.writerows(np.column_stack([trajectory.t, trajectory.q, trajectory.qd]).tolist())
        write_text(path, text.getvalue())
    else:
        raise InputError(f"a trajectory is written as {JSON} (ROS 2) or {CSV}, got {path.name}")


def read_trajectory(file: str | Path) -> Trajectory:
    """Read a trajectory from a file that `write_trajectory` or ROS 2 wrote, or from a `servoj` program of kinreach.

    Args:
        file: Path that ends in `.json`, `.csv`, `.script` or `.urscript`.

    Returns:
        The trajectory. Where a message has no velocities, and in URScript, the speeds are differences.

    Raises:
        InputError: The file cannot be read, or does not have the format of its ending; the message gives the place.
    """
    path = check_path("file", file)
    if path.suffix not in (JSON, CSV, *SCRIPTS):
        raise InputError(f"a trajectory is read from {JSON}, {CSV} or {SCRIPTS[0]}, got {path.name}")
    if path.suffix == CSV:
        return _from_table(read_table(path, "the trajectory", most=MAX_BYTES))
    limit = MAX_CHARACTERS if path.suffix in SCRIPTS else MAX_BYTES
    text = read_text(path, "the trajectory", most=limit).removeprefix("\ufeff")
    try:
        if path.suffix == JSON:
            return _from_message(text)
        program = Program.parse(text)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    if program.trajectory is None:
        raise InputError(f"{path} has moves, and no trajectory; Program.parse reads them")
    return program.trajectory


def _message(trajectory: Trajectory) -> dict[str, Any]:
    stamps = [divmod(round(t * NANO), NANO) for t in trajectory.t.tolist()]
    if len(set(stamps)) < len(stamps):
        raise InputError("two samples of the trajectory are closer than a nanosecond")
    rows = zip(stamps, trajectory.q.tolist(), trajectory.qd.tolist(), strict=True)
    return {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""},
        "joint_names": list(trajectory.joints),
        "points": [
            {
                "positions": q,
                "velocities": qd,
                "accelerations": [],
                "effort": [],
                "time_from_start": {"sec": seconds, "nanosec": nanoseconds},
            }
            for (seconds, nanoseconds), q, qd in rows
        ],
    }


def _from_message(text: str) -> Trajectory:
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"not JSON: {error}") from None
    names = content.get("joint_names") if isinstance(content, Mapping) else None
    points = content.get("points") if isinstance(content, Mapping) else None
    if not isinstance(names, list) or not isinstance(points, list) or not points:
        raise InputError("a JointTrajectory needs joint_names and points")
    t, q, qd = [], [], []
    for number, point in enumerate(points):
        try:
            stamp = point["time_from_start"]
            t.append(int(stamp["sec"]) + int(stamp["nanosec"]) / NANO)
            q.append([float(value) for value in point["positions"]])
            qd.append([float(value) for value in point.get("velocities", [])])
        except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
            raise InputError(f"point {number} is not a JointTrajectoryPoint: {shown(error)}") from None
        if len(q[-1]) != len(names) or len(qd[-1]) not in (0, len(names)):
            raise InputError(f"point {number} has {len(q[-1])} positions and {len(qd[-1])} velocities for "
                             f"{len(names)} joints")  # fmt: skip
    return _trajectory(names, t, q, qd)


def _from_table(table: Table) -> Trajectory:
    header = table.header
    joints = [name for name in header[1:] if not name.endswith(VELOCITY)]
    columns = ["time", *joints, *(f"{joint}{VELOCITY}" for joint in joints)]
    if not joints or header not in (columns, columns[: 1 + len(joints)]):
        raise InputError(
            f"{table.name}: the columns must be time, the joints, and each JOINT{VELOCITY}, got {shown(header)}"
        )
    t, q, qd = np.split(table.numbers(range(len(header)), needed="numbers are needed"), (1, 1 + len(joints)), axis=1)
    try:
        return _trajectory(joints, t[:, 0].tolist(), q.tolist(), qd.tolist())
    except InputError as error:
        raise InputError(f"{table.name}: {error}") from None


def _trajectory(names: list[Any], t: list[float], q: list[list[float]], qd: list[list[float]]) -> Trajectory:
    """Make a trajectory; where a row has no speeds, all are differences."""
    if not t:
        raise InputError("there are no samples")
    if not all(qd):
        checked = Trajectory(tuple(names), np.array(t), np.array(q), np.zeros_like(q))
        speeds = np.gradient(checked.q, checked.t, axis=0) if len(t) > 1 else checked.qd
        return Trajectory(checked.joints, checked.t, checked.q, np.asarray(speeds, dtype=np.float64))
    return Trajectory(tuple(names), np.array(t), np.array(q), np.array(qd))
