"""Where one joint cannot stand, as a table over one or two others: collisions between links few joints apart.

Whether two links touch depends only on the joints between them. With up to three of those, the colliding positions of
one are an arc of the circle that depends on the other two (one or none, in all but a few postures of the UR5), and a
table of its ends is nearly as good as the meshes it was measured on, for the price of a look-up.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np

from kinreach.checks import Floats
from kinreach.kinematics.straight_line import Entry, apply

#: Whether a posture collides.
Collides = Callable[[Floats], bool]

TURN = 2 * np.pi
#: Positions of the joint at which a collision is looked for, and halvings of the last step to find an arc's ends:
#: arcs narrower than 0.26 rad may be missed, ends are known to 1 mrad.
SCAN = 24
HALVINGS = 8
#: Finest step of a table: positions of a joint that the look-up tells apart.
FINE = {1: 2048, 2: 128}


class Arcs(NamedTuple):
    """The question that a table answers.

    Attributes:
        joint: Index of the joint whose arc it is.
        over: Indices of the joints on which the arc depends, one or two.
        grid: At how many positions of each of those it is measured.
        averaged: Index of a joint on which it depends little: the mean of two positions is taken.
    """

    joint: int
    over: tuple[int, ...]
    grid: tuple[int, ...]
    averaged: int | None = None


class BlockedArcs:
    """The blocked arc of a joint as a table over others.

    Args:
        arcs: Which joint, over which.
        collides: Whether a posture collides, by the links in question.
        joints: Number of joints of the arm.
    """

    def __init__(self, arcs: Arcs, collides: Collides, joints: int) -> None:
        self.arcs = arcs
        middle, half = _measure(arcs, collides, joints)
        fine = FINE[len(arcs.over)]
        for axis in range(len(arcs.over)):
            middle, half = _refined(middle, axis, fine), _refined(half, axis, fine)
        self._size = fine + 1
        self._middle = np.angle(middle).astype(np.float32).ravel()
        self._open = np.where(half > 0.0, np.pi - half, TURN).astype(np.float32).ravel()

    def blocked(self, q: Sequence[Entry]) -> Entry:
        """Whether the joint stands in its blocked arc: a formula of the angles `q` within ±pi [rad]."""
        index: Entry = 0.0
        for joint in self.arcs.over:
            step = (self._size - 1) / TURN
            index = self._size * index + apply(np.rint, step * q[joint] + 0.5 * (self._size - 1))
        row = apply(_as_index, index)
        from_middle = apply(np.absolute, q[self.arcs.joint] - apply(self._middle.take, row))
        # pi minus the distance on the circle, without asking on which side of the cut at pi the two stand
        return apply(np.greater, apply(np.absolute, from_middle - np.pi), apply(self._open.take, row))


def _as_index(values: Floats) -> np.ndarray[tuple[int, ...], np.dtype[np.intp]]:
    return values.astype(np.intp)


def _measure(arcs: Arcs, collides: Collides, joints: int) -> tuple[np.ndarray, Floats]:
    """Middle (as a unit complex number) and half width [rad] of the arc on the grid; half is 0 where there is none."""
    middle, half = np.zeros(arcs.grid, dtype=np.complex128), np.zeros(arcs.grid)
    q = np.zeros(joints)

    def hit(angle: float) -> bool:
        q[arcs.joint] = angle
        return collides(q)

    for cell in product(*map(range, arcs.grid)):
        q[list(arcs.over)] = [TURN * k / size - np.pi for k, size in zip(cell, arcs.grid, strict=True)]
        for position in (0.0,) if arcs.averaged is None else (0.0, np.pi / 2):
            if arcs.averaged is not None:
                q[arcs.averaged] = position
            low, high = _blocked_arc(hit)
            middle[cell] += np.exp(0.5j * (low + high)) * (high > low)
            half[cell] += 0.5 * (high - low) * (1.0 if arcs.averaged is None else 0.5)
    while (middle == 0).any() and (
        middle != 0
    ).any():  # where there is no arc, the neighbours' middle is as good as any
        spread = sum(np.roll(middle, shift, axis) for shift in (-1, 1) for axis in range(middle.ndim))
        middle = np.where(middle == 0, spread, middle)
    return middle / np.maximum(np.abs(middle), 1e-300), half


def _blocked_arc(hit: Callable[[float], bool]) -> tuple[float, float]:
    """Ends of the arc outside the longest free one [rad]; equal if nothing is blocked."""
    step = TURN / SCAN
    hits = [k for k in range(SCAN) if hit(k * step - np.pi)]
    if not hits:
        return 0.0, 0.0
    gaps = [after - before for before, after in pairwise([*hits, hits[0] + SCAN])]
    widest = int(np.argmax(gaps))
    if gaps[widest] == 1:
        return -np.pi, np.pi
    last = hits[widest] * step - np.pi
    first = last + gaps[widest] * step - TURN
    return _edge(hit, first, first - step), _edge(hit, last, last + step)


def _edge(hit: Callable[[float], bool], inside: float, outside: float) -> float:
    for _ in range(HALVINGS):
        angle = 0.5 * (inside + outside)
        inside, outside = (angle, outside) if hit(angle) else (inside, angle)
    return 0.5 * (inside + outside)


def _refined(values: np.ndarray, axis: int, count: int) -> np.ndarray:
    """A periodic table on a finer grid of `count` steps, by linear interpolation; both ends are there."""
    size = values.shape[axis]
    position = np.arange(count + 1) * (size / count)
    low = np.floor(position).astype(int)
    shape = [-1 if k == axis else 1 for k in range(values.ndim)]
    weight = (position - low).reshape(shape)
    return values.take(low % size, axis) * (1.0 - weight) + values.take((low + 1) % size, axis) * weight
