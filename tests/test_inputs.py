"""Checks of single numbers: what is a number, what is an integer, and their bounds."""

from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

from kinreach._checks import check_count, check_number
from kinreach.errors import InputError
from kinreach.kinematics import CollisionChecker, UR5Kinematics
from kinreach.sim import ArmSimulation
from kinreach.vision._cameras import Intrinsics, SensorNoise

NO_NUMBERS = [True, False, np.True_, np.False_, np.array(True), None, "1", 1j, [1.0], Decimal(1), np.array([1.0])]


@pytest.mark.parametrize("value", NO_NUMBERS, ids=repr)
@pytest.mark.parametrize("check", [check_number, check_count])
def test_truth_values_and_other_things_are_no_numbers(check, value):
    with pytest.raises(InputError, match=r"it must be an? (number|integer), got "):
        check("it", value, least=0)


@pytest.mark.parametrize(
    "value", [1, 1.0, np.float32(1), np.float64(1), np.int8(1), np.uint64(1), Fraction(1)], ids=repr
)
def test_numbers_of_any_type(value):
    assert check_number("it", value) == 1.0
    assert type(check_number("it", value, least=1.0, most=1.0)) is float


@pytest.mark.parametrize("yes", [True, np.True_], ids=repr)
@pytest.mark.parametrize(
    "use",
    [
        lambda yes: ArmSimulation("arm3", tolerance=yes),
        lambda yes: CollisionChecker("arm3", margin=yes),
        lambda yes: SensorNoise(rgb_sigma=yes),
        lambda yes: Intrinsics.from_fovy(yes, 640, 480),
        lambda yes: UR5Kinematics().batch(np.eye(4)[None], tol=yes),
    ],
)
def test_nothing_takes_a_truth_value_for_a_number(use, yes):
    with pytest.raises(InputError, match="must be a number, got"):
        use(yes)
