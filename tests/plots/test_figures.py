"""What the figures show is the data they got."""

from __future__ import annotations

import numpy as np
import pytest

from kinreach import plots
from kinreach.errors import InputError
from kinreach.plots import Success
from kinreach.plots.style import PALETTE
from kinreach.thesis.reward import reach_reward


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def points(axes, index=0) -> np.ndarray:
    return np.asarray(axes.lines[index].get_xydata(), dtype=float)


class TestRewards:
    def test_distance_reward(self, texts):
        figure = plots.draw_distance_reward(farthest=4.0)
        (ax,) = figure.axes
        near, far = points(ax, 0), points(ax, 1)
        assert near[:, 1] == pytest.approx(0.5 - 0.5 * np.log(near[:, 0]) / np.log(2))
        assert far[:, 1] == pytest.approx(1 - far[:, 0] / 2)
        assert near[-1] == pytest.approx([2.0, 0.0])
        assert far[[0, -1]] == pytest.approx(np.array([[2.0, 0.0], [4.0, -1.0]]))
        assert "distance d from the tcp to the goal [m]" in texts(figure)

    @pytest.mark.parametrize("epsilon", [0.1, 0.2, 0.5])
    def test_clipped_objective(self, epsilon, texts):
        figure = plots.draw_clipped_objective(epsilon=epsilon)
        better, worse = (points(ax, 1) for ax in figure.axes)
        assert better[:, 1] == pytest.approx(np.minimum(better[:, 0], 1 + epsilon))
        assert worse[:, 1] == pytest.approx(-np.maximum(worse[:, 0], 1 - epsilon))
        assert 1 + epsilon in better[:, 0]  # the bend is drawn sharp
        assert {"1 + ε", "1 − ε"} <= set(texts(figure))

    def test_sections(self, texts):
        d = np.geomspace(1e-3, 3, 400)
        home = [-1.5, -1.6, 1.6, -1.6, -1.6, 0.0]
        figure = plots.draw_reward_sections(d, {"home": reach_reward(d, home).reward, "flat": 0 * d}, title="Sections")
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
        figure = plots.draw_learning_curves(panels, title="T", xlabel="steps", note="a note")
        top, bottom = figure.axes
        assert points(top) == pytest.approx(np.column_stack([x, np.median(seeds, axis=0)]))
        band = top.collections[0].get_paths()[0].vertices
        assert {band[:, 1].min(), band[:, 1].max()} == {seeds.min(), seeds.max()}
        assert bottom.lines[0].get_color() == top.lines[1].get_color() == PALETTE[1]  # a recipe keeps its colour
        assert top.get_xlim() == bottom.get_xlim() == (1.0, 50.0)
        assert {"ours", "theirs", "reward", "reached", "steps", "a note"} <= set(texts(figure))

    def test_episode_rewards(self, rng, texts):
        rewards = rng.normal(size=5000)
        figure = plots.draw_episode_rewards(rewards, title="T", window=100)
        (ax,) = figure.axes
        assert np.asarray(ax.collections[0].get_offsets())[:, 1] == pytest.approx(rewards)
        assert points(ax)[0] == pytest.approx([100, rewards[:100].mean()])
        assert points(ax)[-1] == pytest.approx([5000, rewards[-100:].mean()])
        assert "dot: one episode · line: mean of the last 100" in texts(figure)

    def test_distances(self, texts):
        figure = plots.draw_distances({"a": [0.5, 0.05, 0.005], "b": [0.5, 0.2]}, title="T")
        (ax,) = figure.axes
        assert points(ax) == pytest.approx(np.array([[0, 500], [1, 50], [2, 5]]))
        assert ax.get_yscale() == "log"
        assert "dashed: 10 mm, near enough to reach the goal" in texts(figure)

    def test_discounted_rewards(self, rng, texts):
        steps, returns = np.arange(1, 401), rng.normal(size=400)
        figure = plots.draw_discounted_rewards(steps, returns, gamma=0.9, n_steps=100, title="T")
        (ax,) = figure.axes
        updates = [line for line in ax.lines if len(line.get_xdata()) == 2 and len(set(line.get_xdata())) == 1]
        assert [line.get_xdata()[0] for line in updates] == [100, 200, 300, 400]
        assert points(ax, 4) == pytest.approx(np.column_stack([steps, returns]))
        assert "discounted reward, $\\gamma$ = 0.9" in texts(figure)

    def test_refused(self):
        with pytest.raises(InputError, match="at least one panel"):
            plots.draw_learning_curves({}, title="", xlabel="")
        with pytest.raises(InputError, match="'a' must be positive"):
            plots.draw_distances({"a": [0.1, 0.0]}, title="")
        with pytest.raises(InputError, match="at least one episode"):
            plots.draw_distances({}, title="")


