"""The parts of `kinreach move`, one by one: its flags, its plan's moves and blends, and what it says of a motion."""

import re
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from kinreach.cli import Parser
from kinreach.deploy import Program, _moving, _planning
from kinreach.deploy._controller import FINISHED
from kinreach.deploy._moving import MotionFlags, MotionPlanner, TriedMotion
from kinreach.deploy._planning import Leg, plan, planned_program
from kinreach.deploy._program import Move
from kinreach.errors import InputError, PathError
from kinreach.kinematics import ArmKinematics, CollisionChecker, Trajectory, pose, pose_vector
from kinreach.robots import Box, Obstacle, Tool, Workcell, get_arm
from tests.deploy.conftest import CALIBRATION

ARM = get_arm("ur5e").calibrated(CALIBRATION)
KIN = ArmKinematics.of(ARM, base="base")
HOME = np.array(ARM.home)


@pytest.fixture(scope="module")
def checker():
    return CollisionChecker(KIN, margin=0.005)


def parsed(words):
    parser = Parser(prog="move")
    MotionFlags.add_to(parser)
    return MotionFlags.of(parser.parse_args(words))


def listed(numbers):
    return ",".join(map(str, np.asarray(numbers).round(4).tolist()))


def random_flags(rng):
    given = {
        "to": tuple(listed(rng.uniform(-0.5, 0.5, 6)) for _ in range(rng.integers(1, 4))),
        "start": listed(rng.uniform(-1.0, 1.0, 6)), "degrees": True, "branch": "right, up", "linear": True,
        "max_travel": f"{rng.uniform(0.1, 3.0):.3f}", "speed": float(rng.uniform(0.1, 1.0)),
        "blend": float(rng.uniform(0.001, 0.1)), "table": "-0.1", "cell": False,
        "boxes": tuple(listed(rng.uniform(0.1, 0.5, 6)) for _ in range(2)), "meshes": ("a.stl", "b.stl@1,0,0,0,0,0"),
        "mesh_scale": 0.001,
    }  # fmt: skip
    kept = {"to", *(name for name in given if rng.random() < 0.5)}
    return MotionFlags(**{name: value for name, value in given.items() if name in kept}), kept


def test_flags_as_words_are_read_as_the_same_flags():
    rng, seen = np.random.default_rng(0), []
    for _ in range(30):
        flags, kept = random_flags(rng)
        assert parsed(flags.words) == flags
        seen += kept
        plain = MotionFlags(flags.to)
        assert plain.words == [word for goal in flags.to for word in ("--to", goal)]
        assert replace(plain, start="home").words == plain.words
    assert min(seen.count(name) for name in set(seen)) >= 8
    assert len(set(seen)) == 13


def test_flags_that_start_at_a_posture_have_it_to_the_last_bit_and_in_radians():
    rng, in_degrees, limited = np.random.default_rng(1), 0, 0
    for _ in range(20):
        flags, _ = random_flags(rng)
        q = rng.uniform(-1.0, 1.0, 6)
        started = flags.starting_at(q)
        np.testing.assert_array_equal(started.posture(KIN), q)
        np.testing.assert_array_equal(parsed(started.words).posture(KIN), q)
        most = None if flags.max_travel is None else float(flags.max_travel) * (np.pi / 180 if flags.degrees else 1.0)
        assert started.most_turn == (None if most is None else pytest.approx(most, rel=1e-12))
        unchanged = {"start": None, "degrees": False, "max_travel": None}
        assert replace(started, **unchanged) == replace(flags, **unchanged)
        in_degrees, limited = in_degrees + (flags.degrees and most is not None), limited + (most is not None)
    assert limited > in_degrees >= 3
    np.testing.assert_array_equal(MotionFlags(("0,0,0,0,0,0",), "home").posture(KIN), HOME)


def move(target, blend=0.0, speed=0.5, command="movej"):
    return Move(command, tuple(target), speed, 1.2, blend)


def leg(travels=(0.1,) * 6, branch=6, before=6, **more):
    given = {"moves": (move(HOME),), "end": HOME, "free": 5, "postures": 8, **more}
    return Leg(branch=branch, before=before, travels=np.array(travels), **given)


