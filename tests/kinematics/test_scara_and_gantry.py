"""SCARAs and gantries in closed form: every posture, against many starts of a numeric solver."""

import numpy as np
import pytest

from kinreach.cli import main
from kinreach.errors import InputError
from kinreach.kinematics import (
    ArmKinematics,
    AxisGoal,
    LevenbergMarquardtSolver,
    PoseGoal,
    PositionGoal,
    SixAxisKinematics,
    SlidingKinematics,
    Status,
)
from tests.kinematics.test_coupled_and_sliding import RIGHT, SCARA, chain, written

TURN = 2 * np.pi


def numbers(values):
    return " ".join(map(str, values))


def random_scara(rng, *, limits=True):
    """Axes in any direction, either way, the slide at any place among them, in an arm that stands anywhere."""
    kinds, joints = ["revolute"] * 3, []
    kinds.insert(int(rng.integers(4)), "prismatic")
    for index, kind in enumerate(kinds):
        place = {"xyz": numbers(rng.uniform(-0.3, 0.3, 3)), "axis": numbers(rng.choice([-1, 1]) * np.array([0, 0, 1]))}
        if index == 0:
            place["rpy"] = numbers(rng.uniform(-3, 3, 3))
        ends = (-0.2, 0.3) if kind == "prismatic" else (-2.5, 2.9)
        kind = "continuous" if kind == "revolute" and not limits else kind
        joints.append((f"j{index}", kind, {**place, "limits": ends}))
    return chain(*joints, ("tool", "fixed", {"xyz": "0.05 0.02 0.1", "rpy": numbers(rng.uniform(-1, 1, 3))}))


def random_gantry(rng, turning):
    """Three slides in any directions, and joints that turn in any others."""
    ways = np.linalg.qr(rng.normal(size=(3, 3)))[0] + 0.2 * rng.normal(size=(3, 3))
    joints = [(f"s{i}", "prismatic", {"axis": numbers(way), "limits": (0, 9.0)}) for i, way in enumerate(ways)]
    for index in range(turning):
        place = {"rpy": numbers(rng.uniform(-2, 2, 3)), "xyz": numbers(rng.uniform(-0.2, 0.2, 3))}
        joints.append((f"t{index}", "revolute", {**place, "axis": numbers(rng.normal(size=3))}))
    return chain(*joints)


def apart(kin, q, others):
    """How far a posture is from the nearest of others, angles modulo turns [rad, m]."""
    way = np.abs(others - q)
    way[:, ~kin.slides] = np.abs((way[:, ~kin.slides] + np.pi) % TURN - np.pi)
    return way.max(axis=1).min(initial=np.inf)


def arms(rng, folder):
    for _ in range(6):
        yield written(folder, random_scara(rng), tip="tool_link")
    for turning in (0, 1, 2, 3, 3, 3):
        yield written(folder, random_gantry(rng, turning))


@pytest.mark.slow
def test_every_posture(tmp_path):
    """Exact, the one that made the pose among them, no two alike; a solver from many starts finds no other."""
    rng, count, found_by_solver = np.random.default_rng(0), 0, 0
    for kin in arms(rng, tmp_path):
        assert type(kin) is SlidingKinematics
        solver = LevenbergMarquardtSolver(kin, max_restarts=0)
        for q in rng.uniform(kin.lower, kin.upper, (6, kin.n)):
            T = kin.fk(q)
            every = kin.all_solutions(T, limits=False)
            assert every.residual.max() < 1e-9
            assert apart(kin, q, every.q) < 1e-6
            assert len(every) <= kin.branches
            for index, one in enumerate(every.q):
                np.testing.assert_allclose(kin.fk(one), T, atol=1e-9)
                assert apart(kin, one, np.delete(every.q, index, axis=0)) > 1e-6
            within = kin.all_solutions(T)
            assert kin.within_limits(within.q[0])
            assert {*within.branch} <= {*every.branch}
            nearest = kin.nearest(T, q)
            np.testing.assert_allclose(nearest.q, q, atol=1e-6)
            count += len(every)
        for q in rng.uniform(kin.lower, kin.upper, (4, kin.n)):
            T = kin.fk(q)
            every = kin.all_solutions(T, limits=False).q
            for start in rng.uniform(kin.lower, kin.upper, (6, kin.n)):
                found = solver.solve(PoseGoal(T), start)
                if found.success:
                    found_by_solver += 1
                    assert apart(kin, found.q, every) < 0.05
    assert count > 100
    assert found_by_solver > 120


