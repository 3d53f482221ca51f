"""Tables of numbers that people hand over: CSV as programs and spreadsheets of any language write it.

One reader for all: columns between commas, semicolons, tabs or spaces, a decimal point or a decimal comma, quotes, any
ends of lines, a byte order mark, and empty columns behind the last. What could be read in two ways is refused.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kinreach._checks import Floats, shown
from kinreach._files import decoded, read_bytes
from kinreach.errors import InputError

#: A number in plain digits, and what people write that looks like one.
_NUMBER = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_LIKE_A_NUMBER = re.compile(r"[+-]?(?=[., '\u00a0\u202f]*[0-9])[0-9., '\u00a0\u202f]+(?:[eE][+-]?[0-9]+)?")
_WITH_COMMA = re.compile(r"[+-]?[0-9]*,[0-9]+(?:[eE][+-]?[0-9]+)?")
#: A number whose comma or point may be one of thousands: 1,234, but not 0,123 or 1,25.
_MAYBE_THOUSANDS = re.compile(r"[+-]?[1-9][0-9]{0,2}[.,][0-9]{3}")
#: The line with which Excel says what separates cells.
_EXCEL = re.compile(r'"?sep=(.)"?', re.IGNORECASE)
#: Lines in which a header is looked for.
MAX_ABOVE = 20
_NOT_FINITE = ("nan", "inf", "infinity")


@dataclass(frozen=True)
class Table:
    """Cells of a table, with a decimal point in each number.

    Attributes:
        name: Of the file, for messages.
        header: Names of the columns; empty if the first line has numbers.
        cells: Rows of text, each as long as the header.
        lines: Number of each row's line.
    """

    name: str
    header: list[str]
    cells: list[list[str]]
    lines: list[int]

    def place(self, column: str) -> int:
        """Return the place of a column by its name, in any case; -1 if there is none.

        Raises:
            InputError: There are two.
        """
        found = [place for place, title in enumerate(self.header) if title.lower() == column.lower()]
        if len(found) > 1:
            raise InputError(f"{self.name} has {len(found)} columns {column}")
        return found[0] if found else -1

    @property
    def rows(self) -> Iterator[dict[str, str]]:
        """Each row by the names of its columns."""
        return (dict(zip(self.header, row, strict=True)) for row in self.cells)

    def numbers(self, places: Sequence[int], *, needed: str = "") -> Floats:
        """Return the numbers of some columns, shape (rows, columns); `needed` is what a message says of a bad row.

        Raises:
            InputError: A cell is no finite number; the message names it and its line.
        """
        rows = []
        for row, line in zip(self.cells, self.lines, strict=True):
            words = [row[place] for place in places]
            for word, place in zip(words, places, strict=True):
                if _NUMBER.fullmatch(word) is None:
                    got = f"{needed}, got {shown(','.join(words))}: " if needed and not _is_not_finite(word) else ""
                    column = shown(self.header[place]) if self.header else place + 1
                    why = _why_no_number(word) if word else f"a number is missing in column {column}"
                    raise InputError(f"{self.name}, line {line}: {got}{why}")
            rows.append([float(word) for word in words])
        values = np.array(rows, dtype=np.float64).reshape(len(rows), len(places))
        if not np.isfinite(values).all():
            first = int((~np.isfinite(values).all(axis=1)).argmax())  # 1e999
            raise InputError(f"{self.name}, line {self.lines[first]}: the numbers must be finite")
        return values


def read_table(path: Path, what: str, *, most: int) -> Table:
    """Read a table from a file.

    Args:
        path: Of the file.
        what: What it is, for messages, such as "the poses".
        most: Largest size [bytes].

    Raises:
        InputError: It cannot be read, is no table, or could be read in two ways.
    """
    content = read_bytes(path, what, most=most)
    text = decoded(content, otherwise="latin-1")
    if "\0" in text:
        raise InputError(f"cannot read {what} {path}: it is not UTF-8 text")
    return table_of(text, str(path))


def table_of(text: str, name: str) -> Table:
    """Divide a text into the cells of a table; arguments and errors as in `read_table`."""
    lines = text.removeprefix("\ufeff").splitlines(keepends=True)
    first = next((n for n, line in enumerate(lines) if line.strip(' ;,\t\r\n"') and line.lstrip()[0] != "#"), None)
    if first is None:
        return Table(name, [], [], [])
    separator = None
    if (said := _EXCEL.fullmatch(lines[first].rstrip("\r\n"))) is not None:
        separator, first = said[1], first + 1
    start = lines[first] if first < len(lines) else ""
    _refuse_title(lines, first, separator, name)
    separator = separator or _separator(start)
    rows, numbers = _rows(lines[first:], separator, first, name)
    if not rows:
        return Table(name, [], [], [])
    rows, numbers = _with_points(rows, numbers, separator, name)
    if all(_LIKE_A_NUMBER.fullmatch(cell) or _is_not_finite(cell) for cell in rows[0]):
        header, width = [], len(rows[0])
    else:
        header, width = rows[0], len(rows[0])
        rows, numbers = rows[1:], numbers[1:]
    for row, number in zip(rows, numbers, strict=True):
        if len(row) > width:
            as_in = "as in the header" if header else "as in the first line"
            comma = "; a decimal comma needs another separator, such as a semicolon" if separator == "," else ""
            raise InputError(f"{name}, line {number}: {width} cells are needed, {as_in}, got {len(row)}{comma}")
        row += [""] * (width - len(row))
    return Table(name, header, rows, numbers)


def _separator(line: str) -> str:
    """Return what separates the cells of a line: a semicolon, a tab, a comma, or spaces (an empty text)."""
    outside = re.sub(r'"[^"]*"', '""', line)
    words = outside.split()
    if "," in outside and len(words) > 1 and all(_WITH_COMMA.fullmatch(word) or word.isdigit() for word in words):
        return ""
    return next((sign for sign in ";\t," if sign in outside), "")


def _refuse_title(lines: Sequence[str], first: int, separator: str | None, name: str) -> None:
    """Refuse a table with text above its header, which is the line before the first numbers and as wide as they are."""
    above: list[tuple[int, int, str]] = []
    for number, line in enumerate(lines[first : first + MAX_ABOVE], start=first):
        sign = _separator(line) if separator is None else separator
        try:
            rows, _ = _rows([line], sign, number, name)
        except InputError:  # a part of a cell of several lines
            continue
        if not rows:
            continue
        count = len(rows[0])
        if 2 * sum(_LIKE_A_NUMBER.fullmatch(cell) is not None for cell in rows[0]) <= count:
            above.append((number, count, sign))
            continue
        if len(above) > 1:
            (_, width, at_top), (header, most, in_header) = above[0], above[-1]
            if count <= most and (width < count or (not at_top and in_header)):
                raise InputError(
                    f"{name}, line {first + 1}: {shown(lines[first].strip())} stands above the header, which is line "
                    f"{header + 1}; delete it, or begin it with #"
                )
        return


def _rows(lines: Sequence[str], separator: str, before: int, name: str) -> tuple[list[list[str]], list[int]]:
    """Return the cells of each row without empty ones at its end, and the number of each row's line."""
    rows, numbers = [], []
    if separator:
        try:
            reader = csv.reader(lines, delimiter=separator, skipinitialspace=True, strict=True)
            for cells in reader:
                rows.append([cell.strip() for cell in cells])
                numbers.append(before + reader.line_num)
        except csv.Error as error:
            raise InputError(f"{name} is not CSV, line {before + reader.line_num}: {error}") from None
    else:
        rows = [[cell.strip('"') for cell in line.split()] for line in lines]
        numbers = [*range(before + 1, before + 1 + len(lines))]
    kept = []
    for row, number in zip(rows, numbers, strict=True):
        while row and not row[-1]:
            row.pop()
        if row and not row[0].startswith("#"):
            kept.append((row, number))
    return [row for row, _ in kept], [number for _, number in kept]


