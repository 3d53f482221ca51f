"""The file of an interrupted benchmark under fuzz: what counts can be shown, drawn and written; the rest is dropped."""

import io
import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from hypothesis import strategies as st
from rich.console import Console

from benchmarks.speed import checks, cli, registry
from benchmarks.speed.checks import check_sections
from benchmarks.speed.figure import draw
from benchmarks.speed.report import markdown
from benchmarks.speed.suite import Section
from benchmarks.speed.unfinished import MOST_BYTES, Unfinished

IDENTITY = {"options": {"rounds": 1, "quick": True, "seed": 0}}
SCHEMA = json.loads(Path(registry.__file__).with_name("results.schema.json").read_text(encoding="utf-8"))
ORACLE = jsonschema.Draft202012Validator({**SCHEMA["$defs"]["section"], "$defs": SCHEMA["$defs"]})
SUITE = "fk-batch"
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**70), 2**70) | st.floats() | st.text(max_size=5)
    | st.sampled_from([10**400, 1e308, 5e-324, "\x1b[2J", "<script>", "$\\frac$", "[/red]", "\ud800", "x" * 5000]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=2),
    max_leaves=4,
)  # fmt: skip


@pytest.fixture(scope="module")
def whole(root, tmp_path_factory):
    """A file as a benchmark leaves it, with sections that were measured: one with bars, one with lines."""
    measured = json.loads((root / "docs" / "benchmarks.json").read_text(encoding="utf-8"))["suites"]
    path = tmp_path_factory.mktemp("bench") / "unfinished.json"
    unfinished = Unfinished(path, IDENTITY)
    unfinished.add(SUITE, [Section.from_json(measured["fk-batch"][0])], 1.5)
    unfinished.add("growth", [Section.from_json(measured["growth"][0])], 2.5)
    assert set(Unfinished(path, IDENTITY).suites) == {SUITE, "growth"}
    return json.loads(path.read_text(encoding="utf-8"))


def places(value, path=()):
    """Where something could be put instead: every entry of every list and object."""
    for key, entry in value.items() if isinstance(value, dict) else enumerate(value):
        yield (*path, key)
        if isinstance(entry, dict | list):
            yield from places(entry, (*path, key))


@st.composite
def damaged(draw_from, kept):
    """A file with one thing wrong, or changed."""
    made = json.loads(json.dumps(kept))
    where = [place for place in places(made) if place[0] != "identity"]
    how = draw_from(st.sampled_from(["change", "change", "swap", "drop", "add", "cut", "odd"]))
    if how == "odd":
        return draw_from(st.sampled_from([b"[" * 100_000, b'{"suites":' * 50_000, b"9" * 5000, b"\xff\xfe", b"null"]))
    if how == "cut":
        data = json.dumps(made).encode()
        return data[: draw_from(st.integers(0, len(data) - 1))]
    *above, last = draw_from(st.sampled_from(where))
    owner = made
    for key in above:
        owner = owner[key]
    if how == "swap":  # by something of the same type, which may well count
        old = owner[last]
        number = st.floats(-10, 10) if isinstance(old, int | float) else VALUES
        owner[last] = draw_from(st.text(max_size=300) if isinstance(old, str) else number)
    elif how == "drop":
        del owner[last]
    elif how == "add" and isinstance(owner, dict):
        owner[draw_from(st.text(max_size=4))] = draw_from(VALUES)
    else:
        owner[last] = draw_from(VALUES)
    return json.dumps(made).encode()


def shown(suites):
    """Everything that is done with sections that were kept."""
    results = {
        "options": IDENTITY["options"], "machine": {"processor": "p", "cores": 2, "system": "s"}, "command": "c",
        "versions": {}, "suites": suites,
    }  # fmt: skip
    sections = [Section.from_json(section) for kept in suites.values() for section in kept]
    page = markdown(results, data="d.json", picture="d.png")
    told = io.StringIO()
    console = Console(file=told, markup=False, highlight=False, width=120)
    for section in sections:
        console.print(cli._table(section))
    console.print(cli._targets([target for section in sections for target in section.targets]))
    figure = draw(sections)
    if figure is not None:
        figure.savefig(io.BytesIO(), format="png", dpi=30)
    return page, told.getvalue()


@pytest.mark.filterwarnings("ignore:Glyph .* missing from")  # an odd letter is drawn as a box
@pytest.mark.filterwarnings("ignore:constrained_layout not applied")  # nor is a page of a name a pretty label
def test_interrupted_benchmarks(whole, fuzzed, tmp_path):
    path = tmp_path / "unfinished.json"
    counts = {"kept": 0, "dropped": 0}

    def run(content):
        path.write_bytes(content)
        unfinished = Unfinished(path, IDENTITY)
        counts["kept" if unfinished.suites else "dropped"] += 1
        for name, sections in unfinished.suites.items():
            assert np.isfinite(unfinished.seconds[name])
            assert all(map(ORACLE.is_valid, sections))
        page, told = shown(unfinished.suites)
        assert "<script" not in page
        assert all(sign.isprintable() or sign == "\n" for sign in told)
        again = tmp_path / "again.json"
        Unfinished(again, IDENTITY).add(SUITE, [], 1.0)
        assert Unfinished(again, IDENTITY).suites == {SUITE: []}

    fuzzed(damaged(whole), run, share=5, both=False)
    assert min(counts.values()) > 3, counts


