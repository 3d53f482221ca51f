"""The command lines under fuzz: bad arguments are one line on stderr and exit code 2, whatever they are."""

import io
import os
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout

import pytest
from hypothesis import strategies as st

from kinreach import cli
from tests.cases import slow

OPTIONS = {
    "compare": [
        "--task", "--methods", "--goals", "--seed", "--observation", "--out", "--fresh", "--pipeline", "--resolution",
        "--rgb-noise", "--depth-noise", "--max-episode-steps", "--actuation", "--help", "--", "--nonsense",
    ],
    "train": ["--seed", "--seeds", "--steps", "--out", "--resume", "--export", "--threads", "--help", "single", "-h"],
    "evaluate": [
        "--goals", "--backend", "--observation", "--max-episode-steps", "--out", "--record", "single", "button", "-h",
    ],
    "demo": [
        "--env", "--policy", "--steps", "--reset-every", "--seed", "--backend", "--observation", "--actuation",
        "--print", "--video", "--help",
    ],
    "move": [
        "--arm", "--to", "--from", "--linear", "--speed", "--blend", "--script", "--robot", "--ports", "--no-cell",
        "--tool", "--tool-mass", "--calibration", "--tip", "-h", "--nonsense",
    ],
    "simulate-ur": ["--arm", "--from", "--address", "--rtde-port", "--script-port", "--speed", "--no-cell", "-h"],
    "bench": ["--suite", "--quick", "--rounds", "--seed", "--out", "--docs", "--fresh", "--help", "--", "--nonsense"],
}  # fmt: skip
COSTLY = ("compare", "demo")
WORDS = [
    "", " ", "-1", "0", "1", "3", "1e9", "nan", "inf", "1" * 30, "9" * 5000, "2.5", "\u0663", "\u00b2", "true", "None",
    "a\0b", "\udcff", "\n", "\x1b[2J", "x" * 5000, "../..", "/proc/nowhere/x", "/dev/full", "[/red]", "<b>", "%s", "{}",
    "--", "-", "640x360", "0x0", "9" * 5000 + "x1", "1x", "ur5", "arm3", "button", "chess", "lm", "lm,lm", ",", "$HOME",
    "geometric", "camera", "pixels", "kinematic", "mujoco", "hybrid", "thesis", "tuned", "report", "single", "multi",
    "ppo-single", "random", "analytic", "x.safetensors", "a.gif", "a.mp4", ".gif", "a.avi", "reward,info", "nothing",
    "env,train", "env,chess", "page.md", "page.json", "ur5e", "-0.4,0.3,0.3,3.14,0,0", "127.0.0.1", "0,0",
]  # fmt: skip


class Accepted(BaseException):
    """Stands for the work that would begin now."""


def begin(*_arguments, **_options):
    raise Accepted


@pytest.fixture(autouse=True)
def nothing_is_measured(monkeypatch, tmp_path):
    """The arguments are what is tested, not the work."""
    import kinreach.baselines._training  # noqa: F401 (so that its function can be replaced)

    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DISPLAY", raising=False)
    for name in (
        "kinreach.compare._cli.compare", "kinreach.baselines._evaluate_cli.evaluate", "kinreach.demo._cli._run",
        "kinreach.baselines._training.train", "kinreach.deploy._moving.MotionPlanner",
        "kinreach.deploy._move_cli.URClient", "kinreach.deploy._simulate_cli.SimulatedUR",
        "benchmarks.speed.cli.run_suites",
    ):  # fmt: skip
        monkeypatch.setattr(name, begin)


def outcome(argv):
    """What `kinreach` with these arguments says; None if the work would begin."""
    out, err = io.StringIO(), io.StringIO()
    try:
        with redirect_stdout(out), redirect_stderr(err):
            if argv[0] == "bench":
                code = cli.run("benchmarks.speed.cli", argv[1:], prog="kinreach bench")
            else:
                code = cli.main(argv)
    except SystemExit as leaving:
        code = leaving.code
    except Accepted:
        return None
    return code, out.getvalue(), err.getvalue()


@pytest.mark.parametrize("command", [*(name for name in OPTIONS if name not in COSTLY), *slow(*COSTLY)])
def test_arguments(command, fuzzed):
    refused = []

    def run(arguments):
        said = outcome([command, *arguments])
        if said is None:
            return
        code, out, err = said
        assert "Traceback" not in err
        if code == 0:
            assert {"--help", "-h"} & set(arguments)
            assert "usage:" in out
            return
        assert code == cli.EXIT_ERROR
        lines = [line for line in err.splitlines() if not line.startswith("No screen here")]
        assert len(lines) == 1, err
        assert lines[0].startswith(f"kinreach {command}: error: ")
        assert len(lines[0]) < 12_000
        assert out == ""
        refused.append(arguments)

    word = st.sampled_from(WORDS) | st.text(max_size=6) | st.integers(-3, 10**20).map(str)
    option = st.sampled_from(OPTIONS[command])
    pairs = st.lists(st.tuples(option, word) | st.tuples(option) | st.tuples(word), max_size=4)
    tally = fuzzed(pairs.map(lambda parts: [text for part in parts for text in part]), run, share=1.5, both=False)
    assert len(refused) > tally.cases / 4


@pytest.mark.parametrize(
    "argv",
    [
        ["compare", "--out", "/dev/full", "--goals", "1"],
        ["train", "ranked-single", "--out", "/proc/nowhere", "--steps", "1"],
        ["evaluate", "/dev/zero"],
        ["demo", "--video", "/proc/x.gif", "--steps", "1"],
        ["bench"],
    ],
)
@pytest.mark.slow
def test_processes(argv, tmp_path, root):
    """The same from outside, where a crash of the interpreter would show."""
    done = subprocess.run(
        [sys.executable, "-m", "kinreach", *argv], capture_output=True, text=True, timeout=600, cwd=tmp_path,
        check=False, env={**os.environ, "PYTHONPATH": str(root)},
    )  # fmt: skip
    assert done.returncode == cli.EXIT_ERROR
    lines = [line for line in done.stderr.splitlines() if not line.startswith("No screen here")]
    assert len(lines) == 1, done.stderr
    assert "error: " in lines[0]
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []
