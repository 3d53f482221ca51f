"""A hook of mkdocs: pages in `api/` list what a package exports, and examples are shown as they are."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
#: What stands in a page for the names of a package.
PLACE = re.compile(r"^<!-- names of ([\w.]+) -->$", re.MULTILINE)
#: What stands in a page for the code of an example.
CODE = re.compile(r"^<!-- code of (examples/\w+\.py) -->$", re.MULTILINE)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Put names and code in their places."""
    markdown = PLACE.sub(lambda match: "\n".join(_directives(match[1])), markdown)
    return CODE.sub(lambda match: f"```python\n{(ROOT / match[1]).read_text(encoding='utf-8')}```", markdown)


def exported(package: str) -> list[str]:
    """Names in the `__all__` of a package."""
    source = ROOT.joinpath(*package.split("."), "__init__.py").read_text(encoding="utf-8")
    (names,) = (
        node.value
        for node in ast.parse(source).body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
    )
    return list(ast.literal_eval(names))


def _directives(package: str) -> Iterator[str]:
    yield f"::: {package}\n    options:\n      members: false\n"
    for name in exported(package):
        yield f"::: {package}.{name}\n"
