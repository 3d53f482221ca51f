"""Stacked trainings are what single ones are, and cells of the table differ by what they say."""

import math

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

import torch
from scipy.stats import norm
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.logger import Logger

from benchmarks.studies import side_by_side
from benchmarks.studies.side_by_side import Batch, Networks, Stack, Trained, advantages, learn, train_stack
from kinreach._registration import MULTI, SINGLE
from kinreach.baselines import get_recipe
from kinreach.baselines._models import build

STEPS, SPREAD = 64, 3.0


def trained(seed=0, **changed):
    usual = {"terminal": True, "gain": 1 / math.pi, "std": 1 / math.pi, "value_clip": True, "rate": 1e-3}
    return Trained(**{"seed": seed, "entropy": 0.01, **usual, **changed})


def stable(stacked, index, one):
    """A model of stable-baselines3 with the weights and the settings of one training of a stack."""
    from dataclasses import replace

    recipe = get_recipe("thesis-ppo-single")
    networks = replace(recipe.networks, std=one.std)
    settings = {**recipe.settings, "gain": one.gain, "n_steps": STEPS, "minibatches": 1, "learning_rate": one.rate}
    settings |= {"ent_coef": one.entropy, "clip_range_vf": 0.2 if one.value_clip else None}
    model = build(replace(recipe, num_envs=1, networks=networks, settings=settings), 0, steps=STEPS).model
    model.set_logger(Logger(None, []))
    model.policy.load_state_dict(weights(stacked, index, model.policy.state_dict()))
    return model


def weights(stacked, index, like):
    """Those of a training by stable-baselines3's names."""
    of = {name: value[index].detach().clone() for name, value in stacked.weights.items()}
    found = {"log_std": of["log_std"][0]}
    for theirs, ours in (("policy_net", "pi"), ("value_net", "vf")):
        for layer in (0, 1):
            found[f"mlp_extractor.{theirs}.{2 * layer}.weight"] = of[f"{ours}{layer}.w"].T
            found[f"mlp_extractor.{theirs}.{2 * layer}.bias"] = of[f"{ours}{layer}.b"][0]
    for theirs, ours in (("action_net", "mean"), ("value_net", "value")):
        found |= {f"{theirs}.weight": of[f"{ours}.w"].T, f"{theirs}.bias": of[f"{ours}.b"][0]}
    return {**like, **found}


def test_an_update_is_that_of_stable_baselines3(monkeypatch):
    """With the whole rollout as minibatch, for its order is drawn elsewhere; the recipes' learner is the oracle."""
    monkeypatch.setattr(side_by_side, "MINIBATCHES", 1)
    jobs = [
        trained(seed, value_clip=clip, rate=rate, gain=gain, entropy=entropy)
        for seed in (0, 1)
        for clip, rate, gain, entropy in (
            (True, 1e-3, 1 / math.pi, 0.01),
            (False, 3e-4, 0.2, 0.0),
            (True, 1e-3, 1.0, 0.1),
        )
    ]
    networks = Networks(jobs, shared=False)
    models = [stable(networks, index, one) for index, one in enumerate(jobs)]
    for value in networks.weights.values():  # a policy that is not the first one, as behind earlier updates
        value.data += 0.05 * torch.randn(value.shape, generator=torch.Generator().manual_seed(3))
    rng = torch.Generator().manual_seed(1)
    shape = (len(jobs), STEPS)
    drawn = [torch.randn(*shape, *size, generator=rng) for size in ((13,), (6,), (), ())]
    with torch.no_grad():
        values, log_prob = networks.evaluated(drawn[0], drawn[1])
    old = values + 0.3 * torch.randn(shape, generator=rng)
    batch = Batch(drawn[0], drawn[1], old, log_prob - 0.1 * drawn[2], SPREAD * drawn[2], old + SPREAD * drawn[3])
    for index, model in enumerate(models):
        model.policy.load_state_dict(weights(networks, index, model.policy.state_dict()))
        buffer = model.rollout_buffer
        buffer.observations[:, 0], buffer.actions[:, 0] = batch.observations[index], batch.actions[index]
        for name, part in (("values", old), ("log_probs", batch.log_prob), ("advantages", batch.advantages),
                           ("returns", batch.returns)):  # fmt: skip
            getattr(buffer, name)[:, 0] = part[index]
        buffer.full = True
    before = {name: value.detach().clone() for name, value in networks.weights.items()}
    learn(networks, batch, jobs, torch.Generator())
    compared = 0
    for index, model in enumerate(models):
        model.train()
        state = model.policy.state_dict()
        for name, value in weights(networks, index, state).items():
            assert torch.allclose(state[name], value, atol=2e-5), (index, name)
            compared += value.numel()
    assert compared > 5 * 10_000
    assert all((networks.weights[name] - value).abs().max() > 1e-4 for name, value in before.items())


