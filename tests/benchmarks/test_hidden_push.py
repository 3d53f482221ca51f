"""Pushing past a strip that no camera sees: the world, the expert that sees all, and a simulation as memory."""

from contextlib import closing
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

pytest.importorskip("stable_baselines3")
from benchmarks.learners import hidden_push, imitated_hidden_push
from benchmarks.learners.hidden_push import ID, OBJECT, STRIP
from benchmarks.studies import hidden_push as study
from kinreach.baselines import evaluate, load_policy, train
from kinreach.baselines._models import build
from kinreach.baselines.inside import PushScript
from kinreach.errors import InputError

Y = OBJECT.start + 1
SMALL = replace(
    imitated_hidden_push,
    num_envs=8,
    steps=400,
    segments=1,
    window=400,
    settings={**imitated_hidden_push.settings, "batch_size": 100, "updates": 5},
)


def batch_of(count, **options):
    return closing(gym.make_vec(ID, count, "vector_entry_point", dtype="float64", **options))


def test_cubes_begin_beside_the_strip_and_goals_lie_in_it_or_across():
    with batch_of(300) as batch:
        seen, _ = batch.reset(seed=1)
        np.testing.assert_array_equal(seen, batch.episodes.whole())
    places, goals = seen[:, OBJECT][:, :2], seen[:, 19:21]
    assert (np.abs(places[:, 1]) >= STRIP / 2.0).all()
    ahead = -np.sign(places[:, 1]) * goals[:, 1]
    assert (ahead > -STRIP / 2.0).all()
    assert 20 < (ahead > STRIP / 2.0).sum() < 100
    ways = np.linalg.norm(goals - places, axis=1)
    assert (ways >= 0.06).all()
    assert (ways <= 0.20).all()


def test_in_the_strip_the_cube_is_reported_as_it_was_last_seen():
    hidden = returned = 0
    with batch_of(16) as batch:
        script = PushScript(gym.make(ID))
        seen, _ = batch.reset(seed=2)
        last = np.array(seen[:, OBJECT])
        for _ in range(150):
            seen, _, terminated, truncated, _ = batch.step(script.act(batch.episodes.whole()))
            whole = batch.episodes.whole()
            visible = np.abs(whole[:, Y]) >= STRIP / 2.0
            np.testing.assert_array_equal(seen[visible], whole[visible])
            over = terminated | truncated
            stale = ~visible & ~over
            np.testing.assert_array_equal(seen[stale][:, OBJECT], last[stale])
            others = [k for k in range(22) if not OBJECT.start <= k < OBJECT.stop]
            np.testing.assert_array_equal(seen[:, others], whole[:, others])
            hidden, returned = hidden + int(stale.sum()), returned + int(over.sum())
            last = np.array(seen[:, OBJECT])
    assert hidden > 300
    assert returned > 8


def test_one_environment_is_as_one_of_a_batch():
    env, steps = gym.make(ID, dtype="float64"), 0
    check_env(gym.make(ID).unwrapped, skip_render_check=True)
    rng = np.random.default_rng(3)
    with batch_of(2) as batch:
        both, _ = batch.reset(seed=4)
        one, _ = env.reset(seed=4)
        for _ in range(30):
            np.testing.assert_allclose(one, both[0], atol=1e-12)
            actions = rng.uniform(-1.0, 1.0, (2, 6))
            both, *_ = batch.step(actions)
            one, _, terminated, truncated, _ = env.step(actions[0])
            steps += 1
            if terminated or truncated:
                break
    assert steps > 5


def test_the_expert_answers_what_it_would_if_it_saw_all():
    trainee, script, different = build(SMALL, 0, steps=800), PushScript(gym.make(ID)), 0
    env = trainee.env
    env.seed(5)
    env.reset()
    for _ in range(120):
        whole = env._env.unwrapped.episodes.whole()
        observed = np.array(env._now)
        np.testing.assert_allclose(env._answers(), np.clip(script.act(whole), -1.0, 1.0), atol=1e-5)
        np.testing.assert_array_equal(env._now, observed)
        different += int((np.abs(observed - whole).max(axis=1) > 1e-3).sum())
        env.step(env._answers())
    assert different > 100  # rows in which it sees more
    env.close()


def test_with_the_true_friction_a_simulation_knows_where_the_cube_is():
    compared = hidden = reached = 0
    with closing(gym.make(ID, dtype="float64")) as env:
        method = study.Simulated(env)
        for seed in range(6):
            observed, info = env.reset(seed=seed)
            method.reset(observed, info)
            over = False
            while not over:
                observed, _, terminated, truncated, info = env.step(method.act(observed))
                over = terminated or truncated
                place = info["position"]
                np.testing.assert_allclose(method._now[OBJECT][:3], place, atol=2e-3)
                compared, hidden = compared + 1, hidden + (abs(place[1]) < STRIP / 2.0)
            reached += info["reached"]
    assert reached == 6
    assert compared > 300
    assert hidden > 60


def test_the_study_keeps_its_cells(tmp_path, capsys, monkeypatch):
    train(SMALL, tmp_path / "runs/seed-0")
    arguments = [str(tmp_path / "runs"), "--frictions", "0.25", "--episodes", "3", "--out", str(tmp_path / "cells")]
    assert study.main(arguments) == 0
    table = capsys.readouterr().out
    names = [row.split("|")[1].strip(" `") for row in table.splitlines() if row.startswith("| `")]
    assert names == ["script", "simulated", "told", "imitated-hidden-push"]
    monkeypatch.setattr(study, "rollout", None)
    monkeypatch.setattr(study, "evaluate", None)
    assert study.main(arguments) == 0
    assert capsys.readouterr().out == table
    with pytest.raises(InputError, match="no finished trainings"):
        study.main([str(tmp_path / "nothing")])


def test_a_policy_of_it_is_played_by_its_own_name(tmp_path):
    train(SMALL, tmp_path)
    policy = load_policy(tmp_path / "policy.safetensors")
    assert policy.card.environment == hidden_push.WORLD
    assert len(evaluate(policy, goals=4).trials) == 4
