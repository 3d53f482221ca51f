"""Parts of the fit of a calibration that only it uses."""

from dataclasses import replace

import numpy as np
import pytest

from kinreach.errors import InputError
from kinreach.kinematics import pose
from kinreach.robots import PosePairs, _calibration, _calibration_fit, calibrate, read_calibration
from kinreach.robots._urdf import MAX_CHARACTERS
from tests.robots.test_calibrate import made_up, nominal_placements, pairs_of, postures


def test_rows_of_a_long_recording_are_taken_from_all_of_it():
    q = postures(1, 0) + np.arange(1000)[:, None] * 0.03
    pairs = PosePairs("long.csv", q, np.tile(np.eye(4), (1000, 1, 1)))
    kept = _calibration_fit._thinned(pairs)
    assert len(kept) == _calibration_fit.MAX_ROWS
    np.testing.assert_array_equal(kept.q[[0, -1]], q[[0, -1]])
    assert np.diff(kept.q[:, 0]).max() < 0.1
    still = _calibration_fit._thinned(replace(pairs, q=np.where(np.arange(1000)[:, None] < 900, q[0], q)))
    assert len(still) == 101


def test_what_a_kind_of_file_cannot_say_is_refused(tmp_path):
    result = calibrate(pairs_of(nominal_placements("ur5e"), postures(12, 3)), arm="ur5e")
    result.save(tmp_path / "nominal.conf")  # whose axes are parallel: the data sheet says where their normals are
    again = read_calibration(tmp_path / "nominal.conf", "ur5e")
    np.testing.assert_allclose(again.placements, result.calibration.placements, atol=1e-8)
    for place, endings, said in (
        (6, (".conf", ".yaml"), "tool0 .* off the axis of wrist_3"),
        (0, (".conf",), "base's z"),
    ):
        for axis in range(2):
            for shift in (pose([*np.eye(3)[axis] * 1e-8, 0, 0, 0]), pose([0, 0, 0, *np.eye(3)[axis] * 1e-8])):
                placements = result.calibration.placements.copy()
                placements[place] = placements[place] @ shift
                off = replace(result, calibration=replace(result.calibration, placements=placements))
                for ending in endings:
                    with pytest.raises(InputError, match=said):
                        off.save(tmp_path / f"off{ending}")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["nominal.conf"]
    with pytest.raises(InputError, match=rf"large.yaml: it has {MAX_CHARACTERS + 1} bytes, too many for one"):
        _calibration.calibrations_in(b" " * (MAX_CHARACTERS + 1), tmp_path / "large.yaml")
    with pytest.raises(InputError, match="the rows fit an arm that no ur5e is: "):
        _calibration.calibration_of(made_up("ur5e", 1, spread=(0.05, 0.0)), "ur5e", tmp_path)
