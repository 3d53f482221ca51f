"""The factory calibration of a UR: read from files, checked, and put into a description.

Four kinds of file have it: the `kinematics.yaml` that the ROS driver's `ur_calibration` writes (a transform for each
link), the `calibration.conf` that the controller keeps (what is to be added to the Denavit-Hartenberg parameters), a
program of PolyScope, a `.urp` (the parameters themselves), and a URDF that was made with one of them. All of them end
up as the same thing, a chain of seven transforms whose frames lie as near to those of the data sheet as the axes allow:
a frame may be slid along its joint's axis without changing the arm, and controllers slide by hundreds of metres where
two axes are almost parallel.

Nothing in a file is executed.
"""

from __future__ import annotations

import hashlib
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from kinreach._checks import Floats, check_known, check_path, shown
from kinreach._files import read_bytes
from kinreach._rotations import placement, rpy, turn
from kinreach.errors import InputError
from kinreach.robots._polyscope import PolyScopeProgram, is_program, read_program
from kinreach.robots._ur import FLIP, JOINTS, UR_LENGTHS
from kinreach.robots._urdf import MAX_CHARACTERS, check_urdf, link_at, origin_of, parse_urdf, set_origin

#: Names of the links in the driver's file, one for each joint of `JOINTS`.
LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
#: How far a joint may be from where the data sheet has it for a file to fit a model well [m].
GOOD_OFFSET = 0.008
#: How far a joint's axis may be from where the data sheet has it: tilt [rad], distance [m]. Real arms were
#: seen with 1 degree and 7 mm, and the models differ from each other by 18 mm or more.
MAX_TILT, MAX_OFFSET = math.radians(5.0), 0.015
#: Bounds of the numbers in a file: lengths of a link [m], angles [rad], and lengths that may cancel each other [m].
MAX_LENGTH, MAX_FILE_ANGLE, MAX_SLIDE = 3.0, 4 * math.pi, 1e4
_KINDS = (
    "it must be the driver's kinematics.yaml (with `kinematics:`), the controller's calibration.conf (with "
    "delta_theta), a .urp of PolyScope, or a URDF"
)
_XYZ, _RPY = ("x", "y", "z"), ("roll", "pitch", "yaw")
_DELTA_LINE = re.compile(r"^\s*(delta_\w+)\s*=\s*\[([^\]]*)\]\s*$", re.MULTILINE)
#: Calibrations of eight real arms whose owners published them, by name, such as "ur5_a" (the model, then a letter);
#: the driver's files. The first line of each names the source of its figures.
PUBLISHED_CALIBRATIONS = {file.stem: file for file in sorted((Path(__file__).parent / "calibrations").glob("*.yaml"))}


@dataclass(frozen=True, eq=False)
class Calibration:
    """The links of one real arm.

    Attributes:
        model: Which UR it is, such as `"ur5e"`.
        placements: A0 to A6 of `T = A0 Rz(q1) A1 ... Rz(q6) A6`, from the DH base (the driver's `base_link_inertia`,
            which is base_link turned by pi about z) to `tool0`, shape (7, 4, 4).
        file: Where it was read.
        repaired: Name of the link whose folded figures were corrected; empty if there was none.
        note: What the file leaves open; empty if nothing.
    """

    model: str
    placements: Floats
    file: Path
    repaired: str = ""
    note: str = ""

    @property
    def tilts(self) -> Floats:
        """Angle of each joint's axis from where the data sheet has it, in the frame of the joint before [rad], (6,)."""
        return _differences(self.placements, self.model)[0][:6]

    @property
    def offsets(self) -> Floats:
        """Distance of each joint from where the data sheet has it, in the frame of the joint before [m], (6,)."""
        return _differences(self.placements, self.model)[1][:6]


def read_calibration(file: str | Path, model: str, *, repair: bool = False) -> Calibration:
    """Read the calibration of a UR.

    Args:
        file: The driver's `kinematics.yaml`, the controller's `calibration.conf`, a program of PolyScope (`.urp`), a
            calibrated URDF, or the name of a published calibration.
        model: Which UR it is, "ur3" to "ur30".
        repair: Correct what an old exporter folded: the figures of one link with x and y negated.

    Raises:
        UnknownNameError: Unknown model.
        InputError: The file cannot be read, is none of these, lacks a joint, has a number that is not finite or
            in another unit, is folded (unless `repair`), or is of another model; the message names joint, value, bound.
    """
    check_known("UR model", model, UR_LENGTHS)
    path = PUBLISHED_CALIBRATIONS.get(str(file)) or check_path("file", file)
    return calibrations_in(read_bytes(path, "the calibration", most=MAX_CHARACTERS), path, repair=repair)(model)


