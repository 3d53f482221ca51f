"""What a program commands is known before it runs: it is what the controller commands, and is judged in every move."""

import re
from dataclasses import replace

import numpy as np
import pytest

from kinreach.deploy import Move, Program
from kinreach.deploy._commanded import commanded
from kinreach.deploy._controller import Controller, rate_of, tcp_of
from kinreach.deploy._motion import LineError, StraightLine
from kinreach.deploy._program import motion_of
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, Trajectory, pose, pose_vector
from kinreach.robots import Workcell, get_arm
from kinreach.robots.inside import JOINTS

ARM = replace(get_arm("ur5e").with_tool([0, 0.01, 0.15, 0.1, 0, 0]), workcell=Workcell())
KIN = ArmKinematics.of(ARM, base="base")
HOME = np.array(ARM.home)
TCP = tcp_of(ARM)
#: Joints whose zero is a singularity of a UR's wrist and elbow.
WRIST_2, ELBOW = 4, 2


def some_moves(rng, kin, count, *, start=HOME, blend=0.0):
    """Moves of both kinds, one after the other, at two thirds of the slowest joint's speed and up to 1 m/s."""
    q, moves, fastest = start, [], float(kin.velocity_limit.min()) / 1.5
    for number in range(count):
        goal = start + rng.uniform(-0.5, 0.5, 6)
        radius = blend if number < count - 1 else 0.0
        if number % 2 == 0:
            moves.append(Move("movej", tuple(goal), fastest, rng.uniform(2.0, 8.0), radius))
        else:
            target = pose_vector(kin.fk(q) @ pose([*rng.uniform(-0.25, 0.25, 3), *rng.uniform(-0.6, 0.6, 3)]))
            moves.append(Move("movel", tuple(target), rng.uniform(0.1, 0.7), rng.uniform(1.0, 5.0), radius))
            goal = kin.nearest(pose(target), q).q
        q = goal
    return moves


@pytest.mark.slow
def test_it_is_what_the_controller_commands(monkeypatch):
    monkeypatch.setattr("kinreach.deploy._commanded.SAMPLES", 10**6)
    ur, rng, tried = Controller(ARM), np.random.default_rng(1), {0.0: 0, 0.05: 0}
    while min(tried.values()) < 1:
        blend = min(tried, key=tried.get)
        try:
            program = Program.of(KIN, HOME, some_moves(rng, KIN, 3, blend=blend))
        except InputError:
            continue
        motion = motion_of(program, ARM)
        ur.place(HOME)
        done = ur.run(program.text)
        if done.reason:
            assert "collision" in done.reason
            continue
        rows = done.commanded.q[np.flatnonzero((done.commanded.q != HOME).any(axis=1))[0] - 1 :]
        # a controller takes a cycle more at each stop
        kept = np.append(True, (np.diff(rows, axis=0) != 0.0).any(axis=1))
        np.testing.assert_allclose(
            rows[kept], motion.q[np.append(True, np.diff(motion.q, axis=0).any(axis=1))], atol=1e-12
        )
        np.testing.assert_allclose(motion.waypoints[-1], done.commanded.q[-1], atol=1e-9)
        for number, move in enumerate(program.moves):
            stops = move.blend == 0.0
            assert np.allclose(motion.q[motion.ended[number]], motion.waypoints[number + 1], atol=1e-9) is stops
            assert (number == 2 or motion.began[number + 1] <= motion.ended[number]) is not (stops and number < 2)
        tried[blend] += 1


@pytest.mark.slow
def test_a_slow_move_has_no_more_samples_than_it_needs():
    lower = pose_vector(KIN.fk(HOME)) - [0, 0, 0.1, 0, 0, 0]
    quick, creeping = (
        motion_of(Program.of(KIN, HOME, [Move("movel", lower, speed, 1.2)]), ARM) for speed in (0.25, 0.002)
    )
    assert 990 <= len(creeping.q) <= 2010
    np.testing.assert_allclose(creeping.waypoints, quick.waypoints, atol=1e-9)
    assert len(quick.q) < 400


