"""The pentagon's angles, measured at the corners that forward kinematics gives, against the reward's own."""

from __future__ import annotations

import math

import numpy as np
import pytest

from kinreach.kinematics import URKinematics
from kinreach.thesis import posture_error
from kinreach.vision import Intrinsics
from notebooks.figures import draw_pentagon_angles, draw_pentagons, pentagon_of, side_camera

GROUND = -0.20


@pytest.fixture(scope="module")
def kin() -> URKinematics:
    return URKinematics("ur5-thesis", tip="tcp", base="world")


@pytest.fixture(scope="module")
def natural(kin) -> np.ndarray:
    """Both branches at 40 places of the table, tool straight down."""
    home = np.array(kin.arm.home)
    found = []
    for goal in kin.arm.workcell.goals.sample(np.random.default_rng(0), 40):
        q = kin.axis_solutions(goal, (0, 0, -1), seed=home).q
        found += list(q[posture_error(q) < 1e-6])
    assert len(found) == 80
    return np.array(found)


def sweep(start: np.ndarray, end: np.ndarray) -> float:
    """Angle counterclockwise from one direction to another, 0 to 2 pi."""
    return (math.atan2(*end[::-1]) - math.atan2(*start[::-1])) % (2 * math.pi)


def apart(one: float, other: float) -> float:
    return abs((one - other + math.pi) % (2 * math.pi) - math.pi)


def test_corners_have_the_angles_of_the_reward(kin, natural):
    """Also with the tool tilted in the arm's plane, and with the arm anywhere in it."""
    rng = np.random.default_rng(1)
    cases = 0
    for q in natural:
        for tilt in (0.0, *rng.uniform(-1.2, 1.2, 3)):
            pentagon = pentagon_of(q + np.eye(6)[3] * tilt, ground=GROUND, kinematics=kin)
            foot, shoulder, elbow, wrist, gripper = pentagon.corners
            alpha, beta, gamma, delta = pentagon.angles
            inside = [
                sweep(gripper - foot, shoulder - foot),
                sweep(foot - shoulder, elbow - shoulder),
                sweep(shoulder - elbow, wrist - elbow),
                sweep(elbow - wrist, gripper - wrist),
                sweep(wrist - gripper, foot - gripper),
            ]
            if gripper[0] < 0.01:  # the tool points back past the foot: no pentagon any more
                continue
            expected = [math.pi / 2, math.pi / 2 + alpha, math.pi - beta, gamma, delta]
            assert max(map(apart, inside, expected)) < 1e-9
            assert sum(inside) == pytest.approx(3 * math.pi)
            cases += 1
    assert cases > 250


def test_links_have_their_lengths(kin, natural):
    for q in natural:
        _, shoulder, elbow, wrist, _ = pentagon_of(q, ground=GROUND, kinematics=kin).corners
        assert np.linalg.norm(elbow - shoulder) == pytest.approx(abs(kin.geometry.a2), abs=1e-9)
        assert np.linalg.norm(wrist - elbow) == pytest.approx(abs(kin.geometry.a3), abs=1e-9)
    assert len(natural) == 80


def test_the_last_joint_of_a_drawing_is_the_tip(kin, natural):
    for q in natural:
        pentagon = pentagon_of(q, ground=GROUND, kinematics=kin)
        tip = kin.fk(q)[:3, 3]
        assert pentagon.joints[-1] == pytest.approx([tip @ pentagon.forward, tip[2]], abs=1e-9)
        assert pentagon.joints[-1, 0] > 0
    assert len(natural) == 80


def test_turn_says_which_way_a_joint_turns(kin, natural):
    cases = 0
    for q in natural:
        here, there = (pentagon_of(q + np.eye(6)[1] * step, ground=GROUND, kinematics=kin) for step in (0.0, 1e-4))
        turned = sweep(here.corners[2] - here.corners[1], there.corners[2] - there.corners[1])
        assert apart(turned, here.turn * 1e-4) < 1e-8
        cases += 1
    assert cases == 80
    assert {pentagon_of(q, ground=GROUND, kinematics=kin).turn for q in natural} == {1.0, -1.0}


def test_side_camera_sees_what_it_says(kin, natural):
    """Corners projected by a pinhole camera land where the extent puts them."""
    width, height = 640, 560
    cases = 0
    for q in natural[::8]:
        pentagon = pentagon_of(q, ground=GROUND, kinematics=kin)
        mount, (left, right, bottom, top) = side_camera(pentagon, width=width, height=height)
        camera = Intrinsics.from_fovy(mount.fovy, width, height)
        back = np.subtract(mount.position, mount.target)
        back /= np.linalg.norm(back)
        across = np.cross(mount.up, back)
        world = np.outer(pentagon.corners[:, 0], pentagon.forward) + np.outer(pentagon.corners[:, 1], (0, 0, 1))
        local = (world - mount.position) @ np.column_stack([across, -np.cross(back, across), -back])
        u, v = camera.project(local).T
        x = left + (u + 0.5) / width * (right - left)
        z = top + (v + 0.5) / height * (bottom - top)
        assert np.column_stack([x, z]) == pytest.approx(pentagon.corners, abs=1e-9)
        cases += 1
    assert cases == 10


def test_figures_write_the_angles(kin, natural, texts):
    pentagons = {"A": pentagon_of(natural[0], ground=GROUND, kinematics=kin)}
    written = texts(draw_pentagons(pentagons))
    for letter, angle in zip("αγδ", np.array(pentagons["A"].angles)[[0, 2, 3]], strict=True):
        assert f"{letter} = {math.degrees(angle):.0f}°" in written
    circles = texts(draw_pentagon_angles(pentagons["A"]))
    assert sum(text.startswith(("j1 =", "j2 =", "j3 =")) for text in circles) == 3
