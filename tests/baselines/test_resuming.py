"""Runs that repeat themselves, go on where they were interrupted, and are kept when they are finished."""

import io
import json
import os
import pickle
import re
import shutil
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import torch

from kinreach import _provenance as provenance
from kinreach._provenance import source_digest
from kinreach.baselines import _training as training
from kinreach.baselines import get_recipe, train
from kinreach.errors import InputError, OutputError
from tests.baselines.small_runs import SMALL, interrupted, small, weights
from tests.cases import slow


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    return {name: train(small(name), folder / name, seed=4) for name in SMALL}


@pytest.mark.slow
def test_another_seed_gives_another_policy(uninterrupted, tmp_path):
    other = train(small("ranked-single"), tmp_path, seed=5)
    assert not np.array_equal(
        *(weights(run.folder / "policy.safetensors") for run in (uninterrupted["ranked-single"], other))
    )


@pytest.mark.parametrize("name", ["ranked-single", *slow(*(name for name in SMALL if name != "ranked-single"))])
def test_the_same_seed_gives_the_same_policy(name, uninterrupted, tmp_path):
    whole = uninterrupted[name].folder
    train(small(name), tmp_path / "again", seed=4)
    np.testing.assert_array_equal(weights(tmp_path / "again/policy.safetensors"), weights(whole / "policy.safetensors"))
    assert (tmp_path / "again/curve.csv").read_text() == (whole / "curve.csv").read_text()


@pytest.mark.parametrize(("name", "kept"), [*((name, 1) for name in SMALL), ("ranked-single", 2)])
@pytest.mark.slow
def test_going_on_gives_what_no_interruption_gives(name, kept, uninterrupted, tmp_path):
    whole = uninterrupted[name].folder
    interrupted(small(name), tmp_path, kept)
    assert (tmp_path / "checkpoint.pt").exists()
    assert not (tmp_path / "policy.safetensors").exists()
    train(small(name), tmp_path, seed=4, resume=True)
    np.testing.assert_array_equal(weights(tmp_path / "policy.safetensors"), weights(whole / "policy.safetensors"))
    assert (tmp_path / "curve.csv").read_text() == (whole / "curve.csv").read_text()
    assert json.loads((tmp_path / "run.json").read_text())["resumed"]


def test_a_run_that_died_after_its_last_segment_is_finished_without_another(uninterrupted, tmp_path, monkeypatch):
    def die(*arguments):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(training, "save_policy", die)
        with pytest.raises(KeyboardInterrupt):
            train(small("ranked-single"), tmp_path, seed=4)
    (tmp_path / "curve.csv").unlink()
    train(small("ranked-single"), tmp_path, seed=4, resume=True, progress=lambda *row: pytest.fail("it trains again"))
    for name in ("policy.safetensors", "curve.csv"):
        assert (tmp_path / name).read_bytes() == (uninterrupted["ranked-single"].folder / name).read_bytes()


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_a_finished_run_is_kept(uninterrupted, tmp_path, monkeypatch):
    finished = uninterrupted["ranked-single"]
    before = contents(finished.folder)
    with monkeypatch.context() as patch:
        patch.setattr(training, "build", lambda *a, **k: pytest.fail("it trains again"))
        again = train(small("ranked-single"), finished.folder, seed=4, resume=True)
    assert contents(finished.folder) == before
    assert (again.card.seed, again.cpu_seconds) == (4, finished.cpu_seconds)
    np.testing.assert_allclose(again.policy.act(np.ones((3, 13))), finished.policy.act(np.ones((3, 13))), atol=1e-6)
    shutil.copytree(finished.folder, tmp_path / "run")
    (tmp_path / "run/policy.safetensors").unlink()  # one without a policy is not finished
    train(small("ranked-single"), tmp_path / "run", seed=4, resume=True)
    np.testing.assert_array_equal(
        weights(tmp_path / "run/policy.safetensors"), weights(finished.folder / "policy.safetensors")
    )


