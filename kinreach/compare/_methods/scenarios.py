"""Touch a rolling ball by planning for many of its futures at once."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np

from kinreach._checks import Floats
from kinreach.baselines.inside import expert
from kinreach.compare._methods.futures import Futures
from kinreach.compare._methods.interception import HORIZON, Interception
from kinreach.envs.inside import moving as ball

#: Futures that are drawn in a decision, and frames between their places.
COUNT, EVERY = 64, 2
#: Postures of single futures among the tried motions; the others go to the median of all, one for each place.
SINGLE = 36
#: A posture within the joints' bounds by much more than this is reached in time, one beyond them is not [rad].
SURE = 0.05
#: `Interception`'s own motion is left only for one from which this share more of the futures can be met.
GAIN = 0.01


class Scenarios(Interception):
    """Go to where most futures of the ball can still be met.

    Hindsight optimisation (Chong, Givan and Chang 2000; Yoon, Fern, Givan and Kambhampati 2008): every frame draws
    futures that agree with the sights. Each tried motion of the next frame is worth the share of futures that the arm
    can meet afterwards, each as if it were known from then on: some posture at the ball, tool down, is within what the
    joints can reach in time. The motion of `Interception` is one of them, and is kept unless another is worth more.

    Args:
        env: `kinreach/Moving-v0`.
        count: Futures that are drawn in a decision.
        every, first, frames: As of `Interception`.
    """

    def __init__(self, env: gym.Env[Any, Any], *, count: int = COUNT, **options: Any) -> None:
        super().__init__(env, **options)
        self._count = count

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        """Forget the last ball; draws begin anew."""
        super().reset(observation, info)
        self._futures = Futures(self._low, self._high)

    def _choose(self, q: Floats, v: Floats, age: float, seen: Floats) -> None:
        super()._choose(q, v, age, seen)
        frames = np.arange(EVERY, HORIZON + 1, EVERY)
        xy = self._futures.draw(self._fit, self._count, age + frames / ball.FRAMES)
        there = np.logical_and.accumulate(((xy >= self._low) & (xy <= self._high)).all(axis=2), axis=1)
        goals = self._postures_at(xy)
        there &= np.isfinite(goals).all(axis=2)
        if not there.any():
            return
        tried = np.array([self._target, *self._motions(goals, there)])
        q1, v1 = self._after_a_frame(np.tile(q, (len(tried), 1)), np.tile(v, (len(tried), 1)), tried, self._limits)
        slack = self._slack(q1, v1, goals, (frames - 1) / ball.FRAMES)
        met = 1.0 / (1.0 + np.exp(-np.where(there, slack, -np.inf).max(axis=2) / SURE))
        met[0] = np.maximum(met[0], self._met_on_the_way(xy, there, frames))
        worth = met.mean(axis=1)
        order = np.argsort(-worth[1:], kind="stable") + 1
        for index in order[:3]:
            if worth[index] < worth[0] + GAIN:
                return
            if self._is_free(q, v, tried[index]):
                self._target, self._followed = tried[index], None
                return

    def _postures_at(self, xy: Floats) -> Floats:
        """Return postures with the tool down at places [m], shape (k, n, 2) to (k, n, 6)."""
        flat = xy.reshape(-1, 2)
        postures = expert.tool_down_postures(self._kinematics, np.column_stack([flat, np.full(len(flat), self._aim)]))
        return postures.reshape(*xy.shape[:2], 6)

    def _motions(self, goals: Floats, there: Any) -> Floats:
        """Return targets to try: for each time the median posture of the futures, and postures of single futures."""
        used = there.sum(axis=0) > 0
        medians = np.nanmedian(np.where(there[:, used, None], goals[:, used], np.nan), axis=0)
        some = np.argwhere(there)
        some = some[np.linspace(0, len(some) - 1, min(SINGLE, len(some))).astype(int)]
        return np.clip(np.concatenate([medians, goals[some[:, 0], some[:, 1]]]), -math.pi, math.pi)

    def _slack(self, q: Floats, v: Floats, goals: Floats, times: Floats) -> Floats:
        """Return by how much goals are within what joints can reach in time, negative if they are not [rad].

        Args:
            q: Joint angles after each tried motion [rad], shape (m, 6).
            v: Their speeds [rad/s], likewise.
            goals: Postures in each future [rad], shape (k, n, 6).
            times: From then on [s], shape (n,).

        Returns:
            Shape (m, k, n); NaN where a posture is.
        """
        low, high = (
            ball.pushed(q.T[:, :, None], v.T[:, :, None], side, times, **self._limits)[0] for side in (-1.0, 1.0)
        )
        joints = np.moveaxis(goals, 2, 0)[:, None]  # first, so that the least of them is found fast
        apart = np.abs(joints - ((low + high) / 2.0)[:, :, None])
        return np.asarray((((high - low) / 2.0)[:, :, None] - apart).min(axis=0))

    def _met_on_the_way(self, xy: Floats, there: Any, frames: Any) -> Any:
        """Return which futures are touched on the way that `Interception` follows, shape (k,)."""
        if self._followed is None:
            return np.zeros(len(xy), dtype=np.bool_)
        parts = np.arange(1, len(self._followed) + 1)
        tips = self._kinematics.fk(self._followed)[:, :2, 3]
        times = frames * ball.PARTS
        within = (parts >= times[0]) & (parts <= times[-1])
        near = np.zeros(len(xy), dtype=np.bool_)
        for future, (path, alive) in enumerate(zip(xy, there, strict=True)):
            at = np.column_stack([np.interp(parts[within], times, axis) for axis in path.T])
            last = times[alive][-1] if alive.any() else 0
            apart = np.linalg.norm(at - tips[within], axis=1)
            near[future] = bool((apart[parts[within] <= last] <= ball.TOUCH).any())
        return near
