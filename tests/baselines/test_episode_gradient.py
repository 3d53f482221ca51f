"""The gradient of whole episodes: they are those of the environment, and what is made small becomes smaller."""

import io
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
import torch
from stable_baselines3.common.logger import configure
from stable_baselines3.common.save_util import load_from_zip_file

from kinreach.baselines import _episode_gradient, get_recipe, train
from kinreach.baselines._episode_gradient import Balls, drawn_balls
from kinreach.baselines._models import build
from kinreach.baselines._sb3_export import averaged_actor
from kinreach.envs import moving
from kinreach.errors import InputError

RECIPE = get_recipe("gradient-moving-clear")
SMALL = replace(RECIPE, num_envs=4, window=40, segments=2, settings={**RECIPE.settings, "balls": 12, "batch_size": 4})


@pytest.fixture(scope="module")
def trainee():
    built = build(SMALL, 0, steps=400)
    yield built
    built.env.close()


def test_balls_are_those_of_the_environment(trainee):
    """Of every kind, over the table from the beginning, each with its mirror image, gone when they leave the table."""
    world, rng = trainee.model.world, np.random.default_rng(3)
    balls = drawn_balls(world, rng, 60, 30)
    low, high = world.area
    assert balls.rolls.shape == (60, 30 * moving.PARTS + 1, 2)
    np.testing.assert_allclose(balls.rolls[30:, :, 0], balls.rolls[:30, :, 0])
    np.testing.assert_allclose(balls.rolls[30:, :, 1], -balls.rolls[:30, :, 1])
    starts, steps = balls.rolls[:, 0], np.diff(balls.rolls, axis=1) * moving.FRAMES * moving.PARTS
    assert (starts >= low + moving.INSIDE - 1e-9).all()
    assert (starts <= high - moving.INSIDE + 1e-9).all()
    speeds = np.linalg.norm(steps, axis=2)
    np.testing.assert_allclose(speeds, speeds[:, :1] * np.ones(speeds.shape[1]), rtol=5e-3)
    assert 0.14 < speeds.min() < 0.3 < 1.0 < speeds.max() < 1.26
    straight = np.abs(np.diff(steps, axis=1)).max(axis=(1, 2)) < 1e-9
    assert straight.sum() == len(straight) / len(moving.PATHS)
    left = 0
    for roll, end in zip(balls.rolls, balls.ends, strict=True):
        inside = ((roll >= low) & (roll <= high)).all(axis=1)
        assert inside[:end].all()
        left += int(end < len(roll) - 1)
        assert end == len(roll) - 1 or not inside[end]
    assert 10 < left < 60


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"randomise": {"noise": (0, 1e-3), "delay": (0, 0.2), "strength": (0.5, 1)}},
        {"hidden": 0.2},
        {"outliers": 0.2, "dropped": 0.2, "friction": 0.3},
    ],
)
def test_an_episode_is_that_of_the_environment(trainee, monkeypatch, options):
    """By the exported actor in `kinreach/Moving-v0` with the same balls and sights: frames lead to the same tips.

    Each from the state before it: single precision comes apart over an episode, where a joint just brakes or not.
    """
    model, rng, count = trainee.model, np.random.default_rng(0), 12
    world = moving.MovingEpisodes(replace(model.world.options, collisions=False, **options), count)
    world.begin(np.arange(count))
    monkeypatch.setattr(model, "world", world)
    balls = drawn_balls(world, rng, count, 30)
    played, states = {}, []
    moved = _episode_gradient._Moved.apply

    def recorded(q, v, *others):
        states.append((q.detach().numpy(), v.detach().numpy()))
        return moved(q, v, *others)

    monkeypatch.setattr(_episode_gradient, "_Moved", SimpleNamespace(apply=recorded))
    monkeypatch.setattr(model, "_loss", lambda tips, *others: played.setdefault("tips", tips).sum())
    model.episodes(balls, np.random.default_rng(5))
    actor = averaged_actor(model)
    world.rolls[:, : balls.rolls.shape[1], :2] = balls.rolls
    rolls = np.dstack([balls.rolls, np.full(balls.rolls.shape[:2], world.height)])
    rng, noise = np.random.default_rng(5), world.noise[:, None, None]
    world._sights[:, :31], world._taken[:, :31] = world.seen(rng, world.due[:, :31], rolls, balls.ends, noise)
    for frame, (q, v) in enumerate(states):
        world.q[:], world.v[:] = q, v
        world.step(np.clip(actor(world.observe()), -1.0, 1.0))
        tip = world.chain.positions(world.q)
        found = played["tips"][:, (frame + 1) * moving.PARTS - 1].detach().numpy()
        np.testing.assert_allclose(found, tip, atol=1e-5)
    assert frame == 29
    assert np.abs(world.q - world.home).max() > 0.05


def test_the_average_is_in_the_saved_model(trainee):
    """A training that goes on from it exports what it would have exported."""
    saved, compared = io.BytesIO(), 0
    trainee.model.save(saved)
    _, parts, _ = load_from_zip_file(saved, device="cpu")
    for name, weight in trainee.model.average.state_dict().items():
        torch.testing.assert_close(parts["average"][name], weight, rtol=0, atol=0)
        compared += weight.numel()
    assert compared > 1000
    assert set(parts["average"]) == set(parts["policy"])


