"""Write a comparison as one HTML file that contains its figures and pictures and fetches nothing.

Every text is escaped; and should one slip through, the page's policy lets no script run but the one that sorts.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
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
from kinreach.compare._task import Task, arm_in
from kinreach.errors import DrawingError, InstallationError
from kinreach.sim._picture import Scene, ScenePicture
from kinreach.sim._posed import PosedScene

#: Dots per inch that a browser counts with.
PAGE_DPI = 96
#: Quality of the pictures' JPEG.
QUALITY = 85


@dataclass(frozen=True)
class Rendering:
    """A picture of how a trial ended.

    Attributes:
        method: Whose trial.
        caption: What it shows.
        image: uint8, shape (height, width, 3).
    """

    method: str
    caption: str
    image: Any


def write_report(
    path: Path,
    task: Task,
    trials: Sequence[Trial],
    results: Mapping[str, Any],
    charts: Mapping[str, Path],
    notes: Sequence[str],
) -> None:
    """Write the report, and `scene.png` beside it: how the first method's ordinary success looks.

    Pictures of the arm need OpenGL; without it, a sentence says so.

    Args:
        path: The HTML file.
        task: What was compared.
        trials: All of them.
        results: Contents of `results.json`.
        charts: PNG files of figures by their titles.
        notes: What the numbers mean, line by line.

    Raises:
        OutputError: The file system refused.
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
    write_text(path, printable(report_html(task, results, charts, renderings, notes)))


def report_html(
    task: Task,
    results: Mapping[str, Any],
    charts: Mapping[str, Path],
    renderings: Sequence[Rendering] | str,
    notes: Sequence[str],
) -> str:
    """Return the page; arguments as in `write_report`, and renderings of trials, or a sentence why they are missing."""
    settings = results["settings"]
    folder = resources.files("kinreach.compare")
    script = folder.joinpath("report_sort.js").read_text(encoding="utf-8")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return Template(folder.joinpath("report_template.html").read_text(encoding="utf-8")).substitute(
        policy=f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{digest}'",
        title=escape(settings["title"]),
        finding=escape(finding(results)),
        summary=escape(
            f"{len(results['methods'])} methods on the same {settings['goals']} goals, seed {settings['seed']}. "
            f"Reached: {settings['terms']['reached']}."
        ),
        command=escape(settings["command"]),
        tables="\n".join(_tables(task.columns, results["methods"])),
        notes="<br>\n".join(map(escape, [*notes, f"Intervals: {settings['intervals']}."])),
        figures="\n".join(_chart(file, title) for title, file in charts.items()),
        renderings=_renderings(renderings),
        settings=_terms(_flat(settings)),
        versions=_terms((name, "not installed" if v is None else str(v)) for name, v in results["versions"].items()),
        script=script,
    )


def finding(results: Mapping[str, Any]) -> str:
    """Return the finding in a sentence: which methods reach how many goals, come nearest and decide soonest.

    It is empty if the task has no column of goals that were reached.
    """
    entries = results["methods"]
    if any(entry.get("reached") is None for entry in entries):
        return ""
    most = max(entry["reached"] for entry in entries)
    best = [entry for entry in entries if entry["reached"] == most]
    rest = [entry for entry in entries if entry["reached"] < most]
    share = "every goal" if most == 1 else f"{100 * most:.1f} % of the goals" if most else "none of the goals"
    if len(best) == 1:
        parts = [f"{best[0]['name']} reaches {share}"]
    else:
        parts = [f"{len(best)} of {len(entries)} methods reach {share}" if rest else f"All methods reach {share}"]
        if most:
            for key, words in (
                ("distance_mm", "ends nearest, {} mm in the median"),
                ("solve_ms", "decides soonest, {} ms"),
            ):
                medians: dict[str, Any] = {entry["name"]: (entry.get(key) or {}).get("median") for entry in best}
                if None not in medians.values():
                    least = min(medians, key=medians.__getitem__)
                    parts.append(f"{least} {words.format(number(medians[least]))}")
    if rest:
        shares = (f"{entry['name']} {100 * entry['reached']:.1f} %" for entry in rest)
        parts.append(f"the others: {', '.join(shares)}")
    return "; ".join(parts) + "."


def render_trials(task: Task, trials: Sequence[Trial], results: Mapping[str, Any]) -> list[Rendering]:
    """Draw the trials that `chosen` picks, method by method, as `task.scene` says.

    Raises:
        InstallationError: No library can draw; the message names the packages.
        DrawingError: The graphics library failed, or the task has no `scene` and its environment no arm.
    """
    settings = results["settings"]
    options = {name: value for name, value in task.options.items() if name != "observation"}
    env = gym.make(task.environment, disable_env_checker=True, **options)
    found = []
    try:
        resets = task.resets(settings["goals"], settings["seed"], env)
        for method in results["methods"]:
            own = [trial for trial in trials if trial["method"] == method["name"]]
            for what, trial in chosen(own).items():
                env.reset(**resets[trial["goal_index"]])
                scene = (task.scene or posed_scene)(env, trial)
                found.append(Rendering(trial["method"], _caption(what, trial), _frame(scene)))
    finally:
        env.close()
    return found


def posed_scene(env: gym.Env[Any, Any], trial: Trial) -> PosedScene:
    """Return the environment's arm in its work cell, in the posture in which a trial ended, within its limits or not.

    Raises:
        DrawingError: The environment has no `arm`, or the trial no posture `q`.
    """
    arm = arm_in(env)
    if arm is None or trial.get("q") is None:
        missing = "its environment has no `arm`" if arm is None else "a trial has no posture `q`"
        raise DrawingError(f"{missing}, and the task has no `scene`")
    scene = PosedScene(arm)
    scene.put(trial["q"], ball=trial.get("goal"))
    return scene


