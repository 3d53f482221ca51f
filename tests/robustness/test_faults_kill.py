"""Processes that are killed: nothing half-written stays, and going on gives the uninterrupted result."""

import fcntl
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import partial

import pytest

from kinreach._files import UNFINISHED, make_writable, write_text
from kinreach.baselines import _training as training
from kinreach.baselines import get_recipe, read_curve, train
from tools.endurance import kills
from tools.endurance.outcome import BrokenPromiseError

RECIPE = replace(get_recipe("ranked-single"), num_envs=32, steps=32 * 48, segments=3, window=256)


#: As `make endurance` has them, on fewer goals.
WORKS = {
    "off-policy training": kills.WORKS["off-policy training"],
    "comparison": replace(kills.WORKS["comparison"], run=partial(kills.compared, goals=6)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", WORKS)
def test_killed_at_random_moments_a_job_goes_on_to_the_same_end(name, tmp_path):
    assert kills.kill_and_go_on(WORKS[name], tmp_path, kills=1).count >= 1


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return train(RECIPE, tmp_path_factory.mktemp("whole"), seed=1).folder


@pytest.mark.slow
def test_what_is_not_whole_is_found(whole):
    """The check can fail: half of each file is refused."""
    assert kills.whole_files(whole) == 4
    for path in ("policy.safetensors", "curve.csv", "run.json", "checkpoint.pt"):
        content = (whole / path).read_bytes()
        (whole / path).write_bytes(content[: len(content) // 2])
        with pytest.raises(BrokenPromiseError, match=path):
            kills.whole_files(whole)
        (whole / path).write_bytes(content)


@pytest.mark.parametrize("segment", [0, 2])
@pytest.mark.slow
def test_a_run_that_dies_between_its_checkpoint_and_its_curve_has_a_whole_curve_in_the_end(
    segment, whole, tmp_path, monkeypatch
):
    written = 0

    def die(path, text):
        nonlocal written
        if path.name == "curve.csv":
            if written == segment:
                raise SystemExit(9)
            written += 1
        write_text(path, text)

    with monkeypatch.context() as patch:
        patch.setattr(training, "write_text", die)
        with pytest.raises(SystemExit):
            train(RECIPE, tmp_path / "killed", seed=1)
    train(RECIPE, tmp_path / "killed", seed=1, resume=True)
    for name in ("policy.safetensors", "curve.csv"):
        assert (tmp_path / "killed" / name).read_bytes() == (whole / name).read_bytes()
    assert len(read_curve(tmp_path / "killed" / "curve.csv")["steps"]) > 3


HOLD_A_FILE_OPEN = """
import sys, time
from pathlib import Path
from kinreach._files import replacing
with replacing(Path(sys.argv[1])) as temporary:
    temporary.write_text("half of the ne")
    print("started", flush=True)
    time.sleep(600)
"""


@pytest.fixture
def writer(tmp_path, root):
    """A process in the middle of writing `results.json`, in which `old` stands."""
    path = tmp_path / "results.json"
    path.write_text("old")
    command = [sys.executable, "-c", HOLD_A_FILE_OPEN, str(path)]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout.readline() == "started\n"
        yield process, path
        process.kill()


def unfinished(path):
    return [name for name in os.listdir(path.parent) if UNFINISHED in name]


def test_what_a_killed_writer_leaves_is_swept_up_by_the_next_one(writer):
    process, path = writer
    assert len(unfinished(path)) == 1
    process.kill()
    process.wait(60)
    assert path.read_text() == "old"
    assert len(unfinished(path)) == 1
    write_text(path, "new")
    assert path.read_text() == "new"
    assert unfinished(path) == []


def test_what_somebody_is_writing_is_left_alone(writer):
    process, path = writer
    make_writable(path.parent)
    write_text(path, "other")
    assert len(unfinished(path)) == 1
    process.kill()
    process.wait(60)
    make_writable(path.parent)
    assert unfinished(path) == []
    assert path.read_text() == "other"


def test_names_that_look_like_patterns_and_files_of_others_survive(tmp_path):
    others = [
        ".notes-unfinished.txt", "results-unfinished-1.json", ".results.json", ".thesis-unfinished-chapter3.tex",
        ".results-unfinished-0123abcd.json", f".results{UNFINISHED}notes.json",
        f".results{UNFINISHED}1-{16 * 'a'}.json",
    ]  # fmt: skip
    for name in others:
        (tmp_path / name).write_text("mine")
    for path in (tmp_path / "[a-z].json", tmp_path / "results.json", tmp_path / "*.csv"):
        write_text(path, "x")
        assert path.read_text() == "x"
    make_writable(tmp_path)
    assert {name for name in others if (tmp_path / name).exists()} == set(others)


def test_a_copy_of_what_a_killed_writer_left_is_somebody_elses(writer):
    process, path = writer
    process.kill()
    process.wait(60)
    (left,) = unfinished(path)
    shutil.copy(path.parent / left, path.parent / f"{left}.kept")
    (path.parent / left).rename(path.parent / "moved")
    shutil.copy(path.parent / "moved", path.parent / left)
    (path.parent / f".link{UNFINISHED}1-{16 * 'b'}").symlink_to("moved")
    make_writable(path.parent)
    assert len(unfinished(path)) == 3


def test_no_sweep_takes_a_file_that_is_about_to_be_locked(tmp_path, monkeypatch):
    found = []
    lock = fcntl.flock

    def sweep_first(handle, operation):
        if not found:
            found.extend(unfinished(tmp_path / "a"))
            make_writable(tmp_path)
        lock(handle, operation)

    monkeypatch.setattr(fcntl, "flock", sweep_first)
    write_text(tmp_path / "a.txt", "whole")
    assert (tmp_path / "a.txt").read_text() == "whole"
    assert len(found) == 1
    assert os.listdir(tmp_path) == ["a.txt"]


def test_a_file_system_without_locks_is_written_to_all_the_same(tmp_path, monkeypatch):
    def refuse(handle, operation):
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(fcntl, "flock", refuse)
    write_text(tmp_path / "a.txt", "whole")
    make_writable(tmp_path)
    assert (tmp_path / "a.txt").read_text() == "whole"
    assert os.listdir(tmp_path) == ["a.txt"]
