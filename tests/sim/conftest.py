import numpy as np
import pytest

from kinreach.kinematics import UR5Kinematics
from kinreach.sim import ArmSimulation


@pytest.fixture
def ur5():
    return ArmSimulation("ur5")


@pytest.fixture(scope="session")
def tool_down():
    """Posture of the UR5 with the tcp at a point of the world [m], pointing down."""
    kinematics = UR5Kinematics(tip="tcp", base="world")

    def posture(position):
        result = kinematics.axis_goal(position, (0.0, 0.0, -1.0), np.array(kinematics.arm.home))
        assert result.success, result.reason
        return result.q

    return posture


@pytest.fixture(scope="session")
def goals():
    """Goals of the UR5 [m]: the corners of the area first, then drawn ones."""
    region = ArmSimulation("ur5").arm.workcell.goals
    corners = [(x, y, region.z[0]) for x in region.x for y in region.y]
    return np.array([*corners, *region.sample(np.random.default_rng(7), 60)])
