"""The study of what a policy does where it was not trained."""

import pytest

from benchmarks.studies.off_volume import main
from kinreach.errors import InputError


def test_inside_is_near_and_outside_is_not(tmp_path, capsys):
    assert main(["space-single", str(tmp_path / "map.png"), "--starts", "6"]) == 0
    lines = capsys.readouterr().out.splitlines()
    within = [float(line.split(": ")[1].split(" %")[0]) for line in lines]
    assert len(within) == 8
    assert min(within[:3]) > 50 > max(within[3:6])
    assert (tmp_path / "map.png").stat().st_size > 50_000


def test_other_policies_are_refused(tmp_path):
    with pytest.raises(InputError, match="not for kinreach/Reach-v0"):
        main(["ranked-single", str(tmp_path / "map.png")])
