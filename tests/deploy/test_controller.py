"""The simulated controller moves as URScript says, and stops where a UR stops."""

import re
from dataclasses import replace

import numpy as np
import pytest

from kinreach.deploy._controller import Controller
from kinreach.deploy._motion import JointLine, LineError, Servo, StraightLine, rates_for
from kinreach.deploy._rtde import RobotMode, RuntimeState, SafetyMode
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, pose, pose_vector
from kinreach.robots import PUBLISHED_CALIBRATIONS, Workcell, get_arm
from tests.cases import slow
from tests.deploy.conftest import CALIBRATION

REAL = get_arm("ur5e").calibrated(CALIBRATION)
HOME = np.array(REAL.home)


def listed(values):
    return "[" + ", ".join(repr(float(value)) for value in values) + "]"


def program(*lines):
    return "def test():\n" + "".join(f"  {line}\n" for line in lines) + "end\n"


@pytest.fixture
def ur():
    controller = Controller(REAL, log=(log := []).append)
    controller.log = log
    return controller


def shifted(ur, *offset):
    """Pose of the tool [m, rad], moved from where it stands."""
    numbers = ur.tcp_pose(ur.target_q)
    numbers[:3] += offset
    return numbers


@pytest.mark.parametrize("name", ["ur5e_a", *slow("ur3_a", "ur10e_a")])
def test_poses_are_those_of_the_calibration(name):
    model, file = name[:-2], PUBLISHED_CALIBRATIONS[name]
    arm = get_arm(model).calibrated(file).with_tool([0.01, 0.02, 0.1, 0.1, 0.2, 0.3])
    kin, nominal = (ArmKinematics(each, base="base") for each in (arm, get_arm(model).with_tool(
        [0.01, 0.02, 0.1, 0.1, 0.2, 0.3])))  # fmt: skip
    ur = Controller(arm)
    rng = np.random.default_rng(0)
    for q in rng.uniform(-1, 1, (20, 6)) + arm.home:
        np.testing.assert_allclose(pose(ur.tcp_pose(q)), kin.fk(q), atol=1e-12)
        assert np.linalg.norm(ur.tcp_pose(q)[:3] - nominal.fk(q)[:3, 3]) > 1e-4
    # the arm in MuJoCo is the calibrated one
    T = np.linalg.inv(kin.T_world_base) @ ur.simulation.T_world_frame("tool")
    np.testing.assert_allclose(T, pose(ur.tcp_pose(ur.actual_q)), atol=1e-9)


@pytest.mark.slow
def test_movej_keeps_speed_acceleration_and_arrives(ur):
    rng = np.random.default_rng(1)
    for _ in range(5):
        goal = HOME + rng.uniform(-0.4, 0.4, 6)
        speed, acceleration = rng.uniform(0.2, 1.0), rng.uniform(0.5, 3.0)
        done = ur.run(program(f"movej({listed(goal)}, a={acceleration}, v={speed})"))
        assert done.reason == ""
        np.testing.assert_allclose(done.commanded.q[-1], goal, atol=1e-12)
        np.testing.assert_allclose(done.measured.q[-1], goal, atol=2e-3)
        assert np.abs(done.commanded.qd).max() <= speed * (1 + 1e-9)
        assert np.abs(np.diff(done.commanded.qd, axis=0)).max() <= acceleration * ur.cycle * 1.01
        # straight in joint space
        way = (done.commanded.q - done.commanded.q[0]) / (goal - done.commanded.q[0])
        assert np.ptp(way, axis=1).max() < 1e-9
        np.testing.assert_allclose(done.measured.q, done.commanded.q, atol=5e-3)
        HOME_AGAIN = ur.run(program(f"movej({listed(HOME)}, a=3, v=1)"))
        assert HOME_AGAIN.reason == ""


def trapezoid(t, length, v, a):
    """Way at times [s] of a motion from rest to rest with speed v and acceleration a, and its duration."""
    ramp = min(v / a, np.sqrt(length / a))
    top = a * ramp
    total = 2 * ramp + (length - top * ramp) / top
    braking = np.clip(total - t, 0.0, ramp)
    way = np.where(
        t < ramp, a * t**2 / 2, np.where(t < total - ramp, top * (t - ramp / 2), length - a * braking**2 / 2)
    )
    return way, total


