"""A stronger model-based rival for the task `moving`, and how many of its touches are free of collisions.

    python -m benchmarks.studies.interceptor                     # the table
    python -m kinreach.compare --task moving --methods benchmarks.studies.interceptor:Interceptor,interception,ppo

`TurnRate` is the package's `interception` with another forecast: constant speed and constant turn rate. `Interceptor`
has another planner too: the tip has to be at the ball, the tool only within `TILT` of straight down, and the arm may
pass the ball at any speed. Both know the sights, their noise and the limits of the joints, not the circles' radius.
Kinematics only: no contact, no friction, no real robot.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.studies.tables import head, line, share
from kinreach._checks import Floats, check_count
from kinreach.baselines._expert import tool_down_postures
from kinreach.baselines._loop import Policy, as_policy, rollout
from kinreach.cli import Parser, finish
from kinreach.compare._methods.interception import Interception
from kinreach.compare._task import get_task
from kinreach.envs import _moving as ball
from kinreach.envs._moving import moved
from kinreach.kinematics import CollisionChecker

PROG = "python -m benchmarks.studies.interceptor"
PART = 1.0 / (ball.FRAMES * ball.PARTS)


class TurnRateFit:
    """Constant speed and turn rate, fitted to the longest run of last sights that agrees with the noise.

    With places as complex numbers, p(t) = p0 + v0 (exp(i w t) - 1) / (i w), which is linear in p0 and v0: each turn
    rate w of a grid is one linear least-squares problem, and all windows share its sums.

    Args:
        noise: Standard deviation of a coordinate of a sight [m].
    """

    #: Turn rates that are tried [rad/s]; standard deviation of the sideways acceleration before any sight [m/s^2].
    RATES = np.linspace(-20.0, 20.0, 402)
    SIDEWAYS = 2.0

    def __init__(self, noise: float) -> None:
        self._noise = max(noise, 1e-6)
        self._times: list[float] = []
        self._places: list[complex] = []

    def see(self, time: float, place: Floats) -> None:
        """A sight [m] that was taken at a time [s], not before the last one."""
        self._times.append(time)
        self._places.append(complex(place[0], place[1]))

    def forecast(self, ahead: Floats) -> Floats:
        """Where the ball will be [m], shape (n, 3), so long after the last sight [s], shape (n,); z is 0."""
        p0, v0, rate = self._fit()
        z = p0 + v0 * _arc(rate, ahead)
        return np.column_stack([z.real, z.imag, np.zeros(len(ahead))])

    def _fit(self) -> tuple[complex, complex, float]:
        """Place and velocity at the last sight, as complex numbers, and the turn rate."""
        last = self._places[-1]
        t, z = np.array(self._times[::-1]) - self._times[-1], np.array(self._places[::-1]) - last
        if t[-1] > -1e-3:
            return last, 0j, 0.0
        *_, costs = self._solve(self.RATES, t, z)
        best = (last, 0j, 0.0)
        for count in range(int((t > -1e-3).sum()) + 1, len(t) + 1):
            index = int(np.clip(costs[:, count - 1].argmin(), 1, len(self.RATES) - 2))
            left, middle, right = costs[index - 1 : index + 2, count - 1]  # the least of a parabola through three
            step = np.clip((left - right) / max(2.0 * (left - 2.0 * middle + right), 1e-12), -1.0, 1.0)
            rate = self.RATES[index] + step * (self.RATES[1] - self.RATES[0])
            p0, v0, misses, _ = (values[0, -1] for values in self._solve(np.array([rate]), t[:count], z[:count]))
            freedom = max(2 * count - 5, 1)
            if best[1] and misses > freedom + 4.0 * math.sqrt(2.0 * freedom):
                break
            best = (last + p0, v0, float(rate))
        return best

    def _solve(self, rates: Floats, t: Floats, z: Any) -> tuple[Any, Any, Floats, Floats]:
        """p0, v0, squared misses in units of the noise, and these with the prior, by turn rate and window."""
        b = _arc(rates[:, None], t)
        n = np.arange(1, len(t) + 1)
        B, BB = np.cumsum(b, axis=1), np.cumsum(np.abs(b) ** 2, axis=1)
        Z, ZZ, BZ = np.cumsum(z), np.cumsum(np.abs(z) ** 2), np.cumsum(b.conj() * z, axis=1)
        v0 = (BZ - B.conj() * Z / n) / np.maximum(BB - np.abs(B) ** 2 / n, 1e-12)
        p0 = (Z - v0 * B) / n
        misses = np.maximum(ZZ - (p0.conj() * Z + v0.conj() * BZ).real, 0.0) / self._noise**2
        return p0, v0, misses, misses + (np.abs(v0) * rates[:, None] / self.SIDEWAYS) ** 2


def _arc(rate: Any, t: Floats) -> Any:
    """(exp(i w t) - 1) / (i w)."""
    half = np.asarray(rate * t) / 2.0
    return t * np.sinc(half / math.pi) * np.exp(1j * half)


class TurnRate(Interception):
    """The package's interception, forecasting by constant speed and turn rate."""

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        """Another ball."""
        super().reset(observation, info)
        self._filter: Any = TurnRateFit(self._env.noise)


