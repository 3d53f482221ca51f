"""Rewards of the reach tasks: the thesis's reward, minus the distance, or a function of your own.

A reward of your own is any callable of stacks of k steps:

    def reward(distance, q, impossible):
        terms = {"distance": -distance, "effort": -0.01 * np.abs(q).sum(axis=1), "impossible": -1.0 * impossible}
        return sum(terms.values()), terms

    env = gym.make("kinreach/UR5SingleStep-v0", reward=reward)

    distance    from the tip to the goal [m], shape (k,)
    q           postures in which the arms stand [rad], shape (k, n)
    impossible  whether the action could not be executed, bool, shape (k,)

It returns the reward, shape (k,), and its terms by name, each of shape (k,), which add up to it. A single environment
calls it with k = 1 and a native batch with k = num_envs, so that it has to work on stacks. The first reset calls it
with the start, for the names of the terms. The arm's own reward still decides when a goal is reached, unless the
callable has a method `reached(distance, q, impossible)` that returns truth values, shape (k,).

In a batch with tensors (`device=`) the arm's own reward is computed on the device, and yours on the host, in numpy.

In `kinreach/Reach-v0` a function that takes a fourth argument gets the angle between the tool and its wanted direction
[rad], shape (k,). In `kinreach/ButtonPress-v0` the third is whether the action pressed, instead of `impossible`.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Mapping
from functools import partial
from sys import float_info
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats, as_flags, as_floats, check_entries, check_number, shown
from kinreach._tensors import like, namespace, on_host
from kinreach.envs._goals import DENSE, SPARSE
from kinreach.errors import InputError
from kinreach.robots import THESIS_ARM, ArmDescription, get_arm
from kinreach.thesis import REACHED_POSTURE_ERROR, distance_reward, posture_error, reach_reward
from kinreach.thesis.inside import (
    IMPOSSIBLE_REWARD,
    NEAR_REWARD,
    REACHED_REWARD,
    ReachReward,
    reward_of_errors,
)

Flags = NDArray[np.bool_]
Terms = Mapping[str, Floats]


class RewardFunction(Protocol):
    """A function for the option `reward`, as the module describes it."""

    def __call__(self, distance: Floats, q: Floats, impossible: Flags, *angle: Floats) -> tuple[Floats, Terms]:
        """Return the reward of k steps, shape (k,), and the terms that add up to it."""
        ...


class Score(NamedTuple):
    """The verdict on k steps; arrays of shape (k,).

    Attributes:
        reward: The sum of the terms.
        terms: The terms by name.
        posture_error: Error of the postures [rad]; 0 if the task accepts any posture.
        reached: Whether the goal is reached.
    """

    reward: Floats
    terms: Terms
    posture_error: Floats
    reached: Flags


class Scorer(Protocol):
    """A reward with everything that environments report of a step."""

    def score(self, distance: Floats, q: Floats, impossible: Flags, *angle: Floats) -> Score:
        """Judge k steps; shapes, and what `angle` is, as the module describes."""
        ...

    def posture_error(self, q: Floats) -> Floats:
        """`Score.posture_error` of postures [rad], shape (k, n)."""
        ...


class ThesisReward:
    """The reward of the thesis (section 3.4.4), see `kinreach.thesis`; for arms with the joints of a UR."""

    def __call__(self, distance: Floats, q: Floats, impossible: Flags) -> tuple[Floats, Terms]:
        score = self.score(distance, q, impossible)
        return score.reward, score.terms

    def score(self, distance: Floats, q: Floats, impossible: Flags, *angle: Floats) -> Score:
        """Reached: possible, nearer than 0.01 m, posture error below 0.15."""
        return self._scored(reach_reward(distance, q, impossible=impossible))

    def of_errors(self, distance: Floats, natural_arm: Floats, gripper_angle: Floats, impossible: Flags) -> Score:
        """Judge k steps by the two errors of the posture [rad], each of shape (k,)."""
        return self._scored(reward_of_errors(distance, natural_arm, gripper_angle, impossible))

    def _scored(self, result: ReachReward) -> Score:
        return Score(result.reward, result.terms._asdict(), result.posture_error, result.reached)

    def posture_error(self, q: Floats) -> Floats:
        return posture_error(q)


class DistanceReward:
    """Minus the distance to the goal, in any posture.

    Args:
        radius: Distance below which the goal is reached [m].
    """

    def __init__(self, radius: float) -> None:
        self.radius = check_number("radius [m]", radius, above=0.0)

    def __call__(self, distance: Floats, q: Floats, impossible: Flags) -> tuple[Floats, Terms]:
        return -distance, {"distance": -distance}

    def score(self, distance: Floats, q: Floats, impossible: Flags, *angle: Floats) -> Score:
        """Reached: possible, and nearer than the radius."""
        reward, terms = self(distance, q, impossible)
        return Score(reward, terms, self.posture_error(q), (distance < self.radius) & ~impossible)

    def posture_error(self, q: Floats) -> Floats:
        return nothing(q)


class DirectedReward:
    """The thesis's reward with the angle between the tool and its wanted direction instead of the posture error.

    Args:
        radius: Distance below which the tip is at the goal [m].
    """

    def __init__(self, radius: float) -> None:
        self.radius = check_number("radius [m]", radius, above=0.0)

    def __call__(self, distance: Floats, q: Floats, impossible: Flags, *angle: Floats) -> tuple[Floats, Terms]:
        score = self.score(distance, q, impossible, *angle)
        return score.reward, score.terms

    def score(self, distance: Floats, q: Floats, impossible: Flags, *angle: Floats) -> Score:
        """Reached: possible, nearer than the radius, angle below 0.15 rad."""
        (error,) = angle
        near = distance < self.radius
        reached = near & (error < REACHED_POSTURE_ERROR) & ~impossible
        xp, zeros = namespace(distance), nothing(distance)
        at_goal = xp.where(reached, REACHED_REWARD, xp.where(near, NEAR_REWARD, zeros))
        terms = {
            "direction": xp.where(reached | impossible, 0.0, -error),
            "distance": xp.where(near | impossible, 0.0, distance_reward(distance)),
            "special": xp.where(impossible, IMPOSSIBLE_REWARD, at_goal),
        }
        return Score(sum(terms.values(), zeros), terms, error, reached)

    def posture_error(self, q: Floats) -> Floats:
        """Zeros, shape (k,): without a direction nothing is asked of a posture."""
        return nothing(q)


class SparseReward:
    """0 where the goal is reached, else -1.

    Args:
        default: Says when it is reached.
    """

    def __init__(self, default: Scorer) -> None:
        self.default = default

    def score(self, distance: Floats, q: Floats, impossible: Flags, *angle: Floats) -> Score:
        return self.of(self.default.score(distance, q, impossible, *angle))

    def of(self, score: Score) -> Score:
        """Return the verdict of the default with this reward."""
        xp, zeros = namespace(score.reached), nothing(score.posture_error)
        reward = xp.where(score.reached, zeros, zeros - 1.0)
        return score._replace(reward=reward, terms={SPARSE: reward})

    def posture_error(self, q: Floats) -> Floats:
        return self.default.posture_error(q)


class OwnReward:
    """A user's reward function, checked at every call.

    Args:
        default: Gives the posture error and, if the function has no `reached`, whether the goal is reached.
    """

    def __init__(self, function: RewardFunction, default: Scorer) -> None:
        self.default = default
        self._directed = directed = isinstance(default, DirectedReward)
        self._function = _with_or_without_angle("reward", function, directed)
        reached = getattr(function, "reached", None)
        self._reached = None if reached is None else _with_or_without_angle("reached", reached, directed)

    def score(self, distance: Floats, q: Floats, impossible: Flags, *angle: Floats) -> Score:
        distance, q, impossible = on_host(distance), on_host(q), on_host(impossible)
        angle = tuple(map(on_host, angle))
        return self.of(self.default.score(distance, q, impossible, *angle), distance, q, impossible, *angle)

    def of(self, default: Score, distance: Floats, q: Floats, impossible: Flags, *angle: Floats) -> Score:
        """Return the verdict of the default with this reward."""
        if not self._directed:
            angle = ()
        answer: object = self._function(distance, q, impossible, *angle)
        if not (isinstance(answer, tuple) and len(answer) == 2 and isinstance(answer[1], Mapping)):
            raise InputError(f"reward must return the rewards and a mapping of their terms, got {shown(answer)}")
        terms = {str(name): _column(f"reward term {name!r}", term, len(distance)) for name, term in answer[1].items()}
        reward = _column("reward", answer[0], len(distance))
        if not np.allclose(sum(terms.values()), reward):
            raise InputError(f"the reward's terms {', '.join(terms)} do not add up to the reward")
        reached = default.reached
        if self._reached is not None:
            reached = as_flags("reached", self._reached(distance, q, impossible, *angle))
            if reached.shape != distance.shape:
                raise InputError(f"reached must have shape {distance.shape}, got {reached.shape}")
        return default._replace(reward=reward, terms=terms, reached=reached)

    def posture_error(self, q: Floats) -> Floats:
        return self.default.posture_error(q)


def default_reward(arm: ArmDescription) -> ThesisReward | DistanceReward:
    """Return the thesis's reward for a UR in a work cell with the thesis's cameras, for others minus the distance.

    What is a natural posture depends on how the arm is mounted; a UR from a file may stand anywhere.
    """
    cameras = {camera.name for camera in arm.goal_cameras}
    if arm.joints == get_arm(THESIS_ARM).joints and {"front", "wrist"} <= cameras:
        return ThesisReward()
    return DistanceReward(arm.workcell.reached_distance)


def check_reward(reward: object, arguments: str = "distance, q and impossible", *, names: Collection[str] = ()) -> None:
    if reward is None or callable(reward) or (isinstance(reward, str) and reward in names):
        return
    named = "".join(f"{name!r}, " for name in names)
    raise InputError(f"reward must be {named}{'or ' if named else ''}a callable of {arguments}, got {shown(reward)}")


def scorer_of(reward: RewardFunction | str | None, default: Scorer) -> Scorer:
    """Return the scorer for an option `reward`; the default also has what a function does not return."""
    if reward is None or reward == DENSE:
        return default
    if reward == SPARSE:
        return SparseReward(default)
    if isinstance(reward, DirectedReward) and not isinstance(default, DirectedReward):
        raise InputError("DirectedReward is for tasks in which goals have a direction, such as kinreach/Reach-v0")
    if isinstance(reward, ThesisReward | DistanceReward | DirectedReward):
        return reward
    return OwnReward(reward, default)  # type: ignore[arg-type]


def judges_posture(scorer: Scorer) -> bool:
    """Return whether the two errors of the thesis's posture are a part of what is to be reached."""
    inner = scorer.default if isinstance(scorer, SparseReward | OwnReward) else scorer
    return isinstance(inner, ThesisReward)