@pytest.mark.parametrize("offset", [(0.9, -0.3, 0.5, 0.2, -0.4, 0.7), (0.05, 0.2, -0.1, 0.0, 0.3, 0.1)])
def test_movej_is_the_trapezoid_that_recordings_of_a_real_arm_are(ur, offset):
    """The bounds are those within which 28 recorded motions of a UR3e agree; the motions here are made up."""
    v, a, q = 0.7, 1.2, HOME + offset
    done = ur.run(program(f"movej({listed(q)}, a={a}, v={v})"))
    assert done.reason == ""
    length = np.abs(offset).max()
    t = ur.cycle * np.arange(len(done.commanded.q))
    way, total = trapezoid(t, length, v, a)
    late = np.flatnonzero(np.abs(done.commanded.q - q).max(axis=1) < 1e-9)[0] * ur.cycle - total
    assert abs(late) < 0.003
    error = done.commanded.q - (HOME + np.outer(way / length, offset))
    assert np.sqrt((error**2).mean(axis=0)).max() < 3e-4


@pytest.mark.slow
def test_movel_is_straight_and_turns_evenly(ur):
    ur.tcp = pose([0.05, -0.1, 0.2, 0.2, 0, 0])
    goal = pose_vector(pose(shifted(ur, 0.15, -0.1, 0.05)) @ pose([0, 0, 0, 0.2, -0.1, 0.3]))
    begin = pose(ur.tcp_pose(HOME))
    done = ur.run(program(f"movel(p{listed(goal)}, a=1.2, v=0.2)"))
    assert done.reason == ""
    poses = np.array([pose(ur.tcp_pose(q)) for q in done.commanded.q])
    way = goal[:3] - begin[:3, 3]
    share = (poses[:, :3, 3] - begin[:3, 3]) @ way / (way @ way)
    off = poses[:, :3, 3] - begin[:3, 3] - share[:, None] * way
    assert np.abs(off).max() < 1e-8
    assert (np.diff(share) > -1e-12).all()
    assert share[-1] == pytest.approx(1.0)
    np.testing.assert_allclose(poses[-1], pose(goal), atol=1e-8)
    turned = [np.arccos(np.clip((np.trace(begin[:3, :3].T @ T[:3, :3]) - 1) / 2, -1, 1)) for T in poses]
    np.testing.assert_allclose(turned, np.array(turned[-1]) * share, atol=1e-6)
    # the length is the turn's, 0.37 rad counts as 0.37 m: the tool moves so much slower
    speed = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).max() / ur.cycle
    assert speed == pytest.approx(0.2 * np.linalg.norm(way) / turned[-1], rel=1e-3)
    np.testing.assert_allclose(np.diff(done.commanded.q, axis=0) / ur.cycle,
                               (done.commanded.qd[1:] + done.commanded.qd[:-1]) / 2, atol=5e-3)  # fmt: skip


@pytest.mark.parametrize("kind", ["movej", *slow("movel")])
def test_a_blend_leaves_and_joins_the_lines_at_its_radius_and_saves_time(ur, kind):
    corner, end, radius = shifted(ur, 0.0, 0.0, 0.2), shifted(ur, 0.2, 0.0, 0.2), 0.05
    kin = ArmKinematics.of(REAL, tip="tool0", base="base")
    targets = [f"p{listed(corner)}", f"p{listed(end)}"]
    if kind == "movej":
        targets = [listed(kin.nearest(pose(target), HOME).q) for target in (corner, end)]
    runs = {}
    for r in (0.0, radius):
        ur.place(HOME)
        done = ur.run(program(f"{kind}({targets[0]}, a=1, v=0.2, r={r})", f"{kind}({targets[1]}, a=1, v=0.2)"))
        assert done.reason == ""
        runs[r] = done
    tips = {r: np.array([ur.tcp_pose(q)[:3] for q in done.commanded.q]) for r, done in runs.items()}
    nearest = {r: np.linalg.norm(tip - corner[:3], axis=1).min() for r, tip in tips.items()}
    assert nearest[0.0] < 1e-8
    assert 0.1 * radius < nearest[radius] < radius
    for tip in tips[radius]:  # the way is the other one's wherever the waypoint is farther away
        if np.linalg.norm(tip - corner[:3]) > 1.15 * radius:  # in joint space the tool's two speeds differ
            assert np.linalg.norm(tips[0.0] - tip, axis=1).min() < (2e-3 if kind == "movel" else 0.3 * radius)
    assert runs[radius].commanded.duration < runs[0.0].commanded.duration - 0.1
    # without a stop on the way
    speeds = {r: np.abs(run.commanded.qd).max(axis=1)[50:-50] for r, run in runs.items()}
    assert speeds[0.0].min() < 1e-9 < 0.02 < speeds[radius].min()


