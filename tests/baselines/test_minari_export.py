"""The episodes of an evaluation as a Minari dataset, read back by Minari."""

import json
import sys

import gymnasium as gym
import numpy as np
import pytest

from kinreach._registration import SINGLE
from kinreach.baselines import load_policy
from kinreach.baselines._minari_export import record_episodes
from kinreach.cli import main
from kinreach.errors import InputError

GOALS = 4


@pytest.fixture
def minari(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))
    pytest.importorskip("h5py", reason="needs minari and h5py")
    return pytest.importorskip("minari", reason="needs minari and h5py")


@pytest.mark.parametrize("policy", ["ranked-single", "ranked-multi", "button"])
def test_the_dataset_is_the_evaluation(policy, minari, tmp_path):
    arguments = ["evaluate", policy, "--goals", str(GOALS), *(["--backend", "kinematic"] if policy != "button" else [])]
    assert main([*arguments, "--out", str(tmp_path / "plain.json")]) == 0
    assert main([*arguments, "--out", str(tmp_path / "found.json"), "--minari", f"kinreach/{policy}-v0"]) == 0
    plain, found = (
        json.loads((tmp_path / name).read_text())["policies"][policy] for name in ("plain.json", "found.json")
    )
    assert (found["goals"], found["reached"], found["steps"]) == (GOALS, plain["reached"], plain["steps"])
    for name in ("return", "distance_mm"):  # the tips of a batch and of one arm are equal to 1e-10 m
        assert found.get(name) == pytest.approx(plain.get(name), rel=1e-9, abs=1e-7)
    dataset = minari.load_dataset(f"kinreach/{policy}-v0")
    assert dataset.total_episodes == GOALS
    assert dataset.action_space.dtype == (np.int64 if policy == "button" else np.float64)
    episodes = list(dataset.iterate_episodes())
    returns = [episode.rewards.sum() for episode in episodes]
    assert np.mean(returns) == pytest.approx(found["return"]["mean"])
    env = dataset.recover_environment()
    replayed = 0
    for number, episode in enumerate(episodes):
        observation, _ = env.reset(seed=2**41 + number)
        np.testing.assert_array_equal(observation, episode.observations[0])
        for action, reward, after in zip(episode.actions, episode.rewards, episode.observations[1:], strict=True):
            observation, gained, *_ = env.step(action)
            assert gained == reward
            np.testing.assert_array_equal(observation, after)
            replayed += 1
    assert replayed >= GOALS
    assert json.loads(dataset.storage.metadata["description"])["recipe"]["name"]


def test_names_that_cannot_be_are_one_line(minari, capsys):
    play = ["evaluate", "ranked-single", "--goals", "1", "--backend", "kinematic", "--minari"]
    assert main([*play, "one-v0"]) == 0
    assert "\nDataset: one-v0\n" in capsys.readouterr().out
    for name, message in (
        ("one-v0", "already"),
        ("no-version", "such as no-version-v0"),
        ("no version", "Malformed"),
        ("../one-v0", "Malformed"),
    ):
        assert main([*play, name]) == 2
        errors = capsys.readouterr().err
        assert message in errors
        assert errors.count("\n") == 1


@pytest.mark.parametrize("missing", ["minari", "h5py"])
def test_without_the_package_one_line_says_what_to_install(missing, minari, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, missing, None)
    assert main(["evaluate", "ranked-single", "--goals", "1", "--minari", "one-v0"]) == 2
    errors = capsys.readouterr().err
    assert "pip install 'kinreach[minari]'" in errors
    assert errors.count("\n") == 1


def test_progress_is_reported_and_the_environment_closed(minari, closings):
    done, closed = [], closings(gym, "make")
    arguments = {"goals": 2, "seed": 3, "environment": SINGLE}
    record_episodes(
        "two-v0", load_policy("ranked-single"), **arguments, options={"backend": "kinematic"}, progress=done.append
    )
    assert (done, sum(close.call_count for close in closed)) == ([1, 2], 1)
    with pytest.raises(InputError, match="cannot make the environment"):
        record_episodes("two-v1", load_policy("ranked-single"), **arguments, options={"speed": 3})
