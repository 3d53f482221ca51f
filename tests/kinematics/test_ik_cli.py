"""`kinreach ik`, as it is typed."""

import csv
import re
from pathlib import Path

import numpy as np
import pytest

from kinreach._engines import load
from kinreach.cli import main
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, ClosedFormSolver, CollisionChecker, URKinematics, pose, pose_vector
from kinreach.kinematics.inside import new_solver
from kinreach.robots import PUBLISHED_CALIBRATIONS, Obstacle, Tool
from tests.robots import peoples_files

coal, pin = load("coal"), load("pinocchio")

FOLDED = Path(__file__).parents[1] / "data/calibrations/ur5e_folded.yaml"
REAL = PUBLISHED_CALIBRATIONS["ur5e_a"]
TOOL = [0.0, 0.0, 0.15, 0.0, 0.0, 0.0]


def poses_file(path, numbers, header="x,y,z,rx,ry,rz"):
    path.write_text("\n".join([header, *(",".join(map(repr, row)) for row in numbers.tolist())]) + "\n")
    return path


def ik(*arguments):
    return main(["ik", *map(str, arguments)])


def reachable(kin, count, seed=0):
    q = np.random.default_rng(seed).uniform(-2.5, 2.5, (count, kin.n))
    return pose_vector(kin.fk(q))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--arm", "ur10"), "UR10, by its data sheet: tip tool0 in base"),
        (("--arm", "ur5e", "--tool", "0,0,0.1,0,0,0"), "UR5E with tool, by its data sheet: tip tool in base"),
        (("--arm", "ur5e", "--calibration", REAL), "UR5E, calibrated by ur5e_a.yaml: tip tool0 in base"),
        (("--arm", "panda"), "Panda: tip panda_hand_tcp in base_link"),
    ],
)
def test_the_first_line_says_whose_answer_it_is(capsys, words, said):
    ik(*words, "--pose", "0.3,0.1,0.3,0,3,0")
    assert capsys.readouterr().out.splitlines()[0] == f"{said}, angles in rad"


def test_one_pose(capsys):
    assert (
        ik("--arm", "UR5e", "--calibration", REAL, "--tool", "0,0,0.15,0,0,0", "--pose", "-0.4,-0.1,0.3,3.14,0,0") == 0
    )
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].endswith("tip tool in base, angles in rad")
    kin = URKinematics.from_calibration(REAL, model="ur5e", tool=TOOL, base="base")
    T, seed = pose([-0.4, -0.1, 0.3, 3.14, 0, 0]), np.array(kin.arm.home)
    expected = kin.all_solutions(T, seed=seed)
    rows = [line.lstrip("* ").split()[1:7] for line in lines[2:-2]]
    np.testing.assert_allclose(np.array(rows, dtype=float), expected.q, atol=1e-5)
    assert len(rows) >= 2
    assert sum(line.startswith("*") for line in lines[2:-2]) == 1
    assert ik("--arm", "ur5e", "--pose", "0.4,0.1,3,3.14,0,0") == 1
    assert "no posture: too far away" in capsys.readouterr().out


def test_a_tool_by_its_name(capsys):
    assert ik("--arm", "ur5e", "--tool", "gripper", "--pose", "-0.4,-0.1,0.3,3.14,0,0") == 0
    assert "tip tool in base" in capsys.readouterr().out
    assert ik("--arm", "ur5e", "--tool", "gripper", "--tool-radius", "0.1", "--pose", "0,0,1,0,0,0") == 2
    assert "leave out --tool-radius" in capsys.readouterr().err


SEEN = ["--pose", "-0.4,0.1,0.3,3.14,0,0"]