def test_batches_are_as_each_alone(tmp_path):
    rng, count = np.random.default_rng(1), 0
    for kin in arms(rng, tmp_path):
        Q = rng.uniform(kin.lower, kin.upper, (8, kin.n))
        T = kin.fk(Q)
        batch, nearest = kin.batch(T), kin.nearest_batch(T, Q)
        np.testing.assert_allclose(nearest.q, Q, atol=1e-6)
        for pose, q, valid in zip(T, batch.q, batch.valid, strict=True):
            np.testing.assert_array_equal(q[valid], kin.all_solutions(pose).q)
            count += valid.sum()
        assert kin.batch(T[:0]).q.shape == (0, kin.branches, kin.n)
    assert count > 90


def test_regular_postures_have_no_flags(tmp_path):
    rng, count = np.random.default_rng(8), 0
    for kin in arms(rng, tmp_path):
        for q in rng.uniform(kin.lower, kin.upper, (4, kin.n)):
            if np.linalg.svd(kin.jacobian(q))[1].min() > 1e-3:
                found = kin.all_solutions(kin.fk(q), limits=False)
                assert found.success
                assert not found.singularity.any()
                count += 1
    assert count > 40


@pytest.mark.slow
def test_a_scara_follows_a_closed_curve_in_its_turns(tmp_path):
    rng, count = np.random.default_rng(2), 0
    for _ in range(3):
        kin = written(tmp_path, random_scara(rng, limits=False), tip="tool_link")
        s = np.linspace(0, 1, 480)[:, None]
        start, turns = rng.uniform(-1, 1, kin.n), np.zeros(kin.n)
        turning = np.flatnonzero(~kin.slides)
        turns[turning[0]], turns[turning[2]] = 1, -2
        start[turning[1]], start[kin.slides] = 0.9, 0.0
        curve = start + TURN * turns * s + np.where(kin.slides, 0.05, 0.3) * np.sin(TURN * s)
        if min(map(abs, kin._links[:2])) < 0.05:
            continue
        bend = kin.all_solutions(kin.fk(start)).branch
        q = start + TURN * np.where(kin.slides, 0, rng.integers(-5, 5, kin.n))
        shift = q - start
        for T, expected in zip(kin.fk(curve), curve, strict=True):
            result = kin.nearest(T, q)
            assert np.abs(result.q - q).max() < np.deg2rad(2)
            q = result.q
            count += np.allclose(q, expected + shift, atol=1e-6)
        assert len(bend) == 2
    assert count > 450


def test_where_a_joint_is_free_it_keeps_the_seeds_value(tmp_path):
    """A wrist that is straight, an elbow that is, and an arm that is folded onto its shoulder."""
    wrist = [
        ("w0", "revolute", {}),
        ("w1", "revolute", {"rpy": f"{RIGHT} 0 0"}),
        ("w2", "revolute", {"rpy": f"-{RIGHT} 0 0"}),
    ]
    axes = (("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1"))
    slides = [(name, "prismatic", {"axis": way, "limits": (0, 2.0)}) for name, way in axes]
    kin = written(tmp_path, chain(*slides, *wrist))
    q = np.array([0.5, 0.6, 0.7, 0.4, 0.0, 0.3])
    for first in (-0.2, 0.9):
        found = kin.all_solutions(kin.fk(q), seed=[0.5, 0.6, 0.7, first, 0.0, 0.0])
        assert found.singularity[0]
        np.testing.assert_allclose(found.q[0], [0.5, 0.6, 0.7, first, 0.0, 0.7 - first], atol=1e-7)
        assert found.residual.max() < 1e-9
    scara = written(tmp_path, chain(*SCARA))
    straight = scara.all_solutions(scara.fk([0.3, 0.0, 0.1, 0.2]))
    assert len(straight) == 1
    np.testing.assert_allclose(straight.q[0], [0.3, 0.0, 0.1, 0.2], atol=1e-6)
    for bend in (1e-3, 1e-6, 1e-8):
        found = scara.all_solutions(scara.fk([0.3, bend, 0.1, 0.2]))
        assert len(found) >= 1
        assert found.residual.max() < 1e-9
    even = (SCARA[0], ("j2", "revolute", {"xyz": "0.25 0 0", "limits": (-3.2, 3.2)}),
            ("z", "prismatic", {"xyz": "0.25 0 0", "limits": (0.0, 0.18)}), ("j4", "continuous", {}))  # fmt: skip
    folded = written(tmp_path, chain(*even))
    found = folded.all_solutions(folded.fk([0.4, np.pi, 0.1, 0.2]), seed=[-1.0, 3.0, 0.1, 0.0])
    assert found.q[0][0] == pytest.approx(-1.0, abs=1e-6)
    assert found.residual.max() < 1e-9


