"""URScript as people write it: its words, its functions, threads, and loops that never end."""

import math
import re
import socket
import time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinreach.deploy import _server
from kinreach.deploy._controller import Controller
from kinreach.deploy._interpreter import STEPS
from kinreach.deploy._rtde import RobotMode, RuntimeState
from kinreach.deploy._script_functions import FUNCTIONS
from kinreach.deploy._script_tree import ScriptError
from kinreach.deploy._urscript import parse, parsing
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, pose, pose_vector
from kinreach.robots import get_arm
from tests.deploy.conftest import CALIBRATION

ARM = get_arm("ur5e").calibrated(CALIBRATION)
HOME = np.array(ARM.home)
KIN = ArmKinematics.of(ARM, tip="tool0", base="base")


def listed(values):
    return "[" + ", ".join(repr(float(value)) for value in values) + "]"


def program(text):
    return "def test():\n" + text.strip("\n") + "\nend\n"


@pytest.fixture
def ur():
    controller = Controller(ARM, log=(log := []).append)
    controller.log = log
    return controller


def said(ur, text):
    """What a program says by `textmsg`."""
    ur.log.clear()
    done = ur.run(program(text))
    assert done.reason == "", done.reason
    return [line.removeprefix("textmsg: ") for line in ur.log if line.startswith("textmsg")]


WORDS = {
    "i = 0\nwhile i < 5:\n  i = i + 1\n  if i == 2:\n    continue\n  elif i == 4:\n    break\n  else:\n    textmsg(i)\n"
    "  end\nend":
        ["1", "3"],
    "def f(a, b=2):\n  return a * b\nend\ntextmsg(f(3) + f(3, b=5))": ["21"],
    "def f(n):\n  if n <= 1:\n    return 1\n  end\n  return n * f(n - 1)\nend\ntextmsg(f(6))": ["720"],
    "global a = 1\ndef f():\n  local a = 2\n  global b = 3\n  return a\nend\nc = f()\n"
    "textmsg(str_cat(a, str_cat(b, c)))": ["132"],
    "n = 0\ndef count():\n  n = n + 1\nend\ncount()\ncount()\ntextmsg(n)": ["2"],
    "q = [1, 2, 3]\nr = q\nq[1] = 7\ntextmsg(q, r)": ["[1, 7, 3][1, 2, 3]"],
    "w = p[0, 0, 0, 0, 0, 0]\nw[2] = .5\ntextmsg(w)\ntextmsg(w[2] == 0.5)": ["p[0, 0, 0.5, 0, 0, 0]", "True"],
    "p = [4, 5]\ntextmsg(p[1])": ["5"],
    "textmsg(not (True xor False) or 1 < 2 and 3 != 4)": ["True"],
    "textmsg(1 + 2 * 3 - 8 / 4 % 3)": ["5"],
    "if False and 1 / 0 > 1:\n  textmsg(0)\nend\ntextmsg(\"and stops early\")": ["and stops early"],
    "$ 1 \"Robot Program\"\n# a comment\nset real 1\ntextmsg(\"a # b\") # c": ["a # b"],
    "textmsg(str_at(\"abc\", 1))\ntextmsg(to_str(1.5))\ntextmsg(to_num(\"2.5\") + 1)\ntextmsg(length([1, 2]))":
        ["b", "1.5", "3.5", "2"],
    "textmsg(1)\nhalt\ntextmsg(2)": ["1"],
    "textmsg(str_find(\"abcab\", \"ab\"))\ntextmsg(str_find(\"abcab\", \"ab\", 1))": ["0", "3"],
    "def f(x):\n  if x > 1:\n    return\n  end\n  textmsg(x)\nend\nf(1)\nf(2)": ["1"],
}  # fmt: skip


@pytest.mark.parametrize("text", WORDS)
def test_words(ur, text):
    assert said(ur, text) == WORDS[text]


def test_functions_compute_what_the_manual_says(ur):
    rng, tried = np.random.default_rng(0), 0
    for _ in range(20):
        one, other = rng.uniform(-1, 1, (2, 6))
        T, S = pose(one), pose(other)
        added, less = np.eye(4), np.eye(4)
        added[:3, :3], added[:3, 3] = T[:3, :3] @ S[:3, :3], one[:3] + other[:3]
        less[:3, :3], less[:3, 3] = T[:3, :3] @ S[:3, :3].T, one[:3] - other[:3]
        a, b = f"p{listed(one)}", f"p{listed(other)}"
        for wanted, call in ((T @ S, f"pose_trans({a}, {b})"), (np.linalg.inv(T), f"pose_inv({a})"),
                             (added, f"pose_add({a}, {b})"), (less, f"pose_sub({a}, {b})"),
                             (S, f"interpolate_pose({a}, {b}, 1)")):  # fmt: skip
            (text,) = said(ur, f"textmsg({call})")
            numbers = [float(part) for part in text[2:-1].split(",")]
            np.testing.assert_allclose(pose(numbers), wanted, atol=1e-8)
            tried += 1
        (text,) = said(ur, f"textmsg(pose_dist({a}, {b}))")
        assert float(text) == pytest.approx(float(np.linalg.norm(pose_vector(less))), abs=1e-8)
    assert tried == 100
    assert said(ur, "textmsg(norm([3, 4]))\ntextmsg(r2d(d2r(30)))\ntextmsg(atan2(1, 1))\ntextmsg(floor(-1.5))") == [
        "5", "30", f"{math.pi / 4:.10g}", "-2"]  # fmt: skip


