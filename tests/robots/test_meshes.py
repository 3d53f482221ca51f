"""Meshes: a plate is a shape, and a file that cannot be used is one sentence in every engine."""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
from dataclasses import replace
from functools import partial

import mujoco
import numpy as np
import pytest
import trimesh

from kinreach.errors import InputError
from kinreach.kinematics import CollisionChecker
from kinreach.robots import ArmDescription, get_arm
from kinreach.robots.inside import collision_mesh, link_shapes
from kinreach.sim.inside import build_scene

ARM3 = get_arm("arm3")
WIDE = np.array([(-0.1, -0.1, 0.5), (0.1, -0.1, 0.5), (0.1, 0.1, 0.5), (-0.1, 0.1, 0.5)])  # across the last link
TWO = np.array([(0, 1, 2), (0, 2, 3)])
#: Thickness of what is flat [m].
MIN_THICKNESS = 1e-4
BOX = trimesh.creation.box((0.2, 0.1, 0.06))
#: From a link to a GLB, which has y upwards.
Y_UP = trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0))


def with_mesh(folder, name, arm=ARM3, *, origin="0 0 0", rpy="0 0 0"):
    """The 3-DOF arm that carries a mesh at its last link, as what collides and as what is drawn."""
    shape = f'<origin xyz="{origin}" rpy="{rpy}"/><geometry><mesh filename="package://{name}"/></geometry>'
    head, link, tail = arm.urdf.partition('<link name="link_3">')
    assert link
    text = head + link + f"<collision>{shape}</collision><visual>{shape}</visual>" + tail
    return replace(arm, build_urdf=lambda: text, package_root=lambda: str(folder))


def with_box(arm, size, *, origin="0 0 0", rpy="0 0 0"):
    shape = f'<collision><origin xyz="{origin}" rpy="{rpy}"/><geometry><box size="{size}"/></geometry></collision>'
    text = arm.urdf.replace('<link name="link_3">', f'<link name="link_3">{shape}')
    return replace(arm, build_urdf=lambda: text)


def contacts(model, q):
    """Pairs of bodies that touch under MuJoCo."""
    data = mujoco.MjData(model)
    data.qpos[: len(q)] = q
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    bodies = model.geom_bodyid[data.contact.geom]
    return tuple(sorted({tuple(sorted(model.body(body).name for body in pair)) for pair in bodies}))


@pytest.mark.parametrize("turned", ["0 0 0", "0.3 -0.7 1.1"])
@pytest.mark.parametrize("kind", ["stl", "obj", "dae"])
def test_a_plate_is_a_shape(tmp_path, kind, turned):
    """Four points in a plane collide like a box of their size, in both engines."""
    flat = trimesh.Trimesh(WIDE - (0, 0, 0.5), TWO, process=False)
    flat.export(tmp_path / f"plate.{kind}")
    plate = with_mesh(tmp_path, f"plate.{kind}", origin="0.1 0 0.2", rpy=turned)
    box = with_box(ARM3, f"0.2 0.2 {MIN_THICKNESS}", origin="0.1 0 0.2", rpy=turned)
    check, expected = CollisionChecker(plate), CollisionChecker(box)
    model = build_scene(plate).compile()
    hits = 0
    for q in np.random.default_rng(0).uniform(check.kinematics.lower, check.kinematics.upper, (200, 3)):
        assert check.distance(q).distance == pytest.approx(expected.distance(q).distance, abs=1e-6)
        found = check.contacts(q)
        assert found == expected.contacts(q) == contacts(model, q)
        hits += any("link_3" in pair for pair in found)
    assert 10 < hits < 100


