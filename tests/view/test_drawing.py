"""The triangles that are drawn are as they are kept in tests/data/shapes.txt: links, sizes, places and colours."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from kinreach.kinematics import ArmKinematics
from kinreach.robots import ArmDescription, get_arm
from kinreach.robots.inside import link_shapes, without_shapes
from kinreach.sim import ArmSimulation
from kinreach.view._draw import BLUE, Ghost, Ghosts, box_colour, overview
from kinreach.view._figure import Figure
from kinreach.view._mujoco_scene import MujocoScene
from tests import kept

#: One of each kind of shape; what is in group 3 collides, and the plane is not drawn.
KINDS = """
<mujoco>
  <asset><material name="table" rgba="0.5 0.5 0.5 1"/></asset>
  <worldbody>
    <geom type="plane" size="1 1 0.1"/>
    <body name="table" pos="0 0 1"><geom type="box" size="0.1 0.2 0.3" pos="0 0 0.1" material="table"/></body>
    <body name="ball" pos="1 0 1"><freejoint/>
      <geom type="sphere" size="0.1" rgba="0.2 0.4 0.8 1"/>
      <geom type="capsule" size="0.1 0.3" euler="90 0 0"/>
      <geom type="cylinder" size="0.1 0.4" group="2"/>
      <geom type="ellipsoid" size="0.1 0.2 0.3" pos="0.1 0 0"/>
      <geom type="box" size="0.1 0.1 0.1" group="3"/>
    </body>
  </worldbody>
</mujoco>
"""


def of(shapes):
    """Things to keep: pieces of links, fine and coarse."""
    found = {}
    for kind, pieces in (("fine", shapes.fine), ("coarse", shapes.coarse)):
        for number, piece in enumerate(pieces):
            found[f"{kind} {number}"] = {
                "link": shapes.links[piece.link], "vertices": kept.written(piece.vertices),
                "faces": kept.written(piece.faces), "colour": str(tuple(map(int, piece.colour))),
            }  # fmt: skip
    return found


def test_shapes_are_as_they_were(tmp_path):
    """Of arms with meshes, drawn finely and simply, of one without, and of a MuJoCo scene with every kind of shape."""
    bare = tmp_path / "bare.urdf"
    bare.write_bytes(ET.tostring(without_shapes(get_arm("ur5e").robot, "visual", "collision")))
    arms = {"ur5": get_arm("ur5-thesis"), "arm3": get_arm("arm3"), "bare": ArmDescription.from_urdf(bare)}
    shapes = {name: Figure(ArmKinematics.of(arm, base="world")) for name, arm in arms.items()}
    shapes |= {"simple ur5": Figure(ArmKinematics.of("ur5-thesis", base="world"), simple=True)}
    shapes |= {"kinds": MujocoScene(mujoco.MjModel.from_xml_string(KINDS))}
    things = {f"{name}: {thing}": each for name, shape in shapes.items() for thing, each in of(shape).items()}
    kept.check("shapes.txt", {"shapes": things})


def test_a_ghost_in_the_place_of_the_solid_arm_is_inside_it():
    """Two surfaces in one place flicker: a shoulder that is turned about its own axis is in its own place."""
    checked = 0
    for name in ("ur5e", "ur20", "ur5-thesis"):
        kinematics = ArmKinematics.of(name, base="world")
        drawn = Figure(kinematics)
        moved = {drawn.links[piece.link] for piece in drawn.coarse}
        collides = link_shapes(kinematics.arm, "collision")
        assert moved == {shape.link for shape in collides} - {"base_link"}
        for piece in drawn.coarse:
            link = drawn.links[piece.link]
            own = np.concatenate([shape.vertices for shape in collides if shape.link == link])
            normals = np.concatenate([shape.normals for shape in collides if shape.link == link])
            inwards = -((piece.vertices - own) * normals).sum(axis=1)
            assert (inwards > 0.001).all()
            assert (np.linalg.norm(piece.vertices - own, axis=1) < 0.003).all()
            checked += len(own)
    assert checked > 2000


def test_a_table_of_an_episode_has_the_colours_of_the_page():
    """Its legs are of metal."""
    simulation = ArmSimulation("ur5-thesis", visual=True)
    scene = MujocoScene(simulation.model)
    table = scene.links.index("table")
    colours = [piece.colour for piece in scene.fine if piece.link == table]
    assert colours == [box_colour("table")] + 4 * [box_colour("leg")]


class RecordedScene:
    """Keeps what ghosts are drawn with."""

    def __init__(self):
        self.nodes = {}

    def add_frame(self, name, **options):
        return SimpleNamespace(visible=True, **options)

    def add_batched_meshes_simple(self, name, vertices, faces, **options):
        self.nodes[name] = SimpleNamespace(**options)
        return self.nodes[name]


def test_links_in_one_place_are_drawn_once():
    """Of eight postures of a UR four share each of two shoulders; the ghost that stands out keeps its own."""
    kin = ArmKinematics.of("ur5e", base="world")
    figure, scene = Figure(kin), RecordedScene()
    ghosts = Ghosts(scene, "/ghosts", figure, most=8)
    target = kin.fk(np.array(kin.arm.home) + 0.3)
    solid, *others = kin.all_solutions(target).q
    assert len(others) == 7
    shoulder = next(
        node
        for piece, node in zip(figure.coarse, scene.nodes.values(), strict=True)
        if figure.links[piece.link] == "shoulder_link"
    )
    for clear in range(7):
        ghosts.take([Ghost(q, BLUE, opacity=0.8 if i == clear else 0.1) for i, q in enumerate(others)], beside=solid)
        for piece, node in zip(figure.coarse, scene.nodes.values(), strict=True):
            places = [figure.poses(q)[piece.link] for q in (solid, *np.array(others)[node.batched_scales[:7] > 0])]
            places = np.array([np.append(place[:3], place[3:] * np.sign(place[3:] @ (1, 2, 3, 4))) for place in places])
            apart = np.abs(places[:, None] - places[None]).max(axis=2) + np.eye(len(places))
            assert apart.min() > 1e-4
        assert shoulder.batched_scales.sum() == 1
        away = np.abs(figure.poses(others[clear])[:2] - figure.poses(solid)[:2]).max() > 0.1
        assert not away or shoulder.batched_scales[clear] == 1


BROKEN = """<robot name="two"><link name="base"/>
  <link name="one"><visual><geometry><mesh filename="package://other/drawn.dae"/></geometry></visual>
    <collision><geometry><box size="0.2 0.1 0.06"/></geometry></collision></link>
  <joint name="a" type="revolute"><parent link="base"/><child link="one"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <link name="two"/>
  <joint name="b" type="revolute"><parent link="one"/><child link="two"/><origin xyz="0.5 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>"""


