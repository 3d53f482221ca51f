"""`kinreach ik`: poses in, joint angles out."""

from __future__ import annotations

import csv
import io
import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from rich.progress import Progress

from kinreach._checks import Floats, check_path, printable
from kinreach._files import write_text
from kinreach._flags import may_be_degrees, numbers_of, pose_numbers_of, posture_of
from kinreach._rotations import pose, pose_error
from kinreach._tables import read_table
from kinreach.cli import Parser, complain, print_notes
from kinreach.deploy._remarks import arm_and_tip, tool_note, why_none
from kinreach.deploy._surroundings import add_surroundings, surrounded
from kinreach.errors import InputError, NoShapesError
from kinreach.kinematics import (
    ArmKinematics,
    AxisGoal,
    ClosedFormKinematics,
    CollisionChecker,
    FiveAxisKinematics,
    Goal,
    NearestOrientationGoal,
    PoseGoal,
    PositionGoal,
    RedundantKinematics,
    SevenAxisKinematics,
    SixAxisKinematics,
    Tolerance,
    URKinematics,
)
from kinreach.robots.inside import JOINTS, ArmFlags

if TYPE_CHECKING:
    from kinreach.kinematics.inside import IKSolutions

#: Columns of the poses that are read.
COLUMNS = ("x", "y", "z", "rx", "ry", "rz")
#: Largest file of poses [bytes], and most poses in it.
MAX_BYTES, MAX_POSES = 2**28, 1_000_000
#: Exit code where a pose has no posture.
NONE_FOUND = 1
#: Joints of an arm of which a pose's position is the goal; and the column of what is left of an orientation.
POSITION_JOINTS, LEFT = 3, ("left_rad",)


class Found(NamedTuple):
    """A posture for a goal.

    Attributes:
        q: The posture [rad], shape (n,).
        branch: Its branch index.
        left: What is left of the orientation [rad], of arms of four and five axes.
        kind: What that is, such as "minimum".
        collides: What collides, empty if nothing does.
        to_seed: What it is to the seed.
    """

    q: Floats
    branch: int
    left: float = 0.0
    kind: str = ""
    collides: str = ""
    to_seed: str = "nearest to"


#: The kind of a posture that has another orientation than the seed's, because that collides.
TURNED = "turned, free"


class NearestAxisGoal(AxisGoal):
    """A point, and a direction of the tip's z axis as near as it goes."""


