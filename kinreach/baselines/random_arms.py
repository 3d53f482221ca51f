"""Arms with random errors, to train a policy that observes a summary of looks.

The environment `kinreach/RandomArm-v0`: a UR5 with errors of its frames as in `kinreach/RealArm-v0`, other ones in each
episode, has been observed in a number of looks, and moves to a ball once, twice or three times. The summary has the
same size for any number of looks: means of the tip's distance from the data sheet's, and of that times the place.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from kinreach._checks import Floats
from kinreach._registration import MAX_EPISODE_STEPS, RANDOM_ARM
from kinreach.baselines.expert import tool_down_postures
from kinreach.envs.inside import (
    Bounds,
    EnvOptions,
    Flags,
    Ids,
    NativeVectorEnv,
    Outcome,
    PosedEnv,
    Randomisation,
    Ranges,
    RowStreams,
    about_randomise,
    check_box_actions,
    check_randomise,
    option_rows,
    real_arm,
)
from kinreach.kinematics import URKinematics
from kinreach.robots import THESIS_ARM, ArmDescription
from kinreach.robots.inside import Prior, frames_of, moved_frames, slopes

#: Errors of frames as in `kinreach/RealArm-v0` (root mean square); those of the base stand for cameras, too.
ERRORS = Prior(base=(3e-3, 6e-3), links=(1e-3, 2e-3), tool=(3e-3, 0.0))
#: Largest number of moves to a ball, and numbers of looks before.
MOVES, LOOKS = 3, real_arm.BUDGETS[:-1]
#: How far beyond the table area balls may lie on all sides [m].
BEYOND = 0.01
#: What can be drawn, and its bounds.
DRAWN: Bounds = {"noise": real_arm.DRAWN["noise"]}
#: Numbers of an observation: where the ball was seen [m]; distance of the tip from the data sheet's beside this ball,
#: mean of the moves, and from the ball in the last one [m]; moves, looks; the result of `summary`.
BALL, OFF, MISSED, DONE, LOOKED, SUMMARY = slice(0, 3), slice(3, 6), slice(6, 9), 9, 10, slice(11, 20)
SIZE = 20
#: Numbers of draws: the frames' errors, the ball, the looks, the moves, the noise of looks, ball and moves.
_PARTS = (42, 3, 1, 1, 9, 3, 3 * MOVES)


@cache
def ur5() -> URKinematics:
    """Return the kinematics of the thesis's arm, in the world, to the tool centre point."""
    return URKinematics(THESIS_ARM, tip="tcp", base="world")


@cache
def _spread_out(count: int, dimensions: int) -> Floats:
    """Return points of Halton's sequence, shape (count, dimensions)."""
    from scipy.stats import qmc  # half a second to import

    return np.asarray(qmc.Halton(dimensions, scramble=True, rng=np.random.default_rng(0)).random(count))


def on_table(count: int) -> Floats:
    """Return points spread over the area of the balls [m], shape (count, 3)."""
    low, high = _table()
    return np.asarray(low + (high - low) * np.column_stack([_spread_out(count, 2), np.zeros(count)]))


def _table() -> Floats:
    """Return the corners of the area of the balls [m], shape (2, 3)."""
    region: Any = ur5().arm.workcell.goals
    return np.array([region.x, region.y, region.z]).T


def _basis(points: Floats) -> Floats:
    """Return 1 and both coordinates on the table, from -1 to 1, of points (m, 3), shape (m, 3)."""
    low, high = _table()
    return np.column_stack([np.ones(len(points)), ((2 * points - low - high) / (high - low + 1e-12))[:, :2]])


def summary(places: Floats, off: Floats) -> Floats:
    """Return the means [m] of the tip's errors, and of these times either coordinate on the table; zeros without looks.

    The errors `off`, shape (m, 3) or (k, m, 3) for k arms, are those of tips that the data sheet has at `places`, shape
    (m, 3) [m]. The result has shape (9,) or (k, 9).
    """
    basis = _basis(places)
    means = np.swapaxes(off, -1, -2) @ basis / max(len(basis), 1)
    return np.asarray(means.reshape(*means.shape[:-2], 9))


