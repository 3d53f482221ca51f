"""The command line: measures arm by arm, keeps what is measured, and writes the table."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from benchmarks.ik_arms.arms import arm, arm_names, class_of
from benchmarks.ik_arms.measure import Effort, asked, measure, recalls
from benchmarks.ik_arms.page import write
from benchmarks.ik_arms.solvers import SOLVERS, Solver, solver_class
from benchmarks.speed.report import PACKAGES
from kinreach._checks import check_count, check_known, check_path
from kinreach._files import make_writable, write_text
from kinreach._provenance import versions
from kinreach.cli import Parser

OUT = "results/ik_arms"
QUICK = {"singular": 4, "blocks": 3, "limit": 6}
_EPILOG = """\
A solver is a class with `name`, `__init__(kin)`, which raises to refuse an arm, and `all(T)`, which returns the
postures of a pose as an array (k, n). See benchmarks/ik_arms/solvers.py. Results are kept in --out: the same command
goes on after an interruption, and another --solver is measured alone, beside the results of the others.
"""


def main(argv: Sequence[str], *, prog: str) -> int:
    """Measure, and write `ik_arms.csv`, `ik_arms.md` and `ik_arms.png`.

    Raises:
        KinreachError: Bad input, ssik is missing, or results cannot be written.
    """
    arguments = _parser(prog).parse_args(argv)
    solvers = dict(SOLVERS)
    entered = solver_class(arguments.solver) if arguments.solver else None
    if entered:
        solvers[entered.name] = entered
    names = arm_names()
    chosen = arguments.arms.split(",") if arguments.arms else names
    for name in chosen:
        check_known("arm", name, names)
    poses = arguments.poses if arguments.poses is not None else 10 if arguments.quick else Effort.poses
    effort = Effort(check_count("--poses", poses), **(QUICK if arguments.quick else {}))
    out = check_path("--out", arguments.out)
    make_writable(out)
    page = check_path("--docs", arguments.docs) if arguments.docs else out / "ik_arms.md"
    make_writable(page.parent)
    command = (
        prog
        + (f" --solver {arguments.solver}" if arguments.solver else "")
        + (f" --arms {arguments.arms}" if arguments.arms else "")
        + (f" --poses {arguments.poses}" if arguments.poses is not None else "")
        + (" --quick" if arguments.quick else "")
        + (f" --docs {arguments.docs}" if arguments.docs else "")
    )
    lines: list[dict[str, Any]] = []
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=len(chosen) * len(solvers))
        for name in chosen:
            lines += _arm(
                name, solvers, entered, effort, out, lambda what: bar.update(task, description=what, advance=1)
            )
    write(lines, effort, page, command=command)
    print(f"Written: {page}, {page.with_suffix('.csv')}")
    return 0


def _arm(
    name: str,
    solvers: dict[str, type[Solver]],
    entered: type[Solver] | None,
    effort: Effort,
    out: Path,
    progress: Any,
) -> list[dict[str, Any]]:
    """The lines of an arm, one a solver; what is in its file and of the same kind is not measured again."""
    kin, file = arm(name), out / f"{name}.json"
    identity = {"effort": asdict(effort), "versions": versions(PACKAGES)}
    rows: dict[str, dict[str, Any]] = {}
    try:
        kept = json.loads(file.read_text(encoding="utf-8"))
        rows = kept["rows"] if kept["identity"] == identity else {}
    except (OSError, ValueError, KeyError, TypeError):
        pass
    for label, kind in solvers.items():
        progress(f"{name}: {label}")
        if label not in rows or kind is entered:
            rows[label] = measure(name, kin, kind, effort)
            write_text(file, json.dumps({"identity": identity, "rows": rows}))
    rows = {label: rows[label] for label in solvers}
    shares, union = recalls(rows, asked(name, kin, effort))
    lines = []
    for label, row in rows.items():
        line = {"arm": name, "class": class_of(kin), "solver": label, "refused": row.get("refused", ""), "union": union}
        if label in shares:
            line |= dict(zip(("recall", "generating", "answered"), shares[label], strict=True))
            line |= {key: row.get(key) for key in ("returned", "wrong", "preparation", "megabytes")}
            line |= {key: row.get(key) for key in ("single", "ratio", "batch", "batch_ratio")}
            line |= {f"{case}: {what}": n for case, counts in row["singular"].items()
                     for what, n in zip(("poses", "empty", "wrong"), counts, strict=True)}  # fmt: skip
        lines.append(line)
    return lines


def _parser(prog: str) -> Parser:
    parser = Parser(
        prog=prog,
        description="Compare solvers on every six- and seven-axis arm at hand.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--solver", metavar="MODULE:CLASS", help="enter a solver of your own")
    parser.add_argument("--arms", metavar="A,B", help="some of the arms, such as ur5e_ik,puma560_ik")
    parser.add_argument("--poses", type=int, metavar="N", help=f"of each arm (default: {Effort.poses})")
    parser.add_argument("--quick", action="store_true", help="10 poses, few blocks: shows that it works")
    parser.add_argument("--docs", metavar="FILE", help="write the page there, such as docs/reference/ik_arms.md")
    parser.add_argument("--out", default=OUT, metavar="DIR", help="where results are kept (default: %(default)s)")
    return parser
