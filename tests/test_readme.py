"""What the README shows works as it stands there."""

import re
from pathlib import Path

from kinreach.compare.cli import main as compare
from kinreach.compare.methods import METHODS

README = Path(__file__).parents[1] / "README.md"


def test_the_python_code_runs(capsys):
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL)
    names: dict[str, object] = {}
    for block in blocks:
        exec(block, names)  # one session, as a reader would type it
    assert len(blocks) == 5
    assert names["reward"] == 20
    assert names["move"].reached
    assert names["placo"].success
    assert "REACHED" in capsys.readouterr().out


def test_the_files_and_pictures_are_there():
    targets = re.findall(r"\]\(([^)#h][^)]*)\)", README.read_text())
    assert len(targets) >= 6
    assert [target for target in targets if not (README.parent / target).exists()] == []


def test_the_comparison_commands_parse(tmp_path, capsys):
    commands = re.findall(r"python -m kinreach\.compare ([^`\n]+)", README.read_text())
    assert len(commands) >= 1
    for command in commands:
        arguments = re.sub(r"--goals \d+", "--goals 1", command).split()
        assert compare([*arguments, "--methods", "closed-form", "--out", str(tmp_path)], prog="compare") == 0
    assert "closed-form" in capsys.readouterr().out


def test_the_table_has_every_method():
    rows = re.findall(r"^\| ([a-z-]+) \| [\d.]+ \[", README.read_text(), re.MULTILINE)
    assert rows == list(METHODS["ur5"])
