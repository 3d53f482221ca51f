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
from tests.compare.failing_methods import FAILING
from tests.policy_files import copy_policy

pytestmark = pytest.mark.usefixtures("without_pictures")


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
    (["--methods", "solvers/mine.py:Mine"], "a module is named without .py, as in solvers.mine:Mine"),
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
    (["--pipeline", "thesis"], "--pipeline needs observation 'camera'"),
    (["--observation", "camera", "--pipeline", "best"], "available: hybrid, thesis"),
    (["--observation", "camera", "--resolution", "wide"], "WIDTHxHEIGHT"),
    (["--observation", "camera", "--depth-noise", "-1"], "depth_noise"),
    (["--max-steps", "5"], "unrecognized arguments: --max-steps 5"),
    (["--margin", "thick"], "--margin must be a number, got 'thick'"),
    (["--end-on-reached", "maybe"], "--end-on-reached must be true or false, got 'maybe'"),
    (["--task", "button", "--max-episode-steps", "1.5"], "--max-episode-steps must be a whole number, got '1.5'"),
    (["--task", "button", "--max-episode-steps", "0"], "max_episode_steps must be at least 1, got 0"),
    (["--task", "button", "--actuation", "strong"], "available: report, tuned"),
    (["--observation", "camera", "--resolution", "160x"], "WIDTHxHEIGHT"),
    (["--arm", "ur6"], "unknown arm 'ur6'"),
    (["--tool-mass", "1"], "--tool-mass needs --arm"),
    (["--package-dir", "x"], "--package-dir needs --arm"),
    (["--task", "json:dumps"], "json:dumps is not a Task"),
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


def contents(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_what_stands_in_a_default_folder_and_is_of_something_else_stays(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    argv = ["--methods", "closed-form", "--goals", "1"]
    assert call(*argv, "--seed", "3", "--out", "results/compare-ur5-closed-form-goals1") == 0
    kept = contents(tmp_path / "results")
    for _ in range(2):
        assert call(*argv) == 0
        assert "In results/compare-ur5-closed-form-goals1-2:" in capsys.readouterr().out
    assert {name: data for name, data in contents(tmp_path / "results").items() if name in kept} == kept
    assert len(list((tmp_path / "results").iterdir())) == 2


def test_another_file_of_the_same_name_is_another_method(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name in ("ranked-single", "ppo-single"):
        (tmp_path / name).mkdir()
        copy_policy(name, tmp_path / name / "p.safetensors")
    assert call("--goals", "1", "--methods", "ranked-single/p.safetensors", "--out", "here") == 0
    assert call("--goals", "1", "--methods", "ppo-single/p.safetensors", "--out", "here") == cli.EXIT_ERROR
    assert "another comparison" in capsys.readouterr().err


@pytest.mark.parametrize(("method", "said"), [
    ("failing:Fails", r"method 'Fails' failed on goal 1: ZeroDivisionError: division by zero \(failing.py, line 12\)"),
    ("failing:Unmade", r"method 'Unmade' cannot be made: KeyError: 'no such thing' \(failing.py, line 17\)"),
    ("failing:wrong", r"method 'wrong' failed on warm-up goal 0: .*shape"),
])  # fmt: skip
def test_a_method_of_ones_own_that_raises_is_named_with_the_goal(method, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "failing", raising=False)
    # 2 goals of the warm-up with an untimed and a timed decision each, then as many for goal 0
    (tmp_path / "failing.py").write_text(FAILING.format(calls=6))
    assert call("--methods", f"closed-form,{method}", "--goals", "3", "--out", "here") == cli.EXIT_ERROR
    error = capsys.readouterr().err
    assert len(error.splitlines()) == 1
    assert re.search(said, error)


def test_help_names_every_task_and_method(capsys):
    with pytest.raises(SystemExit):
        call("--help")
    said = capsys.readouterr().out
    for word in ("ur5", "arm3", "button", "closed-form", "ranked-multi", "analytic", "module:attribute", "--arm"):
        assert word in said


@pytest.mark.parametrize(("task", "flags"), [
    ("ur5", ["--pipeline", "--resolution WxH", "--rgb-noise", "--depth-noise", "--margin", "[px]"]),
    ("space", ["--tilt", "[degrees]", "(default: 30)", "--start-spread", "[rad]", "--resolution"]),
    ("button", ["--max-episode-steps", "(default: 100)", "--actuation"]),
    ("real-arm", ["--looks", "--again", "--calibrations", "--noise", "[m]"]),
    ("moving", ["--speeds", "[m/s]", "--paths", "--delay", "[s]"]),
    ("obstacles", ["--clutter", "--heights", "--margin", "[m]"]),
])  # fmt: skip
def test_help_lists_the_options_of_a_task_with_units(task, flags, capsys):
    with pytest.raises(SystemExit):
        call("--task", task, "--help")
    said = " ".join(capsys.readouterr().out.split())
    assert f"options of the task {task}:" in said
    for words in flags:
        assert words in said
    for word in ("--goal-in", "--sights", "--controls", "--render-mode", "--reward", "`"):
        assert word not in said


@pytest.mark.slow
def test_ctrl_c_is_one_line_and_keeps_what_is_finished(tmp_path, root):
    command = [sys.executable, "-m", "kinreach.compare", "--goals", "5000", "--methods", "closed-form"]
    running = subprocess.Popen(
        [*command, "--out", str(tmp_path)], cwd=root, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    records = tmp_path / "records.jsonl"
    while not (records.exists() and len(records.read_text().splitlines()) > 3):
        assert running.poll() is None, running.communicate()
        time.sleep(0.1)
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=600)
    assert running.returncode == cli.EXIT_INTERRUPTED
    assert re.fullmatch(r"python -m kinreach\.compare: interrupted; \d+ finished trials are kept in .*\n", said)
    assert len(records.read_text().splitlines()) > 3