@pytest.mark.parametrize("model", ["ur10e", "ur5e", "ur20"])
@pytest.mark.slow
def test_a_straight_move_is_refused_just_where_a_joint_is_too_fast(model):
    """By differences of the angles; alone, and while the next move begins."""
    arm = get_arm(model)
    kin, flange = ArmKinematics.of(arm, tip="tool0", base="base"), ArmKinematics(arm, tip="tool0", base="base")
    cycle, limit = 1.0 / rate_of(arm), kin.velocity_limit
    rng, verdicts = np.random.default_rng(3), {True: 0, False: 0}
    for case in range(60):
        if min(verdicts.values()) == 1:
            break
        start = rng.uniform(-2.0, 2.0, 6)
        start[WRIST_2] = rng.choice([-1, 1]) * rng.uniform(0.08, 0.3)  # near a singularity, where joints are fast
        target = pose_vector(kin.fk(start) @ pose([*rng.uniform(-0.2, 0.2, 3), *rng.uniform(-0.1, 0.1, 3)]))
        try:
            once = commanded(flange, np.eye(4), start, [Move("movel", target, 0.4, 5.0)], cycle)
        except InputError:  # out of reach, or past a singularity
            continue
        share = (np.abs(once.qd) / limit).max()
        radius = 0.01 * (case % 2)
        back = Move("movej", tuple(once.waypoints[-1] + 0.1), 0.1, 1.0)
        for factor, refused in ((0.85, False), (1.2, True)):
            if (speed := 0.4 * factor / share) > 1.0:
                continue
            moves = [Move("movel", target, speed, 5.0, radius), back]
            shares = np.abs(np.diff(commanded(flange, np.eye(4), start, moves, cycle).q, axis=0)) / cycle / limit
            if refused and shares.max() < 1.05:  # too short a way to be so fast on it
                continue
            if refused:
                with pytest.raises(InputError, match=r"move 1 moves .* above its limit") as caught:
                    Program.of(kin, start, moves)
                joint = re.search(r"moves (\w+) at", str(caught.value))[1]
                assert shares[:, JOINTS.index(joint)].max() > 1.0
            elif shares.max() < 1.0:
                assert Program.of(kin, start, moves).moves == tuple(moves)
            verdicts[refused] += 1
    assert min(verdicts.values()) >= 1, verdicts


def test_two_joint_moves_may_be_too_fast_together():
    """The first slows down while the second speeds up; each alone, or one after the other, is not too fast."""
    moves = [
        Move("movej", tuple(HOME + 0.8 * np.eye(6)[0]), 2.5, 4.0, 0.3),
        Move("movej", tuple(HOME + 1.8 * np.eye(6)[0]), 2.5, 10.0),
    ]
    stopping = [replace(moves[0], blend=0.0), moves[1]]
    assert Program.of(KIN, HOME, stopping).moves == tuple(stopping)
    with pytest.raises(InputError, match=r"move 2 moves shoulder_pan_joint at 3\.\d+ .* limit of 3\.14") as refused:
        Program.of(KIN, HOME, moves)
    fastest = float(re.search(r"at (\S+) rad/s", str(refused.value))[1])
    assert fastest == pytest.approx(motion_of(Program(HOME, pose_vector(TCP), moves), ARM).qd[:, 0].max(), rel=0.01)
    slower = [replace(move, speed=1.2) for move in moves]
    assert Program.of(KIN, HOME, slower).moves == tuple(slower)


@pytest.mark.parametrize("swung", [True, False])
@pytest.mark.slow
def test_the_simulated_robot_agrees(swung):
    """A straight line past the axis of the first joint, too fast and slow enough."""
    start = np.array([0.0, -2.4, 2.2, -1.4, -1.6, 0.0])
    target = KIN.fk(start)
    target[:3, 3] += [0, 0.3, 0]
    line = Move("movel", pose_vector(target), 0.9 if swung else 0.1, 5.0)
    if swung:
        with pytest.raises(InputError, match=r"move 1 moves shoulder_pan_joint .*; give a lower speed"):
            Program.of(KIN, start, [line])
        reason = Controller(ARM, q=start).run(Program(start, pose_vector(TCP), (line,)).text).reason
        assert "joint speed: shoulder_pan_joint" in reason
    else:
        assert Controller(ARM, q=start).run(Program.of(KIN, start, [line]).text).reason == ""


