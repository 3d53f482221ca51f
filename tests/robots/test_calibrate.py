"""A calibration from what an owner has: programs, exports, recordings and tables of made-up robots."""

import gzip
import re
from dataclasses import replace

import numpy as np
import pytest

from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, pose, pose_vector
from kinreach.robots import PUBLISHED_CALIBRATIONS, PosePairs, calibrate, get_arm, read_calibration
from kinreach.robots.inside import UR_LENGTHS, frames_of, moved_frames
from tests.cases import slow

TCP = pose([0.02, -0.01, 0.15, 0.1, 0.0, 0.3])
WORKSPACE = np.random.default_rng(99).uniform(-np.pi, np.pi, (500, 6))
JOINTS = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]


def nominal_dh(model):
    """The data sheet's parameters: rows theta [rad], a [m], d [m], alpha [rad], shape (4, 6)."""
    d1, a2, a3, d4, d5, d6 = UR_LENGTHS[model]
    right = np.pi / 2
    return np.array([[0.0] * 6, (0, a2, a3, 0, 0, 0), (d1, 0, 0, d4, d5, d6), (right, 0, 0, right, -right, 0)])


def nominal_placements(model):
    """The data sheet's chain A0 Rz(q0) A1 Rz(q1) ... A6, in which each joint turns about its own z axis."""
    _, a, d, alpha = nominal_dh(model)
    frames = [np.eye(4)]
    for index in range(6):
        turn = pose([0.0, 0.0, 0.0, alpha[index], 0.0, 0.0])
        frames[-1] = frames[-1] @ pose([0.0, 0.0, d[index], 0.0, 0.0, 0.0])
        frames.append(pose([a[index], 0.0, 0.0, 0.0, 0.0, 0.0]) @ turn)
    return np.array(frames)


def made_up(model, seed, spread=(1e-3, 2e-3)):
    """Placements of a robot that is off its data sheet as real ones are, base and flange on their axes."""
    errors = np.random.default_rng(seed).normal(size=(7, 6)) * np.repeat(spread, 3)
    errors[0], errors[6] = 0.0, 0.0
    return moved_frames(nominal_placements(model), errors)


def postures(count, seed, turn=1.5):
    rng = np.random.default_rng(seed)
    return np.array([0.0, -1.4, 1.6, -1.7, -1.5, 0.0]) + rng.uniform(-turn, turn, (count, 6))


def pairs_of(placements, q, tool=TCP, known=True, noise=(0.0, 0.0), seed=0, name="made_up.csv"):
    rng = np.random.default_rng(seed)
    T = frames_of(placements, q)[-1] @ tool
    numbers = pose_vector(T)
    numbers += rng.normal(size=numbers.shape) * np.repeat(noise, 3)
    tcp = np.tile(tool, (len(q), 1, 1)) if known else None
    return PosePairs(name, q, pose(numbers), tcp, tuple(f"line {row + 2}" for row in range(len(q))))


def left(result, placements, at=None):
    """Errors of the flange over the workspace [m], or of a point fixed to it."""
    at = np.eye(4) if at is None else at
    found = frames_of(result.calibration.placements, WORKSPACE)[-1]
    return np.linalg.norm((found @ at - frames_of(placements, WORKSPACE)[-1] @ at)[:, :3, 3], axis=1)


@pytest.mark.parametrize("model", ["ur3", "ur5e", "ur10", *slow("ur16e", "ur20", "ur30")])
def test_a_few_waypoints_are_enough_where_they_have_all_digits(model):
    for seed in range(3):
        true = made_up(model, seed)
        result = calibrate(pairs_of(true, postures(8, seed)))
        assert model in result.models
        assert not result.missing
        assert not result.tcp_found
        assert all(UR_LENGTHS[name] == UR_LENGTHS[model] for name in result.models)
        data_sheet = np.linalg.norm(
            (frames_of(nominal_placements(model), WORKSPACE)[-1] - frames_of(true, WORKSPACE)[-1])[:, :3, 3], axis=1
        )
        assert np.median(data_sheet) > 3e-4
        assert np.median(left(result, true)) < 1e-6
        assert left(result, true).max() < 3e-6


@pytest.mark.slow
def test_an_unknown_tool_is_found_with_the_arm():
    for seed in range(4):
        true = made_up("ur5e", seed)
        result = calibrate(pairs_of(true, postures(20, seed), known=False))
        assert result.tcp_found
        # flange and tool are known only together
        tip = frames_of(result.calibration.placements, WORKSPACE)[-1] @ result.tcp
        assert np.linalg.norm((tip - frames_of(true, WORKSPACE)[-1] @ TCP)[:, :3, 3], axis=1).max() < 1e-6


@pytest.mark.slow
def test_the_expected_error_is_the_error():
    """As typed from a pendant: to 0.01 mm and 0.001 rad; over many robots the covariance tells the truth."""
    ratios, better = [], 0
    for seed in range(8):
        true = made_up("ur5e", seed, spread=(1.5e-3, 3e-3))
        pairs = pairs_of(true, postures(18, seed), noise=(5e-5, 5e-4), seed=seed)
        result = calibrate(pairs, arm="ur5e")
        error = left(result, true)
        ratios.append(np.sqrt((error**2).mean() / (result.fit.expected**2).mean()))
        better += np.median(error) < 0.2 * np.median(result.fit.correction)
        assert np.median(result.fit.held_out) < 4e-4 < np.median(result.fit.before)
    assert better == 8
    assert 0.5 < np.median(ratios) < 1.6


