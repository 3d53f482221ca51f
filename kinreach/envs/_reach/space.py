"""Reaching in space: goals in a volume, the tool in any direction near the vertical, starts all around the start pose.

The task of `kinreach/Reach-v0`. The rest is as in the thesis's tasks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats, check_known, check_number
from kinreach._tensors import namespace
from kinreach.envs._batch import ROWS_AHEAD, RowStreams
from kinreach.envs._options import about, options_from
from kinreach.envs._reach.reach_task import (
    JOINTS,
    MULTI_STEP,
    SINGLE_STEP,
    ReachOptions,
    ReachReset,
    ReachTask,
    ReachVariant,
    distance_between,
)
from kinreach.envs._reach.rewards import DirectedReward, Score, score_of_goals
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics
from kinreach.robots import BoxRegion, get_arm
from kinreach.thesis import REACHED_DISTANCE

if TYPE_CHECKING:
    from kinreach.kinematics import FiveAxisKinematics

#: What an option `steps` means.
VARIANTS: Mapping[str, ReachVariant] = {"single": SINGLE_STEP, "multi": MULTI_STEP}
#: Bounds of the options: height of the volume [m], tilt of the tool [degrees], spread of the starts [rad].
MAX_HEIGHT, MAX_TILT, MAX_SPREAD = 2.0, 90.0, math.pi
#: Goals drawn before it is given up that an arm with fewer than six joints reaches one.
MAX_DRAWS = 1000
#: What may be left of a direction that is met [rad], and by how much the cosine of a tilt may be less.
MET, ROUNDING = 1e-9, 1e-9
#: How far apart the postures are in which a move is checked for collisions, in its longest joint [rad].
WAY_STEP = 0.1


@dataclass(frozen=True, kw_only=True)
class SpaceOptions(ReachOptions):
    """Options of `kinreach/Reach-v0`."""

    steps: str = field(
        default="single",
        metadata=about('`"single"` (an action is a posture) or `"multi"` (changes of up to 5 degrees)'),
    )
    goal_height: float = field(
        default=0.25, metadata=about("how far the volume of the goals reaches above where the ball lies [m]")
    )
    tilt: float = field(
        default=0.0, metadata=about("largest angle between the tool's direction and straight down [degrees]")
    )
    start_spread: float = field(
        default=0.0, metadata=about("largest difference of a joint's angle from the start pose when it starts [rad]")
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_known("steps", self.steps, VARIANTS)
        check_number("goal_height [m]", self.goal_height, least=0.0, most=MAX_HEIGHT)
        check_number("tilt [degrees]", self.tilt, least=0.0, most=MAX_TILT)
        check_number("start_spread [rad]", self.start_spread, least=0.0, most=MAX_SPREAD)
        arm = get_arm(self.arm)
        if len(arm.joints) < JOINTS and not hasattr(ArmKinematics.of(arm), "axis_solutions"):
            raise InputError(
                f"a tool with a direction takes six joints, or four or five that turn; the {len(arm.joints)} of arm "
                f"{arm.name!r} are none of these"
            )
        if not isinstance(arm.workcell.goals, BoxRegion):
            raise InputError(f"goals in a volume need a BoxRegion in the work cell, arm {arm.name!r} has none")


class SpaceTask(ReachTask):
    """Goals are uniform in the volume, directions on the cap of the sphere around straight down.

    An arm with four or five joints cannot choose both: its goals are those with a posture that brings the tip there,
    and the direction is the one nearest to the drawn one that the tool can have there.

    Arms start with joints around the start pose, in postures that are possible.
    """

    options: SpaceOptions
    directed = True

    def __init__(self, options: SpaceOptions) -> None:
        super().__init__(options, VARIANTS[options.steps])

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> SpaceTask:
        """Return the task with the options that an environment was made with."""
        return cls(options_from(SpaceOptions, options))

    def default_reward(self) -> DirectedReward:
        return DirectedReward(REACHED_DISTANCE)

    def sample(self, rng: np.random.Generator, count: int, *, beyond: float = 0.0) -> Floats:
        """Draw goals [m], directions and postures [rad], shape (count, 6 + n); goals up to `beyond` [m] outside."""
        aims = self._aims(rng, count, beyond)
        if self._few_joints is not None:
            aims = np.array([self._nearest_aim(self._few_joints, aim, rng, beyond) for aim in aims]).reshape(-1, 6)
        return np.column_stack([aims, self._postures(rng, count)])

    def _aims(self, rng: np.random.Generator, count: int, beyond: float) -> Floats:
        """Draw goals [m] and directions, shape (count, 6)."""
        region: Any = self.arm.workcell.goals
        goals = region.wider(beyond, above=self.options.goal_height).sample
        z = rng.uniform(math.cos(math.radians(self.options.tilt)), 1.0, count)
        angle, across = rng.uniform(0.0, 2 * math.pi, count), np.sqrt(1.0 - z * z)
        directions = np.column_stack([across * np.cos(angle), across * np.sin(angle), -z])
        return np.column_stack([goals(rng, count), directions])

    @cached_property
    def _few_joints(self) -> FiveAxisKinematics | None:
        """The kinematics of an arm that cannot have any direction at any point."""
        if len(self.arm.joints) >= JOINTS:
            return None
        kinematics: Any = ArmKinematics.of(self.arm, base="world")
        return kinematics

    def _nearest_aim(self, kin: FiveAxisKinematics, aim: Floats, rng: np.random.Generator, beyond: float) -> Floats:
        """Return a goal and a direction, shape (6,), or others that are drawn, turned to what the arm reaches."""
        least = math.cos(math.radians(self.options.tilt)) - ROUNDING
        for _ in range(MAX_DRAWS):
            found = kin.axis_solutions(aim[:3], aim[3:], seed=self.home)
            for q, left in zip(found.q, found.left, strict=True):
                if left > found.left[0] + MET:
                    break
                axis = aim[3:] if left < MET else kin.fk(q)[:3, 2]
                if -axis[2] >= least and self.checker.free(q):
                    return np.append(aim[:3], axis)
            aim = self._aims(rng, 1, beyond)[0]
        raise InputError(
            f"arm {self.arm.name!r} reaches none of {MAX_DRAWS} goals in its region with the tool within "
            f"{self.options.tilt:g} degrees of straight down; give it a larger tilt, or a Workcell with other goals"
        )

    def _postures(self, rng: np.random.Generator, count: int) -> Floats:
        q, spread = np.tile(self.home, (count, 1)), self.options.start_spread
        wanted = np.full(count, spread > 0.0)
        for _ in range(20):
            if not wanted.any():
                break
            q[wanted] = self.home + rng.uniform(-spread, spread, (int(wanted.sum()), len(self.home)))
            wanted[wanted] = self.checker.impossible(q[wanted])
        q[wanted] = self.home
        return q

    def training_starts(self, rng: np.random.Generator, count: int, *, beyond: float) -> dict[str, Floats]:
        rows = self.sample(rng, count, beyond=beyond)
        return {"goal": rows[:, :3], "direction": rows[:, 3:6], "q": rows[:, 6:]}

    def streams(self, count: int) -> RowStreams:
        at_once = ROWS_AHEAD if self._few_joints is None else 1
        return RowStreams(self.sample, count, size=6 + len(self.arm.joints), at_once=at_once)

    def completed(self, start: ReachReset, streams: RowStreams, ids: NDArray[np.intp]) -> tuple[Floats, ReachReset]:
        """Return goals and a start in which only the view may be missing; rows are drawn in any case."""
        drawn = streams.draw(ids)
        goals, directions, q = drawn[:, :3], drawn[:, 3:6], drawn[:, 6:]
        return (
            goals if start.goals is None else start.goals.copy(),
            start._replace(
                directions=directions if start.directions is None else start.directions,
                q=q if start.q is None else start.q,
            ),
        )

    def way_free(self, q: Floats, target: Floats) -> bool:
        """Return whether nothing collides on the move from a posture `q` to a target [rad], both of shape (n,)."""
        return not any(
            self.checker.in_collision(posture)
            for start, end in pairwise([q, *self.waypoints_to(q, target)])
            for posture in np.linspace(start, end, 1 + math.ceil(np.abs(end - start).max() / WAY_STEP))[1:-1]
        )

    def score(self, distance: Floats, q: Floats, impossible: NDArray[np.bool_], directions: Floats) -> Score:
        error = self.posture_error(q, directions)
        return self.scorer.score(distance, q, impossible, error)._replace(posture_error=error)

    def score_of_goals(
        self, achieved: Floats, desired: Floats, impossible: NDArray[np.bool_], q: Callable[[], Floats]
    ) -> Score:
        distance = distance_between(achieved, desired)
        error = angle_between(achieved[:, 3:6], desired[:, 3:6])
        errors = np.maximum(achieved - desired, 0.0)[:, -2:].T
        return score_of_goals(self.scorer, distance, impossible, error, errors=errors, q=q)._replace(
            posture_error=error
        )

    def axes(self, q: Floats) -> Floats:
        axes: Floats = self.kinematics.fk(q)[:, :3, 2]
        return axes

    def posture_error(self, q: Floats, directions: Floats) -> Floats:
        """Angle between the tool's z axis and its wanted direction [rad], shape (k,)."""
        return angle_between(self.axes(q), directions)


def angle_between(axes: Floats, directions: Floats) -> Floats:
    """Return the angles between axes and directions, unit vectors of shape (k, 3) [rad], shape (k,)."""
    xp = namespace(axes)
    sine = xp.linalg.norm(xp.linalg.cross(axes, directions), axis=1)
    error: Floats = xp.arctan2(sine, (axes * directions).sum(axis=1))
    return error