def calibrations_in(content: bytes, path: Path, *, repair: bool = False) -> Callable[[str], Calibration]:
    """Read the content of a calibration file, as `read_calibration`, once for all models.

    Returns:
        A function that returns the calibration of a model by its name, or raises what `read_calibration` does.
    """
    if len(content) > MAX_CHARACTERS:
        raise InputError(f"cannot read the calibration {path}: it has {len(content)} bytes, too many for one")
    if is_program(content):
        program = read_program(content, path.name)
        return lambda model: from_program(_only_robot(program, path.name, model), model, path)
    placed_as = _figures_in(content, path)

    def calibration(model: str) -> Calibration:
        placed, note = placed_as(model)
        placements, repaired = _placements(placed, model), ""
        wrong = _what_is_wrong(placements, model)
        if wrong:
            link, unfolded = _unfolded(placed, model)
            if not link:
                raise InputError(f"{wrong}{_better_model(placed, model)}")
            if not repair:
                raise InputError(
                    f"the calibration is folded at {link}: {wrong}; with x and y of {link} negated it fits {model}, "
                    "as after a known fault of old exporters. repair=True does that; better is to export it again"
                )
            placements, repaired = unfolded, link
        return Calibration(model, placements, path, repaired, note)

    return calibration


def _figures_in(content: bytes, path: Path) -> Callable[[str], tuple[_Placed, str]]:
    """Return the figures of a file by the model, and what is assumed of them."""
    try:
        text = content.decode()
    except UnicodeDecodeError as error:
        raise InputError(f"cannot read the calibration {path}: it is not UTF-8 text ({error})") from None
    if "delta_theta" in text and not text.lstrip().startswith("<"):
        each = {name: _from_controller(text, name) for name in UR_LENGTHS}
        fits = [name for name in UR_LENGTHS if _fits(each[name], name)]

        def assumed(model: str) -> tuple[_Placed, str]:
            if fits and model not in fits:
                raise InputError(f"the calibration is not that of a {model}: it fits {' or '.join(fits)}")
            well = ", ".join(fits) or "none well"
            return each[model], f"{path.name} does not name its model: {model} is assumed, it fits {well}"

        return assumed
    placed = _from_urdf(text) if text.lstrip().startswith("<") else _from_driver(text)
    return lambda _: (placed, "")


def is_calibration(content: bytes) -> bool:
    """Whether a file's content is a driver's file, a controller's file or a URDF, by its first words."""
    return content.lstrip().startswith(b"<") or bool(
        re.search(rb"^\s*(kinematics:|delta_theta\s*=)", content, re.MULTILINE)
    )


def from_program(figures: Floats, model: str, file: Path) -> Calibration:
    """Return the calibration of a robot by the figures of its program: delta theta, a, d and alpha, shape (4, 6).

    Raises:
        InputError: They are not those of the model.
    """
    placed = _from_dh(figures)
    placements = _placements(placed, model)
    if wrong := _what_is_wrong(placements, model):
        raise InputError(f"{wrong}{_better_model(placed, model)}")
    return Calibration(model, placements, file)


def models_that_fit(figures: Floats) -> tuple[str, ...]:
    """Return the models whose data sheet is as near to a program's figures as real robots are, the nearest first."""
    placed = _from_dh(figures)
    offsets = {model: float(_differences(_placements(placed, model), model)[1].max()) for model in UR_LENGTHS}
    fitting = [model for model in UR_LENGTHS if not _what_is_wrong(_placements(placed, model), model)]
    nearest = min((offsets[model] for model in fitting), default=0.0)
    return tuple(model for model in fitting if offsets[model] <= nearest + 1e-9)


def _only_robot(program: PolyScopeProgram, name: str, model: str) -> Floats:
    """The figures of the robot of this model in a program that has just one."""
    if not program.robots:
        raise InputError(f"{name} has no calibration: {program.unusable[0]}")
    own = [robot.figures for robot in program.robots if model in models_that_fit(robot.figures)]
    if len(own) > 1:
        raise InputError(f"{name} has the figures of {len(own)} robots: take one out by `kinreach calibrate --robot N`")
    return own[0] if own else program.robots[0].figures


