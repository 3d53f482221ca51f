"""Calibration of an arm from what its owner has: figures that a file carries, or a fit to joint angles and poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import Floats, check_count, check_path, listed
from kinreach._files import read_bytes, write_text
from kinreach._rotations import as_frame, listed_pose, pose
from kinreach.errors import InputError
from kinreach.robots._calibration import (
    Calibration,
    as_conf,
    as_driver_file,
    calibration_of,
    calibrations_in,
    from_program,
    is_calibration,
    models_that_fit,
    nominal_dh,
)
from kinreach.robots._calibration_fit import CalibrationFit, Fitted, fitted_chain, fitted_ur, millimetres
from kinreach.robots._description import ArmDescription
from kinreach.robots._pairs import PosePairs, pairs_of
from kinreach.robots._polyscope import is_program, read_program
from kinreach.robots._registry import FILES, arm_named, get_arm
from kinreach.robots._ur import JOINTS, UR_LENGTHS, ur_model
from kinreach.robots._urdf_chain import UrdfChain

#: Dropped rows that a statement names.
SHOWN = 8
#: Figures nearer to the data sheet than this are the data sheet's [m], [rad]; a real robot's are farther off.
SAME = 1e-6


@dataclass(frozen=True, eq=False)
class CalibratedArm:
    """An arm's calibration, and what it rests on.

    Attributes:
        arm: The calibrated arm, without a tool; by its data sheet where something is missing.
        models: Models of UR that the figures fit, those with the same data sheet together; empty for other arms.
        calibration: The figures of a UR; None for other arms, or where something is missing.
        tcp: Pose of the tool centre point on the flange, shape (4, 4); None if the source does not say it.
        tcp_found: Whether `tcp` was fitted, too.
        fit: Of figures that were fitted; None for those that were read.
        missing: What the rows do not determine, and which motion would; empty if the calibration may be used.
        notes: What was found out or assumed, a line each.
    """

    arm: ArmDescription
    models: tuple[str, ...]
    calibration: Calibration | None
    tcp: Floats | None = None
    tcp_found: bool = False
    fit: CalibrationFit | None = None
    missing: str = ""
    notes: tuple[str, ...] = ()

    def save(self, file: str | Path) -> None:
        """Write the calibration: `.yaml` for the ROS driver, `.conf` as the controller's, `.urdf`; by the ending.

        Raises:
            InputError: Another ending, one that the arm cannot have, or a calibration that is not determined.
            OutputError: The file cannot be written.
        """
        path = check_path("file", file)
        if self.missing:
            raise InputError(f"nothing is written: {self.missing}")
        kinds = (".urdf",) if self.calibration is None else (".yaml", ".yml", ".conf", ".urdf")
        if path.suffix.lower() not in kinds:
            raise InputError(f"the calibration's file must end in {' or '.join(kinds)}, got {path.name}")
        if self.calibration is None or path.suffix.lower() == ".urdf":
            write_text(path, self.arm.urdf)
        elif path.suffix.lower() == ".conf":
            write_text(path, as_conf(self.calibration))
        else:
            write_text(path, as_driver_file(self.calibration))

    def statement(self) -> list[str]:
        """Return what an engineer wants to know, a line each."""
        lines = [f"arm          {' or '.join(self.models) or self.arm.title}"]
        if self.tcp is not None:
            how = ", fitted" if self.tcp_found else ""
            lines.append(f"tool         {listed_pose(self.tcp)}{how}")
        if self.fit is None:
            return [*lines, "figures      read, nothing is fitted", *(f"note         {note}" for note in self.notes)]
        fit, count = self.fit, len(self.fit.dropped)
        lines.append(f"rows         {fit.rows} used, {count} dropped")
        lines += [f"             {place}: {reason}" for place, reason in fit.dropped[:SHOWN]]
        lines += [f"             and {count - SHOWN} more"] if count > SHOWN else []
        lines.append("error, mm    median / largest")
        for what, values in (
            ("data sheet, at the rows", fit.before),
            ("calibrated, at the rows", fit.after),
            ("calibrated, at rows left out of the fit", fit.held_out),
            ("correction, over the workspace", fit.correction),
            ("expected error, over the workspace", fit.expected),
        ):
            lines.append(f"             {millimetres(float(np.median(values)))} / {millimetres(values.max())}  {what}")
        lines += [f"note         {note}" for note in self.notes]
        return [*lines, f"undetermined {self.missing}"] if self.missing else lines


def calibrate(
    source: str | Path | PosePairs | Sequence[str | Path],
    *,
    arm: str | Path | ArmDescription | None = None,
    tool: ArrayLike | None = None,
    robot: int | None = None,
) -> CalibratedArm:
    r"""Find an arm's calibration in files of its owner.

    Where there are rows of postures q and poses y of the tool, the errors x of the joints' frames are fitted to them:

    .. math::

        \min_x \; \sum_i \frac{|y_i - T(q_i; x)|^2}{\sigma^2} + \sum_k \frac{x_k^2}{s_k^2}

    with how far the frames of real arms are off, s (Hollerbach and Wampler, The calibration index and taxonomy for
    robot kinematic calibration methods, IJRR 15, 1996).

    Args:
        source: A `.urp` of PolyScope, whose waypoints carry the figures; its exported `.script`, a recording of UR's
            RTDE client or of ur_rtde, or a table of joint angles and poses, to which the figures are fitted; a
            calibration file, which is read. Several files of one robot are fitted together.
        arm: Which arm it is: a UR by its model's name, which is found if None; or a URDF's path or a description, whose
            joint placements are fitted with an unknown base and tool.
        tool: Tool centre point of the rows, `[x, y, z, rx, ry, rz]` [m, rad] or 4x4; default is what the files say,
            and without that it is fitted, too.
        robot: Number of the robot in a `.urp` of several, from 1.

    Returns:
        The calibration, with errors before and after, and the expected error over the workspace.

    Raises:
        UnknownNameError: Unknown arm.
        InputError: A file cannot be read; the rows are of one posture, of no known arm, of another than `arm`, of two
            robots or tools, in mixed units; or models cannot be told apart. The message names rows and remedy.
    """
    files = [] if isinstance(source, PosePairs) else [source] if isinstance(source, str | Path) else list(source)
    if not files and not isinstance(source, PosePairs):
        raise InputError("a source is needed: a .urp, a .script, a recording or a table")
    paths = [check_path("source", file) for file in files]
    own = _own_arm(arm)
    tcp = None if tool is None else as_frame("tool", tool)
    contents = [read_bytes(path, "the source", most=2**28) for path in paths]
    programs = [is_program(content) for content in contents]
    figures = [program or is_calibration(content) for program, content in zip(programs, contents, strict=True)]
    if any(figures):
        if len(paths) > 1:
            others = [path.name for path, one in zip(paths, figures, strict=True) if one]
            raise InputError(f"{others[0]} carries the figures themselves: give it alone")
        if not isinstance(own, str | None):
            raise InputError(f"{paths[0].name} carries the figures of a UR, not of {own.title}")
        if programs[0]:
            return _read(paths[0], contents[0], own, tcp, robot)
        return _converted(paths[0], contents[0], own, tcp)
    joints = own.joints if isinstance(own, ArmDescription) else ()
    each = (
        [source]
        if isinstance(source, PosePairs)
        else [pairs_of(content, path.name, joints=joints) for path, content in zip(paths, contents, strict=True)]
    )
    if tcp is not None:
        each = [one.with_tcp(tcp) for one in each]
    pairs = reduce(PosePairs.joined, each)
    if isinstance(own, ArmDescription):
        return _other_arm(own, pairs)
    return _ur(fitted_ur(own, pairs), pairs)


def _ur(found: Fitted, pairs: PosePairs) -> CalibratedArm:
    """A UR with what was found of it; by its data sheet where something is missing."""
    arm, calibration = get_arm(found.models[0]), None
    if not found.missing:
        calibration = calibration_of(found.placements, found.models[0], Path(pairs.source))
        arm = arm.calibrated(calibration)
    return CalibratedArm(
        arm, found.models, calibration, found.tcp, found.tcp_found, found.fit, found.missing, found.notes
    )


def _other_arm(arm: ArmDescription, pairs: PosePairs) -> CalibratedArm:
    """An arm that is no UR, with its joints where they were found."""
    chain = UrdfChain.of(arm.robot, arm.joints, base=arm.base, tip=arm.tips[arm.default_tip])
    found = fitted_chain(arm.name, arm.joints, chain, pairs)
    notes = (*found.notes, f"the poses are in a frame in which {arm.base} is at {listed_pose(found.base)}")
    if not found.missing:
        title = f"{arm.title}, calibrated by {pairs.source}"
        build_urdf = chain.urdf_with(found.placements)
        arm = replace(arm, name=f"{arm.name}_calibrated", title=title, build_urdf=build_urdf)
    return CalibratedArm(arm, (), None, found.tcp, found.tcp_found, found.fit, found.missing, notes)


def _own_arm(arm: str | Path | ArmDescription | None) -> str | ArmDescription | None:
    """A UR's model, None if it is to be found, or the description of another arm."""
    if arm is None:
        return None
    if isinstance(arm, Path) or (isinstance(arm, str) and (arm.lower().endswith(FILES) or ":" in arm)):
        return arm_named(str(arm))
    description = get_arm(arm)
    model = ur_model(description.name) if isinstance(arm, str) and description.joints == JOINTS else description.name
    return model if model in UR_LENGTHS else description


