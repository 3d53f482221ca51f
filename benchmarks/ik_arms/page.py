"""The results as a page: a table by class, what every solver refuses, a CSV file with all rows, a figure."""

from __future__ import annotations

import csv
import io
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import median
from textwrap import fill
from typing import Any

from matplotlib.lines import Line2D

from benchmarks.ik_arms.arms import CASES, CLASSES, NONE, PARALLEL, SEVEN, WRIST
from benchmarks.ik_arms.measure import ON_CURVE, RIGHT, SEVENTH, Effort
from benchmarks.ik_arms.self_motions import ERROR, FULL, HEADINGS, faultless, read, summary
from benchmarks.ik_arms.solvers import Kinreach
from benchmarks.speed.report import PACKAGES, show, table
from kinreach._files import make_writable, replacing, write_text
from kinreach._provenance import machine, versions
from kinreach.plots._colours import colours_of
from kinreach.plots._style import FAINT, INK, new_figure

Line = dict[str, Any]
COLUMNS = (
    "", "arms", "recall [%]", "wrong", "singular, empty [%]", "one pose [us]", "x kinreach", "in a batch [us]",
    "x kinreach's batch", "preparation [s]", "memory [MB]",
)  # fmt: skip
#: Columns that are drawn, and what is written above them.
PANELS = {
    "recall [%]": "postures found",
    "singular, empty [%]": "singular poses\nwithout an answer",
    "one pose [us]": "time of one pose",
}
#: What is written below them.
_UNITS = {"recall [%]": "% of all", "singular, empty [%]": "% of them", "one pose [us]": "µs, median of arms"}


_EIGENVALUES = (
    "each pose is an eigenvalue problem of size 16. The 3 to 10 % of the poses near a singularity are solved again "
    "from six such problems, and take half of the time or more; most on arms that are nearly of a class"
)
#: Classes, column, goal [us], what is measured, and why arms miss it.
TIMES = (
    (
        (WRIST, PARALLEL), "single", 60.0, "one pose",
        "the arithmetic is that of the arms which take 35 us; other programs on the machine make some blocks of a run "
        "twice as slow",
    ),
    (
        (WRIST, PARALLEL), "batch", 2.0, "in a batch",
        "the arithmetic is that of the arms which take 1 us; other programs on the machine make some blocks of a run "
        "twice as slow",
    ),
    ((NONE,), "single", 1000.0, "one pose", _EIGENVALUES),
    ((NONE,), "batch", 100.0, "in a batch", _EIGENVALUES),
    (
        (SEVEN,), "single", 100_000.0, "one pose",
        "a third of the time goes into the postures from which the curves start, a fifth into following them, about a "
        "thousand postures 0.1 rad apart, and a third into Python",
    ),
)  # fmt: skip


def write(lines: Sequence[Line], effort: Effort, page: Path, *, command: str) -> None:
    """Write the page, its CSV file beside it, and its figure among the images above it, or beside it.

    Raises:
        OutputError: They cannot be written.
    """
    above = page.parent.parent / "images"
    image = (above if above.is_dir() else page.parent) / f"{page.stem}.png"
    make_writable(page.parent)
    with replacing(image) as temporary:
        _figure(lines).savefig(temporary, dpi=140, format="png")
    text = io.StringIO()
    fields = list(dict.fromkeys(field for line in lines for field in line))
    writer = csv.DictWriter(text, fields, lineterminator="\n")
    writer.writeheader()
    writer.writerows({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in line.items()} for line in lines)
    write_text(page.with_suffix(".csv"), text.getvalue())
    picture = Path(os.path.relpath(image, page.parent)).as_posix()
    write_text(page, "\n\n".join(_parts(lines, effort, page.with_suffix(".csv"), picture, command)) + "\n")


