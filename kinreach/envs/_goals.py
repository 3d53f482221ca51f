"""Goal environments, as Gymnasium-Robotics and panda-gym have them: a reward for any achieved and desired goal."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from kinreach._checks import as_floats, check_flag, shown
from kinreach._tensors import on_device, on_host
from kinreach.envs._options import CameraOptions, about
from kinreach.errors import InputError

#: Rewards by name: the task's own, and 0 where the goal is reached, else -1.
DENSE, SPARSE = REWARD_NAMES = ("dense", "sparse")


@dataclass(frozen=True, kw_only=True)
class GoalOptions(CameraOptions):
    """Options of tasks that can be goal environments."""

    goal_env: bool = field(
        default=False,
        metadata=about(
            "observations are a `Dict` of `observation`, `achieved_goal` and `desired_goal`, and there are "
            "`compute_reward`, `compute_terminated` and `compute_truncated`, for hindsight experience replay",
            flag=None,
        ),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_flag("goal_env", self.goal_env)
        if self.goal_env and self.observation != "geometric":
            raise InputError(
                f'goal_env=True has the goal in the world: use observation="geometric", got {self.observation!r}'
            )


def goal_dict(rest: spaces.Box, goal: spaces.Box) -> spaces.Dict:
    """Return the observation space of a goal environment, from that without the goal and that of goals."""
    return spaces.Dict({"observation": rest, "achieved_goal": goal, "desired_goal": goal})


class Told:
    """What the `info` of k transitions says.

    Args:
        info: Of a batch, with a row for each transition, or one `info` for each.
        count: k.
    """

    def __init__(self, info: Any, count: int) -> None:
        self._info, self._count = info, count
        if isinstance(info, Mapping):
            return
        if not isinstance(info, Sequence | np.ndarray) or len(info) != count:
            raise InputError(f"info must be a dictionary, or one for each of {count} goals, got {shown(info)}")
        for each in info:
            if not isinstance(each, Mapping):
                raise InputError(f"info must be a dictionary, got {shown(each)}")

    def get(self, name: str, default: Any = None) -> Any:
        """Return an entry as an array with k rows; without a default None if it is missing somewhere."""
        if isinstance(self._info, Mapping):
            values = on_host(self._info.get(name))
            values = None if values is None else np.asarray(values)
            if values is not None and values.shape[:1] != (self._count,):
                raise InputError(f"info[{name!r}] must have {self._count} rows, got shape {values.shape}")
        else:
            rows = [each.get(name, default) for each in self._info]
            values = None if any(row is None for row in rows) else np.array(rows)
        if values is None and default is not None:
            return np.full(self._count, default)
        return values

    def need(self, name: str) -> Any:
        """Return an entry as an array with k rows.

        Raises:
            InputError: It is missing.
        """
        values = self.get(name)
        if values is None:
            raise InputError(
                f"this reward depends on info[{name!r}], which is missing: stable-baselines3's "
                'HerReplayBuffer keeps it with copy_info_dict=True, or use reward="sparse"'
            )
        return values


class GoalMethods:
    """The methods of a goal environment; without `goal_env=True` there are none, as other people's code asks.

    `episodes.judge(achieved, desired, told)` returns the `Outcome` of transitions with these goals, shape (k, size),
    by what is `Told` of them; its `info` is not read.
    """

    options: Any
    episodes: Any

    @property
    def compute_reward(self) -> Callable[..., Any]:
        """`compute_reward(achieved_goal, desired_goal, info)`: the reward of a transition, or of k.

        Goals have shape (size,) or (k, size), as observations have them after the step; `info` is the step's, a list of
        k, or that of a batch. The result is a number, or has shape (k,).
        """
        return self._method("compute_reward", "reward")

    @property
    def compute_terminated(self) -> Callable[..., Any]:
        """`compute_terminated(achieved_goal, desired_goal, info)`: whether it ends the episode, as `compute_reward`."""
        return self._method("compute_terminated", "terminated")

    @property
    def compute_truncated(self) -> Callable[..., Any]:
        """`compute_truncated(achieved_goal, desired_goal, info)`: whether the simulation diverged, likewise.

        The limit of steps is Gymnasium's.
        """
        return self._method("compute_truncated", "truncated")

    def _method(self, name: str, result: str) -> Callable[..., Any]:
        if not self.options.goal_env:
            raise AttributeError(f"{name} is of goal environments: make this one with goal_env=True")
        return partial(self._judged, result)

    def _judged(self, result: str, achieved_goal: ArrayLike, desired_goal: ArrayLike, info: Any) -> Any:
        achieved = as_floats("achieved_goal", on_host(achieved_goal))
        desired = as_floats("desired_goal", on_host(desired_goal))
        (size,) = self.episodes.observation_space["desired_goal"].shape
        for name, goals in (("achieved_goal", achieved), ("desired_goal", desired)):
            if goals.shape != achieved.shape or goals.shape[-1:] != (size,) or goals.ndim > 2:
                raise InputError(f"{name} must have shape ({size},), or (k, {size}) as both, got {goals.shape}")
        many = achieved.ndim == 2
        achieved, desired = np.atleast_2d(achieved, desired)
        told = Told(info if many else [info], len(achieved))
        values = on_host(getattr(self.episodes.judge(achieved, desired, told), result))
        device = getattr(self, "device", None)
        if device is not None:
            return on_device(values if many else values[0:1], device)[() if many else 0]
        return values if many else values[0].item()
