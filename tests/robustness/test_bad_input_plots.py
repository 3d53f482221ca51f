"""Figures under fuzz: data that cannot be drawn is refused, all other is drawn to the last pixel."""

import warnings
from io import BytesIO

import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from kinreach import plots
from tests.robustness.fuzzing import NUMBERS, bad_arrays, things

NAMES = st.sampled_from(["a", "lm", "$", "$\\frac{$", "\\$", "a$b$c", "<b>&", "%s{}", "x" * 80, "é", "line\nbreak"])


def drawn(figure):
    """A figure really is one only when its pixels are there."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "constrained_layout not applied|Glyph .* missing", UserWarning)
        figure.savefig(BytesIO(), dpi=30)


def line(n=5, low=-3.0, high=3.0):
    return arrays(np.float64, n, elements=st.floats(low, high)) | bad_arrays((n,))


def mapping(values):
    return st.dictionaries(NAMES, values, max_size=3)


GROWING = st.lists(st.floats(0, 1e6), min_size=1, max_size=6, unique=True).map(sorted).map(np.array)
RUNS = st.lists(
    st.tuples(GROWING, line()) | GROWING.map(lambda x: (x, np.sin(x))) | st.tuples(line(), line()), max_size=3
)
GRIDS = st.tuples(line(3), line(4), bad_arrays((3, 4)) | arrays(np.float64, (3, 4), elements=st.floats(-100, 20)))
POINTS = st.tuples(bad_arrays((5, 2)) | arrays(np.float64, (5, 2), elements=st.floats(-1, 1)), line(5, 1e-6, 10))
SHARES = st.builds(plots.Success, line(5, 0, 1), st.none() | bad_arrays((5, 2)) | arrays(np.float64, (5, 2)))
DRAWINGS = {
    "learning_curves": (
        st.tuples(mapping(mapping(RUNS))), lambda panels: plots.draw_learning_curves(panels, title="t", xlabel="x"),
    ),
    "episode_rewards": (
        st.tuples(line(), st.none() | line(), st.integers(1, 3) | NUMBERS | things()),
        lambda rewards, at, window: plots.draw_episode_rewards(rewards, title="t", at=at, window=window),
    ),
    "distances": (st.tuples(mapping(line(5, 1e-6, 3))), lambda episodes: plots.draw_distances(episodes, title="t")),
    "discounted_rewards": (
        st.tuples(GROWING | line(), line(), st.floats(0, 1) | NUMBERS, st.integers(1, 9) | NUMBERS | things()),
        lambda x, y, gamma, n: plots.draw_discounted_rewards(x, y, gamma=gamma, n_steps=n, title="t"),
    ),
    "error_maps": (st.tuples(mapping(POINTS)), lambda maps: plots.draw_error_maps(maps, title="t")),
    "reward_maps": (
        st.tuples(mapping(GRIDS.map(lambda grid: plots.RewardMap(*grid)))),
        lambda maps: plots.draw_reward_maps(maps, goal=(0.4, 0.0), title="t"),
    ),
    "success": (st.tuples(line(5, 1e-3, 10), mapping(SHARES)), plots.draw_success),
    "posture_errors": (st.tuples(mapping(line(5, 0, 1))), lambda errors: plots.draw_posture_errors(errors, title="t")),
    "pentagon": (
        st.tuples(bad_arrays((6,)) | arrays(np.float64, 6, elements=st.floats(-3, 3)), st.floats(-1, 0) | NUMBERS),
        lambda q, ground: plots.draw_pentagons({"$": plots.pentagon_of(q, ground=ground)}),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", DRAWINGS)
def test_figures(name, fuzzed):
    cases, draw = DRAWINGS[name]
    fuzzed(cases, lambda case: drawn(draw(*case)), share=0.12, least=0.5)


def test_series(fuzzed):
    def run(case):
        which, values, flags, number = case
        if which == "mean":
            assert plots.moving_mean(values, number).shape == np.shape(values)
        elif which == "block":
            ends, counts = plots.per_block(values, number)
            assert ends.shape == counts.shape
        elif which == "returns":
            assert plots.discounted_returns(values, flags, number).shape == np.shape(values)
        else:
            band = plots.seed_band(values)
            assert (band.low <= band.median).all()
            assert (band.median <= band.high).all()

    number = st.integers(1, 4) | NUMBERS | things() | st.floats(0, 1)
    flags = arrays(np.bool_, 5) | line()
    series = st.tuples(st.sampled_from(["mean", "block", "returns"]), line(), flags, number)
    fuzzed(series | st.tuples(st.just("band"), RUNS | things(), flags, number), run)
