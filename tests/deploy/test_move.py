"""`kinreach move`: what it plans is free, what it sends was tried, and what it refuses has a reason."""

import contextlib
import os
import re
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from functools import cache
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from kinreach.cli import main
from kinreach.deploy import Program, SimulatedUR, URClient, _moving
from kinreach.deploy._controller import FINISHED, Controller
from kinreach.deploy._move_cli import Comparison, _moved
from kinreach.deploy._moving import MotionPlanner
from kinreach.deploy._planning import plan
from kinreach.deploy._program import motion_of
from kinreach.errors import InputError, PathError, RobotError
from kinreach.kinematics import ArmKinematics, CollisionChecker, pose, pose_vector
from kinreach.robots import Box, Obstacle, Tool, Workcell, get_arm
from tests.cases import slow
from tests.deploy.conftest import CALIBRATION, ROOT

ARM = get_arm("ur5e").calibrated(CALIBRATION)
KIN = ArmKinematics.of(ARM, base="base")
CHECKER = CollisionChecker(KIN, margin=0.005)
CHECKER_OF = cache(CollisionChecker)
HOME = np.array(ARM.home)
GOAL, NEAR, BELOW = "-0.4,0.3,0.3,3.14,0,0", "-0.3,0.4,0.3,3.14,0,0", "-0.4,0.3,-0.3,3.14,0,0"


def goals(count, seed):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield KIN.fk(rng.uniform(-1.2, 1.2, 6) + HOME)


@pytest.mark.parametrize("linear", [False, *slow(True)])
def test_ways_are_free_by_dense_checks_and_runs_end_at_their_goals(linear):
    planned, refused = 0, []
    for T in goals(20, 6):
        try:
            (leg,) = plan(KIN, CHECKER, HOME, [T], linear=linear)
        except (InputError, PathError) as error:
            refused.append(str(error))
            continue
        planned += 1
        np.testing.assert_allclose(KIN.fk(leg.end), T, atol=1e-5)
        assert 1 <= leg.free <= leg.postures
        found = KIN.all_solutions(T, seed=HOME)
        if leg.branch >= 0:
            assert np.abs(found.q[found.branch == leg.branch] - leg.end).max(axis=1).min() < 1e-4
        if planned > 4:
            continue
        done = Controller(ARM).run(Program.of(KIN, HOME, leg.moves).text)
        if done.reason:  # a straight line near a singularity, where a joint is too fast; the command says so
            assert linear
            assert "joint speed" in done.reason
            continue
        assert done.status == FINISHED
        assert not CHECKER_OF(ARM).impossible(done.commanded.q).any()
        np.testing.assert_allclose(KIN.fk(done.commanded.q[-1]), T, atol=1e-5)
    assert planned >= 6
    assert refused
    assert all(text.startswith("the goal") for text in refused)


def with_wall():
    wall = Box("wall", (0.5, 0.02, 0.55), (0.45, 0.0, 0.275))
    return replace(ARM, workcell=Workcell(obstacles=(*ARM.workcell.obstacles, wall), touching=ARM.workcell.touching))


@pytest.mark.slow
def test_it_goes_around_a_wall():
    """From one side of it to the other, where the straight way in joint space goes through."""
    arm = with_wall()
    kin = ArmKinematics.of(arm, base="base")
    checker = CollisionChecker(kin, margin=0.005)
    rng, around = np.random.default_rng(3), 0
    for _ in range(3):
        start, goal = (np.add(HOME, [side, *rng.uniform(-0.1, 0.1, 5)]) for side in (-0.8, 0.8))
        assert CHECKER_OF(arm).impossible(np.linspace(start, goal, 200)).any()
        (leg,) = plan(kin, checker, start, [kin.fk(goal)])
        done = Controller(arm, q=start).run(Program.of(kin, start, leg.moves).text)
        assert (done.status, done.reason) == (FINISHED, "")
        assert not CHECKER_OF(arm).impossible(done.commanded.q).any()
        np.testing.assert_allclose(kin.fk(done.commanded.q[-1]), kin.fk(goal), atol=1e-5)
        around += len(leg.moves) > 1
    assert around >= 2


