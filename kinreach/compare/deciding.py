"""What a method is to the comparison: something that is told of a goal and then says where the arm shall go.

A method that makes one move says so once. One that makes several is asked again after every move, until the task's
criterion is met or it has used up its moves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from kinreach.checks import Floats

#: What kinds of methods there are, and what each is given, in words, for the record beside the results.
SOLVER, POLICY, SEEDED = "solver", "policy", "seeded solver"
GIVEN: Mapping[str, str] = {
    SOLVER: "one position of the goal (the true one, or the cameras' mean), the start posture as the seed, and the "
    "acceptance test: a posture that it refuses sends the solver on to another branch or a random restart",
    POLICY: "what the environment's agent observes and nothing else: the goal in the front and in the wrist camera, "
    "joint angles, gripper opening; no acceptance test, no collision model, no second try, and the branch that "
    "training has settled on",
    SEEDED: "the policy's observation for the seed, then what a solver is given, with that seed instead of the start "
    "posture",
}


@dataclass(frozen=True, eq=False)
class Decision:
    """Where the arm shall go next, or why nowhere.

    Attributes:
        q: Target posture [rad], shape (n,); None where none was found.
        status: In a word or two, why there is none; empty where there is one.
        reason: The same in a sentence.
        iterations: Steps of an iterative solver, or 1 for a policy, whose step is one inference.
        restarts: Fresh seeds tried after the first.
        candidates: Postures that were put to the acceptance test.
        accept_s: Wall time of these tests [s].
    """

    q: Floats | None
    status: str = ""
    reason: str = ""
    iterations: int = 0
    restarts: int = 0
    candidates: int = 0
    accept_s: float = 0.0


#: The posture in which the arm stands [rad], shape (n,), to the decision made there.
Decide = Callable[[Floats], Decision]


class Method(Protocol):
    """One way to reach a goal."""

    @property
    def kind(self) -> str:
        """A key of `GIVEN`."""
        ...

    @property
    def moves(self) -> int:
        """How many moves it may make for one goal."""
        ...

    @property
    def two_phase(self) -> bool:
        """Whether the arm's last joints wait until the others have arrived, see `ArmSimulation.move`."""
        ...

    @property
    def versions(self) -> Mapping[str, str]:
        """What its answers depend on besides code and packages, by name: digests of files."""
        ...

    def about(self, position: Floats, view: Floats | None) -> Decide:
        """Be told of a goal; what this takes is not part of the time that a decision takes.

        Args:
            position: Where it is in the world [m], shape (3,): the truth, or the mean of what the cameras say.
            view: Where each of the two cameras saw it, in its own frame [m], shape (6,), zeros for one that did not;
                None where nobody looked and `position` is the truth.

        Raises:
            InputError: The goal is malformed, or the arm cannot serve it.
        """
        ...
