"""The results of a benchmark as JSON, as Markdown, and as a page of the documentation."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.speed.sections import Cell, Section, Target
from kinreach._files import make_writable, replacing, write_text
from kinreach._provenance import DISTRIBUTIONS

FORMAT = 1
#: Packages whose versions the page gives.
PEERS = (
    "EAIK", "ik-geo", "ur_analytic_ik", "ssik", "pin-pink", "mink", "ikpy", "roboticstoolbox-python", "pytracik",
    "optik-py", "panda-gym", "pybullet", "gymnasium", "stable_baselines3", "torch",
)  # fmt: skip
PACKAGES = (*DISTRIBUTIONS, *PEERS)
TARGET_COLUMNS = ("", "target", "measured", "met")

Results = Mapping[str, Any]


def write_results(results: Results, folder: Path) -> None:
    """Write `results.json`, `results.md` and a figure for each section in `figures`.

    Raises:
        OutputError: They cannot be written.
    """
    _write(results, folder / "results.json", folder / "results.md", folder / "figures")


def write_page(results: Results, page: Path) -> None:
    """Write a page of the documentation, with the results beside it as JSON and the figures among its images.

    Raises:
        OutputError: They cannot be written.
    """
    _write(results, page.with_suffix(".json"), page, figures_of(page))


def figures_of(page: Path) -> Path:
    """Return the folder of the figures of a page: in the `images` above the page, if there is one, or beside it."""
    above = page.parent.parent / "images"
    return (above if above.is_dir() else page.parent / "images") / page.stem


def pictures_of(results: Results, page: Path, folder: Path) -> dict[str, str]:
    """Return the path of each section's figure, as the page links to it, by the section's title."""
    way = Path(os.path.relpath(folder, page.parent)).as_posix()
    return {
        section.title: f"{way}/{re.sub('[^a-z0-9]+', '-', section.title.lower()).strip('-')}.png"
        for section in sections_of(results)
        if section.charts
    }


def _write(results: Results, data: Path, page: Path, folder: Path) -> None:
    from benchmarks.speed.figure import draw  # matplotlib takes half a second, which `--help` need not wait for

    pictures = pictures_of(results, page, folder)
    make_writable(data.parent)
    for old in folder.glob("*.png"):  # of an earlier run, beside other numbers
        old.unlink()
    if pictures:
        make_writable(folder)
    for section in sections_of(results):
        if (figure := draw(section)) is not None:
            with replacing(folder / Path(pictures[section.title]).name) as temporary:
                figure.savefig(temporary, dpi=130, format="png")
    write_text(data, json.dumps(results, indent=1) + "\n")
    write_text(page, markdown(results, data=data.name, pictures=pictures))


def sections_of(results: Results) -> list[Section]:
    """All sections, in the order in which they were measured."""
    return [Section.from_json(section) for sections in results["suites"].values() for section in sections]


def markdown(results: Results, *, data: str, pictures: Mapping[str, str]) -> str:
    """The report.

    Args:
        results: What `results.json` holds.
        data: Path of that file, as the page links to it.
        pictures: Paths of the sections' figures, as the page links to them, by title.
    """
    return "\n\n".join(_parts(results, data, pictures)) + "\n"


def _parts(results: Results, data: str, pictures: Mapping[str, str]) -> Iterator[str]:
    sections, options, machine = sections_of(results), results["options"], results["machine"]
    yield "# Speed beside other packages"
    yield f"<!-- written by `{results['command']}`; do not edit -->"
    yield (
        "Contenders take turns in every round. A ratio is taken within a round, pair by pair, and its median over the "
        "rounds is shown. A ratio is steadier than the times on a busy machine, but moves too (2.3 became 3.6). p95 is "
        "the time that 95 % of single calls stay below. Where whole rounds were timed, the worst of them is shown. A "
        "package that did not take part is named. Everything runs in one process and on one thread unless a row says "
        "otherwise."
    )
    if options["quick"]:
        yield "**Measured with `--quick`: small sizes and few rounds. These numbers show that it works, no more.**"
    names = ", ".join(f"{name} {version}" for name, version in results["versions"].items() if version)
    absent = ", ".join(name for name, version in results["versions"].items() if version is None)
    yield (
        f"Machine: {machine['processor']}, {machine['cores']} cores, {machine['system']}. "
        f"Seed: {options['seed']}. Versions: {names}." + (f" Not installed: {absent}." if absent else "")
    )
    yield f"Again: `{results['command']}`. All numbers: [{data}]({data})."
    targets = [target for section in sections for target in section.targets]
    if targets:
        yield f"## Targets: {sum(target.met for target in targets)} of {len(targets)} met"
        yield _no_markup(table(TARGET_COLUMNS, [target_cells(target) for target in targets]))
        short = [f"* {target.what}: {target.why}" for target in targets if target.why and not target.met]
        if short:
            yield _no_markup("\n".join(["Why, where a target is not met:", "", *short]))
    for section in sections:
        yield from map(_no_markup, _section(section, pictures.get(section.title, "")))


def _section(section: Section, picture: str) -> Iterator[str]:
    yield f"## {section.title}"
    yield section.text
    if picture:
        yield f"![{section.title}: a dot for each contender]({picture})"
    yield table(section.columns, section.rows)
    if section.missing:
        yield "\n".join(f"* Missing: {name}: {_one_line(why)}" for name, why in section.missing.items())
    rounds = f"Rounds: {section.rounds}. " if section.rounds else ""
    yield f"{rounds}Again: `{section.again}`"


def target_cells(target: Target) -> tuple[str, str, str, str]:
    """Return the cells of a row under `TARGET_COLUMNS`."""
    bound = f"{target.kind} {show(target.bound)} {target.unit}"
    return target.what, bound, f"{show(target.measured)} {target.unit}", "yes" if target.met else "no"


def table(columns: Sequence[str], rows: Sequence[Sequence[Cell]]) -> str:
    """A Markdown table; columns of numbers are aligned to the right."""
    numbers = [
        any(isinstance(row[i], int | float) for row in rows)
        and all(row[i] is None or isinstance(row[i], int | float) for row in rows)
        for i in range(len(columns))
    ]
    lines = [columns, ["---:" if right else "---" for right in numbers], *([show(c) for c in row] for row in rows)]
    return "\n".join(f"| {' | '.join(map(_escaped, line))} |" for line in lines)


def show(cell: Cell) -> str:
    """A cell as text: floats with three significant digits, thousands with a space between them."""
    if cell is None:
        return ""
    if isinstance(cell, str):
        return cell
    if isinstance(cell, float) and (abs(cell) < 1000 or cell != cell):
        return f"{cell:.3g}"
    digits = float(f"{cell:.3g}") if isinstance(cell, float) else cell
    return f"{digits:,.0f}".replace(",", " ")


def _escaped(text: str) -> str:
    return text.replace("|", "\\|")


def _no_markup(text: str) -> str:
    """Markdown in which nothing is HTML: sections may come from a file, and say what a peer's error said."""
    return re.sub(r"<(?=[A-Za-z/!?])", "&lt;", text)


def _one_line(text: str) -> str:
    return " ".join(text.split())