def test_a_plate_however_it_is_made(tmp_path):
    """Many coplanar points, a triangle, a strip, rounding, a large plate, one in millimetres: a hull with a volume."""
    rng = np.random.default_rng(0)
    grid = trimesh.creation.box((0.3, 0.2, 0)).subdivide().subdivide()
    turn = trimesh.transformations.random_rotation_matrix(rng.random(3))
    shapes = {
        "grid": (grid.vertices, grid.faces, 1.0),
        "turned": (grid.copy().apply_transform(turn).vertices, grid.faces, 1.0),
        "rough": (grid.vertices + rng.normal(0, 1e-9, grid.vertices.shape), grid.faces, 1.0),
        "triangle": (WIDE[:3], TWO[:1], 1.0),
        "strip": (WIDE * (1, 1e-4, 1), TWO, 1.0),
        "large": (WIDE * 190, TWO, 1.0),
        "millimetres": (WIDE * 1000, TWO, 0.001),
    }
    for name, (vertices, faces, scale) in shapes.items():
        trimesh.Trimesh(vertices, faces, process=False).export(tmp_path / f"{name}.stl")
        mesh = collision_mesh(f"package://{name}.stl", str(tmp_path), np.full(3, scale))
        points = mesh.vertices * scale
        hull = trimesh.Trimesh(points, mesh.faces)
        assert hull.is_watertight
        assert hull.volume > 0, name
        centred = points - points.mean(axis=0)
        least = np.ptp(centred @ np.linalg.svd(centred)[2].T, axis=0)[2]
        assert least == pytest.approx(MIN_THICKNESS, rel=0.3), name
        size = np.ptp(np.asarray(vertices) * scale, axis=0)
        np.testing.assert_allclose(np.ptp(points, axis=0), size, atol=2 * MIN_THICKNESS, rtol=1e-6)
        text = with_mesh(tmp_path, f"{name}.stl").urdf.replace(
            f'{name}.stl"', f'{name}.stl" scale="{scale} {scale} {scale}"'
        )
        arm = replace(with_mesh(tmp_path, f"{name}.stl"), build_urdf=lambda text=text: text)
        assert CollisionChecker(arm).contacts(arm.home) == contacts(build_scene(arm).compile(), arm.home)


def test_a_mesh_is_read_once_until_its_file_changes(tmp_path):
    file = tmp_path / "a.stl"
    BOX.export(file)
    read = partial(collision_mesh, "package://a.stl", str(tmp_path))
    first = read(np.ones(3))
    assert read(np.ones(3)) is first
    assert read(np.full(3, 0.001)) is not first
    with pytest.raises(ValueError, match="read-only"):
        first.vertices[0] = 0.0
    BOX.copy().apply_scale(2.0).export(tmp_path / "b.stl")
    os.replace(tmp_path / "b.stl", file)
    np.testing.assert_allclose(read(np.ones(3)).vertices, 2.0 * first.vertices)


def test_a_shape_is_the_same_in_every_format(tmp_path):
    expected = CollisionChecker(with_box(ARM3, "0.2 0.1 0.06", origin="0.05 0 0.1"))
    postures = np.random.default_rng(0).uniform(expected.kinematics.lower, expected.kinematics.upper, (50, 3))
    files = {"a.stl": "stl", "b.stl": "stl_ascii", "c.obj": "obj", "d.dae": "dae", "E.STL": "stl", "f.glb": "glb"}
    for name, told in files.items():
        upright = BOX if told != "glb" else BOX.copy().apply_transform(Y_UP)
        upright.export(tmp_path / name, file_type=told)
        arm = with_mesh(tmp_path, name, origin="0.05 0 0.1")
        check, model = CollisionChecker(arm), build_scene(arm).compile()
        for q in postures:
            assert check.distance(q).distance == pytest.approx(expected.distance(q).distance, abs=1e-6)
            assert check.contacts(q) == contacts(model, q)
        (drawn,) = link_shapes(arm, meshes_only=True)
        np.testing.assert_allclose(np.ptp(drawn.vertices, axis=0), (0.2, 0.1, 0.06), atol=1e-7)