@pytest.mark.slow
def test_turns_around_a_wall_are_rounded_where_they_stay_free():
    """What is sent keeps the margin, ends where it should, and is done sooner."""
    arm = with_wall()
    kin, checker = ArmKinematics.of(arm, base="base"), CollisionChecker(arm, margin=0.005)
    rng, rounded = np.random.default_rng(3), 0
    for _ in range(1):
        start, goal = (np.add(HOME, [side, *rng.uniform(-0.1, 0.1, 5)]) for side in (-0.8, 0.8))
        stopping, blended = (
            MotionPlanner(arm, [kin.fk(goal)], linear=False, speed=0.5, blend=blend).tried(start)
            for blend in (0.0, 0.05)
        )
        assert not any(move.blend for move in stopping.program.moves)
        radii = [move.blend for move in blended.program.moves]
        assert radii[-1] == 0.0
        assert max(radii) <= 0.05
        done = blended.done
        assert (done.status, done.reason) == (FINISHED, "")
        assert not checker.impossible(done.commanded.q).any()
        np.testing.assert_allclose(kin.fk(done.commanded.q[-1]), kin.fk(goal), atol=1e-5)
        if any(radii):
            assert done.commanded.duration < 0.95 * stopping.done.commanded.duration
            rounded += 1
    assert rounded == 1


@pytest.mark.slow
def test_turns_that_would_touch_are_not_rounded(monkeypatch):
    """Where no blend of a way keeps the distance, the program stops at each waypoint, and says so."""
    arm = with_wall()
    kin = ArmKinematics.of(arm, base="base")
    start, goal = (np.add(HOME, [side, 0, 0, 0, 0, 0]) for side in (-0.8, 0.8))
    motions, corners = [], []

    def commanded(program, arm):
        motions.append(motion_of(program, arm))
        return motions[-1]

    def touches(checker, q, *, keeps):
        assert keeps == 0.005 < checker.margin
        motion = motions[-1]
        both = [ended for began, ended in zip(motion.began[1:], motion.ended[:-1], strict=True) if began <= ended]
        if both:
            corners.append(both[0])
            raise PathError("collision", index=both[0])

    monkeypatch.setattr("kinreach.deploy._planning.motion_of", commanded)
    monkeypatch.setattr("kinreach.deploy._planning.joint_line", touches)
    motion = MotionPlanner(arm, [kin.fk(goal)], linear=False, speed=0.5, blend=0.05).tried(start)
    (leg,), program, done = motion.legs, motion.program, motion.done
    assert len(program.moves) > 1
    assert not any(move.blend for move in program.moves)
    assert leg.moves == program.moves
    assert 0.0 < leg.reduced <= 0.05
    assert len(corners) > 5
    assert done.status == FINISHED


#: Goals of a corner whose lines pass a pillar inside it, in base: the tool points down.
CORNER = [[-0.30, 0.40, 0.30, np.pi, 0, 0], [-0.30, 0.60, 0.30, np.pi, 0, 0], [-0.10, 0.60, 0.30, np.pi, 0, 0]]


def with_pillar(gap):
    """A tool of 10 mm radius, and a pillar that both lines of the corner pass with a gap [m]."""
    arm = get_arm("ur5e").with_tool(Tool.tube([0, 0, 0.15, 0, 0, 0], 0.01))
    place = [CORNER[0][0] + 0.01 + gap + 0.025, CORNER[1][1] - 0.01 - gap - 0.025, 0.22]
    T = ArmKinematics(arm, base="base").T_world_base
    box = Box("pillar", (0.05, 0.05, 0.3), tuple((T @ [*place, 1.0])[:3]))
    return replace(arm, workcell=Workcell((box,)))


@pytest.mark.parametrize(("linear", "gap"), [(True, 0.0055), (False, 0.008), (True, 0.012), (False, 0.0055)])
@pytest.mark.slow
def test_rounded_corners_keep_the_distance(linear, gap, capsys):
    """The radius is reduced until the corner, as it is commanded, keeps what every way keeps; and that is said."""
    arm = with_pillar(gap)
    kin = ArmKinematics.of(arm, base="base")
    exact, start = CollisionChecker(kin), kin.nearest(pose(CORNER[0]), arm.home).q
    given = {}
    for blend in (0.015, 0.05):
        job = MotionPlanner(arm, [pose(goal) for goal in CORNER[1:]], linear=linear, speed=0.25, blend=blend)
        motion = job.tried(start)
        legs, program, done = motion.legs, motion.program, motion.done
        assert (done.status, done.reason) == (FINISHED, "")
        assert min(exact.distance(q).distance for q in done.commanded.q[::5]) >= 0.005
        given[blend] = program.moves[len(legs[0].moves) - 1].blend
        assert given[blend] <= blend
        assert legs[0].reduced == (blend if given[blend] < blend else 0.0)
        assert program.moves[-1].blend == legs[1].reduced == 0.0
    assert given[0.015] == 0.015
    assert 0.01 < given[0.05] < 0.05  # by more it would touch
    if not linear:
        return
    goals = [part for goal in CORNER[1:] for part in ("--to", ",".join(map(str, goal)))]
    centre = np.linalg.inv(kin.T_world_base) @ [*arm.workcell.obstacles[0].position, 1.0]
    box = ["--no-cell", "--box", ",".join(map(str, [*centre[:3].round(9), 0.05, 0.05, 0.3]))]
    posture = ["--from", ",".join(f"{angle:.9f}" for angle in start)]
    assert main(["move", "--arm", "ur5e", "--tool", "0,0,0.15,0,0,0", "--tool-radius", "0.01", *goals, *box, *posture,
                 "--blend", "0.05", "--linear"]) == 0  # fmt: skip
    out = capsys.readouterr().out
    said = re.search(r"blend (\d+) mm \(reduced from 50 mm, to keep 5 mm from everything\)", out)
    assert int(said[1]) == pytest.approx(1000 * given[0.05], abs=0.51)
    assert "every way keeps 5 mm from everything" in out


