"""Several seeds of a recipe: each is what `train` makes of it, and goes on where it stopped."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from kinreach._jobs import Serial
from kinreach.baselines import _seeds as seeds
from kinreach.baselines import register_recipe, train
from kinreach.baselines._policy_file import POLICY_FILE
from kinreach.errors import InputError
from tests.baselines.small_runs import SMALL, interrupted, small, weights

STEPS = SMALL["ranked-single"]["steps"]
#: The files of a finished run.
FINISHED = {"checkpoint.pt", "curve.csv", "policy.safetensors", "run.json", "tensorboard"}


@pytest.fixture
def recipe(monkeypatch):
    made = replace(small("ranked-single"), name="small-single", segments=3)
    monkeypatch.setattr("kinreach.baselines._recipes.RECIPES", {})
    return register_recipe(made)


def run(recipe, folders, **options):
    shown, notices = [], []
    given = {"steps": None, "resume": False, "fresh": False, "start": None, "threads": 1, "export": False, **options}
    runs = list(seeds.train_seeds(recipe.name, folders, Serial(), **given,
                                  progress=lambda done, planned: shown.append((done, planned)),
                                  notice=notices.append))  # fmt: skip
    return runs, shown, notices


@pytest.mark.slow
def test_each_seed_is_what_train_makes_of_it(recipe, tmp_path):
    folders = {seed: tmp_path / f"seed-{seed}" for seed in (3, 4)}
    runs, shown, notices = run(recipe, folders)
    assert [(each.folder, each.card.seed) for each in runs] == [(folders[3], 3), (folders[4], 4)]
    thirds = [STEPS // 3, 2 * STEPS // 3, STEPS]
    assert shown == [(done, 2 * STEPS) for done in (*thirds, STEPS, *(STEPS + done for done in thirds), 2 * STEPS)]
    assert notices == []
    for seed, folder in folders.items():
        assert {path.name for path in folder.iterdir()} == FINISHED
        alone = train(recipe, tmp_path / "alone" / str(seed), seed=seed).folder
        np.testing.assert_array_equal(weights(folder / "policy.safetensors"), weights(alone / "policy.safetensors"))
        assert (folder / "curve.csv").read_text() == (alone / "curve.csv").read_text()


@pytest.mark.slow
def test_what_is_finished_stays_and_what_was_interrupted_goes_on(recipe, tmp_path):
    folders = {seed: tmp_path / f"seed-{seed}" for seed in (4, 5)}
    interrupted(recipe, folders[4], 1)
    train(recipe, folders[5], seed=5)
    finished = (folders[5] / "run.json").read_text()
    runs, shown, _ = run(recipe, folders, resume=True)
    assert [each.card.seed for each in runs] == [5, 4]  # what needs no training comes first
    assert shown == [(STEPS + done, 2 * STEPS) for done in (2 * STEPS // 3, STEPS, STEPS)]
    assert (folders[5] / "run.json").read_text() == finished
    assert json.loads((folders[4] / "run.json").read_text())["resumed"]
    whole = train(recipe, tmp_path / "whole", seed=4).folder
    np.testing.assert_array_equal(weights(folders[4] / "policy.safetensors"), weights(whole / "policy.safetensors"))
    shutil.copytree(folders[4], folders[5], dirs_exist_ok=True)
    with pytest.raises(InputError):
        run(recipe, {5: folders[5]}, resume=True)  # the run of another seed
    runs, shown, _ = run(recipe, {5: folders[5]}, fresh=True, steps=64)
    assert [each.card.steps for each in runs] == [64]
    assert shown[-1] == (64, 64)


@pytest.mark.slow
def test_finished_seeds_go_on_with_more_steps(recipe, tmp_path):
    folders = {seed: tmp_path / f"seed-{seed}" for seed in (4, 5)}
    run(recipe, folders, start="ranked-single")
    seen = []
    write = seeds._write
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            seeds, "_write", lambda folder, *a, **k: (write(folder, *a, **k), seen.append(set(folder.iterdir())))
        )
        runs, _, _ = run(recipe, folders, start="ranked-single", steps=2 * STEPS, resume=True)
    assert len(seen) == 8
    assert all({"run.json", "policy.safetensors"} <= {path.name for path in there} for there in seen)
    alone = tmp_path / "alone"
    train(recipe, alone, seed=4, start="ranked-single")
    train(recipe, alone, seed=4, start="ranked-single", steps=2 * STEPS, resume=True)
    assert [each.card.recipe["longer_than"] for each in runs] == [[STEPS], [STEPS]]
    np.testing.assert_array_equal(weights(folders[4] / "policy.safetensors"), weights(alone / "policy.safetensors"))


def test_files_of_a_training_come_back_as_they_were(tmp_path, monkeypatch):
    """What marks the run as finished is written last; an earlier run stays until then, or goes at once."""
    rng, compared, written, replacing = np.random.default_rng(0), 0, [], seeds.replacing
    monkeypatch.setattr(seeds, "replacing", lambda path: (written.append(path.name), replacing(path))[1])
    for turn in range(20):
        folder, keep = tmp_path / str(turn), bool(turn % 2)
        folder.mkdir()
        before = {POLICY_FILE: rng.bytes(20), seeds.RUN: rng.bytes(20)}
        seeds._write(folder, before, keep=keep)
        assert written[-1] == seeds.RUN
        parts = {name: rng.bytes(rng.integers(0, 50)) for name in ("notes.csv", "parts/b", "zz")}
        seeds._write(folder, parts, keep=keep)
        assert seeds._contents(folder) == (before | parts if keep else parts)
        done = {seeds.RUN: rng.bytes(20), "zz": rng.bytes(20)}
        seeds._write(folder, done, keep=keep)
        assert written[-1] == seeds.RUN
        assert seeds._contents(folder) == parts | done
        compared += len(parts) + len(done)
    assert compared == 100


def test_refused_seeds_leave_no_folder(recipe, tmp_path):
    with pytest.raises(InputError, match="cannot begin the training of small-single"):
        run(recipe, {seed: tmp_path / "new" / f"seed-{seed}" for seed in (4, 5)}, start="ppo-multi")
    assert list(tmp_path.iterdir()) == []