def score_of_goals(
    scorer: Scorer,
    distance: Floats,
    impossible: Flags,
    *angle: Floats,
    errors: Floats,
    q: Callable[[], Floats],
) -> Score:
    """Judge k steps without their postures.

    Args:
        scorer: Of the task.
        distance: From the tips to the goals [m], shape (k,).
        impossible: Whether the actions could not be executed, shape (k,).
        *angle: Between tools and their directions [rad], shape (k,), where goals have one.
        errors: Errors of the thesis's posture [rad], shape (2, k); unused where it is not judged.
        q: Gives postures [rad], shape (k, n), for a function of the user's, which alone needs them.
    """
    match scorer:
        case SparseReward():
            return scorer.of(score_of_goals(scorer.default, distance, impossible, *angle, errors=errors, q=q))
        case OwnReward():
            default = score_of_goals(scorer.default, distance, impossible, *angle, errors=errors, q=q)
            return scorer.of(default, distance, q(), impossible, *angle)
        case ThesisReward():
            return scorer.of_errors(distance, errors[0], errors[1], impossible)
    return scorer.score(distance, np.empty((len(distance), 0)), impossible, *angle)


def term_names(scorer: Callable[..., Score], *arguments: Any) -> tuple[str, ...]:
    """Return the names of a reward's terms, from what it says of a start.

    Return none if it fails there. A function of the user's may need what only a step has; else it fails again there.
    """
    try:
        return tuple(scorer(*arguments).terms)
    except Exception:  # of the user's function
        return ()


