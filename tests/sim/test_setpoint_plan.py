"""Setpoints lead by the arm's inertia in the posture where a move ends."""

import mujoco
import numpy as np
import pytest

from kinreach.sim import ArmSimulation, BatchSimulation

DRAWN = ("payload", "gears")


def test_the_inertia_along_a_way_is_the_mass_matrix_times_its_direction():
    simulation, rng = ArmSimulation("ur5-thesis"), np.random.default_rng(0)
    controller, model = simulation.controller, simulation.model
    q, direction = rng.uniform(-2.0, 2.0, (20, 6)), rng.uniform(-1.0, 1.0, (20, 6))
    state = np.tile(simulation.data.qpos, (20, 1))
    found = controller._planner._inertia_along(state, q, direction)
    data, mass = mujoco.MjData(model), np.empty((model.nv, model.nv))
    for row in range(20):
        data.qpos[:] = state[row]
        data.qpos[controller.qpos] = q[row]
        mujoco.mj_forward(model, data)
        for column, unit in enumerate(np.eye(model.nv)):
            product = np.empty(model.nv)
            mujoco.mj_mulM(model, data, product, unit)
            mass[:, column] = product
        np.testing.assert_allclose(found[row], mass[:6, :6] @ direction[row], rtol=1e-9, atol=1e-12)
    assert np.abs(found).max() > 1.0


@pytest.mark.parametrize("arm", ["ur5-thesis", "ur10e", "so101"])
def test_the_time_constant_of_the_servos_is_that_of_their_slowest_motion_by_damping(arm):
    """Along it inertia is that constant times damping; along random motions it is less."""
    simulation, rng = ArmSimulation(arm), np.random.default_rng(1)
    controller, model = simulation.controller, simulation.model
    joints = len(simulation.arm.joints)
    damping = -model.actuator_biasprm[controller.ctrl, 2]
    q = np.array(simulation.arm.home) + rng.uniform(-0.3, 0.3, joints)
    found = controller.settling(simulation.data.qpos, q)
    ways = np.vstack([np.eye(joints), rng.uniform(-1.0, 1.0, (2000, joints))])
    moved = controller._planner._inertia_along(
        *(np.tile(row, (len(ways), 1)) for row in (simulation.data.qpos, q)), ways
    )
    times = (ways * moved).sum(axis=1) / (damping * ways**2).sum(axis=1)
    assert 0.5 * found < times.max() <= found
    assert abs(np.linalg.det(moved[:joints] - found * np.diag(damping))) < 1e-9 * np.linalg.det(moved[:joints])


def test_the_controller_of_a_drawn_arm_plans_for_the_ideal_one():
    """With the inertia of an arm without payload, and the same whatever is drawn."""
    ideal, rng, cases = ArmSimulation("ur5-thesis"), np.random.default_rng(2), 0
    q, direction = rng.uniform(-1.5, 1.5, (3, 6)), rng.uniform(-1.0, 1.0, (3, 6))
    state = np.tile(ideal.data.qpos, (3, 1))
    expected = ideal.controller._planner._inertia_along(state, q, direction)
    for drawn in (ArmSimulation("ur5-thesis", drawn=DRAWN), BatchSimulation("ur5-thesis", 2, drawn=DRAWN)):
        settling = drawn.controller.settling(state[0], q[0])
        for size in (0.5, 3.0):
            values = {name: np.full((1, drawn.drawn.sizes[name]), size) for name in DRAWN}
            drawn.drawn.write(np.zeros(1, dtype=np.intp), values)
            assert drawn._plant.model_of(0).body("payload").mass == size
            found = drawn.controller._planner._inertia_along(state, q, direction)
            np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
            assert drawn.controller.settling(state[0], q[0]) == settling
            cases += 1
    assert cases == 4
