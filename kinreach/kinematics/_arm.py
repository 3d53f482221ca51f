"""Forward kinematics, Jacobian and joint limits of any described arm, by Pinocchio."""

from __future__ import annotations

import importlib
import threading
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from copy import deepcopy
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import (
    MAX_ANGLE,
    Floats,
    as_floats,
    as_vector,
    check_entries,
    check_known,
    check_tensor,
    is_tensor,
)
from kinreach._engines import load
from kinreach._rotations import as_frame
from kinreach.errors import InputError
from kinreach.kinematics._chain import Moves, SerialChain
from kinreach.kinematics._solutions import SLACK, past_limits
from kinreach.robots import ArmDescription, Tool, get_arm
from kinreach.robots.inside import (
    FLANGE,
    FLIP,
    JOINTS,
    TOOL,
    Follows,
    endless_joints,
    following_joints,
    one_number_each,
    set_follows,
)

pin: Any = load("pinocchio")

#: Kinematics of arms in which joints follow others.
PALLETIZERS = (("_palletizer", "PalletizerKinematics"),)
#: Axes of Pinocchio's types of joints, which turn (R) or slide (P); others carry their axis.
PLAIN_AXES = {
    f"JointModel{kind}{letter}": axis
    for kind in "RP"
    for letter, axis in (("X", (1.0, 0.0, 0.0)), ("Y", (0.0, 1.0, 0.0)), ("Z", (0.0, 0.0, 1.0)))
}
#: Stacks of up to so many postures go through Pinocchio one by one: `SerialChain` takes as long for two as for forty.
FEW = 32
#: Joints that a pose needs.
POSE_JOINTS = 6
#: A determinant of the Jacobian that is nearer to 0 has no sign [m^3].
NO_SIGN = 1e-8
#: Methods of arms of which all postures are known, as a list or as curves.
LISTS, CURVES = ("all_solutions", "batch", "nearest", "nearest_batch"), ("self_motions", "clearest", "manipulable")


class _WorkSpace(threading.local):
    """Pinocchio's work space, one for each thread; a copy or a pickled one starts anew."""

    def __init__(self, model: Any) -> None:
        self.model, self.data = model, model.createData()

    def __reduce__(self) -> tuple[type[_WorkSpace], tuple[Any]]:
        return _WorkSpace, (self.model,)