@pytest.mark.slow
def test_torn_rows_are_dropped_and_named():
    for seed in range(2):
        true, q = made_up("ur10e", seed), postures(155, seed)
        torn = q.copy()
        rows = np.random.default_rng(seed).choice(155, 5, replace=False)
        torn[rows] += 1e-3  # the pose is of the next cycle
        pairs = replace(pairs_of(true, q), q=torn)
        result = calibrate(pairs)
        assert sorted(place for place, _ in result.fit.dropped) == sorted(f"line {row + 2}" for row in rows)
        assert left(result, true).max() < 1e-6


def test_what_the_rows_do_not_determine_is_said_and_not_written(tmp_path):
    true = made_up("ur5e", 1)
    q = postures(40, 2)
    q[:, 3:] = (-1.7, -1.5, 0.0)  # the wrist stands still
    result = calibrate(pairs_of(true, q, known=False, noise=(1e-5, 1e-5)), arm="ur5e")
    assert "wrist_1_joint, wrist_2_joint and wrist_3_joint" in result.missing
    with pytest.raises(InputError, match="nothing is written"):
        result.save(tmp_path / "robot.yaml")
    assert not list(tmp_path.iterdir())
    result = calibrate(pairs_of(true, postures(3, 2), noise=(1e-5, 1e-4)), arm="ur5e")
    assert "six or more" in result.missing


@pytest.mark.slow
def test_a_fit_is_never_much_worse_than_the_data_sheet():
    """Narrow recordings, few rows, rough numbers: what is written is better over the workspace."""
    written = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        true = made_up("ur5e", seed)
        q = postures(int(rng.integers(4, 30)), seed, turn=float(rng.uniform(0.05, 1.5)))
        noise = 10.0 ** rng.uniform(-7, -3.5)
        result = calibrate(pairs_of(true, q, noise=(noise, noise), seed=seed), arm="ur5e")
        if result.missing:
            continue
        written += 1
        off = np.linalg.norm(
            (frames_of(nominal_placements("ur5e"), WORKSPACE)[-1] - frames_of(true, WORKSPACE)[-1])[:, :3, 3], axis=1
        )
        assert np.median(left(result, true)) < max(0.7 * np.median(off), 2e-5)
    assert written >= 5


@pytest.mark.parametrize("ending", [".yaml", ".conf", ".urdf"])
def test_what_is_written_is_read_again(tmp_path, ending):
    for seed, model in enumerate(("ur3e", "ur10")):
        true = made_up(model, seed)
        file = tmp_path / f"robot{seed}{ending}"
        calibrate(pairs_of(true, postures(12, seed)), arm=model).save(file)
        again = read_calibration(file, model)
        apart = (frames_of(again.placements, WORKSPACE)[-1] - frames_of(true, WORKSPACE)[-1])[:, :3]
        assert np.abs(apart).max() < 2e-6
        np.testing.assert_allclose(
            frames_of(calibrate(file, arm=model).calibration.placements, WORKSPACE)[-1],
            frames_of(again.placements, WORKSPACE)[-1], atol=1e-12,
        )  # fmt: skip


def test_published_calibrations_are_written_in_every_form(tmp_path):
    """Each again into each kind of file; the controller's has what is to be added to the data sheet's figures."""
    written, slides = 0, []
    for name, source in PUBLISHED_CALIBRATIONS.items():
        model = name.split("_")[0]
        result = calibrate(source, arm=model)
        for ending in (".conf", ".yaml", ".urdf"):
            file = tmp_path / f"{name}{ending}"
            result.save(file)
            again = read_calibration(file, model)
            np.testing.assert_allclose(again.placements, result.calibration.placements, atol=1e-8)
            written += 1
        rows = re.findall(r"^(delta_\w+) = \[ (.*) \]$", (tmp_path / f"{name}.conf").read_text(), re.MULTILINE)
        more = {key: np.array(values.split(", "), dtype=float) for key, values in rows}
        assert list(more) == ["delta_theta", "delta_a", "delta_d", "delta_alpha"]
        figures = nominal_dh(model) + np.array(list(more.values()))
        for q in WORKSPACE[:5]:
            np.testing.assert_allclose(dh_fk(figures, q), frames_of(result.calibration.placements, q[None])[-1][0],
                                       atol=1e-8)  # fmt: skip
        assert np.abs(more["delta_alpha"]).max() < 0.02
        slides.append(np.abs(more["delta_d"]).max())
    assert written == 3 * len(PUBLISHED_CALIBRATIONS) == 24
    assert max(slides) > 1.0  # frames on axes that are almost parallel


@pytest.mark.parametrize("model", ["ur3", "ur5e", "ur16e"])
def test_a_robot_by_its_data_sheet_has_nothing_to_add(tmp_path, model):
    """Its axes are parallel, and so have no common normal."""
    result = calibrate(saved(tmp_path, urp(nominal_dh(model), ["A"])), arm=model)
    result.save(tmp_path / "nominal.conf")
    numbers = re.findall(r"[-+\d.e]+(?=[,\s])", (tmp_path / "nominal.conf").read_text().split("]", 1)[1])
    assert len(numbers) == 24
    np.testing.assert_allclose(np.array(numbers, dtype=float), 0.0, atol=1e-12)


