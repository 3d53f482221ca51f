"""The tables of robot files that work, on files written for the purpose."""

from __future__ import annotations

import json

import pytest

from benchmarks import robot_files
from tests.robots.peoples_files import RIGHT, arm, joint

#: Six axes in MJCF, the same geometry as that of `arm`.
ROD = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'


def chain() -> str:
    return (
        "".join(
            f'<body name="b{i}" pos="0 {0.1 * i} 0.1"><joint name="q{i}" axis="{i % 2} 1 0" range="-90 90"/>{ROD}'
            for i in range(5)
        )
        + "</body>" * 5
    )


@pytest.fixture
def folder(tmp_path):
    hand = "".join(f'<link name="f{i}"/>' + joint(f"d{i}", "l6", f"f{i}") for i in range(2))
    longer = {3: {"origin": f'<origin xyz="0.5 0 0" rpy="{RIGHT} 0 0"/>'}}
    files = {
        "maker/abb_robots/urdf/irb1.urdf": arm(),
        "maker/abb_robots/urdf/again.urdf": arm(),
        "maker/abb_robots/urdf/irb1_longer.urdf": arm(joints=longer),
        "maker/abb_robots/urdf/irb1_renamed.urdf": arm(head='<robot name="another">'),
        "maker/abb_robots/package.xml": "<package><name>abb_robots</name></package>",
        "someone/models/kuka.xml": f"<mujoco><worldbody>{chain()}</worldbody></mujoco>",
        "someone/models/hands.urdf": arm(more=hand),
        "someone/models/broken.urdf": '<robot name="a"><joint',
        "someone/models/rail.urdf": arm(joints={1: {"inside": ""}}),
    }  # fmt: skip
    for name, text in files.items():
        file = tmp_path / "clones" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    return tmp_path


def test_files_are_tried_once_and_told_apart(folder, capsys):
    names = {name: str(folder / f"{name}.txt") for name in ("list", "page", "guide", "rows")}
    (folder / "guide.txt").write_text("# Arms\n<!-- kinds -->\nold\n<!-- end -->\nmore\n")
    flags = [word for name, file in names.items() for word in (f"--{name}", file)]
    assert robot_files.main([str(folder / "clones"), *flags]) == 0
    rows = [json.loads(line) for line in (folder / "rows.txt").read_text().splitlines()]
    by_path = {row["path"]: row for row in rows}
    assert set(by_path) == {
        "urdf/irb1_longer.urdf", "urdf/irb1_renamed.urdf", "urdf/again.urdf", "kuka.xml", "hands.urdf", "broken.urdf",
        "rail.urdf",
    }  # fmt: skip
    taken = [row for row in rows if "kind" in row]
    assert len(taken) == 4
    assert all(row["off"] < robot_files.AGREES for row in taken)
    six = [row for row in taken if row["axes"] == 6]
    assert [row["found"] for row in six] == [robot_files.SOLVED] * 3
    assert len(robot_files.distinct(six)) == 2
    assert {row["maker"] for row in six} == {"ABB"}
    assert by_path["kuka.xml"]["kind"] == "five axes"
    assert by_path["kuka.xml"]["maker"] == "KUKA"
    reasons = {path: robot_files.reason_of(row["refused"]) for path, row in by_path.items() if "refused" in row}
    assert reasons["broken.urdf"][0].startswith("broken")
    assert reasons["hands.urdf"][0].startswith("several equal branches")
    assert reasons["rail.urdf"] == ("joints without limits or range", True)
    page = capsys.readouterr().out
    assert page.rstrip() == (folder / "page.txt").read_text().rstrip()
    guide = (folder / "guide.txt").read_text()
    assert guide.startswith("# Arms\n<!-- kinds -->\n")
    assert guide.endswith("<!-- end -->\nmore\n")
    assert guide[7:-6] in page
    assert "| KUKA | 1 | 1 |" not in guide
    assert "7 distinct files of 2 public repositories" in page
    assert "| KUKA | 1 | 1 |" in page


def test_a_list_chooses(folder, capsys):
    chosen = folder / "chosen.txt"
    chosen.write_text("someone/models kuka.xml\nnobody/none a.urdf\n")
    assert robot_files.main([str(folder / "clones"), "--only", str(chosen)]) == 0
    assert "1 distinct files of 1 public repositories" in capsys.readouterr().out
