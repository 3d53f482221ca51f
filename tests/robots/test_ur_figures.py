"""The figures that UR models without a mesh are drawn by: closed, within the cylinders, and nothing but drawn."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from itertools import combinations

import numpy as np
import pytest
import trimesh

from kinreach.kinematics import CollisionChecker
from kinreach.robots import PUBLISHED_CALIBRATIONS, ArmDescription, Tool, get_arm
from kinreach.robots.inside import TOOL_BODY, UR_LENGTHS, link_shapes, origin_of, without_shapes
from kinreach.sim.inside import build_scene

#: All models but those that example-robot-data has meshes of.
MODELS = [
    pytest.param(name, marks=[] if name in ("ur3e", "ur5e", "ur20") else pytest.mark.slow)
    for name in UR_LENGTHS
    if name not in ("ur3", "ur5", "ur10")
]
LINKS = ("base_link", "shoulder_link", "upper_arm_link", "forearm_link", "wrist_1_link", "wrist_2_link", "wrist_3_link")


def counted(arm, which=lambda part: True):
    """How many parts each link has."""
    return Counter(part.link for part in link_shapes(arm) if which(part))


@pytest.mark.parametrize("name", MODELS)
def test_a_figure_is_closed_and_within_the_cylinders_that_collide(name):
    arm = get_arm(name)
    parts = link_shapes(arm)
    cylinders = {link.get("name"): list(link.iter("collision")) for link in arm.robot.iter("link")}
    for part in parts:
        mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
        assert mesh.volume > 0
        assert (np.einsum("fj,fcj->fc", mesh.face_normals, part.normals[part.faces]) > 0.5).all()
        np.testing.assert_allclose(np.linalg.norm(part.normals, axis=1), 1.0)
        out = []
        for solid in cylinders[part.link]:
            cylinder, T = solid.find("geometry/cylinder"), np.linalg.inv(origin_of(solid))
            points = part.vertices @ T[:3, :3].T + T[:3, 3]
            sideways = np.linalg.norm(points[:, :2], axis=1) - float(cylinder.get("radius"))
            out.append(np.maximum(sideways, np.abs(points[:, 2]) - float(cylinder.get("length")) / 2))
        assert np.min(out, axis=0).max() < 1e-9, part.link
        edges = np.unique(np.round(part.vertices, 9), axis=0, return_inverse=True)[1].ravel()[part.faces]
        pairs = Counter(frozenset(pair) for face in edges for pair in combinations(face.tolist(), 2))
        assert set(pairs.values()) == {2}
    assert {part.link for part in parts} == set(LINKS)
    assert sum(len(part.vertices) for part in parts) > 10_000
    caps = Counter(part.link for part in parts if part.rgba[2] > 1.5 * part.rgba[0])
    assert caps == dict(zip(LINKS[1:-1], (1, 2, 1, 1, 1), strict=True)), "six joints have six caps"


def test_an_arm_with_a_tool_or_a_calibration_keeps_its_figure():
    plain = counted(get_arm("ur10e"))
    calibration = next(each for name, each in PUBLISHED_CALIBRATIONS.items() if name.startswith("ur10e"))
    tool = Tool.tube([0.0, 0.0, 0.15, 0.0, 0.0, 0.0], 0.03)
    assert set(plain) == set(LINKS)
    assert counted(get_arm("ur10e").calibrated(calibration)) == plain
    assert set(counted(get_arm("ur10e").with_tool(tool)) - plain) == {TOOL_BODY}


def test_a_link_that_is_not_drawn_by_those_cylinders_is_drawn_as_its_urdf_says():
    robot = ET.fromstring(get_arm("ur5e").urdf)
    cylinder = next(link for link in robot.iter("link") if link.get("name") == "forearm_link").find(".//cylinder")
    cylinder.set("radius", "0.05")
    changed = ArmDescription("own", "own", lambda: robot, tips={"tool0": "tool0"})
    assert counted(get_arm("ur5e")) - counted(changed) == {"forearm_link": 3}
    bare = ArmDescription("bare", "bare", lambda: without_shapes(get_arm("ur5e").robot, "visual"))
    assert link_shapes(bare) == []


def test_figures_are_drawn_only():
    """What collides and what weighs is the same to the last bit, with the figure and without."""
    arm = get_arm("ur5e")
    bare = ArmDescription("bare", "bare", lambda: without_shapes(arm.robot, "visual"), base="base_link")
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (200, 6))
    checkers = [CollisionChecker(each, obstacles=()) for each in (arm, bare)]
    verdicts = [checker.impossible(q) for checker in checkers]
    np.testing.assert_array_equal(*verdicts)
    assert 20 < verdicts[0].sum() < 180

    plain, drawn = (build_scene(arm, visual=visual).compile() for visual in (False, True))
    shown = drawn.geom_dataid >= 0
    assert len({drawn.body(body).name for body in drawn.geom_bodyid[shown]} & set(LINKS)) == len(LINKS)
    assert not (drawn.geom_contype[shown] | drawn.geom_conaffinity[shown]).any()
    hard = [(model.geom_contype | model.geom_conaffinity) > 0 for model in (plain, drawn)]
    for each in ("bodyid", "type", "size", "pos", "quat", "contype", "conaffinity", "friction", "margin"):
        one, other = (getattr(model, f"geom_{each}")[own] for model, own in zip((plain, drawn), hard, strict=True))
        np.testing.assert_array_equal(one, other)
    for each in ("mass", "inertia", "ipos", "iquat", "pos", "quat"):
        np.testing.assert_array_equal(getattr(plain, f"body_{each}"), getattr(drawn, f"body_{each}"))
