"""What `kinreach check` measures, against what is known of the arms, and what it prints."""

from __future__ import annotations

import itertools
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinreach.cli import EXIT_ERROR, main
from kinreach.errors import InputError, InstallationError, NoShapesError
from kinreach.kinematics import Arm3Kinematics, ArmKinematics, URKinematics, check
from kinreach.robots import PUBLISHED_CALIBRATIONS, ArmDescription, get_arm
from kinreach.robots.inside import without_shapes
from kinreach.view import TargetModel
from tests import kept
from tests.robots.peoples_files import arm as peoples_arm

ROOT = Path(__file__).parents[2]
CALIBRATIONS = ROOT / "tests/data/calibrations"


def test_singular_postures_of_a_ur_are_those_in_the_books():
    kin = URKinematics("ur16e")
    g = kin.geometry
    found = check.singular_postures(kin, 1.0)
    kinds = {"elbow": 0, "wrist": 0, "shoulder": 0}
    for q in found.q:
        assert np.linalg.svd(kin.jacobian(q), compute_uv=False)[-1] < 1e-6
        centre = kin.fk(q)[:3, 3] - g.d6 * kin.fk(q)[:3, 2]
        radius = np.hypot(centre[0], centre[1])
        kind = {"elbow": abs(np.sin(q[2])), "wrist": abs(np.sin(q[4])), "shoulder": abs(radius - g.d4)}
        kinds[min(kind, key=kind.__getitem__)] += 1
        assert min(kind.values()) < 1e-5
    assert min(kinds.values()) > 3
    assert 0.0 in found.recurring(2)
    assert 0.0 in found.recurring(4)
    assert found.recurring(0) == found.recurring(5) == []  # the first and the last joint never matter


def test_a_joint_whose_range_lies_beyond_a_turn():
    kin = ArmKinematics(get_arm("ur5").with_limits({"wrist_2_joint": (3.5, 6.0)}))
    found = check.singular_postures(kin, 1.0)
    assert len(found.q) > 12
    assert ((found.q >= kin.lower - 1e-9) & (found.q <= kin.upper + 1e-9)).all()


def test_an_arm_that_its_limits_keep_from_singular_postures():
    ur5 = get_arm("ur5")
    ranges = dict(zip(ur5.joints[1:5], [(-1.6, -1.4), (1.4, 1.6), (-1.7, -1.4), (-1.7, -1.4)], strict=True))
    found = check.singular_postures(ArmKinematics(ur5.with_limits(ranges)), 1.0)
    assert (found.q.shape, found.start.shape, found.start.dtype) == ((0, 6), (0,), np.int64)
    assert found.recurring(2) == []


def test_singular_postures_of_an_arm_with_a_joint_to_spare():
    kin = ArmKinematics("panda")
    found = check.singular_postures(kin, 1.0)
    assert len(found.q) >= 6
    for q in found.q:
        assert kin.within_limits(q)
        assert np.linalg.svd(kin.jacobian(q), compute_uv=False)[5] < 2e-4


def test_deviation_by_another_librarys_rotations():
    real, believed = URKinematics("ur5e"), URKinematics("ur10e")
    found = check.deviation(real, believed, seed=3)
    q = check.random_postures(real, check.POSTURES, 3)
    for i in range(0, check.POSTURES, 40):
        T, expected = real.fk(q[i]), believed.fk(q[i])
        assert found.position[i] == pytest.approx(np.linalg.norm(T[:3, 3] - expected[:3, 3]), abs=1e-12)
        turned = Rotation.from_matrix(expected[:3, :3].T @ T[:3, :3]).magnitude()
        assert found.orientation[i] == pytest.approx(turned, abs=1e-9)
    same = check.deviation(real, URKinematics("ur7e"))
    assert same.position.max() == same.orientation.max() == 0.0


