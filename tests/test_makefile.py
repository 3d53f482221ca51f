"""What `make` installs, asked of a Python that only notes it down."""

import os
import re
import shutil
import subprocess

import pytest

PYTHON = """#!/bin/sh
echo "$@" >> {log}
case "$*" in *--index-url*) exit {status} ;; esac
"""


@pytest.mark.parametrize("status", [0, 1])
@pytest.mark.parametrize(("options", "build"), [([], "cpu"), (["TORCH=cu130"], "cu130")])
def test_torch_comes_first_and_is_the_cpu_build_unless_another_is_named(options, build, status, root, tmp_path):
    if shutil.which("make") is None:
        pytest.skip("make is not installed")
    venv, log = tmp_path / "venv", tmp_path / "log"
    (venv / "bin").mkdir(parents=True)
    (venv / "bin" / "python").write_text(PYTHON.format(log=log, status=status))
    (venv / "bin" / "python").chmod(0o755)
    command = ["make", "setup", f"VENV={venv}", *options]
    env = {"PATH": os.environ["PATH"]}  # and not the options of the `make` that runs the tests
    done = subprocess.run(command, cwd=root, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    torch, rest = log.read_text().splitlines()
    (version,) = re.findall(r"^torch==.*$", (root / "constraints.txt").read_text(), re.MULTILINE)
    assert torch.endswith(f"--index-url https://download.pytorch.org/whl/{build} {version}")
    assert rest.endswith("-c constraints.txt -e .[dev]")
    assert ("pip takes the build that it finds" in done.stderr) == (status == 1)
