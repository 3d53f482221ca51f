"""URScript out and in: what is written is read back, runs on the simulated controller, and nothing else is run."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kinreach
from kinreach.deploy import Move, Program, read_trajectory, write_trajectory
from kinreach.errors import InputError, KinreachError
from kinreach.kinematics import ArmKinematics, Trajectory
from kinreach.robots import Tool, get_arm
from kinreach.robots.inside import JOINTS

KIN = ArmKinematics.of("ur5e", tool=[0, 0.01, 0.15, 0.1, 0, 0], base="base")
HOME = np.array(KIN.arm.home)


@pytest.mark.parametrize(("command", "speed", "acceleration"), [("movej", 100.0, 10.0), ("movel", 1.0, 5.0)])
def test_each_command_has_its_own_bounds(command, speed, acceleration):
    assert Move(command, HOME, speed, acceleration).acceleration == acceleration
    for fast, hard in ((1.01 * speed, acceleration), (speed, 1.01 * acceleration)):
        with pytest.raises(InputError, match=f"of {command} must be .* at most"):
            Move(command, HOME, fast, hard)


def swing(duration=1.0, amplitude=0.2, samples=200, joints=JOINTS, start=HOME):
    t = np.linspace(0, duration, samples)
    share = (1 - np.cos(np.pi * t / duration)) / 2
    rate = np.pi / duration * np.sin(np.pi * t / duration) / 2
    way = amplitude * np.arange(1, len(joints) + 1) / len(joints)
    return Trajectory(joints, t, start + np.outer(share, way), np.outer(rate, way))


def turned(angle):
    return HOME + angle * np.eye(6)[0]


finite = st.floats(-6, 6, allow_nan=False)
sixes = st.tuples(*[finite] * 6)
moves = st.builds(
    Move, st.sampled_from(["movej", "movel"]), sixes, st.floats(0.01, 1), st.floats(0.01, 5), st.floats(0, 0.1)
)


@settings(max_examples=40)
@given(st.integers(2, 60), st.sampled_from([125.0, 500.0]), st.integers(0, 2**32 - 1))
def test_a_trajectory_comes_back_as_it_was(samples, rate, seed):
    rng = np.random.default_rng(seed)
    q = HOME + rng.normal(0, 0.01, (samples, 6)).cumsum(axis=0)
    given_one = Trajectory(JOINTS, np.arange(samples) / rate, q, np.gradient(q, 1 / rate, axis=0))
    program = Program(tuple(q[0].tolist()), (0.0,) * 6, trajectory=given_one)
    back = Program.parse(program.text).trajectory
    np.testing.assert_array_equal(back.q, given_one.q)
    np.testing.assert_allclose(back.t, given_one.t, atol=1e-12)
    np.testing.assert_allclose(back.qd[1:-1], given_one.qd[1:-1], atol=1e-9)


@given(st.integers(1, 40), st.integers(1, 8), st.integers(0, 2**32 - 1), st.sampled_from([".json", ".csv"]))
def test_files_come_back_as_they_were(tmp_path_factory, samples, joints, seed, ending):
    rng = np.random.default_rng(seed)
    names = tuple(f"joint_{number}" for number in range(joints))
    t = np.cumsum(np.concatenate([[0.0], rng.uniform(1e-3, 2, samples - 1)]))
    path = tmp_path_factory.mktemp("files") / f"motion{ending}"
    written = Trajectory(names, t, rng.normal(0, 3, (samples, joints)), rng.normal(0, 3, (samples, joints)))
    write_trajectory(written, path)
    back = read_trajectory(path)
    assert back.joints == names
    np.testing.assert_allclose(back.t, t, rtol=0, atol=0 if ending == ".csv" else 5.01e-10)
    np.testing.assert_array_equal(back.q, written.q)
    np.testing.assert_array_equal(back.qd, written.qd)


def test_a_message_without_velocities_and_a_program_in_a_file(tmp_path):
    path = tmp_path / "ros.json"
    path.write_text('{"joint_names": ["a", "b"], "points": ['
                    '{"positions": [0, 1], "time_from_start": {"sec": 0, "nanosec": 0}},'
                    '{"positions": [1, 3], "time_from_start": {"sec": 0, "nanosec": 500000000}}]}')  # fmt: skip
    np.testing.assert_allclose(read_trajectory(path).qd, [[2, 4], [2, 4]])
    program = Program.of(KIN, HOME, swing())
    path = tmp_path / "motion.script"
    path.write_text(program.text)
    np.testing.assert_array_equal(read_trajectory(path).q, program.trajectory.q)
    path.write_text(Program.of(KIN, HOME, [Move("movej", HOME, 0.5, 1.0)]).text)
    with pytest.raises(InputError, match=r"motion\.script has moves"):
        read_trajectory(path)


POINT = '{"joint_names": ["a"], "points": [{"positions": %s, "time_from_start": {"sec": %s, "nanosec": 0}}]}'
BAD_FILES = {
    "a.json": {
        "": "not JSON", "{": "not JSON", "nan": "not JSON", "[" * 100_000: "not JSON",
        "[]": "needs joint_names and points", '{"joint_names": [], "points": []}': "needs joint_names and points",
        '{"joint_names": 3, "points": [1]}': "needs joint_names and points",
        '{"joint_names": ["a"], "points": 4}': "needs joint_names and points",
        POINT % ('["x"]', 0): "point 0 is not a JointTrajectoryPoint", POINT % ("[1]", "1e999"): "point 0 is not",
        POINT % ("[NaN]", 0): "q must be finite", POINT % ("[1, 2]", 0): "point 0 has 2 positions and 0 velocities",
        POINT % ('[1], "velocities": [1, 2]', 0): "1 positions and 2 velocities for 1 joints",
        '{"joint_names": ["a"], "points": [5]}': "point 0 is not",
        POINT.replace('["a"]', '["a", "a"]') % ("[1, 2]", 0): "different names",
    },
    "a.csv": {
        "": "columns must be time", "time": "columns must be time", "time,a,b_velocity\n": "columns must be time",
        "t,a\n0,1\n": "columns must be time", "time,a\n0,x\n": "line 2: numbers are needed, got '0,x'",
        "time,a\n0,1,2\n": "line 2: 2 cells are needed, as in the header, got 3",
        "time,a\n0,nan\n": "line 2: the numbers must be finite",
        "time,a\n0,1\n0,2\n": "t must increase", "time,a\n5,1\n": "t must begin at 0", "time,a\n": "no samples",
        'time,a\n0,"1\n': "not CSV",
    },
    "a.script": {
        "": "line 1: ", "import os": "line 1, column 8: ", "def f():\nend\n": "not a program of kinreach",
        "__import__('os')": "line 1, column 12: ", "def f():\n  while True:\n  end\nend\n": "not a program of kinreach",
    },
    "a.bag": {"x": "a trajectory is read from .json, .csv or .script, got a.bag"},
}  # fmt: skip


def test_bad_files_are_refused_with_their_name_and_the_reason(tmp_path):
    tried = 0
    for name, texts in BAD_FILES.items():
        for text, reason in texts.items():
            (tmp_path / name).write_text(text)
            with pytest.raises(KinreachError) as refused:
                read_trajectory(tmp_path / name)
            assert name in str(refused.value)
            assert reason in str(refused.value), text
            assert len(str(refused.value).splitlines()) == 1
            tried += 1
    assert tried > 30
    with pytest.raises(InputError, match=r"written as"):
        write_trajectory(swing(), tmp_path / "a.script")
    near = Trajectory(("a",), [0.0, 1e-10], [[0.0], [0.0]], [[0.0], [0.0]])
    with pytest.raises(InputError, match="closer than a nanosecond"):
        write_trajectory(near, tmp_path / "a.json")


def test_spaces_empty_lines_and_a_byte_order_mark_change_no_table(tmp_path):
    (tmp_path / "a.csv").write_text("\ufefftime, a ,b\n\n0,1,2\n\n\n0.5,3,4\n", encoding="utf-8")
    read = read_trajectory(tmp_path / "a.csv")
    assert (read.joints, read.t.tolist(), read.q.tolist()) == (("a", "b"), [0.0, 0.5], [[1, 2], [3, 4]])
    (tmp_path / "a.csv").write_text("time,a\n0,1\n")
    assert read_trajectory(tmp_path / "a.csv").qd.tolist() == [[0.0]]


@pytest.mark.slow
def test_comments_and_empty_lines_change_no_program():
    program = Program.of(KIN, HOME, [Move("movej", HOME + 0.1, 0.5, 1.0)], payload=1.2)
    rng, others = np.random.default_rng(0), ["", "   ", "# a comment", "\t# def f():", "\r"]
    for _ in range(20):
        lines = [part for line in ["", *program.text.splitlines(), ""]
                 for part in (line, *rng.choice(others, rng.integers(3)))]  # fmt: skip
        assert Program.parse("\n".join(lines)) == Program.parse(program.text)


def test_a_program_says_what_it_is_for_and_sets_the_tool():
    program = Program.of(KIN, HOME, [Move("movej", HOME + 0.1, 0.5, 1.0)], payload=1.2, centre_of_mass=(0, 0, 0.05))
    text = program.text
    assert f"Written by kinreach {kinreach.__version__} for: UR5E with tool" in text
    assert "set_tcp(p[0, 0.01, 0.15, 0.1, 0, 0])" in text
    assert "set_payload(1.2, [0, 0, 0.05])" in text
    assert "Payload: 1.2 kg" in text
    assert "-90.000, -90.000, 90.000, -90.000, -90.000, 0.000 degrees, each within 0.029" in text
    assert text.isascii()
    without = Program.of(KIN, HOME, [Move("movej", HOME + 0.1, 0.5, 1.0)]).text
    assert "set_payload" not in without
    heavy = ArmKinematics(get_arm("ur5e").with_tool(Tool.tube([0, 0, 0.2, 0, 0, 0], 0.03, mass=0.8)), base="base")
    assert "set_payload(0.8, [0, 0, 0.1])" in Program.of(heavy, HOME, [Move("movej", HOME + 0.1, 0.5, 1.0)]).text
    assert "as it is set on the robot" in without
    # a title cannot leave its comment
    hostile = Program(HOME, (0,) * 6, (Move("movej", HOME, 1.0, 1.0),), arm="UR\n  movej([0,0,0,0,0,0])\r\x0b")
    assert Program.parse(hostile.text).moves == hostile.moves
    assert len(re.findall(r"^\s*movej\(\[", hostile.text, re.MULTILINE)) == 1


def test_a_call_that_is_not_the_programs_changes_nothing():
    program = Program.of(KIN, HOME, [Move("movej", HOME + 0.1, 0.5, 1.0)], payload=1.2, centre_of_mass=(0, 0, 0.05))
    longer = re.sub(r"^( *)set_payload.*$", r'\g<0>\n\1textmsg("begin")', program.text, flags=re.MULTILINE)
    assert longer.count('textmsg("begin")') == 1
    assert Program.parse(longer) == Program.parse(program.text)


@pytest.mark.parametrize(("motion", "reason"), [
    ([Move("movej", HOME + 0.1, 0.5, 1.0, 0.01)], "the last move must stop"),
    ([], "has moves or a trajectory"),
    ([Move("movej", turned(0.2), 3.5, 1.0)], "move 1 moves shoulder_pan_joint at 3.5 rad"),
    (swing(0.1, 1.0), "the trajectory moves .* above its limit of 3.14"),
    ([Move("movej", turned(0.2), 1, 1, 0.2), Move("movej", HOME, 1, 1)], "blends of move 1 overlap"),
    ([Move("movej", turned(0.5), 1, 1, 0.15), Move("movej", turned(0.4), 1, 1)],
     "blends of move 2 overlap: radii of 0.15 and 0 m"),
    (swing(joints=("a", "b"), start=0), "joints of a UR's trajectory"),
])  # fmt: skip
def test_what_a_robot_should_not_do_is_refused(motion, reason):
    with pytest.raises(InputError, match=reason):
        Program.of(KIN, HOME, motion)


@pytest.mark.parametrize(("values", "reason"), [
    ({"command": "movec"}, "unknown command"), ({"target": (1, 2)}, "target must have shape"),
    ({"speed": 0}, "speed of movej must be"), ({"speed": float("nan")}, "speed of movej"),
    ({"command": "movel", "speed": 1.5}, "speed of movel must be finite and above 0 and at most 1"),
    ({"acceleration": 11}, "acceleration of movej must be"), ({"blend": -0.1}, "blend"),
])  # fmt: skip
def test_moves_out_of_bounds_are_refused(values, reason):
    with pytest.raises(InputError, match=reason):
        Move(**{"command": "movej", "target": HOME, "speed": 0.5, "acceleration": 1.0, **values})


def test_a_trajectory_has_an_even_rate_that_a_ur_keeps():
    even = swing()
    for t, reason in (
        (even.t * (1.0 + 1e-5 * np.arange(len(even.t))), "two samples or more at an even rate"),
        (even.t / even.t[1] * 0.003, r"a sample every 3 ms, .* whole control cycles of 2 ms"),
        (even.t / even.t[1] * 0.001, r"a sample every 1 ms"),
    ):
        with pytest.raises(InputError, match=reason):
            Program(HOME, np.zeros(6), trajectory=Trajectory(JOINTS, t, even.q, even.qd * 0.0))
    alone = Trajectory(JOINTS, [0.0], [HOME], np.zeros((1, 6)))
    with pytest.raises(InputError, match="two samples or more at an even rate"):
        Program(HOME, np.zeros(6), trajectory=alone)
    assert Program.of(KIN, HOME, even).trajectory.t[1] == 0.002


@pytest.mark.parametrize("joint", range(6))
def test_a_trajectory_begins_in_the_start_posture(joint):
    """No joint of it is further off than the program's own check lets pass."""
    path, off = swing().resampled(500.0), 5e-4 * np.eye(6)[joint]
    for sign in (1.0, -1.0):
        assert Program(path.q[0] + 0.99 * sign * off, np.zeros(6), trajectory=path).trajectory is path
        with pytest.raises(InputError, match="the trajectory does not begin in the start posture"):
            Program(path.q[0] + 1.01 * sign * off, np.zeros(6), trajectory=path)


