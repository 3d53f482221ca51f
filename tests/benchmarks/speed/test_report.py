"""The report says all that was measured, and the page of the documentation is what the command would write."""

import dataclasses
import json
import math
from pathlib import Path

import jsonschema
import pytest
from matplotlib.colors import to_hex

import benchmarks.speed
from benchmarks.speed.figure import OURS, PEERS, draw
from benchmarks.speed.report import FORMAT, figures_of, markdown, pictures_of, sections_of, show, table
from benchmarks.speed.sections import Chart, Section, Target
from benchmarks.speed.suites import SUITES

DOCS = Path(__file__).parents[3] / "docs"
SCHEMA = Path(benchmarks.speed.__file__).with_name("results.schema.json")


@pytest.fixture
def results(make_section) -> dict:
    return {
        "format": FORMAT,
        "command": "python -m benchmarks.speed",
        "options": {"rounds": 7, "quick": False, "seed": 0},
        "seconds": 1.5,
        "machine": {"processor": "a processor", "cores": 2, "system": "Linux"},
        "versions": {"numpy": "2.0", "mink": None},
        "suites": {"one": [make_section("one").to_json()], "two": [make_section("two").to_json()]},
    }


def test_the_report_says_everything(results):
    page = markdown(results, data="data.json", pictures={"Section two": "picture.png"})
    for said in (
        "Machine: a processor, 2 cores, Linux. Seed: 0. Versions: numpy 2.0. Not installed: mink.",
        "## Targets: 2 of 4 met",
        "| one, time | at most 1 x theirs | 0.5 x theirs | yes |",
        "| one, rate | at least 10 steps/s | 8 steps/s | no |",
        "* one, rate: MuJoCo's step is 90 % of it",
        "![Section two: a dot for each contender](picture.png)\n\n| contender |",
        "## Section two",
        "Measured with care.",
        "| ours | 1.23 | 0.5 | 0.4 ... 0.6 |",
        "| theirs\\|they | 12 300 |  |  |",
        "* Missing: absent: not installed (no module absent)",
        "Rounds: 2. Again: `python -m benchmarks.speed --suite two`",
        "[data.json](data.json)",
    ):
        assert said in page, said
    assert "--quick" not in page
    assert "![" not in markdown(results, data="data.json", pictures={})
    results["options"]["quick"] = True
    assert "Measured with `--quick`" in markdown(results, data="data.json", pictures={})


def test_sections_survive_json(results, make_section):
    section = make_section("one")
    assert Section.from_json(json.loads(json.dumps(section.to_json()))) == section
    assert sections_of(results) == [section, make_section("two")]


@pytest.mark.parametrize(
    ("kind", "measured", "met"),
    [("at most", 1.0, True), ("at most", 1.01, False), ("at least", 1.0, True), ("at least", 0.99, False)],
)
def test_targets(kind, measured, met):
    assert Target("x", 1.0, kind, measured, "s").met is met
    assert not Target("x", 1.0, kind, math.nan, "s").met


@pytest.mark.parametrize(
    ("cell", "text"),
    [
        (None, ""), ("word", "word"), (0.0, "0"), (1.0, "1"), (0.012345, "0.0123"), (999.0, "999"), (1234.5, "1 230"),
        (3_214_567.0, "3 210 000"), (100_000, "100 000"), (7, "7"), (1e-11, "1e-11"), (math.nan, "nan"),
        (math.inf, "inf"), (-12.0, "-12"),
    ],
)  # fmt: skip
def test_cells(cell, text):
    assert show(cell) == text


def test_columns_of_numbers_are_aligned_to_the_right():
    assert table(("a", "b", "c"), [["x", 1.0, None], ["y", None, "-"]]).splitlines()[1] == "| --- | ---: | --- |"