def test_the_state_is_read_on_the_way(ur):
    """By a program beside the one that moves, of the cycle before."""
    ur.tcp, tried = pose([0.01, 0.02, 0.15, 0.1, 0, 0]), 0
    goal = np.add(HOME, [0.5, 0.2, -0.3, 0.2, 0.3, 0.4])
    ur.start(program(f"set_payload(1.5, [0.01, 0.02, 0.03])\nmovej({listed(goal)}, a=4, v=1)"))
    for _ in range(6):
        for _ in range(30):
            ur.tick()
        q, qd, actual, speeds = ur.target_q, ur.target_qd, ur.actual_q, ur.actual_qd
        J, target = KIN.jacobian(q), KIN.fk(q) @ ur.tcp
        arm = (target - KIN.fk(q))[:3, 3]
        twist = J @ qd
        expected = {
            "get_target_joint_positions()": q, "get_target_joint_speeds()": qd,
            "get_actual_joint_positions()": actual, "get_actual_joint_speeds()": speeds,
            "get_target_tcp_pose()": target, "get_actual_tcp_pose()": KIN.fk(actual) @ ur.tcp,
            "get_actual_tool_flange_pose()": KIN.fk(actual), "get_forward_kin()": KIN.fk(actual) @ ur.tcp,
            "get_target_waypoint()": KIN.fk(goal) @ ur.tcp, "get_tcp_offset()": ur.tcp,
            "get_target_tcp_speed()": np.concatenate([twist[:3] + np.cross(twist[3:], arm), twist[3:]]),
            "get_target_payload()": [1.5], "get_target_payload_cog()": [0.01, 0.02, 0.03], "get_steptime()": [0.002],
            "is_steady()": ["False"],
        }  # fmt: skip
        ur.log.clear()
        ur.start("sec ask():\n" + "\n".join(f"  textmsg({call})" for call in expected) + "\nend\n")
        ur.tick()
        lines = [line.removeprefix("textmsg: ") for line in ur.log if line.startswith("textmsg")]
        for (call, value), text in zip(expected.items(), lines, strict=True):
            words = text.removeprefix("p").strip("[]").split(", ")
            if np.shape(value) == (4, 4):
                np.testing.assert_allclose(pose([float(word) for word in words]), value, atol=1e-7, err_msg=call)
            elif call == "is_steady()":
                assert words == value
            else:
                np.testing.assert_allclose([float(word) for word in words], value, atol=1e-7, err_msg=call)
            tried += 1
    assert tried == 6 * 15
    while ur.runtime_state is not RuntimeState.STOPPED:
        ur.tick()
    assert said(ur, "sleep(0.1)\ntextmsg(is_steady())") == ["True"]


def answers(ur, expected):
    """Ask for values, and compare each with the expected one: a number, numbers, a pose, a truth value or a text."""
    lines = said(ur, "\n".join(f"textmsg({call})" for call in expected))
    for (call, value), text in zip(expected.items(), lines, strict=True):
        if isinstance(value, str):
            assert text == value, call
            continue
        words = text.removeprefix("p").strip("[]").split(", ")
        truths = {"True": True, "False": False}
        found = [truths[word] if word in truths else float(word) for word in words]
        if np.shape(value) == (4, 4):
            assert text.startswith("p["), call
            np.testing.assert_allclose(pose(found), value, atol=1e-7, err_msg=call)
        else:
            assert [type(each) is bool for each in found] == [
                type(each) is bool for each in np.atleast_1d(value).tolist()
            ]
            np.testing.assert_allclose(found, np.atleast_1d(value), atol=1e-8, rtol=1e-8, err_msg=call)
    return len(lines)


def test_functions_of_numbers_and_lists_compute_what_their_names_say(ur):
    rng, tried = np.random.default_rng(4), 0
    for _ in range(5):
        x, y = rng.uniform(0.1, 0.9, 2).tolist()
        angles, vector = rng.uniform(-1.5, 1.5, 3), rng.uniform(-1.5, 1.5, 3)
        bits = rng.integers(0, 2, 32).astype(bool)
        bits[31] = False  # the numbers of a program have a sign
        whole = int(sum(1 << place for place in np.flatnonzero(bits).tolist()))
        one, other = rng.uniform(-1, 1, (2, 6))
        expected = {
            **{f"{name}({x!r})": getattr(math, name)(x)
               for name in ("acos", "asin", "atan", "cos", "sin", "sqrt", "tan")},
            f"ceil({5 * x!r})": math.ceil(5 * x), f"floor(-{5 * x!r})": math.floor(-5 * x),
            f"atan2({-x!r}, {-y!r})": math.atan2(-x, -y), f"pow({x!r}, {y!r})": x**y,
            f"log({2 + x!r}, {y!r})": math.log(y, 2 + x), f"d2r({100 * x!r})": math.radians(100 * x),
            f"r2d({x!r})": math.degrees(x), f"norm(-{x!r})": x, f"norm({listed(vector)})": np.linalg.norm(vector),
            f"rpy2rotvec({listed(angles)})": Rotation.from_euler("xyz", angles).as_rotvec(),
            f"rotvec2rpy({listed(vector)})": Rotation.from_rotvec(vector).as_euler("xyz"),
            f"point_dist(p{listed(one)}, p{listed(other)})": np.linalg.norm(one[:3] - other[:3]),
            f"integer_to_binary_list({whole})": bits.tolist(),
            f"binary_list_to_integer([{', '.join(map(str, bits.tolist()))}])": whole,
            f"length({listed(one)})": 6, 'length("abcd")': 4, 'str_len("abc")': 3, 'str_empty("")': True,
            'str_empty(" ")': False, 'str_sub("abcdef", 2)': "cdef", 'str_sub("abcdef", 2, 3)': "cde",
            'str_sub("abcdef", 4, 9)': "ef", 'str_sub("abcdef", 1, -1)': "bcdef", 'str_at("abcdef", 5)': "f",
            'str_find("abcabc", "c", 3)': 5, 'str_find("abc", "d")': -1, f'str_cat({3}, "a")': "3a",
            f'to_num("{x!r}")': x, f"to_str({7})": "7", "to_str(True)": "True",
        }  # fmt: skip
        tried += answers(ur, expected)
    assert tried == 5 * 37