@pytest.mark.parametrize(
    ("tool", "noted"),
    [
        (["--tool", "0,0,0.15,0,0,0"], True),
        (["--tool", "0,0,0.15,0,0,0", "--tool-mass", "1"], True),
        (["--tool", "0,0,0.15,0,0,0", "--tool-radius", "0.03"], False),
        (["--tool", "gripper"], False),
        ([], False),
    ],
)
def test_a_tool_without_a_shape_is_named(tool, noted, tmp_path, capsys):
    poses = poses_file(tmp_path / "in.csv", np.array([[-0.4, 0.1, 0.3, 3.14, 0, 0]]))
    for asked in (SEEN, ["--poses", poses, "--out", tmp_path / "out.csv"]):
        assert ik("--arm", "ur5e", *tool, *asked) == 0
        assert ("the tool has no shape" in capsys.readouterr().out) is noted


@pytest.mark.parametrize("arm", ["ur3e", "ur5e", "panda"])
@pytest.mark.parametrize("height", [0.0, -0.15])
@pytest.mark.slow
def test_a_table_around_the_arm(arm, height, tmp_path, capsys):
    """As coal finds for each link that moves and the half space below the table's top."""
    kin = ArmKinematics.of(arm)
    poses = poses_file(tmp_path / "in.csv", reachable(kin, 25, seed=3))
    out = tmp_path / "out.csv"
    asked = ["--arm", arm, "--base", "base_link", "--poses", poses, "--out", out, *["--all"] * (kin.n == 6)]
    ik(*asked, "--table", height)
    with out.open() as file:
        rows = [row for row in csv.DictReader(file) if row["q1"]]
    checker, counts = CollisionChecker(kin, obstacles=()), {True: 0, False: 0}
    for row in rows:
        q = np.array([float(row[f"q{j}"]) for j in range(1, kin.n + 1)])
        if checker.free(q):
            hit = below(checker, q, kin.T_world_arm[2, 3] + height)
            assert row["reason"].endswith(" - table") is hit
            counts[hit] += 1
    assert counts[False] >= 10
    assert kin.n > 6 or counts[True] >= 10  # for more axes the one posture that is written is free
    assert "poses have a posture" in capsys.readouterr().out


def below(checker, q, height):
    """Whether a link that moves touches what is below a height, by coal's half space."""
    placed, ground = checker.geometry.createData(), coal.Halfspace(np.array([0.0, 0.0, 1.0]), height)
    pin.updateGeometryPlacements(checker.model, checker.model.createData(), checker.geometry, placed, q)
    return any(
        coal.collide(shape.geometry, coal.Transform3s(M.rotation, M.translation), ground, coal.Transform3s(),
                     coal.CollisionRequest(), coal.CollisionResult())
        for shape, known, M in zip(checker.geometry.geometryObjects, checker.shapes, placed.oMg, strict=True)
        if known.joint >= 0
    )  # fmt: skip


def asked_at(arm, *flags, pose="-0.4,0.1,0.3,3.14,0,0"):
    return ["--arm", arm, "--pose", pose, *flags]


def test_a_box_is_in_the_frame_of_the_poses(capsys):
    """A flat one across the tool: as an `Obstacle` with the pose of that frame has it; its size turns, too."""
    tool = ["--tool", "0,0,0.15,0,0,0", "--tool-radius", "0.04"]
    kin = URKinematics("ur5e", tool=Tool.tube([0, 0, 0.15, 0, 0, 0], 0.04), base="base")
    counts = {True: 0, False: 0}
    for size in ((0.4, 0.02, 0.1), (0.02, 0.4, 0.1)):
        for x in (-0.4, -0.32, -0.55):
            ik(*asked_at("ur5e", *tool, "--box", ",".join(map(str, (x, 0.2, 0.35, *size)))))
            rows = [line for line in capsys.readouterr().out.splitlines() if re.match(r"[* ] +\d", line)]
            box = Obstacle("box 1", size, pose_vector(kin.T_world_base @ pose([x, 0.2, 0.35, 0, 0, 0])))
            checker = CollisionChecker(kin, obstacles=[box])
            for row in rows:
                hit = checker.in_collision(np.array([float(word) for word in row.lstrip("* ").split()[1:7]]))
                assert row.endswith("  no") is not hit
                counts[hit] += 1
    assert min(counts.values()) >= 10
    assert ik(*asked_at("ur5e", "--base", "0,0,0,0,0,0.5", "--box", "1,0,0,1,1,1")) == 2
    assert "axes along those of the world" in capsys.readouterr().err


