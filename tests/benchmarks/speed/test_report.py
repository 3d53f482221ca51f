"""docs/reference/benchmarks.md is what the command writes of benchmarks.json."""

import json
from pathlib import Path

import jsonschema
import pytest

import benchmarks.speed
from benchmarks.speed.report import figures_of, markdown, pictures_of, sections_of
from benchmarks.speed.suites import SUITES

DOCS = Path(__file__).parents[3] / "docs"
SCHEMA = Path(benchmarks.speed.__file__).with_name("results.schema.json")


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