def test_a_payload_is_what_was_set_last(ur):
    """Without a centre it is at the tool for `set_payload` and at the flange for `set_target_payload`."""
    ur.tcp, zero = pose([0.01, 0.02, 0.15, 0.1, 0, 0]), [0.0] * 6
    inertia, tried = [0.1, 0.2, 0.3, 0.01, 0.02, 0.03], 0
    for order, mass, centre, turned in (
        ("set_payload(1.5)", 1.5, (0.01, 0.02, 0.15), zero),
        ("set_payload(2, [0.1, 0.2, 0.3])", 2.0, (0.1, 0.2, 0.3), zero),
        ("set_payload_mass(3)", 3.0, (0.1, 0.2, 0.3), zero),
        ("set_payload_cog([0.3, 0.2, 0.1])", 3.0, (0.3, 0.2, 0.1), zero),
        (f"set_target_payload(1, [0.1, 0, 0], {inertia})", 1.0, (0.1, 0.0, 0.0), inertia),
        ("set_payload_mass(2)", 2.0, (0.1, 0.0, 0.0), inertia),
        ("set_target_payload(4)", 4.0, (0.0, 0.0, 0.0), zero),
        (f"set_target_payload(5, inertia={inertia})", 5.0, (0.0, 0.0, 0.0), inertia),
        ("set_payload(0.5)", 0.5, (0.01, 0.02, 0.15), zero),
    ):
        assert said(ur, order) == []
        tried += answers(ur, {
            "get_target_payload()": mass, "get_target_payload_cog()": centre, "get_target_payload_inertia()": turned,
        })  # fmt: skip
        assert tuple(_server.output(ur, "payload_inertia")) == pytest.approx(turned)
        assert tuple(_server.output(ur, "payload_cog")) == pytest.approx(centre)
    assert tried == 27


def test_each_output_is_set_and_read_by_its_number(ur):
    """Standard outputs are digital outputs 0 to 7, configurable ones 8 to 15, and those of the tool 16 and 17."""
    tried = 0
    for kind, count, first in (("standard_", 8, 0), ("configurable_", 8, 8), ("tool_", 2, 16), ("", 18, 0)):
        for place in (0, count - 1):
            ur.io = type(ur.io)()
            expected = {f"get_digital_out({number})": number == first + place for number in range(18)}
            expected[f"get_{kind}digital_out({place})"] = True
            expected |= {f"get_{kind}digital_in({place})": False, f"get_flag({place})": False}
            assert said(ur, f"set_{kind}digital_out({place}, True)") == []
            tried += answers(ur, expected)
            assert _server.output(ur, "actual_digital_output_bits") == (1 << first + place,)
            assert said(ur, f"set_{kind}digital_out({place}, False)") == []
            assert _server.output(ur, "actual_digital_output_bits") == (0,)
        for call in (f"set_{kind}digital_out({count}, True)", f"x = get_{kind}digital_out({count})",
                     f"x = get_{kind}digital_in(-1)"):  # fmt: skip
            assert f"must be from 0 to {count - 1}" in ur.run(program(call)).reason
    assert said(ur, "set_flag(32, True)\nset_analog_out(0, 0.25)\nset_standard_analog_out(1, 1)") == []
    tried += answers(ur, {
        "get_flag(32)": True, "get_flag(0)": False, "get_analog_out(0)": 0.25, "get_standard_analog_out(0)": 0.25,
        "get_analog_out(1)": 1.0, "get_analog_in(3)": 0.0, "get_standard_analog_in(0)": 0.0,
    })  # fmt: skip
    for call, last in (("get_flag(33)", 32), ("get_analog_out(2)", 1), ("get_analog_in(4)", 3)):
        assert f"must be from 0 to {last}" in ur.run(program(f"x = {call}")).reason
    assert tried == 8 * 21 - 2 + 7


def test_poses_of_joints_and_what_is_in_reach(ur):
    rng, tried = np.random.default_rng(5), 0
    ur.tcp = pose([0.01, 0.02, 0.15, 0.1, 0, 0])
    for _ in range(5):
        q, tool = HOME + rng.uniform(-1, 1, 6), rng.uniform(-0.3, 0.3, 6)
        T = KIN.fk(q)
        tried += answers(ur, {
            f"get_forward_kin({listed(q)})": T @ ur.tcp,
            f"get_forward_kin({listed(q)}, p{listed(tool)})": T @ pose(tool),
            f"get_forward_kin(tcp=p{listed(tool)})": KIN.fk(ur.actual_q) @ pose(tool),
            f"get_inverse_kin_has_solution(p{listed(pose_vector(T @ ur.tcp))})": True,
            f"is_within_safety_limits(p{listed(pose_vector(T @ ur.tcp))})": True,
            f"is_within_safety_limits({listed(q)})": True,
            f"is_within_safety_limits({listed([*q[:5], 2 * math.pi + rng.uniform(0.01, 1)])})": False,
            f"get_inverse_kin_has_solution(p{listed([1.5, *pose_vector(T)[1:]])})": False,
            f"is_within_safety_limits(p{listed([1.5, *pose_vector(T)[1:]])})": False,
        })  # fmt: skip
    assert tried == 45


def test_a_program_may_take_the_arms_power(ur):
    assert said(ur, "textmsg(1)\npowerdown()\nsleep(0.01)\ntextmsg(2)")[:1] == ["1"]
    assert ur.robot_mode is RobotMode.POWER_OFF
    assert ur.runtime_state is RuntimeState.STOPPED
    assert [line for line in ur.log if "power" in line] == ["the power of the arm is off"]


def test_random_is_drawn_evenly_from_0_to_1(ur):
    text = "i = 0\nwhile i < 200:\n  textmsg(random())\n  i = i + 1\nend"
    drawn = np.array([float(line) for line in said(ur, text)])
    assert len(set(drawn)) == 200
    assert ((drawn >= 0.0) & (drawn < 1.0)).all()
    shares = np.histogram(drawn, bins=4, range=(0, 1))[0] / 200
    np.testing.assert_allclose(shares, 0.25, atol=0.12)


def test_get_inverse_kin_is_nearest(ur):
    """With the arm's own calibration, and the active tool centre point or another one."""
    rng, found = np.random.default_rng(1), 0
    ur.tcp = pose([0.01, 0.02, 0.15, 0.1, 0, 0])
    for _ in range(30):
        near = HOME + rng.uniform(-0.5, 0.5, 6)
        flange = KIN.fk(HOME + rng.uniform(-0.8, 0.8, 6))
        for tcp, argument in ((ur.tcp, ""), (np.eye(4), ", tcp=p[0, 0, 0, 0, 0, 0]")):
            target = f"p{listed(pose_vector(flange @ tcp))}"
            (text,) = said(ur, f"textmsg(get_inverse_kin({target}, qnear={listed(near)}{argument}))")
            q = np.array([float(part) for part in text[1:-1].split(",")])
            np.testing.assert_allclose(q, KIN.nearest(flange, near).q, atol=1e-7)
            found += 1
    assert found == 60
    assert said(ur, "textmsg(get_inverse_kin_has_solution(p[3, 0, 0, 0, 0, 0]))") == ["False"]


