"""`kinreach ik`: poses in, joint angles out."""

from __future__ import annotations

import csv
import io
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from rich.progress import Progress

from kinreach._checks import Floats, check_path, printable
from kinreach._files import write_text
from kinreach._flags import may_be_degrees, pose_numbers_of, posture_of
from kinreach._rotations import pose
from kinreach._tables import read_table
from kinreach.cli import Parser, complain, print_notes
from kinreach.deploy._remarks import tool_note, why_none
from kinreach.deploy._surroundings import add_surroundings, surrounded
from kinreach.errors import InputError, NoShapesError
from kinreach.kinematics import ArmKinematics, ClosedFormKinematics, CollisionChecker, PoseGoal, URKinematics
from kinreach.robots.inside import JOINTS, ArmFlags

#: Columns of the poses that are read.
COLUMNS = ("x", "y", "z", "rx", "ry", "rz")
#: Largest file of poses [bytes], and most poses in it.
MAX_BYTES, MAX_POSES = 2**28, 1_000_000
#: Exit code where a pose has no posture.
NONE_FOUND = 1


class Answers:
    """Postures of an arm for poses, and what they collide with."""

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

    def postures(self, T: Floats) -> tuple[list[tuple[Floats, int]], str]:
        """Return every posture of a pose with its branch, nearest first, colliding ones too; and why there is none.

        An arm without a closed form has the one posture that is found, which is free.
        """
        kin = self.kinematics
        if isinstance(kin, ClosedFormKinematics):
            solutions = kin.all_solutions(T, seed=self.seed)
            return list(zip(solutions.q, solutions.branch.tolist(), strict=True)), why_none(kin, T, solutions.reason)
        from kinreach.kinematics import LevenbergMarquardtSolver

        accept = None if self.checker is None else self.checker.free
        result = LevenbergMarquardtSolver(kin).solve(PoseGoal(T), self.seed, accept=accept)
        if result.success:
            return [(result.q, 0)], ""
        reason = why_none(kin, T, result.reason)
        return [], "; ".join(filter(None, (reason, kin.no_closed_form)))

    def all(self, T: Floats) -> tuple[list[tuple[Floats, int, str]], str]:
        """Return every posture of a pose with its branch and what collides; and why there is none.

        Free ones come first, then nearest first.
        """
        found, reason = self.postures(T)
        return sorted(((q, branch, self.collision(q)) for q, branch in found), key=lambda row: bool(row[2])), reason

    def nearest(self, T: Floats) -> tuple[tuple[Floats, int] | None, str]:
        """Return the posture nearest to the seed that does not collide and its branch, or None and why."""
        found, reason = self.postures(T)
        free = next((each for each in found if self.checker is None or self.checker.free(each[0])), None)
        if free is None and found:
            causes = ", ".join(dict.fromkeys(self.collision(q) for q, _ in found))
            reason = f"{'all ' * (len(found) > 1)}{len(found)} postures collide: {causes}"
        return free, reason


def main(argv: Sequence[str], *, prog: str) -> int:
    """Solve one pose and print its postures, or many from a file to a file."""
    arguments = _parser(prog).parse_args(argv)
    if (arguments.pose is None) == (arguments.poses is None):
        raise InputError("give --pose or --poses")
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
    answers = Answers(ArmKinematics.of(surrounded(kin, arguments, cell=arguments.cell), base=base), seed)
    if arguments.pose is not None:
        numbers = pose_numbers_of("--pose", arguments.pose)
        return _one(answers, numbers, degrees=arguments.degrees)
    files = check_path("--poses", arguments.poses), check_path("--out", arguments.out)
    return _many(answers, *files, every=arguments.all, degrees=arguments.degrees)


def _one(answers: Answers, numbers: list[float], *, degrees: bool) -> int:
    kin = answers.kinematics
    unit, scale = "degrees" if degrees else "rad", scales_of(kin, degrees=degrees)
    sliding = ", ".join(name for name, slides in zip(kin.arm.joints, kin.slides, strict=True) if slides)
    metres = f", {sliding} in m" if sliding else ""
    print(printable(f"{kin.arm.title}: tip {kin.tip} in {kin.base}, angles in {unit}{metres}"))
    found, reason = answers.all(pose(numbers))
    if not found:
        print(printable(f"no posture: {reason}"))
        return NONE_FOUND
    names = [joint.removesuffix("_joint") for joint in kin.arm.joints]
    widths = [max(len(name), 9) for name in names]
    heads = [f"{name:>{width}}" for name, width in zip(names, widths, strict=True)]
    print(
        "  ".join(["branch", *heads, *[f"{'shoulder, elbow, wrist':<24}"] * isinstance(kin, URKinematics), "collides"])
    )
    nearest = next((index for index, (*_, cause) in enumerate(found) if not cause), None)
    for index, (q, branch, cause) in enumerate(found):
        angles = "  ".join(
            f"{angle:>{width}.{5 if factor == 1.0 else 3}f}"
            for angle, factor, width in zip(scale * q, scale, widths, strict=True)
        )
        mark = "*" if index == nearest else " "
        known = cause or ("no" if answers.checker is not None else "not known")
        bent = f"{', '.join(kin.branch_words(branch)):<24}  " if isinstance(kin, URKinematics) else ""
        print(printable(f"{mark} {branch:>4}  {angles}  {bent}{known}"))
    seed = ", ".join(
        f"{angle:.{3 if factor == 1.0 else 1}f}" for angle, factor in zip(scale * answers.seed, scale, strict=True)
    )
    print("every posture collides" if nearest is None else f"* nearest to the seed {seed}")
    if answers.note:
        print(answers.note)
    return NONE_FOUND if nearest is None else 0


def _many(answers: Answers, source: Path, out: Path, *, every: bool, degrees: bool) -> int:
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
    rows.writerow(["pose", *(f"q{joint}{unit}" for joint, unit in enumerate(units, start=1)), "branch", "reason"])
    with Progress(disable=not sys.stderr.isatty(), transient=True) as bar:
        shown = bar.add_task("poses", total=len(poses))
        for number, T in enumerate(poses, start=1):
            lines = list(_rows(answers, T, every, scale))
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


def _rows(answers: Answers, T: Floats, every: bool, scale: Floats) -> Iterator[list[object]]:
    """Rows of a pose: numbers of the posture times a scale, branch and reason."""
    if every:
        found, reason = answers.all(T)
    else:
        nearest, reason = answers.nearest(T)
        found = [] if nearest is None else [(*nearest, "")]
    for q, branch, cause in found:
        yield [*(scale * q).tolist(), branch, f"collides: {cause}" if cause else ""]
    if not found:
        yield [*[""] * (answers.kinematics.n + 1), reason]


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
