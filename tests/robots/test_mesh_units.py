"""Meshes in millimetres: told by their size beside the arm's, and scaled where that is certain."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

from kinreach.errors import NoShapesError
from kinreach.kinematics import ArmKinematics, CollisionChecker
from kinreach.robots import ArmDescription, _mesh_units, get_arm
from kinreach.robots._mesh_units import FAR, FITS, arm_length
from kinreach.robots._urdf import parse_urdf
from kinreach.robots.inside import link_shapes
from tests.robots.peoples_files import MASS, arm, shape

#: Of the arm of these tests, from its root to its last link [m].
LENGTH = 0.15 + 0.1 + 0.4 + 0.35 + 0.1 + 0.09
MESH = '<mesh filename="{}"{}/>'
SIZE = (0.3, 0.05, 0.04)


def box(folder: Path, name: str, unit: float, *, size=SIZE, declared: float | None = None) -> str:
    """Write a box of a size [m] with so many metres per unit, and return the file's name."""
    mesh = trimesh.creation.box(np.array(size) / unit)
    mesh.apply_translation([0.5 * size[0] / unit, 0, 0])
    if name == "ascii.stl":
        (folder / name).write_text(mesh.export(file_type="stl_ascii"))
        return name
    if name.endswith("dae"):
        text = mesh.export(file_type="dae").decode()
        said = "" if declared is None else f'<unit name="u" meter="{declared}"/>'
        (folder / name).write_text(text.replace("<up_axis>", f"{said}<up_axis>"))
        return name
    mesh.export(folder / name)
    return name


def written(folder: Path, *, moved: str, base: str = "", scale: str = "", kinds=("visual", "collision")) -> Path:
    """An arm with a mesh on link 3, and one on its base."""
    attribute = f' scale="{scale}"' if scale else ""
    on = {3: moved, 0: base}
    links = {
        i: MASS + "".join(shape(MESH.format(name, attribute), kind) for kind in kinds) for i, name in on.items() if name
    }
    (folder / "a.urdf").write_text(arm(links=links))
    return folder / "a.urdf"


def extent(described: ArmDescription, link: str, kind: str = "collision") -> np.ndarray:
    points = [each.vertices for each in link_shapes(described, kind) if each.link == link]
    return np.ptp(np.concatenate(points), axis=0)


def test_the_length_of_an_arm():
    assert arm_length(parse_urdf(arm())) == pytest.approx(LENGTH)


@pytest.mark.parametrize("name", ["a.stl", "ascii.stl", "a.STL", "a.obj", "a.dae", "unit.dae", "inches.dae"])
@pytest.mark.parametrize("scale", ["", "1 1 1", "1 -1 1"])
def test_meshes_in_millimetres_are_scaled_and_that_is_said(tmp_path, name, scale):
    unit = 0.0254 if name == "inches.dae" else 1e-3
    declared = {"unit.dae": 1e-3, "inches.dae": 0.0254}.get(name)
    size = SIZE if unit == 1e-3 else (0.6, 0.05, 0.04)
    box(tmp_path, name, unit, size=size, declared=declared)
    metres = box(tmp_path, "base.stl", 1.0)
    described = ArmDescription.from_urdf(written(tmp_path, moved=name, base=metres, scale=scale))
    (note,) = described.notes
    what = "millimetres" if unit == 1e-3 else "units of 0.0254 m"
    assert note == f"meshes in {what} are scaled to metres: link l3"
    np.testing.assert_allclose(extent(described, "l3"), size, rtol=1e-5)
    np.testing.assert_allclose(extent(described, "l0"), SIZE, rtol=1e-5)
    assert len(CollisionChecker(described).shapes) == 2


@pytest.mark.parametrize("name", ["a.stl", "a.obj", "a.dae"])
def test_meshes_in_metres_stay(tmp_path, name):
    for unit, scale in ((1.0, ""), (1.0, "1 1 1"), (1e-3, "0.001 0.001 0.001"), (1e-3, "0.001")):
        moved = box(tmp_path, name, unit)
        described = ArmDescription.from_urdf(written(tmp_path, moved=moved, base=moved, scale=scale))
        assert len(described.notes) == (scale == "0.001")
        np.testing.assert_allclose(extent(described, "l3"), SIZE, rtol=1e-5)


def test_a_unit_that_a_scale_makes_up_for_counts_once(tmp_path):
    """Pinocchio leaves the unit of a COLLADA file alone, and so did who wrote this one."""
    moved = box(tmp_path, "a.dae", 1e-3, declared=1e-3)
    described = ArmDescription.from_urdf(written(tmp_path, moved=moved, scale="0.001 0.001 0.001"))
    assert described.notes == ()
    np.testing.assert_allclose(extent(described, "l3"), SIZE, rtol=1e-5)


