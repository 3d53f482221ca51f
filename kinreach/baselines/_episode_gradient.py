"""Gradient descent on whole episodes with a rolling ball, through the motion of the arm.

Every update draws new balls and plays their episodes with the actor's mean actions. The arm's motion is differentiable,
so the gradient of what happens in an episode goes back through all its frames (backpropagation through time, as in
short-horizon learning with differentiable simulators: Xu et al. 2022, arXiv:2204.07137). What is made small is the
least distance of tip and ball. It looks `BEYOND` the first touch: a loss that ends there teaches to graze the ball.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import torch

from kinreach._checks import Floats
from kinreach.baselines._averaged import AveragedActor
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
#: Updates in which the learning rate grows.
WARM = 20
#: Of float32, below which two speeds are the same.
EPS = 1e-5


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
    half = np.array(
        [kinds[i % len(kinds)](rng, speed, world.rolling(speed, times), *inside) for i, speed in enumerate(speeds)]
    )
    mirrored = half * [1.0, -1.0] + [0.0, low[1] + high[1]]
    rolls = np.concatenate([half, mirrored])[:count]
    return Balls(rolls, moving.last_part(rolls, world.area))


class EpisodeGradient(AveragedActor, SimulatorGradient):
    """Analytic gradient of whole episodes with a rolling ball.

    Args:
        balls: In an update.
    """

    world: moving.MovingEpisodes

    def __init__(self, *args: Any, balls: int, **kwargs: Any) -> None:
        self.balls = balls
        super().__init__(*args, **kwargs)

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
        self._average()
        self.logger.record("train/loss", loss.item())
        self._explore()

    def episodes(self, balls: Balls, rng: np.random.Generator) -> torch.Tensor:
        """Return the mean loss of the episodes with some balls, seen with noise, through which gradients go."""
        world, parts, n = self.world, moving.PARTS, len(balls.rolls)
        frames = (balls.rolls.shape[1] - 1) // parts
        observed = self._observed(balls, rng, frames)
        nominal = {"speed": float(world.speed_limit), "acceleration": float(world.acceleration_limit)}
        strength = world.strength[self._worlds(n)].astype(np.float32)
        # a share of one as an array would round the limits
        limits: dict[str, Any] = nominal if (strength == 1.0).all() else {k: strength * v for k, v in nominal.items()}
        q = torch.as_tensor(world.home, dtype=torch.float32).expand(n, 6)
        v, tip = torch.zeros(n, 6), world.chain.fk(q)[:, :3, 3]
        least = table_top(world.arm) + CLEARANCE
        feelers, (low, high) = torch.tensor(GRIPPER, dtype=torch.float32), self._bounds()
        postures, folds = [], []
        for frame in range(frames):
            x = torch.cat(
                [observed[frame][:, : moving.ANGLES.start], q, v, observed[frame][:, moving.ANGLES.start :]], 1
            )
            target = math.pi * self.policy.means(x)  # type: ignore[operator]
            middle, q, v = _Moved.apply(q, v, target, limits)  # type: ignore[no-untyped-call]
            postures += [middle, q]
            folds.append(((q - high).clamp(min=0.0) + (low - q).clamp(min=0.0)).sum(1))
        T = world.chain.fk(torch.stack(postures, 1).flatten(0, 1))
        depths = feeler_depth(T, feelers, least).view(n, frames, len(POSTURES))
        tips = torch.cat([tip[:, None], T[:, :3, 3].view(n, -1, 3)], 1)
        thirds = torch.stack([tips[:, :-2:2], tips[:, 1:-1:2], tips[:, 2::2]], 2)
        along = (_PARABOLA @ thirds).flatten(1, 2)  # the tip in all parts of all frames
        return self._loss(along, depths, torch.stack(folds, 1), balls)

    def _worlds(self, count: int) -> Ids:
        """Return environments, whose delays, noise and strength the episodes with as many balls have."""
        return np.arange(count) % len(self.world.due)

    def _observed(self, balls: Balls, rng: np.random.Generator, frames: int) -> list[torch.Tensor]:
        """Return observations without joints, for every frame."""
        world, n = self.world, len(balls.rolls)
        rows = self._worlds(n)
        rolls = np.dstack([balls.rolls, np.full(balls.rolls.shape[:2], world.height)])
        due, noise = world.due[rows, : frames + 1], world.noise[rows, None, None]
        sights, taken = world.seen(rng, due, rolls, balls.ends, noise)
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


class _Moved(torch.autograd.Function):
    """`moving.moved` for all parts of a frame, with its gradient by hand: three times as fast.

    From angles, speeds and targets, shape (n, 6), and the limits, to the angles in the middle of the frame, and the
    angles and speeds at its end.
    """

    @staticmethod
    def forward(ctx: Any, *state: Any) -> Any:
        q, v, target = (part.detach().numpy() for part in state[:3])
        dt, acceleration = 1.0 / (moving.FRAMES * moving.PARTS), state[3]["acceleration"]
        brake, passed, ctx.slopes = acceleration * dt, [], []
        for _ in range(moving.PARTS):
            way, before = target - q, v
            q, v = moving.moved(q, v, target, dt, **state[3])
            # of the speed by the way: none where the joint accelerates as it can, or is as fast as it may be
            free = np.abs(v - before) < (1.0 - EPS) * brake
            slope = np.where(np.abs(way) < 0.5 * brake * dt, 1.0 / dt, acceleration / (np.abs(v) + brake / 2.0))
            ctx.slopes.append((free, np.where(free & (np.abs(v) < (1.0 - EPS) * state[3]["speed"]), slope, 0.0)))
            passed.append(q)
        ctx.dt = dt
        return *(torch.from_numpy(passed[part - 1]) for part in POSTURES), torch.from_numpy(v)

    @staticmethod
    def backward(ctx: Any, *grads: Any) -> Any:
        middle, by_q, by_v = (grad.numpy() for grad in grads)
        by_target = np.zeros_like(by_q)
        for part in range(moving.PARTS, 0, -1):
            if part == POSTURES[0]:
                by_q = by_q + middle
            free, slope = ctx.slopes[part - 1]
            by_v = by_v + ctx.dt * by_q
            along = slope * by_v
            by_q, by_v, by_target = by_q - along, np.where(free, 0.0, by_v), by_target + along
        return *(torch.from_numpy(np.asarray(by, np.float32)) for by in (by_q, by_v, by_target)), None


def _parabolas() -> torch.Tensor:
    """Return weights of the places at the beginning, in the middle and at the end of a frame, for its parts."""
    s = np.arange(1, moving.PARTS + 1) / moving.PARTS
    return torch.tensor(np.column_stack([(2 * s - 1) * (s - 1), 4 * s * (1 - s), s * (2 * s - 1)]), dtype=torch.float32)


_PARABOLA = _parabolas()
