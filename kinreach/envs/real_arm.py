"""A real arm: a UR5 whose tool, base and cameras differ from what its user believes.

The environment `kinreach/RealArm-v0` is a workplace. Somewhere in it lies a tray of balls; a step moves the tip to each
of them at once, and the observation has the places where the cameras saw the balls and the tip. Beforehand, an agent
may practise: `look` sends the arm to postures of its own choice and returns where the tip was seen. Kinematics only.

An episode goes through the `budgets`, each a number of looks that may have been taken by then, the earlier ones
included. With each, the arm goes to every ball once, and then `again` times more: the tip has been seen beside the
ball, and the posture can be corrected.

What is wrong is a rigid transform, or one of four errors that no frame describes (non-geometric ones: Whitney, Lozinski
and Rourke 1986, J. Dyn. Sys., Meas., Control 108): gears that give way under a load, their hysteresis, encoders off
their axes, and a stand that bends.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterable, Mapping
from copy import copy
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import Floats, as_floats, check_count, check_known, check_number, check_path, shown
from kinreach._registration import MAX_EPISODE_STEPS, REAL_ARM
from kinreach._rotations import turn
from kinreach.envs._batch import Episodes, Flags, Ids, NativeVectorEnv, Outcome
from kinreach.envs._options import EnvOptions, about, check_box_actions, check_started, option_values, with_options
from kinreach.envs._randomise import Bounds, Randomisation, Ranges, about_randomise, check_randomise
from kinreach.envs._single import SingleEnv
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics
from kinreach.kinematics.inside import SerialChain
from kinreach.robots import PUBLISHED_CALIBRATIONS, THESIS_ARM, ArmDescription, get_arm
from kinreach.robots.inside import frames_of
from kinreach.sim.inside import PosedScene, build_scene, mujoco

#: What can be wrong: rigid transforms, and what no rigid transform describes.
GEOMETRIC = LINKS, TOOL, BASE, CAMERAS = "links", "tool", "base", "cameras"
NONGEOMETRIC = SAG, BACKLASH, ENCODERS, MOUNT = "sag", "backlash", "encoders", "mount"
#: Errors of a workplace -> what is wrong with it.
ERRORS: Mapping[str, tuple[str, ...]] = {
    **{name: (name,) for name in GEOMETRIC},
    "all": GEOMETRIC,
    **{name: (name,) for name in NONGEOMETRIC},
    "nongeometric": NONGEOMETRIC,
    "everything": (*GEOMETRIC, *NONGEOMETRIC),
}
#: How far the tool is off [m], by how much the base is turned [rad], how far and by how much the cameras are off.
TOOL_OFF, BASE_TURN, CAMERAS_OFF, CAMERAS_TURN = 5e-3, math.radians(0.5), 2e-3, math.radians(0.3)
#: Load at the tip, all that a UR5 may carry [kg], and acceleration of gravity [m/s²].
PAYLOAD, GRAVITY = 5.0, 9.81
#: Of the joints' gears [N m/rad]: strain wave gears of sizes 25 and 14 and a ratio of 100, whose peak torques (157 and
#: 28 N m) are nearly those of the UR5's joints, at low torque (Harmonic Drive, CHA-A actuators, 2018, stiffness K1).
STIFFNESS = np.repeat((31e3, 4.7e3), 3)
#: Hysteresis of the same gears, the most that the maker allows: one minute of arc [rad].
HYSTERESIS = math.radians(1.0 / 60.0)
#: Amplitude of an encoder's error over a turn [rad]: a ring of 32.5 mm radius, 0.02 mm off its axis, a fifth of what a
#: maker of such encoders allows (Synapticon, SOMANET Circulo, 2022: 635 seconds of arc at 0.1 mm).
ECCENTRICITY = 0.02 / 32.5
#: The stand: its bending stiffness [N m/rad] and half its height [m]. An aluminium tube of 80 x 80 x 4 mm and 0.7 m by
#: the theory of beams (70 GPa). Universal Robots' manual asks for a stiff stand and names no number.
STAND_STIFFNESS, STAND_CENTRE = 1.2e5, 0.35
#: Masses of the UR5's links, as in its URDF [kg].
LINK_MASSES = np.array((3.7, 8.393, 2.275, 1.219, 1.219, 0.1879))
#: Median length of the error of a look [m], and of an error with a standard deviation of 1 a coordinate.
NOISE, MEDIAN_LENGTH = 1.4e-4, 1.5382
#: What can be drawn, and its bounds; the payload acts on gears and stand.
DRAWN: Bounds = {"noise": (1e-9, 1.0), "payload": (0.0, PAYLOAD)}
#: Looks that may be taken before, a choice of these; half of the balls have to be nearer than this in the end [m].
BUDGETS, REACHED_WITHIN = (0, 5, 10, 20, 50, 100), 5e-4
#: UR5 whose calibrations come with the package.
UR5S = tuple(name for name in PUBLISHED_CALIBRATIONS if name.startswith("ur5_"))
#: Numbers of an observation: ball and tip as they were seen, posture, moves to this ball, looks allowed so far.
SEEN_BALL, SEEN_TIP, POSTURE, MOVES, BUDGET = slice(0, 3), slice(3, 6), slice(6, 12), 12, 13
SIZE = 14
#: No tip is seen farther away [m].
REACH = 2.0
MAX_AGAIN, MAX_BALLS = 20, 100_000


@dataclass(frozen=True, kw_only=True)
class RealArmOptions(EnvOptions):
    """Options of `kinreach/RealArm-v0`."""

    errors: tuple[str, ...] = field(
        default=(*GEOMETRIC, "all"), metadata=about("what is wrong, one of them an episode: " + ", ".join(ERRORS))
    )
    calibrations: tuple[str, ...] = field(default=UR5S, metadata=about("true UR5s: names of published ones, or files"))
    budgets: tuple[int, ...] = field(
        default=BUDGETS[:-1], metadata=about(f"looks that may be taken before, some of {BUDGETS}", flag="looks")
    )
    again: int = field(default=2, metadata=about("how often the arm goes to a ball again, having seen where it was"))
    balls: int = field(default=50, metadata=about("on the tray"))
    noise: float = field(default=NOISE, metadata=about("median error of a look [m]"))
    randomise: Ranges | None = field(default=None, metadata=about_randomise(DRAWN, '"noise": (1e-4, 1e-3)'))

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in self.errors:
            check_errors(name)
        for count in self.budgets:
            check_count("a budget of looks", count, least=0)
            check_known("budget of looks", str(count), [str(known) for known in BUDGETS])
        if list(self.budgets) != sorted(set(self.budgets)):
            raise InputError(f"budgets of looks must increase, got {shown(self.budgets)}")
        check_count("again", self.again, least=0, most=MAX_AGAIN)
        check_count("balls", self.balls, most=MAX_BALLS)
        check_number("noise [m]", self.noise, least=DRAWN["noise"][0], most=DRAWN["noise"][1])
        check_randomise(self.randomise, bounds=DRAWN)
        for calibration in self.calibrations:
            true_arm(calibration)


def check_errors(name: str) -> str:
    """Check the name of a workplace's errors and return it."""
    check_known("errors of a real arm", name, ERRORS)
    return name


