"""Search for settings of a recipe with Ray Tune.

A search is a file: the recipe, ranges of its fields, a budget, and a number of validation goals. Tune draws the
settings, stops trials early, and keeps its state in a folder of its own.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml

from kinreach import _provenance as provenance
from kinreach._checks import check_count, check_known, shown
from kinreach._engines import load_extra
from kinreach._files import locked, make_writable, read_text, write_text
from kinreach._jobs import RAY
from kinreach.baselines._evaluation import VALIDATION, evaluate
from kinreach.baselines._recipes import Networks, Recipe, get_recipe
from kinreach.baselines._training import run_identity, segments
from kinreach.errors import InputError

TRIALS, RESULTS, STATE = "results.csv", "results.json", "tune"
SEARCHERS, SCHEDULERS = ("random", "optuna"), ("none", "asha")
#: Measures of a trial: name -> from the summary of an evaluation to a number, and which end is better.
JUDGES: Mapping[str, tuple[Callable[[Mapping[str, Any]], float], str]] = {
    "reached": (lambda found: found["reached"], "max"),
    "distance_mm": (lambda found: found["distance_mm"]["median"], "min"),
    "return": (lambda found: found["return"]["mean"], "max"),
}
#: Fields of a recipe that name it, and those with fields of their own.
_NAMES, _NESTED = ("name", "summary"), ("networks", "settings", "options")


@dataclass(frozen=True)
class Search:
    """Settings of a search.

    Attributes:
        recipe: Name, or `module:attribute`.
        ranges: By the field of the recipe, such as `settings.learning_rate` or `networks.hidden`: `{"choice": [...]}`,
            `{"uniform": [low, high]}`, `{"loguniform": [low, high]}` or `{"randint": [low, high]}` (high excluded).
        trials: Number of settings that are tried.
        steps: Actions of a whole trial; the recipe's if None.
        goals: Validation goals after every segment.
        judge: Key of `JUDGES`.
        searcher: `"random"` or `"optuna"`.
        scheduler: `"none"`, or `"asha"`, which stops trials early.
        seed: Of the searcher, and of every training.
    """

    recipe: str
    ranges: Mapping[str, Mapping[str, Any]]
    trials: int = 10
    steps: int | None = None
    goals: int = 200
    judge: str = "reached"
    searcher: str = "random"
    scheduler: str = "asha"
    seed: int = 0

    def __post_init__(self) -> None:
        for name, least in (("trials", 1), ("goals", 1), ("seed", 0)):
            check_count(name, getattr(self, name), least=least, most=10**6)
        if self.steps is not None:
            check_count("steps", self.steps)
        check_known("judge", self.judge, JUDGES)
        check_known("searcher", self.searcher, SEARCHERS)
        check_known("scheduler", self.scheduler, SCHEDULERS)
        ranges: Any = self.ranges
        if not isinstance(ranges, Mapping) or not ranges:
            raise InputError(f"ranges are a range by the field of the recipe, got {shown(ranges)}")
        for field, content in self.ranges.items():
            _check_range(field, content)
            self.tried({field: next(iter(content.values()))[0]})

    def tried(self, values: Mapping[str, Any]) -> Recipe:
        recipe = get_recipe(self.recipe)
        recipe = recipe if self.steps is None else replace(recipe, steps=self.steps)
        for field, value in values.items():
            recipe = _with(recipe, field, tuple(value) if isinstance(value, list) else value)
        return recipe


def read_search(path: Path) -> Search:
    """Read a search from a file of YAML or JSON with the fields of `Search`."""
    text = read_text(path, "the search", most=2**20)
    try:
        content = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise InputError(f"{path} is not YAML: {error}") from None
    names = [field.name for field in fields(Search)]
    if not isinstance(content, dict) or not {"recipe", "ranges"} <= set(content):
        raise InputError(f"{path} must have at least recipe and ranges, got {shown(content)}")
    for name in content:
        check_known(f"entry of {path}", name, names)
    return Search(**content)


def _check_range(field: object, content: object) -> None:
    form = "choice: [...], uniform: [low, high], loguniform: [low, high] or randint: [low, high]"
    if not isinstance(field, str) or not isinstance(content, Mapping) or len(content) != 1:
        raise InputError(f"a range of {shown(field)} is one of {form}; got {shown(content)}")
    ((kind, values),) = content.items()
    check_known(f"range of {field}", kind, ("choice", "uniform", "loguniform", "randint"))
    if not isinstance(values, list) or not values:
        raise InputError(f"the range of {field} is {form}; got {shown(content)}")
    if kind == "choice":
        return
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    if not numbers or len(values) != 2 or not values[0] < values[1] or (kind == "loguniform" and values[0] <= 0):
        hint = "; in YAML 1e-4 is a text and 1.0e-4 a number" if any(isinstance(value, str) for value in values) else ""
        raise InputError(f"the range of {field} needs two numbers, the lower one first; got {shown(values)}{hint}")


def _with(recipe: Recipe, field: str, value: Any) -> Recipe:
    """Return a recipe with another value of a field, or of an entry of one."""
    name, _, entry = field.partition(".")
    known = [each.name for each in fields(Recipe) if each.name not in _NAMES]
    check_known("field of a recipe", name, known)
    if bool(entry) != (name in _NESTED):
        raise InputError(f"a range is of a field of the recipe or of an entry of {', '.join(_NESTED)}; got {field!r}")
    if not entry:
        return replace(recipe, **{name: value})
    if name == "networks":
        check_known("field of networks", entry, [each.name for each in fields(Networks)])
        return replace(recipe, networks=replace(recipe.networks, **{entry: value}))
    changed: dict[str, Any] = {name: {**getattr(recipe, name), entry: value}}
    return replace(recipe, **changed)


def search(given: Search, out: Path, *, resume: bool = False, threads: int = 1) -> dict[str, Any]:
    """Run a search on the Ray cluster that this process is connected to; return the contents of `results.json`.

    `out` gets `results.json`, `results.csv`, and Tune's own `tune`. With `resume` the search in it goes on, where
    unfinished trials begin anew. Each trial has `threads` of torch.
    """
    tune = load_extra("ray.tune", RAY)
    make_writable(out)
    with locked(out, "a search"):
        found = _tuner(tune, given, out / STATE, resume=resume, threads=threads).fit()
    metric, mode = given.judge, JUDGES[given.judge][1]
    rows = [dict(_rows(result, given)) for result in found]
    finished = [row for row in rows if row[metric] is not None]
    if not finished:
        reason = next((str(result.error).strip().splitlines()[-1] for result in found if result.error), "none ran")
        raise InputError(f"no trial of the search came to anything: {reason}")
    worst = float("inf")
    rows.sort(key=lambda row: worst if row[metric] is None else row[metric] * (-1 if mode == "max" else 1))
    best = given.tried({field: rows[0][field] for field in given.ranges})
    results = {
        "search": asdict(given), "trials": rows, "best": best.to_dict(),
        "versions": provenance.versions((*provenance.DISTRIBUTIONS, "torch", "stable-baselines3", "ray", "optuna")),
    }  # fmt: skip
    write_text(out / TRIALS, _csv(rows))
    write_text(out / RESULTS, json.dumps(results, indent=2) + "\n")
    return results


def _tuner(tune: Any, given: Search, state: Path, *, resume: bool, threads: int) -> Any:
    def run(values: Mapping[str, Any]) -> None:
        for done, scores in trial(given, values, threads):
            tune.report({"steps": done, **scores})

    trainable = tune.with_resources(run, {"cpu": threads})
    if resume and tune.Tuner.can_restore(str(state)):
        return tune.Tuner.restore(str(state), trainable, resume_unfinished=True, restart_errored=True)
    mode = JUDGES[given.judge][1]
    if given.searcher == "optuna":
        load_extra("optuna", RAY)
        searcher = load_extra("ray.tune.search.optuna", RAY).OptunaSearch(seed=given.seed)
    else:
        basic = load_extra("ray.tune.search.basic_variant", RAY)
        searcher = basic.BasicVariantGenerator(random_state=given.seed)
    scheduler = None
    if given.scheduler == "asha":
        asha = load_extra("ray.tune.schedulers", RAY).ASHAScheduler
        most = given.tried({}).steps
        scheduler = asha(time_attr="steps", max_t=most, grace_period=max(1, most // 9), reduction_factor=3)
    return tune.Tuner(
        trainable,
        param_space={field: getattr(tune, kind)(*([values] if kind == "choice" else values))
                     for field, content in given.ranges.items() for kind, values in content.items()},
        tune_config=tune.TuneConfig(
            metric=given.judge, mode=mode, num_samples=given.trials, search_alg=searcher, scheduler=scheduler
        ),
        run_config=tune.RunConfig(
            name=state.name, storage_path=str(state.parent.resolve()), verbose=0,
            failure_config=tune.FailureConfig(max_failures=0),
        ),
    )  # fmt: skip


def trial(given: Search, values: Mapping[str, Any], threads: int = 1) -> Iterator[tuple[int, dict[str, float]]]:
    """Train with some settings; after each segment yield the number of actions and the scores."""
    recipe = given.tried(values)
    with TemporaryDirectory(prefix="kinreach-") as name:
        identity = run_identity(recipe, given.seed, threads)
        for policy in segments(recipe, Path(name), identity, resume=False):
            found = evaluate(policy, goals=given.goals, seed=VALIDATION, options=recipe.judged_in).summary()
            yield policy.card.steps, {name: judge(found) for name, (judge, _) in JUDGES.items() if name in found}


def _rows(result: Any, given: Search) -> Iterator[tuple[str, Any]]:
    """Return a trial's row: settings, steps, scores, and how it ended."""
    metrics = result.metrics or {}
    yield from ((field, result.config[field]) for field in given.ranges)
    yield "steps", metrics.get("steps")
    yield from ((name, metrics.get(name)) for name in JUDGES)
    whole = (metrics.get("steps") or 0) >= given.tried(result.config).steps
    yield "status", "failed" if result.error else "finished" if whole else "ended early"


def _csv(rows: list[dict[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
