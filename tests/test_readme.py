"""What the README shows works as it stands there."""

import json
import re
from pathlib import Path

import pytest

from kinreach.compare import get_task
from kinreach.compare.cli import main as compare

README = Path(__file__).parents[1] / "README.md"


def test_the_python_code_runs(capsys):
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL)
    names: dict[str, object] = {}
    for block in blocks:
        exec(block, names)  # one session, as a reader would type it
    assert len(blocks) >= 1
    assert names["reward"] == 20
    assert names["info"]["reached"]
    assert "True" in capsys.readouterr().out


def test_the_files_and_pictures_are_there():
    targets = re.findall(r"\]\(([^)#h][^)]*)\)", README.read_text())
    assert len(targets) >= 6
    files = [target.partition("#")[0] for target in targets]
    assert [file for file in files if not (README.parent / file).exists()] == []


def test_the_comparison_commands_run(tmp_path, capsys):
    commands = re.findall(r"python -m kinreach\.compare ([^`\n]+)", README.read_text())
    assert len(commands) >= 1
    for command in commands:
        arguments = re.sub(r"--goals \d+", "--goals 1", command).split()
        assert compare([*arguments, "--methods", "closed-form", "--out", str(tmp_path)], prog="compare") == 0
    assert "closed-form" in capsys.readouterr().out


def test_the_methods_of_the_table_exist():
    rows = re.findall(r"^\| ([a-z-]+) \| [\d.]+ \[", README.read_text(), re.MULTILINE)
    assert len(rows) >= 10
    assert set(rows) <= set(get_task("ur5").methods)


def shown_number(text):
    """A number and what its last digit is worth, which it may be off by on another processor."""
    return float(text), 1.01 * 10.0 ** -len(text.partition(".")[2])


@pytest.mark.slow
def test_the_table_is_what_its_command_measures(tmp_path):
    """All of it but the times to solve, and the intervals, which follow from the shares."""
    text = README.read_text()
    command = re.search(r"Again: `python -m kinreach\.compare ([^`]+)`", text).group(1)
    assert compare([*command.split(), "--out", str(tmp_path)], prog="compare") == 0
    found = json.loads((tmp_path / "results.json").read_text())
    rows = [line.strip("| \n").split(" | ") for line in text.splitlines() if re.match(r"\| [a-z-]+ \| [\d.]+ \[", line)]
    checked = 0
    measured = {method["name"]: method for method in found["methods"]}
    for row in rows:
        name, reached, distance, near, impossible, reward, _, move = row
        method = measured[name]
        pairs = [
            (reached.split(" ")[0], 100 * method["reached"]),
            *zip(distance.split(" / "), (method["distance_mm"][name] for name in ("median", "p95")), strict=True),
            (near, 100 * method["success_at_mm"]["1"]),
            (impossible, 100 * method["impossible"]),
            (reward, method["reward_mean"]),
            (move, method["move_s"]["median"]),
        ]
        for said, value in pairs:
            number, unit = shown_number(said)
            assert value == pytest.approx(number, abs=unit), (name, said)
            checked += 1
    assert checked == 7 * len(rows) >= 70
