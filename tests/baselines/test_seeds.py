"""Several seeds of a recipe: each is what `train` makes of it, and goes on where it stopped."""

import json
import shutil
from dataclasses import replace
from types import SimpleNamespace

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


def test_finished_seeds_come_first_and_the_others_as_an_engine_trains_them(recipe, tmp_path, monkeypatch):
    """What came from a job is written, counted and told at once; the run is yielded when its file came."""
    folders = {seed: tmp_path / f"seed-{seed}" for seed in (3, 4, 5, 6)}
    asked = []

    def kept_run(folder, identity, **how):
        asked.append((folder, identity["seed"], how))
        return f"run of {folder.name}" if folder in (folders[4], folders[6]) or (folder / seeds.RUN).exists() else None

    def trained(function, jobs, *, threads):
        assert (function, threads) == (seeds.train_here, 2)
        assert [(job.name, job.recipe.steps, job.identity["seed"], job.checkpoint) for job in jobs] == [
            (recipe.name, STEPS, seed, content) for seed, content in ((3, b"half"), (5, None))
        ]
        yield 1, seeds.Kept(10, {"a": b"1"}, ("slow",))
        assert seeds._contents(folders[5]) == {"a": b"1"}
        yield 0, seeds.Kept(4, {"b": b"2"}, ())
        assert seeds._contents(folders[3]) == {seeds.CHECKPOINT: b"half", POLICY_FILE: b"old", "b": b"2"}
        yield 1, seeds.Kept(20, {"a": b"1", seeds.RUN: b"{}"}, ("done", "well"))

    monkeypatch.setattr(seeds, "kept_run", kept_run)
    monkeypatch.setattr(seeds, "read_checkpoint", lambda path, identity: asked.append((path.parent, identity["seed"])))
    for seed in (3, 5):
        folders[seed].mkdir()
        (folders[seed] / POLICY_FILE).write_bytes(b"old")  # stays until a training that goes on has a newer one
    (folders[3] / seeds.CHECKPOINT).write_bytes(b"half")
    shown, notices = [], []
    found = list(
        seeds.train_seeds(recipe.name, folders, SimpleNamespace(map=trained), steps=None, resume=True, fresh=False,
                          start=None, threads=2, export=True, notice=notices.append,
                          progress=lambda done, planned: shown.append((done, planned)))
    )  # fmt: skip
    assert found == ["run of seed-4", "run of seed-6", "run of seed-5"]
    assert shown == [(2 * STEPS + done, 4 * STEPS) for done in (10, 14, 24)]
    assert notices == ["slow", "done", "well"]
    how = {"resume": True, "fresh": False, "export": True}
    first = [(folders[3], 3, how), (folders[3], 3), (folders[4], 4, how), (folders[5], 5, how), (folders[6], 6, how)]
    assert asked == [*first, (folders[5], 5, {})]


@pytest.mark.parametrize("checkpoint", [None, b"half"])
def test_a_job_yields_its_files_and_notices_after_each_segment(recipe, monkeypatch, checkpoint):
    job = seeds.Training(recipe.name, recipe, {"seed": 3}, None, True, checkpoint)
    begin = {} if checkpoint is None else {seeds.CHECKPOINT: b"half"}

    def segments(made, folder, identity, *, resume, begins, export, notice):
        assert (made, identity, resume, begins, export) == (recipe, {"seed": 3}, True, None, True)
        assert seeds._contents(folder) == begin
        for steps in (5, 9):
            notice(f"after {steps}")
            (folder / f"file-{steps}").write_bytes(bytes([steps]))
            yield SimpleNamespace(card=SimpleNamespace(steps=steps))
        notice("over")
        (folder / seeds.RUN).write_bytes(b"{}")

    monkeypatch.setattr(seeds, "segments", segments)
    first, second, last = seeds.train_here(job)
    one, both = begin | {"file-5": b"\5"}, begin | {"file-5": b"\5", "file-9": b"\t"}
    assert first == (5, one, ("after 5",))
    assert second == (9, both, ("after 9",))
    assert last == (9, both | {seeds.RUN: b"{}"}, ("over",))


def test_refused_seeds_leave_no_folder(recipe, tmp_path):
    with pytest.raises(InputError, match="cannot begin the training of small-single"):
        run(recipe, {seed: tmp_path / "new" / f"seed-{seed}" for seed in (4, 5)}, start="ppo-multi")
    assert list(tmp_path.iterdir()) == []
