"""Run comparisons: every method on every goal, resumable trial by trial.

All methods play one goal before the next, in random order, so that other load on the machine affects all of them
alike. Cameras measure a goal once; all methods observe the same measurement.
"""

from __future__ import annotations

import json
import math
import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from matplotlib.figure import Figure

from kinreach import _provenance as provenance
from kinreach import _statistics as statistics
from kinreach._checks import check_count, check_known, check_path, check_step_limit, shown
from kinreach._files import locked, make_writable, open_input, read_bytes, read_text, write_text
from kinreach._jobs import SERIAL, Engine, Serial, open_engine
from kinreach._objects import place_of
from kinreach._statistics import Trial, summarise, trials_csv
from kinreach.baselines import rollout
from kinreach.baselines.inside import Policy, as_policy
from kinreach.compare import _figures as figures
from kinreach.compare import _report as report
from kinreach.compare._methods.resolve import colours, resolve_methods
from kinreach.compare._motion import MotionRecorder, check_motion, with_motion
from kinreach.compare._task import GIVEN, SOLVER, Draw, Method, Task, arm_in, arm_version, get_task
from kinreach.envs.inside import in_doubles, reach_task, with_goals
from kinreach.errors import InputError, InstallationError, KinreachError, MethodError, OtherResultsError, OutputError
from kinreach.robots import ArmDescription, get_arm

#: Called with the number of finished trials and the number of all trials.
TrialProgress = Callable[[int, int], None]

DEFAULT_GOALS = 200
#: Largest number of goals, which would take a month.
MAX_GOALS = 10**7
MAX_SEED = 2**63 - 1
#: Seed and number of untimed goals at the start, which load libraries and fill caches. The seed is above those of
#: comparisons.
WARM_UP_SEED, WARM_UP_GOALS = 2**63, 2
#: Observations of tasks that have the option; the second needs OpenGL.
GEOMETRIC, CAMERA = "geometric", "camera"
#: Least trials of a job, which spends half a second on its environments; trials that it sends at once.
BLOCK, TRIALS_AT_ONCE = 500, 32
#: The trials of an unfinished comparison, and the results of a finished one.
RECORDS, RESULTS = "records.jsonl", "results.json"
#: Sizes of what is read [bytes]: results, or a line of the trials, and all trials; one has some 700.
MAX_BYTES, MAX_RECORDS = 256 * 1024 * 1024, 64 * 1024**3


@dataclass(frozen=True)
class Comparison:
    """A comparison with checked settings.

    Attributes:
        task: With the options of its environments.
        left_out: Methods of the task that cannot be made, with the reason.
        arm: Name of the environment's arm, or empty.
    """

    task: Task
    methods: Mapping[str, Method]
    goals: int
    seed: int
    command: str
    left_out: Mapping[str, str]
    arm: str
    motion: bool

    def settings(self) -> dict[str, Any]:
        options = {name: _as_json(value) for name, value in self.task.options.items()}
        return {
            "task": self.task.name,
            "methods": list(self.methods),
            "goals": self.goals,
            "seed": self.seed,
            "observation": options.get("observation", GEOMETRIC),
            "options": options,
            "motion": self.motion,
        }


