"""The notebooks' figures show the data that they are given."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.patches import Circle

from kinreach.plots import PALETTE
from kinreach.robots import CameraMount
from kinreach.thesis import reach_reward
from kinreach.thesis.inside import IMPOSSIBLE_REWARD
from notebooks import figures
from notebooks.figures import Success, moving_mean, seed_band

pytestmark = pytest.mark.slow

CASES = 50
HEIGHTS = np.linspace(0.0, 0.1, 11)
TARGET = [0.3, -0.4, 0.25]


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def line_points(line) -> np.ndarray:
    return np.asarray(line.get_xydata(), dtype=float)


def points(axes, index=0) -> np.ndarray:
    return line_points(axes.lines[index])


def filled(axes):
    """Errors of a map's cells, NaN where there is none."""
    return np.ma.filled(np.ma.asarray(axes.collections[1].get_array(), dtype=float), np.nan)


class TestRewards:
    def test_distance_reward(self, texts):
        figure = figures.draw_distance_reward(farthest=4.0)
        (ax,) = figure.axes
        near, far = points(ax, 0), points(ax, 1)
        assert near[:, 1] == pytest.approx(0.5 - 0.5 * np.log(near[:, 0]) / np.log(2))
        assert far[:, 1] == pytest.approx(1 - far[:, 0] / 2)
        assert near[-1] == pytest.approx([2.0, 0.0])
        assert far[[0, -1]] == pytest.approx(np.array([[2.0, 0.0], [4.0, -1.0]]))
        assert "distance d from the tcp to the goal [m]" in texts(figure)

    @pytest.mark.parametrize("epsilon", [0.1, 0.2, 0.5])
    def test_clipped_objective(self, epsilon, texts):
        figure = figures.draw_clipped_objective(epsilon=epsilon)
        better, worse = (points(ax, 1) for ax in figure.axes)
        assert better[:, 1] == pytest.approx(np.minimum(better[:, 0], 1 + epsilon))
        assert worse[:, 1] == pytest.approx(-np.maximum(worse[:, 0], 1 - epsilon))
        assert 1 + epsilon in better[:, 0]  # the bend is drawn sharp
        assert {"1 + ε", "1 − ε"} <= set(texts(figure))

    def test_sections(self, texts):
        d = np.geomspace(1e-3, 3, 400)
        home = [-1.5, -1.6, 1.6, -1.6, -1.6, 0.0]
        figure = figures.draw_reward_sections(
            d, {"home": reach_reward(d, home).reward, "flat": 0 * d}, title="Sections"
        )
        (ax,) = figure.axes
        assert points(ax) == pytest.approx(np.column_stack([1e3 * d, reach_reward(d, home).reward]))
        assert {"home", "flat", "Sections"} <= set(texts(figure))


