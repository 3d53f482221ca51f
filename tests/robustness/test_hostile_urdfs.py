"""Descriptions of arms that do not hold, or want to read what is none of theirs: refused before an engine sees them."""

import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import strategies as st

from kinreach.errors import InputError, KinreachError
from kinreach.kinematics import ArmKinematics, CollisionChecker, PlacoSolver
from kinreach.robots import ArmDescription, get_arm
from kinreach.sim.inside import build_scene
from tests.robustness.fuzzing import things

ARM3, UR5 = get_arm("arm3"), get_arm("ur5")
LAUGHS = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 12))
BOMBS = {
    "billion laughs": f'<!DOCTYPE r [<!ENTITY l0 "ha">{LAUGHS}]><robot name="&l11;"/>',
    "external entity": '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot name="a">&x;</robot>',
    "external subset": '<!DOCTYPE robot SYSTEM "http://127.0.0.1:9/x.dtd"><robot name="a"/>',
    "parameter entity": '<!DOCTYPE r [<!ENTITY % p SYSTEM "file:///etc/passwd"> %p;]><robot name="a"/>',
    "deep": "<a>" * 100_000,
    "wide": "<robot name='a'>" + "".join(f"<link name='l{i}'/>" for i in range(5000)) + "</robot>",
    "long": "<robot name='a'>" + " " * 2**24 + "</robot>",
    "null": "<robot name='a'>\0</robot>",
    "surrogate": "<robot name='\ud800'/>",
    "nothing": "",
    "other": "<mujoco><include file='/etc/passwd'/></mujoco>",
}
MESHES = [
    "/etc/passwd", "package:///etc/passwd", "package://../../../../etc/passwd", "file:///etc/passwd", "../x.stl",
    "package://a/../../x.stl", "http://127.0.0.1/x.stl", "package://a\u202e.stl", "PACKAGE://x.stl", "",
]  # fmt: skip


def arm_of(text, arm=ARM3):
    return replace(arm, build_urdf=lambda: text)


@pytest.mark.parametrize("name", BOMBS)
def test_bombs_are_refused_at_once(name):
    with pytest.raises(InputError):
        ArmKinematics(arm_of(BOMBS[name]))


@pytest.mark.parametrize("file", MESHES)
def test_meshes_outside_the_package_are_refused(file):
    inside = "package://example-robot-data/robots"
    assert inside in UR5.urdf
    ET.register_namespace("", "")
    robot = ET.fromstring(UR5.urdf)
    next(robot.iter("mesh")).set("filename", file)
    text = ET.tostring(robot, encoding="unicode")
    for use in (ArmKinematics, CollisionChecker, build_scene):
        with pytest.raises(InputError, match="files of a URDF"):
            use(arm_of(text, UR5))
    with pytest.raises(InputError, match="files of a URDF"):
        ArmKinematics(ArmDescription("mine", "mine", lambda: UR5.urdf))


@st.composite
def damaged(draw):
    """The text of the 3-DOF arm with something cut out, put in, doubled or changed."""
    text = ARM3.urdf
    how = draw(st.sampled_from(["cut", "bytes", "attribute", "remove", "double", "thing"]))
    if how == "cut":
        return text[: draw(st.integers(0, len(text)))]
    if how == "bytes":
        at = draw(st.integers(0, len(text) - 1))
        return text[:at] + draw(st.text(max_size=3)) + text[at + draw(st.integers(0, 9)) :]
    if how == "thing":
        return draw(things())
    robot = ET.fromstring(text)
    element = draw(st.sampled_from(list(robot.iter())[1:]))
    parent = next(candidate for candidate in robot.iter() if element in list(candidate))
    if how == "attribute" and element.attrib:
        wild = st.sampled_from(
            ["nan", "inf", "-1", "0", "1e308", "", "x", "0 0 0", "1 2", "nan 0 0", "world", "tip", "floating"]
        )
        element.set(draw(st.sampled_from(list(element.attrib))), draw(wild))
    elif how == "double":
        parent.append(element)
    else:
        parent.remove(element)
    return ET.tostring(robot, encoding="unicode")


def test_damaged_descriptions(fuzzed):
    def run(text):
        arm = arm_of(text)
        kin = ArmKinematics(arm)
        assert np.isfinite(kin.fk(np.zeros(3))).all()
        check = CollisionChecker(kin)
        assert check.in_collision(np.zeros(3)) is bool(check.contacts(np.zeros(3)))
        PlacoSolver(kin)
        model = build_scene(arm, visual=False).compile()
        assert model.njnt == 3

    fuzzed(damaged(), run, share=0.8)


@pytest.mark.slow
def test_damaged_meshes_do_not_end_the_process(tmp_path, root):
    """Truncated and random mesh files, read by the collision checker in a process of its own."""
    code = (
        "import resource, sys\n"
        "from dataclasses import replace\n"
        "from kinreach.errors import KinreachError\n"
        "from kinreach.kinematics import CollisionChecker\n"
        "from kinreach.robots import get_arm\n"
        "resource.setrlimit(resource.RLIMIT_AS, (2**33, 2**33))\n"
        "folder, *names = sys.argv[1:]\n"
        "for name in names:\n"
        "    text = get_arm('arm3').urdf\n"
        "    start = text.index('<collision'); start = text.index('<geometry>', start) + 10\n"
        "    end = text.index('</geometry>', start)\n"
        "    text = text[:start] + f'<mesh filename=\"package://{name}\"/>' + text[end:]\n"
        "    arm = replace(get_arm('arm3'), build_urdf=lambda: text, package_root=lambda: folder)\n"
        "    try:\n"
        "        CollisionChecker(arm)\n"
        "        print('read', name)\n"
        "    except KinreachError:\n"
        "        print('refused', name)\n"
    )
    rng = np.random.default_rng(0)
    triangle = np.zeros(1, dtype=[("numbers", "<f4", 12), ("attribute", "<u2")])
    head = b"\0" * 80
    contents = {
        "empty.stl": b"",
        "short.stl": head,
        "claims.stl": head + (2**32 - 1).to_bytes(4, "little") + triangle.tobytes(),
        "flat.stl": head + (4).to_bytes(4, "little") + 4 * triangle.tobytes(),
        "random.stl": rng.bytes(3000),
        "random.dae": rng.bytes(3000),
        "laughs.dae": BOMBS["billion laughs"].encode(),
        "text.obj": b"v 0 0 0\nf 1 2 99999\n",
        "text.stl": b"solid x\n facet normal 0 0\n",
    }
    for name, content in contents.items():
        (tmp_path / name).write_bytes(content)
    names = [*contents, "missing.stl"]
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path), *names], capture_output=True, text=True, timeout=300, check=False,
        env={**os.environ, "PYTHONPATH": str(root)},
    )  # fmt: skip
    assert done.stdout.splitlines() == [f"refused {name}" for name in names], done.stderr[-2000:]
    assert done.returncode == 0, done.stderr[-2000:]


@pytest.mark.parametrize(
    "change",
    [
        {"joints": ("nowhere", "link_2_joint", "link_3_joint")}, {"base": "nowhere"}, {"default_tip": "nowhere"},
        {"build_urdf": lambda: None}, {"build_urdf": lambda: b"<robot/>"}, {"tips": {"end_effector": "nowhere"}},
    ],
)  # fmt: skip
def test_descriptions_that_do_not_fit_their_urdf(change):
    with pytest.raises(KinreachError):
        ArmKinematics(replace(ARM3, **change))
