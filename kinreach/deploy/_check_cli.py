"""`kinreach check`: describe and test an arm in one screen of text, and draw its workspace."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from kinreach._checks import Floats, check_count, check_out_file, printable
from kinreach._files import replacing
from kinreach._rotations import listed_pose
from kinreach.cli import Parser, print_notes
from kinreach.errors import InputError
from kinreach.kinematics import (
    Arm3Kinematics,
    ArmKinematics,
    CalibratedURKinematics,
    FiveAxisKinematics,
    PalletizerKinematics,
    RedundantKinematics,
    SevenAxisKinematics,
    SixAxisKinematics,
    SlidingKinematics,
    URKinematics,
    check,
)
from kinreach.kinematics.inside import POSE_JOINTS
from kinreach.plots.inside import draw_workspace
from kinreach.robots import PosePairs
from kinreach.robots.inside import JOINTS, ArmFlags

#: Part of the data sheet's error that the calibration of a recording's robot leaves at most, and another's at least.
TELLING, OTHER = 0.5, 1.2
#: Poses to solve by default, and the most singular ones.
POSES, MAX_SINGULAR = 200, 60


class Subject(NamedTuple):
    """The arm to check.

    Attributes:
        kinematics: Of the arm.
        believed: Of the data sheet of a calibrated arm, else None.
    """

    kinematics: ArmKinematics
    believed: ArmKinematics | None


def main(argv: Sequence[str], *, prog: str) -> int:
    """Check an arm and print the report.

    Args:
        argv: Arguments without the program's name.
        prog: How the user called it, for messages.

    Returns:
        Exit code 0; anything else is raised.

    Raises:
        KinreachError: Bad input, or a picture that cannot be written.
    """
    arguments = _parser(prog).parse_args(argv)
    poses = check_count("--poses", arguments.poses, most=100_000)
    seed = check_count("--seed", arguments.seed, least=0, most=2**31)
    path = None if arguments.picture is None else check_out_file("--picture", arguments.picture)
    subject = _subject(arguments)
    lines = report(subject, poses=poses, seed=seed) if arguments.log is None else _explained(subject, arguments)
    for line in lines:
        print(printable(line), flush=True)
    if path is not None:
        with replacing(path) as temporary:
            draw_workspace(*subject, seed=seed).savefig(temporary, format="png")
        print(printable(f"picture      {path}"))
    return 0


def report(subject: Subject, *, poses: int, seed: int) -> Iterator[str]:
    """Yield the lines of the report, each as soon as it is measured."""
    kin = subject.kinematics
    yield f"{kin.arm.name}: {kin.arm.title}, tip {kin.tip}"
    yield f"class        {_class_of(kin)}"
    if subject.believed is not None:
        yield from _deviation(check.deviation(kin, subject.believed, seed=seed))
    reach = check.reach_of(kin, seed=seed)
    yield (
        f"reach        {reach.farthest:.3f} m from the origin of {kin.arm.joints[0]}, 95 % within {reach.usual:.3f} m; "
        f"{reach.lowest:+.3f} to {reach.highest:+.3f} m above it"
    )
    singular = check.singular_postures(kin, reach.farthest, seed=seed)
    chosen = np.random.default_rng(seed).permutation(singular.q)[:MAX_SINGULAR]
    yield f"IK           {poses} poses of random postures and {len(chosen)} singular ones, from the start posture"
    position, orientation = check.REACHED
    yield (
        f"             reached: within {1e3 * position:g} mm and {orientation:g} rad; placo, lm and qp stop there, "
        "a closed form is exact"
    )
    yield "             solver        reached  singular   time, ms: median / p95   largest error, mm"
    postures = check.random_postures(kin, poses, seed + 1)
    for solver in check.solvers_of(kin):
        done = check.solved(kin, solver, postures, chosen)
        singular_share = "      –" if np.isnan(done.singular) else f"{100 * done.singular:5.1f} %"
        median, late = (1e3 * time for time in done.time)
        times = f"{median:12.3f} / {late:<9.3f}"
        shares = f"{100 * done.success:6.1f} %   {singular_share}"
        yield f"             {done.name:<12} {shares}   {times}  {1e3 * done.error:.1e}"
    if isinstance(kin, FiveAxisKinematics):
        yield from _orientation(kin, postures, seed)
    yield f"singular     {_singular(kin, singular)}"
    yield f"collisions   {_collisions(kin, seed)}"
    yield from _joints(kin)


def _class_of(kin: ArmKinematics) -> str:
    if isinstance(kin, CalibratedURKinematics):
        return f"UR with its calibration: every posture of a pose exactly, singular poses too; {kin.special_axes}"
    if isinstance(kin, URKinematics):
        return "UR: every posture of a pose exactly, singular poses too"
    if isinstance(kin, SixAxisKinematics):
        special = f"; {kin.special_axes}" if kin.special_axes else ""
        return f"six joints: every posture of a pose exactly, {kin.solved}{special}"
    if isinstance(kin, SevenAxisKinematics):
        numeric = "placo, lm and qp give one posture at a time"
        sliding = [name for name, slides in zip(kin.arm.joints, kin.slides, strict=True) if slides]
        what = f"six joints and the slide {sliding[0]}" if sliding else "seven joints"
        return f"{what}: every posture of a pose as curves, {kin.solved}; {numeric}"
    if isinstance(kin, Arm3Kinematics):
        return "turning base with two links: every posture of a position in closed form"
    if isinstance(kin, RedundantKinematics):
        spare = kin.n - POSE_JOINTS
        return (
            f"{spare} joint{'s' * (spare > 1)} more than a pose needs; numeric: nearest, clearest and manipulable in "
            "Python, and placo, lm and qp, give one posture at a time"
        )
    if isinstance(kin, PalletizerKinematics):
        return "palletizer: every posture of a pose that the arm can have, in closed form"
    if isinstance(kin, SlidingKinematics):
        what = "three slides and a wrist" if kin.slides.sum() > 1 else "SCARA"
        return f"{what}: every posture of a pose that the arm can have, in closed form"
    if isinstance(kin, FiveAxisKinematics):
        count = "four" if kin.n == 4 else "five"
        return f"{count} joints: a point exactly, the orientation as near as it goes, {kin.solved}"
    if kin.no_closed_form:
        return f"no closed form, but placo, lm and qp, one posture at a time: {kin.no_closed_form}"
    spare = kin.n - POSE_JOINTS
    because = (
        f"{spare} joint{'s' * (spare > 1)} more than a pose needs, so that each pose has a family of postures"
        if spare > 0
        else "not the geometry of an arm that kinreach has one for"
    )
    return f"no closed form ({because}): placo, lm and qp, one posture at a time"


def _orientation(kin: FiveAxisKinematics, postures: Floats, seed: int) -> Iterator[str]:
    """Say what is left of random orientations at points that random postures reach."""
    found = check.nearest_orientations(kin, postures, seed=seed)
    median, late, _ = np.rad2deg(check.quantiles(found.left))
    yield (
        f"orientation  {len(found.left)} points, each with a random orientation: {median:.0f}° are left in the median, "
        f"p95 {late:.0f}°; {1e3 * found.time:.2f} ms"
    )
    yield f"             at {100 * found.down:.0f} % of them the tip's z axis points straight down"


def _joints(kin: ArmKinematics) -> Iterator[str]:
    """Return a line for each joint: limits, speed and start."""
    width = max(map(len, kin.arm.joints))
    rows = zip(kin.arm.joints, kin.lower, kin.upper, kin.velocity_limit, kin.arm.home, kin.slides, strict=True)
    for index, (name, low, high, speed, home, slides) in enumerate(rows):
        head, unit = "joints" if index == 0 else "", "m" if slides else "rad"
        at = " m" if slides else ""
        limits = f"{low:+7.3f} to {high:+7.3f} {unit}" + ("" if slides else f" ({np.rad2deg(high - low):.0f}°)")
        limits = limits if np.isfinite(high - low) else "turns without end"
        yield f"{head:<12} {name:<{width}}  {limits + ',':<30} {speed:.2f} {unit}/s, starts at {home:+.3f}{at}"


def _collisions(kin: ArmKinematics, seed: int) -> str:
    try:
        found = check.collisions_of(kin, seed=seed)
    except InputError as error:  # the rest is known without shapes
        return f"not known: {' '.join(str(error).split())}"
    if found is None:
        return "not known: the arm has no shapes"
    start = "free" if found.home_free else "IN COLLISION"
    return (
        f"{found.pairs} pairs of links are checked; {100 * found.share:.0f} % of random postures collide with "
        f"themselves; the start is {start}"
    )


def _deviation(found: check.Deviation) -> Iterator[str]:
    median, late, most = (1e3 * value for value in check.quantiles(found.position))
    turned = np.rad2deg(check.quantiles(found.orientation))
    yield (
        f"calibration  the data sheet puts the tip {median:.2f} mm off in the median, p95 {late:.2f}, most {most:.2f}; "
        f"{turned[0]:.2f}°, p95 {turned[1]:.2f}°, most {turned[2]:.2f}°"
    )


def _explained(subject: Subject, arguments: argparse.Namespace) -> Iterator[str]:
    """Yield how well the arm, and its data sheet beside it, explain a recording."""
    kin, tool = subject.kinematics, ArmFlags.of(arguments).tool
    pairs = PosePairs.read(arguments.log, joints=() if kin.arm.joints == JOINTS else kin.arm.joints)
    if pairs.q.shape[1] != kin.n:
        raise InputError(f"arm {kin.arm.name!r} has {kin.n} joints, {pairs.source} has {pairs.q.shape[1]}")
    yield f"{kin.arm.name}: {len(pairs)} rows of {pairs.source}"
    for note in pairs.notes:
        yield f"note         {note}"
    medians = []
    for name, arm in (("data sheet", subject.believed), ("calibrated" if subject.believed else "arm", kin)):
        if arm is None:
            continue
        tip, base = ("tool0", "base") if arm.arm.joints == JOINTS else (arm.arm.default_tip, arm.base)
        found = check.explained(ArmKinematics(arm.arm, tip=tip, base=base), pairs, None if tool is None else tool.T)
        medians.append(1e3 * float(np.median(found.position)))
        if found.recovered:
            six = listed_pose(found.tool)
            yield f"{name:<12} tool {six}, found: the recording has none"
        for what, values, scale, unit in (
            ("position", found.position, 1e3, "mm"),
            ("orientation", found.orientation, 180 / np.pi, "°"),
            ("speed, Jacobian to recorded", found.speed, 1e3, "mm/s"),
            ("joints, actual to target", found.tracking, 180 / np.pi, "°"),
        ):
            if len(values):
                median, late, most = (f"{scale * value:.3g}" for value in check.quantiles(values))
                yield f"{name:<12} {what}: {median} {unit} in the median, p95 {late}, most {most}"
    if subject.believed is not None:
        yield f"verdict      {_verdict(*medians)}"


def _verdict(sheet: float, own: float) -> str:
    """Say whether a calibration is that of a recording's robot, by the median errors [mm] without and with it."""
    if own < TELLING * sheet:
        return f"the calibration is that of this robot: {own:.3g} mm are left of {sheet:.3g}"
    if own > OTHER * sheet:
        return f"the calibration is not that of this robot: {own:.3g} mm off, the data sheet {sheet:.3g}"
    return (
        f"undecided: {own:.3g} mm are left of {sheet:.3g}; it is another robot's, the tool centre point is another, or "
        "joint angles and poses are of different moments"
    )


