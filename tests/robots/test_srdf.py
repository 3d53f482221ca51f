"""MoveIt's SRDF beside a URDF: which links may touch."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from kinreach import cli
from kinreach.errors import InputError
from kinreach.kinematics import CollisionChecker
from kinreach.robots import ArmDescription
from kinreach.robots.inside import neighbours
from tests.robots.peoples_files import arm, shape

#: Boxes so large that links beside their neighbours overlap as well, in most postures.
FAT = {i: shape('<box size="0.29 0.29 0.29"/>', "collision") for i in range(7)}
LINKS = [f"l{i}" for i in range(7)]


def srdf(pairs, more: str = "") -> str:
    text = "".join(f'<disable_collisions link1="{a}" link2="{b}" reason="Adjacent"/>' for a, b in pairs)
    group = '<group name="arm"><chain base_link="l0" tip_link="l6"/></group>'
    return f'<?xml version="1.0"?><robot name="a">{group}{text}{more}</robot>'


@pytest.fixture
def file(tmp_path) -> Path:
    (tmp_path / "a.urdf").write_text(arm(links=FAT))
    return tmp_path / "a.urdf"


def write(file: Path, text: str) -> str:
    (file.parent / "a.srdf").write_text(text)
    return str(file.parent / "a.srdf")


def test_pairs_of_an_srdf_are_not_checked(file):
    """For many drawn sets of pairs: neighbours and those are left out, and nothing else."""
    plain, rng = ArmDescription.from_urdf(file), np.random.default_rng(0)
    near, every, tried = set(neighbours(plain.robot)), list(combinations(LINKS, 2)), 0
    for _ in range(20):
        chosen = [every[i] for i in rng.permutation(len(every))[: rng.integers(1, 15)]]
        described = plain.with_srdf(write(file, srdf([pair[:: rng.choice([1, -1])] for pair in chosen])))
        checked = set(CollisionChecker(described).pairs)
        assert checked == {pair for pair in every if pair not in near and pair not in chosen}
        assert described.notes == plain.notes
        tried += len(checked)
    assert tried > 100


@pytest.mark.slow
def test_an_arm_whose_links_overlap_is_free_with_it(file, capsys):
    plain = ArmDescription.from_urdf(file)
    pairs = [pair for pair in combinations(LINKS, 2) if int(pair[1][1]) - int(pair[0][1]) <= 3]
    described = plain.with_srdf(write(file, srdf(pairs)))
    Q = np.random.default_rng(1).uniform(-3, 3, (200, 6))
    before, after = (np.mean(list(map(CollisionChecker(each).in_collision, Q))) for each in (plain, described))
    assert before > 0.8 > 0.5 > after
    for words in ([], ["--srdf", str(file.parent / "a.srdf")]):
        assert cli.main(["check", str(file), "--poses", "2", *words]) == 0
        (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("collisions")]
        share = int(line.split(";")[1].split(" % ")[0])
        assert share > 80 if not words else share < 50


def test_a_tool_and_a_gripper_after_it(file):
    described = ArmDescription.from_urdf(file).with_srdf(write(file, srdf([("l0", "l2")])))
    tooled = described.with_tool([0, 0, 0.2, 0, 0, 0])
    assert tooled.disabled_collisions is not None
    assert ("l0", "l2") in tooled.disabled_collisions


def test_links_that_may_touch_every_other(file):
    more = '<disable_default_collisions link="l6"/><enable_collisions link1="l6" link2="l0"/>'
    described = ArmDescription.from_urdf(file).with_srdf(write(file, srdf([], more)))
    assert {pair for pair in CollisionChecker(described).pairs if "l6" in pair} == {("l0", "l6")}


def test_unknown_links_are_named(file, capsys):
    path = write(file, srdf([("l0", "l2"), ("l2", "hand"), ("finger", "l2")]))
    described = ArmDescription.from_urdf(file).with_srdf(path)
    assert ("l0", "l2") not in CollisionChecker(described).pairs
    (note,) = described.notes
    assert "names links that the arm does not have: hand, finger" in note
    assert cli.main(["ik", "--arm", str(file), "--srdf", path, "--pose", "0.4,0.1,0.3,0,0,0"]) in (0, 1)
    assert "hand, finger" in capsys.readouterr().err


@pytest.mark.parametrize(
    "more",
    [
        '<disable_collisions link1="l0"/>',
        '<disable_collisions link2="l0"/>',
        "<disable_default_collisions/>",
        '<enable_collisions link1="l3"/>',
        '<enable_collisions link2="l3"/>',
    ],
)
def test_an_element_that_lacks_a_link_changes_nothing(file, more):
    plain = ArmDescription.from_urdf(file)
    described, known = (plain.with_srdf(write(file, srdf([("l0", "l2")], each))) for each in (more, ""))
    assert CollisionChecker(described).pairs == CollisionChecker(known).pairs
    (note,) = described.notes
    assert "names a link that the arm does not have" in note


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (srdf([("hand", "finger")]), "names no two links of this arm"),
        (srdf([]), "an SRDF names with <disable_collisions>"),
        (arm(), "is a URDF"),
        ("<mujoco/>", "must begin with <robot>"),
        ("", "not XML"),
        (srdf([("${prefix}l0", "${prefix}l2")]), "is xacro"),
        (srdf([], "<xacro:arm/>"), "is xacro"),
    ],
)
def test_what_is_no_srdf_of_the_arm(file, capsys, text, said):
    path = write(file, text)
    with pytest.raises(InputError, match=said):
        ArmDescription.from_urdf(file).with_srdf(path)
    assert cli.main(["check", str(file), "--srdf", path]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    with pytest.raises(InputError):
        ArmDescription.from_urdf(file).with_srdf(file.parent)
