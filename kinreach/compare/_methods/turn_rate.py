"""Forecast a rolling ball by constant speed and constant turn rate, or none, fitted to its last sights."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from kinreach._checks import Floats

#: Turn rates that are tried [rad/s]; prior standard deviation of the sideways acceleration [m/s^2].
RATES, SIDEWAYS = np.linspace(-20.0, 20.0, 402), 2.0
#: Least standard deviation of a coordinate that is found [m], and over how many last sights it is.
MIN_NOISE, SIGHTS = 1e-4, 4
#: The median of their squared misses, a degree of freedom, is 0.79 of the variance (chi-squared with 3). By less the
#: noise is found larger than it is: long windows that are kept too long cost less than ones that are left too early.
MEDIAN_SQUARE = 0.53
#: Shares of the believed delay that are tried, the whole first, and with which numbers of sights. To be found, one must
#: miss by so many squares less than the believed one, in units of its own squares divided by the degrees of freedom.
DELAYS, FIRST_SIGHTS, BETTER = (1.0, *np.linspace(0.5, 1.8, 27).tolist()), range(6, 11), 100.0
#: Numbers of last sights that are fitted, beside all: some 20 % more each time.
WINDOWS = (3, 4, 5, 6, 7, 8, 10, 12, 14, 17, 20, 24, 30, 40, 60)


class TurnRateFit:
    """Fit constant speed and turn rate to the longest run of last sights that agrees with the noise.

    With places as complex numbers, p(t) = p0 + v0 (exp(i w t) - 1) / (i w), which is linear in p0 and v0: each turn
    rate w of a grid is one linear least-squares problem, and all windows share its sums. This is the text-book model of
    a coordinated turn (Bar-Shalom, Li and Kirubarajan 2001, chapter 11). Before its sights, a ball that rolls straight
    on is as likely as one that turns.

    Until the delay has passed, sights show where the ball began. A delay that differs much from what is believed is
    found if the ball moves within its first ten sights, from half of the belief to 1.8 times it.

    Args:
        noise: Standard deviation of a coordinate of a sight [m]; if None, it is found from what short fits miss.
    """

    def __init__(self, noise: float | None) -> None:
        self._known = noise is not None
        self._noise = MIN_NOISE if noise is None else max(noise, 1e-6)
        self._squares: list[float] = []
        self._observed: list[float] = []
        self._ages: list[float] = []
        self._age = 0.0
        self._delay = 1.0
        self._places: list[complex] = []

    @property
    def noise(self) -> float:
        """Standard deviation of a coordinate of a sight that is believed or was found [m]."""
        return self._noise

    @property
    def moving(self) -> bool:
        """Whether sights of two times have been seen, so that there is a speed."""
        times = self._times()
        return len(times) > 1 and times[-1] - times[0] > 1e-3

    @property
    def age(self) -> float:
        """Age of the last sight when it was last reported [s]."""
        return self._delay * self._age

    def see(self, time: float, place: Floats, age: float = 0.0) -> None:
        """Add a sight [m], shape (2,) or (3,), that is observed at a time [s] and believed to be so old [s].

        One that is reported again, because the ball is hidden, has only become older.
        """
        z, self._age = complex(place[0], place[1]), age
        if self._places and z == self._places[-1]:
            return
        self._observed.append(time)
        self._ages.append(age)
        self._places.append(z)
        if age > 0.0 and len(self._places) in FIRST_SIGHTS:
            self._find_delay()

    def _times(self) -> Floats:
        """Return when the sights were taken [s]."""
        return np.array(self._observed) - self._delay * np.array(self._ages)

    def _find_delay(self) -> None:
        """Find the share of the believed delay with which the first sights are those of one turn."""
        z, misses = np.array(self._places[::-1]) - self._places[-1], list[float]()
        least = (MIN_NOISE / self._noise) ** 2  # of the unit
        for delay in DELAYS:
            t = np.maximum(np.array(self._observed[::-1]) - delay * self._ages[-1], self._observed[0])
            misses.append(self._solve(RATES, t - t[0], z)[2][:, -1].min())
            if misses[0] <= BETTER * least:
                break  # none can miss by so much less
        best = int(np.argmin(misses))
        unit = max(misses[best] / (2 * len(z) - 6), least)
        delay = DELAYS[best] if misses[0] - misses[best] > BETTER * unit else 1.0
        if delay != self._delay:
            self._delay = delay
            self._squares.clear()  # misses of fits with another delay

    def forecast(self, ahead: Floats) -> Floats:
        """Return where the ball will be [m], shape (n, 2), at times after the last sight [s], shape (n,)."""
        p0, v0, rate, _ = self.local()
        z = p0 + v0 * arc(rate, ahead)
        return np.column_stack([z.real, z.imag])

    @property
    def seen(self) -> int:
        """Number of sights."""
        return len(self._places)

    @property
    def last_time(self) -> float:
        """When the last sight was taken, after the first [s]."""
        times = self._times()
        return float(times[-1] - times[0])

    def of_all(self, rates: Floats) -> tuple[Any, Any, Floats]:
        """Return place and velocity at the last sight, as complex numbers, if all sights are of one turn.

        And the squared misses in units of the noise; for turn rates [rad/s], each shape (n,).
        """
        times, last = self._times(), self._places[-1]
        p0, v0, misses, _ = self._solve(rates, times[::-1] - times[-1], np.array(self._places[::-1]) - last)
        return last + p0[:, -1], v0[:, -1], misses[:, -1]

    def acceleration_error(self, window: int) -> float:
        """Return the standard deviation of an acceleration that is fitted to so many last sights [m/s^2]."""
        t = self._times()[-max(window, 3) :] - self._times()[-1]
        A = np.column_stack([np.ones_like(t), t, t**2 / 2.0])
        return self._noise * math.sqrt(np.linalg.pinv(A.T @ A)[2, 2])

    def local(self) -> tuple[complex, complex, float, int]:
        """Return place and velocity at the last sight, as complex numbers, the turn rate, and the sights it is of."""
        last = self._places[-1]
        if not self.moving:
            return last, 0j, 0.0, len(self._places)
        times = self._times()
        t, z = times[::-1] - times[-1], np.array(self._places[::-1]) - last
        *_, misses, costs = self._solve(RATES, t, z)
        if not self._known and len(t) >= SIGHTS:
            self._squares.append(self._noise**2 * float(misses[:, SIGHTS - 1].min()) / (2 * SIGHTS - 5))
            before, self._noise = self._noise, max(MIN_NOISE, math.sqrt(np.median(self._squares) / MEDIAN_SQUARE))
            costs += misses * ((before / self._noise) ** 2 - 1.0)
        _, speeds, straight, _ = self._solve(np.zeros(1), t, z)
        best, least = (last, 0j, 0.0, 0), int((t > -1e-3).sum()) + 1
        for count in sorted({min(max(window, least), len(t)) for window in (least, *WINDOWS, len(t))}):
            rate = self._rate(costs[:, count - 1], straight[0, count - 1], abs(speeds[0, count - 1]))
            p0, v0, misses, _ = (values[0, -1] for values in self._solve(np.array([rate]), t[:count], z[:count]))
            freedom = max(2 * count - 5, 1)
            if best[1] and misses > freedom + 4.0 * math.sqrt(2.0 * freedom):
                break
            best = (last + p0, v0, float(rate), count)
        return best

    @staticmethod
    def _rate(costs: Floats, straight: float, speed: float) -> float:
        """Return the turn rate: 0 if a straight line is likelier than all turns together.

        Args:
            costs: Squared misses of each turn rate in units of the noise, with the prior.
            straight: Squared misses of the straight line.
            speed: [m/s].
        """
        least, spacing = costs.min(), RATES[1] - RATES[0]
        turns = np.exp((least - costs) / 2.0).sum() * spacing * max(speed, 1e-3) / (SIDEWAYS * math.sqrt(math.tau))
        if straight < least - 2.0 * math.log(turns):
            return 0.0
        index = int(np.clip(costs.argmin(), 1, len(RATES) - 2))
        left, middle, right = costs[index - 1 : index + 2]  # the least of a parabola through three
        step = np.clip((left - right) / max(2.0 * (left - 2.0 * middle + right), 1e-12), -1.0, 1.0)
        return float(RATES[index] + step * spacing)

    def _solve(self, rates: Floats, t: Floats, z: Any) -> tuple[Any, Any, Floats, Floats]:
        """Return p0, v0, squared misses in units of the noise, and these with the prior, by turn rate and window."""
        b = arc(rates[:, None], t)
        n = np.arange(1, len(t) + 1)
        B, BB = np.cumsum(b, axis=1), np.cumsum(np.abs(b) ** 2, axis=1)
        Z, ZZ, BZ = np.cumsum(z), np.cumsum(np.abs(z) ** 2), np.cumsum(b.conj() * z, axis=1)
        v0 = (BZ - B.conj() * Z / n) / np.maximum(BB - np.abs(B) ** 2 / n, 1e-12)
        p0 = (Z - v0 * B) / n
        misses = np.maximum(ZZ - (p0.conj() * Z + v0.conj() * BZ).real, 0.0) / self._noise**2
        return p0, v0, misses, misses + (np.abs(v0) * rates[:, None] / SIDEWAYS) ** 2


def arc(rate: Any, t: Floats) -> Any:
    """Return (exp(i w t) - 1) / (i w), the way in a time t [s] at a turn rate w [rad/s] of each velocity of 1."""
    half = np.asarray(rate * t) / 2.0
    return t * np.sinc(half / math.pi) * np.exp(1j * half)
