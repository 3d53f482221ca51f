"""Put tables of numbers into pages as Markdown, which GitHub draws, too: `python docs/tables.py`.

A page has `<!-- table FILE.csv -->` and `<!-- end -->`, with FILE beside it; what is between them is written here.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path

DOCS = Path(__file__).resolve().parent
PLACE = re.compile(r"(<!-- table (\S+\.csv) -->\n).*?(<!-- end -->)", re.DOTALL)


def markdown(file: Path) -> str:
    """Write a CSV file with a header as a table."""
    with file.open(encoding="utf-8", newline="") as stream:
        header, *rows = csv.reader(stream)
    lines = (header, ["---"] * len(header), *rows)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def with_tables(page: Path) -> str:
    """Return the text of a page with its tables as their files are now."""
    text = page.read_text(encoding="utf-8")
    return PLACE.sub(lambda at: f"{at[1]}\n{markdown(page.parent / at[2])}\n\n{at[3]}", text)


if __name__ == "__main__":
    for each in sorted(DOCS.rglob("*.md")):
        each.write_text(with_tables(each), encoding="utf-8")