def urp(figures, waypoints, status="LINEARIZED", valid="true", head="", tcp="0, 0, 0.15, 0, 0, 0"):
    block = (
        f'<Kinematics status="{status}" validChecksum="{valid}">'
        + "".join(
            f'<{name} value="{", ".join(map(repr, row))}"/>'
            for name, row in zip(("deltaTheta", "a", "d", "alpha"), figures.tolist(), strict=True)
        )
        + "</Kinematics>"
    )
    return "".join(
        f'<Waypoint name="{name}"><position><JointAngles angles="0, 0, 0, 0, 0, 0"/><TCPOffset pose="{tcp}"/>{block}'
        "</position></Waypoint>" for name in waypoints
    )  # fmt: skip


def saved(tmp_path, *parts, head="", packed=True):
    text = f'{head}<URProgram name="x"><children>{"".join(parts)}</children></URProgram>'.encode()
    file = tmp_path / "program.urp"
    file.write_bytes(gzip.compress(text) if packed else text)
    return file


def figures_of(model, seed):
    figures = nominal_dh(model)
    return figures + np.random.default_rng(seed).normal(size=figures.shape) * np.array(
        [[5e-4], [5e-4], [5e-4], [5e-4]]
    ) * (np.arange(6) < 5)


def dh_fk(figures, q):
    """Forward kinematics of Denavit-Hartenberg figures, written out again for the test."""
    T = np.eye(4)
    for (theta, a, d, alpha), angle in zip(figures.T, q, strict=True):
        c, s, ca, sa = np.cos(theta + angle), np.sin(theta + angle), np.cos(alpha), np.sin(alpha)
        T = T @ np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1.0]])
    return T


@pytest.mark.parametrize("packed", [True, False])
@pytest.mark.parametrize("model", ["ur3e", "ur5e", "ur10", "ur20"])
def test_the_figures_of_a_program_are_read(tmp_path, model, packed):
    figures = figures_of(model, 3)
    file = saved(tmp_path, urp(figures, ["A", "B"]), packed=packed)
    result = calibrate(file)
    assert model in result.models
    assert result.fit is None
    np.testing.assert_allclose(pose_vector(result.tcp), [0, 0, 0.15, 0, 0, 0], atol=1e-12)
    kin = ArmKinematics.of(get_arm(model).calibrated(file), tip="tool0", base="base")
    for q in WORKSPACE[:50]:
        np.testing.assert_allclose(kin.fk(q), dh_fk(figures, q), atol=1e-11)
        np.testing.assert_allclose(
            frames_of(result.calibration.placements, q[None])[-1][0], dh_fk(figures, q), atol=1e-11
        )


def test_the_tool_of_a_program_is_taken_where_it_has_just_one(tmp_path):
    """Two are named in a note, and of none nothing is said; a given one counts."""
    figures, tools = figures_of("ur5e", 3), ["0, 0, 0.15, 0, 0, 0", "0, 0.02, 0.1, 0, 0.3, 0"]
    ways = [urp(figures, [name], tcp=tool) for name, tool in zip("AB", tools, strict=True)]
    bare = re.sub("<TCPOffset [^>]*>", "", ways[0])
    for parts, tool, notes in (
        ([bare], None, ()), (ways[:1], tools[0], ()), ([bare, ways[1], ways[1]], tools[1], ()),
        (ways, None, ("the waypoints have 2 tool centre points",)),
    ):  # fmt: skip
        file = saved(tmp_path, *parts)
        result = calibrate(file)
        assert result.notes == notes
        if tool is None:
            assert result.tcp is None
        else:
            np.testing.assert_allclose(pose_vector(result.tcp), list(map(float, tool.split(","))), atol=1e-12)
    given = calibrate(file, tool=TCP)
    np.testing.assert_allclose(given.tcp, TCP, atol=1e-12)
    assert given.notes == ()


def test_programs_of_several_robots_say_which(tmp_path):
    one, other = figures_of("ur5e", 1), figures_of("ur5e", 2)
    file = saved(tmp_path, urp(one, ["A", "B", "C"]), urp(other, ["D"]))
    with pytest.raises(
        InputError, match=r"2 robots: choose with robot=N \(1: 3 waypoints, A, B, C; 2: 1 waypoints, D\)"
    ):
        calibrate(file)
    for number, figures in enumerate((one, other), start=1):
        found = calibrate(file, robot=number).calibration.placements
        np.testing.assert_allclose(frames_of(found, WORKSPACE[:1])[-1][0], dh_fk(figures, WORKSPACE[0]), atol=1e-11)
    with pytest.raises(InputError, match="2 robots"):
        read_calibration(file, "ur5e")


