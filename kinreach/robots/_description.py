"""An arm as data: one URDF and the facts that a URDF does not carry. No engine is imported here."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from pathlib import Path
from types import UnionType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import MAX_ANGLE, Floats, as_floats, as_vector, check_known, check_number, shown
from kinreach.errors import InputError, UnknownNameError, UnknownOptionError
from kinreach.robots._calibration import Calibration, place_by_calibration
from kinreach.robots._grippers import PARALLEL_GRIPPER, Gripper, JawGripper, add_parallel_gripper
from kinreach.robots._meshes import HULLS, MESHES_AS
from kinreach.robots._srdf import read_srdf
from kinreach.robots._tools import FLANGE, TOOL, TOOL_BODY, Tool, add_tool
from kinreach.robots._ur import ur_model
from kinreach.robots._urdf import (
    WORLD,
    CheckedUrdf,
    Follows,
    UrdfArm,
    check_home,
    check_urdf,
    following_joints,
    link_before,
    links_below,
    named,
    neighbours,
    prune,
    set_limits,
    sliding_joints,
)
from kinreach.robots._workcell import CameraMount, Workcell

#: Attributes with one number for each joint.
PER_JOINT = ("home", "position_gains", "joint_damping")
#: Attributes that only a URDF file gives.
FROM_FILE = ("build_urdf", "package_root")


def no_package() -> None:
    """Return None: the package of an arm whose URDF names no files."""


@dataclass(frozen=True, eq=False)
class ArmDescription:
    """One robot arm, described once for Pinocchio, placo and MuJoCo. Compared and hashed by identity.

    Only `name`, `title` and `build_urdf` must be given. What is left empty is read from the URDF, as described below.

    Attributes:
        name: Key in the registry, as in `get_arm("ur5")`.
        title: Name for people.
        build_urdf: Returns the URDF, its text or its `<robot>` element, meshes as `package://` addresses within
            `package_root`. It is checked once, when it is first needed; `with_*` and `calibrated` change a copy.
        joints: Names of the actuated joints in the order of `q`; default are the joints that move between the root and
            the tip. All other joints must be fixed, or be the gripper's.
        home: Start posture [rad], shape `(n,)`, within the limits; default is the middle of each joint's range.
        base: Link that carries the arm's own coordinate system; default is the URDF's first link, or the only one that
            a first link `world` carries fixed.
        tips: Frames that may be asked for as the tip, by short name: `{"tcp": "tcp", ...}`; default are the links that
            the last joint carries rigidly.
        default_tip: Key of `tips` that tasks use; default is the first, and without `tips` the link
            with the most joints between it and the root.
        workcell: Obstacles around the arm and where its goals are; default is an empty one.
        disabled_collisions: Link pairs that touch by construction, as `with_srdf` reads them. None: neighbours, and
            pairs that collide at home, and pairs that always collide, found by `kinreach.kinematics._collision`.
        package_root: Returns the folder that `package://` stands for, or None if the URDF names no mesh.
        meshes: What collision checks use of a mesh: `"hulls"`, its convex hull, as MuJoCo does; or `"triangles"`, the
            mesh itself, the default of URDF files.
        position_gains: Stiffness of the position servo of each joint [N m/rad], of a slide [N/m]; default makes each
            servo answer in 1/30 s, by an estimate of the inertia, or of the mass, that the joint carries.
        speed_limit: Joint speed the controller commands [rad/s, m/s]; default is the slowest joint's limit, at most 3.
        acceleration_limit: Joint acceleration the controller commands [rad/s^2, m/s^2]; default is what half of the
            joints' torque or force can give, at most 10.
        armature: Rotor inertia seen at each joint [kg m^2], at a slide [kg].
        joint_damping: Viscous friction of each joint [N m s/rad, N s/m]; default is that of the URDF.
        gripper: The gripper, or None.
        moves_last: Joints that a two-phase move holds still until all others have arrived; default none.
        cameras: Cameras on the arm and around it; those with `observed=True` measure the goal, and `overview` is the
            viewpoint of pictures. Default is an `overview` from which the whole arm is seen.
        missing_shapes: Why collision shapes are missing, so that collision checks and simulation are refused; empty
            if none is.
        notes: What was left out of the URDF file, such as a gripper's joints, or is assumed of a calibration, a line
            each.

    Raises:
        InputError: What has to be read from the URDF is not in it, or a number or an object cannot be that of an arm;
            the message names it.
    """

    name: str
    title: str
    build_urdf: Callable[[], str | ET.Element]
    joints: tuple[str, ...] = ()
    home: tuple[float, ...] = ()
    base: str = ""
    tips: Mapping[str, str] = field(default_factory=dict)
    default_tip: str = ""
    workcell: Workcell = field(default_factory=Workcell)
    disabled_collisions: tuple[tuple[str, str], ...] | None = None
    package_root: Callable[[], str | None] = no_package
    meshes: str = HULLS
    position_gains: tuple[float, ...] = ()
    speed_limit: float = 0.0
    acceleration_limit: float = 0.0
    armature: float = 0.1
    joint_damping: tuple[float, ...] = ()
    gripper: Gripper | JawGripper | None = None
    moves_last: tuple[str, ...] = ()
    cameras: tuple[CameraMount, ...] = ()
    missing_shapes: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        defaults: Mapping[str, Callable[[UrdfArm], object]] = {
            "default_tip": lambda urdf: urdf.tip,
            "tips": lambda urdf: urdf.tips,
            "joints": lambda urdf: urdf.joints,
            "home": lambda urdf: urdf.home,
            "base": lambda urdf: urdf.base,
            "position_gains": lambda urdf: urdf.position_gains(self.armature),
            "speed_limit": lambda urdf: urdf.speed_limit,
            "acceleration_limit": lambda urdf: urdf.acceleration_limit(self.armature),
            "joint_damping": lambda urdf: urdf.damping,
            "cameras": lambda urdf: (urdf.overview,),
        }
        self._check_kinds()
        for name in PER_JOINT:
            object.__setattr__(self, name, tuple(as_floats(name, getattr(self, name)).ravel().tolist()))
        if self.tips and not self.default_tip:
            object.__setattr__(self, "default_tip", next(iter(self.tips)))
        elif self.tips and self.default_tip not in self.tips:
            raise UnknownNameError(
                f"default_tip of arm {self.name!r} is {shown(self.default_tip)}, which is none of its tips "
                f"{', '.join(self.tips)}; with other tips give a default_tip, too, such as "
                f"default_tip={next(iter(self.tips))!r}"
            )
        missing = [name for name in defaults if not getattr(self, name)]
        if missing:
            tip = self.tips.get(self.default_tip, self.default_tip) if self.default_tip else None
            gripper = () if self.gripper is None else self.gripper.joints
            urdf = UrdfArm(self.name, self._checked.robot, tip=tip, joints=self.joints, held=gripper)
            for name in missing:
                object.__setattr__(self, name, defaults[name](urdf))
        count = len(self.joints)
        for name in PER_JOINT:
            values = getattr(self, name)
            if len(values) != count:
                raise InputError(f"arm {self.name!r}: {name} must have {count} numbers, one a joint, got {values}")
        for name in ("speed_limit", "acceleration_limit"):
            check_number(f"{name} of arm {self.name!r}", getattr(self, name), above=0.0)
        for name, bound in (("position_gains", {"above": 0.0}), ("joint_damping", {"least": 0.0}), ("home", {})):
            for value in getattr(self, name):
                check_number(f"{name} of arm {self.name!r}", value, **bound)
        for joint in self.moves_last:
            check_known(f"joint of arm {self.name!r} in moves_last", joint, self.joints)
        if missing:
            self._check_fit()

    def _check_kinds(self) -> None:
        """Refuse values of another type than the attribute's."""
        kinds: Mapping[str, tuple[type | UnionType, str]] = {
            "name": (str, "text"),
            "title": (str, "text"),
            "default_tip": (str, "text"),
            "build_urdf": (Callable, "a function"),  # type: ignore[dict-item]
            "package_root": (Callable, "a function"),  # type: ignore[dict-item]
            "workcell": (Workcell, "a Workcell"),
            "gripper": (Gripper | JawGripper | None, "a Gripper or None"),
        }
        for name, (kind, wanted) in kinds.items():
            if not isinstance(getattr(self, name), kind):
                raise InputError(f"{name} of an arm must be {wanted}, got {shown(getattr(self, name))}")
        if not all(isinstance(camera, CameraMount) for camera in self.cameras):
            raise InputError(f"cameras of arm {self.name!r} must be CameraMounts, got {shown(self.cameras)}")
        check_known(f"meshes of arm {self.name!r}", self.meshes, MESHES_AS)
        check_number(f"armature of arm {self.name!r}", self.armature, least=0.0)

    def _check_fit(self) -> None:
        """Refuse a start posture outside the limits, and cameras on links that the URDF does not have."""
        robot = self._checked.robot
        links = [WORLD, *(link.get("name", "") for link in robot.findall("link"))]
        for camera in self.cameras:
            check_known(f"link of camera {camera.name!r} of arm {self.name!r}", camera.link, links)
        check_home(self.name, robot, dict(zip(self.joints, self.home, strict=True)))

    @classmethod
    def from_file(
        cls,
        file: str | Path,
        *,
        name: str | None = None,
        tip: str | None = None,
        base: str | None = None,
        joints: Sequence[str] | None = None,
        home: Sequence[float] | None = None,
        held: Mapping[str, float] | None = None,
        workcell: Workcell | None = None,
        package_dirs: Sequence[str | Path] = (),
        gripper_on: str | None = None,
        meshes: str | None = None,
        **facts: Any,
    ) -> ArmDescription:
        """Describe an arm by its file: a URDF, or MuJoCo's MJCF. `from_urdf` is another name of this.

        Joints that are not part of the arm, such as a gripper's or a rail's, are held still: they become fixed joints.
        What kinematics does not use, such as a shape without size or an effort below zero, is repaired or left out.
        The attribute `notes` lists all of this. A visual mesh that is not found is left out; without a collision
        mesh there is kinematics, but no collision checks and no simulation.

        Of an MJCF each body is a link, and so is each named site. Its keyframe `home` is the start posture, and what
        its joints, position servos and motors are limited to are the limits. Scenery and loose objects are left out.

        Args:
            file: Path of the file. Meshes may be named relative to it, or as `package://PACKAGE/...` or `file://...`.
            name: Key in the registry; default is the name in the URDF.
            tip: Link that is the tip; default is the one farthest from the root, counted in joints, that is neither a
                finger nor a sensor's.
            base: Link that carries the arm's own coordinate system; default is the root, or what a root `world` carries
                fixed.
            joints: Names of the joints of `q`; default are those that move between root and tip, without a gripper's.
            home: Start posture [rad], within the limits; default is the file's, or the middle of each joint's range.
            held: Where joints that are not part of the arm are held [rad, m], within their limits; default is 0, or
                the nearest limit. One or two joints that slide under the whole arm are not part of it, unless `joints`
                names them.
            workcell: Obstacles and goals; default is an empty work cell.
            package_dirs: Folders that hold packages, or are one, in which `package://PACKAGE` is looked for first;
                then those around the file, and those of `ROS_PACKAGE_PATH` and `AMENT_PREFIX_PATH`.
            gripper_on: Link that the parallel gripper of `kinreach.robots._grippers` is mounted on; its `tcp` is then
                the default tip. Default is no gripper.
            meshes: What collision checks use of a mesh, `"triangles"`, the default of a URDF, or `"hulls"`, that of an
                MJCF, as in MuJoCo.
            facts: Any other attribute of `ArmDescription`, such as `title=` and `position_gains=`. `gripper=` describes
                one that is in the file, whose joints stay; `notes=` are added to those of the file.

        Raises:
            UnknownOptionError: A fact that is no attribute of `ArmDescription`, or that the file gives.
            InputError: The file cannot be read or does not describe an arm; or a joint or link is not in it; or a joint
                has no range, or `home` is outside of one.
        """
        gripper = _checked_facts(facts).pop("gripper", None)
        if gripper is not None and gripper_on is not None:
            raise InputError("give gripper= for one that is in the file, or gripper_on= to mount one; not both")
        own = () if gripper is None else gripper.joints
        from kinreach.robots._urdf_file import read_arm  # an arm by its name needs no reader of files

        source = read_arm(file, tip=tip, joints=joints, held=held or {}, package_dirs=package_dirs, gripper=own)
        tips = source.tips
        if gripper_on is not None:
            check_known(f"link of arm {source.name!r} that can carry a gripper", gripper_on, tips)
            add_parallel_gripper(source.robot, gripper_on)
            tips, gripper = {"tcp": "tcp", **tips}, PARALLEL_GRIPPER
        root = source.package_root
        found: dict[str, Any] = {
            "title": name or source.name,
            "tips": tips,
            "default_tip": source.tip if gripper_on is None else "tcp",
            "missing_shapes": source.missing_shapes,
        }
        if "tips" in facts and "default_tip" not in facts:
            found["default_tip"] = next((key for key, link in facts["tips"].items() if link == source.tip), "")
        if source.may_touch is not None:
            found["disabled_collisions"] = (*neighbours(source.robot), *source.may_touch)
        found |= {key: value for key, value in facts.items() if key != "notes"}
        if home is None and source.home is not None:
            home = [source.home[joint] for joint in source.joints]
        return cls(
            name=name or source.name,
            build_urdf=CheckedUrdf.of(name or source.name, source.robot, root),
            package_root=no_package if root is None else partial(str, root),
            joints=source.joints,
            home=() if home is None else tuple(home),
            base=base or source.base,
            workcell=workcell or Workcell(),
            gripper=gripper,
            notes=(*source.notes, *facts.get("notes", ())),
            meshes=meshes or source.meshes,
            **found,
        )

    from_urdf = from_file

    def with_limits(self, limits: float | Mapping[str, tuple[float, float]]) -> ArmDescription:
        """Return the same arm with other joint limits, such as those that are set on its pendant.

        A joint that turns without end has limits, too, once it is given them. Where the start posture is beyond limits,
        it moves to them.

        Args:
            limits: Lower and upper limit [rad, m] by the name of the joint; others stay. A number is ± that for all
                joints that turn.

        Raises:
            UnknownNameError: The arm has no joint of that name.
            InputError: A limit is not a finite number, or a lower one is not below its upper one.
        """
        if not isinstance(limits, Mapping):
            bound = check_number("limits", limits, above=0.0, most=MAX_ANGLE)
            sliding = sliding_joints(self._checked.robot)
            limits = {joint: (-bound, bound) for joint in self.joints if joint not in sliding}
        robot = self._checked.copy()
        for name, pair in limits.items():
            check_known(f"joint of arm {self.name!r}", name, self.joints)
            lower, upper = as_vector(f"the limits of joint {name!r}", pair, 2, most=MAX_ANGLE).tolist()
            set_limits(robot, name, lower, upper)
        check_urdf(robot, self.package_root())
        arm = UrdfArm(self.name, robot, tip=self.tips[self.default_tip], joints=self.joints)
        lower, upper = zip(*arm.limits, strict=True)
        return replace(self, build_urdf=CheckedUrdf(robot), home=tuple(np.clip(self.home, lower, upper).tolist()))

    def with_srdf(self, file: str | Path) -> ArmDescription:
        """Return the same arm with the pairs of links that MoveIt's SRDF lets touch, and neighbours; all others count.

        They take the place of `disabled_collisions`. Mount a tool or a gripper afterwards.

        Args:
            file: Path of the SRDF, expanded if it is xacro.

        Raises:
            InputError: The file cannot be read, is no SRDF, or names no two links of this arm.
        """
        robot = self._checked.robot
        read = read_srdf(file, [link.get("name", "") for link in robot.findall("link")])
        pairs = (*neighbours(robot), *read.may_touch)
        return replace(self, disabled_collisions=pairs, notes=(*self.notes, *read.notes))

    def with_tool(self, tool: Tool | str | ArrayLike) -> ArmDescription:
        """Return the same arm with a tool on its flange, whose centre point becomes the tip `"tool"`.

        It replaces a gripper, such as that of the thesis's arm, but not a `JawGripper`, which is part of its last link.

        Args:
            tool: A `Tool`; or only its centre point, `[x, y, z, rx, ry, rz]` as on the pendant, or a 4x4 transform; or
                `"gripper"`, the thesis's. All in the frame of the tip `tool0`, or of the default tip if there is none.

        Raises:
            InputError: As `Tool`.
        """
        tool = Tool.of(tool)
        robot, tips, disabled = self._checked.copy(), dict(self.tips), self.disabled_collisions
        flange = tips.get(FLANGE, tips[self.default_tip])
        if isinstance(self.gripper, Gripper):
            prune(robot, links=links_below(robot, flange))
        for link in (TOOL, TOOL_BODY):
            if named(robot, "link", link) is not None:
                raise InputError(f"arm {self.name!r} has a link {link!r} already")
        root = add_tool(robot, flange, tool, self.package_root())
        links = {link.get("name") for link in robot.findall("link")}
        if disabled is not None:
            disabled += ((link_before(robot, flange), TOOL_BODY),)  # joint to joint, they touch
            disabled = tuple(pair for pair in disabled if links.issuperset(pair))
        return replace(
            self,
            name=f"{self.name}_tool",
            title=f"{self.title.replace(' with parallel gripper', '')} with tool",
            build_urdf=CheckedUrdf(robot),
            package_root=no_package if root is None else partial(str, root),
            tips={**{name: link for name, link in tips.items() if link in links}, TOOL: TOOL},
            default_tip=TOOL,
            disabled_collisions=disabled,
            gripper=self.gripper if isinstance(self.gripper, JawGripper) else None,
            cameras=tuple(camera for camera in self.cameras if camera.link in {WORLD, *links}),
        )

    def with_gripper(self, gripper: Gripper = PARALLEL_GRIPPER) -> ArmDescription:
        """Return the same arm with a parallel gripper on its flange, whose tip is `"tcp"`.

        Args:
            gripper: Its fingers; default is the thesis's gripper.

        Raises:
            InputError: It has a gripper already, or no tip `tool0`, or is given no `Gripper`.
        """
        given: Any = gripper
        if not isinstance(given, Gripper):
            raise InputError(f"gripper must be a Gripper, got {shown(given)}")
        if self.gripper is not None:
            raise InputError(f"arm {self.name!r} has a gripper already")
        check_known(f"tip of arm {self.name!r} that can carry a gripper", FLANGE, self.tips)
        robot, flange = self._checked.copy(), self.tips[FLANGE]
        prune(robot, links=("tcp",))
        add_parallel_gripper(robot, flange, gripper)
        return replace(
            self,
            title=f"{self.title} with parallel gripper",
            build_urdf=CheckedUrdf(robot),
            tips={**self.tips, "tcp": "tcp"},
            default_tip="tcp",
            gripper=gripper,
        )

    def calibrated(
        self, file: str | Path | Calibration, *, model: str | None = None, repair: bool = False
    ) -> ArmDescription:
        """Return the same arm with its joints where its factory calibration has them.

        Args:
            file: The ROS driver's `kinematics.yaml`, the controller's `calibration.conf`, a program of PolyScope
                (`.urp`), a calibrated URDF, or the name of a published calibration, a key of
                `kinreach.robots.PUBLISHED_CALIBRATIONS`; an export, a recording or a table, to which it is fitted as by
                `kinreach.robots.calibrate`; or a calibration that was read or found before.
            model: Which UR it is, "ur3" to "ur30"; default is the one that this arm's name begins with.
            repair: Correct what an old exporter folded (`kinreach.robots.read_calibration`).

        Raises:
            UnknownNameError: Unknown model.
            InputError: The file is none of these, is folded, or does not fit the model.
        """
        from kinreach.robots._calibration_fit import calibration_from  # scipy takes as long to import as the rest

        name = (ur_model(self.name) or self.name) if model is None else model
        calibration = file if isinstance(file, Calibration) else calibration_from(file, name, repair=repair)
        check_known(f"tip of arm {self.name!r}", "tool0", self.tips)
        robot = self._checked.copy()
        place_by_calibration(robot, calibration, base=self.base, tip=self.tips["tool0"])
        return replace(
            self,
            name=f"{self.name}_calibrated",
            title=f"{self.title}, calibrated by {calibration.file.name}",
            build_urdf=CheckedUrdf(robot),
            notes=(*self.notes, *[calibration.note] * bool(calibration.note)),
        )

    @cached_property
    def urdf(self) -> str:
        """The URDF text, built and checked on first use.

        Raises:
            InputError: Not a URDF, or one that `check_urdf` refuses; the start posture is outside its limits, or a
                camera on a link that it does not have.
        """
        self._check_fit()
        return self._checked()

    @cached_property
    def robot(self) -> ET.Element:
        """The `<robot>` element of `urdf`; only to be read."""
        self._check_fit()
        return self._checked.robot

    def __getstate__(self) -> dict[str, Any]:
        """The attributes, with the URDF itself for a function that returns it and cannot be imported, as a lambda."""
        anonymous = "<" in getattr(self.build_urdf, "__qualname__", "")
        return self.__dict__ | ({"build_urdf": self._checked} if anonymous else {})

    @cached_property
    def _checked(self) -> CheckedUrdf:
        if isinstance(self.build_urdf, CheckedUrdf):
            return self.build_urdf
        return CheckedUrdf.of(self.name, self.build_urdf(), self.package_root())

    @property
    def goal_cameras(self) -> tuple[CameraMount, ...]:
        """The cameras that measure the goal, in the order of the observation."""
        return tuple(camera for camera in self.cameras if camera.observed)

    @property
    def locked_joints(self) -> Mapping[str, float]:
        """Joints that are not part of `q`, with the position [m, rad] they are held at."""
        gripper = self.gripper
        if gripper is None:
            return {}
        return dict(zip(gripper.joints, gripper.positions(np.array(gripper.opening)).tolist(), strict=True))


