"""How files of arms are read and repaired, in their parts."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import pytest

from kinreach.errors import InputError
from kinreach.robots._urdf_file import turning_joints
from tests.robots.test_urdf_files import write


def test_the_joints_of_a_file_that_turn(tmp_path):
    """None of what is no file."""
    file = write(tmp_path)
    turning = {
        joint.get("name") for joint in ET.parse(file).iter("joint") if joint.get("type") in ("revolute", "continuous")
    }
    assert turning_joints(str(file)) == turning != set()
    assert turning_joints(str(tmp_path / "none.urdf")) == set()
    assert turning_joints(str(tmp_path)) == set()


def test_what_is_no_xml_is_read_as_urdfdom_does_or_refused_as_it_stands(tmp_path):
    """A bare ampersand is read; where that does not help, the first error is said."""
    file = tmp_path / "a.urdf"
    text = write(tmp_path).read_text()
    file.write_text(text.replace('name="', 'name="R&D ', 1))
    assert turning_joints(str(file)) == turning_joints(str(write(tmp_path)))
    said = []
    for content in ('<robot name="a & b"><link></robot>', '<robot name="a"><link></robot>'):
        file.write_text(content)
        with pytest.raises(InputError) as error:
            turning_joints(str(file))
        said.append(str(error.value))
    assert "not well-formed" in said[0]
    assert "mismatched tag" in said[1]