def test_with_one_mesh_in_millimetres_small_ones_are_too(tmp_path):
    """A screw of 5 mm is five times as long as the arm, which alone tells nothing."""
    big, small = box(tmp_path, "big.stl", 1e-3), box(tmp_path, "small.stl", 1e-3, size=(0.005, 0.004, 0.003))
    assert FITS * LENGTH < 5
    assert FAR * LENGTH > 5
    both = ArmDescription.from_urdf(written(tmp_path, moved=big, base=small))
    assert both.notes == ("meshes in millimetres are scaled to metres: links l0, l3",)
    np.testing.assert_allclose(extent(both, "l0"), (0.005, 0.004, 0.003), rtol=1e-5)
    alone = ArmDescription.from_urdf(written(tmp_path, moved=small))
    assert alone.notes == ()


def test_from_ten_lengths_of_the_arm_on_a_mesh_is_told_alone(tmp_path):
    for lengths, told in ((9.8, False), (10.2, True)):
        side = 1e-3 * lengths * LENGTH
        moved = box(tmp_path, "a.stl", 1e-3, size=(side, side / 2, side / 2))
        described = ArmDescription.from_urdf(written(tmp_path, moved=moved))
        assert bool(described.notes) == told
        np.testing.assert_allclose(extent(described, "l3").max(), side if told else 1e3 * side, rtol=1e-5)


def test_what_cannot_be_a_link_costs_the_collisions(tmp_path):
    """Ten times as long as the arm, and in millimetres longer than it: neither is a link."""
    moved = box(tmp_path, "a.stl", 1e-6)
    described = ArmDescription.from_urdf(written(tmp_path, moved=moved))
    assert [note for note in described.notes if "a visual mesh " in note]
    assert re.search(
        "no collision checks .* the collision mesh .*a.stl' of link 'l3' is 3e\\+05 m long", described.notes[-1]
    )
    assert ArmKinematics(described).n == 6
    with pytest.raises(NoShapesError, match="scale= of its <mesh>"):
        CollisionChecker(described)


def test_a_room_around_the_arm_is_left_as_it_is(tmp_path):
    room = box(tmp_path, "room.stl", 1.0, size=(20, 20, 3))
    described = ArmDescription.from_urdf(written(tmp_path, moved="", base=room))
    (note,) = described.notes
    assert note == "a mesh is 17 times as long as the arm; if it is in millimetres, its <mesh> needs scale: link l0"
    np.testing.assert_allclose(extent(described, "l0"), (20, 20, 3), rtol=1e-5)


def test_an_arm_in_millimetres_is_named(tmp_path):
    text = re.sub(r'xyz="([^"]*)"', lambda m: f'xyz="{" ".join(str(1000 * float(v)) for v in m[1].split())}"', arm())
    file = tmp_path / "a.urdf"
    file.write_text(text)
    (note,) = ArmDescription.from_urdf(file).notes
    assert note == f"the arm is {1000 * LENGTH:.0f} m long; URDFs are in metres, and its lengths may be millimetres"


NO_MESHES = [
    b"", b"solid x", b"v 1 2 x\n", b"<COLLADA><float_array>1 nan x</float_array>", b"\0" * 84, b"\n" * 500_000,
    b"<float_array" * 100_000, b"<unit" * 100_000, b" v" * 300_000,
]  # fmt: skip


