"""Write a comparison as one HTML file without external resources, and its finding in a few sentences.

Texts are escaped, and the page's policy allows no script except its own, which sorts tables and links downloads.
`_ranking` says which methods reach the goals, and which of those are nearest and fastest.
"""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from datetime import date
from html import escape
from importlib import resources
from io import BytesIO
from pathlib import Path
from string import Template
from typing import Any

import gymnasium as gym
from PIL import Image

from kinreach._checks import printable
from kinreach._files import replacing, write_text
from kinreach._statistics import QUANTILES, SPREAD, Column, Trial, number
from kinreach.compare._figures import DPI
from kinreach.compare._options import options_class
from kinreach.compare._ranking import MIN_GOALS, PARTS, RESOLVED_MM, RESOLVED_TIME, Ranking, part_of
from kinreach.compare._task import Task, arm_in
from kinreach.errors import DrawingError, InstallationError
from kinreach.sim.inside import PosedScene, Scene, ScenePicture

#: Width and height of pictures of a scene [pixels].
SIZE = (960, 540)
#: Quality of the pictures' JPEG.
QUALITY = 85
#: Names of the task's terms -> their headings; others are headings as they are.
HEADINGS = {
    "goal": "Goals",
    "accept": "Accepted postures",
    "tolerance": "Where solvers stop",
    "execution": "Motion",
    "error_budget": "Parts of the distance",
    "seed_posture": "Start posture",
    "success_at_mm": "Share within a tolerance",
    "sight": "Sights",
    "arm": "Limits of the arm",
    "given to a chance": "Given to chance",
    "look": "A look",
    "errors": "What is off",
    "there": "In the second move",
}
OBSERVATIONS = {"geometric": "the true goal", "camera": "where the cameras saw the goal"}


@dataclass(frozen=True)
class Rendering:
    """A picture of how a trial ended.

    Attributes:
        image: uint8, shape (height, width, 3).
    """

    method: str
    caption: str
    image: Any
    reached: bool = False


def write_report(
    path: Path,
    task: Task,
    trials: Sequence[Trial],
    results: Mapping[str, Any],
    charts: Mapping[str, Path],
) -> None:
    """Write the report, and beside it `scene.png`, an ordinary success of the best method.

    Charts are PNG files of figures, by title; the first one opens the report.
    """
    renderings: list[Rendering] | str
    try:
        renderings = render_trials(task, trials, results)
    except (InstallationError, DrawingError) as error:
        renderings = f"None: {' '.join(str(error).split())}"
    else:
        if renderings:
            with replacing(path.with_name("scene.png")) as temporary:
                Image.fromarray(renderings[0].image).save(temporary, "PNG")
    write_text(path, printable(report_html(task, trials, results, charts, renderings)))


def report_html(
    task: Task,
    trials: Sequence[Trial],
    results: Mapping[str, Any],
    charts: Mapping[str, Path],
    renderings: Sequence[Rendering] | str,
) -> str:
    """Return the page; arguments as in `write_report`, and renderings or the reason why there are none."""
    settings = results["settings"]
    folder = resources.files("kinreach.compare")
    script = folder.joinpath("report.js").read_text(encoding="utf-8")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    ranking = Ranking(task, results, trials)
    pictures = [] if isinstance(renderings, str) else list(renderings)
    scene = next((picture for picture in pictures if picture.reached), next(iter(pictures), None))
    shown = [_chart(file, title) for title, file in charts.items()]
    opening = [*([_picture(scene)] if scene else []), *shown[:1]]
    goals = f"{settings['goals']} goals" if settings["goals"] > 1 else "one goal"
    command = " ".join(f"<span>{escape(word)}</span>" for word in settings["command"].split(" "))
    return Template(folder.joinpath("report_template.html").read_text(encoding="utf-8")).substitute(
        policy=f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{digest}'",
        title=escape(settings["title"]),
        finding=" ".join(
            escape(sentence) if number else f"<strong>{escape(sentence)}</strong>"
            for number, sentence in enumerate(ranking.finding())
        ),
        criterion=f"A goal counts as <strong>reached</strong> if: {escape(settings['terms']['reached'])}. "
        f"{len(results['methods'])} methods, the same {goals} for each, seed {settings['seed']}, "
        f"{date.today().isoformat()}. Again: <code>{command}</code>",
        opening=f'<div class="opening{"" if len(opening) > 1 else " alone"}">{"".join(opening)}</div>'
        if opening
        else "",
        tables="\n".join(_tables(ranking)),
        notes="<br>\n".join(map(escape, [*_legend(ranking), *task.notes(results)])),
        figures="\n".join(shown[1:]) or f"<p>None{' besides the one above' if shown else ''}.</p>",
        failures=_failures(task, renderings, scene, results["methods"]),
        settings="\n".join(f"<dt>{escape(name)}</dt><dd>{escape(text)}</dd>" for name, text in _words(task, results)),
        script=script,
    )


