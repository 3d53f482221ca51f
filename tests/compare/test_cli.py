"""The command: tables, the command that gives them again, and one clear line where something is wrong."""

import json
import re
import shlex
import signal
import subprocess
import sys
import time

import pytest

from kinreach import cli
from kinreach.compare.runner import RECORDS


def call(*argv):
    return cli.main(["compare", *argv])


def test_a_comparison_prints_its_tables_and_the_command_that_gives_it_again(tmp_path, capsys):
    argv = ["--methods", "closed-form,lm", "--goals", "3", "--seed", "5", "--out", str(tmp_path / "a b")]
    assert call(*argv) == 0
    said = capsys.readouterr().out
    assert "closed-form" in said
    assert "Where the distance comes from" in said
    again = shlex.split(re.search(r"Again: (.*)", said)[1])
    assert again == ["kinreach", "compare", "--task", "ur5", *argv]
    assert all(len(line) <= 100 for line in said.split("\n\n")[0].splitlines())
    assert call(*again[2:]) == 0
    assert json.loads((tmp_path / "a b" / "results.json").read_text())["settings"]["goals"] == 3


@pytest.mark.parametrize(("argv", "said"), [
    (["--task", "ur6"], "unknown task 'ur6'"),
    (["--methods", "closed"], "unknown ur5 method 'closed'"),
    (["--methods", "nowhere:Thing"], "cannot import the method nowhere:Thing"),
    (["--methods", "missing.safetensors"], "missing.safetensors"),
    (["--methods", "missing.zip"], "missing.zip"),
    (["--goals", "0"], "goals must be at least 1"),
    (["--goals", "x"], "invalid int value"),
    (["--seed", "-1"], "seed must be at least 0"),
    (["--observation", "pixels"], "unknown ur5 observation"),
    (["--task", "arm3", "--observation", "camera"], "unknown arm3 observation"),
    (["--pipeline", "thesis"], "need observation 'camera'"),
    (["--observation", "camera", "--pipeline", "best"], "available: hybrid, thesis"),
    (["--observation", "camera", "--resolution", "wide"], "WIDTHxHEIGHT"),
    (["--observation", "camera", "--depth-noise", "-1"], "depth_noise"),
    (["--max-steps", "5"], "max_steps"),
    (["--task", "button", "--max-steps", "0"], "max_steps"),
    (["--task", "button", "--actuation", "strong"], "available: report, tuned"),
    (["--arm", "ur6"], "unknown arm 'ur6'"),
    (["--task", "button", "--arm", "ur10"], "arm"),
])  # fmt: skip
def test_bad_input_is_one_clear_line(argv, said, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    try:
        code = call("--goals", "1", *argv) if "--goals" not in argv else call(*argv)
    except SystemExit as error:  # of argparse
        code = error.code
    assert code == cli.EXIT_ERROR
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert said in lines[0]


def test_a_task_of_a_users_own_does_not_pass_for_one_of_the_package(tmp_path, monkeypatch, capsys):
    module = (
        "from kinreach.compare import get_task\nfrom dataclasses import replace\nTASK = replace(get_task('arm3'))\n"
    )
    (tmp_path / "taken_name.py").write_text(module)
    monkeypatch.chdir(tmp_path)
    assert call("--task", "taken_name:TASK", "--goals", "1") == 2
    assert "a task named 'arm3' is registered already" in capsys.readouterr().err


def test_results_of_another_comparison_stay(tmp_path, capsys):
    assert call("--methods", "closed-form", "--goals", "1", "--out", str(tmp_path)) == 0
    assert call("--methods", "closed-form", "--goals", "2", "--out", str(tmp_path)) == cli.EXIT_ERROR
    assert "--fresh" in capsys.readouterr().err
    assert call("--methods", "closed-form", "--goals", "2", "--out", str(tmp_path), "--fresh") == 0


def test_help_names_every_task_and_method(capsys):
    with pytest.raises(SystemExit):
        call("--help")
    said = capsys.readouterr().out
    for word in ("ur5", "arm3", "button", "closed-form", "ranked-multi", "analytic", "module:attribute", "--arm"):
        assert word in said


def test_ctrl_c_is_one_line_and_keeps_what_is_finished(tmp_path, root):
    command = [sys.executable, "-m", "kinreach.compare", "--goals", "5000", "--methods", "closed-form"]
    running = subprocess.Popen(
        [*command, "--out", str(tmp_path)], cwd=root, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    records = tmp_path / RECORDS
    for _ in range(600):
        if records.exists() and len(records.read_text().splitlines()) > 3:
            break
        time.sleep(0.1)
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=60)
    assert running.returncode == cli.EXIT_INTERRUPTED
    assert re.fullmatch(r"python -m kinreach\.compare: interrupted; \d+ finished trials are kept in .*\n", said)
    assert len(records.read_text().splitlines()) > 3
