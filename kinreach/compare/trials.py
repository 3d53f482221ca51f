"""One method on one goal: what was asked, what came out, how long it took."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

#: `Trial.status` of a move that arrived.
COMPLETED = "completed"


@dataclass(frozen=True)
class Trial:
    """What one method did with one goal.

    Attributes:
        goal: Index of the goal.
        method: Name of the method.
        x, y, z: The goal in the world frame [m].
        reached: The task's own criterion.
        impossible: No posture was found, or the arm could not execute it.
        status: How it ended: `COMPLETED`, or in a word or two what made it impossible.
        reason: Why it was impossible in a sentence, else empty.
        distance: From the tip to the goal after the move, in the simulation [m]; without one, from the start posture.
        posture_error: The thesis's r_e [rad] of the posture the arm is in after the move; None where the task has none.
        reward: The task's reward.
        ik_error: Distance from the tip to the goal by forward kinematics, in the posture that the method gave [m].
        iterations, restarts: As the solver counted them.
        candidates: How many postures the acceptance test was asked about.
        solve_s: Wall time of the solve, acceptance tests included [s].
        accept_s: Of which in acceptance tests [s].
        move_s: Simulated time of the move [s]; None where no move was completed.
        q: Posture that was commanded [rad]; None where none was found.
    """

    goal: int
    method: str
    x: float
    y: float
    z: float
    reached: bool
    impossible: bool
    status: str
    reason: str
    distance: float
    posture_error: float | None
    reward: float
    ik_error: float
    iterations: int
    restarts: int
    candidates: int
    solve_s: float
    accept_s: float
    move_s: float | None
    q: tuple[float, ...] | None

    def to_json(self) -> str:
        """One line of JSON."""
        return json.dumps(asdict(self), allow_nan=False)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Trial:
        """The trial that `to_json` wrote; a missing value raises `KeyError`."""
        known = {field.name: values[field.name] for field in fields(cls)}
        return cls(**{**known, "q": None if known["q"] is None else tuple(known["q"])})
