"""`kinreach simulate-ur --program`: what a program of somebody does, without a robot and without ports."""

import re

import numpy as np
import pytest

from kinreach.cli import main
from kinreach.deploy import SimulatedUR
from kinreach.kinematics import URKinematics

UP = "movej([0, -1.57, 1.57, -1.57, -1.57, 0], a=1.2, v=0.5)"


@pytest.fixture
def tried(tmp_path, capsys):
    """`tried(lines, *flags)`: the exit code of a program with these lines, and what was said."""

    def run(lines, *flags, name="mine.script"):
        file = tmp_path / name
        file.write_text("\n".join(["def mine():", *(f"  {line}" for line in lines), "end", ""]))
        code = main(["simulate-ur", "--arm", "ur5e", "--program", str(file), *flags])
        said = capsys.readouterr()
        return code, said.out, said.err

    return run


def numbers(line):
    return np.array(re.findall(r"-?\d+\.\d{4}", line), dtype=float)


def test_it_ends_where_its_last_move_does(tried):
    code, out, err = tried([UP, "movej([0.3, -1.4, 1.2, -1.3, -1.5, 0.2], a=1.2, v=0.8)"])
    assert (code, err) == (0, "")
    assert "no collision with itself, table, floor" in out
    assert re.search(r"dry run  \d\.\d\d s; elbow at most 0.6\d rad/s, 21 % of its limit; tool at most", out)
    angles, tool = (numbers(line) for line in out.splitlines()[-2:])
    np.testing.assert_allclose(angles, [0.3, -1.4, 1.2, -1.3, -1.5, 0.2], atol=1e-3)
    T = URKinematics("ur5e", base="base").fk(angles)
    np.testing.assert_allclose(tool[:3], T[:3, 3], atol=1e-3)


def test_the_start_and_what_is_around_are_chosen(tried):
    start, block = ("--from", "0.2,-1.2,1.2,-1.5,-1.5,0"), ("--box", "-0.4,-0.13,0.2,0.3,0.3,0.3")
    assert tried(["movej([0.3, -1.2, 1.2, -1.5, -1.5, 0])"], *start)[0] == 0
    down = [UP, "movel(pose_add(get_actual_tcp_pose(), p[0, 0, -0.25, 0, 0, 0]), a=0.5, v=0.1)"]
    assert tried(down)[0] == 0
    code, out, err = tried(down, *block)
    assert code == 2
    assert "no collision" not in out
    assert re.search(r"mine.script does not come to its end: collision: .* touches box", err)


def test_the_longest_time_is_above_0_and_at_most_ten_minutes(tried):
    code, out, err = tried(["sleep(0.02)"], "--longest", "0.5")
    assert (code, err) == (0, "")
    assert "goes on" not in out
    code, out, _ = tried(["sleep(3)"], "--longest", "0.05")
    assert code == 0
    assert "it goes on after these 0.05 s; --longest lets it run longer" in out
    assert "no collision with itself" in out
    for longest in ("0", "600.1"):
        code, out, err = tried(["sleep(0.02)"], "--longest", longest)
        assert (code, out) == (2, "")
        assert "--longest must be" in err


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (["movej([0, -1.57, 1.57, -1.57, -1.57, 0], v=0.5"], "line 2, column"),
        (['socket_open("10.0.0.1", 50000)'], "socket_open"),
        ([UP, "movel(pose_add(get_actual_tcp_pose(), p[0, 0, 2, 0, 0, 0]))"], "leaves the reach"),
        ([UP, "movel(pose_add(get_actual_tcp_pose(), p[0, 0, -0.6, 0, 0, 0]), v=0.3)"], "touches table"),
    ],
)
def test_what_stops_it_is_said(tried, lines, said):
    code, out, err = tried(lines)
    assert code == 2
    assert err.startswith("kinreach simulate-ur: error: ")
    assert said in err
    assert len(err.splitlines()) == 1
    assert "ends" not in out or "dry run" in out


def test_a_loop_without_end_is_left(tried):
    code, out, err = tried(["while True:", UP, "movej([0.2, -1.57, 1.57, -1.57, -1.57, 0])", "end"], "--longest", "4")
    assert (code, err) == (0, "")
    assert "dry run  4.00 s" in out
    assert "it goes on after these 4 s" in out
    assert "no collision with itself" in out


def test_other_files_and_times_are_refused(tried, capsys, tmp_path):
    assert "its URScript stands beside it" in tried([UP], name="mine.urp")[2]
    for longest in ("0", "nan", "601"):
        assert "--longest" in tried([UP], "--longest", longest)[2]
    assert main(["simulate-ur", "--arm", "ur5e", "--program", str(tmp_path / "none.script")]) == 2
    assert "cannot read the program" in capsys.readouterr().err
    assert main(["check", str(tmp_path / "mine.script")]) == 2
    assert "simulate-ur --arm NAME --program" in capsys.readouterr().err


def test_a_simulated_robot_is_as_its_flags_say(monkeypatch, free_address, capsys):
    served = []
    monkeypatch.setattr(SimulatedUR, "serve", lambda robot: served.append(robot))
    rng = np.random.default_rng(0)
    for speed in (0.5, 3.0):
        address, q = free_address(), rng.uniform(-1.0, 1.0, 6).round(3)
        rtde_port, script_port = rng.choice(np.arange(40000, 60000), 2, replace=False).tolist()
        flags = {"--address": address, "--rtde-port": rtde_port, "--script-port": script_port, "--speed": speed}
        given = [str(word) for flag in flags.items() for word in flag]
        assert main(["simulate-ur", "--arm", "ur3e", f"--from={','.join(map(str, q))}", "--no-cell", *given]) == 0
        robot = served[-1]
        found = robot.address, robot.rtde_port, robot.script_port, robot.speed
        assert found == (address, rtde_port, script_port, speed)
        np.testing.assert_allclose(robot.controller.target_q, q, atol=1e-12)
        assert f"{address}: RTDE {rtde_port}, script port {script_port}, " in capsys.readouterr().out
    assert len(served) == 2
