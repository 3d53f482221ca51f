"""Moves of an arm in joint space, by dynamics, and the verdict on each: reached, or why not.

A move has *attained* its target when every joint is within the tolerance of it, the arm stands still, and it is not
pressed at anything there. A target that is not attained is what the thesis calls impossible; `MoveResult.reason` has
the cause. Touching something on the way does not make a target impossible, being held off by it does. For motion
free of contact, ask a collision checker before the move.

How the servos are led to a target is in `kinreach.sim._setpoints`; what is moved, one simulation or many, in
`kinreach.sim._plants`.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats, check_number
from kinreach.errors import InputError
from kinreach.kinematics.inside import past_limits
from kinreach.robots import ArmDescription
from kinreach.robots.inside import between_phases
from kinreach.sim._engine import mujoco
from kinreach.sim._movable_boxes import box_names
from kinreach.sim._plants import ArmJoints, Ids, Plant, as_index, rows_and_columns
from kinreach.sim._setpoints import ARRIVED, DIVERGED, LATE, MOVING, Following, SetpointPlanner

#: The thesis's tolerance: "the smallest value where the environment still gets the joint angles close" [rad].
TOLERANCE = 0.01
#: Bodies that are deeper than this inside each other at the end are pressed together [m]. Where a target lies inside an
#: obstacle, servos and contact both yield: this depth is that of a target 0.03 mm inside, about the tip's accuracy.
PRESSED = 1e-5
#: A simulation in which a joint ends further than this past its limit [rad] has diverged. Limits are springs in MuJoCo:
#: links that start inside one another pushed joints of the UR5 up to 0.29 rad past theirs.
BEYOND_LIMIT = 0.5


class MoveStatus(Enum):
    """How a move ended. Everything but REACHED is an impossible target."""

    REACHED = "reached"
    #: The target is outside the joint limits; the arm was not moved.
    OUT_OF_LIMITS = "out of limits"
    #: An obstacle holds the arm off the target or is pressed at it, or the arm has stopped for no visible reason
    #: (torque limit).
    BLOCKED = "blocked"
    #: One part of the arm holds another off the target, or presses it there.
    COLLISION = "self-collision"
    #: The arm is still moving long after it should have arrived.
    TIMEOUT = "timeout"
    #: The simulation became unstable, or pushed a joint far past its limit; the arm was put back to where it stood
    #: before, at rest.
    DIVERGED = "diverged"


@dataclass(frozen=True, eq=False)
class MoveResult:
    """Result of a move.

    Attributes:
        status: How it ended.
        reason: One phrase for people when the target was not attained, else empty.
        duration: Simulated time [s].
        q: Posture in which the arm ended [rad], shape (n,).
        error: Largest distance of a joint from the target [rad].
        touches: Contacts in that posture, deepest first; where the target was reached, only slight ones and those with
            free objects.
    """

    status: MoveStatus
    reason: str
    duration: float
    q: Floats
    error: float
    touches: tuple[Touch, ...] = ()

    @property
    def reached(self) -> bool:
        """Whether every joint came to rest within the tolerance of its target, and nothing is pressed there."""
        return self.status is MoveStatus.REACHED


@dataclass(frozen=True)
class Touch:
    """Two bodies in contact.

    Attributes:
        link: A link of the arm.
        other: An obstacle of the work cell, a free object, or another link.
        with_itself: Whether `other` is a link.
        depth: How far the two are inside each other [m].
    """

    link: str
    other: str
    with_itself: bool
    depth: float

    def __str__(self) -> str:
        if self.with_itself:
            return f"self-collision: {self.link} - {self.other}"
        return f"{self.link} touches {self.other}"


def touches(model: Any, data: Any, obstacles: Collection[str]) -> tuple[Touch, ...]:
    """Return the links in contact in the last computed step, deepest first, each pair once."""
    deepest: dict[tuple[str, str], float] = {}
    for (first, second), depth in pairs_in_contact(model, data).items():
        a, b = model.body(first).name, model.body(second).name
        if a in obstacles and b in obstacles:  # an object that lies on the table
            continue
        pair = (b, a) if a in obstacles else (a, b)
        deepest[pair] = max(deepest.get(pair, 0.0), depth)
    found = [Touch(link, other, other not in obstacles, depth) for (link, other), depth in deepest.items()]
    return tuple(sorted(found, key=lambda touch: -touch.depth))


def pairs_in_contact(model: Any, data: Any) -> dict[tuple[int, int], float]:
    """Return the ids of bodies in contact in the last computed step, and how deep they are in each other [m]."""
    if data.ncon == 0:
        return {}  # making MuJoCo's list of contacts, even of none, takes longer than a step
    between: dict[tuple[int, int], float] = {}
    bodies = model.geom_bodyid[data.contact.geom].tolist()
    for (first, second), distance in zip(bodies, data.contact.dist.tolist(), strict=True):
        between[first, second] = max(between.get((first, second), 0.0), -distance)
    return between


class JointController:
    """Moves the arms in simulations of one scene.

    The setpoint runs on a synchronous trapezoid and leads by the servo's own lag and by the arm's inertia, so that the
    joints follow it without delay. Measured on 200 two-phase moves of the UR5 from home to a tool-down posture at a
    goal: all reached, residual error 3e-5 rad in the median and 6e-5 rad at most (0.03 and 0.07 mm at the tip), 1.28 to
    1.36 s of simulated time.

    The verdict depends almost only on the target. Of 1700 targets up to 0.2 rad (sigma) from a tool-down posture, all
    453 in collision were found impossible, and one of the others, whose path is blocked; of 600 random ones all 367 in
    collision, and 30 of the others.

    Attributes:
        tolerance: How far from its target a joint may come to rest [rad].
        lower, upper: Joint limits [rad], shape (n,).
        joints: Where the arm's joints are in MuJoCo's arrays, with those that follow them.
        qpos, ctrl: Where the arm's joints are in MuJoCo's `qpos` and `ctrl`.
        obstacles: Names of the bodies that are not links.
        objects: Those of them that are free objects. One that is held, or pushed, makes no target impossible.
        encoder_noise: Of each simulation [rad], shape (count,), where it is not the same in all.
    """

    def __init__(
        self,
        arm: ArmDescription,
        model: Any,
        *,
        tolerance: float = TOLERANCE,
        encoder_noise: float = 0.0,
        boxes: int = 0,
        planned_with: Any = None,
    ) -> None:
        self.arm = arm
        self.model = model
        self.tolerance = check_number("tolerance", tolerance, above=0.0, most=np.pi)
        self.joints = ArmJoints(arm, model)
        self.qpos = self.joints.qpos
        endless = (-np.inf, np.inf)
        joints = [model.joint(name) for name in arm.joints]
        ranges = [joint.range if model.jnt_limited[joint.id] else endless for joint in joints]
        self.lower, self.upper = np.array(ranges).T
        self.ctrl = as_index([model.actuator(name).id for name in arm.joints])
        free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        self.objects = frozenset(model.body(model.jnt_bodyid[joint]).name for joint in free)
        self.obstacles = frozenset(box.name for box in arm.workcell.obstacles) | self.objects | {*box_names(boxes)}
        self._following = Following(self.qpos, self.joints.dof, self.ctrl, tolerance, model.opt.timestep, encoder_noise)
        self._planner = SetpointPlanner(
            arm, planned_with or model, joints=self.joints, servos=self.ctrl, period=self._following.period
        )
        self.encoder_noise: Floats | None = None
        self._scratch = mujoco.MjData(model)

    def outside_limits(self, q: Floats) -> NDArray[np.bool_]:
        """Return which joints are outside their limits, for one posture or many, shape (..., n)."""
        return past_limits(q, self.lower, self.upper)

    def joints_outside_limits(self, q: Floats) -> tuple[str, ...]:
        return tuple(name for name, out in zip(self.arm.joints, self.outside_limits(q), strict=True) if out)

    def refuse_outside_limits(self, q: Floats) -> None:
        """Raise an `InputError` about the first joint that is outside its limits, if there is one."""
        for name in self.joints_outside_limits(q)[:1]:
            joint = self.arm.joints.index(name)
            low, high = self.lower[joint], self.upper[joint]
            raise InputError(f"{name} = {q[joint]:.6g} rad is outside its limits [{low:.6g}, {high:.6g}]")

    def move(self, plant: Plant, ids: Ids, targets: Floats, *, two_phase: bool = True) -> list[MoveResult]:
        """Move arms until they stand at their targets or it is clear that they do not arrive.

        Args:
            plant: The simulations; those that are moved are simulated forward.
            ids: Which of them, ascending, shape (k,).
            targets: Target postures [rad], shape (k, n).
            two_phase: As in the thesis, the joints in `arm.moves_last` (shoulder_lift of the UR5: the gripper comes
                from above) wait until all others have arrived. Otherwise all joints move at once, in a straight line
                in joint space. An arm without such joints moves in one phase in any case.

        Returns:
            How each ended, and where, in the order of `ids`. An arm whose simulation diverged is put back to where its
            move began.
        """
        began, before = plant.time[ids], plant.states(ids)
        ends = np.full(len(ids), MOVING, dtype=np.int8)
        inside = ~self.outside_limits(targets).any(axis=1)
        if inside.any():
            ends[inside] = self._follow(plant, ids[inside], targets[inside], two_phase=two_phase)
        q = plant.qpos[rows_and_columns(ids, self.qpos)]
        lost = plant.diverged(ids) | past_limits(q, self.lower, self.upper, BEYOND_LIMIT).any(axis=1)
        if lost.any():  # MuJoCo has started them afresh, and their motion since then is not the move's
            plant.put_back(ids[lost], before[lost])
            ends[lost] = DIVERGED
        durations = plant.time[ids] - began
        return [
            self._result(self._touches(plant, index), plant.qpos[index], target, int(end), float(duration))
            for index, target, end, duration in zip(ids, targets, ends, durations, strict=True)
        ]

    def settling(self, state: Floats, q: Floats) -> float:
        """Return the time constant with which the servos come to rest near a posture [rad], shape (n,) [s].

        Args:
            state: MuJoCo's `qpos`, for the joints that are not the arm's, shape (nq,).
            q: The posture.
        """
        return self._planner.settling(state, q)

    def _follow(self, plant: Plant, ids: Ids, targets: Floats, *, two_phase: bool) -> NDArray[np.int8]:
        state = plant.qpos[ids]
        points = [state[:, self.qpos], targets]
        if two_phase and self.arm.moves_last:
            points.insert(1, between_phases(self.arm, points[0], targets))
        noise = None if self.encoder_noise is None else self.encoder_noise[ids]
        return self._following.run(plant, ids, self._planner.plan(state, points), noise)

    def _result(self, found: tuple[Touch, ...], state: Floats, target: Floats, end: int, duration: float) -> MoveResult:
        q = state[self.qpos].copy()
        error = np.abs(q - target)
        against = next((touch for touch in found if touch.other not in self.objects), None)
        if end == DIVERGED:
            status, reason = MoveStatus.DIVERGED, "diverged: the simulation became unstable"
        elif end == MOVING:
            outside = ", ".join(self.joints_outside_limits(target))
            status, reason = MoveStatus.OUT_OF_LIMITS, f"out of limits: {outside}"
        elif end == ARRIVED and (against is None or against.depth <= PRESSED):
            status, reason = MoveStatus.REACHED, ""
        elif found:
            cause = against or found[0]
            status = MoveStatus.COLLISION if cause.with_itself else MoveStatus.BLOCKED
            reason = str(cause) if cause.with_itself else f"blocked: {cause}"
        else:
            status = MoveStatus.TIMEOUT if end == LATE else MoveStatus.BLOCKED
            reason = f"{status.value}: {self.arm.joints[int(error.argmax())]} does not arrive, nothing touches"
        return MoveResult(status, reason, duration, q, float(error.max()), found)

    def _touches(self, plant: Plant, index: int) -> tuple[Touch, ...]:
        model = plant.model_of(index)
        return touches(model, self.posed(model, plant.qpos[index]), self.obstacles)

    def posed(self, model: Any, state: Floats) -> Any:
        """Return a `mujoco.MjData` with the poses and contacts of a posture of everything; valid until the next."""
        self._scratch.qpos[:] = state
        mujoco.mj_kinematics(model, self._scratch)
        mujoco.mj_collision(model, self._scratch)
        return self._scratch