def _read(path: Path, content: bytes, model: str | None, tcp: Floats | None, robot: int | None) -> CalibratedArm:
    """The figures of a `.urp`."""
    program = read_program(content, path.name)
    if not program.robots:
        raise InputError(f"{path.name} has no calibration: {program.unusable[0]}")
    if robot is not None:
        number = check_count("robot", robot, most=len(program.robots)) - 1
    elif len(program.robots) > 1:
        each = "; ".join(f"{n}: {_of_waypoints(r.waypoints)}" for n, r in enumerate(program.robots, start=1))
        raise InputError(f"{path.name} has the figures of {len(program.robots)} robots: choose with robot=N ({each})")
    else:
        number = 0
    figures = program.robots[number].figures
    names = models_that_fit(figures)
    if model is not None and model not in names:
        raise InputError(f"the figures of {path.name} are not those of a {model}: they fit {listed(names) or 'no UR'}")
    if not names:
        raise InputError(f"the figures of {path.name} fit no model of UR")
    calibration = from_program(figures, model or names[0], path)
    notes = [f"{path.name} has the data sheet's figures beside: {line}" for line in program.unusable]
    if np.abs(figures - nominal_dh(calibration.model)).max() < SAME:
        notes.append(
            f"the figures are those of the data sheet to {SAME:g} m and rad: the robot has no calibration, or "
            f"{path.name} was saved in a simulator"
        )
    if tcp is None and len(program.tcps) == 1:
        tcp = pose(program.tcps[0])
    elif tcp is None and len(program.tcps) > 1:
        notes.append(f"the waypoints have {len(program.tcps)} tool centre points")
    models = (model,) if model else names
    return CalibratedArm(
        get_arm(calibration.model).calibrated(calibration), models, calibration, tcp, notes=tuple(notes)
    )