def test_slides_are_not_wound(tmp_path):
    """A gantry of nine metres: places that differ by 2 pi metres are others."""
    kin = written(tmp_path, random_gantry(np.random.default_rng(3), 1))
    q = np.array([8.5, 1.0, 4.0, 0.3])
    found = kin.nearest(kin.fk(q), [1.0, 8.0, 1.0, 0.3 + 6 * TURN])
    np.testing.assert_allclose(found.q[:3], q[:3], atol=1e-9)
    beyond = kin.all_solutions(kin.fk([9.5, 1.0, 4.0, 0.3]))
    assert beyond.status is Status.OUT_OF_LIMITS
    assert beyond.reason == "all 1 postures are outside the joint limits (s0)"


@pytest.mark.slow
def test_points_and_directions(tmp_path):
    """What the goal leaves free keeps the seed's value: of a SCARA the last joint that turns, of a gantry the wrist."""
    rng, solved, directed, refused = np.random.default_rng(8), 0, 0, 0
    for kin in arms(rng, tmp_path):
        scara = kin.n == 4 and kin.slides.sum() == 1
        free = np.flatnonzero(~kin.slides)[2:3] if scara else np.flatnonzero(~kin.slides)
        for q in rng.uniform(*kin.sampling_limits, (2, kin.n)):
            T, seed = kin.fk(q), q + 0.05 * (kin.arm.home - q)
            seed[free] = q[free]
            found = kin.solve(PositionGoal(T[:3, 3]), seed)
            assert found.success, found.reason
            assert found.position_error < 1e-9
            np.testing.assert_allclose(found.q[free], seed[free], atol=1e-6)
            assert np.linalg.norm(found.q - seed) <= np.linalg.norm(q - seed) + 1e-6
            refused += kin.solve(PositionGoal(T[:3, 3]), seed, accept=lambda q: False).status is Status.REJECTED
            solved += 1
            if scara or kin.n == 6:
                found = kin.solve(AxisGoal(T[:3, 3], T[:3, 2]), seed)
                assert found.success, found.reason
                assert max(found.position_error, found.orientation_error) < 1e-9
                directed += 1
    assert solved == refused == 24
    assert directed >= 16


def test_a_scara_turns_its_tip_into_a_direction(tmp_path):
    """From a seed with the tip turned otherwise; a direction that no turn about its axes gives is refused."""
    rng, compared = np.random.default_rng(11), 0
    for _ in range(2):
        kin = written(tmp_path, random_scara(rng), tip="tool_link")
        for q, seed in rng.uniform(*kin.sampling_limits, (2, 2, kin.n)):
            T = kin.fk(q)
            found = kin.solve(AxisGoal(T[:3, 3], T[:3, 2]), seed)
            assert found.success, found.reason
            np.testing.assert_allclose(kin.fk(found.q)[:3, [2, 3]], T[:3, [2, 3]], atol=1e-9)
            assert not kin.solve(AxisGoal(T[:3, 3], T[:3, 0]), seed).success
            compared += 1
    assert compared == 4