def check_calibration(calibration: str | Path) -> str:
    """Check the name or the file of a UR5's calibration and return it."""
    true_arm(calibration)
    return str(calibration)


def true_arm(calibration: str | Path) -> ArmDescription:
    """Return a calibrated UR5 by the name of a published calibration, or by a file."""
    file = check_path("calibration", calibration)
    return _calibrated(file, file.stat().st_mtime_ns if file.exists() else 0)


@lru_cache
def _calibrated(file: Path, written: int) -> ArmDescription:
    return get_arm(THESIS_ARM).calibrated(file)


@lru_cache
def _chain(arm: ArmDescription) -> SerialChain:
    return ArmKinematics(arm, tip="tcp", base="world").chain


@dataclass(frozen=True)
class Workplace:
    """The true arm, and how the cameras see it.

    Attributes:
        arm: With its true links.
        tool: Of the tip, in its frame [m].
        base: Turn of the base about the vertical [rad].
        cameras: The world as the cameras see it in the true world, shape (4, 4).
        sags: Whether gears give way under the payload.
        lags: Whether gears have hysteresis.
        phases: Of the encoders' errors [rad], shape (6,); None without.
        tilts: Whether the stand bends under arm and payload.
        payload: At the tip [kg].
    """

    arm: ArmDescription
    tool: Floats
    base: float
    cameras: Floats
    sags: bool = False
    lags: bool = False
    phases: Floats | None = None
    tilts: bool = False
    payload: float = PAYLOAD

    def joints(self, q: Floats, start: Floats) -> Floats:
        """Return where the joints are [rad] when the arm goes from `start`, (1, 6), to postures (m, 6) in turn."""
        true = q.copy()
        if self.phases is not None:
            true += ECCENTRICITY * np.sin(q + self.phases)
        if self.lags:
            true -= 0.5 * HYSTERESIS * np.sign(np.diff(q, axis=0, prepend=start))
        if self.sags:
            true -= self.payload * GRAVITY * _chain(self.arm).jacobian(q)[:, 2] / STIFFNESS
        return true

    def tips(self, q: Floats, start: Floats | None = None) -> Floats:
        """Return where the tip is in postures (m, 6) [m], shape (m, 3), taken one after the other.

        Args:
            q: Commanded [rad].
            start: The posture before them; the first of them if None.
        """
        joints = self.joints(q, q[:1] if start is None else start[None])
        frames = frames_of(_chain(self.arm).placements, joints)  # for few balls quicker than the chain
        yaw = turn(np.array((0.0, 0.0, 1.0)), self.base).T
        tips = np.asarray((frames[-1][:, :3, :3] @ self.tool + frames[-1][:, :3, 3]) @ yaw)
        if not self.tilts:
            return tips
        origins = np.array([frame[:, :3, 3] for frame in frames]) @ yaw
        centres = 0.5 * (origins[:-1] + origins[1:])
        x, y, _ = GRAVITY / STAND_STIFFNESS * (np.tensordot(LINK_MASSES, centres, 1) + self.payload * tips).T
        foot = np.array((0.0, 0.0, -STAND_CENTRE))
        return np.asarray(tips + np.cross(np.column_stack([-y, x, 0.0 * x]), tips - foot))

    def seen(self, points: Floats) -> Floats:
        """Return where the cameras see points (m, 3) of the world, without noise [m]."""
        return np.asarray(points @ self.cameras[:3, :3].T + self.cameras[:3, 3])

    def scene(self) -> PosedScene:
        """Return the arm as it truly stands in its work cell, its tool where it truly is; without what is not rigid."""
        return PosedScene(self.arm, model=copy(_true_model(self.arm, tuple(self.tool.tolist()), self.base)))


