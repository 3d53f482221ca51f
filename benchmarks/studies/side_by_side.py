"""Many trainings by PPO2 of the reach tasks at once: their networks are stacked, their arms are one native batch.

A training here is what `kinreach.baselines._ppo2.PPO2` does with the same settings; stacked, one takes a tenth of the
time, because what a step of a small network costs is mostly calling it. Trainings of a stack are of one task with
one number of arms, and may differ in what `Trained` says. Those with the same seed have the same initial weights, the
same noise and the same goals, so that cells of a table differ by what they are about.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from kinreach.baselines._batch import last_step, make_batch
from kinreach.baselines._policies import LearnedPolicy
from kinreach.baselines._policy_file import Network, PolicyCard
from kinreach.baselines._ppo2 import ppo2_loss
from kinreach.baselines._rewards import TrainingReward, own

Array = np.ndarray[Any, Any]

#: What all trainings have in common: PPO2's, in both libraries.
EPOCHS, MINIBATCHES, CLIP, LAMBDA, VF_COEF, MAX_NORM = 4, 4, 0.2, 0.95, 0.5, 0.5
_BETAS, _EPS, _HIDDEN, _JOINTS, _INPUTS = (0.9, 0.999), 1e-5, 64, 6, 13
#: Seeds of the goals of trainings, so far apart that arms of different ones share none.
_APART = 100_003


@dataclass(frozen=True)
class Trained:
    """What one training of a stack may have of its own.

    Attributes:
        seed: Of weights, noise and goals.
        terminal: Whether the step limit is an end; else the value of the last state is added.
        gain: What the actor's unit is as an action: 1/π for radians, 1/5 for degrees.
        std: Standard deviation to begin with, as an action.
        value_clip: Whether the value function is clipped too.
        rate, entropy: Learning rate, coefficient of the entropy.
        reward: What the learner sees.
        random: Share of the actions that are any in the range instead, as in epsilon-greedy exploration. Probabilities
            are those of the mixture.
    """

    seed: int
    terminal: bool
    gain: float
    std: float
    value_clip: bool
    rate: float
    entropy: float
    reward: TrainingReward = own
    random: float = 0.0


@dataclass(frozen=True)
class Stack:
    """What the trainings of a stack have in common.

    Attributes:
        environment: Id of a reach environment of the UR5.
        steps: Actions of each.
        arms: Of each.
        n_steps: Of each arm between two updates.
        gamma: Discount factor.
        shared: Whether the value function is a head of the actor's network, as in OpenAI Baselines.
        ends: Whether reaching ends an episode of several steps.
        windows: Rows of the learning curve.
        looks: How often the policies are looked at while they are trained.
        options: Of the environment.
        inputs: What is subtracted from an observation, and what it is divided by, before the networks see it.
    """

    environment: str
    steps: int
    arms: int
    n_steps: int
    gamma: float
    shared: bool
    ends: bool = True
    windows: int = 50
    looks: int = 10
    options: Mapping[str, Any] = field(default_factory=dict)
    inputs: tuple[tuple[float, ...], tuple[float, ...]] = ((0.0,) * _INPUTS, (1.0,) * _INPUTS)


def initial_weights(seed: int, shared: bool) -> dict[str, Tensor]:
    """Orthogonal weights as both libraries draw them, and zeros, by name."""
    generator = torch.Generator().manual_seed(seed)

    def drawn(inputs: int, outputs: int, gain: float) -> Tensor:
        rows = torch.randn(max(inputs, outputs), min(inputs, outputs), generator=generator)
        q, r = torch.linalg.qr(rows)
        q = q * torch.diagonal(r).sign()
        return gain * (q if inputs >= outputs else q.T)

    root = math.sqrt(2)
    found = {}
    for net in ("pi",) if shared else ("pi", "vf"):
        found |= {f"{net}0.w": drawn(_INPUTS, _HIDDEN, root), f"{net}1.w": drawn(_HIDDEN, _HIDDEN, root)}
        found |= {f"{net}{layer}.b": torch.zeros(1, _HIDDEN) for layer in (0, 1)}
    found |= {"mean.w": drawn(_HIDDEN, _JOINTS, 0.01), "mean.b": torch.zeros(1, _JOINTS)}
    return found | {"value.w": drawn(_HIDDEN, 1, 1.0), "value.b": torch.zeros(1, 1)}


class Networks:
    """Stacked actors and critics, and their optimiser.

    Args:
        trained: What each training has of its own.
        shared: As in `Stack`.
        inputs: As in `Stack`.

    Attributes:
        weights: By name, each of shape (trainings, ...).
    """

    def __init__(
        self, trained: Sequence[Trained], shared: bool, inputs: tuple[Sequence[float], Sequence[float]] = Stack.inputs
    ) -> None:
        self._shift, self._scale = map(torch.tensor, inputs)
        self._seeds = [one.seed for one in trained]
        each = [initial_weights(seed, shared) for seed in self._seeds]
        self.weights = {name: torch.stack([weights[name] for weights in each]) for name in each[0]}
        self.weights["log_std"] = torch.tensor([[[math.log(one.std)] * _JOINTS] for one in trained])
        for value in self.weights.values():
            value.requires_grad_(True)
        self._gain = torch.tensor([one.gain for one in trained])[:, None, None]
        self._rate = torch.tensor([one.rate for one in trained])
        self._random = torch.tensor([one.random for one in trained])[:, None]
        self._first = [torch.zeros_like(value) for value in self.weights.values()]
        self._second = [torch.zeros_like(value) for value in self.weights.values()]
        self._updates = 0
        self._shared = shared

    def _hidden(self, net: str, x: Tensor) -> Tensor:
        x = (x - self._shift) / self._scale
        for layer in (0, 1):
            x = torch.baddbmm(self.weights[f"{net}{layer}.b"], x, self.weights[f"{net}{layer}.w"]).tanh()
        return x

    def _head(self, name: str, hidden: Tensor) -> Tensor:
        return torch.baddbmm(self.weights[f"{name}.b"], hidden, self.weights[f"{name}.w"])

    def means(self, x: Tensor) -> Tensor:
        """Mean actions, shape (trainings, n, 6), of observations of shape (trainings, n, 13)."""
        return self._gain * self._head("mean", self._hidden("pi", x))

    def values(self, x: Tensor) -> Tensor:
        """Return the critics' values, shape (trainings, n)."""
        return self._head("value", self._hidden("pi" if self._shared else "vf", x)).squeeze(-1)

    def evaluated(self, x: Tensor, actions: Tensor) -> tuple[Tensor, Tensor]:
        """Values and logarithms of the probabilities of actions, both of shape (trainings, n)."""
        hidden = self._hidden("pi", x)
        log_std = self.weights["log_std"]
        z = (actions - self._gain * self._head("mean", hidden)) * (-log_std).exp()
        log_prob = -0.5 * z.square().sum(-1) - log_std.sum(-1) - 0.5 * _JOINTS * math.log(2 * math.pi)
        if self._random.any():
            uniform = torch.where((actions.abs() <= 1).all(-1), -_JOINTS * math.log(2), -math.inf)
            log_prob = torch.logaddexp(log_prob + (-self._random).log1p(), uniform + self._random.log())
        return self._head("value", hidden if self._shared else self._hidden("vf", x)).squeeze(-1), log_prob

    def entropy(self) -> Tensor:
        """Of the actions, shape (trainings,)."""
        return (self.weights["log_std"] + 0.5 * math.log(2 * math.pi * math.e)).sum((-2, -1))

    def descend(self, losses: Tensor) -> None:
        """One step of Adam for every training, each with its own gradient's norm held down."""
        gradients = torch.autograd.grad(losses.sum(), list(self.weights.values()))
        with torch.no_grad():
            norms = sum(gradient.flatten(1).square().sum(1) for gradient in gradients).sqrt()  # type: ignore[union-attr]
            factors = (MAX_NORM / (norms + 1e-6)).clamp(max=1.0)
            self._updates += 1
            done = [1 - beta**self._updates for beta in _BETAS]
            for weight, gradient, first, second in zip(
                self.weights.values(), gradients, self._first, self._second, strict=True
            ):
                gradient = gradient * factors[:, None, None]
                first.mul_(_BETAS[0]).add_(gradient, alpha=1 - _BETAS[0])
                second.mul_(_BETAS[1]).addcmul_(gradient, gradient, value=1 - _BETAS[1])
                step = first / done[0] / ((second / done[1]).sqrt() + _EPS)
                weight.sub_(self._rate[:, None, None] * step)

    def act(self, observations: Array, *, explore: bool) -> Array:
        """Actions of all trainings, with exploration or without.

        Args:
            observations: Shape (trainings n, 13), those of one training after those of the other.
            explore: Whether the actions are drawn, from torch's own generator.
        """
        x = torch.from_numpy(observations).float().reshape(len(self._rate), -1, _INPUTS)
        with torch.no_grad():
            actions = self.means(x)
            if explore:
                actions += self.weights["log_std"].exp() * torch.randn_like(actions)
        return actions.clamp(-1, 1).flatten(0, 1).numpy().astype(np.float64)

    def policy(self, index: int, stack: Stack) -> LearnedPolicy:
        """The actor of one of the trainings of a stack."""
        arrays = {name: value[index].detach().numpy().astype(np.float64) for name, value in self.weights.items()}
        layers = [(arrays[f"{name}.w"].T, arrays[f"{name}.b"][0]) for name in ("pi0", "pi1", "mean")]
        gain = np.full(_JOINTS, float(self._gain[index]))
        network = Network(
            self._shift.numpy(), self._scale.numpy(), np.zeros(0), layers, "tanh", "linear", gain, np.zeros(_JOINTS)
        )
        recipe = {"name": "a stacked training"}
        seed = self._seeds[index]
        card = PolicyCard(stack.environment, "action", "tanh", "linear", "PPO2", recipe, seed, stack.steps)
        return LearnedPolicy(card, network)


