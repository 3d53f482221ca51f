"""`python -m benchmarks.studies.smooth_policies`: commands end at the last posture, and only some keep the limits."""

import numpy as np
import pytest

pytest.importorskip("ruckig")
pytest.importorskip("toppra")

from benchmarks.studies import smooth_policies as study
from kinreach.compare._motion import peaks
from kinreach.kinematics import MotionLimits

LIMITS = MotionLimits.of("ur5-thesis")
#: Steps of at most 5 degrees, in other directions each.
POSTURES = np.array(study.ArmKinematics("ur5-thesis").arm.home) + np.vstack(
    [np.zeros(6), np.random.default_rng(0).uniform(-np.radians(5), np.radians(5), (8, 6)).cumsum(axis=0)]
)
ALL = {**study.WAYS, "filtered": study.filtered(0.1)}


@pytest.mark.parametrize("name", ALL)
def test_a_command_goes_from_the_first_posture_to_the_last(name):
    motion = ALL[name](POSTURES, LIMITS)
    np.testing.assert_allclose(motion.q[0], POSTURES[0], atol=1e-9)
    np.testing.assert_allclose(motion.q[-1], POSTURES[-1], atol=1e-5)
    asked = peaks(motion, LIMITS)
    keeps = name.startswith("ruckig") or name == "filtered"
    assert (max(asked.values()) <= 1.001) == keeps, asked
    assert min(asked.values()) > 0.02


def test_only_some_stay_on_the_way():
    kinematics = study.ArmKinematics.of("ur5-thesis", tip="tcp", base="world")
    off = {name: study.off_way(kinematics, command(POSTURES, LIMITS), POSTURES) for name, command in ALL.items()}
    for name in ("straight between decisions", "ruckig, stops at each posture"):
        assert off[name] < 1e-3
    assert off["filtered"] > 5e-3
    assert off["ruckig, follows the newest posture"] > 2e-3