@pytest.mark.parametrize(
    ("parts", "head", "said"),
    [
        (
            [urp(nominal_dh("ur5e"), ["A"], status="NOT_INITIALIZED", valid="false")],
            "",
            "NOT_INITIALIZED: the data sheet's",
        ),
        ([urp(figures_of("ur5e", 1), ["A"], valid="false")], "", "no valid checksum"),
        ([""], "", "no waypoint with a robot's kinematics"),
        ([urp(figures_of("ur5e", 1), ["A"])], '<!DOCTYPE x [<!ENTITY a "b">]>', "declares a document type"),
        (
            [urp(figures_of("ur5e", 1), ["A"]).replace('deltaTheta value="', 'deltaTheta value="nan, ')],
            "",
            "six numbers",
        ),
        ([urp(figures_of("ur5e", 1), ["A"]).replace('a value="', 'a value="0,,')], "", "six numbers"),
        ([urp(figures_of("ur5e", 1), ["A"]).replace("<alpha ", "<beta ")], "", "a block of kinematics lacks alpha"),
        (["<a>" * 600], "", "nested deeper"),
        (["<a>"], "", "damaged"),
    ],
)
def test_programs_without_figures_are_refused_in_words(tmp_path, parts, head, said):
    with pytest.raises(InputError, match=re.escape(said)):
        calibrate(saved(tmp_path, *parts, head=head))