def _parts(lines: Sequence[Line], effort: Effort, data: Path, picture: str, command: str) -> Iterator[str]:
    here, found = machine(), versions(PACKAGES)
    names = ", ".join(f"{name} {version}" for name, version in found.items() if version and "source" not in name)
    arms, solvers = (len({line[of] for line in lines}) for of in ("arm", "solver"))
    yield "# Inverse kinematics of every arm"
    yield f"<!-- written by `{command}`; do not edit -->"
    yield (
        f"Every posture of {arms} arms by {solvers} solvers: the arms that ssik ships, and URs with published "
        "calibrations. Pinocchio judges every posture. Where kinreach loses is listed."
    )
    yield f"![Recall, singular poses and time of one pose, a dot for each class and solver]({picture})"
    yield (
        f"Random poses: {effort.poses} of each arm, {-(-effort.poses // SEVENTH)} with seven axes, at most 40 of a "
        "calibrated UR. **Recall** is the share of all postures that any solver finds. A posture is **wrong** if its "
        f"tip is more than {RIGHT:g} m or rad from the pose. With seven axes postures form curves, and solvers return "
        f"samples; a posture is found if a sample is within {ON_CURVE} rad in every joint. **Singular** poses: "
        f"{effort.singular} in each of {len(CASES)} cases ({', '.join(CASES)}); empty are those without a right "
        "posture. TRAC-IK is iterative and returns one posture. Joint limits are off."
    )
    yield (
        "A time is the processor's, the median of blocks, then of the arms. Blocks take turns with kinreach's. Above "
        "1, kinreach is faster. TRAC-IK has two threads, and stops after 20 ms. Memory is the peak of a process that "
        f"holds the judge, too. A solver has {effort.limit} s of processor time for an arm, preparation included."
    )
    if effort.limit < Effort.limit:
        yield "**Measured with `--quick`: few poses, few repetitions and short limits. The times are rough.**"
    for kind in CLASSES:
        rows = [_row(solver, chosen) for solver, chosen in _grouped(lines, kind)]
        if rows:
            yield f"## {kind[0].upper()}{kind[1:]}"
            yield table(COLUMNS, rows)
    if curves := read(data.with_name("self_motions.csv")):
        yield "### Self-motions"
        yield (
            "All curves of random poses, limits off: the posture that made the pose is on one, every curve reaches the "
            f"pose, and the tip stands still along it. The first {FULL} poses of each arm are also compared with "
            "ssik's samples and charts, and searched for further curves by a grid twice as fine; these two columns "
            f"count those only. Errors are up to {1e3 * ERROR:g} mm and {1e3 * ERROR:g} mrad along and about each "
            "axis of every joint. Rows: [self_motions.csv](self_motions.csv). Again: `python -m "
            "benchmarks.ik_arms.self_motions --out docs/reference/self_motions.csv`."
        )
        yield table(HEADINGS, list(summary(curves)))
    yield "## Goals"
    yield "Of kinreach, for every arm of a class. What is worse than the goal on some arms is missed."
    yield "\n".join(_goals(lines, curves)) or "None of these arms has one."
    yield "## Refused, because"
    refused = Counter((line["solver"], line["refused"]) for line in lines if line["refused"])
    yield "\n".join(f"* {solver}, {_arms(count)}: {why}" for (solver, why), count in refused.items()) or "None."
    yield "## Where kinreach loses"
    yield "\n".join(_losses(lines)) or "Nowhere in this run."
    yield "## Enter a solver"
    yield (
        "A class with `name`, `__init__(kin)` and `all(T)` takes part; `kin` is the arm, and a constructor that raises "
        "refuses it:"
    )
    yield (
        '```python\nclass MySolver:\n    name = "mine"\n\n    def __init__(self, kin):\n'
        "        self.urdf = kin.arm.urdf  # and kin.chain.placements, kin.fk\n\n"
        "    def all(self, T):\n        return solutions  # postures [rad], shape (k, n)\n```"
    )
    yield f"    {command.split(' --')[0]} --solver my_module:MySolver"
    yield (
        "Results of the other solvers are kept, so it is measured alone. ssik's answers for calibrated URs are stored "
        "(`benchmarks.studies.calibrated_arms --oracle`), with their times: it prepares each for 2 to 12 minutes."
    )
    yield (
        f"Machine: {here['processor']}, {here['cores']} cores, load {os.getloadavg()[2]:.0f}. Versions: {names}. "
        f"All rows: [{data.name}]({data.name}). Again: `{command}`"
    )


