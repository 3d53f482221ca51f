"""A hook of mkdocs: the pages in `api/` list every public module of a package, so that none can be forgotten."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
#: What stands in a page for the modules of a package.
PLACE = re.compile(r"^<!-- modules of ([\w.]+) -->$", re.MULTILINE)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Put the modules in their place."""
    return PLACE.sub(lambda match: "\n".join(_directives(match[1])), markdown)


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
