"""The compiled core ends, and writes where it may, whatever it is given; `make core-check` watches the memory."""

import os
from pathlib import Path

import numpy as np
import pytest

import kinreach
from benchmarks.ik_arms.random_arms import CLASSES, kinematics, some_arm
from kinreach.kinematics import ArmKinematics, URKinematics
from kinreach.kinematics._core import NULL, Struct, doubles, ffi, lib
from kinreach.kinematics._ur.geometry import URGeometry, core_arm

#: `make core-check` says how many arms, and watches the memory: ARGS="--arms 1000000".
WATCHED = "KINREACH_SANITIZED" in os.environ
ARMS = int(os.environ.get("KINREACH_SANITIZED", "5000"))
ODD = np.array([np.nan, np.inf, -np.inf, 0.0, -0.0, 5e-324, -5e-324, 1e-300, 1e308, -1e308, 1e16, np.pi, 1.0])


def spoiled(rng, values):
    """A copy of an array in which some entries are odd ones, or all are multiplied."""
    values = np.array(values, dtype=np.float64)
    flat = values.reshape(-1)
    kind = rng.integers(5)
    if kind == 0:
        flat *= 10.0 ** rng.uniform(-300, 300)
    elif kind < 4:
        at = rng.integers(len(flat), size=rng.integers(1, 4))
        flat[at] = rng.choice(ODD, size=len(at))
    return values


def test_the_core_that_runs_is_the_one_beside_this_test():
    if WATCHED:
        assert Path(kinreach.__file__).parents[1] == Path(__file__).parents[2]


def test_numbers_of_any_kind_go_through_the_ur():
    rng, count = np.random.default_rng(0), ARMS
    kin, found, ended = URKinematics("ur5e"), 0, 0
    poses, lengths = kin.fk(rng.uniform(-3, 3, (500, 6))), np.array([0.1, 0.4, 0.4, 0.1, 0.1, 0.1])
    rows, q, errors = np.empty((8, 8)), np.empty(6), np.empty((8, 2))
    counts = ffi.new("int[2]")
    for k in range(count):
        T = spoiled(rng, poses[k % 500]) if k % 2 else poses[k % 500].copy()
        seed, tol = spoiled(rng, rng.uniform(-3, 3, 6)), float(spoiled(rng, [1e-7])[0])
        d1, upper, fore, d4, d5, d6 = spoiled(rng, lengths).tolist()
        bent = Struct(
            "kr_ur", d1=d1, upper=upper, fore=fore, d4=d4, d5=d5, d6=d6, stretched=upper + fore,
            folded=abs(upper - fore), base=spoiled(rng, kin._T_dh_base[:3]).ravel().tolist(),
            flange=spoiled(rng, kin._T_tip_flange[:3]).ravel().tolist(),
        )  # fmt: skip
        lower, high = spoiled(rng, kin.lower), spoiled(rng, kin.upper)
        arm = Struct(
            "kr_arm", n=6, lower=lower.tolist(), upper=high.tolist(), full_turn=int(rng.integers(2)),
            one_turn=int(rng.integers(2)), placements=spoiled(rng, kin._placements[:, :3]).ravel().tolist(),
        )  # fmt: skip
        start = NULL if k % 3 == 0 else doubles(seed)
        n = lib.kr_solutions(lib.KR_UR, bent.pointer, arm.pointer, doubles(T), start, k % 2, tol, doubles(rows))
        assert -1 <= n <= 8
        found += n > 0
        kind = k % 3
        if n > 0:
            lib.kr_errors(arm.pointer, kind, doubles(T), doubles(rows), n, doubles(errors))
            lib.kr_allowed(
                arm.pointer, kind, doubles(T), doubles(rows[0, 2:].copy()), doubles(seed), 1, tol, doubles(q)
            )
            assert 0 <= lib.kr_within(arm.pointer, kind, doubles(T), start, 1, tol, doubles(rows), n) <= n
        reach, pitch, last = spoiled(rng, rng.uniform(-1, 1, 3)).tolist()
        n = lib.kr_ur_axis_postures(bent.pointer, doubles(T), reach, pitch, last, tol, doubles(rows), counts)
        assert 0 <= n <= 8
        assert (
            -1
            <= lib.kr_nearest(lib.KR_UR, bent.pointer, arm.pointer, doubles(T), doubles(seed), tol, doubles(rows))
            <= 8
        )
        ended += 1
    assert ended == count
    assert found > count // 50