class ArmKinematics:
    """Kinematics of one arm between a base frame and a tip frame. Threads may share an instance.

    Args:
        arm: Name of a registered arm, or a description.
        tip: Short name of the tip frame, one of `arm.tips`; default is the arm's own tool centre point.
        base: The frame in which all poses and goals are expressed: `"base_link"`, the arm's own; `"base"`, that of a
            UR's controller and pendant (base_link turned by pi about z, REP 199); `"world"`; or a frame of your own by
            its pose in base_link, as a 4x4 transform or `[x, y, z, rx, ry, rz]`.
        tool: A tool on the flange, as in `ArmDescription.with_tool`; its centre point is the tip.

    Attributes:
        arm: The description, with the tool.
        tip: As given, `"tool"` with a tool.
        base: As given, `"own"` for a frame of your own.
        model: Pinocchio model with the gripper locked; its joint order is that of `q`.
        lower, upper: Joint limits [rad, m], shape (n,); -inf and inf of a joint that turns without end.
        velocity_limit: Joint speed limits of the URDF [rad/s, m/s], shape (n,).
        slides: Which joints slide, and have metres in `q`, shape (n,); the others turn.
        T_world_base: Pose of the base frame in the world (4, 4).
        no_closed_form: Why `of` found no class that lists every posture; empty where it did, or was not asked.

    Raises:
        UnknownNameError: The arm, the tip or the base does not exist.
        InputError: The description does not fit its URDF.
        InstallationError: Pinocchio cannot be loaded.
    """

    #: Classes with a closed form by number of joints, as module and name, in the order in which `of` tries them.
    _closed_forms: ClassVar[Mapping[int, Sequence[tuple[str, str]]]] = {
        3: (("_arm3", "Arm3Kinematics"),),
        4: (("_five_axis", "FiveAxisKinematics"),),
        5: (("_five_axis", "FiveAxisKinematics"),),
        6: (
            ("_ur.kinematics", "URKinematics"),
            ("_ur.kinematics", "CalibratedURKinematics"),
            ("_six_axis.kinematics", "SixAxisKinematics"),
        ),
        7: (("_seven_axis.kinematics", "SevenAxisKinematics"),),
    }
    #: Whether `solve` considers every posture of a goal.
    knows_all_postures: ClassVar[bool] = False
    no_closed_form: str = ""

    def __init__(
        self,
        arm: str | ArmDescription,
        *,
        tip: str | None = None,
        base: str | ArrayLike = "base_link",
        tool: Tool | str | ArrayLike | None = None,
    ) -> None:
        self.arm = get_arm(arm)
        if tool is not None:
            if tip not in (None, FLANGE):
                raise InputError(f"give a tip or a tool, not both; got the tip {tip!r}")
            self.arm, tip = self.arm.with_tool(tool), TOOL
        self.tip = tip if tip is not None else self.arm.default_tip
        check_known("tip", self.tip, self.arm.tips)
        self.model = build_model(self.arm)
        self._work = _WorkSpace(self.model)
        self.n: int = self.model.nq
        self.slides: NDArray[np.bool_] = np.array([_slides(self.model, name) for name in self.arm.joints])
        self.lower: Floats = self.model.lowerPositionLimit.copy()
        self.upper: Floats = self.model.upperPositionLimit.copy()
        self.velocity_limit: Floats = self.model.velocityLimit.copy()
        self.tip_frame: int = link_frame(self.model, self.arm.tips[self.tip])
        self.T_world_arm: Floats = self.model.frames[link_frame(self.model, self.arm.base)].placement.homogeneous
        self.base: str
        self.T_world_base: Floats
        self.base, self.T_world_base = self._base_frame(base)
        self.T_base_world: Floats = np.asarray(np.linalg.inv(self.T_world_base), dtype=np.float64)
        self._prepare()

    def _prepare(self) -> None:
        """Prepare what this kind of kinematics needs, and refuse an arm of another kind."""

    def _base_frame(self, base: str | ArrayLike) -> tuple[str, Floats]:
        """Return the base frame's name and pose in the world."""
        if not isinstance(base, str):
            return "own", self.T_world_arm @ as_frame("base", base)
        frames = {"base_link": self.T_world_arm, "world": np.eye(4)}
        if self.model.existFrame("base", pin.BODY):
            frames["base"] = self.model.frames[link_frame(self.model, "base")].placement.homogeneous
        elif self.arm.joints == JOINTS:
            frames["base"] = self.T_world_arm @ FLIP
        check_known("base", base, frames)
        return base, frames[base]

    @property
    def data(self) -> Any:
        """Pinocchio's work space of the calling thread."""
        return self._work.data

    @classmethod
    def of(
        cls,
        arm: str | ArmDescription,
        *,
        tip: str | None = None,
        base: str | ArrayLike = "base_link",
        tool: Tool | str | ArrayLike | None = None,
    ) -> Self:
        """Return the kinematics of an arm, of the class that lists every posture of a pose, if there is one.

        Args:
            arm: Name of a registered arm, or a description.
            tip: As in the class.
            base: As in the class.
            tool: As in the class.

        Raises:
            UnknownNameError: The arm, the tip or the base does not exist.
            InputError: A tool or a base that is not a rigid motion, or a tip beside a tool.

        Note:
            The tip of `ArmKinematics.of("ur5-thesis")` is `"tcp"`; that of `URKinematics("ur5-thesis")` is `"tool0"`.

        Examples:
            >>> from kinreach.kinematics import ArmKinematics
            >>> kin = ArmKinematics.of("panda")
            >>> kin.n, len(kin.self_motions(kin.fk(kin.arm.home))) > 0
            (7, True)
        """
        plain = cls(arm, tip=tip, base=base, tool=tool)
        kinds = cls._closed_forms.get(plain.n, ())
        if not plain.turns_alone:
            of_six = (("_sliding", "SlidingKinematics"),)
            kinds = (of_six if plain.n <= POSE_JOINTS else kinds) if plain.slides.any() else PALLETIZERS
        for module, name in kinds:
            kind: Any = getattr(importlib.import_module(f"kinreach.kinematics.{module}"), name)
            try:
                return kind(plain.arm, tip=plain.tip, base=base)
            except InputError as error:  # another geometry; the last class takes the most
                plain.no_closed_form = str(error)
        spare = plain.n - POSE_JOINTS
        return plain._redundant(base) if spare > 1 or (spare > 0 and not plain.turns_alone) else plain

    def _redundant(self, base: str | ArrayLike) -> Self:
        """The same kinematics with numeric choices from the postures of a pose."""
        kind: Any = importlib.import_module("kinreach.kinematics._redundant").RedundantKinematics
        found = kind(self.arm, tip=self.tip, base=base)
        found.no_closed_form = self.no_closed_form
        return found

    @classmethod
    def from_file(
        cls,
        file: str | Path,
        *,
        tip: str | None = None,
        joints: Sequence[str] | None = None,
        base: str | ArrayLike = "base_link",
        tool: Tool | str | ArrayLike | None = None,
        **facts: Any,
    ) -> Self:
        """Return the kinematics of the arm in a URDF or MJCF file, of the class that `of` chooses.

        `from_urdf` is another name of this.

        Args:
            file: Path of the file.
            tip: Link that is the tip; default is the one farthest from the root, counted in joints, and not a sensor's.
            joints: Names of the joints of `q`; default are those that move between root and tip.
            base: As in the class; `"base_link"` is the root.
            tool: As in the class; on the link `tool0`, and on the tip of arms without one.
            facts: Further arguments of `ArmDescription.from_file`, such as `home=`, `held=` and `title=`.

        Raises:
            InputError: The file does not describe an arm of this kind.
        """
        arm = ArmDescription.from_file(file, tip=tip, joints=joints, **facts)
        return cls.of(arm, base=base, tool=tool)

    from_urdf = from_file

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name not in LISTS + CURVES or "n" not in self.__dict__:
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
            what = f"arm {self.arm.name!r} with {self.n} joints has no {name}"
            if not self.knows_all_postures:
                because = f"; {self.no_closed_form}" if self.no_closed_form else ""
                raise AttributeError(
                    f"{what}: LevenbergMarquardtSolver(kin) or PlacoSolver(kin) finds one posture{because}"
                )
            other = "self_motions has its curves" if name in LISTS else "all_solutions lists its postures"
            raise AttributeError(f"{what}: {other}, nearest chooses one")

    def __repr__(self) -> str:
        return f"{type(self).__name__}(arm={self.arm.name!r}, tip={self.tip!r}, base={self.base!r})"

    def as_posture(self, name: str, q: ArrayLike) -> Floats:
        """Check a posture: shape (n,), each angle within ±1e6 rad; anything else is an `InputError`."""
        return as_vector(name, q, self.n, most=MAX_ANGLE)

    def fk(self, q: ArrayLike) -> Floats:
        r"""Compute the pose of the tip in the base frame.

        .. math::

            T(q) = \left(\prod_{i=1}^{n} A_i \, e^{[a_i] q_i}\right) A_{n+1}

        with the placement A of each joint in the frame of the one before, its twist [a], a turn about its axis or a
        slide along it, and the tip on the last joint (Siciliano et al., Robotics, section 2.8).

        Args:
            q: Posture [rad], shape (n,), or a stack of them, shape (..., n). Up to 32 postures go through Pinocchio,
                more go through `SerialChain`, built from the same model (equal to 1e-10). So does a tensor of torch, on
                its device and in its precision, and so do gradients; its values are not checked.

        Returns:
            Homogeneous transforms, shape (4, 4) or (..., 4, 4); a tensor for a tensor.

        Raises:
            InputError: Wrong shape, or a value that is not finite or larger than 1e6 rad.

        Examples:
            >>> from kinreach.kinematics import URKinematics
            >>> URKinematics("ur5e", base="base").fk([0, 0, 0, 0, 0, 0])[:3, 3].round(4).tolist()
            [-0.8172, -0.2329, 0.0628]
        """
        if is_tensor(q):
            check_tensor("q", q, (self.n,))
            return self.chain.fk(q)
        q = as_floats("q", q)
        if q.ndim == 1:
            return self._pose(self.as_posture("q", q))
        rows = self._rows_of(q)
        if len(rows) == 1:
            poses = self._pose(rows[0])[None]
        else:
            poses = np.array([self._pose(row) for row in rows]) if 0 < len(rows) <= FEW else self.chain.fk(rows)
        return poses if q.ndim == 2 else poses.reshape(*q.shape[:-1], 4, 4)

    def _pose(self, q: Floats) -> Floats:
        data = self._work.data
        pin.forwardKinematics(self.model, data, q)
        T_world_tip: Floats = pin.updateFramePlacement(self.model, data, self.tip_frame).homogeneous
        return T_world_tip if self.base == "world" else self.T_base_world @ T_world_tip

    def positions(self, q: ArrayLike) -> Floats:
        """Compute tip positions [m], shape (..., 3), for postures `q` [rad], shape (..., n).

        Many postures take three quarters of the time of `fk`.

        A tensor for a tensor, as in `fk`.

        Raises:
            InputError: Wrong shape, or a value that is not finite or larger than 1e6 rad.
        """
        if is_tensor(q):
            check_tensor("q", q, (self.n,))
            return self.chain.fk(q)[..., :3, 3]
        q = as_floats("q", q)
        rows = self._rows_of(q)
        few = 0 < len(rows) <= FEW
        points: Floats = np.array([self._pose(row)[:3, 3] for row in rows]) if few else self.chain.positions(rows)
        return points.reshape(*q.shape[:-1], 3)

    def jacobian(self, q: ArrayLike) -> Floats:
        r"""Compute the geometric Jacobian of the tip, (6, n): rows 0-2 linear [m/rad], rows 3-5 angular [rad/rad].

        .. math::

            \begin{pmatrix} \dot p \\ \omega \end{pmatrix} = J \, \dot q, \qquad
            J_i = \begin{pmatrix} z_i \times (p - p_i) \\ z_i \end{pmatrix}
            \text{ or } \begin{pmatrix} z_i \\ 0 \end{pmatrix}

        where joint i turns or slides, with the tip at p, and the axis through p_i along z_i, all along the axes of the
        base frame (Siciliano et al., Robotics, equation 3.30). Joints that follow joint i are in its column, too.

        Args:
            q: Posture [rad], shape (n,), or a stack of them, shape (..., n), or a tensor of torch; all as in `fk`.

        Returns:
            Shape (6, n) or (..., 6, n); a tensor for a tensor.

        Raises:
            InputError: Wrong shape, or a value that is not finite or larger than 1e6 rad.

        Examples:
            >>> from kinreach.kinematics import URKinematics
            >>> kin = URKinematics("ur5e")
            >>> bool(abs(kin.jacobian(kin.arm.home)[3:]).max() <= 1)  # the axes are unit vectors
            True
        """
        if is_tensor(q):
            check_tensor("q", q, (self.n,))
            return self.chain.jacobian(q)
        q = as_floats("q", q)
        if q.ndim == 1:
            return self._jacobian(self.as_posture("q", q))
        rows = self._rows_of(q)
        few = 0 < len(rows) <= FEW
        jacobians: Floats = np.array([self._jacobian(row) for row in rows]) if few else self.chain.jacobian(rows)
        return jacobians if q.ndim == 2 else jacobians.reshape(*q.shape[:-1], 6, self.n)

    def _jacobian(self, q: Floats) -> Floats:
        J = pin.computeFrameJacobian(self.model, self.data, q, self.tip_frame, pin.LOCAL_WORLD_ALIGNED)
        J = J.reshape(6, -1)  # of one joint Pinocchio returns a vector
        R = self.T_base_world[:3, :3]
        return np.vstack([R @ J[:3], R @ J[3:]])

    @property
    def sampling_limits(self) -> tuple[Floats, Floats]:
        """Limits between which random postures are drawn [rad], shape (n,): -pi and pi of a joint without end."""
        return sampling_limits(self.model)

    def within_limits(self, q: ArrayLike, *, tolerance: float = SLACK) -> bool:
        """Return whether every joint is within its limits, `lower - tolerance <= q <= upper + tolerance` [rad]."""
        return not self.past_limits(self.as_posture("q", q), tolerance).any()

    def joints_outside_limits(self, q: ArrayLike, *, tolerance: float = SLACK) -> tuple[str, ...]:
        """Return the names of the joints that are outside their limits."""
        outside = self.past_limits(self.as_posture("q", q), tolerance)
        return tuple(name for name, out in zip(self.arm.joints, outside, strict=True) if out)

    def past_limits(self, q: Floats, tolerance: float = SLACK) -> NDArray[np.bool_]:
        """Return `past_limits` of the arm, of postures [rad] of any shape (..., n), which are not checked."""
        return past_limits(q, self.lower, self.upper, tolerance)

    def _rows_of(self, q: Floats) -> Floats:
        """Check a stack of postures, shape (..., n), and return them one a row, shape (m, n)."""
        if q.ndim == 0 or q.shape[-1] != self.n:
            raise InputError(f"q must have shape (..., {self.n}), got {q.shape}")
        check_entries("q", q, MAX_ANGLE)
        return q if q.ndim == 2 else q.reshape(-1, self.n)

    def _check_turns_alone(self) -> None:
        """Refuse an arm for a class whose joints turn, each alone."""
        if not self.turns_alone:
            does = "slides" if self.slides.any() else "follows another"
            raise InputError(
                f"arm {self.arm.name!r} has a joint that {does}; {type(self).__name__} takes joints that turn"
            )

    @property
    def turns_alone(self) -> bool:
        """Whether every joint between base and tip turns, and follows no other."""
        return not self.slides.any() and self.model.njoints == self.n + 1

    @cached_property
    def chain(self) -> SerialChain:
        """The arm from the base frame to the tip, for many postures at once."""
        placements, axes = self._joint_frames()
        placements[0] = self.T_base_world @ placements[0]
        tip = self.model.frames[self.tip_frame].placement.homogeneous
        return SerialChain(placements, axes, tip, None if self.turns_alone else self.moves)

    @cached_property
    def moves(self) -> list[Moves]:
        """How each joint between base and tip moves, from the base on; those that follow others, too."""
        entry = {name: index for index, name in enumerate(self.arm.joints)}
        follows = following_joints(self.arm.robot)
        found = []
        for name in list(self.model.names)[1:]:
            how = follows[name] if name not in entry else Follows(name, 1.0, 0.0)
            found.append(Moves(entry[how.joint], how.factor, how.offset, _slides(self._each_alone, name)))
        return found

    @cached_property
    def _each_alone(self) -> Any:
        """Pinocchio's model in which no joint follows another."""
        return self.model if self.model.njoints == self.n + 1 else build_model(self.arm, following=False)

    def _joint_frames(self) -> tuple[list[Floats], list[Floats]]:
        """Pose of each joint's frame in that of the joint before (the world for the first), and its axis in its own."""
        model = self._each_alone
        joints = range(1, model.njoints)
        kinds = [(model.joints[i], model.joints[i].shortname()) for i in joints]
        axes = [np.array(PLAIN_AXES[kind] if kind in PLAIN_AXES else joint.extract().axis) for joint, kind in kinds]
        return [model.jointPlacements[i].homogeneous for i in joints], axes