@pytest.mark.slow
def test_a_run_that_comes_too_near_is_refused(monkeypatch):
    """Though it touches nothing: as where a way is planned without what stands there."""
    arm = with_pillar(0.003)
    kin = ArmKinematics.of(arm, base="base")
    start, blind = kin.nearest(pose(CORNER[0]), arm.home).q, CollisionChecker(kin, obstacles=(), margin=0.01)
    planned = _moving.planned_program
    monkeypatch.setattr(_moving, "planned_program", lambda kin, _, *rest, **more: planned(kin, blind, *rest, **more))
    job = MotionPlanner(arm, [pose(goal) for goal in CORNER[1:]], linear=True, speed=0.25, blend=0.0)
    with pytest.raises(InputError, match=r"the dry run comes too near to something, nothing is sent: .*pillar"):
        job.tried(start)


@pytest.mark.slow
def test_whoever_the_start_check_lets_pass_keeps_the_distance():
    """A box under the tool at the start: the nearer it is, the nearer the arm has to be to where it was tried from."""
    arm = get_arm("ur5e").with_tool(Tool.tube([0, 0, 0.15, 0, 0, 0], 0.01))
    kin = ArmKinematics.of(arm, base="base")
    start, tolerances = kin.nearest(pose(CORNER[0]), arm.home).q, {}
    for gap in (0.0052, 0.0056, 0.0062, 0.0066, 0.012):
        tip = kin.T_world_base @ kin.fk(start)
        below = Box("box", (0.1, 0.1, 0.1), (*tip[:2, 3], tip[2, 3] - 0.05 - gap))
        there = replace(arm, workcell=Workcell((below,)))
        job = MotionPlanner(there, [pose(CORNER[2])], linear=False, speed=0.25, blend=0.0)
        if gap < 0.0058:
            near = (
                r"start is not free: .* 5\.2 mm apart, the margin is 5\.25 mm"
                if gap < 0.0053
                else r"start is too near: .* 5\.60 mm"
            )
            with pytest.raises(PathError, match=near):
                job.tried(start)
            continue
        program = job.tried(start).program
        tolerances[gap] = program.tolerance
        exact = CollisionChecker(there)
        corners = start + 0.999 * program.tolerance * np.array(list(product((-1, 1), repeat=6)))
        distances = [exact.distance(q).distance for q in corners]
        assert min(distances) >= 0.005
        if gap < 0.01:
            assert min(distances) < gap - 0.0002
        ur = Controller(there, q=corners[int(np.argmin(distances))].tolist())
        done = ur.run(program.text)
        assert (done.status, done.reason) == (FINISHED, "")
        assert min(exact.distance(q).distance for q in done.commanded.q[::3]) >= 0.005
    assert 2.5e-4 <= tolerances[0.0062] < tolerances[0.0066] < tolerances[0.012] == 5e-4


@pytest.fixture
def run(capsys):
    """`run(*flags)`: exit code, output and errors of `kinreach move` for a calibrated UR5e."""

    def command(*flags):
        code = main(["move", "--arm", "ur5e", "--calibration", str(CALIBRATION), *flags])
        return code, *capsys.readouterr()

    command.calibration = str(CALIBRATION)
    return command


def test_what_a_file_leaves_open_is_said_before_what_is_wrong(capsys):
    file = ROOT / "tests/data/calibrations/controller_calibration_ur5e.conf"
    assert main(["move", "--arm", "ur5e", "--calibration", str(file), "--to", "5,0,0,0,0,0"]) == 2
    note, error = capsys.readouterr().err.splitlines()
    assert note.startswith("note: controller_calibration_ur5e.conf does not name its model: ur5e is assumed")
    assert error.startswith("kinreach move: error: ")


