"""A motion as `kinreach move` is asked for it: planned, tried in MuJoCo, and what there is to say about it."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinreach._checks import Floats, check_number
from kinreach._flags import numbers_of, pose_numbers_of, posture_of
from kinreach._rotations import pose_error
from kinreach.deploy._controller import FINISHED, Controller, Recording
from kinreach.deploy._planning import SPEED, Leg, planned_program
from kinreach.deploy._program import Program
from kinreach.deploy._remarks import arm_and_tip, fastest, tool_note, untouched, why_none
from kinreach.deploy._surroundings import add_meshes, add_surroundings, meshes_of, surrounded
from kinreach.errors import InputError, PathError
from kinreach.kinematics import ArmKinematics, ClosedFormKinematics, CollisionChecker, joint_line, pose
from kinreach.kinematics.inside import PATH_MARGIN, described, postures_of
from kinreach.robots import ArmDescription, Box, Obstacle

#: Distance from everything that what is sent keeps [m], and how much more its samples keep, so that it does between
#: them, too.
KEEPS, SAMPLING = PATH_MARGIN, 2.5e-4
HOME = "home"


@dataclass(frozen=True)
class MotionFlags:
    """What the flags of the command line say of a motion, as they are typed.

    Attributes:
        to: Goals, a pose each.
        start: Posture, or a branch at a pose; None or "home" for the arm's own.
        degrees: Angles of `start` and `max_travel` are in degrees.
        table: Height of its top.
        boxes: A box each.
        meshes: A mesh each.
        mesh_scale: Metres per unit of their files.
        cell: Keep the arm's own table and floor.

    Raises:
        InputError: A goal that is no pose, or a speed out of range.
    """

    to: tuple[str, ...]
    start: str | None = None
    degrees: bool = False
    branch: str | None = None
    max_travel: str | None = None
    linear: bool = False
    speed: float = SPEED
    blend: float = 0.0
    table: str | None = None
    boxes: tuple[str, ...] = ()
    meshes: tuple[str, ...] = ()
    mesh_scale: float = 1.0
    cell: bool = True

    def __post_init__(self) -> None:
        check_number("--speed", self.speed, above=0.0, most=1.0)
        self.goals  # noqa: B018  (refuses what is no pose before the arm is read)

    @staticmethod
    def add_to(parser: argparse.ArgumentParser) -> None:
        """Add the flags."""
        parser.add_argument(
            "--to",
            required=True,
            action="append",
            metavar="X,Y,Z,RX,RY,RZ",
            help="goal of the tool in the frame base, as on the pendant: metres, rotation vector in radians; repeat "
            "it for further goals",
        )
        parser.add_argument(
            "--from",
            dest="start",
            metavar="Q1,...,Q6|BRANCH@POSE",
            help="start posture in radians; or a row of `kinreach ik`: its branch, @, and the pose; or "
            f"{HOME} (default)",
        )
        parser.add_argument("--degrees", action="store_true", help="the angles of --from and --max-travel are degrees")
        parser.add_argument(
            "--branch",
            metavar="N|WORDS|same",
            help="how the arm is bent at every goal: the number or words of `kinreach ik`, such as "
            "'right, up, straight' or only 'up'; or as in the start posture (default: whichever is nearest along the "
            "way)",
        )
        parser.add_argument(
            "--max-travel",
            metavar="RAD",
            help="largest way of a joint to a goal, in radians or with --degrees in degrees",
        )
        parser.add_argument("--linear", action="store_true", help="move the tool on straight lines")
        parser.add_argument(
            "--speed",
            type=float,
            default=SPEED,
            metavar="PART",
            help="of the joints' limits, or of 1 m/s (%(default)s)",
        )
        parser.add_argument(
            "--blend",
            type=float,
            default=0.0,
            metavar="M",
            help="radius at all goals but the last, and where a way around obstacles turns if it stays free (0: stop)",
        )
        parser.add_argument("--no-cell", action="store_true", help="no table and no floor around the arm")
        add_surroundings(parser, "the frame base, as on the pendant")
        add_meshes(parser, "the frame base")

    @classmethod
    def of(cls, arguments: argparse.Namespace) -> MotionFlags:
        """Read the flags of `add_to` from the parsed arguments."""
        return cls(
            tuple(arguments.to), arguments.start, arguments.degrees, arguments.branch, arguments.max_travel,
            arguments.linear, arguments.speed, arguments.blend, arguments.table, tuple(arguments.box),
            tuple(arguments.mesh), arguments.mesh_scale, not arguments.no_cell,
        )  # fmt: skip

    def starting_at(self, q: Floats) -> MotionFlags:
        """Return the flags with a start posture [rad], shape (6,), to its last bit."""
        most = self.most_turn
        return replace(
            self, start=",".join(map(repr, q.tolist())), degrees=False, max_travel=None if most is None else repr(most)
        )

    @property
    def words(self) -> list[str]:
        """The flags with their values, for a command line; what is as by default is left out."""
        words = [word for goal in self.to for word in ("--to", goal)]
        given = {
            "--from": None if self.start == HOME else self.start,
            "--branch": self.branch,
            "--max-travel": self.max_travel,
            "--speed": None if self.speed == SPEED else f"{self.speed!r}",
            "--blend": f"{self.blend!r}" if self.blend else None,
            "--table": self.table,
        }
        words += [word for flag, value in given.items() if value is not None for word in (flag, value)]
        words += [word for box in self.boxes for word in ("--box", box)]
        words += [word for mesh in self.meshes for word in ("--mesh", mesh)]
        words += ["--mesh-scale", f"{self.mesh_scale!r}"] if self.mesh_scale != 1.0 else []
        on = {"--degrees": self.degrees, "--linear": self.linear, "--no-cell": not self.cell}
        return words + [flag for flag, given in on.items() if given]

    @property
    def goals(self) -> list[Floats]:
        """Poses of the tool in the frame `base`, each (4, 4)."""
        return [pose(pose_numbers_of("--to", text, strict=True)) for text in self.to]

    def surrounded(self, arm: ArmDescription) -> ArmDescription:
        """Return an arm with the table and the boxes around it."""
        return surrounded(ArmKinematics(arm, base="base"), self.table, self.boxes, cell=self.cell)

    def obstacles(self, arm: ArmDescription) -> list[Obstacle]:
        """Return the meshes around an arm that `surrounded` returned."""
        return meshes_of(ArmKinematics(arm, base="base"), self.meshes, self.mesh_scale)

    def planner(self, arm: ArmDescription) -> MotionPlanner:
        """Return the planner of this motion, for an arm that `surrounded` returned."""
        return MotionPlanner(
            arm, self.goals,
            linear=self.linear, speed=self.speed, blend=self.blend,
            branch=None if self.branch is None else _branch_of(self.branch),
            max_travel=self.most_turn,
            meshes=self.obstacles(arm),
        )  # fmt: skip

    def posture(self, kin: ClosedFormKinematics) -> Floats:
        """Return the start posture [rad], shape (6,), of a planner's kinematics."""
        home = np.array(kin.arm.home)
        if self.start is None or self.start == HOME:
            return home
        words, row, numbers = self.start.rpartition("@")
        if not row:
            return posture_of("--from", numbers, 6, degrees=self.degrees, limits=(kin.lower, kin.upper))
        T = pose(pose_numbers_of("--from", numbers, strict=True))
        solutions = kin.all_solutions(T, seed=home)
        if not len(solutions):
            raise InputError(f"--from: the pose has no posture: {why_none(kin, T, solutions.reason)}")
        try:
            return postures_of(kin, solutions, _branch_of(words), home)[0]
        except InputError as error:
            raise InputError(f"--from: {error}") from None

    @property
    def most_turn(self) -> float | None:
        """Largest way of a joint to a goal [rad]."""
        if self.max_travel is None:
            return None
        most = numbers_of("--max-travel", self.max_travel, 1)[0]
        check_number("--max-travel", most, above=0.0)
        return float(np.radians(most)) if self.degrees else most