def tried(legs, status=FINISHED, reason="", q=None, goals=(), meshes=(), kin=KIN, shapes=None):
    q = np.array([HOME, HOME + 0.01, HOME + 0.03]) if q is None else q
    qd = np.array([[0.0] * 6, [0.1, -0.5, 0.2, 0.0, 0.0, 0.0], [0.4, 0.2, -0.3, 0.0, 0.0, 0.0]])
    t = 0.1 * np.arange(len(q))
    run = Trajectory(ARM.joints, t, q, qd[: len(q)])
    done = SimpleNamespace(commanded=run, measured=run, status=status, reason=reason)
    return TriedMotion(kin, shapes, HOME, goals, legs, None, done, meshes)


def test_a_plan_is_said_leg_by_leg():
    corner = (move(HOME, 0.02, 0.3), move(HOME + 0.1, 0.04, 0.4), move(HOME + 0.2, 0.0, 0.25))
    line = (move(pose_vector(KIN.fk(HOME)), 0.0, 0.5, "movel"),)
    legs = [
        leg(np.radians([10, 20, 130, 5, 0, 0]), moves=corner, end=HOME + 0.2, reduced=0.05),
        leg(np.radians([0, 0, 3, 0, 0, 0]), branch=-1, moves=line, free=2, postures=4),
    ]
    motion = tried(legs)
    ways = [
        "branch 6 (right, up, straight), 5 of 8 postures free; 3 x movej, 0.25 rad/s, blend 40 mm (reduced from 50 mm, "
        "to keep 5 mm from everything); a joint turns by 130° at most",
        "no branch of the closed form, 2 of 4 postures free; movel, 0.50 m/s; a joint turns by 3° at most",
    ]
    assert motion.ways == ways
    first, start, *rest = motion.plan
    assert first == "UR5E, calibrated by ur5e_a.yaml: tip tool0 in base, degrees"
    assert start.split()[0] == "from"
    np.testing.assert_allclose([float(word) for word in start.split()[1:]], np.degrees(HOME), atol=0.051)
    assert len(rest) == 2
    for said, one, way in zip(rest, legs, ways, strict=True):
        angles, below = said.split("\n")
        assert below == f"         {way}"
        assert angles.split()[0] == "to"
        np.testing.assert_allclose([float(word) for word in angles.split()[1:]], np.degrees(one.end), atol=0.051)
    np.testing.assert_allclose(motion.shares, [0.4, 0.5, 0.3, 0, 0, 0] / KIN.velocity_limit)


@pytest.mark.parametrize(("legs", "said"), [
    ([leg()], []),
    ([leg([0, 0, 3.14, 0, 0, 0])], []),
    ([leg([0, 0, 3.5, 3.2, 0, 0])], ["elbow turns by 201°, more than half a turn"]),
    ([leg(branch=4)], ["the arm leaves its branch: from 6 (right, up, straight) to 4 (right, up, flipped)"]),
    ([leg(branch=-1), leg(before=-1)], []),
    ([leg(), leg([0, 0, 0, 0, 0, 4.0], branch=6, before=0)],
     ["to goal 2 wrist_3 turns by 229°, more than half a turn",
      "to goal 2 the arm leaves its branch: from 0 (left, down, flipped) to 6 (right, up, straight)"]),
    ([leg(branch=0, before=6)], ["the arm leaves its branch: from 6 (right, up, straight) to 0 (left, down, flipped)"]),
])  # fmt: skip
def test_long_turns_and_other_branches_are_cautions(legs, said):
    assert tried(legs).cautions == said


def test_a_dry_run_is_described_and_has_to_finish():
    goal, obstacle = KIN.fk(HOME + 0.03) @ pose(np.array([0.0, 0.003, 0.004, 0.0, 0.0, 0.1])), Obstacle("part", "x.stl")
    motion = tried([], goals=[np.eye(4), goal], meshes=[obstacle], shapes=CollisionChecker(KIN))
    lines = list(motion.dry_run)
    assert re.match(r"dry run  0.20 s; shoulder_lift at most 0.50 rad/s, 16 % of its limit; tool at most", lines[0])
    assert lines[1:] == [
        "         no collision with itself, table, floor, part",
        "         every way keeps 5 mm from everything",
        "         ends 5.00 mm and 5.73° from the goal",
    ]
    tool = ArmKinematics.of(ARM.with_tool([0, 0, 0.1, 0, 0, 0]), base="base")
    motion = tried([], goals=[goal], kin=tool, shapes=CollisionChecker(tool))
    assert any("the tool has no shape, so it cannot collide" in line for line in motion.dry_run)
    motion.check_finished()
    for status, reason in ((FINISHED, "collision: a"), (1, "it stands"), (1, "")):
        with pytest.raises(InputError, match=f"did not come to its end, nothing is sent: {reason}$"):
            tried([], status, reason).check_finished()