def test_a_bomb_and_a_torn_file_are_refused(tmp_path):
    file = tmp_path / "bomb.urp"
    file.write_bytes(gzip.compress(b"<URProgram>" + b" " * 2**26, 1))
    with pytest.raises(InputError, match="more than 64 MiB"):
        calibrate(file)
    file.write_bytes(b"<URProgram>" + b" " * (2**26 + 1))
    with pytest.raises(InputError, match="more than 64 MiB"):
        calibrate(file)
    whole = saved(tmp_path, urp(figures_of("ur5e", 1), ["A"])).read_bytes()
    for cut in (3, 30, len(whole) // 2, len(whole) - 4):
        file.write_bytes(whole[:cut])
        with pytest.raises(InputError, match="damaged"):
            calibrate(file)
    file.write_bytes(whole[:30] + bytes(20) + whole[50:])
    with pytest.raises(InputError, match=r"bomb\.urp is a damaged \.urp: gzip: "):
        calibrate(file)


def test_figures_of_the_data_sheet_are_said_to_be_no_calibration(tmp_path):
    for model in ("ur3", "ur5e", "ur10"):
        assert "the robot has no calibration" in calibrate(saved(tmp_path, urp(nominal_dh(model), ["A"]))).notes[0]
        assert not calibrate(saved(tmp_path, urp(figures_of(model, 1), ["A"]))).notes


@pytest.mark.slow
def test_differences_from_a_data_sheet_are_not_taken_for_those_of_another(tmp_path):
    """A .conf does not name its model, and a wrong data sheet below it makes an arm that is centimetres off."""
    messages = []
    for seed, model in enumerate(("ur3", "ur5", "ur10", "ur3e", "ur5e")):
        file, absolute = tmp_path / f"{model}.conf", tmp_path / f"{model}.yaml"
        true = made_up(model, seed)
        saved_once = calibrate(pairs_of(true, postures(12, seed)), arm=model)
        saved_once.save(file)
        saved_once.save(absolute)
        assert model in calibrate(absolute).models
        assert left(calibrate(file, arm=model), true).max() < 2e-6
        try:
            assert left(calibrate(file), true).max() < 2e-6
        except InputError as error:
            messages.append((model, str(error)))
    assert len(messages) >= 2
    assert all(re.search(rf"\b{model}\b.*name yours with arm=", message) for model, message in messages)


def test_the_name_of_a_thesis_arm_means_its_model(tmp_path):
    true = made_up("ur5", 1)
    pairs = pairs_of(true, postures(12, 1))
    for source in (pairs, saved(tmp_path, urp(figures_of("ur5", 2), ["A"]))):
        result = calibrate(source, arm="ur5-thesis")
        assert result.models == ("ur5",)
        assert result.calibration.model == "ur5"
    assert left(calibrate(pairs, arm="ur5-thesis"), true).max() < 2e-6


def test_a_given_tool_is_that_of_every_file(tmp_path):
    true, q = made_up("ur10", 2), postures(24, 2)
    T = frames_of(true, q)[-1] @ TCP
    typed, program = tmp_path / "typed.csv", tmp_path / "program.script"
    typed.write_text(table(q[:12], T[:12], PLAIN))
    program.write_text(script(q[12:], T[12:], [pose_vector(TCP).tolist()]))
    result = calibrate([typed, program], tool=TCP)
    assert result.fit.rows == 24
    assert left(result, true).max() < 2e-6
    with pytest.raises(InputError, match=r"typed.csv does not say its tool centre point.*tool="):
        calibrate([typed, program])


@pytest.mark.slow
def test_a_program_that_changes_its_tool_is_followed(tmp_path):
    other = pose([0.0, 0.03, 0.25, 0.0, 0.4, 0.0])
    file = tmp_path / "two_tools.script"
    for seed in range(6):
        true, q = made_up("ur5", seed), postures(20, seed)
        change = 5 + 2 * seed
        T = frames_of(true, q)[-1] @ np.where((np.arange(20) < change)[:, None, None], TCP, other)
        one, two = (script(q[part], T[part]).splitlines()[1:-1] for part in (slice(0, change), slice(change, None)))
        two = [line.replace("W", "V") for line in two]
        tools = [f"  set_tcp(p{pose_vector(tool).tolist()})" for tool in (TCP, other)]
        if seed % 2:  # by a variable, and with waypoints before their use, as PolyScope exports them
            tools[1:] = [
                f"  my_tool=p{pose_vector(other).tolist()}",
                "  # set_tcp(p[0,0,0,0,0,0])",
                "  set_tcp(my_tool)",
            ]
            moves = [line for line in two if "movej" in line]
            one, two = [*(line for line in two if "movej" not in line), *one], moves
        file.write_text("\n".join(["def made_up():", tools[0], *one, *tools[1:], *two, "end"]))
        result = calibrate(file)
        assert result.fit.rows == 20
        assert not result.tcp_found
        assert result.tcp is None  # there are two
        assert "2 tool centre points" in result.notes[0]
        assert left(result, true).max() < 2e-6
    file.write_text(file.read_text().replace("my_tool=", "my_tool=tool_of("))  # only the first ones are known
    result = calibrate(file)
    assert result.fit.rows == change
    assert "which tool centre point they have is not known" in " ".join(result.notes)


def script(q, T, tcps=()):
    lines = ["def made_up():", *(f"  set_tcp(p{list(tcp)})" for tcp in tcps)]
    for row, (angles, numbers) in enumerate(zip(q.tolist(), pose_vector(T).tolist(), strict=True)):
        lines += [
            f"  global W{row}_p=p{numbers}",
            f"  global W{row}_q={angles}",
            f"  movej(get_inverse_kin(W{row}_p, qnear=W{row}_q))",
        ]
    return "\n".join([*lines, "end"])


def table(q, T, names=None, separator=",", decimal=".", degrees=False, millimetres=False, tcp=None):
    numbers = pose_vector(T)
    q = np.degrees(q) if degrees else q
    numbers[:, :3] *= 1e3 if millimetres else 1.0
    columns = [q, numbers] if tcp is None else [q, numbers, np.tile(pose_vector(tcp), (len(q), 1))]
    rows = [separator.join(f"{value:.12f}" for value in row).replace(".", decimal) for row in np.hstack(columns)]
    return "\n".join([*([separator.join(names)] if names else []), *rows, ""])


RTDE = [*(f"actual_q_{n}" for n in range(6)), *(f"actual_TCP_pose_{n}" for n in range(6))]
OFFSET = [f"tcp_offset_{n}" for n in range(6)]
PLAIN = ["q1", "q2", "q3", "q4", "q5", "q6", "x", "y", "z", "rx", "ry", "rz"]
PENDANT = [
    "Base (°)",
    "Shoulder (°)",
    "Elbow (°)",
    "Wrist 1 (°)",
    "Wrist 2 (°)",
    "Wrist 3 (°)",
    "X (mm)",
    "Y (mm)",
    "Z (mm)",
    "RX (rad)",
    "RY (rad)",
    "RZ (rad)",
]


@pytest.mark.parametrize(
    ("text", "known"),
    [
        (lambda q, T: script(q, T, [pose_vector(TCP).tolist()]), True),
        (lambda q, T: script(q, T), False),
        (lambda q, T: table(q, T, RTDE, " "), False),
        (lambda q, T: table(q, T, [*RTDE, *OFFSET], ",", tcp=TCP), True),
        (lambda q, T: table(q, T, PLAIN, "\t"), False),
        (lambda q, T: table(q, T, PLAIN, ";", ","), False),
        (lambda q, T: "\ufeff" + table(q, T, PLAIN).replace("\n", "\r\n"), False),
        (lambda q, T: table(q, T), False),
        (lambda q, T: table(q, T, PENDANT, degrees=True, millimetres=True), False),
        (lambda q, T: table(q, T, PLAIN, degrees=True, millimetres=True), False),
    ],
)  # fmt: skip
def test_every_source_is_read(tmp_path, text, known):
    true, q = made_up("ur5e", 4), postures(20, 4)
    T = frames_of(true, q)[-1] @ TCP
    file = tmp_path / "source"
    file.write_text(text(q, T), newline="")
    result = calibrate(file)
    assert result.models == ("ur5e", "ur7e")
    assert result.tcp_found != known
    tip = frames_of(result.calibration.placements, WORKSPACE)[-1] @ result.tcp
    assert np.linalg.norm((tip - frames_of(true, WORKSPACE)[-1] @ TCP)[:, :3, 3], axis=1).max() < 2e-6


@pytest.mark.parametrize(
    "names",
    [
        ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint"],
        ["Shoulder Pan", "Shoulder Lift", "Elbow", "Wrist 1", "Wrist 2", "Wrist 3"],
        ["Base", "Shoulder", "Elbow", "Wrist 1", "Wrist 2", "Wrist 3"],
        *([f"{name}{n}" for n in range(1, 7)] for name in ("theta", "Theta_", "J ", "Joint ", "Axis ", "q.", "joint-")),
        [f"q_{n}" for n in range(6)],
    ],
)
def test_columns_are_known_by_the_names_and_units_that_people_write(tmp_path, names):
    true, q = made_up("ur10", 5), postures(20, 5)
    T = frames_of(true, q)[-1] @ TCP
    file = tmp_path / "rows.csv"
    read = 0
    for position in (["X", "Y", "Z"], ["TCP X", "TCP Y", "TCP Z"], ["tcp_x", "tcp_y", "tcp_z"]):
        turn = [title.replace("X", "RX").replace("Y", "RY").replace("Z", "RZ") for title in position]
        turn = [re.sub("_(.)", r"_r\1", title) for title in turn]
        for unit in ("{} in {}", "{} [{}]", "{}_{}", "{} ({})", "{}"):
            for angle in ("deg", "°", "degrees"):
                units = [angle] * 6 + ["mm"] * 3 + ["rad"] * 3
                header = [unit.format(name, what) for name, what in zip([*names, *position, *turn], units, strict=True)]
                rows = table(q, T, ["t", *header], degrees=True, millimetres=True).splitlines()
                rows[1:] = [f"{number},{row}" for number, row in enumerate(rows[1:])]
                if unit == "{}":  # the units are a line of their own
                    rows.insert(1, ",".join(["s", *units]))
                file.write_text("\n".join(rows))
                pairs = PosePairs.read(file)
                np.testing.assert_allclose(pairs.q, q, atol=1e-10)
                np.testing.assert_allclose(pairs.seen, T, atol=1e-10)
                assert pairs.tcp is None
                assert pairs.places[0] == f"line {3 if unit == '{}' else 2}"
                read += 1
    assert read == 45


@pytest.mark.parametrize("count", [6, 5, 7])
def test_columns_without_names_are_known_by_their_number(tmp_path, count):
    """Joint angles, the position, then perhaps the rotation vector, then perhaps the tool centre point."""
    joints = () if count == 6 else tuple(f"joint_{i}" for i in range(count))
    rng, file = np.random.default_rng(count), tmp_path / "rows.csv"
    q, six = rng.uniform(-2, 2, (12, count)), rng.uniform(-1, 1, (12, 6))
    tool = np.tile([0.01, 0.02, 0.15, 0.1, 0.2, 0.3], (12, 1))
    read = 0
    for columns in ((q, six[:, :3]), (q, six), (q, six, tool)):
        file.write_text("\n".join(",".join(map(repr, row)) for row in np.hstack(columns).tolist()))
        pairs = PosePairs.read(file, joints=joints)
        np.testing.assert_allclose(pairs.q, q, atol=1e-12)
        expected = pose(six) if len(columns[1][0]) == 6 else six[:, :3]
        np.testing.assert_allclose(pairs.seen, expected, atol=1e-9)
        if len(columns) == 3:
            np.testing.assert_allclose(pairs.tcp, pose(tool), atol=1e-9)
        else:
            assert pairs.tcp is None
        read += 1
    assert read == 3
    for width in (count + 2, count + 4, count + 5, count + 7, count + 11, count + 13):
        file.write_text("\n".join(",".join(map(repr, row)) for row in rng.uniform(0, 1, (8, width)).tolist()))
        with pytest.raises(InputError, match=f"has no header and {width} columns; needed are {count} joint angles"):
            PosePairs.read(file, joints=joints)


def test_the_tool_of_a_recording_is_found_beside_torn_rows():
    for seed in range(10):
        q = postures(300, seed)
        F = frames_of(made_up("ur5e", seed), q)[-1]
        late = postures(300, seed) + np.random.default_rng(seed).uniform(0.001, 0.02, (300, 1))
        torn = np.arange(300) % 10 == 0
        seen = frames_of(made_up("ur5e", seed), np.where(torn[:, None], late, q))[-1] @ TCP
        np.testing.assert_allclose(PosePairs("", q, seen).tool_on(F), TCP, atol=1e-9)
        numbers = pose_vector(seen) + np.random.default_rng(seed).normal(size=(300, 6)) * 1e-3
        assert np.abs(PosePairs("", q, pose(numbers)).tool_on(F) - TCP).max() < 6e-4


@pytest.mark.slow
def test_poses_in_base_link_and_joints_in_another_order_are_put_right():
    true, q = made_up("ur5e", 5), postures(20, 5)
    pairs = pairs_of(true, q)
    flipped = replace(pairs, seen=np.diag([-1.0, -1.0, 1.0, 1.0]) @ pairs.seen)
    result = calibrate(flipped)
    assert "base_link" in result.notes[0]
    assert left(result, true).max() < 1e-6
    order = [2, 1, 0, 3, 4, 5]  # alphabetical, as ROS's joint_states has them
    result = calibrate(replace(pairs, q=q[:, order]))
    assert "elbow, shoulder_lift, shoulder_pan, wrist_1" in result.notes[0]
    assert left(result, true).max() < 1e-6


def refused(pairs, **options):
    with pytest.raises(InputError) as error:
        calibrate(pairs, **options)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.slow
def test_rows_that_cannot_be_right_are_refused_with_the_remedy(tmp_path):
    true, q = made_up("ur5e", 6), postures(40, 6)
    pairs = pairs_of(true, q)
    assert "1 different posture" in refused(pairs.rows(np.zeros(10, dtype=int)))
    assert "are those of a ur5e or ur7e, not of a ur10" in refused(pairs, arm="ur10")
    feature = pose([0.3, -0.2, 0.1, 0.0, 0.0, 0.7])
    said = refused(replace(pairs, seen=np.linalg.inv(feature) @ pairs.seen))
    assert "frame of a feature" in said
    numbers = [float(word) for word in re.search(r"feature at ([-\d.e,]+);", said)[1].split(",")]
    np.testing.assert_allclose(numbers, pose_vector(feature), atol=5e-3)
    said = refused(pairs.with_tcp(pose([0, 0, 0.3, 0, 0, 0])))
    assert "tool centre point" in said
    assert "0.1" in said
    noise = np.random.default_rng(0).normal(size=q.shape)
    assert "fit no model of UR" in refused(replace(pairs, q=q + noise))
    other = pairs_of(made_up("ur5e", 7), postures(40, 7))
    said = refused(pairs.joined(replace(other, source="other.csv")))
    assert "two robots" in said
    later = pairs_of(true, postures(40, 8), tool=TCP @ pose([0.0, 0.0, 0.01, 0.0, 0.0, 0.0]))
    said = refused(replace(pairs, tcp=None).joined(replace(later, tcp=None)))
    assert "the tool changes" in said
    assert "0.01" in said
    for count in (12, 28):  # at any part of the rows
        first, rest = replace(pairs, tcp=None).rows(range(count)), replace(later, tcp=None).rows(range(count, 40))
        assert "the tool changes" in refused(first.joined(rest))


def in_degrees(row):
    cells = row.split(",")
    return ",".join([*(repr(57.3 * float(cell)) for cell in cells[:6]), *cells[6:]])


def with_cell(row, place, text):
    cells = row.split(",")
    return ",".join([*cells[:place], text, *cells[place + 1 :]])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda rows: [*rows[:5], *map(in_degrees, rows[5:8]), *rows[8:]], "angles of line 6, 7, 8 look like degrees"),
        (lambda rows: [*rows[:3], with_cell(rows[3], 7, "abc"), *rows[4:]], "line 4: 'abc' is no number"),
        (lambda rows: [*rows[:2], with_cell(rows[2], 3, "nan"), *rows[3:]], "line 3: the numbers must be finite"),
        (lambda rows: [*rows[:3], rows[3] + ",1", *rows[4:]], "line 4: 12 cells are needed"),
        (lambda rows: ["a,b," + rows[0][6:], *rows[1:]], "no columns of joint angles"),
        (lambda rows: rows[:1], "no rows of numbers"),
        (lambda rows: [rows[0], ",".join(6 * ["deg"] + 3 * ["mm"] + 3 * ["rad"])], "no rows of numbers"),
        (lambda rows: [rows[0], ",".join(6 * ["deg"] + 6 * ["inch"]), *rows[1:]], "line 2: 'deg' is no number"),
    ],
)
def test_tables_that_cannot_be_read_name_the_line(tmp_path, change, said):
    q = postures(20, 9)
    file = tmp_path / "rows.csv"
    rows = table(q, frames_of(made_up("ur5e", 9), q)[-1], PLAIN).splitlines()
    file.write_text("\n".join(change(rows)))
    with pytest.raises(InputError, match=re.escape(said)):
        calibrate(file)