@pytest.mark.slow
def test_without_a_robot_it_is_tried_and_written(run, tmp_path):
    path = tmp_path / "motion.script"
    picture = tmp_path / "motion.png"
    code, out, err = run("--to", GOAL, "--tool", "0,0,0.15,0,0,0", "--tool-mass", "1.5", "--script", str(path),
                         "--picture", str(picture))  # fmt: skip
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0] == "UR5E, calibrated by ur5e_a.yaml with tool: tip tool in base, degrees"
    assert [float(word) for word in lines[1].removeprefix("from").split()] == pytest.approx(np.degrees(HOME), abs=0.05)
    assert [line.split()[0] for line in lines] == [
        "UR5E,", "from", "to", "branch", "dry", "no", "every", "the", "ends", "wrote", "picture"
    ]  # fmt: skip
    assert "branch 6 (right, up, straight), " in out
    assert "a joint turns by " in out
    assert "postures free; movej, 0.79 rad/s" in out
    assert "25 % of its limit" in out
    assert "no collision with itself, table, floor" in out
    assert "ends 0.0" in out
    assert picture.read_bytes().startswith(b"\x89PNG")
    program = Program.parse(path.read_text())
    assert program.payload == 1.5
    assert program.centre_of_mass == (0, 0, 0.075)
    assert program.start == pytest.approx(ARM.home)
    arm = ARM.with_tool([0, 0, 0.15, 0, 0, 0])
    done = Controller(arm).run(path.read_text())
    np.testing.assert_allclose(ArmKinematics(arm, base="base").fk(done.commanded.q[-1]),
                               pose([float(word) for word in GOAL.split(",")]), atol=1e-6)  # fmt: skip


@pytest.mark.slow
def test_several_goals_are_blended(run, tmp_path):
    path = tmp_path / "motion.script"
    code, out, _ = run("--to", NEAR, "--to", "-0.3,0.5,0.2,3.14,0,0", "--linear", "--blend", "0.03", "--speed", "0.25",
                       "--from", "-1.6,-1.5,1.5,-1.5,-1.5,0.1", "--no-cell", "--script", str(path))  # fmt: skip
    assert code == 0
    assert "movel, 0.25 m/s, blend 30 mm" in out
    assert "nothing around it is known" in out
    program = Program.parse(path.read_text())
    assert [(move.command, move.speed, move.blend) for move in program.moves] == [
        ("movel", 0.25, 0.03),
        ("movel", 0.25, 0),
    ]


@pytest.mark.slow
def test_the_way_is_the_near_one_in_a_chosen_branch(run, capsys):
    """A long turn and another branch are said first; a row of `kinreach ik` is a start."""
    straight = run("--to", GOAL)[1]
    assert straight.startswith("UR5E")
    assert "branch 6 (right, up, straight), " in straight
    assert run("--to", GOAL, "--branch", "same")[1] == run("--to", GOAL, "--branch", "6")[1] == straight
    code, out, _ = run("--to", GOAL, "--branch", "right, up, flipped")
    first, *_ = out.splitlines()
    assert code == 0
    assert first == "caution  the arm leaves its branch: from 6 (right, up, straight) to 4 (right, up, flipped)"
    assert "branch 4 (right, up, flipped), " in out
    out = run("--to", GOAL, "--branch", "1")[1]
    assert re.match(r"caution  elbow turns by 20\d°, more than half a turn\n", out)
    assert main(["ik", "--arm", "ur5e", "--calibration", run.calibration, f"--pose={NEAR}", "--degrees"]) == 0
    found = capsys.readouterr().out.splitlines()[2:-1]
    rows = {line.strip("* ").split()[0]: line.strip("* ").split()[1:7] for line in found}
    for start, row in (("4", "4"), ("right,up,flipped", "4"), ("same", "6")):
        out = run("--to", GOAL, "--from", f"{start}@{NEAR}")[1]
        begins = next(line for line in out.splitlines() if line.startswith("from"))
        angles = [float(word) for word in begins.split()[1:]]
        np.testing.assert_allclose(angles, [float(word) for word in rows[row]], atol=0.051)