@pytest.mark.parametrize(("sample", "above"), [(0, 0.0), (2, 0.0), (4, 0.0), (2, 0.5)])
def test_a_simulated_run_that_touches_a_mesh_is_refused(sample, above, tmp_path):
    """Wherever along it the mesh is; one that is 0.5 m above is not touched."""
    file = tmp_path / "cube.stl"
    trimesh.creation.box((100.0, 100.0, 100.0)).export(file)
    q = HOME + np.linspace(0.0, 0.8, 5)[:, None] * [1, 0, 0, 0, 0, 0]
    x, y, z = (KIN.T_world_base @ KIN.fk(q[sample]))[:3, 3]
    block = Obstacle("block", str(file), [x, y, z + above, 0, 0, 0], 0.001)
    planner = MotionPlanner(ARM, [], linear=False, speed=0.25, blend=0.0, meshes=[block])
    done = SimpleNamespace(measured=SimpleNamespace(q=q))
    if above:
        planner._check_meshes(done)
        return
    with pytest.raises(InputError, match=r"keep free, nothing is sent: collision: (block - \w+|\w+ - block)$"):
        planner._check_meshes(done)
    planner.meshes = []
    planner._check_meshes(done)


@pytest.mark.parametrize(("gap", "status", "reason", "refused"), [
    (0.003, FINISHED, "", True), (0.012, FINISHED, "", False), (0.003, FINISHED, "collision", False),
    (0.003, 1, "", False),
])  # fmt: skip
def test_a_finished_run_that_comes_too_near_is_refused(monkeypatch, gap, status, reason, refused):
    """By what was commanded; one that did not finish is refused later, with its own reason."""
    arm = ARM.with_tool(Tool.tube([0, 0, 0.15, 0, 0, 0], 0.01))
    kin = ArmKinematics.of(arm, base="base")
    x, y, z = (kin.T_world_base @ kin.fk(HOME))[:3, 3]
    low = Box("low", (0.1, 0.1, 0.1), (x, y, z - 0.05 - gap))  # below the tip, which points down
    arm = replace(arm, workcell=Workcell((low,)))
    q = np.array([HOME, np.add(HOME, [0, 0, 0, 0, 0, 0.1])])
    run = Trajectory(ARM.joints, np.array([0.0, 0.1]), q, np.zeros((2, 6)))
    done = SimpleNamespace(commanded=run, measured=run, status=status, reason=reason)

    class Simulated:
        def __init__(self, arm, *, q):
            assert q == HOME.tolist()

        def run(self, text):
            assert text == "the program"
            return done

    program = SimpleNamespace(text="the program")
    monkeypatch.setattr(_moving, "planned_program", lambda *given, **more: (["a leg"], program))
    monkeypatch.setattr(_moving, "Controller", Simulated)
    planner = MotionPlanner(arm, ["a goal"], linear=False, speed=0.25, blend=0.0)
    if refused:
        with pytest.raises(InputError, match=r"the dry run comes too near to something, nothing is sent: .*low"):
            planner.tried(HOME)
        return
    motion = planner.tried(HOME)
    assert (motion.program, motion.done, motion.legs, motion.goals) == (program, done, ["a leg"], ["a goal"])
    assert motion.start is HOME


def test_a_sample_belongs_to_the_last_corner_that_is_blended_there():
    moves = [move(HOME, blend) for blend in (0.1, 0.0, 0.2, 0.3)]
    motion = SimpleNamespace(began=(1, 10, 20, 30), ended=(12, 20, 33, 40))
    found = [_planning._corner(moves, motion, index) for index in range(41)]
    assert found == [None] * 9 + [0] * 4 + [None] * 16 + [2] * 5 + [None] * 7
    motion.ended = (30, 31, 33, 40)
    assert [_planning._corner(moves, motion, index) for index in (28, 29, 30, 31)] == [0, 2, 2, 2]


