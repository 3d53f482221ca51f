"""Setpoints lead by the arm's inertia in the posture where a move ends."""

import mujoco
import numpy as np

from kinreach.sim import ArmSimulation


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