class Interceptor(TurnRate):
    """Meets the ball as soon as the joints' limits allow, in passing, the tool within `TILT` of straight down."""

    #: [rad]; how far ahead it looks [frames]; what is left of the limits at first, and what a radian weighs [m].
    TILT, FRAMES, MARGINS, LEVER = 0.15, 39, (0.94, 1.0), 0.1

    def act(self, observation: Any) -> Floats:
        """Towards the earliest meeting."""
        age, q, v = float(observation[ball.AGE]), observation[ball.ANGLES], observation[ball.RATES]
        self._filter.see(self._time - age, observation[ball.BALL])
        self._time += 1.0 / ball.FRAMES
        parts = ball.PARTS * np.arange(1, self.FRAMES + 1)
        places = self._filter.forecast(age + parts * PART)
        places[:, 2] = self._env.height
        area = self._env.arm.workcell.goals
        low, high = np.array([area.x, area.y]).T
        gone = ((places[:, :2] < low) | (places[:, :2] > high)).any(axis=1)
        count = max(int(gone.argmax()) if gone.any() else len(gone), 4)
        down = tool_down_postures(self._kinematics, places[:count])
        start = np.where(np.isfinite(down), down, q)
        for margin in self.MARGINS:
            postures, misses = self._nearest(*self._bounds(q, v, parts[:count], margin), places[:count], start)
            if misses.min() < 1e-3:
                break
        at = int((misses < 1e-3).argmax()) if misses.min() < 1e-3 else int(misses.argmin())
        return self._command(q, v, postures[at], int(parts[at])) / math.pi

    def _bounds(self, q: Floats, v: Floats, parts: Any, margin: float) -> tuple[Floats, Floats]:
        """Least and greatest angles that the joints can have after parts of a frame, each of shape (n, 6)."""
        gain = margin * self._env.acceleration_limit * PART * np.arange(1, parts[-1] + 1)[:, None]
        limit = self._env.speed_limit
        least, most = (
            q + PART * np.cumsum(np.clip(v + side * gain, -limit, limit), axis=0)[parts - 1] for side in (-1, 1)
        )
        return np.clip(least, -math.pi, math.pi), np.clip(most, -math.pi, math.pi)

    def _nearest(self, low: Floats, high: Floats, places: Floats, start: Floats) -> tuple[Floats, Floats]:
        """Postures within bounds whose tips are nearest to places, and what they miss [m], tilt weighed in."""
        q = np.clip(start, low, high)
        best, least = q, np.full(len(q), np.inf)
        for _ in range(12):
            T, J = self._kinematics.fk(q), self._kinematics.jacobian(q)
            tilt = np.arccos(np.clip(-T[:, 2, 2], -1.0, 1.0))
            beyond = np.maximum(tilt - 0.9 * self.TILT, 0.0)
            error = np.zeros((len(q), 6))
            error[:, :3] = places - T[:, :3, 3]
            turn = np.cross(T[:, :3, 2], (0.0, 0.0, -1.0))
            error[:, 3:] = self.LEVER * turn * (beyond / np.maximum(tilt, 1e-9))[:, None]
            missed = np.linalg.norm(error[:, :3], axis=1) + self.LEVER * np.maximum(tilt - self.TILT, 0.0)
            better = missed < least
            best, least = np.where(better[:, None], q, best), np.minimum(missed, least)
            J[:, 3:] *= self.LEVER * (beyond > 0.0)[:, None, None]
            pull = np.einsum("nij,ni->nj", J, error)
            held = ((q >= high) & (pull > 0.0)) | ((q <= low) & (pull < 0.0))
            J = np.where(held[:, None], 0.0, J)
            H = J @ J.transpose(0, 2, 1) + 1e-4 * np.eye(6)
            step = np.einsum("nij,ni->nj", J, np.linalg.solve(H, error[:, :, None])[:, :, 0])
            q = np.clip(q + np.clip(step, -0.5, 0.5), low, high)
        return best, least

    def _command(self, q: Floats, v: Floats, goal: Floats, parts: int) -> Floats:
        """Angles to go to, so that each joint passes its goal after parts of a frame."""
        low, high, joints = np.full(6, -math.pi), np.full(6, math.pi), np.arange(6)
        limits = {"speed": self._env.speed_limit, "acceleration": self._env.acceleration_limit}
        for _ in range(3):  # where a joint is then grows with the angle that it goes to
            tried = np.linspace(low, high, 33)
            end, speed = np.tile(q, (33, 1)), np.tile(v, (33, 1))
            for _ in range(parts):
                end, speed = moved(end, speed, tried, PART, **limits)
            first = (end < goal - 1e-6).sum(axis=0)
            low, high = tried[np.maximum(first - 1, 0), joints], tried[np.minimum(first, 32), joints]
        return np.asarray(high)