@pytest.mark.parametrize("tolerance", [0.0, 1e-4, 0.011, float("nan"), -1, True, "x"])
def test_the_tolerance_of_the_start_is_bounded(tolerance):
    with pytest.raises(InputError, match=r"tolerance \[rad\] must be"):
        Program(HOME, (0,) * 6, (Move("movej", HOME, 1.0, 1.0),), tolerance=tolerance)
    wide = Program(HOME, (0,) * 6, (Move("movej", HOME, 1.0, 1.0),), tolerance=0.0025)
    assert wide.text.count("> 0.0025") == 6
    assert Program.parse(wide.text) == wide


@pytest.mark.parametrize(("kind", "old", "new", "reason"), [
    ("movej", r"movej\(\[.*?\]", "movej([1, 2]", "target must have shape"),
    ("movej", r"movej\(\[", "movej(p[", "movej takes joint angles"),
    ("movej", r", v=0.5", "", None),
    ("movej", r", v=0.5", ", v=0.5, t=2", "movej is not a move with a and v"),
    ("movej", r"movej\((\[.*?)\], ", r"movej(\1 - 1], ", "a number is needed here"),
    ("movej", r"movej\(\[.*?\]", "movej(start", "movej takes joint angles"),
    ("movej", r"  start = .*", "  start = 3", "a list of numbers is needed here"),
    ("movej", r"  start = .*", "  start = [True]", "a number is needed here"),
    ("movej", r"> 0.0005 or", "> 0.01 or", "line 40, column .* six joints with one tolerance"),
    ("movej", r" or norm\(q.*:", ":", "compares each of six joints"),
    ("movej", r"if norm\(q.*:", "if 1 > 0.0005 or q[0] > 1:", "compares each of six joints"),
    ("movej", r"> 0.0005", "> q[0]", "a number is needed here"),
    ("movej", r"> 0.0005", "> 0.1", "with one tolerance"),
    ("movej", r"set_tcp\(p\[.*\]\)", "textmsg(1)", "it needs set_tcp, start"),
    ("movej", r"movej\(\[.*", "sleep(1)", "it needs set_tcp, start"),
    ("movej", r"off = .*", "off = 3", "line 13, column 3: a comparison of the arm's kinematics is needed here"),
    ("movej", r"pose_inv\(.*?\)", "p[0, 0, 0, 0, 0, 0]", "line 13, column 3: a comparison of"),
    ("movej", r" > 0.02 or .*:", " > 0.02:", "line 13, column 3: a comparison of"),
    ("servoj", r"(servoj\(.*\n)", r"\1    movej([0, 0, 0, 0, 0, 0])\n", "movej among the servoj of a trajectory"),
    ("servoj", r"servoj\(\[.*?\]", "servoj([1, 2]", "line 47, column .: servoj takes six joint angles, got 2"),
])  # fmt: skip
def test_what_is_not_of_kinreachs_form_is_named(kind, old, new, reason):
    motion = swing() if kind == "servoj" else [Move("movej", HOME + 0.1, 0.5, 1.0)]
    text = Program.of(KIN, HOME, motion).text
    changed = re.sub(old, new, text, count=1)
    assert changed != text
    if reason is None:
        assert Program.parse(changed).moves[0].speed == 1.05  # URScript's own
        return
    with pytest.raises(InputError, match=reason):
        Program.parse(changed)