@pytest.mark.parametrize(("free", "left", "tries"), [
    (0.06, 0.05, 1), (0.05, 0.05, 1), (0.04, 0.035, 2), (0.03, 0.0245, 3), (0.001, 0.0, 12), (1e-4, 0.0, 12),
])  # fmt: skip
def test_a_radius_is_reduced_until_its_corner_keeps_the_distance(monkeypatch, free, left, tries):
    """To 70 % of it each time, and to a stop below 1 mm; the other corners stay as they are."""
    tried_radii = []

    def touches(checker, q, *, keeps):
        assert (checker, keeps) == ("checker", 0.005)
        tried_radii.append(q)
        if q > free:
            raise PathError("collision", index=17)

    def commanded(program, arm):
        assert arm is ARM
        return SimpleNamespace(q=program.moves[1].blend, began=(1, 5, 15), ended=(9, 18, 30))

    monkeypatch.setattr(_planning, "motion_of", commanded)
    monkeypatch.setattr(_planning, "joint_line", touches)
    moves = (move(HOME + 0.1, 0.02), move(HOME + 0.2, 0.05), move(HOME))
    program = Program(tuple(HOME), (0.0,) * 6, moves)
    kept = _planning._kept(program, KIN, "checker", 0.005)
    assert [each.blend for each in kept.moves] == [0.02, pytest.approx(left, abs=1e-12), 0.0]
    assert len(tried_radii) == tries
    positive = [radius for radius in tried_radii if radius]
    np.testing.assert_allclose([after / before for before, after in pairwise(positive)], 0.7, atol=1e-4)
    assert replace(kept, moves=moves) == program
    before = leg(moves=moves, reduced=0.0)
    assert _planning._with_moves(before, kept.moves).reduced == (0.05 if tries > 1 else 0.0)
    assert _planning._with_moves(before, kept.moves).moves == kept.moves


def test_a_motion_that_touches_at_no_corner_is_left_to_the_dry_run(monkeypatch):
    def touches(checker, q, *, keeps):
        raise PathError("collision", index=12)

    motion = SimpleNamespace(q=None, began=(1, 5, 15), ended=(9, 18, 30))
    monkeypatch.setattr(_planning, "motion_of", lambda program, arm: motion)
    monkeypatch.setattr(_planning, "joint_line", touches)
    program = Program(tuple(HOME), (0.0,) * 6, (move(HOME + 0.1, 0.02), move(HOME + 0.2, 0.05), move(HOME)))
    assert _planning._kept(program, KIN, None, 0.005) is program


def test_a_start_is_as_exact_as_the_room_around_it(checker):
    distance, reach = checker.distance(HOME).distance, float(checker.reach.sum())
    for room, tolerance in ((6e-4, 5e-4), (4.2e-4, 4.2e-4), (2.555e-4, 2.55e-4)):
        found = _planning._tolerance(checker, HOME, distance - room * reach)
        assert found == pytest.approx(tolerance, abs=1.1e-6)
        assert found <= room
    with pytest.raises(PathError, match=r"the start is too near: .* mm apart; with .* mm a program") as refused:
        _planning._tolerance(checker, HOME, distance - 2.4e-4 * reach)
    np.testing.assert_array_equal(refused.value.q, HOME)
    here, wanted = map(float, re.findall(r"(\d+\.\d+) mm", str(refused.value)))
    assert here == pytest.approx(1e3 * distance, abs=0.0051)
    assert wanted == pytest.approx(1e3 * (distance + 1e-5 * reach), abs=0.0051)


def test_moves_are_as_fast_as_the_slowest_joint_allows():
    rng, turned = np.random.default_rng(4), 0
    for _ in range(30):
        path, speeds, radii = rng.uniform(-1, 1, (4, 6)), rng.uniform(0.5, 3.0, 6), rng.uniform(0.0, 0.1, 3)
        path[:, rng.random(6) < 0.4] = 0.3
        path[2] = path[1] if rng.random() < 0.3 else path[2]
        moves = _planning._joint(path, speeds, radii)
        ways = np.abs(np.diff(path, axis=0))
        kept = ways.any(axis=1)
        if not kept.any():
            continue
        assert [each.blend for each in moves] == pytest.approx(radii[kept])
        for each, end, way in zip(moves, path[1:][kept], ways[kept], strict=True):
            np.testing.assert_allclose(each.target, end, atol=1e-7)
            assert (each.command, each.acceleration) == ("movej", 1.4)
            shares = each.speed * way / way.max() / speeds
            assert shares.max() == pytest.approx(1.0, abs=1e-5)
            turned += 1
    assert turned > 50
    (stays,) = _planning._joint(np.array([HOME, HOME]), np.array([3.0, 2.0, 4.0, 5.0, 3.0, 3.0]), [0.07])
    assert (stays.speed, stays.blend) == (2.0, 0.0)
    np.testing.assert_allclose(stays.target, HOME, atol=1e-7)