def calibration_of(placements: Floats, model: str, file: Path) -> Calibration:
    """Return the calibration of an arm whose joints turn about z, by its placements as in `Calibration`."""
    placed = _Placed(placements, np.tile((0.0, 0.0, 1.0), (6, 1)))
    settled = _placements(placed, model)
    if wrong := _what_is_wrong(settled, model):
        raise InputError(f"the rows fit an arm that no {model} is: {wrong}")
    return Calibration(model, settled, file)


def as_driver_file(calibration: Calibration) -> str:
    """Return the calibration as the text of the ROS driver's `kinematics.yaml`.

    Raises:
        InputError: Its tool0 does not lie on the last joint's axis, which that file cannot say.
    """
    placements = _with_flange_on_axis(calibration)
    lines = ["kinematics:"]
    for link, T in zip(LINKS, placements, strict=True):
        figures = zip((*_XYZ, *_RPY), (*T[:3, 3], *rpy(T[:3, :3])), strict=True)
        lines += [f"  {link}:", *(f"    {key}: {float(value)!r}" for key, value in figures)]
    digest = hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16]
    return "\n".join([*lines, f"  hash: kinreach_{digest}", ""])


def as_conf(calibration: Calibration) -> str:
    """Return the calibration as the text of the controller's `calibration.conf`: what to add to the data sheet's DH.

    Raises:
        InputError: As `as_driver_file`, or the base's z axis is not that of the first joint.
    """
    more = _dh_of(_with_flange_on_axis(calibration), calibration.model) - nominal_dh(calibration.model)
    names = ("delta_theta", "delta_a", "delta_d", "delta_alpha")
    rows = [f"{name} = [ {', '.join(repr(float(v)) for v in row)} ]" for name, row in zip(names, more, strict=True)]
    return "\n".join(["[mounting]", *rows, ""])


#: How far a tool0 may be from the last joint's axis, and the base from the first's, where a file has no place for it.
ON_AXIS = 1e-9


def _with_flange_on_axis(calibration: Calibration) -> Floats:
    """The six placements before the joints, with that of tool0 in the last one, shape (6, 4, 4)."""
    tip = calibration.placements[6]
    if max(np.abs(tip[:2, 2:]).max(), np.abs(tip[2, :2]).max()) > ON_AXIS:
        raise InputError("tool0 of this calibration is off the axis of wrist_3, which only a .urdf can say")
    return np.array([*calibration.placements[:5], calibration.placements[5] @ tip])


def _dh_of(placements: Floats, model: str) -> Floats:
    """Denavit-Hartenberg parameters of a chain, as in `nominal_dh`: the common normals of its axes, shape (4, 6).

    Where two axes are parallel to 1e-4 / `MAX_SLIDE`, their normal is where the data sheet has it.
    """
    frames = [*accumulate(placements, np.matmul)]
    if max(np.abs(frames[0][:2, 2:]).max(), np.abs(frames[0][2, :2]).max()) > ON_AXIS:
        raise InputError("the first joint of this calibration is not about the base's z axis, which a .conf cannot say")
    nominal, found = nominal_dh(model), np.zeros((4, 6))
    T = np.eye(4)
    for joint in range(5):
        origin, z, x = T[:3, 3], T[:3, 2], T[:3, 0]
        after, z_after = frames[joint + 1][:3, 3], frames[joint + 1][:3, 2]
        normal = np.cross(z, z_after)
        sine = float(np.linalg.norm(normal))
        between: Floats = after - origin
        slide = float(np.cross(between, z_after) @ normal) / sine**2 if sine > 0.0 else math.inf
        if abs(slide) > MAX_SLIDE / 2:
            slide = float(nominal[2, joint])
            normal = between - (between @ z) * z
        x_new = normal / np.linalg.norm(normal)
        length = float(between @ x_new)
        expected = nominal[1, joint] if nominal[1, joint] else math.sin(nominal[3, joint])
        along = length if nominal[1, joint] else float(np.cross(z, z_after) @ x_new)
        if along * expected < 0.0:
            x_new, length = -x_new, -length
        theta = math.atan2(float(np.cross(x, x_new) @ z), float(x @ x_new))
        alpha = math.atan2(float(np.cross(z, z_after) @ x_new), float(z @ z_after))
        found[:, joint] = theta, length, slide, alpha
        T = T @ _from_dh(np.column_stack([found[:, joint], np.zeros((4, 5))])).steps[1]
    last = np.linalg.inv(T) @ frames[5]
    found[:, 5] = math.atan2(last[1, 0], last[0, 0]), 0.0, last[2, 3], 0.0
    return found


