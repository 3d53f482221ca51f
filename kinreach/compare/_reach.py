"""The reach tasks: the thesis's, in space, and with the 3-DOF arm; and what a distance there comes from."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from kinreach._checks import Floats
from kinreach._registration import MULTI, SINGLE, SPACE
from kinreach._statistics import COMPLETED, MEAN, QUANTILES, Column, Trial, number, thousandfold
from kinreach.baselines import load_policy
from kinreach.baselines.inside import SolverPolicy, policy_version
from kinreach.compare import _curves as curves
from kinreach.compare import _figures as figures
from kinreach.compare._methods.resolve import policy_method, solver_method
from kinreach.compare._methods.weighted import WeightedPlaco
from kinreach.compare._task import SEEDED, WEIGHTED, Draw, Method, Task, common_columns, resets_to
from kinreach.envs.inside import button_task
from kinreach.errors import InputError
from kinreach.kinematics import Tolerance
from kinreach.kinematics.inside import SOLVERS, new_solver
from kinreach.robots import THESIS_ARM
from kinreach.sim.inside import TOLERANCE
from kinreach.thesis import REACHED_DISTANCE

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

    The way has three steps: to where the goal was `seen`, to where forward kinematics puts the tip in the commanded
    posture, `meant`, and to where the tip is. A part is a step's component along the line from the goal to the tip: it
    is negative if its step leads back towards the goal.
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

#: Goals in a row that an arm may miss.
MAX_MISSED = 1000

_COMMON = common_columns(completed)
COLUMNS = (
    _COMMON[0],
    Column("observed_error_mm", seen_error_mm, QUANTILES, "seen\nmm", "median"),
    *_COMMON[1:],
    Column("posture_error", "posture_error", QUANTILES, "posture\nerror, rad"),
    *BUDGET_COLUMNS,
    Column("iterations", "iterations", QUANTILES, "iterations\nmedian / p95", "quantiles", BUDGET_TABLE, digits=3),
    Column("restarts", "restarts", QUANTILES, "restarts\nmedian / p95", "quantiles", BUDGET_TABLE, digits=3),
    Column("candidates", "candidates", QUANTILES, "postures\ntested", table=BUDGET_TABLE, digits=3),
    Column("accept_ms", thousandfold("accept_s"), QUANTILES, "acceptance\ntests, ms", table=BUDGET_TABLE),
)


def _figures(near_mm: float) -> Mapping[str, Draw]:
    return {
        "errors": figures.draw_errors(ik_error_mm, seen_error_mm, near_mm=near_mm),
        "success": curves.draw_success,
        "map": figures.draw_map,
        "times": figures.draw_times,
        "budget": figures.draw_budget(Budget._fields, BUDGET_MEANING),
    }


FIGURES = _figures(1e3 * REACHED_DISTANCE)


def _hybrid() -> Method:
    def make(env: gym.Env[Any, Any]) -> SolverPolicy:
        solver = new_solver("lm", env.unwrapped.kinematics)  # type: ignore[attr-defined]
        return SolverPolicy(solver, env, proposer=load_policy("ranked-single"))

    return Method(make, SEEDED, SINGLE, policy_version("ranked-single"))


METHODS: Mapping[str, Method] = {name: solver_method(partial(new_solver, name)) for name in SOLVERS}
#: Methods of arms with four or five joints.
FEW_JOINTS: Mapping[str | int, Mapping[str, Method]] = {
    joints: {"placo-weights": Method(WeightedPlaco, WEIGHTED)} for joints in (4, 5)
}


def goals_of(env: gym.Env[Any, Any], count: int, seed: int, *, reachable: bool = False) -> Floats:
    """Draw goals in the arm's region, in the world [m], shape (count, 3); the first ones do not depend on `count`.

    Reachable ones are those for which the closed form finds an acceptable posture.
    """
    world: Any = env.unwrapped
    solver = new_solver("closed-form", world.kinematics) if reachable else None
    rng = np.random.default_rng(seed)
    kept: list[Floats] = []
    missed = 0
    while len(kept) < count:
        position = world.arm.workcell.draw_goals(rng, 1)[0]
        if solver is None or solver.solve(world.ik_goal(position), world.home, accept=world.accept).success:
            kept.append(position)
            missed = 0
        else:
            missed += 1
        if missed == MAX_MISSED:
            raise InputError(
                f"arm {world.arm.name!r} reaches none of {missed} goals in a row; give it a Workcell with others"
            )
    return np.array(kept)


def _resets(count: int, seed: int, env: gym.Env[Any, Any]) -> Sequence[Mapping[str, Any]]:
    return resets_to(goals_of(env, count, seed), seed)


def _space_resets(count: int, seed: int, env: gym.Env[Any, Any]) -> Sequence[Mapping[str, Any]]:
    drawn = env.unwrapped.starts(np.random.default_rng(seed), count)  # type: ignore[attr-defined]
    rest = {name: rows for name, rows in drawn.items() if name != "goal"}
    return [
        {**reset, "options": reset["options"] | {name: rows[index] for name, rows in rest.items()}}
        for index, reset in enumerate(resets_to(drawn["goal"], seed))
    ]


def _reachable_resets(count: int, seed: int, env: gym.Env[Any, Any]) -> Sequence[Mapping[str, Any]]:
    return resets_to(goals_of(env, count, seed, reachable=True), seed)


def _notes(results: Mapping[str, Any]) -> list[str]:
    entries, settings = results["methods"], results["settings"]
    causes = {
        entry["name"]: [f"{count} {status}" for status, count in entry["outcomes"].items() if status != COMPLETED]
        for entry in entries
        if entry["impossible"]
    }
    seen = [entry["observed_error_mm"] for entry in entries if entry["observed_error_mm"]["median"] is not None]
    return [
        *(f"Impossible for {name}: {', '.join(found)}." for name, found in causes.items()),
        *(
            f"Seen: the cameras' median error; p95 {number(error['p95'])} mm. One look per goal, alike for all; judged "
            "against the true ball."
            for error in seen[:1]
        ),
        "Distance, move: simulated in MuJoCo. Solve: wall time on one thread, acceptance tests included.",
        "Iterations: a solver's steps, a policy's decisions. Seeing, deciding and moving sum to the distance:",
        "the component of each error along the line from the goal to the tip, mean over completed moves.",
        *(
            ["A ball that no camera finds leaves solvers without a goal."]
            if settings["observation"] == "camera"
            else []
        ),
    ]


_TERMS = {
    "tolerance": f"numeric solvers stop within {Tolerance().position:g} m and {Tolerance().orientation:g} rad",
    "execution": "from the start posture, in MuJoCo: one move, two-phase; a policy of several steps moves all joints "
    f"at once and decides after each move; a move is done when every joint rests within {TOLERANCE:g} rad",
    "timing": "methods take turns in random order on every goal, each after one untimed decision on it; one process, "
    "one thread, one goal at a time; the clock runs while a method is reset to the goal and decides, summed over its "
    "decisions",
    "error_budget": f"seeing, deciding and moving: {BUDGET_MEANING}; the parts sum to the distance",
    "seed_posture": "the start posture of the arm, the same for every goal",
    "distance": "tip to the goal after the last move, in the simulation",
    "success_at_mm": "share of all goals, reached or not, whose move was completed and ended within the tolerance",
}

UR5_TASK = Task(
    name="ur5",
    title="UR5: gripper on the ball, tool down, natural posture",
    environment=SINGLE,
    arm=THESIS_ARM,
    variants=(SINGLE, MULTI),
    observations=("geometric", "camera"),
    resets=_resets,
    methods={
        **METHODS,
        "ppo-single": policy_method("ppo-single", SINGLE),
        "ppo-multi": policy_method("ppo-multi", MULTI),
        "ranked-single": policy_method("ranked-single", SINGLE),
        "ranked-multi": policy_method("ranked-multi", MULTI),
        "thesis-ppo-single": policy_method("thesis-ppo-single", SINGLE),
        "hybrid": _hybrid(),
    },
    arm_methods={**FEW_JOINTS, "panda": {"panda-single": policy_method("panda-single", SINGLE)}},
    columns=COLUMNS,
    figures=FIGURES,
    reached="the tip ends within 10 mm of the ball and, with a UR arm, the posture error r_e is below 0.15 rad",
    terms={
        "goal": "ball's centre in the world, uniform on the table area, one height; tcp there, z axis down, free "
        "about it",
        "accept": "solvers' postures: no collision (self, table, mount, pedestal, floor) and r_e < 0.15",
        "reward": "the thesis's, of the last move; impossible -100",
        **_TERMS,
    },
    notes=_notes,
)

ARM3_TASK = Task(
    name="arm3",
    title="3-DOF arm: end effector on the target",
    environment=SINGLE,
    arm="arm3",
    options={"arm": "arm3"},
    variants=(SINGLE, MULTI),
    resets=_reachable_resets,
    methods=METHODS,
    columns=[column for column in COLUMNS if column.key != "posture_error"],
    figures=_figures(1e3 * button_task.PRESS_RADIUS),
    reached="the tip ends within 50 mm of the goal, the press radius",
    terms={
        "goal": "point in the world, uniform in the button task's four quadrants, kept if some posture reaches it",
        "accept": "no collision (self, floor)",
        "reward": "-distance [m], also where the move was impossible",
        **_TERMS,
    },
    notes=_notes,
)

SPACE_TASK = Task(
    name="space",
    title="Reaching in space: the tip on the ball, the tool along a direction, from anywhere near the start pose",
    environment=SPACE,
    arm=THESIS_ARM,
    options={"tilt": 30.0, "start_spread": 0.3},
    variants=(SPACE,),
    observations=("geometric", "camera"),
    resets=_space_resets,
    methods={**METHODS, "space-single": policy_method("space-single", SPACE)},
    arm_methods=FEW_JOINTS,
    columns=COLUMNS,
    figures=FIGURES,
    reached="the tip ends within 10 mm of the ball and the tool within 0.15 rad of its direction",
    terms={
        "goal": "ball's centre in the world, uniform in the arm's goal area up to 0.25 m above it; tool within 30 "
        "degrees of straight down, uniform on the sphere; free about it",
        "accept": "solvers' postures and the moves there: no collision (self, table, mount, pedestal, floor); the tool "
        "within 0.15 rad",
        "reward": "that of kinreach/Reach-v0, of the last move; impossible -100",
        **_TERMS,
        "seed_posture": "where the arm starts: joints uniform within 0.3 rad of the start posture, one start a goal",
    },
    notes=_notes,
)

TASKS = (UR5_TASK, ARM3_TASK, SPACE_TASK)
