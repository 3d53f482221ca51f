"""The cases in which other closed forms come back empty or wrong."""

import numpy as np
import pytest

from benchmarks.speed.poses import CASES, FLANGE
from benchmarks.speed.suites.ik_edge_cases import judge
from kinreach._rotations import pose_error
from kinreach.kinematics._core import NULL, Struct, doubles, ffi, lib
from kinreach.kinematics._solutions import ANGLES, BRANCH, FLAGS
from kinreach.kinematics._ur.calibrated import _chain
from kinreach.kinematics._ur.geometry import Singularity, URGeometry, core_arm

COUNT = 400


def fk(q, g):
    """Upper rows of the flange's pose in the DH base frame."""
    return g.chain.fk(np.array([q]))[0, :3].copy()


def solve_pose(rows, g, *, q6=0.0):
    """Postures of the flange's pose in the DH base frame; a free wrist_3 starts from q6."""
    T, seed = np.array(rows), np.array([0.0, 0.0, 0.0, 0.0, 0.0, q6])
    found, miss = np.empty((8, 8)), ffi.new("int *")
    count = lib.kr_ur_postures(core_arm(g).pointer, NULL, doubles(T), doubles(seed), 1e-7, doubles(found), miss)
    return [(int(row[0]), int(row[1]), *row[2:]) for row in found[:count].tolist()]


@pytest.mark.parametrize("case", CASES)
def test_never_empty_and_never_wrong(case):
    poses = CASES[case](np.random.default_rng(5), COUNT)
    assert poses.shape == (COUNT, 4, 4)
    tally = judge(lambda T: FLANGE.all_solutions(T).q, poses)
    assert tally.empty == 0
    assert tally.spurious == 0
    assert tally.worst <= 1e-7


@pytest.mark.parametrize("case", CASES)
def test_batches_agree_with_single_poses(case):
    poses = CASES[case](np.random.default_rng(6), 80)
    batch = FLANGE.batch(poses)
    nearest = FLANGE.nearest_batch(poses, np.full(6, 0.3))
    assert batch.valid.any(axis=1).all()
    assert nearest.success.all()
    for i, T in enumerate(poses):
        for q in (*batch.q[i, batch.valid[i]], nearest.q[i]):
            assert max(pose_error(T, FLANGE.fk(q))) <= 1e-7
        assert batch.valid[i].sum() == len(FLANGE.all_solutions(T))


def test_singular_targets_rounded_to_single_precision():
    """Rounding moves these by more than the default tolerance now and then; the caller can allow for it."""
    poses = CASES["arm upright"](np.random.default_rng(9), COUNT).astype(np.float32)
    tally = judge(lambda T: FLANGE.all_solutions(T, tol=5e-7).q, poses)
    assert tally.empty == 0
    assert tally.spurious == 0
    assert tally.worst <= 5e-7


def test_flags_name_what_was_singular():
    expected = {
        "sin q5 = 0 exactly": Singularity.WRIST,
        "elbow 1e-9 m past stretch": Singularity.ELBOW,
        "shoulder r = d4 - 1e-9": Singularity.SHOULDER,
    }
    for case, flag in expected.items():
        for T in CASES[case](np.random.default_rng(7), 100):
            assert (FLANGE.all_solutions(T).singularity & flag).any(), case
    T = FLANGE.fk([0.3, -1.0, 1.2, -0.4, 0.9, 0.2])
    assert not FLANGE.all_solutions(T).singularity.any()


def test_a_free_wrist_says_whether_it_kept_the_seeds_value():
    rng, counts = np.random.default_rng(10), {True: 0, False: 0}
    for T in CASES["sin q5 = 0 exactly"](rng, 200):
        seed = rng.uniform(-np.pi, np.pi, 6)
        solutions = FLANGE.all_solutions(T, seed=seed)
        for q, flags in zip(solutions.q, solutions.singularity, strict=True):
            if flags & Singularity.WRIST:
                moved = abs((q[5] - seed[5] + np.pi) % (2 * np.pi) - np.pi) > 1e-9
                assert bool(flags & Singularity.MOVED) == moved
                counts[moved] += 1
    assert min(counts.values()) > 20


def test_a_free_wrist_that_moves_goes_no_farther_than_it_must():
    """Held against the values from which it need not move, on a grid."""
    rng, compared = np.random.default_rng(12), 0
    for T in CASES["sin q5 = 0 exactly"](rng, 120):
        wanted = rng.uniform(-np.pi, np.pi)
        moved = {}
        feasible = {branch: [] for branch in range(8)}
        for value in (wanted, *np.linspace(-np.pi, np.pi, 40)):
            solutions = FLANGE.all_solutions(T, seed=np.array([0, 0, 0, 0, 0, value]))
            for q, branch, flags in zip(solutions.q, solutions.branch, solutions.singularity, strict=True):
                if not flags & Singularity.MOVED:
                    feasible[branch].append(q[5])
                elif value == wanted:
                    moved[branch] = q[5]
        for branch, q6 in moved.items():
            away = np.abs((np.array([q6, *feasible[branch]]) - wanted + np.pi) % (2 * np.pi) - np.pi)
            assert away[0] <= away[1:].min(initial=np.pi) + 1e-9
            compared += len(feasible[branch]) > 0
    assert compared > 10


