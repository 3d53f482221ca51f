"""What was singular in a posture of a UR-type arm, and what kept a target out of reach."""

from __future__ import annotations

from enum import IntFlag


class Singularity(IntFlag):
    """What was clamped, free or moved in a solution."""

    #: P5 lies on the cylinder of radius d4 around the first axis: both shoulder values are one.
    SHOULDER = 1
    #: sin q5 = 0: wrist_3 is parallel to the three middle axes, q6 was chosen.
    WRIST = 2
    #: The elbow is stretched or folded: both elbow values are one.
    ELBOW = 4
    #: q6 could not keep the caller's value and was moved to the nearest feasible one.
    MOVED = 8


class Miss(IntFlag):
    """Which part of the geometry kept a branch from reaching."""

    SHOULDER_CYLINDER = 1
    ELBOW_OUT = 2
    ELBOW_IN = 4
    RESIDUAL = 8


_MISS_TEXT = {
    Miss.SHOULDER_CYLINDER: "wrist centre inside the shoulder cylinder (closer to the first axis than d4)",
    Miss.ELBOW_OUT: "too far away for the stretched elbow",
    Miss.ELBOW_IN: "too close for the folded elbow",
    Miss.RESIDUAL: "a clamped solution misses the target by more than the tolerance",
}


def miss_text(miss: int) -> str:
    """What kept the arm from a target, in words; empty for no flags."""
    return "; ".join(text for flag, text in _MISS_TEXT.items() if miss & flag)
