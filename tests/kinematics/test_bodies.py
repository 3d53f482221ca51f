"""Overlap of boxes against coal, and the bodies that stand for meshes."""

from __future__ import annotations

import numpy as np
import pytest

from kinreach.engines import load
from kinreach.errors import InputError
from kinreach.kinematics.bodies import fitted, overlap
from kinreach.kinematics.collision import CollisionChecker

pin, coal = load("pinocchio"), load("coal")


def test_sharp_boxes_overlap_as_in_coal():
    rng = np.random.default_rng(0)
    count = 3000
    half, box_half = rng.uniform(0.02, 0.3, (2, 3, count))
    offset = rng.uniform(-0.4, 0.4, (3, count))
    axes = np.empty((3, 3, count))
    truth = np.empty(count, dtype=bool)
    gap = np.empty(count)
    for k in range(count):
        pose = pin.SE3.Random()
        axes[:, :, k] = pose.rotation.T
        one, other = coal.Box(*(2 * half[:, k])), coal.Box(*(2 * box_half[:, k]))
        place = coal.Transform3s(pose.rotation, offset[:, k])
        result = coal.DistanceResult()
        gap[k] = coal.distance(one, place, other, coal.Transform3s(), coal.DistanceRequest(), result)
        truth[k] = gap[k] <= 0
    single = [x.astype(np.float32) for x in (axes, half, np.zeros(count), offset, box_half)]
    clear = np.abs(gap) > 1e-5
    assert 0.3 < truth.mean() < 0.8
    assert clear.mean() > 0.99
    np.testing.assert_array_equal(overlap(*single)[clear], truth[clear])


def test_rounding_makes_a_box_thicker():
    axes = np.eye(3, dtype=np.float32)[..., None]
    half = np.full((3, 1), 0.1, dtype=np.float32)
    for gap, touches in ((0.019, True), (0.021, False)):
        offset = np.array([[0.2 + gap], [0.0], [0.0]], dtype=np.float32)
        assert overlap(axes, half, np.array([0.02], dtype=np.float32), offset, half)[0] == touches


def test_bodies_reach_as_far_as_the_shapes_they_stand_for():
    directions = np.random.default_rng(0).standard_normal((400, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    exact = 0
    for shape in CollisionChecker("ur5").geometry.geometryObjects:
        bodies = list(fitted("", 0, shape))
        reach = np.max([directions @ b.centre + np.abs(directions) @ b.half + b.radius for b in bodies], axis=0)
        if isinstance(shape.geometry, coal.Box):
            corners = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T * shape.geometry.halfSide
            bound = 1e-9
            exact += bodies[0].radius == 0.0
        else:
            corners = np.array([shape.geometry.point(k) for k in range(shape.geometry.num_points)])
            bound = 0.05  # the base, whose corners are those of a cylinder
        points = corners @ shape.placement.rotation.T + shape.placement.translation
        np.testing.assert_allclose(reach, (directions @ points.T).max(axis=1), rtol=0, atol=bound)
    assert exact == 8


def test_other_shapes_are_refused():
    shape = pin.GeometryObject("ball", 0, pin.SE3.Identity(), coal.Sphere(0.1))
    with pytest.raises(InputError, match="ball"):
        list(fitted("ball", 0, shape))