def test_a_mirrored_mesh(tmp_path):
    """A negative scale, as in the files of arms with a left and a right side."""
    wedge = trimesh.Trimesh(BOX.vertices + (0, 0.1, 0) * (BOX.vertices[:, :1] > 0), BOX.faces, process=False)
    wedge.export(tmp_path / "wedge.stl")
    mirrored = wedge.copy().apply_transform(np.diag([1.0, -1.0, 1.0, 1.0]))
    mirrored.export(tmp_path / "mirrored.stl")
    arm = with_mesh(tmp_path, "wedge.stl")
    text = arm.urdf.replace('wedge.stl"', 'wedge.stl" scale="1 -1 1"')
    arm, expected = replace(arm, build_urdf=lambda: text), with_mesh(tmp_path, "mirrored.stl")
    check, other = CollisionChecker(arm), CollisionChecker(expected)
    model = build_scene(arm).compile()
    assert model.body("link_3").mass == pytest.approx(build_scene(expected).compile().body("link_3").mass)
    for q in np.random.default_rng(0).uniform(check.kinematics.lower, check.kinematics.upper, (100, 3)):
        assert check.distance(q).distance == pytest.approx(other.distance(q).distance, abs=1e-6)
        assert check.contacts(q) == contacts(model, q)
    (drawn,) = link_shapes(arm, meshes_only=True)
    assert trimesh.Trimesh(drawn.vertices, drawn.faces).volume == pytest.approx(mirrored.volume)


def stl(vertices, faces=TWO):
    triangles = np.zeros(len(faces), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    triangles["corners"] = np.asarray(vertices)[np.asarray(faces)]
    return bytes(80) + len(faces).to_bytes(4, "little") + triangles.tobytes()


def obj(vertices, faces=TWO):
    lines = [f"v {' '.join(map(str, v))}" for v in vertices] + [f"f {' '.join(str(i + 1) for i in f)}" for f in faces]
    return "\n".join(lines).encode() + b"\n"


def changed(value):
    corners = BOX.vertices.copy()
    corners[3, 1] = value
    return corners


def laughing_dae():
    """A scene of nodes of two nodes each, 60 deep."""
    text = BOX.export(file_type="dae").decode()
    nodes = "".join(
        f'<node id="n{i}"><instance_node url="#n{i - 1}"/><instance_node url="#n{i - 1}"/></node>' for i in range(1, 60)
    )
    geometry = text[text.index("<instance_geometry") : text.index("</instance_geometry>")] + "</instance_geometry>"
    text = text.replace(
        "<library_visual_scenes>",
        f'<library_nodes><node id="n0">{geometry}</node>{nodes}</library_nodes><library_visual_scenes>',
    )
    return text.replace(
        geometry + "</node></visual_scene>", '<instance_node url="#n59"/></node></visual_scene>'
    ).encode()


def glb(**changes) -> bytes:
    """A GLB with other entries in its JSON."""
    content = BOX.export(file_type="glb")
    size = int.from_bytes(content[12:16], "little")
    head = json.loads(content[20 : 20 + size]) | changes
    text = json.dumps(head).encode()
    text += b" " * (-len(text) % 4)
    rest = content[20 + size :]
    return content[:8] + struct.pack("<II", 20 + len(text) + len(rest), len(text)) + b"JSON" + text + rest


DAE = BOX.export(file_type="dae")
HOSTILE = {
    **{f"{name}.stl": (stl(changed(float(name)), BOX.faces), "not finite") for name in ("nan", "inf", "-inf")},
    **{f"{name}.obj": (obj(changed(float(name)), BOX.faces), "not finite|cannot be read") for name in ("nan", "inf")},
    "3e38.stl": (stl(changed(3e38), BOX.faces), "a vertex at 3e.38 m, farther than 100 m"),
    "1e300.obj": (obj(changed(1e300), BOX.faces), "a vertex at 1e.300 m, farther than 100 m"),
    "millimetres.stl": (stl(changed(700.0), BOX.faces), 'a mesh in millimetres needs scale="0.001 0.001 0.001"'),
    "line.stl": (stl(WIDE * (1, 0, 0)), "has no surface: its points are on one line"),
    "point.obj": (obj(WIDE * 0), "has no surface"),
    "nothing.stl": (b"", "cannot be read|no triangles"),
    "nothing.obj": (b"", "cannot be read|no triangles"),
    "nothing.dae": (b"", "is not XML"),
    "points.obj": (obj(WIDE, ()), "no triangles"),
    "far.obj": (obj(WIDE, [(0, 1, 99_999)]), "cannot be read|a vertex that it does not have"),
    "before.obj": (obj(WIDE, [(0, 1, -99_999)]), "cannot be read|a vertex that it does not have"),
    "doctype.dae": (b'<!DOCTYPE r SYSTEM "file:///etc/passwd">' + DAE[DAE.index(b"<COLLADA") :], "document type"),
    "laughing.dae": (laughing_dae(), "places more than"),
    "circle.dae": (
        DAE.replace(b"<node ", b'<node id="n"><instance_node url="#n"/></node><node ', 1),
        "places parts within parts without end",
    ),
    "deep.dae": (b"<node>" * 200_000, "cannot be read|is not XML"),
    "zip.dae": (b"PK\3\4" + bytes(100), "is not XML"),
    "other.3ds": (stl(BOX.vertices, BOX.faces), "is not one of .stl, .obj, .dae, .glb"),
    "nothing.glb": (b"", "is no GLB of glTF 2"),
    "cut.glb": (glb()[:60], "is no GLB of glTF 2"),
    "short.glb": (glb()[:-200], "cannot be read"),
    "bomb.glb": (glb(accessors=[{"componentType": 5126, "count": 10**12, "type": "VEC3"}] * 2), "more numbers than"),
    "parts.glb": (glb(nodes=[{"mesh": 0}] * 20_000), "places more than"),
    "circle.glb": (glb(nodes=[{"children": [0]}], scenes=[{"nodes": [0]}]), "cannot be read|no triangles"),
    "outside.glb": (glb(buffers=[{"byteLength": 9, "uri": "/etc/passwd"}]), "names other files"),
    "second.glb": (glb(buffers=[{"byteLength": 9}, {"byteLength": 9, "uri": "a.bin"}]), "names other files"),
    "image.glb": (glb(images=[{"bufferView": 0}, {"uri": "a.png"}]), "names other files"),
    "deep.glb": (b"glTF\2\0\0\0" + struct.pack("<II", 10**5 + 20, 10**5) + b"JSON" + b"[" * 10**5, "cannot be read"),
}  # fmt: skip


def test_what_is_no_mesh_is_one_sentence_of_the_reader(tmp_path):
    for name, (content, said) in HOSTILE.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=f"^the mesh .*{name}.*({said})") as refused:
            collision_mesh(f"package://{name}", str(tmp_path), np.ones(3))
        assert len(str(refused.value)) < 400
    assert len(HOSTILE) > 20