def nominal_placements(model: str) -> Floats:
    """Return the data sheet's chain from the DH base to tool0, as in `Calibration`, shape (7, 4, 4)."""
    d1, a2, a3, d4, d5, d6 = UR_LENGTHS[model]
    right = math.pi / 2
    steps = (
        ((0.0, 0.0, d1), (0.0, 0.0, 0.0)),
        ((0.0, 0.0, 0.0), (right, 0.0, 0.0)),
        ((a2, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((a3, 0.0, d4), (0.0, 0.0, 0.0)),
        ((0.0, -d5, 0.0), (right, 0.0, 0.0)),
        ((0.0, d6, 0.0), (-right, 0.0, 0.0)),
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    )
    return np.array([placement(*step) for step in steps])


def place_by_calibration(robot: ET.Element, calibration: Calibration, *, base: str, tip: str) -> None:
    """Move the joints of a model's parsed URDF to where the calibration has them; shapes and masses stay as they are.

    In the URDF, of the arm by its data sheet, the link `base` is base_link and `tip` is tool0.
    """
    frames = _link_frames(robot)
    for link in (base, tip):
        check_known("link of the URDF", link, frames)
    start = FLIP @ np.linalg.inv(frames[base])
    nominal = _nominal_frames(calibration.model)
    if np.abs(start @ frames[tip] - nominal[-1]).max() > 1e-6:
        raise InputError(f"the URDF {shown(robot.get('name'))} is not that of a {calibration.model} by its data sheet")
    joints = {joint.get("name"): joint for joint in robot.findall("joint")}
    (tip_joint,) = (joint for joint in joints.values() if link_at(joint, "child") == tip)
    before = np.eye(4)
    for index, name in enumerate((*JOINTS, tip_joint.get("name", ""))):
        check_known("joint of the URDF", name, [each for each in joints if each])
        parent, child = (start @ frames[link_at(joints[name], end)] for end in ("parent", "child"))
        carried, own = np.linalg.inv(before) @ parent, np.linalg.inv(nominal[index]) @ child
        T = np.linalg.inv(carried) @ calibration.placements[index] @ own
        set_origin(robot, name, T[:3, 3], rpy(T[:3, :3]))
        before = nominal[index]


@dataclass(frozen=True)
class _Placed:
    """The figures of a file: the pose of each joint's frame in that of the joint before, and that of tool0.

    Attributes:
        steps: In the DH base, shape (7, 4, 4).
        axes: Of each joint in its own frame, shape (6, 3).
    """

    steps: Floats
    axes: Floats

    def folded(self, index: int) -> _Placed:
        steps = self.steps.copy()
        steps[index, :2, 3] *= -1.0
        return _Placed(steps, self.axes)


def _from_driver(text: str) -> _Placed:
    """Read the driver's file: x y z roll pitch yaw of six links."""
    try:
        content = yaml.load(text, Loader=yaml.BaseLoader)  # texts only: no tags, and no merging that multiplies
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        mark = getattr(error, "problem_mark", None)
        place = "" if mark is None else f", from line {mark.line + 1} on"
        raise InputError(f"the calibration cannot be read: it is not YAML{place}; {_KINDS}") from None
    links = content.get("kinematics") if isinstance(content, Mapping) else None
    if not isinstance(links, Mapping):
        raise InputError(f"the calibration cannot be read: {_KINDS}")
    steps = [np.eye(4)] * 7
    for index, (link, joint) in enumerate(zip(LINKS, JOINTS, strict=True)):
        figures = links.get(link)
        if not isinstance(figures, Mapping):
            raise InputError(f"the calibration lacks {link} ({joint}); it must have {', '.join(LINKS)}")
        for key in (*_XYZ, *_RPY):
            if key not in figures:
                raise InputError(f"the calibration lacks {key} of {link} ({joint})")
        xyz = [_number(f"{key} of {link} ({joint})", figures[key], MAX_LENGTH, "m") for key in _XYZ]
        angles = [_number(f"{key} of {link} ({joint})", figures[key], MAX_FILE_ANGLE, "rad") for key in _RPY]
        steps[index] = placement(xyz, angles)
    return _Placed(np.array(steps), np.tile((0.0, 0.0, 1.0), (6, 1)))


def _from_controller(text: str, model: str) -> _Placed:
    """Read the controller's file: four lists of six numbers, to be added to the DH parameters of the data sheet."""
    lists = dict(_DELTA_LINE.findall(text))
    values = []
    for key in ("delta_theta", "delta_a", "delta_d", "delta_alpha"):
        words = lists.get(key, "").replace(",", " ").split()
        if len(words) != 6:
            raise InputError(
                f"the calibration must have six numbers {key} = [...], one for each joint, got {len(words)}"
            )
        bound, unit = (MAX_FILE_ANGLE, "rad") if key in ("delta_theta", "delta_alpha") else (MAX_SLIDE, "m")
        values.append([_number(f"{key} of {joint}", w, bound, unit) for w, joint in zip(words, JOINTS, strict=True)])
    return _from_dh(np.array(values) + nominal_dh(model))


def _from_dh(figures: Floats) -> _Placed:
    """Place joints by Denavit-Hartenberg parameters: rows delta theta, a, d, alpha, shape (4, 6)."""
    steps, z, x = [np.eye(4)] * 7, np.array((0.0, 0.0, 1.0)), np.array((1.0, 0.0, 0.0))
    for index, (theta, a, d, alpha) in enumerate(figures.T):
        link = np.eye(4)
        R = turn(z, theta)
        link[:3, :3] = R @ turn(x, alpha)
        link[:3, 3] = a * R[:, 0] + d * z
        steps[index + 1] = link
    return _Placed(np.array(steps), np.tile(z, (6, 1)))


def nominal_dh(model: str) -> Floats:
    """Return the data sheet's parameters: rows delta theta [rad], a [m], d [m], alpha [rad], shape (4, 6)."""
    d1, a2, a3, d4, d5, d6 = UR_LENGTHS[model]
    right = math.pi / 2
    return np.array([[0.0] * 6, (0, a2, a3, 0, 0, 0), (d1, 0, 0, d4, d5, d6), (right, 0, 0, right, -right, 0)])


def _from_urdf(text: str) -> _Placed:
    """Read a URDF whose joints have the names of a UR, with or without a prefix."""
    robot = parse_urdf(text)
    for link in robot.findall("link"):
        for element in list(link):
            link.remove(element)
    check_urdf(robot, None)
    frames = _link_frames(robot)
    joints = []
    for name in JOINTS:
        named = [joint for joint in robot.findall("joint") if joint.get("name", "").endswith(name)]
        if len(named) != 1:
            raise InputError(
                f"a calibrated URDF must have one joint {name}, with or without a prefix, got {len(named)}"
            )
        joints.append(named[0])
    last = link_at(joints[-1], "child")
    tips = [link for link in frames if link.endswith("tool0")]
    ends = [frames[link_at(joint, "child")] for joint in joints] + [frames[tips[0] if len(tips) == 1 else last]]
    start = frames[link_at(joints[0], "parent")]
    if not link_at(joints[0], "parent").endswith("base_link_inertia"):
        start = start @ FLIP
    before = [start, *ends]
    steps = np.array([np.linalg.inv(a) @ b for a, b in zip(before, ends, strict=False)])
    axes = [joint.find("axis") for joint in joints]
    directions = [[float(v) for v in ("1 0 0" if a is None else a.get("xyz", "1 0 0")).split()] for a in axes]
    return _Placed(steps, np.array([np.array(d) / np.linalg.norm(d) for d in directions]))


def _number(name: str, value: Any, most: float, unit: str) -> float:
    """Check a finite number within bounds, also as text: YAML reads 1e-5 as text."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} must be a number [{unit}], got {shown(value)}") from None
    if not -most <= number <= most:
        other = {"m": "millimetres", "rad": "degrees"}[unit]
        hint = f"; are these {other}?" if math.isfinite(number) else ""
        raise InputError(f"{name} must be within ±{most:.4g} {unit}, got {shown(number)}{hint}")
    return number


def _placements(placed: _Placed, model: str) -> Floats:
    """Compute the chain whose frames are as near to the data sheet's as the axes allow, shape (7, 4, 4)."""
    wanted = _nominal_frames(model)
    frames, frame = [], np.eye(4)
    for step, axis, near in zip(placed.steps[:6], placed.axes, wanted[:6], strict=True):
        frame = frame @ step
        z = frame[:3, :3] @ axis
        own = np.eye(4)
        x = near[:3, 0] - (near[:3, 0] @ z) * z
        x /= max(float(np.linalg.norm(x)), 1e-9)
        own[:3, :3] = np.column_stack([x, np.cross(z, x), z])
        own[:3, 3] = frame[:3, 3] + ((near[:3, 3] - frame[:3, 3]) @ z) * z
        frames.append(own)
    frames.append(frame @ placed.steps[6])
    return np.array([np.linalg.inv(a) @ b for a, b in zip((np.eye(4), *frames), frames, strict=False)])


def _what_is_wrong(placements: Floats, model: str) -> str:
    """Describe the first joint that is farther from the data sheet than any calibration; empty if none is."""
    tilts, offsets = _differences(placements, model)
    for what, tilt, offset in zip((*JOINTS, "tool0"), tilts, offsets, strict=True):
        if not tilt <= MAX_TILT:
            return (
                f"the axis of {what} is tilted by {math.degrees(tilt):.3g} degrees against that of a {model}, more "
                f"than the {math.degrees(MAX_TILT):g} of any calibration"
            )
        if not offset <= MAX_OFFSET:
            return (
                f"{what} is {1000 * offset:.4g} mm from where a {model} has it, more than the {1000 * MAX_OFFSET:g} "
                "mm of any calibration"
            )
    return ""


def _differences(placements: Floats, model: str) -> tuple[Floats, Floats]:
    """Tilts [rad] and offsets [m] of joints and tool0 in the frames before, shapes (7,)."""
    z, nominal = placements[:, :3, 2], nominal_placements(model)
    tilts = np.arctan2(np.linalg.norm(np.cross(z, nominal[:, :3, 2]), axis=1), (z * nominal[:, :3, 2]).sum(axis=1))
    turned = nominal[6, :3, :3].T @ placements[6, :3, :3]
    tilts[6] = math.acos(min(1.0, max(-1.0, 0.5 * (float(np.trace(turned)) - 1.0))))
    return tilts, np.linalg.norm(placements[:, :3, 3] - nominal[:, :3, 3], axis=1)


def _unfolded(placed: _Placed, model: str) -> tuple[str, Floats]:
    """Find the link with whose x and y negated the arm fits, and that arm; an empty name if there is none."""
    for index, link in enumerate(LINKS):
        placements = _placements(placed.folded(index), model)
        if not _what_is_wrong(placements, model):
            return link, placements
    return "", np.empty(0)


def _fits(placed: _Placed, model: str) -> bool:
    """Return whether an arm is as near to a model as those whose calibration is known."""
    return bool(_differences(_placements(placed, model), model)[1].max() < GOOD_OFFSET)


def _better_model(placed: _Placed, model: str) -> str:
    fitting = [
        other for other in UR_LENGTHS if other != model and not _what_is_wrong(_placements(placed, other), other)
    ]
    return f"; it fits {' or '.join(fitting)}" if fitting else ""


def _nominal_frames(model: str) -> Floats:
    """Frames of the data sheet's joints and tool0, all joints at 0, shape (7, 4, 4)."""
    return np.array([*accumulate(nominal_placements(model), np.matmul, initial=np.eye(4))][1:])


def _link_frames(robot: ET.Element) -> dict[str, Floats]:
    """Pose of each link of a URDF in its root, with all joints at 0."""
    joints = robot.findall("joint")
    children = {link_at(joint, "child") for joint in joints}
    frames = {name: np.eye(4) for link in robot.findall("link") if (name := link.get("name", "")) not in children}
    todo = list(frames)
    for parent in todo:  # grows until it has all links
        for joint in joints:
            if link_at(joint, "parent") == parent:
                frames[link_at(joint, "child")] = frames[parent] @ origin_of(joint)
                todo.append(link_at(joint, "child"))
    return frames