def render_trials(task: Task, trials: Sequence[Trial], results: Mapping[str, Any]) -> list[Rendering]:
    """Draw the ends of trials by `task.scene`: an ordinary success, and the worst failure of each method.

    The success is of the nearest method among those that reach. Tasks with a figure of paths have no failures.
    """
    settings, entries = results["settings"], results["methods"]
    options = {name: value for name, value in task.options.items() if name != "observation"}
    own = {entry["name"]: [trial for trial in trials if trial["method"] == entry["name"]] for entry in entries}
    ranking = Ranking(task, results, trials)
    best = next(iter([*ranking.best("distance_mm"), *(entry["name"] for entry in ranking.reaching)]), None)
    wanted: list[tuple[str, Trial]] = []
    if best is not None and (success := ordinary_success(own[best])):
        wanted.append(("an ordinary success", success))
    if task.paths is None:
        for group in own.values():
            failed = sum(not trial["reached"] for trial in group)
            if worst := worst_failure(group):
                wanted.append((f"{failed} of {len(group)} goals not reached, the worst", worst))
    env = gym.make(task.environment, disable_env_checker=True, **options)
    found = []
    try:
        resets = task.resets(settings["goals"], settings["seed"], env) if wanted else []
        for what, trial in wanted:
            env.reset(**resets[trial["goal_index"]])
            frame = _frame((task.scene or posed_scene)(env, trial))
            found.append(Rendering(trial["method"], _caption(what, trial), frame, bool(trial["reached"])))
    finally:
        env.close()
    return found


def posed_scene(env: gym.Env[Any, Any], trial: Trial) -> PosedScene:
    """Return the environment's arm in its work cell, as a trial ended, within its limits or not."""
    arm = arm_in(env)
    if arm is None or trial.get("q") is None:
        missing = "its environment has no `arm`" if arm is None else "a trial has no posture `q`"
        raise DrawingError(f"{missing}, and the task has no `scene`")
    scene = PosedScene(arm)
    scene.put(trial["q"], ball=trial.get("goal"))
    return scene


def _frame(scene: Scene) -> Any:
    picture = ScenePicture(scene, mode="rgb_array", fps=1)
    picture.size = SIZE
    try:
        return picture.frame()
    finally:
        picture.close()