def link_frame(model: Any, link: str) -> int:
    """Return the index of a link's frame in a Pinocchio model; a joint may have the same name."""
    return int(model.getFrameId(link, pin.BODY))


def determinant_sign(jacobians: Floats) -> Floats:
    """Return the signs of determinants, which change where a posture passes a singularity; 0 at one.

    Args:
        jacobians: Shape (..., 6, 6).
    """
    determinants = np.linalg.det(jacobians)
    return np.where(np.abs(determinants) > NO_SIGN, np.sign(determinants), 0.0)


def sampling_limits(model: Any) -> tuple[Floats, Floats]:
    """Return the joint limits of a Pinocchio model [rad], shape (n,), with one turn of a joint without end."""
    lower, upper = model.lowerPositionLimit, model.upperPositionLimit
    return np.where(np.isinf(lower), -np.pi, lower), np.where(np.isinf(upper), np.pi, upper)


def _slides(model: Any, joint: str) -> bool:
    return model.joints[model.getJointId(joint)].shortname().startswith(("JointModelP", "JointModelPrismatic"))


def build_model(arm: ArmDescription, *, following: bool = True) -> Any:
    """Build the Pinocchio model of an arm, with the joints that are not part of `q` held in place.

    Joints that follow others have no entry of `q`; without `following`, each has one. The model is the caller's own.
    """
    return pin.Model(_built(arm, following=following))


