import numpy as np
import pytest

from kinreach.sim import ArmSimulation


@pytest.fixture
def ur5():
    return ArmSimulation("ur5")


@pytest.fixture(scope="session")
def goals():
    """Goals of the UR5 [m]: the corners of the area first, then drawn ones."""
    region = ArmSimulation("ur5").arm.workcell.goals
    corners = [(x, y, region.z[0]) for x in region.x for y in region.y]
    return np.array([*corners, *region.sample(np.random.default_rng(7), 60)])
