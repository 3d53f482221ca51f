"""Draw futures of a rolling ball that agree with its sights, for methods that plan for many of them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from kinreach._checks import Floats
from kinreach.compare._methods.turn_rate import RATES, TurnRateFit, arc
from kinreach.envs.inside import moving as ball

#: Speeds of a ball that has not been seen to move [m/s].
SPEEDS = (0.1, 1.3)
#: Steps of a drawn path [s].
STEP = 1.0 / 60.0
#: How well the radius of a circle is known [m]; the least probability of a change of direction.
RADIUS_ERROR, LEAST_RANDOM = 0.004, 0.05
STRAIGHT, CIRCLE, RANDOM = range(3)


class Futures:
    """Draws of where a ball may be, by the ways of rolling of `kinreach/Moving-v0`.

    A ball rolls straight on, on a circle of the known radius, or with a sideways acceleration that changes at known
    times. Their probabilities follow from how well each explains all sights; of the third kind the present turn rate is
    that of the fit, and later accelerations are drawn. A ball that has not been seen to move rolls through the middle
    half of the area, or on a circle, at any speed of `SPEEDS`.

    Args:
        low, high: Corners of the area [m], each shape (2,).
        seed: Of the draws.
    """

    def __init__(self, low: Floats, high: Floats, seed: int = 0) -> None:
        self._low, self._high = low, high
        self._rng = np.random.default_rng(seed)

    def draw(self, fit: TurnRateFit, count: int, ahead: Floats) -> Floats:
        """Return places [m], shape (count, n, 2), at times after the last sight [s], shape (n,), in growing order."""
        places, velocities, rates, kinds = self._moving(fit, count) if fit.moving else self._resting(fit, count)
        z = places[:, None] + velocities[:, None] * arc(rates[:, None], ahead)
        changing = kinds == RANDOM
        given = places[changing], velocities[changing], rates[changing]
        drawn = self._rng.uniform(-ball.SIDEWAYS, ball.SIDEWAYS, (math.ceil(float(ahead[-1]) / ball.HOLD) + 1, count))
        z[changing] = self._changing(*given, drawn[:, changing], fit.last_time, ahead)
        return np.stack([z.real, z.imag], axis=2)

    def _changing(self, places: Any, velocities: Any, rates: Floats, drawn: Floats, since: float, ahead: Floats) -> Any:
        """Return places, as complex numbers, of balls whose sideways acceleration changes at known times.

        Args:
            places: At the last sight, as complex numbers, shape (n,).
            velocities: Likewise.
            rates: Turn rates until the first change [rad/s], shape (n,).
            drawn: Sideways accelerations after each change [m/s^2], shape (k, n).
            since: Time of the last sight after the first [s].
            ahead: Times after the last sight [s], shape (m,).
        """
        steps = math.ceil(float(ahead[-1]) / STEP) + 1
        path = np.empty((len(places), steps + 1), dtype=complex)
        path[:, 0] = places
        speeds, headings = np.abs(velocities), np.angle(velocities)
        holds = (np.floor((since + STEP * np.arange(steps)) / ball.HOLD) - math.floor(since / ball.HOLD)).astype(int)
        for step in range(steps):
            if step and holds[step] > holds[step - 1]:
                rates = drawn[holds[step] - 1] / speeds
            rates = self._inwards(path[:, step], headings, rates)
            path[:, step + 1] = path[:, step] + speeds * STEP * np.exp(1j * (headings + rates * STEP / 2.0))
            headings = headings + rates * STEP
        first = np.minimum((ahead / STEP).astype(int), steps - 1)
        return path[:, first] + (path[:, first + 1] - path[:, first]) * (ahead / STEP - first)

    def _moving(self, fit: TurnRateFit, count: int) -> tuple[Any, Any, Any, Any]:
        """Return places, velocities, turn rates and kinds that agree with the sights; complex numbers."""
        rng, seen, noise = self._rng, fit.seen, fit.noise
        p0, v0, misses = fit.of_all(np.append(RATES, 0.0))
        speeds = np.abs(v0)
        off = speeds[:-1] / np.maximum(np.abs(RATES), 1e-3) - ball.RADIUS
        circles = -0.5 * (misses[:-1] + (off / RADIUS_ERROR) ** 2)
        place, velocity, rate, window = fit.local()
        # a change of the acceleration in every hold is explained at the cost of its prior
        spread = fit.acceleration_error(window)
        holds = max(fit.last_time / ball.HOLD, 1.0)
        prior = holds * min(math.log(max(spread, 1e-9) * math.sqrt(math.tau) / (2.0 * ball.SIDEWAYS)), 0.0)
        evidence = np.array([-0.5 * misses[-1], circles.max(), -0.5 * max(2 * seen - 4, 0) + prior])
        shares = np.exp(evidence - evidence.max())
        shares = np.maximum(shares / shares.sum(), [0.0, 0.0, LEAST_RANDOM])
        kinds = rng.choice(3, size=count, p=shares / shares.sum())
        weights = np.exp(circles - circles.max())
        index = np.where(kinds == CIRCLE, rng.choice(len(RATES), size=count, p=weights / weights.sum()), len(RATES))
        local, speed = kinds == RANDOM, max(abs(velocity), 1e-3)
        rates = np.where(local, rate + spread / speed * rng.normal(size=count), np.append(RATES, 0.0)[index])
        used = np.where(local, window, seen)
        blur = noise * (rng.normal(size=(2, count)) + 1j * rng.normal(size=(2, count)))
        places = np.where(local, place, p0[index]) + blur[0] * 2.0 / np.sqrt(used)
        velocities = np.where(local, velocity, v0[index]) + blur[1] * math.sqrt(12.0) * ball.FRAMES / used**1.5
        return places, velocities, rates, kinds

    def _resting(self, fit: TurnRateFit, count: int) -> tuple[Any, Any, Any, Any]:
        """Return the same of a ball that has only been seen where it began."""
        rng, low, high = self._rng, self._low, self._high
        start, size = fit.local()[0], high - low
        speeds, kinds = rng.uniform(*SPEEDS, count), rng.integers(3, size=count)
        through = rng.uniform(low + size / 4.0, high - size / 4.0, (count, 2))
        headings = np.angle(through[:, 0] + 1j * through[:, 1] - start)
        # a circle of the known radius through the start; its centre is in the area, that far from the border
        angles, sides = rng.uniform(0.0, math.tau, (20, count)), rng.choice((-1.0, 1.0), count)
        centres = start + ball.RADIUS * np.exp(1j * angles)
        inside = self._inside(centres, ball.RADIUS)
        angle = angles[inside.argmax(axis=0), np.arange(count)]
        kinds = np.where((kinds == CIRCLE) & ~inside.any(axis=0), STRAIGHT, kinds)
        circling = kinds == CIRCLE
        headings = np.where(circling, angle + math.pi + sides * math.pi / 2.0, headings)
        rates = np.where(circling, sides * speeds / ball.RADIUS, 0.0)
        return np.full(count, start), speeds * np.exp(1j * headings), rates, kinds

    def _inside(self, places: Any, margin: Any) -> Any:
        """Return whether places, as complex numbers, are in the area, so far from its border [m]."""
        low, high = self._low + margin, self._high - margin
        return (places.real >= low[0]) & (places.real <= high[0]) & (places.imag >= low[1]) & (places.imag <= high[1])

    def _inwards(self, places: Any, headings: Floats, rates: Floats) -> Floats:
        """Return turn rates that lead towards the middle, of balls outside of the middle half of the area."""
        middle = complex(*(self._low + self._high) / 2.0)
        towards = np.sin(np.angle(middle - places) - headings)
        return np.where(self._inside(places, (self._high - self._low) / 4.0), rates, np.copysign(rates, towards))
