"""The analytic policy gradient: what it goes down is the error, and it comes near in seconds."""

import copy
import io
import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
import torch
from stable_baselines3.common.logger import configure

from kinreach.baselines import VALIDATION, evaluate, get_recipe, train
from kinreach.baselines._descent import CLEARANCE, DOWN, FOLDED, GRIPPER_CLEARANCE, LEVER, WAY
from kinreach.baselines._models import build
from kinreach.baselines.expert import table_top, tool_down_postures
from kinreach.baselines.random_arms import ur5
from kinreach.envs.inside import SpaceTask
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics
from kinreach.robots import get_arm
from kinreach.vision import goal_in_world

RECIPE = get_recipe("space-single")
SMALL = replace(RECIPE, num_envs=256, window=2560, settings={**RECIPE.settings, "n_epochs": 4, "minibatches": 2})


@pytest.fixture(scope="module")
def trainee():
    built = build(SMALL, 0, steps=SMALL.steps)
    yield built
    built.env.close()


@pytest.fixture(scope="module")
def observations(trainee):
    return trainee.env.reset().astype(float)


@pytest.mark.slow
def test_what_is_made_small(trainee, observations):
    """By Pinocchio: distance and angle of postures that are high enough for the fingers; more where they are not."""
    kin, task = ArmKinematics("ur5-thesis", tip="tcp", base="world"), SpaceTask.of(SMALL.options)
    objective = trainee.model.objective(observations)
    rng, checked = np.random.default_rng(0), {True: 0, False: 0}
    home = np.array(SMALL.settings["around"])
    for row in range(40):
        q = home + rng.uniform(-0.5, 0.5, 6) + [0, -0.7 * (row % 2), 0, 0, 0, 0]
        T = kin.fk(q)
        corners = T[:3, 3] + np.array(SMALL.settings["feelers"]) @ T[:3, :3].T
        high = corners[:, 2].min() > -0.2 + 0.01
        off = np.linalg.norm(T[:3, 3] - goal_in_world(kin.arm, observations[row, :6], [True, True]))
        turn = np.linalg.norm(T[:3, 2] - observations[row, task.layout.direction])
        found = float(objective(torch.as_tensor(q[None] / np.pi, dtype=torch.float32), torch.tensor([row])))
        wanted = off + LEVER * turn
        if high:
            assert found == pytest.approx(wanted, abs=1e-5)
        else:
            assert found > wanted + 1e-6
        checked[bool(high)] += 1
    assert min(checked.values()) >= 8


@pytest.mark.slow
def test_it_comes_near_in_seconds(tmp_path):
    run = train(SMALL, tmp_path, seed=0, steps=20_000)
    found = evaluate(run.policy, goals=200, seed=VALIDATION, options={"backend": "kinematic"})
    assert np.median(found.measures["distance"]) < 0.08
    assert np.median(found.measures["posture_error"]) < 0.2
    assert run.card.meaning == "posture"


@pytest.mark.slow
def test_an_evaluation_has_the_goals_of_the_training(tmp_path):
    run = train(replace(SMALL, segments=1), tmp_path, seed=0, steps=256)
    tilted = evaluate(run.policy, goals=20, options={"backend": "kinematic"})
    down = evaluate(run.policy, goals=20, options={"backend": "kinematic", "tilt": 0.0})
    assert not np.array_equal(tilted.measures["posture_error"], down.measures["posture_error"])


@pytest.mark.parametrize("name", ["ranked-single", "button"])
def test_other_environments_are_refused(name):
    recipe = get_recipe(name)
    settings = {**SMALL.settings}
    with pytest.raises(InputError, match=r"analytic gradients are for postures|ranked PPO tries postures"):
        build(replace(SMALL, environment=recipe.environment, options=recipe.options, settings=settings), 0, steps=1)


def test_each_step_goes_down_the_gradient_of_its_own_rows(trainee, monkeypatch):
    model = trainee.model
    seen = np.random.default_rng(0).uniform(-1.0, 1.0, (32, *model.observation_space.shape))
    model.set_logger(configure(None, []))
    monkeypatch.setattr(model, "batch_size", 8)
    monkeypatch.setattr(model, "seen", lambda: seen)
    monkeypatch.setattr(model, "objective", lambda _: lambda means, rows: ((means - 0.01 * rows[:, None]) ** 2).mean())
    before, policy = copy.deepcopy(model.policy.state_dict()), copy.deepcopy(model.policy)
    torch.manual_seed(3)
    model.train()
    (group,) = policy.optimizer.param_groups
    group["lr"] = model.policy.optimizer.param_groups[0]["lr"]
    torch.manual_seed(3)
    inputs = torch.as_tensor(seen, dtype=torch.float32)
    for _ in range(model.n_epochs):
        for rows in torch.split(torch.randperm(32), 8):
            policy.optimizer.zero_grad()
            loss = ((policy.get_distribution(inputs[rows]).distribution.mean - 0.01 * rows[:, None]) ** 2).mean()
            loss.backward()
            policy.optimizer.step()
    found, expected = (torch.cat([value.ravel() for value in one.parameters()]) for one in (model.policy, policy))
    start = torch.cat([before[name].ravel() for name, _ in policy.named_parameters()])
    torch.testing.assert_close(found, expected, rtol=1e-5, atol=1e-7)
    assert (found != start).float().mean() > 0.3
    assert model.logger.name_to_value["train/loss"] == pytest.approx(loss.item(), rel=1e-4)
    model.policy.load_state_dict(before)


def test_a_model_is_saved_without_its_task(trainee):
    trainee.model.save(io.BytesIO())
    assert "task" in trainee.model._excluded_save_params()