def test_models_that_rows_do_not_tell_apart_are_named():
    """A UR5 and a UR5e differ by their shoulders' heights, which a tracker beside the base does not see."""
    true, q = made_up("ur5e", 10), postures(20, 10, turn=0.02)
    pairs = pairs_of(true, q, known=False, noise=(1e-3, 1e-2))
    assert "do not tell a" in refused(pairs)
    assert "add rows in which the joints differ more" in refused(pairs)


def test_a_statement_is_a_line_each(tmp_path):
    """Digits apart, which another machine may round otherwise."""
    true, q = made_up("ur10e", 0), postures(60, 0)
    torn = q.copy()
    torn[:12] += 1e-2
    result = calibrate(replace(pairs_of(true, q), q=torn))
    statement = "\n".join(result.statement())
    assert "rows         48 used, 12 dropped\n             line 2: " in statement
    assert "\n             line 9: " in statement
    assert "\n             and 4 more\n" in statement
    assert re.sub(r"(?<![\w.])-?\d[-.\de]*", "#", statement).splitlines() == [
        "arm          ur10e or ur12e",
        "tool         #,#,#,#,#,#",
        "rows         # used, # dropped",
        *["             line #: # mm off the others"] * 8,
        "             and # more",
        "error, mm    median / largest",
        "             # / #  data sheet, at the rows",
        "             # / #  calibrated, at the rows",
        "             # / #  calibrated, at rows left out of the fit",
        "             # / #  correction, over the workspace",
        "             # / #  expected error, over the workspace",
    ]
    few = calibrate(pairs_of(true, postures(3, 2), known=False, noise=(1e-5, 1e-4)), arm="ur10e")
    assert few.statement()[1].endswith(", fitted")
    assert few.statement()[-2:] == [f"note         {few.notes[-1]}", f"undetermined {few.missing}"]
    read = calibrate(saved(tmp_path, urp(nominal_dh("ur3"), ["A"])))
    assert read.statement()[2:] == ["figures      read, nothing is fitted", f"note         {read.notes[0]}"]


