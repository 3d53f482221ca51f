"""A hook of mkdocs: pages in `api/` list every public module of a package, and examples are shown as they are."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
#: What stands in a page for the modules of a package.
PLACE = re.compile(r"^<!-- modules of ([\w.]+) -->$", re.MULTILINE)
#: What stands in a page for the code of an example.
CODE = re.compile(r"^<!-- code of (examples/\w+\.py) -->$", re.MULTILINE)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Put modules and code in their places."""
    markdown = PLACE.sub(lambda match: "\n".join(_directives(match[1])), markdown)
    return CODE.sub(lambda match: f"```python\n{(ROOT / match[1]).read_text(encoding='utf-8')}```", markdown)


def modules(package: str) -> Iterator[str]:
    """Public modules of a package and of those in it, each package before what is in it."""
    folder = ROOT.joinpath(*package.split("."))
    yield package
    for path in sorted(folder.iterdir()):
        if path.name.startswith("_"):
            continue
        if path.suffix == ".py":
            yield f"{package}.{path.stem}"
        elif (path / "__init__.py").is_file():
            yield from modules(f"{package}.{path.name}")


def _directives(package: str) -> Iterator[str]:
    for name in modules(package):
        yield f"::: {name}"
        if ROOT.joinpath(
            *name.split("."), "__init__.py"
        ).is_file():  # what it exports is documented where it is defined
            yield "    options:\n      members: false"
        yield ""