@lru_cache(maxsize=4)
def _true_model(arm: ArmDescription, tool: tuple[float, ...], turned: float) -> Any:
    """A scene (`mujoco.MjModel`) in which the tool is off [m] and the base is turned about the vertical [rad]."""
    spec = build_scene(arm)
    base, flange = spec.body(arm.base), spec.body(arm.tips["tool0"])
    yaw, placed = np.array([math.cos(turned / 2), 0.0, 0.0, math.sin(turned / 2)]), np.array(base.quat)
    mujoco.mju_mulQuat(base.quat, yaw, placed)
    for held in flange.bodies:  # turned as the flange is, and so is the tip
        held.pos = held.pos + tool
    return spec.compile()


def workplace(errors: str, calibration: str, rng: np.random.Generator, payload: float = PAYLOAD) -> Workplace:
    """Draw a workplace with errors as large as the constants of this module, in a random direction.

    They are a key of `ERRORS`; the calibration is as of `true_arm`, the payload in kg.
    """
    parts = ERRORS[errors]
    tool, base, shift, axis = _direction(rng), rng.choice((-1.0, 1.0)), _direction(rng), _direction(rng)
    cameras = np.eye(4)
    if CAMERAS in parts:
        stand = np.array(next(m.position for m in get_arm(THESIS_ARM).cameras if m.name == "front"))
        cameras[:3, :3] = turn(axis, CAMERAS_TURN)
        cameras[:3, 3] = stand - cameras[:3, :3] @ stand + CAMERAS_OFF * shift
    return Workplace(
        true_arm(calibration) if LINKS in parts else get_arm(THESIS_ARM),
        TOOL_OFF * tool if TOOL in parts else np.zeros(3),
        float(BASE_TURN * base) if BASE in parts else 0.0,
        cameras,
        sags=SAG in parts,
        lags=BACKLASH in parts,
        phases=rng.uniform(-math.pi, math.pi, 6) if ENCODERS in parts else None,
        tilts=MOUNT in parts,
        payload=payload,
    )