def test_reach_of_a_stretched_arm():
    g = URKinematics("ur5e").geometry
    most = np.hypot(g.stretched + g.d5, g.d4 + g.d6)
    reach = check.reach_of(URKinematics("ur5e"))
    assert 0.9 * most < reach.farthest <= most + g.d6
    assert reach.usual < reach.farthest
    assert reach.lowest < -0.7 < 0.7 < reach.highest
    assert check.collisions_of(URKinematics("ur5e")).home_free
    assert check.collisions_of(URKinematics("ur5")).home_free


def arm_with_a_broken_mesh(tmp_path):
    """A URDF whose mesh is there and is none."""
    (tmp_path / "link.stl").write_bytes(b"no mesh")
    file = tmp_path / "broken.urdf"
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
    file.write_text(
        '<robot name="broken"><link name="base"/><link name="one"><collision><geometry><mesh filename="link.stl"/>'
        '</geometry></collision></link><link name="two"/><link name="end"/>'
        f'<joint name="a" type="revolute"><parent link="base"/><child link="one"/><axis xyz="0 0 1"/>{limit}</joint>'
        '<joint name="b" type="revolute"><parent link="one"/><child link="two"/><origin xyz="0.3 0 0"/>'
        f'<axis xyz="0 1 0"/>{limit}</joint>'
        '<joint name="c" type="fixed"><parent link="two"/><child link="end"/><origin xyz="0.3 0 0"/></joint></robot>'
    )
    return file


def test_shapes_that_cannot_be_read_are_not_taken_for_none(tmp_path, capsys):
    file = arm_with_a_broken_mesh(tmp_path)
    with pytest.raises(InputError, match="has no triangles"):
        check.collisions_of(ArmKinematics.from_urdf(file))
    with pytest.raises(InputError, match="has no triangles"):
        TargetModel(ArmDescription.from_urdf(file))
    assert main(["check", str(file), "--poses", "2"]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("collisions")]
    assert line.startswith("collisions   not known: the mesh 'package://link.stl' has no triangles")
    bare = tmp_path / "bare.urdf"
    bare.write_bytes(ET.tostring(without_shapes(get_arm("ur5e").robot, "visual", "collision")))
    assert main(["check", str(bare), "--poses", "2"]) == 0
    assert "collisions   not known: the arm has no shapes\n" in capsys.readouterr().out


@pytest.mark.parametrize("kin", [URKinematics("ur20"), Arm3Kinematics()])
def test_solvers_are_judged_by_forward_kinematics(kin):
    class Liar:
        name = "liar"

        def solve(self, goal, seed, *, accept=None):
            return check.ClosedFormSolver(kin).solve(goal, seed)

    postures = check.random_postures(kin, 30, 0)
    exact = check.solved(kin, check.solvers_of(kin)[0], postures, postures[:5])
    assert (exact.name, exact.success, exact.singular) == ("closed-form", 1.0, 1.0)
    assert exact.error < 1e-9
    assert 0 < exact.time[0] <= exact.time[1]
    assert check.solved(kin, Liar(), postures, postures[:0]).success == 1.0
    kin.upper = kin.upper - 10.0  # all of its postures are outside of these
    assert check.solved(kin, Liar(), postures, postures[:0]).success == 0.0


@pytest.mark.usefixtures("needs_placo")
def test_one_screen(tmp_path, capsys):
    file = f"{get_arm('ur5').package_root()}/example-robot-data/robots/xarm_description/urdf/xarm7.urdf"
    said = {"ur5": "UR: every", "arm3": "turning base", file: "as curves, by Newton's method from a closed form"}
    printed = {}
    for arm, kind in said.items():
        picture = tmp_path / "workspace.png"
        assert main(["check", arm, "--poses", "10", "--picture", str(picture)]) == 0
        text = capsys.readouterr().out
        assert kind in text
        for head in ("class", "joints", "reach", "collisions", "singular", "IK", "picture"):
            assert f"\n{head:<12} " in text
        assert "100.0 %" in text
        assert "reached: within 0.1 mm and 0.001 rad; placo, lm and qp stop there" in text
        assert "m from the origin of " in text
        assert "\n             solver        reached  singular   time, ms: median / p95   largest error, mm\n" in text
        assert len(text.splitlines()) < 25
        assert picture.read_bytes().startswith(b"\x89PNG")
        printed |= lines(Path(arm).stem, text)
    kept.check("checks.txt", {"printed": printed})


