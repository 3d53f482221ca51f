"""`python -m benchmarks.paths`: problems are what they say, a path that collides is counted, the page is written."""

import io
import json
import re
import tarfile
from itertools import islice

import numpy as np
import pytest

pytest.importorskip("ompl")

from benchmarks.paths import cli, planners, problems
from kinreach.cli import run
from kinreach.kinematics import CollisionChecker
from kinreach.robots import get_arm


def call(*argv):
    return run("benchmarks.paths.cli", argv, prog="python -m benchmarks.paths")


@pytest.mark.parametrize("kind", problems.KINDS)
def test_generated_problems_are_free_at_both_ends_and_the_same_again(kind):
    kin = problems.ur5e()
    once, again = (list(islice(problems.generated(kind), 3)) for _ in range(2))
    for problem, same in zip(once, again, strict=True):
        assert problem.obstacles == same.obstacles
        assert (problem.goal == same.goal).all()
        checker = CollisionChecker(kin, obstacles=problem.obstacles, margin=problems.MARGIN)
        assert checker.free(problem.start)
        assert checker.free(problem.goal)
    assert not np.allclose(once[0].goal, once[1].goal)


def test_problems_of_moveit_are_converted(tmp_path, monkeypatch):
    """A box in an object that is turned and shifted, and a cylinder, whose height comes first."""
    joints = get_arm("ur5e").joints
    turned = {"position": [1.0, 0.0, 0.0], "orientation": [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]}
    inside = {"position": [0.5, 0.0, 0.0], "orientation": [0.0, 0.0, 0.0, 1.0]}
    scene = {"world": {"collision_objects": [
        {"id": "box", "pose": turned, "primitives": [{"type": "box", "dimensions": [1, 2, 3]}],
         "primitive_poses": [inside]},
        {"id": "can", "primitives": [{"type": "cylinder", "dimensions": [0.2, 0.05]}], "primitive_poses": [inside]},
    ]}}  # fmt: skip
    request = {
        "start_state": {"joint_state": {"name": list(joints[::-1]), "position": [0.6, 0.5, 0.4, 0.3, 0.2, 0.1]}},
        "goal_constraints": [
            {"joint_constraints": [{"joint_name": name, "position": float(i)} for i, name in enumerate(joints)]}
        ],
    }
    with tarfile.open(tmp_path / "problems.tar.bz2", "w:bz2") as archive:
        for name, content in (("scene0007.yaml", scene), ("request0007.yaml", request)):
            text = json.dumps(content).encode()
            entry = tarfile.TarInfo(f"problems/cage_ur5/{name}")
            entry.size = len(text)
            archive.addfile(entry, io.BytesIO(text))
    monkeypatch.setattr(problems, "vamp_ur5", lambda folder: problems.ur5e())
    (problem,) = problems.vamp(tmp_path)
    assert (problem.kind, problem.index) == ("cage", 7)
    np.testing.assert_allclose(problem.start, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    np.testing.assert_allclose(problem.goal, range(6))
    box, can = problem.obstacles
    assert (box.shape, can.shape) == ((1.0, 2.0, 3.0), (0.05, 0.2))
    np.testing.assert_allclose(box.pose, [1.0, 0.5, 0.0, 0.0, 0.0, np.pi / 2], atol=1e-12)


def test_a_planner_that_collides_is_found_out_and_results_are_kept(tmp_path, monkeypatch):
    def straight(checker, start, goals, seconds):
        return np.array([start, goals.q[0]])

    monkeypatch.setattr(cli, "PLANNERS", {
        "kinreach": planners.kinreach, "kinreach, each alone": planners.each_alone, "straight": straight,
    })  # fmt: skip
    monkeypatch.setattr(planners, "PLANNERS", cli.PLANNERS)
    monkeypatch.setattr(planners, "ALONE", 30.0)  # on the clock: a busy machine finds what an idle one does
    monkeypatch.setattr(cli, "RIVALS_PATIENCE", 60.0)
    assert not call("--problems", "3", "--out", str(tmp_path))
    page = (tmp_path / "paths.md").read_text(encoding="utf-8")
    rows = [json.loads(line) for line in (tmp_path / "rows.jsonl").read_text(encoding="utf-8").splitlines()]
    assert len(rows) == 27
    assert sum(row["collisions"] > 0 for row in rows if row["planner"] == "straight") > 3
    assert not any(row.get("collisions") for row in rows if row["planner"] == "kinreach")
    assert "0 of its paths collide" in page
    assert re.search(
        r"On 9 problems the largest way of a joint is at most (0\.\d\d|1\.[01]\d) times the least of", page
    )
    assert (tmp_path / "paths.png").stat().st_size > 10_000
    assert not call("--problems", "3", "--out", str(tmp_path))
    assert len((tmp_path / "rows.jsonl").read_text(encoding="utf-8").splitlines()) == 27


def test_bad_input_is_one_line(tmp_path, capsys):
    assert call("--problems", "0", "--out", str(tmp_path)) == 2
    assert capsys.readouterr().err.count("\n") == 1