def test_touching_and_staying_clear_cost_less(trainee):
    """Nearer tips, gripper points above the table and joints within their bounds have the smaller loss."""
    model, parts = trainee.model, 30 * moving.PARTS
    balls = Balls(np.tile([0.5, 0.1], (2, parts + 1, 1)), np.array([parts, parts]))
    clear, free = torch.zeros(2, 30, 2), torch.zeros(2, 30)

    def loss(away, depths=clear, folds=free):
        tips = torch.tensor([0.5 + away, 0.1, model.world.height]).expand(2, parts, 3)
        return float(model._loss(tips, depths, folds, balls))

    losses = [loss(away) for away in (0.001, 0.004, 0.009, 0.02, 0.1, 0.4)]
    assert losses == sorted(losses)
    assert loss(0.02, depths=clear + 0.002) > loss(0.02) + 0.01
    assert loss(0.02, folds=free + 0.1) > loss(0.02) + 0.01


def test_a_graze_is_worse_than_a_meeting(trainee):
    """A tip that goes on nearer after the first touch costs less than one that turns away there."""
    model, parts = trainee.model, 30 * moving.PARTS
    balls = Balls(np.tile([0.5, 0.1], (1, parts + 1, 1)), np.array([parts]))
    away = torch.full((2, parts), 0.02)
    away[:, 100] = 0.0099
    away[1, 101:108] = 0.002
    tips = torch.stack([0.5 + away, torch.full_like(away, 0.1), torch.full_like(away, model.world.height)], 2)
    grazing, meeting = (float(model._loss(one[None], torch.zeros(1, 30, 2), torch.zeros(1, 30), balls)) for one in tips)
    assert meeting < grazing - 0.3


@pytest.mark.slow
def test_a_resumed_training_is_the_same(tmp_path):
    recipe = replace(SMALL, steps=48, settings={**SMALL.settings, "balls": 4})
    whole = train(recipe, tmp_path / "whole", seed=1)

    class StopError(Exception):
        pass

    def stop(done, planned, row):
        if done > 30:
            raise StopError

    with pytest.raises(StopError):
        train(recipe, tmp_path / "parts", seed=1, progress=stop)
    again = train(recipe, tmp_path / "parts", seed=1, resume=True)
    for layer, other in zip(whole.policy.network.layers, again.policy.network.layers, strict=True):
        for part, same in zip(layer, other, strict=True):
            np.testing.assert_array_equal(part, same)


def test_each_update_records_the_loss_of_its_episodes():
    trainee, compared = build(replace(SMALL, settings={**SMALL.settings, "balls": 2}), 0, steps=400), 0
    model = trainee.model
    model.set_logger(configure(None, []))
    for update in range(2):
        np.random.seed(update)
        rng = np.random.default_rng(np.random.randint(2**31))
        with torch.no_grad():
            loss = model.episodes(drawn_balls(model.world, rng, model.balls, _episode_gradient.FRAMES), rng)
        np.random.seed(update)
        model.train()
        assert model.logger.name_to_value["train/loss"] == pytest.approx(loss.item(), rel=1e-6)
        compared += 1
    trainee.env.close()
    assert compared == 2


@pytest.mark.parametrize("weak", [False, True])
def test_a_frame_has_the_gradient_that_torch_finds_for_its_parts(weak):
    """Joints that are steered, that accelerate as they can and that are as fast as they may be, weak arms too."""
    rng, n = np.random.default_rng(7), 3000
    share = rng.uniform(0.5, 1.0, (n, 1)).astype(np.float32) if weak else 1.0
    limits = {"speed": np.pi * share, "acceleration": 10.0 * share}
    q, v = rng.uniform(-1.0, 1.0, (n, 6)), np.pi * share * np.clip(rng.uniform(-1.5, 1.5, (n, 6)), -1.0, 1.0)
    stopping = v * np.abs(v) / (2.0 * 10.0 * share)
    near = stopping + rng.choice([0.0, 1e-4, 1e-2], (n, 6)) * rng.normal(size=(n, 6))
    start = [q, v, q + np.where(rng.random((n, 6)) < 0.7, near, 1.0)]
    weights = torch.as_tensor(rng.normal(size=(3, n, 6)), dtype=torch.float32)
    results = []
    for by_parts in (True, False):
        state = [torch.tensor(part, dtype=torch.float32, requires_grad=True) for part in start]
        if by_parts:
            at, speed, target = state
            bounds = {name: torch.as_tensor(bound) for name, bound in limits.items()}
            passed = []
            for _ in range(moving.PARTS):
                at, speed = moving.moved(at, speed, target, 1.0 / (moving.FRAMES * moving.PARTS), **bounds)
                passed.append(at)
            ends = [passed[moving.PARTS // 2 - 1], at, speed]
        else:
            ends = _episode_gradient._Moved.apply(*state, limits)
        gradients = torch.autograd.grad(
            sum((end * weight).sum() for end, weight in zip(ends, weights, strict=True)), state
        )
        results.append([part.detach().numpy() for part in (*ends, *gradients)])
    steered = np.abs(results[0][5]) > 1e-6
    assert 0.2 < steered.mean() < 0.8
    for theirs, ours in zip(*results, strict=True):
        # where a limit is just met, either side is right
        assert (np.abs(theirs - ours) > 1e-3 * (1.0 + np.abs(theirs))).sum() <= 5


@pytest.mark.slow
def test_the_loss_falls(monkeypatch):
    monkeypatch.setattr(_episode_gradient, "EVERY", 10**9)  # all episodes are equally long
    trainee = build(replace(SMALL, settings={**SMALL.settings, "balls": 32}), 0, steps=400)
    model, losses = trainee.model, []
    model.set_logger(configure(None, []))
    for update in range(100):
        model.num_timesteps = 4 * update
        model.train()
        losses.append(model.logger.name_to_value["train/loss"])
    trainee.env.close()
    assert np.mean(losses[-10:]) < np.mean(losses[:10]) - 0.3


def test_fewer_sights_are_refused():
    with pytest.raises(InputError, match="12 sights or more"):
        build(replace(SMALL, options={"sights": 6}), 0, steps=100)
