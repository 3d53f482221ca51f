"""The comparison as one HTML file that needs nothing else: figures and pictures are in it, nothing is fetched.

Every text is escaped; and should one slip through, the page's policy lets no script run but the one that sorts.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

from PIL import Image

from kinreach.compare import figures
from kinreach.compare.contests import CONTESTS
from kinreach.compare.report_pictures import Rendering, render_trials
from kinreach.compare.report_table import headings_and_rows
from kinreach.compare.tasks import TASKS
from kinreach.compare.trials import Trial
from kinreach.errors import DrawingError, InstallationError
from kinreach.files import write_text

#: Dots per inch that a browser counts with.
PAGE_DPI = 96


def write_report(path: Path, trials: Sequence[Trial], results: Mapping[str, Any], charts: Mapping[str, Path]) -> None:
    """Write the report.

    Pictures of the arm are drawn where there is OpenGL; elsewhere a sentence says that there is none.

    Args:
        path: The HTML file.
        trials: All of them.
        results: Contents of `results.json`.
        charts: PNG files of figures by their titles.

    Raises:
        OutputError: The file system refused.
    """
    try:
        renderings: list[Rendering] | str = render_trials(trials, results)
    except (InstallationError, DrawingError) as error:
        renderings = f"None: {' '.join(str(error).split())}"
    write_text(path, report_html(results, charts, renderings))


def report_html(results: Mapping[str, Any], charts: Mapping[str, Path], renderings: Sequence[Rendering] | str) -> str:
    """The page.

    Args:
        results: Contents of `results.json`.
        charts: PNG files of figures by their titles.
        renderings: Of trials, or in a sentence why there are none.
    """
    settings = results["settings"]
    folder = resources.files("kinreach.compare")
    script = folder.joinpath("report_sort.js").read_text(encoding="utf-8")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    headings, rows = headings_and_rows(results["methods"])
    return Template(folder.joinpath("report_template.html").read_text(encoding="utf-8")).substitute(
        policy=f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{digest}'",
        title=escape(TASKS[settings["task"]].title),
        summary=escape(
            f"{len(results['methods'])} methods on the same {settings['goals']} goals, seed {settings['seed']}. "
            f"Reached: {settings['terms']['reached']}."
        ),
        command=escape(settings["command"]),
        headings=headings,
        rows=rows,
        notes="<br>\n".join(map(escape, _notes(results))),
        figures="\n".join(_chart(file, title) for title, file in charts.items()),
        renderings=_renderings(renderings),
        settings=_terms(_flat(settings)),
        versions=_terms((name, "not installed" if v is None else str(v)) for name, v in results["versions"].items()),
        script=script,
    )


def _notes(results: Mapping[str, Any]) -> Iterable[str]:
    yield from CONTESTS[results["settings"]["task"]].notes(results)
    yield f"Intervals: {results['settings']['intervals']}."


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
    """A figure, which says in itself what it shows, with its text as large as the page's."""
    with Image.open(file) as picture:
        width = round(PAGE_DPI / figures.DPI * picture.width)
    uri = _data_uri("image/png", file.read_bytes())
    return f'<figure class="chart"><img src="{uri}" alt="{escape(title)}" width="{width}"></figure>'


def _picture(rendering: Rendering) -> str:
    said = escape(rendering.caption)
    uri = _data_uri("image/jpeg", rendering.jpeg)
    return f'<figure><img src="{uri}" alt=""><figcaption>{said}</figcaption></figure>'


def _data_uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def _terms(pairs: Iterable[tuple[str, str]]) -> str:
    return "\n".join(f'<tr><th scope="row">{escape(name)}</th><td>{escape(text)}</td></tr>' for name, text in pairs)


def _flat(settings: Mapping[str, Any]) -> Iterable[tuple[str, str]]:
    """Names and texts, groups dissolved into their members."""
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from ((f"{name}: {inner}", text) for inner, text in _flat(value))
        elif value is not None:
            yield name.replace("_", " "), ", ".join(map(str, value)) if isinstance(value, list) else str(value)
