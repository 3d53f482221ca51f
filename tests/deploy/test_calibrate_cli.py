"""`kinreach calibrate` and `kinreach check --log`, as an owner types them."""

import threading

import numpy as np
import pytest

from kinreach.cli import main
from kinreach.deploy import SimulatedUR, URClient
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, pose_vector
from kinreach.robots import PUBLISHED_CALIBRATIONS, get_arm, read_calibration

CALIBRATION = PUBLISHED_CALIBRATIONS["ur5e_a"]
RTDE = [f"{name}_{n}" for name in ("actual_q", "actual_TCP_pose", "tcp_offset") for n in range(6)]
TCP = [0.01, -0.02, 0.15, 0.3, 0.0, 0.0]
WORKSPACE = np.random.default_rng(1).uniform(-np.pi, np.pi, (300, 6))


def calibrate(*arguments):
    return main(["calibrate", *map(str, arguments)])


def check(*arguments):
    return main(["check", *map(str, arguments)])


@pytest.fixture
def recording(tmp_path):
    """Twenty rows of a recorder, of a UR5e with a published calibration and a tool."""
    kin = ArmKinematics.of(get_arm("ur5e").calibrated(CALIBRATION).with_tool(TCP), base="base")
    q = np.array(kin.arm.home) + np.random.default_rng(0).uniform(-1.2, 1.2, (20, 6))
    rows = np.hstack([q, pose_vector(kin.fk(q)), np.tile(TCP, (20, 1))])
    file = tmp_path / "robot_data.csv"
    file.write_text("\n".join([" ".join(RTDE), *(" ".join(map(repr, row)) for row in rows.tolist()), ""]))
    return file


def off(file):
    arm = get_arm("ur5e")
    found, true = (ArmKinematics.of(arm.calibrated(each), tip="tool0") for each in (file, CALIBRATION))
    return np.linalg.norm(found.positions(WORKSPACE) - true.positions(WORKSPACE), axis=1).max()


@pytest.mark.parametrize("ending", ["yaml", "conf", "urdf"])
@pytest.mark.slow
def test_from_a_recording_to_a_file_that_every_command_takes(tmp_path, recording, capsys, ending):
    out, picture = tmp_path / f"my_robot.{ending}", tmp_path / "errors.png"
    assert calibrate(recording, "--out", out, "--picture", picture) == 0
    said = capsys.readouterr().out
    assert "arm          ur5e or ur7e" in said
    assert "tool         0.01,-0.02,0.15,0.3,0,0\n" in said
    assert "rows         20 used, 0 dropped\nerror, mm    median / largest\n" in said
    assert off(out) < 2e-6
    assert picture.read_bytes()[:4] == b"\x89PNG"
    assert check("ur5e", "--calibration", out, "--log", recording) == 0
    lines = capsys.readouterr().out.splitlines()
    sheet, own = (
        next(line.removeprefix(name) for line in lines if line.startswith(name) and " position:" in line)
        for name in ("data sheet", "calibrated")
    )
    assert float(sheet.split()[1]) > 0.5
    assert float(own.split()[1]) < 1e-3


@pytest.mark.slow
def test_a_robot_is_read_while_its_owner_moves_it(tmp_path, capsys):
    arm = get_arm("ur5e").calibrated(CALIBRATION).with_tool(TCP)
    home = np.array(arm.home)
    goals = home + np.random.default_rng(2).uniform(-0.7, 0.7, (14, 6))
    moves = "\n".join(f"  movej({goal}, a=5, v=2)" for goal in goals.tolist())
    with SimulatedUR(arm, rtde_port=0, script_port=0, speed=20) as robot:
        ports = {"rtde_port": robot.rtde_port, "script_port": robot.script_port}

        def owner():
            with URClient(robot.address, **ports) as client:
                client.send(f"def by_hand():\n{moves}\nend\n")
                while not done.is_set():
                    client.next_state()

        done = threading.Event()
        thread = threading.Thread(target=owner)
        thread.start()
        out = tmp_path / "my_robot.yaml"
        try:
            code = calibrate(
                robot.address, "--ports", f"{robot.rtde_port},{robot.script_port}", "--rows", 12, "--out", out
            )
        finally:
            done.set()
            thread.join()
    assert code == 0, capsys.readouterr()
    assert "12 used" in capsys.readouterr().out
    assert off(out) < 1e-5


def test_what_is_missing_is_said_and_the_exit_code_tells(tmp_path, recording, capsys):
    rows = recording.read_text().splitlines()
    short = tmp_path / "short.csv"
    short.write_text("\n".join([rows[0].rsplit(" ", 6)[0], *(row.rsplit(" ", 6)[0] for row in rows[1:4])]))
    out = tmp_path / "my_robot.yaml"
    assert calibrate(short, "--arm", "ur5e", "--out", out) == 1
    captured = capsys.readouterr()
    assert "undetermined" in captured.out
    assert "is not written: the rows leave" in captured.err
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nothing.csv"], "No such file"),
        (["127.0.0.1", "--ports", "9,9"], "no robot answers at 127.0.0.1:9"),
        ([CALIBRATION, "--picture", "x.png"], "--picture shows the errors of a fit"),
        ([CALIBRATION, "--out", "x.txt"], "must end in .yaml or .yml or .conf or .urdf"),
        ([CALIBRATION, "--out", "/nowhere/x.yaml"], "--out must be a file in a folder that exists"),
        (["127.0.0.1", CALIBRATION], "give the robot at 127.0.0.1 alone"),
        ([CALIBRATION, "--arm", "ur10"], "it fits ur5e or ur7e"),
    ],
)
def test_bad_input_is_one_line(capsys, arguments, said):
    assert calibrate(*arguments) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


