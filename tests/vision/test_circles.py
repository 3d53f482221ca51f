"""The steps of the thesis's search, against other libraries and against a count by hand."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy import ndimage

from kinreach.errors import InputError
from kinreach.vision import circle_votes, edge_steps


def disk(u: float, v: float, r: float) -> np.ndarray:
    """A red disk on grey."""
    rows, columns = np.mgrid[:90, :160]
    rgb = np.full((90, 160, 3), 150, dtype=np.uint8)
    rgb[np.hypot(rows - v, columns - u) < r] = (220, 10, 10)
    return rgb


def test_sobel_is_the_thesis_kernel():
    """Section 2.2.1: k_x and k_y, as a convolution by SciPy."""
    kx = np.array([[1, 0, -1], [2, 0, -2], [1, 0, -1]])
    cases = 0
    for seed in range(10):
        rgb = np.random.default_rng(seed).integers(0, 256, (40, 60, 3), dtype=np.uint8)
        steps = edge_steps(rgb)
        x, y = (ndimage.convolve(steps.grey, kernel, mode="mirror") for kernel in (kx, kx.T))
        assert steps.sobel == pytest.approx(np.hypot(x, y))
        cases += 1
    assert cases == 10


def test_edges_are_thin_and_on_the_outline():
    cases = 0
    for seed in range(20):
        u, v, r = np.random.default_rng(seed).uniform([40, 30, 8], [120, 60, 20])
        rows, columns = np.nonzero(edge_steps(disk(u, v, r)).edges)
        assert len(rows) > 4 * r  # of the 2 pi r pixels of the outline
        assert len(rows) < 9 * r
        assert np.abs(np.hypot(rows - v, columns - u) - r).max() < 1.6
        cases += 1
    assert cases == 20


def test_edges_are_those_that_the_search_uses():
    """OpenCV's Hough transform takes `param1` as Canny's upper threshold and half of it as the lower."""
    rgb = disk(80, 45, 15)
    grey = cv2.GaussianBlur(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), (0, 0), 1.0)
    assert np.array_equal(edge_steps(rgb).edges, cv2.Canny(grey, 50.0, 100.0) > 0)


def test_votes_are_distances_counted():
    cases = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        edges, radius = rng.random((20, 30)) < 0.05, float(rng.uniform(0.5, 12))
        rows, columns = np.nonzero(edges)
        at = np.mgrid[:20, :30]
        expected = sum((abs(np.hypot(at[0] - v, at[1] - u) - radius) < 0.5) for v, u in zip(rows, columns, strict=True))
        assert np.array_equal(circle_votes(edges, radius), expected)
        cases += len(rows)
    assert cases > 300


def test_most_votes_are_in_the_centre():
    cases = 0
    for seed in range(20):
        u, v, r = np.random.default_rng(seed).uniform([40, 30, 8], [120, 60, 20])
        votes = circle_votes(edge_steps(disk(u, v, r)).edges, r)
        row, column = np.unravel_index(votes.argmax(), votes.shape)
        assert np.hypot(row - v, column - u) < 2.0
        cases += 1
    assert cases == 20


def test_refused():
    with pytest.raises(InputError, match="rgb must be uint8"):
        edge_steps(np.zeros((4, 4, 3)))
    with pytest.raises(InputError, match="edges must be bool"):
        circle_votes(np.zeros((4, 4)), 2.0)
    with pytest.raises(InputError, match=r"radius must be finite and at least 0\.5 .*, got 0"):
        circle_votes(np.zeros((4, 4), dtype=bool), 0.0)
