import re
import sys
import types

import pytest

HEADED = 2  # lines of a table before its first row


@pytest.fixture(scope="session")
def doc_tables():
    """`doc_tables(docstring, heading)`: the tables of a docstring's section, each a list of rows of cells."""

    def tables(docstring, heading):
        section = docstring.split(f"## {heading}")[1].split("\n    ## ")[0]
        found = [block.splitlines() for block in re.findall(r"(?:^    \|.*\n?)+", section, re.MULTILINE)]
        return [
            [[cell.strip() for cell in row.strip().strip("|").split("|")] for row in rows[HEADED:]] for rows in found
        ]

    return tables


@pytest.fixture
def films(monkeypatch):
    """The frames of each film that Gymnasium hands to moviepy, which is not installed here."""
    films = []

    class Clip:
        def __init__(self, frames, fps):
            films.append(list(frames))

        def write_videofile(self, *args, **kwargs):
            pass

    editor = types.ModuleType("moviepy.video.io.ImageSequenceClip")
    editor.ImageSequenceClip = Clip
    for name in ("moviepy", "moviepy.video", "moviepy.video.io"):
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    monkeypatch.setitem(sys.modules, "moviepy.video.io.ImageSequenceClip", editor)
    return films
