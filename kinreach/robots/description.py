"""What an arm is: one URDF and the facts that a URDF does not carry. Data only, no engine is imported here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

from kinreach.robots.urdf import check_urdf
from kinreach.robots.workcell import CameraMount, Workcell


@dataclass(frozen=True)
class Gripper:
    """A parallel gripper driven by one prismatic joint; the other finger mimics it.

    Attributes:
        joint: Name of the driven prismatic joint; its position is half the opening [m].
        mimic_joint: Name of the joint that follows with ratio 1.
        stroke: Largest opening between the fingers [m].
        opening: Opening in which the arm reaches [m].
        force: Largest force of the drive [N].
    """

    joint: str
    mimic_joint: str
    stroke: float
    opening: float
    force: float


def no_package() -> None:
    """For an arm whose URDF names no files."""


@dataclass(frozen=True, eq=False)
class ArmDescription:
    """One robot arm, described once for Pinocchio, placo and MuJoCo. Compared and hashed by identity.

    Attributes:
        name: Key in the registry, as in `get_arm("ur5")`.
        title: Name for people.
        build_urdf: Returns the URDF text, root link `world`, meshes as `package://` addresses.
        joints: Names of the actuated joints in the order of `q`.
        home: Start posture [rad], shape `(n,)`.
        base: Link that carries the arm's own coordinate system.
        tips: Frames that may be asked for as the tip, by short name: `{"tcp": "tcp", ...}`.
        default_tip: Key of `tips` that tasks use.
        workcell: Obstacles around the arm and where its goals are.
        disabled_collisions: Link pairs that touch by construction (SRDF `disable_collisions`).
        package_root: Returns the folder that `package://` stands for, or None if the URDF names no mesh.
        position_gains: Stiffness of the position servo of each joint [N m/rad].
        speed_limit: Joint speed the controller commands [rad/s].
        acceleration_limit: Joint acceleration the controller commands [rad/s^2].
        armature: Rotor inertia seen at each joint [kg m^2].
        joint_damping: Viscous friction of each joint [N m s/rad].
        gripper: The gripper, or None.
        moves_last: Joints that a two-phase move holds still until all others have arrived.
        cameras: Cameras on the arm and around it; `overview` is the viewpoint of pictures.
    """

    name: str
    title: str
    build_urdf: Callable[[], str]
    joints: tuple[str, ...]
    home: tuple[float, ...]
    base: str
    tips: Mapping[str, str]
    default_tip: str
    workcell: Workcell
    disabled_collisions: tuple[tuple[str, str], ...] = ()
    package_root: Callable[[], str | None] = no_package
    position_gains: tuple[float, ...] = ()
    speed_limit: float = 3.0
    acceleration_limit: float = 10.0
    armature: float = 0.1
    joint_damping: tuple[float, ...] = ()
    gripper: Gripper | None = None
    moves_last: tuple[str, ...] = ()
    cameras: tuple[CameraMount, ...] = ()

    @cached_property
    def urdf(self) -> str:
        """The URDF text, built and checked on first use.

        Raises:
            InputError: It is no URDF, or not one that an engine should be given: see `check_urdf`.
        """
        text = self.build_urdf()
        check_urdf(text, self.package_root())
        return text

    @property
    def locked_joints(self) -> Mapping[str, float]:
        """Joints that are not part of `q`, with the position [m] they are held at."""
        if self.gripper is None:
            return {}
        half = self.gripper.opening / 2
        return {self.gripper.joint: half, self.gripper.mimic_joint: half}
