"""Rewards of learners in training; evaluation uses the environment's own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np

from kinreach._checks import check_known
from kinreach._objects import load_object
from kinreach.baselines.expert import GRIPPER, table_top, tool_down_postures
from kinreach.envs.inside import lift_task, moving
from kinreach.kinematics import Arm3Kinematics, URKinematics
from kinreach.robots import THESIS_ARM

Array = np.ndarray[Any, Any]

#: From the environment's rewards and the step's `info`, as arrays (n,), to the learner's rewards (n,). In trainings
#: step by step, `info["observation"]` is that after the step, also at the end of an episode.
TrainingReward = Callable[[Array, Mapping[str, Any]], Array]

#: Least reward: the thesis's -100 and -25 hide all other differences at first.
FLOOR = -30.0
#: Distance below which the dense reward has nothing left to gain [m], and its weight of the posture error.
DENSE_DISTANCE, DENSE_POSTURE, DENSE_IMPOSSIBLE = 1e-5, 5.0, -200.0


def own(rewards: Array, info: Mapping[str, Any]) -> Array:
    return rewards


def floored(rewards: Array, info: Mapping[str, Any]) -> Array:
    return np.maximum(rewards, FLOOR)


def dense(rewards: Array, info: Mapping[str, Any]) -> Array:
    """Return -ln(d + 1e-5) - 5 r_e, less 200 for impossible actions.

    Within 1 cm of the goal the thesis's reward is flat, this one steep. It ranks impossible actions by their distance.
    """
    near = -np.log(info["distance"] + DENSE_DISTANCE) - DENSE_POSTURE * info["posture_error"]
    return near + np.where(info["impossible"], DENSE_IMPOSSIBLE, 0.0)


def grasp(rewards: Array, info: Mapping[str, Any]) -> Array:
    """Return the dense reward, plus 5 if the fingers close around the object."""
    return dense(rewards, info) + 5.0 * info["held"]


def grasp_guided(rewards: Array, info: Mapping[str, Any]) -> Array:
    """Return the reward of lifting in small steps, guided by postures of the closed form.

    They are above the grasp while the arm is away from the object, then at the grasp, where the fingers are to close,
    and further up while the object is held. `info` has the step's `observation`, shape (n, 18), `held` and `clearance`.
    """
    seen = info["observation"]
    place, turn, size, q, opening = seen[:, :3], seen[:, 3], seen[:, 4], seen[:, 8:14], seen[:, 14]
    low = tool_down_postures(_ur5(), place, turn)
    high = tool_down_postures(_ur5(), np.add(place, (0.0, 0.0, ABOVE)), turn)
    up = np.outer(np.clip(RAISED - info["clearance"], 0.0, RAISED), (0.0, 0.0, 1.0))
    raised = tool_down_postures(_ur5(), place + up, turn)
    to_low, to_high, to_raised = (
        np.nan_to_num(np.linalg.norm(q - end, axis=1), nan=FAR) for end in (low, high, raised)
    )
    over = np.linalg.norm(seen[:, 15:17], axis=1) < OVER
    to_close = CLOSING_WEIGHT * np.where(to_low < CLOSE, np.abs(opening - 2.0 * size), OPEN)
    ahead = np.where(over, to_low + to_close, to_high + FAR)
    held = info["held"] & (
        np.linalg.norm(seen[:, 15:18], axis=1) < lift_task.NEAR
    )  # not one that lies below the finger tips
    to_lift = to_raised - HELD - RAISED_WEIGHT * np.clip(info["clearance"] / lift_task.HEIGHT, 0.0, 1.0)
    return rewards + GUIDE_WEIGHT * (WHOLE_WAY - np.where(held, to_lift, ahead))


#: Factor that makes returns of the order of 1; a press pays 100.
SCALE = 0.05
#: Weight of the distance to the goal posture [1/rad].
POSTURE_WEIGHT = 0.3
#: Branches of the closed form by preference. With its back to the target the arm reaches 97 % of them, facing it with
#: the elbow up another 2 %; one branch is easier to learn than both.
BRANCH_ORDER = (3, 0, 1, 2)
#: Penalty of a wrong press while no episode reaches the goal, and when all do. A large one from the start teaches never
#: to press; a small one at the end, with a discount of 5 % a step, to press too early.
FIRST_PENALTY, LAST_PENALTY = 0.05, 10.0


#: Of lifting in small steps: how far above the object the arm comes first [m]; how near to the vertical line through it
#: is over it [m], and how near to the grasp the fingers close [rad]; their opening before [m]; how high a held object
#: is to come [m].
ABOVE, OVER, CLOSE, OPEN, RAISED = 0.06, 0.03, 0.1, 0.10, 0.12
#: Weights of what is left to close [1/m], of how high the object is, and of all of it; what is left where the arm is
#: not over the object, and what it is worth that the object is held.
CLOSING_WEIGHT, RAISED_WEIGHT, GUIDE_WEIGHT, FAR, HELD = 20.0, 6.0, 0.05, 2.5, 1.0
#: More than is ever left: rewards must be positive, or colliding at once would be best.
WHOLE_WAY = 6.0


@cache
def _ur5() -> URKinematics:
    return URKinematics(THESIS_ARM, tip="tcp", base="world")


@cache
def _kinematics() -> Arm3Kinematics:
    return Arm3Kinematics(base="world")


def goal_postures(goals: Array) -> Array:
    """Return the posture of the closed form that training leads to for targets in the world [m], shape (n, 3).

    It is in joint angles [rad], shape (n, 3); NaN where no posture within the joint limits reaches the target.
    """
    found = _kinematics().batch(goals)
    order = np.array(BRANCH_ORDER)
    rows = np.arange(len(goals))
    return found.q[rows, order[found.valid[:, order].argmax(axis=1)]]


def scaled(rewards: Array, info: Mapping[str, Any]) -> Array:
    return SCALE * rewards


def guided(rewards: Array, info: Mapping[str, Any]) -> Array:
    """Return the environment's reward, less 0.3 times the distance in joint space to a posture that reaches the target.

    The penalty of a wrong press grows with the square of the share of episodes that reach the goal. `info` has the
    step's `observation`, shape (n, 19), and `reached_lately`.
    """
    observation = info["observation"]
    q = np.arctan2(observation[:, 3:6], observation[:, :3])
    error = np.linalg.norm(q - goal_postures(observation[:, 6:9]), axis=1)
    penalty = FIRST_PENALTY + (LAST_PENALTY - FIRST_PENALTY) * info["reached_lately"] ** 2
    wrong = info["reward_terms"]["wrong_press"]  # -1 or 0
    return SCALE * (rewards - wrong + penalty * wrong - POSTURE_WEIGHT * error)


#: Of touching a rolling ball: what a touch or a collision counts, and how far above the table the gripper's corners are
#: to stay [m].
TOUCHED, ABOVE_TABLE = 3.0, 0.006
#: Weight of how deep they are [1/m]: to begin with, and more where balls are touched. From the first share of episodes
#: on it grows, at the second it is whole.
DEPTH_WEIGHT, MORE_DEPTH, GROWS_FROM, GROWN_AT = 1.0, 20.0, 0.5, 0.9
#: Least weight of a collision, as a share, and of the tool's tilt.
LEAST_COLLISION, LEAST_TILT = 0.3, 0.3


def level(rewards: Array, info: Mapping[str, Any]) -> Array:
    """Return the reward of touching a rolling ball, less costs of the gripper's depth in the table and of its tilt.

    Once more than half of the balls are touched, depth costs more, and a touch within the table counts less; earlier,
    the arm would stay away from fast balls. Tilt along the fingers costs a third of tilt across them. `info` has the
    step's `observation`, shape (n, 16) or more, `reward_terms` and `reached_lately`.
    """
    terms, lately = info["reward_terms"], info["reached_lately"]
    T = _ur5().fk(info["observation"][:, moving.ANGLES])
    height = T[:, 2, 3] + (T[:, 2, :3] @ GRIPPER.T).min(axis=1) - table_top(_ur5().arm)
    strict = float(np.clip((lately - GROWS_FROM) / (GROWN_AT - GROWS_FROM), 0.0, 1.0)) ** 2
    depth = (DEPTH_WEIGHT + MORE_DEPTH * strict) * np.maximum(ABOVE_TABLE - height, 0.0)
    tilt = max(LEAST_TILT, 1.0 - 1.3 * lately) * (T[:, 2, 1] ** 2 + 0.3 * T[:, 2, 0] ** 2)
    touched = np.where(height > 0.0, 1.0, 1.0 - strict) * terms["touch"]
    counted = TOUCHED * (touched + max(LEAST_COLLISION, strict) * terms["collision"])
    return np.asarray(terms["distance"] + counted - depth - tilt)


#: Training rewards by the name that recipes use.
REWARDS: dict[str, TrainingReward] = {
    "own": own,
    "floored": floored,
    "dense": dense,
    "grasp": grasp,
    "grasp-guided": grasp_guided,
    "scaled": scaled,
    "guided": guided,
    "level": level,
}


def training_reward(name: str) -> TrainingReward:
    """Return a training reward by name, or one of your own as `module:function`."""
    if ":" in name:
        return load_object("training reward", name)
    check_known("training reward", name, REWARDS)
    return REWARDS[name]
