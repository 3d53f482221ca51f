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


@pytest.mark.parametrize("there", [True, False])
def test_what_the_readme_installs_is_not_installed_again(there, root, tmp_path):
    if shutil.which("make") is None:
        pytest.skip("make is not installed")
    venv, log = tmp_path / "venv", tmp_path / "log"
    (venv / "bin").mkdir(parents=True)
    asked = 'case "$*" in *metadata*) exit {status} ;; esac\n'
    (venv / "bin" / "python").write_text(PYTHON.format(log=log, status=0) + asked.format(status=0 if there else 1))
    (venv / "bin" / "python").chmod(0o755)
    env = {"PATH": os.environ["PATH"]}
    for target, extra, names in (("compare", "placo", "kinreach placo"), ("view", "view", "kinreach viser")):
        done = subprocess.run(
            ["make", target, f"VENV={venv}"], cwd=root, env=env, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        ran = log.read_text()
        assert f'"{names}"' in ran
        assert (f"-e .[{extra}]" in ran) != there


def test_how_the_tests_are_run(root, tmp_path):
    """What Python compiled is kept: a hundred tests start interpreters, and each would compile the package again."""
    if shutil.which("make") is None:
        pytest.skip("make is not installed")
    venv, log = tmp_path / "venv", tmp_path / "log"
    (venv / "bin").mkdir(parents=True)
    python = venv / "bin" / "python"
    python.write_text(f'#!/bin/sh\necho "$@, ${{PYTHONDONTWRITEBYTECODE-kept}}" >> {log}\n')
    python.chmod(0o755)
    for name in ("core", "view", "dev"):
        (venv / f".installed-{name}").touch()
    command = ["make", "test", "test-all", f"VENV={venv}"]
    env = {"PATH": os.environ["PATH"], "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(command, cwd=root, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    ran = log.read_text().splitlines()
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    workers = f"-n {min(cores + 1, 8)} --dist worksteal"
    assert ran == [f"-m pytest -m not slow {workers}, kept", f"-m pytest {workers}, kept"]


def test_there_is_one_description_of_the_install(root):
    """README has its commands; the other pages link to it."""
    texts = {name: (root / name).read_text() for name in ("README.md", "docs/start.md")}
    commands = {re.search(r"^python3.11 -m venv .*?^```", text, re.DOTALL | re.MULTILINE)[0] for text in texts.values()}
    (only,) = commands
    assert "-e '.[placo,view]'\n" in only
    others = [path for path in (root / "CONTRIBUTING.md", *root.glob("docs/**/*.md")) if path.name != "start.md"]
    assert [
        path.name for path in others if re.search(r"install .*-e \.( |$)|-m venv", path.read_text(), re.MULTILINE)
    ] == []
    for name in ("README.md", "CONTRIBUTING.md", "docs/reference/install.md"):
        assert "start.md#install)" in (root / name).read_text()