def _grouped(lines: Sequence[Line], kind: str) -> Iterator[tuple[str, list[Line]]]:
    for solver in dict.fromkeys(line["solver"] for line in lines):
        chosen = [line for line in lines if line["solver"] == solver and line["class"] == kind]
        if chosen:
            yield solver, chosen


def _row(solver: str, lines: Sequence[Line]) -> list[Any]:
    taken = [line for line in lines if not line["refused"]]
    if not taken:
        return [solver, f"0 of {len(lines)}", *[None] * (len(COLUMNS) - 2)]
    asked, empty, wrong = (
        sum(line.get(f"{c}: {what}") or 0 for line in taken for c in CASES) for what in ("poses", "empty", "wrong")
    )
    return [
        solver,
        f"{len(taken)} of {len(lines)}",
        sum(line["recall"] * line["union"] for line in taken) / sum(line["union"] for line in taken),
        sum(line["wrong"] for line in taken) + wrong,
        100 * empty / asked if asked else None,
        _middle(taken, "single", 1e6),
        _middle(taken, "ratio"),
        _middle(taken, "batch", 1e6),
        _middle(taken, "batch_ratio"),
        _middle(taken, "preparation"),
        _middle(taken, "megabytes"),
    ]


def _middle(lines: Sequence[Line], field: str, scale: float = 1.0) -> float | None:
    values = [line[field] * scale for line in lines if line.get(field) is not None]
    return float(median(values)) if values else None


def _goals(lines: Sequence[Line], curves: Sequence[dict[str, str]]) -> Iterator[str]:
    """Lines of a list: each goal, met or missed, with the median and the worst of the arms that it is set for."""
    ours = [line for line in lines if line["solver"] == Kinreach.name]
    taken = [line for line in ours if not line["refused"]]
    yield _goal("arms taken", [100.0 * (not line["refused"]) for line in ours], 100.0, "%", least=True)
    why = "near a singularity others return postures some mrad beside kinreach's that still reach the pose within 1e-6"
    yield _goal("recall", [line["recall"] for line in taken], 100.0, "%", least=True, why=why)
    empty = [float(sum(line.get(f"{case}: empty") or 0 for case in CASES)) for line in taken if line["class"] != SEVEN]
    yield _goal("singular poses without an answer", empty, 0.0, "")
    for kinds, field, bound, what, why in TIMES:
        chosen = [line for line in taken if line["class"] in kinds and line.get(field) is not None]
        name = f"{' or '.join(kinds)}, {what}"
        yield _goal(name, [1e6 * line[field] for line in chosen], bound, "us", why=why)
    for field, what in (("ratio", "one pose"), ("batch_ratio", "a batch")):
        ratios = [1.0 / line[field] for line in lines if line["solver"] == "EAIK" and line.get(field)]
        yield _goal(f"{what} beside EAIK", ratios, 4.0, "times")
    if curves:
        yield _goal("self-motions with a fault", [100.0 * (not faultless(row)) for row in curves], 0.0, "%")


def _goal(name: str, values: Sequence[float], bound: float, unit: str, *, least: bool = False, why: str = "") -> str:
    """A line: whether all values are at most, or at least, a bound; and why not."""
    if not values:
        return f"* {name}: not measured."
    met = sum(value >= bound - 1e-9 if least else value <= bound + 1e-9 for value in values)
    worst = min(values) if least else max(values)
    numbers = f"median {show(float(median(values)))}, worst {show(float(worst))}"
    verdict = "met" if met == len(values) else f"**missed** by {len(values) - met} of {len(values)}"
    reason = f" Why: {why}." if why and met < len(values) else ""
    return f"* {name}, at {'least' if least else 'most'} {f'{bound:g} {unit}'.strip()}: {verdict} ({numbers}).{reason}"