#: What a kr_decoupled is made of, the rest is prepared.
GIVEN = ("sign", "offset", "d", "a", "alpha", "before", "after", "placements")


def test_numbers_of_any_kind_go_through_the_classes_of_six_axes(tmp_path):
    """Figures, poses, seeds and tolerances; singular poses take many samples, of an arm that may be no arm at all."""
    rng, found, near, families = np.random.default_rng(2), 0, 0, 0
    arms = [kinematics(tmp_path, some_arm(rng, name)) for name in CLASSES]
    poses = [
        kin.fk(rng.choice([0.0, np.pi / 2, 1.0, -2.0], (50, 6)) + rng.choice([0.0, 1e-9], (50, 6))) for kin in arms
    ]
    rows, free = np.empty((107_000, 8)), ffi.new("int *")
    q, pose, first = np.empty((128, 6)), np.empty(128, dtype=np.int64), np.empty(107_000, dtype=np.int32)
    slots, there, doubtful = np.empty((16, 6)), np.empty(16, dtype=np.bool_), np.empty(1, dtype=np.bool_)
    flags = [ffi.from_buffer("unsigned char[]", each) for each in (there, doubtful)]
    for k in range(ARMS // 10):
        kin = arms[k % len(arms)]
        whole = kin._method.compiled[1].pointer
        figures = {name: np.array(list(getattr(whole, name))) for name in GIVEN}
        for name in GIVEN if k % 3 else ():
            figures[name] = spoiled(rng, figures[name]) if rng.random() < 0.4 else figures[name]
        bent = Struct("kr_decoupled", **{name: value.tolist() for name, value in figures.items()})
        lib.kr_decoupled_prepare(bent.pointer)
        T, seed = poses[k % len(arms)][rng.integers(50)], rng.uniform(-3, 3, 6)
        T, seed = (spoiled(rng, each) if k % 2 else each.copy() for each in (T, seed))
        tol, off = float(spoiled(rng, [1e-7])[0]), float(spoiled(rng, [1e-5])[0])
        way = lib.KR_DECOUPLED + (k % 4 == 3) * lib.KR_BACKWARDS
        arm, start = kin._core.pointer, NULL if k % 3 == 0 else doubles(seed)
        n = lib.kr_solutions(way, bent.pointer, arm, doubles(T), start, k % 2, tol, doubles(rows))
        assert -1 <= n <= 8
        found += n > 0
        n = lib.kr_decoupled_rows(bent.pointer, doubles(T), tol, doubles(seed), k % 5 == 0, free, doubles(rows))
        assert 0 <= n <= len(rows)
        postures = np.ascontiguousarray(rows[: min(n, 60), 2:])
        lib.kr_families(whole.placements, doubles(T), doubles(postures), len(postures), ffi.from_buffer("int[]", first))
        assert (first[: len(postures)] <= np.arange(len(postures))).all()
        families += len(postures) > 0
        n = lib.kr_decoupled_starts(bent.pointer, doubles(T), 1, doubles(q), ffi.from_buffer("long long[]", pose))
        assert 0 <= n <= len(q)
        lib.kr_nearly_decoupled_of_each(
            bent.pointer, off, doubles(T), doubles(seed), 1, doubles(slots), flags[0], flags[1]
        )
        near += not doubtful[0]
        lib.kr_decoupled_postures_of_each(bent.pointer, doubles(T), doubles(seed), 1, tol, doubles(slots), flags[0])
        assert 0 <= there[:8].sum() <= 8
    assert found > ARMS // 100
    assert near > 0
    assert families > ARMS // 100


@pytest.mark.parametrize("scale", [1e-2, 1.0, 1e5])
def test_no_length_makes_a_wrong_posture(scale):
    """Arms of any size: what is returned without a flag reaches the pose, in units of the arm's size."""
    rng, right = np.random.default_rng(1), 0
    for _ in range(200):
        d1, a2, a3, d4, d5, d6 = scale * rng.uniform(0.01, 1.0, 6)
        g = URGeometry(d1, -a2, -a3, d4, d5, d6)
        q, arm, miss = rng.uniform(-3, 3, 6), core_arm(g), ffi.new("int *")
        T, rows = g.chain.fk(q[None])[0, :3].copy(), np.empty((8, 8))
        n = lib.kr_ur_postures(arm.pointer, NULL, doubles(T), doubles(q), 1e-7, doubles(rows), miss)
        off = np.abs(g.chain.fk(rows[:n, 2:])[:, :3] - T)
        off[..., 3] /= scale
        assert off.max(initial=0.0) < 1e-5
        right += n
    assert right > 400


def test_numbers_of_any_kind_go_through_the_self_motion_of_seven_axes():
    """Arms, poses, starts and curves with odd entries, and arms of length 0: calls end, and write where they may."""
    rng, count, room, curves_found = np.random.default_rng(8), 12, 600, 0
    kin = ArmKinematics.of("panda")
    rows = np.ascontiguousarray(kin.chain.placements[:, :3])
    for k in range(400):
        posture = rng.uniform(-3, 3, 7)
        T, q, off = kin.fk(posture), posture + rng.uniform(-0.5, 0.5, (count, 7)), np.empty(count)
        A = np.zeros_like(rows) if k % 40 == 1 else np.tile(np.eye(4)[:3], (8, 1, 1)) if k % 40 == 2 else rows
        if k % 3:
            A, T, q = (spoiled(rng, each) if rng.random() < 0.5 else np.array(each) for each in (A, T, q))
        slides = np.zeros(7) if k % 5 else spoiled(rng, rng.uniform(-1.0, 1.0, 7))
        arm, pose = doubles(np.append(A, slides)), doubles(T)
        lib.kr_shortest_steps(arm, pose, 12, count, doubles(q), doubles(off))
        starts = q[np.argsort(q[:, 0])]
        if k % 3 != 1:
            starts = starts[off[np.argsort(q[:, 0])] < 1e-12]
            starts = (starts + np.pi) % (2.0 * np.pi) - np.pi
            starts = starts[np.argsort(starts[:, 0])]
        n = len(starts)
        samples, tangents = np.empty((room, 7)), np.empty((room, 7))
        (ends, closed), marks = np.zeros((2, 2 * n), np.int32), np.empty(4 * n, np.int32)
        ints = [ffi.from_buffer("int[]", each) for each in (ends, closed, marks)]
        found = lib.kr_self_motion(arm, pose, doubles(starts), n, room, doubles(samples), doubles(tangents), *ints)
        assert 0 <= found <= 2 * n
        assert (np.diff(ends[:found], prepend=0) >= 0).all()
        assert ends[:found].max(initial=0) <= room
        curves_found += (closed[:found] >= 0).sum()
        m = int(rng.integers(1, 20))
        curve, ways = spoiled(rng, rng.uniform(-3, 3, (m, 7))), spoiled(rng, rng.uniform(-1, 1, (m, 7)))
        lib.kr_tangents(arm, m, doubles(curve), doubles(ways), doubles(np.empty((m, 7))))
        on, values = np.full(count, 2, np.uint8), np.empty(m)
        lib.kr_on_curve(
            arm,
            pose,
            doubles(curve),
            doubles(ways),
            m,
            k % 2,
            doubles(q),
            count,
            ffi.from_buffer("unsigned char[]", on),
        )
        assert on.max() <= 1
        lib.kr_least_singular_values(arm, m, doubles(curve), doubles(values))
        lib.kr_missed_by_each(arm, pose, m, doubles(curve), doubles(values))
        lower, upper = spoiled(rng, kin.lower), spoiled(rng, kin.upper)
        lib.kr_turns_along(m, 7, doubles(curve), lower[0], upper[0], 1e-9, doubles(values))
        which, limits, shares = np.empty(42 * m, np.int32), np.empty(42 * m), np.empty(42 * m)
        crossed = lib.kr_crossings(
            m, 7, doubles(curve), doubles(ways), doubles(ways), doubles(curve), doubles(lower), doubles(upper),
            ffi.from_buffer("unsigned char[]", np.ones(7, np.uint8)), ffi.from_buffer("int[]", which), doubles(limits),
            doubles(shares),
        )  # fmt: skip
        assert 0 <= crossed <= 42 * m
        assert ((shares[:crossed] >= 0.0) & (shares[:crossed] <= 1.0)).all()
        lib.kr_across_each(arm, pose, 8, m, doubles(curve), doubles(ways), doubles(values))
    assert curves_found > 200
