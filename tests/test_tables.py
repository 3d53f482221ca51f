"""Tables as spreadsheets of any language write them: read as they are meant, or refused with the cell."""

from __future__ import annotations

import csv
import io
import itertools

import numpy as np
import pytest

from kinreach import cli
from kinreach._tables import read_table, table_of
from kinreach.deploy import read_trajectory
from kinreach.errors import InputError
from kinreach.kinematics import URKinematics
from kinreach.robots import PosePairs

HEADER = ["x", "y", "z", "rx", "ry", "rz"]
POSES = np.array(
    [[-0.4, 0.1, 0.3, 3.14, 0.0, -1.5], [0.25, -0.125, 1.0, 0.0, 2.5, 1234.5], [1e-05, 2.0, -3.0, 0.0, 0.0, 12.0]]
)
ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "latin-1")


def written(rows, *, separator=",", comma=False, ends="\n", quotes=csv.QUOTE_MINIMAL, blanks=0, first=()):
    """A table as text; `blanks` empty columns behind the last."""
    text = io.StringIO()
    writer = csv.writer(text, delimiter=separator, lineterminator=ends, quoting=quotes)
    for row in rows:
        cells = [cell if isinstance(cell, str) else format(cell, ".15g") for cell in row]
        writer.writerow([cell.replace(".", ",") if comma else cell for cell in cells] + [""] * blanks)
    return ends.join([*first, text.getvalue()])


def test_every_way_of_writing_a_table_is_read_alike(tmp_path):
    """Separators, decimal signs, ends of lines, quotes, empty columns and encodings, each with each."""
    file, tried = tmp_path / "poses.csv", 0
    ways = itertools.product(
        [(",", False), (";", False), (";", True), ("\t", False), ("\t", True)], ["\n", "\r\n", "\r"],
        [csv.QUOTE_MINIMAL, csv.QUOTE_ALL], [0, 3], ENCODINGS, [False, True],
    )  # fmt: skip
    for (separator, comma), ends, quotes, blanks, encoding, named in ways:
        first = [f"{'SEP' if comma else 'sep'}={separator}"] if named else []
        extra = [["größe", *HEADER], *(["a b", *row] for row in POSES)]
        text = written(extra, separator=separator, comma=comma, ends=ends, quotes=quotes, blanks=blanks, first=first)
        file.write_bytes(text.encode(encoding))
        table = read_table(file, "the poses", most=10_000)
        assert table.header == ["größe", *HEADER]
        np.testing.assert_array_equal(table.numbers([table.place(name) for name in HEADER]), POSES)
        assert table.lines == [2 + named, 3 + named, 4 + named]
        tried += 1
    assert tried == 5 * 3 * 2 * 2 * 4 * 2


@pytest.mark.parametrize("comma", [False, True])
def test_spaces_empty_lines_and_comments(comma):
    rows = [" ".join(format(v, ".15g") for v in row) for row in POSES]
    text = "\n".join(["# made by hand", "", " ".join(HEADER), "", *rows, "  ", ""])
    text = text.replace(".", ",") if comma else text
    table = table_of(text, "a")
    assert table.header == HEADER
    np.testing.assert_array_equal(table.numbers(range(6)), POSES)
    assert table.lines == [5, 6, 7]
    for sign in (";", "\t", ","):
        with_spaces = f" {sign} ".join(HEADER) + "\n" + f" {sign} ".join(map(repr, POSES[0].tolist()))
        np.testing.assert_array_equal(table_of(with_spaces, "a").numbers(range(6)), POSES[:1])


@pytest.mark.parametrize(("separator", "comma"), [(",", False), (";", True), ("\t", True), (" ", False), (" ", True)])
def test_a_table_without_a_header(separator, comma):
    table = table_of(written(POSES, separator=separator, comma=comma), "a")
    assert table.header == []
    np.testing.assert_array_equal(table.numbers(range(6)), POSES)
    assert table.lines == [1, 2, 3]


