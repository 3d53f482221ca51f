"""Two clients of one robot: it runs one program, whose client is told so, and the other one is told what happened."""

import threading

import numpy as np
import pytest

from kinreach.deploy import Move, Program, SimulatedUR, _server
from kinreach.deploy._rtde import NOT_FOUND
from kinreach.errors import RobotError
from kinreach.kinematics import ArmKinematics, Trajectory, pose_vector
from kinreach.robots import get_arm
from kinreach.robots.inside import JOINTS
from tests.deploy.conftest import connected

ARM = get_arm("ur5e")
KIN = ArmKinematics.of(ARM, base="base")
HOME = np.array(ARM.home)
_text = Program.text_of_run


@pytest.fixture
def robot():
    log = []
    with SimulatedUR(ARM, rtde_port=0, script_port=0, speed=8.0, log=log.append) as served:
        served.log = log
        yield served


def to(change, start=HOME, speed=2.0):
    goal = np.add(start, change * np.eye(6)[0])
    return Program.of(KIN, start, [Move("movej", goal, speed, 5.0)]), goal


def both(robot, programs):
    """Let two clients judge the robot, and then send: what each run ended with."""
    ready, ends = threading.Barrier(2), {}

    def go(client, program):
        try:
            ends[program] = client.run(program, check=lambda state: ready.wait(30.0))
        except RobotError as error:
            ends[program] = error

    with connected(robot) as one, connected(robot) as other:
        threads = [threading.Thread(target=go, args=pair) for pair in zip((one, other), programs, strict=True)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    return [ends[program] for program in programs]


def without(monkeypatch, *unknown):
    """A controller that is too old for some variables."""
    known = _server.type_of

    def type_of(name, **inputs):
        return NOT_FOUND if name in unknown else known(name, **inputs)

    monkeypatch.setattr(_server, "type_of", type_of)


@pytest.mark.parametrize("old", [False, True])
@pytest.mark.slow
def test_of_two_programs_at_the_same_moment_one_runs_and_the_other_is_told(robot, monkeypatch, old):
    """By the number of the run; by an old controller, which shows none, by the program's name.

    On a busy machine a program may come when the other one has moved the arm: then both are told so, and it is tried
    again.
    """
    if old:
        without(monkeypatch, "output_int_register_24", "output_int_register_25")
    won, start = [], HOME
    for turn in range(6):
        (left, at_left), (right, at_right) = (to(change, start) for change in (0.4, -0.4))
        ends = both(robot, [left, right])
        failed = [isinstance(end, RobotError) for end in ends]
        if all(failed) and any("it does not stand where the program begins" in str(end) for end in ends):
            assert any("which ended this one" in str(end) for end in ends), ends
            with connected(robot) as watch:
                start = watch.read().actual_q
            continue
        assert sorted(failed) == [False, True], (turn, ends)
        winner, loser = (ends[failed.index(flag)] for flag in (False, True))
        goal = (at_left, at_right)[failed.index(False)]
        np.testing.assert_allclose(winner.measured.q[-1], goal, atol=1e-3)
        assert "another" in str(loser)
        assert "; the arm is at " in str(loser)
        assert str(loser).endswith(" degrees")
        with connected(robot) as watch:
            start = watch.read().actual_q
            np.testing.assert_allclose(start, goal, atol=1e-3)
        won.append(failed.index(False))
        if len(won) == 2:
            break
    assert len(won) == 2
    assert not any("kinreach_stop" in line for line in robot.log)  # the loser does not stop the other's program


def test_where_nothing_tells_them_apart_the_end_does(robot, monkeypatch):
    """An old controller, and a port that announces no program: what did not end where it should stops the robot."""
    without(monkeypatch, "output_int_register_24", "output_int_register_25")
    monkeypatch.setattr(SimulatedUR, "_announce", lambda self: None)
    programs = [to(0.4), to(-0.4)]
    ends = both(robot, [program for program, _ in programs])
    failed = [isinstance(end, RobotError) for end in ends]
    assert any(failed)
    for end, (_, goal) in zip(ends, programs, strict=True):
        if isinstance(end, RobotError):
            assert "does not stand where the program ends: shoulder_pan_joint is " in str(end)
        else:
            np.testing.assert_allclose(end.measured.q[-1], goal, atol=1e-3)
    with connected(robot) as watch:
        assert watch.read().runtime_state == 1


@pytest.mark.parametrize("script", [
    "movej([-1.2, -1.57, 1.57, -1.57, -1.57, 0], a=2, v=1)\n",
    "def other():\n  sleep(5)\nend\n",
    to(0.7)[0].text,
    to(0.7)[0].text_of_run(77),
], ids=["a line", "sleep", "a file", "another run"])  # fmt: skip
def test_a_program_that_comes_in_mid_program_ends_the_run(robot, script):
    """Whoever sends it: kinreach, a pendant or a script of one's own."""
    sent = []
    with connected(robot) as client, connected(robot) as other:

        def watch(state):
            if np.abs(state.target_qd).max() > 0.5 and not sent:
                sent.append(other.send(script))

        program, _ = to(1.5, speed=0.8)
        with pytest.raises(RobotError, match=r"another program|another client.*; the arm is at ") as ended:
            client.run(program, watch=watch)
    assert sent
    assert ended.value.recording.reason == str(ended.value)
    assert not any("kinreach_stop" in line for line in robot.log)


@pytest.mark.slow
def test_a_program_that_ends_elsewhere_than_planned_is_no_success(robot, monkeypatch):
    """As if the robot had skipped the last move; a straight line is judged by the tool."""
    lower = pose_vector(KIN.fk(HOME)) - [0, 0, 0.05, 0, 0, 0]
    for last, said in (
        (Move("movej", np.add(HOME, [0, 0, 0, 0, 0.3, 0]), 1.0, 2.0), "wrist_2_joint is 0.300 rad off"),
        (Move("movel", lower, 0.5, 1.0), r"its tool is 50.0 mm and 0.0\d° off"),
    ):
        first = Move("movej", HOME, 1.0, 2.0)
        program, sent = Program.of(KIN, HOME, [first, last]), Program.of(KIN, HOME, [first])
        monkeypatch.setattr(Program, "text_of_run", lambda _, run, sent=sent: _text(sent, run))
        with (
            connected(robot) as client,
            pytest.raises(RobotError, match=f"does not stand where the program ends: {said}"),
        ):
            client.run(program)
        monkeypatch.undo()


def test_cycles_that_were_not_received_are_counted(robot):
    publish, left_out = robot._publish, []

    def sometimes():
        number = round(robot.controller.time / 0.002)
        if robot.controller.runtime_state == 2 and number % 50 < 7:
            left_out.append(number)
        else:
            publish()

    robot._publish = sometimes
    with connected(robot) as client:
        done = client.run(to(0.5)[0])
    t = done.measured.t
    assert done.missing == round(t[-1] / 0.002) + 1 - len(t)
    assert 0 < done.missing <= len(left_out)
    assert done.missing > 0.1 * len(t)


@pytest.mark.slow
def test_a_trajectory_for_another_controllers_cycle_is_not_sent():
    """A CB3 takes a posture every 8 ms; what is made for it is taken by later ones too."""
    kin = {name: ArmKinematics.of(name, base="base", tip="tool0") for name in ("ur3", "ur3e")}
    home = np.array(kin["ur3e"].arm.home)
    t = np.linspace(0, 0.5, 60)
    way = 0.1 * (1 - np.cos(np.pi * t / 0.5)) / 2
    motion = Trajectory(JOINTS, t, home + np.outer(way, np.ones(6)), np.gradient(np.outer(way, np.ones(6)), t, axis=0))
    programs = {name: Program.of(kin[name], home, motion, model=None) for name in kin}
    assert {name: program.trajectory.t[1] for name, program in programs.items()} == {"ur3": 0.008, "ur3e": 0.002}
    for name in kin:
        with SimulatedUR(kin[name].arm, rtde_port=0, script_port=0, speed=8.0) as robot, connected(robot) as client:
            for made_for, program in programs.items():
                if (name, made_for) == ("ur3", "ur3e"):
                    with pytest.raises(RobotError, match=r"has control cycles of 8 ms, and .* every 2 ms; .*\(125\)"):
                        client.run(program)
                    continue
                done = client.run(program)
                assert done.missing == 0
                np.testing.assert_allclose(done.commanded.q[-1], motion.q[-1], atol=1e-3)
                client.send(f"movej({home.tolist()}, a=20, v=3)\n")
                while np.abs(client.read().actual_q - home).max() > 2e-4 or client.read().runtime_state != 1:
                    pass