def test_overlapping_blends_are_skipped_with_a_warning(ur):
    corner, end = shifted(ur, 0.0, 0.0, 0.1), shifted(ur, 0.1, 0.0, 0.1)
    done = ur.run(program(f"movel(p{listed(corner)}, r=0.06)", f"movel(p{listed(end)}, r=0.06)",
                          f"movel(p{listed(shifted(ur, 0.1, 0.0, 0.0))})"))  # fmt: skip
    assert done.reason == ""
    assert [line for line in ur.log if "overlapping blends, the move is skipped" in line]


def test_servoj_follows_late_by_the_lookahead_time(ur):
    t = np.arange(600) * ur.cycle
    for lookahead, gain in ((0.03, 2000), (0.1, 300), (0.2, 100)):
        ur.place(HOME)
        ramp = HOME + np.outer(0.3 * t, [1, 0, 0, 0, 0, -1])
        done = ur.run(program(*(f"servoj({listed(q)}, t={ur.cycle}, lookahead_time={lookahead}, gain={gain})"
                                for q in ramp)))  # fmt: skip
        assert done.reason == ""
        assert len(done.commanded.t) == pytest.approx(600, abs=2)
        late = (ramp[400:590, 0] - done.commanded.q[402:592, 0]) / 0.3
        np.testing.assert_allclose(late, lookahead - ur.cycle, atol=2 * ur.cycle)


@pytest.mark.slow
def test_the_servo_filter_is_stable_wherever_a_controller_takes_it():
    rng, tried = np.random.default_rng(2), 0
    for _ in range(100):
        servo = Servo(np.zeros(1), np.zeros(1))
        lookahead, gain, dt = rng.uniform(0.03, 0.2), rng.uniform(100, 2000), rng.choice([0.002, 0.008])
        most = 0.0
        for _ in range(int(3 / dt)):
            servo.follow(np.ones(1), lookahead, gain, dt)
            most = max(most, float(servo.q[0]))
        assert most < 1.2
        assert servo.q[0] == pytest.approx(1.0, abs=1e-3)
        tried += 1
    assert tried == 100


@pytest.mark.slow
def test_the_speed_slider_stretches_time_and_nothing_else(ur):
    goal = np.add(HOME, [0.3, 0, 0, 0, 0, 0.2])
    steps = [f"servoj({listed(HOME + s * (goal - HOME))}, t=0.002, lookahead_time=0.03, gain=2000)"
             for s in np.linspace(0, 1, 300)]  # fmt: skip
    for lines in ([f"movej({listed(goal)}, a=1, v=0.5)"], [*steps, f"servoj({listed(goal)}, t=0.3, gain=300)"]):
        ways = {}
        for fraction in (1.0, 0.5):
            ur.place(HOME)
            ur.speed_slider = fraction
            for _ in range(200):
                ur.tick()
            assert ur.speed_scaling == fraction
            ways[fraction] = ur.run(program(*lines)).commanded
        slow, fast = ways[0.5], ways[1.0]
        assert slow.duration == pytest.approx(2 * fast.duration, abs=0.01)
        assert np.abs(slow.qd).max() == pytest.approx(np.abs(fast.qd).max() / 2, rel=0.01)
        np.testing.assert_allclose(slow.q[::2][:200], fast.q[:200], atol=3e-3)
    # on the way to 0 and back the arm slows down without a jerk, and goes on where it was
    ur.place(HOME)
    ur.speed_slider = 1.0
    ur.start(program(f"movej({listed(np.add(HOME, [1, 0, 0, 0, 0, 0]))}, a=1, v=0.5)"))
    speeds = []
    for cycle in range(2000):
        ur.speed_slider = 0.0 if 500 < cycle < 1000 else 1.0
        ur.tick()
        speeds.append(ur.target_qd[0])
    assert speeds[900] == 0.0 < 0.49 < speeds[1200]
    assert np.abs(np.diff(speeds)).max() <= 1.01 * max(1.0, 4.0 * 0.5) * ur.cycle
    assert ur.reason == ""


