"""What was measured before an interruption counts exactly if it was measured for the same comparison."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from kinreach.compare.checkpoint import Checkpoint
from kinreach.compare.trials import ReachTrial
from kinreach.errors import OutputError

IDENTITY = {"settings": {"task": "ur5", "methods": ["lm"], "goals": 3, "seed": 0}, "versions": {"placo": None}}


TrialFactory = Callable[..., list[ReachTrial]]


def test_a_trial_survives_json(make_trials: TrialFactory, impossible: ReachTrial) -> None:
    for trial in (*make_trials(1), impossible):
        assert ReachTrial.from_dict(json.loads(trial.to_json())) == trial


def test_a_number_that_json_does_not_have_is_refused(make_trials: TrialFactory) -> None:
    (trial,) = make_trials(1, distance=float("nan"))
    with pytest.raises(ValueError, match="JSON"):
        trial.to_json()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Where the checkpoint is."""
    return tmp_path / "records.jsonl"


@pytest.fixture
def kept(path: Path, make_trials: TrialFactory) -> list[ReachTrial]:
    """Three trials that an interrupted comparison has left at `path`."""
    first = Checkpoint(path, IDENTITY, ReachTrial)
    for trial in make_trials(3):
        first.add(trial)
    return first.trials


def test_the_same_comparison_goes_on(path: Path, kept: list[ReachTrial]) -> None:
    assert len(kept) == 3
    assert Checkpoint(path, IDENTITY, ReachTrial).trials == kept


def test_a_line_cut_short_is_dropped_and_the_file_can_be_added_to(path: Path, kept: list[ReachTrial]) -> None:
    path.write_text(path.read_text()[:-40])
    second = Checkpoint(path, IDENTITY, ReachTrial)
    assert second.trials == kept[:2]
    second.add(kept[2])
    assert Checkpoint(path, IDENTITY, ReachTrial).trials == kept


@pytest.mark.parametrize("change", [{"settings": {"task": "button"}}, {"versions": {"placo": "0.10.2"}}])
@pytest.mark.usefixtures("kept")
def test_another_comparison_starts_over(path: Path, change: dict[str, object]) -> None:
    assert Checkpoint(path, IDENTITY | change, ReachTrial).trials == []
    assert Checkpoint(path, IDENTITY, ReachTrial).trials == []


@pytest.mark.usefixtures("kept")
def test_fresh_starts_over(path: Path) -> None:
    assert Checkpoint(path, IDENTITY, ReachTrial, fresh=True).trials == []


@pytest.mark.parametrize("content", ["", "not json\n", "[]\n", '{"settings": 1}\n{"goal": 0}\n'])
def test_a_file_that_is_something_else_starts_over(path: Path, content: str) -> None:
    path.write_text(content)
    assert Checkpoint(path, IDENTITY, ReachTrial).trials == []


def test_a_file_that_cannot_be_added_to_is_one_clear_error(path: Path, make_trials: TrialFactory) -> None:
    checkpoint = Checkpoint(path, IDENTITY, ReachTrial)
    path.unlink()
    path.mkdir()
    with pytest.raises(OutputError, match=r"cannot write .*records\.jsonl"):
        checkpoint.add(make_trials(1)[0])
    assert checkpoint.trials == []


@pytest.mark.usefixtures("kept")
def test_removed_when_done(path: Path) -> None:
    Checkpoint(path, IDENTITY, ReachTrial).remove()
    assert list(path.parent.iterdir()) == []