def _singular(kin: ArmKinematics, found: check.Singular) -> str:
    if not len(found.q):
        return "no posture found"
    places, rest = [], np.ones(len(found.q), dtype=np.bool_)
    for joint, name in enumerate(kin.arm.joints):
        if angles := found.recurring(joint):
            places.append(f"{name} at {' or '.join(f'{angle:g}' for angle in angles)}")
            rest &= (np.abs(found.q[:, joint, None] - angles) > 0.01).all(axis=1)
    places += [f"{rest.sum()} where it depends on several joints"] if rest.any() else []
    return f"{len(found.q)} postures found: {'; '.join(places)}"


def _subject(arguments: argparse.Namespace) -> Subject:
    """The arm of a name or URDF, with its calibration and tool."""
    if Path(arguments.arm).suffix.lower() in (".yaml", ".yml", ".conf"):
        raise InputError(f"{arguments.arm} is a calibration: name its UR too, such as check ur5e --calibration FILE")
    arm = ArmFlags.of(arguments).arm(arguments.arm)
    print_notes(arm.notes)
    real = ArmKinematics.of(arm)
    if arguments.calibration is None:
        return Subject(real, None)
    arguments.calibration = None
    return Subject(real, ArmKinematics.of(ArmFlags.of(arguments).arm(arguments.arm)))


def _parser(prog: str) -> Parser:
    parser = Parser(
        prog=prog,
        description="What an arm is and how its inverse kinematics does: class, limits, reach, collisions, singular "
        "postures, solvers; of a calibrated UR also how far its data sheet is off.",
    )
    parser.add_argument(
        "arm",
        metavar="FILE|NAME",
        help="a URDF or MJCF, the name of an arm, or module:attribute; the name of a UR with --calibration",
    )
    parser.add_argument(
        "--poses", type=int, default=POSES, help=f"number of poses that the solvers are tried on ({POSES})"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the random postures (0)")
    ArmFlags.add_to(parser)
    parser.add_argument("--picture", metavar="FILE.png", help="draw the workspace from the side")
    parser.add_argument(
        "--log",
        metavar="FILE",
        help="say how well the arm explains a recording (as of `kinreach calibrate`), instead of the report",
    )
    return parser
