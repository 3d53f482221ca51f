"""The notebooks as they are shipped: run from top to bottom, without an error, readable without being run."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from base64 import b64decode
from pathlib import Path

import nbformat
import pytest

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
LARGEST = 1_500_000
#: Figures of the thesis that a notebook shows, by the beginning of its name; none where the thesis has none.
FIGURES: dict[str, tuple[str, ...]] = {
    "01": ("2.2", "2.4", "2.5", "3.2", "3.3", "3.4", "3.5", "3.6", "3.7", "3.8"),
    "02": ("3.1",),
    "03": ("5.1", "5.2"),
    "04": ("5.3", "5.4", "5.5", "5.6", "6.1", "6.2"),
    "05": (),
    "06": (),
    "07": (),
    "08": (),
    "09": (),
}
#: What a notebook without a figure of the thesis takes up: sections of the thesis, or the report of the other task.
SECTIONS = {
    "05": ("section 1.1",),
    "06": ("sections 6.3 and 7.2",),
    "07": ("Gym Coding Report",),
    "08": ("(7.1)",),
    "09": ("(7.1)",),
}
#: Notebooks with learned policies: they can train them again instead.
WITH_POLICIES = ("03", "04", "05", "06", "07")


@pytest.fixture(params=NOTEBOOKS, ids=lambda path: path.stem)
def path(request) -> Path:
    return request.param


@pytest.fixture
def notebook(path):
    return nbformat.read(path, as_version=4)


def code(notebook) -> list:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def outputs(notebook) -> list:
    return [output for cell in code(notebook) for output in cell.outputs]


def test_there_are_notebooks():
    assert {path.name[:2] for path in NOTEBOOKS} == set(FIGURES)


def test_valid_and_small(path, notebook):
    nbformat.validate(notebook)
    assert path.stat().st_size < LARGEST


def test_run_once_from_top_to_bottom(notebook):
    cells = code(notebook)
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    assert len(cells) >= 3


def test_outputs_are_there_and_clean(notebook):
    kinds = [output.output_type for output in outputs(notebook)]
    assert "error" not in kinds
    assert not [output for output in outputs(notebook) if output.get("name") == "stderr"]
    pictures = [output.data["image/png"] for output in outputs(notebook) if "image/png" in output.get("data", {})]
    assert len(pictures) >= 2
    assert all(b64decode(picture).startswith(b"\x89PNG") for picture in pictures)


def test_nothing_of_the_machine(path, notebook):
    """No path, and nothing that differs from one run to the next."""
    text = re.sub(r'"image/png": "[^"]*"', "", path.read_text(encoding="utf-8"))  # whose letters may be any
    assert not re.search(r"(/home/|/root/|/tmp/|/work/|/Users/|C:\\\\|0x[0-9a-f]{8})", text)
    assert set(notebook.metadata) == {"kernelspec", "language_info"}
    assert notebook.metadata.language_info == {"name": "python"}
    assert not any(cell.metadata for cell in notebook.cells)


def test_no_long_function_in_a_cell(notebook):
    """Code is in the package, the notebook tells the story: at most 6 statements, however many lines they take."""
    for cell in code(notebook):
        for function in ast.walk(ast.parse(re.sub(r"^[%!].*", "", cell.source, flags=re.MULTILINE))):
            if isinstance(function, ast.FunctionDef):
                count = sum(isinstance(node, ast.stmt) for node in ast.walk(function)) - 1
                assert count <= 6, ast.unparse(function)


def test_figures_of_the_thesis(path, notebook):
    shown = "\n".join(cell.source for cell in notebook.cells)
    ranges = [(major, int(a), int(b)) for major, a, b in re.findall(r"(\d)\.(\d) (?:to|and) \d\.(\d)", shown)]
    for figure in FIGURES[path.name[:2]]:
        major, minor = figure.split(".")
        in_range = any(major == m and a <= int(minor) <= b for m, a, b in ranges)
        assert in_range or re.search(rf"figure {re.escape(figure)}\b", shown), figure


def test_sections_of_the_thesis(path, notebook):
    shown = "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "markdown")
    assert FIGURES[path.name[:2]] or SECTIONS[path.name[:2]]
    assert [section for section in SECTIONS.get(path.name[:2], ()) if section not in shown] == []


def test_no_two_figures_have_one_title():
    titles = [
        keyword.value.value
        for path in NOTEBOOKS
        for cell in code(nbformat.read(path, as_version=4))
        for node in ast.walk(ast.parse(re.sub(r"^[%!].*", "", cell.source, flags=re.MULTILINE)))
        if isinstance(node, ast.Call)
        for keyword in node.keywords
        if keyword.arg == "title" and isinstance(keyword.value, ast.Constant)
    ]
    assert len(titles) >= 30
    assert sorted({title for title in titles if titles.count(title) > 1}) == []


def test_one_switch_trains_again(path, notebook):
    """At the top, and it is off in what is shipped."""
    switches = [bool(re.search(r"^RETRAIN = False\b", cell.source, re.MULTILINE)) for cell in code(notebook)]
    assert switches == [path.name[:2] in WITH_POLICIES] + [False] * (len(switches) - 1)


def test_only_training_again_needs_torch(notebook):
    """The extra `notebooks` runs them without it."""
    program = "\n".join(re.sub(r"^[%!].*", "", cell.source, flags=re.MULTILINE) for cell in code(notebook))
    modules = [
        name
        for node in ast.parse(program).body
        if isinstance(node, ast.Import | ast.ImportFrom)
        for name in ([node.module] if isinstance(node, ast.ImportFrom) else [alias.name for alias in node.names])
    ]
    assert len(modules) >= 3
    assert not [name for name in modules if name.startswith(("torch", "stable_baselines3", "benchmarks.learners"))]


def test_links_lead_somewhere(notebook):
    targets = [
        target
        for cell in notebook.cells
        if cell.cell_type == "markdown"
        for target in re.findall(r"\]\(([^)#]+)\)", cell.source)
        if not target.startswith("http")
    ]
    assert len(targets) >= 1
    assert [target for target in targets if not (FOLDER / target).exists()] == []


@pytest.mark.slow
def test_they_run(path, tmp_path, needs_gl):
    """In a kernel of their own, by the script that made them."""
    command = [sys.executable, str(FOLDER / "execute.py"), "--check", str(path)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=1500, check=False)
    assert done.returncode == 0, done.stderr