@dataclass(frozen=True, eq=False)
class TriedMotion:
    """A planned motion, and its program as it ran in MuJoCo.

    Attributes:
        checker: Of the arm with what is around it, with the margin that was kept.
        start: Posture [rad], shape (6,).
        goals: Poses of the tool in the frame `base` (4, 4).
        meshes: Around the arm, beside its work cell.
    """

    kinematics: ClosedFormKinematics
    checker: CollisionChecker
    start: Floats
    goals: Sequence[Floats]
    legs: Sequence[Leg]
    program: Program
    done: Recording
    meshes: Sequence[Obstacle] = ()

    @property
    def cautions(self) -> list[str]:
        """Ways that turn a joint by more than half a turn, or end in another branch than they began in."""
        return list(_cautions(self.kinematics, self.legs))

    @property
    def plan(self) -> Iterator[str]:
        """Lines on the start, and on the way to each goal."""
        kin = self.kinematics
        yield f"{arm_and_tip(kin)}, degrees"
        yield f"from     {_degrees(self.start)}"
        for leg in self.legs:
            yield f"to       {_degrees(leg.end)}\n         {_way(kin, leg)}"

    @property
    def ways(self) -> list[str]:
        """What there is to say about the way to each goal: branch, moves, and the largest turn of a joint."""
        return [_way(self.kinematics, leg) for leg in self.legs]

    @property
    def shares(self) -> Floats:
        """Largest speed of each joint by its limit, shape (6,)."""
        return np.abs(self.done.commanded.qd).max(axis=0) / self.kinematics.velocity_limit

    def check_finished(self) -> None:
        """Refuse a motion whose program did not come to its end.

        Raises:
            InputError: It did not; the message has the reason.
        """
        if self.done.status != FINISHED or self.done.reason:
            raise InputError(f"the dry run did not come to its end, nothing is sent: {self.done.reason}")

    @property
    def dry_run(self) -> Iterator[str]:
        """Lines on the dry run."""
        kin, done = self.kinematics, self.done
        yield f"dry run  {fastest(kin, done.commanded)}"
        boxes, meshes = kin.arm.workcell.obstacles, self.meshes
        yield f"         {untouched([*(box.name for box in boxes), *(mesh.name for mesh in meshes)])}"
        yield f"         every way keeps {1e3 * KEEPS:g} mm from everything"
        if note := tool_note(self.checker):
            yield f"         {note}"
        yield f"         ends {self.miss(self.kinematics.fk(done.measured.q[-1]))} from the goal"

    def miss(self, T: Floats) -> str:
        """Say how far a pose of the tool (4, 4) is from the last goal."""
        return far(difference(T, self.goals[-1]))


