"""The command line: what it says when it is used wrongly, interrupted, or well."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from kinreach import cli
from kinreach.compare.methods import METHODS
from kinreach.errors import InstallationError

PROG = "kinreach compare"


def _call(*argv: str) -> int:
    """Exit code of `kinreach` with these arguments."""
    try:
        return cli.main(argv)
    except SystemExit as leaving:
        return int(leaving.code or 0)


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["--task", "chess"], "unknown task 'chess'; available: arm3, button, ur5"),
        (["--methods", "magic"], "unknown ur5 method 'magic'; available: closed-form, hybrid, lm, placo, ppo-multi,"),
        (
            ["--task", "button", "--methods", "random,lm"],
            "unknown button method 'lm'; available: analytic, ppo, random",
        ),
        (["--methods", ""], "unknown ur5 method ''"),
        (["--methods", "lm,lm"], "method 'lm' is named twice"),
        (["--methods", "lm,folder/lm.safetensors"], "method 'lm' is named twice"),
        (["--methods", "nowhere.safetensors"], "cannot read the policy nowhere.safetensors: No such file or directory"),
        (
            ["--task", "arm3", "--methods", "lm.safetensors"],
            "unknown arm3 method 'lm.safetensors'; available: closed-form, lm",
        ),
        (
            ["--task", "button", "--methods", "nowhere.safetensors"],
            "cannot read the policy nowhere.safetensors: No such",
        ),
        (["--max-steps", "10"], "max steps and actuation need task 'button', got task 'ur5'"),
        (["--task", "arm3", "--actuation", "tuned"], "max steps and actuation need task 'button', got task 'arm3'"),
        (["--task", "button", "--max-steps", "0"], "max_steps must be at least 1, got 0"),
        (["--task", "button", "--actuation", "magic"], "unknown actuation 'magic'; available: report, tuned"),
        (["--goals", "0"], "the number of goals must be at least 1, got 0"),
        (["--goals", "-3"], "the number of goals must be at least 1, got -3"),
        (["--goals", "many"], "argument --goals: invalid int value: 'many'"),
        (["--seed", "-1"], "the seed must be at least 0, got -1"),
        (["--observation", "pixels"], "unknown ur5 observation 'pixels'; available: camera, geometric"),
        (["--task", "button", "--observation", "camera"], "unknown button observation 'camera'; available: geometric"),
        (["--pipeline", "thesis"], "pipeline, resolution and noise need observation 'camera', got observation 'geo"),
        (["--rgb-noise", "0"], "need observation 'camera'"),
        (["--observation", "camera", "--pipeline", "magic"], "unknown pipeline 'magic'; available: hybrid, thesis"),
        (["--observation", "camera", "--resolution", "640"], "expected WIDTHxHEIGHT in pixels, such as 640x360, got '"),
        (["--observation", "camera", "--resolution", "-640x360"], "argument --resolution"),
        (["--observation", "camera", "--resolution", "8x8"], "width [px] must be at least 16, got 8"),
        (["--observation", "camera", "--rgb-noise", "nan"], "at least 0 and at most 255, got nan"),
        (["--observation", "camera", "--depth-noise", "-1"], "at least 0 and at most 1, got -1.0"),
        (["--colour"], "unrecognized arguments: --colour"),
        (["--out"], "argument --out: expected one argument"),
    ],
)
def test_bad_input_is_one_clear_line(argv: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert _call("compare", *argv) == cli.EXIT_ERROR
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"{PROG}: error: ")
    assert said in err
    assert err.count("\n") == 1


def test_an_unknown_method_lists_every_method_there_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert _call("compare", "--methods", "magic") == cli.EXIT_ERROR
    said = capsys.readouterr().err
    assert all(name in said for name in METHODS["ur5"])


def test_a_directory_that_cannot_be_written_is_one_clear_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert _call("compare", "--goals", "1", "--out", str(tmp_path / "file" / "out")) == cli.EXIT_ERROR
    err = capsys.readouterr().err
    assert err == f"{PROG}: error: cannot write {tmp_path / 'file' / 'out'}: Not a directory\n"


def test_a_method_whose_package_is_missing_is_one_clear_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(kinematics: object) -> None:
        raise InstallationError("cannot import placo:\n  install it")

    monkeypatch.setitem(METHODS["ur5"], "placo", missing)  # type: ignore[arg-type]
    assert _call("compare", "--goals", "1", "--out", str(tmp_path)) == cli.EXIT_ERROR
    assert capsys.readouterr().err == f"{PROG}: error: cannot import placo: install it\n"


def test_cameras_without_a_graphics_library_are_one_clear_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_library() -> None:
        raise InstallationError("cannot draw. Do: apt install libegl1 libgl1,\n or apt install libosmesa6")

    monkeypatch.setattr("kinreach.sim.rendering._choose_library", no_library)
    assert _call("compare", "--observation", "camera", "--goals", "1", "--out", str(tmp_path)) == cli.EXIT_ERROR
    out, err = capsys.readouterr()
    assert out == ""
    assert err == f"{PROG}: error: cannot draw. Do: apt install libegl1 libgl1, or apt install libosmesa6\n"
    assert list(tmp_path.iterdir()) == []


def test_pictures_that_cannot_be_drawn_so_large_are_one_clear_line(
    needs_gl: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = ["--observation", "camera", "--resolution", "9000x9000", "--goals", "1", "--out", str(tmp_path)]
    assert _call("compare", *argv) == cli.EXIT_ERROR
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert "got 9000" in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("argv", "said"), [([], "required: COMMAND"), (["dance"], "invalid choice: 'dance'")])
def test_a_missing_or_unknown_command_is_one_clear_line(
    argv: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _call(*argv) == cli.EXIT_ERROR
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1


def test_help_names_every_command_and_every_method(capsys: pytest.CaptureFixture[str]) -> None:
    assert _call("--help") == 0
    text = capsys.readouterr().out
    assert all(name in text for name in cli.COMMANDS)
    assert _call("compare", "--help") == 0
    text = capsys.readouterr().out
    assert all(name in text for methods in METHODS.values() for name in methods)


def test_a_comparison_prints_its_table_and_the_command_that_gives_it_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        _call("compare", "--task", "arm3", "--methods", "closed-form,lm", "--goals", "2", "--out", str(tmp_path)) == 0
    )
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[3:5]] == ["closed-form", "lm"]
    command = json.loads((tmp_path / "results.json").read_text())["settings"]["command"]
    assert command == "kinreach compare --task arm3 --methods closed-form,lm --goals 2 --seed 0"
    assert any(command in line for line in lines)


@pytest.mark.usefixtures("stand_in", "no_figures")
@pytest.mark.parametrize(
    ("argv", "again"),
    [
        ("", ""),
        ("--pipeline hybrid --resolution 640x360 --rgb-noise 0", ""),
        ("--pipeline thesis --depth-noise 2e-3", " --pipeline thesis --depth-noise 0.002"),
        ("--resolution 1280x720 --rgb-noise 6", " --resolution 1280x720 --rgb-noise 6.0"),
    ],
)
def test_a_comparison_with_cameras_says_so_and_how_to_do_it_again(
    argv: str, again: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("kinreach.compare.cli.write_scene", lambda *_, **__: "")
    asked = ["--methods", "closed-form", "--goals", "1", "--observation", "camera", *argv.split()]
    assert _call("compare", *asked) == 0
    said = capsys.readouterr().out
    assert "Seen: the cameras' median error" in said
    results = json.loads((tmp_path / "results" / "compare-ur5-camera" / "results.json").read_text())
    command = f"{PROG} --task ur5 --methods closed-form --goals 1 --seed 0 --observation camera{again}"
    assert results["settings"]["command"] == command
    assert command in said


@pytest.mark.parametrize("module", [["kinreach.compare"], ["kinreach", "compare"]])
def test_as_a_module(module: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", *module, "--task", "chess"], capture_output=True, text=True, check=False
    )
    assert done.returncode == cli.EXIT_ERROR
    assert done.stdout == ""
    assert done.stderr == f"python -m {' '.join(module)}: error: unknown task 'chess'; available: arm3, button, ur5\n"


@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT")
def test_ctrl_c_is_one_line_and_keeps_what_is_finished(tmp_path: Path) -> None:
    arguments = ["--task", "arm3", "--methods", "closed-form", "--goals", "2000", "--out", str(tmp_path)]
    records = tmp_path / "records.jsonl"
    with subprocess.Popen(
        [sys.executable, "-m", "kinreach.compare", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # background jobs inherit "ignore"
    ) as process:
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and not (records.exists() and records.read_text().count("\n") > 3):
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert process.returncode == cli.EXIT_INTERRUPTED
    assert out == ""
    assert err.startswith("python -m kinreach.compare: interrupted; ")
    assert err.count("\n") == 1
    kept = records.read_text().count("\n") - 1
    assert kept >= 3
    said = re.search(r"(\d+) finished trials are kept in", err)
    assert said is not None
    assert int(said[1]) in (kept - 1, kept)
