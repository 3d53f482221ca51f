"""PPO that touches rolling balls without a collision: its reward in training, and when collisions begin to count."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
from kinreach.baselines import get_recipe
from kinreach.baselines._models import build
from kinreach.baselines._rewards import REWARDS
from kinreach.kinematics import URKinematics

RECIPE = get_recipe("ppo-moving-clear")
UR5 = URKinematics("ur5-thesis", tip="tcp", base="world")
#: A tip over the table, its gripper's lowest corner 12 mm further down, and 83 mm out across the fingers [m].
PLACE, CORNER, ACROSS = (0.45, 0.1), 0.012, 0.083


def posture(height, across=0.0, along=0.0):
    """Postures with the tip at a height above the table [m], the tool turned about its own axes [rad]."""
    down = UR5.fk(np.array(UR5.arm.home))
    (cx, sx), (cy, sy) = ((np.cos(angle), np.sin(angle)) for angle in (across, along))
    turned = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]]) @ np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    down[:3, :3] = down[:3, :3] @ turned
    down[:3, 3] = *PLACE, height - 0.2
    return UR5.nearest(down, UR5.arm.home).q


def level(q, *, lately=0.0, touch=0.0, collision=0.0):
    seen = np.concatenate([np.zeros(4), q, np.zeros(6)])[None]
    terms = {"distance": np.array([-0.3]), "touch": np.array([touch]), "collision": np.array([-collision])}
    info = {"observation": seen, "reward_terms": terms, "reached_lately": lately}
    return float(REWARDS["level"](np.zeros(1), info)[0])


@pytest.mark.parametrize(("lately", "strict"), [(0.0, 0.0), (0.5, 0.0), (0.7, 0.25), (0.9, 1.0), (1.0, 1.0)])
def test_the_level_reward_has_the_values_that_it_documents(lately, strict):
    depth_costs, tilt_costs = 1.0 + 20.0 * strict, max(0.3, 1.0 - 1.3 * lately)
    high = posture(0.1)
    assert level(high, lately=lately) == pytest.approx(-0.3, abs=1e-9)
    assert level(high, lately=lately, touch=1.0) == pytest.approx(2.7, abs=1e-9)
    assert level(high, lately=lately, collision=1.0) == pytest.approx(-0.3 - 3.0 * max(0.3, strict), abs=1e-9)
    for across, along in ((0.2, 0.0), (-0.3, 0.0), (0.0, 0.2)):
        wanted = -0.3 - tilt_costs * (np.sin(across) ** 2 + 0.3 * np.sin(along) ** 2)
        assert level(posture(0.1, across, along), lately=lately) == pytest.approx(wanted, abs=1e-9)
    low = posture(CORNER + 0.001)  # above the table, but by less than 6 mm
    assert level(low, lately=lately, touch=1.0) == pytest.approx(2.7 - depth_costs * 0.005, abs=1e-6)
    deep = posture(CORNER - 0.002)  # in the table
    wanted = -0.3 + 3.0 * (1.0 - strict) - depth_costs * 0.008
    assert level(deep, lately=lately, touch=1.0) == pytest.approx(wanted, abs=1e-6)


def test_a_tilt_brings_the_gripper_down():
    """Level the gripper is above the table, 10 degrees across the fingers it is in it."""
    height, tilt = 0.02, np.radians(10.0)
    assert level(posture(height)) == pytest.approx(-0.3, abs=1e-9)
    depth = 0.006 - (height - CORNER * np.cos(tilt) - ACROSS * np.sin(tilt))
    wanted = -0.3 - 1.0 * depth - np.sin(tilt) ** 2
    assert level(posture(height, tilt)) == pytest.approx(wanted, abs=1e-6)


def test_collisions_count_in_the_last_part_of_a_training():
    recipe = replace(RECIPE, num_envs=4, settings={**RECIPE.settings, "n_steps": 2, "minibatches": 1, "until": 0.5})
    trainee = build(recipe, 0, steps=64)
    world, counted = trainee.env.get_attr("unwrapped")[0].episodes, []
    step = world.step

    def noted(*args):
        counted.append(world.options.collisions)
        return step(*args)

    world.step = noted
    try:
        trainee.model.learn(64)
    finally:
        trainee.env.close()
    assert counted == 8 * [False] + 8 * [True]


def test_it_is_judged_where_collisions_count():
    assert RECIPE.judged_in == {"sights": 6}