class MotionPlanner:
    """Plans a motion of one arm through goals, and tries it.

    Args:
        arm: A UR, with what is around it.
        goals: Poses of the tool in the frame `base` (4, 4).
        linear: As for `planned_program`.
        speed: As for `planned_program`.
        blend: As for `planned_program`.
        branch: As for `planned_program`.
        max_travel: As for `planned_program`.
        meshes: Around the arm, beside its work cell.
    """

    def __init__(
        self,
        arm: ArmDescription,
        goals: Sequence[Floats],
        *,
        linear: bool,
        speed: float,
        blend: float,
        branch: int | str | None = None,
        max_travel: float | None = None,
        meshes: Sequence[Obstacle] = (),
    ) -> None:
        kin = ArmKinematics.of(arm, base="base")
        if not isinstance(kin, ClosedFormKinematics):
            raise InputError(f"{arm.title} has not the geometry of a UR")
        self.arm, self.kinematics, self.goals = arm, kin, goals
        self.linear, self.speed, self.blend = linear, speed, blend
        self.branch, self.max_travel = branch, max_travel
        self.meshes = meshes
        self._around: list[Box | Obstacle] = [*arm.workcell.obstacles, *meshes]
        self.checker = CollisionChecker(kin, obstacles=self._around, margin=KEEPS + SAMPLING)

    def tried(self, start: Floats) -> TriedMotion:
        """Plan from a posture [rad], and run the program in MuJoCo.

        Raises:
            InputError: The way that was run comes nearer to something than it may, or as `planned_program`.
            PathError: As `planned_program`.
        """
        legs, program = planned_program(
            self.kinematics, self.checker, start, self.goals,
            keeps=KEEPS, linear=self.linear, speed=self.speed, blend=self.blend,
            branch=self.branch, max_travel=self.max_travel,
        )  # fmt: skip
        done = Controller(self.arm, q=start.tolist()).run(program.text)
        if done.status == FINISHED and not done.reason:
            try:
                joint_line(self.checker, done.commanded.q, keeps=KEEPS)
            except PathError as error:
                raise InputError(f"the dry run comes too near to something, nothing is sent: {error}") from None
            self._check_meshes(done)
        return TriedMotion(self.kinematics, self.checker, start, self.goals, legs, program, done, self.meshes)

    def _check_meshes(self, done: Recording) -> None:
        """Refuse a run whose arm, as it was simulated, touches a mesh: MuJoCo has only the work cell."""
        if not self.meshes:
            return
        exact = CollisionChecker(self.kinematics, obstacles=self._around)
        for q in done.measured.q:
            if touching := exact.contacts(q):
                raise InputError(
                    f"the dry run does not keep free, nothing is sent: collision: {' - '.join(touching[0])}"
                )