def _direction(rng: np.random.Generator) -> Floats:
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


class RealArmStart(NamedTuple):
    """Names of k workplaces' errors and calibrations, shape (k,); None where they are drawn."""

    errors: NDArray[np.str_] | None = None
    calibrations: NDArray[np.str_] | None = None


class MovedEpisodes(Episodes):
    """Episodes that change in moves only: what was observed last is kept, and the distance of the tip."""

    _observed: Floats

    def observe(self) -> Floats:
        """Return the observations of all environments, a row for each."""
        return self._observed.copy()

    def start_info(self, ids: Ids) -> dict[str, Any]:
        """Return the `info` of a reset; distances are infinite before the first move."""
        return self._info(ids, np.zeros(len(ids)))

    @abstractmethod
    def _info(self, rows: Any, reward: Floats) -> dict[str, Any]:
        """Return the `info` of some environments; `reward` has as many rows."""


class RealArmEpisodes(MovedEpisodes):
    """The episodes of a number of workplaces.

    Attributes:
        places: The workplaces; None before their first episodes.
        balls: On the trays [m], shape (count, balls, 3).
        q: Postures of the last moves to every ball [rad], shape (count, balls, 6).
        at: Where the arms stand [rad], shape (count, 6).
        noise: Standard deviations of each coordinate of a look [m], shape (count,).
    """

    def __init__(self, options: RealArmOptions, count: int) -> None:
        self.options, self.count = options, count
        high = np.array([*6 * [REACH], *6 * [math.pi], options.again + 1, max(*options.budgets, 1)])
        low, shape = np.where(np.arange(SIZE) < MOVES, -high, 0.0), (options.balls, 1)
        self.observation_space = spaces.Box(np.tile(low, shape), np.tile(high, shape), dtype=np.float64)
        self.action_space = spaces.Box(-1.0, 1.0, (options.balls, 6))
        self.noise, self.home = np.full(count, options.noise / MEDIAN_LENGTH), np.array(get_arm(THESIS_ARM).home)
        self._drawn = Randomisation(options.randomise, count, None, sizes=dict.fromkeys(DRAWN, 1))
        self._rngs = [np.random.default_rng() for _ in range(count)]
        self.places: list[Workplace | None] = [None for _ in range(count)]
        self._scenes: list[PosedScene | None] = [None for _ in range(count)]
        self._named = np.full((2, count), "", dtype=object)  # errors and calibrations
        self.balls, self._observed = np.zeros((count, options.balls, 3)), np.zeros((count, options.balls, SIZE))
        self.q, self.at = np.empty((count, options.balls, 6)), np.empty((count, 6))
        self._looks, self._level, self._moves = np.zeros((3, count), dtype=np.intp)
        self._distance = np.empty(count)
        self._errors = np.empty((count, len(options.budgets), options.again + 1))

    @property
    def goals(self) -> Floats:  # type: ignore[override]
        """The first balls of the trays [m], shape (count, 3)."""
        return self.balls[:, 0]

    def place(self, index: int) -> Workplace:
        """Return a workplace, or raise an `InputError` before its first episode."""
        place = self.places[index]
        check_started(place is not None)
        return cast("Workplace", place)

    def scene(self, index: int) -> PosedScene:
        """Return the true arm of an episode, which moves with it from now on."""
        scene = self._scenes[index]
        if scene is None:
            scene = self._scenes[index] = self.place(index).scene()
            moved = self._moves[index] or self._level[index]
            scene.put(self.at[index], ball=self.balls[index, -1 if moved else 0])
        return scene

    def seed(self, index: int, rng: np.random.Generator) -> None:
        """Give a workplace its own generator."""
        self._rngs[index] = rng
        self._drawn.seed(index, rng.spawn(1)[0])

    def check_start(self, options: Mapping[str, Any] | None, count: int | None) -> RealArmStart:
        """Return the options of `reset`: `errors` and `calibration`, one for all workplaces or one for each."""
        checks = {"errors": check_errors, "calibration": check_calibration}
        return RealArmStart(*option_values(options, checks, count))

    def check_actions(self, actions: ArrayLike, count: int | None) -> Floats:
        """Return postures to go to, each angle divided by pi, shape (k, balls, 6)."""
        return check_box_actions(actions, self.action_space.shape, count)

    def begin(self, ids: Ids, start: RealArmStart = RealArmStart()) -> None:  # noqa: B008 (immutable)
        """Draw other workplaces, and trays of balls."""
        self._drawn.begin(ids)
        self.noise[ids] = self._drawn.values("noise", ids, self.options.noise)[:, 0] / MEDIAN_LENGTH
        payload = self._drawn.values("payload", ids, PAYLOAD)[:, 0].tolist()
        for row, index in enumerate(ids):
            rng = self._rngs[index]
            drawn = rng.choice(self.options.errors), rng.choice(self.options.calibrations)
            errors, calibration = (
                str(name if names is None else names[row]) for name, names in zip(drawn, start, strict=True)
            )
            self._named[:, index] = errors, calibration
            self.places[index] = workplace(errors, calibration, rng, payload[row])
            self.balls[index] = get_arm(THESIS_ARM).workcell.draw_goals(rng, self.options.balls)
            self._observed[index] = 0.0
            self._observed[index, :, SEEN_BALL] = self._seen(index, self.balls[index])
            self._observed[index, :, BUDGET] = self.options.budgets[0]
            self._scenes[index] = None
        self.at[ids] = self.home
        self.q[ids] = self.home
        self._looks[ids] = self._level[ids] = self._moves[ids] = 0
        self._distance[ids] = self._errors[ids] = math.inf

    def looks_left(self, index: int) -> int:
        """Return the number of looks that may still be taken in an environment before the next move."""
        return self.options.budgets[self._level[index]] - int(self._looks[index])

    def look(self, index: int, postures: ArrayLike) -> Floats:
        """Go to postures (m, 6) [rad] in an environment, and return where the tip is seen [m], shape (m, 3)."""
        place, q = self.place(index), as_floats("postures", postures)
        if q.ndim != 2 or q.shape[1] != 6 or not np.isfinite(q).all():
            raise InputError(f"postures must be finite and have shape (m, 6), got {q.shape}")
        if len(q) > self.looks_left(index):
            raise InputError(f"there are {self.looks_left(index)} looks left, got {len(q)} postures")
        self._looks[index] += len(q)
        self._show(index, q)
        tips = place.tips(q, self.at[index])
        self.at[index] = np.concatenate([self.at[[index]], q])[-1]
        return self._seen(index, tips)

    def _seen(self, index: int, points: Floats) -> Floats:
        return self.place(index).seen(points) + self._rngs[index].normal(0.0, self.noise[index], points.shape)

    def _show(self, index: int, postures: Floats, balls: Iterable[Floats] = ()) -> None:
        scene = self._scenes[index]
        if scene is None or not len(postures):
            return
        taken = [*zip_longest(postures, balls)]
        if scene.watch is None:
            q, ball = taken[-1]
            scene.put(q, ball=ball)
            return
        for q, ball in taken:
            scene.go(q, ball=ball)

    def step(self, actions: Floats, acting: Flags | None = None) -> Outcome:
        """Go to every ball, in all environments or where `acting` is True."""
        acting = np.ones(self.count, dtype=np.bool_) if acting is None else acting
        over, reward = np.zeros(self.count, dtype=np.bool_), np.zeros(self.count)
        for index in np.flatnonzero(acting):
            q = self.q[index] = math.pi * np.clip(actions[index], -1.0, 1.0)
            self._show(index, q, self.balls[index])
            tips = self.place(index).tips(q, self.at[index])
            self.at[index] = q[-1]
            observed = self._observed[index]
            observed[:, SEEN_TIP], observed[:, POSTURE] = self._seen(index, tips), q
            distances = np.linalg.norm(tips - self.balls[index], axis=1)
            self._distance[index], reward[index] = np.median(distances), -distances.mean()
            level, moves = self._level[index], self._moves[index]
            self._errors[index, level, moves] = self._distance[index]
            self._moves[index] += 1
            if moves == self.options.again:
                over[index] = level + 1 == len(self.options.budgets)
                if not over[index]:
                    self._level[index], self._moves[index] = level + 1, 0
                    observed[:, SEEN_TIP] = observed[:, POSTURE] = 0.0
            observed[:, MOVES], observed[:, BUDGET] = self._moves[index], self.options.budgets[self._level[index]]
        return Outcome(reward, over, np.zeros_like(over), self._info(slice(None), reward))

    def goal_info(self, rows: Any) -> dict[str, Any]:
        """Return where the first balls are, and what is wrong with the arms."""
        names = {"errors": np.array(self._named[0, rows]), "calibration": np.array(self._named[1, rows])}
        return names | super().goal_info(rows) | self._drawn.info(rows)

    def _info(self, rows: Any, reward: Floats) -> dict[str, Any]:
        distance = np.array(self._distance[rows])
        near = distance < REACHED_WITHIN
        return {
            **self.goal_info(rows),
            "q": np.array(self.q[rows, 0]),
            "distance": distance,
            **{
                f"error_{budget}_{again}": np.array(self._errors[rows, level, again])
                for level, budget in enumerate(self.options.budgets)
                for again in range(1 + self.options.again)
            },
            "reached": near,
            "is_success": near,
            "impossible": np.zeros(len(distance), dtype=np.bool_),
            "reward_terms": {"distance": reward},
        }