@pytest.mark.slow
def test_moves_with_a_time_a_pose_and_joints(ur):
    goal = np.add(HOME, [0.3, 0.1, -0.1, 0, 0.1, 0])
    for t in (0.5, 1.0, 2.0):
        ur.place(HOME)
        done = ur.run(program(f"movej({listed(goal)}, a=20, t={t})"))
        assert done.commanded.duration == pytest.approx(t, abs=3 * ur.cycle)
        np.testing.assert_allclose(done.commanded.q[-1], goal, atol=1e-12)
    target = pose_vector(KIN.fk(goal) @ ur.tcp)
    for line in (f"movej(p{listed(target)})", f"movel({listed(goal)})", f"movep(p{listed(target)})",
                 f"movel(p{listed(target)}, t=2)"):  # fmt: skip
        ur.place(HOME)
        assert ur.run(program(line)).reason == ""
        np.testing.assert_allclose(ur.target_q, goal, atol=1e-6)


@pytest.mark.parametrize("mode", [0, 1])
@pytest.mark.slow
def test_movec_is_on_the_circle_through_three_points(ur, mode):
    start = ur.tcp_pose(HOME)
    via, end = (np.add(start, way) for way in ([0.06, 0, 0.06, 0, 0, 0], [0.12, 0, 0, 0, 0, 0]))
    done = ur.run(program(f"movec(p{listed(via)}, p{listed(end)}, a=1.2, v={0.5 if mode else 0.1}, mode={mode})"))
    assert done.reason == ""
    points = np.array([ur.tcp_pose(q) for q in done.commanded.q])
    off = np.linalg.norm(points[:, :3] - (start + end)[:3] / 2, axis=1) - 0.06
    assert np.abs(off).max() < 1e-8
    assert np.linalg.norm(points[:, :3] - via[:3], axis=1).min() < 1e-4
    np.testing.assert_allclose(points[-1, :3], end[:3], atol=1e-8)
    turned = np.arccos(np.clip((np.trace(pose(start)[:3, :3].T @ pose(points[-1])[:3, :3]) - 1) / 2, -1, 1))
    assert turned == pytest.approx(np.pi if mode else 0.0, abs=1e-6)
    np.testing.assert_allclose(np.diff(done.commanded.q, axis=0) / ur.cycle,
                               (done.commanded.qd[1:] + done.commanded.qd[:-1]) / 2, atol=5e-3)  # fmt: skip
    assert "not on a line" in ur.run(program(f"movec(p{listed(end)}, p{listed(end)})")).reason