def test_a_new_program_takes_over_and_stopj_brakes_from_the_next_cycle(ur):
    ur.start(program(f"movej({listed(np.add(HOME, [1, 0, 0, 0, 0, 0]))}, a=1.4, v=0.8)"))
    for _ in range(400):
        ur.tick()
    assert ur.target_qd[0] == pytest.approx(0.8)
    ur.start(program("stopj(4)"))
    speeds = []
    while ur.runtime_state is RuntimeState.PLAYING:
        ur.tick()
        speeds.append(ur.target_qd[0])
    assert speeds[0] == pytest.approx(0.8 - 4 * ur.cycle)
    np.testing.assert_allclose(np.diff(speeds), -4 * ur.cycle, atol=4 * ur.cycle + 1e-9)
    assert len(speeds) == pytest.approx(0.8 / 4 / ur.cycle, abs=2)
    assert speeds[-1] == 0.0
    for _ in range(200):
        ur.tick()
    np.testing.assert_allclose(ur.actual_q, ur.target_q, atol=1e-3)
    # a refused program ends the one that runs, too, and the arm brakes
    ur.start(program(f"movej({listed(HOME)}, a=1.4, v=0.8)"))
    for _ in range(100):
        ur.tick()
    with pytest.raises(InputError, match=r"force_mode"):
        ur.start(program("force_mode()"))
    for _ in range(200):
        ur.tick()
    assert not ur.target_qd.any()
    assert ur.runtime_state is RuntimeState.STOPPED


STOPS = {
    "joint limit: wrist_3_joint": f"movej({listed([*HOME[:5], 6.5])}, a=5, v=3)",
    "joint speed: shoulder_pan_joint": f"movej({listed([-0.5, *HOME[1:]])}, a=100, v=20)",
    "straight line leaves the reach": "movel(p[0, 0, 3, 0, 0, 0])",
    "collision: .* touches table": f"movej({listed([HOME[0], 0.1, 0.0, *HOME[3:]])}, a=2, v=1)",
    "collision: self-collision": f"movej({listed([HOME[0], -2.0, 2.9, -1.0, *HOME[4:]])}, a=2, v=1)",
}


class TestProtectiveStops:
    """Each with its reason, the robot's numbers, and nothing that moves afterwards."""

    @pytest.mark.parametrize("reason", STOPS)
    def test_stop(self, reason):
        cell = Workcell() if "self" in reason else REAL.workcell
        ur = Controller(replace(REAL, workcell=cell), log=(log := []).append)
        text = program(STOPS[reason], f"movej({listed(HOME)})")
        done = ur.run(text)
        assert done.reason != ""
        with pytest.raises(InputError, match=f"protective stop .*{reason}"):
            ur.start(text)
        assert (ur.safety_mode, ur.runtime_state, ur.speed_scaling) == (SafetyMode.PROTECTIVE_STOP, 1, 0.0)
        assert any(line.startswith("protective stop:") for line in log)
        for _ in range(300):
            ur.tick()
        stands = ur.actual_q
        for _ in range(50):
            ur.tick()
        np.testing.assert_allclose(ur.actual_q, stands, atol=1e-3)
        ur.release()
        np.testing.assert_allclose(ur.actual_q, HOME, atol=1e-9)
        assert not ur.history  # of where the arm has not come from
        assert ur.run(program(f"movej({listed(HOME + 0.05)})")).reason == ""

    def test_a_singular_straight_line(self, ur):
        """Through the axis of the first joint."""
        away = ur.tcp_pose(HOME)
        away[:2] *= -1
        done = ur.run(program(f"movel(p{listed(away)})"))
        assert "singularity at" in done.reason or "joint speed" in done.reason

    def test_a_speed_of_the_tool_at_a_singularity(self, ur):
        straight = np.where(np.arange(6) == 4, 0.0, HOME)
        assert ur.run(program(f"movej({listed(straight)}, a=20, v=3)")).reason == ""
        done = ur.run(program("speedl([0.1, 0, 0, 0, 0, 0], 0.5, 1)"))
        assert done.reason == "the tool cannot keep its speed at a singularity"

    def test_an_arm_that_is_pushed_away(self, ur):
        ur.start(program("sleep(1)"))
        ur.tick()
        ur.simulation.data.qpos[2] += 0.4
        ur.tick()
        assert ur.safety_mode is SafetyMode.PROTECTIVE_STOP
        assert re.fullmatch(r"protective stop: elbow_joint is 0\.\d\d rad from its target", ur.log[-1])

    def test_after_a_stop_the_arm_is_put_back_to_where_that_program_began(self, ur):
        rng, stopped = np.random.default_rng(1), 0
        for goal in HOME + rng.uniform(-0.1, 0.1, (3, 6)):
            assert ur.run(program(f"movej({listed(goal)}, a=20, v=3)")).reason == ""
            began = ur.actual_q
            assert "asked for it" in ur.run(program(f"movej({listed(HOME)}, a=20, v=3)", "protective_stop()")).reason
            assert np.abs(ur.actual_q - began).max() > 0.01
            ur.release()
            np.testing.assert_allclose(ur.actual_q, began, atol=1e-3)
            stopped += 1
        assert stopped == 3

    def test_an_arm_that_is_pushed_away_while_no_program_runs_is_put_back_where_it_was_placed(self, ur):
        rng, placed = np.random.default_rng(0), 0
        for q in HOME + rng.uniform(-0.2, 0.2, (5, 6)):
            ur.place(q)
            ur.tick()
            ur.simulation.data.qpos[2] += 0.4
            ur.tick()
            assert ur.safety_mode is SafetyMode.PROTECTIVE_STOP
            ur.release()
            assert ur.safety_mode is SafetyMode.NORMAL
            for posture in (ur.actual_q, ur.target_q):
                np.testing.assert_array_equal(posture, q)
            assert not ur.target_qd.any()
            placed += 1
        assert placed == 5


