"""The script that measures thousands of worlds on a GPU, tried with few on Warp's CPU device."""

import re

import pytest

from benchmarks.studies import many_worlds
from kinreach.cli import finish
from kinreach.errors import InputError

pytest.importorskip("mujoco_warp")


@pytest.mark.slow
def test_few_worlds_agree_and_are_measured(capsys):
    assert many_worlds.main(["--device", "cpu", "--worlds", "2", "3", "--minutes", "60"]) == 0
    said = capsys.readouterr().out
    agreed = re.findall(r"^\| kinreach/UR5\w+Step-v0 \| 2 \| 2 \| (\S+) \|$", said, re.MULTILINE)
    assert len(agreed) == 2
    assert all(0.0 < float(apart) <= many_worlds.TOLERANCE for apart in agreed)
    rows = re.findall(r"^\| kinreach/(\w+)-v0 \| ([23]) \| ([\d.]+) \| ([\d.]+|-) \|$", said, re.MULTILINE)
    assert len(rows) == 6
    assert {(name, warp == "-") for name, _, _, warp in rows} == {
        ("UR5SingleStep", False),
        ("UR5MultiStep", False),
        ("Lift", True),
    }
    assert "agreement within 1e-05 rad: yes" in said


def test_what_there_is_no_time_for_is_listed_and_a_disagreement_fails(monkeypatch, capsys):
    monkeypatch.setattr(many_worlds, "agreement", lambda name, count, *_: (count - 1, 0.0))
    monkeypatch.setattr(many_worlds, "rate", lambda *_: pytest.fail("it measures"))
    assert many_worlds.main(["--device", "cpu", "--worlds", "64", "8192", "--minutes", "0"]) == 1
    said = capsys.readouterr().out
    assert said.count("out of time: kinreach/") == 10
    assert "agreement within 1e-05 rad: no" in said


def test_another_device_is_refused_in_a_line(capsys):
    with pytest.raises(InputError, match="--device cpu tries the script"):
        many_worlds.card("cuda:99")
    assert finish(lambda: many_worlds.main(["--device", "cuda:99"]), prog=many_worlds.PROG) == 2
    assert "there is no device 'cuda:99'" in capsys.readouterr().err
