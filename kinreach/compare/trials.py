"""One method on one goal: what was asked, what came out, how long it took."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from math import isfinite
from typing import Any, Self

#: `Trial.status` of a move that arrived, and of a goal that the methods were not asked for because no camera saw it.
COMPLETED, UNSEEN = "completed", "no ball found"


@dataclass(frozen=True)
class Trial:
    """What one method did with one goal, whatever the task.

    Attributes:
        goal: Index of the goal.
        method: Name of the method.
        x, y, z: The goal in the world frame [m].
        reached: The task's own criterion.
        impossible: The arm could not do what was asked, or nothing was asked of it; `status` has the cause.
        status: How it ended, in a word or two.
        reason: Why it was impossible in a sentence, else empty.
        distance: From the tip to the goal in the end, in the simulation [m].
        reward: The task's reward.
        solve_s: Wall time of all decisions [s]; None where the method was not asked.
        move_s: Simulated time of what the arm did [s]; None where it was not completed.
        q: A posture [rad]: the one that was commanded last, None where none was; or that at the end of an episode.
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
    reward: float
    solve_s: float | None
    move_s: float | None
    q: tuple[float, ...] | None

    @property
    def completed(self) -> bool:
        """Whether the distance counts: the arm did what the task asks for, however near the goal that was."""
        return not self.impossible

    def to_json(self) -> str:
        """One line of JSON."""
        return json.dumps(asdict(self), allow_nan=False)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """The trial that `to_json` wrote; a missing value raises `KeyError`, one of another type `TypeError`."""
        return cls(**{field.name: _checked(field.name, str(field.type), values[field.name]) for field in fields(cls)})


def _checked(name: str, kind: str, value: Any) -> Any:
    """A value that is of its field's type; what JSON has made a list is a tuple again."""
    wanted, _, optional = kind.partition(" | ")
    if value is None and optional:
        return None
    if wanted.startswith("tuple") and isinstance(value, list):
        return tuple(_checked(name, "float", entry) for entry in value)
    if wanted == "float" and type(value) in (int, float) and isfinite(value):
        return float(value)
    if type(value) is not {"int": int, "bool": bool, "str": str}.get(wanted):
        raise TypeError(f"{name} must be of type {kind}")
    return value


@dataclass(frozen=True)
class ReachTrial(Trial):
    """A goal that was to be reached by moving to a posture.

    It is impossible where no camera found the ball, no posture was found, or the arm could not execute it; then the
    distance is that from where the arm stands, and without a move that is the start posture. The reward is that of the
    last move if there are several.

    Attributes:
        posture_error: The thesis's r_e [rad] of the posture the arm is in after the move; None where the task has none.
        ik_error: Distance from the tip to the position that the method was told by forward kinematics, in the posture
            that it commanded last [m]; None where it commanded none.
        iterations: Steps of an iterative solver, or decisions of a policy. This and the next three are None where the
            method was not asked, as no camera found the ball.
        restarts: Fresh seeds that the solver tried.
        candidates: How many postures the acceptance test was asked about.
        accept_s: Wall time of acceptance tests, a part of `solve_s` [s].
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

    posture_error: float | None
    ik_error: float | None
    iterations: int | None
    restarts: int | None
    candidates: int | None
    accept_s: float | None
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


@dataclass(frozen=True)
class EpisodeTrial(Trial):
    """An episode of the button task.

    It is reached, and completed, if the button was pressed; impossible if the simulation diverged. The reward is the
    sum over the episode.

    Attributes:
        steps: Of the episode; that many decisions took `solve_s`.
        wrong_presses: Presses away from the target.
        energy: Sum over joints and time of torque^2 dt [N^2 m^2 s].
    """

    steps: int
    wrong_presses: int
    energy: float

    @property
    def completed(self) -> bool:
        """Whether the button was pressed."""
        return self.reached
