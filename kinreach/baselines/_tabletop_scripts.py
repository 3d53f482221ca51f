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
from kinreach.envs.inside import lift_task

#: Greatest way [m] and turn [rad] of the tip in a step.
STRIDE, TURN = 0.02, math.radians(4.0)
#: Behind the object the fingers wait so far from its middle, and above it so high [m].
BEHIND, ABOVE = 0.07, 0.08
#: A step of a push [m]; the fingers push while they are no farther from the line to the goal, and no higher [m].
PUSH_STEP, IN_LINE, DOWN = 0.006, 0.03, 0.02
#: Height above the grasp from which the fingers go down to the object, and in which it is carried, above the table [m].
APPROACH, CARRIED = 0.10, 0.06
#: How far from the object's middle is above it [m], how nearly turned as it is [rad], and what a radian counts [m].
BESIDE, TURNED, LEVER = 0.003, 0.03, 0.1
#: The fingers go down in a funnel that ends so far from there [m]; so near they close [m].
FUNNEL, CLOSE = 0.012, 0.006
#: Least height above the table at which fingers grasp [m].
LOWEST = 0.012
#: Fingers that are no wider apart than this beyond the object's width hold it, if it is no farther from the tip [m].
HELD, NEAR = 0.001, 0.02


class _Seen(NamedTuple):
    """What k observations of a `TabletopTask` say whose goal is a place, and what follows from the joints.

    Attributes:
        q: Joint angles [rad], shape (k, n).
        opening: Between the fingers [m], shape (k,).
        tip, object, goal: Places [m], shape (k, 3).
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
        self._upright: Floats = made.kinematics.fk(made.home)[:3, :3]
        self._size, self._top = float(made.task.size), float(made.region.z[0])
        self._fingers: bool = made.task.fingers

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
        return _Seen(q, opening[:, 0], tip, place, goal, yaw, T, heading)

    def _moved(self, seen: _Seen, ways: Floats, turned: Floats, fingers: ArrayLike = 0.0) -> Floats:
        """Return actions that move the tips by ways [m], (k, 3), turn them about the vertical [rad], (k,), and fingers.

        The tool is straight down, whatever it was.
        """
        yaws = seen.heading + np.clip(turned, -TURN, TURN)
        T = turns_about_z(yaws - math.atan2(self._upright[1, 0], self._upright[0, 0]))
        T[:, :3, :3] = T[:, :3, :3] @ self._upright
        T[:, :3, 3] = seen.T[:, :3, 3] + ways * np.minimum(1.0, STRIDE / np.maximum(_lengths(ways), 1e-9))
        found = self._kinematics.nearest_batch(T, seen.q)
        changes = self._steps.action_for(seen.q, np.where(found.success[:, None], found.q, seen.q))
        if not self._fingers:
            return np.asarray(changes)
        return np.column_stack([changes, np.broadcast_to(fingers, len(changes))])


class PushScript(TabletopScript):
    """Pushes an object to a place: over the table behind it, as seen from the goal, down, and ahead."""

    def _actions(self, seen: _Seen) -> Floats:
        way = _level(seen.goal - seen.object)
        ahead = way / np.maximum(_lengths(way), 1e-9)
        off = seen.tip - seen.object
        along, above = (off * ahead).sum(axis=1, keepdims=True), off[:, 2:]
        aside = _level(off - along * ahead)
        pushes = (above < DOWN) & (along < 0.0) & (_lengths(aside) < IN_LINE)
        push = PUSH_STEP * ahead - 0.3 * aside - np.pad(above, ((0, 0), (2, 0)))
        behind = seen.object - BEHIND * ahead - seen.tip
        wrong = np.maximum(_lengths(_level(behind))[:, 0] - BESIDE, 0.0)
        step = np.where(pushes, push, _down(behind[:, :2], above[:, 0], wrong, ABOVE))
        facing = np.arctan2(ahead[:, 1], ahead[:, 0])
        backwards = (ahead * seen.T[:, :3, 0]).sum(axis=1) < 0.0  # either wide side of the closed fingers pushes
        return self._moved(seen, step, wrapped(facing + math.pi * backwards - seen.heading))


class PickAndPlaceScript(TabletopScript):
    """Grasps an object from above and carries it to its goal; one that is lost is grasped again."""

    def _actions(self, seen: _Seen) -> Floats:
        off = seen.object - seen.tip
        held = (seen.opening < 2.0 * self._size + HELD) & (_lengths(_level(off))[:, 0] < NEAR)
        held &= np.abs(off[:, 2]) < self._size
        ways, turned, fingers = self._grasp(seen, off)
        ways = np.where(held[:, None], self._carry(seen), ways)
        return self._moved(seen, ways, np.where(held, 0.0, turned), np.where(held, -1.0, fingers))

    def _grasp(self, seen: _Seen, off: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the tip's ways and turns to the object, down in a funnel, and what the fingers do."""
        turned = lift_task.face_angle(seen.yaw - seen.heading)
        low = self._top + max(self._size, LOWEST)
        wrong = np.maximum(_lengths(_level(off))[:, 0] - BESIDE, 0.0)
        wrong += LEVER * np.maximum(np.abs(turned) - TURNED, 0.0)
        height = seen.tip[:, 2] - low
        closes = (height < CLOSE) & (wrong < CLOSE)
        return _down(off[:, :2], height, wrong, APPROACH), turned, np.where(closes, -1.0, 1.0)

    def _carry(self, seen: _Seen) -> Floats:
        """Return the ways of an object that is held: up, over there, and to its goal."""
        way = seen.goal - seen.object
        over = np.maximum(seen.goal[:, 2], self._top + self._size + CARRIED)
        there = np.clip(_lengths(_level(way))[:, 0] / STRIDE - 0.5, 0.0, 1.0)
        rise = seen.goal[:, 2] + there * (over - seen.goal[:, 2]) - seen.object[:, 2]
        level = np.clip((1.0 - rise / (0.5 * CARRIED)) * 1.3, 0.0, 1.0)
        return np.column_stack([way[:, :2] * level[:, None], rise])
