"""Films: whole or not there, whatever happens to the disk."""

import errno
import json
import os
from base64 import b64encode

import cv2
import numpy as np
import pytest
from PIL import Image

from kinreach.demo._film import Film
from kinreach.errors import InputError, OutputError

#: Films of noise under a limit to the size of files, a stand-in for a full disk that needs no rights.
LIMITED = """
import json, resource, sys
from pathlib import Path

import numpy as np

from kinreach.demo._film import Film
from kinreach.errors import OutputError

hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
frames = np.random.default_rng(0).integers(0, 255, (6, 120, 160, 3), dtype=np.uint8)
said = {}
for ending in (".gif", ".mp4"):
    path = Path("film" + ending)
    with Film(path, fps=10) as film:
        for frame in frames:
            film.add(frame)
    whole = path.stat().st_size
    path.write_text("old")
    for limit in (0, 100, 20_000, whole // 2, whole - 1000, whole - 300):
        try:
            with Film(path, fps=10) as film:
                resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
                for frame in frames:
                    film.add(frame)
        except OutputError as error:
            said[f"{limit} {path}"] = str(error)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
print(json.dumps(said))
"""


class StandInWriter:
    """Plays `cv2.VideoWriter`: writes nothing, and counts how often it was released."""

    def __init__(self, *_):
        self.released = 0
        self.made.append(self)

    def isOpened(self):
        return True

    def write(self, frame):
        pass

    def release(self):
        self.released += 1


@pytest.fixture
def writers(monkeypatch):
    fresh = type("Fresh", (StandInWriter,), {"made": [], "fourcc": staticmethod(lambda *_: 0)})
    monkeypatch.setattr(cv2, "VideoWriter", fresh)
    return fresh.made


@pytest.fixture
def frame():
    return np.zeros((48, 64, 3), np.uint8)


@pytest.fixture(params=[".gif", ".mp4"])
def path(request, tmp_path):
    path = tmp_path / f"film{request.param}"
    path.write_bytes(b"old")
    return path


@pytest.mark.slow
def test_a_disk_that_is_full_at_any_moment(run_python, tmp_path):
    done = run_python("-c", LIMITED)
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert len(said) == 12
    for case, message in said.items():
        assert message.startswith(("cannot write", "OpenCV cannot write")), message
        assert case.split()[1] in message
    assert sorted(os.listdir(tmp_path)) == ["film.gif", "film.mp4"]
    assert all((tmp_path / name).read_text() == "old" for name in os.listdir(tmp_path))


def test_a_gif_that_cannot_be_finished_is_one_error(tmp_path, monkeypatch, frame):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Image.Image, "save", full)
    with pytest.raises(OutputError, match=r"cannot write .*film\.gif: No space left on device"):  # noqa: SIM117
        with Film(tmp_path / "film.gif", fps=10) as film:
            film.add(frame)
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("error", [None, ZeroDivisionError, KeyboardInterrupt, OSError])
def test_the_writer_is_released_whatever_happens(error, tmp_path, writers, frame):
    """And a film of which nothing was written, without a word, is no film."""
    expected = ZeroDivisionError if error is ZeroDivisionError else OutputError

    def make():
        with Film(tmp_path / "film.mp4", fps=10) as film:
            film.add(frame)
            if error is not None:
                raise error

    with pytest.raises(expected):
        make()
    (writer,) = writers
    assert writer.released
    assert os.listdir(tmp_path) == []


def test_an_opencv_without_the_encoder_is_one_line(tmp_path, writers, frame, monkeypatch):
    monkeypatch.setattr(cv2.VideoWriter, "isOpened", lambda self: False)
    with pytest.raises(OutputError, match=r"film\.mp4: this OpenCV has no VP9 encoder; a \.gif"):  # noqa: SIM117
        with Film(tmp_path / "film.mp4", fps=10) as film:
            film.add(frame)
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("error", [None, KeyboardInterrupt])
def test_a_film_is_whole_also_with_ctrl_c(error, path, frame):
    def make():
        with Film(path, fps=10) as film:
            for level in range(0, 250, 50):
                film.add(frame + np.uint8(level))
            if error is not None:
                raise error

    if error is None:
        make()
    else:
        with pytest.raises(error):
            make()
    film = cv2.VideoCapture(str(path))
    levels = []
    while (read := film.read())[0]:
        levels.append(float(read[1].mean()))
    np.testing.assert_allclose(levels, range(0, 250, 100 if path.suffix == ".gif" else 50), atol=4)
    assert [p.name for p in path.parent.iterdir()] == [path.name]


def test_the_folder_of_a_film_is_made(tmp_path, frame):
    with Film(tmp_path / "new" / "film.gif", fps=10) as film:
        film.add(frame)
    assert (tmp_path / "new" / "film.gif").stat().st_size > 0


def test_a_failed_film_leaves_the_old_one(path):
    with pytest.raises(AttributeError), Film(path, fps=10) as film:
        film.add("not a frame")
    with pytest.raises(InputError, match="no frames"), Film(path, fps=10):
        pass
    with pytest.raises(KeyboardInterrupt), Film(path, fps=10):
        raise KeyboardInterrupt
    assert path.read_bytes() == b"old"
    assert [p.name for p in path.parent.iterdir()] == [path.name]


#: What a browser says of a film once it can be seen to its end.
PLAYED = """source => new Promise(done => {
  const video = Object.assign(document.createElement("video"), {muted: true, playbackRate: 4});
  video.onerror = () => done(video.error.message);
  video.onended = () => done([video.videoWidth, video.videoHeight, video.duration]);
  document.body.append(video);
  video.src = source;
  video.play();
})"""


@pytest.mark.slow
def test_a_browser_plays_it(browser, tmp_path):
    path = tmp_path / "film.mp4"
    with Film(path, fps=10) as film:
        for level in range(0, 250, 10):
            film.add(np.full((48, 64, 3), level, np.uint8))
    source = f"data:video/mp4;base64,{b64encode(path.read_bytes()).decode()}"
    page = browser.new_page()
    said = page.evaluate(PLAYED, source)
    page.close()
    assert said == [64, 48, pytest.approx(2.5)]
