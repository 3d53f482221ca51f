"""Tasks and methods of a comparison, as data, and their registry."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import gymnasium as gym
import numpy as np
from matplotlib.figure import Figure

from kinreach import _provenance as provenance
from kinreach._checks import Floats, check_known, shown
from kinreach._statistics import MEAN, QUANTILES, RATE, Column, Trial, success_columns, thousandfold
from kinreach.errors import InputError
from kinreach.robots import ArmDescription, BoxRegion, QuadrantRegion
from kinreach.sim.inside import Scene

#: Draws a figure from all trials and the contents of `results.json`.
Draw = Callable[[Sequence[Trial], Mapping[str, Any]], Figure]
#: From a number of goals, a seed and the environment to keyword arguments of its reset, one mapping a goal. Those of a
#: smaller number are the first of a larger one.
Resets = Callable[[int, int, gym.Env[Any, Any]], Sequence[Mapping[str, Any]]]

#: Replays a method, by name, on a goal, by index: the `info` of the reset and of every step.
Replay = Callable[[str, int], list[dict[str, Any]]]
#: Draws a figure of paths from all trials, the contents of `results.json`, and a replay.
DrawPaths = Callable[[Sequence[Trial], Mapping[str, Any], Replay], Figure]

#: Returns the scene of a trial's end, from the task's environment, reset to the trial's goal, and the trial.
MakeScene = Callable[[gym.Env[Any, Any], Trial], Scene]

#: Kinds of methods, and what each is given, in words, for the record beside the results.
SOLVER, POLICY, SEEDED, PLANNER = "solver", "policy", "seeded solver", "planner"
CONTROLLER, CHANCE, WEIGHTED = "controller", "chance", "weighted solver"
GIVEN: Mapping[str, str] = {
    SOLVER: "where the environment saw the goal, in the world (the true position, or the cameras' mean), the start "
    "posture as the seed, and the acceptance test: a posture that it refuses sends the solver on to another branch or "
    "a random restart",
    POLICY: "what the environment's agent observes and nothing else; no acceptance test, no collision model, no "
    "second try, and the branch that training has settled on",
    SEEDED: "the policy's observation for the seed, then what a solver is given, with that seed instead of the start "
    "posture",
    PLANNER: "where the goal and the obstacles are, the start posture, every posture at the goal, and the collision "
    "checker with its margin",
    CONTROLLER: "what the environment's agent observes, and a model of the arm: closed-form inverse kinematics, and "
    "the masses, friction, gears and period of the simulation; it adds up the controls that it asked for",
    WEIGHTED: "where the environment saw the goal, and the start posture, whose orientation it aims at, turned to the "
    "goal's direction where there is one; weights for point and orientation, no bound of what is left, no acceptance "
    "test",
    CHANCE: "nothing: uniform among the actions, seeded by the episode",
}


@dataclass(frozen=True)
class Method:
    """One way to do a task.

    Attributes:
        make: From its environment to a policy, or to an object for `as_policy`.
        kind: A key of `GIVEN`, or another word or two.
        environment: Id of its environment; the task's if empty.
        versions: Digests of its files, by name.
        colour: In figures; one is chosen if empty.
        options: Of its environment that differ from the task's.
    """

    make: Callable[[gym.Env[Any, Any]], Any]
    kind: str = POLICY
    environment: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
    colour: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def is_policy(self) -> bool:
        """Whether it decides by a policy alone, without a solver."""
        return self.kind == POLICY


@dataclass(frozen=True)
class Task:
    """What is compared: goals in an environment, methods, and what is measured of a trial.

    Attributes:
        name: As on the command line.
        title: For headings.
        environment: Id of the environment of methods without another.
        resets: Its goals.
        methods: By name, in the order of reports.
        columns: Measures of each method.
        figures: By name of the file.
        reached: The criterion in a few words.
        arm: Name of the default arm; empty if the environments have no option `arm`.
        arm_title: Title with another arm, after the arm's.
        arm_methods: By the name or the number of joints of another arm, its methods beside the task's solvers.
        options: Of the environments; `compare` can override them.
        variants: Ids of environments for policies from files.
        observations: Values of the environments' option `observation`; empty without that option.
        terms: Conditions of all methods, in words, by a short name.
        notes: From the contents of `results.json` to lines under the tables.
        scene: By default the environment's `arm` in its work cell, in the posture `q` with the ball at `goal`.
        paths: A figure of paths, instead of pictures of failures.
        ranked: Keys of columns by which the report names the best methods, smaller is better.
    """

    name: str
    title: str
    environment: str
    resets: Resets
    methods: Mapping[str, Method]
    columns: Sequence[Column]
    figures: Mapping[str, Draw] = field(default_factory=dict)
    reached: str = "the environment's own criterion"
    arm: str = ""
    arm_title: str = "tip at the goal"
    arm_methods: Mapping[str | int, Mapping[str, Method]] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    variants: Sequence[str] = ()
    observations: tuple[str, ...] = ()
    terms: Mapping[str, str] = field(default_factory=dict)
    notes: Callable[[Mapping[str, Any]], list[str]] = lambda results: []
    scene: MakeScene | None = None
    paths: DrawPaths | None = None
    ranked: Sequence[str] = ("distance_mm", "decision_ms", "solve_ms")

    def __post_init__(self) -> None:
        keys = [column.key for column in self.columns]
        if twice := sorted({key for key in keys if keys.count(key) > 1}):
            raise InputError(f"columns of the task {self.name!r} must have different keys, got two with {twice[0]!r}")

    def with_options(self, options: Mapping[str, Any]) -> Task:
        """Return the task with some options replaced."""
        return replace(self, options={**self.options, **options})


#: Fields of an arm that are not in its version: their text is not reproducible, or part of other fields.
_OUTSIDE = ("build_urdf", "package_root", "workcell", "missing_shapes", "notes", "meshes")
#: Registered tasks by name.
_TASKS: dict[str, Task] = {}
#: Tasks of the package -> the module whose `TASKS` has them.
_OWN = {
    "ur5": "_reach",
    "space": "_reach",
    "arm3": "_reach",
    "button": "_button",
    "real-arm": "_real_arm",
    "moving": "_moving",
    "obstacles": "_obstacles",
    "lift": "_lift",
    "push": "_tabletop",
    "pick-and-place": "_tabletop",
}


def register_task(task: Task) -> Task:
    """Register a task by its name, for `compare` and the command line.

    Raises:
        InputError: It is not a `Task`, or another one has that name already.
    """
    given: Any = task
    if not isinstance(given, Task):
        raise InputError(f"a task must be a Task, got {shown(given)}")
    known = get_task(task.name) if task.name in task_names() else task
    if known is not task:
        raise InputError(f"a task named {task.name!r} is registered already")
    _TASKS[task.name] = task
    return task


def get_task(name: str) -> Task:
    """The task of a name, registered ones included.

    Raises:
        InputError: For another name; the message lists all.
    """
    check_known("task", name, task_names())
    if name not in _TASKS:
        _TASKS.update({task.name: task for task in importlib.import_module(f"kinreach.compare.{_OWN[name]}").TASKS})
    return _TASKS[name]


def task_names() -> list[str]:
    """Return the names of the registered tasks, the package's own first."""
    return list(dict.fromkeys((*_OWN, *_TASKS)))