@pytest.mark.slow
def test_a_recording_is_a_calibration_everywhere(recording):
    arm = get_arm("ur5e").calibrated(recording)
    assert "fitted to 20 rows of robot_data.csv" in arm.notes[0]
    assert off(recording) < 2e-6
    with pytest.raises(InputError, match="not of a ur10"):
        get_arm("ur10").calibrated(recording)
    rows = recording.read_text().splitlines()
    recording.write_text("\n".join(rows[:4]))
    with pytest.raises(InputError, match="does not determine the calibration: "):
        get_arm("ur5e").calibrated(recording)


@pytest.mark.slow
def test_a_calibration_is_converted(tmp_path, capsys):
    assert calibrate(CALIBRATION, "--out", tmp_path / "my.conf") == 0
    assert "read, nothing is fitted" in capsys.readouterr().out
    with pytest.raises(InputError, match="it fits"):
        read_calibration(tmp_path / "my.conf", "ur10")
    assert off(tmp_path / "my.conf") < 1e-9


def test_a_log_is_held_against_the_right_robot_and_another(tmp_path, recording, capsys):
    other = tmp_path / "other.yaml"
    other.write_text(CALIBRATION.read_text().replace("x: -0.42510", "x: -0.42910"))
    for file, said in ((CALIBRATION, "is that of this robot"), (other, "is not that of this robot")):
        assert check("ur5e", "--calibration", file, "--log", recording) == 0
        assert f"verdict      the calibration {said}: " in capsys.readouterr().out
    assert check("ur5e", "--calibration", CALIBRATION, "--log", recording, "--tool", "0,0,0.4,0,0,0") == 0
    assert "the tool centre point is another" in capsys.readouterr().out
    program = tmp_path / "program.urp"
    program.write_text("<URProgram/>")
    assert check("ur5e", "--log", program) == 2
    assert "no poses: needed is its export, a .script" in capsys.readouterr().err


def test_speeds_and_targets_of_a_log_are_held_against_the_arm(tmp_path, capsys):
    kin = ArmKinematics.of(get_arm("ur5e").calibrated(CALIBRATION).with_tool(TCP), base="base")
    rng, step = np.random.default_rng(3), 1e-6
    q = np.array(kin.arm.home) + rng.uniform(-1.2, 1.2, (20, 6))
    qd, target = rng.uniform(-1.0, 1.0, (20, 6)), q + np.array([0.0, 0.01, 0.0, -0.005, 0.0, 0.0])
    ahead, behind = kin.fk(q + step * qd), kin.fk(q - step * qd)
    speed = (ahead[:, :3, 3] - behind[:, :3, 3]) / (2 * step)
    turn = ahead[:, :3, :3] @ behind[:, :3, :3].swapaxes(1, 2)
    turn = np.stack(
        [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]], axis=1
    )
    names = [*RTDE, *(f"{name}_{n}" for name in ("actual_qd", "actual_TCP_speed", "target_q") for n in range(6))]
    rows = np.hstack([q, pose_vector(kin.fk(q)), np.tile(TCP, (20, 1)), qd, speed, turn / (4 * step), target])
    file = tmp_path / "robot_data.csv"
    file.write_text("\n".join([" ".join(names), *(" ".join(map(repr, row)) for row in rows.tolist()), ""]))
    assert check("ur5e", "--calibration", CALIBRATION, "--log", file) == 0
    said = capsys.readouterr().out
    sheet, own = (float(line.split(": ")[1].split()[0]) for line in said.splitlines() if "Jacobian to recorded" in line)
    assert own < 1e-3 < 0.1 < sheet  # mm/s
    assert said.count("joints, actual to target: 0.573 ° in the median, p95 0.573, most 0.573") == 2


def test_what_it_says_names_flags(recording, capsys):
    recording.write_text("\n".join(" ".join(line.split()[:12]) for line in recording.read_text().splitlines()))
    assert calibrate(recording) == 0
    said = capsys.readouterr().out
    assert "use --tool 0.0" in said
    assert "tool=" not in said


def test_a_mistyped_file_is_not_only_called_a_robot(capsys):
    assert calibrate("no_such_folder/program") == 2
    assert "no_such_folder/program is no file here" in capsys.readouterr().err


def test_a_log_without_a_tool_is_explained_with_the_tool_that_fits(recording, capsys):
    rows = recording.read_text().splitlines()[:9]
    recording.write_text("\n".join(" ".join(line.split()[:12]) for line in rows))
    assert check("ur5e", "--calibration", CALIBRATION, "--log", recording) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0].endswith(": 8 rows of robot_data.csv")
    (tool,) = (line for line in said if line.startswith("calibrated   tool "))
    six, rest = tool.removeprefix("calibrated   tool ").split(", found")
    np.testing.assert_allclose([float(word) for word in six.split(",")], TCP, atol=1e-5)
    assert rest == ": the recording has none"
    assert sum(line.startswith("data sheet   ") for line in said) == 3


def test_a_log_is_explained_by_a_data_sheet_alone(recording, capsys):
    """There is one arm then, and no verdict."""
    recording.write_text("\n".join(recording.read_text().splitlines()[:9]))
    assert check("ur5e", "--log", recording) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "ur5e: 8 rows of robot_data.csv"
    assert [line.split()[:2] for line in said[1:]] == [["arm", "position:"], ["arm", "orientation:"]]