@pytest.mark.parametrize(("flags", "reason"), [
    (["--to", "-2,0,0,0,0,0"], "the goal has no posture: too far away"),
    (["--to", BELOW], "the goal: none of the .* goal postures is free: .*table"),
    (["--to", GOAL, "--to", BELOW], "goal 2: none of the"),
    (["--to", GOAL, "--from", "0,-1,2.9,-1,-1.57,0"], "the start is not free: upper_arm_link - wrist"),
    (["--to", GOAL, "--from", "9,-1,2.9,-1,-1.57,0"], "--from must be within ±6.283 rad, got 9; for degrees add"),
    (["--to", GOAL, "--from", "0,-60,190,-60,-90,0", "--degrees"], "the start is not free: out of limits: elbow"),
    (["--to", GOAL, "--speed", "1.01"], "--speed must be finite and above 0 and at most 1"),
    (["--to", GOAL, "--speed", "0"], "--speed must be"),
    (["--to", GOAL, "--speed", "nan"], "--speed must be"),
    (["--to", GOAL, "--to", "-0.41,0.3,0.3,3.14,0,0", "--blend", "0.2"], "the blends of move [12] overlap"),
    (["--to", GOAL, "--blend", "-1", "--to", NEAR], "blend"),
    (["--to", "1,2"], "--to must be 6 numbers"),
    (["--to", GOAL, "--table", "0.01"], "--table must be 0 or negative, got 0.01: metres from the arm's base down"),
    (["--to", GOAL, "--robot", "127.0.0.1", "--show", "--yes"], "--show is for looking before the robot moves"),
    (["--to", "0.4,0.3,3,3.14,0,0"], r"the nearest pose in reach with this orientation is 2\.\d+ m away"),
    (["--to", "-400,300,300,3.14,0,0"], "the goal has no posture: too far .*; positions are in metres"),
    (["--to", GOAL, "--box", "-0.4,0.3,0.3,0.1,0.1,0.1"], "none of the 8 goal postures is free: .* - box 1"),
    (["--to", GOAL, "--script", "/"], "--script must be a file"),
    (["--to", GOAL, "--picture", "/nowhere/a.png"], "--picture must be a file"),
    (["--to", GOAL, "--robot", "127.0.0.1", "--from", "home"], "leave out --from"),
    (["--to", GOAL, "--robot", "127.255.9.9"], r"no robot answers at 127.255.9.9:30004: Connection refused"),
    (["--to", GOAL, "--ports", "1"], "--ports must be 2 numbers"),
    (["--to", GOAL, "--branch", "upp"], "unknown word of a branch 'upp'; .*did you mean up"),
    (["--to", GOAL, "--branch", "11"], "the goal: branch must be at most 7, got 11"),
    (["--to", GOAL, "--max-travel", "0"], "--max-travel must be finite and above 0"),
    (["--to", GOAL, "--max-travel", "0.2"], r"the goal: a joint would turn by 0.6\d+ rad .*; max_travel is 0.2 rad"),
    (["--to", GOAL, "--max-travel", "10", "--degrees"], r"a joint would turn by .* rad \(38°\) .* is 0.1745 rad"),
    (["--to", GOAL, "--linear", "--max-travel", "0.2"], "a joint would turn by .* along the straight line of the tool"),
    (["--to", GOAL, "--linear", "--branch", "left"], "the straight line of the tool ends in another branch than left"),
    (["--to", GOAL, "--from", "17@-0.4,0.3,0.3,3.14,0,0"], "--from: branch must be at most 7, got 17"),
    (["--to", GOAL, "--from", "2@5,0,0,0,0,0"], "--from: the pose has no posture: too far"),
    (["--to", GOAL, "--from", "2@5,0"], "--from must be 6 numbers"),
    ([], "--to"),
])  # fmt: skip
def test_what_cannot_be_is_refused_in_one_line(flags, reason, capsys):
    try:
        code = main(["move", "--arm", "ur5e", *flags])
    except SystemExit as leaving:
        code = leaving.code
    assert code == 2
    said = capsys.readouterr()
    assert len(said.err.splitlines()) == 1
    assert re.search(reason, said.err), said.err


def test_only_urs_move(capsys):
    assert main(["move", "--arm", "panda", "--to", GOAL]) == 2
    assert "is not a UR" in capsys.readouterr().err


@pytest.fixture
def cube(tmp_path):
    """A cube of 100 mm, in millimetres."""
    file = tmp_path / "cube.stl"
    trimesh.creation.box((100.0, 100.0, 100.0)).export(file)
    return file


@pytest.mark.slow
def test_a_table_a_box_and_meshes_stand_around_it(run, cube):
    start = ["--from", "-90,-90,90,-90,-90,0", "--degrees"]
    meshes = ["--mesh", f"{cube}@0.5,-0.5,0.5,0,0,0.3", "--mesh", f"{cube}@0.5,0.2,0.5,0,0,0", "--mesh-scale", "0.001"]
    _, out, _ = run("--to", GOAL, "--table", "-0.1", "--box", "0.5,0.5,0.5,0.1,0.1,0.1", *meshes, *start)
    assert "no collision with itself, table, box 1, cube.stl, cube.stl 2" in out
    assert "from       -90.0    -90.0     90.0" in out