def test_free_postures_come_first_and_have_words(capsys):
    assert ik(*asked_at("ur5e", "--table", "-0.02", "--degrees")) == 0
    rows = [line for line in capsys.readouterr().out.splitlines() if re.match(r"[* ] +\d", line)]
    free = [row.endswith("  no") for row in rows]
    assert free == sorted(free, reverse=True)
    assert 1 <= sum(free) < len(rows)
    assert rows[0].startswith("* ")
    words = [re.search(r"(left|right), (up|down), (straight|flipped)", row)[0] for row in rows]
    assert len(set(words)) == len(rows) == 8


def test_what_is_copied_from_urscript_is_a_pose(capsys):
    found = []
    for text in ("-0.4,0.1,0.3,3.14,0,0", "p[-0.4, 0.1, 0.3, 3.14, 0, 0]", "[-.4,.1,.3,3.14,0,0]"):
        assert ik(*asked_at("ur5e", pose=text)) == 0
        found.append(capsys.readouterr().out)
    assert len(set(found)) == 1


def test_degrees_are_written_as_they_are_asked_for(tmp_path):
    poses = poses_file(tmp_path / "in.csv", np.array([[-0.4, 0.1, 0.3, 3.14, 0, 0]]))
    rows = []
    for flags in ([], ["--degrees"]):
        assert ik("--arm", "ur5e", "--poses", poses, "--out", tmp_path / "out.csv", *flags) == 0
        with (tmp_path / "out.csv").open() as file:
            rows += csv.DictReader(file)
    for joint in range(1, 7):
        assert np.degrees(float(rows[0][f"q{joint}"])) == pytest.approx(float(rows[1][f"q{joint}_deg"]))


def test_how_far_a_pose_is_from_the_reach(capsys):
    assert ik(*asked_at("ur5e", pose="1.3,0,0.3,3.14,0,0")) == 1
    kin = URKinematics("ur5e", base="base")
    T = pose([1.3, 0, 0.3, 3.14, 0, 0])
    lack = 1000 * np.linalg.norm(kin.nearest_in_reach(T)[:3, 3] - T[:3, 3])
    assert f"stretched elbow; the nearest pose in reach with this orientation is {lack:.3g} mm away" in (
        capsys.readouterr().out
    )
    assert 100 < lack < 1000


@pytest.mark.parametrize("arm", ["ur5e", "panda", "arm3"])
def test_a_position_in_millimetres_is_named(arm, tmp_path, capsys):
    assert ik("--arm", arm, "--pose", "400,200,300,3.14,0,0") == 1
    assert re.search(r"no posture: .* 53\d m from the first joint, of an arm of \d\.\d m; positions are in metres",
                     capsys.readouterr().out)  # fmt: skip
    poses = poses_file(tmp_path / "in.csv", np.array([[3.0, 0, 0, 0, 0, 0], [300.0, 0, 0, 0, 0, 0]]))
    assert ik("--arm", arm, "--poses", poses, "--out", tmp_path / "out.csv") == 1
    with (tmp_path / "out.csv").open() as file:
        assert [row["reason"].endswith("in metres") for row in csv.DictReader(file)] == [False, True]


@pytest.mark.parametrize(("rx", "noted"), [(180.0, True), (-6.5, True), (2 * np.pi, False), (6.2, False), (3.2, False)])
def test_a_rotation_in_degrees_is_named(rx, noted, tmp_path, capsys):
    ik("--arm", "ur5e", "--pose", f"-0.4,0.1,0.3,{rx},0,0")
    assert ("in radians, not degrees" in capsys.readouterr().err) is noted
    poses = poses_file(tmp_path / "in.csv", np.array([[-0.4, 0.1, 0.3, 3.14, 0, 0], [-0.4, 0.1, 0.3, rx, 0, 0]]))
    ik("--arm", "ur5e", "--poses", poses, "--out", tmp_path / "out.csv")
    assert ("in radians, not degrees" in capsys.readouterr().err) is noted


