"""What is no regular file, or too large, is refused by whatever reads it, at once and in one line."""

import json
import os
import re
import signal
import socket
from contextlib import contextmanager

import pytest

from kinreach import _files as files
from kinreach.baselines import load_policy, read_curve
from kinreach.baselines.inside import policy_version
from kinreach.cli import main
from kinreach.compare import compare
from kinreach.deploy import read_trajectory
from kinreach.errors import InputError, KinreachError
from kinreach.kinematics import URKinematics
from kinreach.robots import ArmDescription
from kinreach.view import read_results

#: A reader that waits for a FIFO would wait for ever [s].
LIMIT = 60


@contextmanager
def time_limit():
    def stop(number, frame):
        raise TimeoutError(f"nothing happened within {LIMIT} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(LIMIT)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def fifo(path):
    os.mkfifo(path)


def bound_socket(path):
    with socket.socket(socket.AF_UNIX) as one:
        here = os.getcwd()
        os.chdir(path.parent)  # names of sockets are short
        try:
            one.bind(path.name)
        finally:
            os.chdir(here)


def sparse(path):
    with path.open("wb") as file:
        file.truncate(2**41)


KINDS = {
    "FIFO": fifo,
    "link to a FIFO": lambda path: (fifo(path.with_name("pipe")), path.symlink_to("pipe")),
    "socket": bound_socket,
    "folder": lambda path: path.mkdir(),
    "endless device": lambda path: path.symlink_to("/dev/zero"),
    "empty device": lambda path: path.symlink_to("/dev/null"),
    "terminal": lambda path: path.symlink_to("/dev/tty"),
    "sparse": sparse,
}


def read_trials(path):
    results = {"methods": [{"name": "lm", "colour": "#123456"}], "settings": {"task": "ur5"}}
    (path.parent / "results.json").write_text(json.dumps(results))
    read_results(path.parent)


def compared(path):
    compare("ur5", ["closed-form"], goals=1, out=path.parent, options={"backend": "kinematic"})


#: Reader -> the file's name.
READERS = {
    load_policy: "p.safetensors",
    policy_version: "r.safetensors",
    read_curve: "curve.csv",
    read_results: "results.json",
    read_trials: "results.csv",
    compared: "results.json",
    lambda path: compared(path): "records.jsonl",
    ArmDescription.from_urdf: "arm.urdf",
    lambda path: URKinematics.from_calibration(path, model="ur5"): "calibration.yaml",
    read_trajectory: "motion.json",
    lambda path: read_trajectory(path): "motion.csv",
    lambda path: (read_trajectory(path), None): "motion.script",
}


def refused(reader, name, kind, folder):
    """What a reader says, in one line and at once, of a special file of that name."""
    path = folder / "runs" / "folder" / name
    path.parent.mkdir(parents=True)
    KINDS[kind](path)
    with time_limit(), pytest.raises(KinreachError) as error:
        reader(path)
    assert len(str(error.value).splitlines()) == 1
    return str(error.value)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("reader", "name"), READERS.items(), ids=range(len(READERS)))
def test_special_files_are_refused_at_once(reader, name, kind, tmp_path):
    assert name in refused(reader, name, kind, tmp_path) or reader in (compared, read_results)


@pytest.mark.parametrize("argv", [
    ["compare", "--goals", "1", "--methods", "{}.safetensors"],
    ["compare", "--goals", "1", "--arm", "{}.urdf"], ["evaluate", "{}.safetensors"],
    ["demo", "--policy", "{}.safetensors"], ["check", "{}.urdf"], ["check", "ur5", "--calibration", "{}.yaml"],
    ["view", "--results", "{}.json"], ["view", "--calibration", "{}.yaml"],
])  # fmt: skip
def test_commands_refuse_special_files_in_one_line(argv, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    given = [word.format("here") for word in argv]
    name = next(word for word in given if word.startswith("here"))
    os.mkfifo(name)
    with time_limit():
        assert main(given) == 2
    said = capsys.readouterr()
    errors = [line for line in said.err.splitlines() if "nothing is drawn" not in line]  # where there is no screen
    assert len(errors) == 1
    assert "not a regular file" in errors[0]


def test_the_bound_is_in_the_message(tmp_path):
    path = tmp_path / "some.txt"
    path.write_bytes(b"12345")
    assert files.read_bytes(path, "the file", most=5) == b"12345"
    assert files.read_text(path, "the file", most=5) == "12345"
    with pytest.raises(InputError, match=r"cannot read the file .*some\.txt: it has 5 bytes, larger than 4 bytes"):
        files.read_bytes(path, "the file", most=4)
    path.write_bytes(b"\xff")
    with pytest.raises(InputError, match="UTF-8"):
        files.read_text(path, "the file", most=5)


#: Modules that open files otherwise, and how often: what the package or Python itself put there, what was just written,
#: and what `open_input` has checked before (`_policy_file.py`). In `view` it is a method of that name.
OPENING = {
    "_files.py": 5, "cli.py": 1, "_provenance.py": 2, "baselines/_policy_file.py": 1, "baselines/_seeds.py": 1,
    "baselines/_policies.py": 1, "compare/_report.py": 4, "compare/_runner.py": 1,
    "compare/_methods/resolve.py": 1, "view/_cli.py": 2, "view/_real_arm_panel.py": 3,
    "view/_results_panel.py": 3, "view/_server.py": 1, "kinematics/_core/__init__.py": 1,
}  # fmt: skip


def test_nothing_else_opens_what_a_user_hands_over(root):
    """A new place that opens a file goes through `kinreach._files`, or is listed above with its reason."""
    opening = re.compile(
        r"\.read_text\(|\.read_bytes\(|\bopen\(|np\.load\(|ZipFile\(|safe_open\(|torch\.load\((?!io|file)"
    )
    found = {}
    for path in (root / "kinreach").rglob("*.py"):
        if count := len(opening.findall(path.read_text(encoding="utf-8"))):
            found[path.relative_to(root / "kinreach").as_posix()] = count
    assert found == OPENING