@pytest.mark.parametrize(("flags", "reason"), [
    (["--mesh", "CUBE@-0.4,0.3,0.3,0,0,0", "--mesh-scale", "0.001"], r"goal postures is free: .* - cube\.stl"),
    (["--mesh", "CUBE@1,2,3"], "--mesh must be 6 numbers"),
    (["--mesh", "CUBE@0,1,0,90,0,0"], "of --mesh is 14.3 turns long; rx, ry, rz are in radians"),
    (["--mesh", "CUBE", "--mesh-scale", "0"], "the scale of the obstacle 'cube.stl' must be finite and above 0"),
    (["--mesh", "nothing.stl"], "nothing.stl"),
])  # fmt: skip
def test_a_mesh_that_cannot_be_is_refused(flags, reason, run, cube):
    code, _, err = run("--to", GOAL, *(flag.replace("CUBE", str(cube)) for flag in flags))
    assert code == 2
    assert len(err.splitlines()) == 1
    assert re.search(reason, err), err


@pytest.mark.slow
def test_a_run_that_touches_a_mesh_is_refused(cube):
    """MuJoCo does not have meshes: what it simulated is checked against them."""
    done = MotionPlanner(ARM, [pose([float(x) for x in GOAL.split(",")])], linear=False, speed=0.25, blend=0.0)
    done = done.tried(HOME).done
    at = KIN.T_world_base @ KIN.fk(done.measured.q[len(done.measured.q) // 2])
    refused = 0
    for away in (0.0, 0.5):
        block = Obstacle("block", str(cube), [*(at[:3, 3] + [0, 0, away]), 0, 0, 0], 0.001)
        planner = MotionPlanner(ARM, [], linear=False, speed=0.25, blend=0.0, meshes=[block])
        with contextlib.nullcontext() if away else pytest.raises(InputError, match="nothing is sent: collision: block"):
            planner._check_meshes(done)
        refused += not away
    assert refused == 1


@pytest.fixture
def robot():
    with SimulatedUR(ARM, rtde_port=0, script_port=0, speed=8.0, log=(log := []).append) as served:
        served.log, served.ports = log, f"{served.rtde_port},{served.script_port}"
        yield served


@pytest.mark.slow
def test_a_robot_is_asked_for_its_posture_and_moved(robot, run):
    code, out, err = run("--to", GOAL, "--robot", "127.0.0.1", "--ports", robot.ports, "--yes")
    assert (code, err) == (0, "")
    assert "its tool centre point is 0.00 mm and 0.00° from kinreach's" in out
    assert "moved    " in out
    goal = pose([float(word) for word in GOAL.split(",")])
    with URClient("127.0.0.1", rtde_port=robot.rtde_port, script_port=robot.script_port) as client:
        np.testing.assert_allclose(pose(client.read().tcp_pose), goal, atol=1e-3)
    # from there on, by the data sheet: the robot's own straight line ends at the goal all the same
    code = main(
        ["move", "--arm", "ur5e", "--to", NEAR, "--linear", "--robot", "127.0.0.1", "--ports", robot.ports, "--yes"]
    )
    assert code == 0
    with URClient("127.0.0.1", rtde_port=robot.rtde_port, script_port=robot.script_port) as client:
        assert pose_vector(pose(client.read().tcp_pose))[:3] == pytest.approx([-0.3, 0.4, 0.3], abs=5e-4)


@pytest.mark.slow
def test_nothing_is_sent_without_a_yes(robot, run, monkeypatch):
    for answer, code in (("n", 1), ("", 1), ("Y", 0)):
        monkeypatch.setattr("builtins.input", lambda _, answer=answer: answer)
        assert run("--to", GOAL, "--robot", "127.0.0.1", "--ports", robot.ports)[0] == code
        assert bool(robot.log) is (code == 0)

    def nobody(_):
        raise EOFError

    monkeypatch.setattr("builtins.input", nobody)
    code, _, err = run("--to", NEAR, "--robot", "127.0.0.1", "--ports", robot.ports)
    assert code == 2
    assert "give --yes" in err


@pytest.mark.slow
def test_what_fails_in_the_dry_run_is_not_sent(robot, run, monkeypatch):
    def through_everything(checker, start, goals, **_):
        return np.array([start, goals.q[0]])

    monkeypatch.setattr("kinreach.deploy._planning.plan_path", through_everything)
    code, _, err = run("--to", BELOW, "--robot", "127.0.0.1", "--ports", robot.ports, "--yes")
    assert code == 2
    assert "the dry run did not come to its end, nothing is sent: collision: " in err
    assert robot.log == []


def test_another_arm_is_recognised(robot, capsys):
    for flags, reason in (
        (["--arm", "ur3e"], r"not this UR3E.*another model"),
        (["--arm", "ur5e", "--calibration", str(ROOT / "tests/data/calibrations/controller_calibration_ur5e.conf")],
         r"another calibration"),
    ):  # fmt: skip
        assert main(["move", *flags, "--to", NEAR, "--robot", "127.0.0.1", "--ports", robot.ports, "--yes"]) == 2
        assert re.search(reason, capsys.readouterr().err)
    assert robot.log == []


@pytest.mark.parametrize("given", [[], ["--tool", "0,0,0.12,0,0,0"], ["--tool", "0,0,0.15,0,0.1,0"]])
def test_another_tool_than_the_robots_is_refused(given, run):
    arm = ARM.with_tool([0, 0, 0.15, 0, 0, 0])
    with SimulatedUR(arm, rtde_port=0, script_port=0, log=(log := []).append) as robot:
        ports = f"{robot.rtde_port},{robot.script_port}"
        code, out, err = run("--to", GOAL, "--robot", "127.0.0.1", "--ports", ports, "--yes", *given)
    assert (code, out, log) == (2, "", [])
    mine = given[1] if given else "0,0,0,0,0,0"
    assert f"the TCP of the robot at 127.0.0.1 is 0,0,0.15,0,0,0; kinreach's tool is {mine}. Give --tool" in err


def test_a_robot_without_a_tcp_offset_is_compared_by_the_pose_of_its_tool():
    with (
        SimulatedUR(ARM, rtde_port=0, script_port=0) as robot,
        URClient("127.0.0.1", rtde_port=robot.rtde_port, script_port=robot.script_port) as client,
    ):
        state = replace(client.read(), tcp_offset=None)
    assert "is 0.00 mm" in Comparison(ARM).same_arm(state, None, "old")
    with pytest.raises(RobotError, match=r"150\.00 mm and 0\.00° from"):
        Comparison(ARM.with_tool([0, 0, 0.15, 0, 0, 0])).same_arm(state, None, "old")


def scripted(text):
    return lambda robot, other: other.send(text)


#: What happens while the question is read, by another client or at the robot; how its state shows that; and why nothing
#: is sent then.
MEANWHILE = {
    "it moved": (
        scripted(f"movej({[*HOME[:5].tolist(), 0.3]}, a=5, v=2)\n"),
        lambda state: state.runtime_state == 1 and state.actual_q[5] > 0.299,
        "does not stand where the program begins: wrist_3_joint is 0.3",
    ),
    "another TCP": (
        scripted("set_tcp(p[0, 0, 0.1, 0, 0, 0])\n"),
        lambda state: state.runtime_state == 1 and state.tcp_offset[2] > 0.05,
        "the TCP of the robot at 127.0.0.1 is 0,0,0.1,0,0,0; kinreach's tool is 0,0,0,0,0,0",
    ),
    "a program runs": (
        scripted("def other():\n  sleep(3000)\nend\n"),
        lambda state: state.runtime_state == 2,
        "runs a program already; end that one first",
    ),
    "a stop": (
        lambda robot, _: robot.emergency_stop(), lambda state: state.safety_mode == 7, "is not ready: robot emergency"
    ),
    "another mode": (
        lambda robot, _: robot.report("robot_mode", [5]), lambda state: state.robot_mode == 5, "is not ready: idle"
    ),
    "NaN": (
        lambda robot, _: robot.report("actual_q", [np.nan] * 6), lambda state: np.isnan(state.actual_q[0]),
        "is not ready: it reports NaN",
    ),
    "another arm": (
        lambda robot, _: robot.report("actual_TCP_pose", [0.3, 0.2, 0.5, 0, 0, 0]),
        lambda state: state.tcp_pose[0] == 0.3, "is not this UR5E",
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", MEANWHILE)
@pytest.mark.slow
def test_what_changes_while_the_question_is_read_is_judged_again(robot, run, monkeypatch, what):
    """In the cycle before sending, by a state that is newer than the answer."""
    happen, shows, reason = MEANWHILE[what]

    def answer(_):
        with URClient("127.0.0.1", rtde_port=robot.rtde_port, script_port=robot.script_port) as other:
            happen(robot, other)
            while not shows(other.read()):
                pass
        robot.log.clear()
        return "y"

    monkeypatch.setattr("builtins.input", answer)
    code, out, err = run("--to", GOAL, "--robot", "127.0.0.1", "--ports", robot.ports)
    assert code == 2
    assert reason in err
    assert len(err.splitlines()) == 1
    assert "dry run" in out
    assert robot.log == []


@pytest.mark.slow
def test_another_model_is_not_moved_even_where_its_tool_is_at_the_same_place(capsys):
    """By its own figures; where the robot does not say them, by the program, which asks the robot before it moves."""
    rng, (mine, theirs) = np.random.default_rng(8), (ArmKinematics(name, base="base") for name in ("ur16e", "ur18"))
    free, there = (CollisionChecker(kin, margin=0.006) for kin in (mine, theirs))
    q = next(
        q for q in rng.uniform(-2.5, 2.5, (3000, 6))
        if np.linalg.norm(mine.fk(q)[:3, 3] - theirs.fk(q)[:3, 3]) < 0.018 and free.free(q) and there.free(q)
    )  # fmt: skip
    near = ",".join(f"{number:.6f}" for number in pose_vector(mine.fk(q + 0.05)))
    for says, reason in ((True, "figures are nearest to those of a ur18"), (False, "the robot at .* did not move")):
        with SimulatedUR("ur18", q=q.tolist(), rtde_port=0, script_port=0, speed=8.0) as robot:
            robot.greeting = robot.greeting if says else b""
            ports = f"{robot.rtde_port},{robot.script_port}"
            flags = ["--arm", "ur16e", "--no-cell", "--to", near, "--robot", robot.address, "--ports", ports, "--yes"]
            code = main(["move", *flags])
            said = capsys.readouterr()
            assert code == 2
            assert re.search(reason, said.err), said
            assert np.abs(robot.controller.target_q - q).max() < 1e-9


@pytest.mark.slow
def test_a_recording_that_was_cut_says_so(robot, run):
    publish = robot._publish

    def sometimes():
        if robot.controller.runtime_state != 2 or round(robot.controller.time / 0.002) % 20:
            publish()

    robot._publish = sometimes
    code, out, _ = run("--to", GOAL, "--robot", "127.0.0.1", "--ports", robot.ports, "--yes")
    assert code == 0
    found = re.search(r"the recording is cut: (\d+) of (\d+) control cycles were not received", out)
    assert 0.02 < int(found[1]) / int(found[2]) < 0.2


def test_cycles_that_are_missing_are_said_if_there_are_any(capsys):
    received, rng = 200, np.random.default_rng(0)
    q = rng.uniform(-1.0, 1.0, (received, 6))
    trajectory = SimpleNamespace(t=np.arange(received) * 0.002, q=q, duration=0.4)
    motion = SimpleNamespace(program=None, miss=lambda T: "0.00 mm")
    for missing in (0, 1, 7):
        done = SimpleNamespace(measured=trajectory, commanded=trajectory, missing=missing)
        robot = SimpleNamespace(
            run=lambda program, check, done=done: done, read=lambda: SimpleNamespace(tcp_pose=np.zeros(6))
        )
        assert _moved(robot, motion, None) == 0
        out = capsys.readouterr().out
        assert "moved    0.40 s; joints at most 0.0 mrad" in out
        said = f"the recording is cut: {missing} of {received + missing} control cycles were not received"
        assert (said in out) == ("recording" in out) == (missing > 0)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_the_robot(number, free_address):
    """In a process, as from a terminal; the robot decelerates and stands before the command ends."""
    address = free_address()
    with SimulatedUR(ARM, address=address, log=(log := []).append) as robot:
        process = subprocess.Popen(
            [sys.executable, "-m", "kinreach", "move", "--arm", "ur5e", "--calibration", str(CALIBRATION), "--to",
             "0.3,-0.3,0.3,3.14,0,0", "--robot", address, "--yes", "--speed", "0.1"],
            env={**os.environ, "PYTHONPATH": str(ROOT)}, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        deadline = time.monotonic() + 120
        while np.abs(robot.controller.target_qd).max() < 0.2 and time.monotonic() < deadline:
            time.sleep(0.01)
        for _ in range(5):  # the first one stops it, and no further one ends that
            process.send_signal(number)
        _, err = process.communicate(timeout=60)
        assert process.returncode == 130
        assert err.splitlines() == ["python -m kinreach move: stopped; the robot stands"]
        assert "program kinreach_stop is running" in log
        assert not robot.controller.target_qd.any()
        assert np.abs(robot.controller.target_q - HOME).max() < 1.0
    assert threading.active_count() < 10
