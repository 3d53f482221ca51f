"""What the page says of a target, without a browser."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from example_robot_data.robots_loader import getModelPath

from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, AxisGoal, CollisionChecker, PoseGoal, URKinematics
from kinreach.kinematics.inside import SOLVERS
from kinreach.robots import PUBLISHED_CALIBRATIONS, ArmDescription, get_arm
from kinreach.robots._urdf import parse_urdf
from kinreach.robots.inside import link_shapes, without_shapes
from kinreach.view import TargetModel
from kinreach.view import _html as html
from kinreach.view._cli import setup_of
from kinreach.view._figure import Figure
from kinreach.view._names import branch_name
from kinreach.view._real_arm import RealArm
from kinreach.view._snippet import program, real_arm_program
from kinreach.view._target import AXIS, POINT, POSE, State
from tests.kinematics.test_coupled_and_sliding import COUPLED_WRIST, PALLETIZER, RAIL, SCARA, chain

CALIBRATION = PUBLISHED_CALIBRATIONS["ur5_a"]


@pytest.fixture(scope="module")
def ur5():
    return TargetModel("ur5-thesis")


def poses(model, count, *, seed=0, stretch=1.6):
    """Poses of the arm, some of them moved out of its reach."""
    rng, kinematics = np.random.default_rng(seed), model.kinematics
    for _ in range(count):
        T = kinematics.fk(rng.uniform(kinematics.lower, kinematics.upper))
        T[:3, 3] *= rng.uniform(0.5, stretch)
        yield T


def test_a_posture_along_a_self_motion_replaces_the_one_before():
    """It is judged as others are, its distance from the seed among it, and is shown if nothing was."""
    model, rng, tried = TargetModel("panda"), np.random.default_rng(0), 0
    kinematics = model.kinematics
    seed = np.array(kinematics.arm.home)
    answer = model.answer(PoseGoal(kinematics.fk(seed)), seed)
    before = len(answer.postures)
    for q in seed + rng.uniform(-0.3, 0.3, (5, 7)):
        answer = model.along(answer, 2, q)
        *_, last = answer.postures
        assert len(answer.postures) == before + 1
        assert last.branch == 2
        np.testing.assert_array_equal(last.q, q)
        assert last.distance == pytest.approx(np.linalg.norm(q - seed))
        assert answer.shown >= 0
        tried += 1
    assert tried == 5


@pytest.mark.parametrize("calibrated", [False, True])
def test_every_branch_is_reached_or_has_a_reason(calibrated, root):
    kinematics = (
        URKinematics.from_calibration(CALIBRATION, tip="tcp", base="world")
        if calibrated
        else URKinematics("ur5-thesis", tip="tcp", base="world")
    )
    rng, missing, apart = np.random.default_rng(0), 0, 0
    for _ in range(40 if calibrated else 1000):
        T = kinematics.fk(rng.uniform(-3, 3, 6))
        T[:3, 3] *= rng.uniform(0.3, 1.5)
        found = {branch for branch in kinematics.all_solutions(T, limits=False).branch.tolist() if branch < 8}
        lacks = kinematics.shortfalls(T)
        apart += found ^ set(lacks) != set(range(8))
        missing += len(lacks)
        assert all(lack.missing > 0 for lack in lacks.values())
        if not calibrated:
            assert found | set(lacks) == set(range(8))
            assert not found & set(lacks)
    assert missing > (40 if calibrated else 1500)
    assert apart <= 5  # of a calibrated arm, near a border


@pytest.mark.parametrize("kind", [POSE, AXIS])
def test_states_are_what_the_solver_and_the_checker_say(ur5, kind):
    kinematics, checker = ur5.kinematics, CollisionChecker(ur5.kinematics)
    seen = dict.fromkeys(State, 0)
    for T in poses(ur5, 60):
        goal = ur5.goal(kind, T)
        answer = ur5.answer(goal, ur5.home)
        assert [posture.branch for posture in answer.postures] == list(range(8))
        for posture in answer.postures:
            seen[posture.state] += 1
            assert (posture.reason == "") == (posture.state is State.USABLE)
            assert (posture.q is None) == (posture.state is State.UNREACHED)
            if posture.q is not None:
                assert posture.pairs == checker.contacts(posture.q)
                assert np.linalg.norm(kinematics.fk(posture.q)[:3, 3] - T[:3, 3]) < 1e-6
                assert all(
                    part in posture.reason for pair in posture.pairs for part in ("touches", pair[0].split("_")[0])
                )
        assert (answer.approach is None) == any(posture.q is not None for posture in answer.postures)
        best = kinematics.solve(goal, ur5.home, accept=checker.free)
        if answer.usable:
            assert answer.postures[answer.shown].state is State.USABLE
            assert (
                np.linalg.norm(answer.postures[answer.shown].q - ur5.home) <= np.linalg.norm(best.q - ur5.home) + 1e-9
            )
            assert f"{answer.usable} of 8" in answer.verdict
        else:
            assert answer.verdict.startswith("No posture")
    assert min(seen[state] for state in State if state is not State.LIMITS) > 20


def test_a_joint_limit_is_named(ur5):
    model = TargetModel("ur5-thesis")
    model.limit_joints(np.radians(100))
    named, refused = 0, 0
    for T in poses(model, 20, stretch=1.0):
        for posture in model.answer(model.goal(POSE, T), model.home).postures:
            if posture.state is State.LIMITS:
                refused += 1
                outside = [
                    name.removesuffix("_joint").replace("_", " ")
                    for name, value in zip(model.kinematics.arm.joints, posture.q, strict=True)
                    if abs((value + np.pi) % (2 * np.pi) - np.pi) > np.radians(100)
                ]
                named += all(f"{name} would be at" in posture.reason for name in outside)
    assert named == refused > 20


def test_the_nearest_outside_the_limits_is_least_outside():
    model = TargetModel("ur5-thesis")
    model.limit_joints(np.radians(90))
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[:3, 3] = 0.5, 0.1, 0.1
    answer = model.answer(model.goal(POSE, T), model.home)
    assert {posture.state for posture in answer.postures} == {State.LIMITS}
    turned = [np.abs((posture.q + np.pi) % (2 * np.pi) - np.pi) - np.pi / 2 for posture in answer.postures]
    least = answer.postures[int(np.argmin([np.maximum(over, 0).sum() for over in turned]))]
    assert answer.verdict == f"No posture can be used: all 8 are outside the joint limits. The nearest: {least.reason}."
    assert answer.verdict.count("would be at") == 1


def test_what_is_missing_is_in_the_verdict(ur5):
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[:3, 3] = 1.2, 0.0, 0.0
    answer = ur5.answer(ur5.goal(POSE, T), ur5.home)
    least = min(lack.missing for lack in ur5.kinematics.shortfalls(T).values())
    assert answer.verdict.startswith("No posture reaches this target. Too far by ")
    assert f"{1000 * least:.0f} mm" in answer.verdict
    near = ur5.kinematics.nearest_in_reach(T)[:3, 3]
    tip = ur5.kinematics.fk(answer.approach.q)
    np.testing.assert_allclose(tip[:3, 3], near, atol=1e-6)
    np.testing.assert_allclose(tip[:3, :3], T[:3, :3], atol=1e-6)
    assert answer.approach.proven
    assert answer.approach.distance == pytest.approx(np.linalg.norm(near - T[:3, 3]), abs=1e-6)
    assert answer.verdict.endswith(
        f"With the tool turned as asked the tip comes within {1000 * answer.approach.distance:.0f} mm of it (amber)."
    )
    T[:3, 3] = 0.5, 0.0, -0.25
    assert "finger left touches table" in ur5.answer(ur5.goal(POSE, T), ur5.home).verdict


@pytest.mark.slow
def test_the_verdict_is_of_the_branch_that_lacks_the_least(ur5):
    compared = 0
    for T in poses(ur5, 600, seed=5, stretch=3.0):
        lacks = ur5.kinematics.shortfalls(T)
        if len(lacks) < 8:
            continue
        answer = ur5.answer(ur5.goal(POSE, T), ur5.home)
        least = min(lacks, key=lambda branch: lacks[branch].missing)
        (reason,) = (posture.reason for posture in answer.postures if posture.branch == least)
        assert answer.verdict.startswith(f"No posture reaches this target. {reason[0].upper()}{reason[1:]}.")
        compared += 1
    assert compared > 100


def test_the_slowest_motion_is_the_least_that_joints_do(ur5):
    rng = np.random.default_rng(1)
    for _ in range(50):
        q = rng.uniform(-2, 2, 6)
        moved = ur5.kinematics.jacobian(q) * np.array([1, 1, 1, 0.2, 0.2, 0.2])[:, None]
        assert ur5.slowest_motion(q) ** 2 == pytest.approx(np.linalg.eigvalsh(moved.T @ moved)[0], abs=1e-9)
    assert ur5.slowest_motion(np.zeros(6)) < 1e-6
    assert ur5.nearest_singularity(np.array([0, -1, 1, 0, 1e-3, 0])).startswith("wrist")
    assert ur5.nearest_singularity(np.array([0, -1, 1e-3, 0, 1, 0])).startswith("elbow")


def test_solvers_end_where_they_say(ur5):
    T = ur5.kinematics.fk(ur5.home)
    T[2, 3] += 0.1
    finishes = ur5.solve(ur5.goal(POSE, T), ur5.home)
    assert [finish.solver for finish in finishes] == list(SOLVERS)
    for finish in finishes:
        assert finish.result.success
        assert np.linalg.norm(ur5.kinematics.fk(finish.result.q)[:3, 3] - T[:3, 3]) < 2e-4
    table = html.solvers(finishes)
    assert all(name in table for name in SOLVERS)


def test_a_solver_is_timed_in_many_calls_after_the_first(ur5, monkeypatch):
    """The first call imports and compiles; a slow solver is not called twenty times."""
    calls, solve = [], ur5._solver("closed-form").solve
    monkeypatch.setattr(ur5._solver("closed-form"), "solve", lambda *a, **k: calls.append(0) or solve(*a, **k))
    for step, timed in ((1e-3, 20), (0.03, 7), (5.0, 1)):
        calls.clear()
        clock = iter((step * np.arange(99)).tolist())
        monkeypatch.setattr("kinreach.view._target.time.perf_counter", lambda clock=clock: next(clock))
        (finish,) = ur5.solve(ur5.goal(POSE, ur5.kinematics.fk(ur5.home)), ur5.home, ["closed-form"])
        assert (finish.calls, len(calls)) == (timed, timed + 1)
        assert finish.seconds == pytest.approx(step)
        assert f"median of {timed} calls after a first" in html.solvers([finish])


def test_the_table_of_solvers_is_in_the_words_of_the_page(ur5):
    (finish,) = ur5.solve(ur5.goal(POSE, ur5.kinematics.fk(ur5.home)), ur5.home, ["closed-form"])
    for off, turned, said in (
        (4e-7, 1e-7, "<td>&lt; 1 µm</td><td>0.00°</td>"),
        (3.2e-6, 1e-3, "<td>3 µm</td><td>0.06°</td>"),
        (2.3e-4, 0.5, "<td>0.23 mm</td><td>28.65°</td>"),
        (0.1234, 2.0, "<td>123 mm</td><td>114.59°</td>"),
        (1.5, np.pi, "<td>1500 mm</td><td>180.00°</td>"),
    ):
        result = replace(finish.result, position_error=off, orientation_error=turned)
        assert said in html.solvers([replace(finish, result=result)])


@pytest.mark.slow
def test_policies_are_solvers_too():
    """Where they end is what their episodes say; what they are not for, they are not offered for."""
    setup = setup_of("ur5-thesis", calibration=str(CALIBRATION))
    assert setup.policies == setup_of("ur5-thesis").policies == (
        "ppo-single", "ranked-single", "thesis-ppo-single", "ppo-multi", "ranked-multi", "thesis-ppo-multi",
    )  # fmt: skip
    assert setup_of("ur5-thesis", tip="tool0").policies == setup_of("arm3").policies == ()
    assert setup_of("panda").policies == ("panda-single",)
    model, rng, near = setup_of("ur5-thesis").model(), np.random.default_rng(4), 0
    for position in model.kinematics.arm.workcell.goals.sample(rng, 5):
        finishes = model.solve(AxisGoal(position), model.home, ["ranked-single", "ranked-multi", "closed-form"])
        for finish in finishes:
            off = np.linalg.norm(model.kinematics.fk(finish.result.q)[:3, 3] - position)
            assert finish.result.position_error == pytest.approx(off)
            assert finish.seconds > 0
            near += off < 0.002
    assert near == 15
    with pytest.raises(InputError, match=r"is for kinreach/ButtonPress-v0"):
        TargetModel("ur5-thesis", policies=["button"]).solve(AxisGoal(position), model.home, ["button"])


@pytest.mark.parametrize("arm", ["ur5e", "arm3"])
def test_other_arms(arm):
    model = TargetModel(arm)
    T = model.kinematics.fk(model.home)
    for kind in model.kinds:
        answer = model.answer(model.goal(kind, T), model.home)
        assert answer.usable >= 1
        assert np.abs(answer.postures[answer.shown].q - model.home).max() < 1e-6
    T[:3, 3] += 5.0
    approach = model.answer(model.goal(model.kinds[0], T), model.home).approach
    assert approach.proven == (arm == "ur5e")
    assert 0 < approach.distance < np.linalg.norm(T[:3, 3])
    assert model.checker is not None
    assert (model.kinds == (POINT,)) == (arm == "arm3")


def test_names_are_different():
    for arm in ("ur5-thesis", "arm3"):
        kinematics = ArmKinematics.of(arm)
        count = 8 if kinematics.n == 6 else 4
        assert len({branch_name(kinematics, branch) for branch in range(count)}) == count


def test_postures_of_other_arms_with_three_joints_have_names_of_their_own(tmp_path):
    """More of them are found than the 3-DOF arm of the package has."""
    links = "".join(f'<link name="l{index}"/>' for index in range(4))
    joints = "".join(
        f'<joint name="j{index}" type="revolute"><parent link="l{index}"/><child link="l{index + 1}"/>'
        f'<origin xyz="{0.3 if index else 0} 0 {0.1 * index}"/><axis xyz="0 {index % 2} {1 - index % 2}"/>'
        '<limit lower="-6" upper="6" effort="1" velocity="1"/></joint>'
        for index in range(3)
    )
    file = tmp_path / "three.urdf"
    file.write_text(f'<robot name="three">{links}{joints}</robot>')
    model, most = TargetModel(ArmDescription.from_urdf(file)), 0
    rng = np.random.default_rng(0)
    for _ in range(8):
        T = model.kinematics.fk(rng.uniform(-3, 3, 3))
        names = [posture.name for posture in model.answer(model.goal(POINT, T), model.home).postures]
        assert len(set(names)) == len(names)
        most = max(most, len(names))
    assert most > 4


def test_a_figure_follows_the_arm():
    kinematics = ArmKinematics.of("arm3", base="world")
    figure = Figure(kinematics)
    rng = np.random.default_rng(0)
    data, frames = kinematics.model.createData(), [kinematics.model.getFrameId(link) for link in figure.links]
    import pinocchio as pin

    for _ in range(10):
        q = rng.uniform(-1, 1, 3)
        pin.framesForwardKinematics(kinematics.model, data, q)
        for pose, frame in zip(figure.poses(q), frames, strict=True):
            np.testing.assert_allclose(pose[:3], data.oMf[frame].translation, atol=1e-12)
            w, x, y, z = pose[3:]
            np.testing.assert_allclose(pin.Quaternion(w, x, y, z).matrix(), data.oMf[frame].rotation, atol=1e-12)


def test_arms_without_shapes_are_drawn_as_tubes(tmp_path):
    (tmp_path / "bare.urdf").write_bytes(ET.tostring(without_shapes(get_arm("ur5e").robot, "visual", "collision")))
    kinematics = ArmKinematics.from_urdf(tmp_path / "bare.urdf", tip="tool0", base="world")
    assert link_shapes(kinematics.arm) == []
    assert TargetModel(kinematics.arm).checker is None
    figure = Figure(kinematics)
    q = np.array(kinematics.arm.home)
    corners = np.concatenate([piece.vertices for piece in figure.fine if piece.link == len(figure.links) - 1])
    x, y, z, *_ = figure.poses(q)[-1]
    assert len(figure.links) == 7
    assert np.linalg.norm(np.array([x, y, z]) - kinematics.fk(q)[:3, 3]) <= np.abs(corners).max() * 2


def test_a_copied_program_says_the_same(ur5, capsys):
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[:3, 3] = 0.5, 0.1, -0.1
    for kind in (POSE, AXIS):
        goal = ur5.goal(kind, T)
        answer = ur5.answer(goal, ur5.home)
        code = program(ur5, goal, ur5.home, arm="'ur5-thesis'")
        exec(compile(code, "copied", "exec"), {})
        said = capsys.readouterr().out.splitlines()
        assert said[0].strip() == "ok"
        assert sorted(int(line.split()[0]) for line in said[1:]) == [
            p.branch for p in answer.postures if p.q is not None
        ]
        for posture in answer.postures:
            line = next(line for line in said[1:] if line.startswith(f"{posture.branch} "))
            assert str(np.degrees(posture.q).round(1)) in line
            assert str(posture.pairs) in line


def copied(code, capsys):
    """What a copied program prints: its first line, and the angles [rad] in the others by branch."""
    exec(compile(code, "copied", "exec"), {})
    said, *lines = capsys.readouterr().out.replace("\n ", " ").splitlines()
    angles = (re.search(r"\[(.*?)\]", line)[1].split() for line in lines)
    return said, {
        int(line.split()[0]): np.radians([float(word) for word in words])
        for line, words in zip(lines, angles, strict=True)
    }


@pytest.mark.parametrize("calibration", [None, str(CALIBRATION)])
@pytest.mark.slow
def test_a_copied_program_has_the_limits_of_the_page(calibration, capsys):
    setup = setup_of("ur5-thesis", calibration=calibration)
    model, counted = setup.model(), 0
    model.limit_joints(np.radians(160))
    for T in poses(model, 6, stretch=1.0):
        goal = model.goal(POSE, T)
        answer = model.answer(goal, model.home)
        _, found = copied(program(model, goal, model.home, arm=setup.expression), capsys)
        within = {p.branch: p.q for p in answer.postures if p.state in (State.USABLE, State.COLLIDES)}
        assert set(found) == set(within)
        for branch, q in within.items():
            np.testing.assert_allclose(found[branch], q, atol=2e-3)
        counted += len(within)
    assert counted > 6


def test_a_copied_search_keeps_the_limits_of_the_page(capsys):
    model, found, rng = TargetModel("panda"), 0, np.random.default_rng(0)
    model.limit_joints(np.radians(60))
    for _ in range(4):
        T = model.kinematics.fk(rng.uniform(model.lower, model.upper))
        said, postures = copied(program(model, model.goal(AXIS, T), model.home, arm="'panda'"), capsys)
        assert said.startswith("ok") == bool(postures)
        for q in postures.values():
            assert (q >= model.lower - 1e-3).all()
            assert (q <= model.upper + 1e-3).all()
            found += 1
    assert found == 4


def test_an_arm_with_any_six_joints_has_all_its_postures(tmp_path):
    file = "kinova_description/robots/kinova.urdf"
    text = Path(f"{getModelPath(file)}/{file}").read_text()
    (tmp_path / "bare.urdf").write_bytes(ET.tostring(without_shapes(parse_urdf(text), "visual", "collision")))
    model = TargetModel(ArmDescription.from_urdf(tmp_path / "bare.urdf", tip="j2s6s200_link_6"))
    kinematics, rng, most = model.kinematics, np.random.default_rng(3), 0
    for _ in range(6):
        T = kinematics.fk(rng.uniform(np.maximum(kinematics.lower, -3), np.minimum(kinematics.upper, 3)))
        answer = model.answer(model.goal(POSE, T), model.home)
        every = len(kinematics.all_solutions(T, limits=False).q)
        assert len(answer.postures) == every
        assert "by a search" not in answer.verdict
        most = max(most, every)
    assert most >= 6
    assert "by a search" in model.answer(model.goal(AXIS, T), model.home).verdict
    for kind, solver in ((POSE, "all_solutions"), (AXIS, "LevenbergMarquardtSolver(kin).solve")):
        assert f"solution = {solver.replace('all', 'kin.all')}(" in program(
            model, model.goal(kind, T), model.home, arm="''"
        )


@pytest.mark.slow
def test_copied_programs_of_an_arm_from_a_file(capsys):
    file = "ur_description/urdf/ur5_robot.urdf"
    setup = setup_of(arm=f"{getModelPath(file)}/{file}", calibration=str(CALIBRATION))
    T = ArmKinematics.of(setup.arm, base="world").fk(setup.arm.home)
    model = TargetModel(setup.arm)
    for code in (
        program(model, model.goal(POSE, T), model.home, arm=setup.expression),
        real_arm_program(RealArm(setup.nominal, setup.arm), T, model.home, sheet=setup.sheet, arm=setup.expression),
    ):
        exec(compile(code, "copied", "exec"), {})
        assert capsys.readouterr().out.startswith("ok")


def test_copied_programs_of_an_arm_of_ones_own_run(capsys):
    setup = setup_of("kinreach.robots._arm3:ARM")
    model = setup.model()
    goal = model.goal(POINT, model.kinematics.fk(model.home))
    assert setup.arm is model.kinematics.arm
    exec(compile(program(model, goal, model.home, arm=setup.expression), "copied", "exec"), {})
    assert capsys.readouterr().out.startswith("ok")


@pytest.mark.parametrize("arm", ["arm3", "panda"])
def test_copied_programs_of_other_arms_run(arm, capsys):
    model = TargetModel(arm)
    T = model.kinematics.fk(model.home)
    for kind in model.kinds:
        exec(compile(program(model, model.goal(kind, T), model.home, arm=repr(arm)), "copied", "exec"), {})
        assert capsys.readouterr().out.startswith("ok")


def test_a_refused_posture_is_not_called_solid(ur5):
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    for z, word, other in ((0.0, ">solid<", ">shown<"), (-0.25, ">shown<", ">solid<")):
        T[:3, 3] = 0.5, 0.0, z
        answer = ur5.answer(ur5.goal(POSE, T), ur5.home)
        listed = html.legend(answer, shown=answer.shown, joints=ur5.kinematics.arm.joints)
        assert listed.count(word) == 1
        assert other not in listed


def test_what_is_shown_is_escaped(ur5):
    hostile = "<script>alert(1)</script>"
    assert "<script>" not in html.message(hostile, bad=True) + html.small(hostile) + html.code(hostile)
    answer = ur5.answer(ur5.goal(POSE, ur5.kinematics.fk(ur5.home)), ur5.home)
    assert "<script>" not in html.legend(answer, shown=0, joints=[hostile] * 6)


def test_a_setup_has_the_tip_and_the_calibration_that_were_asked_for():
    calibrated = setup_of("ur5-thesis", calibration=str(CALIBRATION), tip="tool0")
    assert calibrated.model().kinematics.tip == "tool0"
    assert type(calibrated.model().kinematics).__name__ == "CalibratedURKinematics"
    assert (calibrated.title, calibrated.sheet) == ("kinreach – ur5-thesis", "'ur5-thesis'")
    assert setup_of("UR5e").sheet == "'ur5e'"


def test_an_endless_joint_is_within_one_turn_each_way():
    """A slider of twenty turns is of no use; the copied program has the same limits."""
    model = TargetModel("ur3")
    assert model.kinematics.upper[5] == pytest.approx(20 * np.pi)
    np.testing.assert_allclose(model.upper, [2 * np.pi, 2 * np.pi, np.pi, 2 * np.pi, 2 * np.pi, 2 * np.pi])
    np.testing.assert_array_equal(model.lower, -model.upper)
    goal = model.goal(POSE, model.kinematics.fk(model.home))
    assert "wrist_3_joint" in program(model, goal, model.home, arm="'ur3'")
    assert "with_limits" not in program(TargetModel("ur5"), goal, model.home, arm="'ur5'")


@pytest.mark.parametrize(
    "joints", [SCARA, PALLETIZER, RAIL, COUPLED_WRIST], ids=["scara", "palletizer", "rail", "wrist"]
)
def test_arms_with_joints_that_slide_or_follow_others(joints, tmp_path, capsys):
    """Targets that they reach have postures, slides are in metres, and the copied program runs."""
    names = [name for name, _, options in joints if "mimic" not in options]
    (tmp_path / "arm.urdf").write_text(chain(*joints))
    model = TargetModel(ArmDescription.from_urdf(tmp_path / "arm.urdf", joints=names))
    kin, rng, reached = model.kinematics, np.random.default_rng(3), 0
    for q in rng.uniform(*kin.sampling_limits, (5, kin.n)):
        for kind in model.kinds:
            goal = model.goal(kind, kin.fk(q))
            answer = model.answer(goal, q)
            reached += answer.approach is None
            for posture in answer.postures:
                assert max(goal.error(kin.fk(posture.q))) < 1e-3
    assert reached >= 4 * len(model.kinds)
    sliding = [name for name, turns in zip(kin.arm.joints, model.turns, strict=True) if not turns]
    listed = html.legend(answer, shown=answer.shown, joints=kin.arm.joints, sliding=sliding)
    assert listed.count(" m ") + listed.count(" m,") + listed.count(' m"') >= len(sliding)
    model.limit_joints(0.1)
    assert [name for name, high in zip(kin.arm.joints, model.upper, strict=True) if high > 0.1] == [
        name for name, high in zip(kin.arm.joints, kin.upper, strict=True) if name in sliding and high > 0.1
    ]
    if joints is SCARA:
        said = TargetModel(kin.arm).answer(model.goal(POSE, kin.fk([0.4, 0.5, 0.23, 0.1])), kin.arm.home).verdict
        assert "joint limit: z would be at 0.230 m, allowed is 0.000 m to 0.180 m" in said
    arm = f"ArmDescription.from_urdf({str(tmp_path / 'arm.urdf')!r}, joints={names!r})"
    text = program(TargetModel(kin.arm), goal, np.array(kin.arm.home), arm=arm)
    exec(compile(text, "copied", "exec"), {})
    assert capsys.readouterr().out.startswith("ok")