def test_advantages_are_those_of_stable_baselines3():
    rng = np.random.default_rng(0)
    steps, arms, compared = 50, 4, 0
    for gamma in (0.0, 0.7, 0.99):
        rewards, values = rng.normal(size=(2, steps, arms))
        ended = rng.random((steps, arms)) < 0.1
        last = rng.normal(size=arms)
        space = get_space()
        buffer = RolloutBuffer(steps, space, space, gae_lambda=side_by_side.LAMBDA, gamma=gamma, n_envs=arms)
        buffer.rewards[:], buffer.values[:] = rewards, values
        buffer.episode_starts[1:] = ended[:-1]
        buffer.compute_returns_and_advantage(torch.from_numpy(last), ended[-1])
        found = advantages(rewards, values, last, ended.astype(float), gamma)
        np.testing.assert_allclose(found, buffer.advantages, atol=1e-4)
        compared += found.size
    assert compared == 3 * steps * arms


def get_space():
    from gymnasium.spaces import Box

    return Box(-1, 1, (2,))


@pytest.mark.parametrize("shared", [True, False])
def test_what_is_trained_beside_others_is_what_it_is_alone(shared):
    """Up to the order in which numbers are added."""
    stack = Stack(MULTI, steps=240, arms=2, n_steps=60, gamma=0.99, shared=shared, looks=2, windows=2)
    one = trained(3, gain=0.2, std=0.2)
    others = [trained(3, terminal=False, gain=0.2, std=0.2), trained(4, gain=1.0, std=0.2)]
    looks = []

    def look(steps, networks):
        looks.append(steps)

    alone, _ = train_stack(stack, [one], look=look)
    beside, curves = train_stack(stack, [others[0], one, others[1]], look=look)
    compared = 0
    for name, value in alone.weights.items():
        assert torch.allclose(value[0], beside.weights[name][1], atol=1e-5), name
        compared += value[0].numel()
    assert compared > 5000
    assert looks == [120, 240] * 2
    assert curves.columns(1)["steps"] == [120.0, 240.0]
    assert not torch.allclose(beside.weights["value.b"][0], beside.weights["value.b"][1], atol=1e-5)  # the step limit


def test_a_stack_learns():
    """What no policy earns at first: postures that are possible, in single-step."""
    stack = Stack(SINGLE, steps=128 * 40, arms=128, n_steps=1, gamma=0.0, shared=False, windows=4)
    _, curves = train_stack(stack, [trained(seed) for seed in range(2)])
    for index in range(2):
        impossible = curves.columns(index)["impossible"]
        assert impossible[-1] < 0.8 * impossible[0]


def test_inputs_are_shifted_and_scaled_first():
    """In the networks and in the policies that come of them."""
    rng = np.random.default_rng(0)
    shift, scale = tuple(rng.normal(size=13).tolist()), tuple(rng.uniform(0.5, 2.0, 13).tolist())
    stack = Stack(SINGLE, 128, 128, 1, 0.0, shared=False, inputs=(shift, scale))
    plain, scaled = Networks([trained()], shared=False), Networks([trained()], shared=False, inputs=stack.inputs)
    x = torch.randn(1, 50, 13)
    with torch.no_grad():
        expected = plain.means((x - torch.tensor(shift)) / torch.tensor(scale))
        assert torch.equal(scaled.means(x), expected)
    network = scaled.policy(0, stack).network
    np.testing.assert_allclose(network(x[0].numpy().astype(float)), expected[0].numpy(), atol=1e-5)


def test_random_actions_are_a_mixture():
    """Probabilities are those of scipy's normal and of the uniform distribution over the range."""
    jobs = [trained(gain=1.0, std=0.4, random=share) for share in (0.0, 0.3, 0.1)]
    networks = Networks(jobs, shared=False)
    rng = torch.Generator().manual_seed(0)
    x, actions = torch.randn(3, 200, 13, generator=rng), 0.6 * torch.randn(3, 200, 6, generator=rng)
    with torch.no_grad():
        found, means = networks.evaluated(x, actions)[1].double().exp().numpy(), networks.means(x).numpy()
    inside = (actions.abs() <= 1).all(-1).numpy()
    assert 100 < inside.sum() < 500
    for index, share in enumerate((0.0, 0.3, 0.1)):
        density = norm.pdf(actions[index].numpy(), means[index], 0.4).prod(axis=1)
        np.testing.assert_allclose(found[index], (1 - share) * density + share * inside[index] / 2**6, rtol=1e-3)


def test_random_actions_of_one_training_leave_those_beside_it_alone():
    stack = Stack(SINGLE, 512, 128, 1, 0.0, shared=False)
    jobs = [trained(), trained(random=0.5)]
    (together, curves), (alone, _) = (train_stack(stack, some) for some in (jobs, jobs[:1]))
    for name, value in alone.weights.items():
        assert torch.allclose(together.weights[name][0], value[0], atol=1e-5), name
        assert (together.weights[name][1] - value[0]).abs().max() > 1e-4 or name.endswith(".b")
    assert curves.columns(1)["impossible"] != curves.columns(0)["impossible"]