class TestLearning:
    def test_curves(self, rng, texts):
        x = np.arange(1.0, 51.0)
        seeds = rng.normal(size=(5, 50))
        panels = {
            "reward": {"ours": [(x, y) for y in seeds], "theirs": [(x, seeds[0] - 9)]},
            "reached": {"theirs": [(x, x)]},
        }
        figure = figures.draw_learning_curves(panels, title="T", xlabel="steps", note="a note")
        top, bottom = figure.axes
        assert points(top) == pytest.approx(np.column_stack([x, np.median(seeds, axis=0)]))
        band = top.collections[0].get_paths()[0].vertices
        assert {band[:, 1].min(), band[:, 1].max()} == {seeds.min(), seeds.max()}
        assert bottom.lines[0].get_color() == top.lines[1].get_color() == PALETTE[1]  # a recipe keeps its colour
        assert top.get_xlim() == bottom.get_xlim() == (1.0, 50.0)
        assert {"ours", "theirs", "reward", "reached", "steps", "a note"} <= set(texts(figure))

    def test_episode_rewards(self, rng, texts):
        rewards = np.where(rng.random(5000) < 0.2, IMPOSSIBLE_REWARD, rng.normal(size=5000))
        possible, at = rewards[rewards > -100], 1 + np.flatnonzero(rewards > -100)
        figure = figures.draw_episode_rewards(rewards, title="T", window=100, marks={"theirs": (2000, 2.0)})
        for ax in figure.axes:
            assert np.asarray(ax.collections[0].get_offsets())[:, 1] == pytest.approx(rewards)
            assert points(ax)[0] == pytest.approx([at[99], possible[:100].mean()])
            assert points(ax)[-1] == pytest.approx([at[-1], possible[-100:].mean()])
        near, whole = figure.axes
        assert near.get_ylim() == (-6.0, 4.0)
        assert points(near, 1)[0] == pytest.approx([2000, 2.0])
        assert whole.get_ylim()[0] < -100
        assert {"theirs", "dot: one episode · line: mean of the last 100 that were possible"} <= set(texts(figure))

    def test_distances(self, texts):
        figure = figures.draw_distances({"a": [0.5, 0.05, 0.005], "b": [0.5, 0.2]}, title="T", marks={"m": (1, 0.03)})
        (ax,) = figure.axes
        assert points(ax) == pytest.approx(np.array([[0, 500], [1, 50], [2, 5]]))
        assert points(ax, 2)[0] == pytest.approx([1, 30])
        assert ax.get_yscale() == "log"
        (linear,) = figures.draw_distances({"a": [0.5, 0.05]}, title="T", log=False).axes
        assert (linear.get_yscale(), linear.get_ylim()[0]) == ("linear", 0.0)
        assert "dashed: 10 mm, near enough to reach the goal" in texts(figure)

    def test_discounted_rewards(self, rng, texts):
        steps, returns = np.arange(1, 401), rng.normal(size=400)
        figure = figures.draw_discounted_rewards(steps, returns, gamma=0.9, n_steps=100, title="T")
        (ax,) = figure.axes
        updates = [line for line in ax.lines if len(line.get_xdata()) == 2 and len(set(line.get_xdata())) == 1]
        assert [line.get_xdata()[0] for line in updates] == [100, 200, 300, 400]
        dots = np.asarray(ax.collections[0].get_offsets(), dtype=float)
        assert dots == pytest.approx(np.column_stack([steps, returns]))
        values, edges, _ = ax.patches[0].get_data()
        assert values == pytest.approx([np.median(returns[100 * k : 100 * k + 100]) for k in range(4)])
        assert edges.tolist() == [0, 100, 200, 300, 400]
        assert np.diff(ax.get_ylim()) < 6 * np.diff(np.percentile(returns, (25, 75)))
        assert "discounted reward, $\\gamma$ = 0.9" in texts(figure)


class TestMethods:
    def test_success(self, texts):
        share, interval = [1.0, 0.5, 0.2], [[0.9, 1.0], [0.4, 0.6], [0.1, 0.3]]
        figure = figures.draw_success([50, 5, 0.5], {"a": Success(share, interval), "b": Success([0, 0, 0])}, note="n")
        (ax,) = figure.axes
        assert points(ax)[:, 1] == pytest.approx([20, 50, 100])  # by growing tolerance
        assert points(ax)[:, 0] == pytest.approx([0.5, 5, 50], rel=0.05)
        bars = np.array([np.sort(path.vertices[:, 1]) for path in ax.collections[0].get_paths()])
        assert bars == pytest.approx(100 * np.array(interval)[::-1])
        assert {"a", "b", "tolerance [mm]", "0.5", "50"} <= set(texts(figure))


