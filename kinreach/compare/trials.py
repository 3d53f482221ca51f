"""One method on one goal: what was asked, what came out, how long it took."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

#: `Trial.status` of a move that arrived, and of a goal that the methods were not asked for because no camera saw it.
COMPLETED, UNSEEN = "completed", "no ball found"


@dataclass(frozen=True)
class Trial:
    """What one method did with one goal.

    Attributes:
        goal: Index of the goal.
        method: Name of the method.
        x, y, z: The goal in the world frame [m].
        reached: The task's own criterion.
        impossible: No camera found the ball, no posture was found, or the arm could not execute it.
        status: How it ended: `COMPLETED`, or in a word or two what made it impossible.
        reason: Why it was impossible in a sentence, else empty.
        distance: From the tip to the goal after the last move, in the simulation [m]; without one, from the start
            posture.
        posture_error: The thesis's r_e [rad] of the posture the arm is in after the move; None where the task has none.
        reward: The task's reward, that of the last move if there are several.
        ik_error: Distance from the tip to the position that the method was told by forward kinematics, in the posture
            that it commanded last [m]; None where it commanded none.
        iterations: Steps of an iterative solver, or decisions of a policy. This and the next four are None where the
            method was not asked, as no camera found the ball.
        restarts: Fresh seeds that the solver tried.
        candidates: How many postures the acceptance test was asked about.
        solve_s: Wall time of all decisions, acceptance tests included [s].
        accept_s: Of which in acceptance tests [s].
        move_s: Simulated time of all moves [s]; None where the last one was not completed.
        q: Posture that was commanded last [rad]; None where none was found.
        seen_x, seen_y, seen_z: Where the cameras saw the goal, the mean of what both say, in the world [m]; None where
            no camera found it, or where the method was told the true position.
        seen_error: Distance of that from the goal [m]; None likewise.
        look_s: Wall time of the look, not part of `solve_s` [s]; None where the method was told the true position.
        view: Where each camera saw the goal, in its own frame [m], zeros for one that did not; None where nobody
            looked.
        move_error: Distance from the tip to where forward kinematics puts it in the posture that was commanded [m].
            This and the next three are None where the last move was not completed.
        seeing, deciding, moving: Parts of `distance` [m], see `kinreach.compare.budget`.
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
    ik_error: float | None
    iterations: int | None
    restarts: int | None
    candidates: int | None
    solve_s: float | None
    accept_s: float | None
    move_s: float | None
    q: tuple[float, ...] | None
    seen_x: float | None = None
    seen_y: float | None = None
    seen_z: float | None = None
    seen_error: float | None = None
    look_s: float | None = None
    view: tuple[float, ...] | None = None
    move_error: float | None = None
    seeing: float | None = None
    deciding: float | None = None
    moving: float | None = None

    def to_json(self) -> str:
        """One line of JSON."""
        return json.dumps(asdict(self), allow_nan=False)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Trial:
        """The trial that `to_json` wrote; a missing value raises `KeyError`."""
        known = {field.name: values[field.name] for field in fields(cls)}
        return cls(**{**known, **{name: None if known[name] is None else tuple(known[name]) for name in ("q", "view")}})