def test_degrees_and_a_frame_of_ones_own(capsys):
    mount = "0.1,0.2,-0.3,0,0,1.5"
    assert ik("--arm", "ur10e", "--base", mount, "--pose", "0.5,0.1,0.6,3.14,0,0", "--degrees",
              "--seed", "-90,-90,90,-90,-90,0") == 0  # fmt: skip
    lines = capsys.readouterr().out.splitlines()
    nearest = next(line for line in lines if line.startswith("*"))
    kin = URKinematics("ur10e", base=[0.1, 0.2, -0.3, 0, 0, 1.5])
    T = kin.fk(np.radians([float(word) for word in nearest.split()[2:8]]))
    np.testing.assert_allclose(pose_vector(T)[:3], [0.5, 0.1, 0.6], atol=1e-4)


@pytest.mark.parametrize(("arm", "base"), [("ur5e", "base"), ("ur3", "world"), ("panda", "base_link")])
@pytest.mark.slow
def test_a_file_of_poses(arm, base, tmp_path, capsys):
    kin = ArmKinematics.of(arm, tip="tool0" if arm == "ur3" else None, base=base)
    numbers = np.vstack([reachable(kin, 20), [[9.0, 0, 0, 0, 0, 0]]])
    source, out = poses_file(tmp_path / "in.csv", numbers), tmp_path / "out.csv"
    tip = ["--tip", "tool0"] if arm == "ur3" else []
    assert ik("--arm", arm, "--base", base, "--poses", source, "--out", out, *tip) == 0
    with out.open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["pose", *(f"q{j}" for j in range(1, kin.n + 1)), "branch", "reason"]
    assert [int(row["pose"]) for row in rows] == list(range(1, 22))
    assert rows[-1]["q1"] == ""
    assert rows[-1]["reason"]
    solved = 0
    for row, given in zip(rows, numbers, strict=True):
        if row["q1"]:
            q = np.array([float(row[f"q{j}"]) for j in range(1, kin.n + 1)])
            np.testing.assert_allclose(kin.fk(q), pose(given), atol=2e-4)
            solved += 1
        else:
            assert row["reason"]
            assert row["branch"] == ""
    assert f"{solved} of 21 poses" in capsys.readouterr().out
    assert solved >= 10


def test_poses_are_not_replaced_by_their_answers(tmp_path, capsys):
    poses = poses_file(tmp_path / "in.csv", np.array([[-0.4, 0.1, 0.3, 3.14, 0, 0]]))
    (tmp_path / "link.csv").symlink_to(poses)
    text = poses.read_text()
    for out in (poses, tmp_path / "link.csv", tmp_path / "../" / tmp_path.name / "in.csv"):
        assert ik("--arm", "ur5e", "--poses", poses, "--out", out) == 2
        assert "--out must be another file than --poses" in capsys.readouterr().err
        assert poses.read_text() == text


@pytest.mark.parametrize("flag", ["--pose", "--base", "--tool"])
def test_a_rotation_that_may_be_in_degrees_is_named_with_its_flag(flag, capsys):
    flags = {"--pose": "-0.4,0.1,0.3,3.14,0,0"} | {flag: "0,0,0.1,0,0,90"}
    ik("--arm", "ur5e", *[word for pair in flags.items() for word in pair])
    assert f"the rotation vector of {flag} is 14.3 turns long" in capsys.readouterr().err
    assert main(["move", "--arm", "ur5e", "--to", "-0.4,0.1,0.3,180,0,0"]) == 2
    assert "the rotation vector of --to is 28.6 turns long" in capsys.readouterr().err
    assert ik("--arm", "ur5e", "--pose", flags["--pose"], "--tool", "0,0,150,0,0,0") == 2
    assert "error: --tool must be within 5 m, got 150" in capsys.readouterr().err