def _losses(lines: Sequence[Line]) -> Iterator[str]:
    """Lines of a list: postures that kinreach misses, and arms on which another solver is faster."""
    ours = [line for line in lines if line["solver"] == Kinreach.name]
    refused = [line["arm"] for line in ours if line["refused"]]
    if refused:
        yield f"* Refused: {', '.join(refused)}."
    taken = [line for line in ours if not line["refused"]]
    missed = [f"{line['arm']} ({100 - line['recall']:.1f} %)" for line in taken if line["recall"] < 100 - 1e-9]
    if missed:
        yield f"* Missed postures: {', '.join(missed)}."
    wrong = [line["arm"] for line in taken if line["wrong"] or any(line.get(f"{case}: wrong") for case in CASES)]
    if wrong:
        yield f"* Wrong postures: {', '.join(wrong)}."
    empty = [f"{line['arm']} ({case}: {line[f'{case}: empty']} of {line[f'{case}: poses']})"
             for line in taken for case in CASES if line.get(f"{case}: empty")]  # fmt: skip
    if empty:
        yield f"* Singular poses without an answer: {', '.join(empty)}."
    for kind in CLASSES:
        for solver, chosen in _grouped(lines, kind):
            for what, field in (("one pose", "ratio"), ("a batch", "batch_ratio")):
                ratios = [line[field] for line in chosen if line.get(field) is not None]
                faster = [ratio for ratio in ratios if ratio < 1.0]
                if faster and solver != Kinreach.name:
                    times = (
                        f"{1 / max(faster):.1f} to {1 / min(faster):.1f} times"
                        if len(faster) > 1
                        else f"{1 / faster[0]:.1f} times"
                    )
                    yield f"* {kind}, {what}: {solver} is {times} as fast on {len(faster)} of {_arms(len(ratios))}."


def _arms(count: int) -> str:
    return f"{count} arm" + ("s" if count != 1 else "")


def _figure(lines: Sequence[Line]) -> Any:
    """Recall, singular poses and time of one pose: a row for each class, a dot for each solver."""
    kinds = [kind for kind in CLASSES if any(line["class"] == kind for line in lines)]
    colours = colours_of(line["solver"] for line in lines)
    figure, panels = new_figure("", size=(7.4, 1.5 + 0.85 * len(kinds)), columns=len(PANELS))
    for axes, (column, title) in zip(panels, PANELS.items(), strict=True):
        most = 0.0
        for row, kind in enumerate(kinds):
            axes.axhline(row + 0.5, color="#e4e4e4", lw=0.8)
            for solver, chosen in _grouped(lines, kind):
                value = _row(solver, chosen)[COLUMNS.index(column)]
                place = row + 0.12 * (list(colours).index(solver) - (len(colours) - 1) / 2)
                if value is not None:
                    axes.plot(value, place, "o", ms=6.0, color=colours[solver], clip_on=False)
                    most = max(most, value)
        if "[%]" in column:
            top = 100.0 if most > 50.0 else 50.0
            axes.set_xlim(-0.03 * top, 1.03 * top)
            axes.set_xticks([0.0, 0.5 * top, top])
        else:
            axes.set_xscale("log")
            axes.set_xticks([10.0**power for power in range(1, 6)], ["10", "100", "1k", "10k", "100k"])
            axes.set_xticks([], minor=True)
            axes.set_xlim(6.0, 3e5)
        axes.set_yticks(range(len(kinds)), [""] * len(kinds))
        axes.set_ylim(len(kinds) - 0.5, -0.5)
        axes.grid(visible=False, axis="y")
        axes.tick_params(labelsize=10.5)
        axes.set_xlabel(_UNITS[column], fontsize=10.5, color=FAINT)
        axes.set_title(title, fontsize=10.5, color=INK, loc="left")
    figure.get_layout_engine().set(wspace=0.06)  # type: ignore[union-attr, call-arg]
    counts = Counter(line["class"] for line in lines if line["solver"] == Kinreach.name)
    names = [fill(f"{kind} ({counts[kind]})", 18) for kind in kinds]
    panels[0].set_yticks(range(len(kinds)), names, fontsize=10.5)
    handles = [Line2D([], [], ls="", marker="o", ms=6.0, color=colour) for colour in colours.values()]
    figure.legend(handles, list(colours), loc="outside upper center", ncols=3, frameon=False, fontsize=10.5)
    return figure