def test_a_joint_move_after_a_straight_one_is_judged_from_where_that_ends():
    """The base of a UR10e turns at 2.09 rad/s, its wrist at 3.14 rad/s."""
    kin = ArmKinematics.of("ur10e", base="base")
    home = np.array(kin.arm.home)
    line = Move("movel", tuple(pose_vector(kin.fk(home)) - [0, 0, 0.1, 0, 0, 0]), 0.25, 1.2)
    below = motion_of(Program.of(kin, home, [line]), kin.arm).waypoints[-1]
    with pytest.raises(InputError, match=r"move 2 moves shoulder_pan_joint at 3 rad/s, above its limit of 2\.09"):
        Program.of(kin, home, [line, Move("movej", tuple(below + np.eye(6)[0]), 3.0, 1.0)])
    assert Program.of(kin, home, [line, Move("movej", tuple(below + np.eye(6)[5]), 3.0, 1.0)]).moves


@pytest.mark.parametrize("joint", range(6))
def test_moves_and_trajectories_beyond_a_limit_are_refused(joint):
    tight = ARM.with_limits({name: (low, high) for name, low, high in zip(JOINTS, HOME - 0.3, HOME + 0.2, strict=True)})
    kin = ArmKinematics(tight, base="base")
    for off in (-0.31, 0.21):
        goal = HOME + off * np.eye(6)[joint]
        share = np.linspace(0, 1, 200)[:, None]
        swing = Trajectory(JOINTS, np.linspace(0, 1, 200), HOME + share * (goal - HOME), np.zeros((200, 6)))
        two = [Move("movej", HOME + 0.1, 0.5, 1.0), Move("movej", goal, 0.5, 1.0)]
        for motion, what in ((two, "move 2"), (swing, "the trajectory")):
            wanted = rf"{what} turns {JOINTS[joint]} to {goal[joint]:.3f} rad, outside its limits of"
            with pytest.raises(InputError, match=wanted):
                Program.of(kin, HOME, motion)
    for limit in (HOME - 0.3, HOME + 0.2):
        assert Program.of(kin, HOME, [Move("movej", limit, 0.5, 1.0)]).moves


@pytest.mark.parametrize("model", ["ur5e", "ur10e", "ur3e", "ur20"])
@pytest.mark.slow
def test_a_straight_move_through_an_exact_singularity_keeps_its_branch_or_is_refused(model):
    arm = get_arm(model)
    kin = ArmKinematics.of(arm, tip="tool0", base="base")
    rng, refused, through = np.random.default_rng(11), 0, 0
    for case in range(20):
        middle = rng.uniform(-2.0, 2.0, 6)
        middle[WRIST_2 if case % 3 else ELBOW] = 0.0
        way = np.array([*rng.uniform(-0.05, 0.05, 3), *rng.uniform(-0.2, 0.2, 3)])
        here, there = (kin.fk(middle) @ pose(part) for part in (-way, way))
        for start in kin.all_solutions(here, seed=middle, limits=False).q[:2]:
            before = kin.all_solutions(here, seed=start, limits=False).branch[0]
            try:
                end = StraightLine(kin, np.eye(4), start, there, 0.1, 1.0).end
            except LineError as error:
                refused += "singularity" in str(error)
                with pytest.raises(InputError, match=r"move 1: the straight line .*singularity"):
                    Program.of(kin, start, [Move("movel", pose_vector(there), 0.1, 1.0)])
                continue
            after = kin.all_solutions(there, seed=end, limits=False)
            assert np.abs(after.q[0] - end).max() < 1e-6
            assert after.branch[0] == before
            through += 1
    assert refused > 12
    assert through >= 1