@pytest.mark.slow
def test_why_an_arm_has_no_closed_form_comes_with_no_posture(tmp_path, capsys):
    """Axes 1 and 2 of this arm are one line: six joints move it in five directions."""
    file = tmp_path / "a.urdf"
    file.write_text(peoples_files.arm(joints={2: {"origin": '<origin xyz="0 0 0.1"/>'}}))
    reason = "arm 'a' is singular in every posture: axes 1 and 2"
    kin = ArmKinematics.from_urdf(file)
    assert kin.no_closed_form.startswith(reason)
    assert ArmKinematics.of("ur5e").no_closed_form == ""
    assert ik("--arm", file, "--pose", "0.4,0.1,0.3,3.14,0,0") == 1
    assert reason in capsys.readouterr().out
    assert main(["check", str(file), "--poses", "2"]) == 0
    assert re.search(f"class .*no closed form.*: {reason}", capsys.readouterr().out)
    for use in (lambda: kin.all_solutions, lambda: ClosedFormSolver(kin), lambda: new_solver("closed-form", kin)):
        with pytest.raises((InputError, AttributeError), match=reason):
            use()


def test_every_posture_of_each_pose(tmp_path):
    kin = URKinematics("ur5e", base="base")
    numbers = reachable(kin, 15, seed=4)
    source, out = poses_file(tmp_path / "in.csv", numbers), tmp_path / "out.csv"
    assert ik("--arm", "ur5e", "--poses", source, "--out", out, "--all") == 0
    with out.open() as file:
        rows = list(csv.DictReader(file))
    seed = np.array(kin.arm.home)
    expected = [len(kin.all_solutions(pose(given), seed=seed)) for given in numbers]
    assert [sum(int(row["pose"]) == number for row in rows) for number in range(1, 16)] == expected
    assert any(row["reason"].startswith("collides: ") for row in rows)
    assert sum(expected) >= 60


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--arm", "ur5e"], "give --pose, --poses or --point"),
        (["--arm", "ur5ee", "--pose", "0,0,1,0,0,0"], "unknown arm 'ur5ee'.*did you mean ur5e"),
        (["--arm", "ur5e", "--pose", "1,2,3"], "--pose must be 6 numbers"),
        (["--arm", "ur5e", "--pose", "0,0,1,0,0,0", "--tool", "0,0,150,0,0,0"], "metres, not millimetres"),
        (["--arm", "ur5e", "--pose", "0,0,1,0,0,0", "--tool-radius", "0.1"], "--tool-radius needs --tool"),
        (["--arm", "ur5e", "--pose", "0,0,1,0,0,0", "--tip", "tcp", "--tool", "0,0,1,0,0,0"], "--tip or --tool"),
        (["--arm", "ur5e", "--pose", "0,0,1,0,0,0", "--calibration", str(FOLDED)], "--repair does that"),
        (["--arm", "ur10e", "--pose", "0,0,1,0,0,0", "--calibration", str(REAL)], "it fits ur5e"),
        (["--arm", "ur5e", "--poses", "missing.csv", "--out", "o.csv"], "cannot read the poses missing.csv"),
        (["--arm", "ur5e", "--poses", "missing.csv"], "belong together"),
        (["--arm", "ur5e", "--pose", "0,0,1,0,0,0", "--seed", "1,2"], "--seed must be 6 numbers"),
        (
            ["--arm", "ur5e", "--pose", "0,0,1,0,0,0", "--seed", "-90,-90,90,-90,-90,0"],
            r"--seed must be within ±6.283 rad, got -90; for degrees add --degrees",
        ),
        (["--arm", "ur5e", "--pose", "-0.4,0.1,O.3,3,0,0"], r"--pose must be 6 numbers.*: 'O.3' is no number"),
        (["--arm", "ur5e", "--pose", "0,0,1,0,0,0", "--box", "1,0,0,1,1,-1"], "the size of the box 'box 1'"),
        (["--arm", "ur5e", "--pose", "0,0,1,0,0,0", "--box", "1,0,0"], "--box must be 6 numbers"),
        (["--arm", "ur5e", "--pose", "0,0,1,0,0,0", "--base", "floor"], "unknown base 'floor'"),
        (["--arm", "ur5e", "--pose", "0,0,1,0,0,0", "--table", "0.2"], "--table must be 0 or negative, got 0.2"),
        (["--arm", "ur5e", "--pose", "0,0,1,0,0,0", "--table", "nan"], "--table must be 0 or negative"),
        (["--arm", "ur5e", "--pose", "0,0,1,0,0,0", "--table", "-5000"], "position of the box 'table'"),
        (["--arm", "ur5e", "--pose", "0,0,1,0,0,0", "--table", "0", "--cell"], "give --cell or --table, not both"),
    ],
)
def test_bad_input_is_one_line(arguments, message, capsys):
    assert ik(*arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()

    assert re.search(message, line), line


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no column x"),
        ("x,y,z\n1,2,3\n", "has no column rx, ry, rz"),
        ("x,y,z,rx,ry,rz\n", "1 to 1000000 poses, got 0"),
        ("x,y,z,rx,ry,rz\n1,2,3,4,5\n", "line 2: six numbers"),
        ("x,y,z,rx,ry,rz\n0,0,1,0,0,0\n1,2,three,4,5,6\n", "line 3: six numbers"),
        ("x,y,z,rx,ry,rz\n1,2,3,4,5,nan\n", "line 2: the numbers must be finite"),
    ],
)
def test_bad_files_name_the_line(text, message, tmp_path, capsys):
    (tmp_path / "in.csv").write_text(text)
    assert ik("--arm", "ur5e", "--poses", tmp_path / "in.csv", "--out", tmp_path / "out.csv") == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out.csv").exists()