def test_a_gantry_comes_to_a_point_with_the_orientation_of_the_seed(tmp_path):
    rng, solved = np.random.default_rng(9), 0
    for turning in (1, 2, 3):
        kin = written(tmp_path, random_gantry(rng, turning))
        for q, seed in rng.uniform(*kin.sampling_limits, (4, 2, kin.n)):
            seed[:3] = q[:3] + rng.uniform(-0.1, 0.1, 3)
            seed[3:] = q[3:]
            T = kin.fk(q)
            found = kin.solve(PositionGoal(T[:3, 3]), seed)
            assert found.success, found.reason
            np.testing.assert_allclose(kin.fk(found.q), T, atol=1e-9)
            solved += 1
    assert solved == 12


def test_why_there_is_none(tmp_path):
    kin = written(tmp_path, chain(*SCARA))
    T = kin.fk([0.3, 0.5, 0.1, 0.2])
    tilted, far = T.copy(), T.copy()
    tilted[:3, :3] = T[:3, :3] @ np.array([[1, 0, 0], [0, np.cos(0.1), -np.sin(0.1)], [0, np.sin(0.1), np.cos(0.1)]])
    far[:3, 3] *= 3.0
    for pose, said in (
        (tilted, "its joints cannot turn the tip to this orientation"),
        (far, "m too far from the axis of j1"),
    ):
        found = kin.all_solutions(pose)
        assert (len(found), found.status) == (0, Status.OUT_OF_REACH)
        assert said in found.reason
        assert said in kin.nearest(pose, kin.arm.home).reason
    rejected = kin.nearest(T, kin.arm.home, accept=lambda q: False)
    assert rejected.status is Status.REJECTED
    sideways = kin.solve(AxisGoal(T[:3, 3], [1.0, 0.0, 0.0]), kin.arm.home)
    assert (sideways.status, sideways.reason) == (Status.OUT_OF_REACH, "its joints leave 1.57 rad of this direction")
    gantry = written(tmp_path, random_gantry(np.random.default_rng(3), 1))
    with pytest.raises(InputError, match="give a PoseGoal, or use a numeric solver"):
        gantry.solve(AxisGoal(T[:3, 3], T[:3, 2]), gantry.arm.home)
    with pytest.raises(InputError, match="has a joint that slides; SixAxisKinematics takes joints that turn"):
        SixAxisKinematics(kin.arm)


def test_others_have_none_and_say_what_has(tmp_path):
    turns = [(name, "revolute", {"rpy": rpy}) for name, rpy in zip("abdef", (
        "0 0 0", f"{RIGHT} 0 0", "0 0 0", f"{RIGHT} 0 0", f"-{RIGHT} 0 0"), strict=True)]  # fmt: skip
    stanford = chain(*turns[:2], ("c", "prismatic", {"limits": (0.1, 0.6)}), *turns[2:])
    kin = written(tmp_path, stanford)
    assert type(kin) is ArmKinematics
    with pytest.raises(AttributeError, match=r"SCARAs have a closed form .*; with c held, others may"):
        kin.all_solutions(np.eye(4))
    flat = chain(*[(name, "prismatic", {"axis": way, "limits": (0, 1)}) for name, way in
                   (("x", "1 0 0"), ("y", "0 1 0"), ("z", "1 1 0"))])  # fmt: skip
    assert "the three slides move it in a plane" in written(tmp_path, flat).no_closed_form


def test_a_scara_is_checked_and_solved_on_the_command_line(tmp_path, capsys):
    file = tmp_path / "arm.urdf"
    written(tmp_path, chain(*SCARA))
    assert main(["check", str(file), "--poses", "20"]) == 0
    out = capsys.readouterr().out
    assert "SCARA: every posture of a pose that the arm can have, in closed form" in out
    assert "closed-form   100.0 %" in out
    assert main(["ik", "--arm", str(file), "--pose", "0.35,0.1,0.1,0,0,0.5"]) == 0
    out = capsys.readouterr().out
    assert "angles in rad, z in m" in out
    assert sum(line.strip("* ")[:1] in ("0", "1") for line in out.splitlines()[2:4]) == 2
