"""The documentation agrees with the code: paths, names and commands in it exist, and no page or module is forgotten.

That the pages build without a warning is `make docs`.
"""

from __future__ import annotations

import importlib
import importlib.util
import re
from pathlib import Path

import pytest

import kinreach
from kinreach import plots

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
PACKAGE = Path(kinreach.__file__).parent


@pytest.fixture(scope="module")
def text() -> str:
    return "\n".join(page.read_text(encoding="utf-8") for page in PAGES)


def test_every_page_is_in_the_navigation():
    listed = re.findall(r": ([\w/]+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(listed) == [page.relative_to(DOCS).as_posix() for page in PAGES]
    assert len(listed) >= 10


def test_nothing_is_fetched_to_show_a_page(text):
    assert "font: false" in (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    assert not re.findall(r"<script|!\[[^\]]*\]\(http|src=\"http", text)


def test_paths_exist(text):
    paths = set(re.findall(r"`((?:kinreach|tests|notebooks|docs|benchmarks)/[\w/.-]*)`", text))
    environments = {"kinreach/ButtonPress-v0", "kinreach/UR5SingleStep-v0", "kinreach/UR5MultiStep-v0"}
    assert [path for path in sorted(paths - environments) if not (ROOT / path).exists()] == []
    assert len(paths) >= 20


def test_commands_exist(text):
    modules = set(re.findall(r"python -m ([\w.]+)", text))
    assert [name for name in sorted(modules) if importlib.util.find_spec(name) is None] == []
    assert modules >= {"kinreach.compare", "kinreach.demo"}
    targets = set(re.findall(r"^ *make (\w+)", text, re.MULTILINE))
    assert targets <= set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    assert "notebooks" in targets


def test_figures_of_the_thesis_have_functions():
    page = (DOCS / "thesis.md").read_text(encoding="utf-8")
    names = set(re.findall(r"`(?:plots\.)?(draw_\w+)`", page))
    assert [name for name in sorted(names) if not hasattr(plots, name)] == []
    assert len(names) >= 10


def test_names_in_the_points_exist():
    """What the column "where" names is defined somewhere in the package, or is a notebook."""
    source = "\n".join(path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py"))
    files = {path.name for path in (*PACKAGE.rglob("*.py"), *(ROOT / "notebooks").iterdir())}
    missing, checked = [], 0
    for page in ("thesis.md", "report.md"):
        for row in re.findall(r"^\| .*\|$", (DOCS / page).read_text(encoding="utf-8"), re.MULTILINE):
            where = row.split(" | ")[1] if row.count(" | ") >= 2 else ""
            for name in re.findall(r"`(?!python )(?:plots\.|ARM\.)?(\w+(?:\.py)?)\b[^`/]*`", where):
                defined = rf"^\s*(?:def|class) {name}\b|^\s*{name}\s*[:=]|[\"']?{name}[\"']?="
                known = name in files or f"{name}.ipynb" in files or re.search(defined, source, re.MULTILINE)
                missing += [] if known else [f"{page}: {name}"]
                checked += 1
    assert missing == []
    assert checked >= 40


def test_the_reference_lists_every_module():
    spec = importlib.util.spec_from_file_location("api_pages", DOCS / "api_pages.py")
    hook = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(hook)
    layers = [page.stem for page in (DOCS / "api").glob("*.md")]
    expected = {
        ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__")
        for layer in layers
        for path in (PACKAGE / layer).rglob("*.py")
        if path.name == "__init__.py" or not path.name.startswith("_")
    }
    listed = set()
    for layer in layers:
        page = hook.on_page_markdown((DOCS / "api" / f"{layer}.md").read_text(encoding="utf-8"))
        listed |= set(re.findall(r"^::: ([\w.]+)$", page, re.MULTILINE))
    assert listed == expected
    assert len(listed) >= 80
    packages = {path.parent.name for path in PACKAGE.glob("*/__init__.py")} - {"demo"}
    assert set(layers) == packages
