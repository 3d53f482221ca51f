"""Methods that decide on a posture, which the arm then moves to."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from rich.table import Table

from kinreach.compare.budget import MEANING
from kinreach.compare.budget_figure import draw_budget
from kinreach.compare.contest import Contest, Run
from kinreach.compare.deciding import GIVEN, Method
from kinreach.compare.methods import new_method, short_name
from kinreach.compare.observation import looking, what_is_told
from kinreach.compare.reach_figures import draw_errors, draw_success, draw_times
from kinreach.compare.reach_stage import ReachStage
from kinreach.compare.reach_tables import budget_table, methods_table, notes
from kinreach.compare.runner import run_trials
from kinreach.compare.settings import Settings
from kinreach.compare.strips import origin
from kinreach.compare.summary import summarise
from kinreach.compare.tasks import REACH_TASKS
from kinreach.compare.trials import ReachTrial
from kinreach.kinematics.solvers.base import ClosedFormSolver, Tolerance
from kinreach.sim.controller import TOLERANCE
from kinreach.sim.rendering import render
from kinreach.sim.simulation import ArmSimulation

#: What all of these tasks give every method alike.
_TERMS = {
    "tolerance": f"numeric solvers stop within {Tolerance().position:g} m and {Tolerance().orientation:g} rad",
    "execution": "from the start posture, in MuJoCo: one move, two-phase; a policy of several steps moves all joints "
    f"at once and decides after each move; a move is done when every joint rests within {TOLERANCE:g} rad",
    "timing": "methods take turns in random order on every goal after untimed warm-up decisions; one process, one "
    "thread, one goal at a time; a policy's time is that of its features and its network, summed over its decisions",
    "error_budget": f"seeing, deciding and moving: {MEANING}; the parts sum to the distance",
}


class ReachContest(Contest[ReachTrial]):
    """Solvers and policies on the same goals, told the same, executed alike."""

    trial = ReachTrial
    methods: Mapping[str, Method]
    figures = {  # noqa: RUF012 (declared by `Contest`)
        "errors": draw_errors,
        "success": lambda trials, results: draw_success(results),
        "times": draw_times,
        "budget": lambda trials, results: draw_budget(results, note=origin(results)),
    }

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        self._task = REACH_TASKS[settings.task]()
        self.methods = {short_name(name): new_method(self._task, name) for name in settings.methods}

    @contextmanager
    def trying(self) -> Iterator[Run[ReachTrial]]:
        """See `Contest.trying`."""
        task, settings = self._task, self.settings
        goals = task.goals(settings.goals, settings.seed)
        simulation = ArmSimulation(arm=task.arm_name)
        with looking(task, settings.camera, settings.seed) as look:
            yield lambda done: run_trials(task, self.methods, goals, simulation, look=look, done=done)

    def summarise(self, name: str, trials: Sequence[ReachTrial]) -> dict[str, Any]:
        """See `Contest.summarise`."""
        return summarise(name, self.methods[name].kind, trials)

    def terms(self) -> dict[str, str]:
        """See `Contest.terms`."""
        kinds = {method.kind for method in self.methods.values()}
        given = {f"given to a {kind}": words for kind, words in GIVEN.items() if kind in kinds}
        return {**self._task.terms(), "observation": what_is_told(self.settings.camera), **given, **_TERMS}

    @staticmethod
    def tables(results: Mapping[str, Any], *, title: str) -> list[Table]:
        """See `Contest.tables`."""
        return [methods_table(results, title=title), budget_table(results)]

    @staticmethod
    def notes(results: Mapping[str, Any]) -> list[str]:
        """See `Contest.notes`."""
        return notes(results)

    @staticmethod
    def stage(results: Mapping[str, Any]) -> ReachStage:
        """See `Contest.stage`."""
        return ReachStage(REACH_TASKS[results["settings"]["task"]]().arm)

    @staticmethod
    def scene(settings: Settings) -> Any:
        """The arm in its work cell, in the posture of the closed form."""
        task = REACH_TASKS[settings.task]()
        goal = task.goals(1, settings.seed)[0]
        posture = ClosedFormSolver(task.new_kinematics()).solve(task.ik_goal(goal), task.home, accept=task.accept)
        simulation = ArmSimulation(task.arm_name, visual=True)
        simulation.reset(posture.q)
        simulation.place_ball(goal)
        return render(simulation)