@with_options(RealArmOptions)
class RealArmEnv(SingleEnv):
    """A UR5 that differs from its data sheet reaches a tray of balls, after a few looks at its own tip.

    ## Description
    The true arm has a published factory calibration; its tool, its base and the cameras are a little off. One step
    moves the tip to every ball of the tray. Before a step the agent may practise: `look(postures)` sends the arm to
    postures and returns where the tip was seen, as long as `looks_left` allows. Kinematics only.

    ## Action Space
    `Box(-1, 1, (balls, 6), float32)`: a posture for each ball, each angle divided by pi.

    ## Observation Space
    `Box(balls, 14), float32`, a row for each ball.

    | Num | Observation | Unit |
    |-----|-------------|------|
    | 0 to 2 | where the ball was seen | m |
    | 3 to 5 | where the tip was seen in the last move to it; zeros before | m |
    | 6 to 11 | posture of that move; zeros before | rad |
    | 12 | moves so far with this budget | 1 |
    | 13 | looks allowed so far | 1 |

    ## Rewards
    Minus the mean distance of tip and balls [m]; the only term in `info["reward_terms"]` is `distance`.

    ## Starting State
    Errors, calibration and the directions of the errors are drawn; the balls are uniform on the table.
    `reset(options={"errors": name, "calibration": name})` sets either.

    ## Episode End
    An episode goes through the `budgets`. With each, the arm goes to every ball once, and then `again` times more. The
    episode terminates after the last move of the last budget.

    ## Info
    `reset` and `step` give the same entries, each of one type and shape. After a reset `distance` and the errors of
    moves to come are infinite, `is_success` is False, `q` is where the arm stands, and the reward is 0.

    | Key | Value |
    |-----|-------|
    | `calibration`, `errors` | which arm it truly is, and what is wrong with it |
    | `goal`, `impossible` | where the first ball is [m]; always `False` |
    | `distance` | median distance of this move [m] |
    | `error_BUDGET_AGAIN` | the same of each move, such as `error_5_0` |
    | `reached`, `is_success` | the median is below 0.5 mm |
    | `q` | posture of the last move to the first ball [rad] |
    | `reward_terms` | terms of the reward |

    ## Arguments

    <table of the options>

    ## Version History
    * v0: initial version

    Attributes:
        options: As given.
        believed: The arm as its user believes it to be.
    """

    episodes_class = RealArmEpisodes

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.believed: ArmDescription = get_arm(THESIS_ARM)

    @property
    def noise(self) -> float:
        """Standard deviation of each coordinate of a look [m], in this episode."""
        return float(self.episodes.noise[0])

    @property
    def scene(self) -> PosedScene:
        """The true arm of this episode; it is animated while `watch` is set, else it jumps.

        Raises:
            InputError: Before the first reset.
        """
        scene: PosedScene = self.episodes.scene(0)
        return scene

    def _first_scene(self) -> PosedScene:
        return PosedScene(get_arm(THESIS_ARM))

    def _follow(self) -> None:
        if self._picture is not None:
            self._picture.show(self.scene)

    @property
    def looks_left(self) -> int:
        """Number of looks that may still be taken before the next move."""
        return int(self.episodes.looks_left(0))

    def look(self, postures: ArrayLike) -> Floats:
        """Go to postures and see where the tip is.

        Args:
            postures: [rad], shape (m, 6).

        Returns:
            Where the tip was seen in each [m], shape (m, 3).

        Raises:
            InputError: Another shape, or more than there are looks left.
        """
        seen: Floats = self.episodes.look(0, postures)
        return seen