def _draws(rng: np.random.Generator, count: int) -> Floats:
    """Draw rows of an episode's numbers; the ball, the budget and the moves are uniform from 0 to 1."""
    rows = rng.normal(size=(count, sum(_PARTS)))
    rows[:, _PARTS[0] : _PARTS[0] + 5] = rng.uniform(size=(count, 5))
    return rows


@dataclass(frozen=True, kw_only=True)
class RandomArmOptions(EnvOptions):
    """Options of `kinreach/RandomArm-v0`."""

    randomise: Ranges | None = field(default=None, metadata=about_randomise(DRAWN, '"noise": (1e-4, 1e-3)'))

    def __post_init__(self) -> None:
        super().__post_init__()
        check_randomise(self.randomise, bounds=DRAWN)


class RandomArmStart(NamedTuple):
    """An episode has no options."""


ALL_DRAWN = RandomArmStart()


class RandomArmEpisodes(real_arm.MovedEpisodes):
    """The episodes of a number of environments.

    Attributes:
        placements: Of the true arms' frames, shape (count, 7, 4, 4).
        q: Postures of the last moves [rad], shape (count, 6).
        goals: The balls [m], shape (count, 3).
    """

    def __init__(self, options: RandomArmOptions, count: int) -> None:
        self.options = options
        self._drawn = Randomisation(options.randomise, count, None, sizes=dict.fromkeys(DRAWN, 1))
        self.action_space = spaces.Box(-1.0, 1.0, (6,))
        self.observation_space = spaces.Box(-np.inf, np.inf, (SIZE,), dtype=np.float64)
        self.chain = ur5().chain
        self._streams = RowStreams(_draws, count, size=sum(_PARTS))
        self.placements = np.tile(self.chain.placements, (count, 1, 1, 1))
        self.goals, self.q = np.empty((count, 3)), np.tile(ur5().arm.home, (count, 1))
        self._observed = np.empty((count, SIZE))
        self._noise = np.empty((count, MOVES, 3))
        self._distances, self._moves = np.full(count, np.inf), np.empty(count, dtype=int)
        q = tool_down_postures(ur5(), on_table(max(LOOKS)))
        frames = frames_of(self.chain.placements, q)
        self._slopes = slopes(frames).reshape(len(q), 3, -1)
        self._places = frames[-1][:, :3, 3]

    def seed(self, index: int, rng: np.random.Generator) -> None:
        """Let world `index` draw from `rng`."""
        self._drawn.seed(index, rng.spawn(1)[0])
        self._streams.seed(index, rng)

    def check_start(self, options: Mapping[str, Any] | None, count: int | None) -> RandomArmStart:
        """Return no options: `reset` has none."""
        return RandomArmStart(*option_rows(options, {}, count))

    def check_actions(self, actions: ArrayLike, count: int | None) -> Floats:
        """Return postures to go to, each angle divided by pi, shape (k, 6)."""
        return check_box_actions(actions, (6,), count)

    def begin(self, ids: Ids, start: RandomArmStart = ALL_DRAWN) -> None:
        """Begin an episode in worlds `ids`: an arm, a ball and the number of looks."""
        errors, ball, budget, moves, look_noise, ball_noise, noise = np.split(
            self._streams.draw(ids), np.cumsum(_PARTS)[:-1], axis=1
        )
        self._drawn.begin(ids)
        sigma = self._drawn.values("noise", ids, real_arm.NOISE) / real_arm.MEDIAN_LENGTH
        errors = errors * ERRORS.deviations(self.chain.joints).ravel()
        nominal = np.tile(self.chain.placements, (len(ids), 1, 1))
        self.placements[ids] = moved_frames(nominal, errors.reshape(-1, 6)).reshape(len(ids), -1, 4, 4)
        low, high = _table() + np.outer((-BEYOND, BEYOND), np.ones(3))
        self.goals[ids] = low + (high - low) * ball
        rows = np.zeros((len(ids), SIZE))
        rows[:, BALL] = self.goals[ids] + sigma * ball_noise
        level = (budget[:, 0] * len(LOOKS)).astype(int)
        for index, looks in enumerate(LOOKS):
            own = np.flatnonzero(level == index)
            if looks and len(own):
                off = (errors[own] @ self._slopes[:looks].reshape(3 * looks, -1).T).reshape(len(own), looks, 3)
                basis = _basis(self._places[:looks])
                root = np.linalg.cholesky(basis.T @ basis / looks)
                blur = sigma[own, None] / math.sqrt(looks) * look_noise[own].reshape(-1, 3, 3) @ root.T
                rows[own, SUMMARY] = summary(self._places[:looks], off) + blur.reshape(-1, 9)
                rows[own, LOOKED] = looks
        self._observed[ids], self._distances[ids], self.q[ids] = rows, np.inf, ur5().arm.home
        self._moves[ids] = 1 + (MOVES * moves[:, 0]).astype(int)
        self._noise[ids] = (sigma * noise).reshape(len(ids), MOVES, 3)

    def goal_info(self, rows: Any) -> dict[str, Any]:
        """Return where the balls are, and what was drawn."""
        return {**super().goal_info(rows), **self._drawn.info(rows)}

    def tips(self, q: Floats, rows: Any = slice(None)) -> Floats:
        """Return the true arms' tips in postures, one for each of some rows [m], shape (m, 3)."""
        return frames_of(np.swapaxes(self.placements[rows], 0, 1), q)[-1][:, :3, 3]

    def step(self, actions: Floats, acting: Flags | None = None) -> Outcome:
        """Move to the postures of `actions`, shape (n, 6), in [-1, 1], and look again."""
        acting = np.ones(len(actions), dtype=np.bool_) if acting is None else acting
        q = math.pi * np.clip(actions, -1.0, 1.0)
        self.q, tips = np.where(acting[:, None], q, self.q), self.tips(q)
        done = self._observed[:, DONE].astype(int)
        seen = tips + self._noise[np.arange(len(q)), np.minimum(done, MOVES - 1)]
        after = after_move(self._observed, q, seen)
        self._observed = np.where(acting[:, None], after, self._observed)
        self._distances = np.where(acting, np.linalg.norm(tips - self.goals, axis=1), self._distances)
        over = acting & (self._observed[:, DONE] >= self._moves)
        reward = -np.where(acting, self._distances, 0.0)
        return Outcome(reward, over, np.zeros_like(over), self._info(slice(None), reward))

    def _info(self, rows: Any, reward: Floats) -> dict[str, Any]:
        distance = np.array(self._distances[rows])
        return {
            **self.goal_info(rows),
            "distance": distance,
            "reached": distance < real_arm.REACHED_WITHIN,
            "is_success": distance < real_arm.REACHED_WITHIN,
            "impossible": np.zeros(len(distance), dtype=np.bool_),
            "reward_terms": {"distance": reward},
        }