class TestMaps:
    def test_errors(self, rng, texts):
        xy = rng.uniform([0.3, -0.3], [0.65, 0.3], (40, 2))
        errors = rng.uniform(0.1, 5, 40)
        errors[3] = np.nan
        figure = figures.draw_error_maps({"one": (xy, errors), "two": (xy, 2 * errors)}, title="T", missing="missed")
        one, two = figure.axes[:2]
        cells = [filled(ax) for ax in (one, two)]
        assert set(np.unique(cells[0][np.isfinite(cells[0])])) == set(
            errors[np.isfinite(errors)]
        )  # every goal has cells
        np.testing.assert_array_equal(cells[1], 2 * cells[0])
        assert np.asarray(one.collections[-1].get_offsets()) == pytest.approx(xy[[3], ::-1])
        assert one.collections[1].norm is two.collections[1].norm  # one scale
        assert one.get_xlim()[0] > one.get_xlim()[1]  # the robot's left is the figure's
        assert any("1 missed (×)" in text for text in texts(figure))

    def test_rewards(self, texts):
        x, y = np.linspace(0.2, 0.8, 7), np.linspace(-0.5, 0.5, 11)
        reward = np.full((7, 11), 2.0)
        reward[0, 0], reward[3, 5], reward[4, 5], reward[1, 1] = -100, 20, 9.9, -25
        figure = figures.draw_reward_maps(
            {"map": figures.RewardMap(x, y, reward)}, goal=(0.5, 0.0), area=((0.3, 0.6), (-0.3, 0.3)), title="T"
        )
        impossible, possible = figure.axes[0].collections[:2]
        assert np.flatnonzero(~np.ma.getmaskarray(impossible.get_array()).ravel()).tolist() == [0]
        colours = possible.cmap(possible.norm(np.array([20.0, 9.9, 3.99])))[:, :3]
        assert len(np.unique(colours, axis=0)) == 3
        assert len(figure.axes[0].patches) == 1  # the area
        assert {"20: reached", "reward r", "x [m]", "y [m]"} <= set(texts(figure))


class TestPictures:
    def test_side_by_side(self, rng, texts):
        pictures = {"colour": rng.integers(0, 255, (36, 64, 3), dtype=np.uint8), "depth": rng.uniform(0, 1, (36, 64))}
        figure = figures.draw_pictures(pictures, units={"depth": "[m]"})
        for ax, picture in zip(figure.axes, pictures.values(), strict=False):
            assert np.array_equal(ax.images[0].get_array(), picture)
        assert {"colour", "depth", "[m]"} <= set(texts(figure))

    def test_steps_show_the_circle(self, rng, texts):
        pictures = {name: rng.uniform(0, 1, (90, 160)) for name in "ab"}
        circles = [(120, 40, 8), (30, 50, 5)]
        figure = figures.draw_camera_steps(pictures, circles, marked="b", title="T", zoom=2.0)
        texts(figure)
        for ax, (u, v, r) in zip(figure.axes, circles, strict=False):
            (inset,) = ax.child_axes
            assert inset.get_xlim() == (u - 2 * r, u + 2 * r)
            assert inset.get_ylim() == (v + 2 * r, v - 2 * r)
            # the corner that is farther from the ball
            assert (inset.get_position().x0 < ax.get_position().x0 + ax.get_position().width / 2) == (u > 80)
        marks = [[p for p in ax.patches if hasattr(p, "get_radius")] for ax in figure.axes]
        assert [len(m) for m in marks] == [0, 2]
        assert {(*m.center, m.radius) for m in marks[1]} == {circles[1]}


class TestNamedPlaces:
    def test_a_point_is_where_the_camera_renders_it(self, rng):
        """The middle of the picture is the target; what is nearer the right edge is to the camera's right."""
        cases = 0
        for _ in range(50):
            position, target = rng.uniform(-2, 2, (2, 3))
            mount = CameraMount("c", "world", tuple(position), tuple(target), fovy=float(rng.uniform(20, 90)))
            ahead = (target - position) / np.linalg.norm(target - position)
            right = np.cross(ahead, (0, 0, 1))
            right /= np.linalg.norm(right)
            points = [target, target + 0.1 * right, target + 0.1 * np.cross(right, ahead)]
            middle, beside, above = figures.places_in_picture(mount, points, width=640, height=480)
            assert middle == pytest.approx([319.5, 239.5])
            assert (beside[0] > middle[0], above[1] < middle[1]) == (True, True)
            assert (beside[1], above[0]) == pytest.approx((middle[1], middle[0]))
            cases += 1
        assert cases == 50

    def test_names_are_beside_their_dots_and_apart(self, rng, texts):
        for _ in range(10):
            places = {f"j{i}": rng.uniform((0, 0), (640, 480)) for i in range(6)}
            figure = figures.draw_named_places(np.zeros((480, 640, 3), dtype=np.uint8), places, title="T")
            (ax,) = figure.axes
            assert {*places, "T"} <= set(texts(figure))
            dots = {tuple(np.ravel(line.get_xydata())) for line in ax.lines}
            assert dots == {tuple(place) for place in places.values()}
            for side in ("left", "right"):
                heights = sorted(text.get_position()[1] for text in ax.texts if text.get_ha() == side)
                assert (np.diff(heights) > 0.08 * 480).all()


