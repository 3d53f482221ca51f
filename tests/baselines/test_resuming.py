"""Runs that repeat themselves, go on where they were interrupted, and are kept when they are finished."""

import json
import os
import pickle
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from kinreach import provenance
from kinreach.baselines import training
from kinreach.baselines.training import finished_run, train
from kinreach.errors import InputError, OutputError
from kinreach.provenance import source_digest
from tests.baselines.small_runs import SMALL, interrupted, small, weights


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    return {name: train(small(name), folder / name, seed=4) for name in SMALL}


@pytest.mark.parametrize("name", SMALL)
def test_the_same_seed_gives_the_same_policy_and_another_seed_another(name, uninterrupted, tmp_path):
    whole = uninterrupted[name].folder
    train(small(name), tmp_path / "again", seed=4)
    train(small(name), tmp_path / "other", seed=5)
    np.testing.assert_array_equal(weights(tmp_path / "again/policy.safetensors"), weights(whole / "policy.safetensors"))
    assert (tmp_path / "again/curve.csv").read_text() == (whole / "curve.csv").read_text()
    assert not np.array_equal(weights(tmp_path / "other/policy.safetensors"), weights(whole / "policy.safetensors"))


@pytest.mark.parametrize("name", SMALL)
@pytest.mark.parametrize("kept", [1, 2])
def test_going_on_gives_what_no_interruption_gives(name, kept, uninterrupted, tmp_path):
    whole = uninterrupted[name].folder
    interrupted(small(name), tmp_path, kept)
    assert (tmp_path / "checkpoint.pt").exists()
    assert not (tmp_path / "policy.safetensors").exists()
    train(small(name), tmp_path, seed=4, resume=True)
    np.testing.assert_array_equal(weights(tmp_path / "policy.safetensors"), weights(whole / "policy.safetensors"))
    assert (tmp_path / "curve.csv").read_text() == (whole / "curve.csv").read_text()
    assert json.loads((tmp_path / "run.json").read_text())["resumed"]
    assert not (tmp_path / "checkpoint.pt").exists()


def test_a_finished_run_is_kept(uninterrupted, tmp_path, monkeypatch):
    finished = uninterrupted["single"]
    before = {path.name: path.read_bytes() for path in finished.folder.iterdir() if path.is_file()}
    with monkeypatch.context() as patch:
        patch.setattr(training, "build", lambda *a, **k: pytest.fail("it trains again"))
        again = train(small("single"), finished.folder, seed=4, resume=True)
    assert {path.name: path.read_bytes() for path in finished.folder.iterdir() if path.is_file()} == before
    assert (again.card.seed, again.cpu_seconds) == (4, finished.cpu_seconds)
    np.testing.assert_allclose(again.policy.act(np.ones((3, 13))), finished.policy.act(np.ones((3, 13))), atol=1e-6)
    for other in ({"seed": 5}, {"seed": 4, "steps": 400}):  # another run is trained, and so is one without a policy
        assert finished_run(finished.folder, {"recipe": {}, "versions": {}, **other}) is None
    shutil.copytree(finished.folder, tmp_path / "run")
    (tmp_path / "run/policy.safetensors").unlink()
    train(small("single"), tmp_path / "run", seed=4, resume=True)
    np.testing.assert_array_equal(
        weights(tmp_path / "run/policy.safetensors"), weights(finished.folder / "policy.safetensors")
    )


def test_a_finished_export_is_kept_and_one_without_it_is_trained_again(tmp_path, monkeypatch):
    recipe = small("single")
    train(recipe, tmp_path, seed=4)
    train(recipe, tmp_path, seed=4, resume=True, export=True)
    before = (tmp_path / "model.zip").read_bytes()
    monkeypatch.setattr(training, "build", lambda *a, **k: pytest.fail("it trains again"))
    train(recipe, tmp_path, seed=4, resume=True, export=True)
    train(recipe, tmp_path, seed=4, resume=True)
    assert (tmp_path / "model.zip").read_bytes() == before


def test_a_new_run_in_an_old_folder_begins_without_the_old_results(tmp_path):
    """Else what reads finished runs would take the policy of one for that of another."""
    recipe = replace(small("single"), trace_after=64)
    train(recipe, tmp_path, seed=4, export=True)
    assert {"run.json", "policy.safetensors", "model.zip", "curve.csv", "episode.csv"} < set(os.listdir(tmp_path))
    interrupted(small("single"), tmp_path, 1)
    assert set(os.listdir(tmp_path)) == {"checkpoint.pt", "curve.csv", "tensorboard"}
    with pytest.raises(InputError, match="other settings"):
        train(small("single"), tmp_path, seed=5, resume=True)
    assert set(os.listdir(tmp_path)) == {"checkpoint.pt", "curve.csv", "tensorboard"}
    (tmp_path / "run.json").mkdir()
    with pytest.raises(OutputError, match=r"run\.json"):
        train(small("single"), tmp_path, seed=5)


