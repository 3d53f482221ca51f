"""Calibration of any arm's chain, and how often a file is read."""

from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from kinreach import _files
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, pose
from kinreach.robots import PUBLISHED_CALIBRATIONS, PosePairs, _calibration, calibrate, get_arm, read_calibration
from kinreach.robots._calibration_fit import calibration_from
from kinreach.robots._pairs import pairs_of
from kinreach.robots._urdf_chain import UrdfChain
from kinreach.robots.inside import frames_of, moved_frames


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("with_rotations", [True, False])
def test_any_arm_is_calibrated_from_what_a_tracker_saw(tmp_path, with_rotations, known):
    """Its base in the tracker and its tool are not known; the URDF that is written puts the tool where it was seen."""
    arm = get_arm("panda")
    kin, rng = ArmKinematics.of(arm), np.random.default_rng(3)
    chain = UrdfChain.of(arm.robot, arm.joints, base=arm.base, tip=arm.tips[arm.default_tip])
    q = rng.uniform(kin.lower, kin.upper, (60, kin.n))
    np.testing.assert_allclose(frames_of(chain.placements, q)[-1], kin.fk(q), atol=1e-10)
    errors = rng.normal(size=(8, 6)) * np.repeat((1e-3, 2e-3), 3)
    errors[0], errors[-1] = 0.0, 0.0
    real = ArmKinematics.of(replace(arm, build_urdf=chain.urdf_with(moved_frames(chain.placements, errors))))
    tracker, tool = pose([0.7, -0.3, 1.2, 0.3, -1.0, 0.4]), pose([0.01, 0.02, 0.1, 0.2, 0.1, 0.0])
    T = tracker @ real.fk(q) @ tool
    pairs = PosePairs("tracker.csv", q, T if with_rotations else T[:, :3, 3])
    result = calibrate(pairs.with_tcp(tool) if known and with_rotations else pairs, arm=arm)
    assert not result.missing
    assert result.models == ()
    result.save(tmp_path / "panda.urdf")
    again = ArmKinematics.from_urdf(tmp_path / "panda.urdf", tip=kin.arm.tips[kin.tip], joints=arm.joints)
    q = rng.uniform(kin.lower, kin.upper, (100, kin.n))
    found, true = again.fk(q) @ result.tcp, real.fk(q) @ tool
    apart = np.linalg.inv(found[0]) @ found[:, :, 3:], np.linalg.inv(true[0]) @ true[:, :, 3:]  # whatever the base
    assert np.abs(np.linalg.norm(apart[0][:, :3, 0], axis=1) - np.linalg.norm(apart[1][:, :3, 0], axis=1)).max() < 5e-6
    with pytest.raises(InputError, match=r"must end in \.urdf"):
        result.save(tmp_path / "panda.conf")


def test_a_joint_whose_axis_is_not_written_turns_about_x():
    """As URDF has it, whether `<axis>` is missing or says nothing."""
    text = """<robot name="r"><link name="a"/><link name="b"/><link name="c"/>
    <joint name="j" type="continuous"><parent link="a"/><child link="b"/><origin xyz="1 2 3"/></joint>
    <joint name="k" type="continuous"><parent link="b"/><child link="c"/><origin xyz="0 1 0"/><axis/></joint></robot>"""
    chain = UrdfChain.of(ET.fromstring(text), ("j", "k"), base="a", tip="c")
    q = np.random.default_rng(6).uniform(-3, 3, (50, 2))
    about_x = [pose([1, 2, 3, first, 0, 0]) @ pose([0, 1, 0, second, 0, 0]) for first, second in q]
    np.testing.assert_allclose(frames_of(chain.placements, q)[-1], about_x, atol=1e-12)


@pytest.mark.slow
def test_a_calibration_is_read_once(tmp_path, monkeypatch):
    """However many models it is held against: the file, and what is written in it."""
    arm = get_arm("ur5e").calibrated("ur5e_a")
    (tmp_path / "my.urdf").write_text(arm.urdf)
    calibrate(PUBLISHED_CALIBRATIONS["ur5e_a"]).save(tmp_path / "my.conf")
    files = [PUBLISHED_CALIBRATIONS["ur5e_a"], tmp_path / "my.urdf", tmp_path / "my.conf"]
    read, parsed = [], []
    opened, from_urdf = _files.open_input, _calibration._from_urdf

    def opening(path, *rest, **more):
        read.append(path)
        return opened(path, *rest, **more)

    def parsing(text):
        parsed.append(text)
        return from_urdf(text)

    monkeypatch.setattr(_files, "open_input", opening)
    monkeypatch.setattr(_calibration, "_from_urdf", parsing)
    for file in files:
        for result in (calibrate(file, arm="ur5e"), calibration_from(file, "ur5e"), read_calibration(file, "ur5e")):
            assert "ur5e" in (result.models if hasattr(result, "models") else [result.model])
        assert read == [file] * 3
        read.clear()
    for file in files[:2]:
        assert "ur5e" in calibrate(file).models
    assert read == files[:2]
    assert len(parsed) == 4


@pytest.mark.parametrize(
    ("column", "most", "word"), [(0, 2 * np.pi + 0.1, "joint angles"), (11, 3 * np.pi, "rotations")]
)
def test_numbers_without_a_unit_are_radians_up_to_what_radians_can_be(column, most, word):
    """Just below the bound they are, just above it they are degrees, and a note says so."""
    rows = np.full((12, 12), 0.1)
    for value, degrees in ((most - 0.01, False), (most + 0.01, True)):
        rows[:, column] = value
        text = "q1,q2,q3,q4,q5,q6,x,y,z,rx,ry,rz\n" + "\n".join(",".join(map(repr, row)) for row in rows.tolist())
        pairs = pairs_of(text.encode(), "rows.csv")
        assert any(f"the {word} of rows.csv are larger than radians can be" in note for note in pairs.notes) == degrees
        if not column:
            np.testing.assert_allclose(pairs.q[:, 0], np.radians(value) if degrees else value)