@pytest.mark.parametrize("mode", [0, 1])
def test_a_small_arc_is_followed_and_turned_along(ur, mode):
    """As far as it has come, it has turned: to the rotation of the end, or with the circle."""
    ur.tcp = pose([0.01, 0.02, 0.15, 0.1, 0, 0])
    start = KIN.fk(HOME) @ ur.tcp
    angle, radius = 0.6, 0.03
    x, y, _ = start[:3, :3] @ Rotation.random(random_state=3).as_matrix()
    centre = start[:3, 3] - radius * x
    via, end = (centre + radius * (np.cos(each) * x + np.sin(each) * y) for each in (0.35, angle))
    T = start.copy()
    T[:3, 3], own = end, Rotation.from_rotvec(0.4 * np.array([0.6, 0.0, 0.8]))
    T[:3, :3] = start[:3, :3] @ own.as_matrix()
    goal = KIN.nearest(T @ np.linalg.inv(ur.tcp), HOME).q
    to = listed(goal) if mode == 0 else f"p{listed(pose_vector(T))}"  # where joints are given, their pose is meant
    middle = np.concatenate([via, pose_vector(start)[3:]])
    done = ur.run(program(f"movec(p{listed(middle)}, {to}, a=8, v=2, mode={mode})"))
    assert done.reason == ""
    seen, most = 0, angle if mode else 0.4
    for q in done.commanded.q[:: max(1, len(done.commanded.q) // 20)]:
        now = KIN.fk(q) @ ur.tcp
        way = now[:3, 3] - centre
        assert abs(way @ np.cross(x, y)) < 1e-7
        assert np.linalg.norm(way) == pytest.approx(radius, abs=1e-7)
        covered = math.atan2(way @ y, way @ x) / angle
        assert -1e-6 < covered < 1 + 1e-6
        turned = Rotation.from_matrix(now[:3, :3] @ start[:3, :3].T).as_rotvec()
        axis = np.cross(x, y) if mode else start[:3, :3] @ [0.6, 0.0, 0.8]
        np.testing.assert_allclose(turned, covered * most * axis, atol=1e-5)
        seen += 1
    assert seen >= 20
    np.testing.assert_allclose((KIN.fk(ur.target_q) @ ur.tcp)[:3, 3], end, atol=1e-7)


@pytest.mark.parametrize("turning", [None, 3.0])
def test_tool_speeds_change_with_their_accelerations(ur, turning):
    """Those of the tool centre point, and those of its turns, which are the same number where just one is given."""
    ur.tcp, rng = pose([0.01, 0.02, 0.15, 0.1, 0, 0]), np.random.default_rng(6)
    ways = rng.normal(size=(2, 3))
    wanted = (ways / np.linalg.norm(ways, axis=1)[:, None] * [[0.08], [0.15]]).ravel()
    more = "" if turning is None else f", aRot={turning}"
    done = ur.run(program(f"speedl({listed(wanted)}, 0.8, t=0.25{more})\nstopl(1.5{more})"))
    assert done.reason == ""
    speeds = np.array([ur.tcp_speed(q, qd) for q, qd in zip(done.commanded.q, done.commanded.qd, strict=True)])
    np.testing.assert_allclose(speeds[120], wanted, atol=2e-3)
    assert not speeds[-1].any()
    for part, change, stop in ((slice(3), 0.8, 1.5), (slice(3, 6), turning or 0.8, turning or 1.5)):
        size, full = np.linalg.norm(speeds[:, part], axis=1), np.linalg.norm(wanted[part])
        begin = np.flatnonzero(size > 0)[0]
        t = ur.cycle * np.arange(1, 60)
        np.testing.assert_allclose(size[begin : begin + 59], np.minimum(change * t, full), atol=0.02 * full + 1e-3)
        direction = speeds[begin + 20, part] / size[begin + 20]
        np.testing.assert_allclose(direction, wanted[part] / full, atol=0.02)
        last = np.flatnonzero(size > 0.98 * full)[-1]
        np.testing.assert_allclose(size[last : last + 20], np.maximum(full - stop * ur.cycle * np.arange(20), 0.0),
                                   atol=0.03 * full + 3e-3)  # fmt: skip


def test_moves_to_poses_and_to_joints_end_there(ur):
    goal, moved = np.add(HOME, [0.03, 0.02, -0.03, 0, 0.02, 0]), 0
    ur.tcp = pose([0.01, 0.02, 0.15, 0.1, 0, 0])
    joints, target = listed(goal), f"p{listed(pose_vector(KIN.fk(goal) @ ur.tcp))}"
    for line in (f"movej({target}, a=20, v=3)", f"movej({joints}, a=20, t=0.1)", f"movel({joints}, a=3, v=1)",
                 f"movel({target}, t=0.2)", f"movep({target}, a=3, v=1)", f"movep({joints}, a=3, v=1)"):  # fmt: skip
        ur.place(HOME)
        done = ur.run(program(line))
        assert done.reason == ""
        np.testing.assert_allclose(ur.target_q, goal, atol=1e-6)
        if "t=" in line:
            seconds = float(line[line.index("t=") + 2 : -1])
            assert np.count_nonzero(done.commanded.qd.any(axis=1)) * ur.cycle == pytest.approx(seconds, abs=0.005)
        moved += 1
    assert moved == 6
    for line in (f"movep({joints[:-1]}, 1])", "movec([1, 2], p[0, 0, 0, 0, 0, 0])", "servoj(p[0, 0, 0, 0, 0, 0])"):
        assert "takes a" in ur.run(program(line)).reason


def test_speeds_are_reached_and_kept(ur):
    wanted = np.array([0.2, 0, 0, 0, -0.1, 0])
    done = ur.run(program(f"speedj({listed(wanted)}, 1, 0.8)\nstopj(4)"))
    assert done.reason == ""
    assert np.abs(done.commanded.qd - wanted).max(axis=1).min() < 1e-9
    assert not done.commanded.qd[-1].any()
    begin = ur.tcp_pose(ur.target_q)
    done = ur.run(program("speedl([0, 0.05, -0.02, 0, 0, 0], 0.5, 1.0)\nstopl(1)"))
    assert done.reason == ""
    speeds = np.array([ur.tcp_speed(q, qd) for q, qd in zip(done.commanded.q, done.commanded.qd, strict=True)])
    assert np.abs(speeds[200:450] - [0, 0.05, -0.02, 0, 0, 0]).max() < 1e-3
    way = ur.tcp_pose(ur.target_q) - begin
    np.testing.assert_allclose(way[1:3] / way[1], [1, -0.4], atol=1e-3)
    np.testing.assert_allclose(way[3:], 0, atol=1e-4)


class TestThreads:
    def test_they_take_turns_in_every_control_cycle(self, ur):
        text = """
x = 0
thread count():
  while True:
    x = x + 1
    sync()
  end
end
h = run count()
sleep(0.2)
kill h
y = x
sleep(0.1)
textmsg(x == y)
textmsg(x)
"""
        same, count = said(ur, text)
        assert same == "True"
        assert float(count) == pytest.approx(0.2 / ur.cycle, abs=3)

    def test_join_waits_and_the_main_thread_moves(self, ur):
        text = f"""
thread slow():
  sleep(0.3)
  textmsg("slow")
end
h = run slow()
movej({listed(HOME + 0.05)}, a=5, v=1)
textmsg("moved")
join h
textmsg("joined")
"""
        assert said(ur, text) == ["moved", "slow", "joined"]

    def test_a_handle_of_0_is_no_thread(self, ur):
        """Programs set a handle to 0 before they run a thread, and kill it in any case."""
        assert said(ur, "t = 0\nkill t\njoin t\ntextmsg(1)") == ["1"]

    def test_two_cannot_move_the_arm(self, ur):
        text = f"thread t():\n  movej({listed(HOME + 0.2)})\nend\nh = run t()\nmovej({listed(HOME - 0.2)})\n"
        assert "another thread is already controlling the robot" in ur.run(program(text)).reason

    def test_in_a_critical_section_a_thread_is_alone(self, ur):
        """Also if it ends in it: others go on then."""
        count = (
            "x = 0\nthread count():\n  while True:\n    x = x + 1\n    sync()\n  end\nend\nrun count()\nsleep(0.05)\n"
        )
        alone = "enter_critical\ny = x\nsleep(0.1)\ntextmsg(x == y)\nexit_critical\nsleep(0.1)\ntextmsg(x > y + 10)"
        assert said(ur, count + alone) == ["True", "True"]
        ends = "thread ends():\n  enter_critical\n  sleep(0.05)\nend\nh = run ends()\njoin h\n"
        assert said(ur, f"{count}{ends}y = x\nsleep(0.1)\ntextmsg(x > y + 10)") == ["True"]

    def test_a_killed_one_stops_the_arm(self, ur):
        text = f"thread t():\n  movej({listed(HOME + 0.5)}, a=2, v=1)\nend\nh = run t()\nsleep(0.4)\nkill h\nsleep(0.5)"
        assert ur.run(program(text)).reason == ""
        assert not ur.target_qd.any()
        assert 0.02 < ur.target_q[0] - HOME[0] < 0.4


@pytest.mark.parametrize("text", ["x = [" + ", ".join(["a"] * 2000) + "]", "x = 1\n" * 500])
def test_a_long_program_is_read_in_parts_however_long_its_lines_are(text):
    """The robot's cycle goes on between two parts."""
    parts = sum(1 for _ in parsing(program("a = 1\n" + text)))
    assert parts > 80


def test_a_value_in_the_next_line_and_two_assignments_in_one(ur):
    """As ur_rtde's control script has them, and variables whose names begin as functions that the robot lacks."""
    body = "global a = # a comment\n\n3    global force_mode_type =\n4\nlocal c = 5 global d = 6\n"
    assert said(ur, body + 'textmsg(a + force_mode_type, "")\ntextmsg(c, d)') == ["7", "56"]
    inner = "def scaled(p, factor):\np[0] = p[0] * factor\np[1 + 1] = p[1]\nreturn p\nend\n"
    assert said(ur, inner + "textmsg(scaled(p[1, 2, 3, 0, 0, 0], 2))") == ["p[2, 2, 2, 0, 0, 0]"]
    for wrong in ("a = 1 b = 2", "p[1, 2] = 3", "p[1]"):
        with pytest.raises(ScriptError, match="syntax error"):
            parse(f"def f():\n p = [1, 2]\n {wrong}\nend")


def test_the_robot_remembers_where_it_was(ur):
    body = "speedj([0.2, 0, 0, 0, 0, 0], 1, 0.3)\nnow = get_actual_joint_positions()\n"
    for steps in (0, 1, 40):
        end = "write_output_float_register(0, now[0])\nwrite_output_float_register(1, past[0])"
        done = ur.run(program(f"{body}past = get_actual_joint_positions_history({steps})\n{end}"))
        ((row,),) = np.nonzero(done.measured.q[:, 0] == ur.io.floats[0])
        assert done.measured.q[row - steps, 0] == ur.io.floats[1]
    assert "steps must be from 0 to" in ur.run(program("q = get_actual_joint_positions_history(500)")).reason


@pytest.mark.parametrize("loop", ["while True:\n  x = 1\nend", "def f():\n  while True:\n  end\nend\nf()",
                                  "thread t():\n  while True:\n  end\nend\nrun t()\nwhile True:\nend"])  # fmt: skip
def test_a_loop_that_never_waits_delays_nothing_and_ends_with_the_next_program(ur, loop):
    ur.start(program(loop))
    for _ in range(20):
        ur.tick()
    assert ur.runtime_state is RuntimeState.PLAYING
    ur.end_program()
    ur.tick()
    assert ur.runtime_state is RuntimeState.STOPPED
    ur.start(program(loop))
    ur.tick()
    assert ur.run(program(f"movej({listed(HOME + 0.1)})")).reason == ""


@pytest.mark.parametrize(("text", "reason"), [
    ("def f():\n  f()\nend\nf()", "functions call one another"),
    ("x = [1]\nwhile True:\n  x = [x, x]\nend", "levels within one another|at most 10000"),
    ("x = \"a\"\nwhile True:\n  x = str_cat(x, x)\nend", "a text may have 10000 signs"),
    ("thread t():\n  sleep(9)\nend\nwhile True:\n  run t()\nend", "50 threads at a time"),
])  # fmt: skip
def test_memory_is_bounded(ur, text, reason):
    found = ur.run(program(text), longest=60.0).reason
    assert re.search(reason, found)
    assert found.startswith("line ")


def test_a_statement_leaves_nothing_behind(ur):
    """However long a program runs: values that nobody takes, arguments, what `and` has begun, threads that ended."""
    body = """
def f(x):
  return x
end
thread t():
  sleep(0.001)
end
while True:
  f(1)
  sin(1)
  sleep(0.001)
  y = f(2) + sin(f(3))
  if True and False or y > 0:
    y = [1, f(4)]
    y[1] = 2
  end
  run t()
  sync()
end
"""
    ur.start(program(body))
    for _ in range(100):
        ur.tick()
    machine = ur._program
    left = [value for value in machine._main._stack if value is not None]
    assert (left, len(machine._main._stack) <= 1, len(machine._main._frames)) == ([], True, 1)
    assert len(machine._threads) <= 3
    assert machine.variables["y"] == (1.0, 2.0)


def test_a_program_takes_a_bounded_number_of_steps_in_a_cycle(ur):
    ur.start(program("x = 0\nwhile True:\n  x = x + 1\nend"))
    counts = []
    for _ in range(10):
        ur.tick()
        counts.append(ur._program.variables["x"])
    assert (np.diff(counts) > 10).all()
    assert np.diff(counts).max() <= STEPS


def test_what_the_simulated_robot_lacks_is_refused_where_it_would_be_called():
    for text, reason in (("socket_open(\"10.0.0.1\", 80)", "'socket_open': the simulated robot has no sockets"),
                         ("while True:\n  force_mode(1)\nend", "has no force control"),
                         ("thread t():\n  freedrive_mode()\nend\nrun t()", "cannot be moved by hand")):  # fmt: skip
        with pytest.raises(ScriptError, match=reason) as refused:
            parse(program(text))
        assert refused.value.line >= 2
        assert refused.value.column >= 1
    ur = Controller(ARM)
    assert ur.run(program("if 1 > 2:\n  force_mode(1)\nend")).reason == ""
    assert (
        "line 3, column 3: runtime error: function 'force_mode'"
        in ur.run(program("if True:\n  force_mode()\nend")).reason
    )


RUN_TO = {
    "get_forward_kin(p[0, 0, 0, 0, 0, 0])": "get_forward_kin takes a list of six joint angles, got [0.0, 0.0, 0.0, 0.0",
    "get_forward_kin([1, 2])": "get_forward_kin takes a list of six joint angles, got [1.0, 2.0]",
    "get_inverse_kin(get_actual_tcp_pose(), qnear=[1])": "qnear is a list of six joint angles, got [1.0]",
    "get_inverse_kin([1, 2, 3, 4, 5, 6])": "a pose p[...] is needed, got ",
    "set_standard_analog_out(0, 1.01)": "an analog output is from 0 to 1, got 1.01",
    "set_standard_analog_out(0, -0.01)": "an analog output is from 0 to 1, got -0.01",
    "write_output_integer_register(0, 2147483648)": "value of a register must be from -2^31 to 2^31 - 1, got ",
    "write_output_integer_register(0, -2147483649)": "value of a register must be from -2^31 to 2^31 - 1, got ",
    'str_at("abc", 0.5)': "a whole number is needed, got 0.5",
    "set_target_payload(1, [1, 2])": "a list of 3 numbers is needed, got [1.0, 2.0]",
    "norm([True])": "a number is needed, got True",
    "binary_list_to_integer([1])": "1.0 is neither true nor false",
    "binary_list_to_integer(3)": "a list of at most 32 truth values is needed, got 3",
    'str_sub("abc", 4)': "the text has no sign 4",
    'str_sub("abc", -1)': "the text has no sign -1",
    "str_sub(1, 0)": "a text is needed, got 1",
    'to_num("x")': "'x' is not a number",
    "x = [1]\nx[1] = 2": "x has no entry 1",
    "x = [1]\ny = x[-1]": "x has no entry -1",
    "def f():\n  sleep(0)\nend\nx = [1]\nx[0] = f()": "an entry of x is set to the value of a function that",
    "def f():\n  sleep(0)\nend\nx = f()": "x is set to the value of a function that returns none",
    "def f():\n  sleep(0)\nend\nx = [f()]": "a list has values, and at most 10000",
    "x = p[1, 2]": "a pose has six numbers, got 2",
    'x = "a"\nwhile True:\n  x = x + x\nend': "a text may have 10000 signs",
    "x = 1 / 0": "1 / 0 has no value",
    "if 1:\n  halt\nend": "1.0 is neither true nor false",
    "x = True and 1": "and is for truth values, got 1.0",
    "x = 0 or True": "or is for truth values, got 0.0",
    "x = not 1": "1.0 is neither true nor false",
    "x = 1 < True": "a number is needed, got True",
}


@pytest.mark.parametrize("text", RUN_TO)
def test_what_a_statement_cannot_do_ends_the_program_with_its_reason(ur, text):
    done = ur.run(program(text)).reason
    assert RUN_TO[text] in done
    assert re.match(r"line \d+, column \d+: runtime error: ", done)


def test_bounds_themselves_are_allowed(ur):
    text = "set_standard_analog_out(0, 1)\nset_standard_analog_out(1, 0)\nwrite_output_integer_register(0, 2147483647)"
    text += '\nwrite_output_integer_register(1, -2147483648)\ntextmsg(str_sub("abc", 3))'
    text += '\ntextmsg(str_sub("abcd", 1, 2))\ntextmsg(str_sub("abc", 1, -1))'
    text += "\ntextmsg(binary_list_to_integer([True, False, True]))\ntextmsg(integer_to_binary_list(6)[1])"
    text += '\ntextmsg(norm([3, 4]))\ntextmsg(norm(-2))\ntextmsg("a" + "b")\ntextmsg(1 == True)\ntextmsg(1 != 1)'
    text += "\ntextmsg(is_within_safety_limits(get_actual_tcp_pose()))\ntextmsg(is_within_safety_limits([0,0,9,0,0,0]))"
    text += "\ntextmsg(is_within_safety_limits(p[9, 0, 0, 0, 0, 0]))\ntextmsg(is_within_safety_limits([0,0,1,0,0,0]))"
    expected = ["", "bc", "bc", "5", "True", "5", "2", "ab", "False", "False", "True", "False", "False", "True"]
    assert said(ur, text) == expected


@pytest.mark.parametrize(
    ("text", "reason"),
    {
        "sec": (program("sec f():\n  halt\nend"), "a secondary program within another program"),
        "arguments": (program("def f(a, a):\n  return a\nend"), "two arguments are called 'a'"),
        "twice": (program("def f():\n  halt\nend\ndef f():\n  halt\nend"), "f is defined twice"),
        "function": (program("def f():\n  halt\nend\nf = 1"), "'f' is a function, and cannot be a variable"),
        "thread": ("thread t():\n  halt\nend\n", "a thread belongs into a program"),
        "statements": ("textmsg(1)\ntextmsg(2)\n", "nothing more is expected after a statement"),
        "after": (program("halt") + "halt\n", "nothing more is expected after the end of a program"),
        "not called": ("def f(a):\n  textmsg(a)\nend\n", "f has arguments, and nothing calls it"),
        "nothing": ("\n", "the program ends where a statement is expected"),
        "many": (program("sleep()"), "sleep needs the argument t"),
        "more": (program("sleep(1, 2)"), "sleep has 1 arguments, got 2"),
        "none": (program("x = sleep(1)"), "sleep returns no value"),
        "other": (program("sleep(s=1)"), "sleep has no free argument 's'; it has: t"),
    }.values(),
)  # fmt: skip
def test_what_is_no_program_is_refused_before_it_begins(ur, text, reason):
    with pytest.raises(ScriptError, match=rf"(compile|syntax) error.*{re.escape(reason)}"):
        parse(text)
    assert ur.log == []


def test_outputs_and_registers_are_seen_by_rtde(ur):
    text = """
set_digital_out(2, True)
set_configurable_digital_out(1, True)
set_tool_digital_out(0, True)
set_standard_analog_out(1, 0.25)
set_tool_voltage(24)
set_payload(1.5, [0, 0, 0.05])
set_gravity([0, 0, 9.8])
write_output_float_register(3, 1.5)
write_output_boolean_register(5, True)
write_output_integer_register(7, -2)
textmsg(get_digital_out(2))
textmsg(read_output_float_register(3))
"""
    assert said(ur, text) == ["True", "1.5"]
    for name, values in {
        "actual_digital_output_bits": (1 << 2 | 1 << 9 | 1 << 16,), "standard_analog_output1": (0.25,),
        "tool_output_voltage": (24,), "payload": (1.5,), "payload_cog": (0, 0, 0.05), "target_gravity": (0, 0, 9.8),
        "output_double_register_3": (1.5,), "output_bit_registers0_to_31": (1 << 5,), "output_int_register_7": (-2,),
    }.items():  # fmt: skip
        assert tuple(_server.output(ur, name)) == values, name


@pytest.mark.parametrize(
    ("kind", "count", "default", "value"),
    [("float", 48, "0", "1.5"), ("integer", 48, "0", "-3"), ("boolean", 128, "False", "True")],
)
def test_each_register_has_its_own_value_and_one_that_nobody_wrote_is_zero(ur, kind, count, default, value):
    rng, tried = np.random.default_rng(0), 0
    for place in (0, count - 1, *rng.integers(1, count - 1, 3).tolist()):
        others = [other for other in (0, place - 1, place + 1, count - 1) if 0 <= other < count and other != place]
        ur.io, ur.registers = type(ur.io)(), {}
        read = [f"read_output_{kind}_register({place})", *(f"read_output_{kind}_register({i})" for i in others)]
        read += [f"read_input_{kind}_register({i})" for i in (place, *others)]
        text = "\n".join(f"textmsg({each})" for each in read)
        assert said(ur, text) == [default] * len(read)
        assert said(ur, f"write_output_{kind}_register({place}, {value})\n{text}") == [
            value,
            *[default] * (len(read) - 1),
        ]
        tried += len(read)
    assert tried > 25
    for place in (-1, count, 0.5):
        for call in (f"read_output_{kind}_register({place})", f"read_input_{kind}_register({place})"):
            assert f"must be from 0 to {count - 1}" in ur.run(program(f"textmsg({call})")).reason


def test_a_secondary_program_runs_beside(ur):
    ur.start(program('sleep(0.1)\ntextmsg("main")'))
    ur.tick()
    ur.start("sec other():\n  set_digital_out(0, True)\nend\n")
    for _ in range(200):
        ur.tick()
    assert ur.io.digital == 1
    assert "textmsg: main" in ur.log
    ur.start(program('sleep(0.1)\ntextmsg("goes on")'))
    ur.tick()
    ur.start('sec other():\n  x = 1 / 0\n  textmsg("not said")\nend\n')
    for _ in range(200):
        ur.tick()
    assert "secondary program stopped: line 2, column 9: runtime error: 1 / 0 has no value" in ur.log
    assert ur.log[-2:] == ["textmsg: goes on", "program finished"]
    assert "textmsg: not said" not in ur.log
    with pytest.raises(InputError, match="cannot move the arm"):
        ur.start("sec other():\n  movej([0, 0, 0, 0, 0, 0])\nend\n")


EXPORTED = """def Palletise():
  global _hidden_verificationVariable=0
  step_count = 0.0
  thread Step_Counter():
    while (True):
      step_count = step_count + 1.0
      sync()
    end
  end
  run Step_Counter()
  set_standard_analog_input_domain(0, 1)
  set_tool_analog_input_domain(0, 1)
  set_analog_outputdomain(0, 0)
  set_input_actions_to_default()
  set_tool_communication(False, 115200, 0, 1, 1.5, 3.5)
  set_tool_voltage(0)
  set_gravity([0.0, 0.0, 9.82])
  set_tcp(p[0.0,0.0,0.12,0.0,0.0,0.0])
  set_target_payload(1.200000, [0.000000, 0.000000, 0.050000], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
  global Above_p=%s
  global Above_q=%s
  global Down_p=%s
  global Down_q=%s
  global rounds = 0
  while (True):
    $ 1 "Robot Program"
    $ 2 "MoveJ"
    $ 3 "Above" "breakAfter"
    movej(get_inverse_kin(Above_p, qnear=Above_q), a=1.3962634015954636, v=1.0471975511965976)
    $ 4 "MoveL"
    $ 5 "Down"
    movel(pose_trans(p[0.0,0.0,0.0,0.0,0.0,0.0], Down_p), a=1.2, v=0.25)
    $ 6 "Set DO[0]=On"
    set_standard_digital_out(0, True)
    $ 7 "Wait: 0.1"
    sleep(.1)
    rounds = rounds + 1
    $ 8 "If rounds≥2"
    if (rounds >= 2):
      halt
    end
  end
end
"""


@pytest.mark.slow
def test_a_waypoint_program_as_polyscope_exports_it(ur):
    tcp = pose([0, 0, 0.12, 0, 0, 0])
    above = np.add(HOME, [0.2, 0, 0, 0, 0.1, 0])
    T = KIN.fk(above)
    down = T.copy()
    down[2, 3] -= 0.08
    q = KIN.nearest(down, above).q
    text = EXPORTED % (
        f"p{listed(pose_vector(T @ tcp))}",
        listed(above),
        f"p{listed(pose_vector(down @ tcp))}",
        listed(q),
    )
    done = ur.run(text)
    assert done.reason == ""
    np.testing.assert_allclose(done.commanded.q[-1], q, atol=1e-6)
    assert np.abs(done.commanded.q - above).max(axis=1).min() < 1e-6
    assert ur.io.digital == 1


def test_every_function_is_simulated(ur):
    """Each that the parser knows is known to the robot, too: none ends in "is not simulated"."""
    values = {"t": "0.01", "b": "True", "n": "0", "q": listed(HOME), "tcp": "p[0, 0, 0, 0, 0, 0]"}
    tried = 0
    for name, function in FUNCTIONS.items():
        given = ", ".join(values.get(parameter, "1") for parameter, default in function.parameters.items()
                          if default.__class__ is type)  # fmt: skip
        ur.release()
        reason = ur.run(program(f"x = {name}({given})" if function.returns else f"{name}({given})")).reason
        assert "is not simulated" not in reason, reason
        tried += 1
    assert tried > 110


def test_what_people_send_to_the_script_port_runs():
    """A function and its call, two lines at once, comments, what ends in a carriage return, what takes long to read."""
    lines = {
        b"def f(x):\n  textmsg(x)\nend\nf(3)\n": ["3"],
        b"def g():\n  textmsg(4)\n  sleep(0.2)\nend\ng()\n": ["4"],
        b"textmsg(1)\ntextmsg(2)\n": ["1", "2"],
        b"# a comment\ntextmsg(5)\r\n": ["5"],
        b"set real 1\ntextmsg(6)\n": ["6"],
        b"sec s():\n  textmsg(7)\nend\n": ["7"],
        b"def long():\n  if False:\n" + 1000 * b"    x = 1\n" + b"  end\n  textmsg(8)\nend\n": ["8"],
    }
    log = []
    with _server.SimulatedUR(ARM, rtde_port=0, script_port=0, speed=20, log=log.append) as robot:
        for text, wanted in lines.items():
            with socket.create_connection((robot.address, robot.script_port), 20) as client:
                client.sendall(text + b'textmsg("done")\n')
                deadline = time.monotonic() + 20
                while "textmsg: done" not in log and time.monotonic() < deadline:
                    client.recv(4096)
            assert [line.removeprefix("textmsg: ") for line in log if line.startswith("textmsg")] == [*wanted, "done"]
            log.clear()