def _of_waypoints(names: Sequence[str]) -> str:
    if not names:
        return "the program itself"
    return f"{len(names)} waypoints, {', '.join(names[:3])}{', ...' if len(names) > 3 else ''}"


def _converted(path: Path, content: bytes, model: str | None, tcp: Floats | None) -> CalibratedArm:
    """A calibration that is one already; of the models that it fits the nearest, unless it says only differences."""
    found, calibration_as = [], calibrations_in(content, path)
    for name in [model] if model else UR_LENGTHS:
        try:
            found.append(calibration_as(name))
        except InputError as error:
            reason = error
    if not found:
        raise reason
    nearest = min(float(calibration.offsets.max()) for calibration in found)
    names = [calibration.model for calibration in found]
    if any(calibration.note for calibration in found):  # differences from a data sheet that the file does not name
        if len({UR_LENGTHS[name] for name in names}) > 1:
            raise InputError(
                f"{path.name} says how far a robot is off its data sheet, but not which robot it is: it fits "
                f"{listed(names)}; name yours with arm="
            )
    else:
        found = [calibration for calibration in found if calibration.offsets.max() <= nearest + 1e-9]
    models = tuple(calibration.model for calibration in found)
    return CalibratedArm(get_arm(found[0].model).calibrated(found[0]), models, found[0], tcp)
