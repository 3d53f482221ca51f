"""Objects brought to a place by pushing or grasping: scripts with the arm's own inverse kinematics.

They have no memory: what they do follows from an observation, or from rows of observations. So they can answer in
every state that a learner comes to.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import Floats
from kinreach._rotations import turns_about_z, wrapped
from kinreach.envs.inside import STEP_S, lift_task
from kinreach.robots import BoxRegion, Gripper
from kinreach.robots.inside import JawGripper

#: Greatest way [m] and turn [rad] of the tip in a step; over a region with a longer diagonal than this [m] the way is
#: longer in proportion, because episodes are not.
STRIDE, TURN, DIAGONAL = 0.02, math.radians(4.0), 0.70
#: Servos that come to rest within a step are sent the whole way. Others would overshoot, for no speed is observed:
#: they are sent this share of a way that may be longer by as much, so that only the last of it is slower.
SLOW_SHARE = 0.45
#: At home a tool points straight down if its z axis is lower than this. Where it does not, it goes to a posture above
#: the table first whenever that axis is higher than the second.
STRAIGHT, TILTED = 0.999, 0.7
#: Behind the object the fingers wait so far from its middle, and above it so high [m].
BEHIND, ABOVE = 0.07, 0.08
#: A step of a push [m]; the fingers push while they are no farther from the line to the goal, and no higher [m].
PUSH_STEP, IN_LINE, DOWN = 0.006, 0.03, 0.02
#: Height above the grasp from which the fingers go down to the object, and in which it is carried, above the table [m].
APPROACH, CARRIED = 0.10, 0.06
#: The first is no less than this for arms that are small [m], and from there tools point down nearly so (a cosine).
LEAST_APPROACH, POINTS_DOWN = 0.03, 0.95
#: How far from the object's middle is above it [m], how nearly turned as it is [rad], and what a radian counts [m].
BESIDE, TURNED, LEVER = 0.003, 0.03, 0.1
#: The fingers go down in a funnel that ends so far from there [m]; so near they close [m].
FUNNEL, CLOSE = 0.012, 0.006
#: Least height above the table at which fingers grasp [m].
LOWEST = 0.012
#: Least distance from the object to a finger that is nearer to the tip than its size [m].
ROOM = 0.01
#: Fingers that are no wider apart than this beyond the object's width hold it, if it is no farther from the tip [m].
HELD, NEAR = 0.001, 0.02


class _Seen(NamedTuple):
    """What k observations of a `TabletopTask` say whose goal is a place, and what follows from the joints.

    Attributes:
        q: Joint angles [rad], shape (k, n).
        opening: Between the fingers [m], shape (k,).
        tip, object, goal: Places [m], shape (k, 3); that of the tip is where the fingers hold or push.
        yaw: Of the object [rad], shape (k,).
        T: The tip's poses, shape (k, 4, 4).
        heading: Yaws of the tip's x-axis [rad], shape (k,).
    """

    q: Floats
    opening: Floats
    tip: Floats
    object: Floats
    goal: Floats
    yaw: Floats
    T: Floats
    heading: Floats


def _level(way: Floats) -> Floats:
    """Return the horizontal parts of ways, shape (k, 3)."""
    return way * [1.0, 1.0, 0.0]


def _lengths(ways: Floats) -> Floats:
    """Return lengths, shape (k, 1)."""
    return np.asarray(np.linalg.norm(ways, axis=1, keepdims=True))


def _down(level: Floats, height: Floats, wrong: Floats, highest: float) -> Floats:
    """Return ways, shape (k, 3), over there and down in a funnel; low and beside it, first up.

    Args:
        level: Ways to the place that is above the end [m], shape (k, 2).
        height: Above the end [m], shape (k,).
        wrong: How far from above it [m], shape (k,).
        highest: Height of the funnel [m].
    """
    wanted = highest * np.clip(wrong / FUNNEL, 0.0, 1.0)
    free = np.where(wanted < 0.3 * highest, 1.0, np.clip((height + BESIDE) / (wanted + BESIDE), 0.0, 1.0))
    return np.column_stack([level * free[:, None], wanted - height])


class TabletopScript:
    """Moves the tip in small steps by the arm's closed form, with the tool straight down.

    Args:
        env: Of a `TabletopTask` whose goal is a place.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        made: Any = env.unwrapped
        self._kinematics, self._steps = made.kinematics, made.episodes.small_steps
        self._size, self._top = float(made.task.size), float(made.region.z[0])
        self._low = self._top + max(self._size, LOWEST)
        self._upright: Floats = made.kinematics.fk(made.home)[:3, :3]
        self._ready: Floats | None = None
        self._approach = APPROACH
        if self._upright[2, 2] > -STRAIGHT:
            yaw = math.atan2(self._upright[1, 0], self._upright[0, 0])
            self._upright = turns_about_z(np.array([yaw]))[0, :3, :3] @ np.diag([1.0, -1.0, -1.0])
            self._ready, self._approach = self._above(made.region, made.home)
        self._share = 1.0 if made.episodes.world.settling(made.home) < STEP_S else SLOW_SHARE
        across = math.hypot(*(high - low for low, high in (made.region.x, made.region.y)))
        self._stride = STRIDE * max(1.0, across / DIAGONAL) / self._share
        self._gripper: Gripper | JawGripper = made.episodes.world.gripper
        self._aside = 0.0  # from the place that is led, with the object or behind it, to the tip, along its y axis [m]
        self._fingers: bool = made.task.fingers

    def _above(self, region: BoxRegion, home: Floats) -> tuple[Floats, float]:
        """Return the posture above the middle of the region, and how high above a grasp it is [m].

        That is `APPROACH`, or less where the tool could not point down above the whole region.
        """
        x, y = (np.linspace(*side, 3) for side in (region.x, region.y))
        T = np.tile(np.eye(4), (9, 1, 1))
        T[:, :3, :3] = self._upright
        T[:, :2, 3] = np.array(np.meshgrid(x, y)).reshape(2, -1).T
        for approach in np.linspace(APPROACH, LEAST_APPROACH, 8):
            T[:, 2, 3] = self._low + approach
            found = self._kinematics.nearest_batch(T, home)
            if found.success.all() and (self._kinematics.chain.fk(found.q)[:, 2, 2] < -POINTS_DOWN).all():
                break
        return (found.q[4] if found.success[4] else home), float(approach)

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        """Do nothing: an action depends on the observation only."""

    def act(self, observation: ArrayLike) -> Floats:
        """Return the next action for an observation, shape (m,), or for rows of them, shape (k, m)."""
        numbers = np.asarray(observation, dtype=np.float64)
        actions = self._actions(self._seen(np.atleast_2d(numbers)))
        return actions.reshape(*numbers.shape[:-1], -1)

    def _actions(self, seen: _Seen) -> Floats:
        """Return the actions for k observations, shape (k, ...)."""
        raise NotImplementedError

    def _seen(self, rows: Floats) -> _Seen:
        joints: int = self._kinematics.n
        q, opening, tip, place, turned, goal = np.split(rows, joints + np.array([0, 1, 4, 7, 13]), axis=1)
        T = self._kinematics.chain.fk(np.ascontiguousarray(q))
        yaw, heading = np.arctan2(turned[:, 2], turned[:, 0]), np.arctan2(T[:, 1, 0], T[:, 0, 0])
        return _Seen(q, opening[:, 0], tip - self._aside * T[:, :3, 1], place, goal, yaw, T, heading)

    def _moved(
        self, seen: _Seen, ways: Floats, turned: Floats, fingers: ArrayLike = 0.0, held: ArrayLike = False
    ) -> Floats:
        """Return actions that move the tips by ways [m], (k, 3), turn them about the vertical [rad], (k,), and fingers.

        The tool is straight down, or as nearly so as the arm goes; what is held is not turned back first.
        """
        share = self._share
        yaws = seen.heading + np.clip(turned, -TURN / share, TURN / share)
        T = turns_about_z(yaws - math.atan2(self._upright[1, 0], self._upright[0, 0]))
        T[:, :3, :3] = T[:, :3, :3] @ self._upright
        T[:, :3, 3] = seen.T[:, :3, 3] + ways * np.minimum(1.0, self._stride / np.maximum(_lengths(ways), 1e-9))
        T[:, :3, 3] += self._aside * (T[:, :3, 1] - seen.T[:, :3, 1])
        found = self._kinematics.nearest_batch(T, seen.q)
        target = np.where(found.success[:, None], found.q, seen.q)
        if self._ready is not None:
            tilted = (seen.T[:, 2, 2] > -TILTED) & ~np.asarray(held)
            target = np.where(tilted[:, None], self._ready, target)
        if share < 1.0:
            target = seen.q + share * (target - seen.q)
        changes = self._steps.action_for(seen.q, target)
        if not self._fingers:
            return np.asarray(changes)
        return np.column_stack([changes, np.broadcast_to(fingers, len(changes))])