def _with_points(
    rows: list[list[str]], numbers: list[int], separator: str, name: str
) -> tuple[list[list[str]], list[int]]:
    """Write decimal points for decimal commas, or refuse a table in which a comma could be either."""
    if separator == ",":
        return rows, numbers
    commas, points = [], []
    for row, number in zip(rows, numbers, strict=True):
        for cell in row:
            if "," in cell and _LIKE_A_NUMBER.fullmatch(cell):
                commas.append((cell, number))
            elif "." in cell and _NUMBER.fullmatch(cell):  # not a date
                points.append((cell, number))
    if not commas:
        _refuse_thousands(points, name)
        return rows, numbers
    cell, number = next(((c, n) for c, n in commas if not _WITH_COMMA.fullmatch(c)), ("", 0))
    if cell:
        raise InputError(f"{name}, line {number}: {_why_no_number(cell)}")
    if points:
        (cell, number), (other, place) = commas[0], points[0]
        raise InputError(
            f"{name} has both {shown(cell)}, in line {number}, and {shown(other)}, in line {place}; one of them may be "
            "thousands: write all numbers with a decimal point"
        )
    _refuse_thousands(commas, name)
    return [[cell.replace(",", ".") if _WITH_COMMA.fullmatch(cell) else cell for cell in row] for row in rows], numbers


def _refuse_thousands(cells: Sequence[tuple[str, int]], name: str) -> None:
    """Refuse numbers with one kind of sign if it may be that of thousands in every one of them."""
    if cells and all(_MAYBE_THOUSANDS.fullmatch(cell) for cell, _ in cells):
        cell, number = cells[0]
        plain = re.sub("[.,]", "", cell)
        raise InputError(
            f"{name}, line {number}: {shown(cell)} could be {cell.replace(',', '.')} or {plain}; write {plain}, or "
            "four decimals"
        )


def _is_not_finite(word: str) -> bool:
    return word.lower().lstrip("+-") in _NOT_FINITE


def _why_no_number(word: str) -> str:
    """Say what is wrong with a cell that must be a number."""
    if _is_not_finite(word):
        return f"the numbers must be finite, got {shown(word)}"
    if _WITH_COMMA.fullmatch(word):
        return f"{shown(word)} has a decimal comma in a table separated by commas; write a decimal point"
    if _LIKE_A_NUMBER.fullmatch(word):
        return f"{shown(word)} has signs between its digits, as of thousands; write it without them"
    return f"{shown(word)} is no number"