class TestLocalOptimum:
    def test_impossible_stretches_are_gaps_with_marked_borders(self, rng, texts):
        """However often a joint gets impossible and possible again, at both ends too."""
        offsets = np.linspace(-0.2, 0.2, 60)
        cases = 0
        for _ in range(50):
            reward = rng.uniform(0, 4, 60)
            impossible = np.repeat(rng.random(12) < 0.4, 5)
            if impossible.all():
                continue
            line = np.where(impossible, IMPOSSIBLE_REWARD, reward)
            figure = figures.draw_local_optimum(offsets, {"j": line}, HEIGHTS, {"1°": HEIGHTS}, title="T")
            shown, borders = (line_points(one) for one in figure.axes[0].lines[:2])
            assert np.isnan(shown[:, 1]).tolist() == impossible.tolist()
            assert shown[~impossible] == pytest.approx(np.column_stack([np.degrees(offsets), reward])[~impossible])
            beside = [
                i
                for i in range(60)
                if not impossible[i] and impossible[max(i - 1, 0) : i + 2].any()
            ]  # fmt: skip
            assert borders[:, 0] == pytest.approx(np.degrees(offsets)[beside])
            cases += 1
        assert cases > 40
        assert "×: beyond it the posture is impossible, −100" in texts(figure)

    def test_the_best_height_is_marked(self, rng, texts):
        explored = {"0.5°": 10 - 100 * HEIGHTS, "3°": 2 - 50 * (HEIGHTS - 0.04) ** 2}
        figure = figures.draw_local_optimum([-0.1, 0.1], {"j": [1, 2]}, HEIGHTS, explored, title="T", note="N")
        lines = figure.axes[1].lines
        assert line_points(lines[0]) == pytest.approx(np.column_stack([1e3 * HEIGHTS, explored["0.5°"]]))
        assert line_points(lines[1]) == pytest.approx(np.array([[0.0, 10.0]]))
        assert line_points(lines[3]) == pytest.approx(np.array([[40.0, 2.0]]))
        assert {"0.5°", "3°", "height above the goal [mm]", "change of one joint [°]", "N"} <= set(texts(figure))

    def test_losses_are_drawn_upright(self):
        """Also where every height costs."""
        figure = figures.draw_local_optimum(
            [-1, 1], {"j": [1, 2]}, HEIGHTS, {"a": -2 - HEIGHTS, "b": 0 * HEIGHTS - 3}, title=""
        )
        low, high = figure.axes[1].get_ylim()
        assert low < -3 < -2 < high


class TestPostureErrors:
    def test_shares(self, rng, texts):
        errors = {"a": rng.uniform(0, 0.2, 300), "b": rng.uniform(0.3, 0.5, 200)}
        figure = figures.draw_posture_errors(errors, title="T", widest=0.4)
        (ax,) = figure.axes
        edges = np.linspace(0, 0.4, 81)
        for patch, sample in zip(ax.patches, errors.values(), strict=True):
            shares = np.histogram(sample, edges)[0] / len(sample)
            assert shares.max() > 0.01
            assert {round(y, 9) for y in patch.get_path().vertices[:, 1]} == {0.0, *np.round(shares, 9)}
        assert {"a", "b", "dashed: 0.15 rad, below which the goal counts as reached"} <= set(texts(figure))


