"""Gradient descent on whole episodes with a rolling ball, through the motion of the arm.

Every update draws new balls and plays their episodes with the actor's mean actions. The arm's motion is differentiable,
so the gradient of what happens in an episode goes back through all its frames (backpropagation through time, as in
short-horizon learning with differentiable simulators: Xu et al. 2022, arXiv:2204.07137). What is made small is the
least distance of tip and ball. It looks `BEYOND` the first touch: a loss that ends there teaches to graze the ball.
"""

from __future__ import annotations

import copy
import math
from typing import Any, NamedTuple

import numpy as np
import torch

from kinreach._checks import Floats
from kinreach.baselines._descent import SimulatorGradient, feeler_depth
from kinreach.baselines.expert import GRIPPER, table_top
from kinreach.envs.inside import Ids, moving

#: Length of an episode, of every fourth one, and parts of a frame in which the arm's posture is computed [frames].
FRAMES, LONG, EVERY = 30, 60, 4
#: Parts of a frame, of the environment's `PARTS`, after which postures of the arm are computed.
POSTURES = (moving.PARTS // 2, moving.PARTS)
#: How long it looks beyond the first touch [parts of a frame].
BEYOND = 10
#: Speeds of the balls [m/s].
SPEEDS = (0.15, 1.25)
#: Distance of a ball that has left the table area [m].
GONE = 9.0
#: A touch is worth `TOUCH` from here on, with this width [m].
TOUCH, NEAR, WIDTH = 1.0, 0.008, 0.002
#: Width of the soft minimum over time at the beginning, and what it has always [m].
SOFT, LEAST_SOFT = 0.03, 0.004
#: How high points of the gripper stay above the table [m], and how far joints within their bounds [rad].
CLEARANCE, WITHIN = 0.004, 0.2
#: Weight of a joint near its bounds, and of depths of the gripper: logarithmic with this scale [m], and linear.
FOLDED, DEPTH_SCALE, DEEP, DEPTH = 2.0, 0.004, 0.25, 5.0
#: Updates in which the learning rate grows, and over how many weights are averaged.
WARM, AVERAGED = 20, 150


class Balls(NamedTuple):
    """Rolling balls: where they are in the parts of a frame [m], (n, parts, 2), and when they are gone, (n,)."""

    rolls: Floats
    ends: Any


def drawn_balls(world: moving.MovingEpisodes, rng: np.random.Generator, count: int, frames: int) -> Balls:
    """Draw balls of all kinds in equal parts: a half of them, and their mirror images."""
    times = np.arange(frames * moving.PARTS + 1) / (moving.FRAMES * moving.PARTS)
    low, high = world.area
    kinds = list(moving.PATHS.values())
    speeds = rng.uniform(*SPEEDS, -(-count // 2))
    inside = low + moving.INSIDE, high - moving.INSIDE
    half = np.array([kinds[i % len(kinds)](rng, speed, times, *inside) for i, speed in enumerate(speeds)])
    mirrored = half * [1.0, -1.0] + [0.0, low[1] + high[1]]
    rolls = np.concatenate([half, mirrored])[:count]
    return Balls(rolls, moving.last_part(rolls, world.area))


class EpisodeGradient(SimulatorGradient):
    """Analytic gradient of whole episodes with a rolling ball.

    Attributes:
        average: The policy with the mean of its weights over the last updates, which is exported.

    Args:
        balls: In an update.
    """

    world: moving.MovingEpisodes

    def __init__(self, *args: Any, balls: int, **kwargs: Any) -> None:
        self.balls = balls
        super().__init__(*args, **kwargs)

    def _setup_model(self) -> None:
        super()._setup_model()
        self.average = copy.deepcopy(self.policy)

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        modules, variables = super()._get_torch_save_params()
        return [*modules, "average"], variables

    def train(self) -> None:
        """Update the actor once, on the episodes of new balls."""
        optimizer: Any = self.policy.optimizer
        self._update_learning_rate(optimizer)
        for group in optimizer.param_groups:
            group["lr"] *= min(1.0, (self._n_updates + 1) / WARM)
        rng = np.random.default_rng(np.random.randint(2**31))
        frames = LONG if self._n_updates % EVERY == EVERY - 1 else FRAMES
        loss = self.episodes(drawn_balls(self.world, rng, self.balls, frames), rng)
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self.policy.parameters(), self.max_grad_norm)
        optimizer.step()
        self._n_updates += 1
        with torch.no_grad():
            share = 1.0 / min(self._n_updates + 1, AVERAGED)
            for mean, new in zip(self.average.parameters(), self.policy.parameters(), strict=True):
                mean.lerp_(new, share)
        self.logger.record("train/loss", loss.item())
        self._explore()

    def episodes(self, balls: Balls, rng: np.random.Generator) -> torch.Tensor:
        """Return the mean loss of the episodes with some balls, seen with noise, through which gradients go."""
        world, parts, n = self.world, moving.PARTS, len(balls.rolls)
        frames = (balls.rolls.shape[1] - 1) // parts
        observed = self._observed(balls, rng, frames)
        nominal = {"speed": float(world.speed_limit), "acceleration": float(world.acceleration_limit)}
        strength = torch.as_tensor(world.strength[self._worlds(n)], dtype=torch.float32)
        # a share of one as a tensor would round the limits
        limits: dict[str, Any] = nominal if (strength == 1.0).all() else {k: strength * v for k, v in nominal.items()}
        q = torch.as_tensor(world.home, dtype=torch.float32).expand(n, 6)
        v, tip = torch.zeros(n, 6), world.chain.fk(q)[:, :3, 3]
        least = table_top(world.arm) + CLEARANCE
        feelers, (low, high) = torch.tensor(GRIPPER, dtype=torch.float32), self._bounds()
        tips, depths, folds = [], [], []
        for frame in range(frames):
            x = torch.cat(
                [observed[frame][:, : moving.ANGLES.start], q, v, observed[frame][:, moving.ANGLES.start :]], 1
            )
            distribution: Any = self.policy.get_distribution(x)
            target, postures = math.pi * distribution.distribution.mean, []
            for part in range(1, parts + 1):
                q, v = moving.moved(q, v, target, 1.0 / (moving.FRAMES * parts), **limits)
                if part in POSTURES:
                    postures.append(q)
            T = world.chain.fk(torch.cat(postures))
            middle, end = T[:, :3, 3].split(n)
            tips.append(torch.stack([tip, middle, end], 1))
            depths.append(feeler_depth(T, feelers, least).view(len(POSTURES), n).T)
            folds.append(((q - high).clamp(min=0.0) + (low - q).clamp(min=0.0)).sum(1))
            tip = end
        along = (_PARABOLA @ torch.stack(tips, 1)).flatten(1, 2)  # the tip in all parts of all frames
        return self._loss(along, torch.stack(depths, 1), torch.stack(folds, 1), balls)

    def _worlds(self, count: int) -> Ids:
        """Return environments, whose delays, noise and strength the episodes with as many balls have."""
        return np.arange(count) % len(self.world.taken)

    def _observed(self, balls: Balls, rng: np.random.Generator, frames: int) -> list[torch.Tensor]:
        """Return observations without joints, for every frame."""
        world, n = self.world, len(balls.rolls)
        rows = self._worlds(n)
        taken = world.taken[rows, : frames + 1]
        sights = np.full((n, frames + 1, 3), world.height)
        sights[:, :, :2] = balls.rolls[np.arange(n)[:, None], np.minimum(taken, balls.ends[:, None])]
        sights += rng.normal(0.0, world.noise[rows, None, None], sights.shape)
        ages = (np.arange(frames + 1) * moving.PARTS - taken) / (moving.FRAMES * moving.PARTS)
        observed = []
        for frame in range(frames):
            before = np.maximum(frame - np.arange(1, world.options.sights), 0)
            earlier = sights[:, before] - sights[:, [frame]]
            x = np.concatenate([sights[:, frame], ages[:, [frame]], earlier.reshape(n, -1)], axis=1)
            observed.append(torch.as_tensor(x, dtype=torch.float32))
        return observed

    def _bounds(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return angles that joints are to stay between [rad]; those that may turn freely have none."""
        steering: Any = self.policy.features_extractor.steering
        low, high = (torch.as_tensor(bound, dtype=torch.float32) for bound in (steering.low, steering.high))
        free = torch.full((6,), math.inf)
        return torch.where(low > -3.14, low + WITHIN, -free), torch.where(high < 3.14, high - WITHIN, free)

    def _loss(self, tips: torch.Tensor, depths: torch.Tensor, folds: torch.Tensor, balls: Balls) -> torch.Tensor:
        """Return the mean loss of episodes.

        Args:
            tips: In all parts of all frames [m], shape (n, frames * PARTS, 3).
            depths: Of the gripper's points in the table [m], shape (n, frames, len(POSTURES)).
            folds: How near joints are to their bounds [rad], shape (n, frames).
            balls: That they are to meet.
        """
        left, parts = 1.0 - self.progress, tips.shape[1]
        places = torch.as_tensor(balls.rolls[:, 1:], dtype=torch.float32)
        away = (tips[:, :, :2] - places).square().sum(2) + (tips[:, :, 2] - self.world.height).square()
        distances = (away + 1e-8).sqrt()
        time = torch.arange(parts)
        distances = torch.where(time >= torch.as_tensor(balls.ends)[:, None], GONE, distances)
        hit = distances.detach() <= moving.TOUCH
        first = torch.where(hit.any(1), hit.float().argmax(1), parts)[:, None]
        seen = torch.where(time <= first + BEYOND, distances, GONE)
        width = SOFT * left + LEAST_SOFT
        soft = width * (math.log(moving.PARTS) - torch.logsumexp(-seen / width, 1))
        least = seen.min(1).values
        mean = torch.where(seen < GONE - 1.0, seen, 0.0).sum(1) / parts
        missed = 0.5 * (least + 0.003).log() + 0.5 * (soft.clamp(min=0.0) + 0.01).log() + 2.0 * left * mean
        touch = TOUCH * torch.sigmoid((NEAR - least) / WIDTH)
        before = (torch.arange(depths.shape[1]) * moving.PARTS <= first).float()
        depth = (depths.sum(2) * before).sum(1) * (moving.PARTS / len(POSTURES))
        deep = DEEP * torch.log1p(depth / DEPTH_SCALE) + DEPTH * depth.clamp(max=1.0)
        clear = min(1.0, 0.2 + self.progress / 0.3) * (deep + FOLDED * (folds * before).sum(1))
        return (missed - touch + clear).mean()


def _parabolas() -> torch.Tensor:
    """Return weights of the places at the beginning, in the middle and at the end of a frame, for its parts."""
    s = np.arange(1, moving.PARTS + 1) / moving.PARTS
    return torch.tensor(np.column_stack([(2 * s - 1) * (s - 1), 4 * s * (1 - s), s * (2 * s - 1)]), dtype=torch.float32)


_PARABOLA = _parabolas()