def test_sources_that_do_not_go_together_are_refused(tmp_path):
    true, q = made_up("ur5e", 3), postures(20, 3)
    pairs = pairs_of(true, q)
    program, typed, panda = (
        saved(tmp_path, urp(figures_of("ur5e", 1), ["A"])),
        tmp_path / "typed.csv",
        tmp_path / "p.urdf",
    )
    typed.write_text(table(q, frames_of(true, q)[-1], PLAIN))
    panda.write_text(get_arm("panda").urdf)
    assert "a source is needed: a .urp" in refused([])
    assert "program.urp carries the figures themselves: give it alone" in refused([typed, program])
    assert re.search("program.urp carries the figures of a UR, not of p(anda)?$", refused(program, arm=panda))
    assert "not those of a ur10: they fit ur5e and ur7e" in refused(program, arm="ur10")
    saved(tmp_path, urp(nominal_dh("ur5e") + 0.1, ["A"]))
    assert refused(program) == "the figures of program.urp fit no model of UR"
    assert "not those of a ur5e: they fit no UR" in refused(program, arm="ur5e")
    wide = replace(pairs, q=np.column_stack([q, q[:, 0]]))
    assert "a UR has six joints, made_up.csv has 7" in refused(wide)
    assert "made_up.csv and made_up.csv do not have the same number of joints" in refused_to_join(pairs, wide)
    points = replace(pairs, seen=pairs.positions)
    np.testing.assert_array_equal(points.positions, pairs.positions)
    assert "do not have the same number of numbers a pose" in refused_to_join(points, pairs)
    assert "arm 'panda' has 7 joints, made_up.csv has 6" in refused(pairs, arm="panda")
    q7 = np.column_stack([q, q[:, 2] / 2]) + np.array([0, 1.4, -1.6, 0, 1.5, 1.5, 0])
    seen = ArmKinematics.of("panda").fk(q7)
    mirrored = PosePairs("mirrored.csv", q7 * [1, -1, 1, 1, 1, 1, 1], seen)
    assert re.search(
        r"mirrored.csv do not fit panda: \d+ mm are left .*or of another sign", refused(mirrored, arm="panda")
    )