def compare(
    task: str | Task = "ur5",
    methods: Sequence[Any] | Mapping[str, Any] = (),
    *,
    goals: int = DEFAULT_GOALS,
    seed: int = 0,
    arm: str | ArmDescription | None = None,
    observation: str | None = None,
    options: Mapping[str, Any] | None = None,
    motion: bool = False,
    out: str | Path | None = None,
    fresh: bool = False,
    engine: str = SERIAL,
    address: str | None = None,
    command: str = "kinreach.compare.compare(...)",
    progress: TrialProgress = lambda done, total: None,
) -> dict[str, Any]:
    """Measure methods on the same goals.

    With `out`, an interrupted comparison keeps its finished trials in `out/records.jsonl`, and resumes when called
    again with the same settings, code, versions and machine.

    Args:
        task: Name of a registered task, or a task.
        methods: Names of the task's methods, files of policies, solvers, policies, classes or functions, see
            `kinreach.compare._methods.resolve.resolve_methods`; all of the task's own if empty.
        goals: Number of goals.
        seed: Of the goals.
        arm: Name of a registered arm, or a description, for tasks with other arms. If its work cell has no goals,
            they are `ReachableGoals`, scaled to the arm.
        observation: `"geometric"` (the true goal) or `"camera"` (what the cameras saw), for tasks that have both.
        options: Of the task's environments.
        motion: Also time each motion by ruckig within the limits of the arm; for tasks whose arm moves from posture to
            posture.
        out: Directory for `results.json`, `results.csv`, `report.html` and the figures. None: nothing is written.
        fresh: Do not resume, and overwrite the results of another comparison.
        engine: `"serial"`, or `"ray"`: blocks of goals as tasks of Ray, which give the same trials except for times.
        address: Of a running Ray cluster, `host:port` or `auto`; without it Ray is started on this machine.
        command: That repeats the comparison, for the results.
        progress: Called with the number of finished and of all trials.

    Returns:
        The contents of `results.json`.

    Raises:
        OutputError: `out` cannot be written, or another comparison is writing there.
        InstallationError: The packages of a method or of cameras are missing.
        ClusterError: No cluster answers at the address, or it died; finished trials are kept in `out`.
        InputError: An argument is invalid, or `out` holds the results of another comparison.
        UnknownNameError: The task, method, arm or observation is unknown.

    Examples:
        >>> from kinreach.compare import compare
        >>> results = compare("ur5", methods=["closed-form", "lm"], goals=2)
        >>> [(method["name"], method["reached"]) for method in results["methods"]]
        [('closed-form', 1.0), ('lm', 1.0)]
    """
    comparison = prepare(
        task,
        methods,
        goals=goals,
        seed=seed,
        arm=arm,
        observation=observation,
        options=options,
        command=command,
        motion=motion,
    )
    machine = provenance.machine() if engine == SERIAL else {"engine": engine}
    with open_engine(engine, address) as running:
        if out is None:
            return results_of(comparison, list(run_trials(comparison, running, progress=progress)), machine)
        folder = check_path("out", out)
        make_writable(folder)
        with locked(folder, "a comparison"):
            return _compare_on_disk(comparison, folder, engine=running, machine=machine, fresh=fresh, progress=progress)


def prepare(
    task: str | Task,
    methods: Any,
    *,
    goals: int,
    seed: int,
    arm: str | ArmDescription | None,
    observation: str | None,
    options: Mapping[str, Any] | None,
    command: str,
    motion: bool = False,
) -> Comparison:
    """Check the arguments of a comparison, which are as in `compare`."""
    task = get_task(task) if isinstance(task, str) else task
    if not isinstance(task, Task):
        raise InputError(f"a task is a name or a Task, got {shown(task)}")
    _check_numbers(goals, seed)
    chosen = dict(options or {})
    if observation is not None:
        _check_observation(task, observation)
        if task.observations:
            chosen["observation"] = observation
    if arm is not None:
        description = with_goals(get_arm(arm))
        if not task.arm:
            raise InputError(f"the task {task.name!r} takes no other arm, got {description.name!r}")
        chosen["arm"] = description if isinstance(arm, ArmDescription) else arm
        if description.name != task.arm or reach_task.layout_of(description) != reach_task.layout_of(get_arm(task.arm)):
            solvers = {name: method for name, method in task.methods.items() if method.kind == SOLVER}
            for key in (len(description.joints), description.name):
                solvers |= task.arm_methods.get(key, {})
            task = replace(task, title=f"{description.title}: {task.arm_title}", methods=solvers)
    task = task.with_options(chosen)
    resolved = resolve_methods(task, methods)
    left_out: dict[str, str] = {}
    with ExitStack() as stack:
        environments = Environments(task, stack)
        for name, method in list(resolved.items()):
            try:
                environments.policy(method)
            except (InstallationError, InputError) as error:
                if methods:
                    if isinstance(error, MethodError):
                        raise MethodError(f"method {name!r} cannot be made: {error}") from error.__cause__
                    raise
                left_out[name] = str(error)
                del resolved[name]
        if not resolved:
            raise InputError(f"no method of {task.name!r} can be used: {next(iter(left_out.values()))}")
        known = arm_in(environments.default)
        if motion:
            check_motion(task, environments.default)
            task = with_motion(task)
    named = "" if known is None else known.name
    return Comparison(task, resolved, int(goals), int(seed), command, left_out, named, motion)


def run_trials(
    comparison: Comparison,
    engine: Engine | None = None,
    *,
    done: Sequence[Trial] = (),
    progress: TrialProgress = lambda done, total: None,
) -> Iterator[Trial]:
    """Yield each finished trial of the goals and methods that are not done."""
    task, names, engine = comparison.task, list(comparison.methods), engine or Serial()
    finished = {(trial["goal_index"], trial["method"]) for trial in done}
    count, total = len(finished), comparison.goals * len(names)
    progress(count, total)
    with ExitStack() as stack:
        resets = resets_of(task, comparison.goals, comparison.seed, Environments(task, stack).default)
    goals = []
    for index, reset in enumerate(resets):
        turns = np.random.default_rng(index).permutation(len(names))
        if pending := [names[turn] for turn in turns if (index, names[turn]) not in finished]:
            goals.append((index, reset, pending))
    blocks = engine.split(goals, math.ceil(BLOCK / len(names)))
    for _, trial in engine.map(partial(play, comparison), blocks, together=TRIALS_AT_ONCE):
        yield trial
        count += 1
        progress(count, total)