def difference(one: Floats, other: Floats) -> tuple[float, float]:
    """Return the distance [m] and the angle [degrees] between two poses."""
    distance, angle = pose_error(one, other)
    return distance, float(np.degrees(angle))


def far(off: tuple[float, float]) -> str:
    """Write a distance [m] and an angle [degrees]."""
    return f"{1000 * off[0]:.2f} mm and {off[1]:.2f}°"


def _degrees(q: Floats) -> str:
    return "  ".join(f"{angle:7.1f}" for angle in np.degrees(q))


def _branch_of(text: str) -> int | str:
    return int(text) if text.strip().isdecimal() else text


def _cautions(kin: ClosedFormKinematics, legs: Sequence[Leg]) -> Iterator[str]:
    """Say of each way that it turns a joint by more than half a turn, or ends in another branch than it began in."""
    for number, leg in enumerate(legs, start=1):
        to = f"to goal {number} " if len(legs) > 1 else ""
        joint = int(leg.travels.argmax())
        if leg.travels[joint] > np.pi:
            name = kin.arm.joints[joint].removesuffix("_joint")
            yield f"{to}{name} turns by {np.degrees(leg.travels[joint]):.0f}°, more than half a turn"
        if leg.branch != leg.before and min(leg.branch, leg.before) >= 0:
            before, after = (described(kin, branch) for branch in (leg.before, leg.branch))
            yield f"{to}the arm leaves its branch: from {before} to {after}"


def _way(kin: ClosedFormKinematics, leg: Leg) -> str:
    last, widest = leg.moves[-1], max(move.blend for move in leg.moves)
    branch = f"branch {described(kin, leg.branch)}" if leg.branch >= 0 else "no branch of the closed form"
    count = f"{len(leg.moves)} x " if len(leg.moves) > 1 else ""
    blend = f", blend {1000 * widest:.0f} mm" if widest else ""
    if leg.reduced:
        blend += f" (reduced from {1000 * leg.reduced:.0f} mm, to keep {1e3 * KEEPS:g} mm from everything)"
    speed = f"{last.speed:.2f} {'rad/s' if last.command == 'movej' else 'm/s'}"
    return (
        f"{branch}, {leg.free} of {leg.postures} postures free; {count}{last.command}, {speed}{blend}; "
        f"a joint turns by {np.degrees(leg.travels.max()):.0f}° at most"
    )
