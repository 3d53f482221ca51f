"""The button task: what an action means, what is observed, and what is paid for.

Everything here works on stacks, so that one environment and thousands in a batch share it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import Floats, as_array
from kinreach.envs._reach.rewards import Score, Terms, nothing
from kinreach.errors import InputError
from kinreach.robots import QuadrantRegion, get_arm

JOINTS = 3
#: What each of the 27 torque actions adds to the controls of the three joints; the first joint changes slowest.
INCREMENTS: Floats = np.array(list(product((-1.0, 0.0, 1.0), repeat=JOINTS)))
#: Torque actions without a press, then the same with one.
ACTIONS = 2 * len(INCREMENTS)
#: Controls accumulate and are kept within +- this.
CONTROL_LIMIT = 10.0
#: Cosines (3) and sines (3) of the joint angles, target (3), end effector (3), joint velocities (3), end effector
#: minus target (3), push state (1).
OBSERVATIONS = 19
#: Bounds of positions, and of their differences, in the observation space [m]; the arm reaches 1.2 m.
POSITION_BOUND, DIFFERENCE_BOUND = 2.0, 4.0
#: A simulation in which a joint is faster than this [rad/s] has diverged; random actions give up to 100.
SPEED_BOUND = 10_000.0

#: A press counts when the end effector is nearer to the target than this [m].
PRESS_RADIUS = 0.05
PRESS_REWARD = 100.0

Actions = NDArray[np.intp]
Flags = NDArray[np.bool_]

_ARM = get_arm("arm3")


@dataclass(frozen=True)
class Actuation:
    """A world of the task: motors, friction and time of the arm, where targets are, and what a press is worth.

    Attributes:
        gears: Torque of each motor per unit of control [N m].
        damping: Viscous friction of each joint [N m s/rad].
        armature: Inertia that each joint feels besides that of the links [kg m^2].
        timestep: Step of the simulation [s].
        frame_skip: Steps of the simulation in one step of the environment.
        effort_limits: Whether the URDF's effort bounds the torque.
        endless: Whether the first joint turns without a limit.
        targets: Where targets are drawn; None: in the arm's work cell.
        near: Reward of a step that ends near the target.
        wrong_press: Reward of a press in a step that does not end near the target.
        press_first: Whether a press counts by where the end effector is before the step moves it, or after.
    """

    name: str
    gears: tuple[float, ...]
    damping: tuple[float, ...]
    armature: tuple[float, ...]
    timestep: float
    frame_skip: int
    effort_limits: bool
    endless: bool
    targets: QuadrantRegion | None
    near: float
    wrong_press: float
    press_first: bool

    @property
    def period(self) -> float:
        """Time of one step of the environment [s]."""
        return self.timestep * self.frame_skip


#: The course project's world on the day of its report. In its model base and first link overlap, and touch. MuJoCo's
#: contacts are soft: with their friction this one does not hold the joint, but lets it creep. That is to say, with the
#: share s of a torque that is left and the rate r at which speed decays, both measured there, and the inverse inertia A
#: of the joint, 1 / (A s / (1 - s)) of inertia and r / (1 - s) times as much damping:
#: s = 0.0293, r = 102 / s, A = 5.07 / (kg m^2) in MuJoCo 2.2 and 2.3, the means of 360 angles of the joint.
REPORT = Actuation(
    name="report",
    gears=(100.0, 30.0, 10.0),
    damping=(686.0, 0.0, 0.0),
    armature=(6.52, 0.0, 0.0),
    timestep=0.002,
    frame_skip=2,
    effort_limits=False,
    endless=True,
    targets=QuadrantRegion(across=(0.1, 0.75), height=(0.0, 0.75)),
    near=10.0,
    wrong_press=-5.0,
    press_first=True,
)
#: Full control is the effort of the URDF, 40, 80 and 25 N m: 1.7 times and more what gravity asks for. Near the target
#: a step pays less than 0.1, so that waiting there for a whole episode of 1000 steps pays less than pressing at once.
TUNED = Actuation(
    name="tuned",
    gears=(4.0, 8.0, 2.5),
    damping=_ARM.joint_damping,
    armature=(_ARM.armature,) * JOINTS,
    timestep=0.004,
    frame_skip=10,
    effort_limits=True,
    endless=False,
    targets=None,
    near=0.1,
    wrong_press=-1.0,
    press_first=False,
)
ACTUATIONS = {actuation.name: actuation for actuation in (TUNED, REPORT)}


def action_space() -> spaces.Discrete:
    return spaces.Discrete(ACTIONS)


def observation_space(*, controls: bool = False, frames: int = 1) -> spaces.Box:
    """Return the space of the 19 numbers, with the controls where they are observed, of so many steps."""
    bounds = (1.0, 1.0, POSITION_BOUND, POSITION_BOUND, SPEED_BOUND, DIFFERENCE_BOUND)
    high = np.array([*np.repeat(bounds, 3), 1.0, *[CONTROL_LIMIT] * JOINTS * controls])
    low = -high
    low[OBSERVATIONS - 1] = 0.0
    return spaces.Box(np.tile(low, frames), np.tile(high, frames), dtype=np.float64)


def check_actions(actions: ArrayLike, count: int | None) -> Actions:
    """Return actions as integers of shape (1,), or (count,) for a batch."""
    shape = () if count is None else (count,)
    values = as_array("action", actions)
    if values.shape != shape or values.dtype.kind not in "iu":
        raise InputError(f"action must be integers of shape {shape}, got {values.dtype} of shape {values.shape}")
    outside = (values < 0) | (values >= ACTIONS)
    if outside.any():
        raise InputError(f"action must be from 0 to {ACTIONS - 1}, got {values[outside].flat[0]}")
    return values.reshape(-1).astype(np.intp)


def meaning(actions: Actions) -> tuple[Floats, Flags]:
    """Return what checked actions add to the controls, shape (n, 3), and whether they press, shape (n,)."""
    return INCREMENTS[actions % len(INCREMENTS)], actions >= len(INCREMENTS)


def action_of(change: Floats, press: Flags) -> Actions:
    """Inverse of `meaning`: the actions that add -1, 0 or 1 to each control, shape (n, 3), and press or not, (n,)."""
    digits = np.array([9, 3, 1])
    return ((np.asarray(change) + 1) @ digits + len(INCREMENTS) * press).astype(np.intp)


def observation(q: Floats, qd: Floats, tip: Floats, goals: Floats, pushed: Flags) -> Floats:
    """Lay out the 19 numbers, shape (n, 19), of angles, velocities, end effectors, targets (n, 3) and pushes (n,)."""
    return np.concatenate([np.cos(q), np.sin(q), goals, tip, qd, tip - goals, pushed[:, None]], axis=1)


def button_reward(
    distance: Floats, press: Flags, counts: Flags | None = None, *, pays: Actuation = TUNED
) -> tuple[Floats, Terms]:
    """Return reward of one step, and its terms, shape (n,).

    Args:
        distance: From the end effector to the target after the step [m], shape (n,).
        press: Whether the action pressed, shape (n,).
        counts: Whether it pressed the button, shape (n,); None: if it pressed and the step ends near the target.
        pays: Has the values.
    """
    near = distance < PRESS_RADIUS
    terms = {
        "distance": -distance,
        "near": np.where(near, pays.near, 0.0),
        "wrong_press": np.where(press & ~near, pays.wrong_press, 0.0),
        "press": np.where(press & near if counts is None else counts, PRESS_REWARD, 0.0),
    }
    return sum(terms.values(), nothing(distance)), terms


class ButtonReward:
    """The reward of one of the worlds, with everything that the environment reports of a step."""

    def __init__(self, pays: Actuation = TUNED) -> None:
        self._pays = pays

    def score(self, distance: Floats, q: Floats, press: Flags, *before: Floats) -> Score:
        """Reached: pressed, nearer than 0.05 m; before the step if that is how this world counts.

        Args:
            distance: To the target after the step [m], shape (k,).
            q: Joint angles [rad], shape (k, 3).
            press: Whether the action pressed, shape (k,).
            before: The distance before the step [m], shape (k,).
        """
        (judged,) = before if self._pays.press_first else (distance,)
        counts = press & (judged < PRESS_RADIUS)
        reward, terms = button_reward(distance, press, counts, pays=self._pays)
        return Score(reward, terms, self.posture_error(q), counts)

    def posture_error(self, q: Floats) -> Floats:
        """Zeros, shape (k,): any posture will do."""
        return nothing(q)