def test_a_time_is_kept_with_an_acceleration_that_may_have_to_be_raised():
    raised, rng = 0, np.random.default_rng(0)
    for seconds, length, acceleration in 10.0 ** rng.uniform(-1, 1, (500, 3)):
        speed, used = rates_for(seconds, length, acceleration)
        assert used >= acceleration * (1 - 1e-12)
        assert speed**2 / used <= length * (1 + 1e-9)
        assert speed / used + length / speed == pytest.approx(seconds, rel=1e-9)
        raised += used > acceleration * (1 + 1e-9)
    assert 100 < raised < 400
    assert rates_for(2.0, 0.0, 1.0) == (1e-9, 1e-9)


MOVE = f"movej({listed(np.add(HOME, [1, 0, 0, 0, 0, 0]))}, a=1.4, v=0.8)"
SERVO = [f"servoj({listed(np.add(HOME, [0.002 * s, 0, 0, 0, 0, 0]))}, t=0.002, lookahead_time=0.03, gain=2000)"
         for s in (*range(600), *[600] * 300)]  # fmt: skip


def test_a_gentle_stop_of_one_program_makes_no_other_stop_gentle(ur):
    """`stopj` brakes as it says; the arm of a program that is ended brakes by 10 rad/s^2."""
    done = ur.run(program("speedj([0.3, 0, 0, 0, 0, 0], 10, 0.05)", "stopj(2)"))
    assert np.diff(done.commanded.qd[:, 0]).min() == pytest.approx(-2.0 * ur.cycle, abs=1e-9)
    ur.start(program("speedj([0.3, 0, 0, 0, 0, 0], 10, 5)"))
    for _ in range(30):
        ur.tick()
    ur.end_program()
    speeds = [ur.target_qd[0]]
    for _ in range(60):
        ur.tick()
        speeds.append(ur.target_qd[0])
    assert speeds[0] == pytest.approx(0.3)
    assert speeds[-1] == 0.0
    assert np.diff(speeds).min() == pytest.approx(-10.0 * ur.cycle, abs=1e-9)