def table(lines):
    """Numbers of the rows of a printed table: branch, angles, and what follows; and their last words."""
    rows = [line.lstrip("* ").split() for line in lines[2:-1]]
    return np.array([[float(word) for word in row[:8]] for row in rows]), [" ".join(row[8:]) for row in rows]


def test_five_axes_say_what_is_left_of_an_orientation(capsys):
    kin = ArmKinematics.of("so101")
    numbers = "0.25,0.1,0.1,0,3,0.5"
    T, seed = pose([0.25, 0.1, 0.1, 0, 3, 0.5]), np.array(kin.arm.home)
    assert ik("--arm", "so101", "--pose", numbers) == 1
    assert "5 joints leave 0.256 rad (14.7 degrees) of the orientation at this point" in capsys.readouterr().out
    assert ik("--arm", "so101", "--pose", numbers, "--nearest-orientation") == 0
    rows, words = table(capsys.readouterr().out.splitlines())
    minima = kin.all_solutions(T, seed=seed).minima
    np.testing.assert_allclose(rows[:, 1:6], minima.q, atol=1e-5)
    np.testing.assert_allclose(rows[:, 6], minima.left, atol=1e-5)
    np.testing.assert_allclose(rows[:, 7], np.degrees(minima.left), atol=1e-2)
    assert [text.removesuffix(" no") for text in words] == list(minima.kind)
    assert ik("--arm", "so101", "--pose", "0.9,0,0,0,0,0", "--nearest-orientation") == 1
    assert "the tip does not come to this point, 0.863 m from shoulder_pan" in capsys.readouterr().out


