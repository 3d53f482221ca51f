"""Objects brought to a place by pushing or grasping: scripts with the arm's own inverse kinematics."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from enum import Enum, auto
from typing import Any, cast

import gymnasium as gym
import numpy as np

from kinreach._checks import Floats
from kinreach._registration import PICK_AND_PLACE, PUSH
from kinreach._rotations import turn, wrap
from kinreach._statistics import MEAN, QUANTILES, RATE, Column, Trial, thousandfold
from kinreach.baselines import RandomPolicy
from kinreach.compare._button import decision_ms
from kinreach.compare._task import CHANCE, CONTROLLER, Method, Task, episode_seed, of_reached
from kinreach.envs.inside import lift_task
from kinreach.sim.inside import Scene

#: Greatest way [m] and turn [rad] of the tip in a step.
STRIDE, TURN = 0.02, math.radians(4.0)
#: Behind the object the fingers wait so far from its middle, and above it so high [m].
BEHIND, ABOVE = 0.07, 0.08
#: A step of a push [m]; the fingers push while they are no farther from the line to the goal, and no higher [m].
PUSH_STEP, IN_LINE, DOWN = 0.006, 0.03, 0.02
#: Height from which the fingers go down to the object, and in which it is carried, above the table [m].
APPROACH, CARRIED = 0.10, 0.06
#: How near is there [m], and how nearly turned as the object [rad].
THERE, TURNED = 0.004, 0.05
#: The fingers have stopped when they close by less in a step [m].
STOPPED = 5e-4
#: An object that is farther from the tip is lost [m].
LOST = 0.05
UP = np.array([0.0, 0.0, 1.0])


class _Seen:
    """An observation of a `TabletopTask` whose goal is a place: joints, opening, tip, object, its yaw, goal.

    And what follows from the joints: the tip's pose, and the yaw of its x-axis.
    """

    def __init__(self, observation: Floats, kinematics: Any) -> None:
        joints: int = kinematics.n
        numbers = np.asarray(observation, dtype=np.float64)
        self.q, self.opening = numbers[:joints], float(numbers[joints])
        self.tip, self.object, turned, self.goal = np.split(numbers[joints + 1 :], [3, 6, 12])
        self.yaw = math.atan2(turned[2], turned[0])
        self.T: Floats = kinematics.fk(self.q)
        self.heading = math.atan2(self.T[1, 0], self.T[0, 0])


class _TipScript:
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

    def _action(self, seen: _Seen, way: Floats, yaw: float, fingers: float = 0.0) -> Floats:
        """Return the action that moves the tip by a way [m] and turns the tool towards a yaw of its x-axis [rad]."""
        T, aim = seen.T.copy(), seen.heading + float(np.clip(wrap(yaw - seen.heading), -TURN, TURN))
        T[:3, :3] = turn(UP, aim - math.atan2(self._upright[1, 0], self._upright[0, 0])) @ self._upright
        T[:3, 3] += way * min(1.0, STRIDE / max(float(np.linalg.norm(way)), 1e-9))
        found = self._kinematics.nearest(T, seen.q)
        changes = self._steps.action_for(seen.q, found.q if found.success else seen.q)
        return np.append(changes, fingers) if self._fingers else changes


class PushScript(_TipScript):
    """Pushes an object to a place: over the table behind it, as seen from the goal, down, and ahead."""

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        """Do nothing: an action depends on the observation only."""

    def act(self, observation: Any) -> Floats:
        """Return the next action."""
        seen = _Seen(observation, self._kinematics)
        way = (seen.goal - seen.object) * [1.0, 1.0, 0.0]
        ahead = way / max(float(np.linalg.norm(way)), 1e-9)
        off = seen.tip - seen.object
        along, above = float(off @ ahead), float(off[2])
        aside = (off - along * ahead) * [1.0, 1.0, 0.0]
        if above < DOWN and along < 0.0 and np.linalg.norm(aside) < IN_LINE:
            step = PUSH_STEP * ahead - 0.3 * aside - [0.0, 0.0, above]
        else:
            step = seen.object - BEHIND * ahead - seen.tip
            if np.linalg.norm(step[:2]) > 0.01:  # not there yet: stay above
                step = np.append(step[:2] * (above > 0.75 * ABOVE), ABOVE - above)
        facing = math.atan2(ahead[1], ahead[0])
        if ahead @ seen.T[:3, 0] < 0.0:  # either wide side of the closed fingers pushes
            facing += math.pi
        return self._action(seen, step, facing)


class _Phase(Enum):
    """What comes next in a grasp."""

    ABOVE, DOWN, CLOSE, CARRY = auto(), auto(), auto(), auto()


class PickAndPlaceScript(_TipScript):
    """Grasps an object from above and carries it to its goal; one that is lost is grasped again."""

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        """Begin with a grasp."""
        self._phase, self._before = _Phase.ABOVE, math.inf

    def act(self, observation: Any) -> Floats:
        """Return the next action."""
        seen = _Seen(observation, self._kinematics)
        off = seen.object - seen.tip
        now = seen.heading
        yaw = now + float(lift_task.face_angle(np.array(seen.yaw - now)))
        low = max(self._top + self._size, self._top + 0.012)
        beside = float(np.linalg.norm(off[:2]))
        if self._phase is _Phase.ABOVE and beside < THERE and abs(wrap(yaw - now)) < TURNED:
            self._phase = _Phase.DOWN
        if self._phase is _Phase.DOWN:
            if beside > 2.0 * THERE:
                self._phase = _Phase.ABOVE
            elif seen.tip[2] - low < THERE:
                self._phase, self._before = _Phase.CLOSE, math.inf
        if self._phase is _Phase.CLOSE:
            if self._before - seen.opening < STOPPED:
                self._phase = _Phase.CARRY
            self._before = seen.opening
        if self._phase is _Phase.CARRY and np.linalg.norm(off) > LOST:
            self._phase = _Phase.ABOVE
        match self._phase:
            case _Phase.ABOVE:
                up = self._top + self._size + APPROACH - seen.tip[2]
                level = seen.tip[2] > self._top + self._size + 0.5 * APPROACH
                return self._action(seen, np.append(off[:2] * level, up), yaw, 1.0)
            case _Phase.DOWN:
                return self._action(seen, np.append(off[:2], low - seen.tip[2]), yaw, 0.0)
            case _Phase.CLOSE:
                return self._action(seen, np.zeros(3), now, -1.0)
        way = seen.goal - seen.object
        if np.linalg.norm(way[:2]) > STRIDE:  # over there first, above the table
            way[2] = max(seen.goal[2], self._top + self._size + CARRIED) - seen.object[2]
            way[:2] *= way[2] < 0.5 * CARRIED
        return self._action(seen, way, now, -1.0)


def scene_with_object(env: gym.Env[Any, Any], trial: Trial, start: Mapping[str, Any]) -> Scene:
    """Return arm, fingers and object after the last step, after a reset with the options `start`."""
    spec: Any = env.spec
    drawn: Any = gym.make(spec, render_mode="rgb_array").unwrapped
    drawn.reset(seed=env.unwrapped.np_random_seed, options=start)
    world, only = drawn.episodes.world, np.zeros(1, dtype=np.intp)
    world.reset(only, np.array([trial["q"]]))
    world.put_fingers(only, np.array([trial["opening"]]))
    world.put_at(only, np.array([trial["position"]]), np.reshape(trial["rotation"], (1, 3, 3)))
    scene: Scene = drawn.scene
    return scene


def _scene(env: gym.Env[Any, Any], trial: Trial) -> Scene:
    """Return the scene with the ball that marks the goal."""
    scene: Any = scene_with_object(env, trial, {})
    scene.place_ball(trial["goal"])
    return cast("Scene", scene)


def _columns() -> tuple[Column, ...]:
    return (
        Column("reached", "reached", RATE, "at the goal %\n[95 % CI]", "interval"),
        Column("steps", of_reached("steps"), QUANTILES, "steps\nmedian / p95", "quantiles"),
        Column("distance_mm", thousandfold("distance"), QUANTILES, "distance mm\nmedian / p95", "quantiles"),
        Column("impossible", "impossible", RATE, "colli-\nsions %", "share"),
        Column("reward_mean", "reward", MEAN, "reward\nmean", "mean"),
        Column("solve_ms", decision_ms, QUANTILES, "a decision\nms", "quantiles"),
    )


def _resets(count: int, seed: int, env: gym.Env[Any, Any]) -> Sequence[Mapping[str, Any]]:
    return [{"seed": episode_seed(seed, index)} for index in range(count)]


def _task(name: str, environment: str, title: str, script: type[_TipScript], goal: str) -> Task:
    return Task(
        name=name,
        title=title,
        environment=environment,
        variants=(environment,),
        resets=_resets,
        methods={
            "script": Method(script, CONTROLLER),
            "random": Method(lambda env: RandomPolicy(env.action_space), CHANCE),
        },
        columns=_columns(),
        scene=_scene,
        reached="the object's middle is within 20 mm of the goal before the episode ends",
        terms={
            "goal": goal,
            "distance": "the object's middle to the goal after the last step, in the simulation",
            "steps": "of 40 ms, of episodes that ended at the goal; at most 200",
            "script": "closed-form inverse kinematics for the tip's way, from what is observed",
        },
    )


TASKS = (
    _task(
        "push",
        PUSH,
        "A UR5 pushes a cube to a place on the table",
        PushScript,
        "a cube of 50 mm and 50 g on the table, turned anyhow, and a place 6 to 20 cm from it",
    ),
    _task(
        "pick-and-place",
        PICK_AND_PLACE,
        "A UR5 brings a cube to a place",
        PickAndPlaceScript,
        "a cube of 50 mm and 50 g on the table, turned anyhow, and a place that is on the table, too, or up to 20 cm "
        "higher; each half of the goals",
    ),
)