@lru_cache(maxsize=16)
def _built(arm: ArmDescription, *, following: bool) -> Any:
    robot = one_number_each(arm.robot)
    follow = [name for name in following_joints(robot) if name not in arm.locked_joints]
    if follow:
        robot = deepcopy(robot)
        for name in arm.locked_joints:
            set_follows(robot, name, None)
    urdf = arm.urdf if robot is arm.robot else ET.tostring(robot, encoding="unicode")
    try:
        full = pin.buildModelFromXML(urdf, mimic=True) if follow and following else pin.buildModelFromXML(urdf)
    except (RuntimeError, ValueError) as error:
        raise InputError(f"Pinocchio cannot read the URDF of arm {arm.name!r}: {error}") from None
    reference = pin.neutral(full)
    locked = []
    for name, position in arm.locked_joints.items():
        if not full.existJointName(name):
            raise InputError(f"arm {arm.name!r}: the URDF has no joint {name!r}")
        joint = full.getJointId(name)
        reference[full.joints[joint].idx_q] = position
        locked.append(joint)
    model = pin.buildReducedModel(full, locked, reference) if locked else full
    names = tuple(name for name in list(model.names)[1:] if name not in follow)
    if names != arm.joints:
        raise InputError(
            f"arm {arm.name!r}: URDF joints {names}, described {arm.joints}; "
            "ArmDescription.from_urdf holds joints that are not part of the arm"
        )
    for name in arm.joints:
        joint = model.joints[model.getJointId(name)]
        kind = joint.shortname()
        if joint.nq != 1 or not ("Revolute" in kind or "Prismatic" in kind or kind in PLAIN_AXES):
            raise InputError(
                f"arm {arm.name!r}: joint {name!r} ({kind}) neither turns about an axis nor slides along one"
            )
    if following:
        endless = np.isin(arm.joints, endless_joints(arm.robot))
        model.lowerPositionLimit = np.where(endless, -np.inf, model.lowerPositionLimit)
        model.upperPositionLimit = np.where(endless, np.inf, model.upperPositionLimit)
    for frame in (arm.base, *arm.tips.values()):
        if not model.existFrame(frame, pin.BODY):
            raise InputError(f"arm {arm.name!r}: the URDF has no link {frame!r}")
    return model