def ordinary_success(trials: Sequence[Trial]) -> Trial | None:
    """Return the trial with the median distance of those that reached their goals."""
    reached = sorted((trial for trial in trials if trial["reached"]), key=_distance)
    return reached[(len(reached) - 1) // 2] if reached else None


def worst_failure(trials: Sequence[Trial]) -> Trial | None:
    """Return the failure with the largest distance, impossible ones first."""
    failed = [trial for trial in trials if not trial["reached"]]
    return max(failed, key=lambda trial: (trial["impossible"], _distance(trial)), default=None)


def _distance(trial: Trial) -> float:
    return float(trial.get("distance") or 0.0)


def _caption(what: str, trial: Trial) -> str:
    parts = [what, f"goal {trial['goal_index']}"]
    if trial.get("distance") is not None:
        parts.append(f"{number(1e3 * trial['distance'])} mm")
    if trial.get("posture_error") is not None:
        parts.append(f"posture error {number(trial['posture_error'])} rad")
    if trial["steps"] > 1:
        parts.append(f"{trial['steps']} steps")
    if trial["impossible"]:
        parts.append(trial.get("impossible_reason") or trial["status"])
    return " · ".join(parts)


def _tables(ranking: Ranking) -> Iterable[str]:
    """Yield the columns with a heading as HTML tables, one a title.

    Columns in which nothing was measured are left out, and so is the second of two of the same value.
    """
    entries, trials = sorted(ranking.results["methods"], key=part_of), ranking.trials
    found: dict[str, list[Column]] = {}
    for column in ranking.task.columns:
        same = any(column.value == other.value for other in found.get(column.table, ()))
        if (
            column.heading
            and (column.show or "." not in column.key)
            and any(map(column.measured, entries))
            and not same
        ):
            found.setdefault(column.table, []).append(column)
    parts = sorted({part_of(entry) for entry in entries})
    for title, group in found.items():
        counts = {column.key: _counts(column, entries, trials) for column in group}
        head = _heading("method", "text")
        head += "".join(_heading(column.heading, "number", counts[column.key]) for column in group)
        rows = []
        for part in parts:
            if len(parts) > 1:
                rows.append(f'<tr class="part"><th colspan="{1 + len(group)}">{escape(PARTS[part])}</th></tr>')
            rows += [_row(entry, group, counts, ranking) for entry in entries if part_of(entry) == part]
        caption = f"<h3>{escape(title)}</h3>" if title else ""
        body = "\n".join(rows)
        yield (
            f'{caption}<div class="wide"><table class="sortable">\n<thead><tr>{head}</tr></thead>\n'
            f"<tbody>\n{body}\n</tbody>\n</table></div>"
        )


def _counts(column: Column, entries: Sequence[Mapping[str, Any]], trials: Sequence[Trial]) -> dict[str, int]:
    counts = {entry["name"]: 0 for entry in entries}
    for trial in trials:
        counts[trial["method"]] += column.of(trial) is not None
    return counts


def _heading(text: str, kind: str, counts: Mapping[str, int] | None = None) -> str:
    """Return a heading, with the number of trials if all methods have as many."""
    same = {n for n in (counts or {}).values() if n}
    count = f"<br><small>n = {same.pop()}</small>" if len(same) == 1 else ""
    return (
        f'<th scope="col" class="{kind}" data-kind="{kind}"><button type="button">{escape(text)}</button>{count}</th>'
    )


def _row(
    entry: Mapping[str, Any], columns: Sequence[Column], counts: Mapping[str, Mapping[str, int]], ranking: Ranking
) -> str:
    name = escape(entry["name"])
    long = ' class="long"' * (len(entry["name"]) > 24)
    dot = f'<i style="background: {escape(entry["colour"])}"></i>'
    enough = ranking.results["settings"]["goals"] >= MIN_GOALS
    cells = [f'<th scope="row"{long} data-value="{name}" title="{escape(entry["kind"])}">{dot}{name}</th>']
    for column in columns:
        show = column.show or {QUANTILES: "quantiles", SPREAD: "quantiles", "rate": "interval"}.get(
            column.summary, "mean"
        )
        value = column.number(entry, show if show == "mean" else "")
        by = "" if value is None else escape(str(value))
        count = counts[column.key]
        own = count[entry["name"]]
        n = f" <small>(n = {own})</small>" if own and len({*count.values()} - {0}) > 1 else ""
        text = _small(column.text(entry, show, count=own))
        reached = column.key in ("reached", "pressed")
        test = (ranking.reached if reached else ranking.measured(column.key)).get(entry["name"])
        text = f"<strong>{text}</strong>" if test and test.same and enough else text
        why = f' title="{escape(test.words(reached))}"' if test and test.best != entry["name"] else ""
        cells.append(f'<td data-value="{by}"{why}>{text}{n}</td>')
    return f"<tr>{''.join(cells)}</tr>"


def _small(text: str) -> str:
    """Return a cell with its interval or percentile in small print."""
    for sign in (" [", " / "):
        first, found, rest = text.partition(sign)
        if found:
            return f"{escape(first)}<small>{escape(found + rest)}</small>"
    return escape(text)


def _legend(ranking: Ranking) -> list[str]:
    if not ranking.reaching or ranking.results["settings"]["goals"] < MIN_GOALS:
        return ["n: trials that have a value."]
    return [
        "Bold: the best, and what a paired test on the same goals cannot tell from it (p ≥ 0.05): McNemar's exact test "
        "of goals reached, the sign test of distances and times. Medians count as equal if they are less than "
        f"{RESOLVED_MM:g} mm apart, which the simulation does not resolve, or {100 * RESOLVED_TIME:g} % of a time. "
        "A cell names its test; hold the pointer over it. "
        "Distances and times are compared only among the methods that reach as many goals as the best. "
        "n: trials that have a value."
    ]


def _failures(
    task: Task, found: Sequence[Rendering] | str, scene: Rendering | None, entries: Sequence[Mapping[str, Any]]
) -> str:
    """Return the failures, without one that opens the report."""
    if isinstance(found, str):
        return f"<p>{escape(found)}</p>"
    if all(entry.get("reached") == 1 for entry in entries):
        return "<p>None: every method reached every goal.</p>"
    if task.paths is not None:
        return "<p>How episodes go is shown by the paths above.</p>"
    failed = [_picture(rendering) for rendering in found if not rendering.reached and rendering is not scene]
    if not failed:
        return "<p>The worst one opens this report.</p>" if found else "<p>None is drawn.</p>"
    return (
        f'<p class="faint">The worst failure of each method that has one.</p><div class="grid">{"".join(failed)}</div>'
    )


def _chart(file: Path, title: str) -> str:
    """Return a figure in the page's text size, with a link to save it."""
    with Image.open(file) as picture:
        width = round(96 / DPI * picture.width)  # browsers have 96 dots per inch
    uri = _data_uri("image/png", file.read_bytes())
    return (
        f'<figure class="chart {escape(file.stem)}"><img src="{uri}" alt="{escape(title)}" width="{width}">'
        f'<figcaption><a download="{escape(file.name)}">Save as PNG</a></figcaption></figure>'
    )


def _picture(rendering: Rendering) -> str:
    content = BytesIO()
    Image.fromarray(rendering.image).save(content, "JPEG", quality=QUALITY)
    uri = _data_uri("image/jpeg", content.getvalue())
    caption = f"<strong>{escape(rendering.method)}</strong>: {escape(rendering.caption)}"
    return f'<figure><img src="{uri}" alt=""><figcaption>{caption}</figcaption></figure>'


def _data_uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def _words(task: Task, results: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    settings = results["settings"]
    for name, text in settings["terms"].items():
        if name != "reached":
            yield HEADINGS.get(name, name[0].upper() + name[1:]), _sentence(text)
    if settings.get("arm"):
        yield "Arm", f"{settings['arm']}."
    if task.observations:
        yield "Observed", f"{OBSERVATIONS.get(settings['observation'], settings['observation'])}."
    options = {name: value for name, value in settings["options"].items() if name not in ("observation", "arm")}
    if options:
        yield "Options", "; ".join(_option(task, name, value) for name, value in options.items()) + "."
    for name, reason in settings["left_out"].items():
        yield f"Left out: {name}", _sentence(reason)
    yield "Intervals", f"{100 * settings['confidence']:g} %: {settings['intervals']}."
    yield "Machine", ", ".join(f"{name} {value}" for name, value in settings["machine"].items()) + "."
    versions = (f"{name} {version or 'not installed'}" for name, version in results["versions"].items())
    yield "Versions", ", ".join(versions) + "."


def _option(task: Task, name: str, value: Any) -> str:
    """Return an option with its value and, if declared, its description."""
    declared = options_class(task.environment)
    meanings = {entry.name: entry.metadata.get("description", "") for entry in fields(declared)} if declared else {}
    text = ", ".join(map(str, value)) if isinstance(value, list) else str(value)
    meaning = re.sub(r'[`"]', "", meanings.get(name, ""))
    return f"{name.replace('_', ' ')} {text}{f' ({meaning})' if meaning else ''}"


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:].rstrip('.')}."
