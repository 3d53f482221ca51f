"""The shapes of an arm as triangles: where they are, how large, and in which colour."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from kinreach._rotations import placement
from kinreach.robots import ArmDescription
from kinreach.robots.inside import link_shapes

URDF = """<robot name="r"><material name="named"><color rgba="0.1 0.2 0.3 0.4"/></material>
  <link name="base">
    <visual><origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/><geometry><box size="0.3 0.2 0.1"/></geometry></visual>
    <collision><geometry><box size="1 1 1"/></geometry></collision>
    <visual><geometry><cylinder radius="0.1" length="0.5"/></geometry><material name="named"/></visual>
    <visual><geometry><sphere radius="0.2"/></geometry>
      <material name="named"><color rgba="0.9 0.8 0.7 1"/></material></visual>
  </link>
  <link name="one">
    <visual><origin xyz="0 0 1"/><geometry><mesh filename="package://wedge.dae" scale="2 1 -1"/></geometry></visual>
    <visual><geometry><mesh filename="package://wedge.dae"/></geometry><material name="named"/></visual>
  </link>
  <joint name="j" type="revolute"><parent link="base"/><child link="one"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>"""


@pytest.fixture
def wedge(tmp_path):
    """A box of which one side is cut off, red."""
    box = trimesh.creation.box((0.2, 0.1, 0.06))
    mesh = trimesh.Trimesh(box.vertices + (0, 0.1, 0) * (box.vertices[:, :1] > 0), box.faces, process=False)
    red = trimesh.visual.material.PBRMaterial(baseColorFactor=(255, 0, 51, 255))
    mesh.visual = trimesh.visual.TextureVisuals(uv=np.zeros((8, 2)), material=red)
    mesh.export(tmp_path / "wedge.dae")
    return mesh


@pytest.fixture
def arm(tmp_path, wedge):
    return ArmDescription("r", "r", lambda: URDF, package_root=lambda: str(tmp_path))


def test_shapes_are_where_the_urdf_has_them_in_its_colours(arm, wedge):
    box, cylinder, sphere, scaled, plain = link_shapes(arm)
    assert [shape.link for shape in (box, cylinder, sphere, scaled, plain)] == ["base"] * 3 + ["one"] * 2
    T = np.linalg.inv(placement((0.1, 0.2, 0.3), (0.4, 0.5, 0.6)))
    local = box.vertices @ T[:3, :3].T + T[:3, 3]
    np.testing.assert_allclose(np.abs(local).max(axis=0), (0.15, 0.1, 0.05))
    np.testing.assert_allclose(np.ptp(cylinder.vertices, axis=0), (0.2, 0.2, 0.5), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(sphere.vertices, axis=1), 0.2)
    np.testing.assert_allclose(np.ptp(plain.vertices, axis=0), np.ptp(wedge.vertices, axis=0), atol=1e-6)
    np.testing.assert_allclose(np.ptp(scaled.vertices, axis=0), np.ptp(wedge.vertices, axis=0) * (2, 1, 1), atol=1e-6)
    np.testing.assert_allclose(scaled.vertices[:, 2].mean(), 1.0, atol=1e-6)
    assert [shape.rgba for shape in (box, cylinder, sphere, scaled, plain)] == [
        (0.62, 0.64, 0.67, 1.0), (0.1, 0.2, 0.3, 0.4), (0.9, 0.8, 0.7, 1.0), (1.0, 0.0, 0.2, 1.0), (0.1, 0.2, 0.3, 0.4)
    ]  # fmt: skip
    for shape in (box, cylinder, sphere, scaled, plain):
        mesh = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
        assert mesh.volume > 0
        assert ((mesh.face_normals[:, None] * shape.normals[shape.faces]).sum(axis=2) > 0.0).all()
        np.testing.assert_allclose(np.linalg.norm(shape.normals, axis=1), 1.0)


def test_one_kind_or_meshes_alone(arm):
    (collision,) = link_shapes(arm, "collision")
    assert np.ptp(collision.vertices) == 1.0
    assert [shape.link for shape in link_shapes(arm, meshes_only=True)] == ["one"] * 2
    assert link_shapes(arm, "collision", meshes_only=True) == []