def refused_to_join(one, other):
    with pytest.raises(InputError) as error:
        one.joined(other)
    return str(error.value)


def test_several_tools_and_robots_of_a_program(tmp_path):
    figures = figures_of("ur5e", 1)
    two = calibrate(saved(tmp_path, urp(figures, ["A"]), urp(figures, ["B"], tcp="0, 0, 0.2, 0, 0, 0")))
    assert two.tcp is None
    assert two.notes == ("the waypoints have 2 tool centre points",)
    beside = urp(nominal_dh("ur5e"), ["C"], valid="false")
    assert "has the data sheet's figures beside: " in calibrate(saved(tmp_path, urp(figures, ["A"]), beside)).notes[0]
    alone = re.sub("</?Waypoint[^>]*>", "", urp(figures_of("ur5e", 2), ["A"]))
    file = saved(tmp_path, urp(figures, ["A", "B", "C", "D"]), alone)
    assert "(1: 4 waypoints, A, B, C, ...; 2: the program itself)" in refused(file)
    assert "robot must be" in refused(file, robot=3)
    with pytest.raises(InputError, match=r"program.urp has the figures of 2 robots: .*kinreach calibrate --robot N"):
        get_arm("ur5e").calibrated(file)
    with pytest.raises(InputError, match=r"mm from where a ur10 .*it fits .*ur5e"):
        get_arm("ur10").calibrated(saved(tmp_path, urp(figures, ["A"])))
    with pytest.raises(InputError, match=r"program.urp has no calibration: its kinematics is NOT_INITIALIZED"):
        get_arm("ur5e").calibrated(saved(tmp_path, urp(figures, ["A"], status="NOT_INITIALIZED")))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (lambda q, T: "a\0b", "is no text: it must be a .urp, a .script or a table"),
        (lambda q, T: "def x():\n  movej([0,0,0,0,0,0])\nend", "has no waypoint with joint angles and a pose"),
        (lambda q, T: table(np.column_stack([q, q[:, 0]]), T, [*PLAIN[:6], "q1", *PLAIN[6:]]), "has 2 columns q1"),
        (lambda q, T: table(np.column_stack([q, q[:, :1]]), T), "has no header and 13 columns; needed are 6 joint"),
    ],
)
def test_files_that_are_no_source_say_why(tmp_path, text, said):
    q = postures(20, 3)
    file = tmp_path / "source"
    file.write_text(text(q, frames_of(made_up("ur5e", 3), q)[-1]))
    assert said in refused(file)


def test_positions_alone_have_a_tool_too(tmp_path):
    """A tracker sees a point; its columns may be called as a tool's."""
    true, q = made_up("ur5e", 3), postures(60, 3)
    F = frames_of(true, q)[-1]
    seen = (F @ TCP)[:, :3, 3]
    point = PosePairs("", q, seen).tool_on(F)
    np.testing.assert_allclose(point, pose([*TCP[:3, 3], 0.0, 0.0, 0.0]), atol=1e-9)
    rows = [",".join(map(repr, row)) for row in np.hstack([q, seen]).tolist()]
    (tmp_path / "seen.csv").write_text("\n".join([",".join([*PLAIN[:6], "tcp_x", "tcp_y", "tcp_z"]), *rows]))
    pairs = PosePairs.read(tmp_path / "seen.csv")
    assert pairs.tcp is None
    np.testing.assert_array_equal(pairs.positions, seen)
    assert "fit no model of UR" in refused(replace(pairs, q=q + np.random.default_rng(0).normal(size=q.shape)))
