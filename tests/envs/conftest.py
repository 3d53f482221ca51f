import sys
import types

import pytest


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
