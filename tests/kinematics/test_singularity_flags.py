"""What a solution's flags say of singular poses: which parts are clamped, free or moved."""

from __future__ import annotations

import numpy as np
import pytest

from kinreach.kinematics import (
    Arm3Kinematics,
    URKinematics,
)
from kinreach.kinematics import _arm3 as arm3
from kinreach.kinematics._ur.geometry import Singularity

FLANGE = URKinematics("ur5-thesis")


@pytest.mark.parametrize("q5", [0.0, np.pi, -np.pi])
@pytest.mark.parametrize("q6", [0.7, -0.7, 2.5])
def test_a_free_wrist_3_keeps_the_seeds_value(q5, q6):
    q = np.array([0.3, -1.0, 1.2, 0.4, q5, q6])
    T = FLANGE.fk(q)
    for seed in (q, np.array([*q[:5], q6 + 0.2])):
        solutions = FLANGE.all_solutions(T, seed=seed)
        assert solutions.residual.max() < 1e-9
        kept = solutions.singularity & (Singularity.WRIST | Singularity.MOVED) == Singularity.WRIST
        assert kept.any()
        np.testing.assert_allclose(solutions.q[kept, 5], seed[5], atol=1e-12)
        (row,) = FLANGE.nearest_batch(T[None], seed).q
        np.testing.assert_allclose(row, FLANGE.nearest(T, seed).q, rtol=0, atol=1e-9)
        assert row[5] == pytest.approx(seed[5], abs=1e-12)


@pytest.mark.parametrize(("beyond", "solved"), [(4e-8, True), (4e-7, False)])
@pytest.mark.parametrize("kind", ["stretch", "fold", "shoulder"])
@pytest.mark.parametrize("tensors", [False, True])
def test_the_tolerance_holds_in_a_batch(kind, beyond, solved, tensors):
    g, rng = FLANGE.geometry, np.random.default_rng(2)
    poses = []
    for _ in range(60):
        q = rng.uniform(-3.0, 3.0, 6)
        q[2] = {"stretch": 0.0, "fold": np.pi}.get(kind, q[2])
        T = FLANGE.fk(q)
        if kind == "shoulder":
            p5 = T[:3, 3] - g.d6 * T[:3, 2]
            T[:2, 3] += p5[:2] * ((g.d4 - beyond) / np.linalg.norm(p5[:2]) - 1)
        else:  # along the line from wrist_1 to the shoulder
            FLANGE.fk(q)
            lift, wrist_1 = (FLANGE.T_base_world @ FLANGE.data.oMi[joint].homogeneous for joint in (2, 4))
            along = (wrist_1 - lift)[:3, 3]
            along -= (along @ lift[:3, 1]) * lift[:3, 1]
            T[:3, 3] += (1 if kind == "stretch" else -1) * beyond * along / np.linalg.norm(along)
        poses.append(T)
    given = pytest.importorskip("torch").tensor(np.array(poses)) if tensors else np.array(poses)
    batch = FLANGE.batch(given)
    for T, q, valid in zip(poses, np.asarray(batch.q), np.asarray(batch.valid), strict=True):
        solutions = FLANGE.all_solutions(T)
        near = solutions.singularity & (Singularity.SHOULDER if kind == "shoulder" else Singularity.ELBOW) != 0
        if kind == "shoulder" and not solved:
            assert not valid.any()
        elif kind == "shoulder":
            assert (near.all(), valid.any()) == (True, len(solutions) > 0)
        else:
            assert near.any() == solved
        np.testing.assert_array_equal(np.flatnonzero(valid), solutions.branch)
        np.testing.assert_allclose(q[valid], solutions.q, rtol=0, atol=1e-9)


def test_the_3_dof_arms_shoulder_is_clamped_within_its_inner_cylinder():
    kin = Arm3Kinematics()
    offset = abs(kin.geometry.offset)
    for angle in np.linspace(-3, 3, 50):
        target = (offset - 1e-9) * np.array([np.cos(angle), np.sin(angle), 0.0]) + (0, 0, 0.9)
        inside = kin.all_solutions(target, limits=False)
        assert inside.success
        assert (inside.singularity & arm3.Singularity.BASE).all()
