"""The study of imitation: a training that was interrupted ends with the curve of one that was not."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
from benchmarks.studies import imitation
from benchmarks.studies.reached_curves import numbers_of
from benchmarks.studies.trainings import POLICY
from kinreach.baselines import get_recipe

RECIPE = get_recipe("imitated-push")
SMALL = replace(
    RECIPE,
    num_envs=4,
    steps=120,
    segments=3,
    window=20,
    settings={**RECIPE.settings, "n_steps": 10, "batch_size": 40, "updates": 1},
)


def tried(policy, *, goals):
    halves = np.arange(goals) % 2 == 0
    return SimpleNamespace(reached=halves, impossible=~halves, measures={"distance": np.full(goals, 0.01)})


@pytest.mark.parametrize("interrupted", [1, 2, 3])
def test_no_point_of_the_curve_is_lost(interrupted, tmp_path, monkeypatch):
    """The policy of each part is being tried when the study is interrupted, and then it is begun again."""
    monkeypatch.setattr(imitation, "get_recipe", lambda name: SMALL)
    calls = []

    def stopped(policy, *, goals):
        calls.append(policy)
        if len(calls) == interrupted:
            raise KeyboardInterrupt
        return tried(policy, goals=goals)

    monkeypatch.setattr(imitation, "evaluate", stopped)
    with pytest.raises(KeyboardInterrupt):
        imitation.train("imitated-push", tmp_path, 0, 4)
    for _ in range(2):  # the second time there is nothing left to do
        imitation.train("imitated-push", tmp_path, 0, 4)
        assert numbers_of(tmp_path / imitation.CURVE)[:, :3].tolist() == [[n, 50.0, 10.0] for n in (40, 80, 120)]
        assert (tmp_path / POLICY).exists()
        assert len(calls) == interrupted + 3


def test_a_training_goes_on_after_its_last_point(tmp_path, monkeypatch):
    """Interrupted between two parts, it tries none again."""
    monkeypatch.setattr(imitation, "get_recipe", lambda name: SMALL)
    calls = []

    def counted(policy, *, goals):
        calls.append(policy.card.steps)
        return tried(policy, goals=goals)

    def stopped(*rows):
        write(*rows)
        raise KeyboardInterrupt

    monkeypatch.setattr(imitation, "evaluate", counted)
    write = imitation.write_rows
    for _ in range(3):
        monkeypatch.setattr(imitation, "write_rows", stopped)
        with pytest.raises(KeyboardInterrupt):
            imitation.train("imitated-push", tmp_path, 0, 4)
    assert not (tmp_path / POLICY).exists()
    imitation.train("imitated-push", tmp_path, 0, 4)
    assert (tmp_path / POLICY).exists()
    assert calls == [40, 80, 120]