def test_a_section_counts_where_the_schema_allows_it(whole, fuzzed):
    """Beside an oracle, and that has no word on sizes, on letters and on the length of rows: what it refuses we do."""
    counts = {True: 0, False: 0}

    def run(content):
        try:
            made = json.loads(content)["suites"][SUITE][0]
        except (ValueError, KeyError, TypeError, IndexError, RecursionError):
            return
        try:
            check_sections([made])
        except (ValueError, OverflowError):
            counts[False] += 1
            return
        counts[True] += 1
        assert ORACLE.is_valid(made)

    fuzzed(damaged(whole), run, share=20, both=False)
    assert min(counts.values()) > 10, counts


def test_the_schema_says_nothing_that_is_not_understood():
    def words(schema):
        yield from schema
        inner = [*schema.get("properties", {}).values(), schema.get("items"), schema.get("additionalProperties")]
        for one in inner:
            if isinstance(one, dict):
                yield from words(one)

    used = {word for definition in checks.definitions().values() for word in words(definition)}
    assert {"required", "minItems", "minimum", "enum", "$ref"} <= used <= checks.KEYWORDS


def test_what_was_measured_counts(root):
    """All sections of the page of the documentation, as a run of all suites would keep them."""
    measured = json.loads((root / "docs" / "benchmarks.json").read_text(encoding="utf-8"))["suites"]
    sections = [section for suite in measured.values() for section in suite]
    assert json.loads(json.dumps([section.to_json() for section in check_sections(sections)])) == sections
    assert len(sections) > 10


def _put(**changes):
    return lambda section: section.update(changes)


BARS = {"title": "t", "bars": {"a": 1.0}, "lines": {}, "x": "", "y": "", "peers": []}
TARGET = {"what": "w", "bound": 1, "kind": "at most", "measured": 1.0, "unit": "u", "why": "", "met": True}


@pytest.mark.parametrize(
    "change",
    [
        _put(rows=None), _put(rows=[["x"]]), _put(rows=[[]]), _put(rows=[{"a": 1}]), _put(columns=[1, 2]),
        _put(columns=[]), _put(title=5), _put(text=None), _put(missing=["a"]), _put(missing={"a": 5}),
        _put(charts="abc"), _put(samples=5), _put(samples={"a": [True]}), _put(samples={"a": [float("nan")]}),
        _put(samples={"a": [10**400]}), _put(more=1), _put(title="\x1b[2J"), _put(missing={"a\r": ""}),
        _put(charts=[BARS | {"bars": {"a": "x"}}]), _put(charts=[BARS | {"bars": {"a": -1.0}}]),
        _put(charts=[BARS | {"bars": {"a": float("inf")}}]), _put(charts=[BARS | {"bars": {"a": 1e300}}]),
        _put(charts=[BARS | {"bars": {str(i): 1.0 for i in range(5000)}}]), _put(charts=[BARS] * 500),
        _put(charts=[BARS | {"title": "x" * 5000}]), _put(charts=[BARS | {"bars": {}, "lines": {"a": []}}]),
        _put(charts=[BARS | {"bars": {}, "lines": {"a": [[1.0, 2.0, 3.0]]}}]), _put(targets=[TARGET | {"bound": "x"}]),
        _put(targets=[TARGET | {"kind": "zzz"}]), _put(targets=[{}]), lambda section: section.pop("again"),
    ],
)  # fmt: skip
def test_damage(whole, tmp_path, change):
    made = json.loads(json.dumps(whole))
    change(made["suites"][SUITE][0])
    path = tmp_path / "unfinished.json"
    path.write_text(json.dumps(made))
    assert Unfinished(path, IDENTITY).suites == {}


@pytest.mark.parametrize(
    "change", [{"suites": [1]}, {"suites": {SUITE: 5}}, {"suites": {SUITE: ["x"]}}, {"seconds": {}}, {"seconds": [1]},
               {"seconds": {SUITE: "nan", "growth": 1}}, {"seconds": {SUITE: -1.0, "growth": 1}},
               {"suites": {"../x": []}, "seconds": {"../x": 1}}],
)  # fmt: skip
def test_damage_around_the_sections(whole, tmp_path, change):
    path = tmp_path / "unfinished.json"
    path.write_text(json.dumps(whole | change))
    assert (Unfinished(path, IDENTITY).suites, Unfinished(path, IDENTITY).seconds) == ({}, {})


def test_a_file_of_any_length_takes_no_memory(tmp_path):
    path = tmp_path / "unfinished.json"
    with path.open("wb") as file:
        file.truncate(2**40)
    assert path.stat().st_size > MOST_BYTES
    assert Unfinished(path, IDENTITY).suites == {}


def test_html_of_a_file_is_text(whole):
    made = json.loads(json.dumps(whole["suites"]))
    made[SUITE][0] |= {"title": "<script>x</script>", "text": "<!-- <img src=x> 1 < 2", "missing": {"a": "<b>"}}
    page, _ = shown(made)
    for tag in ("<script", "</script", "<img", "<b>", "<!-- <"):
        assert tag not in page
    assert "&lt;script>x&lt;/script>" in page
    assert "1 < 2" in page