class Answers:
    """Postures of an arm for goals, and what they collide with."""

    def __init__(self, kinematics: ArmKinematics, seed: Floats) -> None:
        self.kinematics, self.seed = kinematics, seed
        self.checker: CollisionChecker | None
        try:
            self.checker = CollisionChecker(kinematics)
        except NoShapesError:
            self.checker = None

    @property
    def note(self) -> str:
        """A note on what the collision checks leave out; empty if nothing."""
        return "" if self.checker is None else tool_note(self.checker)

    def collision(self, q: Floats) -> str:
        """Return what collides in a posture, such as "forearm_link - table"; empty if nothing does, or is known."""
        return "" if self.checker is None else self.checker.reason(q)

    def postures(self, goal: Goal) -> tuple[list[Found], str]:
        """Return every posture for a goal, nearest first, colliding ones too; and why there is none.

        Arms of four and five axes have those that leave least of the orientation first. An arm with more joints than a
        pose needs, or without a closed form, has the one posture that is found, which is free.
        """
        kin = self.kinematics
        if isinstance(kin, FiveAxisKinematics):
            return self._nearest_orientations(kin, goal)
        solutions = self._solutions(goal)
        if solutions is not None:
            found = [Found(*each) for each in zip(solutions.q, solutions.branch.tolist(), strict=True)]
            return found, why_none(kin, goal.frame(), solutions.reason)
        from kinreach.kinematics import LevenbergMarquardtSolver

        accept = None if self.checker is None else self.checker.free
        if isinstance(kin, SevenAxisKinematics | RedundantKinematics) and isinstance(goal, PoseGoal):
            result = kin.nearest(goal.frame(), self.seed, accept=accept)
            said = "nearest to" if kin.knows_all_postures else "numeric: no other next to it is nearer to"
        else:
            result = LevenbergMarquardtSolver(kin).solve(goal, self.seed, accept=accept)
            said = "numeric: found from"
        if result.success:
            return [Found(result.q, max(result.branch, 0), to_seed=said)], ""
        reason = why_none(kin, goal.frame(), result.reason)
        return [], "; ".join(filter(None, (reason, kin.no_closed_form)))

    def _solutions(self, goal: Goal) -> IKSolutions | None:
        """All solutions for a goal, where the arm lists them."""
        kin = self.kinematics
        if isinstance(goal, AxisGoal) and isinstance(kin, URKinematics | SixAxisKinematics):
            return kin.axis_solutions(goal.position, goal.axis, seed=self.seed)
        if isinstance(kin, ClosedFormKinematics) and (isinstance(goal, PoseGoal) or kin.n == POSITION_JOINTS):
            return kin.all_solutions(goal.frame(), seed=self.seed)
        return None

    def _nearest_orientations(self, kin: FiveAxisKinematics, goal: Goal) -> tuple[list[Found], str]:
        if isinstance(goal, NearestAxisGoal | AxisGoal):
            solutions = kin.axis_solutions(goal.position, goal.axis, seed=self.seed)
        else:
            T = goal.position if isinstance(goal, PositionGoal) else goal.frame()
            solutions = kin.all_solutions(T, seed=self.seed)
        minima = solutions.minima
        rows = zip(minima.q, minima.branch.tolist(), minima.left.tolist(), minima.kind, strict=True)
        whose = "the seed's" if isinstance(goal, PositionGoal) else "the"
        found = [Found(*row, to_seed=f"leaves least of {whose} orientation, and is nearest to") for row in rows]
        if isinstance(goal, PositionGoal) and found and self.checker is not None and not self.checker.free(found[0].q):
            found = [*self._turned(kin, goal), *found]
        if not found or not isinstance(goal, PoseGoal | AxisGoal) or isinstance(goal, NearestAxisGoal):
            return found, why_none(kin, goal.frame(), solutions.reason)
        exact = [each for each in found if each.left <= Tolerance().orientation]
        least = found[0].left
        what = "direction" if isinstance(goal, AxisGoal) else "orientation"
        reason = f"{kin.n} joints leave {least:.3g} rad ({degrees_of(least):.1f} degrees) of the {what} at this point"
        return exact, "" if exact else f"{reason}; --nearest-orientation takes that"

    def _turned(self, kin: FiveAxisKinematics, goal: PositionGoal) -> list[Found]:
        """The free posture nearest to the seed at a point where the seed's orientation collides."""
        result = kin.solve(goal, self.seed, accept=None if self.checker is None else self.checker.free)
        if not result.success:
            return []
        _, left = pose_error(kin.fk(self.seed), kin.fk(result.q))
        return [Found(result.q, -1, left, TURNED, to_seed="nearest without a collision to")]

    def all(self, goal: Goal) -> tuple[list[Found], str]:
        """Return every posture for a goal with what collides; and why there is none.

        Free ones come first, then nearest first.
        """
        found, reason = self.postures(goal)
        judged = [each._replace(collides=self.collision(each.q)) for each in found]
        return sorted(judged, key=lambda each: bool(each.collides)), reason

    def nearest(self, goal: Goal) -> tuple[Found | None, str]:
        """Return the posture nearest to the seed that does not collide, or None and why."""
        found, reason = self.postures(goal)
        free = next((each for each in found if self.checker is None or self.checker.free(each.q)), None)
        if free is None and found:
            causes = ", ".join(dict.fromkeys(self.collision(each.q) for each in found))
            reason = f"{'all ' * (len(found) > 1)}{len(found)} postures collide: {causes}"
        return free, reason


def degrees_of(angle: float) -> float:
    return float(np.degrees(angle))


def main(argv: Sequence[str], *, prog: str) -> int:
    """Solve one pose and print its postures, or many from a file to a file."""
    arguments = _parser(prog).parse_args(argv)
    asked = arguments.pose, arguments.poses, arguments.point
    if sum(each is not None for each in asked) != 1:
        raise InputError("give --pose, --poses or --point")
    if arguments.axis is not None and arguments.point is None:
        raise InputError("--axis belongs to --point")
    if (arguments.poses is None) != (arguments.out is None):
        raise InputError("--poses and --out belong together")
    arm = ArmFlags.of(arguments).arm(arguments.arm)
    print_notes(arm.notes)
    default = "base" if arm.joints == JOINTS else "base_link"
    base = _base(arguments.base) if arguments.base else default
    kin = ArmKinematics.of(arm, base=base)
    seed = np.array(arm.home)
    if arguments.seed is not None:
        limits = kin.lower, kin.upper
        seed = posture_of("--seed", arguments.seed, kin.n, degrees=arguments.degrees, limits=limits, slides=kin.slides)
    if arguments.cell and arguments.table is not None:
        raise InputError("give --cell or --table, not both")
    answers = Answers(
        ArmKinematics.of(surrounded(kin, arguments.table, arguments.box, cell=arguments.cell), base=base), seed
    )
    yields = arguments.nearest_orientation
    if yields and not isinstance(answers.kinematics, FiveAxisKinematics):
        raise InputError(
            f"--nearest-orientation is for arms of four and five axes; {arm.name} has {kin.n}: leave it out"
        )
    if arguments.point is not None:
        return _one(answers, _point_goal(arguments, yields=yields), degrees=arguments.degrees)
    if arguments.pose is not None:
        T = pose(pose_numbers_of("--pose", arguments.pose))
        return _one(answers, _pose_goal(T, yields=yields), degrees=arguments.degrees)
    files = check_path("--poses", arguments.poses), check_path("--out", arguments.out)
    return _many(answers, *files, every=arguments.all, degrees=arguments.degrees, yields=yields)


