"""Numbers on the command line: poses and postures, as people type them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import MAX_ANGLE, shown
from kinreach.cli import complain
from kinreach.errors import InputError

#: Angles of more turns than this may be degrees.
MANY_TURNS = 3
#: Places of joints that slide may be millimetres beyond this [m].
MAX_SLIDE = 20.0


def numbers_of(flag: str, text: str, count: int) -> list[float]:
    """Return the numbers of a flag, separated by commas or spaces, also in URScript's brackets: p[...] or [...]."""
    bare = text.strip().removeprefix("p")
    bare = bare[1:-1] if bare[:1] + bare[-1:] == "[]" else text
    words, values = bare.replace(",", " ").split(), []
    wanted = "a number" if count == 1 else f"{count} numbers, separated by commas"
    for word in words:
        try:
            values.append(float(word))
        except ValueError:
            which = f": {shown(word)} is no number" if count > 1 else ""
            raise InputError(f"{flag} must be {wanted}, got {shown(text)}{which}") from None
    if len(values) != count:
        raise InputError(f"{flag} must be {wanted}, got {shown(text)}")
    return values


def pose_numbers_of(flag: str, text: str, *, strict: bool = False) -> list[float]:
    """Return the six numbers of a pose; one whose rotation vector may be in degrees gets a note, or is refused."""
    numbers = numbers_of(flag, text, 6)
    said = may_be_degrees(f"of {flag}", numbers[3:])
    if said and strict:
        raise InputError(said)
    if said:
        complain(f"note: {said}")
    return numbers


def may_be_degrees(of: str, rotation: Sequence[float]) -> str:
    """Say so if a rotation vector is longer than a turn; empty if it is not."""
    turns = float(np.linalg.norm(rotation)) / (2 * np.pi)
    said = f"the rotation vector {of} is {turns:.3g} turns long; rx, ry, rz are in radians, not degrees"
    return said if turns > 1.0 else ""


def posture_of(
    flag: str,
    text: str,
    count: int,
    *,
    degrees: bool,
    limits: Sequence[ArrayLike] = (),
    slides: ArrayLike = False,
) -> NDArray[np.float64]:
    """Return the joint angles of a flag [rad], within a turn, or within the limits of joints that turn farther.

    Joints that slide are typed in metres, and are within `MAX_SLIDE`.

    Those of joints that turn without end, whose limits are infinite, are within `MAX_ANGLE`.
    """
    angles = np.array(numbers_of(flag, text, count))
    slides = np.broadcast_to(slides, (count,))
    q = np.where(slides, angles, np.radians(angles)) if degrees else angles
    most = np.abs(np.array([np.full(count, 2.0 * np.pi), *limits])).max(axis=0).clip(max=MAX_ANGLE)
    most = np.where(slides, np.maximum(most, MAX_SLIDE), most)
    beyond = ~(np.abs(q) <= most + 1e-6)
    if beyond.any():
        joint = int(np.where(beyond, np.abs(q), 0.0).argmax())
        in_degrees = degrees and not slides[joint]
        unit = f"±{np.degrees(most[joint]):g} degrees" if in_degrees else f"±{most[joint]:.4g} rad"
        hint = "" if degrees else "; for degrees add --degrees"
        if slides[joint]:
            unit, hint = f"±{most[joint]:g} m", "; a joint that slides is in metres"
        raise InputError(f"{flag} must be within {unit}, got {angles[joint]:g}{hint}")
    many = (np.abs(q) > MANY_TURNS * 2.0 * np.pi) & ~slides
    if many.any() and not degrees:
        angle = q[many][0]
        turns = abs(angle) / (2.0 * np.pi)
        complain(f"note: {angle:g} rad of {flag} are {turns:.3g} turns; for degrees add --degrees")
    return q
