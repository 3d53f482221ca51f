"""Divide the distance after a move into parts of seeing, deciding and moving.

The way from the goal to the tip has three steps: to where the goal was seen, to where forward kinematics puts the tip
in the commanded posture, and to where the tip is in the simulation. A part is a step's component along the line from
the goal to the tip. The parts sum to the distance; a part is negative if its step leads back towards the goal.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from kinreach._checks import Floats
from kinreach._statistics import MEAN, QUANTILES, Column, Trial

#: Title of the table.
BUDGET_TABLE = "Where the distance comes from"
#: What the numbers of a budget mean, for people.
BUDGET_MEANING = "component of each error along the line from the goal to the tip, mean over completed moves"


class Budget(NamedTuple):
    """Parts of one distance [m]; their sum is the distance."""

    seeing: float
    deciding: float
    moving: float


def budget(goal: Floats, seen: Floats, meant: Floats, tip: Floats) -> Budget:
    """Divide the distance from the goal to the tip into its parts; all points in the world [m], shape (3,).

    The goal is `seen` somewhere, and the tip would be where it is `meant` to be in the commanded posture.
    """
    whole = tip - goal
    distance = float(np.linalg.norm(whole))
    if distance == 0.0:
        return Budget(0.0, 0.0, 0.0)
    direction = whole / distance
    return Budget(*(float(step @ direction) for step in (seen - goal, meant - seen, tip - meant)))


def completed(trial: Trial) -> bool:
    return not trial["impossible"]


def ik_error_mm(trial: Trial) -> float | None:
    """Return the distance of the commanded posture, by forward kinematics, from the seen goal [mm]."""
    return None if trial["status"] == "forfeited" else _between(trial, "target_tip", "seen")


def seen_error_mm(trial: Trial) -> float | None:
    """Return the error of the cameras [mm]; None if they did not see the goal."""
    return _between(trial, "seen", "goal") or None


def _between(trial: Trial, start: str, end: str) -> float | None:
    a, b = trial.get(start), trial.get(end)
    return None if a is None or b is None else 1e3 * float(np.linalg.norm(np.subtract(a, b)))


def _part(name: str) -> Callable[[Trial], float | None]:
    def value(trial: Trial) -> float | None:
        points = [trial.get(point) for point in ("goal", "seen", "target_tip", "tip")]
        if not completed(trial) or any(point is None for point in points):
            return None
        return 1e3 * getattr(budget(*map(np.array, points)), name)

    return value


def _moved(trial: Trial) -> float | None:
    return _between(trial, "tip", "target_tip") if completed(trial) else None


def _distance(trial: Trial) -> float | None:
    return None if _part("seeing")(trial) is None else 1e3 * trial["distance"]


BUDGET_COLUMNS = (
    Column("ik_error_mm", ik_error_mm, QUANTILES, "posture's own\nerror, mm", table=BUDGET_TABLE),
    Column("move_error_mm", _moved, QUANTILES, "controller's\nerror, mm", table=BUDGET_TABLE),
    Column("budget_mm.seeing", _part("seeing"), MEAN, "seeing\nmm", "mean", BUDGET_TABLE),
    Column("budget_mm.deciding", _part("deciding"), MEAN, "+ deciding\nmm", "mean", BUDGET_TABLE),
    Column("budget_mm.moving", _part("moving"), MEAN, "+ moving\nmm", "mean", BUDGET_TABLE),
    Column("budget_mm.distance", _distance, MEAN, "= distance\nmean mm", "mean", BUDGET_TABLE),
)