def test_a_link_without_a_readable_visual_mesh_is_drawn_by_its_collision_shape(tmp_path):
    (tmp_path / "two.urdf").write_text(BROKEN)
    drawn = Figure(ArmKinematics(ArmDescription.from_urdf(tmp_path / "two.urdf"), base="world"))
    (piece,) = drawn.fine
    assert drawn.links[piece.link] == "one"
    np.testing.assert_allclose(np.ptp(piece.vertices, axis=0), (0.2, 0.1, 0.06), atol=1e-6)


def test_the_arm_is_left_of_the_panel_and_above_it_on_an_upright_screen():
    """Seen from anywhere: as far away as the camera and more, level, and as wide."""
    arm, rng, seen = get_arm("ur5-thesis"), np.random.default_rng(0), 0
    (mount,) = (mount for mount in arm.cameras if mount.name == "overview")
    for upright in 20 * [False, True]:
        placed = replace(mount, position=rng.uniform(1.0, 2.0, 3), target=rng.uniform(-0.3, 0.3, 3))
        size = {"image_width": 300 + 600 * (not upright), "image_height": 600}
        client = SimpleNamespace(camera=SimpleNamespace(**size))
        overview(client, replace(arm, cameras=(placed,)))
        camera = client.camera
        forward = camera.look_at - camera.position
        np.testing.assert_allclose(np.cross(forward, placed.target - placed.position), 0.0, atol=1e-9)
        assert 1.1 < np.linalg.norm(forward) / np.linalg.norm(placed.target - placed.position) < 2.0
        side = np.cross(forward, (0.0, 0.0, 1.0))
        shift = placed.target - camera.look_at
        across, up = shift @ side, shift @ np.cross(side, forward)
        if upright:
            assert (across, up > 0.1) == (pytest.approx(0.0, abs=1e-9), True)
        else:
            assert (across < -0.1, up) == (True, pytest.approx(0.0, abs=1e-9))
        assert camera.fov == pytest.approx(np.radians(mount.fovy))
        seen += 1
    assert seen == 40
