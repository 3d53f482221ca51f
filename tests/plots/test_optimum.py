"""What figures say of local optima, of the limit of the posture error, and of errors against tolerance."""

from __future__ import annotations

import numpy as np
import pytest

from kinreach import plots
from kinreach.errors import InputError
from kinreach.thesis.reward import IMPOSSIBLE_REWARD

HEIGHTS = np.linspace(0.0, 0.1, 11)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def points(line) -> np.ndarray:
    return np.asarray(line.get_xydata(), dtype=float)


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
            figure = plots.draw_local_optimum(offsets, {"j": line}, HEIGHTS, {"1°": HEIGHTS}, title="T")
            shown, borders = (points(one) for one in figure.axes[0].lines[:2])
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
        figure = plots.draw_local_optimum([-0.1, 0.1], {"j": [1, 2]}, HEIGHTS, explored, title="T", note="N")
        lines = figure.axes[1].lines
        assert points(lines[0]) == pytest.approx(np.column_stack([1e3 * HEIGHTS, explored["0.5°"]]))
        assert points(lines[1]) == pytest.approx(np.array([[0.0, 10.0]]))
        assert points(lines[3]) == pytest.approx(np.array([[40.0, 2.0]]))
        assert {"0.5°", "3°", "height above the goal [mm]", "change of one joint [°]", "N"} <= set(texts(figure))

    def test_losses_are_drawn_upright(self):
        """Also where every height costs."""
        figure = plots.draw_local_optimum(
            [-1, 1], {"j": [1, 2]}, HEIGHTS, {"a": -2 - HEIGHTS, "b": 0 * HEIGHTS - 3}, title=""
        )
        low, high = figure.axes[1].get_ylim()
        assert low < -3 < -2 < high

    @pytest.mark.parametrize(
        ("offsets", "joints", "heights", "explored", "message"),
        [
            ([0, 1], {}, [0, 1], {"a": [1, 1]}, "reward for an offset each"),
            ([0, 1], {"j": [1, 2, 3]}, [0, 1], {"a": [1, 1]}, "reward for an offset each"),
            ([0], {"j": [1]}, [0, 1], {"a": [1, 1]}, "two or more"),
            ([0, 1], {"j": [1, 2]}, [0, 1], {}, "reward for a height each"),
            ([0, 1], {"j": [1, 2]}, [0, 1], {"a": [1]}, "reward for a height each"),
            ([1, 0], {"j": [1, 2]}, [0, 1], {"a": [1, 1]}, "at increasing places"),
            ([0, np.nan], {"j": [1, 2]}, [0, 1], {"a": [1, 1]}, "finite rewards at increasing"),
            ([0, 1], {"j": [1, 2]}, [0, 1], {"a": [1, np.inf]}, "reward of a must be within"),
        ],
    )
    def test_refused(self, offsets, joints, heights, explored, message):
        with pytest.raises(InputError, match=message):
            plots.draw_local_optimum(offsets, joints, heights, explored, title="")


class TestPostureErrors:
    def test_shares(self, rng, texts):
        errors = {"a": rng.uniform(0, 0.2, 300), "b": rng.uniform(0.3, 0.5, 200)}
        figure = plots.draw_posture_errors(errors, title="T", widest=0.4)
        (ax,) = figure.axes
        edges = np.linspace(0, 0.4, 81)
        for patch, sample in zip(ax.patches, errors.values(), strict=True):
            shares = np.histogram(sample, edges)[0] / len(sample)
            assert shares.max() > 0.01
            assert {round(y, 9) for y in patch.get_path().vertices[:, 1]} == {0.0, *np.round(shares, 9)}
        assert {"a", "b", "dashed: 0.15 rad, below which the goal counts as reached"} <= set(texts(figure))

    def test_refused(self):
        for nothing in ({}, {"a": []}):
            with pytest.raises(InputError, match="at least one step"):
                plots.draw_posture_errors(nothing, title="")


class TestErrorBands:
    def test_median_and_middle(self, rng, texts):
        tolerances = [0.1, 0.001, 0.01]
        errors = {name: rng.uniform(0.1, 9, (3, 400)) for name in ("closed form", "policy")}
        figure = plots.draw_error_bands(tolerances, errors, title="T", xlabel="tolerance [rad]", limit=10.0)
        (ax,) = figure.axes
        order = np.argsort(tolerances)
        for line, band, sample in zip(ax.lines, ax.collections, errors.values(), strict=False):
            assert points(line)[:, 0].tolist() == [0.001, 0.01, 0.1]
            assert points(line)[:, 1] == pytest.approx(np.median(sample, axis=1)[order])
            corners = {round(y, 9) for y in band.get_paths()[0].vertices[:, 1]}
            assert {round(y, 9) for y in np.percentile(sample, (5, 95), axis=1).ravel()} == corners
        assert ax.get_xscale() == ax.get_yscale() == "log"
        assert points(ax.lines[2])[:, 1].tolist() == [10.0, 10.0]
        shown = "line: median · band: 90 % of the goals · dashed: 10, which is allowed"
        assert {"closed form", "policy", "tolerance [rad]", "0.001", "T", shown} <= set(texts(figure))

    @pytest.mark.parametrize(
        ("tolerances", "errors", "message"),
        [
            ([1.0], {}, "need a method and positive tolerances"),
            ([0.0], {"a": [[1.0]]}, "need a method and positive tolerances"),
            ([1.0, 2.0], {"a": [[1.0]]}, r"'a' must be positive, of shape \(2, n\), got \(1, 1\)"),
            ([1.0], {"a": [[0.0]]}, "'a' must be positive"),
            ([1.0], {"a": [[]]}, "'a' must be positive"),
            ([1.0], {"a": [[np.inf]]}, "must be"),
            ([np.inf], {"a": [[1.0]]}, "positive tolerances|tolerances must be"),
            ([1.0], {"a": [[np.nan]]}, "'a' must be positive"),
        ],
    )
    def test_refused(self, tolerances, errors, message):
        with pytest.raises(InputError, match=message):
            plots.draw_error_bands(tolerances, errors, title="", xlabel="")
        with pytest.raises(InputError, match=r"limit must be finite and above 0 .*, got 0"):
            plots.draw_error_bands([1.0], {"a": [[1.0]]}, title="", xlabel="", limit=0)