@pytest.mark.parametrize("content", NO_MESHES, ids=range(len(NO_MESHES)))
@pytest.mark.parametrize("name", ["a.stl", "a.obj", "a.dae"])
def test_what_is_no_mesh_is_not_measured(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    described = ArmDescription.from_urdf(written(tmp_path, moved=name))
    assert described.notes == ()
    assert ArmKinematics(described).n == 6


def test_arms_of_other_makers_have_no_such_meshes():
    share = Path(str(get_arm("ur5").package_root())) / "example-robot-data/robots"
    tried = 0
    for file in (
        "xarm_description/urdf/xarm7.urdf", "panda_description/urdf/panda.urdf", "ur_description/urdf/ur10_robot.urdf",
        "z1_description/urdf/z1.urdf", "kinova_description/robots/kinova.urdf",
    ):  # fmt: skip
        notes = ArmDescription.from_urdf(share / file).notes
        assert not [note for note in notes if "mesh" in note], notes
        tried += 1
    assert tried == 5


@pytest.mark.parametrize("name", ["a.stl", "a.dae"])
def test_a_scale_that_is_a_thousand_times_too_large_is_made_up_for(tmp_path, name):
    described = ArmDescription.from_urdf(written(tmp_path, moved=box(tmp_path, name, 1.0), scale="1000 1000 1000"))
    assert described.notes == ("meshes in millimetres are scaled to metres: link l3",)
    np.testing.assert_allclose(extent(described, "l3"), SIZE, rtol=1e-5)


def test_beside_one_in_millimetres_what_cannot_be_a_link_is_none_either(tmp_path):
    good, bad = box(tmp_path, "good.stl", 1e-3), box(tmp_path, "bad.stl", 1e-6)
    links = {i: MASS + shape(MESH.format(name, ""), "collision") for i, name in ((3, good), (4, bad))}
    (tmp_path / "a.urdf").write_text(arm(links=links))
    described = ArmDescription.from_urdf(tmp_path / "a.urdf")
    assert described.notes[0] == "meshes in millimetres are scaled to metres: link l3"
    assert "bad.stl' of link 'l4' is 3e+05 m long" in described.missing_shapes
    np.testing.assert_allclose(extent(described, "l3"), SIZE, rtol=1e-5)


def test_what_is_only_drawn_and_slow_to_measure_is_measured_beside_others(tmp_path, monkeypatch):
    """A large COLLADA file that is only drawn, unless it says that it has another unit."""
    solid, drawn = box(tmp_path, "solid.stl", 1e-3), box(tmp_path, "drawn.dae", 1e-3)
    declared = box(tmp_path, "declared.dae", 1e-3, declared=1e-3)
    note = "meshes in millimetres are scaled to metres: link l3"
    for names, slow, found in (
        ((solid, drawn), 0, True), ((drawn,), 0, False), ((drawn,), 2**20, True), ((declared,), 0, True),
    ):  # fmt: skip
        monkeypatch.setattr("kinreach.robots._mesh_units.SLOW", slow)
        kinds = ("collision", "visual")[-len(names) :]
        shapes = "".join(shape(MESH.format(name, ""), kind) for name, kind in zip(names, kinds, strict=True))
        (tmp_path / "a.urdf").write_text(arm(links={3: MASS + shapes}))
        described = ArmDescription.from_urdf(tmp_path / "a.urdf")
        assert described.notes == ((note,) if found else ()), names
        for kind in kinds if found else ():
            np.testing.assert_allclose(extent(described, "l3", kind), SIZE, rtol=1e-5)


def collada(folder: Path, unit: str, name: str = "a.dae") -> Path:
    (folder / name).write_text(f"<COLLADA><asset>{unit}</asset></COLLADA>")
    return folder / name


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("", 1.0), ('<unit name="inch" meter="0.0254"/>', 0.0254), ("<unit meter = '.001' name='mm'/>", 1e-3),
        ('<unit meter="1e-2"/>', 1e-2), ('<unit meter="a metre"/>', 1.0), ('<unit meter=""/>', 1.0), ("<unit/>", 1.0),
    ],
)  # fmt: skip
def test_the_unit_that_a_collada_file_names(tmp_path, monkeypatch, text, unit):
    """One that is no number is none. Only files in metres are slow to measure: those of more bytes than a bound."""
    file = collada(tmp_path, text)
    assert _mesh_units._unit_of(file.read_bytes()) == unit
    monkeypatch.setattr(_mesh_units, "SLOW", file.stat().st_size - 1)
    assert _mesh_units._is_slow(file) == (unit == 1.0)
    monkeypatch.setattr(_mesh_units, "SLOW", file.stat().st_size)
    assert not _mesh_units._is_slow(file)


def test_only_collada_files_that_can_be_read_are_slow(tmp_path, monkeypatch):
    monkeypatch.setattr(_mesh_units, "SLOW", 0)
    assert _mesh_units._is_slow(collada(tmp_path, "", "a.DAE"))
    assert not _mesh_units._is_slow(collada(tmp_path, "", "a.stl"))
    assert not _mesh_units._is_slow(tmp_path / "missing.dae")
    late = collada(tmp_path, " " * _mesh_units.ASSET + '<unit meter="0.001"/>', "late.dae")  # beyond what is read
    assert _mesh_units._is_slow(late)
    (tmp_path / "folder.dae").mkdir()
    assert not _mesh_units._is_slow(tmp_path / "folder.dae")


def test_what_is_not_measured_has_no_length(tmp_path):
    """A file that is not there, which is said elsewhere; a binary glTF file, which is in metres."""
    one = np.ones(3)
    assert _mesh_units._length(tmp_path / "missing.stl", one, 1.0) == (0.0, 1e-3)
    for name in ("a.glb", "a.GLB"):
        trimesh.creation.box((300, 50, 40)).export(tmp_path / name, file_type="glb")
        assert _mesh_units._length(tmp_path / name, one, 1.0) == (0.0, 1.0)
    box(tmp_path, "a.stl", 1e-3)
    assert _mesh_units._length(tmp_path / "a.stl", np.array([1.0, 8.0, 1.0]), 1.0) == pytest.approx((400.0, 1e-3))
