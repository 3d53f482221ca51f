"""Where goals may be is checked when it is said."""

import numpy as np
import pytest

from kinreach.errors import InputError
from kinreach.robots import Box, BoxRegion, CameraMount, QuadrantRegion, Workcell


@pytest.mark.parametrize("bad", [(0.5, 0.3), (np.nan, 0.3), (0.3,), (0.1, 0.2, 0.3), "ab", None, (-np.inf, 0.0)])
@pytest.mark.parametrize("coordinate", ["x", "y", "z"])
def test_ranges_that_are_none_are_refused_by_name(coordinate, bad):
    ranges = {"x": (0.3, 0.6), "y": (-0.2, 0.2), "z": (0.1, 0.1), coordinate: bad}
    with pytest.raises(InputError, match=rf"\b{coordinate}\b"):
        BoxRegion(**ranges)


def test_goals_are_in_their_quadrants():
    region = QuadrantRegion(across=(0.2, 0.6), height=(0.1, 0.5))
    drawn = region.sample(np.random.default_rng(0), 500)
    assert drawn.shape == (500, 3)
    assert ((np.abs(drawn[:, :2]) >= 0.2) & (np.abs(drawn[:, :2]) <= 0.6)).all()
    assert ((drawn[:, 2] >= 0.1) & (drawn[:, 2] <= 0.5)).all()
    assert np.ptp(drawn[:, 2]) > 0.39
    assert len({tuple(row) for row in np.sign(drawn[:, :2])}) == 4


def test_a_box_of_goals_can_be_wider():
    wide = BoxRegion((0.3, 0.6), (-0.2, 0.2), (0.1, 0.4)).wider(0.1, above=0.5)
    np.testing.assert_allclose((wide.x, wide.y, wide.z), [(0.2, 0.7), (-0.3, 0.3), (0.1, 0.9)])
    assert BoxRegion((0, 1), (0, 1), (0, 1)).wider(0.0) == BoxRegion((0, 1), (0, 1), (0, 1))


def test_goals_are_in_their_box():
    low, high = np.array([0.3, -0.2, 0.1]), np.array([0.6, 0.2, 0.1])
    drawn = BoxRegion(*zip(low.tolist(), high.tolist(), strict=True)).sample(np.random.default_rng(0), 500)
    assert len(drawn) == 500
    assert ((drawn >= low) & (drawn <= high)).all()


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        ({"obstacles": ("x",)}, "obstacles of a work cell must be a list of Box"),
        ({"obstacles": (Box("a", (1, 1, 1), (0, 0, 0)),) * 2}, "two obstacles are named 'a'"),
        ({"touching": ("table",)}, "touching must be pairs"),
        ({"goals": "everywhere"}, "goals must be a region"),
        ({"ball_radius": "a"}, "ball_radius must be a number"),
        ({"ball_radius": 0.0}, "ball_radius must be finite and above 0"),
        ({"reached_distance": -0.1}, "reached_distance must be finite and above 0"),
    ],
)
def test_what_no_cell_can_have_is_refused(facts, said):
    with pytest.raises(InputError, match=said):
        Workcell(**facts)


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        ({"name": ""}, "the name of a box must be text"),
        ({"name": 5}, "the name of a box must be text"),
        ({"size": (1, 1)}, "the size of the box 'crate' must be three numbers"),
        ({"size": 1.0}, "the size of the box 'crate' must be three numbers"),
        ({"size": (1, 1, 0)}, "the size of the box 'crate' must be finite and above 0"),
        ({"size": (1, 1, 1001)}, "the size of the box 'crate' must be .* at most 1000"),
        ({"position": (0, 0, np.nan)}, "the position of the box 'crate' must be finite"),
        ({"position": (0, 0, -1001)}, "the position of the box 'crate' must be .* at least -1000"),
        ({"position": "abc"}, "the position of the box 'crate' must be a number"),
        ({"legs": -0.1}, "the legs of the box 'crate' must be finite and at least 0"),
        ({"legs": 1001}, "the legs of the box 'crate' must be .* at most 1000"),
    ],
)
def test_what_no_box_can_have_is_refused(facts, said):
    good = {"name": "crate", "size": (1000, 1, 1), "position": (-1000, 0, 1000)}
    assert Box(**good).legs == 0.0
    with pytest.raises(InputError, match=said):
        Box(**good | facts)


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        ({"name": 5}, "name of a camera must be text"),
        ({"link": ""}, "link of the camera 'eye' must be text"),
        ({"fovy": -3.0}, "fovy of the camera 'eye' must be finite and above 0 and at most 179"),
        ({"position": (0.0, 0.0)}, "position of the camera 'eye' must have shape"),
        ({"target": (0.0, np.nan, 0.0)}, "target of the camera 'eye' must be finite"),
        ({"target": (0.0, 0.0, 1.0)}, "must not be where it stands"),
        ({"target": (0.0, 0.0, 5.0)}, "nor up or down from there"),
        ({"up": (0.0, 0.0, 0.0)}, "nor up or down from there"),
        ({"holder": 3.0}, "holder of the camera 'eye'"),
    ],
)
def test_what_no_camera_can_have_is_refused(facts, said):
    good = {"name": "eye", "link": "world", "position": (0.0, 0.0, 1.0), "target": (1.0, 0.0, 0.0)}
    assert CameraMount(**good).fovy == 58.0
    with pytest.raises(InputError, match=said):
        CameraMount(**good | facts)


@pytest.mark.parametrize("facts", [{"across": (0.6, 0.2)}, {"height": (0.1,)}, {"height": "high"}])
def test_quadrants_are_ranges(facts):
    with pytest.raises(InputError, match=next(iter(facts))):
        QuadrantRegion(**{"across": (0.2, 0.6), "height": (0.1, 0.6)} | facts)
