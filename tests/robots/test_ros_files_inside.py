"""Packages of ROS, in their parts."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from kinreach.robots import _packages


def test_what_cannot_be_read_names_no_package(tmp_path, monkeypatch):
    """A manifest that is too large, or a folder that cannot be listed."""
    manifest = tmp_path / "package.xml"
    manifest.write_text("<package><name> my_arm </name></package>")
    assert _packages._declared_name(manifest) == "my_arm"
    monkeypatch.setattr(_packages, "MAX_MANIFEST", manifest.stat().st_size - 1)
    assert _packages._declared_name(manifest) == ""
    (tmp_path / "b").mkdir()
    (tmp_path / "a").mkdir()
    assert _packages._folders_in(tmp_path) == [tmp_path / "a", tmp_path / "b"]
    assert _packages._folders_in(manifest) == []
    assert _packages._folders_in(tmp_path / "none") == []


def test_pictures_of_surfaces_are_left_out(tmp_path):
    robot = ET.fromstring(
        '<robot><material name="m"><texture filename="a.png"/><color rgba="1 0 0 1"/><texture/></material></robot>'
    )
    assert _packages.find_meshes(robot, tmp_path / "a.urdf", []) == (None, "", {})
    assert ET.tostring(robot) == b'<robot><material name="m"><color rgba="1 0 0 1" /></material></robot>'