def test_radii_take_less_than_half_of_the_shorter_way():
    rng, limited = np.random.default_rng(5), 0
    for most in (0.02, 0.1, 0.3):
        path = HOME + rng.uniform(-0.4, 0.4, (6, 6))
        radii = _planning._radii(KIN, path, most)
        points = [KIN.fk(q)[:3, 3] for q in path]
        ways = [np.linalg.norm(after - before) for before, after in pairwise(points)]
        assert radii == pytest.approx([min(most, 0.45 * min(pair)) for pair in pairwise(ways)], abs=1e-7)
        limited += sum(radius < most for radius in radii)
    assert 3 <= limited <= 10


def test_lines_of_the_tool_end_in_their_goals_and_in_the_branch_of_the_start(checker):
    goals = [KIN.fk(HOME) @ pose(np.array([x, 0.01, 0.0, 0.0, 0.0, 0.02])) for x in (0.01, -0.02)]
    for branch in ("same", 6):
        legs = plan(KIN, checker, HOME, goals, linear=True, speed=0.4, blend=0.003, branch=branch)
        assert [(one.branch, one.before, one.postures) for one in legs] == [(6, 6, 8)] * 2
        for one, T, blend in zip(legs, goals, (0.003, 0.0), strict=True):
            np.testing.assert_allclose(KIN.fk(one.end), T, atol=1e-6)
            (line,) = one.moves
            assert (line.command, line.speed, line.acceleration, line.blend) == ("movel", 0.4, 1.2, blend)
            np.testing.assert_allclose(pose(np.array(line.target)), T, atol=1e-8)
        np.testing.assert_allclose(legs[0].travels, np.abs(legs[0].end - HOME), atol=1e-4)


def test_a_way_from_a_posture_of_no_branch_is_planned_unless_that_branch_is_wanted(monkeypatch, checker):
    def none(kin, q):
        raise InputError("the start is in no branch: it is singular")

    monkeypatch.setattr(_planning, "branch_of", none)
    (one,) = plan(KIN, checker, HOME, [KIN.fk(HOME + 0.02)])
    assert (one.before, one.branch) == (-1, 6)
    with pytest.raises(InputError, match="in no branch"):
        plan(KIN, checker, HOME, [KIN.fk(HOME + 0.02)], branch="same")


def test_ways_are_planned_rounded_first_and_then_with_stops(monkeypatch, checker):
    """With a blend in joint space; else, and where rounded ways cannot be, they stop at their waypoints."""
    asked, ends = [], [HOME + 0.01, HOME + 0.02]

    def planned(kin, checker, start, goals, *, rounded, **more):
        asked.append(rounded)
        if rounded and more["speed"] == 0.3:
            raise InputError("overlap")
        return [leg(moves=(move(q, more["blend"] if number == 0 else 0.0),)) for number, q in enumerate(ends)]

    monkeypatch.setattr(_planning, "plan", planned)
    monkeypatch.setattr(_planning, "joint_line", lambda *_, keeps: None)
    for linear, speed, blend, calls in (
        (False, 0.2, 0.004, [True]), (False, 0.3, 0.004, [True, False]), (False, 0.2, 0.0, [False]),
        (True, 0.2, 0.004, [False]),
    ):  # fmt: skip
        asked.clear()
        legs, program = planned_program(KIN, checker, HOME, [], keeps=0.0, linear=linear, speed=speed, blend=blend)
        assert asked == calls
        assert [one.moves for one in legs] == [(each,) for each in program.moves]
        assert [each.blend for each in program.moves] == [blend, 0.0]
        np.testing.assert_allclose(program.start, HOME)
        assert program.tolerance == 5e-4