class TestMethods:
    def test_success(self, texts):
        share, interval = [1.0, 0.5, 0.2], [[0.9, 1.0], [0.4, 0.6], [0.1, 0.3]]
        figure = plots.draw_success([50, 5, 0.5], {"a": Success(share, interval), "b": Success([0, 0, 0])}, note="n")
        (ax,) = figure.axes
        assert points(ax)[:, 1] == pytest.approx([20, 50, 100])  # by growing tolerance
        assert points(ax)[:, 0] == pytest.approx([0.5, 5, 50], rel=0.05)
        bars = np.array([np.sort(path.vertices[:, 1]) for path in ax.collections[0].get_paths()])
        assert bars == pytest.approx(100 * np.array(interval)[::-1])
        assert {"a", "b", "tolerance [mm]", "0.5", "50"} <= set(texts(figure))

    @pytest.mark.parametrize(
        ("call", "message"),
        [
            (lambda: plots.draw_success([1], {}), "needs a method and positive tolerances"),
            (lambda: plots.draw_success([0, 1], {"a": Success([1, 1])}), "positive tolerances"),
            (lambda: plots.draw_success([1, 2], {"a": Success([1])}), r"'a' must have shape \(2,\), got \(1,\)"),
        ],
    )
    def test_refused(self, call, message):
        with pytest.raises(InputError, match=message):
            call()


class TestMaps:
    def test_errors(self, rng, texts):
        xy = rng.uniform([0.3, -0.3], [0.65, 0.3], (40, 2))
        errors = rng.uniform(0.1, 5, 40)
        errors[3] = np.nan
        figure = plots.draw_error_maps({"one": (xy, errors), "two": (xy, 2 * errors)}, title="T", missing="missed")
        one, two = figure.axes[:2]
        seen = np.isfinite(errors)
        assert np.asarray(one.collections[0].get_offsets()) == pytest.approx(xy[seen][:, ::-1])
        assert np.asarray(two.collections[0].get_array()) == pytest.approx(2 * errors[seen])
        assert np.asarray(one.collections[1].get_offsets()) == pytest.approx(xy[[3], ::-1])
        assert one.collections[0].norm is two.collections[0].norm  # one scale
        assert one.get_xlim()[0] > one.get_xlim()[1]  # the robot's left is the figure's
        assert any("1 missed (×)" in text for text in texts(figure))

    def test_rewards(self, texts):
        x, y = np.linspace(0.2, 0.8, 7), np.linspace(-0.5, 0.5, 11)
        reward = np.full((7, 11), 2.0)
        reward[0, 0], reward[3, 5], reward[4, 5], reward[1, 1] = -100, 20, 9.9, -25
        figure = plots.draw_reward_maps(
            {"map": plots.RewardMap(x, y, reward)}, goal=(0.5, 0.0), area=((0.3, 0.6), (-0.3, 0.3)), title="T"
        )
        impossible, possible = figure.axes[0].collections[:2]
        assert np.flatnonzero(~np.ma.getmaskarray(impossible.get_array()).ravel()).tolist() == [0]
        colours = possible.cmap(possible.norm(np.array([20.0, 9.9, 3.99])))[:, :3]
        assert len(np.unique(colours, axis=0)) == 3
        assert len(figure.axes[0].patches) == 1  # the area
        assert {"20: reached", "reward r", "x [m]", "y [m]"} <= set(texts(figure))

    @pytest.mark.parametrize(
        ("call", "message"),
        [
            (lambda: plots.draw_error_maps({}, title=""), "at least one positive error"),
            (lambda: plots.draw_error_maps({"a": ([[0, 0]], [np.nan])}, title=""), "at least one positive error"),
            (lambda: plots.draw_error_maps({"a": ([[0, 0]], [1, 2])}, title=""), r"got \(1, 2\) and \(2,\)"),
            (lambda: plots.draw_reward_maps({}, goal=(0, 0), title=""), "at least one panel"),
            (
                lambda: plots.draw_reward_maps({"a": plots.RewardMap([0, 1], [0, 1], [1])}, goal=(0, 0), title=""),
                r"'a' must have shape \(2, 2\)",
            ),
        ],
    )
    def test_refused(self, call, message):
        with pytest.raises(InputError, match=message):
            call()


class TestPictures:
    def test_side_by_side(self, rng, texts):
        pictures = {"colour": rng.integers(0, 255, (36, 64, 3), dtype=np.uint8), "depth": rng.uniform(0, 1, (36, 64))}
        figure = plots.draw_pictures(pictures, units={"depth": "[m]"})
        for ax, picture in zip(figure.axes, pictures.values(), strict=False):
            assert np.array_equal(ax.images[0].get_array(), picture)
        assert {"colour", "depth", "[m]"} <= set(texts(figure))

    def test_steps_show_the_circle(self, rng, texts):
        pictures = {name: rng.uniform(0, 1, (90, 160)) for name in "ab"}
        circles = [(120, 40, 8), (30, 50, 5)]
        figure = plots.draw_camera_steps(pictures, circles, marked="b", title="T", zoom=2.0)
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

    def test_refused(self):
        with pytest.raises(InputError, match="shape"):
            plots.draw_pictures({})
        with pytest.raises(InputError, match="shape"):
            plots.draw_pictures({"a": np.zeros(3)})
        with pytest.raises(InputError, match=r"circle must have shape \(3,\) or \(1, 3\)"):
            plots.draw_camera_steps({"a": np.zeros((9, 9))}, (1, 2), title="")