def all_tasks() -> list[Task]:
    """Return the registered tasks, the package's own first."""
    return list(map(get_task, task_names()))


def common_columns(completed: Callable[[Trial], bool]) -> tuple[Column, ...]:
    """Return the columns of every task: rates over all goals, distances [mm], reward, times.

    Distances include impossible goals; times of moves are of completed trials.

    Args:
        completed: Whether the arm moved, however near the goal it ended.
    """
    return (
        Column("reached", "reached", RATE, "reached % [95 % CI]", "interval"),
        Column("distance_mm", thousandfold("distance"), QUANTILES, "distance mm\nmedian / p95", "quantiles"),
        *success_columns(completed),
        Column("impossible", "impossible", RATE, "impos-\nsible %", "share"),
        Column("reward_mean", "reward", MEAN, "reward\nmean", "mean"),
        Column("solve_ms", thousandfold("solve_s"), QUANTILES, "solve ms\nmedian / p95", "quantiles"),
        Column("move_s", lambda t: t.get("move_s") if completed(t) else None, QUANTILES, "move s\nmedian", "median"),
    )


def of_reached(name: str) -> Callable[[Trial], Any]:
    """Return a column's value that trials have which reached their goal."""
    return lambda trial: trial[name] if trial["reached"] else None


def episode_seed(seed: int, index: int) -> int:
    """Return the environment's seed for an episode of a comparison."""
    return int(np.random.SeedSequence(seed, spawn_key=(index,)).generate_state(1)[0])


def resets_in_turn(cases: Sequence[Mapping[str, Any]], count: int, seed: int) -> list[dict[str, Any]]:
    """Return a reset with the options of each case, then again with the next seed, and so on."""
    size = len(cases)
    return [{"seed": episode_seed(seed, index // size), "options": cases[index % size]} for index in range(count)]


def resets_to(goals: Floats, seed: int) -> list[dict[str, Any]]:
    """Return resets of a reach environment to goals, each with its own seed of the cameras' noise."""
    return [{"seed": episode_seed(seed, index), "options": {"goal": goal}} for index, goal in enumerate(goals)]


def arm_in(env: gym.Env[Any, Any]) -> ArmDescription | None:
    """Return the arm of an environment, the believed one if the true one differs, or None."""
    named = (env.get_wrapper_attr(part) for part in ("believed", "arm") if env.has_wrapper_attr(part))
    return next((arm for arm in named if isinstance(arm, ArmDescription)), None)


def arm_version(arm: ArmDescription) -> dict[str, str]:
    """Return a digest of an arm's description, by name."""
    cell = arm.workcell
    goals = cell.goals if isinstance(cell.goals, BoxRegion | QuadrantRegion) else type(cell.goals).__qualname__
    facts = [getattr(arm, entry.name) for entry in fields(arm) if entry.name not in _OUTSIDE]
    facts += [] if arm.meshes == "hulls" else [arm.meshes]
    content = repr((arm.urdf, facts, replace(cell, goals=None), goals)).encode()
    return {f"arm {arm.name}": provenance.digest(content)}