#: Prints what each engine says of each mesh; a process that dies says nothing.
TRY = """
import resource, sys
from pathlib import Path
from kinreach.errors import KinreachError
from kinreach.kinematics import CollisionChecker
from kinreach.robots.inside import link_shapes
from kinreach.sim.inside import build_scene
from tests.robots.test_meshes import with_mesh
resource.setrlimit(resource.RLIMIT_AS, (2**33, 2**33))
folder, *names = sys.argv[1:]
for name in names:
    for use in (CollisionChecker, build_scene, link_shapes):
        try:
            use(with_mesh(folder, name))
            print(name, use.__name__, 'works', flush=True)
        except KinreachError as error:
            print(name, use.__name__, 'refused:', error, flush=True)
"""


def tried(root, folder, names):
    done = subprocess.run(
        [sys.executable, "-c", TRY, str(folder), *names], capture_output=True, text=True, timeout=300, check=False,
        env={**os.environ, "PYTHONPATH": str(root)},
    )  # fmt: skip
    assert done.returncode == 0, (done.returncode, done.stdout[-500:], done.stderr[-2000:])
    lines = done.stdout.splitlines()
    assert len(lines) == 3 * len(names), lines
    return {name: [line.split(" ", 2)[2] for line in lines if line.startswith(f"{name} ")] for name in names}