def test_a_point_and_a_direction(capsys):
    kin = ArmKinematics.of("so101")
    assert ik("--arm", "so101", "--point", "0.25,0.1,0.05", "--axis", "0,0,-1") == 0
    rows, _ = table(capsys.readouterr().out.splitlines())
    assert len(rows) > 0
    for row in rows:
        T = kin.fk(row[1:6])
        np.testing.assert_allclose(T[:3, 3], [0.25, 0.1, 0.05], atol=1e-4)
        np.testing.assert_allclose(T[:3, 2], [0, 0, -1], atol=1e-4)
    assert ik("--arm", "so101", "--point", "0.25,0.1,0.05") == 0
    rows, _ = table(capsys.readouterr().out.splitlines())
    np.testing.assert_allclose(kin.positions(rows[:, 1:6]), np.tile([0.25, 0.1, 0.05], (len(rows), 1)), atol=1e-4)
    assert ik("--arm", "so101", "--point", "0.2,0.05,0.03") == 0  # with the seed's orientation the wrist is in the way
    said = capsys.readouterr().out
    rows, _ = table(said.splitlines())
    best = np.array(rows)[0, 1:6]
    assert "turned, free" in said
    assert "* nearest without a collision to the seed" in said
    assert np.abs(best).max() < 1.7  # not with the roll at its limit
    np.testing.assert_allclose(kin.positions(best), [0.2, 0.05, 0.03], atol=1e-4)
    assert CollisionChecker(kin).free(best)
    point = ["--arm", "so101", "--point", "0.25,0.0,0.1", "--axis", "0,1,0"]
    assert ik(*point) == 1
    assert "of the direction at this point; --nearest-orientation takes that" in capsys.readouterr().out
    assert ik(*point, "--nearest-orientation") == 0
    assert "leaves least" in capsys.readouterr().out
    six = URKinematics("ur5e", base="base")
    assert ik("--arm", "ur5e", "--point", "0.4,0.2,0.3", "--axis", "0,0,-1") == 0
    lines = capsys.readouterr().out.splitlines()
    q = np.array([line.lstrip("* ").split()[1:7] for line in lines[2:-1]], dtype=float)
    assert len(q) == len(six.axis_solutions([0.4, 0.2, 0.3], [0, 0, -1], seed=six.arm.home))
    np.testing.assert_allclose(six.positions(q), np.tile([0.4, 0.2, 0.3], (len(q), 1)), atol=1e-4)
    assert ik("--arm", "panda", "--point", "0.4,0.2,0.3") == 0  # without a list one posture is found
    assert "* numeric: found from the seed" in capsys.readouterr().out


def test_poses_in_a_file_for_five_axes(tmp_path, capsys):
    kin, rng = ArmKinematics.of("so101"), np.random.default_rng(0)
    T = kin.fk(rng.uniform(kin.lower, kin.upper, (12, 5)))
    turned = T @ pose([0, 0, 0, 0.2, 0.3, 0.1])
    source = poses_file(tmp_path / "in.csv", pose_vector(np.concatenate([T, turned])))
    out = tmp_path / "out.csv"
    assert ik("--arm", "so101", "--poses", source, "--out", out, "--nearest-orientation") == 0
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert list(rows[0]) == ["pose", "q1", "q2", "q3", "q4", "q5", "branch", "left_rad", "reason"]
    solved = [row for row in rows if not row["reason"]]
    for row in solved:
        reached, wanted = kin.fk([float(row[f"q{i}"]) for i in range(1, 6)]), np.concatenate([T, turned])
        target = wanted[int(row["pose"]) - 1]
        np.testing.assert_allclose(reached[:3, 3], target[:3, 3], atol=1e-8)
        left = np.arccos(min(1.0, (np.trace(reached[:3, :3].T @ target[:3, :3]) - 1) / 2))
        assert float(row["left_rad"]) == pytest.approx(left, abs=1e-6)
    assert len(solved) >= 15
    capsys.readouterr()


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        (["--pose", "0,0,1,0,0,0", "--point", "0,0,1"], "give --pose, --poses or --point"),
        (["--pose", "0,0,1,0,0,0", "--axis", "0,0,1"], "--axis belongs to --point"),
        (["--point", "0,0"], "--point"),
        (["--point", "0.1,0,0.1", "--axis", "0,0,0"], "axis must not be the zero vector"),
        (["--arm", "ur5e", "--pose", "0,0,1,0,0,0", "--nearest-orientation"], "is for arms of four and five axes"),
    ],
)
def test_what_is_asked_of_five_axes_in_other_words_is_refused(typed, said, capsys):
    assert ik("--arm", "so101", *typed) == 2
    assert said in capsys.readouterr().err