def test_a_figure_has_dots_with_the_range_of_the_rounds(make_section):
    section = dataclasses.replace(make_section("one"), samples={"ours": [1e-6, 2e-6, 4e-6], "ours 10": [1.0, 2.0]})
    figure = draw(section)
    dots, lines = figure.axes
    assert [ax.get_title(loc="left").partition("\n")[0] for ax in figure.axes] == ["bars", "lines"]
    drawn = [line for line in dots.lines if line.get_marker() == "o"]
    assert [float(line.get_xdata()[0]) for line in drawn] == [1.0, 20.0]
    assert [to_hex(line.get_color()).upper() for line in drawn] == [OURS, PEERS]
    ranges = [[*map(float, line.get_xdata())] for line in dots.lines if line.get_marker() != "o"]
    assert ranges == [[0.5, 2.0], [20.0, 20.0]]  # around the median, in the unit of the chart
    assert [*zip(*lines.lines[0].get_data(), strict=True)] == [(1.0, 3.0), (10.0, 0.1)]
    figure.canvas.draw()


def test_the_range_of_a_rate_is_that_of_its_inverse(make_section):
    chart = Chart("rate", bars={"ours": 100.0}, x="steps/s")
    figure = draw(dataclasses.replace(make_section("one"), charts=[chart], samples={"ours": [1.0, 2.0, 8.0]}))
    assert [*figure.axes[0].lines[0].get_xdata()] == pytest.approx([25.0, 200.0])


def test_what_a_peer_says_is_no_markup(results, make_section):
    said = {"title": "<script>x</script>", "text": "<!-- <img src=x> 1 < 2", "missing": {"a": "<b>\n| x"}}
    results["suites"] = {"one": [dataclasses.replace(make_section("one"), **said).to_json()]}
    page = markdown(results, data="data.json", pictures={})
    for tag in ("<script", "</script", "<img", "<b>", "<!-- <"):
        assert tag not in page
    assert "&lt;script>x&lt;/script>" in page
    assert "1 < 2" in page


def test_rounds_are_those_of_the_section():
    bare = Section("a", "b", ("c",), [["d"]], "e")
    assert bare.rounds == 0
    assert Section("a", "b", ("c",), [["d"]], "e", samples={"f": [1.0] * 5, "g": [2.0] * 5}).rounds == 5


def test_a_section_that_timed_nothing_tells_no_rounds(results, make_section):
    results["suites"] = {"one": [dataclasses.replace(make_section("one"), samples={}).to_json()]}
    page = markdown(results, data="data.json", pictures={})
    assert "\nAgain: `python -m benchmarks.speed --suite one`" in page
    assert "Rounds" not in page


@pytest.mark.parametrize("values", [[0.0, 2.0, 5.0], [0.0, 0.0], [0.0], [3.0]])
def test_nothing_is_drawn_too(values):
    bars = {f"bar {number}": value for number, value in enumerate(values)}
    figure = draw(Section("a", "b", ("c",), [], "e", charts=[Chart("x", bars=bars)]))
    figure.canvas.draw()
    (axes,) = figure.axes
    low, high = axes.get_xlim()
    assert 0 <= low < high
    assert max(values) < high
    assert [note.get_text() for note in axes.texts] == [f"{value:g}" for value in values]


def test_no_figure_without_charts():
    assert draw(Section("a", "b", ("c",), [["d"]], "e")) is None


@pytest.fixture(scope="module")
def data() -> dict:
    return json.loads((DOCS / "reference/benchmarks.json").read_text(encoding="utf-8"))


class TestPage:
    """docs/reference/benchmarks.md holds a run; `docs/reference/benchmarks.json` has its numbers."""

    def test_is_what_the_command_writes(self, data):
        page = (DOCS / "reference/benchmarks.md").read_text(encoding="utf-8")
        file = DOCS / "reference/benchmarks.md"
        assert figures_of(file) == DOCS / "images" / "benchmarks"
        pictures = pictures_of(data, file, figures_of(file))
        assert page == markdown(data, data="benchmarks.json", pictures=pictures)
        assert len(pictures) >= 10
        there = {path.name for path in figures_of(file).iterdir()}
        assert there == {picture.rpartition("/")[2] for picture in pictures.values()}

    def test_holds_all_suites(self, data):
        jsonschema.validate(data, json.loads(SCHEMA.read_text(encoding="utf-8")))
        assert list(data["suites"]) == list(SUITES)
        for section in sections_of(data):
            assert section.text
            assert all(len(row) == len(section.columns) for row in section.rows), section.title
            assert section.rows or section.missing, section.title

    def test_shortfalls_are_explained(self, data):
        short = [target for section in sections_of(data) for target in section.targets if not target.met]
        assert [target.what for target in short if not target.why] == []