@pytest.mark.parametrize("lines", [[MOVE], SERVO], ids=["movej", "servoj"])
def test_an_emergency_stop_brakes_and_takes_the_power(ur, lines):
    ur.start(program(*lines))
    for _ in range(400):
        ur.tick()
    fastest = abs(ur.target_qd[0])
    assert fastest > 0.7
    ur.emergency_stop()
    assert (ur.robot_mode, ur.safety_mode, ur.runtime_state) == (
        RobotMode.POWER_OFF, SafetyMode.ROBOT_EMERGENCY_STOP, RuntimeState.STOPPED)  # fmt: skip
    assert ur.speed_scaling == 0.0
    speeds = [fastest]
    while speeds[-1] > 0.0:
        ur.tick()
        speeds.append(abs(ur.target_qd[0]))
    np.testing.assert_allclose(np.diff(speeds)[:-1], -10.0 * ur.cycle, atol=1e-9)
    stopped = ur.target_q
    for _ in range(200):
        ur.tick()
    np.testing.assert_array_equal(ur.target_q, stopped)
    np.testing.assert_allclose(ur.actual_q, stopped, atol=1e-3)
    with pytest.raises(InputError, match=r"the program is not run: emergency stop \(its button was pressed\)"):
        ur.start(program(MOVE))
    ur.release()
    np.testing.assert_array_equal(ur.target_q, stopped)
    assert (ur.robot_mode, ur.safety_mode) == (RobotMode.RUNNING, SafetyMode.NORMAL)
    assert ur.run(program(MOVE)).reason == ""


@pytest.mark.parametrize("lines", [[MOVE], SERVO], ids=["movej", "servoj"])
@pytest.mark.slow
def test_a_pause_stretches_time_and_nothing_else(ur, lines):
    way = ur.run(program(*lines)).commanded.q[:, 0]
    ur.place(HOME)
    ur.start(program(*lines))
    states, seen = [ur.runtime_state], []
    for cycle in range(3000):
        if cycle == 200:
            ur.pause()
        if cycle == 800:
            ur.resume()
        ur.tick()
        if ur.runtime_state is not states[-1]:
            states.append(ur.runtime_state)
        if ur.runtime_state is RuntimeState.PAUSED:
            assert ur.target_qd[0] == 0.0
        seen.append(ur.target_q[0])
    assert [state.name for state in states] == ["PLAYING", "PAUSING", "PAUSED", "RESUMING", "PLAYING", "STOPPED"]
    assert len(set(seen[500:800])) == 1
    assert seen[-1] == pytest.approx(way[-1], abs=1e-6)
    off = [np.abs(way - q).min() for q in seen]
    assert max(off) < 2e-3  # on the same way
    # a paused program ends as another does, and a pause without one is none
    ur.place(HOME)
    ur.start(program(*lines))
    ur.pause()
    for _ in range(300):
        ur.tick()
    assert ur.runtime_state is RuntimeState.PAUSED
    assert ur.run(program("stopj(4)")).reason == ""
    assert ur.runtime_state is RuntimeState.STOPPED
    for change in (ur.pause, ur.resume):
        change()
        assert ur.runtime_state is RuntimeState.STOPPED


def test_values_and_what_is_none():
    ur = Controller(REAL, log=(log := []).append)
    ur.run(program("x = 3 - 1 - 1", "q = [x, -x, 7]", "if q[0] > 0.5 or False:", "  textmsg(q[2] - q[1])", "else:",
                   "  textmsg(0)", "end", "if norm(-x) > 1 or norm(x) > 2:", "  textmsg(1)", "else:", "  textmsg(2)",
                   "end"))  # fmt: skip
    assert [line for line in log if line.startswith("textmsg")] == ["textmsg: 8", "textmsg: 2"]
    ur.run(program('popup("a")', 'textmsg("b", "c")'))
    assert log[-3:-1] == ["popup: a", "textmsg: bc"]
    for lines, reason in (
        (("if 1 or True:", "  sleep(1)", "end"), "or is for truth values"),
        (("x = 3", "y = x[0]"), "x has no entry 0"),
        (("x = [1]", "y = x[0.5]"), "x has no entry 0.5"),
        (("x = [1]", "y = x[-1]"), "x has no entry -1"),
        (("x = True > 1",), "a number is needed, got True"),
        (("set_tcp([0, 0, 0, 0, 0, 0])",), "set_tcp takes a pose"),
        (("servoj([0, 0], t=0.1)",), "servoj takes a list of six"),
        ((f"servoj({listed(HOME)}, t=11)",), "t of servoj must be from 0.002 to 10 s"),
        (("textmsg(1)", 'set_payload("a", [0])'), "m of set_payload must be a number from 0 to 100"),
    ):
        assert reason in ur.run(program(*lines)).reason, lines