def lines(arm, text):
    """What is printed for an arm, to keep; without folders, and without what a solver or a search finds."""
    found = {}
    for number, line in enumerate(text.splitlines()):
        shown = re.sub(r"\S*/", "", line)
        if "%   " in line:
            shown = re.sub(r"\d+\.\d+(e[-+]\d+)?", "#", shown)
        elif line.startswith("singular"):
            shown = re.sub(r"-?\d+(\.\d+)?(?![\w_])", "#", shown.partition(";")[0])
        shown = re.sub(r"\d+ singular ones", "# singular ones", shown)
        found[f"{arm} {number}"] = {"line": re.sub(" +", " ", shown)}
    return found


def test_names_are_drawn_as_they_are(tmp_path, capsys):
    """A dollar sign in a name begins no formula."""
    file = arm_with_a_broken_mesh(tmp_path)
    file.write_text(file.read_text().replace('"broken"', r'"a $\frac{$"').replace('"end"', r'"b $\frac{$"'))
    picture = tmp_path / "workspace.png"
    assert main(["check", str(file), "--poses", "1", "--picture", str(picture)]) == 0
    assert r"a $\frac{$" in capsys.readouterr().out
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.usefixtures("needs_placo")
def test_what_a_calibration_changes(tmp_path, capsys):
    picture = tmp_path / "error.png"
    file = PUBLISHED_CALIBRATIONS["ur5_a"]
    assert main(["check", "ur5", "--calibration", str(file), "--poses", "10", "--picture", str(picture)]) == 0
    text = capsys.readouterr().out
    kept.check("checks_calibrated.txt", {"printed": lines("ur5", text)})
    assert "UR with its calibration" in text
    median, late, most = map(
        float, re.search(r"([\d.]+) mm off in the median, p95 ([\d.]+), most ([\d.]+);", text).groups()
    )
    real, nominal = URKinematics.from_calibration(file, model="ur5"), URKinematics("ur5")
    q = np.random.default_rng(5).uniform(-np.pi, np.pi, (4000, 6))
    off = 1e3 * np.linalg.norm(real.positions(q) - nominal.positions(q), axis=1)
    np.testing.assert_allclose((median, late), np.quantile(off, (0.5, 0.95)), rtol=0.05)
    assert most == pytest.approx(off.max(), rel=0.1)
    assert re.search(r"closed-form +100\.0 % +100\.0 %", text)
    assert picture.stat().st_size > 10_000


def test_bad_input(capsys):
    for arguments, said in (
        (["nothing"], "unknown arm 'nothing'; available: arm3"),
        (["nowhere.urdf"], "cannot read"),
        (["ur5", "--tip", "nose"], "unknown tip 'nose'"),
        (["ur5", "--poses", "0"], "--poses must be at least 1"),
        (["ur5", "--calibration", "nowhere.yaml"], "cannot read"),
        (["ur10", "--calibration", str(PUBLISHED_CALIBRATIONS["ur5_a"])], "it fits ur5"),
        (["ur5e", "--calibration", str(CALIBRATIONS / "ur5e_folded.yaml")], "folded at"),
        (["kinematics.yaml"], "name its UR too"),
    ):
        assert main(["check", *arguments]) == EXIT_ERROR
        assert said in capsys.readouterr().err


def test_what_five_axes_leave_of_orientations():
    kin = ArmKinematics.of("so101")
    found = check.nearest_orientations(kin, check.random_postures(kin, 30, 0))
    assert found.left.shape == (30,)
    assert 0.3 < np.median(found.left) < 2.5
    assert 0.0 < found.down < 1.0
    assert found.time > 0.0


