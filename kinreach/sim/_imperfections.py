"""Imperfections of real arms: friction, damping, an unknown load, noise of the encoders.

The controller ignores them: it plans for the ideal arm, and compensates its gravity.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from kinreach._checks import Floats, check_known, check_number, shown
from kinreach.errors import InputError

#: Largest values: all of a joint's torque, an arm's own weight, a turn that no servo bears.
LIMITS = {"friction": 1.0, "damping": 10.0, "payload": 100.0, "encoder_noise": 0.1}


@dataclass(frozen=True)
class Imperfections:
    """How far an arm is from an ideal one.

    Attributes:
        friction: Dry friction of every joint, as a share of its largest torque.
        damping: Viscous friction of every joint at 1 rad/s, as a share of its largest torque [s/rad]; beside the
            damping that the arm's description has.
        payload: Mass at the tip that is not compensated [kg].
        encoder_noise: Standard deviation of a servo's reading of its joint, drawn anew every 8 ms [rad].

    Raises:
        InputError: A value out of range.
    """

    friction: float = 0.0
    damping: float = 0.0
    payload: float = 0.0
    encoder_noise: float = 0.0

    def __post_init__(self) -> None:
        for entry in fields(self):
            check_number(entry.name, getattr(self, entry.name), least=0.0, most=LIMITS[entry.name])


IDEAL = Imperfections()


def as_imperfections(given: Imperfections | Mapping[str, float] | None) -> Imperfections:
    """Check imperfections, given as such or by name; None is an ideal arm."""
    if given is None:
        return IDEAL
    if isinstance(given, Imperfections):
        return given
    if not isinstance(given, Mapping):
        raise InputError(f"imperfections must be a mapping of {', '.join(LIMITS)}, got {shown(given)}")
    for name in given:
        check_known("imperfection", name, LIMITS)
    return Imperfections(**given)


def in_scene(flaws: Imperfections) -> Imperfections:
    """Return the imperfections without encoder noise: arms that differ in that alone share a scene."""
    return replace(flaws, encoder_noise=0.0)


def encoder_errors(sigma: float, start: Floats, target: Floats, periods: int) -> Floats:
    """Draw the encoder errors in each period of a move [rad], shape (periods, n).

    The generator follows from where the move starts and ends: the same move is the same again, alone or in a batch,
    and no other move has the same noise.
    """
    words: Any = np.concatenate([start, target]).view(np.uint32)
    return sigma * np.random.default_rng(words.tolist()).standard_normal((periods, len(target)))
