"""Ranked PPO whose tries are episodes with the same ball."""

from dataclasses import replace

import numpy as np
import pytest
import torch

pytest.importorskip("stable_baselines3")
from benchmarks.learners import ranked_moving_late
from benchmarks.learners.ranked_episodes import nearness
from kinreach.baselines import train
from kinreach.baselines._models import build
from kinreach.envs import moving

TRIES = 4


def small(**changes):
    settings = {**ranked_moving_late.settings, "tries": TRIES, "n_steps": 12, "batch_size": 64}
    return replace(ranked_moving_late, num_envs=16, settings=settings, window=96, **changes)


def groups(rows):
    return np.asarray(rows).reshape(-1, TRIES, *np.shape(rows)[1:])


def test_a_group_has_one_ball_and_one_set_of_sights():
    env = build(small(), 0, steps=1000).env
    env.seed(1)
    balls = []
    for _ in range(3):
        observed, seen = env.reset(), []
        for _ in range(20):
            seen.append(observed[:, moving.BALL])
            observed, _, over, _ = env.step(np.zeros((16, 6), dtype=np.float32))
            if over.any():
                break
        sights = groups(np.stack(seen, axis=1))
        np.testing.assert_array_equal(sights, np.repeat(sights[:, :1], TRIES, axis=1))
        balls += [tuple(first[0, 0]) for first in sights]
    assert len({*balls}) == 12  # another ball in every group and after every reset
    env.seed(1)
    assert tuple(groups(env.reset()[:, moving.BALL])[0, 0]) == balls[0]
    env.close()


def test_what_an_arm_does_until_it_is_nearest_gets_the_score_of_its_episode(monkeypatch):
    trainee = build(small(), 0, steps=10_000)
    model, told = trainee.model, []
    step = model.env.step_wait

    def watched():
        result = step()
        told.append((np.array(result[1]), np.array(result[2])))
        return result

    monkeypatch.setattr(model.env, "step_wait", watched)
    monkeypatch.setattr(model, "train", lambda: None)
    model.learn(16 * 12)
    rewards, over = (np.array(each) for each in zip(*told[-12:], strict=True))
    ended = np.logical_or.accumulate(np.vstack([np.zeros((1, 16), dtype=bool), over[:-1]]))
    nearest = np.where(ended, np.inf, -rewards)
    frames = nearest.argmin(axis=0) + 1
    found = model._collected
    assert len(found.actions) == frames.sum()
    assert len({*map(len, found)}) == 1
    scores = {round(float(value), 5) for value in found.advantages}
    assert len(scores) >= TRIES
    # in each group the nearest episode has the highest score
    order = np.concatenate([np.flatnonzero(frame < frames) for frame in range(12)])
    by_arm = np.zeros(16)
    for arm, value in zip(order, found.advantages.numpy(), strict=True):
        by_arm[arm] = value
    ranks = groups(nearest.min(axis=0)).argsort(axis=1)
    assert (np.diff(np.take_along_axis(groups(by_arm), ranks, axis=1), axis=1) <= 1e-6).all()
    trainee.env.close()


def test_pairs_of_a_group_have_opposite_noise(monkeypatch):
    trainee = build(small(), 0, steps=10_000)
    model = trainee.model
    monkeypatch.setattr(model, "train", lambda: None)
    model.learn(16 * 12)
    first = model._collected.observations[:16], model._collected.actions[:16]  # all arms, in the first frame
    with torch.no_grad():
        means = model.policy.get_distribution(first[0]).distribution.mean
    noise = (first[1] - means).reshape(8, 2, 6)
    assert (noise.abs() > 1e-4).float().mean() > 0.9
    torch.testing.assert_close(noise[:, 0], -noise[:, 1], atol=1e-6, rtol=0.0)
    trainee.env.close()


def test_nearness_is_that_of_the_episode_so_far():
    np.testing.assert_array_equal(nearness(np.zeros(2), {"distance": [0.5, 0.01]}), [-0.5, -0.01])


def test_a_training_is_repeatable(tmp_path):
    recipe = small(steps=16 * 12 * 3, segments=1)
    one, two = (train(recipe, tmp_path / name, seed=3).policy.network for name in "ab")
    for (weights, biases), (others, other) in zip(one.layers, two.layers, strict=True):
        np.testing.assert_array_equal(weights, others)
        np.testing.assert_array_equal(biases, other)