def test_what_five_axes_leave_is_printed(capsys):
    assert main(["check", "so101", "--poses", "15", "--seed", "3"]) == 0
    text = capsys.readouterr().out
    kin = ArmKinematics.of("so101")
    found = check.nearest_orientations(kin, check.random_postures(kin, 15, 4), seed=3)
    median, late = np.degrees(np.quantile(found.left, (0.5, 0.95)))
    count, shown, p95, time, down = map(float, re.search(
        r"\norientation  (\d+) points, each with a random orientation: (\d+)° are left in the median, p95 (\d+)°; "
        r"([\d.]+) ms\n +at (\d+) % of them the tip's z axis points straight down\n", text).groups())  # fmt: skip
    assert (count, shown, p95, down) == (15, round(median), round(late), round(100 * found.down))
    assert 0.0 < time < 1000.0
    assert late > 20


def test_joints_are_printed_with_their_units(tmp_path, capsys):
    """One that turns without end, one that slides, and others; in degrees, too, where they turn."""
    slides = '<limit lower="-0.25" upper="0.5" effort="1" velocity="0.125"/>'
    turns = '<limit lower="-1.5" upper="2" effort="1" velocity="1.25"/>'
    file = tmp_path / "a.urdf"
    file.write_text(peoples_arm(joints={
        1: {"kind": "continuous", "inside": ""}, 2: {"inside": turns}, 3: {"kind": "prismatic", "inside": slides},
    }))  # fmt: skip
    assert main(["check", str(file), "--poses", "1", "--tip", "l6"]) == 0
    text = capsys.readouterr().out.splitlines()
    begin = next(place for place, line in enumerate(text) if line.startswith("joints"))
    printed = [re.sub(" +", " ", line).strip() for line in text[begin : begin + 6]]
    assert printed[0].startswith("joints j1 turns without end, ")
    assert printed[0].endswith("rad/s, starts at +0.000")
    assert printed[1] == "j2 -1.500 to +2.000 rad (201°), 1.25 rad/s, starts at +0.250"
    assert printed[2] == "j3 -0.250 to +0.500 m, 0.12 m/s, starts at +0.125 m"
    assert printed[3] == "j4 -3.100 to +3.100 rad (355°), 1.00 rad/s, starts at +0.000"


def test_times_are_those_between_before_and_after(monkeypatch):
    """A clock that goes on by 0.25 s whenever it is asked."""
    clock = itertools.count(1000.0, 0.25)
    monkeypatch.setattr(check, "perf_counter", lambda: next(clock))
    kin = ArmKinematics.of("so101")
    assert check.nearest_orientations(kin, check.random_postures(kin, 3, 0)).time == 0.25
    kin = URKinematics("ur5e")
    closed_form = check.solvers_of(kin)[0]
    solved = check.solved(kin, closed_form, check.random_postures(kin, 3, 0), np.empty((0, 6)))
    assert solved.time == (0.25, 0.25)


def test_an_arm_whose_shapes_are_missing_is_not_one_without_shapes(tmp_path):
    bare = tmp_path / "bare.urdf"
    bare.write_bytes(ET.tostring(without_shapes(get_arm("ur5e").robot, "visual", "collision")))
    kin = ArmKinematics.from_urdf(bare)
    assert check.collisions_of(kin) is None
    kin.arm = replace(kin.arm, missing_shapes="a file of its shapes is not there")
    with pytest.raises(NoShapesError, match="a file of its shapes is not there"):
        check.collisions_of(kin)


def test_a_solver_that_is_not_installed_is_not_compared(monkeypatch):
    def missing(kin):
        raise InstallationError("placo is not installed")

    kin = URKinematics("ur5e")
    names = [solver.name for solver in check.solvers_of(kin)]
    assert names[0] == "closed-form"
    assert {"lm", "qp"} < {*names}
    monkeypatch.setattr(check, "QPSolver", missing)
    assert [solver.name for solver in check.solvers_of(kin)] == [name for name in names if name != "qp"]