@pytest.mark.parametrize("files", list(product((False, True), repeat=3)))
def test_a_finished_run_is_a_policy_without_a_training_to_go_on_with(files, tmp_path):
    """A policy beside a checkpoint and no run was written by a training that was stopped before its run's file."""
    for name, there in zip((training.POLICY, training.RUN, training.CHECKPOINT), files, strict=True):
        if there:
            (tmp_path / name).write_text('{"seconds": 1.0, "cpu_seconds": 1.0}')
    policy, run, checkpoint = files
    if policy and not run and not checkpoint:
        with pytest.raises(InputError, match="holds a policy, and no"):
            training._holds(tmp_path, {}, resume=True)
    else:
        assert training._holds(tmp_path, {}, resume=True) == (policy and run)


def with_other_numpy(folder):
    run = json.loads((folder / "run.json").read_text())
    (folder / "run.json").write_text(json.dumps({**run, "versions": {**run["versions"], "numpy": "2.3.4"}}))


def with_damage(folder):
    (folder / "run.json").write_text("{")


@pytest.mark.parametrize(
    ("change", "options", "message"),
    [
        (None, {"steps": 400}, "recipe.steps 768, not 400"),
        (None, {"steps": 900, "seed": 5}, "recipe.steps 768, not 900; seed 4, not 5"),
        (None, {"start": "ranked-single"}, "start None, not 'ranked-single "),
        (None, {"seed": 5}, "seed 4, not 5"),
        (None, {"threads": 2}, "threads 1, not 2"),
        (None, {"export": True}, "without model.zip"),
        (with_other_numpy, {}, f"versions.numpy '2.3.4', not '{np.__version__}'"),
        (with_damage, {}, "no run.json with its recipe and seed"),
    ],
)
def test_another_finished_run_is_not_touched(change, options, message, uninterrupted, tmp_path, monkeypatch):
    folder = tmp_path / "run"
    shutil.copytree(uninterrupted["ranked-single"].folder, folder)
    if change:
        change(folder)
    before = contents(folder)
    monkeypatch.setattr(training, "build", lambda *a, **k: pytest.fail("it trains again"))
    for resume in (True,) if "export" in options else (True, False):
        with pytest.raises(InputError, match=re.escape(message)) as refused:
            train(small("ranked-single"), folder, resume=resume, **{"seed": 4, **options})
        assert ("without --resume" if "export" in options else "--fresh (fresh=True)") in str(refused.value)
        assert contents(folder) == before


