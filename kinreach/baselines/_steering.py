"""How a policy for a rolling ball sees and steers, on numpy's arrays or torch's tensors: features and targets.

It sees the last sights of the ball, linear least-squares fits of its speed and acceleration to some of them, its own
joints, its tip, and where the ball will be from there. It answers with a share of the motion that each joint can make
in the next frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from kinreach._checks import Floats
from kinreach._tensors import like, namespace
from kinreach.baselines.random_arms import ur5
from kinreach.envs.inside import moving

#: Numbers of last sights that speeds and accelerations are fitted to, and sights whose places are features.
WINDOWS, PLACES = (3, 5, 8, 12), 12
#: Which fitted speed forecasts the ball, and how far ahead [s].
FORECASTING, AHEAD = 2, (0.05, 0.15, 0.3, 0.5)
#: Frames after which the first clock stands still; the second does when sights are no longer repeated.
FIRST_FRAMES = 10
#: Speeds and accelerations, places, the last sight, clocks, joints, the tip, forecasts, the ball's speed.
FEATURES = 4 * len(WINDOWS) + 2 * (PLACES - 1) + 2 + 2 + 12 + 6 + 2 * len(AHEAD) + 1
#: Keeps the fit of an acceleration to few sights finite, and the slope of a root where the ball is at rest [m^2/s^2].
PRIOR, TINY = 1e-10, 1e-10


def sight_fits(sights: int, delay: float) -> Floats:
    """Return how fitted speeds and accelerations depend on earlier sights relative to the last.

    Until the delay has passed, sights show where the ball began; of these only the latest is used. Later there is one
    in every frame: after one was missed (the options `hidden` and `dropped`) speeds and accelerations are wrong as long
    as a window has a sight that was reported again.

    Args:
        sights: That are observed, as the option of `kinreach/Moving-v0`.
        delay: Age of a sight [s].

    Returns:
        Shape (sights, 2 * len(WINDOWS), sights - 1), after 0, 1, ... frames; the last is of all later frames, too. Rows
        are the speeds [1/s] of the windows, then their accelerations [1/s^2]; columns are sights, the latest first.
    """
    taken = np.maximum(np.arange(sights) / moving.FRAMES - delay, 0.0)
    first, count = int((taken == 0.0).sum()) - 1, len(WINDOWS)
    fits = np.zeros((sights, 2 * count, sights - 1))
    for frame in range(sights):
        for row, window in enumerate(WINDOWS):
            used = np.arange(max(frame - window + 1, first), frame + 1)
            t, columns = taken[used] - taken[frame], frame - used[:-1] - 1
            A = np.column_stack([np.ones_like(t), t, t**2 / 2.0])
            if len(used) >= 2:
                fits[frame, row, columns] = np.linalg.pinv(A[:, :2])[1, :-1]
            if len(used) >= 3:
                fits[frame, count + row, columns] = np.linalg.solve(A.T @ A + np.diag([0, 0, PRIOR]), A.T)[2, :-1]
    return fits


@dataclass(frozen=True, eq=False)
class Steering:
    """Features of observations, and actions from shares of the possible motion.

    Attributes:
        fits: As `sight_fits` returns them.
        low, high: Bounds of the targets [rad], shape (6,).
    """

    fits: Any
    low: Any
    high: Any

    @property
    def inputs(self) -> int:
        """Numbers of an observation."""
        return moving.RATES.stop + 3 * int(self.fits.shape[2])

    def features(self, x: Any) -> Any:
        """Return features, shape (n, FEATURES), of observations, shape (n, m)."""
        xp, count = namespace(x), len(WINDOWS)
        seen, q, v = x[:, moving.BALL][:, :2], x[:, moving.ANGLES], x[:, moving.RATES]
        earlier = x[:, moving.RATES.stop : self.inputs].reshape(len(x), -1, 3)[:, :, :2]
        first = earlier[:, -1:]  # it is repeated until there are as many sights
        frames = (earlier != first).any(2).sum(1) + (first != 0.0).any(2).sum(1)
        fitted = self.fits[frames] @ earlier
        speed = fitted[:, FORECASTING]
        clocks = frames[:, None] / like(x, np.array([FIRST_FRAMES, len(self.fits) - 1.0]))
        T = ur5().fk(q)
        groups = (
            fitted[:, :count] * 2.0,
            xp.tanh(fitted[:, count:] / 10.0) * 2.0,
            xp.tanh(earlier[:, : PLACES - 1] * 10.0),
            (seen - like(x, table_middle())) * 5.0,
            xp.clip(clocks, None, 1.0),
            q - like(x, ur5().arm.home),
            v * 0.5,
            T[:, :3, 3] * 3.0,
            T[:, :3, 2],
            *((seen - T[:, :2, 3] + time * speed) * 5.0 for time in AHEAD),
            xp.sqrt((speed**2).sum(1) + TINY) * 2.0,
        )
        return xp.concatenate([group.reshape(len(x), -1) for group in groups], 1)

    def actions(self, x: Any, share: Any) -> Any:
        """Return actions, shape (n, 6), from shares of the possible motion, likewise, and observations."""
        targets = moving.steered(x[:, moving.ANGLES], x[:, moving.RATES], share, **self._limits)
        return namespace(x).clip(targets, like(x, self.low), like(x, self.high)) / math.pi

    def spread(self, x: Any) -> Any:
        """Return by how much actions grow with a share, shape (n, 6), after observations."""
        down, up = moving.motion_range(x[:, moving.ANGLES], x[:, moving.RATES], **self._limits)
        return (up - down) / (2.0 * math.pi)

    @property
    def _limits(self) -> dict[str, Any]:
        arm = ur5().arm
        return {"speed": arm.speed_limit, "acceleration": arm.acceleration_limit}


@cache
def table_middle() -> Floats:
    """Return the middle of the area that balls roll over [m], shape (2,)."""
    region: Any = ur5().arm.workcell.goals
    return np.array([sum(region.x) / 2.0, sum(region.y) / 2.0])
