"""Ways of an end effector: both views show the positions that were given."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.patches import Circle

from kinreach import plots
from kinreach.errors import InputError

TARGET = [0.3, -0.4, 0.25]


def test_from_above_and_from_the_side(texts):
    rng = np.random.default_rng(0)
    ways = {"analytic": rng.normal(size=(30, 3)), "ppo": rng.normal(size=(12, 3))}
    figure = plots.draw_paths(ways, TARGET, radius=0.05, title="The way")
    above, side = figure.axes
    for index, way in enumerate(ways.values()):
        np.testing.assert_allclose(above.lines[2 * index].get_xydata(), way[:, :2])
        np.testing.assert_allclose(
            side.lines[2 * index].get_xydata(), np.column_stack([np.linalg.norm(way[:, :2], axis=1), way[:, 2]])
        )
        np.testing.assert_allclose(above.lines[2 * index + 1].get_xydata(), [way[-1, :2]])
    circles = [next(p for p in ax.patches if isinstance(p, Circle)) for ax in figure.axes]
    np.testing.assert_allclose([circle.center for circle in circles], [(0.3, -0.4), (0.5, 0.25)])
    assert [circle.radius for circle in circles] == [0.05, 0.05]
    assert {"The way", "analytic", "ppo", "x [m]", "y [m]", "z [m]"} <= set(texts(figure))


@pytest.mark.parametrize(
    ("paths", "target", "message"),
    [
        ({}, TARGET, "at least one"),
        ({"ppo": np.zeros((4, 2))}, TARGET, "'ppo'.*got \\(4, 2\\)"),
        ({"ppo": np.zeros((0, 3))}, TARGET, "'ppo'"),
        ({"ppo": np.full((4, 3), np.nan)}, TARGET, "finite"),
        ({"ppo": np.zeros((4, 3))}, [0.0, np.inf, 0.0], "target"),
    ],
)
def test_what_cannot_be_drawn_is_refused(paths, target, message):
    with pytest.raises(InputError, match=message):
        plots.draw_paths(paths, target, radius=0.05, title="")


def test_distances_have_the_limit_that_is_asked_for(texts):
    figure = plots.draw_distances({"ppo": [0.5, 0.2, 0.01]}, near=0.05, title="Distances")
    assert "dashed: 50 mm, near enough to reach the goal" in texts(figure)