def test_another_finished_run_is_replaced_if_asked(uninterrupted, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(uninterrupted["ranked-single"].folder, folder)
    assert train(small("ranked-single"), folder, seed=5, steps=64, fresh=True).card.seed == 5
    with pytest.raises(InputError, match="one of them"):
        train(small("ranked-single"), folder, seed=5, resume=True, fresh=True)


def test_without_resume_a_finished_run_is_replaced_by_one_with_more(uninterrupted, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(uninterrupted["ranked-single"].folder, folder)
    train(small("ranked-single"), folder, seed=4, export=True)
    before = contents(folder)
    assert "model.zip" in before
    for export in (True, False):
        train(small("ranked-single"), folder, seed=4, export=export, resume=True)
        assert contents(folder) == before


@pytest.mark.parametrize("name", ["ranked-single", *slow(*(name for name in SMALL if name != "ranked-single"))])
def test_a_finished_run_goes_on_with_more_steps(name, uninterrupted, tmp_path):
    """The same bits, interrupted or not; until it is longer the finished run stays; and it goes on again."""
    finished, recipe = uninterrupted[name].folder, small(name)
    longer = replace(recipe, steps=2 * recipe.steps)
    for folder in ("whole", "again"):
        shutil.copytree(finished, tmp_path / folder)
    with pytest.raises(InputError, match=f"recipe.steps {recipe.steps}, not {longer.steps}; go on with it with --resu"):
        train(longer, tmp_path / "whole", seed=4)
    whole = train(longer, tmp_path / "whole", seed=4, resume=True)
    before = (finished / "curve.csv").read_text()
    curve = (tmp_path / "whole/curve.csv").read_text()
    assert curve.startswith(before)
    assert len(curve) > 1.5 * len(before)
    assert whole.card.steps >= longer.steps
    assert whole.card.recipe["longer_than"] == [recipe.steps]
    assert len(whole.card.goal_seeds["training"]) == 6

    interrupted(longer, tmp_path / "again", 1, resume=True)
    assert train(recipe, tmp_path / "again", seed=4, resume=True).card.steps == uninterrupted[name].card.steps
    again = train(longer, tmp_path / "again", seed=4, resume=True)
    np.testing.assert_array_equal(weights(again.folder / "policy.safetensors"), weights(whole.folder / training.POLICY))
    assert (tmp_path / "again/curve.csv").read_text() == curve
    with pytest.raises(InputError, match="finished run with"):
        train(recipe, tmp_path / "again", seed=4, resume=True)  # fewer
    longest = replace(recipe, steps=3 * recipe.steps)
    assert train(longest, tmp_path / "again", seed=4, resume=True).card.recipe["longer_than"] == [
        recipe.steps,
        longer.steps,
    ]
    (tmp_path / "whole/checkpoint.pt").unlink()
    with pytest.raises(InputError, match=r"no checkpoint\.pt to go on with; begin with its policy, --from"):
        train(longest, tmp_path / "whole", seed=4, resume=True)
    assert train(longer, tmp_path / "whole", seed=4, resume=True).card.steps == whole.card.steps


def test_a_second_training_in_a_folder_is_refused_and_the_first_is_safe(uninterrupted, tmp_path):
    recipe, refused = small("ranked-single"), []

    def begin_another(done, planned, row):
        for resume in (False, True):
            with pytest.raises(OutputError, match=r"a training is writing into .* already"):
                train(replace(recipe, steps=64), tmp_path, seed=4, resume=resume)
            refused.append(done)

    train(recipe, tmp_path, seed=4, progress=begin_another)
    assert len(refused) >= 6
    for name in ("policy.safetensors", "curve.csv"):
        assert (tmp_path / name).read_bytes() == (uninterrupted["ranked-single"].folder / name).read_bytes()
    train(recipe, tmp_path, seed=4, resume=True)  # the folder is free again


@pytest.mark.slow
def test_a_refused_training_leaves_no_folder(tmp_path):
    """Nor the folders around it that it made; what was there stays."""
    refused = replace(get_recipe("ppo-single"), settings={**get_recipe("ppo-single").settings, "no_such": 1})
    for folder in (tmp_path / "new" / "run", tmp_path / "run"):
        with pytest.raises(InputError, match="no_such"):
            train(refused, folder, steps=256)
        assert list(tmp_path.iterdir()) == []
    kept = tmp_path / "kept"
    kept.mkdir()
    (kept / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="no_such"):
        train(refused, kept, steps=256)
    assert [path.name for path in kept.iterdir()] == ["notes.txt"]


def test_threads_are_part_of_what_a_run_is(tmp_path):
    interrupted(small("ranked-single"), tmp_path, 1)
    with pytest.raises(InputError, match="threads 1, not 2"):
        train(small("ranked-single"), tmp_path, seed=4, threads=2, resume=True)
    train(small("ranked-single"), tmp_path, seed=4, resume=True)
    assert json.loads((tmp_path / "run.json").read_text())["threads"] == 1


def test_a_new_run_in_an_old_folder_begins_without_the_old_results(tmp_path):
    """Else what reads finished runs would take the policy of one for that of another."""
    recipe = replace(small("ranked-single"), trace_after=64)
    train(recipe, tmp_path, seed=4, export=True)
    assert {"run.json", "policy.safetensors", "model.zip", "curve.csv", "episode.csv"} < set(os.listdir(tmp_path))
    interrupted(small("ranked-single"), tmp_path, 1, fresh=True)
    assert set(os.listdir(tmp_path)) == {"checkpoint.pt", "curve.csv", "tensorboard"}
    (tmp_path / "run.json").mkdir()
    with pytest.raises(OutputError, match=r"run\.json"):
        train(small("ranked-single"), tmp_path, seed=5)


@pytest.mark.slow
def test_going_on_with_other_code_is_said_and_written_down(tmp_path, monkeypatch):
    recipe, said = small("ranked-single"), []
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
    before, inside, build = torch.get_num_threads(), [], training.build

    def look(*arguments, **options):
        inside.append(torch.get_num_threads())
        if len(inside) == 2:
            raise KeyboardInterrupt
        return build(*arguments, **options)

    monkeypatch.setattr(training, "build", look)
    train(small("ranked-single"), tmp_path / "one", seed=4, steps=64, threads=before + 1)
    assert torch.get_num_threads() == before
    with pytest.raises(KeyboardInterrupt):
        train(small("ranked-single"), tmp_path / "other", seed=4, threads=before + 2)
    assert torch.get_num_threads() == before
    assert inside == [before + 1, before + 2]


def test_a_checkpoint_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    recipe = small("ranked-single")
    interrupted(recipe, tmp_path, 1)
    before = (tmp_path / "checkpoint.pt").read_bytes()
    monkeypatch.setattr(Path, "write_bytes", lambda *a: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    with pytest.raises(OutputError, match="No space left"):
        train(recipe, tmp_path, seed=4, resume=True)
    assert (tmp_path / "checkpoint.pt").read_bytes() == before
    assert not [name for name in os.listdir(tmp_path) if name.startswith(".")]


def test_checkpoints_of_other_runs_are_refused(tmp_path):
    recipe = small("ranked-single")
    interrupted(recipe, tmp_path, 1)
    before = contents(tmp_path)
    for other, seed in ((recipe, 5), (replace(recipe, steps=recipe.steps + 64), 4)):
        with pytest.raises(InputError, match=r"belongs to a run with (seed 4, not 5|recipe.steps 768, not 832); train"):
            train(other, tmp_path, seed=seed, resume=True)
    assert contents(tmp_path) == before


def damaged(path):
    whole = path.read_bytes()
    for content in (b"", whole[: len(whole) // 2], pickle.dumps(Bomb()), b"\0" * 100):
        yield content
    state = torch.load(path, weights_only=True)
    for value in ({"identity": Bomb()}, [], {**state, "curve": {}}, {**state, "parameters": {}}):
        content = io.BytesIO()
        torch.save(value, content)
        yield content.getvalue()


@pytest.mark.slow
def test_with_a_checkpoint_that_cannot_be_read_the_training_starts_over(uninterrupted, tmp_path):
    def stop(done, planned, row):
        raise KeyboardInterrupt

    recipe, checked = small("ranked-single"), 0
    interrupted(recipe, tmp_path, 1)
    for content in list(damaged(tmp_path / "checkpoint.pt")):
        (tmp_path / "checkpoint.pt").write_bytes(content)
        said = []
        with pytest.raises(KeyboardInterrupt):
            train(recipe, tmp_path, seed=4, resume=True, notice=said.append, progress=stop)
        assert len(said) == 1
        assert said[0].endswith("the training starts over")
        checked += 1
    assert checked == 8
    assert not Bomb.executed
    (tmp_path / "checkpoint.pt").write_bytes(b"")
    train(recipe, tmp_path, seed=4, resume=True, notice=said.append)
    for name in ("policy.safetensors", "curve.csv"):
        assert (tmp_path / name).read_bytes() == (uninterrupted["ranked-single"].folder / name).read_bytes()


class Bomb:
    executed = False

    def __reduce__(self):
        return (Bomb.go_off, ())

    @staticmethod
    def go_off():
        Bomb.executed = True