def _frame(scene: Scene) -> Any:
    picture = ScenePicture(scene, mode="rgb_array", fps=1)
    try:
        return picture.frame()
    finally:
        picture.close()


def chosen(trials: Sequence[Trial]) -> dict[str, Trial]:
    """Return a method's ordinary success and its worst trial, by their captions.

    Where the task has no distance, all are as far. The ordinary success has the median distance of all goals that were
    reached. The worst trial is the failure that left the tip farthest from the goal, impossible ones first; without a
    failure it is the success with the largest distance.

    Args:
        trials: Of one method, at least one.
    """
    reached = sorted((trial for trial in trials if trial["reached"]), key=_distance)
    failed = [trial for trial in trials if not trial["reached"]]
    found = {}
    if reached:
        found["success"] = reached[(len(reached) - 1) // 2]
    if failed:
        found["worst failure"] = max(failed, key=lambda trial: (trial["impossible"], _distance(trial)))
    else:
        found["largest distance, reached all the same"] = reached[-1]
    return found


def _distance(trial: Trial) -> float:
    return float(trial.get("distance") or 0.0)


def _caption(what: str, trial: Trial) -> str:
    parts = [f"{what[0].upper()}{what[1:]}", f"goal {trial['goal_index']}"]
    if trial.get("distance") is not None:
        parts.append(f"{number(1e3 * trial['distance'])} mm")
    if trial.get("posture_error") is not None:
        parts.append(f"posture error {number(trial['posture_error'])} rad")
    if trial["steps"] > 1:
        parts.append(f"{trial['steps']} steps")
    if trial["impossible"]:
        parts.append(trial.get("impossible_reason") or trial["status"])
    return " · ".join(parts)


def _tables(columns: Sequence[Column], entries: Sequence[Mapping[str, Any]]) -> Iterable[str]:
    """Yield the columns with a heading as HTML tables, one a title, without columns in which nothing was measured."""
    found: dict[str, list[Column]] = {}
    for column in columns:
        if column.heading and (column.show or "." not in column.key) and any(map(column.measured, entries)):
            found.setdefault(column.table, []).append(column)
    for title, shown in found.items():
        head = "".join(map(_heading, ("method", *([] if title else ["kind"])), ("text", "text")))
        head += "".join(_heading(column.heading, "number") for column in shown)
        rows = "\n".join(_row(entry, shown, kind=not title) for entry in entries)
        caption = f"<h3>{escape(title)}</h3>" if title else ""
        yield (
            f'{caption}<div class="wide"><table class="sortable">\n<thead><tr>{head}</tr></thead>\n'
            f"<tbody>\n{rows}\n</tbody>\n</table></div>"
        )


def _heading(text: str, kind: str) -> str:
    return f'<th scope="col" data-kind="{kind}"><button type="button">{escape(text)}</button></th>'


def _row(entry: Mapping[str, Any], columns: Sequence[Column], *, kind: bool) -> str:
    name = escape(entry["name"])
    cells = [f'<th scope="row" data-value="{name}">{name}</th>']
    if kind:
        cells.append(f'<td data-value="{escape(entry["kind"])}">{escape(entry["kind"])}</td>')
    for column in columns:
        show = column.show or {QUANTILES: "quantiles", SPREAD: "quantiles", "rate": "interval"}.get(
            column.summary, "mean"
        )
        value = column.number(entry, show if show == "mean" else "")
        by = "" if value is None else escape(str(value))
        cells.append(f'<td data-value="{by}">{escape(column.text(entry, show))}</td>')
    return f"<tr>{''.join(cells)}</tr>"


def _renderings(found: Sequence[Rendering] | str) -> str:
    if isinstance(found, str):
        return f"<p>{escape(found)}</p>"
    by_method: dict[str, list[str]] = {}
    for rendering in found:
        by_method.setdefault(rendering.method, []).append(_picture(rendering))
    return "\n".join(
        f'<h3>{escape(name)}</h3><div class="pair">{"".join(pictures)}</div>' for name, pictures in by_method.items()
    )


def _chart(file: Path, title: str) -> str:
    """Return a figure with its text as large as the page's."""
    with Image.open(file) as picture:
        width = round(PAGE_DPI / DPI * picture.width)
    uri = _data_uri("image/png", file.read_bytes())
    return f'<figure class="chart"><img src="{uri}" alt="{escape(title)}" width="{width}"></figure>'


def _picture(rendering: Rendering) -> str:
    content = BytesIO()
    Image.fromarray(rendering.image).save(content, "JPEG", quality=QUALITY)
    uri = _data_uri("image/jpeg", content.getvalue())
    return f'<figure><img src="{uri}" alt=""><figcaption>{escape(rendering.caption)}</figcaption></figure>'


def _data_uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def _terms(pairs: Iterable[tuple[str, str]]) -> str:
    return "\n".join(f'<tr><th scope="row">{escape(name)}</th><td>{escape(text)}</td></tr>' for name, text in pairs)


def _flat(settings: Mapping[str, Any]) -> Iterable[tuple[str, str]]:
    """Yield names and texts, with groups dissolved into their members."""
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from ((f"{name}: {inner}", text) for inner, text in _flat(value))
        elif value is not None:
            yield name.replace("_", " "), ", ".join(map(str, value)) if isinstance(value, list) else str(value)
