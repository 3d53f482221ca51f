"""A simulation of the button's arm that runs away ends the episode."""

import numpy as np
import pytest

from kinreach.envs._button.episodes import ButtonEpisodes
from kinreach.envs._button.world import SingleTorqueWorld
from kinreach.envs.inside import ButtonOptions

STILL, PRESS = 13, 40  # actions that change no control


@pytest.mark.parametrize("joint", range(3))
def test_one_joint_that_is_too_fast_is_enough(joint):
    class Spun(SingleTorqueWorld):
        def step(self, control, acting=None):
            self.qd[:] = 0.0
            self.qd[0, joint] = 2e4

    options = ButtonOptions()
    episodes = ButtonEpisodes(options, Spun(options.arm, options.motors, visual=False))
    episodes.seed(0, np.random.default_rng(0))
    episodes.begin(np.zeros(1, dtype=int))
    outcome = episodes.step(np.array([STILL]))
    assert outcome.truncated.tolist() == outcome.info["impossible"].tolist() == [True]