#: What could be read in two ways, or is no number -> what is said of it.
REFUSED = {
    "decimal commas between commas": ("x,y,z\n0,4,0,1,0,3\n", "line 2: 3 cells.*decimal comma needs another"),
    "quoted decimal comma between commas": ('x,y\n"1,5",2\n', "line 2: '1,5' has a decimal comma in a table separated"),
    "thousands between commas": ('x,y\n"1,234.5",2\n', "line 2: '1,234.5' has signs between its digits"),
    "thousands in points": ("x;y\n1.234,5;2\n", "line 2: '1.234,5' has signs between its digits"),
    "thousands twice": ("x;y\n1,234,567;2,5\n", "line 2: '1,234,567' has signs"),
    "thousands in spaces": ("x;y\n1 234,5;2,5\n", "line 2: '1 234,5' has signs"),
    "thousands in apostrophes": ("x;y\n1'234.5;2.5\n", "line 2: .1'234.5. has signs"),
    "thousands in narrow spaces": ("x;y\n1\u202f234,5;2,5\n", "line 2: .* has signs"),
    "both signs": ("x;y\n0,5;1\n1;0.5\n", "both '0,5', in line 2, and '0.5', in line 3"),
    "either": ("x;y\n1,234;2\n-5,678;3\n", "line 2: '1,234' could be 1.234 or 1234; write 1234, or four"),
    "either, with points": ("x;y\n1.234;2\n-5.678;3\n", "line 2: '1.234' could be 1.234 or 1234; write 1234, or four"),
    "text": ("x;y\n1;two\n", "line 2: 'two' is no number"),
    "missing": ("x;y\n1;2\n3\n", "line 3: a number is missing in column 'y'"),
    "missing amid": ("x,y\n1,2\n,4\n", "line 3: a number is missing in column 'x'"),
    "missing without a header": ("1;2\n3\n", "line 2: a number is missing in column 2"),
    "too many": ("x;y\n1;2;3\n", "line 2: 2 cells are needed, as in the header, got 3"),
    "too many without a header": ("1;2\n1;2;3\n", "line 2: 2 cells are needed, as in the first line, got 3"),
    "nan": ("x;y\n1;nan\n", "line 2: the numbers must be finite"),
    "inf": ("x;y\n1;-Infinity\n", "line 2: the numbers must be finite"),
    "too large": ("x;y\n1;1e999\n", "line 2: the numbers must be finite"),
    "underscores": ("x;y\n1;1_000\n", "line 2: '1_000' is no number"),
    "hexadecimal": ("x;y\n1;0x10\n", "line 2: '0x10' is no number"),
    "other digits": ("x;y\n1;\u0661\n", "line 2: .* is no number"),
    "a true minus": ("x;y\n1;\u22125\n", "line 2: .* is no number"),
    "unit": ("x;y\n1;5 mm\n", "line 2: '5 mm' is no number"),
    "open quote": ('x,y\n"1,2\n', "is not CSV"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_could_be_read_in_two_ways_is_refused(name):
    text, said = REFUSED[name]
    with pytest.raises(InputError, match=said) as caught:
        table_of(text, "a.csv").numbers([0, 1])
    assert str(caught.value).startswith("a.csv")
    assert "\n" not in str(caught.value)


#: Lines that stand above a header.
TITLES = (
    "My robot", "Poses, measured by hand", "Poses of 12.05.2024, 13:00, cell 3; flange", '"A title, between quotes"',
    "A title of more words than the table has columns", "Date\t12.05.2024", "Robot,,,,,",
)  # fmt: skip


def test_a_title_above_the_header_is_named_whatever_separates_the_cells():
    """And no line that belongs to the table: units below the header, text in some columns, one column."""
    tried = 0
    for separator, comma, title in itertools.product(";\t, ", (False, True), TITLES):
        if (separator == "," and comma) or (separator == " " and title.endswith("columns")):  # it may be the header
            continue
        text = written([HEADER, *POSES], separator=separator, comma=comma, first=[title])
        for more in ("", "\n", "# a comment\n", "Second line\n"):
            at = 1 + more.count("\n")
            with pytest.raises(InputError) as caught:
                table_of(text.replace(title + "\n", f"{title}\n{more}", 1), "a.csv").numbers(range(6))
            said = str(caught.value)
            assert said.startswith("a.csv, line 1: "), said
            assert f"stands above the header, which is line {at + 1}; delete it, or begin it with #" in said
            tried += 1
    assert tried == (7 * len(TITLES) - 2) * 4
    assert table_of("x;y;note\n1;2;no comment\n", "a").header == ["x", "y", "note"]
    assert table_of("name;x;y\nfirst;1;2\n", "a").header == ["name", "x", "y"]
    assert table_of("note\none\n1\n", "a").header == ["note"]
    with pytest.raises(InputError, match="line 2: 's' is no number"):
        table_of("t;x;note\ns;m\n1;2\n", "a").numbers([0, 1])


@pytest.mark.parametrize(
    ("cells", "numbers"),
    [
        (["0,123", "1,234"], [0.123, 1.234]), (["1,234", "5,6"], [1.234, 5.6]),
        (["1234,567", "1,234"], [1234.567, 1.234]), (["1,234E-03", "1,234"], [0.001234, 1.234]),
        ([",5", "-,25"], [0.5, -0.25]), (["1.5", "2."], [1.5, 2.0]),
        (["1.234", "0.678"], [1.234, 0.678]), (["+1,5", "1e3"], [1.5, 1000.0]), (["1,2345", "7"], [1.2345, 7.0]),
    ],
)  # fmt: skip
def test_what_can_be_read_in_one_way_is(cells, numbers):
    table = table_of("x;y\n" + ";".join(cells), "a")
    np.testing.assert_array_equal(table.numbers([0, 1]), [numbers])


def test_text_beside_numbers_has_commas_and_points_as_it_likes():
    """A date is no number with points, and a column that nobody asks for is not looked at."""
    table = table_of("day;x;note\n12.05.2024;0,5;touches the table, twice\n13.05.2024;1,25;1.2.3\n", "a")
    np.testing.assert_array_equal(table.numbers([1]), [[0.5], [1.25]])
    assert table.cells[0][2] == "touches the table, twice"
    table = table_of('x,reason\n1.5,"forearm, table"\n', "a")
    assert table.cells == [["1.5", "forearm, table"]]
    with pytest.raises(InputError, match="2 columns x"):
        table_of("x;X\n1;2\n", "a").place("x")


def test_random_numbers_come_back_or_are_refused():
    """As any spreadsheet writes them, with thousands or without: what is read is what was written."""
    rng, read, refused = np.random.default_rng(0), 0, 0
    for _ in range(600):
        digits, scale = int(rng.integers(0, 6)), 10.0 ** rng.integers(-3, 7)
        values = np.round(rng.uniform(-scale, scale, (3, 2)), digits)
        point, thousands = [(".", ""), (",", ""), (".", ","), (",", "."), (",", " "), (".", "'")][rng.integers(6)]
        separator = ";\t,"[rng.integers(2 if point == "," else 3)]  # a comma that is decimal separates nothing
        swap = {".": point, ",": thousands}
        cells = [["".join(swap.get(c, c) for c in format(v, f",.{digits}f")) for v in row] for row in values]
        text = written([["x", "y"], *cells], separator=separator)
        try:
            found = table_of(text, "a").numbers([0, 1])
        except InputError:
            refused += 1
            continue
        np.testing.assert_array_equal(found, values, err_msg=text)
        read += 1
    assert read > 200
    assert refused > 100


SPREADSHEET = written([HEADER, *POSES[:2]], separator=";", comma=True, ends="\r\n", blanks=2).encode("utf-8-sig")


def test_every_reader_of_tables_reads_a_spreadsheets(tmp_path, capsys):
    poses, trajectory, pairs = (tmp_path / f"{name}.csv" for name in ("poses", "trajectory", "pairs"))
    poses.write_bytes(SPREADSHEET)
    rows = [["time", "a", "b", "a_velocity", "b_velocity"], [0.0, 0.1, 0.2, 0.0, 0.5], [0.5, 0.3, 0.4, 0.25, 0.75]]
    trajectory.write_bytes(written(rows, separator=";", comma=True, ends="\r\n", blanks=1).encode("utf-16"))
    read = read_trajectory(trajectory)
    np.testing.assert_array_equal(np.column_stack([read.t, read.q, read.qd]), rows[1:])
    q = np.random.default_rng(0).uniform(-1, 1, (5, 6))
    header = [*(f"q{i}" for i in range(1, 7)), *HEADER]
    table = [header, *np.column_stack([q, np.tile(POSES[0], (5, 1))]).tolist()]
    pairs.write_bytes(written(table, separator="\t", comma=True, ends="\r\n", quotes=csv.QUOTE_ALL).encode("utf-8-sig"))
    np.testing.assert_allclose(PosePairs.read(pairs).q, q, atol=1e-14)
    out = tmp_path / "out.csv"
    assert cli.main(["ik", "--arm", "ur5e", "--poses", str(poses), "--out", str(out)]) == 0
    solved = np.loadtxt(out, delimiter=",", skiprows=1, usecols=range(1, 7))
    np.testing.assert_allclose(URKinematics("ur5e", base="base").fk(solved)[:, :3, 3], POSES[:2, :3], atol=1e-6)
    poses.write_bytes(SPREADSHEET.replace(b";", b","))
    assert cli.main(["ik", "--arm", "ur5e", "--poses", str(poses), "--out", str(out)]) == 2
    assert "a decimal comma needs another separator" in capsys.readouterr().err
    for file, reader in ((trajectory, read_trajectory), (pairs, PosePairs.read)):
        file.write_text(
            file.read_bytes().decode("utf-16" if file is trajectory else "utf-8-sig").replace("0,", "0.", 1)
        )
        with pytest.raises(InputError, match=r"both '.*,.*', in line \d, and '0\."):
            reader(file)


LONG = ["1" * 100_000 + "x", "1," * 50_000 + "x", " " * 100_000 + "1x", '"' * 99_999, "1.5" * 40_000]


@pytest.mark.parametrize("cell", LONG, ids=range(len(LONG)))
@pytest.mark.parametrize("separator", [";", ",", " "])
def test_long_cells_take_no_time(cell, separator):
    """Each is looked at once from end to end, not once from each of its digits."""
    with pytest.raises(InputError):
        table_of(f"x{separator}y\n{cell}{separator}2\n", "a").numbers([0, 1])


@pytest.mark.parametrize("text", ["", "\n\n", "# only this\n", ";;;\n", "sep=;\n", "sep=;\n;;\n", "\ufeff"])
def test_an_empty_table_has_no_columns_and_no_rows(text):
    table = table_of(text, "a")
    assert (table.header, table.cells, table.lines, table.place("x")) == ([], [], [], -1)


def test_what_a_row_needs_is_said_with_the_row():
    table = table_of("x;y\n1;two\n3;nan\n", "a")
    with pytest.raises(InputError, match=r"^a, line 2: two numbers are needed, got '1,two': 'two' is no number$"):
        table.numbers([0, 1], needed="two numbers are needed")
    table = table_of("x;y\n3;nan\n", "a")
    with pytest.raises(InputError, match=r"^a, line 2: the numbers must be finite, got 'nan'$"):
        table.numbers([0, 1], needed="two numbers are needed")
