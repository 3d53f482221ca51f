"""Disks that are full or read-only: one clear error, and what was there stays."""

import errno
import json
import os
import subprocess
import sys

import pytest

from kinreach import cli
from kinreach._files import make_writable, write_text
from kinreach.errors import OutputError
from tests.cases import slow
from tools.endurance import storage

#: Sets the largest size of a file that the process can write, a stand-in for a full disk that needs no rights.
LIMITED = """
import json, resource, sys
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

from kinreach.baselines._training import save_checkpoint
from kinreach.baselines._models import build
from kinreach.baselines._policy_file import read_policy, save_policy
from kinreach.baselines._recipes import get_recipe
from kinreach.compare._runner import Records, prepare
from kinreach.errors import OutputError
from kinreach._files import write_text

out = Path.cwd()
trainee = build(replace(get_recipe("ranked-single"), num_envs=16), 0, steps=64)
shipped = Path(str(files("kinreach.baselines"))) / "pretrained" / "ranked-single.safetensors"
card, network = read_policy(shipped)
comparison = prepare(
    "ur5", ("lm",), goals=1000, seed=0, arm=None, observation=None, options={"backend": "kinematic"}, command=""
)
trial = {"goal_index": 0, "method": "lm", "reached": True, "reason": "x" * 200}
kept = Records(out / "records.jsonl", {}, comparison, fresh=False)
kept.add(trial)
jobs = {
    "text.json": lambda: write_text(out / "text.json", "x" * 100_000),
    "checkpoint.pt": lambda: save_checkpoint(out / "checkpoint.pt", {}, 1, trainee),
    "policy.safetensors": lambda: save_policy(out / "policy.safetensors", card, network),
    "records.jsonl": lambda: [kept.add(trial | {"goal_index": len(kept.trials)}) for _ in range(100)],
}
for name in jobs:
    if name != "records.jsonl":
        (out / name).write_text("old")
said = {}
for limit in (0, 100, 4096, 20_000):
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
    for name, job in jobs.items():
        try:
            job()
        except OutputError as error:
            said[f"{limit} {name}"] = str(error)
resource.setrlimit(resource.RLIMIT_FSIZE, (resource.getrlimit(resource.RLIMIT_FSIZE)[1],) * 2)
kept.add(trial | {"goal_index": len(kept.trials)})
print(json.dumps([said, len(kept.trials), len(Records(out / "records.jsonl", {}, comparison, fresh=False).trials)]))
"""


@pytest.mark.slow
def test_whatever_cannot_be_written_is_one_kind_of_error_and_keeps_the_old_file(run_python, tmp_path):
    done = run_python("-c", LIMITED)
    assert done.returncode == 0, done.stderr
    said, kept, found = json.loads(done.stdout)
    assert len(said) == 16
    assert all(name.split()[1] in message and "File too large" in message for name, message in said.items())
    assert kept == found > 50  # added as long as there was room, and again when there was
    for name in ("text.json", "checkpoint.pt", "policy.safetensors"):
        assert (tmp_path / name).read_text() == "old"
    assert sorted(os.listdir(tmp_path)) == ["checkpoint.pt", "policy.safetensors", "records.jsonl", "text.json"]


@pytest.mark.slow
@pytest.mark.parametrize("job", storage.COMMANDS)
def test_jobs_on_full_and_read_only_disks(job, tmp_path):
    found = storage.full_disks(tmp_path, jobs=[job], sizes=(16,))
    if not found.count:
        pytest.skip(found.detail)
    assert found.count == 2


def test_a_disk_without_room_is_refused_before_any_work(tmp_path, monkeypatch):
    def full(handle):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(OutputError, match="No space left"):
            make_writable(tmp_path / "out")
        with pytest.raises(OutputError, match=r"a\.txt: No space left"):
            write_text(tmp_path / "a.txt", "new")
    assert os.listdir(tmp_path) == ["out"]


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG])
def test_commands_end_in_one_line_whoever_could_not_write(number, monkeypatch, capsys):
    def main(argv, *, prog):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("kinreach.compare._cli.main", main)
    assert cli.run_command("compare", [], prog="kinreach compare") == cli.EXIT_ERROR
    said = capsys.readouterr().err
    assert said == f"kinreach compare: error: cannot write: {os.strerror(number)}\n"


def test_other_errors_of_the_system_are_not_hidden(monkeypatch):
    def main(argv, *, prog):
        raise ConnectionResetError(errno.ECONNRESET, "reset")

    monkeypatch.setattr("kinreach.compare._cli.main", main)
    with pytest.raises(ConnectionResetError):
        cli.run_command("compare", [], prog="kinreach compare")


EVALUATE = ("evaluate", "ranked-single", "--goals", "5", "--backend", "kinematic")


class TestOutputThatCannotBeWritten:
    """With the interpreter's buffer the failure comes when all is over, without it at the first line."""

    @staticmethod
    def start(root, arguments, unbuffered, stdout) -> subprocess.Popen:
        environment = {**os.environ, "PYTHONPATH": str(root), "PYTHONUNBUFFERED": unbuffered}
        command = [sys.executable, "-m", "kinreach", *arguments]
        return subprocess.Popen(command, env=environment, stdout=stdout, stderr=subprocess.PIPE, text=True)

    @pytest.mark.parametrize(
        ("arguments", "unbuffered"),
        [
            ((), ""),
            ((), "1"),
            (("--version",), ""),
            (("--version",), "1"),
            *slow((EVALUATE, "1")),
        ],
    )
    def test_full_device(self, root, arguments, unbuffered):
        with open("/dev/full", "w") as full, self.start(root, arguments, unbuffered, full) as process:
            said = process.communicate(timeout=120)[1].splitlines()
        assert process.returncode == cli.EXIT_ERROR
        called = " ".join(["python -m kinreach", *(name for name in arguments[:1] if name in cli.COMMANDS)])
        assert said == [f"{called}: error: cannot write: No space left on device"]

    @pytest.mark.parametrize(
        ("arguments", "unbuffered"),
        [(("--help",), ""), (("--help",), "1"), *slow((EVALUATE, ""))],
    )
    def test_reader_who_has_left(self, root, arguments, unbuffered):
        reading, writing = os.pipe()
        os.close(reading)
        with self.start(root, arguments, unbuffered, writing) as process:
            os.close(writing)
            assert process.communicate(timeout=120)[1] == ""
        assert process.returncode == cli.EXIT_UNREAD


@pytest.mark.slow
def test_complaint_that_cannot_be_written(root, tmp_path):
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "kinreach.evaluate", "--nonsense"]
        done = subprocess.run(command, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(root)}, stderr=full)
    assert done.returncode == cli.EXIT_ERROR


def test_a_broken_pipe_to_somebody_else_is_not_hidden(monkeypatch):
    def main(argv, *, prog):
        raise BrokenPipeError(errno.EPIPE, "a worker has died")

    monkeypatch.setattr("kinreach.compare._cli.main", main)
    with open(os.devnull, "w") as stdout:
        monkeypatch.setattr("sys.stdout", stdout)
        with pytest.raises(BrokenPipeError):
            cli.run_command("compare", [], prog="kinreach compare")