class PushScript(TabletopScript):
    """Pushes an object to a place: over the table behind it, as seen from the goal, down, and ahead."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self._aside = -self._gripper.meeting

    def _actions(self, seen: _Seen) -> Floats:
        way = _level(seen.goal - seen.object)
        ahead = way / np.maximum(_lengths(way), 1e-9)
        off = seen.tip - seen.object
        along, above = (off * ahead).sum(axis=1, keepdims=True), off[:, 2:]
        aside = _level(off - along * ahead)
        pushes = (above < DOWN) & (along < 0.0) & (_lengths(aside) < IN_LINE)
        push = PUSH_STEP / self._share * ahead - 0.3 * aside - np.pad(above, ((0, 0), (2, 0)))
        behind = seen.object - BEHIND * ahead - seen.tip
        wrong = np.maximum(_lengths(_level(behind))[:, 0] - BESIDE, 0.0)
        step = np.where(pushes, push, _down(behind[:, :2], above[:, 0], wrong, ABOVE))
        facing = np.arctan2(ahead[:, 1], ahead[:, 0])
        backwards = (ahead * seen.T[:, :3, 0]).sum(axis=1) < 0.0  # either wide side of the closed fingers pushes
        return self._moved(seen, step, wrapped(facing + math.pi * backwards - seen.heading))


class PickAndPlaceScript(TabletopScript):
    """Grasps an object from above and carries it to its goal; one that is lost is grasped again."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        before, behind = self._gripper.sides
        self._around: float = self._gripper.opening_around(self._size)
        self._aside = max(0.0, self._size + ROOM - before) - max(0.0, self._size + ROOM - behind)

    def _actions(self, seen: _Seen) -> Floats:
        off = seen.object - seen.tip
        held = (seen.opening < self._around + HELD) & (_lengths(_level(off))[:, 0] < NEAR)
        held &= np.abs(off[:, 2]) < self._size
        ways, turned, fingers = self._grasp(seen, off)
        ways = np.where(held[:, None], self._carry(seen), ways)
        return self._moved(seen, ways, np.where(held, 0.0, turned), np.where(held, -1.0, fingers), held)

    def _grasp(self, seen: _Seen, off: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the tip's ways and turns to the object, down in a funnel, and what the fingers do."""
        turned = lift_task.face_angle(seen.yaw - seen.heading)
        wrong = np.maximum(_lengths(_level(off))[:, 0] - BESIDE, 0.0)
        wrong += LEVER * np.maximum(np.abs(turned) - TURNED, 0.0)
        height = seen.tip[:, 2] - self._low
        closes = (height < CLOSE) & (wrong < CLOSE)
        return _down(off[:, :2], height, wrong, self._approach), turned, np.where(closes, -1.0, 1.0)

    def _carry(self, seen: _Seen) -> Floats:
        """Return the ways of an object that is held: up, over there, and to its goal."""
        way = seen.goal - seen.object
        over = np.maximum(seen.goal[:, 2], self._top + self._size + CARRIED)
        there = np.clip(_lengths(_level(way))[:, 0] / STRIDE - 0.5, 0.0, 1.0)
        rise = seen.goal[:, 2] + there * (over - seen.goal[:, 2]) - seen.object[:, 2]
        level = np.clip((1.0 - rise / (0.5 * CARRIED)) * 1.3, 0.0, 1.0)
        return np.column_stack([way[:, :2] * level[:, None], rise])
