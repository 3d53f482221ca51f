"""Which links touch what, by name."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Touch:
    """Two bodies in contact.

    Attributes:
        link: A link of the arm.
        other: An obstacle of the work cell, or another link.
        with_itself: Whether `other` is a link.
        depth: How far the two are inside each other [m].
    """

    link: str
    other: str
    with_itself: bool
    depth: float

    def __str__(self) -> str:
        if self.with_itself:
            return f"self-collision: {self.link} - {self.other}"
        return f"{self.link} touches {self.other}"


def touches(model: Any, data: Any, obstacles: Collection[str]) -> tuple[Touch, ...]:
    """Bodies in contact in the last computed step, deepest first, each pair once.

    Args:
        model: The scene.
        data: Its state; contacts are read, not computed.
        obstacles: Names of the bodies that are not links.
    """
    if data.ncon == 0:
        return ()  # making MuJoCo's list of contacts, even of none, takes longer than a step
    between: dict[tuple[int, int], float] = {}
    bodies = model.geom_bodyid[data.contact.geom].tolist()
    for (first, second), distance in zip(bodies, data.contact.dist.tolist(), strict=True):
        between[first, second] = max(between.get((first, second), 0.0), -distance)
    deepest: dict[tuple[str, str], float] = {}
    for (first, second), depth in between.items():
        a, b = model.body(first).name, model.body(second).name
        pair = (b, a) if a in obstacles else (a, b)
        deepest[pair] = max(deepest.get(pair, 0.0), depth)
    found = [Touch(link, other, other not in obstacles, depth) for (link, other), depth in deepest.items()]
    return tuple(sorted(found, key=lambda touch: -touch.depth))