def between_phases(arm: ArmDescription, q: Floats, target: Floats) -> Floats:
    """Return the postures (..., n) between the phases of moves from `q`: all but `arm.moves_last` are at the target."""
    return np.where(np.isin(arm.joints, arm.moves_last), q, target)


def followers(arm: ArmDescription) -> dict[str, Follows]:
    """Return the joints that follow one of an arm's, by their names, and how."""
    every = following_joints(arm.robot).items()
    return {name: how for name, how in every if name not in arm.locked_joints and how.joint in arm.joints}


def _checked_facts(facts: dict[str, Any]) -> dict[str, Any]:
    """Refuse what is not an attribute that may be given beside a file, or of another kind."""
    available = [each.name for each in fields(ArmDescription) if each.name not in FROM_FILE]
    for name in facts:
        if name not in available:
            raise UnknownOptionError(
                f"unknown attribute of an arm from a file {name!r}; available: {', '.join(available)}"
            )
    for name, kind, wanted in (
        ("gripper", Gripper | JawGripper | None, "a Gripper or None"),
        ("tips", Mapping, "a mapping of short names to links"),
        ("notes", tuple | list, "a tuple of lines"),
    ):
        if name in facts and not isinstance(facts[name], kind):
            raise InputError(f"{name} of an arm must be {wanted}, got {shown(facts[name])}")
    return facts
