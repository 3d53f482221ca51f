"""Cameras, their noise, and the ball finder under fuzz; and that no picture makes up a ball."""

import math

import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from kinreach.sim import ArmSimulation
from kinreach.sim.inside import FrameRenderer
from kinreach.vision import Intrinsics, RGBDCamera, RGBDImage, SensorNoise, circle_votes, edge_steps, find_ball
from kinreach.vision.inside import PIPELINES, BallFix
from tests.robustness.fuzzing import NUMBERS, THINGS, bad_arrays, dressed, things

WIDTH, HEIGHT, RADIUS = 96, 64, 0.025
CAMERA = Intrinsics.from_fovy(58.0, WIDTH, HEIGHT)
SIZE = (HEIGHT, WIDTH)
names = st.sampled_from(sorted(PIPELINES))
numbers = st.floats(0.0, 1e3) | NUMBERS | things() | st.integers(-2, 10**20)
pictures = arrays(np.uint8, (*SIZE, 3), elements=st.sampled_from([0, 12, 190, 255]))
depths = arrays(np.float64, SIZE, elements=st.floats(0.2, 1.2) | NUMBERS)


def with_ball(u, v, z):
    """A ball's disk and depth, flat, in front of a wall."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    disk = (columns - u) ** 2 + (rows - v) ** 2 <= (CAMERA.fx * RADIUS / z) ** 2
    rgb, depth = np.full((*SIZE, 3), 110, np.uint8), np.full(SIZE, 0.9)
    rgb[disk], depth[disk] = (190, 12, 10), z - RADIUS
    return rgb, depth


balls = st.builds(with_ball, st.floats(0, WIDTH), st.floats(0, HEIGHT), st.floats(0.3, 0.8))


def holds(fix, camera, radius):
    """A ball that was found is in front of the camera, in its picture, and a number."""
    assert fix is None or isinstance(fix, BallFix)
    if fix is not None:
        assert fix.position.shape == (3,)
        assert np.isfinite(fix.position).all()
        assert np.isfinite(fix.circle).all()
        assert fix.position[2] > 0
        u, v = camera.project(fix.position)
        assert -radius * camera.fx <= u <= camera.width + radius * camera.fx
        assert -radius * camera.fy <= v <= camera.height + radius * camera.fy


def test_arguments_of_the_ball_finder(fuzzed):
    good_rgb, good_depth = with_ball(40.0, 30.0, 0.5)
    choices = [
        st.just(good_rgb) | bad_arrays((*SIZE, 3)),
        st.just(good_depth) | bad_arrays(SIZE),
        st.just(CAMERA) | things(),
        st.just(RADIUS) | numbers,
        names | things(),
    ]

    def run(case):
        rgb, depth, camera, radius, pipeline = case
        holds(find_ball(rgb, depth, camera, radius, pipeline=pipeline), camera, radius)

    good = [st.just(good_rgb), st.just(good_depth), st.just(CAMERA), st.just(RADIUS), names]
    one_bad = st.integers(0, 5).flatmap(lambda k: st.tuples(*(choices[i] if i == k else good[i] for i in range(5))))
    fuzzed(one_bad | st.tuples(*choices), run)


def test_any_picture(fuzzed):
    """Wild colours and depths: a ball or none, never an error."""
    wild = balls.flatmap(lambda pair: st.tuples(st.just(pair[0]), depths)) | st.tuples(pictures, depths) | balls
    kinds = st.sampled_from(["f2", "f4", "f8", ">f4", "i4", "u1"])

    def run(case):
        (rgb, depth), kind, pipeline = case
        with np.errstate(over="ignore", invalid="ignore"):
            depth = depth.astype(kind)
        holds(find_ball(rgb, depth, CAMERA, RADIUS, pipeline=pipeline), CAMERA, RADIUS)

    fuzzed(st.tuples(wild, kinds, names), run, both=False)


def test_pictures_in_other_clothes(fuzzed):
    """Strides, read-only memory, lists and bytes of another order make no difference."""

    def run(case):
        (rgb, odd_rgb), (depth, odd_depth), pipeline = case
        plain = find_ball(rgb, depth, CAMERA, RADIUS, pipeline=pipeline)
        odd = find_ball(np.asarray(odd_rgb).astype(np.uint8), odd_depth, CAMERA, RADIUS, pipeline=pipeline)
        assert (plain is None) is (odd is None)
        if plain is not None:
            np.testing.assert_array_equal(plain.position, odd.position)

    pairs = balls.flatmap(lambda pair: st.tuples(dressed(st.just(pair[0])), dressed(st.just(pair[1])), names))
    fuzzed(pairs, run, both=False)


def test_steps_of_the_search(fuzzed):
    """The pictures in between, for figures: of any picture, or refused."""
    edges = with_ball(40.0, 30.0, 0.5)[0][..., 0] > 150

    def run(case):
        which, picture, radius = case
        if which:
            assert {step.shape for step in edge_steps(picture)} == {np.shape(picture)[:2]}
        else:
            votes = circle_votes(picture, radius)
            assert votes.shape == np.shape(picture)
            assert 0 <= votes.min(initial=0) <= votes.max(initial=0) <= np.count_nonzero(picture)

    bad = st.sampled_from([np.zeros((0, 0, 3), np.uint8), np.zeros((0, 4, 3), np.uint8), np.zeros((0, 4), bool)])
    rgb = st.tuples(st.just(True), dressed(pictures).map(lambda pair: pair[1]) | bad_arrays((5, 7, 3)) | bad, numbers)
    flags = arrays(np.bool_, (5, 7)) | st.just(edges)
    votes = st.tuples(st.just(False), flags | flags | bad_arrays((5, 7)) | bad, st.floats(0.5, 30) | numbers)
    fuzzed(rgb | votes, run)


def test_intrinsics(fuzzed):
    def run(case):
        how, values = case
        camera = Intrinsics.from_fovy(*values[:3]) if how else Intrinsics(*values)
        u, v = camera.project([0.0, 0.0, 1.0])
        assert (u, v) == pytest.approx((camera.cx, camera.cy))
        points = camera.deproject([0.0, camera.width], [0.0, camera.height], 0.5)
        assert np.isfinite(points).all()
        np.testing.assert_allclose(
            camera.project(points), [[0, 0], [camera.width, camera.height]], atol=1e-6 * (1 + abs(u) + abs(v))
        )

    good = st.tuples(st.just(640), st.just(360), *[st.floats(10, 1000)] * 4)
    fovy = st.tuples(st.floats(1, 170), st.integers(1, 5000), st.integers(1, 5000))
    fuzzed(st.tuples(st.booleans(), good | fovy.map(lambda t: (*t, 1.0, 1.0, 1.0)) | st.tuples(*[numbers] * 6)), run)


def test_projection(fuzzed):
    def project(points):
        assert np.isfinite(CAMERA.project(points)).all()

    def deproject(case):
        points = CAMERA.deproject(*case)
        depth = np.broadcast_to(np.asarray(case[2], dtype=float), points.shape[:-1])
        np.testing.assert_array_equal(points[..., 2], depth)
        assert np.isfinite(points[np.abs(depth) < 1e290]).all()

    fuzzed(bad_arrays((3,)) | bad_arrays((4, 3)) | arrays(np.float64, (2, 3), elements=st.floats(0.1, 9)), project)
    fuzzed(st.tuples(*[bad_arrays((2,)) | st.floats(0, 90)] * 3) | st.tuples(*[NUMBERS] * 3), deproject)


def test_noise(fuzzed):
    rgb, depth = with_ball(40.0, 30.0, 0.5)
    image = RGBDImage(rgb, depth.astype(np.float32))

    def run(sigmas):
        noisy = SensorNoise(*sigmas).apply(image, np.random.default_rng(0))
        assert noisy.rgb.dtype == np.uint8
        assert np.isfinite(noisy.depth).all()
        assert noisy.depth.min() >= 0

    fuzzed(st.tuples(numbers, numbers), run)


def test_cameras_and_frames(fuzzed):
    simulation = ArmSimulation("ur5-thesis")
    known = [simulation.model.camera(i).name for i in range(simulation.model.ncam)]

    def camera(case):
        name, width, height = case
        with RGBDCamera(simulation, name, width=width, height=height) as found:
            assert found.name in known
            assert math.isfinite(found.intrinsics.fx)

    sizes = st.integers(1, 1000) | numbers
    fuzzed(st.tuples(st.sampled_from([*known, *known, *THINGS]), sizes, sizes), camera)


def test_sizes_of_frames():
    """Only refused ones: none of them opens a graphics library."""
    model = ArmSimulation("ur5-thesis").model
    bad = [0, -1, 4000, 10**30, 1.5, math.nan, True, *THINGS]
    refused = 0
    for value in bad:
        for size in ({"width": value}, {"height": value}):
            with pytest.raises(Exception) as caught:  # noqa: PT011
                FrameRenderer(model, **size)
            assert type(caught.value).__name__ == "InputError", (size, caught.value)
            refused += 1
    assert refused == 2 * len(bad) >= 80