@pytest.mark.slow
def test_what_is_no_mesh_is_one_sentence_in_every_engine(tmp_path, root):
    for name, (content, _) in HOSTILE.items():
        (tmp_path / name).write_bytes(content)
    os.mkfifo(tmp_path / "fifo.stl")
    (tmp_path / "folder.stl").mkdir()
    (tmp_path / "device.stl").symlink_to("/dev/zero")
    with (tmp_path / "huge.stl").open("wb") as file:
        file.truncate(2**26 + 1)
    said = {
        "fifo.stl": "it is a FIFO, not a regular file", "folder.stl": "it is a folder, not a regular file",
        "device.stl": "outside of its package", "huge.stl": f"it has {2**26 + 1} bytes, larger than 64 MiB",
        "missing.stl": "missing.stl: No such file",
    }  # fmt: skip
    expected = {name: said for name, (_, said) in HOSTILE.items()} | said
    answers = tried(root, tmp_path, list(expected))
    for name, lines in answers.items():
        drawn_only = name in ("line.stl", "point.obj")  # drawn, they are seen or not
        assert all(line.startswith("refused: the mesh ") for line in lines[: 2 if drawn_only else 3]), (name, lines)
        for line in lines[:2]:
            assert any(part in line for part in expected[name].replace("e.", "e+").split("|")), (name, line)
            assert len(line) < 400
    assert len(answers) == len(HOSTILE) + 5


@pytest.mark.slow
def test_a_mesh_opens_no_other_file(tmp_path, root):
    """`mtllib` of a pipe that nobody writes into would hang; one outside of the package would be read."""
    package = tmp_path / "robot/package"
    package.mkdir(parents=True)
    os.mkfifo(tmp_path / "robot/x.mtl")
    os.mkfifo(package / "beside.mtl")
    for name, library in (("above.obj", "../x.mtl"), ("beside.obj", "beside.mtl"), ("absolute.obj", "/dev/zero")):
        (package / name).write_bytes(f"mtllib {library}\nusemtl a\n".encode() + obj(BOX.vertices, BOX.faces))
    answers = tried(root, package, ["above.obj", "beside.obj", "absolute.obj"])
    assert all(lines == ["works"] * 3 for lines in answers.values()), answers


def test_a_link_out_of_the_package_is_refused(tmp_path):
    package, outside = tmp_path / "workspace/package", tmp_path / "elsewhere/meshes"
    (package / "meshes").mkdir(parents=True)
    outside.mkdir(parents=True)
    BOX.export(outside / "box.stl")
    (package / "meshes/link.stl").symlink_to(outside / "box.stl")
    (package / "folder").symlink_to(outside)
    BOX.export(package / "meshes/real.stl")
    (package / "meshes/inside.stl").symlink_to(package / "meshes/real.stl")
    urdf = package / "arm.urdf"
    for name in ("meshes/link.stl", "folder/box.stl"):
        arm = with_mesh(package, name)
        for use in (CollisionChecker, build_scene, link_shapes):
            with pytest.raises(InputError, match=r"is a link to .*box.stl.*, outside of its package"):
                use(arm)
        urdf.write_text(arm.urdf.replace("package://", ""))
        assert "is not found" in ArmDescription.from_urdf(urdf).missing_shapes
    urdf.write_text(with_mesh(package, "meshes/inside.stl").urdf.replace("package://", ""))
    assert CollisionChecker(ArmDescription.from_urdf(urdf)).pairs


def test_a_link_into_a_folder_that_the_caller_names_is_followed(tmp_path):
    """So ROS installs packages: `--symlink-install` links from `install/` into `src/`."""
    install, source = tmp_path / "install/share/robot", tmp_path / "src/robot"
    (install / "meshes").mkdir(parents=True)
    source.mkdir(parents=True)
    BOX.export(source / "box.stl")
    (install / "meshes/box.stl").symlink_to(source / "box.stl")
    urdf = install / "arm.urdf"
    urdf.write_text(with_mesh(install, "robot/meshes/box.stl").urdf)
    arm = ArmDescription.from_urdf(urdf, package_dirs=[install.parent, tmp_path / "src"])
    assert CollisionChecker(arm).pairs


def test_what_fails_while_a_mesh_is_read_is_said(tmp_path, monkeypatch):
    BOX.export(tmp_path / "box.stl")
    with pytest.raises(InputError, match=r"^the mesh .*cannot be read: .*null"):
        collision_mesh("package://a\0b.stl", str(tmp_path), np.ones(3))

    def greedy(*_, **__):
        raise MemoryError

    monkeypatch.setattr(trimesh, "load_scene", greedy)
    with pytest.raises(InputError, match=r"^the mesh 'package://box.stl' cannot be read: there is not enough memory$"):
        collision_mesh("package://box.stl", str(tmp_path), np.ones(3))