class RealArmVectorEnv(NativeVectorEnv):
    """A batch of `kinreach/RealArm-v0`, equal to as many single ones with the seeds `seed`, `seed + 1`, ...

    Arguments, and how episodes start anew, are as of `NativeVectorEnv`.
    """

    registered_limit = MAX_EPISODE_STEPS[REAL_ARM]
    Options = RealArmOptions
    episodes_class = RealArmEpisodes

    def look(self, postures: ArrayLike) -> Floats:
        """Go to postures and see where the tips are.

        Args:
            postures: [rad], shape (num_envs, m, 6).

        Returns:
            Where the tip was seen in each [m], shape (num_envs, m, 3).

        Raises:
            InputError: Another shape, or more than there are looks left in one of the environments.
        """
        q = as_floats("postures", postures)
        if q.ndim != 3 or q.shape[::2] != (self.num_envs, 6) or not np.isfinite(q).all():
            raise InputError(f"postures must be finite and have shape ({self.num_envs}, m, 6), got {q.shape}")
        left = min(self.episodes.looks_left(index) for index in range(self.num_envs))
        if q.shape[1] > left:
            raise InputError(f"there are {left} looks left, got {q.shape[1]} postures")
        return np.array([self.episodes.look(index, each) for index, each in enumerate(q)])