def _pose_goal(T: Floats, *, yields: bool) -> Goal:
    return NearestOrientationGoal(T) if yields else PoseGoal(T)


def _point_goal(arguments: Namespace, *, yields: bool) -> Goal:
    point = np.array(numbers_of("--point", arguments.point, 3))
    if arguments.axis is None:
        return PositionGoal(point)
    axis = np.array(numbers_of("--axis", arguments.axis, 3))
    return NearestAxisGoal(point, axis) if yields else AxisGoal(point, axis)


def _one(answers: Answers, goal: Goal, *, degrees: bool) -> int:
    kin = answers.kinematics
    unit, scale = "degrees" if degrees else "rad", scales_of(kin, degrees=degrees)
    sliding = ", ".join(name for name, slides in zip(kin.arm.joints, kin.slides, strict=True) if slides)
    metres = f", {sliding} in m" if sliding else ""
    print(printable(f"{arm_and_tip(kin)}, angles in {unit}{metres}"))
    found, reason = answers.all(goal)
    if not found:
        print(printable(f"no posture: {reason}"))
        return NONE_FOUND
    names = [joint.removesuffix("_joint") for joint in kin.arm.joints]
    widths = [max(len(name), 9) for name in names]
    heads = [f"{name:>{width}}" for name, width in zip(names, widths, strict=True)]
    words, remains = isinstance(kin, URKinematics), isinstance(kin, FiveAxisKinematics)
    heads += [f"{'shoulder, elbow, wrist':<24}"] * words + [f"{'left: rad':>9}  degrees  {'kind':<18}"] * remains
    print("  ".join(["branch", *heads, "collides"]))
    nearest = next((index for index, each in enumerate(found) if not each.collides), None)
    for index, each in enumerate(found):
        angles = "  ".join(
            f"{angle:>{width}.{5 if factor == 1.0 else 3}f}"
            for angle, factor, width in zip(scale * each.q, scale, widths, strict=True)
        )
        mark = "*" if index == nearest else " "
        known = each.collides or ("no" if answers.checker is not None else "not known")
        bent = f"{', '.join(kin.branch_words(each.branch)):<24}  " if isinstance(kin, URKinematics) else ""
        left = f"{each.left:>9.5f}  {degrees_of(each.left):>7.2f}  {each.kind:<18}  " if remains else ""
        print(printable(f"{mark} {each.branch:>4}  {angles}  {bent}{left}{known}"))
    seed = ", ".join(
        f"{angle:.{3 if factor == 1.0 else 1}f}" for angle, factor in zip(scale * answers.seed, scale, strict=True)
    )
    print("every posture collides" if nearest is None else f"* {found[nearest].to_seed} the seed {seed}")
    if answers.note:
        print(answers.note)
    return NONE_FOUND if nearest is None else 0


def _many(answers: Answers, source: Path, out: Path, *, every: bool, degrees: bool, yields: bool) -> int:
    poses = read_poses(source)
    if out.is_dir() or not out.parent.is_dir():
        raise InputError(f"--out must be a file in a folder that exists, got {out}")
    if out.exists() and out.samefile(source):
        raise InputError(f"--out must be another file than --poses, which it would replace, got {out}")
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    solved = 0
    scale = scales_of(answers.kinematics, degrees=degrees)
    units = ["" if factor == 1.0 else "_deg" for factor in scale]
    rows.writerow(
        ["pose", *(f"q{joint}{unit}" for joint, unit in enumerate(units, start=1)), "branch", *LEFT[:yields], "reason"]
    )
    with Progress(disable=not sys.stderr.isatty(), transient=True) as bar:
        shown = bar.add_task("poses", total=len(poses))
        for number, T in enumerate(poses, start=1):
            lines = list(_rows(answers, _pose_goal(T, yields=yields), every, scale))
            solved += any(line[-1] == "" for line in lines)
            rows.writerows([number, *line] for line in lines)
            bar.update(shown, advance=1)
    write_text(out, text.getvalue())
    print(printable(f"{solved} of {len(poses)} poses have a posture: {out}"))
    if answers.note:
        print(answers.note)
    return 0 if solved else NONE_FOUND


