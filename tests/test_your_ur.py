"""The owner of a UR, from the shell alone: published calibrations, or none, and three tools, in every command."""

import csv
import re

import pytest
import trimesh

from kinreach.cli import EXIT_INTERRUPTED, main
from kinreach.robots import PUBLISHED_CALIBRATIONS

TOOLS = {
    "plain": ["--tool", "0,0,0.15,0,0,0"],
    "turned tube": ["--tool", "0.02,0,0.12,0,0.4,0", "--tool-radius", "0.03", "--tool-mass", "1.1"],
    "mesh": ["--tool", "0,0,0.16,0,0,1.57", "--tool-mesh", "tool.stl", "--tool-mesh-scale", "0.001"],
}


#: Each tool on a calibrated arm of either generation, and on one by its data sheet.
MINE = [
    *(("ur10", tool) for tool in TOOLS), ("ur5e_a", "plain"), ("ur3e_a", "turned tube"), ("ur10e_a", "mesh"),
    ("ur3_a", "mesh"), ("ur5_a", "turned tube"),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("name", "tool"), MINE)
def test_every_command_takes_my_arm(name, tool, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    trimesh.creation.box((60.0, 60.0, 160.0)).apply_translation([0, 0, 80.0]).export("tool.stl")
    model, calibrated = name.partition("_")[0], name in PUBLISHED_CALIBRATIONS
    mine = [*(["--calibration", str(PUBLISHED_CALIBRATIONS[name])] if calibrated else []), *TOOLS[tool]]
    arm = ["--arm", model, *mine]

    assert main(["ik", *arm, "--pose", "-0.2,0.15,0.25,3.14,0,0"]) == 0
    assert len(re.findall(r"^[* ] +\d ", capsys.readouterr().out, re.MULTILINE)) >= 2

    (tmp_path / "in.csv").write_text("x,y,z,rx,ry,rz\n-0.2,0.15,0.25,3.14,0,0\n9,0,0,0,0,0\n")
    assert main(["ik", *arm, "--poses", "in.csv", "--out", "out.csv"]) == 0
    with open("out.csv", encoding="utf-8") as table:
        first, second = csv.DictReader(table)
    assert first["q6"]
    assert not second["q6"]
    assert second["reason"]

    assert main(["check", model, *mine, "--poses", "3"]) == 0
    found = capsys.readouterr().out
    assert ("UR with its calibration" in found) == calibrated
    assert bool(re.search(r"data sheet puts the tip [\d.]+ mm off", found)) == calibrated
    assert "pairs of links are checked" in found

    assert main(["compare", *arm, "--goals", "3", "--methods", "closed-form", "--out", "results"]) == 0
    assert "closed-form" in capsys.readouterr().out
    again = re.search(r"--arm .*?--goals", (tmp_path / "results/results.json").read_text())[0]
    assert all(word in again for word in mine)

    seen = []

    def stop(setup, *, port):
        seen.append(setup)
        raise KeyboardInterrupt

    monkeypatch.setattr("kinreach.view._cli.Server", stop)
    assert main(["view", *arm]) == EXIT_INTERRUPTED
    assert seen[0].arm.default_tip == "tool"
    assert (seen[0].nominal is not None) == calibrated
