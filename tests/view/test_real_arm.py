"""A calibrated arm beside its data sheet, without a browser."""

import numpy as np
import pinocchio as pin
import pytest

from kinreach.errors import InputError
from kinreach.kinematics import URKinematics
from kinreach.robots import PUBLISHED_CALIBRATIONS, get_arm
from kinreach.view import _html as html
from kinreach.view._real_arm import RealArm, colours
from kinreach.view._snippet import calibrated, real_arm_program

FILES = {"ur5": "ur5_a", "ur3": "ur3_a", "ur10e": "ur10e_a"}


@pytest.fixture(scope="module", params=FILES)
def pair(request):
    arm = get_arm(request.param)
    return RealArm(arm, arm.calibrated(PUBLISHED_CALIBRATIONS[FILES[request.param]]))


def test_the_miss_is_what_both_chains_say(pair):
    """The real tip by the other way to a calibrated arm; the angle by Pinocchio's logarithm."""
    name = pair.nominal.arm.name
    twin = URKinematics.from_calibration(
        PUBLISHED_CALIBRATIONS[FILES[name]], model=name, tip=pair.real.tip, base="world"
    )
    rng, off = np.random.default_rng(0), []
    for _ in range(50):
        miss = pair.miss(rng.uniform(-3, 3, 6))
        np.testing.assert_allclose(miss.real, twin.fk(miss.q), atol=1e-9)
        np.testing.assert_allclose(miss.meant[:3, 3] + miss.vector, miss.real[:3, 3], atol=1e-15)
        assert miss.turned == pytest.approx(
            np.linalg.norm(pin.log3(miss.meant[:3, :3].T @ miss.real[:3, :3])), abs=1e-9
        )
        off.append(miss.distance)
    assert 0.0005 < np.median(off) < 0.01  # docs/guides/your_ur.md: 1 to 8 mm


def test_the_map_is_of_the_table(pair):
    found = pair.map()
    rows, columns = found.distances.shape
    assert max(rows, columns) == 32
    assert found.known.size > 300
    assert 0 < found.known.max() < 0.015
    rng, home, same = np.random.default_rng(1), np.array(pair.nominal.arm.home), 0
    for row, column in zip(rng.integers(rows, size=40), rng.integers(columns, size=40), strict=True):
        share = np.array([(column + 0.5) / columns, (row + 0.5) / rows]) - 0.5
        point = found.centre + np.append(share * found.size, 0.0)
        result = pair.nominal.axis_goal(point, (0, 0, -1), home)
        assert result.success == np.isfinite(found.distances[row, column])
        if result.success:
            tip = pair.real.fk(result.q)[:3, 3]
            assert found.distances[row, column] == pytest.approx(np.linalg.norm(tip - point), abs=1e-9)
            same += 1
    assert same > 10
    table = next((box for box in pair.nominal.arm.workcell.obstacles if box.name == "table"), None)
    if table is not None:
        assert found.centre[2] == pytest.approx(table.position[2] + table.size[2] / 2)
        assert found.size == table.size[:2]


def test_only_a_ur_has_a_calibration(root):
    with pytest.raises(InputError, match="only a UR has a factory calibration, got the arm 'panda'"):
        RealArm(get_arm("panda"), get_arm("panda"))
    with pytest.raises(InputError, match="folded"):
        get_arm("ur5e").calibrated(root / "tests/data/calibrations/ur5e_folded.yaml")


def test_colours_go_from_dark_to_bright():
    values = np.array([[0.0, 1.0, 2.0, np.nan]])
    rgba = colours(values, 2.0)
    assert rgba.shape == (1, 4, 4)
    assert rgba[0, :, 3].tolist() == [255, 255, 255, 0]
    brightness = rgba[0, :3, :3].sum(axis=1).tolist()
    assert brightness == sorted(brightness)
    assert "kinreach" not in html.scale(rgba[0], "<b>", "7 mm", "title")
    assert "<b>" not in html.scale(rgba[0], "<b>", "7 mm", "title")


def test_a_copied_program_says_the_same(pair, capsys):
    """The tip error that the page shows, in mm; of every arm that has a calibration here."""
    name = pair.nominal.arm.name
    seed = np.array(pair.nominal.arm.home)
    T = pair.nominal.fk(seed + np.array([0.2, -0.1, 0.3, 0.1, -0.2, 0.4]))
    arm = calibrated(repr(name), str(PUBLISHED_CALIBRATIONS[FILES[name]]))
    code = real_arm_program(pair, T, seed, sheet=repr(name), arm=arm)
    exec(compile(code, "copied", "exec"), {})
    first, second = capsys.readouterr().out.splitlines()
    assert first.strip() == "ok"
    miss = pair.miss(pair.believed(T, seed).q)
    np.testing.assert_allclose(np.array(second.strip("[] ").split(), dtype=float), 1e3 * miss.vector, atol=1e-3)
    assert miss.distance > 5e-4