def test_both_arcs_of_a_free_wrist_are_listed():
    """With d5 as long as the arm, wrist_1 comes from two sides: held against all values of wrist_3 on a grid."""
    g, rng, both = URGeometry(0.1, -0.3, -0.25, 0.1, 0.5, 0.08), np.random.default_rng(13), 0
    for q in rng.uniform(-np.pi, np.pi, (60, 6)) * (1, 1, 1, 1, 0, 1):
        rows, kept = fk(q, g), set()
        for wanted in np.linspace(-np.pi, np.pi, 30):
            kept |= {row[BRANCH] for row in solve_pose(rows, g, q6=wanted) if row[FLAGS] == Singularity.WRIST}
        found = solve_pose(rows, g)
        free = [row for row in found if row[FLAGS] & Singularity.WRIST]
        assert {branch & 6 for branch in kept} == {row[BRANCH] & 6 for row in free}  # a moved elbow may be straight
        assert len(found) == len({row[BRANCH] for row in found})
        for row in found:
            np.testing.assert_allclose(fk(row[ANGLES], g), rows, atol=1e-7)
        both += {0, 2} <= kept
    assert both >= 4


def test_a_free_wrist_is_turned_into_its_limits():
    """On both arcs, held against all values of wrist_3 on a grid within its limits."""
    g, rng, turned = URGeometry(0.1, -0.3, -0.25, 0.1, 0.5, 0.08), np.random.default_rng(14), 0
    placements = _chain(np.array([g.d1, g.a2, g.a3, g.d4, g.d5, g.d6]), np.eye(4), np.eye(4)).placements
    ur, rows, miss = core_arm(g), np.empty((8, 8)), ffi.new("int *")
    for q in rng.uniform(-np.pi, np.pi, (40, 6)) * (1, 1, 1, 1, 0, 1):
        T, low = fk(q, g), rng.uniform(-3, 2.4)
        limits = {"lower": [-7.0] * 5 + [low], "upper": [7.0] * 5 + [low + 0.6]}
        arm = Struct("kr_arm", n=6, placements=placements[:, :3].ravel().tolist(), **limits)
        count = lib.kr_ur_postures(ur.pointer, arm.pointer, doubles(T), doubles(np.zeros(6)), 1e-7, doubles(rows), miss)
        inside = [row for row in rows[:count] if low - 1e-3 <= row[7] <= low + 0.6 + 1e-3]
        expected = set()
        for wanted in np.linspace(low, low + 0.6, 20):
            expected |= {row[BRANCH] for row in solve_pose(T, g, q6=wanted) if row[FLAGS] == Singularity.WRIST}
        assert {branch & 6 for branch in expected} <= {int(row[BRANCH]) & 6 for row in inside}  # as above
        for row in inside:
            np.testing.assert_allclose(fk(row[ANGLES], g), T, atol=1e-7)
        turned += len(inside) > 0
    assert turned > 15


@pytest.mark.parametrize("tol", [1e-7, 1e-5])
def test_two_misses_that_add_up_to_more_than_the_tolerance_are_none(tol):
    """Shoulder and elbow each miss by 0.9 of it: together the tip would be 1.27 tolerances away."""
    g, rng, refused = FLANGE.geometry, np.random.default_rng(11), 0
    for _ in range(100):
        q = rng.uniform(-3, 3, 6)
        q[1] = -np.pi / 2 + rng.uniform(-0.08, 0.08)  # stretched, with P5 over the first axis
        q[2], q[3] = 0.0, np.arcsin((-g.a2 - g.a3) * np.cos(q[1]) / g.d5) - q[1]
        T = FLANGE.fk(q)
        shoulder, wrist_1 = ((FLANGE.T_base_world @ FLANGE.data.oMi[joint].homogeneous)[:3, 3] for joint in (2, 4))
        p5 = T[:3, 3] - g.d6 * T[:3, 2]
        assert np.linalg.norm(p5[:2]) == pytest.approx(g.d4, abs=1e-12)
        T[:2, 3] -= 0.9 * tol * p5[:2] / g.d4
        T[2, 3] += 0.9 * tol * np.sign(wrist_1[2] - shoulder[2])
        few, many = (FLANGE.all_solutions(T, limits=False, tol=limit) for limit in (tol, 3 * tol))
        assert len(few) == 0 or few.residual.max() <= tol
        refused += len(many) - len(few)
    assert refused > 50


def test_nothing_is_invented_beyond_the_tolerance():
    """A target that is missed by more than `tol` has no solution, even right next to the border."""
    poses = CASES["elbow q3 = 0 exactly"](np.random.default_rng(8), 300)
    returned = 0
    for T in poses:
        for q in FLANGE.all_solutions(T).q:
            if abs(q[2]) > 1e-6:
                continue
            out = T.copy()
            direction = FLANGE.fk(q)[:3, 3] - (0, 0, FLANGE.geometry.d1)
            out[:3, 3] += 1e-4 * direction / np.linalg.norm(direction)
            solutions = FLANGE.all_solutions(out)
            returned += len(solutions)
            assert len(solutions) == 0 or solutions.residual.max() <= 1e-7
    assert returned > 0