def play(comparison: Comparison, goals: Sequence[tuple[int, Mapping[str, Any], Sequence[str]]]) -> Iterator[Trial]:
    """Yield the trials of some goals, after an untimed warm-up; a goal has its number, reset, and methods in order."""
    task = comparison.task
    with ExitStack() as stack:
        environments = Environments(task, stack)
        players = {
            name: (environments.of(method), environments.policy(method)) for name, method in comparison.methods.items()
        }
        shared = task.options.get("observation") == CAMERA
        for index, reset in enumerate(resets_of(task, WARM_UP_GOALS, WARM_UP_SEED, environments.default)):
            for _ in _one_goal(comparison, players, list(players), reset, f"warm-up goal {index}", shared=shared):
                pass
        for index, reset, pending in goals:
            for name, trial in _one_goal(comparison, players, pending, reset, f"goal {index}", shared=shared):
                yield {"goal_index": index, "method": name, **trial}


def resets_of(task: Task, count: int, seed: int, env: gym.Env[Any, Any]) -> Sequence[Mapping[str, Any]]:
    resets: Any = task.resets(count, seed, env)
    if not isinstance(resets, Sequence) or len(resets) != count:
        got = f"{len(resets)} of them" if isinstance(resets, Sequence) else shown(resets)
        raise InputError(f"resets of the task {task.name!r} must return {count} keyword arguments, got {got}")
    return resets


def _one_goal(
    comparison: Comparison,
    players: Mapping[str, tuple[gym.Env[Any, Any], Policy]],
    names: Sequence[str],
    reset: Mapping[str, Any],
    goal: str,
    *,
    shared: bool,
) -> Iterator[tuple[str, Trial]]:
    """Run methods on one goal; with a shared look, all observe the first one's measurement.

    Each decides once untimed before its episode, or cold caches would double the time of a short decision.
    """
    for name in names:
        env, policy = players[name]
        with naming(f"method {name!r} failed on {goal}"):
            observation, info = env.reset(**reset)
            policy.reset(observation, info)
            policy.act(observation)
            if shared:
                reset = {**reset, "options": {**reset.get("options", {}), "view": info["view"]}}
            recorder = MotionRecorder() if comparison.motion else None
            (trial,) = rollout(env, policy, [reset], watch=recorder)
            trial |= {} if recorder is None else recorder.measured()
        for column in comparison.task.columns:
            try:
                column.check(trial)
            except InputError as error:
                raise InputError(f"{error} (method {name!r}, {goal})") from error.__cause__
        yield name, trial


@contextmanager
def naming(what: str) -> Iterator[None]:
    """Turn errors of the block into a `MethodError` with type, text and place in the user's file."""
    try:
        yield
    except InputError as error:
        raise MethodError(f"{what}: {error}") from error
    except KinreachError:  # not the method's: cameras that cannot draw, a package that is missing
        raise
    except Exception as error:
        raise MethodError(f"{what}: {type(error).__name__}: {error}{place_of(error)}") from error


class Environments:
    """The environments of a comparison by id and options, closed with the stack."""

    def __init__(self, task: Task, stack: ExitStack) -> None:
        self._task, self._stack = task, stack
        self._made: dict[tuple[str, str], gym.Env[Any, Any]] = {}

    @property
    def default(self) -> gym.Env[Any, Any]:
        return self._get(self._task.environment, {})

    def of(self, method: Method) -> gym.Env[Any, Any]:
        return self._get(method.environment or self._task.environment, method.options)

    def policy(self, method: Method) -> Policy:
        """Make a method's policy; refuse a class of the user's that cannot be made."""
        env = self.of(method)
        try:
            return as_policy(method.make(env))
        except KinreachError:
            raise
        except Exception as error:
            raise MethodError(f"{type(error).__name__}: {error}{place_of(error)}") from error

    def _get(self, name: str, options: Mapping[str, Any]) -> gym.Env[Any, Any]:
        key = name, repr(sorted(options.items()))
        if key not in self._made:
            check_step_limit({**self._task.options, **options})
            try:
                doubles = in_doubles(name)  # the closed form's nanometres are lost in single precision
                env = gym.make(name, disable_env_checker=True, **{**doubles, **self._task.options, **options})
            except gym.error.Error as error:
                raise InputError(f"the task {self._task.name!r} has no environment: {error}") from error
            self._stack.callback(env.close)
            self._made[key] = env
        return self._made[key]


