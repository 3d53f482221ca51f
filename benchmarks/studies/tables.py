"""Tables in Markdown, printed row by row while they are measured, and the CSV files of docs/studies/appendix/data.

A study's command prints its tables; piped into this one they become files, by their order:

python -m benchmarks.studies.loitering results/train | python -m benchmarks.studies.tables loitering
"""

from __future__ import annotations

import argparse
import csv
import io
import math
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from statistics import median

from kinreach._files import write_text
from kinreach._statistics import wilson_interval
from kinreach.cli import Parser, finish
from kinreach.errors import InputError

PROG = "python -m benchmarks.studies.tables"
DATA = Path(__file__).parents[2] / "docs" / "studies" / "appendix" / "data"


def head(*names: str) -> str:
    """The two lines above the rows."""
    return f"{line(*names)}\n{'|---' * len(names)}|"


def line(*cells: object) -> str:
    """Write cells as a row of a Markdown table."""
    return f"| {' | '.join(map(str, cells))} |"


def share(successes: int, total: int) -> str:
    """In percent, with Wilson's 95 % interval."""
    low, high = wilson_interval(successes, total)
    return f"{100 * successes / total:.1f} [{100 * low:.1f}, {100 * high:.1f}]"


def spread(values: Sequence[float], digits: int) -> str:
    """The median and the range, or the one value that they all are; what never was (NaN) is `-`, and the last."""
    ordered = sorted(math.inf if math.isnan(value) else value for value in values)
    middle, low, high = (
        "-" if value == math.inf else f"{value:.{digits}f}" for value in (median(ordered), ordered[0], ordered[-1])
    )
    return middle if low == high else f"{middle} [{low}, {high}]"


def as_csv(table: str) -> str:
    """A Markdown table as CSV. Columns in which every cell is zero are left out.

    A `-` becomes a dash: in Markdown a cell that begins with it is a list.
    """
    cells = [
        [re.sub(r"(?<!\w)-(?![\w.])", "–", cell.strip()) for cell in row.strip()[1:-1].split("|")]
        for row in table.strip().splitlines()
    ]
    columns = [column for column in zip(*(cells[:1] + cells[2:]), strict=True) if not _zero(column[1:])]
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(zip(*columns, strict=True))
    return text.getvalue()


def _zero(cells: Sequence[str]) -> bool:
    return all(re.fullmatch(r"[0. /]*0[0. /]*", cell) for cell in cells)


def main(argv: list[str] | None = None) -> int:
    """Write the tables of standard input as CSV files."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="+", metavar="NAME", help="names of the files, in the order of the tables")
    parser.add_argument("--out", type=Path, default=DATA, help="their folder")
    arguments = parser.parse_args(argv)
    found = re.findall(r"(?:^\|.*\|\n)+", sys.stdin.read() + "\n", re.MULTILINE)
    if len(found) != len(arguments.names):
        raise InputError(f"standard input has {len(found)} tables, but {len(arguments.names)} names were given")
    for name, table in zip(arguments.names, found, strict=True):
        write_text(arguments.out / f"{name}.csv", as_csv(table))
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))
