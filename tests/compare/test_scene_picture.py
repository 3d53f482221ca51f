"""A picture where one can be drawn, and a line that says why not where it cannot."""

from pathlib import Path

import numpy as np
import pytest

from kinreach.compare.scene_picture import write_scene
from kinreach.compare.tasks import ButtonTask
from kinreach.errors import InstallationError


def test_a_picture_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frame = np.random.default_rng(0).integers(0, 255, (36, 64, 3), dtype=np.uint8)
    monkeypatch.setattr("kinreach.compare.scene_picture.render", lambda simulation: frame)
    said = write_scene(ButtonTask(), tmp_path / "scene.png", seed=0)
    assert said == f"Scene: {tmp_path / 'scene.png'}"
    assert (tmp_path / "scene.png").read_bytes().startswith(b"\x89PNG")


def test_without_opengl_there_is_a_line_and_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_library(simulation: object) -> None:
        raise InstallationError("cannot draw:\n  install libegl1")

    monkeypatch.setattr("kinreach.compare.scene_picture.render", no_library)
    assert (
        write_scene(ButtonTask(), tmp_path / "scene.png", seed=0)
        == "No picture of the scene: cannot draw: install libegl1"
    )
    assert list(tmp_path.iterdir()) == []