def test_speeds_are_judged_on_the_way_from_the_move_before():
    """The base of a UR10e turns at 2.09 rad/s, its wrist at 3.14 rad/s."""
    kin = ArmKinematics.of("ur10e", base="base")
    home = np.array(kin.arm.home)
    there = home + np.eye(6)[0]
    moves = [Move("movej", there, 2.0, 1.0), Move("movej", there + np.eye(6)[5], 3.0, 1.0)]
    assert Program.of(kin, home, moves).moves == tuple(moves)
    with pytest.raises(InputError, match=r"move 2 moves shoulder_pan_joint at 3 rad/s, above its limit of 2\.09"):
        Program.of(kin, home, [moves[0], Move("movej", home, 3.0, 1.0)])


def test_only_urs_have_programs():
    with pytest.raises(InputError, match=r"not a UR"):
        Program.of(ArmKinematics("panda"), np.zeros(7), [Move("movej", HOME, 1, 1)])
    with pytest.raises(InputError, match=r"start posture"):
        Program.of(KIN, HOME + 0.1, swing())


REFUSED = {
    "while True:\n  sleep(1)": "the program ends where 'end'",
    "thread f():\nend": "compile error|syntax error",
    "halt 3": "syntax error at '3'",
    "break": "break outside of a loop",
    "socket_open(\"10.0.0.1\", 80)": "function 'socket_open': the simulated robot has no sockets",
    "eval(1)": "function 'eval' is not in",
    "x = y": "name 'y' is not defined",
    "movej = 3": "'movej' cannot be a variable",
    "if = 3": "syntax error at '='",
    "x = 1 +": "syntax error",
    "x = [1, 2": "syntax error",
    "x = (1, 2)": "syntax error",
    "x = 1e999": "too large",
    "x = 1" + 400 * "0": "too large",
    "x = 1" + 9000 * "0": "syntax error",
    "x = " + 100_000 * "1" + "a": "syntax error: a line may have 8192 signs",
    "x = 0x10": "syntax error at",
    "x = [1][0": "syntax error at the end of the line",
    "x = 1 > 2 > 3": "syntax error",
    "movej(*[0])": "syntax error at",
    "movej(norm)": "name 'norm' is not defined",
    "sleep(1, 2)": "sleep has 1 arguments, got 2",
    "movej()": "movej needs the argument q",
    "movej([0], v=1, v=2)": "has no free argument 'v'",
    "movej([0], q=[1])": "has no free argument 'q'",
    "movej([0], w=1)": "has no free argument 'w'; it has: q, a, v, t, r",
    "movej(a=1, [0])": "an argument without a name after one with a name",
    "x = movej([0])": "movej returns no value",
    "x = \"a": "syntax error at",
    "x = 'a'": "syntax error at",
    "x = 1; y = 2": "syntax error at",
    "12 = 3": "syntax error",
    "while = 3": "syntax error at '='",
    "def 12():\nend": "syntax error",
    "textmsg(\"a\" \"b\")": "syntax error at",
    "textmsg(r\"a\")": "syntax error at",
    "sleep(1.2.3)": "syntax error at",
    "x = 1" + " or 1" * 3000: "syntax error",
    "x = " + "[" * 60 + "]" * 60: "levels",
    "x = " + "[" * 9000: "syntax error",
    "x = " + "-" * 90_000 + "1": "syntax error|levels",
    "def f():\n" + "if True:\n" * 60 + "end\n" * 61: "levels",
    "x = " + "-" * 400 + "1": "a line may have 300 operations",
    "def f():\n  x = 1": "syntax error",
    "def f():\n  x = 1\nend\nx = 2": "nothing more is expected",
    "def f(a):\nend": "the program f has arguments, and nothing calls it",
    "def f():\n  g(1)\n  def g(a, b):\n  end\nend": "g needs the argument b",
    "def f():\n  def g():\n  end\n  def g():\n  end\nend": "g is defined twice",
    "def f():\n  thread t():\n  end\n  t()\nend": "t is a thread: run starts it",
    "def f():\n  def g():\n    force_mode()\n  end\n  while True:\n    g()\n  end\nend": "no force control",
    "def f():\n  def g():\n    y = 1\n  end\n  z = y\nend": "name 'y' is not defined",
    "": "a statement is expected",
}  # fmt: skip
