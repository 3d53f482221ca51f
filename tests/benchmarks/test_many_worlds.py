"""The script that measures thousands of worlds on a GPU, tried with few on Warp's CPU device."""

import re

import pytest

from benchmarks.studies import many_worlds
from kinreach.cli import finish
from kinreach.errors import InputError
from tests.machine import compile_kernels_quickly

compile_kernels_quickly()
NAMES = ["UR5SingleStep", "UR5MultiStep", "Lift", "Push", "PickAndPlace"]


@pytest.mark.slow
def test_few_worlds_agree_and_are_measured(capsys):
    assert many_worlds.main(["--device", "cpu", "--worlds", "1", "2", "--minutes", "60", "--training", "0"]) == 0
    said = capsys.readouterr().out
    agreed = re.findall(r"^\| kinreach/(\w+)-v0 \| 1 \| 1 \| 1 \| (\S+) \| (\S+) \|$", said, re.MULTILINE)
    assert [name for name, *_ in agreed] == NAMES
    assert all(0.0 < float(apart) <= many_worlds.OF_SCRIPTS for _, apart, _ in agreed)
    assert [objects == "-" for *_, objects in agreed] == [True, True, False, False, False]
    rows = re.findall(r"^\| kinreach/(\w+)-v0 \| ([12]) \| [\d.]+ \| [\d.]+ \|$", said, re.MULTILINE)
    assert rows == [(name, worlds) for worlds in "12" for name in NAMES]
    assert "agreement, joints within 1e-05 rad, with scripts 0.0001: yes" in said
    assert "training" not in said


def test_what_there_is_no_time_for_is_listed_and_a_disagreement_fails(monkeypatch, capsys):
    monkeypatch.setattr(many_worlds, "agreement", lambda name, count, *_: (count - 1, 0, 0.0, 0.0))
    for name in ("rate", "trained"):
        monkeypatch.setattr(many_worlds, name, lambda *_: pytest.fail("it measures"))
    options = ["--device", "cpu", "--worlds", "64", "8192", "--minutes", "0"]
    assert many_worlds.main(options) == 1
    said = capsys.readouterr().out
    assert said.count("out of time: kinreach/") == 20
    assert said.count("out of time: training, ") == 2
    assert "with scripts 0.0001: no" in said
    assert many_worlds.main([*options, "--tasks", "lift", "push"]) == 1
    said = capsys.readouterr().out
    assert re.findall(r"^\| kinreach/(\w+)-v0 \| 64 \| 63", said, re.MULTILINE) == ["Lift", "Push"]
    assert "training" not in said


def test_a_training_ends_with_a_share_and_a_time():
    found = re.fullmatch(r"(\d+) after \d+ s", many_worlds.trained("mujoco", 3200))
    assert found is not None
    assert 0 <= int(found[1]) <= 100


def test_another_device_is_refused_in_a_line(capsys):
    with pytest.raises(InputError, match="--device cpu tries the script"):
        many_worlds.card("cuda:99")
    assert finish(lambda: many_worlds.main(["--device", "cuda:99"]), prog=many_worlds.PROG) == 2
    assert "there is no device 'cuda:99'" in capsys.readouterr().err