def nothing(q: Floats) -> Floats:
    """Return zeros, shape (k,), in the kind of array of postures (k, n)."""
    zeros: Floats = like(q, np.zeros(len(q)))
    return zeros


def _with_or_without_angle(name: str, function: Callable[..., Any], directed: bool) -> Callable[..., Any]:
    """Return a function with the argument `angle`, whether or not the user's has it."""
    try:
        signature = inspect.signature(function)
    except ValueError:  # some functions of C have none
        return function
    if directed and _takes(signature, 4):
        return function
    if not _takes(signature, 3):
        also = ", or these and angle" if directed else ""
        raise InputError(f"{name} must take (distance, q, impossible){also}, got {signature}")
    return partial(_without_angle, function)


def _takes(signature: inspect.Signature, count: int) -> bool:
    try:
        signature.bind(*range(count))
    except TypeError:
        return False
    return True


def _without_angle(function: RewardFunction, distance: Floats, q: Floats, impossible: Flags, *angle: Floats) -> object:
    return function(distance, q, impossible)


def _column(name: str, value: object, count: int) -> Floats:
    column = as_floats(name, value)  # type: ignore[arg-type]
    if column.shape != (count,):
        raise InputError(f"{name} must have shape ({count},), got {column.shape}")
    check_entries(name, column, float_info.max)
    return column
