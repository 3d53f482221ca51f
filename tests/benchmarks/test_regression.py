"""What `ik-net` is regressed on, and that it is nothing else than regression."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from benchmarks.learners import ik_net
from kinreach.baselines import VALIDATION, evaluate, train
from kinreach.baselines._models import build
from kinreach.baselines.expert import tool_down_postures
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, CollisionChecker, URKinematics
from kinreach.robots import get_arm
from kinreach.thesis import posture_error

CASES = 5000


def test_postures_reach_and_change_smoothly():
    """By Pinocchio's forward kinematics; over all of what is drawn from in training, which is more than the table."""
    arm, ur5 = get_arm("ur5-thesis"), URKinematics("ur5-thesis", tip="tcp", base="world")
    rng = np.random.default_rng(0)
    goals = arm.workcell.goals.wider(ik_net.beyond).sample(rng, CASES)
    q = tool_down_postures(ur5, goals)
    kinematics = ArmKinematics(arm, tip="tcp", base="world")
    off = [np.linalg.norm(kinematics.fk(one)[:3, 3] - goal) for one, goal in zip(q[:300], goals[:300], strict=True)]
    assert max(off) < 1e-9
    assert posture_error(q).max() < 1e-9
    beside = goals + rng.uniform(-1e-3, 1e-3, goals.shape) * [1, 1, 0]
    moved = np.abs(tool_down_postures(ur5, beside) - q).max(axis=1)
    assert moved.max() < 0.05  # no jump from one branch to the other
    assert q.shape == (CASES, 6)
    on_table = arm.workcell.goals.sample(rng, CASES)
    assert not CollisionChecker("ur5-thesis").impossible(tool_down_postures(ur5, on_table)).any()


def test_rewards_make_no_difference(tmp_path):
    policies = [
        train(replace(ik_net, num_envs=256, reward=reward), tmp_path / reward, seed=0, steps=2048).policy
        for reward in ("own", "dense")
    ]
    observations = np.random.default_rng(1).uniform(-1, 1, (50, 13))
    answers = [policy.act(observations) for policy in policies]
    np.testing.assert_array_equal(*answers)


def test_it_learns_in_seconds(tmp_path):
    run = train(replace(ik_net, num_envs=512), tmp_path, seed=0, steps=60_000)
    found = evaluate(run.policy, goals=300, seed=VALIDATION, options={"backend": "kinematic"})
    assert np.median(found.measures["distance"]) < 0.01
    assert np.median(found.measures["posture_error"]) < 0.05


@pytest.mark.parametrize(
    "change",
    [
        {"environment": "kinreach/Reach-v0"},
        {"environment": "kinreach/UR5MultiStep-v0"},
        {"options": {"backend": "kinematic", "arm": "ur10"}},
    ],
)
def test_tasks_with_other_postures_are_refused(change):
    with pytest.raises(InputError, match="postures of the UR5"):
        build(replace(ik_net, num_envs=64, **change), 0, steps=100)