def advantages(rewards: Array, values: Array, last: Array, ended: Array, gamma: float) -> Array:
    """Generalised advantages, shape (n_steps, ...); `ended[t]` says that an episode ended with step t."""
    found, running, following = np.empty_like(rewards), np.zeros_like(last), last
    for t in range(len(rewards) - 1, -1, -1):
        goes_on = 1.0 - ended[t]
        running = rewards[t] + gamma * following * goes_on - values[t] + gamma * LAMBDA * goes_on * running
        found[t], following = running, values[t]
    return found


class Batch(NamedTuple):
    """What an update learns from; the first two dimensions are trainings and steps."""

    observations: Tensor
    actions: Tensor
    values: Tensor
    log_prob: Tensor
    advantages: Tensor
    returns: Tensor


def learn(networks: Networks, batch: Batch, trained: Sequence[Trained], shuffles: torch.Generator) -> None:
    """One update of all trainings: several epochs in minibatches."""
    entropy = torch.tensor([one.entropy for one in trained])
    value_clip = torch.tensor([CLIP if one.value_clip else math.inf for one in trained])
    for _ in range(EPOCHS):
        for rows in torch.randperm(batch.values.shape[1], generator=shuffles).chunk(MINIBATCHES):
            some = Batch(*(part[:, rows] for part in batch))
            values, log_prob = networks.evaluated(some.observations, some.actions)
            losses = ppo2_loss(
                log_prob - some.log_prob,
                some.advantages,
                values,
                some.values,
                some.returns,
                clip=CLIP,
                value_clip=value_clip,
                vf_coef=VF_COEF,
            )
            networks.descend(losses - entropy * networks.entropy())