def test_a_folded_elbow_costs(trainee, observations, monkeypatch):
    """As much as it is beyond its largest angle."""
    objective, largest = trainee.model.objective(observations), SMALL.settings["largest"]
    for angle in (-2.9, -2.81, -2.79, 2.79, 2.95):
        means, costs = torch.tensor([SMALL.settings["around"]]) / np.pi, []
        means[0, 2] = angle / np.pi
        for limits in (torch.tensor(largest), torch.tensor(math.inf)):
            monkeypatch.setattr(trainee.model, "largest", limits)
            costs.append(float(objective(means, torch.tensor([0]))))
        assert costs[0] - costs[1] == pytest.approx(max(abs(angle) - largest[2], 0.0), abs=1e-5)


def test_without_limits_and_feelers_what_is_made_small_is_the_error_alone(trainee, observations):
    """By Pinocchio; with them the depth of the feelers is added, and what joints are folded."""
    settings = {name: value for name, value in SMALL.settings.items() if name not in ("largest", "feelers")}
    bare, task = build(replace(SMALL, settings=settings), 0, steps=SMALL.steps), SpaceTask.of(SMALL.options)
    bare.env.close()
    objectives = [one.model.objective(observations) for one in (bare, trainee)]
    kin, rng, deep, folded = ArmKinematics("ur5-thesis", tip="tcp", base="world"), np.random.default_rng(1), 0, 0
    for row in range(100):
        q = rng.uniform(-np.pi, np.pi, 6)
        T = kin.fk(q)
        off = np.linalg.norm(T[:3, 3] - goal_in_world(kin.arm, observations[row, :6], [True, True]))
        turn = np.linalg.norm(T[:3, 2] - observations[row, task.layout.direction])
        corners = T[2, 3] + np.array(SMALL.settings["feelers"]) @ T[2, :3]
        more = np.maximum(-0.2 + CLEARANCE - corners, 0.0).sum(), max(abs(q[2]) - 2.8, 0.0)
        means, rows = torch.as_tensor(q[None] / np.pi, dtype=torch.float32), torch.tensor([row])
        found = [float(objective(means, rows)) for objective in objectives]
        assert found == pytest.approx([off + LEVER * turn, off + LEVER * turn + more[0] + FOLDED * more[1]], abs=2e-5)
        deep, folded = deep + (more[0] > 0.0), folded + (more[1] > 0.0)
    assert 5 < deep < 80
    assert 3 < folded < 50


def test_a_ball_is_to_be_met_where_it_will_be():
    """By stepping the environment until the arm has come to rest where it was sent: the ball is as far as was said."""
    recipe = replace(get_recipe("gradient-moving"), num_envs=16, window=160)
    trainee = build(recipe, 0, steps=1000)
    try:
        trainee.env.seed(1)
        observations = trainee.env.reset()
        world = trainee.env.get_attr("unwrapped")[0].episodes
        targets = world.home + np.random.default_rng(0).uniform(-0.3, 0.3, (16, 6))
        means = torch.as_tensor(targets / np.pi, dtype=torch.float32)
        objective = trainee.model.objective(observations)
        tips = world.chain.fk(targets)
        compared = 0
        rests = np.full(16, -1)
        for frame in range(1, 40):
            world.step(targets / np.pi)
            rests = np.where((rests < 0) & (np.abs(world.q - targets).max(axis=1) < 1e-3), frame, rests)
        for row in np.flatnonzero(rests > 0):
            said = float(objective(means[[row]], torch.tensor([row])))
            turn = DOWN * np.linalg.norm(tips[row, :3, 2] - [0, 0, -1])
            now = np.linalg.norm(tips[row, :3, 3] - world.rolls[row, rests[row] * 8])
            assert said - turn == pytest.approx(now, abs=0.03)  # within a frame or so
            compared += 1
        assert compared >= 12
    finally:
        trainee.env.close()


def test_a_gripper_in_the_table_costs():
    """By how deep its corners would be, at the target and on the way there, beside the objective without feelers."""
    low = [[0.0, 0.0, 0.05]]  # under the tip, in the table where the tip is at a ball
    recipe = replace(get_recipe("gradient-moving"), num_envs=8, window=80)
    values = []
    for feelers in ((), low):
        trainee = build(replace(recipe, settings={**recipe.settings, "feelers": feelers}), 0, steps=1000)
        trainee.env.seed(1)
        objective = trainee.model.objective(trainee.env.reset())
        world = trainee.env.get_attr("unwrapped")[0].episodes
        q = tool_down_postures(ur5(), world.rolls[:, 40])
        values.append([float(objective(torch.as_tensor(q[[i]] / np.pi, dtype=torch.float32), torch.tensor([i])))
                       for i in range(8)])  # fmt: skip
        trainee.env.close()
    least = -0.2 + GRIPPER_CLEARANCE
    tips = world.chain.fk(np.array([world.home + part * (q - world.home) for part in WAY]).reshape(-1, 6))
    depth = np.maximum(least - (tips[:, 2, 2] * 0.05 + tips[:, 2, 3]), 0.0).reshape(len(WAY), 8).mean(axis=0)
    assert (depth > 0.005).all()
    np.testing.assert_allclose(np.subtract(*values[::-1]), depth, atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gradient-moving", "random-arms"])
def test_what_the_simulation_knows_is_learned(name, tmp_path):
    recipe = replace(get_recipe(name), num_envs=256, window=256)
    run = train(recipe, tmp_path, seed=0, steps=2560)
    rows = np.genfromtxt(tmp_path / "curve.csv", delimiter=",", names=True)
    assert rows["reward"][-1] > rows["reward"][0]
    assert run.card.meaning == "posture"


def test_an_arm_without_a_table_may_go_as_low_as_it_likes():
    assert table_top(get_arm("arm3")) == -math.inf
    assert table_top(get_arm("ur5-thesis")) == pytest.approx(-0.2)
