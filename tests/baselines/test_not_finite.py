"""Trainings that end in NaN, and folders that somebody else has put something in: one line, nothing lost."""

import os
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from kinreach.baselines import _rewards as rewards
from kinreach.baselines import train
from kinreach.baselines._training import CHECKPOINT, POLICY, RUN
from kinreach.cli import main
from kinreach.errors import OutputError, TrainingError
from tests.baselines.small_runs import small
from tests.cases import slow


def spoilt_after(calls, value):
    """A reward that is a number so many times."""
    count = 0

    def reward(given, info):
        nonlocal count
        count += 1
        seen = np.array(given)
        if count > calls:
            seen[0] = value
        return seen

    return reward


@pytest.mark.parametrize(
    ("name", "value"), [*slow(("ppo-multi", np.nan), ("sac-single", np.nan)), ("ranked-single", np.inf)]
)
def test_a_reward_that_is_no_number_is_named_and_the_last_checkpoint_kept(name, value, tmp_path, monkeypatch):
    recipe = replace(small(name), reward="spoilt")
    steps = recipe.steps // recipe.num_envs
    monkeypatch.setitem(rewards.REWARDS, "spoilt", spoilt_after(steps // 2, value))
    with pytest.raises(
        TrainingError, match=rf"the training reward became {value} after \d+ actions; the last checkpoint"
    ):
        train(recipe, tmp_path, seed=4)
    assert (tmp_path / CHECKPOINT).is_file()
    assert not (tmp_path / POLICY).exists()
    assert not (tmp_path / RUN).exists()
    monkeypatch.setitem(rewards.REWARDS, "spoilt", spoilt_after(10**9, value))
    resumed = train(recipe, tmp_path, seed=4, resume=True)
    whole = train(recipe, tmp_path / "whole", seed=4)
    for (one, _), (other, _) in zip(resumed.policy.network.layers, whole.policy.network.layers, strict=True):
        np.testing.assert_array_equal(one, other)


def lacking(given, info):
    return info["nothing"]


@pytest.mark.parametrize("name", ["ppo-multi", "ranked-single"])
@pytest.mark.parametrize(
    ("reward", "said"),
    [
        (lacking, r"the training reward failed: KeyError: 'nothing' \(test_not_finite\.py, line \d+\) after 0 actions"),
        (lambda given, info: 0.0, r"the training reward must have shape \(\d+,\), got \(\) after 0 actions"),
        (lambda given, info: given[:, None], r"must have shape \(\d+,\), got \(\d+, 1\)"),
    ],
)
def test_a_reward_that_fails_or_has_another_shape_is_named(name, reward, said, tmp_path, monkeypatch):
    monkeypatch.setitem(rewards.REWARDS, "mine", reward)
    with pytest.raises(TrainingError, match=said):
        train(replace(small(name), reward="mine"), tmp_path, seed=4)


def test_before_the_first_checkpoint_there_is_none(tmp_path, monkeypatch):
    monkeypatch.setitem(rewards.REWARDS, "spoilt", spoilt_after(0, np.nan))
    with pytest.raises(TrainingError, match="there is no checkpoint yet"):
        train(replace(small("ppo-multi"), reward="spoilt"), tmp_path, seed=4)


@pytest.mark.parametrize("name", ["ppo-multi", "sac-single"])
def test_a_loss_or_a_weight_that_is_no_number_is_named(name, tmp_path, monkeypatch):
    monkeypatch.setitem(rewards.REWARDS, "spoilt", spoilt_after(0, 1e38))  # finite; its square is not
    said = r"(loss became (inf|nan)|the network's \w.* became NaN or infinite) after \d+ actions"
    with pytest.raises(TrainingError, match=said):
        train(replace(small(name), reward="spoilt"), tmp_path, seed=4)


@pytest.mark.parametrize("kind", ["file", "FIFO", "link to nothing"])
def test_a_foreign_tensorboard_is_refused_and_stays(kind, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "out" / "ranked-single" / "seed-0"
    folder.mkdir(parents=True)
    path = folder / "tensorboard"
    {"file": lambda: path.write_text("mine"), "FIFO": lambda: os.mkfifo(path),
     "link to nothing": lambda: path.symlink_to("/proc/nowhere/at/all")}[kind]()  # fmt: skip
    before = os.lstat(path)[:7]  # without times: a link that is followed has been read
    assert main(["train", "ranked-single", "--steps", "64", "--out", "out"]) == 2
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1
    assert "tensorboard" in said
    assert os.lstat(path)[:7] == before
    assert [entry.name for entry in folder.iterdir()] == ["tensorboard"]
    with pytest.raises(OutputError, match="tensorboard"):
        train(small("ranked-single"), folder)
