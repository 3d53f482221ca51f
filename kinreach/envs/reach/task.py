"""The two variants of the thesis's task: what an action means, and what is observed.

Everything here works on stacks, so that one environment and thousands in a batch share it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from kinreach.checks import Floats, as_floats
from kinreach.envs.batch import option_rows
from kinreach.errors import InputError
from kinreach.vision.goal_view import geometric_goal_view

JOINTS = 6
#: What is observed: goal in the front camera (3), goal in the wrist camera (3), joint angles (6), gripper opening (1).
OBSERVATIONS = 13
GOAL, ANGLES, GRIPPER = slice(0, 6), slice(6, 12), 12
#: How the tool points at a goal, in the world: straight down.
TOOL_DOWN = (0.0, 0.0, -1.0)
#: Largest change of a joint in one step of the multi-step task [rad].
STEP_SIZE = math.radians(5.0)
#: Cameras see no further than this; the bound of the goal's coordinates in the observation space [m].
CAMERA_RANGE = 2.0
#: Joints come to rest within the controller's tolerance of their target, so they may stand a little past a limit [rad].
JOINT_BOUND = math.pi + 0.02


@dataclass(frozen=True)
class ReachVariant:
    """One way to act.

    Attributes:
        name: `"single"` or `"multi"`.
        relative: Whether an action changes the joint angles (else it sets them).
        scale: What an action of 1 means [rad].
        two_phase: Whether shoulder_lift waits for the other joints.
        max_steps: Steps after which an episode is truncated.
    """

    name: str
    relative: bool
    scale: float
    two_phase: bool
    max_steps: int

    def targets(self, q: Floats, actions: Floats) -> Floats:
        """Joint targets [rad] of checked actions in postures `q`, both of shape (n, 6)."""
        return q + self.scale * actions if self.relative else self.scale * actions


#: One action sets all joints, shoulder_lift last; the episode is over (thesis, section 3.4.5).
SINGLE_STEP = ReachVariant("single", relative=False, scale=math.pi, two_phase=True, max_steps=1)
#: Up to 100 actions of -5 ... 5 degrees, all joints at once.
MULTI_STEP = ReachVariant("multi", relative=True, scale=STEP_SIZE, two_phase=False, max_steps=100)


def action_space() -> spaces.Box:
    """Actions of an agent, in [-1, 1]."""
    return spaces.Box(-1.0, 1.0, (JOINTS,), np.float32)


def observation_space() -> spaces.Box:
    """The 13 numbers in metres and radians."""
    high = np.array([CAMERA_RANGE] * 6 + [JOINT_BOUND] * JOINTS + [CAMERA_RANGE])
    low = -high
    low[-1] = 0.0
    return spaces.Box(low, high, dtype=np.float64)


def reset_options(options: Mapping[str, Any] | None, count: int | None) -> tuple[Floats | None, Floats | None]:
    """The goals [m] and the postures [rad] that `reset(options=)` asks for, one a row; None for what it leaves open.

    Raises:
        InputError: An unknown option, a wrong shape, a value that is not finite, a joint outside its limits, or a goal
            that an observation cannot hold.
    """
    goals, q = option_rows(options, {"goal": 3, "q": JOINTS}, count)
    if q is not None and (np.abs(q) > math.pi).any():
        raise InputError(f"q must be within ±π, got {np.abs(q).max():g}")
    if goals is not None:
        seen = np.abs(geometric_goal_view("ur5", goals)).max(axis=1)
        if (seen > CAMERA_RANGE).any():
            raise InputError(f"goal {goals[seen.argmax()]} m is outside the {CAMERA_RANGE:g} m that the cameras see")
    return goals, q


def check_actions(actions: ArrayLike, count: int | None) -> Floats:
    """Actions of shape (6,), or (count, 6) for a batch, clipped to [-1, 1].

    In the result what belongs to one joint lies side by side, as the formulas want it.

    Raises:
        InputError: Wrong shape, or a value that is not finite.
    """
    shape = (JOINTS,) if count is None else (count, JOINTS)
    values = as_floats("action", actions)
    if values.shape != shape:
        raise InputError(f"action must have shape {shape}, got {values.shape}")
    if values.min() >= -1.0 and values.max() <= 1.0:  # there is nothing to clip
        return np.array(values.T, order="C").T
    if not np.isfinite(values).all():
        raise InputError("action must be finite")
    return np.clip(values.T, -1.0, 1.0, order="C").T
