"""A picture where one can be drawn, and a line that says why not where it cannot."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from kinreach.compare import Settings
from kinreach.compare.contests import CONTESTS
from kinreach.compare.scene_picture import write_scene
from kinreach.compare.tasks import TASKS
from kinreach.errors import InstallationError


def test_a_picture_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frame = np.random.default_rng(0).integers(0, 255, (36, 64, 3), dtype=np.uint8)
    monkeypatch.setattr(CONTESTS["arm3"], "scene", lambda settings: frame)
    said = write_scene(Settings(task="arm3"), tmp_path / "scene.png")
    assert said == f"Scene: {tmp_path / 'scene.png'}"
    assert (tmp_path / "scene.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("task", TASKS)
def test_every_task_has_a_scene(needs_gl: None, task: str, tmp_path: Path) -> None:
    write_scene(Settings(task=task, seed=1), tmp_path / "scene.png")
    picture = imread(tmp_path / "scene.png")[..., :3]
    assert picture.shape == (720, 1280, 3)
    red, green, blue = np.moveaxis(picture, 2, 0)
    assert ((red > 0.5) & (green < 0.2) & (blue < 0.2)).sum() > 50  # the ball
    pressed = (green > 0.35) & (red < 0.25) & (blue < 0.35)
    assert (pressed.sum() > 50) == (task == "button")  # the cap of a button that was pressed


@pytest.mark.parametrize("task", TASKS)
def test_without_opengl_there_is_a_line_and_no_file(task: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_library() -> None:
        raise InstallationError("cannot draw:\n  install libegl1")

    monkeypatch.setattr("kinreach.sim.rendering._choose_library", no_library)
    said = write_scene(Settings(task=task), tmp_path / "scene.png")
    assert said == "No picture of the scene: cannot draw: install libegl1"
    assert list(tmp_path.iterdir()) == []
