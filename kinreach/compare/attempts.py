"""One method on one goal: its decisions with a clock, and the moves they lead to."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

from kinreach.checks import Floats
from kinreach.compare.deciding import Decision, Method
from kinreach.compare.tasks import ReachTask, Verdict
from kinreach.compare.trials import COMPLETED, UNSEEN
from kinreach.sim.simulation import ArmSimulation


class Attempt:
    """A method that is told of a goal, and what its decisions have taken so far.

    Args:
        method: Who attempts it.
        position, view: See `Method.about`.

    Attributes:
        method: Who attempts it.
        solve_s: Wall time of all decisions [s].
        accept_s: Of which in acceptance tests [s].
        iterations, restarts, candidates: As `Decision` counts them, over all decisions.
        decision: The latest one; to begin with nowhere.
    """

    def __init__(self, method: Method, position: Floats, view: Floats | None) -> None:
        self.method = method
        self.solve_s = self.accept_s = 0.0
        self.iterations = self.restarts = self.candidates = 0
        self.decision = Decision(None)
        self._decide = method.about(position, view)

    def decide(self, q: Floats) -> None:
        """Have the method decide, the arm standing in `q` [rad], shape (n,)."""
        start = time.perf_counter()
        self.decision = decision = self._decide(q)
        self.solve_s += time.perf_counter() - start
        self.accept_s += decision.accept_s
        self.iterations += decision.iterations
        self.restarts += decision.restarts
        self.candidates += decision.candidates


@dataclass(frozen=True, eq=False)
class Ending:
    """Where an attempt left the arm.

    Attributes:
        status: `COMPLETED`, or in a word or two why the last move was none.
        reason: The same in a sentence, else empty.
        q: The posture that was commanded last [rad], shape (n,); None if the last decision was none.
        tip: Position of the tip in the world [m], shape (3,).
        distance: From it to the goal [m].
        move_s: Simulated time of all moves [s].
        verdict: The task's.
    """

    status: str
    reason: str
    q: Floats | None
    tip: Floats
    distance: float
    move_s: float
    verdict: Verdict

    @property
    def impossible(self) -> bool:
        """Whether the last move was not completed."""
        return self.status != COMPLETED


def execute(task: ReachTask, simulation: ArmSimulation, goal: Floats, attempt: Attempt | None) -> Ending:
    """Move as decided, ask again as long as the method has moves left, and judge where the arm is then.

    After each move it is judged as the environments do; the verdict on the last one stands.

    Args:
        task: Judges.
        simulation: Is put back first: every attempt starts from the same state.
        goal: Where the goal truly is in the world [m], shape (3,).
        attempt: Has decided once, for the start posture; None where no camera found the ball.
    """
    simulation.reset()
    simulation.place_ball(goal)
    if attempt is None:
        return _ending(task, simulation, goal, UNSEEN, "no camera found the ball", None, 0.0)
    move_s = 0.0
    for moves_left in reversed(range(attempt.method.moves)):
        target = attempt.decision.q
        if target is None:
            return _ending(task, simulation, goal, attempt.decision.status, attempt.decision.reason, None, move_s)
        move = simulation.move(target, two_phase=attempt.method.two_phase)
        move_s += float(move.duration)
        status = COMPLETED if move.reached else move.status.value
        ending = _ending(task, simulation, goal, status, move.reason, target, move_s)
        if ending.verdict.reached or not moves_left:
            break
        attempt.decide(simulation.q)
    return ending


def _ending(
    task: ReachTask, simulation: ArmSimulation, goal: Floats, status: str, reason: str, q: Floats | None, move_s: float
) -> Ending:
    tip = simulation.tip_position
    x, y, z = (tip - goal).tolist()
    distance = math.sqrt(x * x + y * y + z * z)  # to the last bit what the environments say
    verdict = task.judge(distance, simulation.q, impossible=status != COMPLETED)
    return Ending(status, reason, q, tip, distance, move_s, verdict)
