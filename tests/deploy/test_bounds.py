"""What is judged by a bound, at the bound: robots beside models, poses beside the reach."""

import math

import numpy as np
import pytest

from kinreach.deploy._model import apart
from kinreach.deploy._remarks import arm_and_tip, why_none
from kinreach.kinematics import ArmKinematics, pose
from kinreach.robots import PUBLISHED_CALIBRATIONS, get_arm

KIN = ArmKinematics.of(get_arm("ur5e"), base="base")


@pytest.mark.parametrize(
    ("far", "turned", "judged"),
    [(0.0, 0.0, False), (0.02, 2.0, False), (math.nextafter(0.02, 1.0), 2.0, True),
     (0.02, math.nextafter(2.0, 3.0), True), (math.nan, 0.0, True), (0.0, math.nan, True)],
)  # fmt: skip
def test_robots_are_apart_beyond_their_bounds_only(far, turned, judged):
    assert apart((0.02, 2.0), far, turned) is judged


def border():
    """A pose at the border of the reach, and the way straight out of it."""
    T = pose([0.9, 0.9, 0.9, math.pi, 0.0, 0.0])
    at = KIN.nearest_in_reach(T)[:3, 3].copy()
    return T, at, (T[:3, 3] - at) / np.linalg.norm(T[:3, 3] - at)


@pytest.mark.parametrize(
    ("away", "said"),
    [(5e-7, ""), (2e-6, "0.002 mm"), (0.0123, "12.3 mm"), (0.9994, "999 mm"), (0.9997, "1 m"), (2.34, "2.34 m")],
)
def test_how_far_a_pose_is_from_the_reach(away, said):
    T, at, out = border()
    T[:3, 3] = at + away * out
    text = why_none(KIN, T, "too far away")
    assert text == "too far away" + (
        f"; the nearest pose in reach with this orientation is {said} away" if said else ""
    )
    assert why_none(KIN, T, "") == ""


@pytest.mark.parametrize(("lengths", "metres"), [(9.99, False), (10.01, True), (1000.0, True)])
def test_positions_of_ten_arms_away_are_not_in_metres(lengths, metres):
    first, *links = KIN.chain.placements[:, :3, 3]
    length = sum(map(np.linalg.norm, links))
    T = np.eye(4)
    T[:3, 3] = first + lengths * length * np.eye(3)[1]
    text = why_none(KIN, T, "too far away")
    assert text.endswith("; positions are in metres") is metres
    if metres:
        assert f": {lengths * length:.0f} m from the first joint, of an arm of {length:.1f} m;" in text


def test_whose_answers_they_are():
    calibrated = ArmKinematics.of(get_arm("ur5e").calibrated(PUBLISHED_CALIBRATIONS["ur5e_a"]), base="base")
    assert arm_and_tip(KIN) == "UR5E, by its data sheet: tip tool0 in base"
    assert "data sheet" not in arm_and_tip(calibrated)
    assert arm_and_tip(ArmKinematics.of("panda")).startswith(f"{get_arm('panda').title}: tip ")
