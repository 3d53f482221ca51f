"""Kinematics on tensors of torch: the numbers are numpy's, gradients go through, and the device stays."""

import numpy as np
import pytest

from kinreach._tensors import parts
from kinreach.errors import InputError
from kinreach.kinematics import Arm3Kinematics, ArmKinematics, URKinematics, pose
from kinreach.robots import get_arm

torch = pytest.importorskip("torch")

DEVICES = ["cpu", pytest.param("cuda", marks=pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU"))]
#: Where a skew matrix has the vector that it is made of.
SPIN = ((2, 1), (0, 2), (1, 0))


def kinematics():
    return [
        URKinematics("ur5", tip="tcp", base="world"),
        URKinematics("ur10e"),
        ArmKinematics("panda"),
        Arm3Kinematics(),
    ]


@pytest.mark.parametrize("device", DEVICES)
def test_poses_and_jacobians_are_those_of_numpy(device):
    checked = 0
    for kin in kinematics():
        q = np.random.default_rng(0).uniform(-np.pi, np.pi, (40, 25, kin.n))
        tensor = torch.tensor(q, device=device)
        for method in (kin.fk, kin.positions, kin.jacobian):
            found = method(tensor)
            assert found.dtype == torch.float64
            assert found.device == tensor.device
            np.testing.assert_allclose(found.cpu().numpy(), method(q), rtol=0, atol=1e-12)
            checked += len(q)
        one = kin.jacobian(tensor[0, 0]).cpu().numpy()
        assert one.shape == (6, kin.n)
        np.testing.assert_allclose(one, kin.jacobian(q[0, 0]), rtol=0, atol=1e-10)  # of Pinocchio
        assert kin.fk(tensor[0, 0].float()).dtype == torch.float32
    assert checked == 480


def test_stacks_of_jacobians_are_those_of_pinocchio():
    for kin in kinematics():
        q = np.random.default_rng(1).uniform(-np.pi, np.pi, (50, kin.n))
        np.testing.assert_allclose(kin.jacobian(q), [kin.jacobian(row) for row in q], rtol=0, atol=1e-10)


def test_the_gradient_of_fk_is_the_jacobian():
    checked = 0
    for kin in kinematics():
        q = torch.tensor(np.random.default_rng(2).uniform(-np.pi, np.pi, (200, kin.n)), requires_grad=True)
        T = kin.fk(q)
        slope = np.zeros((200, 3, 4, kin.n))
        for entry in np.ndindex(3, 4):  # an entry that no joint moves is a constant
            if T[:, *entry].grad_fn is not None:
                slope[:, *entry] = torch.autograd.grad(T[:, *entry].sum(), q, retain_graph=True)[0]
        J, R = kin.jacobian(q).detach().numpy(), T[:, :3, :3].detach().numpy()
        spin = np.einsum("mijk,mlj->milk", slope[:, :, :3], R)  # dR R^T
        np.testing.assert_allclose(slope[:, :, 3], J[:, :3], rtol=0, atol=1e-12)
        np.testing.assert_allclose(np.stack([spin[:, i, j] for i, j in SPIN], axis=1), J[:, 3:], rtol=0, atol=1e-12)
        checked += len(q)
    assert checked == 800


def test_a_posture_is_found_by_descent():
    """What the gradient is for: a loss on poses trains whatever gives the postures."""
    kin = URKinematics("ur5")
    wanted = kin.positions(torch.tensor([0.3, -1.2, 1.0, -0.8, -1.3, 0.2], dtype=torch.float64))
    q = torch.tensor(kin.arm.home, dtype=torch.float64, requires_grad=True)
    for _ in range(100):
        loss = ((kin.positions(q) - wanted) ** 2).sum()
        (slope,) = torch.autograd.grad(loss, q)
        q = (q - slope).detach().requires_grad_()
    assert loss.item() < 1e-6


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("limited", [False, True])
def test_all_postures_of_a_batch_are_those_of_numpy(device, limited):
    arm = get_arm("ur5")
    if limited:
        arm = arm.with_limits(dict.fromkeys(arm.joints, (-2.0, 3.5)))
    kin = URKinematics(arm, tip="tcp", base="world")
    rng = np.random.default_rng(3)
    T = kin.fk(rng.uniform(-np.pi, np.pi, (5000, 6)))
    T[:50, :3, 3] += 2.0  # out of reach
    wrist = rng.uniform(-1, 1, (20, 6))
    wrist[:, 4] = 0.0
    T[50:70] = kin.fk(wrist)  # singular, which `closed_form` solves
    expected = kin.batch(T)
    found = kin.batch(torch.tensor(T, device=device))
    assert found.q.device.type == found.valid.device.type == device
    np.testing.assert_array_equal(found.valid.cpu().numpy(), expected.valid)
    assert expected.valid.sum() > (4000 if limited else 15000)
    np.testing.assert_allclose(found.q.cpu().numpy(), expected.q, rtol=0, atol=1e-11)
    off = np.abs(found.q.cpu().numpy() - expected.q)
    assert np.nanquantile(off, 0.999) <= 1e-12
    single = kin.batch(torch.tensor(T, device=device, dtype=torch.float32))
    assert single.q.dtype == torch.float32
    assert (single.valid.cpu().numpy() == expected.valid).mean() > 0.99


@pytest.mark.parametrize("joint", [2, 4])
def test_postures_next_to_a_singular_one_are_as_exact_as_those_of_numpy(joint):
    """Where the elbow is nearly stretched, or wrist_2 nearly straight, rounding is magnified."""
    kin, rng = URKinematics("ur5", tip="tool0"), np.random.default_rng(joint)
    q = rng.uniform(-2.0, 2.0, (600, 6))
    q[:, joint] = rng.choice([-1, 1], 600) * 10.0 ** rng.uniform(-8.0, -2.5, 600)
    T = kin.fk(q)
    found, expected = kin.batch(torch.tensor(T)), kin.batch(T)
    np.testing.assert_array_equal(found.valid.numpy(), expected.valid)
    goals = np.repeat(T, expected.valid.sum(axis=1), axis=0)
    off, best = (np.abs(kin.fk(q[expected.valid]) - goals).max(axis=(1, 2)) for q in (found.q.numpy(), expected.q))
    assert len(off) > 2000
    assert (off < best + 1e-11).all()


def test_a_base_frame_of_ones_own_is_that_of_the_goals():
    """It stands beside the arm, and leans."""
    kin = URKinematics("ur10e", base=pose([0.3, -0.2, 0.5, 0.4, -0.3, 0.2]))
    q = np.random.default_rng(5).uniform(-np.pi, np.pi, (200, 6))
    T = kin.fk(q)
    found = kin.batch(torch.tensor(T), limits=False)
    valid = found.valid.numpy()
    assert np.abs(kin.fk(found.q.numpy()[valid]) - np.repeat(T, valid.sum(axis=1), axis=0)).max() < 1e-9
    away = np.abs(np.remainder(found.q.numpy() - q[:, None] + np.pi, 2 * np.pi) - np.pi).max(axis=-1)
    assert np.nanmin(away, axis=1).max() < 1e-6
    assert valid.sum() > 800
    np.testing.assert_allclose(found.q.numpy(), kin.batch(T, limits=False).q, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("tol", "least"), [(1e-3, 50), (1e-7, 30)])
def test_postures_next_to_limits_are_those_of_single_poses(tol, least):
    """A joint is past its limit by 1e-8; half of the goals are beyond a stretched elbow by 0.01 mm."""
    arm = get_arm("ur5").with_limits({"shoulder_pan_joint": (-1.0, 1.0), "wrist_3_joint": (-2.0, 2.0)})
    kin, rng = URKinematics(arm, tip="tool0"), np.random.default_rng(6)
    q = rng.uniform(0.5, 1.5, (80, 6)) * rng.choice([-1, 1], (80, 6))
    q[::2, 0], q[1::2, 5] = rng.choice([-1.0, 1.0], 40), rng.choice([-2.0, 2.0], 40)
    q *= 1 + 1e-8
    q[:40, 2] = 0.0
    T = kin.fk(q)
    T[:40, :3, 3] *= 1 + 1e-5 / np.linalg.norm(T[:40, :3, 3], axis=1)[:, None]
    expected = np.full((80, 8, 6), np.nan)
    for row, goal in enumerate(T):
        alone = kin.all_solutions(goal, tol=tol)
        expected[row, alone.branch] = alone.q
    reached = np.isfinite(expected[..., 0])
    assert reached.any(axis=1).sum() >= least
    for goals in (T, torch.tensor(T)):
        found = kin.batch(goals, tol=tol)
        np.testing.assert_array_equal(np.asarray(found.valid), reached)
        np.testing.assert_allclose(np.asarray(found.q), expected, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(kin.nearest_batch(T, q, tol=tol).success, reached.any(axis=1))


def test_arms_without_formulas_for_tensors_go_by_way_of_numpy():
    arm3, so101, rng = Arm3Kinematics(), ArmKinematics.of("so101"), np.random.default_rng(4)
    poses = so101.fk(rng.uniform(so101.lower, so101.upper, (5, so101.n)))
    for kin, goals in ((arm3, arm3.positions(rng.uniform(-2, 2, (100, 3)))), (so101, poses)):
        for limits in (True, False):
            expected, found = kin.batch(goals, limits=limits), kin.batch(torch.tensor(goals), limits=limits)
            np.testing.assert_array_equal(found.q.numpy(), expected.q)
            np.testing.assert_array_equal(found.valid.numpy(), expected.valid)
            assert found.valid.any()
            assert found.q.dtype == torch.float64
            assert kin.batch(torch.tensor(goals).float()).q.dtype == torch.float32
    assert arm3.batch(torch.ones(2, 3, dtype=torch.int64)).q.dtype == torch.float64


def test_rows_are_computed_in_blocks_on_the_processor_alone():
    assert list(parts(torch.empty(9000, device="meta"))) == [slice(None)]
    for rows in (torch.empty(9000), np.empty(9000)):
        assert list(parts(rows)) == [slice(0, 4096), slice(4096, 8192), slice(8192, 12288)]


def test_tensors_of_other_shapes_or_kinds_are_refused():
    kin = URKinematics("ur5")
    for wrong in (torch.zeros(5), torch.zeros(2, 7), torch.zeros(()), torch.zeros(6, dtype=torch.int64)):
        for method in (kin.fk, kin.jacobian, kin.positions, kin.batch):
            with pytest.raises(InputError):
                method(wrong)
    skewed = torch.eye(4).expand(3, 4, 4).clone()
    skewed[1, 0, 0] = 2.0
    with pytest.raises(InputError, match="entry 1"):
        kin.batch(skewed)