class Curves:
    """What happens in the trainings: sums over windows of as many updates.

    Args:
        trainings: How many.
        updates: Of each.
        windows: How many at most.
    """

    def __init__(self, trainings: int, updates: int, windows: int) -> None:
        self._width = -(-updates // windows)
        self._sums = np.zeros((-(-updates // self._width), 5, trainings))

    def add(self, update: int, rewards: Array, impossible: Array, reached: Array) -> None:
        """Count the steps of an update; arrays of shape (n_steps, trainings, arms)."""
        possible = ~impossible
        of = (np.ones_like(rewards), impossible, np.where(possible, rewards, 0.0), possible, reached)
        self._sums[update // self._width] += np.array([values.sum(axis=(0, 2)) for values in of])

    def columns(self, index: int) -> dict[str, list[float]]:
        """Of one training: steps so far, share of impossible ones, mean reward of the others, goals reached."""
        steps, impossible, reward, possible, reached = self._sums[:, :, index].T
        return {
            "steps": np.cumsum(steps).tolist(),
            "impossible": np.round(impossible / steps, 4).tolist(),
            "reward": np.round(reward / np.maximum(possible, 1), 3).tolist(),
            "reached": reached.tolist(),
        }


def train_stack(
    stack: Stack,
    trained: Sequence[Trained],
    *,
    look: Callable[[int, Networks], None] = lambda steps, networks: None,
) -> tuple[Networks, Curves]:
    """Train all, from scratch.

    Args:
        stack: What they have in common.
        trained: What each has of its own.
        look: Called `stack.looks` times, with the actions that each has done.
    """
    count, arms, length = len(trained), stack.arms, stack.n_steps
    networks = Networks(trained, stack.shared, stack.inputs)
    updates = -(-stack.steps // (arms * length))
    curves = Curves(count, updates, stack.windows)
    seeds = sorted({one.seed for one in trained})
    place = [seeds.index(one.seed) for one in trained]
    generators = [torch.Generator().manual_seed(seed) for seed in seeds]
    shuffles = torch.Generator().manual_seed(0)
    greedy = {i: torch.Generator().manual_seed(_APART + one.seed) for i, one in enumerate(trained) if one.random}
    bootstrapped = np.array([not one.terminal for one in trained])
    groups = [(reward, [i for i, one in enumerate(trained) if one.reward is reward])
              for reward in dict.fromkeys(one.reward for one in trained)]  # fmt: skip
    env = make_batch(
        stack.environment,
        count * arms,
        {"backend": "kinematic", "end_on_reached": stack.ends, **stack.options},
    )

    def per_training(values: Array) -> Array:
        return np.asarray(values).reshape(count, arms, *np.shape(values)[1:])

    seen = per_training(env.reset(seed=[1 + _APART * one.seed + arm for one in trained for arm in range(arms)])[0])
    shape = (length, count, arms)
    try:
        for update in range(updates):
            drawn = torch.stack([torch.randn(length, arms, _JOINTS, generator=one) for one in generators], 1)
            noise = drawn[:, place]
            observations, actions = torch.empty(*shape, _INPUTS), torch.empty(*shape, _JOINTS)
            rewards, ended, added = np.empty(shape), np.empty(shape), np.zeros(shape)
            paid, impossible, reached = np.empty(shape), np.empty(shape, bool), np.empty(shape, bool)
            with torch.no_grad():
                std = networks.weights["log_std"].exp()
                for t in range(length):
                    observations[t] = torch.from_numpy(seen)
                    actions[t] = networks.means(observations[t]) + std * noise[t]
                    for index, generator in greedy.items():
                        some = torch.rand(arms, 1, generator=generator) < trained[index].random
                        anything = 2 * torch.rand(arms, _JOINTS, generator=generator) - 1
                        actions[t, index] = torch.where(some, anything, actions[t, index])
                    after, own_rewards, terminated, truncated, info = env.step(
                        actions[t].flatten(0, 1).clamp(-1, 1).numpy().astype(np.float64)
                    )
                    told = last_step(info)
                    paid[t], impossible[t], reached[t] = (
                        per_training(values) for values in (own_rewards, told["impossible"], told["reached"])
                    )
                    for reward, members in groups:
                        rewards[t, members] = per_training(reward(own_rewards, told))[members]
                    ended[t], seen = per_training(terminated | truncated), per_training(after)
                    cut = per_training(truncated & ~terminated) & bootstrapped[:, None]
                    if cut.any():
                        final = torch.from_numpy(per_training(info["final_obs"])).float()
                        added[t] = np.where(cut, stack.gamma * networks.values(final).numpy(), 0.0)
                x = observations.transpose(0, 1).flatten(1, 2)
                a = actions.transpose(0, 1).flatten(1, 2)
                old_values, old_log_prob = networks.evaluated(x, a)
                values = old_values.numpy().reshape(count, length, arms).swapaxes(0, 1)
                last = networks.values(torch.from_numpy(seen).float()).numpy()
            curves.add(update, paid, impossible, reached)
            gains = advantages(rewards + added, values, last, ended, stack.gamma)
            advised = [
                torch.from_numpy(np.ascontiguousarray(part.swapaxes(0, 1)).reshape(count, -1)).float()
                for part in (gains, gains + values)
            ]
            learn(networks, Batch(x, a, old_values, old_log_prob, *advised), trained, shuffles)
            if (update + 1) * stack.looks // updates > update * stack.looks // updates:
                look((update + 1) * length * arms, networks)
    finally:
        env.close()
    return networks, curves