def scales_of(kin: ArmKinematics, *, degrees: bool) -> Floats:
    """Return what numbers of postures are printed times, shape (n,): joints that slide are in metres."""
    return np.where(kin.slides, 1.0, 180 / np.pi) if degrees else np.ones(kin.n)


def _rows(answers: Answers, goal: Goal, every: bool, scale: Floats) -> Iterator[list[object]]:
    """Rows of a goal: numbers of the posture times a scale, branch, what is left where that counts, and reason."""
    yields = isinstance(goal, NearestOrientationGoal)
    if every:
        found, reason = answers.all(goal)
    else:
        nearest, reason = answers.nearest(goal)
        found = [] if nearest is None else [nearest]
    for each in found:
        left = [each.left] if yields else []
        yield [*(scale * each.q).tolist(), each.branch, *left, f"collides: {each.collides}" if each.collides else ""]
    if not found:
        yield [*[""] * (answers.kinematics.n + 1 + yields), reason]


def read_poses(path: Path) -> Floats:
    """Return the poses of a table with the columns x, y, z, rx, ry, rz, shape (count, 4, 4)."""
    table = read_table(path, "the poses", most=MAX_BYTES)
    places = [table.place(name) for name in COLUMNS]
    if missing := [name for name, place in zip(COLUMNS, places, strict=True) if place < 0]:
        raise InputError(f"{path} has no column {', '.join(missing)}; its first line must name x,y,z,rx,ry,rz")
    if not 1 <= len(table.cells) <= MAX_POSES:
        raise InputError(f"{path} must have 1 to {MAX_POSES} poses, got {len(table.cells)}")
    numbers = table.numbers(places, needed="six numbers are needed")
    if said := may_be_degrees(f"of a pose in {path}", max((row[3:] for row in numbers), key=np.linalg.norm)):
        complain(f"note: {said}")
    return pose(numbers)


def _base(text: str) -> str | list[float]:
    return pose_numbers_of("--base", text) if any(sign.isdigit() for sign in text) and "," in text else text


def _parser(prog: str) -> Parser:
    parser = Parser(
        prog=prog,
        description="Joint angles for poses of the tool: every posture of one pose, or the nearest of each in a file.",
    )
    parser.add_argument("--arm", required=True, metavar="NAME|FILE", help="an arm, a URDF or MJCF, or module:attribute")
    parser.add_argument("--pose", metavar="X,Y,Z,RX,RY,RZ", help="metres, rotation vector in radians, as in URScript")
    parser.add_argument(
        "--point", metavar="X,Y,Z",
        help="metres, in place of a pose; four and five axes leave the orientation near the seed's",
    )  # fmt: skip
    parser.add_argument("--axis", metavar="X,Y,Z", help="with --point: direction of the tool's z axis")
    parser.add_argument(
        "--nearest-orientation", action="store_true",
        help="four and five axes: the point exactly, the orientation or axis as near as it goes; out gets left_rad",
    )  # fmt: skip
    parser.add_argument("--poses", metavar="IN.csv", help="columns x,y,z,rx,ry,rz")
    parser.add_argument(
        "--out",
        metavar="OUT.csv",
        help="columns pose,q1,...,branch,reason; angles in radians, or with --degrees q1_deg,...",
    )
    parser.add_argument("--all", action="store_true", help="write every posture of each pose")
    parser.add_argument("--seed", metavar="Q1,Q2,...", help="posture to stay near (default: the arm's home)")
    parser.add_argument("--degrees", action="store_true", help="angles that are typed, printed and written are degrees")
    parser.add_argument(
        "--base",
        metavar="FRAME",
        help="frame of the poses: base (the pendant's, default of URs), base_link (default of others), world, or a "
        "frame of your own by its pose in base_link, X,Y,Z,RX,RY,RZ",
    )
    parser.add_argument(
        "--cell", action="store_true", help="check the obstacles of the arm's work cell in kinreach, too"
    )
    add_surroundings(parser, "the frame of the poses")
    ArmFlags.add_to(parser)
    return parser