def after_move(observed: Floats, q: Floats, seen: Floats) -> Floats:
    """Return observations (m, 20) after moves to postures (m, 6) [rad], with the tips seen at (m, 3) [m]."""
    after, count = observed.copy(), observed[:, [DONE]]
    off = seen - ur5().chain.positions(q)
    after[:, OFF] = (count * observed[:, OFF] + off) / (count + 1)
    after[:, MISSED] = seen - observed[:, BALL]
    after[:, DONE] += 1
    return after


class RandomArmEnv(PosedEnv):
    """One `kinreach/RandomArm-v0`; the module describes an episode, `RandomArmVectorEnv` the rest.

    The arm that is drawn is that of the data sheet.
    """

    Options = RandomArmOptions
    episodes_class = RandomArmEpisodes

    @property
    def arm(self) -> ArmDescription:
        """The arm of the data sheet, in its work cell."""
        return ur5().arm


class RandomArmVectorEnv(NativeVectorEnv):
    """A batch of `kinreach/RandomArm-v0`; the module describes an episode.

    An action is a posture, each angle divided by pi, shape (6,); an observation has 20 numbers. The reward is minus the
    distance [m].
    """

    registered_limit = MAX_EPISODE_STEPS[RANDOM_ARM]
    Options = RandomArmOptions
    episodes_class = RandomArmEpisodes