class TestErrorBands:
    def test_median_and_middle(self, rng, texts):
        tolerances = [0.1, 0.001, 0.01]
        errors = {name: rng.uniform(0.1, 9, (3, 400)) for name in ("closed-form", "policy")}
        figure = figures.draw_error_bands(tolerances, errors, title="T", xlabel="tolerance [rad]", limit=10.0)
        (ax,) = figure.axes
        order = np.argsort(tolerances)
        for line, band, sample in zip(ax.lines, ax.collections, errors.values(), strict=False):
            assert line_points(line)[:, 0].tolist() == [0.001, 0.01, 0.1]
            assert line_points(line)[:, 1] == pytest.approx(np.median(sample, axis=1)[order])
            corners = {round(y, 9) for y in band.get_paths()[0].vertices[:, 1]}
            assert {round(y, 9) for y in np.percentile(sample, (5, 95), axis=1).ravel()} == corners
        assert ax.get_xscale() == ax.get_yscale() == "log"
        assert line_points(ax.lines[2])[:, 1].tolist() == [10.0, 10.0]
        shown = "line: median · band: 90 % of the goals · dashed: 10, which is allowed"
        assert {"closed-form", "policy", "tolerance [rad]", "0.001", "T", shown} <= set(texts(figure))


def test_from_above_and_from_the_side(texts):
    rng = np.random.default_rng(0)
    ways = {"analytic": rng.normal(size=(30, 3)), "ppo": rng.normal(size=(12, 3))}
    figure = figures.draw_paths(ways, TARGET, radius=0.05, title="The way")
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


def test_distances_have_the_limit_that_is_asked_for(texts):
    figure = figures.draw_distances({"ppo": [0.5, 0.2, 0.01]}, near=0.05, title="Distances")
    assert "dashed: 50 mm, near enough to reach the goal" in texts(figure)


def test_limits_change_colours_but_no_numbers(texts):
    errors = np.array([1e-12, 3e-12, 5e-12, 2e-12, 2e-9])
    figure = figures.draw_error_maps({"a": (np.zeros((5, 2)), errors)}, title="", limits=(1e-2, 1.0))
    assert "median 3e-12, max 2e-09" in texts(figure)
    cells = filled(figure.axes[0])
    assert set(cells[np.isfinite(cells)]) == {0.01}


def test_band_holds_every_seed():
    cases = 0
    for seed in range(CASES):
        rng = np.random.default_rng(seed)
        x = np.cumsum(rng.uniform(0.1, 2.0, 30))
        ys = rng.normal(size=(int(rng.integers(1, 7)), 30))
        band = seed_band([(x, y) for y in ys])
        assert np.array_equal(band.x, x)
        assert np.array_equal(band.median, np.median(ys, axis=0))
        assert (band.low <= ys).all()
        assert (ys <= band.high).all()
        assert (band.low == ys.min(axis=0)).all()
        cases += 1
    assert cases == CASES


def test_band_of_seeds_that_logged_elsewhere():
    """A straight line is the same wherever it was sampled; what one seed has not reached is left out."""
    first, second = np.arange(0.0, 101.0, 10.0), np.arange(5.0, 66.0, 3.0)
    band = seed_band([(first, 2 * first), (second, 2 * second + 4)])
    assert band.x.tolist() == [10, 20, 30, 40, 50, 60]
    assert band.median == pytest.approx(2 * band.x + 2)
    assert band.high - band.low == pytest.approx(np.full(6, 4.0))


def test_band_leaves_out_what_was_not_logged():
    x = np.arange(6.0)
    band = seed_band([(x, [np.nan, 1, 2, np.nan, 4, 5]), (x, x + 1)])
    assert band.x.tolist() == [1, 2, 4, 5]
    assert band.median == pytest.approx(band.x + 0.5)


def test_moving_mean_is_a_convolution():
    cases = 0
    for seed in range(CASES):
        rng = np.random.default_rng(seed)
        values, window = rng.normal(size=60), int(rng.integers(1, 60))
        means = moving_mean(values, window)
        assert means[window - 1 :] == pytest.approx(np.convolve(values, np.full(window, 1 / window), mode="valid"))
        assert means[:window] == pytest.approx([values[: k + 1].mean() for k in range(window)])
        cases += 1
    assert cases == CASES