def results_of(
    comparison: Comparison, trials: Sequence[Trial], machine: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Return the contents of `results.json`; `machine` measured the times, this one if None."""
    task, painted = comparison.task, colours(comparison.methods)
    trials = sorted(trials, key=lambda trial: trial["goal_index"])
    entries = []
    for name, method in comparison.methods.items():
        own = [trial for trial in trials if trial["method"] == name]
        entries.append(
            {
                "name": name,
                "kind": method.kind,
                "goals": len(own),
                **summarise(task.columns, own),
                "outcomes": dict(Counter(trial["status"] for trial in own)),
                "colour": painted[name],
            }
        )
    kinds = {method.kind for method in comparison.methods.values()}
    given = {f"given to a {kind}": words for kind, words in GIVEN.items() if kind in kinds}
    return {
        "methods": entries,
        "settings": {
            **comparison.settings(),
            "command": comparison.command,
            "title": task.title,
            "arm": comparison.arm,
            "terms": {**task.terms, "reached": task.reached, **given},
            "left_out": dict(comparison.left_out),
            "confidence": statistics.CONFIDENCE,
            "intervals": f"Wilson for rates; percentile bootstrap with {statistics.RESAMPLES} resamples for the rest",
            "machine": dict(machine or provenance.machine()),
        },
        "versions": _versions(comparison),
    }


def notes(task: Task, results: Mapping[str, Any]) -> list[str]:
    settings = results["settings"]
    return [
        f"{settings['goals']} goals, seed {settings['seed']}. Reached: {settings['terms']['reached']}; its 95 % "
        "interval is Wilson's.",
        *task.notes(results),
        *(f"Left out: {name}: {reason}" for name, reason in settings["left_out"].items()),
    ]


def _compare_on_disk(
    comparison: Comparison,
    out: Path,
    *,
    engine: Engine,
    machine: Mapping[str, Any],
    fresh: bool,
    progress: TrialProgress,
) -> dict[str, Any]:
    if not fresh:
        _refuse_other_results(out, comparison)
    identity = {
        "settings": comparison.settings(),
        "versions": _versions(comparison, methods=False),
        "methods": {name: dict(method.versions) for name, method in comparison.methods.items()},
        "machine": dict(machine),
    }
    records = Records(out / RECORDS, identity, comparison, fresh=fresh)
    try:
        for trial in run_trials(comparison, engine, done=tuple(records.trials), progress=progress):
            records.add(trial)
    except MethodError as error:
        if not records.trials:
            raise
        raise MethodError(f"{error}; {len(records.trials)} finished trials are kept in {out}") from error.__cause__
    order = list(comparison.methods)
    trials = sorted(records.trials, key=lambda trial: (trial["goal_index"], order.index(trial["method"])))
    results = results_of(comparison, trials, machine)
    write_text(out / "results.csv", trials_csv(trials))
    drawings = {**comparison.task.figures, **_path_figure(comparison)}
    drawn = figures.write_figures(drawings, out, trials, results)
    report.write_report(out / "report.html", comparison.task, trials, results, drawn)
    write_text(out / RESULTS, json.dumps(results, indent=2, allow_nan=False) + "\n")
    records.remove()
    return results


def _path_figure(comparison: Comparison) -> dict[str, Draw]:
    """Return the task's figure of paths, which replays some trials, or nothing."""
    draw_paths = comparison.task.paths
    if draw_paths is None:
        return {}

    def draw(trials: Sequence[Trial], results: Mapping[str, Any]) -> Figure:
        with ExitStack() as stack:
            environments = Environments(comparison.task, stack)
            resets = resets_of(comparison.task, comparison.goals, comparison.seed, environments.default)

            def replay(name: str, goal: int) -> list[dict[str, Any]]:
                env = environments.of(comparison.methods[name])
                policy, infos = environments.policy(comparison.methods[name]), []
                for _ in rollout(env, policy, [resets[goal]], watch=lambda env, info: infos.append(dict(info))):
                    pass
                return infos

            return draw_paths(trials, results, replay)

    return {"paths": draw}


class Records:
    """The finished trials of a comparison, one line of JSON each.

    The first line is the identity of the comparison: settings, versions, code and machine. With another identity, or if
    the file cannot be read, the comparison starts over. If only a method's file changed, trials of the others are kept.

    Args:
        identity: As JSON types.
        fresh: Drop old trials.

    Attributes:
        trials: All so far.
    """

    def __init__(self, path: Path, identity: Mapping[str, Any], comparison: Comparison, *, fresh: bool) -> None:
        self.path = path
        self.trials: list[Trial] = [] if fresh else list(_kept(path, identity, comparison))
        # written anew, without a line that a crash cut short
        write_text(path, "".join(json.dumps(line) + "\n" for line in (identity, *self.trials)))

    def add(self, trial: Trial) -> None:
        """Append a finished trial, in memory and on disk. If the file system refuses, the file is unchanged."""
        line, end = json.dumps(trial, allow_nan=False) + "\n", None
        try:
            with self.path.open("a", encoding="utf-8") as file:
                end = file.tell()
                file.write(line)
        except OSError as error:
            if end is not None:
                with suppress(OSError):  # of half a line
                    os.truncate(self.path, end)
            raise OutputError(f"cannot write {self.path}: {error.strerror or error}") from error
        self.trials.append(trial)

    def remove(self) -> None:
        self.path.unlink(missing_ok=True)


def _kept(path: Path, identity: Mapping[str, Any], comparison: Comparison) -> Iterator[Trial]:
    """Yield trials of this identity, each once, up to the first invalid line."""
    seen = set()
    wanted = json.loads(json.dumps(identity))
    made_of = wanted.pop("methods", {})
    if not path.exists():
        return
    file = open_input(path, "the trials of an interrupted comparison", most=MAX_RECORDS)
    with file, suppress(OSError, ValueError, KeyError, TypeError, RecursionError, AttributeError):
        found = json.loads(file.readline(MAX_BYTES))
        was_made_of = found.pop("methods", {})
        if found != wanted:
            return
        for line in iter(lambda: file.readline(MAX_BYTES), b""):
            trial = json.loads(line)
            which = trial["goal_index"], trial["method"]
            if which in seen or which[1] not in comparison.methods or not 0 <= which[0] < comparison.goals:
                return
            comparison.task.columns[0].of(trial)
            seen.add(which)
            if was_made_of.get(which[1]) == made_of.get(which[1]):
                yield trial


def _refuse_other_results(out: Path, comparison: Comparison) -> None:
    path = out / RESULTS
    if not path.exists():
        return
    try:
        found = json.loads(read_text(path, "the results", most=MAX_BYTES))
        differences = _differences(found["settings"], found["versions"], comparison)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        differences = "it was not written by a comparison"
    if differences:
        raise OtherResultsError(
            f"{out} holds the results of another comparison ({differences}); "
            "choose another directory, or overwrite it with --fresh (fresh=True)"
        )


def _differences(settings: Mapping[str, Any], versions: Mapping[str, Any], comparison: Comparison) -> str:
    """Return how results differ from those of a comparison, in words; empty if they do not.

    Files may be edited between two runs, but not renamed.
    """
    wanted = json.loads(json.dumps(comparison.settings()))
    found = [
        f"{name} {shown(settings.get(name))}, not {shown(value)}"
        for name, value in wanted.items()
        if name not in settings or settings[name] != value
    ]
    files = [name for method in comparison.methods.values() for name in method.versions if name not in versions]
    return "; ".join([*found, *(f"without {name}" for name in files)])


def _versions(comparison: Comparison, *, methods: bool = True) -> dict[str, Any]:
    found: dict[str, Any] = provenance.versions()
    if (arm := comparison.task.options.get("arm")) is not None:
        found |= arm_version(get_arm(arm))
    found |= {
        f"file {path}": provenance.digest(read_bytes(path, "the file", most=MAX_BYTES))
        for path in _files(comparison.task.options)
    }
    for method in comparison.methods.values() if methods else ():
        found |= method.versions
    return found


def _files(options: Mapping[str, Any]) -> Iterator[Path]:
    """Yield the files in options, such as calibrations."""
    for value in options.values():
        for name in (value,) if isinstance(value, str) else value if isinstance(value, Sequence) else ():
            if isinstance(name, str) and (path := Path(name)).is_file():
                yield path


def _check_numbers(goals: object, seed: object) -> None:
    check_count("the number of goals", goals, most=MAX_GOALS)
    check_count("the seed", seed, least=0, most=MAX_SEED)


def _check_observation(task: Task, observation: str) -> None:
    check_known(f"{task.name} observation", observation, task.observations or (GEOMETRIC,))


def _as_json(value: Any) -> Any:
    """Convert an option to JSON types: an arm to its name, an object to its class or function."""
    if isinstance(value, ArmDescription):
        return value.name
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, Sequence | np.ndarray):
        return [_as_json(entry) for entry in value]
    return getattr(value, "__qualname__", type(value).__qualname__)