def test_a_start_in_collision_or_outside_the_limits_is_refused():
    with pytest.raises(InputError, match=r"start posture is in collision"):
        Controller(REAL, q=[0, -1.0, 2.9, -1.0, -1.57, 0])
    with pytest.raises(InputError, match=r"outside its limits"):
        Controller(REAL, q=[7, -1.0, 1.0, -1.0, -1.57, 0])


@pytest.mark.parametrize(("lines", "reason"), [
    ((f"movej({listed(HOME)}, v=-1)",), "line 2, column 3: runtime error: v of movej must be a number"),
    (("movej([1, 2, 3])",), "takes a list of six joint angles"),
    (("movel([1, 2])",), "movel takes a list of six joint angles"),
    (("movej(p[3, 0, 0, 0, 0, 0])",), "no posture within the limits reaches the pose"),
    (("x = 1 / 0",), "1 / 0 has no value"),
    (("x = sqrt(-1)",), "sqrt: "),
    (("if False:", "  y = 1", "end", "x = y"), "name 'y' has no value yet"),
    (("speedj([1])",), "speedj takes a list of six joint angles"),
    (("set_digital_out(18, True)",), "its number must be from 0 to 17"),
    (("set_tool_voltage(5)",), "voltage is 0, 12 or 24"),
    (("set_tcp(p[1, 2])",), "a pose has six numbers"),
    (("q = get_actual_joint_positions()", "x = q[6]"), "q has no entry 6"),
    (("q = get_actual_joint_positions()", "x = q - 1"), "a number is needed"),
    (("sleep(True)",), "t of sleep must be a number"),
    ((f"servoj({listed(HOME)}, t=0.0001)",), "t of servoj must be from"),
    ((f"servoj({listed(HOME)}, t=0.002, gain=5)",), "gain of servoj must be"),
    (("if 1:", "  sleep(1)", "end"), "neither true nor false"),
    (("write_output_integer_register(48, 1)",), "output_id"),
])  # fmt: skip
def test_runtime_errors_end_the_program_with_a_reason(ur, lines, reason):
    done = ur.run(program(*lines))
    assert reason in done.reason
    assert ur.safety_mode is SafetyMode.NORMAL
    assert ur.runtime_state is RuntimeState.STOPPED


def test_a_program_that_does_not_end_is_given_up(ur):
    assert "takes longer than 0.5 s" in ur.run(program("sleep(3000)"), longest=0.5).reason


def test_a_straight_line_within_the_reach_ends_where_a_closed_form_ends():
    kin = ArmKinematics.of(REAL, tip="tool0", base="base")
    rng, lines = np.random.default_rng(4), 0
    for _ in range(60):
        start = HOME + rng.uniform(-0.3, 0.3, 6)
        goal = kin.fk(start) @ pose(rng.uniform(-0.12, 0.12, 6))
        try:
            line = StraightLine(kin, np.eye(4), start, goal, 0.25, 1.2)
        except LineError:
            continue
        found = kin.all_solutions(goal, seed=start).q
        assert np.abs(found - line.end).max(axis=1).min() < 1e-6
        lines += 1
    assert lines > 45


def test_a_segment_of_no_length_is_done_at_once():
    assert JointLine(HOME, HOME, 1.0, 1.0).done


@pytest.mark.parametrize(("kind", "speed", "acceleration"), [
    ("movej", 1.05, 1.4), ("movel", 0.25, 1.2), ("movep", 0.25, 1.2), ("movec", 0.25, 1.2),
])  # fmt: skip
def test_what_a_program_leaves_out_of_a_motion_is_the_manuals(ur, kind, speed, acceleration):
    """Its speed [m/s, rad/s], and the acceleration."""
    goals = [f"p{listed(shifted(ur, *off))}" for off in ((0.1, 0.0, 0.1), (0.0, 0.0, 0.2))][kind != "movec" :]
    aside = listed(np.add(HOME, (1.5, 0, 0, 0, 0, 0)))
    done = ur.run(program(f"{kind}({aside if kind == 'movej' else ', '.join(goals)})"))
    assert done.reason == ""
    way = done.commanded.q[:, :1] if kind == "movej" else np.array([ur.tcp_pose(q)[:3] for q in done.commanded.q])
    rates = np.linalg.norm(np.diff(way, axis=0), axis=1) / ur.cycle
    assert rates.max() == pytest.approx(speed, rel=2e-3)
    assert np.median(np.diff(rates)[:50]) / ur.cycle == pytest.approx(acceleration, rel=1e-2)
