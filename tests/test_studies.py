"""The study pages are short, and their numbers are those of the tables they come from."""

import csv
import json
import re
from pathlib import Path

import pytest

from kinreach.cli import main

ROOT = Path(__file__).parents[1]
STUDIES = ROOT / "docs" / "studies"
PAGES = ("reach_without_learning", "learning_pays", "thesis", "report")


def read(page):
    return (STUDIES / f"{page}.md").read_text(encoding="utf-8")


def own(page):
    """What a page has of its own, without the tables that are written from files."""
    return re.sub(r"^<!-- table .*?^<!-- end -->$", "", read(page), flags=re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("page", PAGES)
def test_a_study_is_short_and_says_how_to_make_it_again(page):
    text = read(page)
    assert 400 < len(re.sub(r"^\|.*$", "", text, flags=re.MULTILINE).split()) <= 1150, "without tables"
    assert re.findall(r"^## (.*)$", text, re.MULTILINE)[-1] == "Make it again"
    assert "## How it was measured" in text
    assert re.search(r"^## What th(is|ese) worlds? did not contain$", text, re.MULTILINE)
    assert all(len(line) <= 92 for line in text.splitlines() if line.startswith("    "))


def cells(text):
    """Rows of all tables of a page, without what is bold."""
    for row in re.findall(r"^\| (.*) \|$", text, re.MULTILINE):
        yield [cell.strip().replace("**", "") for cell in row.split("|")]


def kept(name):
    with (STUDIES / "appendix" / "data" / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file))


@pytest.mark.parametrize(
    ("page", "section", "name", "least"),
    [
        ("learning_pays", "A model that is wrong", "real-arm", 32),
        ("learning_pays", "Damage", "damage", 12),
        ("reach_without_learning", "Goals in a volume", "space", 20),
    ],
)
def test_rows_of_a_page_are_those_of_the_appendix(page, section, name, least):
    """A value of a row, without its interval or with it, is in the file's row of that method."""
    whole = {row[0].strip("`"): row[1:] for row in kept(name)[1:]}
    checked = 0
    for method, *values in cells(own(page).partition(f"\n## {section}\n")[2].partition("\n## ")[0]):
        method = method.partition(":")[0].strip("`")
        for value in values if method in whole else ():
            found = {
                one for cell in whole[method] for one in (cell, *(cell.partition(mark)[0] for mark in (" [", ";")))
            }
            assert value in found, (method, value)
            checked += 1
    assert checked >= least


def test_touched_balls_are_those_of_the_sections_beneath():
    shown = {row[0]: row[1:] for row in cells(read("learning_pays")) if len(row) == 3}
    section = read("learning_pays").partition("\n### A stronger learner\n")[2].partition("\n### ")[0]
    by_speed = {row[0]: row[3] for row in cells(section)}
    planner, network = by_speed["`interception`"], by_speed["`gradient-moving-clear`, mean of five trainings"]
    assert shown["ball at 0.6 m/s: touched, %"] == [planner, network]
    ignored, same = shown["the same, collisions ignored"]
    assert f"at 0.6 m/s, the planner has {ignored}, the network as before" in section
    assert same == network
    beside = {row[0]: row[4] for row in cells(read("learning_pays")) if len(row) == 5}
    assert shown["the same, 1 look beside the ball"] == [beside["`look-again`"], beside["`policy-again`"]]


def test_seeds_of_the_page_are_those_of_the_trainings():
    rows = [row for name in ("trained", "trained-mujoco", "trained-camera", "trained-thesis") for row in kept(name)]
    section = read("reach_without_learning").partition("\n### All five trainings\n")[2].partition("\n### ")[0]
    checked = 0
    for name, *shown in (row for row in cells(section) if row[0].startswith("`")):
        assert any(row[0] == name and set(shown) <= set(row) for row in rows), name
        checked += 1
    assert checked == 6


def test_speeds_are_those_of_the_benchmarks():
    """A number that links to a section of the benchmarks stands in it."""
    sections = (ROOT / "docs" / "reference" / "benchmarks.md").read_text(encoding="utf-8").split("\n## ")
    named = {re.sub(r"[^a-z0-9-]", "", part.partition("\n")[0].lower().replace(" ", "-")): part for part in sections}
    text = read("appendix/thesis_points")
    links = re.findall(r"\[([^\]]*)\]\(\.\./\.\./reference/benchmarks\.md#([^)]*)\)", text)
    assert len(links) == text.count("reference/benchmarks.md#") == 7
    assert [(number, at) for number, at in links if not re.search(rf"(?<![\d.]){number}(?![\d.]\d)", named[at])] == []


def shown_number(text):
    """A number and what its last digit is worth, which it may be off by on another processor."""
    return float(text), 1.01 * 10.0 ** -len(text.partition(".")[2])


@pytest.mark.slow
def test_the_table_is_what_its_command_measures(tmp_path):
    """All of it except the times to solve, and the intervals, which follow from the shares."""
    text = read("reach_without_learning")
    command = re.search(r"python -m kinreach\.compare (--task ur5 [^#\n]+)", text).group(1)
    assert main(["compare", *command.split(), "--out", str(tmp_path)]) == 0
    found = json.loads((tmp_path / "results.json").read_text())
    measured = {method["name"]: method for method in found["methods"]}
    rows = [[row[0].strip("`"), *row[1:]] for row in cells(text.partition("\n## Goals in")[0]) if len(row) == 5]
    rows = [row for row in rows if row[0] in measured and "/" in row[2]]
    assert len(rows) == len(measured) == 10
    for name, reached, distance, near, _ in rows:
        method = measured[name]
        pairs = [
            (reached.split(" ")[0], 100 * method["reached"]),
            *zip(distance.split(" / "), (method["distance_mm"][key] for key in ("median", "p95")), strict=True),
            (near, 100 * method["success_at_mm"]["1"]),
        ]
        for said, value in pairs:
            number, unit = shown_number(said)
            assert value == pytest.approx(number, abs=unit), (name, said)
        assert method["impossible"] == 0
    moves = sorted(method["move_s"]["median"] for method in measured.values())
    assert [round(move, 1) for move in (moves[0], *moves[-3:])] == [1.3, 1.8, 4.2, 5.0]
    assert sorted(round(method["reward_mean"], 1) for method in measured.values()) == [2.8, *[20.0] * 9]


def test_every_picture_has_its_command_on_its_page():
    """By its name in code; those of the thesis by the tool that draws them."""
    checked = 0
    for page in STUDIES.rglob("*.md"):
        text = page.read_text(encoding="utf-8")
        code = "\n".join(re.findall(r"^    .*$|`[^`]*`", text, re.MULTILINE))
        for path in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", text):
            *_, folder, name = path.split("/")
            assert ("tools.thesis_pictures" if folder == "thesis" else name) in code, (page, name)
            checked += 1
    assert checked >= 25