#: What is measured beside each other, by the names of the table.
METHODS: Mapping[str, Any] = {
    "interception": Interception,
    "interception, forecast by turn rate": TurnRate,
    "interceptor": Interceptor,
    "ppo": get_task("moving").methods["ppo"].make,
}


def cells(name: str, speed: float, balls: int, seed: int) -> tuple[str, str]:
    """Shares of balls that a method touches, and touches without a collision on its way; the same balls for all."""
    task = get_task("moving")
    env = gym.make(task.environment, **{**task.options, "speeds": (speed,)})
    policy: Policy = as_policy(METHODS[name](env))
    checker = CollisionChecker("ur5")
    ways: list[list[Floats]] = []

    def watch(_: Any, info: Mapping[str, Any]) -> None:
        if info["time"] == 0.0:
            ways.append([])
        ways[-1].append(np.array(info["q"]))

    touched = [trial["reached"] for trial in rollout(env, policy, task.resets(balls, seed, env), watch=watch)]
    free = [hit and not any(map(checker.in_collision, way)) for hit, way in zip(touched, ways, strict=True)]
    return share(sum(touched), balls), share(sum(free), balls)


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--speeds", type=float, nargs="+", default=[0.2, 0.4, 0.6], help="[m/s] (default: %(default)s)")
    parser.add_argument("--balls", type=int, default=180, help="at each speed (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=100, help="of the balls (default: %(default)s)")
    arguments = parser.parse_args(argv)
    check_count("--balls", arguments.balls)
    check_count("--seed", arguments.seed, least=0)
    columns = [
        f"{speed:g} m/s: {what}" for speed in arguments.speeds for what in ("touched, %", "without collision, %")
    ]
    print(head("method", *columns))
    for name in METHODS:
        found = [cells(name, speed, arguments.balls, arguments.seed) for speed in arguments.speeds]
        print(line(name, *(cell for pair in found for cell in pair)), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