def test_going_on_with_other_code_is_said_and_written_down(tmp_path, monkeypatch):
    recipe, said = small("single"), []
    now = source_digest()
    monkeypatch.setattr(provenance, "source_digest", lambda: "0123456789ab")
    interrupted(recipe, tmp_path / "run", 1)
    interrupted_again = tmp_path / "again"
    shutil.copytree(tmp_path / "run", interrupted_again)
    monkeypatch.setattr(provenance, "source_digest", lambda: now)
    train(recipe, tmp_path / "run", seed=4, resume=True, notice=said.append)
    assert len(said) == 1
    assert f"other code of kinreach (0123456789ab, now {now})" in said[0]
    assert json.loads((tmp_path / "run/run.json").read_text())["sources"] == ["0123456789ab", now]
    train(recipe, tmp_path / "run", seed=4, resume=True, notice=pytest.fail)  # it is finished, and kept
    with pytest.warns(UserWarning, match="other code of kinreach") as warned:
        train(recipe, interrupted_again, seed=4, resume=True)
    assert [each.filename for each in warned] == [__file__]
    interrupted(recipe, tmp_path / "same", 2)
    train(recipe, tmp_path / "same", seed=4, resume=True, notice=pytest.fail)
    assert json.loads((tmp_path / "same/run.json").read_text())["sources"] == [now]


def test_torch_has_as_many_threads_after_training_as_before(tmp_path, monkeypatch):
    before, inside = torch.get_num_threads(), []

    def look(*arguments, **options):
        inside.append(torch.get_num_threads())
        if len(inside) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(training, "_train", look)
    train(small("single"), tmp_path, seed=4, threads=before + 1)
    assert torch.get_num_threads() == before
    with pytest.raises(KeyboardInterrupt):
        train(small("single"), tmp_path, seed=4, threads=before + 2)
    assert torch.get_num_threads() == before
    assert inside == [before + 1, before + 2]


def test_a_checkpoint_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    recipe = small("single")
    interrupted(recipe, tmp_path, 1)
    before = (tmp_path / "checkpoint.pt").read_bytes()
    monkeypatch.setattr(Path, "write_bytes", lambda *a: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    with pytest.raises(OutputError, match="No space left"):
        train(recipe, tmp_path, seed=4, resume=True)
    assert (tmp_path / "checkpoint.pt").read_bytes() == before
    assert not [name for name in os.listdir(tmp_path) if name.startswith(".")]


def test_checkpoints_of_other_runs_and_damaged_ones_are_refused(tmp_path):
    recipe = small("single")
    interrupted(recipe, tmp_path, 1)
    path = tmp_path / "checkpoint.pt"
    whole = path.read_bytes()
    for other, seed in ((recipe, 5), (replace(recipe, steps=recipe.steps + 64), 4)):
        with pytest.raises(InputError, match="other settings"):
            train(other, tmp_path, seed=seed, resume=True)
    for content in (b"", whole[: len(whole) // 2], pickle.dumps(Bomb()), b"\0" * 100):
        path.write_bytes(content)
        with pytest.raises(InputError, match="no checkpoint"):
            train(recipe, tmp_path, seed=4, resume=True)
    torch.save({"identity": Bomb()}, path)
    with pytest.raises(InputError, match="no checkpoint"):
        train(recipe, tmp_path, seed=4, resume=True)
    assert not Bomb.executed


def test_what_is_no_archive_is_not_given_to_torch(tmp_path, monkeypatch):
    """It would warn of a plain pickle, and silencing warnings is not for one thread alone."""
    (tmp_path / "checkpoint.pt").write_bytes(pickle.dumps(Bomb()))
    monkeypatch.setattr(torch, "load", lambda *a, **k: pytest.fail("torch reads it"))
    with pytest.raises(InputError, match="no checkpoint"):
        train(small("single"), tmp_path, seed=4, resume=True)


def test_a_checkpoint_sets_only_what_a_checkpoint_has(tmp_path):
    interrupted(small("single"), tmp_path, 1)
    path = tmp_path / "checkpoint.pt"
    state = torch.load(path, weights_only=True)
    torch.save({**state, "counters": {**state["counters"], "train": 1}, "curve": {**state["curve"], "step": 1}}, path)
    train(small("single"), tmp_path, seed=4, resume=True)  # neither of the functions is replaced
    interrupted(small("single"), tmp_path, 1)
    torch.save({**state, "counters": {**state["counters"], "num_timesteps": "many"}}, path)
    with pytest.raises(InputError, match="no checkpoint"):
        train(small("single"), tmp_path, seed=4, resume=True)


class Bomb:
    executed = False

    def __reduce__(self):
        return (Bomb.go_off, ())

    @staticmethod
    def go_off():
        Bomb.executed = True
