"""Names that are markup, formulas or commands: written, drawn and printed as what they are, and never obeyed."""

import json
import shlex
from html.parser import HTMLParser
from pathlib import Path

import pytest

from kinreach.cli import main
from kinreach.compare import compare
from tests.policy_files import copy_policy

NAMES = [
    "<script>alert(1)<",
    '"><img src=x onerror=alert(1)>',
    "'onmouseover='alert(1)",
    "&lt;b&gt;",
    "a$b$c",
    "$\\frac{$",
    "[bold]x[",
    "[red]",
    "{{7*7}} ${title} $title %s {0}",
    "a; touch evil; b",
    "$(touch evil)",
    "`touch evil`",
    "=cmd|calc!A1",
    "x" * 200,
    "..",
    "-rf",
]


class Elements(HTMLParser):
    """Elements, and attributes that run something, of a page."""

    def __init__(self):
        super().__init__()
        self.tags, self.handlers, self.text = [], [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.handlers += [name for name, value in attrs if name.startswith("on") or "javascript:" in (value or "")]

    def handle_data(self, data):
        self.text.append(data)


def files(folder):
    """A policy under each of the names."""
    for name in NAMES:
        path = folder / f"{name}.safetensors"
        copy_policy("ranked-single", path)
        yield path


@pytest.mark.slow
def test_every_name_is_a_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "in"
    folder.mkdir()
    paths = [str(path) for path in files(folder)]
    assert len(paths) == len(NAMES)
    results = compare(methods=["lm", *paths], goals=1, out=tmp_path / "out")
    page = (tmp_path / "out" / "report.html").read_text()
    plain = Elements()
    compare(methods=["lm"], goals=1, out=tmp_path / "plain")
    plain.feed((tmp_path / "plain" / "report.html").read_text())
    hostile = Elements()
    hostile.feed(page)
    assert hostile.handlers == []
    assert hostile.tags.count("script") == plain.tags.count("script") == 1
    assert set(hostile.tags) == set(plain.tags)
    said = "".join(hostile.text)
    assert all(Path(path).stem in said for path in paths)
    assert [method["name"] for method in results["methods"]][1:] == [Path(path).stem for path in paths]
    assert json.loads((tmp_path / "out" / "results.json").read_text()) == results
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in", "out", "plain"]


@pytest.mark.slow
@pytest.mark.parametrize("name", [NAMES[0], NAMES[5], NAMES[6], NAMES[9], "/red"])
def test_commands_print_names_and_give_a_line_that_can_be_copied(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    safe = name.replace("/", "")
    file = f"{safe}.safetensors"
    copy_policy("ranked-single", file)
    assert main(["compare", "--methods", file, "--goals", "1", "--out", "[" + "out"]) == 0
    said = capsys.readouterr().out
    again = next(line for line in said.splitlines() if line.startswith("Again: "))
    assert shlex.split(again)[1:6] == ["kinreach", "compare", "--task", "ur5", "--methods"]
    assert shlex.split(again)[6] == file
    assert main(["evaluate", file, "--goals", "2", "--backend", "kinematic"]) == 0
    said = capsys.readouterr().out
    assert safe[:20] in said
    again = next(line for line in said.splitlines() if line.startswith("Again: "))
    assert shlex.split(again)[3] == file


def test_two_policies_of_one_name_are_both_reported(tmp_path, capsys):
    paths = [tmp_path / folder / "p.safetensors" for folder in ("a", "b")]
    for path in paths:
        path.parent.mkdir()
        copy_policy("ranked-single", path)
    out = tmp_path / "found.json"
    arguments = ["evaluate", *map(str, paths), "--goals", "2", "--backend", "kinematic", "--out", str(out)]
    assert main(arguments) == 0
    assert list(json.loads(out.read_text())["policies"]) == [str(path) for path in paths]
